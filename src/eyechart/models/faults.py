"""What a refusal proves: that the request is wrong, so that it is refused again, or that something stood in its way.

A status alone proves nothing of a request: gateways, proxies and load balancers send 400, 409, 413 and 422 of their
own. A request is shown to be wrong where a JSON error names a field of it or a limit that it meets, or says that it
was moderated. Everything else is a fault of the road, and may pass (docs/decisions/0043).
"""

import re
from collections.abc import Iterator, Mapping
from types import MappingProxyType

from eyechart.calls import TRANSIENT, ErrorKind, Reply

_STATUSES: Mapping[int, ErrorKind] = MappingProxyType(
    {
        401: "auth",
        402: "quota",
        403: "auth",
        404: "missing_model",
        408: "timeout",
        425: "server_error",
        429: "rate_limited",
    }
)
"""What a status says by itself; another one from 500 on is a `server_error`, another one below it `gateway`."""
_PROVING = frozenset({400, 413, 422})
_MODERATING = frozenset({400, 403, 422, 451})
_DEEPEST = 20
_FIELDS = re.compile(
    r"\b(?:max_(?:completion_|new_)?tokens|num_(?:ctx|predict)|temperature|top_p|seed|response_format|json_schema"
    r"|schema"
    r"|image_url|images?|pictures?|vision|multimodal|base64|messages|tools|tool_choice"
    r"|(?:system|developer|user) (?:role|message|prompt)|roles?|tokens"
    r"|context (?:length|window|size)|prompt|parameters?|arguments?|(?:thinking|reasoning)(?:_\w+)?"
    r"|model name|max_model_len)\b",
    re.IGNORECASE,
)
_LIMITS = re.compile(
    r"\b(?:exceed(?:s|ed|ing)?|maximum|at most|too (?:long|large|many|big)|limit(?:s|ed)?|must be"
    r"|(?:not|n't) support(?:s|ed)?|unsupported|unrecognized)\b",
    re.IGNORECASE,
)
_PASSES = re.compile(
    r"try(?:ing)? again|retry|temporar|overload|\bbusy\b|upstream|gateway|proxy|tim(?:ed?|ing)[ -]?out|unavailable"
    r"|rate[ _-]?limit|too many (?:concurrent |open )?(?:requests|connections)|concurren|\bload(?:ing|ed)\b|not ready"
    r"|capacity|connect|\breset\b|conflict|pars(?:e|ing)|decod|unexpected (?:end|token|eof)",
    re.IGNORECASE,
)
_MODERATED = re.compile(
    r"moderat|flagged|content[ _-]?(?:policy|filter)|responsibleai|safety (?:system|polic)", re.IGNORECASE
)
_NO_MODEL = re.compile(
    r"(invalid|unknown|no such) model( name| id|:|$)|\bmodel_not_found\b|not a valid model\b"
    r"|\bmodel [^ ]{1,200} (does not exist|not found|is not (found|available|known|loaded|served))",
    re.IGNORECASE,
)
"""How servers say in a 400 that they have no model of this name."""
_NAMES = ("param", "parameter", "field")
_PLACES = frozenset({"body", "query", "path", "header", "cookie"})


def kind_of_status(status: int, said: object = None) -> ErrorKind:
    """Return the kind of an HTTP status that is no success.

    ``said`` is the value of the body's JSON, or of the error inside it; None where the body was none.
    """
    words = " ".join(_texts(said))
    if status in _MODERATING and _MODERATED.search(words):
        return "bad_request"
    if status == 400 and _NO_MODEL.search(words):
        return "missing_model"
    if status == 429 and ("insufficient_quota" in words or "exceeded your current quota" in words):
        return "quota"
    if status in _PROVING and _proves(said, words):
        return "bad_request"
    return _STATUSES.get(status, "server_error" if status >= 500 else "gateway")


def is_of_the_road(reply: Reply) -> bool:
    """Return whether a failure that finished a call says nothing of its request, so that it may be asked once more.

    A `bad_request` of an older run is one unless its words prove the request wrong: it may be a gateway's own.
    """
    if reply.error != "bad_request":
        return reply.error in TRANSIENT or reply.error in {"wrong_json", "too_large", "exception"}
    words = re.sub(r"\AHTTP \d+: ", "", reply.error_detail)
    if reply.status is None or re.search(r"<\s*(?:!doctype|html|head|body|center|h1)\b", words, re.IGNORECASE):
        return True
    return kind_of_status(reply.status, words) != "bad_request"


def _proves(said: object, words: str) -> bool:
    """Return whether a JSON error names a field of the request or a limit, by its own entries or in its words."""
    named = [*_named(said)]
    if any(named):
        return True
    return not named and not _PASSES.search(words) and bool(_FIELDS.search(words) or _LIMITS.search(words))


def _named(said: object, depth: int = 0) -> Iterator[bool]:
    """Yield for each entry that says where a fault lies (``param``, ``loc``) whether it names a field."""
    if depth >= _DEEPEST:
        return
    if isinstance(said, Mapping):
        for name, value in said.items():
            if name in _NAMES and isinstance(value, str):
                yield bool(value.strip()) and value not in _PLACES
            elif name == "loc" and isinstance(value, list):
                yield any(isinstance(part, str) and part not in _PLACES for part in value)
            else:
                yield from _named(value, depth + 1)
    elif isinstance(said, list):
        for value in said:
            yield from _named(value, depth + 1)


def _texts(said: object, depth: int = 0) -> Iterator[str]:
    """Yield the texts of a JSON value, not the names of its entries."""
    if isinstance(said, str):
        yield said
    elif depth < _DEEPEST and isinstance(said, Mapping | list):
        for value in said.values() if isinstance(said, Mapping) else said:
            yield from _texts(value, depth + 1)
