"""Write the tables of docs/verdicts.md, between their marks, from the labels and from the rows of the rules.

Usage: python docs/update_verdicts.py
"""

import re
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path

from eyechart.verdicts.labels import LABELS, LATERAL, meets
from eyechart.verdicts.numbers import ASKS, BESIDE, PHOTOGRAPHS, needs_of, refuted_by

PAGE = Path(__file__).with_name("verdicts.md")

EACH = {"specificity": "the same in each third of the range", "order": "the same of the other kinds of pairs"}


def labels() -> Iterator[str]:
    """Yield a row a label: the answer, what a gate that requires it by another name reads, and what it says."""
    yield "| label | answer | meets | says |"
    yield "|---|---|---|---|"
    for name, label in LABELS.items():
        met = ", ".join(f"`{one}`" for one in meets(name, LABELS) if one != name)
        yield f"| [`{name}`](#{name}) | {label.answer} | {met} | {label.says} |"


def lateral() -> Iterator[str]:
    """Yield a row a lateral label."""
    yield "| label | meets | says |"
    yield "|---|---|---|"
    for name, label in LATERAL.items():
        met = ", ".join(f"`{one}`" for one in meets(name, LATERAL) if one != name)
        yield f"| [`{name}`](#{name}) | {met} | {label.says} |"


def depth() -> Iterator[str]:
    """Yield a row a number that depth rests on; what is the same by part, with one threshold, is one row."""
    yield "| number | asks | depth needs | refuted where |"
    yield "|---|---|---|---|"
    every = {**ASKS, **BESIDE, **PHOTOGRAPHS}
    alike = {name: (needs_of(name), refuted_by(name)) for name in every if every[name].startswith("the same")}
    for _, names in groupby(every, key=lambda name: alike.get(name, name)):
        first, *others = names
        asks = EACH[first.partition("_")[0]] if others else every[first]
        named = ", ".join(f"`{name}`" for name in (first, *others))
        yield f"| {named} | {asks} | {needs_of(first)} | {refuted_by(first)} |"


MADE = {"labels": labels, "depth": depth, "lateral labels": lateral}
"""The tables by the name of their marks."""


def page(text: str) -> str:
    """Return a page with its tables made anew. Raises ValueError where it has lost the marks of one."""
    for name, make in MADE.items():
        block = re.compile(rf"(<!-- {name}: .*? -->\n).*?(<!-- end of {name} -->)", re.DOTALL)
        if block.search(text) is None:
            raise ValueError(f"docs/verdicts.md has lost the marks of its table '{name}'")
        made = "\n".join([*make(), ""])
        text = block.sub(lambda found, made=made: found[1] + made + found[2], text)  # type: ignore[misc]
    return text


if __name__ == "__main__":
    PAGE.write_text(page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
