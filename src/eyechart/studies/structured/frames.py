"""The frames of the page of scene estimates: what was told of each beside the truth, the worst with their views."""

from collections.abc import Sequence

from eyechart.calls import Reply
from eyechart.conditions import show
from eyechart.errors import EyechartError
from eyechart.frames import Frame, Scalar
from eyechart.perception.view import find_view, through
from eyechart.spaces.scene import SceneDecision
from eyechart.studies.battery.album import view_uri
from eyechart.studies.structured import Told
from eyechart.studies.structured.estimates import Estimates, Estimator, action_of, faults, gap_error_m, weight
from eyechart.studies.structured.planning import CONDITIONS

MOST_PICTURES = 24
"""Frames of all runs together that are shown with their view."""
MOST_ROWS = 2400
"""Rows of the tables of all frames, over all models."""
_POINTED_OUT = 0.1
"""A model's estimate stands beside the truth from this fault on: a tenth of what is close, where only the gap errs."""
_LONGEST = 600
_VIEWS = {"real": "the picture", "mirrored": "its reflection"}
_OF = {"real": "picture", "mirrored": "reflection"}


def shown_frames(evidence: Sequence[Estimates]) -> tuple[list[dict[str, object]], list[str]]:
    """Return, run by run, the frames with the worst estimates, with their views, and what has to be said of that."""
    each = max(1, MOST_PICTURES // max(1, len(evidence)))
    runs: list[dict[str, object]] = []
    notes = []
    for run in evidence:
        worst = run.worst[:each]
        runs.append({"run": run.name, "frames": [_frame(run, place) for place in worst]})
        if len(worst) < len(run.frames):
            notes.append(f"Of {run.name} the {len(worst)} worst of {len(run.frames)} frames are shown with their view.")
        if run.pictures is None:
            notes.append(f"{run.name} is shown without pictures, because {run.about_pictures}.")
    return runs, notes


def listed_frames(everyone: Sequence[Estimator]) -> tuple[list[dict[str, object]], list[str]]:
    """Return a table a model of what it told of the frames, worst first, and what has to be said of that."""
    each = max(1, MOST_ROWS // max(1, len(everyone)))
    tables: list[dict[str, object]] = []
    notes = []
    for who in everyone:
        told, places = who.score.told, who.run.worst[:each]
        rows = [
            [
                told.frames[place].id,
                _truth_words(told, place),
                *(_words(told.replies_to(name)[place]) for name in CONDITIONS),
                action_of(told, told.estimates("real")[place]) or "—",
                ", ".join(faults(told, place)) or "—",
            ]
            for place in places
        ]
        tables.append({"model": who.label, "rows": rows, "faulty": sum(row[-1] != "—" for row in rows)})
        if len(rows) < len(told.frames):
            notes.append(f"The table of {who.label} lists {len(rows)} of {len(told.frames)} frames, worst first.")
    return tables, notes


def _frame(run: Estimates, place: int) -> dict[str, object]:
    frame = run.frames[place]
    told = next(iter(run.score.models.values())).told
    wrong = [spec for spec, one in run.score.models.items() if weight(one.told, place) >= _POINTED_OUT]
    return {
        "id": frame.id,
        "where": f"{frame.scenario}, episode {frame.episode}, step {frame.step}",
        "truth": _truth_cells(told, place),
        "views": _views(run, frame),
        "right": [spec for spec in run.score.models if spec not in wrong],
        "rows": [
            _row(run, spec, condition, place)
            for spec in wrong
            for condition in CONDITIONS
            if run.score.models[spec].told.replies_to(condition)[place] is not None
        ],
    }


def _row(run: Estimates, spec: str, condition: str, place: int) -> dict[str, object]:
    told = run.score.models[spec].told
    reply, wrong = told.replies_to(condition)[place], faults(told, place) if condition == "real" else []
    assert reply is not None
    error = gap_error_m(told, place) if condition == "real" else None
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
            (_metres(one.gap_m), _gap_is_wrong(error, wrong, told)),
            ("close" if one.close else "not close", "close is wrong" in wrong),
            (_side(clear=one.left_clear), "left is wrong" in wrong),
            (_side(clear=one.right_clear), "right is wrong" in wrong),
            (f"{one.confidence:.2f}", False),
            (str(action_of(told, one)), False),
        ],
        "faults": ", ".join([*wrong, *([] if not error or error < _worth(told) else [f"gap {error:.1f} m off"])]),
    }


def _gap_is_wrong(error: float | None, wrong: Sequence[str], told: Told) -> bool:
    return bool({"no lead told", "a lead that is not there"} & {*wrong}) or (error or 0.0) >= _worth(told)


def _worth(told: Told) -> float:
    """Return the error of a gap from which on it is pointed out, in metres."""
    return told.distances.close_m * _POINTED_OUT


def _truth_cells(told: Told, place: int) -> list[str]:
    frame = told.frames[place]
    sides = [_said(frame.truth.get(name)) for name in ("left_clear", "right_clear")]
    gap = float(told.gap_m[place])
    metres = "no lead" if gap == float("inf") else f"{gap:.1f} {told.unit}"
    if metres != "no lead" and not told.visible[place]:
        metres += ", out of the picture"
    demand = frame.truth.get("demand")
    return [metres, "close" if told.close[place] else "not close", *sides, "", "—" if demand is None else str(demand)]


def _truth_words(told: Told, place: int) -> str:
    gap, close, left, right, _, demand = _truth_cells(told, place)
    return f"{gap}, {close}; left {left}, right {right}; {demand}"


def _words(reply: SceneDecision | None) -> str:
    if reply is None:
        return "not asked"
    one = reply.action
    if one is None:
        return _missing(reply)
    close, left, right = (
        "close" if one.close else "not close",
        _side(clear=one.left_clear),
        _side(clear=one.right_clear),
    )
    return f"{_metres(one.gap_m)}, {close}; left {left}, right {right}"


def _missing(reply: SceneDecision) -> str:
    return f"no estimate: {reply.missing}{f' ({reply.why})' if reply.why else ''}"


def _metres(gap_m: float | None) -> str:
    return "no lead" if gap_m is None else f"{gap_m:.1f} m"


def _side(*, clear: bool) -> str:
    return "clear" if clear else "taken"


def _said(truth: Scalar) -> str:
    return _side(clear=truth) if isinstance(truth, bool) else "—"


def _verbatim(reply: Reply | None) -> str:
    """Return the beginning of a reply without control signs."""
    if reply is None:
        return ""
    text = reply.text or reply.error_detail or ""
    shown = "".join(sign if sign.isprintable() or sign in "\n\t" else "�" for sign in text[:_LONGEST])
    return f"{shown}…" if len(text) > _LONGEST else shown


def _views(run: Estimates, frame: Frame) -> list[tuple[str, str]]:
    """Return the picture and its reflection as the models were shown them, or nothing where they are not at hand."""
    if run.pictures is None:
        return []
    manifest = run.score.manifest
    try:
        view = find_view(manifest.view)
    except EyechartError:
        view = None
    found = []
    for condition, words in _VIEWS.items():
        seen = through(view, show(condition, run.pictures.frame(frame.id), run.pictures, manifest.seed), frame.id)
        found += [(words, view_uri(picture)) for picture in seen.images.values()]
    return found
