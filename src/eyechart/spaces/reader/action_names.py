"""The names of actions in words: folded characters, separators, and mentions."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

from eyechart.spaces.reader import languages, marks, quantities
from eyechart.spaces.reader.marks import LETTERS as _WORD
from eyechart.spaces.reader.marks import Mention

_QUOTES = dict.fromkeys(map(ord, "“”„‟«»‹›「」『』〝〞"), ' " ') | dict.fromkeys(map(ord, "’‘‛´"), "'")
_SIGNS = {ord("。"): ". ", ord("、"): ", ", ord("…"): "... ", ord("—"): " - ", ord("–"): " - ", ord("−"): "-"}
_ARROWS = dict.fromkeys(map(ord, "→⇒➔➜➡⟶"), " -> ")
_UNSEEN = dict.fromkeys(
    [*range(0x200B, 0x2010), *range(0x202A, 0x202F), *range(0x2060, 0x2070), 0xFEFF, 0xFE0F, 0xAD, 0x1A, 0x0], ""
)
_WIDE = {ord("！") + at: chr(ord("!") + at) + (" " if chr(ord("!") + at) in "!,.:;?" else "") for at in range(94)}
_FOLDED = _QUOTES | _SIGNS | _ARROWS | _UNSEEN | _WIDE | dict.fromkeys(map(ord, "*`_"), " ")

_STRUCK = re.compile(r"~~[^~]{0,200}~~")
_IDEOGRAPH = "\u3400-\u9fff"
_ENDINGS = "ly|wards?|p?p?ing|t?ting"
"""English forms of a name with the same meaning: slowly, leftward, stopping."""
_NAME_AT_MOST = 100
"""More characters than a name three times over make no whole name: small words and signs are fewer."""
_LETTERS = re.compile(r"\W*([^\W\d](?:[ .-][^\W\d]){1,30})\W*")
_MINUS = re.compile(r"(?<![\w)\]°º˚%])[\u2010-\u2015\u2212\ufe63](?=\.?\d)")
"""A dash directly before a number, and after no word, is its sign."""


def fold(text: str) -> str:
    """Return a text with plain quotes, dashes and arrows, and full-width forms made plain.

    Emphasis, struck-out text and invisible characters are removed. Letters keep their case.
    """
    return _STRUCK.sub(" ", _MINUS.sub("-", text).translate(_FOLDED))


_BOUND = re.compile(r"\W*!\s?\w[^!]*\Z|(?![\s\"'(]*[-=]+>)[^\w]{0,20}(?:[-+≤≥≠≈~±]|[<>!]=?)[^\w]{0,20}\d")
"""A number after two signs or a bound, "- -2" or "> 3", is another; "!" negates what follows."""


@dataclass(frozen=True, slots=True)
class ActionNames:
    """The names of a space's actions and aliases, as written form and action.

    ``pairs`` exchange under reflection.
    """

    spelled: tuple[tuple[str, str], ...]
    pairs: tuple[tuple[str, str], ...] = ()

    @property
    def actions(self) -> tuple[str, ...]:
        """Return the actions under their own names, without aliases."""
        return tuple(action for written, action in self.spelled if written == action)

    def action(self, text: str) -> str | None:
        """Return the action that a text names, whatever its case, signs and separators."""
        if _BOUND.match(text) and marks.split_number(text) is None:
            return None
        return _table(self).get(spelled(text)) or _loose(self).get(_loosely(text))

    def side(self, action: str) -> str | None:
        """Return the side of an action that is a mark, "" for none; None where it is unknown."""
        return _sides(self).get(action)

    @property
    def quantity(self) -> quantities.Quantity:
        """Return what the numbers among the names measure."""
        return _quantity(self)

    def in_english(self, text: str) -> str:
        """Return a text with English words for those of a choice, and digits for such number words."""
        foreign = languages.is_foreign(text)
        if _marks(self).numbers:
            text = quantities.in_digits(text, self.quantity.units, commas=foreign)
        return languages.in_english(text, tuple(written for written, _ in self.spelled)) if foreign else text

    def whole(self, text: str) -> str | None:
        """Return the action if a text is only its name, even with spaced letters."""
        if len(text) > _longest(self):
            return None
        if (result := self.action(text)) is not None:
            return result
        if _marks(self).numbers and (number := quantities.number_in_words(text.strip(" \n\t.!\"'()"))) is not None:
            return self.action(number)
        spaced = _LETTERS.fullmatch(text)
        return None if spaced is None else self.action(re.sub(r"[ .-]", "", spaced.group(1)))

    def mentions(self, text: str) -> Iterator[Mention]:
        """Yield the mentions of actions in a folded text; at one place the longest."""
        found = [*self._worded(text), *marks.mentions(text, _marks(self))]
        if len(found) > 1:
            found.sort(key=lambda mention: (mention.start, -mention.end))
        done = 0
        for one in found:
            if one.start >= done:
                yield one
                done = one.end

    def _worded(self, text: str) -> Iterator[Mention]:
        """Yield the mentions of actions by words in a folded text."""
        for match in _pattern(self).finditer(text):
            # None: a case-insensitive pattern takes "İ" for "I", but upper() does not.
            action, ending = self.action(match.group()), match.group("ending") or ""
            if action is None and ending:
                action = self.action(match.group()[: -len(ending)])
            if action is not None:
                derived = ending.lower().endswith("ing") or _is_active(match.group(), action)
                yield Mention(action, match.group(), match.start(), match.end(), derived)


def spelled(text: str) -> str:
    """Return the common form of a name's spellings: upper case without separators.

    A leading number keeps its sign and fraction in shortest form: "+1.0" is "1".
    """
    if (split := marks.split_number(text)) is not None:
        number, rest = split
        return number + _words_of(rest)
    return _words_of(text)


_AROUND = ".,;:!*`\"'()[]<>{}"


def _words_of(text: str) -> str:
    plain = re.sub(r"[\s_-]+", "", re.sub(r"(?<=[\s_-])(?:(?:to|on|onto|into)\s+)?the\s|(?<=[\s_-])to\s", "", text))
    plain = plain.strip(_AROUND).upper()
    parted = "-" in text and re.fullmatch(r"[\d.]+", plain) is not None  # "-(1)" is not "1"
    return re.sub(r"\s+", "", text).strip(_AROUND) if parted else plain


@lru_cache(maxsize=256)
def _longest(names: ActionNames) -> int:
    return _NAME_AT_MOST + 3 * max(len(written) for written, _ in names.spelled)


@lru_cache(maxsize=256)
def _table(names: ActionNames) -> dict[str, str]:
    united = _united(names)
    return {spelled(form): action for written, action in united for form in _forms(written)} | {
        spelled(written): action for written, action in united
    }


@lru_cache(maxsize=256)
def _marks(names: ActionNames) -> marks.Marks:
    return marks.Marks.of(_united(names), _sides(names))


_SIDES = ("left", "right")


@lru_cache(maxsize=256)
def _sides(names: ActionNames) -> dict[str, str]:
    """Return the sides of the actions that are marks.

    A number with a minus is on the left where there is one. Else the first of a pair is, unless
    words for it say otherwise; what is in no pair has no side.
    """
    numbers = {action: split[0] for action in names.actions if (split := marks.split_number(action)) is not None}
    if any(number.startswith("-") for number in numbers.values()):
        return {one: "" if number == "0" else _SIDES[number[0] != "-"] for one, number in numbers.items()}
    sides = {action: "" for action in names.actions if names.pairs and marks.is_mark(action)}
    for pair in names.pairs:
        said = [side for side in _SIDES for word, action in names.spelled if action == pair[0] and side in word.lower()]
        for action, side in zip(pair, reversed(_SIDES) if said == ["right"] else _SIDES, strict=True):
            sides |= {action: side} if action in sides else {}
    return sides


@lru_cache(maxsize=256)
def _quantity(names: ActionNames) -> quantities.Quantity:
    opposite = [[spelled(one).removeprefix("-") for one in pair] for pair in names.pairs]
    return quantities.quantity_of(names.spelled, sided=bool(opposite) and all(one == other for one, other in opposite))


@lru_cache(maxsize=256)
def _united(names: ActionNames) -> tuple[tuple[str, str], ...]:
    """Return the written names and their actions, with all spellings of numbers' units."""
    numbers = {split[0]: action for _, action in names.spelled if (split := marks.split_number(action)) is not None}
    return (
        *((f"{number} {unit}", action) for number, action in numbers.items() for unit in _quantity(names).units),
        *names.spelled,
    )


_OWN = r"(?:the|your|my|an?|its|our|their|this|that|some)"
_WHICH = r"(?:current|own|same|present)"
_KIND = r"(?:(?:right|left)(?:-hand)?|open|closed|near(?:est|by|er)?|next|first|second|same|other|front|main|white)"
"""Words before the noun of a name: "keep the current lane", and of one with "the": "follow the left wall"."""
_WITHIN = rf"(?:(?:in|within|along|through)[\s_-]+(?:{_OWN}[\s_-]+)?(?!back|left|right)|right[\s_-]+(?=here\b))"
_SMALL_WORDS = re.compile(
    rf"(?<=[\s_-])(?:{_WITHIN}|(?:(?:to|on|onto|into|towards?|in|by)[\s_-]+(?={_OWN}[\s_-]))?(?:{_OWN}|to)[\s_-]+)"
    rf"(?:(?:{_WHICH}|{_KIND}(?=[\s_-]))[\s_-]+)?"
    r"|(?<=[\s_-])(?:onto|into|towards?)[\s_-]+|(?<=[\s_-]lane)s(?=[\s_-])",
    re.IGNORECASE,
)
_FIRST_WORD = re.compile(r"[^\W\d_]{2,}(?=[\s_-])")


def _loosely(text: str) -> str:
    """Return the common form of a long name's variants, without small words."""
    return _words_of(_SMALL_WORDS.sub("", text))


def _ing(verb: str) -> str:
    """Return the "-ing" form of an English verb: "turning", "changing", "stopping"."""
    if verb[-1:] == "e" and verb[-2:] not in {"ee", "oe", "ye"}:
        return f"{verb[:-1]}ing"
    short = re.fullmatch(r"[^aeiou]*[aeiou][^aeiouwxy]", verb) is not None
    return f"{verb}{verb[-1] * short}ing"


def _active(written: str) -> str | None:
    """Return a long name with its first word in "-ing"; None for one word, or without a verb."""
    found = None if marks.is_mark(written) else _FIRST_WORD.match(written)
    return (
        None if found is None or not found.group().isascii() else _ing(found.group().lower()) + written[found.end() :]
    )


def _is_active(text: str, action: str) -> bool:
    """Return whether a text is a name with "-ing" that the action's own name lacks."""
    first = _FIRST_WORD.match(text)
    return (
        first is not None
        and first.group().lower().endswith("ing")
        and not action.lower().startswith(first.group().lower())
    )


_LANE_OF_SIDE = re.compile(r"(?i)(?<=[\s_-])(lane)([\s_-]+)(left|right)$")


def _forms(written: str) -> list[str]:
    """Return a name with and without "-ing", and with a side before or after "lane"."""
    each = [written, _LANE_OF_SIDE.sub(r"\3\2\1", written)]
    return [*each, *filter(None, map(_active, each))]


@lru_cache(maxsize=256)
def _loose(names: ActionNames) -> dict[str, str]:
    """Return the actions by loose forms of their names, where only one action fits."""
    found: dict[str, set[str]] = {}
    for written, action in names.spelled:
        for form in _forms(written):
            if not marks.is_mark(form):
                found.setdefault(_loosely(form), set()).add(action)
    return {form: actions.pop() for form, actions in found.items() if len(actions) == 1}


_BETWEEN = rf"(?:[\s-]{{1,3}}(?:{_WITHIN}|(?:(?:to|on|onto|into|towards?)\s)?(?:{_OWN}\s)?(?:{_WHICH}\s)?)|)"


def _words_pattern(written: str) -> str:
    """Return a pattern of a name's words with small words between; "lane" inside it matches "lanes"."""
    found = ""
    parts = [part for part in re.split(r"[\s_-]+", written) if part]
    for at, part in enumerate(parts):
        inside = 0 < at < len(parts) - 1
        if inside and part.upper() == "THE":
            found += rf"(?:[\s-]{{1,3}}{_OWN}|the)(?:\s{_KIND}(?=\s))?"
        else:
            found += (_BETWEEN if at else "") + re.escape(part) + "s?" * (inside and part.upper() == "LANE")
    return found


@lru_cache(maxsize=256)
def _pattern(names: ActionNames) -> re.Pattern[str]:
    worded = dict.fromkeys(form for name, _ in names.spelled if not marks.is_mark(name) for form in _forms(name))
    each = [_words_pattern(written) for written in sorted(worded, key=len, reverse=True)]
    # Not \b: neither "non-stop" nor "right-hand" names an action, and 左 in 左車線 is part of a word.
    before = rf"(?<![{_WORD}])(?<![{_WORD}]-)"
    latin = [one for one in each if one[0].isascii() or re.match(rf"[{_WORD}]", one)]
    other = [one for one in each if one not in latin]
    kinds = [rf"{before}(?:{'|'.join(latin)})(?P<ending>{_ENDINGS})?(?!-?[{_WORD}])"] if latin else []
    kinds += [rf"(?<![{_IDEOGRAPH}])(?:{'|'.join(other)})(?![{_IDEOGRAPH}])"] if other else []
    return re.compile("|".join(kinds if latin else [*kinds, "(?P<ending>(?!))"]), re.IGNORECASE)
