"""Names that are numbers or single letters, where they are an option, not a count or an article."""

import re
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from functools import lru_cache
from itertools import islice

LETTERS = "0-9A-Za-z\u00c0-\u024f\u0370-\u052f"
"""Letters of scripts with spaces between words."""
_NUMBER = r"[+-]?(?:\d+(?:\.\d+)?|\.\d+)"
_HEAD = re.compile(
    r"(?:[\s\"'(\[{*`_.,;:]|<(?=[^<>]*>)"
    r"|!(?=.*!))*?(?P<sign>[+-]?)(?P<apart>(?<=[+-])\s)?\s?(?P<digits>\d+(?:\.\d+)?|\.\d+)(?P<rest>.*)",
    re.DOTALL,
)
_NAMED = re.compile(rf"(?P<number>{_NUMBER})(?P<unit>(?:\s?[^\W\d_].*|\s?[°%])?)", re.DOTALL)
_TOKEN = re.compile(
    rf"(?<![{LETTERS}_.~≈≥≤<±$€£²³°º˚%+-])(?<!\w[-/:])(?<!\+/)(?<!\d[.,])(?<!\d [-x×/])(?<!\d [x×/] )(?<!\d[x×/] )"
    rf"(?P<number>{_NUMBER})(?![.,:/x×·]?\d|[,/][+-]\d|[ \t]?[-–][ \t]?\d|[ \t]?[x×/][ \t]?\d)"
)
_TOKENS_AT_MOST = 2000
"""The most numbers or letters to read, the last ones."""
_BETWEEN = r"[ \t]*(?:[-+/x×*^&·~]|\.{2,})?[ \t]*"
_BESIDE_BEFORE = re.compile(
    rf"(?:(?P<number>\d+){_BETWEEN}|(?:[≤≥≠≈~±]=?|(?:(?<![-=])[<>]|!)=|(?<![-=\w])[<>])[ \t]*)\Z"
)
_BESIDE_AFTER = re.compile(rf"{_BETWEEN}[+-]?(?P<number>\.?\d+)|[+^]")
"""What makes a number part of something else: "3 – 5", "≥ 3"."""
SIGN_APART = re.compile(r"(?:\b(?:minus|negative|neg\.?)[\s\"'(\[)\]:,]{1,4}|(?<![\w)])-[(\[{\"']+)\Z", re.IGNORECASE)
"""A sign that is separated from its number: "-(1)", "minus (1)"."""
_LISTED_BEFORE = re.compile(rf"(?:^|[\n(\[:=])[ \t]*(?:{_NUMBER}[ \t]*,[ \t]*)*(?P<number>{_NUMBER})[ \t]*,[ \t]*\Z")
_LISTED_AFTER = re.compile(rf"[ \t]*,[ \t]*(?P<number>{_NUMBER})[ \t]*(?=[,)\]\n]|\.?[ \t]*\Z)")
"""Another number of a list: "(7, 2)"."""
_OF_LIST = (
    re.compile(rf"[\[({{]\s?(?:{_NUMBER}\s?,\s?){{1,9}}\Z"),
    re.compile(rf"\s?,\s?(?:{_NUMBER}\s?,\s?){{0,9}}{_NUMBER}\s?[\])}}]"),
)
_CALL_BEFORE, _CALL_AFTER = re.compile(r"\w\(([^()\n]{0,40})\Z"), re.compile(r"[^()\n]{0,40}(?=\))")
_LETTER = re.compile(rf"(?<![{LETTERS}_.&/+-])(?<!\w')(?P<letter>[^\W\d_])(?![\w&/+#-]|['.]\w|\s?=)")
_OPTION = (
    r"(?:options?|choices?|actions?|answers?|numbers?|letters?|ids?|no\.|nr\.|index|commands?|candidates?|codes?|keys?"
    r"|cmd|arrows?|bins?|case)"
)
_WITH_OPTION = re.compile(rf"\b(?:{_OPTION}[\s_-]*)+(?:#|\(|\[|\"|'|is\s|:\s?)?\s*$|#+\s?$", re.IGNORECASE)
_BEFORE = re.compile(
    r"so|thus|hence|therefore|then|now|please|just|simply|finally|ultimately|instead|rather|and|press|pressing|push"
    r"|hit|tap|or|nor|not|than|but|is|be|are|was|would|should|will|must|i'd|i'll|(?:it|that|answer|choice|pick)'s"
    r"|that'd|with|for|to|on|choose|choosing|chose|chosen|pick|picking|picked|select|selecting|selected|say|go|going|"
    r"take|taking|use|using|output|return|execute|perform|apply|do|prefer|recommend|recommended|suggest|advise|propose"
    r"|answer|reply|respond|vote|opt|lean|towards|as|yes|no|ok|okay|only|believe|think|guess|suppose|mean|steer"
    r"|steering|final|best|better|safest|correct|because|by|o|u|y|e|obviously|clearly|definitely|certainly|absolutely"
    r"|avoid|out|reject|surely|probably|likely|preferably|actually|sorry|perhaps|maybe|possibly|alternatively|later|afterwards|leaves"
    r"|leaving|makes|remains|course|doubt|first|yeah|yep|alright|great|sure|need|needs|requires|demands"
)
_SET = re.compile(
    r"\b(?:(?:turn|steer|rotate)(?:\s+the\s+(?:steering\s+)?wheel)?(?:\s+(?:by|to|with))?|keep|hold|maintain|an?"
    r"|(?:keep|hold|set|put|leave|be)(?:\s+(?:the|my|our))?(?:\s+(?:it|speed|velocity|angle|wheel|steering(?: wheel"
    r"| angle)?))?\s+at|(?:keep going|keep driving|start|begin|drive|go|move|proceed|continue|travel|cruise|steering"
    r"|driving)\s+(?:\w+\s+)?at)\s+$",
    re.IGNORECASE,
)
"""Words that may also precede a number with its unit or sign."""
_WITH_QUANTITY = re.compile(
    r"\b(?:an?\s|the\s)?(?:[\w-]+\s)?(?:speed|velocity|angle|steering|value|bin)\s(?:value\s)?of\s$", re.IGNORECASE
)
TURN = (
    r"(?:(?:i\.e\.|that is|an?|to|the|towards?|turn(?:ing)?|steer(?:ing)?|go|bear|swing|chang(?:e|ing)|switch(?:ing)?"
    r"|mov(?:e|ing)|lanes?|by|hard|full|fully|sharp|sharply|slight|slightly|gentle|gently|soft|softly|strong|strongly"
    r"|small|medium|bit|little|\d+(?:°| degrees))\s+){0,4}"
)
SIDE = (
    r"(?P<side>left|right)\b(?!\s+(?:lane|side|of|wall|car|edge|is|are|was|would|and|or|hand|one|now|away|here|there"
    r"|ahead|behind|next|before|after|in|at|blocked|occupied|closed|taken|free|has|leads)\b|-)"
)
_SIDE_AFTER = re.compile(rf"[\s.,:;()=\"'-]{{0,7}}{TURN}{SIDE}", re.IGNORECASE)
_APART = re.compile(r"(?:^|\n|[^\w)\s])[ \t]*[+-]\s+\Z")
"""A dash before a space: it may be the number's sign or a list's."""
_SIDE_BEFORE = re.compile(
    r"\b(?:steer|turn|go|swing|bear|change|lanes?|hard|slight|slightly|sharp|sharply|full)\s+(?:to\s+the\s+)?"
    r"(?P<side>left|right)(?:\s+(?:by|hard|slightly|sharply|a (?:bit|little)|\d+(?:°| degrees))){0,2}[\s:=(]{1,3}$",
    re.IGNORECASE,
)
_AFTER = re.compile(
    r"because|since|as|is|was|would|should|seems|looks|appears|remains|due|so|and|or|but|given|then|"
    r"than|here|now|please|instead|rather|when|while|if|unless|with|it|i|we|i'd|which|for|over|the|"
    r"until|till|later|afterwards|next|therefore|thus|hence|again|immediately|safely|gently|carefully|though|although"
    r"|not|only|makes|(?:is|wo|would)n't|gets|has|selected|chosen|followed|will|works|fits"
)
_WITH_NEXT = re.compile(rf"\s+(?:or|and|o|y|и)\s+(?:{_NUMBER}|[A-Z])(?![\w.])")
"""A second mark: "either 0 or 2" is a list, whatever precedes its first."""
_DOES = re.compile(
    r"are|does|cannot|\w+n't|were|both|will|could|can|means|hits|leads|fits|avoids|works|keeps|takes|gives"
)
"""Verbs of an option, never after an article."""
_WORD_BEFORE = re.compile(r"([^\W\d_][\w']*)[ \t\"'(\[]*\Z")
_WORD_AFTER = re.compile(r"[\"'\]]*[ \t]+(?!at first\b|initially\b\s*(?:[.,;]|$))([^\W\d_][\w']*)")
_ITEM = re.compile(r"^[ \t>#*+-]*\(?(?:\d{1,2}|[a-z])[.):][ \t]+\S", re.IGNORECASE | re.MULTILINE)
_OPENS = re.compile(r"\.[ \t]+\S")
_INITIAL = re.compile(r"(?<![Nn]ot )(?<!\w)([^\W\d_])\.[ \t]?\Z"), re.compile(r"\.[ \t]?[^\W\d_]\.(?!\w)")
"""Two dotted letters make an abbreviation: "D. C.", "e. g."."""
_SPECIES = re.compile(r"\.[ \t]+(?:coli|elegans|sapiens|aureus|subtilis|cerevisiae|musculus|difficile)\b")
"""A species' name after a dotted letter is no option's text: "E. coli"."""
_AROUND = re.compile(r"\.[ \t]+\d")
"""A number after a small dotted letter: "c. 20 metres"."""
_COUNTED = re.compile(r"\d[ \t]*[°º˚][ \t]*\Z")
"""A letter directly after degrees is their unit: "20 °C"."""
_CONCLUDES = re.compile(
    r"\b(?:answer|action|choice|decision|option|command|letter|number|conclusion)\b[^.\n:]{0,40}:?\s*$", re.IGNORECASE
)
_STARTS = re.compile(r"[ \t>#*+-]*\(?")
_CLOSES = re.compile(r"[.):][ \t]+\S")
_OPENS_QUOTE, _CLOSES_QUOTE = re.compile(r"(?:\A|[:=\n]|\b(?:choose|pick|is))\s*[\"'] ?\Z"), re.compile(r" ?[\"']")
_PICKS = re.compile(r"choos(?:e|ing)|pick(?:ing)?|select(?:ing)?|with|use|take|do|say|answer|prefer|recommend|suggest")
_TO_DO = re.compile(r"\W*to (?!\d|(?:the|an?|my|our|\w|be|describe|mean|mark|name|one|two|three|four|five)\b)")
_TO_NUMBER = re.compile(r"\s*(?:to|of|out of|in|at|by)\s+\d")


@dataclass(frozen=True, slots=True)
class Mention:
    """A mention of an action in a text; ``written`` is its form.

    ``derived`` marks "slowing" for "slow", ``united`` a number with its unit.
    """

    action: str
    written: str
    start: int
    end: int
    derived: bool = False
    united: bool = False


def short_number(sign: str, digits: str) -> str | None:
    """Return a number in its shortest form, "1" for "+1.0"; None for padded zeros, a name."""
    if len(digits) > 1 and digits[0] == "0" and digits[1] != ".":
        return None
    value = Decimal(f"{sign}{digits}").normalize()
    return "0" if value == 0 else f"{value:f}"


def split_number(text: str) -> tuple[str, str] | None:
    """Return a text's leading number in its shortest form, and the rest; None without one.

    A text of two numbers, as "1-2" or "1,5", has none.
    """
    match = _HEAD.fullmatch(text)
    if match is None or len(match["digits"]) > _MOST_DIGITS or _GOES_ON.match(match["rest"]):
        return None
    number = short_number(match["sign"], match["digits"])
    if match["apart"]:
        return (f"{match['sign']} {match['digits']}", match["rest"])  # list dash or sign?
    return None if number is None else (number, match["rest"])


_MOST_DIGITS = 30
_GOES_ON = re.compile(r"\s*[-–.,:/x×·]?\s*\d")


def is_mark(name: str) -> bool:
    """Return whether a name is a single letter, a number, or a number with its unit."""
    return (len(name) == 1 and name.isalpha() and name.isascii()) or _NAMED.fullmatch(name) is not None


@dataclass(frozen=True, slots=True)
class Marks:
    """The names of a space that are marks: letters, and numbers with their possible units.

    ``sides`` are "left", "right" or "" of the actions, as far as they are known.
    """

    letters: Mapping[str, str]
    numbers: Mapping[str, tuple[tuple[str, str], ...]]
    sides: Mapping[str, str]

    @property
    def is_signed(self) -> bool:
        """Return whether some numbers are negative, so that a sign may mean a side."""
        return any(number.startswith("-") for number in self.numbers)

    @classmethod
    def of(cls, spelled: Sequence[tuple[str, str]], sides: Mapping[str, str]) -> "Marks":
        """Return the marks among written names and their actions, with the longest units first."""
        letters = {name: action for name, action in spelled if len(name) == 1 and is_mark(name) and name.isalpha()}
        numbers: dict[str, list[tuple[str, str]]] = {}
        for name, action in spelled:
            if (split := split_number(name)) is not None and _NAMED.fullmatch(name):
                numbers.setdefault(split[0], []).append((split[1].strip(), action))
        longest = {number: tuple(sorted(found, key=_longest)) for number, found in numbers.items()}
        return cls(letters, longest, sides)


def _longest(named: tuple[str, str]) -> int:
    return -len(named[0])


def mentions(text: str, marks: Marks) -> Iterator[Mention]:
    """Yield the marks in a folded text that are options."""
    if marks.numbers:
        yield from _numbers(text, marks)
    if marks.letters:
        yield from _letters(text, marks)


def _numbers(text: str, marks: Marks) -> Iterator[Mention]:
    numbers, signed = marks.numbers, marks.is_signed
    zero = "+-0" if signed else "+-"
    for match in deque(_TOKEN.finditer(text), _TOKENS_AT_MOST):
        split = split_number(match["number"])
        for unit, action in numbers.get(split[0], ()) if split is not None else ():
            start, end = match.start(), _unit_end(text, match.end(), unit)
            if end is None or _is_other_side(marks.sides.get(action), text, start, end):
                continue
            if _is_beside(match["number"], unit, text, start, end) or _is_one_of_others(text, start, end, numbers):
                continue
            if signed and _APART.search(text, max(0, start - 40), start):
                continue
            quantity = _WITH_QUANTITY.search(text, max(0, start - 40), start) if unit or signed else None
            start = start if quantity is None else quantity.start()
            if _is_option(text, start, end, united=bool(unit), measured=bool(unit) or match["number"][0] in zero):
                yield Mention(action, match["number"], _begin(text, start), end, united=bool(unit))
                break


def _is_one_of_others(text: str, start: int, end: int, numbers: Mapping[str, object]) -> bool:
    """Return whether a number is one of several in a call or a list with no action, or has a separated sign."""
    left = text[max(0, start - 60) : start]
    if (call := _CALL_BEFORE.search(left)) is not None and (rest := _CALL_AFTER.match(text, end)) is not None:
        return "," in call[1] + rest[0]
    if _OF_LIST[0].search(left) or _OF_LIST[1].match(text, end):
        return True
    around = (_LISTED_BEFORE.search(left), _LISTED_AFTER.match(text, end))
    beside = [split_number(match["number"]) for match in around if match is not None]
    return any(one is None or one[0] not in numbers for one in beside) or SIGN_APART.search(left) is not None


def _is_beside(number: str, unit: str, text: str, start: int, end: int) -> bool:
    """Return whether a number is part of a range, a power or a bound."""
    if unit:
        before, after = text[max(0, start - 30) : start], text[end : end + 10]
        if re.match(r"[+^]|[ \t]*[-/][ \t]*[+-]?\.?\d", after):
            return True
        if re.search(rf"\d[ \t]?{re.escape(unit)}[ \t]*[-/][ \t]*\Z", before, re.IGNORECASE):
            return True
    around = (_BESIDE_BEFORE.search(text, max(0, start - 12), start), None if unit else _BESIDE_AFTER.match(text, end))
    return any(one is not None and one["number"] != number for one in around)


def _is_other_side(side: str | None, text: str, start: int, end: int) -> bool:
    """Return whether the words at a mark contradict its action's side: "2 (hard left)"."""
    if side is None:
        return False
    found = _SIDE_AFTER.match(text, end) or _SIDE_BEFORE.search(text, max(0, start - 40), start)
    return found is not None and found["side"].lower() != side


def _unit_end(text: str, start: int, unit: str) -> int | None:
    """Return the end of the unit here; None for another unit, or any unit if none is expected."""
    if not unit:
        return None if re.match(r"[\w²³^]|\s?[°%‰€$£]", text[start : start + 2]) else start
    match = re.compile(rf"[\s-]{{0,2}}{re.escape(unit)}(?![\w/^·²³]|\s?[CF]\b)", re.IGNORECASE).match(text, start)
    return None if match is None else match.end()


def _letters(text: str, marks: Marks) -> Iterator[Mention]:
    letters = marks.letters
    of_any_case = {letter.upper(): action for letter, action in letters.items()}
    for match in deque(_LETTER.finditer(text), _TOKENS_AT_MOST):
        letter, start, end = match["letter"], match.start(), match.end()
        action = letters.get(letter)
        named = _WITH_OPTION.search(text[max(0, start - 40) : start]) is not None
        closed = text[end : end + 1] == ")" and text[max(0, start - 1) : start] in {"", "(", " ", "\n"}
        closed = closed or (_OPENS.match(text, end) is not None and not re.search(r"\w", text[:start][-40:]))
        if action is None and (named or closed or _is_quoted(text, start, end)):
            action = of_any_case.get(letter.upper())
        if (not named and _is_shortened(text, match)) or _is_other_side(
            marks.sides.get(action or ""), text, start, end
        ):
            continue
        if action is not None and (letter != "I" or named or closed) and _is_option(text, start, end, letter=True):
            yield Mention(action, letter, _begin(text, start), end)


def _is_quoted(text: str, start: int, end: int) -> bool:
    """Return whether a letter is quoted behind a colon or a verb of choice: "My choice: "b""."""
    opens = _OPENS_QUOTE.search(text, max(0, start - 40), start)
    return opens is not None and _CLOSES_QUOTE.match(text, end) is not None


def _is_shortened(text: str, match: re.Match[str]) -> bool:
    """Return whether a letter is part of an abbreviation or a name, or a unit."""
    start, end = match.span()
    first = _INITIAL[0].search(text, max(0, start - 4), start)
    if (first and first[1] != match[0]) or _INITIAL[1].match(text, end) or _SPECIES.match(text, end):
        return True
    return _COUNTED.search(text, max(0, start - 4), start) is not None or (
        match["letter"].islower() and _AROUND.match(text, end) is not None
    )


def _begin(text: str, start: int) -> int:
    """Return the start of a mark with the word that introduces it: "option 3", "#3"."""
    left = text[max(0, start - 40) : start]
    match = _WITH_OPTION.search(left)
    return (
        start
        if match is None or ":" in match.group() or "is" in match.group().split()
        else start - (len(left) - match.start())
    )


def _is_option(
    text: str, start: int, end: int, *, united: bool = False, measured: bool = False, letter: bool = False
) -> bool:
    """Return whether a mark is an option: no count, no other name, no number of a line."""
    left, right = text[max(0, start - 40) : start], text[end : end + 40]
    named = _WITH_OPTION.search(left) is not None
    before = None if named or _WITH_NEXT.match(right) else _WORD_BEFORE.search(left)
    if before is not None and not (_BEFORE.fullmatch(before[1].lower()) or (measured and _SET.search(left))):
        return False
    after = _WORD_AFTER.match(right)
    if after is not None and not (_AFTER.fullmatch(after[1].lower()) or (letter and _DOES.fullmatch(after[1].lower()))):
        if after[1].lower() != "to":
            return False
        if united or named or measured:
            return not _TO_NUMBER.match(right)
        return before is not None and bool(_PICKS.fullmatch(before[1].lower()) and _TO_DO.match(right))
    if _TO_NUMBER.match(right):
        return False
    return not _numbers_a_line(text, start, end)


def _numbers_a_line(text: str, start: int, end: int) -> bool:
    """Return whether a mark is the number of a line, as in a list."""
    line = text.rfind("\n", 0, start) + 1
    if not _STARTS.fullmatch(text, line, start) or not _CLOSES.match(text, end):
        return False
    several, first = _items(text)
    return several or (first < line and not _CONCLUDES.search(text, max(0, line - 80), line))


@lru_cache(maxsize=4)
def _items(text: str) -> tuple[bool, int]:
    """Return whether several lines of a text are numbered, and the start of its first word."""
    numbered = _ITEM.finditer(text)
    return len([*islice(numbered, 2)]) > 1, len(text) - len(text.lstrip())
