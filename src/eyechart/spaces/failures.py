"""Failures that a JSON answer reports about itself: an error field, or a missing picture.

The list of words is short, because common words occur in other fields too: "no lead in the picture"
is no failure.
"""

import re
from collections.abc import Iterable, Iterator

from eyechart.spaces.space import PICTURE_ASKED_FOR

_FAILURES = """
error errors errormessage errormsg errorcode errorreason errordetail errordetails exception failed failure failures
failurereason refusal refusals refusalreason refused unable
"""
_NAMES = frozenset(_FAILURES.split())
"""Field names for a failure, in lower case without separators."""
_NOTHING = frozenset(["", "0", "false", "n/a", "na", "nil", "no", "none", "null", "ok"])
"""Values of such a field that mean no failure."""

_KINDS = (
    r"(?:(?:actual|attached|camera|dashcam|driving|front|input|provided|usable|valid|video|visible|visual)\s+){0,2}"
)
_PICTURE = (
    rf"{_KINDS}"
    r"(?:images?|pictures?|photos?|photographs?|frames?|feed|visual (?:input|information|content))"
)
_ENDS = (
    r"(?:\s+(?:data|input|content|files?)\b)?(?=\s*(?:$|[^\w\s'-]|(?:and|attached|available|because|but|found|from|given|has"
    r"|here|i|included|is|present|provided|received|seen|sent|shown|so|supplied|that|therefore|to|uploaded|visible|was|were"
    r"|which|with|yet|you)\b))"
)
"""What may follow: not "no image noise", "no picture of a lead", or "I can't see its edges"."""
_CAME = r"(?:accessible|attached|available|given|included|loaded|opened|provided|received|sent|supplied|uploaded)"
_NO_PICTURE = re.compile(
    rf"\b(?:no|missing|without (?:access to )?(?:(?:seeing )?(?:any|an?|the)\b)?)\s*\b{_PICTURE}\b{_ENDS}"
    rf"|\b{_PICTURE}\s+(?:(?:(?:is|was|are|were|has|have|could|can)(?:n't|not| not)|not)\s+(?:been |be )?{_CAME}"
    rf"|(?:(?:is|was|are|were)\s+)?(?:missing|unavailable|absent)|not found)\b"
    r"|\b(?:can(?:no|')t|can not|could(?:n't| not)|unable to|not able to|(?:do|did)(?:n't| not)|never)\s+"
    r"(?:actually |currently |directly )?(?:access|find|get|have(?: access to)?|load|open|process|receive|see|view)\s+"
    rf"(?:(?:any|an?|the|this|that|your)\s+)?{_PICTURE}\b{_ENDS}"
    r"|\b(?:(?:is|was|are|were|am)(?:n't| not| never)|(?:have|has|had)(?:n't| not| never) been)\s+(?:given|shown|sent"
    rf"|(?:provided|supplied)(?: with)?)\s+(?:any|an?|the)\s+{_PICTURE}\b{_ENDS}"
    rf"|{PICTURE_ASKED_FOR}",
    re.IGNORECASE,
)

_BESIDES = re.compile(
    rf"\b(?:previous|prior|earlier|last|next|rear|side|second)(?:[ -]view)?\s+{_KINDS}\Z", re.IGNORECASE
)
"""Words before a picture that is not the current one."""
_HAS_PICTURE = re.compile(
    r"(?:(?:is|was|has|have|had|got|can|could|received?|sees?|saw|view|access|the|an?|any)\s)*"
    rf"{_PICTURE}(?:\s(?:is|was|has been))?(?:\s(?:{_CAME}|visible|present|seen|shown|readable|valid|found|exists))?",
    re.IGNORECASE,
)
"""A field name that says that there is a picture."""
_OF_PICTURE = re.compile(rf"{_PICTURE}(?:\s(?:status|state|input|data))?", re.IGNORECASE)
_NONE_CAME = re.compile(rf"none|null|n/a|missing|unavailable|absent|not (?:been )?{_CAME}|not found")
"""Values that say that a picture is missing, in the picture's own field."""


_VIEW = (
    r"(?:images?|pictures?|photos?|photographs?|frames?|scene|views?|camera|lens|feed|video"
    r"|visual (?:input|information))"
)
_SEE = r"(?:see|view|discern|make out|distinguish|recogni[sz]e|identify|perceive|tell|determine|judge|assess|interpret)"
_SPOILT = (
    r"(?:dark|bright|black|white|gr[ae]y|blurr?(?:y|ed)|noisy|foggy|hazy|grainy|dim|washed[ -]out"
    r"|(?:over|under)[ -]?exposed|pixelated|distorted|degraded|compressed|dirty|low[ -](?:contrast|quality|resolution))"
)
_LOST = (
    r"(?:blank|unreadable|illegible|unclear|obscured|occluded|obstructed|corrupt(?:ed)?|unusable"
    r"|unintelligible|indiscernible|unrecogni[sz]able|blocked|covered"
    r"|not (?:clear|usable|legible|readable|visible|discernible|recogni[sz]able|interpretable))"
)
_HOW = r"(?:\s+(?:is|are|was|looks?|seems?|appears?|being|has become|to be|quite|so|very|now))*"
_MUCH = (
    r"(?:too|completely|entirely|totally|fully|all|pure|extremely|heavily|severely"
    r"|(?:almost|nearly) (?:completely|entirely|all|pure)?)"
)
_CANNOT_SEE = re.compile(
    r"\b(?:can(?:no|')t|can not|could(?:n't| not)|unable to|not able to|impossible to|hard for me to)\s+"
    rf"(?:(?:\w+ly|really|even)\s+)?{_SEE}\s+"
    rf"(?:anything|much|enough|clearly|well|properly|details?|any (?:details?|features?|objects? clearly)"
    rf"|what|where|whether|if|how|(?:the|this|that|your|my)\s+(?:\w+\s+)?(?:{_VIEW}|road|lane)\b|ahead\b)"
    rf"|\b{_VIEW}\b(?:\s+content)?{_HOW}\s+(?:{_MUCH}\s+{_SPOILT}|(?:{_MUCH}\s+)?{_LOST})\b"
    rf"|\b{_MUCH}\s+{_SPOILT}\s+(?:{_VIEW}|to\s+{_SEE})\b|\b(?:it is|it's)\s+too\s+{_SPOILT}\b"
    r"|\b(?:no|zero|insufficient|inadequate|lack of)\s+(?:usable\s+|visual\s+)?(?:visibility|view of the road)\b"
    r"|\bvisibility\s+(?:(?:is|are|looks?|seems?|appears?)\s+)?(?:(?:near(?:ly)?\s+)?(?:zero|none|nil|insufficient|lost)|too\s+\w+)"
    r"|\bnothing\s+(?:at all\s+)?(?:is|can be)\s+(?:visible|seen|made out|discerned|discernible|recogni[sz]ed)\b"
    r"(?!\s+(?:ahead|in front|in (?:my|the|our) lane|on the road|nearby|close))",
    re.IGNORECASE,
)
"""That the picture came and shows nothing: too dark, obscured, "I cannot make out the road"."""
_NOT = re.compile(r"(?:\bnot|n't|\bnever|\bno longer)\s+(?:\w+\s+)?\Z", re.IGNORECASE)


def says_cannot_see(text: str) -> bool:
    """Return whether a text says that it sees nothing, or not enough, in the current picture.

    That no vehicle is in sight is a finding and not counted, nor is caution in poor weather.
    """
    plain = " ".join(text.replace("’", "'").replace("_", " ").split())
    if says_no_picture(plain):
        return True
    return any(not _NOT.search(plain, max(0, one.start() - 30), one.start()) for one in _CANNOT_SEE.finditer(plain))


def says_no_picture(text: str) -> bool:
    """Return whether a text says that the current picture is missing, or asks for one."""
    plain = text.replace("’", "'").replace("_", " ")
    return any(not _BESIDES.search(plain, max(0, one.start() - 80), one.start()) for one in _NO_PICTURE.finditer(plain))


def says_failed(fields: Iterable[tuple[str, object]], known: Iterable[str]) -> bool:
    """Return whether a field of an object, or of one within it, reports a failure.

    The field has a failure's name and a value, or says that there was no picture; ``known`` fields
    do not count. Objects are lists of names and values.
    """
    return any(_fails(name, value) for name, value in _every(fields) if name not in known)


def lacks_picture(fields: Iterable[tuple[str, object]]) -> bool:
    """Return whether a field of an object, or of one within it, says that there was no picture.

    Its text may say so, or its name and text, or a true name: "image_missing". A false value for a
    picture's name counts too: ``"image_received": false``.
    """
    return any(_lacks(name, value) for name, value in _every(fields))


def _every(fields: Iterable[object]) -> Iterator[tuple[str, object]]:
    """Yield every field of an object and of those within it; a list's items have no name."""
    for field in fields:
        name, value = field if isinstance(field, tuple) else ("", field)
        yield name, value
        if isinstance(value, list):
            yield from _every(value)


def _fails(name: str, value: object) -> bool:
    if re.sub(r"[\W_]", "", name.lower()) in _NAMES and not _is_nothing(value):
        return True
    return _lacks(name, value)


def _lacks(name: str, value: object) -> bool:
    named = re.sub(r"(?<=[a-z])(?=[A-Z])|[\W_]+", " ", name)
    if value is True:
        return says_no_picture(named)
    text = value.strip(" .").lower() if isinstance(value, str) else ""
    if value is False or text in {"false", "no"}:
        return _HAS_PICTURE.fullmatch(named) is not None
    return says_no_picture(text) or (
        _NONE_CAME.fullmatch(text) is not None and _OF_PICTURE.fullmatch(named) is not None
    )


def _is_nothing(value: object) -> bool:
    """Return whether a value means no failure; a list or an object does if all its values do."""
    if isinstance(value, list):
        return all(_is_nothing(one[1] if isinstance(one, tuple) else one) for one in value)
    return not value or (isinstance(value, str) and value.strip(" .").lower() in _NOTHING)
