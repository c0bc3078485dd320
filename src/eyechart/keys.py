"""Finds keys (secrets): by their looks, by the names of their fields, and encoded in a text."""

import base64
import html
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache
from itertools import pairwise
from math import gcd

SHORTEST = 8
"""The least length of a key: a shorter value may occur in any text by chance ("EMPTY", "x")."""

_ANYWHERE = (
    r"api.?key|secret|passw|passphrase|authorization|credential|cookie|private.?key|access.?(?:key|code)|auth.?key|jwt"
    r"|bearer|(?:^|[-_])(?:key|pwd|auth|sig|signature|session|csrf)$|^(?:x[-_]|user[-_]?)?pass$"
    r"|(?:access|auth|api|bearer|id|refresh|session|user|private|security).?token$|^(?:x[-_])?token$"
)
_FIELD = re.compile(_ANYWHERE, re.IGNORECASE)
"""Names of fields that hold a key; the word "token" alone is none: models count tokens too."""
_HEADER = re.compile(rf"auth|token|signature|{_ANYWHERE}", re.IGNORECASE)
"""Names of headers that hold a key; there "token" counts."""
_SCHEME = re.compile(r"bearer|basic|token|key|api-?key|digest|negotiate|[\w-]{1,24}=", re.IGNORECASE)
"""Words that may stand next to a variable in a header that holds a key."""
_NAMED_BY_A_HASH = re.compile(
    r"(?:^|[-_.])(?:id|uuid|guid|revision|rev|commit|sha\d*|digest|hash|checksum|md5|version|etag|fingerprint|traceparent"
    r"|snapshot|build|seed)s?$|[a-z]Id$",
    re.IGNORECASE,
)
"""Names of fields that hold a hash or an id, and no key."""
_LOOKS = re.compile(
    r"(?i:\b(?:bearer|basic)\s+[\w.~+/=-]{8,}|\bbearer\s+(?=\S*\d)\S{6,}|\bdigest\s+\w+="
    r"|\b(?:token|api-?key|key)\s+(?=[\w.~+/=-]*\d)[\w.~+/=-]{12,}"
    r"|(?<![a-z0-9])(?:(?:sk|pk|rk|gsk|csk|cpk|hf|gh[pousr]|github_pat|glpat|xai|nvapi|pplx|xox[abeprs]|fw|npm|dop_v1|r8"
    r"|tgp|rpa|sbp|tvly|lsv2|jina|shpat|dckr_pat|glsa|lin_api|pypi)[_-](?=[a-z_-]*\d)[a-z0-9_-]{12,}))"
    r"|-----BEGIN [A-Z ]*PRIVATE KEY|://[^/\s:@]*:[^/\s@]+@|(?<![A-Za-z0-9])hf_[A-Za-z]{30,}"
    r"|(?<![A-Za-z0-9])sk[-_][A-Za-z]{20,}|(?<![A-Za-z0-9])dapi[0-9a-f]{32}|(?<![A-Za-z0-9])SG\.[\w-]{8,}\.[\w-]{8,}"
    r"|(?<![A-Za-z0-9])(?:ya29|hvs)\.[\w-]{16,}|(?:AKIA|ASIA)[A-Z0-9]{12,}|AIza[\w-]{20,}|eyJ[\w-]{10,}\.[\w-]{4,}"
    r"|(?<![A-Za-z0-9])(?=[A-Za-z]*\d)(?=[a-z0-9]*[A-Z])(?=[A-Z0-9]*[a-z])[A-Za-z0-9]{24,}"
)
"""The looks of a key in any text: a service's own prefix, or many random letters and digits."""
_HEX = re.compile(
    r"(?<![A-Za-z0-9])(?:[0-9a-f]{32,}|[0-9A-F]{32,}|[0-9a-fA-F]{8}-(?:[0-9a-fA-F]{4}-){3}[0-9a-fA-F]{12})"
    r"(?![A-Za-z0-9])"
)
_WORD = re.compile(r"(?<![A-Za-z0-9])(?:[a-z0-9]{20,}|[A-Z0-9]{20,})(?![A-Za-z0-9])")
_CHANGES = 6
"""The least number of changes between letters and digits in a random text; names have fewer."""
_BASE64 = re.compile(r"(?<![\w+/=-])[A-Za-z0-9+/]{20,}={0,2}(?![\w+/=-])")
_AWS = 40
_NESTED = 3
"""The most nested encodings that are decoded."""
_ESCAPE = re.compile(
    r"(?:%|\\+x|\\+u00|\\+U000000|=(?=[0-9A-F]{2}))(?=[0-9A-Fa-f]{2})(?P<hex>[0-9A-Fa-f]{2})"
    r"|\\+[ux]\{0*(?P<braced>[0-9A-Fa-f]{1,6})\}|\\+(?P<octal>[0-3][0-7]{2})"
    r"|(?P<entity>&(?:#\d{1,7}|#[xX][0-9A-Fa-f]{1,6}|[A-Za-z]{2,8});)|\\+(?P<plain>[^\w\\]|[nr])"
)
"""An escaped character, after any number of backslashes."""
_CODES = re.compile(r"(?<!\d)\d{1,3}(?:[\s,;]+\d{1,3}){7,}(?!\d)")
_BETWEEN = " \t\r\n:"
"""Characters that may separate the digits of one encoded value."""
_HEX_RUN = re.compile(r"(?<![0-9A-Fa-f])(?:[0-9A-Fa-f][ \t\r\n:]*+){16,}")
_BASE64_RUN = re.compile(r"(?<![A-Za-z0-9+/_-])(?:[A-Za-z0-9+/_-](?:[ \t]*[\r\n]+[ \t]*)?){11,}")
_BASE32_RUN = re.compile(r"(?<![A-Za-z2-7])(?:[A-Za-z2-7](?:[ \t]*[\r\n]+[ \t]*)?){13,}")
"""Whole runs of digits: a match that begins within a run is tried in vain."""
_BREAKS = {ord("n"): "\n", ord("r"): "\r"}
_ZERO = {4: "0", 6: "A", 5: "A"}
"""The zero digit of each alphabet, by the number of bits of a digit."""


def names_a_key(name: str, *, header: bool = False) -> bool:
    """Return whether the name of a field, or of a header, says that it holds a key."""
    return bool((_HEADER if header else _FIELD).search(name))


def names_a_hash(name: str) -> bool:
    """Return whether the name of a field says that it holds an id, a revision or a digest."""
    return bool(_NAMED_BY_A_HASH.search(name))


def looks_like_a_key(text: str, *, hashes: bool = False) -> bool:
    """Return whether a text seems to hold a key; with ``hashes``, ids and digests do not count."""
    if _LOOKS.search(text) or any(map(_is_base64, _BASE64.findall(text))):
        return True
    rest = _HEX.sub(" ", text)
    return (rest != text and not hashes) or any(map(_is_random, _WORD.findall(rest)))


def is_beside_a_variable(rest: str) -> bool:
    """Return whether a header without its variables is only a scheme (``Bearer``), and no key."""
    return all(_SCHEME.fullmatch(part) for part in re.split(r"[\s:;,\"'./|]+", rest) if part.strip("-_"))


def _is_random(word: str) -> bool:
    kinds = [one.isdigit() for one in word]
    changes = sum(one != other for one, other in pairwise(kinds))
    return changes >= _CHANGES and not re.fullmatch(r"[0-9a-f]+|[0-9A-F]+", word)


def _is_base64(word: str) -> bool:
    """Return whether a word is base64: letters of both cases, digits, and signs of base64."""
    if not (re.search("[a-z]", word) and re.search("[A-Z]", word) and re.search(r"\d", word)):
        return False
    padded = word.endswith("=") and len(word) % 4 == 0
    return padded or "+" in word or (len(word) == _AWS and "/" in word)


Places = Callable[[int], tuple[int, int]]
"""Maps a character of a decoded text to its start and end in the encoded text."""


def without_keys(text: str, keys: Mapping[str, str]) -> str:
    """Return a text with each key replaced by its mark, in any encoding.

    Keys are found plain, in any case, escaped, as entities, in percent, hex, base64 or base32, with
    line breaks, as a list of codes, and in nested encodings. Too short values stay.
    """
    for key, mark in sorted(keys.items(), key=lambda one: -len(one[0])):
        if len(key) < SHORTEST or len(text) < len(key):
            continue
        end, parts = len(text), list[str]()
        for start, stop in sorted(set(_stretches(text, _looked_for(key), len(key), _NESTED)), reverse=True):
            if stop <= end:
                parts += [text[stop:end], mark]
                end = start
            elif start < end:  # it overlaps the one before
                end = start
        text = text[:end] + "".join(reversed(parts))
    return text


@lru_cache(maxsize=256)
def _looked_for(key: str) -> re.Pattern[str]:
    """Return a pattern of a key, also for its bytes: decoded text has a character for each byte."""
    of_bytes = key.encode("utf-8", "surrogateescape").decode("latin-1")
    return re.compile("|".join(map(re.escape, dict.fromkeys((key, of_bytes)))), re.IGNORECASE)


def _stretches(text: str, key: re.Pattern[str], long: int, deep: int) -> Iterator[tuple[int, int]]:
    """Yield the spans of a key of ``long`` characters, plain or encoded up to ``deep`` times."""
    for found in key.finditer(text):
        yield found.span()
    for decoded, place in _decoded(text, long) if deep else ():
        for start, stop in _stretches(decoded, key, long, deep - 1):
            yield place(start)[0], place(stop - 1)[1]


def _decoded(text: str, long: int) -> Iterator[tuple[str, Places]]:
    """Yield the decoded text for each encoding that the text may be in, and that may hold so much."""
    if _ESCAPE.search(text):
        yield _unescaped(text)
    if "\n" in text:
        yield _in_one_line(text)
    for found in _CODES.finditer(text):
        yield _of_codes(found)
    for run, bits, decode in ((_HEX_RUN, 4, bytes.fromhex), (_BASE64_RUN, 6, _of_base64), (_BASE32_RUN, 5, _of_base32)):
        for found in run.finditer(text):
            if len(found[0]) * bits < 8 * long:
                continue
            at = [found.start() + place for place, sign in enumerate(found[0]) if sign not in _BETWEEN]
            signs = "".join(text[one] for one in at)
            yield from _aligned(signs, at, bits, decode)


def _in_one_line(text: str) -> tuple[str, Places]:
    """Return a text without its line breaks."""
    at = [place for place, sign in enumerate(text) if sign not in "\r\n"]
    return "".join(text[one] for one in at), lambda sign: (at[sign], at[sign] + 1)


def _of_codes(found: re.Match[str]) -> tuple[str, Places]:
    """Return the text of a list of character codes."""
    numbers = list(re.finditer(r"\d+", found[0]))
    ends = [(found.start() + number.start(), found.start() + number.end()) for number in numbers]
    return "".join(chr(int(number[0])) for number in numbers), ends.__getitem__


def _aligned(signs: str, at: Sequence[int], bits: int, decode: Callable[[str], bytes]) -> Iterator[tuple[str, Places]]:
    """Yield the decoded texts of a run of digits, for each digit that may begin the first byte."""
    group = 8 // gcd(8, bits)  # digits until one begins a byte again
    for skipped in range(group):
        kept = signs[skipped:]
        whole = decode(kept + _ZERO[bits] * (-len(kept) % group))
        found = whole[: len(kept) * bits // 8].decode("latin-1")

        def place(byte: int, skipped: int = skipped) -> tuple[int, int]:
            first, last = byte * 8 // bits, -(-(byte + 1) * 8 // bits)
            return at[skipped + first], at[skipped + last - 1] + 1

        yield found, place


def _of_base64(signs: str) -> bytes:
    return base64.b64decode(signs.replace("-", "+").replace("_", "/"))


def _of_base32(signs: str) -> bytes:
    return base64.b32decode(signs, casefold=True)


def _unescaped(text: str) -> tuple[str, Places]:
    """Return a text with its escapes decoded."""
    parts, ends, last = list[str](), list[tuple[int, int]](), 0
    for found in _ESCAPE.finditer(text):
        sign = _sign(found)
        parts += [text[last : found.start()], sign]
        ends += [(index, index + 1) for index in range(last, found.start())] + [found.span()] * len(sign)
        last = found.end()
    parts.append(text[last:])
    ends += [(index, index + 1) for index in range(last, len(text))]
    return "".join(parts), ends.__getitem__


def _sign(found: re.Match[str]) -> str:
    """Return the character of an escape."""
    if digits := found["octal"] or found["hex"] or found["braced"]:
        number = int(digits, 8 if found["octal"] else 16)
        return chr(number) if number <= sys.maxunicode else ""
    return html.unescape(found["entity"]) if found["entity"] else found["plain"].translate(_BREAKS)
