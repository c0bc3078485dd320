"""Tables of a battery: verdicts, Table t:frontier of the paper, and every statistic."""

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from eyechart.conditions import BATTERY, find_condition
from eyechart.corruptions import STEPS
from eyechart.errors import counted
from eyechart.report.table import (
    MARK,
    STATISTIC,
    Cell,
    Column,
    Mark,
    Table,
    columns,
    in_words,
    marked,
    number,
    of_each,
    p_value,
    statistic_cells,
)
from eyechart.studies.battery import BatteryScore, ModelScore
from eyechart.studies.battery.answers import Answers
from eyechart.studies.battery.paper_statistics import median_gaps
from eyechart.studies.battery.series import StepEffect, results
from eyechart.studies.battery.subjects import Subject
from eyechart.verdicts import LABELS, NOT_JUDGED, Verdict
from eyechart.verdicts.numbers import ASKS, FIRST, SIGNS

JudgedModel = tuple[str, ModelScore, Verdict]
"""A model's label, its score and its verdict."""


def judged_of(everyone: Sequence[Subject]) -> list[JudgedModel]:
    """Return the models of a report's evidence, judged."""
    return [(who.label, who.model, who.verdict) for who in everyone]


def judged(score: BatteryScore, verdicts: Mapping[str, Verdict]) -> list[JudgedModel]:
    """Return the models of one run, judged."""
    return [(spec, score.models[spec], verdict) for spec, verdict in verdicts.items()]


def tables_of(everyone: Sequence[JudgedModel]) -> tuple[Table, ...]:
    """Return every table of judged models."""
    along, series = depth_table(everyone), series_table(everyone)
    return (
        verdict_table(everyone),
        *([along] if along.rows else ()),
        *([series] if series.rows else ()),
        frontier_table(everyone),
        statistics_table(everyone),
    )


def glance_table(everyone: Sequence[JudgedModel]) -> Table:
    """Return one row per model: both verdicts, the lateral label, and the deciding statistic."""
    state = any(verdict.state for _, _, verdict in everyone)
    named = columns("word", "verdict", "lateral", "paper's rules", "decided by")
    rows: list[tuple[Cell, ...]] = []
    for label, model, verdict in everyone:
        name = verdict.calibrated.decided_by
        one = model.statistics[name]
        if (early := verdict.stopped) is not None:
            by = f"{name.partition('.')[2]}, e {number(one.value, 0)} ({early.calls}/{early.planned})"
        else:
            by = f"{name}, p {p_value(one.p)}" if one.p is not None else f"{name} {number(one.value, 2)}"
        words = (_label(verdict), verdict.lateral.label, verdict.paper.label, by)
        rows.append((label, *words, *([verdict.state] if state else [])))
    unfinished = [Column("unfinished")] if state else []
    return Table("glance", "", (Column("model"), *named, *unfinished), tuple(rows))


def _label(verdict: Verdict) -> Mark:
    label = verdict.calibrated.label
    return Mark(label, LABELS[label].family, MARK if verdict.failed else "")


def verdict_table(everyone: Sequence[JudgedModel]) -> Table:
    """Return one row per model: labels, evidence, and the deciding statistic."""
    named = columns("text", "model", "answer", "verdict", "lateral", "evidence", "paper's verdict", "decided by")
    rows = []
    for label, model, verdict in everyone:
        ruling = verdict.calibrated
        labels = (ruling.label, verdict.lateral.label, verdict.evidence, verdict.paper.label)
        words = (label, verdict.answer, *labels, ruling.decided_by)
        marks = "; ".join(guard.name for guard in verdict.failed)
        rows.append((*words, *statistic_cells(model.statistics[ruling.decided_by]), verdict.state, marks))
    made = (*named, *STATISTIC, *columns("text", "unfinished", "failed guards"))
    return Table("verdicts", "Verdicts and the statistic that decided each", made, tuple(rows))


TONES: Mapping[str, str] = {"holds": "good", "fails": "bad"}
"""The tone of an outcome; a page shows the other outcomes by their sign alone."""


def depth_table(everyone: Sequence[JudgedModel]) -> Table:
    """Return a row per number that depth rests on, for models with pictures along the range."""
    rows = tuple(
        (
            *(label, one.name, Mark(one.outcome, TONES.get(one.outcome, "open"), SIGNS[one.outcome])),
            *(*statistic_cells(one.statistic), one.threshold, one.asks),
        )
        for label, _, verdict in everyone
        for one in verdict.numbers
    )
    named, texts = columns("word", "model", "number", "outcome"), columns("text", "depth needs", "asks")
    return Table("depth", "What depth rests on; intervals are over whole episodes", (*named, *STATISTIC, *texts), rows)


def frontier_rows(score: ModelScore) -> dict[str, str]:
    """Return one column of Table t:frontier: the paper's rows, as it prints them."""
    statistics = score.statistics
    swap, clears = statistics["mirror_swap_rate"], statistics["clears_floor"].value
    return {
        "unparsed rate": number(statistics["unparsed_rate"].value),
        "noise floor s": number(statistics["noise_floor"].value),
        "agree(blank)": number(statistics["agree.blank"].value),
        "agree(noise)": number(statistics["agree.noise"].value),
        "agree(text_only)": number(statistics["agree.text_only"].value),
        "agree(shuffled)": number(statistics["agree.shuffled"].value),
        "agree(cross_scenario)": number(statistics["agree.cross_scenario"].value),
        "Cramér's V": number(statistics["cramers_v"].value),
        "V (real, blank)": number(statistics["cramers_v_real_blank"].value),
        "IDI_adj": number(statistics["idi_adj"].value),
        "clears noise floor": "—" if clears is None else "yes" if clears else "no",
        "n_dir": str(swap.n),
        "mirror swap rate": number(swap.value),
        "I(A;g) (bits)": number(statistics["mutual_information.decision"].value),
        "p (permutation)": p_value(statistics["mutual_information.decision"].p),
        "p (action vs. obstacle)": p_value(statistics["obstacle.decision"].p),
    }


def frontier_table(everyone: Sequence[JudgedModel]) -> Table:
    """Return the paper's Table t:frontier: one column per model, with both verdicts below."""
    made = [frontier_rows(model) for _, model, _ in everyone]
    rows: list[tuple[Cell, ...]] = [(name, *(one[name] for one in made)) for name in (made[0] if made else ())]
    ended = [model.stopped for _, model, _ in everyone]
    if any(ended):
        endings = (None if one is None else f"{one.calls} of {one.planned} calls" for one in ended)
        rows.append(("stopped early", *endings))
    verdicts = [verdict for _, _, verdict in everyone]
    if any(verdict.state for verdict in verdicts):
        rows.append(("unfinished", *(verdict.progress or None for verdict in verdicts)))
    rows.append(
        ("verdict (paper)", *(Mark(verdict.paper.label, "", MARK if verdict.failed else "") for verdict in verdicts))
    )
    rows.append(("verdict (calibrated)", *map(_label, verdicts)))
    named = (Column("metric", "word"), *columns("word", *(label for label, _, _ in everyone)))
    return Table("frontier", "The battery, as the paper prints it", named, tuple(rows))


def series_table(everyone: Sequence[JudgedModel]) -> Table:
    """Return a row per model and series: how far it sees, and the effect there and a step further."""
    rows = tuple(
        (
            *(label, one.words, one.reached),
            *(cell for at in (one.shown, one.lost) for cell in _effect(at)),
        )
        for label, model, _ in everyone
        for one in results(model.statistics)
    )
    named = columns("word", "model", "series", "step")
    shown = columns("text", "effect there", "cannot see there", "a step further", "cannot see further")
    caption = f"How far down a corruption of the camera its effect holds, of {len(STEPS)} steps; intervals of 98%"
    return Table("series", caption, (*named, *shown), rows)


def _effect(at: StepEffect | None) -> tuple[str | None, str | None]:
    if at is None or at.value is None:
        return None, None
    ends = "" if at.ci is None else f" [{at.ci[0]:.2f}, {at.ci[1]:.2f}]"
    said = f"{at.unseeing} of {counted(at.replies, 'reply')}" if at.replies else None
    return f"{at.value:.2f}{ends} on {at.n}", said


UNPRINTED = ("agree(shuffled)", "V (real, blank)")
"""Rows that the paper's Table t:frontier leaves out."""


def paper_tables(everyone: Sequence[Subject]) -> Iterator[Table]:
    """Yield Tables t:conditions, t:frontier and t:qwenorder of the paper, of the models given."""
    conditions = dict.fromkeys(name for who in everyone for name in who.run.conditions)
    shown = tuple((name, (row := find_condition(name)).image, row.asks) for name in conditions)
    yield Table("", "", (Column("condition", "word"), *columns("text", "image", "tests")), shown).labelled(
        "t:conditions", "Blind-input conditions; only the image changes"
    )
    frontier = frontier_table(judged_of(everyone))
    rows = tuple(row for row in frontier.rows if row[0] not in UNPRINTED)
    counts, words = _counts(everyone)
    caption = f"The battery, {words}. s is the rate of disagreement with itself on the identical image"
    yield replace(frontier, rows=(*counts, *rows)).labelled("t:frontier", caption)
    yield numbers_table(everyone)
    if (order := order_table(everyone)).rows:
        yield order


def _counts(everyone: Sequence[Subject]) -> tuple[list[tuple[Cell, ...]], str]:
    """Return each model's number of frames and of the paper's conditions, as rows and in words.

    A row stands in the table only where models differ in it.
    """
    conditions = [[name for name in BATTERY if name in who.run.conditions] for who in everyone]
    found = {
        "frames": [len(who.model.answers.frames) for who in everyone],
        "conditions": [len(names) for names in conditions],
    }
    rows: list[tuple[Cell, ...]] = [(name, *map(str, counts)) for name, counts in found.items() if len(set(counts)) > 1]
    return (
        rows,
        f"{of_each(found['frames'])} frames × {of_each(found['conditions'])} of the paper's conditions per model",
    )


def numbers_table(everyone: Sequence[Subject]) -> Table:
    """Return the unrounded numbers of Table t:frontier, a row each, with interval, n, p, method."""
    every = statistics_table(judged_of(everyone))
    place = every.names.index("statistic")
    rows = tuple(row for row in every.rows if row[place] in PRINTED)
    return replace(every, name="frontier-numbers", caption="Every number of Table t:frontier", rows=rows)


PRINTED = (
    *("unparsed_rate", "noise_floor", "agree.blank", "agree.noise", "agree.text_only", "agree.cross_scenario"),
    *("cramers_v", "idi_adj", "clears_floor", "mirror_swap_rate", "mutual_information.decision", "obstacle.decision"),
)
"""The statistics of that table."""


def order_table(everyone: Sequence[Subject]) -> Table:
    """Return Table t:qwenorder: each action's frames, median gap, and answers under reflection.

    A frame without a lead counts as the farthest gap. Actions stand by frequency. The interval of a
    median resamples episodes.
    """
    rows: list[tuple[Cell, ...]] = []
    for who in everyone:
        answers, medians = who.model.answers, median_gaps(who.model.answers)
        real, mirrored, _ = answers.both("real", "mirrored", "response")
        turned = {name: Counter(mirrored[real == name].tolist()) for name in answers.reflections}
        counts = Counter(answers.actions("real").tolist())
        for action in sorted(medians, key=lambda name: -counts[name]):
            to = ", ".join(f"{name} {count}" for name, count in turned.get(action, Counter()).most_common())
            rows.append((who.label, action, counts[action], medians[action], to or None))
    unit = next((who.model.answers.gap.unit for who in everyone if who.model.answers.gap is not None), "m")
    named = (
        *(Column("model"), Column("action", "word"), Column("n", "count")),
        *(Column(f"med. gap ({unit})", "estimate", 1, beside=""), Column("under reflection")),
    )
    frames = of_each(len(who.model.answers.frames) for who in everyone)
    caption = f"Emitted action against the true gap, {frames} real frames per model, and under reflection"
    return Table("", "", named, tuple(rows)).labelled("t:qwenorder", caption)


def decisions_table(score: BatteryScore) -> Table:
    """Return every decision that counts, a row per reply; docs/clean_room.py recomputes from it.

    A gap is infinite without a lead, and empty where the bank does not record it.
    """
    rows = tuple(
        (
            *(spec, frame.id, frame.scenario, frame.episode, condition),
            *(None if decision.action is None else space.symbol(decision.action), decision.missing, gap),
        )
        for spec, model in score.models.items()
        for space in (model.answers.space,)
        for condition, decisions in model.answers.decisions.items()
        for frame, decision, gap in zip(model.answers.frames, decisions, _gaps(model.answers), strict=True)
        if decision is not None
    )
    named = columns("word", "model", "frame", "scenario", "episode", "condition", "decision", "missing")
    return Table("decisions", "Every decision", (*named, Column("gap", "number")), rows)


def _gaps(answers: Answers) -> Sequence[float | None]:
    return [None] * len(answers.frames) if answers.gaps is None else answers.gaps.tolist()


def statistics_table(everyone: Sequence[JudgedModel]) -> Table:
    """Return every statistic of every model; Holm p is corrected over the models of a run."""
    rows = tuple(
        (
            label,
            name,
            *statistic_cells(statistic),
            model.holm.get(name),
            statistic.method,
            statistic.note,
            statistic.unit,
        )
        for label, model, _ in everyone
        for name, statistic in model.statistics.items()
    )
    named = (Column("model"), Column("statistic", "word"), *STATISTIC, Column("Holm p", "p"))
    caption = "Every statistic with its interval, n and p"
    return Table("statistics", caption, (*named, *columns("text", "method", "note", "unit")), rows)


GROUPS: Mapping[str, re.Pattern[str]] = {
    "how far down a corruption of the camera its effect holds": re.compile("series[.]"),
    "distance": re.compile("depth_|lane_net|holes|place_|sensitivity|specificity|order|rise|file|drawn_|repeat"),
    "left and right": re.compile("turns_|bound_mirrored"),
    "which content of the picture counts": re.compile(
        "content_|scene_cue|presence|bound_(?!kappa)|image_token$|refusal_effect"
    ),
    "whether it repeats itself, and its replies can be read": re.compile(
        "unparsed_(reference|controls)|self_|(bound_)?kappa"
    ),
    "settled early": re.compile("early[.]"),
    "as the paper has it, of all answers": re.compile("(?!.*[.]decision$)"),
    "as the paper has it, of parsed decisions": re.compile(""),
}
"""Every statistic by its subject: it stands in the first group whose pattern its name matches."""
MAIN: Mapping[str, str] = {
    **{name: ASKS[name] for name in FIRST},
    "depth_interventional": "whether it brakes harder for the near lead than for the far one",
    "content_shuffled": "whether another episode's picture changes its answer",
    "presence": "whether a blank picture changes its answer",
    "self_disagreement": "how often it answers the same picture differently",
    "unparsed_reference": "how many replies hold no decision",
}
"""Further statistics of the short table, with what each asks, in order of preference."""
_SHOWN = 5


def group_tables(everyone: Sequence[JudgedModel]) -> Iterator[Table]:
    """Yield every statistic, a table per model and group, without the methods."""
    every = statistics_table(everyone)
    kept = [place for place, column in enumerate(every.columns) if column.name != "method"]
    named = replace(every, columns=tuple(every.columns[place] for place in kept))
    for label, _, _ in everyone:
        grouped: dict[str, list[tuple[Cell, ...]]] = {title: [] for title in GROUPS}
        for row in every.rows:
            if row[0] == label:
                title = next(title for title, names in GROUPS.items() if names.match(str(row[1])))
                grouped[title].append(tuple(row[place] for place in kept[1:]))
        for title, rows in grouped.items():
            if rows:
                yield replace(named, caption=f"{label}: {title}", columns=named.columns[1:], rows=tuple(rows))


def deciding_table(label: str, model: ModelScore, verdict: Verdict) -> Table:
    """Return the five statistics that decided or would have: what each did, or asks."""
    why, ruling = verdict.why_not, verdict.calibrated
    decided = [(ruling.decided_by, f"decided {ruling.label}")]
    decided += [(why.decided_by, f"kept it from {why.label}")] if why is not None else []
    decided += [(verdict.lateral.decided_by, f"left and right: {verdict.lateral.label}")]
    if verdict.paper.label != NOT_JUDGED:
        decided += [(verdict.paper.decided_by, f"by the paper's rules {verdict.paper.label}")]
    said: dict[str, list[str]] = {}
    for name, words in decided:
        said.setdefault(name, []).append(words)
    for name, words in MAIN.items():
        if name in model.statistics and model.statistics[name].value is not None:
            said.setdefault(name, [words])
    there = [name for name in said if name in model.statistics][:_SHOWN]
    rows = tuple((name, in_words(model.statistics[name]), "; ".join(said[name])) for name in there)
    made = (Column("statistic", "word"), Column("value"), Column("what it did, or asks"))
    return Table("deciding", f"{label}: {verdict.answer}, {verdict.headline}", made, rows)


def verdicts_printed(score: BatteryScore, verdicts: Mapping[str, Verdict]) -> Iterator[Table | str]:
    """Yield the table of verdicts, what each verdict means, and the scope of all."""
    everyone = judged(score, verdicts)
    yield glance_table(everyone)
    if (series := series_table(everyone)).rows:
        yield series
    yield from (line for spec, verdict in verdicts.items() for line in marked(spec, verdict.marks))
    for label in dict.fromkeys(verdict.calibrated.label for verdict in verdicts.values()):
        yield f"{LABELS[label].answer}, {label}: {LABELS[label].says}"
    for spec, one in verdicts.items():
        if more := one.trust.removeprefix(LABELS[one.calibrated.label].says).strip():
            yield f"{spec}: {more}"
    if any(verdict.stopped for verdict in verdicts.values()):
        yield "e (n/N): stopped early after n of N calls, by e-values, which are valid after every call."
    yield f"Scope: {score.scope()}"
