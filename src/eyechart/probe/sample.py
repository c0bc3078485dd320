"""The probe's other calls: the run's own question, and two tests of structured output."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from eyechart.calls import REFUSED, Query, Reply, is_cut
from eyechart.frames import Stimulus
from eyechart.modes import RequestMode
from eyechart.probe.asker import Asker
from eyechart.probe.pictures import road
from eyechart.prompts import Prompt, find_prompt
from eyechart.records import parse_json
from eyechart.seeds import key_seed
from eyechart.spaces.discrete import DRIVING, Discrete
from eyechart.spaces.space import AnySpace

SERVED = ("openai", "ollama")
"""Adapters with a format, fields and a seed in their requests; the probe finds which work."""

_ACTIONS = ("TEAPOT", "UMBRELLA")
_PLAIN = "Reply with the word YES and nothing else: one plain word, no JSON, no brackets, no quotation marks."


@dataclass(frozen=True, slots=True)
class Sample:
    """A sample of a run's calls: a few pairs of a prompt and a stimulus, and the answers' space.

    ``at_once`` is the run's number of parallel calls.
    """

    questions: Sequence[tuple[Prompt, Stimulus]]
    space: AnySpace = DRIVING
    at_once: int = 8

    def query(self, number: int, *, picture: bool = True) -> Query:
        """Return one query of the sample, with or without its picture."""
        prompt, seen = self.questions[number % len(self.questions)]
        return prompt.query(seen if picture else replace(seen, images={}), key_seed("sample", number), self.space)

    @property
    def wants_json(self) -> bool:
        """Return whether every prompt asks for JSON."""
        queries = (self.query(number) for number in range(len(self.questions)))
        said = (" ".join(turn.words for turn in one.turns) for one in queries)
        return all(re.search(r"\bjson\b", words, re.IGNORECASE) for words in said)

    def is_decision(self, reply: Reply) -> bool:
        """Return whether a reply holds a decision."""
        return self.space.read(reply).action is not None


def default_sample(prompt: str = "baseline") -> Sample:
    """Return a built-in prompt, or a file's, with sketches of a road; SpecError for another."""
    found = find_prompt(prompt)
    space = found.asks(DRIVING)
    said = dict.fromkeys(found.fields, "unknown")
    return Sample([(found, replace(Stimulus.of(road(number)), fields=said)) for number in range(3)], space)


def plain(words: str, seed: int, picture: bytes | None = None) -> Query:
    """Return a query of the probe itself: this text, and a picture if there is one."""
    return Prompt("probe", "", words).query(Stimulus.of(picture), seed)


def is_served(mode: RequestMode) -> bool:
    """Return whether the model's API has a format and fields of its own."""
    return mode.spec.partition(":")[0] in SERVED


async def schema_binds(asker: Asker, mode: RequestMode) -> tuple[bool | None, str]:
    """Ask for YES under a schema that allows two other words; return whether it binds, and why."""
    query = Prompt("probe", "", _PLAIN).query(Stimulus(), key_seed("schema"), Discrete("probe", _ACTIONS, (), (), ()))
    reply = await asker.ask(query, replace(mode, structured="json_schema"))
    if reply.error is not None:
        refused = False if reply.error in REFUSED else None
        return refused, f"{'refused' if refused is False else 'failed'}: {reply.error_detail[:120]}"
    if is_cut(reply) or not reply.text.strip():
        return None, "the reply was cut off or empty"
    found = _object(reply.text)
    binds = found is not None and found.get("action") in _ACTIONS
    return binds, f"asked for YES, got {reply.text.strip()[:40]!r}"


async def json_binds(asker: Asker, mode: RequestMode) -> tuple[bool | None, str]:
    """Ask for one plain word in JSON mode; return whether an object comes, and why."""
    query = plain(_PLAIN, key_seed("json"))
    reply = await asker.ask(query, replace(mode, structured="json_object"))
    if reply.error is not None or is_cut(reply):
        return (False if reply.error in REFUSED else None), reply.error_detail[:120] or "cut off"
    return _object(reply.text) is not None, f"asked for YES, got {reply.text.strip()[:40]!r}"


def _object(text: str) -> dict[str, object] | None:
    try:
        value = parse_json(text)
    except (ValueError, RecursionError):
        return None
    return value if isinstance(value, dict) else None
