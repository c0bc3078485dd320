"""The reader finds the decision in a reply's verbatim text: strictly, the same way every time, and never guessing."""

import json
import re
from collections.abc import Iterator

from eyechart.actions import ActionSpace, Decision, Unparsed

READER = 3
"""The version of these rules. A run records it, so that decisions read by other rules are never taken for these."""

_REFUSAL = re.compile(
    r"\b(i\s+(can(no|')t|am\s+(unable|not\s+able)|won't|will\s+not|must\s+decline)|i'm\s+(unable|not\s+able|sorry)"
    r"|sorry|cannot\s+(assist|help|see|comply)|unable\s+to\s+(assist|help|see|determine|comply)|no\s+image\b)",
    re.IGNORECASE,
)
_NEGATION = re.compile(
    r"(\b(not|cannot|never|avoid|avoiding|no|nor|neither|without|than|instead\s+of|unable\s+to)|n't)\s+(\w+\s+)?"
    r"((to|the|a|an|on|into|towards?|go|going|turn|turning|move|moving|change|changing|steer|lanes?)\s+){0,4}[\"'`*(]*$",
    re.IGNORECASE,
)
_NEGATED = re.compile(
    r"[\"'`*)]*\s+((is|was|would\s+be)\s+(not|never|impossible|unsafe|dangerous|blocked|occupied|taken)"
    r"|isn't|wasn't|cannot|can't)\b",
    re.IGNORECASE,
)
_THINK_TAG = re.compile(r"(</?think(?:ing)?>)", re.IGNORECASE)
_JSON_KEYS = ("action", "decision", "answer")
_MARKER = r"\b(?:action|answer|decision)\W{0,4}(?:[:=>→–—\n-]|\bis\b)\W{0,6}"
READ_AT_MOST = 100_000
"""Characters outside thinking, the last ones, that are read for a decision; the ledger keeps all of a reply."""
_BRACES_AT_MOST = 1000
_LEVELS_AT_MOST = 100
_STRUCTURE = re.compile(r'"(?:[^"\\]|\\.)*+"?|[{}\[\]]', re.DOTALL)
_SHORT = 80
"""Characters up to which an action in lower case is an answer; in longer prose "the road is straight" is none."""


def read_decision(text: str, finish_reason: str | None, error: str | None, space: ActionSpace) -> Decision:
    """Read the decision from a reply's verbatim text; strict, deterministic, and never guessing.

    In order: an error, a cut-off (``length``) or a filter's refusal is the reason there is no decision. What
    stands in ``<think>`` is no answer. Then the whole text as an action; the ``action`` of its JSON objects; the
    last ``action: X``; an action in capitals named alone; in a short reply that refuses nothing, an action in any
    case named alone. The first of these that is there decides, and nothing below it is looked at.
    Several different candidates, or one that is negated, are ``unparsed``, and the Decision says which. Source:
    paper, section Corpus and parsing.
    """
    if error is not None:
        return Decision(None, "error")
    if finish_reason == "length":
        return Decision(None, "truncated")
    if finish_reason in {"content_filter", "refusal"}:
        return Decision(None, "refused")
    visible = without_thinking(text)[-READ_AT_MOST:].replace("’", "'").strip()
    if not visible:
        return Decision(None, "empty")
    refused = refuses(visible)
    decision = _find(visible, space, any_case=not refused and len(visible) <= _SHORT)
    return Decision(None, "refused") if refused and decision.action is None else decision


def refuses(text: str) -> bool:
    """Return whether a text says in words that it declines to answer; whether it answers all the same is not asked."""
    return _REFUSAL.search(text.replace("’", "'")) is not None


def without_thinking(text: str) -> str:
    """Return what stands outside thinking: its tag may have been opened by the chat template, or never closed."""
    visible: list[str] = []
    thinking = False
    for part in _THINK_TAG.split(text):
        if not _THINK_TAG.fullmatch(part):
            visible += [] if thinking else [part]
        elif part.startswith("</"):
            visible = visible if thinking else []
            thinking = False
        else:
            thinking = True
    return " ".join(visible)


def too_deep(text: str, start: int = 0) -> bool:
    """Return whether the JSON value that begins at ``start`` is nested in more than 100 levels, so that it is not read.

    A parser gives up at a depth that depends on its caller's; this bound does not.
    """
    depth = 0
    for match in _STRUCTURE.finditer(text, start):
        if match.group() in {"{", "["}:
            depth += 1
        elif match.group() in {"}", "]"}:
            depth -= 1
        if not 0 < depth <= _LEVELS_AT_MOST:
            return depth > 0
    return False


def _find(text: str, space: ActionSpace, *, any_case: bool) -> Decision:
    by_name = {action.upper(): action for action in space.actions}
    if (bare := _bare(text)) in by_name:
        return Decision(by_name[bare])
    if stated := {_bare(action) for action in _json_actions(text)}:
        if len(stated) > 1:
            return _unparsed("several_actions")
        found = by_name.get(stated.pop())
        return _unparsed("unknown_action") if found is None else Decision(found)
    # Not \b: neither "non-stop" nor "right-hand" names an action.
    name = rf"(?<!\w)(?<!\w-)({'|'.join(re.escape(one) for one in sorted(by_name, key=len, reverse=True))})(?!-?\w)"
    if marked := list(re.finditer(_MARKER + name, text, re.IGNORECASE)):
        return _only_one([*marked[-1:], *_alternative(marked[-1], name)], by_name)
    for flags in (0, re.IGNORECASE) if any_case else (0,):
        if named := list(re.finditer(name, text, flags)):
            return _only_one(named, by_name)
    return _unparsed("no_action")


def _unparsed(why: Unparsed) -> Decision:
    return Decision(None, "unparsed", why)


def _bare(text: str) -> str:
    return text.strip(" \t\r\n.,;:!*`\"'_()[]").upper()


def _alternative(marked: re.Match[str], name: str) -> list[re.Match[str]]:
    """Return the other action that follows a marked one on its line (``ACTION: LEFT or RIGHT``), if any."""
    following = re.compile(rf"[^\w\n]{{0,6}}(?:(?:or|and|then)[^\w\n]{{1,6}})?{name}", re.IGNORECASE)
    other = following.match(marked.string, marked.end())
    return [] if other is None else [other]


def _only_one(found: list[re.Match[str]], by_name: dict[str, str]) -> Decision:
    if len({match.group(1).upper() for match in found}) != 1:
        return _unparsed("several_actions")
    if any(map(_negated, found)):
        return _unparsed("negated")
    # get: ignoring case, a regular expression takes "İ" for "I", and upper() does not.
    action = by_name.get(found[0].group(1).upper())
    return _unparsed("no_action") if action is None else Decision(action)


def _negated(match: re.Match[str]) -> bool:
    text, start = match.string, match.start(1)
    return bool(_NEGATION.search(text[max(0, start - 60) : start]) or _NEGATED.match(text, match.end(1)))


def _json_actions(text: str) -> Iterator[str]:
    """Yield what each JSON object that states an action states; an empty text where that is no text."""
    for value in _json_objects(text):
        by_key = {key.lower(): action for key, action in value.items()}
        stated = next((by_key[key] for key in _JSON_KEYS if key in by_key), None)
        if any(key in by_key for key in _JSON_KEYS):
            yield stated if isinstance(stated, str) else ""


def _json_objects(text: str) -> Iterator[dict[str, object]]:
    """Yield the outermost JSON objects in a text, wherever they stand; none where it has too many braces to try.

    One that is nested too deeply is taken as text.
    """
    decoder, start = json.JSONDecoder(), text.find("{")
    if text.count("{") > _BRACES_AT_MOST:
        return
    while start >= 0:
        end = start + 1
        try:
            value, ended = decoder.raw_decode(text, start)
            if not too_deep(text, start):
                end = ended
                yield value
        except ValueError:
            pass
        except RecursionError:
            if not too_deep(text, start):
                raise
        start = text.find("{", end)
