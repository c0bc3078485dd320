"""Power before money: what a bank can and cannot decide, computed before any call."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from eyechart.conditions import CONTROLS, asked_in_stages, is_available
from eyechart.frames import FrameBank
from eyechart.report.table import Column, Mark, Table, columns, of_lines
from eyechart.stats.agreement import detectable_share, trials_needed
from eyechart.stats.episode_permutation import EpisodePermutation, exchange_test
from eyechart.stats.paired_tests import bounded_below, pairs_to_bound
from eyechart.studies.battery.controls import FEWEST_PAIRS
from eyechart.studies.battery.early_stop import layout_of, typical
from eyechart.studies.battery.odds import NOISE, Odds, calls_of, odds_of, sampled_of
from eyechart.studies.battery.reach import Reach, reach_of
from eyechart.verdicts import ALPHA, MARGIN

POWER = 0.80
SWAP_RATE = 0.65
"""The swap rate that the test should distinguish from chance."""
CHANCES = (0.2, 0.5)
"""Swap rates by chance: with five equally frequent actions, and with two."""

DEMAND = "demand"
"""The column of ground truth with the action that a frame demands, where a bank has it."""

PRESENCE_FRAMES = 8
"""With fewer frames no label swap reaches a two-sided alpha of .01 (2 · 2 to the -8 is .0078)."""

_DISAGREEMENTS = tuple(share / 100 for share in range(91))


@dataclass(frozen=True)
class BankPower:
    """What a bank can decide at alpha .01 with power .8.

    ``calls`` counts a model's calls by condition, ``controls`` those of each control, made where a
    model's answers call for it. ``smallest_win_share`` is a share of counterfactual pairs, if the
    braking level differs in all of them; None where no share is detectable. ``directional_frames``
    counts frames that demand a turn, None where the bank does not say.

    ``smallest_bound`` is the smallest effect whose absence can be shown for a model that never
    disagrees with itself. ``largest_disagreement`` is the self-disagreement up to which an effect
    below the margin can be bounded; both are None where it cannot.

    ``stopped_early`` maps a label to the calls with --stop-early if repeats never differ.
    ``cannot_say`` maps a test to the reason. ``odds`` say how often known kinds of models get their
    labels; ``labels`` say whether a simulated model gets each calibrated label.
    """

    bank: str
    frames: int
    episodes: Mapping[str, int]
    calls: Mapping[str, int]
    counterfactual_pairs: int
    smallest_win_share: float | None
    smallest_p_exchange: float | None
    directional_frames: int | None
    directional_needed: Mapping[str, int]
    smallest_swap_rate: float | None
    smallest_bound: float | None
    frames_to_bound: int
    largest_disagreement: float | None
    stopped_early: Mapping[str, int]
    cannot_say: Mapping[str, str]
    controls: Mapping[str, int]
    odds: Odds
    labels: tuple[Reach, ...]

    def table(self) -> Table:
        """Return a row per label: whether the bank can give it, and how often when deserved."""
        power = self.odds.by_label
        rows = tuple(
            (
                label.label,
                label.answer,
                Mark(label.words, "good" if label.reached else "bad"),
                power.get(label.label),
                label.lacks,
            )
            for label in self.labels
        )
        named = (*columns("word", "label", "answer", "a simulated model gets it"), Column("power", "number", 2))
        return Table("labels", "What this bank can say", (*named, Column("why not")), rows, self.odds.of_table)

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        levels = {"alpha": ALPHA, "power": POWER, "margin": MARGIN}
        plan = {"format": "eyechart-plan/1", "calls_per_model": sum(self.calls.values()), **levels}
        return plan | asdict(self)

    def of_model(self, spec: str) -> dict[str, object]:
        """Return a model's number of calls; the cost is None where its adapter states no price."""
        del spec  # scripted models cost nothing that could be priced
        return {"calls": sum(self.calls.values()), "controls": sum(self.controls.values()), "cost": None}

    def details(self, specs: Sequence[str]) -> Table:
        """Return the details, a row each: calls, what each test can find, and what cannot say."""
        episodes = ", ".join(f"{scenario} {count}" for scenario, count in self.episodes.items())
        calls = ", ".join(f"{name} {count}" for name, count in self.calls.items())
        controls = ", ".join(f"{name} {count}" for name, count in self.controls.items() if count) or "none"
        needed = " or ".join(f"{n} turns against {chance}" for chance, n in self.directional_needed.items())
        turns = "—" if self.directional_frames is None else self.directional_frames
        said = [
            f"bank {self.bank}: {self.frames} frames; episodes by scenario: {episodes}",
            f"calls per model: {sum(self.calls.values())} ({calls})",
            f"controls, where its answers call for them: up to {sum(self.controls.values())} more calls ({controls})",
            (
                f"distance by intervention: {self.counterfactual_pairs} counterfactual pairs; detectable with power "
                f"{POWER}: harder braking in at least {_number(self.smallest_win_share)} of the pairs, if the braking "
                "level differs in all"
            ),
            f"distance by observation: smallest p with exchanged episodes: {_number(self.smallest_p_exchange)}",
            (
                f"turns: {turns} frames demand a turn; to distinguish a swap rate of {SWAP_RATE} from "
                f"chance takes {needed}; smallest rate found against .5: {_number(self.smallest_swap_rate)}"
            ),
            (
                f"absence: the smallest effect that can be bounded is {_number(self.smallest_bound)}; a bound below "
                f"{MARGIN} takes {self.frames_to_bound} frames. On this bank it allows a self-disagreement of at most "
                f"{_number(self.largest_disagreement)}, if no answer changes"
            ),
        ]
        counts = sorted(self.stopped_early.items(), key=lambda one: one[1])
        early = ", ".join(f"{count} ({label})" for label, count in counts) or "as many"
        most = f"at most {sum(self.calls.values()) + sum(self.controls.values())} calls per model"
        said.append(f"stopping early (--stop-early): {most}; a model whose repeats never differ takes {early}")
        more = f"and up to {sum(self.controls.values())} of controls"
        said += [f"model {spec}: {self.of_model(spec)['calls']} calls {more}, cost —" for spec in specs]
        said += [f"cannot say: {test}: {why}" for test, why in self.cannot_say.items()]
        return of_lines("details", "What it comes of", said)


def _number(value: float | None) -> str:
    return "—" if value is None else f"{value:.3g}"


def power_of(bank: FrameBank, *, noise: float = NOISE) -> BankPower:
    """Return what a bank can decide about models with this noise floor; opens no picture.

    Raises SpecError for a noise floor that no model can have.
    """
    calls = calls_of(bank)
    pairs = sum(all(name in frame.counterfactuals for name in ("lead_near", "lead_far")) for frame in bank)
    demanded = [frame.truth.get(DEMAND) for frame in bank]
    directional = bank.manifest.action_space.directional
    turns = sum(one in directional for one in demanded) if any(demanded) else None
    smallest, why = _smallest_p(bank)
    never = np.zeros(len(bank))
    bound = bounded_below(never, never, margin=MARGIN, alpha=ALPHA).ci
    controls = _controls_of(bank) | sampled_of(bank)
    shown = [name for name, count in (calls | controls).items() if count]
    conditions = {frame.id: tuple(name for name in shown if is_available(name, frame)) for frame in bank}
    return BankPower(
        bank=bank.name,
        frames=len(bank),
        episodes=dict(
            sorted(Counter(scenario for scenario, _ in {(one.scenario, one.episode) for one in bank}).items())
        ),
        calls=calls,
        counterfactual_pairs=pairs,
        smallest_win_share=detectable_share(pairs, alpha=ALPHA, power=POWER),
        smallest_p_exchange=smallest,
        directional_frames=turns,
        directional_needed={
            f"{chance:g}": trials_needed(SWAP_RATE, chance, alpha=ALPHA, power=POWER) for chance in CHANCES
        },
        smallest_swap_rate=None if turns is None else detectable_share(turns, alpha=ALPHA, power=POWER),
        smallest_bound=None if bound is None else bound[1],
        frames_to_bound=pairs_to_bound(margin=MARGIN, alpha=ALPHA),
        largest_disagreement=max(
            (share for share in _DISAGREEMENTS if pairs_to_bound(share, margin=MARGIN, alpha=ALPHA) <= len(bank)),
            default=None,
        ),
        stopped_early=typical(layout_of(bank.frames, conditions, bank.manifest.action_space, 0)),
        cannot_say=_cannot_say(bank, calls, pairs, why),
        controls=controls,
        odds=odds_of(bank, noise=noise),
        labels=reach_of(bank),
    )


def _controls_of(bank: FrameBank) -> dict[str, int]:
    """Return on how many frames each control of a run's later stages can be shown."""
    have = {name: sum(is_available(name, frame) for frame in bank) for name in CONTROLS}
    return {name: have[name] for name in asked_in_stages([name for name, count in have.items() if count])}


def _smallest_p(bank: FrameBank) -> tuple[float | None, str]:
    """Return the smallest p of the episode exchange, and why it cannot decide ("" where it can)."""
    if bank.manifest.gap is None:
        return None, "the bank records no gap"
    levels, ranks = np.zeros(len(bank), dtype=np.int64), np.arange(len(bank), dtype=np.float64)
    columns = [np.array([getattr(frame, name) for frame in bank]) for name in ("scenario", "episode", "step")]
    try:
        statistic = exchange_test(levels, ranks, *columns, seed=0, alpha=ALPHA)
    except ValueError as error:
        return None, str(error)
    smallest = statistic.smallest_p if isinstance(statistic, EpisodePermutation) else None
    return smallest, "" if statistic.p is not None else statistic.note


def _cannot_say(bank: FrameBank, calls: Mapping[str, int], pairs: int, exchange: str) -> dict[str, str]:
    """Return every test that this bank cannot decide, by name, with the reason."""
    result: dict[str, str] = {}
    if pairs < FEWEST_PAIRS:
        result["depth_interventional"] = f"{pairs} counterfactual pairs; {FEWEST_PAIRS} are needed"
    if exchange:
        result["depth_observational"] = result["depth_information"] = exchange
    if bank.manifest.gap is None:
        result |= dict.fromkeys(("obstacle", "mutual_information", "gap_order"), "the bank records no gap")
    for condition, tests in _READS.items():
        if not calls[condition]:
            result |= dict.fromkeys(tests, f"no frame can be shown {condition}")
    if not bank.manifest.action_space.directional:
        result["mirror_swap_rate"] = "no action of this space exchanges under reflection"
    if len(bank) < PRESENCE_FRAMES:
        result["presence"] = f"{len(bank)} frames; {PRESENCE_FRAMES} are needed"
    need = pairs_to_bound(margin=MARGIN, alpha=ALPHA)
    for condition, name in _BOUNDS.items():
        if calls[condition] < need:
            result.setdefault(name, f"{calls[condition]} frames can be shown {condition}; {need} are needed")
    return result


_READS: Mapping[str, tuple[str, ...]] = {
    "shuffled": ("content_shuffled", "bound_content_shuffled", "scene_cue"),
    "cross_scenario": ("scene_cue", "bound_scene"),
    "recoloured": ("content_recoloured", "bound_content_recoloured"),
    "mirrored": ("mirror_swap_rate",),
}
"""The tests that each condition is needed for."""

_BOUNDS: Mapping[str, str] = {
    "blank": "bound_blank",
    "shuffled": "bound_content_shuffled",
    "recoloured": "bound_content_recoloured",
    "cross_scenario": "bound_scene",
}
"""The bounds of an absence, by the condition that each compares with a repeat."""
