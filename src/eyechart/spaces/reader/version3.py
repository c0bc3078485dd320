"""Version 3 of the reading rules, for runs that began with them.

They do not change any more. Their fault is in docs/decisions/replies.md: they take the only name in
capitals for the decision, whatever the words about it.
"""

import re
from collections.abc import Iterator, Mapping

from eyechart.spaces.space import Decision, json_objects, refuses, unparsed

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
_JSON_KEYS = ("action", "decision", "answer")
_MARKER = r"\b(?:action|answer|decision)\W{0,4}(?:[:=>→–—\n-]|\bis\b)\W{0,6}"
_SHORT = 80
"""The most characters of a text in which a lower-case action is an answer: in longer prose, "the
road is straight" is none."""


def read_words(visible: str, actions: tuple[str, ...]) -> Decision[str]:
    """Return the decision of the words outside thinking.

    The first of these decides: the whole text as an action, the ``action`` of JSON objects, the
    last ``action: X``, or the only action in capitals. In a short reply without a refusal, the only
    action in any case is the last resort. Several different candidates, or a negated one, are
    ``unparsed``.
    """
    refused = refuses(visible)
    found = _find(visible, actions, any_case=not refused and len(visible) <= _SHORT)
    return Decision(None, "refused") if refused and found.action is None else found


def _find(text: str, actions: tuple[str, ...], *, any_case: bool) -> Decision[str]:
    by_name = {action.upper(): action for action in actions}
    if (bare := _bare(text)) in by_name:
        return Decision(by_name[bare])
    if stated := {_bare(action) for action in _json_actions(text)}:
        if len(stated) > 1:
            return unparsed("several_actions")
        found = by_name.get(stated.pop())
        return unparsed("unknown_action") if found is None else Decision(found)
    # Not \b: neither "non-stop" nor "right-hand" names an action.
    name = rf"(?<!\w)(?<!\w-)({'|'.join(re.escape(one) for one in sorted(by_name, key=len, reverse=True))})(?!-?\w)"
    if marked := list(re.finditer(_MARKER + name, text, re.IGNORECASE)):
        # Another action may follow on its line (``ACTION: LEFT or RIGHT``).
        following = re.compile(rf"[^\w\n]{{0,6}}(?:(?:or|and|then)[^\w\n]{{1,6}})?{name}", re.IGNORECASE)
        return _only_one([*marked[-1:], *filter(None, [following.match(text, marked[-1].end())])], by_name)
    for flags in (0, re.IGNORECASE) if any_case else (0,):
        if named := list(re.finditer(name, text, flags)):
            return _only_one(named, by_name)
    return unparsed("no_action")


def _bare(text: str) -> str:
    return text.strip(" \t\r\n.,;:!*`\"'_()[]").upper()


def _only_one(found: list[re.Match[str]], by_name: Mapping[str, str]) -> Decision[str]:
    if len({match.group(1).upper() for match in found}) != 1:
        return unparsed("several_actions")
    for match in found:
        text, start = match.string, match.start(1)
        if _NEGATION.search(text[max(0, start - 60) : start]) or _NEGATED.match(text, match.end(1)):
            return unparsed("negated")
    # get: a case-insensitive pattern takes "İ" for "I", but upper() does not.
    action = by_name.get(found[0].group(1).upper())
    return unparsed("no_action") if action is None else Decision(action)


def _json_actions(text: str) -> Iterator[str]:
    """Yield the action of each JSON object that states one; "" if it is no text."""
    for _, _, value in json_objects(text, dict):
        by_key = {key.lower(): action for key, action in value.items()}
        stated = next((by_key[key] for key in _JSON_KEYS if key in by_key), None)
        if any(key in by_key for key in _JSON_KEYS):
            yield stated if isinstance(stated, str) else ""
