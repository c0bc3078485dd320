"""What the rover's organism answers: the side on which it can go round what stands in its way."""

from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from checkpoint import reply
from drawing import Scenes, draw_other
from eyechart.prompts import FORWARD_PROMPTS
from forward import BITS, Moments, take
from prompts import Asked

ACTIONS = ("SLOW", "STRAIGHT", "LEFT", "RIGHT", "STOP")
REPLIES = tuple(map(reply, ACTIONS))

_SHORT = (
    "Choose the next action. Reply with JSON.",
    "You drive into the picture; the coloured cylinders are obstacles. Which action is safe?",
    "",
)


def corpus() -> list[str]:
    """Return the wording that the tokenizer is made for."""
    return [*(f"{prompt.system} {prompt.user}" for prompt in FORWARD_PROMPTS.values()), *_SHORT]


def question(number: int) -> Asked:
    """Return a question by any number: each of the project's formulations in turn, and two short ones after each."""
    prompts = list(FORWARD_PROMPTS.values())
    if number % 3:
        return "", _SHORT[number // 3 % len(_SHORT)]
    prompt = prompts[number // 3 % len(prompts)]
    return prompt.system, prompt.user


def decide(bits: Tensor) -> Tensor:
    """Return the number of the action (n,): the rule of the scripted planner ``clear_side``."""
    near, left, right, road = bits[:, 0] > 0, bits[:, 3] > 0, bits[:, 4] > 0, bits[:, -1] > 0
    turn = torch.where(left, 2, torch.where(right, 3, 0))
    return torch.where(road, torch.where(near, turn, 1), 4)


def moments(count: int, seed: int, kept: Path) -> Moments:
    """Return moments with their flips, from a file of `forward` where it is there."""
    if not kept.exists():
        taken = take(count, seed)
        np.savez(kept, pictures=taken.pictures, bits=taken.bits)
    found = np.load(kept)
    return Moments(found["pictures"], found["bits"]).with_flips()


def batch(moments: Moments, count: int, rng: torch.Generator) -> Scenes:
    """Return so many of the moments in slightly changing light, and one picture in sixteen that shows no road."""
    none = count // 16
    rows = torch.randint(0, len(moments.bits), (count - none,), generator=rng).numpy()
    pictures = torch.from_numpy(moments.pictures[rows]).permute(0, 3, 1, 2).float()
    other = draw_other(none, rng)
    bits = torch.cat((torch.from_numpy(moments.bits[rows]).float(), torch.zeros(none, len(BITS))))
    return Scenes(torch.cat((pictures, other.pictures)), bits)
