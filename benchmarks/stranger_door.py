"""Strangers and newcomers as callables: ``python:stranger_door:NAME``, and ``NAME_t0`` at temperature 0.

EYECHART_ADVERSARY_BANK and EYECHART_ADVERSARY_SEED are those of `adversary_door`. At temperature 0 the seed says how
each picture is read. Each name that is asked for is a new one that remembers nothing; what it remembers comes in the
order of the calls.
"""

import os
import random
from functools import partial

from adversary_door import Ask, see_frame
from eyechart.models.scripted import Answer
from eyechart_organisms.adversaries import Adversary, Rule
from newcomers import NEWCOMERS
from strangers import STRANGERS

COLD = "_t0"
KNOWN = {**STRANGERS, **{name: one for kind in NEWCOMERS.values() for name, one in kind.items()}}
NAMES = (*KNOWN, *(name + COLD for name in KNOWN))


def open_stranger(name: str, seed: int) -> Adversary:
    """Return a new one of this name, that remembers nothing."""
    return KNOWN[name.removesuffix(COLD)].open(0 if name.endswith(COLD) else 1, seed)


async def _answer(rule: Rule, rng: random.Random, _: str, image: bytes | None) -> Answer:
    return rule(see_frame(image), rng)


def __getattr__(name: str) -> Ask:
    if name not in NAMES:
        raise AttributeError(name)
    seed = os.environ.get("EYECHART_ADVERSARY_SEED", "0")
    return partial(_answer, open_stranger(name, int(seed)).decide, random.Random(f"{seed}/{name}"))  # noqa: S311 - no secret
