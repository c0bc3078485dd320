"""What sections of the page show beside their figures: what they cannot say, guards, and counterfactual pairs."""

from collections.abc import Mapping, Sequence

from eyechart.integrity import Guard
from eyechart.report.drawing import Drawing
from eyechart.report.evidence import Evidence, Subject, subjects
from eyechart.report.pictures import NO_PICTURE, Album
from eyechart.spaces.discrete import Discrete

GUARDS_SHOWN = 4
"""Up to so many models every guard of each has its row."""
PAIRS_SHOWN = 4
"""Counterfactual moments that stand side by side, fewer where many models answer; the browser of frames has all."""


def silent(
    evidence: Sequence[Evidence], everyone: Sequence[Subject], drawn: Mapping[str, Sequence[Drawing]]
) -> dict[str, list[tuple[str, str]]]:
    """Return, by section, the runs for which it cannot say anything, each with the reason."""
    found: dict[str, list[tuple[str, str]]] = {"gap": [], "information": [], "mirror": [], "counterfactual": []}
    for run in evidence:
        mine = [who for who in everyone if who.run is run]
        labels = {who.label for who in mine}
        for section in ("gap", "mirror", "counterfactual"):
            if not any(one.of in labels for one in drawn[section]):
                found[section].append((run.name, _why(section, mine)))
        if all(who.model.statistics["mutual_information.decision"].value is None for who in mine):
            found["information"].append((run.name, _why("gap", mine)))
    return found


def _why(section: str, models: Sequence[Subject]) -> str:
    """Return in words why a section has no figure of these models."""
    if section == "counterfactual":
        return "the run has no answers to counterfactual pictures, so distance was not tested by intervention"
    name = "mirror_swap_rate" if section == "mirror" else "mutual_information.decision"
    notes = dict.fromkeys(who.model.statistics[name].note for who in models)
    return "; ".join(note for note in notes if note) or "the run names no model"


def guards(run: Evidence) -> list[tuple[str, Guard]]:
    """Return every guard that does not hold, and, where many models were asked, of the others only the names once."""
    found = [(spec, guard) for spec, many in run.score.guards.items() for guard in many]
    if len(run.score.models) <= GUARDS_SHOWN:
        return found
    every = f"all {len(run.score.models)} models"
    held = {guard.name for _, guard in found} - {guard.name for _, guard in found if guard.holds is not True}
    return [
        *((spec, guard) for spec, guard in found if guard.holds is not True),
        *((every, Guard(name, True, "it holds for each of them")) for name in sorted(held)),
    ]


def pairs(run: Evidence, places: dict[str, tuple[int, ...]], album: Album, models: int) -> list[dict[str, object]]:
    """Return some moments, evenly taken, with the pictures of each counterfactual and the decisions they got."""
    names = [name for name in ("lead_near", "lead_far", "real", "recoloured") if name in run.conditions]
    drawn = [
        place for place, frame in enumerate(run.frames) if {"lead_near", "lead_far"} & frame.counterfactuals.keys()
    ]
    if not drawn or not {"lead_near", "lead_far", "recoloured"} & set(names):
        return []
    count = PAIRS_SHOWN if models <= 8 else PAIRS_SHOWN // 2
    step, space = max(1, len(drawn) // count), run.score.bank.manifest.action_space
    return [
        {
            "frame": run.frames[place].id,
            "run": run.name,
            "columns": [(name, _uri(album, places[name][place])) for name in names],
            "rows": [(who.spec, [_word(who, name, place, space) for name in names]) for who in subjects([run])],
        }
        for place in drawn[::step][:count]
    ]


def _uri(album: Album, number: int) -> str | None:
    return None if number <= NO_PICTURE else album.uris[number]


def _word(who: Subject, condition: str, place: int, space: Discrete) -> tuple[str, str]:
    """Return the role of a decision (brake, proceed, other, none, or nothing where there is no reply) and its word."""
    decision = who.decision(condition, place)
    if decision is None:
        return "", "—"
    if decision.action is None:
        return "none", f"({decision.missing})"
    return space.role(decision.action), decision.action
