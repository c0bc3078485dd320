"""What a key looks like, how a field is named that holds one, and the forms in which a key is written down."""

import base64
import json
import re
from functools import lru_cache
from itertools import pairwise
from urllib.parse import quote

from eyechart.patterns import pattern

SHORTEST = 8
"""A shorter value is likely to stand in other text by chance, and is no key ("EMPTY", "x")."""

_ANYWHERE = (
    r"api.?key|secret|passw|passphrase|authorization|credential|cookie|private.?key|access.?(?:key|code)|auth.?key|jwt"
    r"|bearer|(?:^|[-_])(?:key|pwd|auth|sig|signature|session|csrf)$|^(?:x[-_]|user[-_]?)?pass$"
    r"|(?:access|auth|api|bearer|id|refresh|session|user|private|security).?token$|^(?:x[-_])?token$"
)
_FIELD = pattern(_ANYWHERE, re.IGNORECASE)
"""How a field is named that holds a key; tokens are also what a model counts, and what ends its text."""
_HEADER = pattern(rf"auth|token|signature|{_ANYWHERE}", re.IGNORECASE)
"""How a header is, where nobody counts tokens."""
_SCHEME = pattern(r"bearer|basic|token|key|api-?key|digest|negotiate|[\w-]{1,24}=", re.IGNORECASE)
"""What may stand beside a variable in a header that holds a key."""
_NAMED_BY_A_HASH = pattern(
    r"(?:^|[-_.])(?:id|uuid|guid|revision|rev|commit|sha\d*|digest|hash|checksum|md5|version|etag|fingerprint|traceparent"
    r"|snapshot|build|seed)s?$|[a-z]Id$",
    re.IGNORECASE,
)
"""How a field is named whose value is a hash or an id, and no key."""
_LOOKS = pattern(
    r"(?i:\b(?:bearer|basic)\s+[\w.~+/=-]{8,}|\bbearer\s+(?=\S*\d)\S{6,}|\bdigest\s+\w+="
    r"|\b(?:token|api-?key|key)\s+(?=[\w.~+/=-]*\d)[\w.~+/=-]{12,}"
    r"|(?<![a-z0-9])(?:(?:sk|pk|rk|gsk|csk|cpk|hf|gh[pousr]|github_pat|glpat|xai|nvapi|pplx|xox[abeprs]|fw|npm|dop_v1|r8"
    r"|tgp|rpa|sbp|tvly|lsv2|jina|shpat|dckr_pat|glsa|lin_api|pypi)[_-](?=[a-z_-]*\d)[a-z0-9_-]{12,}))"
    r"|-----BEGIN [A-Z ]*PRIVATE KEY|://[^/\s:@]*:[^/\s@]+@|(?<![A-Za-z0-9])hf_[A-Za-z]{30,}"
    r"|(?<![A-Za-z0-9])sk[-_][A-Za-z]{20,}|(?<![A-Za-z0-9])dapi[0-9a-f]{32}|(?<![A-Za-z0-9])SG\.[\w-]{8,}\.[\w-]{8,}"
    r"|(?<![A-Za-z0-9])(?:ya29|hvs)\.[\w-]{16,}|(?:AKIA|ASIA)[A-Z0-9]{12,}|AIza[\w-]{20,}|eyJ[\w-]{10,}\.[\w-]{4,}"
    r"|(?<![A-Za-z0-9])(?=[A-Za-z]*\d)(?=[a-z0-9]*[A-Z])(?=[A-Z0-9]*[a-z])[A-Za-z0-9]{24,}"
)
"""What a key looks like, wherever it stands: with a service's own beginning, or many letters and digits at random."""
_HEX = pattern(
    r"(?<![A-Za-z0-9])(?:[0-9a-f]{32,}|[0-9A-F]{32,}|[0-9a-fA-F]{8}-(?:[0-9a-fA-F]{4}-){3}[0-9a-fA-F]{12})"
    r"(?![A-Za-z0-9])"
)
_WORD = pattern(r"(?<![A-Za-z0-9])(?:[a-z0-9]{20,}|[A-Z0-9]{20,})(?![A-Za-z0-9])")
_CHANGES = 6
"""So often letters and digits alternate in what was drawn at random, and not in a name with a number or two."""
_BASE64 = pattern(r"(?<![\w+/=-])[A-Za-z0-9+/]{20,}={0,2}(?![\w+/=-])")
_AWS = 40


def names_a_key(name: str, *, header: bool = False) -> bool:
    """Return whether a field, or a header, holds a key by its name."""
    return bool((_HEADER if header else _FIELD).search(name))


def names_a_hash(name: str) -> bool:
    """Return whether a field holds an id, a revision or a digest by its name."""
    return bool(_NAMED_BY_A_HASH.search(name))


def looks_like_a_key(text: str, *, hashes: bool = False) -> bool:
    """Return whether a text holds what looks like a key; with ``hashes`` an id, a revision or a digest is none."""
    if _LOOKS.search(text) or any(map(_is_base64, _BASE64.findall(text))):
        return True
    rest = _HEX.sub(" ", text)
    return (rest != text and not hashes) or any(map(_is_random, _WORD.findall(rest)))


def is_beside_a_variable(rest: str) -> bool:
    """Return whether the rest of a header, its variables taken out, is a scheme (``Bearer``) and no text of a key."""
    return all(_SCHEME.fullmatch(part) for part in re.split(r"[\s:;,\"'./|]+", rest) if part.strip("-_"))


def _is_random(word: str) -> bool:
    kinds = [one.isdigit() for one in word]
    changes = sum(one != other for one, other in pairwise(kinds))
    return changes >= _CHANGES and not re.fullmatch(r"[0-9a-f]+|[0-9A-F]+", word)


def _is_base64(word: str) -> bool:
    """Return whether a word is base64 by its signs, where letters of both cases and digits are in it."""
    if not (re.search("[a-z]", word) and re.search("[A-Z]", word) and re.search(r"\d", word)):
        return False
    padded = word.endswith("=") and len(word) % 4 == 0
    return padded or "+" in word or (len(word) == _AWS and "/" in word)


@lru_cache(maxsize=256)
def forms_of(secret: str) -> tuple[str, ...]:
    """Return a key as a program may write it: plain, in base64, in hex, percent-encoded, escaped; long ones first.

    None for a value that is too short to be one.
    """
    if len(secret) < SHORTEST:
        return ()
    raw = secret.encode("utf-8", "surrogateescape")
    percent, escaped = quote(secret, safe="", errors="surrogateescape"), json.dumps(secret)[1:-1]
    forms = {secret, percent, percent.replace("%", "%25"), escaped, escaped.replace("/", "\\/"), raw.hex()}
    forms |= {raw.hex().upper(), quote(secret, errors="surrogateescape")}
    forms |= {percent.lower()} if percent != secret else set()
    for before, skipped in ((0, 0), (1, 2), (2, 3)):  # base64 of a text that holds it, at three alignments
        whole = base64.b64encode(bytes(before) + raw).decode()
        part = whole[skipped : (before + len(raw)) * 8 // 6]
        forms |= {part, part.replace("+", "-").replace("/", "_")}
    return tuple(sorted(forms, key=lambda form: (-len(form), form)))
