"""Tables of policies: verdicts, the share of every channel and condition, and all statistics."""

from collections import Counter
from collections.abc import Iterator, Mapping
from typing import TypeVar

from eyechart.report.table import STATISTIC, Cell, Column, Mark, Table, columns, in_words, statistic_cells
from eyechart.stats.shares import shown_share
from eyechart.stats.statistic import Statistic
from eyechart.studies.policy.scores import PolicyScore, judge
from eyechart.verdicts.labels import USES
from eyechart.verdicts.policy_verdict import PolicyVerdict

Verdicts = Mapping[str, PolicyVerdict]


def mark(label: str) -> Mark:
    """Return a label in the colours of its family; failed guards are marked as open."""
    return Mark(label, USES[label].family if label in USES else "open")


def verdict_table(verdicts: Verdicts) -> Table:
    """Return a policy a row, an axis a column."""
    cameras = list(dict.fromkeys(name for verdict in verdicts.values() for name in verdict.cameras))
    named = [
        Column("policy", "word"),
        Column("camera", "word"),
        *(Column(f"{name} camera", "word") for name in cameras),
    ]
    rows = [
        (
            spec,
            mark(verdict.camera.label),
            *(mark(verdict.cameras[name].label) if name in verdict.cameras else "—" for name in cameras),
            mark(verdict.state.label),
            mark(verdict.instruction.label),
            ", ".join(verdict.guards),
        )
        for spec, verdict in verdicts.items()
    ]
    rest = (Column("state", "word"), Column("instruction", "word"), Column("guards that failed"))
    return Table("policies", "what each channel is used for", (*named, *rest), tuple(rows))


def channel_table(verdicts: Verdicts) -> Table:
    """Return the share of variation that goes with each channel, a policy a row."""
    names = list(dict.fromkeys(name for verdict in verdicts.values() for name in verdict.channels))
    rows = []
    for spec, one in verdicts.items():
        found = {} if one.guards else one.channels
        rows.append((spec, *(found.get(name) for name in names), _counts(found)))
    head = (Column("policy", "word"), *columns("estimate", *names, least=0.0), Column("n", "count"))
    note = "the share of the policy's own variation that goes with a channel of another episode; 98 % intervals"
    if failed := [f"{spec} ({', '.join(verdict.guards)})" for spec, verdict in verdicts.items() if verdict.guards]:
        note = f"{note}; not computed where a guard failed: {', '.join(failed)}"
    return Table("channels", "how much each channel carries", head, tuple(rows), note)


def _counts(channels: Mapping[str, Statistic]) -> str | int | None:
    """Return the number of frames of the shares; exceptions are listed."""
    usual = Counter(channel.n for channel in channels.values()).most_common(1)
    if not usual:
        return None
    other = [f"{name} {channel.n}" for name, channel in channels.items() if channel.n != usual[0][0]]
    return f"{usual[0][0]}; {', '.join(other)}" if other else usual[0][0]


def statistics_table(score: PolicyScore) -> Table:
    """Return every statistic of every policy, a row each."""
    rows = [
        (spec, name, *statistic_cells(statistic), statistic.note)
        for spec, policy in score.models.items()
        for name, statistic in policy.statistics.items()
    ]
    head = (Column("policy", "word"), Column("statistic", "word"), *STATISTIC, Column("note"))
    below = any(
        one.value is not None and one.value < 0 and not _may_be_below_0(name)
        for policy in score.models.values()
        for name, one in policy.statistics.items()
    )
    note = "a share below 0 is the estimate of one near 0 of drawn answers: read it as 0" if below else ""
    return Table("statistics", "every statistic", head, tuple(rows), note)


def deciding_table(spec: str, statistics: Mapping[str, Statistic], verdict: PolicyVerdict) -> Table:
    """Return the at most five statistics that decided, or could have, each with its meaning."""
    decided = [axis.by for axis in verdict.axes.values()]
    there = [name for name in dict.fromkeys((*decided, *_MAIN)) if name in statistics][:_SHOWN]
    rows = []
    for name in there:
        one = statistics[name]
        axes = [axis for axis, judged in verdict.axes.items() if judged.by == name]
        did = f"decided {' and '.join(axes)}: " if axes else ""
        is_ = MEANINGS.get(meant_by(name), "").replace("the same,", "the share of its own variation that goes,")
        rows.append((name, in_words(one if _may_be_below_0(name) else shown_share(one)), f"{did}{is_}"))
    made = (Column("statistic", "word"), Column("value"), Column("what it did, and is"))
    return Table("deciding", spec, made, tuple(rows))


def _may_be_below_0(name: str) -> bool:
    """Return whether a statistic is a difference, or goes along with something or against it."""
    return name.startswith(("beyond", "follow", "shapley"))


_MAIN = ("misfit", "noise", "T.swapped@cameras", "T.matched@cameras", "T.blank", "T.swapped@state")
"""What is listed after the statistics that decided."""
_SHOWN = 5


MEANINGS: Mapping[str, str] = {
    "motions": "the share of calls that came back with a motion: finite, and of the bank's shape",
    "misfit": "squared error to the logged motions over their variance; 1 is what the log's mean has",
    "variation": "how much the policy varies between episodes, over how much the log does",
    "noise": "the share of the variation without any change",
    "memory": "the share of the noise that goes with the call before",
    "T.swapped": "the share of the policy's own variation that goes when the channel is another episode's",
    "T.matched": "the same, with the moment of another episode that has the nearest state",
    "T.near": "the same, with a moment of its own episode, at least as far off in its state as the matched one",
    "T.kept": "the same, with this channel its own and all others another episode's",
    "T.alone": "the same, with this channel alone from the moment that lends its pictures in swapped@cameras",
    "T.blank": "the same, with grey pictures, of all cameras or of one",
    "T.nudged": "the same, with one value of one pixel one level off: other bytes, the same pictures",
    "T.noise": "the same, with noise for pictures, of all cameras or of one",
    "T.frozen": "the same, with the oldest picture of the window at every instant, as of a still camera",
    "T.exchanged": "the same, with the objects' colours exchanged in the pictures, or in those of one camera",
    "T.recoloured": "the same, on another table",
    "T.decoys": "the same, with further objects in the pictures",
    "reads": "for places: the share of the raw answers, not relative to the state, that goes with another state",
    "beyond": "the share with pictures at a similar state, less that with its own episode's: the part without the pose",
    "swapped.alike": "the share with any other episode's pictures, on the moments that have one at a similar state",
    "responds": "the share of episodes in which the channel carries .10 or more under any condition of its label; "
    "its upper bound holds for the whole data set",
    "responds.shown": "the same, without grey pictures",
    "responds.alike": "the same, at a similar state alone",
    "follow.named": "how far the answer goes along with the named object, as a share of the oracle's way",
    "follow.other": "the same, of the other object",
    "follow.told": "how much farther it goes with the named object, over both instructions",
    "follow.rather": "how much farther it goes with the named object than with the other",
    "follow.logged": "how much nearer its own instruction brings the answer to the log than another one",
    "mirror": "how far the answer to the mirrored moment is from the reflected answer, over the variation",
    "shapley": "the channel's Shapley share; those of cameras, state and instruction sum to 1",
}
"""The meaning of each statistic, by its name without channel; see docs/policy-reference.md."""


def meaning_table(score: PolicyScore) -> Table:
    """Return the meaning of each statistic of a run, a row each."""
    names = dict.fromkeys(meant_by(name) for model in score.models.values() for name in model.statistics)
    rows = tuple((name, MEANINGS[name]) for name in names if name in MEANINGS)
    note = "the name after @ is the exchanged channel or camera"
    return Table("meanings", "what each statistic is", (Column("statistic", "word"), Column("what it is")), rows, note)


def meant_by(name: str) -> str:
    """Return a statistic's key in `MEANINGS`: ``T.blank@top`` has ``T.blank``."""
    return "shapley" if name.startswith("shapley.") else name.partition("@")[0]


def parts_table(score: PolicyScore) -> Table:
    """Return the share of every channel by dimension of the motion."""
    space = score.bank.manifest.motion
    names = [] if space is None else [*space.parts]
    rows: list[tuple[Cell, ...]] = [
        (*head, *(parts[part] for part in names)) for head, parts in _parts(score, "by_dimension", dict)
    ]
    head = (Column("policy", "word"), Column("condition", "word"), *columns("number", *names, least=0.0))
    return Table("dimensions", "how much of each dimension", head, tuple(rows))


def steps_table(score: PolicyScore) -> Table:
    """Return each channel's share by step of the horizon; a long one is sampled evenly."""
    space = score.bank.manifest.motion
    horizon = 0 if space is None else space.horizon
    kept = sorted({round(turn * (horizon - 1) / max(1, _STEPS - 1)) for turn in range(min(horizon, _STEPS))})
    kept = list(range(horizon)) if horizon <= _STEPS else kept
    rows: list[tuple[Cell, ...]] = [
        (*head, *(parts[step] for step in kept)) for head, parts in _parts(score, "by_step", list)
    ]
    head = (Column("policy", "word"), Column("condition", "word"))
    named = columns("number", *(f"step {step + 1}" for step in kept), least=0.0)
    note = "" if horizon <= _STEPS else f"{len(kept)} of {horizon} steps; 'eyechart score RUN --json' has all (by_step)"
    return Table("steps", "how much of each step of the horizon", (*head, *named), tuple(rows), note)


_STEPS = 8
"""The most steps of a horizon in a table."""
P = TypeVar("P", list[float], dict[str, float])


def _parts(score: PolicyScore, by: str, kind: type[P]) -> Iterator[tuple[tuple[str, str], P]]:
    """Yield the parts of each share, with SPEC and condition, if the guards hold."""
    for spec, one in judge(score).items():
        for name, share in score.models[spec].statistics.items() if not one.guards else ():
            parts = (share.detail or {}).get(by)
            if name.startswith("T.") and isinstance(parts, kind):
                yield (spec, name.removeprefix("T.")), parts
