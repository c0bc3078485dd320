"""Strangers as callables: ``python:stranger_door:NAME``, and ``python:stranger_door:NAME_t0`` at temperature 0.

EYECHART_ADVERSARY_BANK and EYECHART_ADVERSARY_SEED are those of `adversary_door`. At temperature 0 the seed says how
each picture is read. Each name that is asked for is a new one that remembers nothing; what it remembers comes in the
order of the calls.
"""

import os
import random
from functools import partial

from adversary_door import Ask, see_frame
from eyechart.calibrate.adversaries import Rule
from eyechart.calibrate.strangers import STRANGERS
from eyechart.models.scripted import Answer

COLD = "_t0"
NAMES = (*STRANGERS, *(name + COLD for name in STRANGERS))


async def _answer(rule: Rule, rng: random.Random, _: str, image: bytes | None) -> Answer:
    return rule(see_frame(image), rng)


def __getattr__(name: str) -> Ask:
    if name not in NAMES:
        raise AttributeError(name)
    seed = os.environ.get("EYECHART_ADVERSARY_SEED", "0")
    one = STRANGERS[name.removesuffix(COLD)].open(0 if name.endswith(COLD) else 1, int(seed))
    return partial(_answer, one.decide, random.Random(f"{seed}/{name}"))  # noqa: S311 - no secret
