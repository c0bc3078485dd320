"""The page of policies: verdict and reason, shares and two moments of each, then all numbers."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from eyechart.frames import FrameBank
from eyechart.report.accounts import costs_table
from eyechart.report.charts import Drawing
from eyechart.report.page import PageSummary, Section, VerdictSummary, page_of
from eyechart.report.table import Table
from eyechart.studies import StudyReport
from eyechart.studies.policy.advice import ASK_ROAD, CHANNEL_OF, named, settling
from eyechart.studies.policy.figures import moments, shares, training
from eyechart.studies.policy.scores import PolicyScore, judge
from eyechart.studies.policy.tables import (
    channel_table,
    meaning_table,
    parts_table,
    statistics_table,
    steps_table,
    verdict_table,
)
from eyechart.studies.policy.training_curve import training_of
from eyechart.verdicts.labels import CAMERA, GUARDS, INSTRUCTION, STATE, USES
from eyechart.verdicts.policy_rules import AxisVerdict
from eyechart.verdicts.policy_verdict import MISFIT, PolicyVerdict

ScoredBank = tuple[PolicyScore, FrameBank | None]
"""A scored run, and its bank if the pictures are available."""


def made(runs: Sequence[ScoredBank], notes: Sequence[str] = (), steps: Mapping[str, int] | None = None) -> StudyReport:
    """Return the report of runs of policies, with the course of a training if there is one."""
    course = training_of([score for score, _ in runs], steps or {})
    first = _opening(runs)
    shown = "" if first.figure is None else first.figure.title
    sections = [section for run in runs for section in _sections(*run, shown, alone=len(runs) == 1)]
    tables = [table for score, _ in runs for table in _tables(score)]
    if course is not None:
        shares, changes = course.tables()
        intro = "Checkpoints of one training, in the order of their steps: when did it stop looking, or listening?"
        summary = Section(
            "Over the training",
            intro,
            [training(course)] if course.channels else [],
            [shares, changes],
            list(course.says()),
        )
        sections, tables = [summary, *sections], [shares, changes, *tables]
    title = ", ".join(dict.fromkeys(score.bank.name for score, _ in runs))
    page = page_of("Does it look, and does it listen?", title, sections, notes, first)
    return StudyReport(page, tables, page.notes)


def _opening(runs: Sequence[ScoredBank]) -> PageSummary:
    """Return the opening: the answer for each policy, its next step, and one figure."""
    judged = [(spec, one, score) for score, _ in runs for spec, one in judge(score).items()]
    said = [
        VerdictSummary(
            spec,
            "no verdict" if one.guards else f"{one.camera.label}; {one.instruction.label}".replace("_", " "),
            _tone(one),
            f"{_answer(one)} Next: {_next(one, score)[0]}",
            "" if one.guards or not one.camera.why_not else f"{one.camera.why_not}.",
        )
        for spec, one, score in judged
    ]
    alone = judged and f"{_answer(judged[0][1])}"
    several = in_a_sentence([(spec, _does(one)) for spec, one, _ in judged])
    sentence = several if len(said) > 1 else alone or "The run names no policy."
    drawn = [] if not judged else _of_first(*judged[0], runs)
    return PageSummary(sentence, said, figure=replace(drawn[0], name="in-short") if drawn else None)


def _of_first(spec: str, verdict: PolicyVerdict, score: PolicyScore, runs: Sequence[ScoredBank]) -> list[Drawing]:
    """Return the figures of the first policy on the page."""
    pictures = next(pictures for other, pictures in runs if other is score)
    return [*moments(spec, score.models[spec], pictures), *_shares(score, verdict)]


_LOOK = {
    "Yes": ("looks", "look"),
    "unfit": ("looks but does something else than was logged", "look but do something else than was logged"),
    "deaf": ("looks but does not listen", "look but do not listen"),
    "In part": ("looks in part", "look in part"),
    "No": ("does not look", "do not look"),
    "Inconclusive": ("is undecided", "are undecided"),
    "none": ("gets no verdict", "get no verdict"),
}
"""The verb phrase for one policy, and for several, by `_does`."""
_MOST_NAMED = 4


def _does(verdict: PolicyVerdict) -> str:
    """Return the key of `_LOOK` for a policy."""
    looks = "none" if verdict.guards else verdict.answer
    if looks != "Yes":
        return looks
    if INSTRUCTION[verdict.instruction.label].is_absence:  # that also explains a misfit
        return "deaf"
    return "unfit" if is_unfit(verdict) else looks


def in_a_sentence(found: Sequence[tuple[str, str]]) -> str:
    """Return how many policies have each answer, in their order, with names if there are few."""
    by_answer: dict[str, list[str]] = {}
    for spec, does in found:
        by_answer.setdefault(does, []).append(spec)
    parts = [
        f"{len(specs)} {_LOOK[does][len(specs) > 1]}" + (f" ({', '.join(specs)})" if len(found) <= _MOST_NAMED else "")
        for does, specs in by_answer.items()
    ]
    return f"Of {len(found)} policies, {' and '.join(filter(None, (', '.join(parts[:-1]), parts[-1])))}."


def _tone(verdict: PolicyVerdict) -> str:
    """Return the severity: by the cameras, "partly" at best for a deaf or unfit policy."""
    return "partly" if _does(verdict) in {"deaf", "unfit"} else CAMERA[verdict.camera.label].family


def _tables(score: PolicyScore) -> list[Table]:
    """Return the tables that are written next to the page."""
    verdicts = judge(score)
    costs = costs_table(score.accounting, every=True)
    parts = [parts_table(score), steps_table(score)]
    return [verdict_table(verdicts), channel_table(verdicts), statistics_table(score), *parts, costs]


def _sections(score: PolicyScore, pictures: FrameBank | None, shown: str, *, alone: bool) -> Iterator[Section]:
    """Yield a section a policy, then the tables; the figure titled ``shown`` is already above."""
    verdicts, of = judge(score), "" if alone else f", {score.bank.name}"
    for spec, verdict in verdicts.items():
        others = [drawn for drawn in moments(spec, score.models[spec], pictures) if drawn.title != shown]
        drawings = [*_shares(score, verdict), *others]
        yield Section(spec, f"{_labels_of(verdict)} {_answer(verdict)}", drawings, lines=list(_why(verdict, score)))
    intro = "The share of a policy's own variation that goes with each channel, and the verdicts."
    yield Section(f"Side by side{of}", intro, tables=[verdict_table(verdicts), channel_table(verdicts)])
    every = [meaning_table(score), *statistics_table(score).split(), parts_table(score), steps_table(score)]
    yield Section(f"Every statistic{of}", _EVERY, tables=every, folded=True)
    yield Section(f"What the calls took{of}", tables=[costs_table(score.accounting, every=False).known()])


_EVERY = (
    "Every number of every policy, with its interval, n and p. — means that the data cannot say; the note says why. "
    "The first table defines each statistic; 'What is measured' in docs/policy-reference.md says how it is computed."
)


def _shares(score: PolicyScore, verdict: PolicyVerdict) -> Iterator[Drawing]:
    """Draw the shares of a policy; nothing if a guard failed, since then it has no verdict."""
    if not verdict.guards:
        yield from shares(verdict, score.models[verdict.model])


def _labels_of(verdict: PolicyVerdict) -> str:
    """Return a policy's labels in a line."""
    if verdict.guards:
        return "No verdict."
    single = ", ".join(f"{name} {judged.label}" for name, judged in verdict.cameras.items())
    cameras = f"{verdict.camera.label} ({single})" if single else verdict.camera.label
    return f"{cameras}; {verdict.state.label}; {verdict.instruction.label}."


def _answer(verdict: PolicyVerdict) -> str:
    """Return a policy's verdict in a few sentences."""
    if verdict.guards:
        return " ".join(f"{name}: {GUARDS[name].says}." for name in verdict.guards) + " It gets no other verdict."
    said = (CAMERA[verdict.camera.label], STATE[verdict.state.label], INSTRUCTION[verdict.instruction.label])
    unfit = [f"Its error is {verdict.misfit:.1f} times the log's variance: {_UNFIT}."] if is_unfit(verdict) else []
    return " ".join([*unfit, *(label.says for label in said)])


_UNFIT = "it does something else than was logged"


def is_unfit(verdict: PolicyVerdict) -> bool:
    """Return whether a policy does something else than was logged, whatever it uses."""
    return verdict.misfit is not None and verdict.misfit >= MISFIT


def _why(verdict: PolicyVerdict, score: PolicyScore) -> Iterator[str]:
    """Yield next steps, the reason for each label, and what prevents a stronger claim."""
    yield from (f"Next: {advice}" for advice in _next(verdict, score))
    yield from (f"{name}: {why}." for name, why in verdict.guards.items())
    axes = {"cameras": verdict.camera, **{f"{name} camera": judged for name, judged in verdict.cameras.items()}}
    axes |= {"state": verdict.state, "instruction": verdict.instruction}
    open_by: dict[str, list[str]] = {}
    for name, judged in axes.items() if not verdict.guards else ():
        yield f"{name}: {judged.label}. {judged.because}"
        if judged.why_not:
            open_by.setdefault(judged.why_not, []).append(name)
    yield from (f"Not more of {', '.join(names)}, because {why}." for why, names in open_by.items())
    yield from (f"{remark}." for remark in verdict.remarks)
    yield f"Scope: {verdict.scope}"


def _next(verdict: PolicyVerdict, score: PolicyScore) -> list[str]:
    """Return next steps for the policy's training, the most urgent first."""
    axes = (
        {} if verdict.guards else {"camera": verdict.camera, "state": verdict.state, "instruction": verdict.instruction}
    )
    found = [GUARDS[name].advice for name in verdict.guards]
    found += filter(None, (_of_label(name, each, score) for name, each in axes.items()))
    still_open = [name for name, each in axes.items() if USES[each.label].may_be_more]
    found += dict.fromkeys(str(settling(score, verdict.model, CHANNEL_OF[name])) for name in still_open)
    spare = [
        name for name, judged in verdict.cameras.items() if judged.label == "ignores_camera" != verdict.camera.label
    ]
    if len(spare) == 1 and not verdict.guards:
        found.append(f"leave out the {spare[0]} camera, or find out why it is ignored: crop, dark picture, wrong key.")
    elif spare and not verdict.guards:
        found.append(f"leave out one of the cameras {', '.join(spare)}, and no more: they may show the same.")
    for name, judged in verdict.cameras.items() if not verdict.guards else ():
        if USES[judged.label].may_be_more and judged.label != verdict.camera.label:
            used = USES[judged.label].rank
            use = (
                f"what it uses the {name} camera for is open" if used else f"the use of the {name} camera is undecided"
            )
            found.append(f"{use}: {settling(score, verdict.model, f'camera:{name}')}")
    return found or [named(UNFIT, score) if is_unfit(verdict) else FINE]


def _of_label(axis: str, verdict: AxisVerdict, score: PolicyScore) -> str:
    """Return a label's advice, or to check the connection if a channel may have none."""
    label = USES[verdict.label]
    unconnected = verdict.may_be_unconnected and label.is_absence
    return named(str(ASK_ROAD) if unconnected else label.advice, score, CHANNEL_OF[axis])


FINE = (
    "no fault was found. Check the next checkpoint with 'eyechart gate RUN --require camera:camera_content', and "
    "test it in closed loop, which no run of frames replaces."
)
UNFIT = (
    "it uses its inputs but does something else than was logged. Before you drive it, compare its actions with the "
    "logged ones, and let 'eyechart doctor SPEC --frames {bank}' try other forms of its pictures."
)
