"""The first part of an online run's page: the admitted estimators, and the crashes."""

from collections.abc import Collection, Iterator, Mapping

from eyechart.gate import UNPARSED, hold_online
from eyechart.report.charts import BLUE, HEAD, INK, Drawing, dots, style
from eyechart.report.page import MOST_SAID, PageSummary, Section, VerdictSummary, parted
from eyechart.report.table import estimate
from eyechart.studies.closed_loop.page import StudyIntroduction
from eyechart.studies.structured.online import CONTROL, OnlineScore
from eyechart.studies.structured.tables import clauses_words, met_table, online_table

_ANSWERS = {"sees": ("admitted",), "blind": ("not admitted",), "open": ("cannot say", "for")}
_INTRO = (
    "An estimator may steer only if it meets every clause on the frames of its own drives. Each of these frames "
    "must also pass the checks of the renderer and of the positive control. Crashes measure caution too: a model that "
    "brakes at everything seldom crashes."
)


def first_of(scores: Mapping[str, OnlineScore]) -> StudyIntroduction:
    """Return the question, the answer and the evidence of online runs, by name."""
    named = {f"{name} · " if len(scores) > 1 else "": score for name, score in scores.items()}
    said = [one for of, score in named.items() for one in _said(of, score)]
    answer = PageSummary(
        parted(said, _ANSWERS, "estimators that drove"),
        said,
        figure=_crashes(named, frozenset(one.who for one in said if one.tone == "sees")),
        caption="Filled: admitted, and the control. Few crashes are no proof of sight.",
    )
    tables = [table(score) for score in scores.values() for table in (online_table, met_table)]
    lines = [line for of, score in named.items() for line in _lines(of, score)]
    return StudyIntroduction(
        "Do these models measure the scene that they drive in?",
        answer,
        Section("Admission", _INTRO, tables=tables, lines=lines),
    )


def _said(of: str, score: OnlineScore) -> Iterator[VerdictSummary]:
    """Yield whether each estimator is admitted, and the clauses that it does not meet."""
    gate = hold_online(score)
    for spec in score.manifest.models:
        mine = [check for check in gate.checks if check.model == spec and check.requirement != UNPARSED]
        held = [check.holds for check in mine]
        tone = "sees" if held and all(held) else "blind" if False in held else "open"
        why = clauses_words((check.requirement, check.holds, check.because) for check in mine)
        yield VerdictSummary(f"{of}{spec}", _ANSWERS[tone][0], tone, why, place="first")


def _crashes(named: Mapping[str, OnlineScore], admitted: Collection[str]) -> Drawing:
    """Draw each estimator's crash rate, the positive control first."""
    rows = [
        (who := f"{of}{spec}", one.crash_rate, INK if spec == CONTROL else BLUE, not {spec, who} & {CONTROL, *admitted})
        for of, score in named.items()
        for spec, one in score.driven.items()
    ][: MOST_SAID + 1]
    with style():
        figure = dots(rows, "crashed, share of episodes", 1.0, across=HEAD)
    told = "; ".join(f"{who}: {estimate(one)}, n {one.n}" for who, one, *_ in rows)
    return Drawing("in-short", "Crashes beside the positive control's", f"Filled: admitted. {told}", figure)


def _lines(of: str, score: OnlineScore) -> Iterator[str]:
    """Yield the checks of each estimator's frames, and the refused worlds."""
    yield from (f"{of}{spec}: {score.frames(spec)[1]}." for spec in score.manifest.models)
    yield from (
        f"{of}refused: {check.scenario}/{check.seed}: {check.why}" for check in score.vetted if check.why is not None
    )
