"""The page of scene estimates: admission by clause, every figure, and the worst frames."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from math import inf
from typing import Any

import numpy as np

from eyechart.calls import Reply
from eyechart.conditions import flip, show
from eyechart.costs import ALL
from eyechart.errors import EyechartError
from eyechart.frames import RGB, Frame, decode
from eyechart.gate import UNPARSED, hold_online
from eyechart.integrity import unfinished
from eyechart.perception.view import View, find_view, through
from eyechart.report.accounts import deployment_tables
from eyechart.report.charts import BLUE, HEAD, INK, MUTED, VERMILLION, Drawing, canvas, dots, panels, style
from eyechart.report.page import MOST_SAID, ExamplePicture, Page, PageSummary, Section, VerdictSummary, fill, parted
from eyechart.report.table import estimate
from eyechart.spaces.scene import SceneDecision
from eyechart.studies import Tell
from eyechart.studies.battery.album import view_uri
from eyechart.studies.battery.subjects import accounts_of, subjects
from eyechart.studies.closed_loop.page import StudyIntroduction
from eyechart.studies.structured.online import CONTROL, OnlineScore
from eyechart.studies.structured.plans import CONDITIONS
from eyechart.studies.structured.scene_answers import SceneAnswers, faults, gap_error_m, weight
from eyechart.studies.structured.tables import (
    Estimates,
    EstimatorInRun,
    clauses_table,
    clauses_words,
    controller_table,
    figures_table,
    met_table,
    online_table,
    scored_of,
)

_WIDTH = 7.16
"""The width of a figure over both columns of the paper's class, in inches."""
_DRAWN = 12
"""The most models with a figure of their own in the page."""
_OPENING_MODELS = 3
"""The most models whose estimates stand at the head of the page."""
MOST_PICTURES = 24
"""The most frames of all runs that are shown with their view."""
MOST_ROWS = 2400
"""The most rows of the tables of all frames, over all models."""
_POINTED_OUT = 0.1
"""The least fault of an estimate that is shown: a gap error of .1 of the close distance."""
_LONGEST = 600
_LEADS = {"no lead told", "a lead that is not there"}
_VIEWS = {"real": "the picture", "mirrored": "its reflection"}
_OF = {"real": "picture", "mirrored": "reflection"}
_ANSWERS = {"sees": ("admitted",), "blind": ("not admitted",), "open": ("not admitted",)}
_DRIVERS_ANSWERS = {"sees": ("admitted",), "blind": ("not admitted",), "open": ("cannot say", "for")}
_DRIVERS_INTRO = (
    "An estimator may steer only if it meets every clause on the frames of its own drives. Each of these frames "
    "must also pass the checks of the renderer and of the positive control. Crashes measure caution too: a model that "
    "brakes at everything seldom crashes."
)


def make_estimates_page(evidence: Sequence[Estimates], *, tell: Tell = lambda _: None) -> Page:
    """Return the report of admission and structured runs; the same runs give the same bytes."""
    everyone = subjects(evidence)
    tell("figures")
    with style():
        drawn = [drawing for place, who in enumerate(everyone[:_DRAWN], 1) for drawing in gaps(who, place)]
    tell("pictures")
    worst = {}
    for run in evidence:  # the frames with the worst estimates of all models together come first
        every = [
            [weight(model.answers, place) for place in range(len(run.frames))] for model in run.score.models.values()
        ]
        order = np.argsort(-np.sum(every, axis=0), kind="stable") if every else ()
        worst[run.name] = [int(place) for place in order]
    frames, notes = shown_frames(evidence, worst)
    listed, more = listed_frames(everyone, worst)
    if len(everyone) > _DRAWN:
        more.append(f"Figures of single models stand here for the first {_DRAWN} of {len(everyone)} models.")
    notes += more
    tell("the page")
    scored = scored_of(everyone)
    cards = [_card(who) for who in everyone]
    html = fill(
        "estimates.html",
        answer=_opening(evidence, cards, worst),
        styles=("estimates.css",),
        title=", ".join(run.name for run in evidence),
        studies=" and ".join(dict.fromkeys(run.score.manifest.study for run in evidence)),
        runs=[_run(run) for run in evidence],
        cards=cards,
        controllers=controller_table(scored),
        figures=list(figures_table(scored).split()),
        drawings=drawn,
        frames=frames,
        listed=listed,
        accounting=[(who, who.run.score.accounting[who.spec][ALL]) for who in everyone],
        costs=deployment_tables(accounts_of(everyone)),
        notes=notes,
    )
    return Page(html, {"gaps": drawn}, tuple(notes))


def _opening(
    evidence: Sequence[Estimates], cards: Sequence[Mapping[str, Any]], worst: Mapping[str, Sequence[int]]
) -> PageSummary:
    """Return the opening: the admitted models, and the estimates of the worst frame."""
    said = [
        VerdictSummary(
            card["model"],
            "admitted" if card["admitted"] else "not admitted yet" if card["state"] else "not admitted",
            "sees" if card["admitted"] else "blind" if card["fails"] and not card["state"] else "open",
            card["why"],
            place=f"card-{number}",
        )
        for number, card in enumerate(cards, 1)
    ]
    sentence = parted(said, _ANSWERS, "estimators") if len(said) != 1 else f"It is {said[0].label}."
    run = next((run for run in evidence if worst[run.name] and run.score.models), None)
    if run is None:
        return PageSummary(sentence, said)
    place, models = worst[run.name][0], list(run.score.models)[:_OPENING_MODELS]
    views = dict(_views(run, run.frames[place]))
    shots = [
        ExamplePicture(
            words, views.get(words, ""), "picture not in this page", [_shot(run, spec, name, place) for spec in models]
        )
        for name, words in _VIEWS.items()
    ]
    truth = _truth_words(run.score.models[models[0]].answers, place)
    caption = f"Frame {run.frames[place].id}, the worst of all models together. Truth: {truth}."
    return PageSummary(sentence, said, models, shots, caption=caption)


def _shot(run: Estimates, spec: str, condition: str, place: int) -> tuple[str, str, str]:
    """Return a model's estimate of a frame, and whether any of it is wrong."""
    answers = run.score.models[spec].answers
    words, wrong = _words(answers.replies_to(condition)[place]), faults(answers, place)
    if condition != "real":
        return "bad" if "the reflection differs" in wrong else "", words, ""
    wrong = [one for one in wrong if one != "the reflection differs"]
    return "bad" if wrong else "good", words, ", ".join(wrong)


def gaps(who: EstimatorInRun, place: int) -> list[Drawing]:
    """Draw the estimated gap against the true one, for leads in the picture; empty without any."""
    answers, one = who.model.answers, who.model.statistics["gap_mae_m"]
    pairs = [
        (float(answers.gap_m[number]), estimate.gap_m)
        for number, estimate in enumerate(answers.estimates("real"))
        if estimate is not None and estimate.gap_m is not None and answers.visible[number]
    ]
    if one.value is None:
        return []
    figure, axes = canvas(3.6, 3.1, (0.6, 0.15, 0.5, 0.15))
    most = 1.06 * max(max(pair) for pair in pairs)
    close = answers.distances.close_m
    axes.plot([0, most], [0, most], color=MUTED, linewidth=0.8)
    for side in (axes.axvline, axes.axhline):
        side(close, color=VERMILLION, linewidth=0.8, linestyle=(0, (4, 3)))
    axes.plot([x for x, _ in pairs], [y for _, y in pairs], "o", color=BLUE, markersize=3, alpha=0.6)
    axes.text(close, 0.99 * most, f" close below {close:g} m", color=INK, fontsize=8, va="top")
    axes.set_xlim(0, most)
    axes.set_ylim(0, most)
    axes.set_xlabel("true gap, m")
    axes.set_ylabel("estimated gap, m")
    words = f"{one.n} frames with a lead in the picture; mean absolute error {one.value:.3f} m. A line marks equality."
    return [Drawing(f"gap-told-{place}", f"Estimated and true gap: {who.label}", words, figure, of=who.label)]


def _run(run: Estimates) -> dict[str, object]:
    return {
        "evidence": run,
        "manifest": run.score.manifest,
        "bank": run.score.bank,
        "guards": [(spec, guard) for spec, many in run.score.guards.items() for guard in many],
        "unfinished": [
            f"{spec}: {model.answered} of {model.planned} calls are answered; the rest is missing from every figure"
            for spec, model in run.score.models.items()
            if model.answered < model.planned
        ],
    }


def _card(who: EstimatorInRun) -> dict[str, Any]:
    score = who.model
    state = unfinished(score.answered, score.planned)
    fails = [clause.name for clause in score.clauses if clause.passes is False]
    unsaid = [clause.name for clause in score.clauses if clause.passes is None]
    words = "meets every clause" if score.is_admitted else f"fails {', '.join(fails)}" if fails else "fails no clause"
    if unsaid:
        words += f"; cannot say: {', '.join(unsaid)}"
    why = clauses_words((clause.name, clause.passes, clause.words) for clause in score.clauses)
    answers = score.answers
    return {
        "model": who.label,
        "version": score.version,
        "admitted": score.is_admitted,
        "fails": fails,
        "state": state,
        "words": words,
        "why": f"{why} It is {state}." if state else why,
        "marks": who.run.score.marks(who.spec),
        "clauses": next(clauses_table([(who.label, score, ())]).split(), None),
        "reasons": list(answers.reasons.items()),
        "repairs": list(answers.repairs.items()),
    }


def shown_frames(
    evidence: Sequence[Estimates], order: Mapping[str, Sequence[int]]
) -> tuple[list[dict[str, object]], list[str]]:
    """Return the frames with the worst estimates by run, with their views, and notes."""
    each = max(1, MOST_PICTURES // max(1, len(evidence)))
    runs: list[dict[str, object]] = []
    notes = []
    for run in evidence:
        worst = order[run.name][:each]
        runs.append({"run": run.name, "frames": [_frame(run, place) for place in worst]})
        if len(worst) < len(run.frames):
            notes.append(f"Of {run.name} the {len(worst)} worst of {len(run.frames)} frames are shown with their view.")
        if run.pictures is None:
            notes.append(f"{run.name} is shown without pictures, because {run.about_pictures}.")
    return runs, notes


def listed_frames(
    everyone: Sequence[EstimatorInRun], order: Mapping[str, Sequence[int]]
) -> tuple[list[dict[str, object]], list[str]]:
    """Return a table per model of its estimates, the worst frames first, and notes."""
    each = max(1, MOST_ROWS // max(1, len(everyone)))
    tables: list[dict[str, object]] = []
    notes = []
    for who in everyone:
        answers, places = who.model.answers, order[who.run.name][:each]
        rows = [
            [
                answers.frames[place].id,
                _truth_words(answers, place),
                *(_words(answers.replies_to(name)[place]) for name in CONDITIONS),
                "—" if (one := answers.estimates("real")[place]) is None else one.act(answers.distances),
                ", ".join(faults(answers, place)) or "—",
            ]
            for place in places
        ]
        tables.append({"model": who.label, "rows": rows, "faulty": sum(row[-1] != "—" for row in rows)})
        if len(rows) < len(answers.frames):
            notes.append(f"The table of {who.label} lists {len(rows)} of {len(answers.frames)} frames, worst first.")
    return tables, notes


def _frame(run: Estimates, place: int) -> dict[str, object]:
    frame = run.frames[place]
    answers = next(iter(run.score.models.values())).answers
    wrong = [spec for spec, model in run.score.models.items() if weight(model.answers, place) >= _POINTED_OUT]
    return {
        "id": frame.id,
        "where": f"{frame.scenario}, episode {frame.episode}, step {frame.step}",
        "truth": _truth_cells(answers, place),
        "views": _views(run, frame),
        "right": [spec for spec in run.score.models if spec not in wrong],
        "rows": [
            _row(run, spec, condition, place)
            for spec in wrong
            for condition in CONDITIONS
            if run.score.models[spec].answers.replies_to(condition)[place] is not None
        ],
    }


def _row(run: Estimates, spec: str, condition: str, place: int) -> dict[str, object]:
    answers = run.score.models[spec].answers
    reply, wrong = answers.replies_to(condition)[place], faults(answers, place) if condition == "real" else []
    assert reply is not None
    error = (gap_error_m(answers, place) if condition == "real" else None) or 0.0
    off = error >= answers.distances.close_m * _POINTED_OUT
    one = reply.action
    verbatim = run.replies[spec].get((run.frames[place].id, condition))
    return {
        "model": spec,
        "of": _OF[condition],
        "none": None if one is not None else _missing(reply),
        "text": "" if one is not None else _verbatim(verbatim),
        "cells": []
        if one is None
        else [
            (_metres(one.gap_m), bool(_LEADS & {*wrong}) or off),
            ("close" if one.close else "not close", "close is wrong" in wrong),
            (_side(clear=one.left_clear), "left is wrong" in wrong),
            (_side(clear=one.right_clear), "right is wrong" in wrong),
            (f"{one.confidence:.2f}", False),
            (one.act(answers.distances), False),
        ],
        "faults": ", ".join([*wrong, *([f"gap {error:.1f} m off"] if off else [])]),
    }


def _truth_cells(answers: SceneAnswers, place: int) -> list[str]:
    frame = answers.frames[place]
    told_of = (frame.truth.get(name) for name in ("left_clear", "right_clear"))
    sides = [_side(clear=one) if isinstance(one, bool) else "—" for one in told_of]
    gap = float(answers.gap_m[place])
    metres = "no lead" if gap == float("inf") else f"{gap:.1f} {answers.unit}"
    if metres != "no lead" and not answers.visible[place]:
        metres += ", out of the picture"
    demand = frame.truth.get("demand")
    return [
        metres,
        "close" if answers.close[place] else "not close",
        *sides,
        "",
        "—" if demand is None else str(demand),
    ]


def _truth_words(answers: SceneAnswers, place: int) -> str:
    gap, close, left, right, _, demand = _truth_cells(answers, place)
    return f"{gap}, {close}; left {left}, right {right}; {demand}"


def _words(reply: SceneDecision | None) -> str:
    if reply is None:
        return "no call"
    one = reply.action
    if one is None:
        return _missing(reply)
    left, right = _side(clear=one.left_clear), _side(clear=one.right_clear)
    return f"{_metres(one.gap_m)}, {'close' if one.close else 'not close'}; left {left}, right {right}"


def _missing(reply: SceneDecision) -> str:
    return f"no estimate: {reply.missing}{f' ({reply.why})' if reply.why else ''}"


def _metres(gap_m: float | None) -> str:
    return "no lead" if gap_m is None else f"{gap_m:.1f} m"


def _side(*, clear: bool) -> str:
    return "clear" if clear else "taken"


def _verbatim(reply: Reply | None) -> str:
    """Return the beginning of a reply without control signs."""
    if reply is None:
        return ""
    text = reply.text or reply.error_detail or ""
    shown = "".join(sign if sign.isprintable() or sign in "\n\t" else "�" for sign in text[:_LONGEST])
    return f"{shown}…" if len(text) > _LONGEST else shown


def _views(run: Estimates, frame: Frame) -> list[tuple[str, str]]:
    """Return the picture and its reflection as the models saw them; empty without pictures."""
    if run.pictures is None:
        return []
    manifest = run.score.manifest
    try:
        view = find_view(manifest.view)
    except EyechartError:
        view = None
    views = []
    for condition, words in _VIEWS.items():
        stimulus = through(view, show(condition, run.pictures.frame(frame.id), run.pictures, manifest.seed), frame.id)
        views += [(words, view_uri(picture)) for picture in stimulus.images.values()]
    return views


def first_of(scores: Mapping[str, OnlineScore]) -> StudyIntroduction:
    """Return the question, the answer and the evidence of online runs, by name."""
    named = {f"{name} · " if len(scores) > 1 else "": score for name, score in scores.items()}
    said = [one for of, score in named.items() for one in _drivers_said(of, score)]
    answer = PageSummary(
        parted(said, _DRIVERS_ANSWERS, "estimators that drove"),
        said,
        figure=_crashes(named, frozenset(one.who for one in said if one.tone == "sees")),
        caption="Filled: admitted, and the control. Few crashes are no proof of sight.",
    )
    tables = [table(score) for score in scores.values() for table in (online_table, met_table)]
    lines = [line for of, score in named.items() for line in _drivers_lines(of, score)]
    return StudyIntroduction(
        "Do these models measure the scene that they drive in?",
        answer,
        Section("Admission", _DRIVERS_INTRO, tables=tables, lines=lines),
    )


def _drivers_said(of: str, score: OnlineScore) -> Iterator[VerdictSummary]:
    """Yield whether each estimator is admitted, and the clauses that it does not meet."""
    gate = hold_online(score)
    for spec in score.manifest.models:
        mine = [check for check in gate.checks if check.model == spec and check.requirement != UNPARSED]
        held = [check.holds for check in mine]
        tone = "sees" if held and all(held) else "blind" if False in held else "open"
        why = clauses_words((check.requirement, check.holds, check.because) for check in mine)
        yield VerdictSummary(f"{of}{spec}", _DRIVERS_ANSWERS[tone][0], tone, why, place="first")


def _crashes(named: Mapping[str, OnlineScore], admitted: Collection[str]) -> Drawing:
    """Draw each estimator's crash rate, the positive control first."""
    rows = [
        (who := f"{of}{spec}", one.crash_rate, INK if spec == CONTROL else BLUE, not {spec, who} & {CONTROL, *admitted})
        for of, score in named.items()
        for spec, one in score.driven.items()
    ][: MOST_SAID + 1]
    with style():
        figure = dots(rows, "crashed, share of episodes", 1.0, across=HEAD)
    description = "; ".join(f"{who}: {estimate(one)}, n {one.n}" for who, one, *_ in rows)
    return Drawing("in-short", "Crashes beside the positive control's", f"Filled: admitted. {description}", figure)


def _drivers_lines(of: str, score: OnlineScore) -> Iterator[str]:
    """Yield the checks of each estimator's frames, and the refused worlds."""
    yield from (f"{of}{spec}: {score.frames(spec)[1]}." for spec in score.manifest.models)
    yield from (
        f"{of}refused: {check.scenario}/{check.seed}: {check.why}" for check in score.vetted if check.why is not None
    )


def interface(evidence: Sequence[Estimates]) -> Iterator[Drawing]:
    """Yield figure fgr:vlm-interface of the first run with pictures and a view.

    Its frame is the first with a close lead, else the first with a lead, else the first of the run.
    """
    for run in evidence:
        view = find_view(run.score.manifest.view)
        if view is None or run.pictures is None or not run.frames:
            continue
        frame = _closest(run)
        pixels = decode(run.pictures.recorded(frame), frame.file)
        with style():
            yield _compared(frame, pixels, view)
        return


def _closest(run: Estimates) -> Frame:
    gap = run.score.bank.manifest.gap
    return (
        run.frames[0]
        if gap is None
        else min(run.frames, key=lambda frame: (not gap.is_near(frame), gap.of(frame) == inf))
    )


def _compared(frame: Frame, pixels: RGB, view: View) -> Drawing:
    reflected = np.ascontiguousarray(flip(pixels, view.axis))
    shown = {
        "the simulator's frame": pixels,
        f"the calibrated view ({view.name})": view.show(pixels, frame.file),
        "its reflection": view.show(reflected, frame.file),
    }
    says = (
        f"Frame {frame.id}, from left to right: as the simulator drew it, as models saw it, and as they saw its "
        "reflection. In the reflection estimates of what is ahead stay, and LEFT and RIGHT exchange"
    )
    return Drawing("fgr-vlm-interface", "Visual interface", says, panels(shown, _WIDTH), wide=True)
