"""A run of episodes says what was asked: who drives, where, under which conditions, and with which versions."""

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from eyechart.errors import LedgerError, SpecError
from eyechart.limits import Spent
from eyechart.manifest import RUN, is_run
from eyechart.modes import RequestMode
from eyechart.perception.view import NONE
from eyechart.prompts import Prompt
from eyechart.spaces.discrete import READER, Discrete

FORMAT = "eyechart-episodes/1"
BESIDE = ("vetting.json",)
"""What may stand in a folder before its run begins: which worlds the structured study's online run chose."""

_MAY_GROW = ("scenarios", "seeds", "conditions")
_AS_BEGUN = ("simulator", "seed", "view", "prompt", "world", "reader", "silence")


@dataclass(frozen=True, slots=True)
class EpisodesManifest:
    """What a run of episodes was planned to do: every policy in every scenario, seed and condition.

    ``policies`` maps a SPEC to the version of what drives: a model's own, the counts of a marginal, or nothing.
    ``picture`` is the kind of picture in words. ``world`` holds the versions of the libraries that make the world,
    ``versions`` all that may matter. ``modes`` and ``facts`` say how each model was asked and what is known of it;
    ``reader`` is the version of what reads their replies, ``view`` the key of the view that they are shown pictures
    through, ``none`` where they are shown as they are. ``max_steps`` is the largest bound on decisions that was asked
    for; each episode says under which it was driven. ``probes`` says what it took to probe a model before the run.
    ``silence`` is one of `SILENCES`: what becomes of a call that fails in a way that may pass.
    """

    created: str
    simulator: str
    scenarios: tuple[str, ...]
    seeds: tuple[int, ...]
    conditions: tuple[str, ...]
    policies: Mapping[str, str]
    action_space: Discrete
    picture: str
    prompt: Prompt
    seed: int
    max_steps: int
    world: Mapping[str, str]
    versions: Mapping[str, str]
    modes: Mapping[str, RequestMode] = field(default_factory=dict)
    facts: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    reader: int = READER
    view: str = NONE
    probes: Mapping[str, Spent] = field(default_factory=dict)
    silence: str = "unfinished"

    @property
    def models(self) -> tuple[str, ...]:
        """Return the policies that are models."""
        return tuple(self.modes)

    def mode(self, spec: str) -> RequestMode:
        """Return how a model was asked."""
        return self.modes.get(spec) or RequestMode(spec)

    def spent_before(self) -> Spent:
        """Return what probing took, of all models together."""
        return Spent.together(self.probes.values())

    def extended(self, other: "EpisodesManifest") -> "EpisodesManifest":
        """Return this manifest with another's policies, scenarios, seeds and conditions added, under the wider bound.

        Raises LedgerError that names what differs where the two cannot be one run.
        """
        for name in _AS_BEGUN:
            mine, theirs = getattr(self, name), getattr(other, name)
            if mine != theirs:
                shown = (mine.key, theirs.key) if isinstance(mine, Prompt) else (mine, theirs)
                raise LedgerError(
                    f"this run has {name} {shown[0]}, now {name} {shown[1]} was asked for; "
                    "give the same options to resume it, or another --out for another run"
                )
        if other.max_steps < self.max_steps:
            raise LedgerError(
                f"this run has --max-steps {self.max_steps}, now {other.max_steps} was asked for: what it drove "
                "already may have gone on for longer; give at least as many, or another --out"
            )
        for spec in self.policies.keys() & other.policies.keys():
            self._require_same(spec, other)
        modes = {spec: mode for spec, mode in other.modes.items() if mode.measured or spec not in self.modes}
        grown = {name: _joined(getattr(self, name), getattr(other, name)) for name in _MAY_GROW}
        return replace(
            self,
            **grown,  # type: ignore[arg-type]
            policies={**self.policies, **other.policies},
            modes={**self.modes, **modes},
            facts={**self.facts, **other.facts},
            max_steps=other.max_steps,
            probes={**self.probes, **other.probes},
        )

    def _require_same(self, spec: str, other: "EpisodesManifest") -> None:
        if self.policies[spec] != other.policies[spec]:
            raise LedgerError(
                f"this run let {spec} drive at version {self.policies[spec]}, which is now {other.policies[spec]}; "
                "give another --out: two versions in one run cannot be told apart"
            )
        if not self.mode(spec).same_request(other.mode(spec)):
            raise LedgerError(
                f"this run asked {spec} in another mode; give the same options or --mode file to resume it, "
                "or another --out"
            )

    def as_text(self) -> str:
        """Return the JSON text of the manifest's file."""
        modes = {spec: mode.as_dict() for spec, mode in self.modes.items()}
        values = {"format": FORMAT, **asdict(self), "prompt": self.prompt.as_dict(), "modes": modes}
        values["action_space"] = self.action_space.as_dict()
        return json.dumps(values, indent=1, ensure_ascii=False) + "\n"


def _joined(one: Sequence[object], other: Sequence[object]) -> tuple[object, ...]:
    return tuple(dict.fromkeys([*one, *other]))


def write_manifest(out: Path, manifest: EpisodesManifest) -> None:
    """Write the manifest into the run's folder, whole or not at all."""
    partial = out / f".{RUN}"
    with partial.open("w", encoding="utf-8") as file:
        file.write(manifest.as_text())
        file.flush()
        os.fsync(file.fileno())
    partial.replace(out / RUN)


def is_episodes_run(out: Path) -> bool:
    """Return whether a folder holds a run of episodes; raises LedgerError where it holds something else.

    False means that one may begin there.
    """
    if is_run(out):
        read_manifest(out)
        return True
    if out.exists():
        left = {item.name for item in out.iterdir()} - {".lock", f".{RUN}", *BESIDE} if out.is_dir() else {out.name}
        if left:
            raise LedgerError(f"{out} exists and is no run; choose another place with --out")
    return False


def read_manifest(path: Path) -> EpisodesManifest:
    """Read the manifest of a run of episodes; raises LedgerError naming the file at fault."""
    file = path / RUN
    try:
        raw = json.loads(file.read_text(encoding="utf-8"))
        found = raw.pop("format")
        if found == FORMAT:
            return _built(raw, str(file))
    except FileNotFoundError as error:
        raise LedgerError(f"{file} does not exist: is {path} a run? 'eyechart run closed-loop' makes one") from error
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError, SpecError) as error:
        raise LedgerError(f"{file} is no manifest of a run of episodes: {error}") from error
    raise LedgerError(f"{file} is of format {found!r}, not {FORMAT!r}: {path} is no run of episodes")


def _built(raw: dict[str, Any], file: str) -> EpisodesManifest:
    raw["prompt"] = Prompt.from_dict(raw["prompt"])
    raw["action_space"] = Discrete.from_dict(raw["action_space"])
    raw["modes"] = {spec: RequestMode.from_dict(mode, file) for spec, mode in raw["modes"].items()}
    raw["seeds"] = tuple(int(seed) for seed in raw["seeds"])
    for name in ("scenarios", "conditions"):
        raw[name] = tuple(str(one) for one in raw[name])
    for name in ("policies", "world", "versions", "facts"):
        raw[name] = dict(raw[name])
    for name in ("seed", "max_steps", "reader"):
        raw[name] = int(raw[name])
    raw["probes"] = {spec: Spent.from_dict(spent) for spec, spent in raw.get("probes", {}).items()}
    raw.setdefault("view", NONE)
    raw.setdefault("silence", "unfinished")
    for name in ("created", "simulator", "picture", "view", "silence"):
        if not isinstance(raw[name], str) or not raw[name].isprintable():
            raise ValueError(f"{name} is {raw[name]!r}, not a line of text")
    return EpisodesManifest(**raw)
