"""The likely causes, in words, of a model's replies to the drawn pictures."""

import re
from collections import Counter
from collections.abc import Mapping

from eyechart.calls import Emptiness, ErrorKind, Reply, is_cut, is_empty
from eyechart.modes import RequestMode
from eyechart.probe.picture_proof import SightAnswers, picture_counts
from eyechart.spaces.space import ending

_MODERATED = re.compile(r"content[ _-]?(?:filter|policy|management policy)|filtered|moderat", re.IGNORECASE)
_ERRORS: dict[ErrorKind, str] = {
    "auth": "the key is missing, wrong, or may not use this model: check the environment variable that holds it",
    "quota": "nothing is left to spend on this account",
    "missing_model": "there is no model of this name at this address, or the address is wrong",
    "connection": "no server answers at this address: is it running, and is --base-url right?",
    "timeout": "no reply in time: the model may still be loading, or needs a longer --timeout",
    "rate_limited": "the server takes no more calls for now (429): try again later",
    "server_error": "the server fails at this request: its log says why",
    "cut_short": "the connection breaks before a reply is complete: a proxy may do that",
    "unreadable": "the reply is no chat completion: is --base-url right (it often ends in /v1)?",
    "gateway": "a proxy or gateway rejects the request: is --base-url right (https, /v1)?",
    "wrong_json": "the reply is no chat completion: is --base-url right (it often ends in /v1)?",
    "too_large": "the reply is no chat completion: is --base-url right?",
    "bad_request": "the server refuses the request",
    "exception": "the adapter failed",
    "not_called": "earlier calls of the callable have not returned: it hangs, or needs a longer --timeout",
}


def likely_causes(sight: SightAnswers, mode: RequestMode, facts: Mapping[str, str]) -> tuple[str, ...]:
    """Return the likely causes of a blind, inconclusive or doubtful result, the likeliest first."""
    if sight.takes_no_pictures:
        refused = next(shot.reply.error_detail for shot in sight.shots if shot.reply.error is not None)
        return (_why_refused(refused),)
    if not any(reply.error is None for reply in sight.replies):
        return _failures(sight, mode)
    outcome, found = sight.outcome, _beside_the_text(sight)
    if sight.is_cached_by_words:
        found.append(
            "a cache between here and the model finds replies by their words and not by their picture. Every frame of "
            "a battery would get the same reply; words that were never sent before were answered rightly"
        )
    elif outcome == "blind":
        found += _why_blind(sight)
    elif outcome == "cannot_say":
        found += _why_unsaid(sight, mode)
    if not sight.is_cached_by_words and sight.is_sudden_by_words:
        found.append("a cache is suspected: different pictures with the same words got the identical reply at once")
    elif not sight.is_cached_by_words and sight.is_sudden:
        found.append(
            "a cache is suspected: an exact repeat got the identical reply at once. Then real_repeat would not "
            "measure how far the model agrees with itself: switch it off"
        )
    if outcome != "sees" and "warning" in facts:
        found.append(facts["warning"])
    return tuple(found)


_TOO_LONG = re.compile(
    r"(prompt|input)[^.]{0,60}\b(long|length|exceed)|context[ _](length|window|size)|model length", re.IGNORECASE
)
_NO_DATA_URL = re.compile(
    r"data[ -]?ur[il]s?\b|only https?\b|\bhttps?:// (and|or) https?://|must be an? https? url", re.IGNORECASE
)


def _why_refused(detail: str) -> str:
    """Return why every picture is refused although text alone is answered."""
    shown = f"({detail[:200]})"
    if _TOO_LONG.search(detail):
        return (
            "a picture takes more context than the server gives: make pictures smaller, or at the server lower "
            f"max_pixels or raise --max-model-len (num_ctx) {shown}"
        )
    if _NO_DATA_URL.search(detail):
        return (
            "the server takes pictures by an http address only and refuses data URLs, which eyechart sends: allow "
            f"data URLs there, or use a gateway that takes them {shown}"
        )
    return f"text-only backend: it answers text, and refuses pictures {shown}"


def _is_aside(reply: Reply) -> bool:
    """Return whether a reply calls a tool, refuses, or was filtered, which explains its text."""
    return reply.finish_reason == "tool_calls" or ending(reply.finish_reason) == "filtered"


def _beside_the_text(sight: SightAnswers) -> list[str]:
    """Return what replaced an answer in text: calls of tools, refusals, or filtered replies."""
    came = [shot.reply for shot in sight.shots if shot.reply.error is None]
    tools = sum(reply.finish_reason == "tool_calls" for reply in came)
    declined = sum(reply.finish_reason == "refusal" for reply in came)
    filtered = sum(ending(reply.finish_reason) == "filtered" for reply in came) - declined
    moderated = sum(
        shot.reply.error == "bad_request" and _MODERATED.search(shot.reply.error_detail) is not None
        for shot in sight.shots
    )
    result = []
    if tools:
        result.append(
            f"{tools} of {len(came)} replies call a tool, although none is offered, and hold the answer in tool_calls. "
            "Switch the tool parser or the chat template's tools off at the server, or use --json-mode tool_call"
        )
    if declined:
        result.append(f"{declined} of {len(came)} replies refuse to answer (the field 'refusal')")
    if filtered or moderated:
        result.append(
            f"{filtered + moderated} of {len(sight.shots)} pictures or replies were filtered by the server: such "
            "frames count as refusals; relax its content filter if you control it"
        )
    return result


def _failures(sight: SightAnswers, mode: RequestMode) -> tuple[str, ...]:
    kinds = Counter(reply.error for reply in sight.replies if reply.error is not None)
    if not kinds:
        return (sight.cut or "no call was made",)
    (kind, _), *_ = kinds.most_common()
    detail = next(reply.error_detail for reply in sight.replies if reply.error == kind)
    known = _ERRORS[kind]
    if kind == "auth":
        known = f"{known} ({mode.key_env or 'OPENAI_API_KEY'})"
    return (f"{known} [{kind}: {detail[:600]}]",)


def _why_blind(sight: SightAnswers) -> list[str]:
    counts, adds = picture_counts(sight.image_tokens), sight.image_tokens
    result = []
    if sight.fits_first:
        result.append(
            "every answer fits the first picture of its kind: a prefix cache gives its state to other pictures; "
            "switch prefix caching off for pictures, or repair the server"
        )
    if counts is False:
        rise = "do not change" if not adds else f"change by {adds} only"
        result.append(
            f"the picture is dropped on the way (a proxy or a gateway), or the chat template has no image slot: "
            f"prompt_tokens {rise} with a picture"
        )
    elif counts:
        result.append(
            f"the server counts the picture ({adds} tokens), and the replies do not follow it. The vision part is not "
            "loaded or gets a damaged picture, or the model is too weak for these questions"
        )
    else:
        result.append(
            "text-only backend, a chat template without an image slot, or a picture dropped by a proxy: the server "
            "reports no prompt_tokens, which would tell them apart"
        )
    if 2 * sight.says_none >= len(sight.shots):
        result.append(f"{sight.says_none} of {len(sight.shots)} replies say themselves that there is no picture")
    return result


def _why_unsaid(sight: SightAnswers, mode: RequestMode) -> list[str]:
    came = [shot for shot in sight.shots if shot.reply.error is None]
    cut = sum(is_cut(shot.reply) for shot in came)
    silent = [shot for shot in came if shot.said is None and not (is_cut(shot.reply) or _is_aside(shot.reply))]
    result, empty = [], Emptiness.of(shot.reply for shot in came if not _is_aside(shot.reply))
    if empty.empty:
        result.append(empty.words)
        silent = [one for one in silent if not is_empty(one.reply)]
    result += _why_missing(sight)
    if cut:
        result.append(
            f"{cut} of {len(came)} replies were cut off at the budget of {mode.max_tokens} tokens: raise --max-tokens, "
            "or let 'eyechart probe' find the budget"
        )
    if silent:
        result.append(
            f"{len(silent)} of {len(came)} replies name none of the choices (the first: "
            f"{silent[0].reply.text.strip()[:60]!r}): the model is too weak for a question, or was trained for one "
            f"kind of answer. {_dependence(sight)}"
        )
    if not result and not _beside_the_text(sight):
        result.append(
            "it is right too often to be called blind, and not often enough to exclude guessing. It is too "
            "weak or too noisy for these questions; another --seed gives other questions"
        )
    return result


def _why_missing(sight: SightAnswers) -> list[str]:
    """Return why questions have no reply."""
    result = [] if sight.cut is None else [f"the questions ended early: {sight.cut}"]
    kinds = Counter(shot.reply.error for shot in sight.shots if shot.reply.error is not None)
    if kinds:
        result.append("calls failed: " + ", ".join(f"{count} {kind}" for kind, count in kinds.items()))
    return result


def _dependence(sight: SightAnswers) -> str:
    """Return the evidence in words that the picture arrives, where the replies are no answers."""
    texts = {shot.reply.text for shot in sight.shots if shot.reply.error is None}
    counts, adds = picture_counts(sight.image_tokens), sight.image_tokens
    arrives = {
        True: f"The server counts the picture ({adds} tokens), so something of it arrives",
        False: f"A picture adds {adds} tokens by the server's count, which is no sign that it arrives",
        None: "The server does not say how many tokens a picture takes",
    }[counts]
    follow = "all replies are the same" if len(texts) == 1 else f"there were {len(texts)} different replies"
    return f"{arrives}; {follow}, which alone proves neither that it looks nor that it does not"
