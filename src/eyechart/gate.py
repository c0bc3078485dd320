"""A gate checks a run against requirements: yes, no, or "cannot say" without evidence."""

import shlex
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Protocol, TypedDict, Unpack

from eyechart.errors import SpecError, did_you_mean, require_known
from eyechart.integrity import Guard, ServedGuard, unfinished
from eyechart.modes import is_made_elsewhere
from eyechart.stats.agreement import clopper_pearson
from eyechart.stats.paired_tests import SignTest
from eyechart.stats.statistic import Statistic
from eyechart.verdicts import (
    ALPHA,
    LABELS,
    LATERAL,
    MARGIN,
    Evidence,
    Label,
    ScoredRun,
    Verdict,
    judge_one,
)
from eyechart.verdicts.admission import CLAUSES
from eyechart.verdicts.admission import hold as hold_clauses
from eyechart.verdicts.depth import holes, is_drawn, is_refuted, named
from eyechart.verdicts.labels import LOOKS, UseLabel, meets
from eyechart.verdicts.policy_verdict import AXES, PolicyVerdict
from eyechart.verdicts.policy_verdict import REQUIREMENTS as OF_POLICIES
from eyechart.verdicts.ruling import Ruling
from eyechart.verdicts.why_not import NOTHING


def _meeting(labels: Mapping[str, Label], which: str) -> dict[str, str]:
    names = dict.fromkeys(name for label in labels for name in meets(label, labels))
    meeting = {name: sorted(label for label in labels if name in meets(label, labels)) for name in names}
    return {name: f"the {which} is {' or '.join(found)}" for name, found in meeting.items()}


REQUIREMENTS = _meeting(LABELS, "calibrated verdict") | _meeting(LATERAL, "lateral label")
"""The possible requirements of a battery, with their meaning."""

UNPARSED = "max_unparsed"
ORDER = "order"
ADMISSION: dict[str, str] = {
    "admission": "every clause of admission",
    **{name: clause.needs for name, clause in CLAUSES.items()},
}
"""The possible requirements of a run of scene estimates; those of a battery do not apply."""


class FurtherTerms(TypedDict, total=False):
    """Further requirements and exceptions.

    ``order`` bounds the share of comparisons in the wrong order. ``allow_fingerprints`` accepts one
    model with several server configurations. ``made_elsewhere`` accepts answers whose questions
    only their maker knows. ``evidence`` names what a label of distance may rest on besides: edited.
    """

    order: float | None
    allow_fingerprints: bool
    made_elsewhere: bool
    evidence: str | None


class Terms(FurtherTerms, total=False):
    """The terms of a gate: the highest rate of calls without a decision, and further ones."""

    max_unparsed: float | None


@dataclass(frozen=True, slots=True)
class Check:
    """One requirement on one model: ``holds`` is True, False or None (cannot say)."""

    model: str
    requirement: str
    holds: bool | None
    because: str


@dataclass(frozen=True, slots=True)
class Gate:
    """Every check of a gate; ``exit_code`` is 0 if all hold, 1 if one fails, else 2."""

    checks: tuple[Check, ...]

    @property
    def exit_code(self) -> int:
        """Return 0 for holds, 1 for fails, 2 for cannot say; no check at all is "cannot say"."""
        outcomes = [check.holds for check in self.checks]
        if False in outcomes:
            return 1
        return 0 if outcomes and None not in outcomes else 2

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        words = {True: "holds", False: "fails", None: "cannot say"}
        return {
            "exit_code": self.exit_code,
            "checks": [{**asdict(check), "outcome": words[check.holds]} for check in self.checks],
        }

    def junit(self) -> bytes:
        """Return the checks as JUnit XML: a failure if one fails, an error if it cannot say."""
        import xml.etree.ElementTree as ET  # noqa: PLC0415 - slow to import

        count = {
            "tests": str(len(self.checks)),
            "failures": str(sum(check.holds is False for check in self.checks)),
            "errors": str(sum(check.holds is None for check in self.checks)),
            "skipped": "0",
        }
        suites = ET.Element("testsuites", count)
        suite = ET.SubElement(suites, "testsuite", {"name": "eyechart gate", **count})
        for check in self.checks:
            case = ET.SubElement(suite, "testcase", classname=_printable(check.model), name=check.requirement)
            if check.holds is not True:
                kind = "failure" if check.holds is False else "error"
                ET.SubElement(case, kind, message=_printable(check.because))
        ET.indent(suites)
        return bytes(ET.tostring(suites, encoding="utf-8", xml_declaration=True))


def _printable(text: str) -> str:
    """Return a text without control characters, which XML cannot hold."""
    return "".join(character for character in text if character.isprintable() or character in "\n\t")


def read_requirements(text: str, known: Collection[str] = tuple(REQUIREMENTS)) -> tuple[str, ...]:
    """Read ``depth,swaps``; raises SpecError that lists the ``known`` requirements."""
    wanted = tuple(dict.fromkeys(part.strip() for part in text.split(",") if part.strip()))
    unknown = [name for name in wanted if name not in known]
    if unknown or not wanted:
        near = "".join(did_you_mean(name, known) for name in unknown)
        raise SpecError(
            f"--require takes one or more of {', '.join(known)}, with commas; got '{text}'{near and f';{near}'}"
        )
    return wanted


def hold_policies(
    verdicts: Mapping[str, PolicyVerdict],
    require: Sequence[str],
    open_calls: Mapping[str, int],
    guards: Mapping[str, Sequence[Guard]] | None = None,
    **terms: Unpack[Terms],
) -> Gate:
    """Check every policy against labels of its axes, as ``camera:camera_content``, or ``looks``.

    ``looks`` is about its cameras. ``open_calls`` are unfinished calls. A failed guard, an
    unfinished run or an inconclusive label gives "cannot say". So does a label that may be the
    wanted one: a bank that moves no object cannot show that an object is followed. ``guards`` are
    those of its calls. Raises SpecError for an unknown label.
    """
    _require_battery(terms)
    checks = []
    for spec, verdict in verdicts.items():
        labels = {"camera": verdict.camera, "state": verdict.state, "instruction": verdict.instruction}
        for name in read_requirements(",".join(require), tuple(OF_POLICIES)):
            axis, _, wanted = f"camera:{LOOKS}".partition(":") if name == LOOKS else name.partition(":")
            found, known = labels[axis], AXES[axis]
            because = f"{found.label}: {found.because}"
            if found.responds is not None and found.why_not:
                because = f"{because} {found.why_not[0].upper()}{found.why_not[1:]}."
            holds: bool | None = wanted in meets(found.label, known)
            if verdict.guards or open_calls.get(spec):
                holds = None
                because = verdict.because if verdict.guards else f"{open_calls[spec]} calls are unfinished"
            elif not holds and (_is_open_to(known, found.label, wanted) or wanted == found.may_be):
                holds = None
                why = found.why_not if found.may_be else ""
                because = f"{because} {why[0].upper()}{why[1:]}." if why else because
            kept = [one for one in (guards or {}).get(spec, ()) if isinstance(one, ServedGuard) and not one.holds]
            checks.append(_marked(Check(spec, name, holds, because), kept, terms))
    return Gate(tuple(checks))


def _is_open_to(known: Mapping[str, UseLabel], label: str, wanted: str) -> bool:
    """Return whether a label of an axis neither shows nor refutes what is wanted."""
    return known[label].leaves_open(known[wanted]) if wanted in known else known[label].is_open


def _require_battery(terms: Terms) -> None:
    """Raise SpecError if an order is required of a run without comparisons."""
    for name, what in (("order", "comparisons of distances"), ("evidence", "control pictures")):
        if terms.get(name) is not None:
            raise SpecError(f"--{name} is for a battery's {what}, and this run is no battery: leave it out")


def hold_admission(score: ScoredRun, require: Sequence[str] = ("admission",), **terms: Unpack[Terms]) -> Gate:
    """Check every model of a run of scene estimates against clauses of admission.

    There is a check per clause; ``admission`` means all of them. An unfinished run or one with
    failed calls cannot say. Nor can a clause that would hold if a guard failed. Raises SpecError
    for an unknown clause or a rate outside [0, 1].
    """
    _require_battery(terms)
    wanted = read_requirements(",".join(require), tuple(ADMISSION))

    def checks(one: Evidence, reason: str) -> Iterator[Check]:
        for clause in hold_clauses(one.statistics):
            if clause.name in wanted or "admission" in wanted:
                yield Check(one.model, clause.name, None if reason else clause.passes, reason or clause.words)

    return _gate(score, checks, _without_estimate, terms)


def _gate(
    score: ScoredRun,
    checks: Callable[[Evidence, str], Iterator[Check]],
    unparsed: Callable[[Evidence, float, str], Check],
    terms: Terms,
) -> Gate:
    """Return every model's checks, and one of its ``unparsed`` rate if that is bounded.

    Guards mark all checks. Answers made elsewhere cannot say, unless the ``terms`` allow them. Each
    check gets the reason why there is no evidence, or "". Raises SpecError for a rate outside [0,
    1].
    """
    most, found = terms.get("max_unparsed"), list[Check]()
    if most is not None and not 0 <= most <= 1:
        raise SpecError(f"--max-unparsed takes a rate between 0 and 1, got {most}")
    for one in score.evidence().values():
        reason = _no_evidence(one)
        if is_made_elsewhere(one.model) and not terms.get("made_elsewhere"):
            reason = reason or _ELSEWHERE
        mine = [*checks(one, reason), *([] if most is None else [unparsed(one, most, reason)])]
        found += [_marked(check, one.failed, terms) for check in mine]
    return Gate(tuple(found))


_ELSEWHERE = (
    "eyechart did not make these calls: only their maker knows the questions and the model; accept that with "
    "--made-elsewhere"
)
"""Why a gate takes no evidence from answers that were made elsewhere."""


def _without_estimate(one: Evidence, most: float, reason: str) -> Check:
    parse = one.statistics["parse"]
    without = None if parse.value is None else 1 - parse.value
    words = parse.note if without is None else f"without an estimate {without:.3f}, at most {most}"
    return Check(one.model, UNPARSED, None if reason or without is None else without <= most, reason or words)


ONLINE: dict[str, str] = {
    **ADMISSION,
    "frames": "every frame that an estimator saw passes renderer integrity and the positive control",
}
"""The possible requirements of an online run: the same clauses over the frames met, and these."""


class ScoredOnlineRun(ScoredRun, Protocol):
    """A scored online run."""

    def left(self, spec: str) -> tuple[int, int]:
        """Return the numbers of finished and planned episodes of a model."""

    def frames(self, spec: str) -> tuple[bool | None, str]:
        """Return whether every frame that a model saw passes (None: unknown), and why."""


def hold_online(score: ScoredOnlineRun, require: Sequence[str] = ("admission",), **terms: Unpack[Terms]) -> Gate:
    """Check every estimator of an online run against clauses over the frames that it met.

    ``admission`` means all of them and ``frames``. A clause that would hold cannot say if frames
    fail their checks or were not checked. An unfinished run cannot say anything. Raises SpecError
    for an unknown clause or a rate outside [0, 1].
    """
    wanted = read_requirements(",".join(require), tuple(ONLINE))
    clauses = [name for name in wanted if name != "frames"]
    held = hold_admission(score, clauses or ["admission"], **terms)
    found = [check for check in held.checks if clauses or check.requirement == UNPARSED]
    checks: list[Check] = []
    for spec in score.evidence():
        seen, why = score.frames(spec)
        mine = [check for check in found if check.model == spec]
        if seen is not True:
            mine = [replace(one, holds=None, because=f"{one.because}; {why}") if one.holds else one for one in mine]
        if {"frames", "admission"} & set(wanted):
            mine.append(Check(spec, "frames", seen, why))
        if left := unfinished(*score.left(spec), "episodes"):
            mine = [replace(one, holds=None, because=f"the run is {left}") for one in mine]
        checks += mine
    return Gate(tuple(checks))


def hold(score: ScoredRun, require: Sequence[str], **terms: Unpack[Terms]) -> Gate:
    """Check every model of a scored battery against requirements and a rate of unparsed calls.

    A run without calls, an unfinished run, and a model with failed calls cannot say. Nor can a
    requirement that would hold if a guard failed. Nothing can be said if more than one model
    answered; ``allow_fingerprints`` accepts several configurations of one model. Raises SpecError
    for an unknown requirement or a rate outside [0, 1].
    """
    wanted = read_requirements(",".join(require))

    require_known(f"--evidence '{accepts}'", accepts, ACCEPTED) if (accepts := terms.get("evidence")) else None
    most = terms.get("order")
    if most is not None and not 0 < most <= 1:
        raise SpecError(f"--order takes a share above 0 and at most 1, got {most}")

    def checks(one: Evidence, reason: str) -> Iterator[Check]:
        verdict = judge_one(one)
        for requirement in wanted:
            yield Check(
                one.model, requirement, *((None, reason) if reason else _made_so(requirement, verdict, one, accepts))
            )
        if most is not None:
            yield Check(one.model, ORDER, *((None, reason) if reason else _ordered(one.statistics, most)))

    return _gate(score, checks, _unparsed, terms)


def _marked(check: Check, guards: Sequence[Guard], terms: Terms) -> Check:
    """Return a check with its failed guards; one that holds becomes "cannot say".

    If several models answered, every check does. Another fingerprint alone may be allowed.
    """
    served = [guard for guard in guards if isinstance(guard, ServedGuard)]
    allowed = [guard for guard in served if guard.is_by_fingerprint and terms.get("allow_fingerprints")]
    failed = [guard for guard in guards if guard not in allowed]
    if not failed:
        return check
    nothing, marks = check.holds or len(served) > len(allowed), (guard.mark for guard in failed)
    return replace(check, holds=None if nothing else check.holds, because="; ".join((check.because, *marks)))


def _no_evidence(one: Evidence) -> str:
    """Return why a model's calls are no evidence at all, or ""."""
    if one.planned == 0 or one.answered == 0:
        return "the run holds no finished call of this model"
    if one.is_unfinished:
        later = "; a shard asks no controls: merge the shards and resume the run" if one.part else ""
        return f"the run is {unfinished(one.answered, one.planned, part=True)}{later}"
    if errors := one.reasons().get("error"):
        return (
            f"{errors} of {one.answered} calls ended in an error (see the ledger), so they say nothing about the model"
        )
    return ""


def _made_so(requirement: str, verdict: Verdict, one: Evidence, accepts: str | None) -> tuple[bool | None, str]:
    """Return whether a verdict meets a requirement by control pictures that are accepted, and why."""
    holds, because = _claim(requirement, verdict, one.statistics)
    if not holds or requirement not in _BY_CONTROLS or not verdict.rests_on_controls:
        return holds, because
    if not one.made:
        run = shlex.quote(one.run)
        mend = f"say it with 'eyechart frames declare {run} --made staged' (or rendered, or edited)"
        return None, f"{because}; it is not said how the control pictures were made: {mend}"
    if one.made == "edited" and accepts != "edited":
        return False, f"{because}; its control pictures are edited photographs: accept these with --evidence edited"
    return holds, because


def _claim(requirement: str, verdict: Verdict, statistics: Mapping[str, Statistic]) -> tuple[bool | None, str]:
    """Return whether a verdict meets a requirement, and why."""
    label = verdict.calibrated.label
    because = f"{label}: {verdict.calibrated.because}"
    if requirement in _SIDEWAYS:
        return _sideways(requirement, verdict.lateral)
    if requirement in meets(label, LABELS):
        weak = f"not excluded: {', or '.join(verdict.open_to)}" if requirement in _AUTHORITY and verdict.open_to else ""
        return (None, f"{because}; {weak}") if weak else (True, because)
    if requirement in _AUTHORITY:
        return _not_depth(verdict, statistics, because)
    is_open = label == "undecided" or (requirement == LOOKS and LABELS[label].answer == "Inconclusive")
    return None if is_open else False, because


_SIDEWAYS = frozenset(name for label in LATERAL for name in meets(label, LATERAL))
_AUTHORITY = frozenset({"depth", "depth_lateral"})
"""Requirements on turns, and those that give a permitted use, which must leave nothing open."""
_BY_CONTROLS = _AUTHORITY | {"partial_depth", "depth_associated"}
"""Requirements of braking by distance, which control pictures show."""
ACCEPTED = ("edited",)
"""What a gate accepts as evidence where that is said."""


def _sideways(requirement: str, lateral: Ruling) -> tuple[bool | None, str]:
    met = requirement in meets(lateral.label, LATERAL)
    exchanged = "swaps" in meets(lateral.label, LATERAL)  # to either side
    is_open = LATERAL[lateral.label].otherwise == "cannot say" or (exchanged and requirement == "turns_clear")
    return True if met else None if is_open else False, f"{lateral.label}: {lateral.because}"


def _not_depth(verdict: Verdict, statistics: Mapping[str, Statistic], because: str) -> tuple[bool | None, str]:
    """Return the outcome of a label below depth for a gate that requires depth."""
    label = LABELS[verdict.calibrated.label]
    if verdict.holes:
        return False, because
    if label.otherwise == "cannot say" or verdict.evidence == "none":
        settle = "" if verdict.why_not is None else f"; {verdict.why_not.settled_by}"
        return None, f"{because} (evidence on distance: {verdict.evidence}){settle}"
    if "depth" in meets(verdict.calibrated.label, LABELS):
        settles = verdict.why_not is not None and verdict.why_not.settle != NOTHING
        is_open = "swaps" in meets(verdict.lateral.label, LATERAL) and settles
        is_open = is_open or LATERAL[verdict.lateral.label].otherwise == "cannot say"
        said = because if verdict.why_not is None else f"{because}; {verdict.why_not}"
        return (
            (None, f"{verdict.lateral.label}: {verdict.lateral.because}; {verdict.why_not}")
            if is_open
            else (False, said)
        )
    if label.otherwise == "fails if bounded":
        shown, words = _refuted(statistics)
        return False if shown else None, f"{because}{words}"
    return False, because


def _refuted(statistics: Mapping[str, Statistic]) -> tuple[bool, str]:
    """Return whether its braking provably ignores distance, and words for the reason."""
    if is_refuted(statistics):
        return True, ""
    near_far = statistics["depth_interventional"]
    if isinstance(near_far, SignTest) and (pairs := near_far.wins + near_far.losses + near_far.ties):
        most = clopper_pearson(near_far.wins, pairs, 1 - 2 * ALPHA)[1]
        if most < MARGIN:
            return True, f"; it brakes harder for the near lead in {near_far.wins} of {pairs} pairs, at most {most:.3f}"
    return False, f"; but it is not shown that its braking ignores distance (no bound below {MARGIN})"


def _ordered(statistics: Mapping[str, Statistic], most: float) -> tuple[bool | None, str]:
    """Return whether the share of comparisons in the wrong order is below the bound, and why."""
    order = statistics["order"]
    if order.ci is None or order.value is None:
        why = order.note if is_drawn(statistics) else "the pictures along the range were not asked"
        return None, f"the share of comparisons in the wrong order is not bounded: {why}"
    low, high = order.ci
    because = f"comparisons in the wrong order {order.value:.3f} [{low:.3f}, {high:.3f}], has to be below {most:g}"
    if places := holes(statistics):
        because += f"; not counted is where its braking hardly answers: {named(places)}"
    return True if high < most else False if low > most else None, because


def _unparsed(one: Evidence, most: float, reason: str) -> Check:
    rate = one.statistics["unparsed_rate"]
    if one.stopped is not None:
        reason = f"{one.stopped.words()}, and the rate is over the calls of a whole run"
    if reason or rate.value is None:
        return Check(one.model, UNPARSED, None, reason or rate.note)
    because = f"unparsed rate {rate.value:.3f}, at most {most} (n = {rate.n})"
    return Check(one.model, UNPARSED, rate.value <= most, because)
