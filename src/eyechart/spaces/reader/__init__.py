"""How the name of an action is read from the words of a reply: by today's rules, and by those of older runs.

A run is read by the version that it was begun under. Today's rules take a choice, not a word: what is stated (JSON,
tags, ``action:``), else what prose chooses. An older version is a module of its own that changes no more.
"""

from eyechart.spaces.reader import version3
from eyechart.spaces.reader.names import Names, spelled
from eyechart.spaces.reader.stated import read_words
from eyechart.spaces.space import Decision

READER = 4
"""The version of the rules of reading. A run records it, and is read by the version that it was begun under."""

READERS = (3, READER)
"""The versions by which a reply can be read."""

__all__ = ["READER", "READERS", "Names", "read_by", "spelled"]


def read_by(version: int, visible: str, names: Names) -> Decision[str]:
    """Return the decision that the visible words of a reply hold, by a version of the rules, one of ``READERS``."""
    if version == READER:
        return read_words(visible, names)
    return version3.read_words(visible, names.actions)
