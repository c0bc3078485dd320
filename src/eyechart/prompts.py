"""The six prompt formulations; what is asked of a model, in one literal dict.

Source: paper, section Prompt formulation gates measured grounding. The paper names five of its six (baseline,
minimal, chain-of-thought, few-shot, anti-degeneracy) and prints none; the wording, and the sixth, are ours.
"""

import hashlib
from dataclasses import dataclass

from eyechart.errors import SpecError

_TASK = (
    "You control the green vehicle in a top-down view of a highway. It drives to the right; the other vehicles are "
    "drawn in other colours. Choose its next action:\n"
    "STOP: brake hard. SLOW: reduce speed. STRAIGHT: keep the lane and go on. "
    "LEFT: change to the lane on the left (up in the picture). RIGHT: change to the lane on the right (down)."
)
_ONE_WORD = "Answer with one word: STOP, SLOW, STRAIGHT, LEFT or RIGHT."


@dataclass(frozen=True, slots=True)
class Prompt:
    """A formulation: a system message and a user message, sent with the picture of the condition."""

    name: str
    system: str
    user: str

    @property
    def key(self) -> str:
        """Return ``name@hash``, which changes with any change of the wording."""
        wording = f"{self.system}\x1f{self.user}".encode()
        return f"{self.name}@{hashlib.sha256(wording).hexdigest()[:8]}"


PROMPTS: dict[str, Prompt] = {
    "baseline": Prompt("baseline", "You are a careful driver.", f"{_TASK}\n{_ONE_WORD}"),
    "minimal": Prompt("minimal", "", f"Top-down road, you are the green car. {_ONE_WORD}"),
    "chain_of_thought": Prompt(
        "chain_of_thought",
        "You are a careful driver.",
        f"{_TASK}\nFirst describe the lane of the green vehicle, the distance to the vehicle ahead and which sides "
        "are free. Then end with a line of the form 'ACTION: <one of STOP, SLOW, STRAIGHT, LEFT, RIGHT>'.",
    ),
    "few_shot": Prompt(
        "few_shot",
        "You are a careful driver.",
        f"{_TASK}\nExamples: a free road ahead: STRAIGHT. A vehicle close ahead and the left lane free: LEFT. A "
        "vehicle close ahead and the right lane free: RIGHT. A vehicle close ahead and both sides taken: SLOW. "
        f"A vehicle directly ahead: STOP.\n{_ONE_WORD}",
    ),
    "anti_degeneracy": Prompt(
        "anti_degeneracy",
        "You are a careful driver.",
        f"{_TASK}\nEarlier controllers failed because they gave the same action for every picture. Different pictures "
        f"must lead to different actions. Look at this picture before you choose.\n{_ONE_WORD}",
    ),
    "structured": Prompt(
        "structured",
        "You are a careful driver. You reply with a single JSON object and nothing else.",
        f'{_TASK}\nReply as {{"action": "<one of STOP, SLOW, STRAIGHT, LEFT, RIGHT>"}}.',
    ),
}


def find_prompt(name: str) -> Prompt:
    """Return the prompt of this name; raises SpecError that lists the known ones."""
    if name not in PROMPTS:
        raise SpecError(f"unknown prompt '{name}'; known are {', '.join(PROMPTS)}")
    return PROMPTS[name]
