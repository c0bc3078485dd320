"""The corpus of replies, the action spaces it is about, and replies made from it by mutation."""

import hashlib
import json
import random
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from eyechart.calls import Reply
from eyechart.spaces.discrete import DRIVING, Discrete
from eyechart.spaces.space import MISSING

CORPUS = Path(__file__).parent / "spaces" / "replies.jsonl"
HARD = CORPUS.with_name("hard_replies.jsonl")

SPACES = {
    "drive": DRIVING,
    "ship": Discrete(
        "ship", ("HALT", "CRAWL", "GO", "PORT", "STARBOARD"), (("PORT", "STARBOARD"),), ("HALT",), ("GO",)
    ),
    "fork": Discrete(
        "fork", ("HALT", "CREEP", "ROLL", "LIFT", "SWING PORT", "SWING STARBOARD"), (), ("HALT", "CREEP"), ("ROLL",)
    ),
    "gym": Discrete("gym", ("LANE_LEFT", "IDLE", "LANE_RIGHT", "FASTER", "SLOWER"), (), ("SLOWER",), ("FASTER",)),
    "colour": Discrete(
        "colour", ("RED", "GREEN", "BLUE", "YELLOW", "ORANGE", "PURPLE", "BLACK", "WHITE", "NONE"), (), (), ()
    ),
    "de": Discrete("de", ("HALT", "LANGSAM", "GERADEAUS", "LINKS", "RECHTS"), (("LINKS", "RECHTS"),), ("HALT",), ()),
    "jp": Discrete("jp", ("停止", "減速", "直進", "左", "右"), (("左", "右"),), ("停止", "減速"), ()),
}
"""The action spaces of the corpus, by name."""

PARTS = ("seen", "held back", "hard")

_SIGNS = (
    *"{}[]()<>\"'`*_~|/\\=:;,.!?-\n\t @#&%^\x00\x1b\u200b\u202e\u2028\ufeff\u0130\ufb01\U0001f6d1e\u0301",
    "\ud800",
    "```",
    "<think>",
    "</think>",
    "<answer>",
    "ACTION: ",
    '{"action": "',
    " not ",
    " if ",
    " so ",
    "n't ",
    " or ",
    "。",
    "：",
    "\\boxed{",
    "<|channel|>",
)


class Written(Protocol):
    """A reply of a corpus, and the name of its space."""

    @property
    def space(self) -> str:
        """The name."""

    @property
    def text(self) -> str:
        """The verbatim text."""


@dataclass(frozen=True)
class Labelled:
    """A reply of the corpus, what a reader made of it in two passes, and the file that it is of."""

    space: str
    text: str
    first: str | None
    second: str | None
    hard: bool = False

    @property
    def part(self) -> str:
        """Return the part of the corpus it is of: by its file, and of the first file by the hash of its text."""
        return PARTS[2] if self.hard else PARTS[int(hashlib.sha256(self.text.encode()).hexdigest(), 16) % 3 == 0]


def read_corpus() -> tuple[Labelled, ...]:
    """Return the replies of the corpus in the order of its files."""
    both = ((CORPUS, False), (HARD, True))
    return tuple(
        Labelled(**json.loads(line), hard=hard)
        for file, hard in both
        for line in file.read_text(encoding="utf-8").splitlines()
    )


def mutated(corpus: tuple[Written, ...], seed: int) -> tuple[str, str]:
    """Return the name of a space, and a reply made for it from some of the corpus; the same for the same seed."""
    dice = random.Random(seed)  # noqa: S311 - no secret
    one = dice.choice(corpus)
    text = one.text
    for _ in range(dice.randint(1, 6)):
        text = dice.choice(_CHANGES)(text, dice, corpus)[:4000]
    return one.space, text


def _cut(text: str, dice: random.Random, corpus: tuple[Written, ...]) -> str:
    del corpus
    start, end = sorted((dice.randint(0, len(text)), dice.randint(0, len(text))))
    return text[:start] + text[end:]


def _insert(text: str, dice: random.Random, corpus: tuple[Written, ...]) -> str:
    del corpus
    at = dice.randint(0, len(text))
    return text[:at] + dice.choice(_SIGNS) * dice.choice((1, 1, 1, 2, 40)) + text[at:]


def _join(text: str, dice: random.Random, corpus: tuple[Written, ...]) -> str:
    other = dice.choice(corpus).text
    return dice.choice((text + dice.choice(("", " ", "\n", ". ", ", ")) + other, other[: len(other) // 2] + text))


def _repeat(text: str, dice: random.Random, corpus: tuple[Written, ...]) -> str:
    del corpus
    start, end = sorted((dice.randint(0, len(text)), dice.randint(0, len(text))))
    return text[:end] + text[start:end] * dice.randint(1, 5) + text[end:]


def _turn(text: str, dice: random.Random, corpus: tuple[Written, ...]) -> str:
    del corpus
    return dice.choice((text.upper(), text.lower(), text.swapcase(), text[::-1], text.title()))


def _shuffle(text: str, dice: random.Random, corpus: tuple[Written, ...]) -> str:
    del corpus
    words = text.split(" ")
    dice.shuffle(words)
    return " ".join(words)


def _random(text: str, dice: random.Random, corpus: tuple[Written, ...]) -> str:
    del corpus
    at = dice.randint(0, len(text))
    return (
        text[:at]
        + "".join(chr(dice.choice((dice.randrange(0x3000), dice.randrange(0x110000)))) for _ in range(5))
        + text[at:]
    )


_CHANGES = (_cut, _insert, _join, _repeat, _turn, _shuffle, _random)


def wrong(space: Discrete, text: str) -> str | None:
    """Return what is wrong with how a reply is read: no action and no reason, or not the same twice; else None."""
    found = space.read(Reply(text, "stop", None))
    if (found.action is None) != (found.missing in MISSING) or found.action not in {None, *space.actions}:
        return f"{found} is no decision"
    again = Discrete(f"{space.name} again", *(getattr(space, name) for name in _ROLES)).read(Reply(text, "stop", None))
    return None if again == found else f"{found}, and then {again}"


_ROLES = ("actions", "mirror_pairs", "brake", "proceed", "aliases")


def count_wrong(corpus: tuple[Written, ...], seeds: range, spaces: Mapping[str, Discrete] = SPACES) -> Iterator[str]:
    """Yield the seed and what is wrong, for each mutated reply with which something is; an exception is wrong too."""
    for seed in seeds:
        named, text = mutated(corpus, seed)
        space = spaces[named]
        try:
            found = wrong(space, text)
        except Exception as error:  # noqa: BLE001 - any at all is what is looked for
            found = repr(error)
        if found is not None:
            yield f"{seed}: {found}"
