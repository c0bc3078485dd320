"""Counts over many replications: right labels, false labels, and rejections of each test."""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from eyechart.errors import SpecError
from eyechart.records import to_json_fields
from eyechart.stats.agreement import clopper_pearson, rate
from eyechart.stats.statistic import Statistic
from eyechart_organisms.adversaries import ADVERSARIES
from eyechart_organisms.calibration import early_stops as stopping
from eyechart_organisms.calibration.early_stops import EarlyStopOutcome, Sums
from eyechart_organisms.calibration.known_answers import KNOWN, NULLS, is_false
from eyechart_organisms.calibration.world import POWER, SETTINGS

FORMAT = "eyechart-calibration/1"
VARIANTS = ("with counterfactuals", "without counterfactuals")
CLAIMS: Mapping[str, tuple[str, ...]] = {
    "depth": ("depth", "depth_lateral"),
    "image_invariant": ("image_invariant",),
    "self_inconsistent": ("self_inconsistent",),
    "refusal_effect": ("refusal_effect",),
}
"""The positive claims that can be false, and the labels that make them."""

RIGHT = 0.95
"""The least share of right labels of each in `WANTED`, default setting, with counterfactuals."""

WANTED = (
    "constant",
    "refuse_blank",
    "declines_blank_depth",
    "truncating",
    "depth",
    "depth_lateral",
    "presence",
    "inverted",
    "nuisance",
    "scene_only",
    "random",
    "self_inconsistent",
    "time",
)

FALSE: Mapping[tuple[str, str], float] = {
    ("depth", VARIANTS[0]): 0.02,
    ("depth", VARIANTS[1]): 0.05,
    **{
        (claim, variant): 0.02
        for claim in ("image_invariant", "self_inconsistent", "refusal_effect")
        for variant in VARIANTS
    },
}
"""The largest share of false claims over the controllers for which the claim is false."""


AGAINST: Mapping[str, float] = {"depth": 0.01, "depth_lateral": 0.01, "turns_clear": 0.01, "absence": 0.005}
"""The largest share of each false claim over all adversaries for which it is false."""

LIMITS: Mapping[str, tuple[float, str]] = {
    "between_reversed_20": (0.16, "untrue, of a fifth of the frames between 9 and 49 m"),
    "patched_25": (0.93, "neither true nor untrue: 5 of 100 pairs are the wrong way round"),
    "exchange_reversed_35": (0.29, "neither true nor untrue: a neighbour near does half of what a lead does"),
}
"""The largest share of ``depth`` of adversaries that are named, and what is true of them.

Each is the end of the 99 % interval of what was measured in 200 banks. It replaces `AGAINST` for
that adversary alone: what is untrue still counts in the share over all.
"""

WEAK: Mapping[str, tuple[float, str]] = {
    "half_blind": (0.69, "it reads half of the frames"),
    "grades_noise_50": (0.58, "half of its answers are a coin"),
}
"""The least share of ``depth`` of readers below ordinary quality, in place of `RIGHT`."""

STRICT_FROM = 200
"""From this many replications, a target applies to the share; below, to its 95 % interval."""


@dataclass(frozen=True, slots=True)
class RuleOutcome:
    """The calibrated label that was given, the deserved one, and whether the given one is false."""

    label: str
    deserved: str
    false: bool


@dataclass(frozen=True, slots=True)
class ReplicationOutcome:
    """One controller's result in one replication: both sets of rules, and the p of every test.

    ``rulings`` and ``early`` are in the order of `VARIANTS`; ``early`` is empty if it was not
    measured.
    """

    controller: str
    paper: str
    rulings: tuple[RuleOutcome, RuleOutcome]
    lateral: str
    p_values: Mapping[str, float | None]
    early: tuple[EarlyStopOutcome, ...] = ()


@dataclass(frozen=True, slots=True)
class AdversaryTrial:
    """One adversary's labels on one bank."""

    adversary: str
    label: str
    lateral: str


@dataclass(frozen=True, slots=True)
class FalseClaims:
    """The rate of a false claim: over all controllers that it could wrong, and for the worst."""

    claim: str
    setting: str
    variant: str
    pooled: Statistic
    worst: str
    worst_rate: Statistic
    wanted: float

    @property
    def holds(self) -> bool:
        """Return whether the share is low enough, and no single controller is surely above it."""
        surely = any(one.ci is not None and one.ci[0] > self.wanted for one in (self.pooled, self.worst_rate))
        strict = self.worst_rate.n >= STRICT_FROM
        return not surely and not (strict and (self.pooled.value or 0.0) > self.wanted)


@dataclass(frozen=True, slots=True)
class NamedLimit:
    """How often one gets ``depth`` that passes, or falls short, and the bound of that."""

    name: str
    share: Statistic
    bound: float
    reads: bool
    why: str

    @property
    def holds(self) -> bool:
        """Return whether the share, or below `STRICT_FROM` cases its interval, reaches the bound."""
        value, (low, high) = self.share.value or 0.0, self.share.ci or (0.0, 1.0)
        if self.share.n >= STRICT_FROM:
            low = high = value
        return high >= self.bound if self.reads else low <= self.bound

    def __str__(self) -> str:
        wrong, n = _counted(self.share)
        low, high = self.share.ci or (0.0, 1.0)
        wanted = f"at {'least' if self.reads else 'most'} {self.bound}"
        return f"{self.name} gets depth {wrong} of {n} times [{low:.3f}, {high:.3f}], {wanted}: {self.why}"


@dataclass(frozen=True)
class Calibration:
    """All counts over ``replications`` banks of each setting.

    ``labels[setting][variant][controller]`` counts calibrated labels,
    ``paper[setting][controller]`` the paper's, and ``lateral[setting][controller]`` lateral ones.
    ``rights[setting][variant][controller]`` counts deserved labels. ``falses``, indexed like
    ``labels``, counts false ones.
    ``tests[setting][test][controller]`` is (made, rejected). ``early``, indexed like ``labels``,
    holds the effects of early stopping, and ``ever`` the rejections of each of its nulls.
    ``adversaries[name]`` counts its labels in the default setting with counterfactuals and
    controls, as "label/lateral label".
    """

    replications: int
    seed: int
    resamples: int
    settings: tuple[str, ...]
    labels: Mapping[str, Mapping[str, Mapping[str, Mapping[str, int]]]]
    paper: Mapping[str, Mapping[str, Mapping[str, int]]]
    lateral: Mapping[str, Mapping[str, Mapping[str, int]]]
    rights: Mapping[str, Mapping[str, Mapping[str, int]]]
    falses: Mapping[str, Mapping[str, Mapping[str, Mapping[str, int]]]]
    tests: Mapping[str, Mapping[str, Mapping[str, tuple[int, int]]]]
    early: Mapping[str, Mapping[str, Mapping[str, Sums]]] = field(default_factory=dict)
    ever: tuple[int, ...] = ()
    adversaries: Mapping[str, Mapping[str, int]] = field(default_factory=dict)

    def right(self, setting: str, variant: str, controller: str) -> Statistic:
        """Return how often a controller got the calibrated label that it deserves."""
        return rate(self.rights[setting][variant].get(controller, 0), self.replications)

    def undecided(self, setting: str, variant: str) -> Statistic:
        """Return the share of ``undecided`` among all verdicts of a setting."""
        counts = self.labels[setting][variant].values()
        return rate(sum(count.get("undecided", 0) for count in counts), self.replications * len(counts))

    def false_claims(self, claim: str, setting: str, variant: str) -> FalseClaims:
        """Return how often a claim was false."""
        by_controller = {
            name: sum(self.falses[setting][variant][name].get(label, 0) for label in CLAIMS[claim])
            for name in KNOWN
            if is_false(claim, name)
        }
        worst = max(by_controller, key=lambda name: by_controller[name])
        return FalseClaims(
            claim=claim,
            setting=setting,
            variant=variant,
            pooled=rate(sum(by_controller.values()), self.replications * len(by_controller)),
            worst=worst,
            worst_rate=rate(by_controller[worst], self.replications),
            wanted=FALSE[claim, variant],
        )

    def every_false_claim(self) -> list[FalseClaims]:
        """Return the false claims of every kind, setting and variant."""
        return [
            self.false_claims(claim, setting, variant)
            for claim in CLAIMS
            for setting in self.settings
            for variant in VARIANTS
        ]

    def fooled(self, claim: str) -> dict[str, Statistic]:
        """Return the rate of a false claim for each adversary that it could wrong."""
        result = {}
        for name, counts in self.adversaries.items():
            false = {called: claim in ADVERSARIES[name].is_false(*called.split("/")) for called in counts}
            if ADVERSARIES[name].may_be_wronged(claim):
                result[name] = rate(sum(counts[called] for called in counts if false[called]), sum(counts.values()))
        return result

    def missed_readers(self) -> dict[str, Statistic]:
        """Return how often each adversary that reads the lead's distance got such a label."""
        return {
            name: self._called(name, ("partial_depth",) if ADVERSARIES[name].near else ())
            for name in self.adversaries
            if ADVERSARIES[name].follows
        }

    def limits(self) -> list[NamedLimit]:
        """Return those that are named, of who was tried."""
        return [
            NamedLimit(name, self._called(name), bound, reads, why)
            for reads, named in ((False, LIMITS), (True, WEAK))
            for name, (bound, why) in named.items()
            if name in self.adversaries
        ]

    def _called(self, name: str, more: Sequence[str] = ()) -> Statistic:
        """Return how often an adversary is called depth, or one of more labels."""
        counts = self.adversaries[name]
        right = {*CLAIMS["depth"], *more}
        return rate(sum(n for called, n in counts.items() if called.split("/")[0] in right), sum(counts.values()))

    def type_one(self, setting: str, test: str) -> Statistic:
        """Return how often a test rejected where its null is true, at its own level."""
        made, rejected = 0, 0
        for name in NULLS[test][1]:
            one = self.tests[setting][test][name]
            made, rejected = made + one[0], rejected + one[1]
        return rate(rejected, made)

    def misses(self) -> list[str]:
        """Return every missed target in words; empty if all are met."""
        found = []
        if "default" in self.settings:
            for name in WANTED:
                share = self.right("default", VARIANTS[0], name)
                high = 1.0 if share.ci is None else share.ci[1]
                if high < RIGHT or (share.n >= STRICT_FROM and (share.value or 0.0) < RIGHT):
                    found.append(f"{name} is right in {share.value:.3f} of {share.n} replications, wanted {RIGHT}")
        found += [
            f"false {one.claim} in {one.setting}, {one.variant}: {one.pooled.value:.4f} of {one.pooled.n} "
            f"(worst {one.worst} {one.worst_rate.value:.3f} of {one.worst_rate.n}), wanted {one.wanted}"
            for one in self.every_false_claim()
            if not one.holds
        ]
        found += self._fooled()
        return found + stopping.misses(
            self.early, self.ever, self.replications, strict=self.replications >= STRICT_FROM
        )

    def _fooled(self) -> list[str]:
        """Return the claims that adversaries got too often, and readers' labels got too seldom."""
        found = [str(one) for one in self.limits() if not one.holds]
        for claim, wanted in AGAINST.items():
            each = self.fooled(claim)
            wrong, n = (
                (sum(numbers) for numbers in zip(*(_counted(one) for one in each.values()), strict=True))
                if each
                else (0, 0)
            )
            if n and clopper_pearson(wrong, n)[0] > wanted:
                found.append(f"false {claim} of adversaries: {wrong} of {n}, wanted {wanted}")
            for name, one in each.items():
                wrong, n = _counted(one)
                bounded = claim == "depth" and name in LIMITS
                if not bounded and wrong / n > wanted + 2 * math.sqrt(wanted * (1 - wanted) / n):
                    most = f"wanted at most {wanted} and two standard errors"
                    found.append(f"adversary {name} gets {claim} {wrong} of {n} times, {most}")
        return found + [
            f"{name} reads the distance and gets that label in {reader.value:.3f} of {reader.n} cases, wanted {RIGHT}"
            for name, reader in self.missed_readers().items()
            if name not in WEAK and reader.ci is not None and reader.ci[1] < RIGHT
        ]

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values: the counts, and the results from them."""
        return {
            "format": FORMAT,
            **to_json_fields(self, "replications seed resamples"),
            "settings": {name: SETTINGS[name].says for name in self.settings},
            "controllers": {name: to_json_fields(one, "says calibrated paper") for name, one in KNOWN.items()},
            **to_json_fields(self, "labels paper lateral rights falses"),
            "right": {
                setting: {
                    variant: {name: _plain(self.right(setting, variant, name)) for name in KNOWN}
                    for variant in VARIANTS
                }
                for setting in self.settings
            },
            "undecided": {
                setting: {variant: _plain(self.undecided(setting, variant)) for variant in VARIANTS}
                for setting in self.settings
            },
            "false_claims": [
                {
                    **to_json_fields(one, "claim setting variant"),
                    **_plain(one.pooled),
                    "worst": {"controller": one.worst, **_plain(one.worst_rate)},
                    **to_json_fields(one, "wanted holds"),
                }
                for one in self.every_false_claim()
            ],
            "type_one": {
                setting: {test: {"alpha": NULLS[test][0], **_plain(self.type_one(setting, test))} for test in NULLS}
                for setting in self.settings
            },
            **to_json_fields(self, "tests early ever"),
            "adversaries": {
                name: {"says": ADVERSARIES[name].says, "deserves": ADVERSARIES[name].deserves, "called": counts}
                for name, counts in self.adversaries.items()
            },
            "limits": [{**to_json_fields(one, "name bound why holds"), **_plain(one.share)} for one in self.limits()],
            "power": [setting for setting in POWER if setting in self.settings],
            "misses": self.misses(),
        }


def read_calibration(raw: Mapping[str, Any]) -> Calibration:
    """Return the calibration that `Calibration.as_dict` wrote; raises SpecError for other data."""
    if raw.get("format") != FORMAT:
        raise SpecError(f"this is no calibration of format {FORMAT!r}, but {raw.get('format')!r}")
    tests = {
        setting: {test: {name: (made, rejected) for name, (made, rejected) in by.items()} for test, by in found.items()}
        for setting, found in raw["tests"].items()
    }
    counts: dict[str, Any] = {name: raw[name] for name in ("labels", "paper", "lateral", "rights", "falses")}
    counts |= {name: int(raw[name]) for name in ("replications", "seed", "resamples")}
    counts |= {"early": raw.get("early", {}), "ever": tuple(raw.get("ever", ()))}
    counts["adversaries"] = {name: one["called"] for name, one in raw.get("adversaries", {}).items()}
    return Calibration(settings=tuple(raw["settings"]), tests=tests, **counts)


def label_counts(tried: Iterable[AdversaryTrial]) -> dict[str, dict[str, int]]:
    """Return the counts of each adversary's labels."""
    found: dict[str, Counter[str]] = {}
    for trial in tried:
        found.setdefault(trial.adversary, Counter())[f"{trial.label}/{trial.lateral}"] += 1
    return {name: dict(sorted(counts.items())) for name, counts in found.items()}


def _counted(share: Statistic) -> tuple[int, int]:
    return round((share.value or 0.0) * share.n), share.n


def _plain(share: Statistic) -> dict[str, object]:
    return {"value": share.value, "n": share.n, "ci": None if share.ci is None else list(share.ci)}


def tally(
    found: Iterable[tuple[str, Sequence[ReplicationOutcome]]],
    *,
    settings: tuple[str, ...],
    replications: int,
    seed: int,
    resamples: int,
) -> Calibration:
    """Count the outcomes of every setting, in any order."""
    by: dict[str, dict[str, list[ReplicationOutcome]]] = {s: {name: [] for name in KNOWN} for s in settings}
    for setting, outcomes in found:
        for outcome in outcomes:
            by[setting][outcome.controller].append(outcome)

    def each(says: Callable[[ReplicationOutcome], str]) -> dict[str, dict[str, dict[str, int]]]:
        return {s: {name: _counts(map(says, ones)) for name, ones in of.items()} for s, of in by.items()}

    def ruled(keep: Callable[[RuleOutcome], bool]) -> dict[str, dict[str, dict[str, dict[str, int]]]]:
        return {
            s: {v: {name: _labels(ones, v, keep) for name, ones in of.items()} for v in VARIANTS}
            for s, of in by.items()
        }

    rights = ruled(lambda one: one.label == one.deserved)
    return Calibration(
        replications=replications,
        seed=seed,
        resamples=resamples,
        settings=settings,
        labels=ruled(lambda _: True),
        paper=each(lambda one: one.paper),
        lateral=each(lambda one: one.lateral),
        rights={
            s: {v: {name: sum(of[name].values()) for name in sorted(of) if by[s][name]} for v, of in found.items()}
            for s, found in rights.items()
        },
        falses=ruled(lambda one: one.false),
        tests={
            s: {test: {name: _rejected(ones, test) for name, ones in of.items()} for test in NULLS}
            for s, of in by.items()
        },
        early={s: stops for s, of in by.items() if (stops := _stops(of))},
    )


def _labels(
    outcomes: Sequence[ReplicationOutcome], variant: str, keep: Callable[[RuleOutcome], bool]
) -> dict[str, int]:
    ruled = (outcome.rulings[VARIANTS.index(variant)] for outcome in outcomes)
    return _counts(one.label for one in ruled if keep(one))


def _counts(words: Iterable[str]) -> dict[str, int]:
    return dict(sorted(Counter(words).items()))


def _rejected(outcomes: Sequence[ReplicationOutcome], test: str) -> tuple[int, int]:
    """Return how often a test was made, and how often it rejected."""
    ps = [p for outcome in outcomes if (p := outcome.p_values.get(test)) is not None]
    return len(ps), sum(p < NULLS[test][0] for p in ps)


def _stops(by: Mapping[str, Sequence[ReplicationOutcome]]) -> dict[str, dict[str, Sums]]:
    """Return the effects of early stopping by variant and controller, where measured."""
    stops: dict[str, dict[str, Sums]] = {}
    for name, outcomes in by.items():
        for outcome in outcomes:
            for variant, stop in zip(VARIANTS, outcome.early, strict=False):
                sums = stops.setdefault(variant, {})
                sums[name] = stopping.add(sums.get(name, stopping.EMPTY), stop)
    return stops
