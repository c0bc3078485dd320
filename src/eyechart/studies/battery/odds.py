"""How often models of known kinds get their labels, by drawn answers and the tests of the rules.

There are three kinds of models. The answer of the first never depends on the picture. The second
only tells a road from no road. The third reads the lead's distance on a share of the frames. All
make errors: each call slips to another answer by chance, so often that two calls about one
picture disagree at the noise floor's rate.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eyechart.conditions import CONDITIONS, CONTROLS, RANGED, SAMPLED, is_available, of_bank, sample
from eyechart.errors import SpecError
from eyechart.frames import PATCHED, FrameBank
from eyechart.records import JsonRecord
from eyechart.report.table import Column, Table
from eyechart.spaces.discrete import Discrete
from eyechart.spaces.space import Decision
from eyechart.stats.exact_difference import EXACT_UP_TO, is_bounded
from eyechart.stats.paired_tests import ChangedPairs, bounded_below, sign_test
from eyechart.stats.statistic import Statistic
from eyechart.studies.battery.answers import Answers
from eyechart.studies.battery.calibrated_statistics import CalibratedTests
from eyechart.studies.battery.controls import FEWEST_PAIRS, OF_PICTURES
from eyechart.studies.battery.depth import BESIDE, PICTURE_OF, BrakingLevels, moved_of
from eyechart.studies.battery.paper_statistics import Resampling
from eyechart.verdicts import ALPHA, BOUND_ALPHA, MARGIN
from eyechart.verdicts.depth import DEPTH

NOISE = 0.11
"""The noise floor that is planned for without a given one: near the median of the paper's hosted
models, .125."""

READS = (0.3, 1.0)
"""The shares of the frames on which the drawn readers of distance read it."""

DRAWS = 2000
ALONG_DRAWS = 100
"""The number of draws where every statistic of each draw is computed."""
RESAMPLES = 999
"""The resamples of a test of photographs as taken, for each draw."""

STRICT = ("shuffled", "recoloured", "cross_scenario")
LOOSE = ("mirrored", "lead_near", "lead_far", "lead_absent")
NO_PICTURES = ("noise", "text_only")
"""Conditions that an absence bounds: at ``ALPHA``, at ``BOUND_ALPHA``, and without any picture."""

LEFT_OUT = (
    *("unparsed_reference", "unparsed_controls", "lane_net"),
    *("content_shuffled", "content_recoloured", "content_lead_absent", "kappa", "self_disagreement", "scene_cue"),
    *("presence", "presence_response", "repeats_together"),
)
"""Tests of a verdict that the power leaves out; each sometimes costs such a model its label."""

Codes = NDArray[np.signedinteger[Any]]
Levels = NDArray[np.float64]
Flags = NDArray[np.bool_]

_FEW = 64
"""Two codes of so many actions add up within eight bits."""


@dataclass(frozen=True, slots=True)
class Odds(JsonRecord):
    """How often a model gets its label at a noise floor; None where the bank lacks what it needs.

    ``depth``, and ``depth_associated`` for a run without controls, are keyed by the share of frames
    on which the model reads the distance. An absence needs all of its bounds together. ``left_out``
    are the tests of a verdict that are not drawn; they lower these rates by up to about .05, as
    measured.
    """

    noise: float
    image_invariant: float | None
    presence_only: float | None
    depth: Mapping[str, float | None]
    depth_associated: Mapping[str, float | None]
    left_out: tuple[str, ...] = LEFT_OUT

    @property
    def by_label(self) -> dict[str, float | None]:
        """Return how often each drawn label is given; for readers, those of all frames."""
        found = {"image_invariant": self.image_invariant, "presence_only": self.presence_only}
        return found | {"depth": self.depth.get("1"), "depth_associated": self.depth_associated.get("1")}

    @property
    def of_table(self) -> str:
        """Return the note below a table of labels."""
        return (
            "Reached: a model that deserves the label and never errs gets it; more frames are frames of the same "
            f"kinds in other episodes. Power: how often it gets it at a noise floor of {self.noise:g}."
        )

    def table(self) -> Table:
        """Return a row per kind of model: how often it gets its label."""
        rows: list[tuple[str, str, float | None]] = [
            ("never looks", "image_invariant", self.image_invariant),
            ("only tells a picture from none", "presence_only", self.presence_only),
        ]
        for share in self.depth:
            reads = f"reads the distance on {float(share):.0%} of the frames"
            rows += [
                (reads, "depth", self.depth[share]),
                (f"{reads}, without controls", "depth_associated", self.depth_associated[share]),
            ]
        named = (Column("a model that …"), Column("is", "word"), Column("power", "number", 2))
        note = (
            f"At a noise floor of {self.noise:g}. Tests that are not drawn lower these by up to about .05; --json "
            "names them (odds, left_out)."
        )
        return Table("odds", "How often a model of a known kind gets its label", named, tuple(rows), note)


def odds_of(
    bank: FrameBank, *, noise: float = NOISE, draws: int = DRAWS, seed: int = 0, reads: Sequence[float] = READS
) -> Odds:
    """Return how often models of known kinds get their labels on a bank.

    ``reads`` are the shares of the frames on which the drawn readers of distance read it.
    Raises SpecError for a noise floor that is impossible with this bank's number of actions.
    """
    space = bank.manifest.action_space
    if len(space.actions) < 2:
        return Odds(noise, None, None, dict.fromkeys(map(_named, reads)), dict.fromkeys(map(_named, reads)))
    count = len(space.actions)
    most = (count - 1) / count
    if not 0 <= noise < most:
        raise SpecError(f"--noise is the share of repeats that get another answer, from 0 to {most:.2f}; got {noise:g}")
    slips = most * (1 - np.sqrt(1 - noise / most))
    drawn = _SimulatedAnswers(bank, space, float(slips), draws, np.random.default_rng(seed))
    depth = {_named(share): drawn.depth(share) for share in reads}
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
    """Return how many frames can be shown under each condition of a run's first stage."""
    of_scenario = Counter(frame.scenario for frame in bank)
    calls = {}
    for name in of_bank(bank):
        if "text" in CONDITIONS[name].needs or name in CONTROLS:
            continue
        shown = [frame for frame in bank if is_available(name, frame)]
        if (name == "shuffled" and min(of_scenario.values()) < 2) or (
            name == "cross_scenario" and len(of_scenario) < 2
        ):
            shown = []
        calls[name] = len(shown)
    return calls


def sampled_of(bank: FrameBank) -> dict[str, int]:
    """Return on how many frames each sampled control is shown, if the answers call for it."""
    calls = sum(calls_of(bank).values())
    shown = {name: [frame.id for frame in bank if is_available(name, frame)] for name in SAMPLED}
    return {name: len(sample(name, ids, calls, 0)) for name, ids in shown.items()}


@dataclass(frozen=True)
class _SimulatedAnswers:
    """Draws many models' answers per condition as action codes, shape (draws, frames)."""

    bank: FrameBank
    space: Discrete
    slips: float
    draws: int
    rng: np.random.Generator

    def _answer(self, meant: Codes | int) -> Codes:
        """Return answers that each slip from the meant action to another one by chance."""
        shape = (self.draws, len(self.bank))
        other = self.rng.integers(1, len(self.space.actions), shape, dtype=self._code)
        slipped = self.rng.random(shape) < self.slips
        return np.asarray((meant + other * slipped) % len(self.space.actions), dtype=self._code)

    def _shown(self, *conditions: str) -> Flags:
        """Return the frames that can be shown under all of these conditions."""
        shown = np.array([all(is_available(name, frame) for name in conditions) for frame in self.bank])
        for name in {*SAMPLED} & {*conditions}:
            shown &= np.cumsum(shown) <= sampled_of(self.bank)[name]  # any sample of this size will do
        return shown

    @property
    def _code(self) -> type[np.signedinteger[Any]]:
        """Return the type of the codes, which holds a sum of two."""
        return np.int8 if len(self.space.actions) <= _FEW else np.int32

    @cached_property
    def _levels(self) -> NDArray[np.float64]:
        """Return the braking level of each action."""
        return np.array([self.space.project(action, "brake") or 0.0 for action in self.space.actions])

    @cached_property
    def _by_level(self) -> tuple[int, int, int]:
        """Return the codes of an action that goes on, one that brakes, and the hardest braking."""
        order = np.argsort(self._levels, kind="stable")
        return int(order[0]), int(order[len(order) - 2]), int(order[-1])

    def absence(self, *, presence: bool) -> float | None:
        """Return how often all bounds hold: of no looking, or of only seeing that it is a road."""
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
        """Return how often a reader of distance is ``depth``, and so without controls."""
        from scipy.stats import binom  # noqa: PLC0415 - slow to import

        pairs = self._shown("lead_near", "lead_far")
        if int(pairs.sum()) < FEWEST_PAIRS or not self.space.brake:
            return None, None
        go, brake, hard = self._by_level
        frames = len(self.bank)
        ranks = np.argsort(self.rng.random((self.draws, frames)), axis=1)
        reads = ranks < round(share * frames)

        near, far = (
            self._levels[self._answer(np.where(reads, code, brake).astype(self._code))][:, pairs] for code in (hard, go)
        )
        won, lost = (np.count_nonzero(apart, axis=1) for apart in (near > far, near < far))
        first = float((binom.sf(won - 1, won + lost, 0.5) < ALPHA).mean())
        return self._along(share) if self._shown(*RANGED).any() else None, first

    def _along(self, share: float) -> float:
        """Return how often a reader of distance is ``depth``, with pictures along the range.

        On ``share`` of the frames it brakes hardest in the nearest third of the range, and goes on
        in the farthest. Otherwise it always brakes.
        """
        shown = moved_of(Answers("", self.bank.frames, self.space, self.bank.manifest.gap, {}))
        go, brake, hard = self._by_level
        ranks = np.argsort(self.rng.random((self.draws, len(self.bank))), axis=1)
        distances = _distances(shown)
        least, greatest = (of(list(distances.values())) for of in (np.nanmin, np.nanmax))
        first, last = np.geomspace(least, greatest, 4)[1:3]
        codes, given = {}, {}
        for name, distance in (distances | {PATCHED: distances["real"]}).items():
            meant = np.where(distance < first, hard, np.where(distance < last, brake, go))
            codes[name] = self._answer(np.where(ranks < round(share * len(self.bank)), meant, brake).astype(self._code))
            given[name] = np.where(np.isnan(distance), np.nan, self._levels[codes[name]] / self._levels.max())
        draws = min(self.draws, ALONG_DRAWS)
        earned = (
            DEPTH.ruling(
                SimulatedStatistics(
                    replace(shown, levels={name: levels[draw] for name, levels in given.items()}),
                    self._of_pictures({name: code[draw] for name, code in codes.items()}),
                )
            )
            is not None
            for draw in range(draws)
        )
        return sum(earned) / draws

    def _of_pictures(self, codes: Mapping[str, Codes]) -> dict[str, Statistic]:
        """Return what depth reads besides where control pictures are not rendered, of one model's answers."""
        bank = self.bank.manifest
        if bank.provenance == "rendered":
            return {}
        conditions = (name for name in ("real", "real_repeat", PATCHED) if self._shown(name).any())
        decisions = {
            name: tuple(
                Decision(self.space.actions[code]) if there else None
                for code, there in zip(codes[name], self._shown(name), strict=True)
            )
            for name in conditions
        }
        gap = None if "episode" in bank.absent and not bank.independent else bank.gap
        answers = Answers("", self.bank.frames, self.space, gap, decisions, made=bank.provenance)
        tests = CalibratedTests(answers, Resampling(resamples=RESAMPLES), bank.independent).tests()
        found = {name: tests[name]() for name in OF_PICTURES if name in tests and name != "patched_bound"}
        if isinstance(one := found.get("patched_excess"), ChangedPairs) and 0 < one.n <= EXACT_UP_TO:
            high = MARGIN / 2 if is_bounded(one.b, one.c, one.n, MARGIN, alpha=ALPHA) else 1.0
            return found | {"patched_bound": Statistic(one.value, one.n, (-1.0, high))}  # its side of the margin alone
        return found | ({"patched_bound": tests["patched_bound"]()} if "patched_bound" in tests else {})


def _distances(levels: BrakingLevels) -> dict[str, Levels]:
    """Return the lead's distance under each condition of depth, NaN where a frame lacks it."""
    found = {name: levels.distance(picture) for name, picture in PICTURE_OF.items()}
    there = ~np.isnan(levels.distance("own"))
    return found | {name: np.where(there, levels.distance("far"), np.nan) for name in (BESIDE, "exchange_apart")}


class SimulatedStatistics(dict[str, Statistic]):
    """The depth statistics of drawn answers, each computed when a rule reads it."""

    def __init__(self, moved: BrakingLevels, of_pictures: Mapping[str, Statistic]) -> None:
        near, far = moved.level("lead_near"), moved.level("lead_far")
        both = ~np.isnan(near + far)
        super().__init__(
            depth_interventional=sign_test(near[both], far[both]),
            unparsed_controls=Statistic(0.0, 1, (0.0, 0.0)),
            **dict.fromkeys(("depth_net", "lane_net"), Statistic(None, 0)),
            **of_pictures,
        )
        self._tests = moved.tests()

    def __missing__(self, name: str) -> Statistic:
        self[name] = self._tests[name]()
        return self[name]


def _each(first: NDArray[np.int64], second: NDArray[np.int64], says: Callable[[int, int], bool]) -> Flags:
    """Return the result for every pair of counts."""
    return np.array([says(int(one), int(other)) for one, other in zip(first, second, strict=True)])


@cache
def _is_bounded(frames: int, alpha: float, lost: int, won: int) -> bool:
    """Return whether an effect is bounded, with so many frames for it and so many against."""
    first, second = np.zeros(frames), np.zeros(frames)
    first[:lost] = second[lost : lost + won] = 1
    p = bounded_below(first, second, margin=MARGIN, alpha=alpha).p
    return p is not None and p < alpha
