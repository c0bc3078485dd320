"""A run's manifest says what was asked of which models on which bank, so that a run can be resumed, merged and read."""

import datetime as dt
import json
import os
import platform
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from eyechart import __version__
from eyechart.conditions import find_condition
from eyechart.errors import LedgerError, SpecError
from eyechart.frames import FrameBank, open_bank
from eyechart.limits import Spent
from eyechart.modes import RequestMode
from eyechart.perception.view import NONE
from eyechart.prompts import Prompt
from eyechart.spaces.discrete import READER, Discrete

FORMAT = "eyechart-run/2"
LEDGER = "ledger.sqlite"
RUN = "run.json"
BANK = "bank"
"""The run's copy of the bank's text; in a bundle with the pictures that the run used."""
BANK_TEXT = ("manifest.json", "metadata.jsonl")


@dataclass(frozen=True, slots=True)
class RunManifest:
    """What a run was planned to do. ``models`` maps a SPEC to the version that answered.

    ``modes`` says how each model was asked, ``facts`` what is known of it (digest, quantisation, template).
    ``shard`` is (i, n), counted from 1, or None for the whole; ``limit`` the number of frames, or None for all.
    ``stop_early`` says that a model is no longer asked once its verdict is settled.
    ``probes`` says what it took to probe a model before the run, where the run did that itself.
    ``reader`` is the version of the reader of replies that the run was begun under. ``view`` is the key of the view
    that pictures are shown through, ``none`` where they are shown as they are. ``frames`` are the ids of the frames
    that were chosen for the run, empty where it is about all of them or their first ``limit``.
    """

    study: str
    created: str
    seed: int
    prompt: Prompt
    models: Mapping[str, str]
    conditions: tuple[str, ...]
    limit: int | None
    shard: tuple[int, int] | None
    bank_path: str
    fingerprint: str
    versions: Mapping[str, str]
    stop_early: bool = False
    modes: Mapping[str, RequestMode] = field(default_factory=dict)
    facts: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    reader: int = READER
    view: str = NONE
    frames: tuple[str, ...] = ()
    probes: Mapping[str, Spent] = field(default_factory=dict)

    def extended(self, other: "RunManifest") -> "RunManifest":
        """Return this manifest with another's models, conditions and limit added.

        Raises LedgerError that names what differs where the two are not parts of one run.
        """
        for name in ("study", "seed", "view", "prompt", "fingerprint", "shard", "stop_early", "frames"):
            mine, theirs = getattr(self, name), getattr(other, name)
            if mine != theirs:
                shown = (mine.key, theirs.key) if isinstance(mine, Prompt) else (mine, theirs)
                raise LedgerError(
                    f"this run has {name} {shown[0]}, now {name} {shown[1]} was asked for; "
                    "give the same options to resume it, or another --out for another run"
                )
        for spec in self.models.keys() & other.models.keys():
            if self.models[spec] != other.models[spec]:
                raise LedgerError(
                    f"this run asked {spec} at version {self.models[spec]}, which is now {other.models[spec]}; "
                    "give another --out: two versions in one ledger cannot be told apart"
                )
            if not self.mode(spec).same_request(other.mode(spec)):
                raise LedgerError(
                    f"this run asked {spec} in another mode: {_difference(self.mode(spec), other.mode(spec))}; "
                    "give the same options or --mode file to resume it, or another --out"
                )
        conditions = self.conditions + tuple(name for name in other.conditions if name not in self.conditions)
        modes = {spec: mode for spec, mode in other.modes.items() if mode.measured or spec not in self.modes}
        return replace(
            self,
            models={**self.models, **other.models},
            modes={**self.modes, **modes},
            facts={**self.facts, **other.facts},
            probes={**self.probes, **other.probes},
            conditions=conditions,
            limit=_larger(self.limit, other.limit),
        )

    def spent_before(self) -> Spent:
        """Return what probing took, of all models together."""
        return Spent.together(self.probes.values())

    def mode(self, spec: str) -> RequestMode:
        """Return how a model was asked; the default mode where the run gave none."""
        return self.modes.get(spec) or RequestMode(spec)


def _difference(mine: RequestMode, theirs: RequestMode) -> str:
    name = next(one.name for one in fields(RequestMode) if getattr(mine, one.name) != getattr(theirs, one.name))
    return f"{name} was {getattr(mine, name)!r}, now {getattr(theirs, name)!r}"


def _larger(one: int | None, other: int | None) -> int | None:
    return None if one is None or other is None else max(one, other)


def versions() -> dict[str, str]:
    """Return the versions that may matter to a picture or a number."""
    found = {"eyechart": __version__, "python": platform.python_version()}
    for package in ("numpy", "scipy", "pillow", "highway-env", "gymnasium", "pygame-ce"):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


def today() -> str:
    """Return the date in UTC, as a run records it."""
    return dt.datetime.now(dt.UTC).date().isoformat()


def write_run(out: Path, manifest: RunManifest, bank: FrameBank) -> None:
    """Write a run's manifest and the text of its bank (no pictures) into the run's folder.

    Raises LedgerError where ``out`` is taken by something that is no run.
    """
    copy = out / BANK
    if not is_run(out):
        if not is_free(out):
            raise LedgerError(f"{out} exists and is no run; choose another place with --out")
        shutil.rmtree(copy, ignore_errors=True)  # of a run that was cut before it had a manifest
        partial = out / f".{BANK}"
        shutil.rmtree(partial, ignore_errors=True)
        partial.mkdir()
        for name in BANK_TEXT:
            shutil.copyfile(bank.root / name, partial / name)
        partial.replace(copy)
    partial_file = out / f".{RUN}"
    with partial_file.open("w", encoding="utf-8") as file:
        file.write(as_text(manifest))
        file.flush()
        os.fsync(file.fileno())
    partial_file.replace(out / RUN)


def as_text(manifest: RunManifest) -> str:
    """Return a run's manifest as the JSON text of its file."""
    modes = {spec: mode.as_dict() for spec, mode in manifest.modes.items()}
    values = {"format": FORMAT, **asdict(manifest), "prompt": manifest.prompt.as_dict(), "modes": modes}
    return json.dumps(values, indent=1, ensure_ascii=False) + "\n"


def is_run(path: Path) -> bool:
    """Return whether a folder holds a run."""
    return (path / RUN).is_file()


def is_free(path: Path) -> bool:
    """Return whether a run may begin in a folder: nothing is there but what a run leaves that was cut at its start.

    A folder ``bank`` that holds pictures is a frame bank, and not ours to remove.
    """
    if not path.is_dir():
        return not path.exists()
    left = {item.name for item in path.iterdir()} - {".lock", f".{RUN}", f".{BANK}"}
    return not left or (left == {BANK} and all(item.name in BANK_TEXT for item in (path / BANK).iterdir()))


def asked_of(bank: FrameBank, prompt: Prompt) -> FrameBank:
    """Return a bank as a prompt asks of it: with what that says of a frame, and the actions it has of its own."""
    asked = replace(bank, said=prompt.fields)
    if not isinstance(prompt.space, Discrete):
        return asked
    return replace(asked, manifest=replace(bank.manifest, action_space=prompt.space))


def _shard(value: Sequence[object]) -> tuple[int, int]:
    index, count = (int(str(part)) for part in value)
    if not 1 <= index <= count:
        raise ValueError(f"shard {index}/{count} does not satisfy 1 <= i <= n")
    return index, count


def read_run(path: Path) -> tuple[RunManifest, FrameBank]:
    """Read a run's manifest and the text of its bank; raises LedgerError or BankError naming the file at fault."""
    manifest = read_manifest(path)
    bank = asked_of(open_bank(path / BANK), manifest.prompt)
    if bank.manifest.fingerprint != manifest.fingerprint:
        raise LedgerError(
            f"{path / BANK} is not the bank of this run: its fingerprint differs from that in {path / RUN}"
        )
    return manifest, bank


def read_manifest(path: Path) -> RunManifest:
    """Read the manifest in a run's folder; raises LedgerError naming the file at fault."""
    file = path / RUN
    try:
        raw = json.loads(file.read_text(encoding="utf-8"))
        found = raw.pop("format")
        if str(found).startswith("eyechart-episodes/"):
            raise LedgerError(
                f"{path} is a run of episodes, for 'eyechart score', 'report', 'audit', 'film' and 'costs' to read"
            )
        if found != FORMAT:
            raise LedgerError(
                f"{file} is of another format than {FORMAT!r}: use the eyechart that wrote it, or run anew"
            )
        raw["prompt"] = Prompt.from_dict(raw["prompt"])
        raw["models"] = dict(raw["models"])
        raw["modes"] = {spec: RequestMode.from_dict(mode, str(file)) for spec, mode in raw["modes"].items()}
        raw["facts"] = {spec: dict(known) for spec, known in raw["facts"].items()}
        raw["probes"] = {spec: Spent.from_dict(spent) for spec, spent in raw.get("probes", {}).items()}
        raw["conditions"] = tuple(find_condition(name).name for name in raw["conditions"])
        raw["seed"] = int(raw["seed"])
        raw["reader"] = int(raw["reader"])
        raw["limit"] = None if raw["limit"] is None else int(raw["limit"])
        raw["shard"] = None if raw["shard"] is None else _shard(raw["shard"])
        raw["frames"] = tuple(str(name) for name in raw.get("frames", ()))
        if not isinstance(raw.setdefault("stop_early", False), bool):
            raise LedgerError(f"{file}: stop_early is {raw['stop_early']!r}, neither true nor false")
        raw.setdefault("view", NONE)
        for name in ("study", "created", "bank_path", "fingerprint", "view"):
            if not isinstance(raw[name], str) or not raw[name].isprintable():
                raise LedgerError(f"{file}: {name} is {raw[name]!r}, not a line of text")
        return RunManifest(**raw)
    except FileNotFoundError as error:
        raise LedgerError(f"{file} does not exist: is {path} a run? 'eyechart run battery' makes one") from error
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError, SpecError) as error:
        raise LedgerError(f"{file} is no run manifest: {error!r}") from error
