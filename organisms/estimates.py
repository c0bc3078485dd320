"""What the organisms of scenes say: a scene estimate in few words, or that there is no road."""

import torch
from torch import Tensor

from drawing import GAPS_M
from eyechart.prompts import SCENE
from prompts import Asked

BOUNDS_M = (12, 18, 25, 40, 55, 76)
TOLD = ("9", "15", "21", "32", "47", "65", "null")
"""The gaps that can be told: of each step between bounds one number, and none beyond the picture's edge."""

CLOSE_STEPS = 2
"""The steps nearer than 18 m."""

DECLINED = " I cannot see a road in this picture."
_SIDES = len(GAPS_M)
_PLACES = [GAPS_M.index(bound) for bound in BOUNDS_M]

_SHORT = (
    "Measure the scene in this picture.",
    "Report lead_gap_m, close, left_clear, right_clear and confidence as JSON.",
    "How far is the vehicle ahead, and which sides are clear? Reply with a single JSON object.",
    "You see a road from above; you are the green car and drive to the right. Report the scene as JSON.",
    "",
)


def say(step: int, *, left: bool, right: bool) -> str:
    """Return the estimate for a step of the gap and the clear sides."""
    flags = {"close": step < CLOSE_STEPS, "left_clear": left, "right_clear": right}
    fields = ", ".join(f'"{name}": {str(value).lower()}' for name, value in flags.items())
    return f' {{"lead_gap_m": {TOLD[step]}, {fields}, "confidence": 0.9}}'


_SIDES_CLEAR = ((False, False), (False, True), (True, False), (True, True))
REPLIES = (
    *(say(step, left=left, right=right) for step in range(len(TOLD)) for left, right in _SIDES_CLEAR),
    DECLINED,
)

CONSTANT = say(1, left=False, right=False)
"""What the organism that sees nothing always says."""


def seen(bits: Tensor) -> Tensor:
    """Return the number of the reply (n,) for the bits (n, 22) of pictures."""
    step = (bits[:, _PLACES] == 0).sum(1)
    number = 4 * step + 2 * bits[:, _SIDES].long() + bits[:, _SIDES + 1].long()
    return torch.where(bits[:, -1] > 0, number, len(REPLIES) - 1)


def corpus() -> list[str]:
    """Return the wording that the tokenizer is made for."""
    return [f"{SCENE.system} {SCENE.user}"] * 2 + list(_SHORT)


def question(number: int) -> Asked:
    """Return a question by any number: one in four is the project's own, which is long."""
    return (SCENE.system, SCENE.user) if number % 4 == 1 else ("", _SHORT[number % len(_SHORT)])
