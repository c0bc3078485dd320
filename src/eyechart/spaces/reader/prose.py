"""Which action prose chooses; an action that is denied, described, conditional or asked is none.

The patterns read a bounded number of characters around ``@``, which stands for an action.
"""

import bisect
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

from eyechart.spaces.reader.action_names import ActionNames
from eyechart.spaces.reader.marks import Mention, is_mark
from eyechart.spaces.space import Decision, unparsed

Unparsed = Literal["no_action", "unknown_action", "several_actions", "negated", "not_chosen"]
"""Why a reply in words could not be read."""

Status = Literal["chosen", "half", "denied", "listed", "said"]
"""The use of a named action; ``half`` is chosen with something unread: "LEFT and accelerate"."""

_SHORT = 80
"""In so short a text, one named action is a choice if its name has no other use."""
_LEFT, _RIGHT, _JOINT = 160, 80, 40
"""Characters to read before a mention, after it, and between two in one list."""
_MENTIONS_AT_MOST = 500
"""The most mentions to read, the last ones."""


def _one_of(words: str) -> str:
    """Return a pattern of words that are separated by ``|`` over several lines."""
    return f"(?:{'|'.join(word.strip() for word in words.split('|'))})"


# Everyday English words that are spelled like an action.

_EVERYDAY = frozenset(
    [
        "STOP",
        "SLOW",
        "SLOWER",
        "FAST",
        "FASTER",
        "STRAIGHT",
        "LEFT",
        "RIGHT",
        "GO",
        "FORWARD",
        "FORWARDS",
        "BACK",
        "BACKWARD",
        "BACKWARDS",
        "UP",
        "DOWN",
        "PORT",
        "HALT",
        "NORTH",
        "SOUTH",
        "EAST",
        "WEST",
        "OPEN",
        "CLOSE",
        "CLOSED",
        "FREE",
        "CLEAR",
        "SAFE",
        "YIELD",
        "KEEP",
        "TURN",
        "MOVE",
        "DRIVE",
        "BRAKE",
        "LINKS",
        "RECHTS",
        "LANGSAM",
        "GERADEAUS",
        "IDLE",
        "WAIT",
        "CRUISE",
        "PASS",
    ]
)
"""Names that road prose also uses for other things; such a name alone is no choice."""

_COLOURS = frozenset(
    ["RED", "GREEN", "BLUE", "YELLOW", "ORANGE", "PURPLE", "BLACK", "WHITE", "GREY", "GRAY", "BROWN", "PINK"]
)
"""Adjectives, which precede a thing: "a red circle"."""

_THINGS = _one_of(
    r"vehicles?|cars?|trucks?|lorry|bus(?:es)?|traffic|signs?|lights?|road|highway|street|leads?|leaders?|obstacles?"
    r"|buoys?|ships?|vessels?|boats?|bow|quarter|beam|tack|arrows?|signals?|indicators?|shoulder|edge|border|line"
    r"|curb|kerb|bend|curve|one|driver|van|bike|motorcycle|turns?(?=\s+(?:ahead|coming))"
)
_CARRIERS = frozenset(["GO", "TURN", "MOVE", "KEEP", "DRIVE", "CHANGE", "STEER", "SWING", "HEAD", "TAKE"])
_CARRIED = re.compile(r"\s+(?:to\s+|on\s+)?(?:the\s+)?")
"""Verbs that are no action if another name follows: "GO STARBOARD"."""

_IDIOM_AFTER = {
    "RIGHT": r"\s+(?:now|there|ahead|away|in front|in the|behind|next to|beside|side up|thing|choice|answer|action"
    "|option"
    r"|decision|move|one)\b",
    "LEFT": r"\s+(?:to be|for (?:me|us)|over(?=\s*[.,;]|\s*$|\s+(?:from|for|of|there)))\b",
    "SLOW": r"[ -]lanes?\b",
    "FAST": r"[ -]lanes?\b",
    "STRAIGHT": r"\s+(?:away|after|line|up|from|talk)\b",
    "STOP": r"\s+(?:here and|by|(?!changing|now|moving)\w+ing)\b",
    "GO": r"\s+(?:ahead|on|with|for|through|over|back|into detail)\b",
    "PORT": r"\s+side\b",
    "STARBOARD": r"\s+side\b",
}
_IDIOM_BEFORE = {
    "RIGHT": r"\b(?:all|al|you're|you are|that's|that is|quite|exactly|is that)\s+$",
    "LEFT": r"\b(?:what is|what's|room|space|time|distance|nothing|anything|much|options?|gap|metres|meters|who)\s+$",
    "STOP": r"\b(?:bus|at an?|at the)\s+(?:full |complete )?$",
    "GO": r"\b(?:let's|here we|good to|way to|ready to)\s+$",
    "SLOW": r"\b(?:too|very|(?:is|are|was|moves|drives|moving) so|quite|pretty)\s+$",
}

# Lists and sentences.

_OR = _one_of(
    "and|or|nor|then|and then|or then|and/or|vs\\.?|versus|ou|et|o|u|y|e|i|или|и|または|か|或|或者|还是|和|또는"
)
_BIT = r"here|for now|a (?:little|bit)|\w+ly|(?:on|by|at) the \w+"
_JOINED = re.compile(
    rf"(?:\s+down\b)?(?:\s+(?:{_BIT})\b(?=\s+(?:and|or)\b))?(?:[\s,/|;&+•>\"'()]"
    rf"|->)*(?:[a-e1-9][.)][\s\"'(]*)?(?:{_OR}(?![a-z])[\s\"',.]*(?:\d{{1,2}}[\s(.):]+)?(?:go |turn |move |change |to "
    rf"|the |lanes? ){{0,4}})?"
)
_BULLETED = re.compile(r"[ \t\"').,;]*\n[ \t]*(?:[-+•>#]|\(?\d{1,2}[.)])[ \t\"'(]*")
_BULLET = re.compile(r"[ \t>#]*(?:[-+•>#]|\(?(?:\d{1,2}[.):]|[a-i](?:[):]|\.(?=\s))))?[ \t>#]*")
_LABEL = re.compile(r"(?:\s?\([^()\n]{1,40}\))?[\s\"']{0,3}(?::|\s-\s)[ \t]*\w")
_SHORTENED = (
    *("approx", "appr", "ca", "cf", "vs", "fig", "figs", "max", "min", "resp", "incl", "excl", "eq"),
    *("i.e", "e.g"),
)
_SENTENCE = re.compile(
    "".join(rf"(?<!\b{re.escape(word)})" for word in _SHORTENED)
    + r"[.!?]+(?=[\s\"')\]]|$)|\n+|;(?=\s|$)|(?<=[^\x00-\x7f])[.!?]"
)
"""The end of a sentence; the point of an abbreviation does not count."""

# Words before the name of a choice.

_ADVERB = _one_of(
    "also|now|then|therefore|thus|still|just|simply|probably|definitely|likely|rather|instead|immediately"
    "|gently|safely"
    "|certainly|always|either|like|prefer|to|it|be|first|here|well|better|strongly|personally|actually|obviously"
)
_OTHER = _one_of(
    "blue|red|yellow|white|black|grey|gray|orange|purple|other|others|lead|leading|front|oncoming|parked|next|second"
    "|first|slow|rear|another"
)
_VEHICLE = r"(?:vehicle|car|driver|robot|agent|machine|controller|ship|boat|forklift|drone|rover)"
_EGO = (
    rf"(?:\b(?:the|our|my|this|your|its|ego)\s+(?!{_OTHER}\b)(?:[\w-]+\s+){{0,2}}?(?:{_VEHICLE}|ego)"
    r"|\b(?:it|you|ego|we|i)|^\s*(?:driver|vehicle|car))"
)
_SHOULD = r"\s+(?:should|must|needs? to|has to|have to|ought to|is to|had better|'d better|is advised to)"
_WILL = (
    r"\b(?:i|we)(?:\s*'d|\s*'ll|\s+would|\s+will|\s+shall|\s+want to|\s+plan to|\s+intend to|\s+prefer to"
    r"|(?:\s*'ve|\s+have)?\s+(?:decided?|chosen|opted) to|(?:\s*'m|\s*'re|\s+am|\s+are)(?:\s+going to)?)"
    rf"(?:\s+(?:have|let|make)\s+(?:it|the {_VEHICLE}))?"
)
_CHOOSE = _one_of(
    "lean(?:ing)? towards?|choose|choosing|chose|chosen|pick(?:ing)?|select(?:ing)?|say|go(?:ing)? with|go(?:ing)? for"
    "|opt(?:ing)? for|recommend(?: to)?|suggest|advise|propose|vote(?: for)?|answer(?: with)?|reply(?: with)?"
    "|respond with|take|prefer|decided? (?:on|for|to)|settled? (?:on|for)|output|execute|perform|apply|use|stick with"
    "|initiate|change (?:it|that|my answer) to|do|guess|choose to|press(?:ing)?"
)
_GO = _one_of(
    "go|going|turn(?:ing)?|mov(?:e|ing)|chang(?:e|ing)|switch(?:ing)?|shift(?:ing)?|merg(?:e|ing)|steer(?:ing)?"
    "|swerv(?:e|ing)|veer(?:ing)?|pull(?:ing)?|head(?:ing)?|com(?:e|ing)|bring(?:ing)?|mak(?:e|ing)|tak(?:e|ing)"
    "|rotat(?:e|ing)|travel(?:ing)?|alter(?:ing)?(?: course)?|overtak(?:e|ing)|pass(?:ing)?|driv(?:e|ing)"
    "|proceed(?:ing)?|continu(?:e|ing)|bear|swing|lane change|perform a lane change|keep going|keep driving"
    "|keep moving|continue going"
)
_WAY = (
    r"(?:[\s,]+(?:to|into|onto|on|over|in|towards?|from|the|a|an|my|its|our|your|lanes?|side|course|line|vehicle|car"
    r"|truck|wheel|it|them|slow|slower|further|full|complete|hard|slightly|gently|immediately|and|up|down|back|out"
    r"|safely|carefully|going|driving|moving|turn|of|that|at|is|above|below|forward|then|by|change)\b){0,9}"
)
_HOLD = "(?:keep|keeping|stay|staying|remain|remaining|hold|holding|maintain|maintaining)"
_DONE = rf"(?:{_GO}{_WAY}|{_HOLD}(?:\s+(?:going|driving|moving|on|it|the lane and|lane and go))?)"
_VERDICT = _one_of(
    "answer|action|choice|decision|option|move|man(?:o|eu|oeu)?euver|manoeuvre|command|output|response|reply|pick"
    "|recommendation|course|bet|conclusion|solution|result|verdict|call|advice|one word|colou?r"
    "|(?:best|safest|correct)(?! (?:lane|side|distance|gap|camera|view|exit|position|row|time)\\b)|assessment"
    "|judg\\w+|thing to do|(?:suitable|appropriate|sensible|reasonable|prudent|logical) one|control"
    "|guess|(?:correct|best|right|safest|action|option) id"
)
_NOT_BAD = (
    r"(?! (?:that|which) (?:would |will )?(?:(?:hit|crash|collid|fail)|(?:lead|point|bring|run)s? [^@.;]{0,20}"
    r"\b(?:wall|stairs|crash|collision|into|off)\b))"
)
_IS = r"(?:\s+(?:is|would be|should be|will be|must be|has to be|remains|seems)\b|'s|\s*[:=]|\s*->)"
_GOOD = _one_of(
    "best|better|safest|safer|wise|wiser|necessary|advisable|recommended|preferable|reasonable|correct|appropriate"
    "|prudent|sensible|enough|sufficient|optimal|time|needed|required"
)
_THEREFORE = "(?:so|thus|hence|therefore|consequently|accordingly|instead|finally|ultimately|overall)"
_MEANS = _one_of(
    "calls? for|requires?|suggests?|implies|means|warrants?|demands?|necessitates?|leav(?:es|ing)(?: me| us)?(?: with"
    "| only)?|indicates?|recommends?|recommended|suggested|choosing|selecting|selected|chosen|picking|opting for"
    "|(?:gut|instinct) says"
)
_END = r"[\s\"'(,:]*$"
_CHOSEN_BEFORE = re.compile(
    "|".join(
        (
            rf"{_EGO}{_SHOULD}(?:\s+{_ADVERB}){{0,3}}\s+(?:(?:{_CHOOSE}\s+)?{_DONE}|{_CHOOSE})?{_END}",
            rf"{_WILL}(?:\s+{_ADVERB}){{0,3}}(?:\s+{_CHOOSE})?(?:\s+(?:to\s+)?{_DONE})?{_END}",
            (
                rf"\b(?:i|we|let's|let us|let me)\s+(?:\w+ly\s+|would\s+|now\s+|therefore\s+|have\s+)?(?:{_CHOOSE}"
                rf"|{_DONE})(?:\s+to)?(?:\s+{_DONE})?{_END}"
            ),
            (
                rf"(?:{_EGO}{_SHOULD}|{_WILL})(?: \w+ly)? {_GO}\b[^@.;:!?]{{1,60}},"
                rf" which (?:is|means|matches|corresponds to){_END}"
            ),
            rf"(?:^|[.;:]\s*|'d |\bwould |\bshould )(?:start|begin) (?:with|at){_END}",
            rf"\b(?:i|we)\s+(?:think|believe|guess|say|suppose|mean)(?:\s+that)?\s+(?:it\s*(?:is|'s)\s+)?{_END}",
            (
                rf"\b{_VERDICT}\b{_NOT_BAD}[^@.;?!:=]{{0,50}}?{_IS}[\s\"'(,:]*(?:(?:just|simply|clearly|now|then|probably)\s+)?"
                rf"(?:to\s+)?(?:{_CHOOSE}\s+)?(?:{_DONE})?{_END}"
            ),
            (
                rf"\b{_GOOD}\b(?:\s+(?:thing|option|idea|choice))?(?:\s+(?:is|would be))?"
                rf"(?:\s+for\s+(?:\w+\s+){{0,3}}?)?\s+to\s+(?:{_DONE})?{_END}"
            ),
            (
                rf"\b{_THEREFORE}\b[\s,:\"'(]*(?:(?:it is|it's|i|we|just|now|please|let's|let us|then)\s+)?"
                rf"(?:{_CHOOSE}|{_DONE})?{_END}"
            ),
            rf"\b(?:everything|all|this|that|which|evidence) points? to\s*:?\s*(?:{_DONE})?{_END}",
            rf"\b(?:let's|let us|let me)\s+(?:now\s+|just\s+)?{_END}",
            rf"[-=]>{_END}",
            (
                rf"(?:^|[,;:(]|\band|\bbut|\bso|\bthen)\s*(?:(?:please|just|simply|then|so|now|immediately|safely"
                rf"|first|also|instead|better|obviously)\s+)*(?:{_CHOOSE}|{_DONE}|lane change)(?:\s+(?:to|an))?{_END}"
            ),
            rf"(?:^|[,;:]|\bit\b)\s*(?:it|that)?(?:'s|'d be| is| would be| has to be| must be)(?:\s+the)?{_END}",
            rf"\b{_MEANS}\s*:?\s*(?:{_DONE})?{_END}",
        )
    )
)

# Words after it.

_CHOSEN_AFTER = re.compile(
    r"\"?(?:\s+(?:down|lane(?: change)?|turn|on the (?:left|right)))?\"?(?:\s+(?:is|'s|seems|looks|appears|would be"
    r"|remains|will be|would)(?:\s+(?:to be|like|clearly|probably|definitely|then|now|thus|therefore|the|a|my|most|more"
    r"|only|much|by far|be)){0,4}\s+(?:best|better|safest|safer|correct|appropriate|fine|good|ok|okay|answer|choice"
    r"|decision|pick|vote|left(?=[\s.,!]*$)|way to go|only way|enough|sufficient|needed|necessary|required|recommended"
    r"|advised|fitting|advisable|preferable|preferred|optimal|ideal|reasonable|warranted|one(?! option)|prudent|wise"
    r"|wisest|sensible|justified|viable|suitable|(?:right|logical|obvious|natural) (?:choice|answer|action|option|move"
    r"|thing|call|speed|angle|value|bin)|action|option|safe (?:choice|option|action))\b|\s+it is\b|\s+(?:seems"
    r"|looks) (?:good|right)\b|\s+(?:works|fits) best\b|\s+(?:recommended|advised|preferred)\b|\s+the (?:best|safest"
    r"|right|correct|most \w+) (?:option|choice|action|answer|one)\b|\s+is what (?:i|we)(?:'d| would)? (?:choose|pick"
    r"|do|say|take|go with|recommend)\b|\s+(?:should|will|would) (?:do(?: it)?|work|be (?:fine|enough|safe|ok|good"
    r"|right|best|the (?:best|safest)))\b|\s+makes (?:the most )?sense\b|\s+(?:gets|has) my vote\b|\s+(?:is"
    r"|was)? ?(?:chosen|selected)(?=[\s.!]*$)|,?\s+i'd say\b|\s+(?:seems|is about) right\b|\s+is plenty\b"
    r"|\s+is the (?:only )?(?:action|option|one|choice) that (?:avoids (?!nothing)|(?:keeps (?:\w+ ){0,2}(?:clear|safe"
    r"|straight|(?:on|in|within) (?:the|our))|(?:points|leads|brings) (?:(?:us|me|it|the robot) )?(?:closer )?(?:at|to"
    r"|towards?) (?:the|our) (?:open )?(?:door(?:way)?|exit|goal|target|corridor|chair|table)|points (?:us|me"
    r"|the robot) at it)\b(?![^.,;!?@]*\b(?:into|off|away|nowhere|nothing|wrong|locked|closed|blocked)\b))[^.,;!?@]*"
    r"|\s+(?:remains|is (?:all|what) (?:that )?(?:is left|remains))(?=[\s.,!]*$))(?:\s+(?:action|choice|option|move"
    r"|answer|decision|pick|speed|angle|value|course|man(?:o|eu|oeu)ver|manoeuvre|one|thing|bet|of|course|available"
    r"|possible|here|now|right|them|these|all|the|options|actions|choices|idea|out|left|forward))*(?=[\s\"']*(?:[^\w\s]"
    r"|$|(?:because|since|as|to(?! (?:(?:the|an?|another|question|crash|hit)\b|\d))|given|due|at|and|but|so"
    r"|in(?= (?:this|the|my|our|that)\b)|with|considering|based|when|while|than|then|over|i|for(?= (?:now|me|us|this"
    r"|the|our|my|it|safety|\w+ing)\b)|by|from|on|under|though|although|even|without|not|rather|instead|especially"
    r"|today|before|after|once|only)\b))"
    rf"(?!\s+for (?:the|an?|that) (?:{_OTHER}|truck|bus|van|car|driver|vehicle)\b)"
)
_TAKEN_BACK = re.compile(
    r"\b(?:just kidding|joking|scratch that|never mind|nevermind|different question|disregard (?:that|this)"
    r"|ignore (?:that|this|my)|let me (?:re-?\w+|think|look|see|check|start)|said (?:nobody|no one)|(?:this|that|the"
    r"|my|which) (?:answer |choice |action |decision )?(?:is|was|would be) (?:wrong|incorrect|not (?:my|the) (?:answer"
    r"|choice|action|decision)\b)|(?:or (?:maybe|perhaps|possibly|else)|alternatively)\b[^.]{0,20}@(?! (?:if|when"
    r"|should|in case)\b))|\b(?:not|un|un-)(?: (?:really|entirely|fully|at all|quite))? ?(?:sure|certain)[\s.!)]*$"
)
"""Words after a choice that withdraw it."""
_CORRECTED = re.compile(
    r"\b(?:edit(?:ed)?|updated?|amend\w*|revis\w+|erratum|corrected|typo|p\.?s|oops|i mean|namely|(?:i |i've )?meant"
    r"|make (?:that|it)|changed? (?:to|it to)|replaced? (?:by|with)|new (?:answer|action|choice)|second (?:answer"
    r"|thoughts?|look)|reconsidered|after review|my bad|or rather)\b[\s:,.\"'(-]{0,8}$|[-.;]\s*or\s+$"
    r"|\bi\.e\.[\s:,(\"']{1,4}$|(?:^@?\s*|[(;,.}]\s*)should (?:be|have been|read)\s+$"
)
"""Words directly before an action that replaces the previous one."""
_FIRST = re.compile(r"@\s+(?:for \S+ \S+|first)\b[^@.;!?\n]*\bthen\b[^@.;!?\n]*$")
"""Words that make a plan of an action and the next one."""
_IN_ORDER = re.compile(r"(?:^|[.;:,\n]\s*)first[\s,:]+(?:\w+\s+){0,2}[\"'(]*$")
_NOW = (
    re.compile(r"\b(?:now|(?:start|begin) (?:with|at))[\s,:\"'(]+$"),
    re.compile(r"[\"')]?,?\s+(?:(?:for |right )?now|at first|initially)\b"),
)
_LATER = (
    re.compile(r"\b(?:then|later|next|afterwards|after that|once|when|until|after)\b"),
    re.compile(r"[\"')]?\s+(?:later|afterwards|next|once|when|after|as soon as|then)\b"),
)
"""Words before and after an action that say when it is done."""
_THEN_ONCE = re.compile(r"[^@]*\bthen\b[^@]*@[\"')]?,?\s+(?:once|when|after|as soon as)\b")
"""An action that is next, in some case: "then LEFT when free"."""
_HESITATES = re.compile(
    r"[.!?;-]\s*(?:(?:wait|hold on)(?! (?:for|until|till|to|here|there|behind|while)\b)|oops|hmm+"
    r"|no(?=[,.:!])|actually|correction)\b"
)
_RULED_OUT = re.compile(
    r"\b(?:rul(?:e|es|ed|ing) out|exclud(?:e|es|ed|ing)|eliminat(?:e|es|ed|ing)|dismiss(?:ed|ing)?|discard(?:ed"
    r"|ing)?)\b(?!(?: (?:the|any|all|every|this|that|a|further|possible))* (?:risks?|dangers?|hazards?|chances?"
    r"|collisions?|possibility|uncertainty|conflicts?)\b)(?:(?!\b(?:so|but|leav\w+|leaves|therefore|thus|hence|only"
    r"|remain\w*|i|we|should|(?:action|choice|answer|decision|option|move|pick) (?:is|would be|should be))\b)[^.;!?])*$"
)
"""Words that deny each action of the list behind them."""
_THEN = re.compile(r"(?:\band|,) ?(?:then|followed by)\b[^@.;!?]*$")
_PREDICATE = re.compile(
    r"\"?(?:\s+(?:lane|side))?\s+(?:is|are|was|has|have|had|seems|looks|appears|would|will|could|may|might"
    r"|can|of|there)\b|,?\s+where\b"
)
"""Predicates of an action or of a side of its name; without the words above it is no choice."""

_TAKES_IT = re.compile(
    r"\"?\s+(?:is|looks|seems|remains|has|fits|works|keeps|avoids|gives|leaves)\b[^@.;:?!\n]{0,60}?,?\s+(?:so|and"
    r"|hence|thus|therefore)\s+(?:that|it|this)?\s*(?:is my (?:answer|choice|decision|pick)|(?:i|we)(?:'ll|'d| will"
    r"| would| shall)?\s+(?:go (?:with|for)|choose|pick|take|select|opt for) (?:it|that|this)(?: one"
    r"| option)?)(?=\s*(?:[^\w\s]|$))|\"?\s+is right(?=[\s\"']*(?:[.!,;]|$|because\b|since\b))"
)
"""A statement about an action that is then taken: "D is free, so I go with it"."""
_QUANTITY = (
    r"(?:(?:speed|velocity)(?: value)?|(?:steering )?angle|steering(?: (?:value|command|bin|wheel))?"
    r"|(?:steering )?(?:bin|value))"
)
_FITTING = (
    r"(?:chosen|selected|target|desired|recommended|suggested|proposed|appropriate|suitable|sensible|reasonable"
    r"|adequate|required|necessary|needed|right|correct|proper|best|better|optimal|ideal|safest|safe|final|new)"
)
_SHALL = (
    r"(?:is|would be|should be|will be|must be|has to be|needs to be)(?: (?:therefore|thus|then|hence|now|set to|at))*"
)
_THERE = r"(?:\s+(?:for|in|here|at|to|under|given|that|i|we)\b(?! (?:cars|trucks))[^@.;:!?,]{0,60}?)?"
_OWN_WILL = r"(?:^|[.;,:]\s*|\bso\s+|\b(?:i|we)(?:'ll|'d|\s+will|\s+would|\s+should)?\s+|\b(?:should|must|let's)\s+)"
_FROM = r"\s+from\s+(?:[a-z]+\s+){0,2}(?:@|[+-]?[\d.]+)(?:\s?[^\s\d.,;]{1,9})?(?:\s+(?:down|up))?"
_SET_TO = re.compile(
    rf"(?:\b{_FITTING}\s+{_QUANTITY}{_THERE}(?:\s+(?:is|therefore|thus|then|would|should|will|be|now|set to)|:)+"
    rf"|\b{_QUANTITY}\s+{_FITTING}\s+{_SHALL}|(?:(?:the|my|our)\s+|^\s*|[.;,:]\s*)(?:robot's |own )?(?:{_QUANTITY}"
    rf"|wheel){_THERE}\s+(?:should|must|has to|needs to)(?: (?:therefore|thus|then|now))*\s+be(?: (?:therefore|set to"
    rf"|at))*|(?<!current )(?<!previous )(?<!last )(?:steering|bin) (?:value|command|bin|choice)\s+(?:is|would be)"
    rf"|\b{_QUANTITY}\s+(?:i|we)(?:'d|\s+would)? (?:choose|pick|set|take|use|recommend) (?:is|would be)"
    r"|\b(?:id|number|index|action|option|command|bin|letter|value|code)\s+(?:i|we)(?:'d|'ll|\s+would|\s+will)?"
    r"\s+(?:choose|pick|select|take|use|send|output|give|return) (?:is|would be)"
    rf"|{_OWN_WILL}(?:just\s+)?(?:set|put|turn|keep|leave|hold)\s+(?:(?:the|my|our)\s+)?(?:{_QUANTITY}|wheel"
    rf"|steering wheel|it)\s+(?:to|at)|{_OWN_WILL}(?:steer(?: by| with)?"
    r"|(?:slow(?: down)?|accelerate|speed up|decelerate|brake|(?:reduce|increase|decrease|lower|raise)"
    rf"(?: (?:the|my|our|it))?(?: {_QUANTITY})?)(?:{_FROM})?\s+to"
    rf"|(?:drop|go|change|move|switch|cut)(?: (?:the|my|our|it))?(?: {_QUANTITY})?{_FROM}\s+to))[\s\"'(:]*$"
)
"""Words before a number to which a speed or an angle is set."""

_CAN = re.compile(
    r"\W*(?:so\W+)?(?:we|i|the robot) can (?:(?:safely|now) )?(?:drive|go|move|travel|proceed) (?:on )?at\s+"
)
_CAN_NOW = re.compile(r"(?:\s(?:here|now|safely))?(?:[\s.!]*$|,?\s(?:because|since|as)\b)")
"""What can be done is chosen where nothing else is said."""

# Words that withdraw a mention.

_NOT = (
    r"(?:\b(?:not|never|no|nor|neither|none|without|avoid\w*|cannot|cant|dont|refus\w+|declin\w+|unable|impossible"
    r"|unsafe|dangerous|risky|unwise|wrong|bad|unnecessary|useless|forbidden|illegal|nobody|hardly|doubt\w*|mistake"
    r"|no point|false|untrue|unclear|uncertain|unsure|incorrect|worst|least|reject\w*|discard\w*|forget"
    r"|cancel\w*|ignor\w+|whether|kein\w*|nie|pas|jamás|ni|non|nem|ни|никогда|нiколи|ingen|inte|ikke|geen|hayır"
    r"|değil)\b|n't\b|不|别|勿|避免|没|沒|無|禁止|안 |못 )"
)
_THAN = _one_of(
    "than|over|except|except for|against|instead of|rather than|anything but|everything but|all but|other than|besides"
    "|as opposed to|unlike|au lieu de|statt|anstatt"
)
_DENIED_BEFORE = re.compile(
    rf"{_NOT}[^@]{{0,45}}$|\b{_THAN}\s+(?:(?:to|the|a|an|going|turning|moving|go|turn|for|just|choosing)\s+)*[\"'(]*$"
)
_NEGATED = re.compile(r"(?:(?:^|[\s(])[!¬~]|\bnot\s?|\bnone of \w -)[\s\"']*$")
"""A program's sign of negation: "!LEFT"."""
_DENIED_BRACKET = re.compile(
    rf"(?:{_NOT}|\b{_THAN})\s*(?:\b(?:be|option|choice|answer|choose|pick|take|go|the|with"
    rf"|for)\s+){{0,3}}[\"']?[(\[][\"']?$"
)
_IN_BRACKETS = re.compile(r"[\"']?\s?(?:[)\]:]|\s-\s)")
_DENIED_LABEL = re.compile(
    rf"(?:^|[,;(])\s*(?!(?:\w+ )?no(?:\s*:"
    rf"| (?:\w+ ){{0,2}}need))(?:\w+\s+){{0,3}}{_NOT}(?:\s+\w+){{0,3}}\)?\s*:\s*[\"'(]*$"
    rf"|\b(?:choose|advise|recommend|suggest)\b[^@.;:]{{0,25}}(?:{_NOT}|\bagainst\b)[^@.;:]{{0,25}}:\s*$"
)
"""A label that denies what follows: "Avoid: LEFT"; "no need: STRAIGHT" is none."""

_SCOPE = re.compile(
    r"[;:()\n,]|\b(?:that|which)\s+(?:best\s+)?avoids?\b[^@.;,]{1,40}?\s(?:is|would be)\b|\b(?:but|so|therefore|thus"
    r"|hence|because|since|mais|also|sino|instead(?! of))\b|而是|而|但|应|-{1,2}>|=>|\s-\s"
)
_ALL_BUT = re.compile(r"(?:anything|everything|all) $")
_BAD = _one_of(
    "unsafe|dangerous|risky|impossible|wrong|incorrect|bad|a bad|a mistake|unnecessary|unneeded|unavailable|blocked"
    "|occupied|taken|busy|closed|excluded|ruled out|out of|too|worse|worst|forbidden|illegal|inappropriate|pointless"
    "|(?<!watch )(?<!look )out(?! of)|опасн\\w*|peligros\\w*|dangereu\\w*|falsch|pericolos\\w*|niebezpieczn\\w*"
    "|perigos\\w*|farlig\\w*|危险|危険|unwise|overkill|excessive|hardly|never|besetzt|belegt|blockiert|occup[ée]e?|ocupado"
    "|занят\\w*"
)
_DENIED_AFTER = re.compile(
    rf"\"?(?:\s+(?:lane|side|turn|option|action|down))?\"?(?:\s+(?:is|are|was|were|would be|would|will be|will|seems"
    rf"|looks|appears|can|could|may|might|es)(?:\s+(?:be|also|both|clearly|definitely|really|currently|simply|very|far"
    rf"|still)){{0,2}}\s+(?:not\b|{_BAD}\b|hit\b|crash\b|collide\b|cause\b|lead to\b|risk\b|block\b)|\s*(?:isn't|wasn't"
    rf"|aren't|can't|cannot|wouldn't|won't|doesn't|is n't)\b|\s*[:=-]\s*(?:(?:would be|is|it is|it's|looks"
    rf"|seems) )?(?:not(?! (?:the )?@)\b|{_BAD}\b|no(?=[\s.,;|]*$|[.,;|]|\s(?:lane|room|space|need|way)))"
    rf"|\s*\((?:not \w+(?: \w+)?[).,;]|{_BAD}\b|rejected\b)|[^@.;\n]{{0,50}}\b(?:but|except|until|yet"
    rf"|though)\b[^@.;\n]{{0,40}}(?:{_NOT}|\b(?:(?!out\b(?! of)){_BAD}|overlooks?|ignores?)\b)"
    rf"|\s+(?:leads? to (?:an? )?(?:collision|crash|accident)|hits? (?:the|an?)|crash(?:es)?\b|collides?\b)"
    rf"|\s*(?:[:=-]>?|->)\s*(?:an? |the )?(?:collision|crash\w*|accident|danger|hits?)\b|\s*(?:[✗✘❌✖🚫👎⛔✕]"
    rf"|\((?:considered|no)\))|\s+(?:rather than|over|instead of|before)\s+@\s+(?:is|was"
    rf"|would be)\s+(?:\w+\s+)?{_BAD}\b|[^@.,、。]{{0,12}}(?:ません|ない|なく|なかった|ず|않|아니|못|禁止|危険|危险)"
    rf"|\"?(?:\s+is|\s+are)\s+(?:best|better)\s+(?:avoided|left|not)\b|\"?,?\s+said (?:nobody|no one)\b)"
)
_BADLY = r"(?:an? |the )?(?:collision|crash|accident|wall|ditch)"
_HARM = _one_of(
    "hits?(?! the brakes?)|crash(?:es)?|collides?|rams?|strikes?(?! (?:a|the) )|scrapes?|rear-ends?"
    "|runs? (?:into|over)|drives? (?:into|off)"
    rf"|leads? (?:in)?to {_BADLY}|causes? {_BADLY}|ends? (?:up )?in {_BADLY}|be (?:hit|struck)"
    r"|be (?:dangerous|unsafe|risky|wrong)(?! (?:not )?to\b)"
)
_SURELY = r"(?:\s+(?:also|then|likely|probably|surely|certainly|only|just))?"
_NOT_ELSE = r"\b(?![^.;!?\n@]*\b(?:otherwise|if|unless|without|else|instead)\b)"
_MAY = r"(?:\s*'d|\s*'ll|\s+would|\s+could|\s+might|\s+may|\s+will|\s+can)"
_HARMS = re.compile(
    r"(?:[)\"']?(?:\s*[:)]|\s+-+)\s*"
    rf"(?:(?:this|that|which|doing (?:so|this|that)){_MAY}?|it(?:\s*'d|\s+would))|,\s*which{_MAY})"
    rf"{_SURELY}\s+{_HARM}{_NOT_ELSE}"
)
"""The effect of an action, directly after it: "B: it would crash"; "STOP. We would hit it" is none."""
_BLOCKED = re.compile(
    rf"\s+{_BAD}\b|\s*(?:turn|steer|go|keep|stay|slow|stop|brak|accelerat|speed|chang|mov|driv|swerv|merg|continu"
    rf"|maintain)(?:(?!\b(?:because|since|as|so|while|when|where)\b)[^@.,;:!?\n]){{0,30}}\s(?:is|are|would be|would"
    rf"|will|can|may)\s+(?:not\b|{_BAD}\b|hit\b|crash\b|collide\b|cause\b"
    r"|lead to\b|risk\b)"
)
"""Words about an option after its letter: "A) blocked"."""
_ASKED_FOR_BAD = re.compile(
    rf"\b(?:which|what)\b[^?@]*\b(?:{_BAD}|not|never|avoid\w*|worst)\b[^?@]*\?\s*(?:a[.:)]\s*)?$|\bworse\b[^?]*\?\s*$"
)
"""A question whose answer is no choice: "Which action is unsafe?"."""
_ASKED_WHERE = re.compile(
    r"\bhow (?:many|much|far|fast)\b(?! should (?:i|we)\b)[^?@]*\?\s*(?:a[.:)]\s*)?$|\b(?:where (?:is|are)|(?:which"
    r"|what) (?:side|lane|direction|way) (?:is|are|does|do|has|have))\b(?!\s+(?:(?:the (?=most |clear|free))?(?:most "
    r"|more |still )?(?:clear(?:er|est)?|free(?:r|st)?|open|room|space)\b|(?:the |my |our )?(?:robot|rover|car|vehicle"
    r"|ego)\s+(?:\w+ )?(?:take|go|@)(?!\w)))(?!\s+(?:i|we|you|(?:the )?(?:safest|safer|safe|best|better|right|correct"
    r"|recommended)\b))[^?@]*\?\s*(?:a[.:)]\s*)?$"
)
"""A question about the picture: "Which side is the car on?"."""
_STATE = re.compile(
    r"\"?(?:\s+(?:lane|side))?\"?\s*[:=(]\s*\"?(?:the\s+|a\s+|an\s+|is\s+)?(?:free|clear|empty|open|available|safe"
    r"|possible|cars?|vehicles?|trucks?|none|unknown|n/a|yes|true|false|\d+(?:\.\d+)?\s*(?:m\b|/\s*\d+)|frei"
    r"|libre)\b[^.;,@]{0,14}(?:[.;,)|\n]|$)|\)?\s*[:=]\s*(?:0|[01]?\.\d+|\d+\s?%)(?=[\s.;,)|]*(?:$|\n|[;,|]))"
    r"|(?<=\w\(@)\)\s*[:=]"
)
"""The state of a side, "LEFT: free", or its probability, "LEFT: 0.1"."""
_FREE_OR_NOT = re.compile(
    r"\"?\s*[:=(]\s*\"?(?:the\s+|a\s+|an\s+|is\s+)?(?:free|clear|empty|open|cars?|vehicles?|trucks?)\b"
)
_PLACE = re.compile(r"left|right|straight|ahead|forward|back|lane|middle|cent|road", re.IGNORECASE)
"""Actions named by a place: such words describe the place; for other actions they are a reason."""
_COUNTED = re.compile(
    r"\"?(?:\s+(?:lane|side))?\"?\s*[:=(]\s*\"?(?:no|\d+|two|three|several|many)\s+(?:free|clear|empty|open|available"
    r"|safe|cars?|vehicles?|trucks?)\b[^.;,@]{0,14}(?:[.;,)|\n]|$)"
)
"""The number of things on a side: "LEFT: two cars"."""

_SPOKEN_OF = re.compile(
    r"\b(?:signs?|arrows?|signals?|traffic light|markings?|display|symbol|instructions?|prompt|text|writing"
    r"|written|word on"
    rf"|reads|told|asked|(?<!gut )(?<!instinct )says|said|(?:of|for) (?:the|an?) {_OTHER}|(?:of|for) (?:the"
    rf"|an?) (?:truck|bus|van)"
    rf"|(?<!ego )(?<!green )(?<!my )(?<!our )(?:car|truck|vehicle|driver|lead|bus|van)'s)\b(?:(?!\bso\b)[^@,;:])*$"
    r"|\bwait(?: for| until|,? then|,? and then)\b[^@;:]*$|\bso (?:is|are|would|does)\s*$|[✗✘❌✖🚫👎⛔✕]\s*$|\[ \]\s*$"
    r"|\b(?:first|initial) (?:answer|thought|instinct|reaction|guess|idea|impression)\b[^@.;]*$|\b(?:previously"
    r"|formerly|a moment ago|naive\w*|superficial\w*|at first (?:glance|sight))\b[^@.;]*$|\b(?:second(?:ary)?"
    r"|alternativ\w*|backup|fallback|runner-up|plan b|next best|previous|last|earlier|former)\b[^@,;]{0,40}$"
    r"|\b(?:ready to|prepared? to|preparing to|prepared for|could|might|may|maybe|perhaps|possibly|consider(?:ing|ed)?"
    r"|thought(?: about| of)?|used to|was|were|yesterday|tempted to|hesitat\w+|peut-être)\b[^@,:;]{0,40}$"
    rf"|(?:{_SHOULD}|{_WILL})(?: \w+ly)?\s+(?!{_GO}|{_HOLD}|(?!answer){_CHOOSE}|slow|stop|brak|accel)[^@.;:]*,"
    rf"\s+(?:which|that|but the truth)(?:'s| is){_END}"
)
"""Another speaker or actor, a later or earlier time, or a mere possibility."""

_QUOTED = re.compile(
    r"\b(?:reads?|says|(?<!i )(?<!i'd )(?<!would )say|said|states?|stated|asks?|asked|wrote|written|shows?"
    r"|displays?)\s*[:,]?\s*[\"'][^@\"]*$|\b(?:he|she|they|someone|somebody|anyone|passenger|human|user|instructor"
    r"|sign|banner|driver)\b[^@.;]{0,30}\b(?:says?|said|wants?|thinks?|reads?|answers?|answered|chose"
    r"|chooses)\b[^@.;]*$|\btoo \w+ \($|\b(?:it|this|that|there)(?: is|'s) an?\s*$|\b(?:ideally|normally|usually"
    r"|generally|typically|theoretically|hypothetically|in (?:theory|principle|general))\b[^@:;.]{0,30}$"
)
"""Another speaker, or a hypothetical case."""

_LABELLED = re.compile(r"(?:^|[.,;\n(|])\s*([^.,;:\n(|]{1,80}?)\s*[:=][\s\"'(]*$")
_ANSWERS = re.compile(
    r"(?:\b(?:the|my|our|your|so|and|but|final|next|first|best|better|chosen|selected|recommended|suggested|proposed"
    r"|preferred|safest|safe|correct|right|optimal|required|appropriate|step|current|immediate|driving|driver|vehicle"
    r"|car|ego|control|action|answer|decision|choice|pick|conclusion|verdict|recommendation|result|output|response"
    r"|reply|command|man(?:o|eu|oeu)ver|manoeuvre|move|control|course|highest|summary|therefore|thus|hence|correction"
    r"|update|ok|okay|yes|no|instead|now|selection|solution|a|helm|assistant|ai|die|der|das|la|le|el|il|ist|lautet"
    r"|one word|ans|vote|got it|sure thing|sure|here you go|there you go|guess|short|dr|faster|slower|accelerate|choose"
    r"|speed up|idle|easy|simple|one|no doubt|first of all|in the end|to sum up|in sum|elimination|by|slightly|slight"
    r"|hard|gentle|gently|sharp|policy|(?:max|min)imum|lowest|slowest|fastest|top speed|(?:action|cmd|command|option"
    r"|bin) (?:id|number|no)|cmd|sel|out|top|option|this (?:picture|image|frame|scene|case)|plan|here(?:'s| is)"
    r"|in short|overall|ultimately|to be|svar|colou?r|shape|\d{1,2}|of action|name|exec(?:ute)?"
    r"|in terms of the (?:given |allowed )?(?:list|options|actions|names))\b|操作|选择|選択|是|は|为|الإجابة|الجواب"
    r"|القرار|الإجراء|תשובה|उत्तर|cevap|karar|eylem|απάντηση|คำตอบ|trả lời|hành động|vastaus|odpověď|válasz|răspuns"
    r"|[^\w@])+"
)
"""Labels of a choice; "Road shape:" is none."""
_CLAUSE = re.compile(
    r"\b(?:is|are|am|was|has|have|had|'re|'m|'ve|i|we|should|must|need(?:s|ed)?|will|would|can|want|steer|brak\w+"
    r"|slow\w*|near\w*|close|stop(?:s|ped|ping)|reduce|(?:keep|stay|hold)(?:ing)?|let's|avoid|change|move|turn|proceed"
    r"|continue|accelerate|speed up|\w+ traffic|clear|sind|es|está)\b|n't\b"
)
"""A reason before a colon: "the lead is near: STOP"."""

_EXAMPLE = re.compile(
    r"\b(?:example|for instance|e\.g|such as|(?<!of the )options(?: are)?(?!,| +-)|choices are)\b[^@]{0,60}$"
    r"|^\s*an? (?:(?!\b(?:is|are|was|has|have)\b)[^,:])*\b(?:free|taken|ahead|occupied)\s*:\s*$"
)
_THING_LABEL = re.compile(
    r"(?:^|[,;(])\s*(?:(?!\b(?:is|are|was|has|have|should|must|switch|change|maintain|keep"
    r"|hold)\b)[\w'-]+\s+){0,4}?(?:detected|position|location|lanes?|sides?|danger|risk|collision|hazard|obstacles?"
    r"|vehicles?|cars?|leads?|blocked|occupied|free|clear|taken|visible|unsafe|bad|worst|wrong|direction of \w+"
    r"|(?!(?:recommend|suggest|select|prefer|advis|requir|need|propos|decid|correct|revis|indicat)ed|need|speed)\w+ed)"
    r"\)?\s*:\s*(?:(?:id|no|number|index|lane|speed)\s*[:=]\s*)?[\"'(]*$"
)
"""A label of a thing in the picture: "Obstacle position: LEFT"."""

_IF = re.compile(
    r"\b(?:if|unless|once|when|whenever|in case|in which case|otherwise|after that|afterwards|later|should the|had the"
    r"|were (?:the|it|there|we|i|that)|would have(?! (?:it|the) )|could have|might have|suppose|supposing|assum(?:e"
    r"|ing)|imagine|pretend|say (?:we|i|it)|before|after|falls|si)\b|(?:^|[.;:]\s*)(?:shall|can|could|may|might|do|does"
    r"|did|will|would|should|is|are) (?:we|i|it|the|you)\b"
)
_IF_OF_SPEECH = re.compile(
    r"\b(?:if (?:i|we) (?:had|have|must|were|was|am|are)(?: forced| asked| required)?(?: to)?(?: \w+){0,5}"
    r"|even if|if you ask me|as if|(?:see|check|checking|determine|decide) if|when in doubt|when asked)\b"
)
_IF_OVER = re.compile(r"\b(?:but|however|for now|currently|(?<!if )so|therefore|thus|hence|right now)\b|[;\n]|\.(?!\d)")
_IF_AFTER = re.compile(
    r"(?!,?\s+(?:(?:for |right )?now|and|then(?!,? if))\b)[^.;:@]{0,24}?\b(?:if|provided|assuming|as long as|in case"
    r"|(?<!at )once|when|whenever|only if|falls|si|at the (?:next|end|following)|in \d+ ?(?:m|metres|meters|km|s|sec"
    r"|seconds)|later|soon|tomorrow|in general|generally|usually)\b|,? and (?:you|they|it)\b"
)
_REASON = re.compile(r"\b(?:because|since|as|so|due|unless|for)\b")

_RETRACTED = re.compile(
    r"\b(?:however|actually|wait|no(?=\s*[,.!:;])|instead|correction|on second thought|on reflection|rather|sorry"
    r"|change (?:it|that|my)|changed my|reconsider\w*|mistake|hold on|scratch that|therefore|final|finally|ultimately"
    r"|overall)\b"
)
"""Words between a choice and the one that replaces it."""

# A part of a sentence that is only an action.

_PARTED = re.compile(
    r"[,:;()\[\]{}|=/\n<>]|\s-+\s|->|\s-(?=@)|\b(?:because|since|as|so|but|while|whereas|although|though|due to"
    r"|therefore|until|till|given|rather than|instead of|unless|for the|over|not|than|to avoid|to keep|to pass"
    r"|to overtake|to prevent|to maintain|in order|and then|then|before|and (?:watch|check|keep an eye|monitor))\b"
)
_TALK = re.compile(r",\s+(?:i|you|we|the|this|that|let|so|ok|okay|here|now|it)\b")
_COMPARED = re.compile(r"over|not|than|rather than|instead of|for the|as")
_FILLER = re.compile(
    r"(?:\b(?:ok|okay|sure|well|so|then|thus|hence|therefore|er|um|uh|hmm+|hm|ah|oh|yes|yeah|now|next|first|finally"
    r"|actually|definitely|probably|likely|certainly|clearly|obviously|just|simply|only|rather|better|answer|action"
    r"|decision|choice|command|output|response|result|final|my|the|it|is|it's|that's|that|for now|currently"
    r"|at the moment|for the moment|here|here's|correction|correct|option|pl(?:ea)?[sz]e?|best|safest|assistant|i guess"
    r"|i think|to be safe|mais|also|but|and|sorry|i mean|no doubt|without a doubt|of course|surely|i\.e"
    "|absolutely|must be|has to be|in the end|confidence|gently"
    r"|immediately|a|an|emergency|full|shape|circle|\d+(?:\.\d+)?|[b-h])\b|[^\w@])*"
)
_TAIL = re.compile(
    r"(?:\b(?:down|now|slowly|right now|right there|right away|straight away|at once|pl(?:ea)?[sz]e?|at first|initially"
    r"|first|immediately|ahead|it is|it down|here|lane|lane change|turn|for now|and wait|and hold|for sure|(?:on"
    r"|to) (?:the|my) (?:left|right)(?: side)?|for an? (?:moment|while|bit)|an? (?:moment|while)|at once"
    r"|at (?:a )?reduced speed|at low speed|with caution|carefully|gently|hard|forward|further|again|obviously|a bit"
    r"|a little|slightly|sharply|is my (?:answer|choice|decision)|the (?:car|vehicle|truck|robot|forklift|pallet"
    r"|machine|ship|boat|drone|rover|engine|load)|i guess|i think|i would say|up|completely|entirely|action|confidence"
    r"|end|out|\d+(?:\.\d+)?)\b|[^\w@])*"
)
_ORDERED = re.compile(rf"\s*(?:(?:please|just|then|now)\s+)*(?:{_DONE}|{_HOLD}|change lanes?|lane change)\s*")
_FAR = r"\d+(?:\.\d+)?\s?(?:km/h|m/s|mph|°|deg(?:ree)?s?|m|cm|met(?:er|re)s?|feet|ft|steps?)"
_DOES = re.compile(r"(?:^|[,;:]|\bso|\band|\bthen|\btherefore)\s*(?:i|we)\s+$")
"""Words that make a sentence of a verb's name: "so I turn right"."""
_LEADS = re.compile(r"\W*(?:rather than|instead of)\s+(?:\w+\s+){0,3}")
_MEASURED = re.compile(rf"\s*(?:by\s+|for\s+|to\s+|about\s+){{0,2}}{_FAR}[\s\"'.!]*")
_BRACKETED = re.compile(rf"\s*\(\s*{_FAR}\s*\)")
"""The amount of a long name: "TURN LEFT 30 degrees"."""
_HELD = re.compile(
    r"@[^@;]*\b(?:until|till|unless)\b[^@;]*$|\b(?:until|till)\b(?:[^@.;!?]|\.\d)*\bthen\b[^@.;!?]{0,20}$"
)
"""A condition that ends or replaces an action: "STOP until the road is free, then …"."""
_SOMEONE = re.compile(r"(?:^|\.\s*)\s*(?:an?|the|some|another) (?:(?!robot|vehicle|car|ego)\w+ ){1,3}$")
_ACTIVE = re.compile(r"[^\W\d_]+ing\b", re.IGNORECASE)
_DOING = re.compile(r"\W*(?:(?:just|simply|so|ok|okay|now|currently|therefore|thus|continue|keep)\b\W*)*")
_DONE_FOR = re.compile(
    r"(?:\s+(?:right now|now|here|at once|for now|carefully|slowly|further|it|on (?:the|my) (?:left|right)))*[\s\"')]*"
    r"(?:[.!;]|$|,?\s*\b(?:because|since|as|due|to|for|so|until|while|in order|around)\b|\s-\s|,\s(?:it|the|we|i"
    r"|there)\b)"
)
_HELPS = re.compile(
    r"(?: on (?:the|my) (?:left|right)(?: side)?)?(?: will)? (?:lets? (?:(?:us|it|the robot) (?:find|reach|pass|avoid)"
    r"|the \w+ pass)\b|(?:lead|bring|take|get)s? (?:us|me|it|the robot) (?:closer )?to (?:the|our) (?:(?!wrong|locked"
    r"|closed|blocked)\w+ )?(?:exit|goal|target|door|corridor)\b|gives? (?:us|me) more (?:room|space|time"
    r"|distance)\b)(?![^.;!?\n]*(?:@|\b(?:but|if|unless|when|once|too|not|wrong|locked|closed|blocked)\b))"
)
"""The use of what is done: "Turning left will bring us to the door."."""
_ASIDE = re.compile(r"\b(?:because|since|as|so|due|until|while|that|which)\b")
_MODAL = re.compile(r"\b(?:would|could|might|may|will|leads?)\b")
_FINITE = re.compile(
    r"\b(?:is|are|was|would|will|could|can|may|might|leads?|seems|looks|causes?|means|makes|won't|isn't|can't|works?"
    r"|takes?|risks?|hits?)\b"
)
"""The verbs of a statement about what is done: "Turning right would …"."""
_ONLY_DENIES = (
    re.compile(
        r"(?:^|[.;:!?\n]|\bbut)(?!\s*(?:if|when|once)\b)[^@.;:!?\n]{0,24}$(?<!than )(?<!because )(?<!think )(?<!doubt )"
    ),
    re.compile(
        r"[\s\"')]*(?:$|[.,;!\n]|(?:because|since|seems|looks|cannot|can't|won't work)\b"
        rf"|is(?!(?:n't| not)(?: {_BAD}| only|[.,;])))"
    ),
)
_EITHER = re.compile(r"\bor\s+(?:the\s+|option\s+)?[\"'(]*$|\bfrom\b[^.;@]{0,9}@?[^.;@]{0,9}\bto\s+$")
"""Words before one of several: "from -2 to 2"."""
_OR_NUMBER = re.compile(
    r"\s+or\s+[+-]?\d|[,;]? (?:and )?(?:the )?(?:m(?:ax|in)imum|(?:high|low|fast|slow)est|top speed)\b"
)
_IT_IS = re.compile(r"(?<!for )\b(?:it|that|this|which|there)\s*(?:is|'s)[\s\"'(]*$")
_GOING = re.compile(r"(?:^|[.,;]\s*|\b(?:am|are|is|was|were)\s+|'m\s+|'re\s+)(?:going|doing)(?:\s+at)?\s+$")
_BARE_FORM = re.compile(r"\s+(?:it\s+)?down\b")


@dataclass(frozen=True, slots=True)
class _PlacedMention:
    """A mention, and the place of its sign in the marked text."""

    mention: Mention
    place: int
    status: Status = "said"


def takes_back(text: str, action: str, names: ActionNames) -> bool:
    """Return whether a folded text chooses or corrects to another action than was stated before."""
    if (found := read_prose(text, names).action) is not None:
        return found != action
    marked, placed = _placed(text, names)
    if _is_ruled_out(marked, action, placed, 0):
        return True
    if not placed or placed[0].mention.action == action:
        return False
    left, right = marked[: placed[0].place], marked[placed[0].place + 1 :][:_RIGHT]
    waits = _HESITATES.match(f".{left.lstrip()}"[:_JOINT]) and not _is_denied(left[-_LEFT:], right)
    return bool(waits or _is_corrected(marked, 0, placed[0].place))


def read_prose(text: str, names: ActionNames) -> Decision[str]:
    """Return the decision of a folded text without a formal statement.

    If the chosen actions differ, the last one counts if words between withdraw the earlier one ("wait").
    """
    marked, judged = _placed(text, names)
    judged = _in_time(marked, judged)
    judged = _without_interjection(marked, _without_pedals(marked, _without_lists(marked, judged), names))
    chosen = [one for one in judged if one.status in {"chosen", "half"}]
    if all(one.status == "half" for one in chosen):
        alone = _alone(text, judged)
        return unparsed(_why(judged)) if alone is None else Decision(alone)
    last = chosen[-1]
    taken_back = _TAKEN_BACK.search(marked, last.place) or _HARMS.match(marked, last.place + 1)
    if taken_back or _is_ruled_out(marked, last.mention.action, judged, last.place) or _goes_on(marked, last, judged):
        return unparsed("not_chosen")
    other = [one for one in chosen if one.mention.action != last.mention.action]
    if other and not _RETRACTED.search(marked[other[-1].place : last.place]):
        return unparsed("several_actions")
    return Decision(last.mention.action) if last.status == "chosen" else unparsed("not_chosen")


def _placed(text: str, names: ActionNames) -> tuple[str, list[_PlacedMention]]:
    """Return the text with signs for the mentions, and the mentions with their status."""
    marked, placed = _mark(text, tuple(_mentions(text, names))[-_MENTIONS_AT_MOST:])
    return marked, [one for start, end in _sentences(marked) for one in _judged(marked, start, end, placed)]


def _is_ruled_out(marked: str, action: str, judged: Sequence[_PlacedMention], start: int) -> bool:
    """Return whether a clause behind a place only denies an action: "Not D."."""
    return any(
        one.status == "denied"
        and one.place >= start
        and one.mention.action == action
        and _ONLY_DENIES[0].search(marked, max(0, one.place - _LEFT), one.place)
        and _ONLY_DENIES[1].match(marked, one.place + 1)
        for one in judged
    )


def _goes_on(marked: str, last: _PlacedMention, judged: Sequence[_PlacedMention]) -> bool:
    """Return whether a choice is part of a plan, or is corrected; then there is no decision."""
    earlier = [
        mention for mention in judged if mention.place < last.place and mention.mention.action != last.mention.action
    ]
    plan = earlier and earlier[-1].status != "denied" and last.place - earlier[-1].place < _LEFT
    if plan and _FIRST.match(marked[earlier[-1].place : last.place]):
        return True
    later = (
        mention for mention in judged if mention.place > last.place and mention.mention.action != last.mention.action
    )
    following = next(later, None)
    between = "" if following is None else marked[last.place : following.place]
    if following is not None and following.status != "denied" and _HESITATES.search(between):
        return True
    if following is not None and following.status != "denied" and _is_corrected(marked, last.place, following.place):
        return True
    return _THEN.search(between) is not None and _HELD.search(between) is None


def _is_corrected(marked: str, start: int, end: int) -> bool:
    """Return whether the words directly before a place say that what follows replaces the past."""
    return _CORRECTED.search(marked[max(start, end - _JOINT) : end]) is not None


def _why(judged: Sequence[_PlacedMention]) -> Unparsed:
    if not judged:
        return "no_action"
    left = {mention.mention.action for mention in judged if mention.status != "denied"}
    return "negated" if not left else "several_actions" if len(left) > 1 else "not_chosen"


_ABOUT = re.compile(r"\s*(?:border|background|outline|frame|lines?|sky|road)\b", re.IGNORECASE)
_HEDGED = re.compile(
    r"\b(?:background colou?r|maybe|perhaps|possibly|might|may|could|usually|normally|often|too (?:dark|bright"
    r"|blurred)|whether|asks?|asked"
    r"|(?:background|sky|road|rest|border|lines?|image|picture)(?: of (?:it|the \w+))? (?:is|are|was|were))\b"
)


def _alone(text: str, judged: Sequence[_PlacedMention]) -> str | None:
    """Return the one action that a short text ends with, if its name has no other use in prose."""
    said = {mention.mention.action for mention in judged}
    if (
        len(text) > _SHORT
        or len(said) != 1
        or any(mention.status != "said" or mention.mention.derived for mention in judged)
    ):
        return None
    word = judged[0].mention.written.upper()
    if (
        word not in _COLOURS
        or "?" in text
        or _HEDGED.search(text.lower())
        or _ABOUT.match(text, judged[-1].mention.end)
        or _IF.search(text.lower())
    ):
        return None
    return said.pop()


def _mentions(text: str, names: ActionNames) -> Iterator[Mention]:
    """Yield the mentions that are not idioms, each repetition once."""
    mentions = list(names.mentions(text))
    before: Mention | None = None
    for at, mention in enumerate(mentions):
        after = mentions[at + 1] if at + 1 < len(mentions) else None
        if mention.written.upper() in _CARRIERS and after and _CARRIED.fullmatch(text[mention.end : after.start]):
            continue
        if _is_idiom(text, mention):
            continue
        if before is not None and before.action == mention.action and not text[before.end : mention.start].strip(" ,"):
            before = replace(mention, start=before.start)
            continue
        if before is not None:
            yield before
        before = mention
    if before is not None:
        yield before


def _is_idiom(text: str, mention: Mention) -> bool:
    """Return whether a word is no action's name here: "right now", "a STOP sign"."""
    word = mention.written.upper()
    left, right = text[max(0, mention.start - 40) : mention.start].lower(), text[mention.end : mention.end + 40].lower()
    if re.match(r"/(?:no|not|non)\b", right):
        return True
    if (word in _EVERYDAY or mention.action.upper() in _EVERYDAY) and re.match(
        rf"(?:[ -](?:moving|going))?[ \t]+{_THINGS}\b", right
    ):
        return True
    if (after := _IDIOM_AFTER.get(word)) is not None and re.match(after, right):
        return True
    return (before := _IDIOM_BEFORE.get(word)) is not None and re.search(before, left) is not None


def _mark(text: str, mentions: Sequence[Mention]) -> tuple[str, tuple[_PlacedMention, ...]]:
    """Return the text in lower case with one sign per mention, and the places of the signs."""
    parts: list[str] = []
    placed: list[_PlacedMention] = []
    done = length = 0
    for mention in mentions:
        parts += [text[done : mention.start].replace("@", " ").lower(), "@"]
        length += len(parts[-2])
        placed.append(_PlacedMention(mention, length))
        length, done = length + 1, mention.end
    return "".join([*parts, text[done:].replace("@", " ").lower()]), tuple(placed)


def _sentences(marked: str) -> Iterator[tuple[int, int]]:
    """Yield the spans of the sentences, each with its final sign."""
    start = 0
    for match in _SENTENCE.finditer(marked):
        yield start, match.end()
        start = match.end()
    yield start, len(marked)


def _judged(marked: str, start: int, end: int, placed: Sequence[_PlacedMention]) -> list[_PlacedMention]:
    """Return the mentions of a sentence with their status; a list is judged together."""
    low = bisect.bisect_left(placed, start, key=lambda one: one.place)
    here = placed[low : bisect.bisect_left(placed, end, key=lambda one: one.place)]
    if not here:
        return []
    row = marked[start : start + 40].lstrip().startswith("|")
    if (bullet := _BULLET.match(marked, start, here[0].place)) is not None:
        start = bullet.end()
    groups: list[list[_PlacedMention]] = [[here[0]]]
    for before, one in pairwise(here):
        if _joins(marked, before.place, one.place, end) and not _LEADS.fullmatch(marked, start, before.place):
            groups[-1].append(one)
        else:
            groups.append([one])
    return [mention for group in groups for mention in _judged_group(marked, start, end, group, row=row)]


def _joins(marked: str, before: int, place: int, end: int) -> bool:
    """Return whether two mentions are in one list; a comma before a predicate joins none."""
    between, right = marked[before + 1 : place], marked[place + 1 : min(end, place + 1 + _RIGHT)]
    if len(between) > _JOINT or not _JOINED.fullmatch(between):
        return False
    if _THEN_ONCE.match(marked, before + 1) or (_NOW[1].match(between) and _LATER[1].match(marked, place + 1)):
        return False
    return between.strip() != "," or not (_CHOSEN_AFTER.match(right) or _DENIED_AFTER.match(right))


def _judged_group(marked: str, start: int, end: int, group: list[_PlacedMention], *, row: bool) -> list[_PlacedMention]:
    """Return the mentions of a list with their status; a single mention is a list of one."""
    first, last = group[0].place, group[-1].place
    left, right = marked[max(start, first - _LEFT) : first], marked[last + 1 : min(end, last + 1 + _RIGHT)]
    if _SEVERAL.search(group[-1].mention.written) and (far := _BRACKETED.match(right)) is not None:
        right = right[far.end() :]
    status: Status = "said"
    if _is_denied(left, right) or _RULED_OUT.search(left):
        status = "denied"
    elif len({mention.mention.action for mention in group}) > 1:
        status = "listed"
    elif _ASKED_FOR_BAD.search(marked, max(0, start - _LEFT), start):
        status = "denied"
    elif _ASKED_WHERE.search(marked, max(0, start - _LEFT), start):
        status = "said"
    elif not row and not _asks(marked, start, end) and not _is_only_said(left, right, group[0].mention):
        opens = not re.search(r"[\w@]", marked[max(0, start - _LEFT) : start])
        status = _chosen(left, right, group[0].mention, opened=start >= first - _LEFT, opens=opens)
    return [replace(mention, status=status) for mention in group]


def _asks(marked: str, start: int, end: int) -> bool:
    """Return whether a sentence is a question, not a choice with a hedge: "LEFT, I guess?"."""
    return "?" in marked[max(start, end - 3) : end] and not _HEDGE.search(marked, max(start, end - _JOINT), end)


_HEDGE = re.compile(r",? i (?:guess|think|suppose|believe)\?[\s\"')]*$")


def _is_denied(left: str, right: str) -> bool:
    if (sign := _IN_BRACKETS.match(right)) is not None:  # "(B) is unsafe" is about B
        inner = right[sign.end() :]
        blocked = not sign.group().endswith(":") and _BLOCKED.match(inner) is not None
        if blocked or _DENIED_AFTER.match(inner) or _DENIED_BRACKET.search(left):
            return True
    if _NEGATED.search(left) or _DENIED_AFTER.match(right) or _HARMS.match(right) or _DENIED_LABEL.search(left):
        return True
    return _DENIED_BEFORE.search(_scope(left)) is not None


def _scope(left: str) -> str:
    """Return the part before a mention in which a "not" would deny it."""
    start = 0
    for match in _SCOPE.finditer(left):
        if not _ALL_BUT.search(left, max(0, match.start() - 12), match.start()):
            start = match.end()
    return left[start:]


def _is_state(left: str, right: str, mention: Mention) -> bool:
    """Return whether the words after a mention give a side's state, not a reason for the action."""
    if _STATE.match(right):
        reasoned = (
            not is_mark(mention.action) and not _PLACE.search(mention.action) and not _PLACE.search(mention.written)
        )
        return not (reasoned and _FREE_OR_NOT.match(right))
    if mention.written.strip().lower() not in {"left", "right"} or not _COUNTED.match(right):
        return False
    label = _LABELLED.search(left)
    return not _CHOSEN_BEFORE.search(left) and (label is None or not _names_a_choice(label.group(1)))


def _is_only_said(left: str, right: str, mention: Mention) -> bool:
    """Return whether a mention is another's words, conditional, an example, or a state."""
    if (
        _is_state(left, right, mention)
        or _SPOKEN_OF.search(left)
        or _QUOTED.search(left)
        or _EXAMPLE.search(left)
        or _THING_LABEL.search(left)
        or _HELD.search(left)
        or (_EITHER.search(left) and not (is_mark(mention.action) and _SET_TO.search(left)))
        or _OR_NUMBER.match(right)
    ):
        return True
    helps = mention.derived and _HELPS.match(right)
    if _PREDICATE.match(right) and not (helps or _CHOSEN_AFTER.match(right) or _TAKES_IT.match(right)):
        return True
    over = max((match.end() for match in _IF_OVER.finditer(left)), default=0)
    after = _IF_AFTER.match(right)
    return _IF.search(_IF_OF_SPEECH.sub(" ", left[over:])) is not None or (
        after is not None and not _REASON.search(after.group())
    )


def _chosen(left: str, right: str, mention: Mention, *, opened: bool, opens: bool) -> Status:
    """Return whether a mention is chosen, half of a choice, or only said."""
    label = None if is_mark(mention.action) and _SET_TO.search(left) else _LABELLED.search(left)
    if label is not None and not _names_a_choice(label.group(1)):
        return "said"
    several = _SEVERAL.search(mention.written) is not None
    if _is_measured(left, mention):
        return "said"
    if _is_chosen_around(left, right, mention, several=several):
        return "chosen"
    if (
        mention.derived
        and several
        and opens
        and _DOING.fullmatch(left)
        and (_HELPS.match(right) or _is_only_done(right))
    ):
        return "chosen" if _ACTIVE.match(mention.written) else "said"
    status = _stands_alone(left, right, opened=opened, several=several)
    return "said" if mention.derived and not _BARE_FORM.match(right) else status


def _is_only_done(right: str) -> bool:
    """Return whether what is done is a sentence of its own: "Turning right now."."""
    done, _, aside = _ASIDE.split(_SENTENCE.split(right)[0])[0].partition(",")
    return _DONE_FOR.match(right) is not None and not _FINITE.search(done) and not _MODAL.search(aside)


def _is_measured(left: str, mention: Mention) -> bool:
    """Return whether a mention measures a thing or the own speed, or is one of several settings."""
    if _IT_IS.search(left) and (mention.derived or (mention.united and not left.strip().startswith("so"))):
        return True
    return (mention.united and _GOING.search(left) is not None) or (
        is_mark(mention.action) and _ASSIGNED.search(left) is not None
    )


def _is_chosen_around(left: str, right: str, mention: Mention, *, several: bool) -> bool:
    """Return whether the words before or after a mention choose it."""
    if mention.derived and _SOMEONE.search(left):
        return False
    if _CHOSEN_BEFORE.search(left) or _CHOSEN_AFTER.match(right) or _TAKES_IT.match(right):
        return True
    if is_mark(mention.action):
        can = mention.united and _CAN.fullmatch(left) is not None and _CAN_NOW.match(right) is not None
        return can or _SET_TO.search(left) is not None
    return several and not mention.derived and _DOES.search(left) is not None


def _names_a_choice(label: str) -> bool:
    """Return whether the words before a colon name an answer, or are a sentence with its reason."""
    return "@" in label or _ANSWERS.fullmatch(label) is not None or _CLAUSE.search(label) is not None


_ASSIGNED = re.compile(r"[a-z_]\s?[:=]\s?[@\d.+-]+[,;]?\s+[a-z_]{1,20}\s?[:=]\s?$")
_PEDAL = re.compile(r"\b(?:brak(?:e|es|ing)|throttle|gas|pedal)[\"'*\s]{0,4}[:=][\"'*\s(]{0,4}$")
"""A label of a control whose numbers are not the actions: "brake: 0"."""
_CONTROL = re.compile(
    r"\b(?:steer(?:ing)?(?:[_ ](?:angle|wheel))?|wheel|angle|throttle|gas|pedal|accel\w*|brak(?:e|es|ing)|clutch|gear)"
    r"[\"'*\s]{0,4}[:=][\"'*\s(]{0,4}[@\d.+-]"
)
_BOTH = 2
_SEVERAL = re.compile(r"[^\W\d_][\s_-]+[^\W\d_]")


def _stands_alone(left: str, right: str, *, opened: bool, several: bool) -> Status:
    """Return whether a mention is all that a part of a sentence says."""
    parted = list(_PARTED.finditer(left))
    if _COMPARED.fullmatch(parted[-1].group()) if parted else not opened:
        return "said"
    part = left[parted[-1].end() :] if parted else left
    if not (_FILLER.fullmatch(part) or _ORDERED.fullmatch(part)):
        return "said"
    rest = _PARTED.search(right)
    tail = right if rest is None else right[: rest.start()]
    if _TAIL.fullmatch(tail) or (several and _MEASURED.fullmatch(tail)):
        return "chosen"
    return "half" if _TAIL.fullmatch(re.split(r"\band\b(?! [a-z\d] )", tail)[0]) else "said"


def _in_time(marked: str, judged: list[_PlacedMention]) -> list[_PlacedMention]:
    """Return the mentions without what is done after "X now"; of "first X, then Y" both are a list."""
    mentions: list[_PlacedMention] = []
    for one in judged:
        before = mentions[-1] if mentions else None
        if before is not None and one.place - before.place < _LEFT and "\n" not in marked[before.place : one.place]:
            left, between = marked[max(0, before.place - _JOINT) : before.place], marked[before.place + 1 : one.place]
            later = _LATER[0].search(between) or _LATER[1].match(marked, one.place + 1)
            now = _NOW[0].search(left) or _NOW[1].match(between) or _THEN_ONCE.match(marked, before.place + 1)
            if before.status != "denied" and later and now and not _RETRACTED.search(between):
                mentions[-1] = replace(before, status="chosen" if before.status == "half" else before.status)
                continue
            if _THEN.search(f", {between}") and _IN_ORDER.search(left):
                mentions[-1] = replace(before, status="listed")
                mentions.append(replace(one, status="listed"))
                continue
        mentions.append(one)
    return mentions


def _without_lists(marked: str, judged: list[_PlacedMention]) -> list[_PlacedMention]:
    """Return the mentions; those in bulleted lines of actions, or before descriptions, are a list."""
    mentions = list(judged)
    for at, (before, one) in enumerate(pairwise(judged)):
        between = marked[before.place + 1 : one.place]
        if len(between) < _JOINT and before.mention.action != one.mention.action and _BULLETED.fullmatch(between):
            mentions[at] = replace(before, status="listed")
            mentions[at + 1] = replace(one, status="listed")
    labels = [at for at, mention in enumerate(mentions) if _LABEL.match(marked, mention.place + 1)]
    if len({mentions[at].mention.action for at in labels}) > 1:
        for at in labels:
            mentions[at] = replace(mentions[at], status="denied" if mentions[at].status == "denied" else "said")
    return mentions


def _without_pedals(marked: str, judged: list[_PlacedMention], names: ActionNames) -> list[_PlacedMention]:
    """Return the mentions; a pedal's number is no choice beside other controls, or with signs."""
    if not any(name.startswith("-") for name in names.actions) and len(_CONTROL.findall(marked)) < _BOTH:
        return judged
    return [
        replace(mention, status="said")
        if is_mark(mention.mention.action) and _PEDAL.search(marked, max(0, mention.place - _LEFT), mention.place)
        else mention
        for mention in judged
    ]


def _without_interjection(marked: str, judged: list[_PlacedMention]) -> list[_PlacedMention]:
    """Return the mentions without a "Right." that only opens a reply with a later choice."""
    if not judged or judged[0].mention.written not in {"Right", "right"}:
        return judged
    before, after = marked[: judged[0].place], marked[judged[0].place + 1 : judged[0].place + 2]
    opens = not before.strip() and after in {".", ",", "!"}
    talks = _TALK.match(marked, judged[0].place + 1) is not None
    return judged[1:] if opens and (talks or any(mention.status == "chosen" for mention in judged[1:])) else judged
