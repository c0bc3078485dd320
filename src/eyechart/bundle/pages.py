"""Compare two report pages tag by tag, and name each difference by its figure."""

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from html import unescape
from itertools import chain
from typing import Any

from eyechart.bundle.differences import (
    Path,
    PrintedDifference,
    RoundedNumbers,
    compare_values,
    first_difference,
    is_same_drawing,
    is_same_writing,
    skeleton,
)
from eyechart.report.page import embedded_json, unpack

_DATA = re.compile(r'(<script type="application/json" id="data">)(.*?)(</script>)', re.DOTALL)
_PACKED = re.compile(r'(<script type="application/octet-stream" id="packed">)(.*?)(</script>)', re.DOTALL)
_TOKEN = re.compile(r"<!--.*?-->|<[!?/]?[a-zA-Z][^>]*>|[^<]+|<", re.DOTALL)
_TAG = re.compile(r"</?([\w:-]+)")
_ATTRIBUTE = re.compile(r'([^\s"=<>/]+)(?:="([^"]*)")?')
_PICTURE = re.compile(r'"data:image/[^"]*"')
_MOST_UNPACKED = 1_000_000_000
_LONGER = 8
"""Most bytes of unpacked page data per character of the recomputed data."""
_DRAWN = {"d", "x", "y", "width", "height", "transform", "style", "points", "viewBox"}
_LABELS = {"caption", "h3", "title", "dt", "th"}


@dataclass(frozen=True, slots=True)
class Token:
    """A tag, a comment or a text of a page, with its place; ``drawn`` inside a drawing."""

    text: str
    where: str
    drawn: bool

    @property
    def shape(self) -> str:
        """Return the part that is equal in two pages of one structure; the same for any text."""
        if self.text.startswith("<!--"):
            return f"comment {self.text[4:-3].strip()}"
        tag = _TAG.match(self.text)
        if tag is None:
            return self.text if self.text.startswith("<") else ""
        return f"{'end' if self.text.startswith('</') else 'element'} {tag[1]}"

    @property
    def words(self) -> str:
        """Return the token in words."""
        return self.shape or unescape(self.text).strip()

    @property
    def attributes(self) -> list[tuple[str, str]]:
        """Return a tag's attributes in order."""
        return [(name, unescape(value)) for name, value in _ATTRIBUTE.findall(self.text.partition(" ")[2])]


class _Place:
    """The section, card, figure, table, row and column of the current position in a page."""

    def __init__(self) -> None:
        self.section = self.card = self.figure = self.caption = self.row = self.term = self.inside = ""
        self.columns: list[str] = []
        self.column, self.head, self.drawn = -1, False, False

    def read(self, text: str) -> None:
        """Move on by a token."""
        tag = _TAG.match(text)
        if tag is None:
            self._name(" ".join(unescape(text).split()))
        elif text.startswith("</"):
            self._close(tag[1])
        else:
            self._open(tag[1], text)

    def _open(self, tag: str, text: str) -> None:
        identity = re.search(r' id="([^"]*)"', text)
        if tag == "section":
            self.section, self.card = identity[1] if identity else "", ""
        elif tag == "article":
            self.card = identity[1] if identity else ""
        elif tag == "svg":
            self.figure, self.drawn = "", True
        elif tag == "table":
            self.caption, self.columns = "", []
        elif tag == "tr":
            self.row, self.column = "", -1
        self.column += tag in {"td", "th"}
        self.head = self.head or tag == "thead"
        self.inside = tag if tag in _LABELS else self.inside

    def _close(self, tag: str) -> None:
        if tag == "svg":
            self.figure, self.drawn = "", False
        elif tag == "table":
            self.caption, self.row, self.columns, self.column = "", "", [], -1
        elif tag == "dd":
            self.term = ""
        elif tag == "article":
            self.card = ""
        self.head = self.head and tag != "thead"
        self.inside = "" if tag == self.inside else self.inside

    def _name(self, words: str) -> None:
        """Keep a text that names the parts after it."""
        if self.inside == "title" and self.drawn:
            self.figure = words
        elif self.inside == "caption":
            self.caption = f"{self.caption} {words}".strip()
        elif self.inside == "th" and self.head and words:
            self.columns.append(words)
        elif self.inside == "th":
            self.row = f"{self.row} {words}".strip()
        elif self.inside == "dt" and words:
            self.term = words
        elif self.inside == "h3" and self.card and words:
            self.card = f"verdict card of {words}"

    def __str__(self) -> str:
        column = self.columns[self.column] if 0 <= self.column < len(self.columns) else ""
        figure = f"figure '{self.figure}'" if self.figure else ""
        table = f"table '{self.caption}'" if self.caption else ""
        parts = ["report.html", self.section, self.card, figure, table, self.row, column, self.term]
        return ", ".join(part for part in parts if part)


def tokens_of(html: str) -> Iterator[Token]:
    """Yield the tokens of a page, without the data of its frame browser."""
    place = _Place()
    for found in _TOKEN.finditer(_PACKED.sub(r"\1\3", _DATA.sub(r"\1\3", html, count=1), count=1)):
        place.read(found.group())
        yield Token(found.group(), str(place), place.drawn)


@dataclass(frozen=True, slots=True)
class Tolerance:
    """Whether to compare positions in ``drawings`` and ``pictures``, which libraries change."""

    drawings: bool
    pictures: bool

    def kept(self, html: str) -> list[Token]:
        """Return the tokens to compare; without ``drawings``, only the words of each drawing."""
        every = tokens_of(html if self.pictures else _PICTURE.sub('""', html))
        return [
            token for token in every if self.drawings or not token.drawn or (not token.shape and token.text.strip())
        ]


def compare_pages(
    printed: str, recomputed: str, rounding: RoundedNumbers, how: Tolerance
) -> Iterator[PrintedDifference]:
    """Yield the differences of two pages, each with its section, figure, table, row and column."""
    if printed == recomputed:
        return
    yield from _compare_data(printed, recomputed, rounding, how)
    mine, theirs = how.kept(printed), how.kept(recomputed)
    shapes = [[one.shape for one in side] for side in (mine, theirs)]
    if shapes[0] != shapes[1]:
        place = first_difference(*shapes)
        end = Token("", "report.html", drawn=False)
        ends = [side[place] if place < len(side) else end for side in (mine, theirs)]
        yield PrintedDifference(ends[1].where, *(one.words for one in ends))
        mine, theirs = mine[:place], theirs[:place]
    for one, other in zip(mine, theirs, strict=True):
        if one.text != other.text:
            yield from _compare_tokens(one, other, rounding, how)


def _compare_tokens(
    token: Token, other: Token, rounding: RoundedNumbers, how: Tolerance
) -> Iterator[PrintedDifference]:
    if not other.shape:
        weighed = " MB before base64" in other.text and not how.pictures
        if not rounding.is_same(token.text, other.text) and not weighed:
            yield PrintedDifference(other.where, token.words, other.words)
        return
    mine, theirs = dict(token.attributes), dict(other.attributes)
    unlike = [
        name
        for name in [*theirs, *(name for name in mine if name not in theirs)]
        if not _is_same_attribute(name, mine.get(name), theirs.get(name), rounding, drawn=other.drawn)
    ]
    for name in unlike:
        words = f"{other.where}, {other.shape.partition(' ')[2]} {name}"
        yield PrintedDifference(words, str(mine.get(name)), str(theirs.get(name)))
    if not unlike and (skeleton(token.text) != skeleton(other.text) or len(token.attributes) != len(other.attributes)):
        yield PrintedDifference("report.html, its markup", "written in another way", "as a report is written")


def _is_same_attribute(
    name: str, mine: str | None, theirs: str | None, rounding: RoundedNumbers, *, drawn: bool
) -> bool:
    if mine is None or theirs is None:
        return False
    return is_same_drawing(mine, theirs) if drawn and name in _DRAWN else rounding.is_same(mine, theirs)


def _compare_data(
    printed: str, recomputed: str, rounding: RoundedNumbers, how: Tolerance
) -> Iterator[PrintedDifference]:
    try:
        own = list(_blocks(recomputed, _MOST_UNPACKED))
        given = list(_blocks(printed, _LONGER * (1 + sum(map(len, own)))))
        if given == own and {*own} <= {"null"}:  # no frame browser, as for scene estimates
            return
        mine, theirs = (
            dict[str, Any](chain.from_iterable(json.loads(one).items() for one in side)) for side in (given, own)
        )
        written = all(is_same_writing(json.loads(block), block, embedded_json) for block in given)
    except (ValueError, AttributeError, RecursionError):
        yield PrintedDifference("report.html, frames", "data that cannot be read", "the calls of the ledger")
        return
    if not written:
        yield PrintedDifference("report.html, frames, data", "written in another way", "as a report writes them")
    if not how.pictures:
        for side in (mine, theirs):
            side.pop("pictures", None)
    yield from compare_values(mine, theirs, rounding, lambda path: f"report.html, frames, {_named(theirs, path)}")


def _blocks(html: str, most: int) -> Iterator[str]:
    """Yield a page's data as JSON, also its packed part up to ``most`` bytes, or ValueError."""
    if plain := _DATA.search(html):
        yield plain.group(2)
    if packed := _PACKED.search(html):
        yield unpack(packed.group(2), most)


def _named(data: Mapping[str, Any], path: Path) -> str:
    """Return in words a place in the frame browser's data: call, frame, picture or episode."""
    if "runs" not in data:
        return _of_episodes(data, path)
    used = next((words for kind, number, words in _used(data) if (kind, number) == path[:2]), None)
    if used is not None:
        return used
    if path[0] != "runs" or len(path) < 4:
        return " ".join(map(str, path))
    run, (part, place, *more) = data["runs"][path[1]], path[2:]
    if part == "models" and len(more) > 2 and more[0] == "calls":
        return f"{run['models'][place]['name']}, {more[1]}, frame {run['frames'][more[2]]['id']}"
    if part == "frames":
        return f"frame {run['frames'][place]['id']}, {' '.join(map(str, more))}"
    return " ".join(map(str, path[2:]))


def _of_episodes(data: Mapping[str, Any], path: Path) -> str:
    """Return in words a place in the episode browser's data."""
    if path[0] != "episodes" or len(path) < 2:
        return " ".join(map(str, path))
    return " ".join(["episode", f"'{data['episodes'][path[1]]['id']}'", *map(str, path[2:])])


def _used(data: Mapping[str, Any]) -> Iterator[tuple[str, int, str]]:
    """Yield every use of a picture or a text by a frame, with its number and in words."""
    for run in data["runs"]:
        ids = [frame["id"] for frame in run["frames"]]
        for name, numbers in run["pictures"].items():
            for number, frame in zip(numbers, ids, strict=True):
                yield "pictures", number, f"picture of frame {frame} under {name}"
        for model in run["models"]:
            for name, calls in model["calls"].items():
                where = [f"{model['name']}, {name}, frame {one}, reply" for one in ids]
                yield from (("texts", call[0], words) for call, words in zip(calls, where, strict=True) if call)
