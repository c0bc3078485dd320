"""Tells errors that prove a request wrong from those that may pass.

A status alone proves nothing about a request: gateways, proxies and load balancers send 400, 409,
413 and 422 too, also as JSON. An error that speaks of temporary trouble proves nothing either.
A request is wrong if a JSON error names its field or its limit, or says that its content was
moderated. An error about the key, the account or the model's name stops the calls of the model.
Everything else is a transport fault, which may pass (docs/decisions/calls.md).
"""

import json
import re
from collections.abc import Iterator, Mapping
from http import HTTPStatus
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
"""The kind of a status by itself; any other is `server_error` from 500 on, and `gateway` below."""
_PROVING = frozenset({400, 413, 422})
_MODERATING = frozenset({400, 403, 422, 451})
_SPENDING = frozenset({400, 402, 403, 413, 422, 429})
_PASSING_CODES = frozenset({408, 425, 429, *range(500, 600)})
_DEEPEST = 20
_LONGEST = 8_000
_MOST_TEXTS = 100
_SHOWN = 300


def _any(*either: str) -> re.Pattern[str]:
    return re.compile("|".join(either), re.IGNORECASE)


_TROUBLE = _any(
    # a request to wait
    r"\btry(?:ing)? (?:\w+ ){0,3}again|\bretry|again later|try later|come back|\bwait(?:ing)?\b|slow down"
    r"|temporar|transient",
    # load
    r"overload|\bbusy\b|capacity|exhausted|throttl|congest|rate[ _-]?limit|too many (?:open|concurrent|pending|active)",
    r"too many (?:requests|connections|files|sessions|users|calls)|concurren|simultaneous|in[ _-]?flight|\bqueu",
    r"\bpending\b|\bsessions?\b|per[ _-](?:second|minute|hour|day|week|month)|\b[rt]p[smd]\b|(?:high"
    r"|heavy) (?:load|demand)",
    r"shedding|too loaded|heavily loaded|limits? (?:(?:is|was|has been|have been) )?(?:reached|hit)\b",
    r"maximum number of [^.]{0,60}(?:reached|hit)\b|\b(?:no|free|idle) slots?\b",
    # a broken connection
    r"upstream|gateway|proxy|tim(?:ed?|ing)[ -]?out|deadline|unavailable|not (?:yet|currently|ready)\b",
    r"connect|\breset\b|unreach|could not (?:be )?(?:reach|forward|rout|deliver)|no route|\bdns\b|\bnetwork|\bsocket",
    r"broken pipe|certificate|handshake|(?:currently|yet) available|available (?:right now|at the moment)"
    r"|invalid (?:http )?(?:response|reply)|\bload balanc",
    # a fault of the server
    r"\binternal|server[ _]?(?:side )?error|something went wrong|(?:unexpected|unknown) error|error occurred"
    r"|\bis down\b",
    r"\bdied\b|\bdead\b|engine ?(?:dead|core|error|loop)|crash|killed|abort|cancell?ed|terminated|panic"
    r"|segfault|traceback",
    r"\bcuda|\bgpus?\b|\bnccl|\bcublas|\brocm|\bhip error|memory|kv[ _-]?cache|\bbuffer|no space left|\bdisk\b",
    r"open files|file descriptor|\bworkers?\b|\bbackends?\b|\breplicas?\b|\bnodes?\b|\bpods?\b|healthy\b|health check",
    r"maintenance|outage|degraded|draining|shut(?:ting)? ?down|\brestart|\bstarting up|is starting"
    r"|warm(?:ing)? ?up|initiali[sz]|\bloading\b",
    r"right now|at the moment|at once\b|being processed|in progress|currently (?:being|process|serving|handling"
    r"|experienc)",
    r"\b(?:server|service) (?:returned|responded|failed|did not|could not|has no)",
    r"being loaded|(?:not|un)(?: yet| fully)? ?loaded yet|not (?:yet|fully) loaded|deploying|upgrading",
)
"""Words of temporary trouble: of load, of the connection, and of the server itself."""
_DOUBT = _any(
    r"pars(?:e|ing)|decod(?:e|ing)|unexpected (?:end|token|eof)|malformed json|conflict|\bheaders?\b|\bcookies?\b",
    r"\b(?:account|plan|tier|subscription|organi[sz]ation|workspace|usage)\b",
    r"\b(?:messages?|prompts?|images?|inputs?|requests?) limit|you(?:'ve| have)? (?:exceeded|reached|hit|used)",
    r"(?<!size )(?<!token )(?<!tokens )(?<!length )(?<!context )(?<!window )limits? (?:(?:is|was|has been) )?exceeded",
)
"""Words of a damaged body or of an account's allowance: then no field or limit is proven wrong."""
_CHANGE = _any(
    r"\b(?:modify|chang|reduc|shorten|lower|resiz|compress|remov|adjust|edit|revis|rephras|reformat|correct|fix"
    r"|check|us"
    r"|provid|upload|limit|choos|select|specify|set|splitt?|decreas|crop)(?:e|ing)?\b[^.!?;]{0,120}?"
    r"\b(?:try(?:ing)?(?: \w+)?(?: again)?|retry(?:ing)?)\b",
    r"\b(?:try(?:ing)? again|retry(?:ing)?|resubmit) (?:with|using|without|after (?:chang|remov|reduc|modify"
    r"|short)\w*) "
    r"(?:an? |the |your )?\w+",
)
"""Advice to send a changed request, which says that this one is wrong."""
_MODERATED = _any(
    r"content[ _-]?polic|content[ _-]?filter|content management polic|usage polic|responsibleai|safety (?:system|polic)"
    r"|moderat|data[ _]?inspection|guardrail",
)
_VERDICT = _any(
    r"violat|block|refus|reject|trigger|filtered|disallow|not allowed|harm|unsafe|prohibit|inappropriate|sensitive"
    r"|flagged|denied|failed to comply|not comply"
)
_FLAGGED = _any(
    r"(?<!account )(?<!account was )(?<!account is )(?<!account has been )(?<!key was )\bflagged",
    r"content_policy_violation|ResponsibleAIPolicyViolation|moderation_blocked|content exists risk",
    r"(?:inappropriate|prohibited|harmful|unsafe) content",
)
"""A moderation: a filter named with its verdict, or a verdict that only a filter gives."""
_NO_KEY = _any(
    r"\b(?:api|access|auth\w*|subscription|secret)[ _-]?(?:key|token)s?\b[^.]{0,60}(?:invalid|not valid"
    r"|incorrect|missing"
    r"|expired|required|revoked|wrong|malformed|disabled|not found|not provided|denied)",
    r"(?:invalid|incorrect|missing|expired|wrong|no|valid|provide|unknown|malformed|revoked)(?: \w+){0,3}"
    r" (?:api|access|auth\w*|subscription|secret)[ _-]?(?:key|token)\b",
    r"\bAPI_KEY_INVALID|invalid_api_key|unauthori[sz]ed|authentication (?:failed|error|required)"
    r"|\bcredentials? (?:are |is )?"
    r"(?:invalid|missing|wrong|required|expired)|(?:location|country|region"
    r"|territory)\b[^.]{0,40}not (?:supported|available|allowed)",
)
"""How servers say in a 400 that a key is wrong, or not allowed in this region."""
_SPENT = _any(
    r"insufficient[ _-]?(?:quota|funds?|credits?|balance)|(?:out of|no|not enough|run out of) (?:\w+ )?credits?\b",
    r"credit balance|balance is (?:too low|insufficient)|exceeded your current quota"
    r"|billing[ _-](?:hard[ _-])?(?:soft[ _-])?"
    r"limit|billing_not_active|hard limit (?:has been )?reached|check your (?:plan and )?billing",
    r"spend(?:ing)?[ _-]limit|budget[ _]?(?:has been )?[ _]?exceeded|exceeded (?:\w+ ){0,3}budget|max budget"
    r"|payment (?:is )?"
    r"required|prepaid|arrear|good standing|overdue|limit exceeded \((?:total|daily|weekly|monthly)",
)
_ALLOWANCE = _any(
    r"\b(?:daily|weekly|monthly|free)\b[^.]{0,40}\b(?:limit|quota|allowance)",
    r"\bquota\b",
)
"""How servers say that no money or quota is left; in a 429 an allowance may be that of a minute."""
_NO_MODEL = _any(
    r"(?:invalid|unknown|no such) model(?: name| id|:|$)|\bmodel_not_found\b|not a valid model\b"
    r"|\bmodel (?:identifier|id|name)\b[^.]{0,80}\bis (?:invalid|not valid|unknown)"
    r"|\bmodel [^ ]{1,200} (?:does not exist|not found|is not (?:found|known|loaded|served|available))"
    r"|\bmodel [^ ]{1,200} (?:has been|was|is|is now) (?:deprecated|decommissioned|retired|removed|discontinued|sunset)"
)
"""How servers say in a 400 or 422 that they have no model of this name."""
_FIELDS = _any(
    r"\b(?:max_(?:completion_|new_|output_|model_)?(?:tokens|len)|num_(?:ctx|predict)|temperature|top_[pk]|seed"
    r"|response_format|json_schema|schema|image_url|images?|pictures?|vision|multi[- ]?modal|base64|messages?(?=\W)"
    r"|aspect[ _]ratio|tools|tool_choice|stream(?:_options|ing)?|(?:system|developer|user) (?:role|message|prompt"
    r"|instruction)|roles?|(?:input|output|prompt|completion|context|requested|image|new|max|maximum)"
    r" tokens?|tokens? (?:count"
    r"|in the|limit of)"
    r"|\d+ tokens|context[ _](?:length|window|size)|model(?:'s)? (?:length|context)|prompt"
    r"|inputs? (?:is|are|must|text|length|size|exceeds?|token)"
    r"|(?:thinking|reasoning)(?:_\w+)?)(?!\w)",
    r"(?:param(?:eter)?|argument|key|property|field|input|value)s?(?: supplied| name| type)?(?:: ?| ?['\"`\[])",
    r"['\"`] (?:parameter|argument|property|field)",
)
"""A field of a request: a known name, or the word "parameter" or its like with a name."""
_COMPLAINTS = _any(
    r"\b(?:exceed(?:s|ed|ing)?|maximum|at most|at least|too (?:long|large|many|big|short|small)|limit(?:s|ed)?|must"
    r"|(?:not|n't) (?:support|accept|take|match|allow|permit|valid|enabled|a valid|an? |this)\w*|unsupported"
    r"|unrecogni[sz]ed"
    r"|invalid|(?:long|larg|great|small|few|short)er than|(?:more|less) than|required?|missing|takes? no"
    r"|should (?:be|have)"
    r"|expected|unexpected (?:keyword|field|property|key|value|argument|param)|extra(?:neous)?|unknown (?:field"
    r"|param|argument|key|value)\w*|may not|only"
    r"|cannot (?:use|have|specify|exceed|contain|take|accept|unmarshal|identify)"
    r"|cannot be (?:used|set|empty|null|specified|combined|negative|zero|greater|less|more|larger|longer))\b",
    r"[<>]=",
)
"""Words that say that a field is wrong."""
_SIZES = _any(
    r"\b(?:payload|body|entity|request|upload|content|file)\b[^.]{0,40}(?:too (?:large|big|long)|size limit"
    r"|exceeds?(?:ed|ing)? [^.]{0,60}(?:size|limit|bytes|\b[kmg]i?b\b)|at most \d+ ?[kmg]?i?b|\b(?:maximum"
    r"|allowed) \w* ?size)",
)
"""A limit of the request as a whole."""
_NAMED = ("param", "parameter", "field")
_LOCATED = ("loc", "path")
_NAME = re.compile(r"/?[A-Za-z_][\w.\[\]$/-]{0,99}")
_NO_FIELDS = frozenset({"body", "request", "payload", "none", "null", "unknown", "error", "model", "na"})
_ELSEWHERE = frozenset({"query", "path", "header", "headers", "cookie", "cookies", "url", "uri"})
_KEYS = re.compile(
    r"(?:x-)?(?:api[-_]?key|authori[sz]ation|(?:access|auth)[-_]?(?:token|key)|token|key)", re.IGNORECASE
)
_ECHOES = frozenset({"input", "url", "flagged_input", "documentation_url", "help", "request_id", "body", "instance"})
"""Entries that repeat the request or hold an address: they say nothing about the fault."""
_AGAIN = frozenset(
    {"retry_after", "retryafter", "retry_after_ms", "retryable", "is_retryable", "retrydelay", "retry_delay"}
)
_WAIT = re.compile(
    r"\b(?:retry(?:ing)?|try(?:ing)? again|wait)(?: \w+){0,3}? (?:in|after|for|at least) (?:about )?"
    r"(?:(\d{1,4})h)?(?:(\d{1,4})m(?!s))?"
    r"(?:(\d{1,9}(?:\.\d{1,9})?) ?(ms|millisecond|s\b|sec|min|hour|day)?)?",
    re.IGNORECASE,
)
"""How a text gives the time to wait: "Please retry in 45.8s", "try again in 7m12s"."""
_RATE = _any(
    r"rate[ _-]?limit|rate exceeded|throttl|too many requests|slow down|(?:requests?|tokens?) per (?:second|minute)"
    r"|per[ -]minute"
)
"""How the text of a 403 says that the request came too soon and is not forbidden."""
_DELAYS = frozenset({"retry_after", "retryafter", "retry_after_ms", "retrydelay", "retry_delay"})
_BARE = frozenset(
    {re.sub(r"[^a-z]", "", status.phrase.lower()) for status in HTTPStatus}
    | {"payloadtoolarge", "contenttoolarge", "entitytoolarge", "requestentitytoolarge", "unprocessablecontent"}
)
"""Names of statuses, which say no more than their numbers."""
_PAGE = re.compile(r"<\s*(?:!doctype|html|head|body|center|h1)\b", re.IGNORECASE)
WITHIN = "error in a reply of status 200: "
"""The start of the text of an error that came with status 200."""
_FIELD = re.compile(r" \(field: [^ ()]{1,100}\)(?=;|\Z)")
"""What `with_proof` appends where an error names the field in an entry of its own."""


def kind_of_status(status: int, said: object = None) -> ErrorKind:
    """Return the error kind of an HTTP status.

    ``said`` is the JSON value of the body, or of the error in it; None where the body is no JSON.
    """
    entries = [*_entries(said)]
    texts = [_meant(text) for _, text in entries if isinstance(text, str)]
    words = "\n".join(text for text in texts if text)
    default = _default(status, entries, words)
    if _is_spent(status, entries, words):
        return "quota"
    passing = _passes(entries, words)
    if status in _MODERATING and _is_moderated(words):
        return "gateway" if passing else "bad_request"
    if status == 403 and passing and _MODERATED.search(words):
        return "gateway"
    if status in _SPENDING - {429} and default != "rate_limited" and _ALLOWANCE.search(words):
        return "quota"
    proven = _of_the_request(said, words, passing=passing) if status in _PROVING else None
    return proven or default


def _default(status: int, entries: list[tuple[str, object]], words: str) -> ErrorKind:
    """Return a status's own kind; a 403 may be a rate limit, and a 404 a gateway's."""
    if status == 403 and _RATE.search(words):
        return "rate_limited"
    if status == 404 and _passes(entries, words) and not _NO_MODEL.search(words):
        return "gateway"
    return _STATUSES.get(status, "server_error" if status >= 500 else "gateway")


def _is_spent(status: int, entries: list[tuple[str, object]], words: str) -> bool:
    """Return whether an error says that nothing is left to spend; not a 429 with a time to wait."""
    if status == 429:
        if any(name == "quotaId" and "PerDay" in str(value) for name, value in entries):
            return True
        if _delay_s(entries) is not None:  # Gemini mentions billing also at a limit per minute
            return False
    return status in _SPENDING and _SPENT.search(words) is not None


def delay_s(said: object) -> float | None:
    """Return the seconds to wait before a retry, by an error's entry or text; None without."""
    return _delay_s([*_entries(said)])


def _delay_s(entries: list[tuple[str, object]]) -> float | None:
    found = (_seconds(value, 1000 if "ms" in name.lower() else 1) for name, value in entries if name.lower() in _DELAYS)
    said = (_said_s(value) for _, value in entries if isinstance(value, str))
    return next((one for one in (*found, *said) if one is not None), None)


def _said_s(text: str) -> float | None:
    """Return the seconds that a text asks to wait; None where it names no time."""
    wait = _WAIT.search(text[:_LONGEST])
    if wait is None or not any(wait.groups()[:3]):
        return None
    hours, minutes, rest, unit = wait.groups()
    return 3600 * float(hours or 0) + 60 * float(minutes or 0) + _SCALES[(unit or "s").lower()] * float(rest or 0)


_SCALES = {"ms": 0.001, "millisecond": 0.001, "s": 1.0, "sec": 1.0, "min": 60.0, "hour": 3600.0, "day": 86400.0}


def _seconds(value: object, parts: int) -> float | None:
    """Return seconds: of a count of 1/``parts`` seconds, or of protobuf's form ``45.8s``."""
    if isinstance(value, str) and (said := re.fullmatch(r"(\d{1,9}(?:\.\d{1,9})?)(s?)", value.strip())):
        return float(said.group(1)) / (1 if said.group(2) else parts)
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return float(value) / parts if is_number and 0 <= value < 10**9 else None  # type: ignore[arg-type, operator]


def named_field(said: object) -> str:
    """Return the request's field that a JSON error names (by ``param``, ``loc``), or ""."""
    named = (name for one, value in _entries(said) if (name := _named(one, value)) and not _KEYS.fullmatch(name))
    return next(named, "")


def with_proof(detail: str, status: int, said: object) -> str:
    """Return the text of a `bad_request` with its proof, where the text alone does not prove it."""
    if kind_of_status(status, detail) == "bad_request":
        return detail
    short = detail if len(detail) <= _SHOWN else f"{detail[:_SHOWN]}…"
    if field := named_field(said):
        return f"{short} (field: {field})"
    texts = (_meant(text) for _, text in _entries(said) if isinstance(text, str))
    proof = next((text for text in texts if kind_of_status(status, text) == "bad_request"), "")
    return f"{short}: {proof}" if proof else detail


def is_of_the_road(reply: Reply) -> bool:
    """Return whether a call's final failure says nothing about its request, so it may be repeated.

    So does a `bad_request` of an older run, unless its text proves the request wrong.
    """
    if reply.error != "bad_request":
        return reply.error in TRANSIENT or reply.error in {"wrong_json", "too_large", "exception"}
    words = re.sub(r"\AHTTP \d+: ", "", reply.error_detail)
    if reply.status is None or _PAGE.search(words):
        return True
    status = 400 if words.startswith(WITHIN) else reply.status
    return not _FIELD.search(words) and kind_of_status(status, words.removeprefix(WITHIN)) != "bad_request"


def _of_the_request(said: object, words: str, *, passing: bool) -> ErrorKind | None:
    """Return the kind that a 400, 413 or 422 proves (key, model, request); None without proof."""
    if _NO_KEY.search(words) or any(_is_of_the_key(name, value) for name, value in _entries(said)):
        return None if passing else "auth"
    if passing:
        return None
    if _NO_MODEL.search(words):
        return "missing_model"
    return "bad_request" if named_field(said) or _names_what_is_wrong(words) else None


def _names_what_is_wrong(words: str) -> bool:
    """Return whether a sentence says that a field, or the size of the request, is wrong."""
    if _DOUBT.search(words):
        return False
    sentences = re.split(r"[.!?;](?=\s)|\n", words)
    return any(
        (_FIELDS.search(sentence) and _COMPLAINTS.search(sentence)) or _SIZES.search(sentence) for sentence in sentences
    )


def _is_moderated(words: str) -> bool:
    return bool(_FLAGGED.search(words) or (_MODERATED.search(words) and _VERDICT.search(words)))


def _passes(entries: list[tuple[str, object]], words: str) -> bool:
    """Return whether an error speaks of temporary trouble: by text, a code, or a time to wait."""
    if _TROUBLE.search(_CHANGE.sub(" ", words)):
        return True
    return any(
        (name.lower() in _AGAIN and bool(value))
        or (name in {"code", "status", "status_code", "statusCode"} and _number(value) in _PASSING_CODES)
        for name, value in entries
        if not isinstance(value, list)
    )


def _number(value: object) -> int | None:
    if isinstance(value, str) and re.fullmatch(r"\d{3}", value):
        return int(value)
    return value if isinstance(value, int) else None


def _meant(text: str) -> str:
    """Return a text without addresses and data; "" where it is only the name of a status."""
    short = re.sub(r"(?:https?://|data:)\S+", " ", text[:_LONGEST])
    return "" if re.sub(r"[^a-z]", "", short.lower()) in _BARE else short


def _named(name: str, value: object) -> str:
    """Return the request's field that an entry names as faulty, or ""."""
    if name in _NAMED and isinstance(value, str):
        parts = [value.strip()] if _NAME.fullmatch(value.strip()) else []
    elif name in _LOCATED and isinstance(value, list):
        parts = [part for part in value if isinstance(part, str)]
    else:
        return ""
    if parts and parts[0].lower() in _ELSEWHERE:
        return ""
    return next((part for part in parts if part.lower().strip("/") not in _NO_FIELDS), "")


def _is_of_the_key(name: str, value: object) -> bool:
    """Return whether an entry names the key's header as faulty."""
    parts = value if name in _LOCATED and isinstance(value, list) else [value] if name in _NAMED else []
    return any(isinstance(part, str) and _KEYS.fullmatch(part) for part in parts)


def _entries(said: object, name: str = "", depth: int = 0) -> Iterator[tuple[str, object]]:
    """Yield every value inside a JSON value with its name, also inside JSON that is a string.

    Entries that repeat the request are left out.
    """
    if depth >= _DEEPEST or name in _ECHOES:
        return
    inner = _inner(said) if isinstance(said, str) else said
    if isinstance(inner, Mapping):
        yield name, inner
        for one, value in inner.items():
            yield from _entries(value, str(one), depth + 1)
    elif isinstance(inner, list):
        yield name, inner
        for value in inner[:_MOST_TEXTS]:
            yield from _entries(value, "", depth + 1)
    else:
        yield name, said


def _inner(text: str) -> object:
    """Return the JSON object or list that a text holds, or None."""
    if text.lstrip()[:1] not in {"{", "["} or len(text) > _LONGEST:
        return None
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return None
