"""Shorten long names, such as SPECs, in the middle; each stays unique."""

import re
from collections.abc import Callable, Iterable, Sequence
from itertools import takewhile

LONGEST = 40
"""The longest name that is not shortened: half a line of 80."""
_HEAD, _TAIL = 10, 8


def shorten(names: Iterable[str], longest: int = LONGEST) -> dict[str, str]:
    """Return a unique form of each name with at most ``longest`` characters, 24 or more.

    Names that differ only in the middle show the place where they begin to differ; equal forms get
    numbers.
    """
    whole = list(dict.fromkeys(names))
    made: dict[str, str] = {name: _ends(name, longest) for name in whole}
    for alike in _groups(made):
        made |= {name: _around(name, alike, longest) for name in alike if len(name) > longest}
    taken = {name for name in whole if len(name) <= longest}
    for name in whole:
        if len(name) > longest:
            made[name] = _free(made[name], taken, longest)
            taken.add(made[name])
    return made


def shortener(names: Iterable[str]) -> Callable[[str], str]:
    """Return a function that shortens these names in a text."""
    made = {name: short for name, short in shorten(names).items() if name != short}
    if not made:
        return lambda text: text
    pattern = re.compile("|".join(re.escape(name) for name in sorted(made, key=len, reverse=True)))
    return lambda text: pattern.sub(lambda found: made[found[0]], text)


def _groups(made: dict[str, str]) -> list[list[str]]:
    """Return the groups of names with equal forms."""
    by_form: dict[str, list[str]] = {}
    for name, form in made.items():
        by_form.setdefault(form, []).append(name)
    return [group for group in by_form.values() if len(group) > 1]


def _ends(name: str, longest: int) -> str:
    """Return the beginning and end of a name."""
    if len(name) <= longest:
        return name
    tail = (longest - 1) // 2
    return f"{name[: longest - 1 - tail]}…{name[-tail:]}"


def _around(name: str, alike: Sequence[str], longest: int) -> str:
    """Return a name's beginning, the place where the names begin to differ, and its end."""
    window = longest - 2 - _HEAD - _TAIL
    same = sum(1 for _ in takewhile(lambda signs: len(set(signs)) == 1, zip(*alike, strict=False)))
    differs = max(same - 3, _HEAD)
    start = min(differs, len(name) - _TAIL - window)
    return f"{name[:_HEAD]}…{name[start : start + window]}…{name[-_TAIL:]}"


def _free(form: str, taken: set[str], longest: int) -> str:
    """Return an unused form of a name, with a number if necessary."""
    number, result = 1, form
    while result in taken:
        number += 1
        end = f"#{number}"
        result = f"{form[: longest - len(end)]}{end}"
    return result
