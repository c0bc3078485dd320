"""How often a model of a known kind gets its label on a bank: its answers are drawn, and the rules' own tests applied.

The kinds: one that answers alike whatever it is shown, one that tells a road from what is none, and one that reads the
distance of the lead on a share of the frames. All of them err: each call gets another answer with a chance that makes
two calls about one picture disagree as often as the noise floor says.
"""

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial

import numpy as np
from numpy.typing import NDArray

from eyechart.conditions import CONDITIONS, CONTROLS, OF_BANKS, RANGED, SAMPLED, available, sample
from eyechart.errors import SpecError
from eyechart.frames import FrameBank
from eyechart.records import Plain
from eyechart.spaces.discrete import Discrete
from eyechart.stats.paired import bounded_below, sign_test
from eyechart.stats.statistic import Statistic
from eyechart.studies.battery.answers import Answers
from eyechart.studies.battery.controls import FEWEST_PAIRS
from eyechart.studies.battery.depth import BESIDE, PICTURE_OF, Moved, moved_of
from eyechart.verdicts import ALPHA, BOUND_ALPHA, MARGIN
from eyechart.verdicts.depth import DEPTH

NOISE = 0.11
"""The noise floor that is planned for where none is given: near the median of the paper's hosted models, .125."""

READS = (0.3, 1.0)
"""The shares of the frames on which the planned readers of distance read it."""

DRAWS = 2000
ALONG_DRAWS = 100
"""So many are drawn where all statistics of each are made, one by one."""

STRICT = ("shuffled", "recoloured", "cross_scenario")
LOOSE = ("mirrored", "lead_near", "lead_far", "lead_absent")
NO_PICTURES = ("noise", "text_only")
"""What an absence bounds: at ``ALPHA``, at ``BOUND_ALPHA``, and likewise where no decision comes from the camera."""

LEFT_OUT = (
    *("unparsed_reference", "unparsed_controls", "lane_net"),
    *("content_shuffled", "content_recoloured", "content_lead_absent", "kappa", "self_disagreement", "scene_cue"),
    *("presence", "presence_response", "repeats_together"),
)
"""The tests that a verdict makes and the power leaves out: each takes a label from such models now and then."""

Codes = NDArray[np.int8]
Levels = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Odds(Plain):
    """How often a model gets its label at a noise floor; None where the bank has not what the label needs.

    ``depth`` and ``depth_associated``, which is what a run without controls can come to, are of those that read the
    distance on such a share of the frames. An absence needs all of its bounds together. ``left_out`` are the tests of
    a verdict that are not drawn: with them a label is rarer, as measured with all by up to about .05.
    """

    noise: float
    image_invariant: float | None
    presence_only: float | None
    depth: Mapping[str, float | None]
    depth_associated: Mapping[str, float | None]
    left_out: tuple[str, ...] = LEFT_OUT

    @property
    def by_label(self) -> dict[str, float | None]:
        """Return how often each label is given that is drawn, of readers to those that read on all frames."""
        found = {"image_invariant": self.image_invariant, "presence_only": self.presence_only}
        return found | {"depth": self.depth.get("1"), "depth_associated": self.depth_associated.get("1")}

    @property
    def of_table(self) -> str:
        """Return what stands below a table of labels."""
        return (
            "Reached: who deserves the label and never errs gets it; more frames are such as there are, in other "
            f"episodes. Power: of who deserves it at a noise floor of {self.noise:g}."
        )

    @property
    def words(self) -> str:
        """Return the same in one line."""

        def shown(one: float | None) -> str:
            return "—" if one is None else f"{one:.2f}"

        readers = (
            f"of who reads the distance on {share} of the frames depth {shown(self.depth[share])} (without controls "
            f"depth_associated {shown(self.depth_associated[share])})"
            for share in self.depth
        )
        return (
            f"power at a noise floor of {self.noise:g}: of who never looks image_invariant "
            f"{shown(self.image_invariant)}; of who tells a picture from none presence_only "
            f"{shown(self.presence_only)}; {'; '.join(readers)}; up to about .05 less by what is not drawn: "
            f"{', '.join(self.left_out)}"
        )


def odds_of(bank: FrameBank, *, noise: float = NOISE, draws: int = DRAWS, seed: int = 0) -> Odds:
    """Return how often models of known kinds get their labels on a bank.

    Raises SpecError for a noise floor that answers of this bank's actions cannot have.
    """
    space = bank.manifest.action_space
    if len(space.actions) < 2:
        return Odds(noise, None, None, dict.fromkeys(map(_named, READS)), dict.fromkeys(map(_named, READS)))
    count = len(space.actions)
    most = (count - 1) / count
    if not 0 <= noise < most:
        raise SpecError(f"--noise is the share of repeats that get another answer, from 0 to {most:.2f}; got {noise:g}")
    slips = most * (1 - np.sqrt(1 - noise / most))
    drawn = _Drawn(bank, space, float(slips), draws, np.random.default_rng(seed))
    depth = {_named(share): drawn.depth(share) for share in READS}
    return Odds(
        noise,
        drawn.absence(presence=False),
        drawn.absence(presence=True),
        {share: one[0] for share, one in depth.items()},
        {share: one[1] for share, one in depth.items()},
    )


def _named(share: float) -> str:
    return f"{share:g}"


def calls_of(bank: FrameBank) -> dict[str, int]:
    """Return how many frames can be shown under each condition that is always asked of a bank."""
    of_scenario = Counter(frame.scenario for frame in bank)
    calls = {}
    for name in OF_BANKS:
        if "text" in CONDITIONS[name].needs or name in CONTROLS:
            continue
        shown = [frame for frame in bank if available(name, frame)]
        if (name == "shuffled" and min(of_scenario.values()) < 2) or (
            name == "cross_scenario" and len(of_scenario) < 2
        ):
            shown = []
        calls[name] = len(shown)
    return calls


def sampled_of(bank: FrameBank) -> dict[str, int]:
    """Return of how many frames each sampled control is asked where answers call for it."""
    calls = sum(calls_of(bank).values())
    shown = {name: [frame.id for frame in bank if available(name, frame)] for name in SAMPLED}
    return {name: len(sample(name, ids, calls, 0)) for name, ids in shown.items()}


@dataclass(frozen=True)
class _Drawn:
    """Draws many models' answers, shape (draws, frames) a condition, as the codes of actions."""

    bank: FrameBank
    space: Discrete
    slips: float
    draws: int
    rng: np.random.Generator

    def _answer(self, meant: Codes | int) -> Codes:
        """Return answers that slip from what is meant to another action, each with its own chance."""
        shape = (self.draws, len(self.bank))
        other = self.rng.integers(1, len(self.space.actions), shape, dtype=np.int8)
        slipped = self.rng.random(shape) < self.slips
        return np.asarray((meant + other * slipped) % len(self.space.actions), dtype=np.int8)

    def _shown(self, *conditions: str) -> Flags:
        """Return which frames can be shown under all of some conditions."""
        shown = np.array([all(available(name, frame) for name in conditions) for frame in self.bank])
        for name in {*SAMPLED} & {*conditions}:
            shown &= np.cumsum(shown) <= sampled_of(self.bank)[name]  # which of them makes no difference here
        return shown

    @cached_property
    def _levels(self) -> NDArray[np.float64]:
        """Return the braking level of each action."""
        return np.array([self.space.project(action, "brake") or 0.0 for action in self.space.actions])

    @cached_property
    def _by_level(self) -> tuple[int, int, int]:
        """Return the codes of an action that goes on, of one that brakes, and of the one that brakes hardest."""
        order = np.argsort(self._levels, kind="stable")
        return int(order[0]), int(order[len(order) - 2]), int(order[-1])

    def absence(self, *, presence: bool) -> float | None:
        """Return how often all bounds hold of who answers alike, or tells a picture from none."""
        strict = STRICT if presence else (*STRICT, "blank")
        loose = LOOSE if presence else (*LOOSE, *NO_PICTURES)
        if not self._shown("shuffled").any() or len(self.bank) < 2:
            return None
        real = self._answer(0)
        same = self._answer(0) == real
        holds = np.ones(self.draws, dtype=np.bool_)
        for names, alpha in ((strict, ALPHA), (loose, BOUND_ALPHA)):
            for name in names:
                which = self._shown(name)
                if which.any():
                    kept = self._answer(0) == real
                    lost, won = (np.count_nonzero(one[:, which], axis=1) for one in (same & ~kept, kept & ~same))
                    holds &= _each(lost, won, partial(_is_bounded, int(which.sum()), alpha))
        return float(holds.mean())

    def depth(self, share: float) -> tuple[float | None, float | None]:
        """Return how often who reads the distance on a share of the frames is ``depth``, and without controls."""
        from scipy.stats import binom  # noqa: PLC0415 - slow to import

        pairs = self._shown("lead_near", "lead_far")
        if int(pairs.sum()) < FEWEST_PAIRS or not self.space.brake:
            return None, None
        go, brake, hard = self._by_level
        frames = len(self.bank)
        ranks = np.argsort(self.rng.random((self.draws, frames)), axis=1)
        reads = ranks < round(share * frames)

        near, far = (
            self._levels[self._answer(np.where(reads, np.int8(code), np.int8(brake)))][:, pairs] for code in (hard, go)
        )
        won, lost = (np.count_nonzero(apart, axis=1) for apart in (near > far, near < far))
        first = float((binom.sf(won - 1, won + lost, 0.5) < ALPHA).mean())
        return self._along(share) if self._shown(*RANGED).any() else None, first

    def _along(self, share: float) -> float:
        """Return how often who reads the distance on a share of the frames is ``depth``, of pictures along the range.

        It brakes hardest in the nearest third of the range, and goes on in the farthest; elsewhere it brakes always.
        """
        shown = moved_of(Answers("", self.bank.frames, self.space, self.bank.manifest.gap, {}))
        go, brake, hard = self._by_level
        ranks = np.argsort(self.rng.random((self.draws, len(self.bank))), axis=1)
        distances = _distances(shown)
        least, greatest = (of(list(distances.values())) for of in (np.nanmin, np.nanmax))
        first, last = np.geomspace(least, greatest, 4)[1:3]
        given = {}
        for name, distance in distances.items():
            meant = np.where(distance < first, hard, np.where(distance < last, brake, go))
            codes = self._answer(np.where(ranks < round(share * len(self.bank)), meant, brake).astype(np.int8))
            given[name] = np.where(np.isnan(distance), np.nan, self._levels[codes] / self._levels.max())
        draws = min(self.draws, ALONG_DRAWS)
        earned = (
            DEPTH.ruling(Drawn(replace(shown, levels={name: levels[draw] for name, levels in given.items()})))
            is not None
            for draw in range(draws)
        )
        return sum(earned) / draws


def _distances(shown: Moved) -> dict[str, Levels]:
    """Return how far away the lead is under each condition that depth compares, NaN where a frame does not show it."""
    found = {name: shown.distance(picture) for name, picture in PICTURE_OF.items()}
    there = ~np.isnan(shown.distance("own"))
    return found | {name: np.where(there, shown.distance("far"), np.nan) for name in (BESIDE, "exchange_apart")}


class Drawn(dict[str, Statistic]):
    """The statistics of depth of answers that were drawn, each made when a rule reads it."""

    def __init__(self, moved: Moved) -> None:
        near, far = moved.level("lead_near"), moved.level("lead_far")
        both = ~np.isnan(near + far)
        super().__init__(
            depth_interventional=sign_test(near[both], far[both]),
            unparsed_controls=Statistic(0.0, 1, (0.0, 0.0)),
            **dict.fromkeys(("depth_net", "lane_net"), Statistic(None, 0)),
        )
        self._tests = moved.tests()

    def __missing__(self, name: str) -> Statistic:
        self[name] = self._tests[name]()
        return self[name]


def _each(first: NDArray[np.int64], second: NDArray[np.int64], says: Callable[[int, int], bool]) -> Flags:
    """Return what is said of every pair of counts."""
    return np.array([says(int(one), int(other)) for one, other in zip(first, second, strict=True)])


@cache
def _is_bounded(frames: int, alpha: float, lost: int, won: int) -> bool:
    """Return whether an effect is bounded that so many frames speak for, and so many against."""
    first, second = np.zeros(frames), np.zeros(frames)
    first[:lost] = second[lost : lost + won] = 1
    p = bounded_below(first, second, margin=MARGIN, alpha=alpha).p
    return p is not None and p < alpha
