"""Tables of policies: a verdict a row, the share of every channel and condition, and what every statistic is."""

from collections import Counter
from collections.abc import Iterator, Mapping
from typing import TypeVar

from eyechart.report.table import STATISTIC, Cell, Column, Mark, Table, columns, statistic_cells
from eyechart.stats.statistic import Statistic
from eyechart.studies.policy.scoring import PolicyScore, judge
from eyechart.verdicts.channels import PolicyVerdict

_TONES = {
    "object_grounded": "sees",
    "camera_content": "sees",
    "pose_only": "partly",
    "camera_presence": "partly",
    "ignores_camera": "blind",
    "instruction_followed": "sees",
    "instruction_ignored": "blind",
    "state_shortcut": "blind",
}
Verdicts = Mapping[str, PolicyVerdict]


def tone(label: str) -> str:
    """Return the kind of evidence that a label is: sees, partly, blind or open."""
    return _TONES.get(label, "open")


def mark(label: str) -> Mark:
    """Return a label with its tone."""
    return Mark(label, tone(label))


def verdict_table(verdicts: Verdicts) -> Table:
    """Return a policy a row, an axis a column."""
    cameras = list(dict.fromkeys(name for one in verdicts.values() for name in one.cameras))
    named = [
        Column("policy", "word"),
        Column("camera", "word"),
        *(Column(f"{name} camera", "word") for name in cameras),
    ]
    rows = [
        (
            spec,
            mark(one.camera.label),
            *(mark(one.cameras[name].label) if name in one.cameras else "—" for name in cameras),
            mark(one.state.label),
            mark(one.instruction.label),
            ", ".join(one.guards),
        )
        for spec, one in verdicts.items()
    ]
    rest = (Column("state", "word"), Column("instruction", "word"), Column("guards that failed"))
    return Table("policies", "what each channel is used for", (*named, *rest), tuple(rows))


def channel_table(verdicts: Verdicts) -> Table:
    """Return a policy a row, the share of its variation that goes with each channel."""
    names = list(dict.fromkeys(name for one in verdicts.values() for name in one.channels))
    rows = []
    for spec, one in verdicts.items():
        found = {} if one.guards else one.channels
        rows.append((spec, *(found.get(name) for name in names), _counts(found)))
    head = (Column("policy", "word"), *columns("estimate", *names), Column("n", "count"))
    note = "the share of the policy's own variation that goes when the channel is another episode's; 98 % intervals"
    if failed := [f"{spec} ({', '.join(one.guards)})" for spec, one in verdicts.items() if one.guards]:
        note = f"{note}; none of whose guard failed: {', '.join(failed)}"
    return Table("channels", "how much each channel carries", head, tuple(rows), note)


def _counts(channels: Mapping[str, Statistic]) -> str | int | None:
    """Return of how many frames the shares are; where they are of unlike numbers, the usual one and the others."""
    usual = Counter(one.n for one in channels.values()).most_common(1)
    if not usual:
        return None
    other = [f"{name} {one.n}" for name, one in channels.items() if one.n != usual[0][0]]
    return f"{usual[0][0]}; {', '.join(other)}" if other else usual[0][0]


def statistics_table(score: PolicyScore) -> Table:
    """Return every statistic of every policy, a row each."""
    rows = [
        (spec, name, *statistic_cells(one), one.note)
        for spec, policy in score.models.items()
        for name, one in policy.statistics.items()
    ]
    head = (Column("policy", "word"), Column("statistic", "word"), *STATISTIC, Column("note"))
    return Table("statistics", "every statistic", head, tuple(rows))


def parts_table(score: PolicyScore) -> Table:
    """Return the share of every channel by dimension of the motion."""
    space = score.bank.manifest.motion
    names = [] if space is None else [one.name for one in space.dimensions]
    rows: list[tuple[Cell, ...]] = [
        (*head, *(parts[part] for part in names)) for head, parts in _parts(score, "by_dimension", dict)
    ]
    head = (Column("policy", "word"), Column("condition", "word"), *columns("number", *names))
    return Table("dimensions", "how much of each dimension", head, tuple(rows))


def steps_table(score: PolicyScore) -> Table:
    """Return the share of every channel by step of the horizon; of a long one, so many steps of all its parts."""
    space = score.bank.manifest.motion
    horizon = 0 if space is None else space.horizon
    kept = sorted({round(turn * (horizon - 1) / max(1, _STEPS - 1)) for turn in range(min(horizon, _STEPS))})
    kept = list(range(horizon)) if horizon <= _STEPS else kept
    rows: list[tuple[Cell, ...]] = [
        (*head, *(parts[step] for step in kept)) for head, parts in _parts(score, "by_step", list)
    ]
    head = (Column("policy", "word"), Column("condition", "word"))
    named = columns("number", *(f"step {step + 1}" for step in kept))
    note = "" if horizon <= _STEPS else f"{len(kept)} of {horizon} steps; 'eyechart score RUN --json' has all (by_step)"
    return Table("steps", "how much of each step of the horizon", (*head, *named), tuple(rows), note)


_STEPS = 8
"""So many steps of a horizon stand in a table."""
P = TypeVar("P", list[float], dict[str, float])


def _parts(score: PolicyScore, by: str, kind: type[P]) -> Iterator[tuple[tuple[str, str], P]]:
    """Yield the parts of every share of every policy whose guards hold, with its SPEC and condition."""
    for spec, one in judge(score).items():
        for name, share in score.models[spec].statistics.items() if not one.guards else ():
            parts = (share.detail or {}).get(by)
            if name.startswith("T.") and isinstance(parts, kind):
                yield (spec, name.removeprefix("T.")), parts
