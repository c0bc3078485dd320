"""The corpus of replies in spaces of numbers, letters and phrases: its spaces, its two readers' labels, what is read.

`marks/spaces.md` says what both readers were told. Most of each set is open; four parts were counted once before any
rule was changed by them.
"""

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from eyechart.calls import Reply
from eyechart.spaces.discrete import Discrete

MARKS = Path(__file__).parent / "spaces" / "marks"
SETS = ("numbers", "letters", "phrases")


def _of_unit(names: tuple[str, ...], unit: str) -> tuple[tuple[str, str], ...]:
    return tuple((f"{name} {unit}", name) for name in names)


_DEGREES = ("-30", "-15", "0", "15", "30")
_SPEEDS = ("0.5", "1", "1.5", "2")
_EACH = (
    Discrete("ids", ("0", "1", "2", "3", "4"), (("0", "2"),), ("4",), ("1", "3")),
    Discrete("bins", ("-2", "-1", "0", "1", "2"), (("-2", "2"), ("-1", "1")), (), ()),
    Discrete("degrees", _DEGREES, (("-30", "30"), ("-15", "15")), (), (), _of_unit(_DEGREES, "degrees")),
    Discrete("gears", _SPEEDS, (), (), (), _of_unit(_SPEEDS, "m/s")),
    Discrete("letters", ("A", "B", "C", "D", "E"), (("A", "E"), ("B", "D")), (), ()),
    Discrete("letters7", ("A", "B", "C", "D", "E", "F", "G"), (("A", "G"), ("B", "F"), ("C", "E")), (), ()),
    Discrete("moves", ("TURN LEFT", "TURN RIGHT", "GO FORWARD", "STOP", "GO BACK"), (), ("STOP",), ()),
    Discrete("rooms", ("ENTER THE DOOR", "FOLLOW THE WALL", "WAIT HERE", "ASK FOR HELP"), (), (), ()),
    Discrete(
        "lanes", ("KEEP LANE", "CHANGE LANE LEFT", "CHANGE LANE RIGHT", "SLOW DOWN", "EMERGENCY STOP"), (), (), ()
    ),
)
SPACES = {space.name: space for space in _EACH}
"""The spaces of the corpus, by name. What has a unit has it in its aliases, as the prompt said it."""


@dataclass(frozen=True)
class Marked:
    """A reply, and the label of each of two readers."""

    space: str
    text: str
    first: str | None
    second: str | None

    @property
    def read(self) -> str | None:
        """Return the action that is read in it."""
        return SPACES[self.space].read(Reply(self.text, "stop", None)).action

    @property
    def agreed(self) -> bool:
        """Return whether both readers chose the same action."""
        return self.first is not None and self.first == self.second

    def is_wrong(self, found: str | None) -> bool:
        """Return whether an action was found that is neither reader's, or not what both say."""
        return found is not None and (found not in {self.first, self.second} or (self.agreed and found != self.first))


def marked(part: str, kind: str) -> tuple[Marked, ...]:
    """Return the replies of a part, "open" or one of those that were kept, of one of the sets."""
    lines = (MARKS / f"{part}_{kind}.jsonl").read_text(encoding="utf-8").splitlines()
    return tuple(Marked(**json.loads(line)) for line in lines)


def counted(replies: Iterable[Marked]) -> dict[str, int | float]:
    """Return of some replies how many there are, how many are read, rightly and wrongly, and two shares of them."""
    found = [(reply, reply.read) for reply in replies]
    read = [(one, action) for one, action in found if action is not None]
    wrong = sum(one.is_wrong(action) for one, action in read)
    agreed = [action == one.first for one, action in found if one.agreed]
    return {
        "replies": len(found),
        "both agree": sum(one.first == one.second for one, _ in found),
        "both choose the same action": len(agreed),
        "read": len(read),
        "wrong": wrong,
        "recall": round(sum(agreed) / len(agreed), 4),
        "precision": round(1 - wrong / len(read), 4),
    }
