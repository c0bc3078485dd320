"""The rules for policies, tried on simulated policies with known shares, noise and objects.

Results of these settings: docs/decisions/policies.md.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from eyechart.clusters import Workers
from eyechart.errors import SpecError
from eyechart.records import JsonRecord
from eyechart.report.table import Column, Table
from eyechart.seeds import key_seed
from eyechart.stats.partners import balanced_partners
from eyechart.stats.risk_bounds import share_bound
from eyechart.stats.shares import Share
from eyechart.stats.sign_flip import follow
from eyechart.stats.statistic import Statistic
from eyechart.stats.total_effect import Pairs, permutation_p, responding, share_beyond, squared_distance, total_effect
from eyechart.verdicts.policy_rules import (
    RESPONDS,
    SURENESS,
    AxisVerdict,
    judged,
    of_camera,
    of_instruction,
    of_state,
    rests_on,
)
from eyechart.verdicts.share_predicates import IGNORED

Floats = npt.NDArray[np.float64]

LATENT, STEPS, NUMBERS = 3, 8, 3
WITHIN = 0.8
"""The correlation of latent numbers between frames of an episode."""
WANTED = 0.01
"""The largest share of false claims to accept, before two standard errors."""
SHARES = (0.0, 0.02, 0.05, 0.10, 0.20, 0.40)
NOISES, ANSWERS = (0.05, 0.25, 1.0), (2, 4)
TRUE_OF_THESE, WHOLE = ", true of these episodes", ", of the data set"
"""Suffixes of a label: true for the drawn episodes only; claimed for the whole data set."""
_BATCH = 100
LEAST_SIMULATED = 3
"""The fewest episodes to simulate: leaving each out in turn must keep enough."""


@dataclass(frozen=True, slots=True)
class PolicySetting:
    """One kind of simulated policy and data set; ``share`` is that of the channel at its margin.

    ``margin`` is ``swap``, ``matched``, ``blank`` or ``instruction``. For moved objects it is
    ``follow`` or ``control``. For a policy that reads its pose it is ``beyond`` (the smaller effect
    of a picture of the same episode) or ``exchanged`` (objects' colours). ``response`` is the share
    of frames, or of ``whole`` episodes, that respond at all.
    """

    margin: str = "swap"
    share: float = 0.10
    episodes: int = 12
    frames: int = 72
    response: float = 1.0
    whole: bool = False
    numbers: str = "plain"
    noise: float = 0.0
    answers: int = 1
    artefact: float = 0.0

    @property
    def name(self) -> str:
        """Return the differences from the base setting in words."""
        parts = [f"{self.margin} {self.share:g}", f"{self.episodes} episodes", f"{self.frames} frames"]
        if self.response < 1:
            parts.append(f"{self.response:.0%} of {'episodes' if self.whole else 'frames'} respond")
        parts += [self.numbers] if self.numbers != "plain" else []
        parts += [f"noise {self.noise:g}, {self.answers} answers"] if self.answers > 1 else []
        parts += [f"artefacts {self.artefact:g}"] if self.artefact else []
        return ", ".join(parts)

    @property
    def false(self) -> frozenset[str]:
        """Return the labels that are false here."""
        return frozenset(label for label, untrue in FALSE[self.margin].items() if untrue(self.share))


def _at_least(bound: float) -> Callable[[float], bool]:
    return lambda share: share >= bound


def _at_most(bound: float) -> Callable[[float], bool]:
    return lambda share: share <= bound


_APART = ("camera_content", "pose_only")
_USES = (*_APART, "uses_camera", "camera_presence")
FALSE: Mapping[str, Mapping[str, Callable[[float], bool]]] = {
    "swap": {
        "ignores_camera": _at_least(0.10),
        "state_shortcut": _at_least(0.10),
        **dict.fromkeys(_USES, _at_most(0.02)),
    },
    "matched": {"pose_only": _at_least(0.10), "camera_content": _at_most(0.02)},
    "blank": {"ignores_camera": _at_least(0.10), "camera_presence": _at_most(0.02)},
    "instruction": {"instruction_ignored": _at_least(0.10), "instruction_followed": _at_most(0.02)},
    "follow": {"object_grounded": _at_most(0.30)},
    "control": {"object_grounded": _at_most(1.0)},
    "beyond": {"camera_content": _at_most(0.02)},
    "exchanged": {"camera_content": _at_most(0.02)},
}
"""The labels that are false at a share, by the bound at its margin."""


def settings() -> tuple[PolicySetting, ...]:
    """Return every setting, the base first."""
    base, found = PolicySetting(), list[PolicySetting]()
    found += [replace(base, share=share) for share in SHARES]
    margins = (0.02, 0.10, 0.20)
    for share in margins:
        found += [replace(base, share=share, frames=frames) for frames in (36, 144, 288)]
        found += [replace(base, share=share, episodes=episodes) for episodes in (6, 24, 50)]
        found += [replace(base, share=share, numbers=numbers) for numbers in ("bang-bang", "heavy tails")]
        for response in (0.15, 0.25):
            found += [replace(base, share=share, response=response, whole=whole) for whole in (False, True)]
    found += list(_sparse(base))
    for noise in NOISES:
        for answers in ANSWERS:
            found += [replace(base, share=share, noise=noise, answers=answers) for share in SHARES]
    for margin in ("matched", "blank", "instruction"):
        found += [replace(base, margin=margin, share=share) for share in (0.0, *margins)]
        found += [replace(base, margin=margin, share=share, episodes=6) for share in (0.02, 0.10)]
    for episodes in (6, 7, 8, 12, 24):
        for share in (0.0, 0.30, 0.50, 0.70):
            for artefact in (0.0, 1.0):
                found.append(replace(base, margin="follow", share=share, episodes=episodes, artefact=artefact))
        found.append(replace(base, margin="control", share=0.60, episodes=episodes))
    found += list(_posed(base))
    return tuple(dict.fromkeys(found))


def _sparse(base: PolicySetting) -> Iterator[PolicySetting]:
    """Yield settings in which only some episodes respond, and their comparisons."""
    some = replace(base, whole=True)
    for episodes, response in ((24, 0.15), (24, 0.25), (50, 0.10), (50, 0.15), (50, 0.25)):
        yield replace(some, episodes=episodes, response=response)
    for episodes in (12, 50):
        yield replace(some, margin="matched", episodes=episodes, response=0.25)
        for response in (0.15, 0.25):
            yield replace(some, margin="instruction", episodes=episodes, response=response)
            yield replace(some, episodes=episodes, response=response, noise=0.25, answers=4)
    yield replace(base, share=0.0, episodes=50)
    for noise in (0.05, 0.25):
        yield replace(base, share=0.0, episodes=50, frames=288, noise=noise, answers=4)
    yield replace(base, margin="instruction", share=0.0, episodes=50)


def _posed(base: PolicySetting) -> Iterator[PolicySetting]:
    """Yield policies that read their pose: one pose control at its margin, the other at 0."""
    for margin in ("beyond", "exchanged"):
        pose = replace(base, margin=margin)
        yield from (replace(pose, share=share) for share in (0.0, 0.02, 0.10, 0.20))
        yield replace(pose, share=0.02, episodes=6)
        yield replace(pose, share=0.02, noise=0.25, answers=4)
    for episodes, share in ((24, 0.02), (24, 0.10), (50, 0.10)):
        yield replace(base, margin="beyond", share=share, episodes=episodes)


@dataclass(frozen=True)
class LabelCounts:
    """The number of times each label was given in a setting, out of ``draws`` data sets."""

    setting: PolicySetting
    labels: Mapping[str, int]
    draws: int

    @property
    def false(self) -> float | None:
        """Return the share of data sets with the most frequent false label; None without one."""
        return self._most()

    @property
    def claimed(self) -> float | None:
        """Return the same share for labels claimed of the whole data set."""
        return self._most(WHOLE)

    @property
    def seen(self) -> float | None:
        """Return the same share for labels that are false for the drawn episodes too."""
        return self._most(less=TRUE_OF_THESE)

    @property
    def is_missed(self) -> bool:
        """Return whether a false label is too frequent, by more than two standard errors."""
        most = WANTED + 2 * np.sqrt(WANTED * (1 - WANTED) / self.draws)
        return any(one is not None and bool(one > most) for one in (self.seen, self.claimed))

    def _most(self, after: str = "", less: str | None = None) -> float | None:
        get = self.labels.get
        counts = [get(f"{one}{after}", 0) - (get(f"{one}{less}", 0) if less else 0) for one in self.setting.false]
        return max(counts) / self.draws if counts else None

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        said = {label: count / self.draws for label, count in sorted(self.labels.items()) if TRUE_OF_THESE not in label}
        return {
            "setting": self.setting.name,
            "draws": self.draws,
            "labels": {label: share for label, share in said.items() if WHOLE not in label},
            "of_data_set": {label.removesuffix(WHOLE): share for label, share in said.items() if WHOLE in label},
            "false": self.false,
            "claimed": self.claimed,
            **({"seen": self.seen} if self.seen != self.false else {}),
        }


def try_rules(
    draws: int,
    *,
    seed: int = 0,
    processes: int = 1,
    chosen: Sequence[str] | None = None,
    exact: bool = False,
    engine: str = "local",
    progress: Callable[[int, int], None] | None = None,
) -> Iterator[LabelCounts]:
    """Yield the results of the rules in every setting, or in those named by ``chosen``.

    ``chosen`` holds parts of names, or whole names if ``exact``. The result does not depend on
    ``processes`` or ``engine``. Raises SpecError if no setting matches.
    """
    every = list(settings())
    named = [one.name for one in every]
    if chosen is not None:
        every = [one for one in every if any(word == one.name if exact else word in one.name for word in chosen)]
    if not every:
        names = ", ".join(chosen or ())
        raise SpecError(f"no setting of policies matches {names}; the first of {len(named)} is {named[0]!r}")
    parts = [(start, min(_BATCH, draws - start)) for start in range(0, draws, _BATCH)]
    batches = [_Batch(setting, seed, *part) for setting in every for part in parts]
    with Workers(processes, engine).mapped(_counted, batches) as found:
        for place, setting in enumerate(every):
            labels: Counter[str] = Counter()
            for counted in islice(found, len(parts)):
                labels.update(counted)
            if progress is not None:
                progress(place + 1, len(every))
            yield LabelCounts(setting, dict(labels), draws)


class _Batch(NamedTuple):
    """So many draws of a setting, from ``start`` on."""

    setting: PolicySetting
    seed: int
    start: int
    draws: int


def _counted(batch: _Batch) -> Counter[str]:
    setting, seed, start, count = batch
    result: Counter[str] = Counter()
    for number in range(start, start + count):
        result.update(labels_of(setting, np.random.default_rng(key_seed("policies", seed, setting.name, number))))
    return result


def labels_of(setting: PolicySetting, rng: np.random.Generator) -> tuple[str, ...]:
    """Return the labels of one simulated data set, and again as `WHOLE` if claimed of the whole.

    If the share is `IGNORED` or more, but not in the drawn episodes, each comes again as
    `TRUE_OF_THESE`.
    """
    world = _World(setting, rng)
    said = _judged(setting, world.statistics())
    labels = tuple(one.label for one in said)
    little = setting.whole and world.share < IGNORED <= setting.share
    own = tuple(f"{label}{TRUE_OF_THESE}" for label in labels) if little else ()
    return (*labels, *(f"{one.of_data_set}{WHOLE}" for one in said), *own)


def _judged(setting: PolicySetting, statistics: Mapping[str, Statistic]) -> tuple[AxisVerdict, ...]:
    if setting.margin == "instruction":
        return (judged(of_instruction(statistics)),)
    camera = judged(of_camera(statistics, "cameras", "its cameras"))
    if setting.margin in {"matched", "follow", "control", "beyond", "exchanged"}:
        return (camera,)
    return camera, judged(of_state(statistics, camera.label, there=True))


def simulated(setting: PolicySetting, rng: np.random.Generator) -> dict[str, Statistic]:
    """Return the statistics of one simulated data set for the rules of its margin."""
    return _World(setting, rng).statistics()


class _World:
    """One data set: latent numbers of frames, and the motions that follow from them."""

    def __init__(self, setting: PolicySetting, rng: np.random.Generator) -> None:
        self._set, self._rng = setting, rng
        sizes = np.full(setting.episodes, setting.frames // setting.episodes)
        sizes[: setting.frames % setting.episodes] += 1
        self._episode = np.repeat(np.arange(setting.episodes), sizes)
        self._map = rng.normal(size=(LATENT, STEPS * NUMBERS))
        self._map /= np.sqrt((self._map**2).sum(axis=0))
        self._rest = self._latent()
        self._gate, self._far = self._gates(), np.ones((len(self._episode), 1))
        if setting.margin == "matched":
            self._gate, self._far = self._far, self._gate**2

    @property
    def share(self) -> float:
        """Return the share of the channel at its margin in the drawn episodes."""
        responds, share = float((self._gate**2 * self._far).mean()), self._set.share
        if self._set.margin in {"swap", "instruction"}:
            return share * responds / (share * responds + 1 - share)
        return share * responds

    def _latent(self) -> Floats:
        """Return latent numbers of variance 1, correlated in episodes, shape (frames, 3)."""
        episode, frame = (self._draw((size, LATENT)) for size in (self._set.episodes, len(self._episode)))
        return np.asarray(np.sqrt(WITHIN) * episode[self._episode] + np.sqrt(1 - WITHIN) * frame)

    def _draw(self, shape: tuple[int, int]) -> Floats:
        if self._set.numbers == "heavy tails":
            return np.asarray(self._rng.standard_t(3, shape) / np.sqrt(3))
        return self._rng.standard_normal(shape)

    def _gates(self) -> Floats:
        one = self._set
        if one.whole:
            responds = (self._rng.random(one.episodes) < one.response)[self._episode]
        else:
            responds = self._rng.random(len(self._episode)) < one.response
        return np.asarray(responds / np.sqrt(one.response))[:, None]

    def _answers(self, part: Floats, share: float) -> Floats:
        """Return the motions for a channel's content, shape (answers, frames, steps, numbers)."""
        plain = np.sqrt(share) * self._gate * part + np.sqrt(1 - share) * self._rest
        noise = np.sqrt(self._set.noise) * self._rng.standard_normal((self._set.answers, *plain.shape))
        numbers = np.asarray((plain + noise) @ self._map).reshape(self._set.answers, len(plain), STEPS, NUMBERS)
        if self._set.numbers == "bang-bang":
            numbers[..., -1] = 2.0 * (numbers[..., -1] > 0)
        return np.asarray(numbers)

    def statistics(self) -> dict[str, Statistic]:
        """Return the statistics that the rules of this margin read."""
        one, picture, wanted = self._set, self._latent(), _wanted(self._set)
        share, every = wanted["swapped"], list(range(len(self._episode)))
        partner = balanced_partners(self._episode.tolist(), every, seed=int(self._rng.integers(2**32)))
        theirs, real = self._episode[partner], self._answers(picture, share)
        variation = Pairs(squared_distance(real, real[:, partner]), self._episode, theirs)
        channel = "instruction" if one.margin == "instruction" else "cameras"
        effects, result = dict[str, Pairs](), dict[str, Statistic]()
        for name, changed in wanted.items():
            other = picture[partner] if name == "swapped" else self._latent()
            far = self._far if name == "matched" else np.ones_like(self._far)
            shown = self._changed(picture, other, share, changed * far)
            condition = name if name in _WHOLE else f"{name}@{channel}"
            whose = self._episode if name in _OWN else theirs
            effects[condition] = Pairs(squared_distance(real, shown), self._episode, whose)
            result[f"T.{condition}"] = self._total((real, shown), effects[condition], variation)
        for claim in RESPONDS:
            rests = [effects[condition] for condition in rests_on(claim, channel) if condition in effects]
            result[f"{claim}@{channel}"] = share_bound(*responding(rests, variation, IGNORED), confidence=SURENESS)
        if one.margin == "instruction":
            return result
        if "near" in wanted:
            matched, near = (effects[f"{name}@{channel}"] for name in ("matched", "near"))
            result[f"beyond@{channel}"] = share_beyond(matched, near, variation)
        result["T.swapped@state"] = Share(1.0, one.frames, (0.5, 2.0), 0.0, episodes=one.episodes)
        return result | (self._followed() if one.margin in _CONTENT else {})

    def _changed(self, own: Floats, other: Floats, share: float, changed: Floats) -> Floats:
        """Return the motions with ``changed`` of the variance from another picture.

        ``share`` is the variance that the picture carries, and ``changed`` has shape (frames, 1).
        The picture keeps its variance; if it carries nothing, the other's part is added.
        """
        if (changed > share).all():
            more = np.asarray(np.sqrt(2 * changed) * self._gate * other @ self._map)
            return np.asarray(self._answers(own, share) + more.reshape(1, len(own), STEPS, NUMBERS))
        new = np.minimum(1.0, changed / share) if share else 0.0
        return self._answers((1 - new) * own + np.sqrt(new * (2 - new)) * other, share)

    def _total(self, answers: tuple[Floats, Floats], effect: Pairs, variation: Pairs) -> Statistic:
        drawn = self._set.answers > 1
        statistic = total_effect(effect, variation, sampled=drawn)
        seed = int(self._rng.integers(2**32))
        return replace(statistic, p=permutation_p(*answers, seed=seed, resamples=999) if drawn else None)

    def _followed(self) -> dict[str, Statistic]:
        """Return how far moved objects are followed, and how much of it is due to their names."""
        one, n = self._set, len(self._episode)
        full = self._rng.uniform(2, 4, n)
        jitter = 0.5 * (np.sqrt(WITHIN) * self._rng.normal(size=one.episodes)[self._episode])
        noise = one.artefact * full.mean() * self._rng.normal(size=n) + 0.3 * self._rng.normal(size=n)
        gains = one.share * full * (1 + jitter) + noise
        because = 0.0 if one.margin == "control" else one.share
        instructed = because * full * (1 + jitter) + one.artefact * full.mean() * self._rng.normal(size=n) / 2
        instructed = instructed + 0.3 * self._rng.normal(size=n)
        return {
            "follow.named": follow(gains, full, self._episode, seed=1),
            "follow.told": follow(instructed, full, self._episode, seed=2),
        }


_CONTENT = ("follow", "control")
_WHOLE, _OWN = ("blank", "exchanged"), ("blank", "exchanged", "near")
"""Conditions without a channel, and conditions with pictures of the same episode."""


def _wanted(setting: PolicySetting) -> dict[str, float]:
    """Return the share of the latent variance that each condition changes."""
    share = _latent_share(setting.share) if setting.numbers == "bang-bang" else setting.share
    if setting.margin in _CONTENT:
        return {"swapped": 0.40, "matched": 0.40, "blank": 0.40}
    if setting.margin == "instruction":
        return {"swapped": share}
    if setting.margin in {"beyond", "exchanged"}:
        more, colours = (share, 0.0) if setting.margin == "beyond" else (0.0, share)
        return {"swapped": 0.40, "matched": 0.20, "near": 0.20 - more, "blank": 0.40, "exchanged": colours}
    none = {"swapped": 0.0, "matched": 0.0, "blank": 0.0}
    return {**none, **({"swapped": 0.40} if setting.margin == "matched" else {}), _CONDITIONS[setting.margin]: share}


_CONDITIONS = {"swap": "swapped", "matched": "matched", "blank": "blank"}


def _latent_share(share: float) -> float:
    """Return the latent share that gives this share overall, if one of three numbers is binary."""
    low, high = 0.0, 1.0
    for _ in range(60):
        middle = (low + high) / 2
        found = middle * (NUMBERS - 1) / NUMBERS + 2 * np.arccos(1 - middle) / np.pi / NUMBERS
        low, high = (middle, high) if found < share else (low, middle)
    return high


@dataclass(frozen=True)
class PolicyPower(JsonRecord):
    """What a bank of ``episodes`` and ``frames`` can decide about a camera, by the camera's share.

    ``calls`` are those of a policy that repeats its answers. ``said`` has ``same`` (such a policy,
    or one with a seed) and ``drawn`` (noise of a quarter of the variance, four answers). Each maps
    shares to how often the camera is called ignored, and used, out of ``draws`` data sets.
    ``apart`` maps them to how often what it is used for is told from the pose. ``matched`` counts the frames
    with a match at a similar state: without them that is open.
    """

    episodes: int
    frames: int
    calls: int
    left_out: Mapping[str, str]
    said: Mapping[str, Mapping[str, tuple[float, float]]]
    apart: Mapping[str, Mapping[str, float]]
    draws: int
    matched: int

    def table(self) -> Table:
        """Return a row per share."""
        rows = [
            (kind, float(share), ignored, used, self.apart[kind][share])
            for kind, shares in self.said.items()
            for share, (ignored, used) in shares.items()
        ]
        head = (Column("answers", "word"), Column("share of the camera", "number", 2))
        title = f"how often {self.episodes} episodes ({self.frames} frames) settle it"
        note = f"of {self.draws} simulated data sets each; every frame responds"
        if self.matched < self.frames:
            note = f"{note}; content or pose is decided by the {self.matched} frames with a match at a similar state"
        ends = (Column("ignored", "number", 2), Column("used", "number", 2), Column("content or pose", "number", 2))
        return Table("power", title, (*head, *ends), tuple(rows), note)


def power(
    episodes: int,
    frames: int,
    calls: int,
    left_out: Mapping[str, str],
    *,
    draws: int = 60,
    matched: tuple[int, int] | None = None,
) -> PolicyPower:
    """Simulate what a bank can decide about a policy's cameras, by their share.

    ``matched`` counts the frames with a match at a similar state, and their episodes; the default
    is all. What a camera is used for is simulated on these frames alone.
    """
    matched_frames, of = (frames, episodes) if matched is None else matched
    kinds = {"same": PolicySetting(), "drawn": PolicySetting(noise=0.25, answers=4)}
    said: dict[str, dict[str, tuple[float, float]]] = {}
    apart: dict[str, dict[str, float]] = {}
    for kind, base in kinds.items():
        for share in SHARES:
            setting = replace(base, share=share, episodes=episodes, frames=max(frames, episodes))
            by_match = labels = _counted(_Batch(setting, 0, 0, draws))
            if matched_frames < frames:
                fewer = replace(setting, episodes=max(of, LEAST_SIMULATED), frames=max(matched_frames, LEAST_SIMULATED))
                by_match = _counted(_Batch(fewer, 0, 0, draws)) if matched_frames else Counter[str]()
            uses = sum(labels[label] for label in _USES)
            said.setdefault(kind, {})[f"{share:g}"] = labels["ignores_camera"] / draws, uses / draws
            apart.setdefault(kind, {})[f"{share:g}"] = sum(by_match[label] for label in _APART) / draws
    return PolicyPower(episodes, frames, calls, left_out, said, apart, draws, matched_frames)


def table(tried: Sequence[LabelCounts]) -> Table:
    """Return a row per setting: how often each label was given, and the false one."""
    labels = list(dict.fromkeys(label for one in tried for label in sorted(one.labels) if "," not in label))
    rows = [
        (
            one.setting.name,
            *(one.labels.get(label, 0) / one.draws for label in labels),
            ", ".join(sorted(one.setting.false)),
            one.false,
            one.seen,
            one.claimed,
            "!" if one.is_missed else "",
        )
        for one in tried
    ]
    head = [Column("setting"), *(Column(label, "number") for label in labels), Column("untrue here")]
    note = (
        "false: share of false labels; seen: of those that are false for the drawn episodes too; claimed: of "
        f"those claimed of the whole data set; ! marks seen or claimed above {WANTED} plus two standard errors"
    )
    ends = (Column("false", "number", 4), Column("seen", "number", 4), Column("claimed", "number", 4), Column(""))
    return Table("policies", "", (*head, *ends), tuple(rows), note)
