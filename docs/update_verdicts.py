"""Write the tables of the pages on verdicts, between their marks, from the labels and from the rows of the rules.

Usage: python docs/update_verdicts.py
"""

import re
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path

from eyechart.verdicts.labels import LABELS, LATERAL, meets
from eyechart.verdicts.numbers import ASKS, BESIDE, PHOTOGRAPHS, needs_of, refuted_by
from eyechart.verdicts.policy_verdict import AXES

DOCS = Path(__file__).parent
PAGE, POLICIES = DOCS / "verdicts.md", DOCS / "policy-reference.md"

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


def policies() -> Iterator[str]:
    """Yield a row a label of a policy, axis by axis; what a look answers is of the camera alone."""
    yield "| axis | label | answer | meets | says |"
    yield "|---|---|---|---|---|"
    for axis, found in AXES.items():
        for name, label in found.items():
            met = ", ".join(f"`{one}`" for one in meets(name, found) if one != name)
            yield f"| {axis} | `{name}` | {label.answer if axis == 'camera' else ''} | {met} | {label.says} |"


MADE = {
    PAGE: {"labels": labels, "depth": depth, "lateral labels": lateral},
    POLICIES: {"labels of policies": policies},
}
"""The tables of each page by the name of their marks."""


def page(text: str, file: Path = PAGE) -> str:
    """Return a page with its tables made anew. Raises ValueError where it has lost the marks of one."""
    for name, make in MADE[file].items():
        block = re.compile(rf"(<!-- {name}: .*? -->\n).*?(<!-- end of {name} -->)", re.DOTALL)
        if block.search(text) is None:
            raise ValueError(f"docs/{file.name} has lost the marks of its table '{name}'")
        made = "\n".join([*make(), ""])
        text = block.sub(lambda found, made=made: found[1] + made + found[2], text)  # type: ignore[misc]
    return text


if __name__ == "__main__":
    for one in MADE:
        one.write_text(page(one.read_text(encoding="utf-8"), one), encoding="utf-8")
