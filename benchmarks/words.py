"""Measures how long the sentences of source trees are, and draws docstrings, errors and help of two of them by a seed.

    python benchmarks/words.py --before OLD --after NEW --other httpx=FOLDER --out benchmarks/results/words.md

OLD and NEW are checkouts in which functions have the same names. Of other trees, which are named with the folder of a
package, only numbers are written.
"""

import argparse
import ast
import json
import random
import re
import statistics
from collections.abc import Iterator
from pathlib import Path

SEED = 15
LONG = 30
_SENTENCE = re.compile(r"(?<=[.!?])\s+")
_KINDS = {"docstrings": 20, "errors": 20, "help texts": 10}


def sentences(text: str) -> list[str]:
    """Return the sentences of a text, paragraph by paragraph; lists and examples count as the text they are."""
    paragraphs = re.split(r"\n\s*\n", text)
    return [one for part in paragraphs for one in _SENTENCE.split(" ".join(part.split())) if one]


def texts(package: Path) -> Iterator[tuple[str, str, str]]:
    """Yield the kind, the place and the words of each docstring, error and help text of a package."""
    for path in sorted(package.rglob("*.py")):
        place = path.relative_to(package).as_posix()
        yield from _within(ast.parse(path.read_text(encoding="utf-8")), place)


def _within(node: ast.AST, place: str) -> Iterator[tuple[str, str, str]]:
    if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef) and (
        words := ast.get_docstring(node)
    ):
        yield "docstrings", place, words
    count = 0
    for child in ast.iter_child_nodes(node):
        name = getattr(child, "name", None) or getattr(getattr(child, "target", child), "id", None)
        name = child.arg if isinstance(child, ast.arg) else name
        inner = f"{place}:{name}" if isinstance(name, str) else place
        raised = child.exc.args if isinstance(child, ast.Raise) and isinstance(child.exc, ast.Call) else []
        if raised and (words := _said(raised[0])):
            yield "errors", f"{inner}#{count}", words
            count += 1
        if isinstance(child, ast.keyword) and child.arg == "help" and (words := _said(child.value)):
            yield "help texts", f"{inner}", words
        yield from _within(child, inner)


def _said(node: ast.expr) -> str:
    """Return the words of a text in a program, with what is put into it in braces; nothing where it is none."""
    if isinstance(node, ast.Constant):
        return node.value if isinstance(node.value, str) else ""
    if isinstance(node, ast.JoinedStr):
        return "".join(
            f"{{{ast.unparse(one.value)}}}" if isinstance(one, ast.FormattedValue) else _said(one)
            for one in node.values
        )
    return ""


def measured(package: Path, kind: str) -> str:
    """Return a row of the table: sentences, words a sentence (median, ninth tenth), and the share of long ones."""
    found = [one for of, _, words in texts(package) if of == kind for one in sentences(words)]
    if len(found) < 2:
        return f"{len(found)} | | | "
    lengths = [len(one.split()) for one in found]
    tenth = statistics.quantiles(lengths, n=10)[-1]
    long = sum(one >= LONG for one in lengths)
    return f"{len(lengths)} | {statistics.median(lengths):g} | {tenth:g} | {long} ({long / len(lengths):.1%})"


def drawn(before: Path, after: Path) -> Iterator[str]:
    """Yield, kind by kind, texts that stand in both trees at one place, drawn by the seed, before and after."""
    old = {(kind, place): words for kind, place, words in texts(before)}
    new = {(kind, place): words for kind, place, words in texts(after)}
    for kind, count in _KINDS.items():
        places = sorted(place for one, place in old if one == kind and (kind, place) in new)
        yield f"\n## {count} {kind}\n"
        for place in sorted(random.Random(SEED).sample(places, count)):  # noqa: S311 - no secret
            was, now = (" ".join(one[kind, place].split()) for one in (old, new))
            yield f"- `{place}`\n  - before: {was}\n  - after: {now if now != was else 'the same'}"


def verdicts(before: Path, after: Path, count: int = 10) -> Iterator[str]:
    """Yield the reasons of verdicts of made-up evidence, drawn by the seed, before and after."""
    old, new = (dict(_reasons(tree / "tests/verdict_words.json")) for tree in (before, after))
    yield f"\n## {count} verdicts\n"
    for name in sorted(random.Random(SEED).sample(sorted(old.keys() & new.keys()), count)):  # noqa: S311 - no secret
        was, now = old[name], new[name]
        yield f"- {name}\n  - before: {was}\n  - after: {now if now != was else 'the same'}"


def _reasons(path: Path) -> Iterator[tuple[str, str]]:
    for name, verdict in json.loads(path.read_text(encoding="utf-8")).items():
        if isinstance(verdict, dict) and "because" in verdict.get("json", {}):
            yield name, verdict["json"]["because"]


def pages(before: Path, after: Path, count: int = 5) -> Iterator[str]:
    """Yield a table of pages, drawn by the seed: words a sentence of their prose, before and after."""
    both = [one.name for one in (after / "docs").glob("*.md") if (before / "docs" / one.name).is_file()]
    names = sorted(name for name in both if all(_lengths(tree / "docs" / name) for tree in (before, after)))
    yield f"\n## {count} pages\n"
    yield "| page | before: sentences, median, of 30 words or more | after |\n|---|---|---|"
    for name in sorted(random.Random(SEED).sample(names, count)):  # noqa: S311 - no secret
        rows = (_prose(tree / "docs" / name) for tree in (before, after))
        yield f"| {name} | {' | '.join(rows)} |"


def _lengths(page: Path) -> list[int]:
    """Return the words of each sentence of a page, without its tables, headings and code."""
    text = re.sub(r"(?ms)^```.*?^```|^\|.*?$|^#.*?$|^<.*?$", "", page.read_text("utf-8"))
    return [len(one.split()) for one in sentences(text)]


def _prose(page: Path) -> str:
    """Return how many sentences a page has, and how long they are."""
    lengths = _lengths(page)
    return f"{len(lengths)}, {statistics.median(lengths):g}, {sum(one >= LONG for one in lengths)}"


def main() -> None:
    """Write the table and what was drawn."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    for name in ("--before", "--after", "--out"):
        options.add_argument(name, type=Path, required=True)
    options.add_argument("--other", action="append", default=[], metavar="NAME=FOLDER")
    given = options.parse_args()
    trees = {"before": given.before / "src/eyechart", "after": given.after / "src/eyechart"}
    trees |= {name: Path(folder) for name, _, folder in (one.partition("=") for one in given.other)}
    lines = [
        "# Sentences, before and after",
        f"\nDrawn by `benchmarks/words.py` with the seed {SEED}.",
        "\n| texts | of | sentences | words a sentence, median | ninth tenth | of 30 words or more |",
        "|---|---|---|---|---|---|",
        *(f"| {kind} | {name} | {measured(folder, kind)} |" for kind in _KINDS for name, folder in trees.items()),
        *drawn(trees["before"], trees["after"]),
        *verdicts(given.before, given.after),
        *pages(given.before, given.after),
    ]
    given.out.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
