"""A gate holds a run to what is required of it: yes, no, or "cannot say"; it never passes for want of evidence."""

import xml.etree.ElementTree as ET
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

from eyechart.errors import SpecError
from eyechart.stats.paired import clopper_pearson
from eyechart.stats.statistic import Statistic
from eyechart.studies.battery import ALPHA, MARGIN, BatteryScore, ModelScore
from eyechart.studies.structured import CLAUSES, EstimatorScore, StructuredScore
from eyechart.studies.structured.admission import Held
from eyechart.verdicts import Verdict, judge

REQUIREMENTS: dict[str, str] = {
    "depth": "the calibrated verdict is depth or depth_lateral",
    "depth_lateral": "the calibrated verdict is depth_lateral",
    "swaps": "the lateral label is swaps",
}
UNPARSED = "max_unparsed"
ADMISSION: dict[str, str] = {
    "admission": "every clause of admission",
    **{name: one.says for name, one in CLAUSES.items()},
}
"""What may be required of a run of scene estimates, which is asked for nothing of the above."""


@dataclass(frozen=True, slots=True)
class Check:
    """One requirement on one model: ``holds`` is True, False, or None where the run cannot say, with the reason."""

    model: str
    requirement: str
    holds: bool | None
    because: str


@dataclass(frozen=True, slots=True)
class Gate:
    """Every check of a gate. ``exit_code`` is 0 where all hold, 1 where one fails, else 2."""

    checks: tuple[Check, ...]

    @property
    def exit_code(self) -> int:
        """Return 0 for holds, 1 for fails, 2 for cannot say; nothing checked is "cannot say"."""
        outcomes = [check.holds for check in self.checks]
        if False in outcomes:
            return 1
        return 0 if outcomes and None not in outcomes else 2

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        words = {True: "holds", False: "fails", None: "cannot say"}
        checks = [
            {
                "model": one.model,
                "requirement": one.requirement,
                "holds": one.holds,
                "outcome": words[one.holds],
                "because": one.because,
            }
            for one in self.checks
        ]
        return {"exit_code": self.exit_code, "checks": checks}

    def junit(self) -> bytes:
        """Return the checks as JUnit XML: a failure where one fails, an error where the run cannot say."""
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
    """Return text without the control characters that XML cannot hold."""
    return "".join(character for character in text if character.isprintable() or character in "\n\t")


def read_requirements(text: str, known: Collection[str] = tuple(REQUIREMENTS)) -> tuple[str, ...]:
    """Read ``depth,swaps``; raises SpecError that lists the ``known`` requirements of the kind of run."""
    wanted = tuple(dict.fromkeys(part.strip() for part in text.split(",") if part.strip()))
    unknown = [name for name in wanted if name not in known]
    if unknown or not wanted:
        raise SpecError(f"--require takes one or more of {', '.join(known)}, with commas; got '{text}'")
    return wanted


def hold_admission(
    score: StructuredScore, require: Sequence[str] = ("admission",), *, max_unparsed: float | None = None
) -> Gate:
    """Hold every model of a run of scene estimates to clauses of admission, a check a clause.

    ``admission`` stands for all of them. As with a battery, an unfinished run, one whose calls ended in errors, and
    what would hold where a guard failed cannot say. Raises SpecError for an unknown clause or a rate outside [0, 1].
    """
    wanted = read_requirements(",".join(require), tuple(ADMISSION))
    _require_rate(max_unparsed)
    names = tuple(name for name in CLAUSES if name in wanted or "admission" in wanted)
    checks: list[Check] = []
    for spec, one in score.models.items():
        reason, held = _no_estimates(one), {clause.name: clause for clause in one.clauses}
        mine = []
        for name in names:
            passes = None if reason else held[name].passes
            mine.append(Check(spec, name, passes, reason or _held_words(held[name])))
        if max_unparsed is not None:
            parse = one.statistics["parse"]
            without = None if parse.value is None else 1 - parse.value
            words = parse.note if without is None else f"without an estimate {without:.3f}, at most {max_unparsed}"
            holds = None if reason or without is None else without <= max_unparsed
            mine.append(Check(spec, UNPARSED, holds, reason or words))
        failed = [guard for guard in score.guards[spec] if guard.holds is False]
        checks += [
            _marked(check, [f"guard '{guard.name}' fails: {guard.because}" for guard in failed]) for check in mine
        ]
    return Gate(tuple(checks))


def _held_words(found: Held) -> str:
    one, least = found.statistic, found.clause.least
    if one.value is None:
        return one.note
    return f"{one.value:.{3 if least < 1 else 0}f}, at least {least:g} (n = {one.n})"


def _no_estimates(one: EstimatorScore) -> str:
    """Return why a model's calls are no evidence of what it estimates, or nothing."""
    if one.planned == 0 or one.answered == 0:
        return "the run holds no finished call of this model"
    if one.answered < one.planned:
        return f"the run is unfinished: {one.answered} of {one.planned} calls"
    errors = one.told.reasons.get("error", 0)
    if errors:
        return f"{errors} of {one.answered} calls ended in an error (see the ledger), so they say nothing of the model"
    return ""


def _require_rate(max_unparsed: float | None) -> None:
    if max_unparsed is not None and not 0 <= max_unparsed <= 1:
        raise SpecError(f"--max-unparsed takes a rate between 0 and 1, got {max_unparsed}")


def hold(score: BatteryScore, require: Sequence[str], *, max_unparsed: float | None = None) -> Gate:
    """Hold every model of a scored battery to the requirements, and to an unparsed rate over all calls.

    A run without calls, one with calls still to make, and a model whose calls failed cannot say; nor does what would
    hold where a guard of the run failed. Raises SpecError
    for an unknown requirement or a rate outside [0, 1].
    """
    wanted = read_requirements(",".join(require))
    _require_rate(max_unparsed)
    verdicts = judge(score)
    checks: list[Check] = []
    for spec, model in score.models.items():
        reason, mine = _no_evidence(model), []
        for requirement in wanted:
            holds, because = (
                (None, reason)
                if reason
                else _claim(requirement, verdicts[spec], model.statistics["depth_interventional"])
            )
            mine.append(Check(spec, requirement, holds, because))
        if max_unparsed is not None:
            mine.append(_unparsed(spec, model, max_unparsed, reason))
        checks += [_marked(check, verdicts[spec].marks) for check in mine]
    return Gate(tuple(checks))


def _marked(check: Check, marks: Sequence[str]) -> Check:
    """Return a check with the guards that failed: what holds by a run that is not to be believed cannot be said."""
    if not marks:
        return check
    return replace(check, holds=None if check.holds else check.holds, because="; ".join((check.because, *marks)))


def _no_evidence(model: ModelScore) -> str:
    """Return why a model's calls are no evidence at all, or nothing."""
    if model.planned == 0 or model.answered == 0:
        return "the run holds no finished call of this model"
    if model.answered < model.planned and model.stopped is None:
        return f"the run is unfinished: {model.answered} of {model.planned} calls"
    errors = _reasons(model).get("error", 0)
    if errors:
        return (
            f"{errors} of {model.answered} calls ended in an error (see the ledger), so they say nothing of the model"
        )
    return ""


def _reasons(model: ModelScore) -> Mapping[str, int]:
    found: dict[str, int] = {}
    for column in model.answers.decisions.values():
        for one in column:
            if one is not None and one.missing is not None:
                found[one.missing] = found.get(one.missing, 0) + 1
    return found


def _claim(requirement: str, verdict: Verdict, interventional: Statistic) -> tuple[bool | None, str]:
    if requirement == "swaps":
        lateral = verdict.lateral
        holds = None if lateral.label in {"no_power", "not_tested"} else lateral.label == "swaps"
        return holds, f"{lateral.label}: {lateral.because}"
    label, because = verdict.calibrated.label, f"{verdict.calibrated.label}: {verdict.calibrated.because}"
    if label in ({"depth", "depth_lateral"} if requirement == "depth" else {"depth_lateral"}):
        return True, because
    if label == "undecided" or verdict.evidence == "none":
        return None, f"{because} (evidence on distance: {verdict.evidence})"
    if label == "depth" and verdict.lateral.label in {"no_power", "not_tested"}:
        return None, f"{verdict.lateral.label}: {verdict.lateral.because}"
    if label in {"content", "scene_cue"} and not _bounded(interventional):
        return (
            None,
            f"{because}; that its braking does not follow distance is not shown either (no bound below {MARGIN})",
        )
    return False, because


def _bounded(interventional: Statistic) -> bool:
    """Return whether the share of pairs in which it brakes harder near than far is bounded below the margin."""
    detail = interventional.detail or {}
    wins, losses, ties = (int(str(detail.get(name, 0))) for name in ("wins", "losses", "ties"))
    pairs = wins + losses + ties
    return pairs > 0 and clopper_pearson(wins, pairs, 1 - 2 * ALPHA)[1] < MARGIN


def _unparsed(spec: str, model: ModelScore, most: float, reason: str) -> Check:
    rate = model.statistics["unparsed_rate"]
    if model.stopped is not None:
        words = f"{model.stopped.words()}, and the rate is over the calls of a whole run"
        return Check(spec, UNPARSED, None, reason or words)
    if reason or rate.value is None:
        return Check(spec, UNPARSED, None, reason or rate.note)
    return Check(spec, UNPARSED, rate.value <= most, f"unparsed rate {rate.value:.3f}, at most {most} (n = {rate.n})")
