"""The opening of a page of batteries: one sentence, a verdict per model, and one example frame."""

from collections import Counter
from collections.abc import Sequence
from itertools import zip_longest

import numpy as np

from eyechart.errors import counted
from eyechart.report.page import ExamplePicture, PageSummary, VerdictSummary, parted
from eyechart.studies.battery.album import NO_PICTURE, Album
from eyechart.studies.battery.figures import BANDS, braking_head
from eyechart.studies.battery.subjects import Evidence, Subject
from eyechart.verdicts import LABELS

MODELS_SHOWN = 4
"""The most models whose answers stand under the pictures."""

OTHERS = {
    "lead_near": "the same moment, the lead near",
    "lane_own": "the same moment, the near vehicle in the own lane",
    "lead_absent": "the same moment without the lead",
    "mirrored": "the same picture, reflected",
    "shuffled": "the picture of another episode",
}
NOTHING = {"blank": "a blank picture", "noise": "noise", "text_only": "no picture"}
"""The second and the third picture of the example, by condition; of each, the first in the run."""

_SHOWS = {"real": "the real frame", **NOTHING, **OTHERS}
_ANSWERS = {answer: (answer.lower(), "for") for answer in ("Yes", "In part", "No", "Inconclusive")}


def opening(evidence: Sequence[Evidence], everyone: Sequence[Subject], album: Album) -> PageSummary:
    """Return the opening of a page; its example is a frame of the first run.

    A model of another run answers there if its run has the same frames under the same conditions.
    """
    said = [_said(who, at) for at, who in enumerate(everyone, 1)]
    sentence = _sentence(everyone, said)
    if len(everyone) == 1 and (drawn := braking_head(everyone[0])) is not None:
        return PageSummary(sentence, said, figure=drawn, caption=BANDS)
    models, shots, caption = _example(evidence, everyone, album) if evidence else ((), (), "")
    return PageSummary(sentence, said, models, shots, caption=caption)


def _sentence(everyone: Sequence[Subject], said: Sequence[VerdictSummary]) -> str:
    """Return in one sentence whether the decisions come from the camera."""
    if not everyone:
        return "The run names no model."
    if len(everyone) == 1:
        verdict = everyone[0].verdict
        early = "" if verdict.stopped is None else f"{verdict.stopped.words()}: "
        return verdict.sentence.replace(f": {early}", ": ", 1)
    return parted(said, _ANSWERS, "models")


def _said(who: Subject, place: int) -> VerdictSummary:
    """Return the opening's line on a model."""
    verdict = who.verdict
    kept = verdict.why_not
    words = f"Not final, {verdict.state}. {verdict.trust}" if verdict.state else verdict.trust
    why = "" if kept is None else f"{label_words(kept.label)} needs {kept.needs}. To settle it: {kept.settle}."
    beware = "not to be relied on" if verdict.doubts else verdict.beware and "turns to the blocked side"
    label = verdict.calibrated.label
    return VerdictSummary(
        who.label, label_words(label), LABELS[label].family, words, why, f"card-{place}", beware, verdict.answer
    )


def label_words(label: str) -> str:
    """Return a label as words."""
    return label.replace("_", " ")


def _example(
    evidence: Sequence[Evidence], everyone: Sequence[Subject], album: Album
) -> tuple[Sequence[str], Sequence[ExamplePicture], str]:
    """Return one frame as it was, without its picture, and with one change, and the answers.

    The frame is one with the most frequent answers. Where gaps are known, its gap is at least the
    median, because only then is a near lead another picture.
    """
    run, places, uris = evidence[0], album.places[0], album.uris
    names = _compared(run)
    alike = [one for one in evidence if _is_alike(run, one, names)]
    able = [one for one in everyone if any(one.run is each for each in alike)]
    who = _of_each(able, alike)[:MODELS_SHOWN]
    if not who or len(names) == 1:
        return (), (), ""
    far, how = _far(who[0], len(run.frames))
    said = {name: [_answers(one, name) for one in who] for name in names}
    seen = [at for at in far if all(places[name][at] >= NO_PICTURE for name in names)]
    best = _typical(seen or far, far, [column for many in said.values() for column in many])
    shots = [
        _shot(name, uris, places[name][best], [_answer_cell(run, column, best, far) for column in said[name]])
        for name in names
    ]
    more = _beside(evidence, everyone, who, alike)
    caption = (
        f"Frame {run.frames[best].id}, one of {len(far)} {how}. Numbers: how many of these frames got that answer."
    )
    return [one.label for one in who], shots, caption + more


def _beside(
    evidence: Sequence[Evidence], everyone: Sequence[Subject], who: Sequence[Subject], alike: Sequence[Evidence]
) -> str:
    """Return the models and runs that are not in the example, in words."""
    left = len(everyone) - len(who)
    more = f" {counted(left, 'more model', 'stand')} below." if left else ""
    others = ", ".join(one.name for one in evidence if not any(one is each for each in alike))
    more += f" Runs with other frames or conditions: {others}." if others else ""
    return more


def _is_alike(first: Evidence, other: Evidence, names: Sequence[str]) -> bool:
    """Return whether a run has the frames of the first, under all of these conditions."""
    same = [frame.id for frame in first.frames] == [frame.id for frame in other.frames]
    bank = first.score.manifest.fingerprint == other.score.manifest.fingerprint
    return same and bank and set(names) <= {"real", *other.conditions}


def _of_each(able: Sequence[Subject], runs: Sequence[Evidence]) -> list[Subject]:
    """Return models in turn: the first of each run, then the second of each."""
    mine = [[one for one in able if one.run is run] for run in runs]
    return [one for turn in zip_longest(*mine) for one in turn if one is not None]


def _compared(run: Evidence) -> list[str]:
    """Return the conditions whose pictures stand side by side: real, and the first of each kind."""
    kinds = ([name for name in kind if name in run.conditions] for kind in (NOTHING, OTHERS))
    return ["real", *(names[0] for names in kinds if names)]


def _shot(name: str, uris: Sequence[str], at: int, answers: Sequence[tuple[str, str, str]]) -> ExamplePicture:
    absent = "no picture is sent" if at == NO_PICTURE else "picture not in this page"
    return ExamplePicture(_SHOWS[name], uris[at] if at > NO_PICTURE else "", absent, answers)


def _typical(seen: Sequence[int], far: Sequence[int], columns: Sequence[Sequence[str]]) -> int:
    """Return the place among ``seen`` where most answers are the most frequent ones on ``far``."""
    usual = [Counter(column[at] for at in far).most_common(1)[0][0] for column in columns]
    return max(seen, key=lambda at: sum(column[at] == most for column, most in zip(columns, usual, strict=True)))


def _answer_cell(run: Evidence, said: Sequence[str], best: int, far: Sequence[int]) -> tuple[str, str, str]:
    """Return the role of an answer, its word, and the number of frames with that answer."""
    word, space = said[best], run.score.bank.manifest.action_space
    role = space.role(word) if word in space.actions else "none"
    return role, word or "—", f"{sum(said[at] == word for at in far)} of {len(far)}"


def _far(who: Subject, frames: int) -> tuple[list[int], str]:
    """Return the places of the candidate frames for the example, and their description."""
    gaps = who.model.answers.gaps
    if gaps is None or not np.isfinite(gaps).any():
        return list(range(frames)), "frames"
    return [int(at) for at in np.flatnonzero(gaps >= np.median(gaps))], "frames with a gap of at least the median"


def _answers(who: Subject, condition: str) -> list[str]:
    """Return a model's answer on each frame in a word; empty where there was no call."""
    given = who.model.answers.decisions.get(condition) or (None,) * len(who.run.frames)
    return ["" if one is None else f"({one.missing})" if one.action is None else one.action for one in given]
