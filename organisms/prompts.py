"""What an organism is asked in training: the project's own formulations, and many like them."""

import random

from eyechart.prompts import PROMPTS

Asked = tuple[str, str]
"""A system message, empty for none, and a user message."""

_SYSTEM = (
    "", "", "You are a careful driver.", "You are a driver.", "You drive a car.", "You are a helpful assistant.",
    "You control a vehicle by its camera.", "You reply with a single JSON object and nothing else.",
)  # fmt: skip
_SCENE = (
    "Top-down road, you are the green car.",
    "This is a picture of a highway from above. You drive the green vehicle.",
    "You control the green vehicle in a top-down view of a highway. It drives to the right.",
    "You see a road from above; the green car is yours and the others are blue or yellow.",
    "You control a machine by its camera (top-down drawing of a highway).",
    "Look at the picture of the road.",
    "Your vehicle is drawn in green and drives to the right.",
    "",
)
_TASK = (
    "Choose its next action.",
    "What should it do next?",
    "Which action is safe?",
    "Decide: STOP, SLOW, STRAIGHT, LEFT or RIGHT?",
    (
        "Choose the next action: STOP: brake hard. SLOW: reduce speed. STRAIGHT: go on. LEFT: change to the left lane. "
        "RIGHT: change to the right lane."
    ),
    "The actions are STOP, SLOW, STRAIGHT, LEFT, RIGHT.",
)
_ANSWER = (
    "Answer with one word: STOP, SLOW, STRAIGHT, LEFT or RIGHT.",
    "Answer with one of STOP, SLOW, STRAIGHT, LEFT, RIGHT.",
    "Reply with one action.",
    'Reply as {"action": "<one of STOP, SLOW, STRAIGHT, LEFT, RIGHT>"}.',
    "End with a line of the form 'ACTION: <one of STOP, SLOW, STRAIGHT, LEFT, RIGHT>'.",
    "Reply with JSON.",
    "",
)
_EXTRA = (
    "", "", "", "First describe the distance to the vehicle ahead and which sides are free.",
    "Think about the lanes before you answer.", "Different pictures must lead to different actions.",
    "Examples: a free road ahead: STRAIGHT. A vehicle directly ahead: STOP.", "Be careful.",
)  # fmt: skip


def corpus() -> list[str]:
    """Return the wording that the tokenizer is made for."""
    own = [f"{prompt.system} {prompt.user}" for prompt in PROMPTS.values()]
    return [*own, *own, *_SYSTEM, *_SCENE, *_TASK, *_ANSWER, *_EXTRA]


def short(rng: random.Random) -> Asked:
    """Return a prompt of a sentence or two."""
    if rng.random() < 0.3:
        return PROMPTS["minimal"].system, PROMPTS["minimal"].user
    return "", " ".join(filter(None, (rng.choice(_SCENE), rng.choice(_ANSWER[:4]))))


def any_of(rng: random.Random) -> Asked:
    """Return one of the project's formulations, or one put together at random."""
    if rng.random() < 0.6:
        prompt = rng.choice([PROMPTS["baseline"], PROMPTS["baseline"], *PROMPTS.values()])
        return prompt.system, prompt.user
    parts = (rng.choice(_SCENE), rng.choice(_TASK), rng.choice(_EXTRA), rng.choice(_ANSWER))
    return rng.choice(_SYSTEM), rng.choice((" ", "\n")).join(filter(None, parts))
