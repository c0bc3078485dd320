"""Tables of policies: a verdict a row, the share of every channel and condition, and what every statistic is."""

from collections.abc import Mapping

from eyechart.report.table import STATISTIC, Column, Mark, Table, columns, statistic_cells
from eyechart.studies.policy.scoring import PolicyScore
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
    rows = [
        (spec, *(one.channels.get(name) for name in names), next(iter(one.channels.values())).n if one.channels else 0)
        for spec, one in verdicts.items()
    ]
    head = (Column("policy", "word"), *columns("estimate", *names), Column("n", "count"))
    note = "the share of the policy's own variation that goes when the channel is another episode's; 98 % intervals"
    return Table("channels", "how much each channel carries", head, tuple(rows), note)


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
    rows = []
    for spec, policy in score.models.items():
        for name, one in policy.statistics.items():
            parts = (one.detail or {}).get("by_dimension")
            if name.startswith("T.") and isinstance(parts, dict):
                rows.append((spec, name.removeprefix("T."), *(parts[part] for part in names)))
    head = (Column("policy", "word"), Column("condition", "word"), *columns("number", *names))
    return Table("dimensions", "how much of each dimension", head, tuple(rows))
