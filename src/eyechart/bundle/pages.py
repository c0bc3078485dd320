"""Comparing two report pages element by element, so that a difference can be named by the figure that it is in."""

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from html.parser import HTMLParser

from eyechart.bundle.comparing import (
    Difference,
    Path,
    Rounding,
    compare_values,
    first_difference,
    same_drawing,
    skeleton,
)
from eyechart.report.page import embedded_json

_DATA = re.compile(r'(<script type="application/json" id="data">)(.*?)(</script>)', re.DOTALL)
_VOID = {"meta", "img", "input", "br", "link", "hr"}
_DRAWN = {"d", "x", "y", "width", "height", "transform", "style", "points", "viewbox"}
_LABELS = {"caption", "h2", "h3", "h4", "title", "summary", "dt", "th"}
_HELD = "data:image/"


@dataclass(frozen=True, slots=True)
class Leaf:
    """One thing in a page: a piece of text, an opening element with its attributes, a closing one, or a remark."""

    where: str
    kind: str
    what: str
    attributes: tuple[tuple[str, str], ...] = ()
    drawn: bool = False


@dataclass
class _Reader(HTMLParser):
    """Reads a page into leaves, and keeps in mind the section, figure, table, row and column that it is in."""

    leaves: list[Leaf] = field(default_factory=list)

    def __post_init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self._open: list[str] = []
        self._section = self._card = self._caption = self._drawing = self._row = self._term = ""
        self._columns: list[str] = []
        self._column = -1

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Keep an opening element."""
        given = tuple((name, value or "") for name, value in attrs)
        if tag not in _VOID:
            self._open.append(tag)
        self._place(tag, dict(given))
        self.leaves.append(Leaf(self._where(), "element", tag, given, "svg" in self._open))

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Keep an element without content."""
        given = tuple((name, value or "") for name, value in attrs)
        self.leaves.append(Leaf(self._where(), "element", tag, given, "svg" in self._open))

    def _place(self, tag: str, attributes: dict[str, str]) -> None:
        if tag == "section":
            self._section, self._card = attributes.get("id", ""), ""
        elif tag in {"article", "div"} and "card" in attributes.get("class", "").split():
            self._card = attributes.get("id", "")
        elif tag == "svg":
            self._drawing = ""
        elif tag == "table":
            self._caption, self._columns = "", []
        elif tag == "tr":
            self._row, self._column = "", -1
        elif tag in {"td", "th"}:
            self._column += 1

    def handle_endtag(self, tag: str) -> None:
        """Keep a closing element."""
        self.leaves.append(Leaf(self._where(), "end", tag, (), "svg" in self._open))
        if tag in self._open:
            while self._open and self._open.pop() != tag:
                pass
        if tag == "svg":
            self._drawing = ""
        if tag == "table":
            self._caption = self._row = ""
            self._columns, self._column = [], -1
        if tag == "dd":
            self._term = ""
        if tag == "article":
            self._card = ""

    def handle_data(self, data: str) -> None:
        """Keep a text, and what it names for those after it."""
        around = next((tag for tag in reversed(self._open) if tag in _LABELS), "")
        text = " ".join(data.split())
        if text:
            self._name(around, text)
        self.leaves.append(Leaf(self._where(), "text", data, (), "svg" in self._open))

    def _name(self, around: str, text: str) -> None:
        if around == "title" and "svg" in self._open:
            self._drawing = text
        elif around == "caption":
            self._caption = f"{self._caption} {text}".strip()
        elif around == "th" and "thead" in self._open:
            self._columns.append(text)
        elif around == "th":
            self._row = f"{self._row} {text}".strip()
        elif around == "dt":
            self._term = text
        elif around == "h3" and self._card:
            self._card = f"verdict card of {text}"

    def handle_comment(self, data: str) -> None:
        """Keep a comment."""
        self.leaves.append(Leaf(self._where(), "comment", data))

    def handle_decl(self, decl: str) -> None:
        """Keep a declaration."""
        self.leaves.append(Leaf(self._where(), "declaration", decl))

    def unknown_decl(self, data: str) -> None:
        """Keep a declaration that is none."""
        self.leaves.append(Leaf(self._where(), "declaration", data))

    def handle_pi(self, data: str) -> None:
        """Keep a processing instruction."""
        self.leaves.append(Leaf(self._where(), "instruction", data))

    def _where(self) -> str:
        column = self._columns[self._column] if 0 <= self._column < len(self._columns) else ""
        figure = f"figure '{self._drawing}'" if self._drawing else ""
        table = f"table '{self._caption}'" if self._caption else ""
        parts = ["report.html", self._section, self._card, figure, table, self._row, column, self._term]
        return ", ".join(part for part in parts if part)


def leaves_of(html: str) -> list[Leaf]:
    """Return what stands in a page, without the data of its browser of frames."""
    reader = _Reader()
    reader.feed(_DATA.sub(r"\1\3", html, count=1))
    reader.close()
    return reader.leaves


@dataclass(frozen=True, slots=True)
class Strictness:
    """What is compared: the places in ``drawings`` and the bytes of ``pictures`` hang on libraries' versions."""

    drawings: bool
    pictures: bool


def compare_pages(printed: str, recomputed: str, rounding: Rounding, how: Strictness) -> Iterator[Difference]:
    """Yield where two pages differ, each difference with the section, figure, table, row and column it is in."""
    if printed == recomputed:
        return
    found = [*_compare_data(printed, recomputed, rounding, how), *_compare_leaves(printed, recomputed, rounding, how)]
    yield from found
    if not found and _skeleton(printed, how) != _skeleton(recomputed, how):
        # Browsers read what this parser overlooks, so that equal leaves are not enough.
        yield Difference("report.html, its markup", "written in another way", "as a report is written")


def _skeleton(html: str, how: Strictness) -> str:
    html = _DATA.sub(r"\1\3", html, count=1)
    if not how.drawings:
        html = re.sub(r"<svg[ >].*?</svg>", "", html, flags=re.DOTALL)
    if not how.pictures:
        html = re.sub(r'"data:image/[^"]*"', '""', html)
    return skeleton(html)


def _compare_leaves(printed: str, recomputed: str, rounding: Rounding, how: Strictness) -> Iterator[Difference]:
    mine, theirs = (_kept(leaves_of(html), how) for html in (printed, recomputed))
    shapes = [[(leaf.kind, leaf.what if leaf.kind != "text" else "") for leaf in leaves] for leaves in (mine, theirs)]
    if shapes[0] != shapes[1]:
        place = first_difference(*shapes)
        ends = [
            leaves[place] if place < len(leaves) else Leaf("report.html", "end", "nothing") for leaves in (mine, theirs)
        ]
        yield Difference(ends[1].where, *(f"{leaf.kind} {leaf.what.strip()}" for leaf in ends))
        mine, theirs = mine[:place], theirs[:place]
    for one, other in zip(mine, theirs, strict=True):
        yield from _compare_leaf(one, other, rounding, how)


def _kept(leaves: list[Leaf], how: Strictness) -> list[Leaf]:
    """Return the leaves that are compared: without comparable drawings, of a drawing only its words."""
    if how.drawings:
        return leaves
    return [leaf for leaf in leaves if not leaf.drawn or (leaf.kind == "text" and leaf.what.strip())]


def _compare_leaf(one: Leaf, other: Leaf, rounding: Rounding, how: Strictness) -> Iterator[Difference]:
    if one.kind == "text":
        weighed = " MB before base64" in other.what and not how.pictures
        if not rounding.same(one.what, other.what) and not weighed:
            yield Difference(other.where, one.what.strip(), other.what.strip())
        return
    mine, theirs = dict(one.attributes), dict(other.attributes)
    for name in [*theirs, *(name for name in mine if name not in theirs)]:
        printed, recomputed = mine.get(name), theirs.get(name)
        if not _same_attribute(name, printed, recomputed, other, rounding, how):
            yield Difference(f"{other.where}, {other.what} {name}", str(printed), str(recomputed))
    if [name for name, _ in one.attributes] != [name for name, _ in other.attributes] and mine.keys() == theirs.keys():
        yield Difference(f"{other.where}, {other.what}", "an attribute twice", "each once")


def _same_attribute(
    name: str, printed: str | None, recomputed: str | None, leaf: Leaf, rounding: Rounding, how: Strictness
) -> bool:
    if printed is None or recomputed is None:
        return False
    if not how.pictures and printed.startswith(_HELD) and recomputed.startswith(_HELD):
        return True
    if leaf.drawn and name in _DRAWN:
        return same_drawing(printed, recomputed)
    return rounding.same(printed, recomputed)


def _compare_data(printed: str, recomputed: str, rounding: Rounding, how: Strictness) -> Iterator[Difference]:
    blocks = [_DATA.search(html) for html in (printed, recomputed)]
    if blocks == [None, None]:  # a page of scene estimates, which has no browser of frames
        return
    try:
        mine, theirs = (json.loads(block.group(2)) for block in blocks if block is not None)
    except (ValueError, RecursionError):
        yield Difference("report.html, frames", "data that cannot be read", "the calls of the ledger")
        return
    if blocks[0] is not None and not _as_written(mine, blocks[0].group(2)):
        yield Difference("report.html, frames, data", "written in another way", "as a report writes them")
    if not how.pictures:
        for side in (mine, theirs):
            if isinstance(side, dict):
                side.pop("pictures", None)
    names = _Names(theirs)
    yield from compare_values(mine, theirs, rounding, names)


def _as_written(data: object, text: str) -> bool:
    try:
        return embedded_json(data) == text
    except ValueError:  # NaN and infinity, which no page holds
        return False


@dataclass(frozen=True)
class _Names:
    """Puts a place in the data of the browser of frames into words."""

    data: dict[str, list[dict[str, object]]]

    def __call__(self, path: Path) -> str:
        words = ["report.html, frames"]
        if path[:1] == ("texts",) and len(path) > 1:
            words.append(self._call_of(0, path[1]) or "a reply")
        elif path[:1] == ("pictures",) and len(path) > 1:
            words.append(self._picture(path[1]))
        elif path[:1] == ("runs",) and len(path) > 2:
            words.append(self._in_run(path))
        else:
            words.append(" ".join(map(str, path)))
        return ", ".join(words)

    def _in_run(self, path: Path) -> str:
        run = self.data["runs"][int(path[1])]
        frames: list[dict[str, str]] = run["frames"]  # type: ignore[assignment]
        models: list[dict[str, str]] = run["models"]  # type: ignore[assignment]
        if path[2] == "models" and len(path) > 6 and path[4] == "calls":
            return f"{models[int(path[3])]['name']}, {path[5]}, frame {frames[int(path[6])]['id']}"
        if path[2] == "frames" and len(path) > 3:
            return f"frame {frames[int(path[3])]['id']}, {' '.join(map(str, path[4:]))}"
        return " ".join(map(str, path[2:]))

    def _call_of(self, place: int, number: str | int) -> str:
        """Return in words the first call whose reply has this number."""
        for run in self.data["runs"]:
            for model in run["models"]:  # type: ignore[attr-defined]
                for condition, calls in model["calls"].items():
                    for frame, call in enumerate(calls):
                        if call is not None and call[place] == number:
                            return f"{model['name']}, {condition}, frame {run['frames'][frame]['id']}, reply"  # type: ignore[index]
        return ""

    def _picture(self, number: str | int) -> str:
        for run in self.data["runs"]:
            for condition, numbers in run["pictures"].items():  # type: ignore[attr-defined]
                if number in numbers:
                    return f"picture of frame {run['frames'][numbers.index(number)]['id']} under {condition}"  # type: ignore[index]
        return "a picture"
