"""What sections of the page show beside figures: guards, pairs, what came back, and what is not covered."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from eyechart.conditions import OF_BANKS
from eyechart.integrity import Guard
from eyechart.report.charts import Drawing
from eyechart.spaces.discrete import Discrete
from eyechart.spaces.space import MISSING
from eyechart.studies.battery.album import NO_PICTURE, Album
from eyechart.studies.battery.planning import conditions_of, plan_of
from eyechart.studies.battery.subjects import Evidence, Subject, subjects

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


@dataclass(frozen=True, slots=True)
class Count:
    """The calls of one condition: how many were planned, came back, took how many attempts, and hold no decision.

    ``partial`` says that calls are still to be made; a run that stopped early leaves some out for good.
    ``errors`` counts attempts that ended in an error, ``unknown`` attempts whose outcome is not known, and ``missing``
    the finished calls without a decision by reason, in the order of ``MISSING``.
    """

    condition: str
    planned: int
    answered: int
    attempts: int
    errors: int
    unknown: int
    missing: tuple[int, ...]
    partial: bool = False

    @property
    def without(self) -> int:
        """Return how many calls hold no decision, for whatever reason."""
        return sum(self.missing)


def counts(who: Subject) -> list[Count]:
    """Return what became of a model's calls, one row a condition."""
    planned: dict[str, int] = dict.fromkeys(who.run.conditions, 0)
    for key in plan_of(who.run.score.manifest, who.run.score.bank).keys_of(who.spec):
        planned[key.condition] += 1
    return [_count(who, name, planned[name]) for name in who.run.conditions]


def _count(who: Subject, name: str, planned: int) -> Count:
    given = [one for one in who.model.answers.decisions.get(name, ()) if one is not None]
    took = who.run.score.accounting[who.spec].get(name)
    missing = tuple(sum(one.missing == reason for one in given) for reason in MISSING)
    sums = (0, 0, 0, 0) if took is None else (took.finished, took.attempts, took.failed, took.unknown)
    return Count(name, planned, *sums, missing, sums[0] < planned and who.model.stopped is None)


def summed(rows: Sequence[Sequence[Count]]) -> list[Count]:
    """Return the counts of several models of one run together, one row a condition."""
    return [
        Count(
            condition=many[0].condition,
            planned=sum(one.planned for one in many),
            answered=sum(one.answered for one in many),
            attempts=sum(one.attempts for one in many),
            errors=sum(one.errors for one in many),
            unknown=sum(one.unknown for one in many),
            missing=tuple(map(sum, zip(*(one.missing for one in many), strict=True))),
            partial=any(one.partial for one in many),
        )
        for many in zip(*rows, strict=True)
    ]


def not_covered(run: Evidence) -> list[str]:
    """Return in words what a run does not cover: conditions, frames, calls, and tests that cannot say, by name."""
    return [*_unasked(run), *_silent(run), "not tested by any run: other prompts, other cameras, closed loop"]


def _unasked(run: Evidence) -> list[str]:
    manifest, bank = run.score.manifest, run.score.bank
    _, why = conditions_of(bank, manifest.prompt)
    lines = [
        f"condition {name} was not asked: {why.get(name, 'it was not chosen')}"
        for name in OF_BANKS
        if name not in manifest.conditions
    ]
    if len(run.frames) < len(bank):
        lines.append(f"{len(bank) - len(run.frames)} of the bank's {len(bank)} frames were not asked about (--limit)")
    if manifest.shard is not None:
        lines.append(f"this is shard {manifest.shard[0]} of {manifest.shard[1]}: the calls of the others are not here")
    for spec, one in run.score.models.items():
        if one.stopped is not None:
            lines.append(f"{spec}: {one.stopped.words()}; the paper's tests, which need the whole run, are not judged")
        elif one.answered < one.planned:
            lines.append(f"{spec}: {one.planned - one.answered} of {one.planned} planned calls are not finished")
    return lines


def _silent(run: Evidence) -> list[str]:
    """Return the tests that cannot say, those of one reason and the same models in one line."""
    reasons: dict[tuple[str, str], list[str]] = {}
    for spec, one in run.score.models.items():
        for name, found in one.statistics.items():
            if found.value is None and found.p is None:
                reasons.setdefault((name, found.note or "no reason given"), []).append(spec)
    grouped: dict[tuple[str, tuple[str, ...]], list[str]] = {}
    for (name, note), specs in reasons.items():
        grouped.setdefault((note, tuple(specs)), []).append(name)
    everyone = tuple(run.score.models)
    return [
        f"cannot say: {', '.join(names)}{'' if specs == everyone else ' for ' + ', '.join(specs)} ({note})"
        for (note, specs), names in grouped.items()
    ]
