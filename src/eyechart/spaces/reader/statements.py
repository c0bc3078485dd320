"""Formal statements: JSON, tags, boxes, and lines that begin with ``action:``."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from eyechart.spaces.failures import lacks_picture
from eyechart.spaces.reader.action_names import ActionNames, fold
from eyechart.spaces.reader.marks import SIDE, SIGN_APART, TURN, is_mark, split_number
from eyechart.spaces.space import PICTURE_ASKED_FOR, Decision, json_objects, refuses, unparsed

_STATED_AT_MOST = 50
_THOUGHT = re.compile(
    r"<\|begin_of_thought\|>.*?(?:<\|end_of_thought\|>|\Z)|◁think▷.*?(?:◁/think▷|\Z)|<(reasoning|thought|thoughts"
    r"|scratchpad|reflection|analysis|observation|tool_(?:response|result|output)|function_(?:response"
    r"|results?))>.*?(?:</\1>|\Z)|<\|channel\|>(?:analysis|commentary)\b.*?(?:<\|end\|>|(?=<\|channel\|>final)|\Z)"
    r"|\Aanalysis(?=[A-Z]).*?(?:assistantfinal|\Z)",
    re.DOTALL | re.IGNORECASE,
)
_TOKEN = re.compile(
    r"<\|[^<>|]{0,40}\|>|<(?:eos|bos|pad|unk|s|/s|end_of_turn|start_of_turn|sep|cls|im_end|im_start)>", re.IGNORECASE
)
_FENCE = re.compile(r"```[\w-]*|\A\s*json\s+(?=\{)")
_TAG = re.compile(r"</?[a-z][^<>\n]{0,120}>", re.IGNORECASE)
_ANSWER_TAG = re.compile(
    r"<(action|answer|final|final_answer|decision|output|response|choice|command)>(.{0,2000}?)</\1>",
    re.DOTALL | re.IGNORECASE,
)
_BOX = re.compile(r"\\boxed\s{0,3}\{((?:[^{}]|\{[^{}]{0,80}\}){0,200})\}")
_HASHED = re.compile(r"#{4}[ \t]{0,4}([^\n#]{1,80})")
_TEX = re.compile(r"\\(?:text(?:bf|it|rm|tt|sf)?|mathrm|mathbf|mathsf|mathtt|bf|it|rm|quad|,|;|!)\s?|[{}$]|\\[()\[\] ]")
_INLINE = re.compile(r"\$\s?([+-]?[\d.]+(?:°|\s?m/s)?)\s?\$(?!\d)")
_CIRC = re.compile(r"\s?\^\s?\{?\s?\\circ\b\s?\}?")

_LABELS = (
    r"action(?: input)?|answer|decision|choice|command|output|response|result|man(?:eu|oeu)ver|manoeuvre"
    r"|move|direction|control|letter"
)
_OWN = (
    r"(?:(?:the|my|your|ego|self|own|final|next|first|best|better|chosen|selected|recommended|suggested|proposed"
    r"|preferred|safe|safest|correct|right|optimal|required|necessary|intended|planned|immediate|current|now|new"
    r"|primary|main|top|driving|drive|driver|vehicle|car|robot|agent|model|assistant|user|control|controller|steering"
    r"|speed|velocity|lateral|longitudinal|lane|motion|movement|navigation|tactical|high|low|level|discrete|action"
    r"|answer|decision|tool|step|task|output|response|predicted|executed|taken|single|one|word|short"
    r"|\d{1,3})[ _.-]{0,2}){0,4}"
)
"""Words before the name of an answer."""
_CODE = r"(?:[ _.-]?(?:id|index|idx|number|num|no|code|letter|key|name))?"
_KEY_OF_ANSWER = (
    rf"(?!options\Z){_OWN}(?:{_LABELS}|tool_input|colou?r|side|count|meta_action|behaviou?r|cmd|option)s?{_CODE}"
)
_KEY = re.compile(_KEY_OF_ANSWER, re.IGNORECASE)
_COUNTS = re.compile(r"counts?|.*(?:_|\b)count", re.IGNORECASE)
"""A key whose number counts something."""
_ONLY_KEY = re.compile(
    r"steer(?:ing)?|turn|drive|do|go|next|pick(?:ed)?|selection|selected|verdict|label|prediction|category|class|value"
    r"|text|content|message|final|name|shape|colou?r|side|count|number",
    re.IGNORECASE,
)
"""A key that is the answer if it is the only one."""

_PLAINEST = ("action", "action", "decision", "answer")
_LOOSE = re.compile(
    rf"[{{,]\s{{0,40}}[\"']?({_OWN}(?:{_LABELS}))[\"']?\s{{0,10}}:\s{{0,10}}"
    rf"(?:\"([^\"\n]{{0,200}})\"|'([^'\n]{{0,200}})'|([\w .-]{{1,60}}?)\s{{0,10}}(?=,(?!\d)|[}}\n]))",
    re.IGNORECASE,
)
_FAULT = re.compile(
    r"error\w*|refus\w+|reject\w*|denied|den(?:y|ial)|abort\w*|invalid|fail\w*|warning|not|negated?|veto\w*|forbidden"
    r"|prohibited|cancel\w*|(?:is_?)?(?:un|not_)(?:safe|sure|allowed|valid|feasible)",
    re.IGNORECASE,
)
_ONLY_SHOWN = re.compile(r"\b(?:only|just|merely) an? (?:example|placeholder|sample)\b", re.IGNORECASE)
_FINE = re.compile(
    r"(?:is_?)?(?:valid|correct|safe|allowed|ok|success\w*|confident|feasible|final|sure|approved|accepted|permitted|executed)",
    re.IGNORECASE,
)
_UNLESS = re.compile(r"(?:pre_?)?conditions?|only_?if|if|when|unless|provided", re.IGNORECASE)
_CASE = re.compile(r"\b(?:if|when|unless|once|provided|only)\b", re.IGNORECASE)
"""A condition under which an action holds, and its words."""
_OTHERS = re.compile(
    r"other|lead|front|vehicle_|human|^if|^when|^unless|^else|^not$|example|sample|alternativ|option|candidate"
    r"|consider|avoid|reject|previous|last|history|past|fallback|forbidden|not_|invalid|available|possible|allowed"
    r"|schema|properties|question|prompt|input$|second|wrong|expert|(?:^|[\W_])(?:trucks?|bus(?:es)?|vans?|vehicles"
    r"|cars|pedestrians?|persons?|people|cyclists?|bicycles?|bikes?|motorcycles?|animals?|actors|agents|neighbou?rs?"
    r"|oncoming|adjacent|surround\w+)(?:$|[\W_\d])|(?:^|(?<!control)[\W_])(?!.*(?:action|decision|response|command"
    r"|choice)s?\Z)(?:obstacles?|objects?|detect\w+|hazards?|traffic|lights?|signs?|signals?|arrows?|lanes|roads?"
    r"|curves?|bends?)(?:$|[\W_\d])",
    re.IGNORECASE,
)
"""Keys whose objects are about others, or are no choice."""
_CUT_OFF = re.compile(r"\{[^{}]*\Z")
_MARKER = re.compile(
    rf"^[^\w\n]{{0,8}}(?:(?:the|my|your|final|next|chosen|recommended|best|selected|correct|suggested|safest"
    rf"|step \d)\s+){{0,4}}"
    rf"(?:(?:{_LABELS}){_CODE}|id(?=[ \t]*[:=][^:]*\Z))[ \t\"']{{0,4}}(?:[:=>]|->|-(?![\s-]*\.?\d)|\bis\b)+[ \t]*",
    re.IGNORECASE | re.MULTILINE,
)
_HEADING = re.compile(
    rf"^[^\w\n]{{0,8}}(?:(?:the|my|final|next|chosen|recommended)\s+){{0,3}}(?:{_LABELS})[ \t:=]*$",
    re.IGNORECASE | re.MULTILINE,
)
_FINAL = re.compile(r"\b(?:final|correct|corrected|revised)\b", re.IGNORECASE)
_NOTHING_SEEN = re.compile(
    r"\b(?:can(?:no|')t|unable to|not able to|could(?:n't| not)|do(?:n't| not))\s+(?:\w+\s+)?(?:see|view|access"
    r"|process|assist|help|comply|interpret|make out|judge|determine|open|load)\b[^.;\n]{0,30}?\b(?:images?|pictures?"
    r"|photos?|frames?|that|this|request|it|with)\b|\bno (?:image|picture|photo)\b"
    r"|\bas an ai\b(?![^.;!?\n]{0,60}\b(?:control|drive|move|steer)"
    rf"\b[^!?\n]{{0,40}}\b(?:but(?: if)?|however,) i\b)|\bmust decline\b|{PICTURE_ASKED_FOR}",
    re.IGNORECASE,
)
_NO_STATEMENT = re.compile(
    r"(?:\b(?:not|never|no|else|wrong|false|incorrect|example|valid|such as|looks? like|previous|earlier|format"
    r"|instead of)\b|n't\b|e\.g)",
    re.IGNORECASE,
)
_NOT_GIVEN = re.compile(r"\s*,?\s*(?:which|but)\b[^.{]*(?:\bnot\b|n't\b|\bwrong\b)", re.IGNORECASE)
_SAYS_SO = frozenset(["NONE", "UNKNOWN", "ABSTAIN", "UNSURE", "UNCLEAR", "NO IMAGE", "NO_IMAGE"])
"""Actions that mean that nothing was seen."""
_END = re.compile(r"[.!?\n]\s|\n|\|")
_CLAUSE = re.compile(r",|\bso\b|\bbut\b")
_CONDITION = re.compile(r"\bif\b|\bwould be\b")
_SHORT_WORDS = 3


@dataclass(frozen=True, slots=True)
class _Statement:
    """A statement of an object, tag or box; ``action`` None if it is no name."""

    start: int
    end: int
    action: str | None
    why: str | None = None


def _prose(text: str, names: ActionNames) -> Decision[str]:
    """Return the decision of prose; most replies do not need it."""
    from eyechart.spaces.reader.prose import read_prose  # noqa: PLC0415 - its patterns take a while to compile

    return read_prose(text, names)


def _takes_back(text: str, action: str, names: ActionNames) -> bool:
    """Return whether words withdraw an action that was stated before them."""
    from eyechart.spaces.reader.prose import takes_back  # noqa: PLC0415 - as above

    return takes_back(text, action, names)


def read_words(visible: str, names: ActionNames) -> Decision[str]:
    """Return the decision of the words outside thinking, of the first form of statement that is present.

    A reply that first says that it sees no picture or cannot help is refused, whatever follows.
    """
    visible = _GAP.sub(lambda gap: "\n" * min(2, gap[0].count("\n")) or "    ", visible)
    if (bare := names.whole(fold(visible))) is not None:
        return Decision(bare)
    text = _TOKEN.sub(" ", _THOUGHT.sub(" ", visible)).replace("\u2019", "'")
    text = _ROBOT.sub(lambda said: f"{said[1]} should {said[2] or said[3]}", text)
    text = names.in_english(_INLINE.sub(r" \1 ", _CIRC.sub("°", text)))
    words = _find(_by_number(text, names) or text, names)
    if words.action is None:
        return Decision(None, "refused") if refuses(visible) else words
    if _turns_otherwise(text, names.side(words.action)):
        return unparsed("several_actions")
    refusal = _NOTHING_SEEN.search(text)
    if words.action.upper() in _SAYS_SO:
        return words
    if refusal is not None and _prose(fold(text[: refusal.start()]), names).action != words.action:
        return Decision(None, "refused")
    return words


_ITEM = re.compile(r"^\W{0,6}(?:option )?(\d{1,2}|[a-i])[.):]+ ?([^\n]{1,80})", re.IGNORECASE | re.MULTILINE)
_BY_NUMBER = re.compile(
    r"(?:\b(?:option|number) ?[#(]?|(?<=[:=] ))(\d{1,2}|[A-I])\b\)?(?!\.?\d|,? ?(?:or|and|/|,) ?(?:option )?\d)",
    re.IGNORECASE,
)


def _by_number(text: str, names: ActionNames) -> str | None:
    """Return what follows a numbered list of names, with these for the numbers; None without both."""
    if any(map(is_mark, names.actions)) or len(items := [*_ITEM.finditer(text)][:_MARKERS_AT_MOST]) < _BOTH:
        return None
    named = {item[1].upper(): _first(fold(item[2]), names) for item in items}
    if len(named) < len(items) or None in named.values():
        return None
    rest = text[text.find("\n", items[-1].end()) :] if "\n" in text[items[-1].end() :] else ""
    said = _BY_NUMBER.sub(lambda one: named.get(one[1].upper()) or one[0], rest)
    return said if said != rest else None


def _first(text: str, names: ActionNames) -> str | None:
    """Return the action that a text begins with."""
    one = next(names.mentions(text), None)
    return None if one is None or re.search(r"\w", text[: one.start]) else one.action


_BOTH = 2
_GAP = re.compile(r"\s{5,}")
"""Blank lines and columns of spaces."""
_ROBOT = re.compile(
    r"\A(\W*the (?:robot|rover)) (?:(go)es|([a-z]{2,12}?)s)\b(?=[^.,;!?\n]{0,20},? (?:because|since|due to)\b)"
    r"(?!.*\b(?:then|or|says?)\b)",
    re.IGNORECASE | re.DOTALL,
)
"""What the robot does, at the start of a reply."""
_TURNS = re.compile(
    r"(?:^|(?<!\b\w)[.!;\n]|\b(?:so|thus|hence|therefore|i\.e\.|meaning|means)\b)[\s,:]*(?:(?:that|this|i|we|you|to"
    r"|please|the|car|robot|vehicle|it|should|will|would|must|now|just)\s+){0,5}(?:turn|steer|go|bear|swing|veer"
    r"|change|move)s?\s+(?:(?:the|car|robot|vehicle|wheel|us|lanes?|to|by|a|bit|little|hard|slightly|gently|sharply"
    r"|\d+ ?(?:°|degrees))\s+){0,4}"
    rf"{SIDE}",
    re.IGNORECASE,
)
"""An order, or what follows from a number: "So turn right"."""


_TURN_TAKEN = re.compile(
    rf"\b(?:because|since|as) {TURN}{SIDE}(?: turn| by [\w°]+(?: degrees)?)?,? (?:gets|brings|takes|leads|lines|keeps"
    r"|clears|avoids|passes|aligns|suffices|is (?:needed|enough|required|best|safest))\b"
    r"(?! [^.,;!?\n]{0,20}\b(?:into|off|dead|collision|crash|away|wall|locked|closed|stairs)\b)",
    re.IGNORECASE,
)
"""A turn as the reason of a choice."""


def _turns_otherwise(text: str, side: str | None) -> bool:
    """Return whether a reply has only turns to another side than that of its action."""
    found = () if side is None else (*_TURNS.finditer(text), *_TURN_TAKEN.finditer(text))
    said = {match["side"].lower() for match in found}
    return len(said) == 1 and said != {side}


def _find(text: str, names: ActionNames) -> Decision[str]:
    if (bare := names.whole(fold(text if "\n" in text else _uncommented(text, names)))) is not None:
        return Decision(bare)
    for form in (_objects, _tags, _boxes, _hashes, _votes, _code):
        if stated := list(form(text, names)):
            return _agreed(text, stated, names)
    text = _FENCE.sub(" ", _without_objects(_without_code(text, names)))
    if "{" in text and text.count('"', text.rfind("{")) % 2:
        text = _CUT_OFF.sub(" ", text)
    if (wholly := _WHOLLY.fullmatch(text)) is not None and (bare := names.whole(wholly[1])) is not None:
        return Decision(bare)
    folded = _ANEW_STATED.sub(r"\n\1\n", _unlisted(_TAG.sub(lambda tag: _kept(tag, names), text), names))
    if (marked := _marked(folded := _without_things(folded, names), names)) is not None:
        return marked
    read = _prose(folded, names)
    meant = None if read.action or read.why in {"several_actions", "negated"} else _MEANT.search(folded)
    return (meant and _in_brackets(meant[1], names)) or read


_OF_THING = re.compile(
    r"\W{0,8}((?:(?:the|an?|lead\w*|front|near\w*|closest|other|own|ego|current|traffic|risk|number of|\w+ed) ){0,3}"
    r"(?:(?:vehicle|car|truck|person|pedestrian|object|obstacle|detection|lane|track|frame|image|camera|sign|exit|gate|score"
    r"|confidence|distance|gap|count|speed|angle|curve)s?\b[ (]{0,2}){1,3}(?:ahead|in front|front|id|number|\d+)?)"
    r"[^\w\n]{0,8}",
    re.IGNORECASE,
)
_OF_NONE = re.compile(
    r"\W{0,8}((?!no )(?:\w+ (?:to )?)?(?:avoid|forbidden|rejected|ruled out|not recommended|previous|last|second best"
    r"|alternatives?|examples?|unsafe(?= )|possible(?= ))(?: (?:option|action|choice|answer|decision)s?)?)\W{0,8}",
    re.IGNORECASE,
)
_MEASURE = re.compile(
    r"\W{0,8}((?:id|no|number|index|code|letter|lane|score|speed|angle)\b[\s:.=#-]*)?[+-]?(?:\d[\d.]*|[A-Z]\b)"
    r"[ °]?(?:m/s|deg\w+)?\s*(?(1)(?:[,;|].*)?)",
    re.IGNORECASE,
)
"""A heading about a thing, and a line that measures it: "Lead vehicle", "id: 3"."""
_APART = re.compile(r"[^\n]*\w[^\w:=\n]*\n\s*(?![-*+•] |\W*[^\W\d]{2})")
"""A line about a thing, and below a blank one a mark that is no item."""


def _without_things(text: str, names: ActionNames) -> str:
    """Return a text without the lines that only measure the thing of a heading, or name what it denies."""
    about, last, kept = None, "", []
    for line in text.split("\n"):
        about = None if about and about.re is _OF_THING and _APART.match(last + line) else about
        last = line if line.strip() else f"{last}\n"
        if about and (_MEASURE.fullmatch(line) or (about.re is _OF_NONE and names.whole(line.strip(" -+•")))):
            continue
        if re.search(r"\w", line) and not (about and ":" in line and not _MARKER.match(line)):
            about, last = _OF_NONE.fullmatch(line) or _OF_THING.fullmatch(line), ""
            about = None if about and (names.quantity.is_key(about[1]) or names.whole(about[1])) else about
        kept.append(line)
    return "\n".join(kept)


_WHOLLY = re.compile(
    r"\s*(?:that's an? )?([+-]?[\d.]{1,6}|[A-Z])(?: \((?:free|clear|empty|open) (?:road|lane|path|way|hall)\))?[.!\s]*",
    re.IGNORECASE,
)
"""A mark and nothing else: "3 (free road)"."""
_MEANT = re.compile(
    r"(?:^|[.!\n>]\s)\s*((?:(?:hard|full|sharp|slight(?:ly)?) (?:left|right)|turn|steer|change|go|slow(?:er| down)"
    r"|faster|accelerate|brake|keep|stay|idle|maintain|speed up)\b(?![^(\n]{0,50}\b(?:cars|trucks|vehicles|vans|people"
    r"|persons|pedestrians|robots|doors|obstacles|boxes|things|leads)(?: \w+)? \()"
    r"[^.!?\n(]{0,50}\([^()\n]{1,20}\))(?:,?\s(?:because|since)\b[^.!?\n(]{1,120})?[.!\s]*$",
    re.IGNORECASE,
)
"""An order with its option in brackets: "Change lane right (2)."."""


_REPEATED = re.compile(r"[ \t]?[(\[]([^()\[\]\n]{3,120})[)\]](?=\s{0,3}[:=])")
_IN_ROW = re.compile(r"(?:(?<!\S)\(?[A-I\d]\) (?!is\b)[^\n():;.]{2,40}(?:[,;] |(?<=\s)|(?=[.\n]|\Z))){3,}")
_ONE_OF = re.compile(r"(?i)\s?(?:/(?!s)|[,|]|\b(?:or|to)\b|\.{2,}|(?<=\w)-(?=\w))\s?")


def _unlisted(text: str, names: ActionNames) -> str:
    """Return a folded text without the options that a heading or a row repeats: "Action (A/B/C): B"."""

    def kept(one: re.Match[str]) -> str:
        parts = _ONE_OF.split(one[1])
        return one[0] if len(parts) < _BOTH or any(part and not names.whole(part) for part in parts) else ""

    return _REPEATED.sub(kept, _IN_ROW.sub(" ", fold(text)))


def _kept(tag: re.Match[str], names: ActionNames) -> str:
    """Return a tag's words if one names an action, as in ``<LEFT>``; else a space."""
    inner = tag.group().strip("<>/ ")
    return f"\n{inner}\n" if any(names.mentions(inner)) else " "


def _phrase(value: str, names: ActionNames) -> Decision[str]:
    """Return the decision of a value that should be a name: "slow down", "TURN_LEFT"."""
    folded = fold(value)
    if (bare := names.whole(folded)) is not None:
        return Decision(bare)
    found = _in_brackets(folded, names) or _prose(_chosen_side(_TEX.sub(" ", folded)), names)
    return found if found.action or found.why != "no_action" else unparsed("unknown_action")


def _chosen_side(value: str) -> str:
    """Return the value of an answer; a side with a number of cars is a choice here, no state."""
    return f"I choose {value}" if _SIDE_WITH_COUNT.match(value) else value


_SIDE_WITH_COUNT = re.compile(
    r"(?:left|right)[\s\"'*]*[:(=]\s*(?:no|\d+|two|three|several|many)\s+[a-z]", re.IGNORECASE
)
_LEFT_OR_RIGHT = re.compile(r"\b(?:left|right)\b")
_BRACKETS = re.compile(r"\s*([^()\n]{1,60})\(([^()\n]{1,20})\)[\s.!]*")


def _in_brackets(value: str, names: ActionNames) -> Decision[str] | None:
    """Return the mark after its meaning, "faster (3)"; None if other words are actions."""
    match = _BRACKETS.fullmatch(value)
    action = None if match is None else names.whole(match.group(2))
    if match is None or action is None or not is_mark(action) or _prose(match.group(1), names).why != "no_action":
        return None
    if (side := names.side(action)) is not None and {*_LEFT_OR_RIGHT.findall(match.group(1).lower())} - {side}:
        return None
    if _NO_STATEMENT.search(match.group(1)) or SIGN_APART.search(value, 0, match.start(2)) or "?" in value:
        return None
    return Decision(action)


def _agreed(text: str, stated: Sequence[_Statement], names: ActionNames) -> Decision[str]:
    """Return the decision of the statements, unless the words around deny or withdraw it."""
    known = [statement for statement in stated if statement.action is not None][-_STATED_AT_MOST:]
    if not known:
        return unparsed(stated[0].why or "unknown_action")
    last = str(known[-1].action)
    before, after = (fold(_TAG.sub(" ", part)) for part in (text[: known[0].start], text[known[-1].end :]))
    if _takes_back(after, last, names) or _commits_otherwise(before, last, names):
        return unparsed("several_actions")
    actions = {statement.action for statement in known if not _is_denied(text, statement, names)}
    if len(actions) == 1:
        return Decision(actions.pop())
    return unparsed("several_actions" if actions else "negated")


_COMMITS = re.compile(
    r"\b(?:(?:i|we)(?:'ll| will| would|'d)? (?:choose|pick|select|take|go with|opt for)\b"
    r"|(?<!other )(?<!previous )(?<!last )(?<!next )(?<!second )(?:answer|choice|decision|action)(?: is\b| ?:))[^\n]*",
    re.IGNORECASE,
)
_WEIGHED = re.compile(r"\b(?:but|however|first|next|last|wait|actually|instead)\b", re.IGNORECASE)
_ANEW = re.compile(
    r"\b(?:final\w*|correct\w*|revised?|actually|wait(?=\W*[,.!])|however|reflection|instead|no|but|so|therefore"
    r"|first)\b",
    re.IGNORECASE,
)


def _commits_otherwise(before: str, action: str, names: ActionNames) -> bool:
    """Return whether the words before a statement commit to another action without weighing it."""
    found = _last(_COMMITS, before)
    return any(_takes_back(one[0], action, names) for one in found) and not _ANEW.search(before, found[0].start())


def _is_denied(text: str, statement: _Statement, names: ActionNames) -> bool:
    """Return whether the words around a statement deny it or make it conditional."""
    before = _FENCE.sub("", text[max(0, statement.start - 120) : statement.start])
    left = _END.split(before.rstrip() if before.rstrip().endswith(":") else before)[-1]
    right = _END.split(text[statement.end : statement.end + 80].partition("{")[0])[0]
    left = _NOT_THERE.sub(" ", left)
    if _NO_STATEMENT.search(_CLAUSE.split(left)[-1]) or _NOT_GIVEN.match(right):
        return True
    around = fold(f"{left} {statement.action} {right}")
    found = _prose(around, names)
    return found.action is None and (found.why == "negated" or _CONDITION.search(around) is not None)


_NOT_THERE = re.compile(
    r"\b(?:obstacles?|objects?|person|people|pedestrians?|cars?|doors?|walls?|hazards?|lead|collision|signs?|blocked)"
    r"(?:_\w{1,20})?=(?:false|no|none)\b",
    re.IGNORECASE,
)
"""What is not there: "obstacle=false next=STOP"."""

# JSON


def _objects(text: str, names: ActionNames) -> Iterator[_Statement]:
    """Yield the statements of JSON objects, or of keys and commas if no object is whole."""
    whole = False
    for start, end, value in json_objects(text, _Pairs):
        whole = whole or bool(value)
        for action, why in _stated_in(value, names):
            yield _Statement(start, end, action, why)
    if whole:
        return
    for match in _LOOSE.finditer(text):
        found_here = _phrase(next(filter(None, match.groups()[1:]), ""), names)
        yield _Statement(match.start(), match.end(), found_here.action, found_here.why)


_ANSWER, _OWN_THING, _OTHER_THING = range(3)
"""An object's container: an answer; the own motion, where a side is set and a speed measured; or another thing."""


class _Pairs(list[tuple[str, object]]):
    """An object's keys and values in order, so that no repeated key is lost."""


def _stated_in(value: object, names: ActionNames, *, within: int = _ANSWER) -> Iterator[tuple[str | None, str | None]]:
    """Yield the actions that a JSON value in a container states, or None and why one is no name."""
    if isinstance(value, list) and not isinstance(value, _Pairs):
        for inner in value:
            yield from _stated_in(inner, names, within=within)
        return
    if not isinstance(value, _Pairs):
        return
    if _is_at_fault(value) or lacks_picture(value) or _is_contrary(value, names) or _has_other_unit(value, names):
        yield None, "negated"
    elif (named := _flagged(value, names) or _called(value, names)) is not None:
        yield named, None
    elif (key := _answer_key(value, names, within=within)) is not None:
        for name, inner in value:
            if name == key or _is_another(name, inner, names):
                yield from _values(None if _is_count(name, inner) else inner, names)
    else:
        for name, inner in ((name, _given(name, inner)) for name, inner in value if not _OTHERS.search(name)):
            within_it = max(within, _thing(name, alone=len(value) == 1))
            yield from _stated_under(name, inner, names, within=within, inside=within_it)


def _stated_under(
    key: str, value: object, names: ActionNames, *, within: int, inside: int
) -> Iterator[tuple[str | None, str | None]]:
    """Yield the actions in the value of a key that is no answer's, or that contains the answer."""
    if (_KEY.fullmatch(key) or (names.quantity.is_key(key) and not within)) and _is_listed(value, names):
        return _named_in(value, names)
    return _stated_in(value, names, within=inside)


def _thing(key: str, *, alone: bool) -> int:
    """Return what an object under a key is about: an answer, the own thing, or another."""
    if _HOLDS.fullmatch(key):
        return _ANSWER
    return _OWN_THING if _MOVES.fullmatch(key) or (alone and not _SEEN.search(key)) else _OTHER_THING


_HOLDS = re.compile(
    rf"{_KEY_OF_ANSWER}|arguments|parameters|params|input|controls?|(?:\w+_)?plan|final|next"
    r"|navigation|steering|step\w*",
    re.IGNORECASE,
)
"""Keys whose objects are about the action."""
_MOVES = re.compile(
    r"(?:(?:ego|own|my|the|current|planned|next|vehicle|robot|car)_)*(?:movement|motion|drive|driving|turn|turning"
    r"|steer|heading|ego|vehicle|car|self|robot|rover|agent|lateral|longitudinal|lane_change|trajectory|path|route"
    r"|recommendations?|predictions?|step|action_?\d+|(?:control_)?signals?|high_level|low_level|policy|data|json"
    r"|value|content|message)",
    re.IGNORECASE,
)
"""Keys whose objects are about the own motion, or wrap another."""
_SEEN = re.compile(
    r"percept|percei|scene|observ|environment|context|image|picture|frame|situation|leader|world", re.IGNORECASE
)
"""Keys whose objects are about things seen."""
_LISTED = re.compile(r"id|index|idx|number|no|letter|code|name|label", re.IGNORECASE)


def _is_listed(value: object, names: ActionNames) -> bool:
    """Return whether an answer is an option of a list: ``{"id": 3, "name": "faster"}``."""
    if not isinstance(value, _Pairs) or _answer_key(value, names) is not None:
        return False
    return any(_LISTED.fullmatch(key) for key, _ in value) or {key for key, _ in value} == {"value", "unit"}


def _named_in(value: object, names: ActionNames) -> Iterator[tuple[str | None, str | None]]:
    """Yield the actions of an option's number, letter or name."""
    for key, inner in value if isinstance(value, _Pairs) else ():
        if _LISTED.fullmatch(key) or key == "value":
            number = isinstance(inner, int | float) and not isinstance(inner, bool)
            action = (
                names.whole(fold(inner)) if isinstance(inner, str) else names.action(f"{inner}") if number else None
            )
            yield action, None if action is not None else "unknown_action"


def _is_at_fault(value: _Pairs) -> bool:
    """Return whether an object reports an error of its own, or a refusal."""
    return any(
        (isinstance(inner, str) and _ONLY_SHOWN.search(inner))
        or (_FAULT.fullmatch(key) and inner not in (None, False, "", 0, "none", "None", "null"))
        or (_FINE.fullmatch(key) and (inner is False or str(inner).lower() in {"no", "false"}))
        or (_UNLESS.fullmatch(key) and isinstance(inner, str) and _CASE.search(f"{key} {inner}".replace("_", " ")))
        or (key.lower() in {"status", "state", "outcome"} and isinstance(inner, str) and _FAULT.fullmatch(inner))
        for key, inner in value
    )


_SIDE = re.compile(r"(?:steer(?:ing)?_|turn_)?(?:dir(?:ection)?|side|turn)", re.IGNORECASE)
_SIDES = {"left": "left", "l": "left", "right": "right", "r": "right"}


def _is_contrary(value: _Pairs, names: ActionNames) -> bool:
    """Return whether an object gives an action, and elsewhere the opposite side or another one."""
    sides = {_SIDES[said] for key, inner in value if _SIDE.fullmatch(key) and (said := str(inner).lower()) in _SIDES}
    keyed = [names.action(f"{inner}") for key, inner in value if _KEY.fullmatch(key) or names.quantity.is_key(key)]
    texts = [fold(inner) for inner in _texts(value) if " " in inner]
    return any(
        any(_is_of_other_side(one, side, names) for side in sides)
        or any(_is_decided_otherwise(text, one, names) for text in texts)
        for one in {*filter(None, keyed)}
    )


def _texts(value: object) -> Iterator[str]:
    """Yield the texts of a JSON value that are not about others."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, list):
        for key, inner in value if isinstance(value, _Pairs) else (("", inner) for inner in value):
            yield from () if _OTHERS.search(key) else _texts(inner)


def _is_decided_otherwise(text: str, action: str, names: ActionNames) -> bool:
    """Return whether a text beside an action chooses another without weighing it."""
    said = _commits_otherwise(text, action, names) or (is_mark(action) and not _WEIGHED.search(text))
    return said and _takes_back(text, action, names)


def _is_of_other_side(action: str, side: str, names: ActionNames) -> bool:
    """Return whether an action's sign or words name another side."""
    if (own := names.side(action)) is not None:
        return own != side
    words = {word for word in re.split(r"[\W_]+", action.lower()) if word in {"left", "right"}}
    return bool(words) and side not in words


def _has_other_unit(value: _Pairs, names: ActionNames) -> bool:
    """Return whether an object has another unit than the space's, as {"unit": "km/h"}."""
    units = {unit.upper() for unit in names.quantity.units}
    said = [inner for key, inner in value if key.lower() in {"unit", "units"} and isinstance(inner, str)]
    return bool(units) and any(one.strip().upper() not in units for one in said)


def _given(key: str, value: object) -> object:
    """Return a value; a tool call's arguments may be JSON inside a string."""
    if key != "arguments" or not isinstance(value, str):
        return value
    return next((inner for _, _, inner in json_objects(value, _Pairs)), None)


_ANOTHER = re.compile(r".*action|(?:final_)?(?:answer|choice|decision|option|letter|response|command)", re.IGNORECASE)
_CORRECTION = re.compile(
    r"(?:corrected|correction|revised|revision|updated?|amended|override[sn]?|final|new|conclusion|verdict)(?:_(?:action|answer"
    r"|choice|decision|to))?",
    re.IGNORECASE,
)


def _is_another(key: str, value: object, names: ActionNames) -> bool:
    """Return whether a key is an answer's too, as ``final_action``, with a name as its value."""
    if not _CORRECTION.fullmatch(key) and (_ANOTHER.fullmatch(key) is None or _KEY.fullmatch(key) is None):
        return False
    return names.whole(fold(value)) is not None if isinstance(value, str) else _counted(value, names).action is not None


def _answer_key(value: _Pairs, names: ActionNames, *, within: int = _ANSWER) -> str | None:
    """Return the key that holds the answer, the plainest of several; None if it is further inside."""
    known = [key for key, _ in value if _KEY.fullmatch(key) and not (within == _OTHER_THING and _SIDE.fullmatch(key))]
    if not within and all(_SIDE.fullmatch(key) for key in known):
        known = [key for key, _ in value if names.quantity.is_key(key)] or known
    if not known and len(value) == 1 and _ONLY_KEY.fullmatch(value[0][0]):
        known = [value[0][0]]
    if not known:
        return None
    key = min(known, key=_rank)
    further = all(isinstance(inner, _Pairs) and not _is_name(inner) for name, inner in value if name == key)
    return None if further else key


def _rank(key: str) -> int:
    plain = key.lower()
    return _PLAINEST.index(plain) if plain in _PLAINEST else 1 if plain.endswith("action") else len(_PLAINEST)


def _is_name(value: _Pairs) -> bool:
    """Return whether an object is one text under another key, as ``{"name": "LEFT"}``."""
    return len(value) == 1 and isinstance(value[0][1], str) and not _KEY.fullmatch(value[0][0])


def _values(value: object, names: ActionNames) -> Iterator[tuple[str | None, str | None]]:
    """Yield the statements in the value of an answer's key; a list states each of its texts."""
    if isinstance(value, _Pairs):
        value = [inner for _, inner in value]
    elif not isinstance(value, list):
        value = [value]
    for inner in value or [None]:
        if isinstance(inner, _Pairs):
            yield from _stated_in(inner, names)
            continue
        found = _phrase(inner, names) if isinstance(inner, str) else _counted(inner, names)
        yield found.action, found.why


def _is_count(key: str, value: object) -> bool:
    """Return whether a number counts something, as under ``count``."""
    return _COUNTS.fullmatch(key) is not None and not isinstance(value, str)


def _counted(value: object, names: ActionNames) -> Decision[str]:
    """Return the decision of a JSON value that is no text: a number is a name."""
    number = isinstance(value, int | float) and not isinstance(value, bool)
    action = names.action(f"{value}") if number else None
    return Decision(action) if action is not None else unparsed("unknown_action")


def _flagged(value: _Pairs, names: ActionNames) -> str | None:
    """Return the one true action of an object whose keys are actions and the others false."""
    if not value or not all(isinstance(inner, bool) and names.action(key) for key, inner in value):
        return None
    true = [key for key, inner in value if inner]
    return names.action(true[0]) if len(true) == 1 else None


def _called(value: _Pairs, names: ActionNames) -> str | None:
    """Return the action that a tool call has as its name."""
    given: Mapping[str, object] = dict(value)
    name = given.get("name")
    return names.action(name) if isinstance(name, str) and ("arguments" in given or "parameters" in given) else None


def _without_objects(text: str) -> str:
    """Return a text without its JSON objects, whose statements were read before."""
    parts, done = [], 0
    for start, end, value in json_objects(text, _Pairs):
        if value:
            parts.append(text[done:start])
            done = end
    return " ".join([*parts, text[done:]])


# Tags, boxes and lines


def _tags(text: str, names: ActionNames) -> Iterator[_Statement]:
    for match in _ANSWER_TAG.finditer(text):
        found = _phrase(match.group(2), names) if match.group(2).strip() else unparsed("no_action")
        yield _Statement(match.start(), match.end(), found.action, found.why)


def _boxes(text: str, names: ActionNames) -> Iterator[_Statement]:
    for match in _BOX.finditer(text):
        found = _phrase(_TEX.sub(" ", match.group(1)), names)
        if found.action is not None and split_number(found.action) and _SIGNED_BOX.search(text, 0, match.start()):
            found = unparsed("unknown_action")
        yield _Statement(match.start(), match.end(), found.action, found.why)


_SIGNED_BOX = re.compile(r"(?<![\w)])[-\u2012-\u2015\u2212]\$?\Z")
"""A sign before a box: its content is another number."""


def _hashes(text: str, names: ActionNames) -> Iterator[_Statement]:
    """Yield the text after four hashes, which end a worked answer."""
    for match in _HASHED.finditer(text):
        if (action := names.whole(fold(match.group(1)))) is not None:
            yield _Statement(match.start(), match.end(), action)


_CODED = re.compile(
    r"^[ \t]*return[ \t]+(?:[a-z]\w{0,40}\.)?(?P<returned>[^\s()=,;]{1,40});?[ \t]*$"
    r"|(?<![\w.])(?P<name>(?:[a-z]\w{0,30}\.){0,3}[a-z]\w{0,40})"
    r"(?:\((?:[ \t]?(?P<key>[a-z]\w{0,30})[ \t]?[=:][ \t]?)?(?P<given>[^()\n,;={}]{0,40})\)"
    r"|[ \t]?:?=[ \t]?(?P<set>\"[^\"\n]{1,40}\"|'[^'\n]{1,40}'"
    r"|[+-]?[\w.-]{1,40}°?)(?=[\s;|)\]}]|,\s|$)(?!\s*(?:or|and|to|\?|/)\b|\s?\?))",
    re.IGNORECASE | re.MULTILINE,
)
"""A call, an assignment or what is returned: "steer(-2)", "sel=B"."""
_CALLS = re.compile(r"\w\(")
_DOES = re.compile(
    r"(?:set|do|turn|exec|execute|run|select|choose|pick|take|apply|perform|send|act|issue|publish|print|output|next"
    r"|best|final|chosen|selected|sel|out|cmd|policy|behaviou?r|ans)(?:_(?:action|option|choice|command|cmd|id|bin"
    r"|letter|move))?|action_id|cmd_id|(?:move|drive|go)(?=_?$)",
    re.IGNORECASE,
)
_MOVES_BY = frozenset(["move", "drive", "go", "run", "print", "turn"])
"""Calls whose number may be a distance or a count, where none has a sign."""
_NO_CODE = re.compile(r"#|//|!\s?$|\b(?:not|or|if|elif|def|while|unless|never|assert)\b|n't\b|\?")
_STATED_ALONE = re.compile(r"[\s\"'`]*(?:$|\n|#|//|[;.,)}]|(?:here|now|because|since|as)\b)")
"""What may follow a call of an action."""
_ORDERS = re.compile(r"(?:^|\.)(?:go|turn|steer|change|drive|move|keep|make|merge)(?=_)", re.IGNORECASE)
"""How a call begins that may say an action in its other words."""
_MANY = ("actions", "options", "choices", "answers", "commands", "bins", "values", "decisions")
_PEDALS = re.compile(r"throttle|brak(?:e|es|ing)|gas|accel\w*|clutch|gear", re.IGNORECASE)
_JUST_BEFORE = 80
_HUMP = re.compile(r"(?<=[a-z])(?=[A-Z])")


def _codes(text: str) -> Iterator[re.Match[str]]:
    return _CODED.finditer(text) if "=" in text or "return" in text or _CALLS.search(text) else iter(())


def _code(text: str, names: ActionNames) -> Iterator[_Statement]:
    """Yield the actions of calls and assignments whose name or key is an answer's."""
    found = [(code, *_coded(code, names)) for code in _codes(text)]
    own = [one for one in found if one[1]][-_STATED_AT_MOST:]
    keys = [(code["key"] or code["name"] or "").rpartition(".")[2] for code, _, _ in found]
    other = any(map(_PEDALS.fullmatch, keys)) and not (names.quantity.units and any("steer" in key for key in keys))
    for code, _, action in own:
        line = text[max(0, code.start() - _JUST_BEFORE) : code.start()].rpartition("\n")[2]
        stands = not (other and is_mark(action or "")) and _NO_CODE.search(line) is None
        yield _Statement(code.start(), code.end(), action if stands else None, None if stands else "not_chosen")


def _coded(code: re.Match[str], names: ActionNames) -> tuple[bool, str | None]:
    """Return whether code is about an action that it does, and the action."""
    if code["returned"] is not None:
        return (action := names.whole(fold(code["returned"]).strip(" \"'"))) is not None, action
    called = _HUMP.sub("_", code["name"].rpartition(".")[2])
    if _OTHERS.search(code["name"].rpartition(".")[0]):
        return False, names.action(called)
    if not (code["given"] or code["set"]):
        does = not is_mark(called) and _STATED_ALONE.match(code.string, code.end()) is not None
        return (action := names.action(called)) is not None and does, action
    key, value = (
        re.sub(r"^(?:apply|send|command)_", "", code["key"] or called),
        fold(code["given"] or code["set"]).strip(" \"'"),
    )
    action = names.whole(value.rpartition(".")[2] if not value[-1:].isdigit() else value)
    moved = key in _MOVES_BY and action is not None and split_number(action) is not None
    moved = moved and not any(name.startswith("-") for name in names.actions)
    return action is not None and not moved and _is_done_by(key, action, names), action


def _is_done_by(key: str, action: str, names: ActionNames) -> bool:
    """Return whether a key or the name of a call is that of an answer."""
    if _COUNTS.fullmatch(key) or key.lower().endswith(_MANY):
        return False
    if key.lower() == "steer" and not is_mark(action):
        return True
    return any((_KEY.fullmatch(key), names.quantity.is_key(key), _DOES.fullmatch(key)))


def _without_code(text: str, names: ActionNames) -> str:
    """Return a text without the code that names an action and does none, as "prev=LEFT"."""
    parts, done = [], 0
    for code in _codes(text):
        does, action = _coded(code, names)
        empty = code["returned"] is None and not (code["given"] or code["set"])
        if empty and _ORDERS.search(code["name"]):
            empty = not any(True for _ in names.mentions(code["name"].replace("_", " ")))
        if not does and (action is not None or empty) and "= " not in code.group():
            parts.append(text[done : code.start()])
            done = code.end()
    return " ".join([*parts, text[done:]])


_VOTE = re.compile(r"[✅✓✔☑❌✗✘✖✕]|[:=-][ \t\"')]{0,3}(?:yes|no)(?=[ \t.!]*$)", re.IGNORECASE)
_VOTED = re.compile(r"[\s>•|+*]*(?:- )?(.{1,80}?)[\s\"'*]*(?:[:|(=-](?!\d)|$)")
_NO_VOTE = re.compile(
    r"\?|\b(?:(?:block|obst|dang|unsafe|risk|occup|hazard|coll|tak|wall|wrong|crash|clos|hit|avoid|reject|exclu)\w*"
    r"|not\b|off\b)",
    re.IGNORECASE,
)
"""Words before votes that do not ask for the best action: "Blocked:"."""


def _votes(text: str, names: ActionNames) -> Iterator[_Statement]:
    """Yield the one action with a yes or a tick, if every action has a line with one or its opposite."""
    lines = [(line, _VOTE.findall(line[0])) for line in re.finditer(r"[^\n]+", text) if _VOTE.search(line[0])]
    found = [
        (None if (said := _VOTED.match(_VOTE.sub("|", fold(line[0])))) is None else names.whole(said[1]), line, votes)
        for line, votes in lines
    ]
    voted = [one for one in found if one[2][0][-1] in "sS✅✓✔☑"]
    once = len(found) == len(names.actions) and {action for action, _, _ in found} == set(names.actions)
    if once and len(voted) == 1 and not any("?" in line[0] or len(votes) > 1 for _, line, votes in found):
        start = found[0][1].start()
        heading = text[:start].rstrip("\n\t -=*_|>#")
        apart = text.count("\n", len(heading), start) > 1 and heading.endswith(".")  # a sentence of its own
        bad = None if apart else _NO_VOTE.search(heading, heading.rfind("\n") + 1)
        yield _Statement(start, found[-1][1].end(), None if bad else voted[0][0], "not_chosen" if bad else None)


def _marked(text: str, names: ActionNames) -> Decision[str] | None:
    """Return the decision of the last line that begins with ``action:``; None without one.

    The last withdraws an earlier one if it is called final, or if other words are between them.
    """
    marks = sorted((*_last(_MARKER, text), *_last(_HEADING, text)), key=lambda mark: mark.start())
    marks = marks or [*names.quantity.lines(text)][-_MARKERS_AT_MOST:]
    read = [(mark.group(), mark.start(), *_value(text, mark.end(), names)) for mark in marks]
    said = [one for one in read if one[3].why not in {"no_action", "not_chosen"} and not _is_no_input(*one[:3], text)]
    if not said:
        return None
    label, start, end, last = said[-1]
    if last.action is None:
        return last if last.why == "unknown_action" or len(said) == 1 else unparsed("several_actions")
    before = text[: said[0][1]] + label
    if _takes_back(text[end:], last.action, names) or _commits_otherwise(before, last.action, names):
        return unparsed("several_actions")
    differ = (one for one in said[:-1] if one[3].action not in {None, last.action})
    if not _FINAL.search(label) and any(not re.search(r"\w", text[one[2] : start]) for one in differ):
        return unparsed("several_actions")
    return last


_ANEW_STATED = re.compile(
    r"((?:^|[.!;\n])\W{0,4}(?:no,? )?(?:wait|hold on|actually|correction|hmm+|oops)\b[^\n]{0,200}?[.!,;:]) "
    rf"(?=(?:final )?(?:{_LABELS}) ?:)",
    re.IGNORECASE,
)
"""What comes before a statement that corrects an earlier one."""


def _is_no_input(label: str, start: int, end: int, text: str) -> bool:
    """Return whether a line says that the action takes no input."""
    return _INPUT.match(label) is not None and _NOTHING.fullmatch(text[start + len(label) : end]) is not None


_INPUT = re.compile(r"\W*action input\b", re.IGNORECASE)
_NOTHING = re.compile(r"[\s\"'{(\[]*(?:none|null|n/a|nothing|empty)?[\s\"'.})\]]*", re.IGNORECASE)
_MARKERS_AT_MOST = 20
_LINE_AT_MOST = 2000
_COMMENT = re.compile(r"\s(?:#|//)\s")
_ITEMS = re.compile(r"[ \t]*[-+•][^\n]*\w[^\n]*(?:\n[ \t]*[-+•][^\n]*\w[^\n]*)+")
_SAYS = re.compile(r"[^\n]*\w[^\n]*")


def _uncommented(line: str, names: ActionNames) -> str:
    """Return a line without a comment of code that names no action."""
    code, *said = _COMMENT.split(line)
    return line if any(True for one in said for _ in names.mentions(fold(one))) else code


def _last(one: re.Pattern[str], text: str) -> list[re.Match[str]]:
    return list(one.finditer(text))[-_MARKERS_AT_MOST:]


def _value(text: str, start: int, names: ActionNames) -> tuple[int, Decision[str]]:
    """Return the end of a line's rest, or of the next line with words, and its decision."""
    match = _SAYS.search(text, start)
    if match is None:
        return len(text), unparsed("no_action")
    value = _uncommented(match.group()[:_LINE_AT_MOST], names)
    if (listed := _ITEMS.match(text, match.start())) is not None:
        return listed.end(), _prose(listed.group()[:_LINE_AT_MOST], names)
    if (bare := names.whole(value)) is not None:
        return match.end(), Decision(bare)
    read = _in_brackets(value, names) or _prose(_chosen_side(value), names)
    short = read.why == "no_action" and 0 < len(value.split()) <= _SHORT_WORDS
    return match.end(), unparsed("unknown_action") if short else read
