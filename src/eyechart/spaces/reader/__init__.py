"""Reading an action's name from the words of a reply, by the rules of a run's version.

Today's rules read a choice, not a word: a statement (JSON, tags, ``action:``), or else a choice in
prose. An older version is a module of its own that does not change.
"""

from eyechart.spaces.reader import version3
from eyechart.spaces.reader.action_names import ActionNames, spelled
from eyechart.spaces.reader.statements import read_words
from eyechart.spaces.space import Decision

READER = 4
"""The version of the reading rules, which a run records and is read by."""

READERS = (3, READER)
"""The versions that can read a reply."""

__all__ = ["READER", "READERS", "ActionNames", "read_by", "spelled"]


def read_by(version: int, visible: str, names: ActionNames) -> Decision[str]:
    """Return the decision in a reply's visible words, by one of ``READERS``."""
    if version == READER:
        return read_words(visible, names)
    return version3.read_words(visible, names.actions)
