"""Numbers as a quantity: their unit, the words for them, and number words.

A space has a unit if every one of its numbers has it, in its name or in an alias. Other spellings
of the unit then count too, and a "speed" or an "angle" states an action. A space whose numbers
exchange with their opposites under reflection steers.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from decimal import Decimal

from eyechart.spaces.reader.marks import is_mark, split_number

_DEGREES = (
    *(
        "°",
        "deg",
        "degs",
        "deg.",
        "degree",
        "degrees",
        "º",
        "˚",
        "Grad",
        "grado",
        "grados",
        "degré",
        "degrés",
        "gradi",
        "graus",
    ),
    *("grau", "graden", "градус", "градуса", "градусов", "度", "도"),
)
_METRES_A_SECOND = (
    *("m/s", "mps", "m/sec", "m/second", "meters/second", "metres/second", "米/秒", "米每秒", "м/с"),
    *(f"{metre}{s} per second" for metre in ("meter", "metre") for s in ("", "s")),
    "Meter pro Sekunde",
    "mètres par seconde",
    "metros por segundo",
)
_KILOMETRES_AN_HOUR = (
    *("km/h", "kmh", "kph", "km/hr", "公里/小时", "км/ч"),
    *("kilometers per hour", "kilometres per hour"),
)

_STEERING = r"steer(?:ing)?(?:[ _-](?:wheel))?(?:[ _-](?:angle|value|command|cmd|output|input|bin|level))?"
_ANGLE = rf"{_STEERING}|(?:turn(?:ing)?[ _-]|yaw[ _-])?angle"
_SPEED = "speed|velocity|cmd_vel|v_cmd"
_WANTED = (
    r"(?:(?:the|my|full|final|next|new|chosen|selected|recommended|suggested|proposed|commanded|target|desired|wanted"
    r"|appropriate|required|safe|safest|best|right|correct|set|output)[ _-]){0,3}"
)
"""Words before the name of a set quantity; ``current_speed`` or ``lead_speed`` is measured."""


@dataclass(frozen=True, slots=True)
class Quantity:
    """What the numbers of a space measure: the unit's spellings, and the words for the quantity.

    ``keyed`` is the unit's pattern in a key or label; a key with another unit means another number.
    """

    units: tuple[str, ...]
    words: str
    keyed: str = "value"

    @property
    def _named(self) -> str:
        """Return a pattern of the quantity in a key or a label."""
        return rf"{_WANTED}(?:{self.words})(?:[ _-]?(?:in[ _-])?(?:{self.keyed}|value|command|cmd))?"

    def is_key(self, key: str) -> bool:
        """Return whether a JSON key names this quantity as a setting."""
        return bool(self.words) and re.fullmatch(self._named, key, re.IGNORECASE) is not None

    def lines(self, text: str) -> Iterator[re.Match[str]]:
        """Yield the line starts of a folded text with the quantity and a colon or similar."""
        if self.words:
            yield from re.finditer(
                rf"(?:^|(?<=[.;!] ))[^\w\n]{{0,8}}{self._named}(?:[ \t]?[(\[](?:{self.keyed})[)\]])?"
                r"(?:[ \t\"']{0,4}(?:[:=]|[-=]>|\b(?:is )?set to\b)+[ \t]*|[ \t](?=[+-]?\d[^\n]{0,9}$"
                r"|[+-]?[\d.]+ ?[^\s\d,]{0,9}, (?:because|since|as|so)\b)|\((?=[+-]?[\d.]+\)[;\s]*$))",
                text,
                re.IGNORECASE | re.MULTILINE,
            )


_KINDS = (
    Quantity(_DEGREES, _ANGLE, "°|degs?|degrees?"),
    Quantity(_METRES_A_SECOND, _SPEED, "mps|ms|m_s|m/s"),
    Quantity(_KILOMETRES_AN_HOUR, _SPEED, "kmh|kph|km_h|km/h"),
)
_PLAIN = Quantity((), "")
_STEERED = Quantity((), rf"{_STEERING}|bin")


def quantity_of(written: Sequence[tuple[str, str]], *, sided: bool) -> Quantity:
    """Return what the numbers of a space measure, by its written names and their actions."""
    actions = {action for _, action in written if split_number(action) is not None}
    for kind in _KINDS:
        known = {unit.upper() for unit in kind.units}
        united = {action for name, action in written if _unit(name).upper() in known}
        if actions and actions <= united:
            return kind
    return _STEERED if sided else _PLAIN


def _unit(name: str) -> str:
    split = split_number(name) if is_mark(name) else None
    return "" if split is None else split[1].strip()


# Number words.

_SMALL = (
    *("zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve"),
    *("thirteen", "fourteen", "fifteen", "sixteen", "seventeen", "eighteen", "nineteen"),
)
_TENS = ["twenty", "thirty", "forty", "fifty", "sixty", "seventy", "eighty", "ninety"]
_WHOLE = {
    **{word: at for at, word in enumerate(_SMALL)},
    **{word: 10 * at for at, word in enumerate(_TENS, 2)},
    **{f"{ten}-{_SMALL[index]}": 10 * at + index for at, ten in enumerate(_TENS, 2) for index in range(1, 10)},
}
_ANY = "|".join(sorted(_WHOLE, key=len, reverse=True)).replace("-", "[ -]")
_MINUS = r"(?:minus|negative|moins|menos|meno|минус|负)"
_WORDED = (
    rf"(?:{_MINUS}\s+)?(?:(?:{_ANY})(?:\s+point\s+(?:{_ANY})|\s+and\s+a\s+half)?|half an?|an? half|point (?:{_ANY}))"
)
_BEHIND_OPTION = re.compile(
    rf"(?P<before>\b(?:options?|choices?|actions?|numbers?|ids?|index|bin|answer:?"
    rf"|(?:answer|choice|action|option|number)\s+is|choose|pick|select|(?:keep|hold) (?:it"
    rf"|the \w+) at)\s+)(?P<number>{_WORDED})(?![\w-])",
    re.IGNORECASE,
)
_OPENING = re.compile(
    rf"(?P<before>\A[\s\"'*]*)(?P<number>(?!one\b){_WORDED})(?=[.!]\s)(?!.*[.!\n][ \t]{{0,4}}(?:{_ANY})[.:,)])",
    re.IGNORECASE | re.DOTALL,
)
"""A number word that is the first sentence, and numbers none: "Zero. The road is straight."."""
_SIGNED = re.compile(rf"(?<![\d\w])(?<!\d\s){_MINUS}\s*(?=\.?\d)", re.IGNORECASE)
_VERB = re.compile(r"\b(?:is|choose|pick|select)\s+\Z", re.IGNORECASE)


def number_in_words(text: str) -> str | None:
    """Return the number of a number word in shortest form: "-2" for "minus two"; else None."""
    if not re.fullmatch(_WORDED, text, re.IGNORECASE):
        return None
    words = " ".join(text.lower().split())
    sign = "-" if re.match(rf"{_MINUS}\s", words) else ""
    words = re.sub(rf"^{_MINUS}\s+", "", words)
    words = re.sub(r"^(?:an? )?half(?: an?)?$", "zero and a half", re.sub("^point", "zero point", words))
    half = words.endswith(" and a half")
    whole, _, rest = words.removesuffix(" and a half").partition(" point ")
    value = _WHOLE[whole.replace(" ", "-")] + Decimal("0.5" if half else "0")
    value += Decimal(f"0.{_WHOLE[rest.replace(' ', '-')]}") if rest else 0
    split = split_number(f"{sign}{value:f}")
    return None if split is None else split[0]


_COMMA = re.compile(r"(?<![\w.,\[])([+-]?\d{1,3}),(\d{1,2})(?![\d.,]|\s?,\s?\d)")


def in_digits(text: str, units: Sequence[str], *, commas: bool) -> str:
    """Return a text with digits for number words and points for decimal commas, in a choice.

    Words count after "option" or similar, and before the space's unit; "one" has other meanings
    too. A comma is a decimal point before the unit, and in a language with decimal ``commas``.
    """
    unit = (
        rf"(?=[\s-]{{0,2}}(?:{'|'.join(map(re.escape, sorted(units, key=len, reverse=True)))})(?!\w))" if units else ""
    )
    text = _SIGNED.sub("-", text)
    text = _OPENING.sub(_digits, _BEHIND_OPTION.sub(_digits, text))
    if unit:
        text = re.sub(rf"(?<![\w-])(?P<before>)(?P<number>{_WORDED}){unit}", _digits, text, flags=re.IGNORECASE)
        text = re.sub(_COMMA.pattern + unit, r"\1.\2", text, flags=re.IGNORECASE)
    return _COMMA.sub(r"\1.\2", text) if commas else text


def _digits(match: re.Match[str]) -> str:
    number = match["number"]
    if number.lower() == "one" and _VERB.search(match["before"]):
        return match.group()
    return match["before"] + (number_in_words(number) or number)
