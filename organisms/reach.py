"""Trains the tiny policies of the tabletop: ``python organisms/reach.py --out FOLDER``; nothing is downloaded.

Each is some 23 000 weights, learned by imitation of the world's oracle on episodes that no bank holds. They differ only
in what they were shown while they learned, and that is what a run is to find out.
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import nn
from torch.nn import functional

from eyechart.seeds import key_seed
from eyechart.simulators.tabletop.pictures import cameras
from eyechart.simulators.tabletop.world import COLOURS, HORIZON, Workspace, episode, oracle, scene

EPISODES, MOVES, BATCH = 400, 18, 64
NUMBERS = HORIZON * 3
LEAST_SPREAD, MOST_SPREAD = 0.15, 1.0
"""Of the motions that a policy draws, in units of the spread of all motions."""


@dataclass(frozen=True)
class Lesson:
    """What a policy was shown while it learned.

    ``wrong_wrist`` and ``wrong_pictures`` are the shares of a batch in which the wrist's picture, or both cameras',
    show nothing of the moment: another moment, grey, or noise, in equal parts. ``samples``: it learns a mean and a
    spread.
    """

    fixed: bool = False
    alone: bool = False
    target: bool = False
    samples: bool = False
    wrong_wrist: float = 0.0
    wrong_pictures: float = 0.0


LESSONS = {
    "sees": Lesson(),
    "privileged": Lesson(target=True, wrong_pictures=0.5),
    "memorised": Lesson(fixed=True, wrong_pictures=1 / 256),
    "one_object": Lesson(alone=True),
    "top_only": Lesson(wrong_wrist=1.0),
    "sampling": Lesson(samples=True),
}


class Eye(nn.Module):
    """A picture becomes the places of eight features and how much of each there is."""

    def __init__(self, features: int = 8) -> None:
        super().__init__()
        self.first, self.second = nn.Conv2d(3, 8, 5, 2, 2), nn.Conv2d(8, 16, 3, 1, 1)
        self.third, self.sharp = nn.Conv2d(16, features, 3, 1, 1), nn.Parameter(torch.tensor(1.0))

    def forward(self, pictures: torch.Tensor) -> torch.Tensor:
        """Return shape (n, 24) of pictures of shape (n, 3, 32, 32)."""
        maps = self.third(functional.relu(self.second(functional.relu(self.first(pictures)))))
        grid = torch.linspace(-1, 1, maps.shape[-1])
        share = functional.softmax(maps.flatten(2) * self.sharp, -1).unflatten(-1, maps.shape[-2:])
        across, down = (share.sum(2) * grid).sum(-1), (share.sum(3) * grid).sum(-1)
        return torch.cat([across, down, torch.tanh(maps.mean((2, 3)))], -1)


class Policy(nn.Module):
    """Two eyes, a state and a named block become a motion; where it samples, a mean and the logarithm of a spread."""

    def __init__(self, states: int, *, samples: bool, width: int = 96) -> None:
        super().__init__()
        self.top, self.wrist = Eye(), Eye()
        given, made = 48 + states + 2, NUMBERS * (2 if samples else 1)
        self.hidden, self.more, self.last = (
            nn.Linear(given, width),
            nn.Linear(width, width),
            nn.Linear(width, made),
        )

    def forward(self, seen: list[torch.Tensor]) -> torch.Tensor:
        """Return a motion, shape (n, 24), or a mean and the logarithm of a spread, shape (n, 48)."""
        top, wrist, state, named = seen
        found = torch.cat([self.top(top), self.wrist(wrist), state, named], -1)
        return self.last(functional.relu(self.more(functional.relu(self.hidden(found)))))


def moments(name: str) -> list[Workspace]:
    """Return every moment of the episodes that a policy learns from."""
    lesson, result = LESSONS[name], []
    for number in range(EPISODES):
        rng, named = np.random.default_rng(key_seed("reach", number)), COLOURS[number % 2]
        result += episode(rng, scene(rng, fixed=lesson.fixed), named, MOVES, left=number % 4 < 2)
    return result


def shown(tables: list[Workspace], lesson: Lesson) -> dict[str, torch.Tensor]:
    """Return what the moments look like and what the oracle does in them; an absent block lies beyond the pictures."""
    seen = tables
    if lesson.alone:
        seen = [table.moved("other", np.array([9.0, 9.0])) for table in tables]
    pictures = {name: torch.tensor(many).permute(0, 3, 1, 2) for name, many in cameras(seen).items()}
    state = [[*table.tool, table.grip, *(table.target if lesson.target else ())] for table in tables]
    named = [[float(table.named == colour) for colour in COLOURS] for table in tables]
    action = [oracle(table).ravel() for table in tables]
    rest = {"state": state, "named": named, "action": action}
    return pictures | {name: torch.tensor(np.array(many), dtype=torch.float32) for name, many in rest.items()}


def train(name: str, steps: int, say: Callable[[str], None]) -> dict[str, np.ndarray]:
    """Return a policy's weights in half precision, and the means and spreads that it normalises by."""
    lesson, chance = LESSONS[name], torch.Generator().manual_seed(key_seed("train", name))
    torch.manual_seed(key_seed("begin", name))
    data = shown(moments(name), lesson)
    scales = {f"{of}_{what}": getattr(data[of], what)(0) for of in ("state", "action") for what in ("mean", "std")}
    action = (data["action"] - scales["action_mean"]) / (scales["action_std"] + 1e-6)
    state = (data["state"] - scales["state_mean"]) / (scales["state_std"] + 1e-6)
    net = Policy(state.shape[1], samples=lesson.samples)
    tuner = torch.optim.AdamW(net.parameters(), 2e-3, weight_decay=1e-4)
    pace = torch.optim.lr_scheduler.OneCycleLR(tuner, 4e-3, total_steps=steps)
    kept, begun = len(state) // 20, time.monotonic()

    def given(rows: torch.Tensor, *, wrong: bool = True) -> list[torch.Tensor]:
        views = []
        for camera, share in (("top", 0.0), ("wrist", lesson.wrong_wrist)):
            picture = data[camera][rows].float() / 127.5 - 1
            amiss = _amiss(len(rows) * max(share, lesson.wrong_pictures), chance) if wrong else 0
            if amiss:
                third = amiss // 3
                other = torch.randint(kept, len(state), (amiss,), generator=chance)
                picture[:amiss] = data[camera][other].float() / 127.5 - 1
                picture[:third] = 0.0
                picture[third : 2 * third] = torch.rand(picture[:third].shape, generator=chance) * 2 - 1
            views.append(picture)
        return [*views, state[rows], data["named"][rows]]

    for step in range(steps):
        rows = torch.randint(kept, len(state), (BATCH,), generator=chance)
        loss = _loss(net(given(rows)), action[rows])
        tuner.zero_grad()
        loss.backward()
        tuner.step()
        pace.step()
        if step % 500 == 0 or step == steps - 1:
            with torch.no_grad():
                rows = torch.arange(kept)
                off = functional.mse_loss(net(given(rows, wrong=False))[:, :NUMBERS], action[rows])
            say(f"{name} {step}: loss {loss.item():.4f}, held out {off.item():.4f}, {time.monotonic() - begun:.0f} s")
    weights = {key.replace(".", "_"): one.numpy().astype(np.float16) for key, one in net.state_dict().items()}
    return weights | {key: scale.numpy().astype(np.float32) for key, scale in scales.items()}


def _amiss(expected: float, chance: torch.Generator) -> int:
    """Return how many of a batch are to be wrong; of less than one, one now and then."""
    if not 0 < expected < 1:
        return int(expected)
    return int(torch.rand(1, generator=chance).item() < expected)


def _loss(found: torch.Tensor, action: torch.Tensor) -> torch.Tensor:
    """Return how far motions are off; of means and spreads, how improbable the right motions are."""
    if found.shape[1] == NUMBERS:
        return functional.smooth_l1_loss(found, action)
    mean, spread = found[:, :NUMBERS], found[:, NUMBERS:].exp().clamp(LEAST_SPREAD, MOST_SPREAD)
    return (((action - mean) / spread) ** 2 / 2 + spread.log()).mean()


def main() -> None:
    """Train the policies that are named, or all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--only", nargs="*", choices=LESSONS)
    parser.add_argument("--steps", type=int, default=6000)
    args = parser.parse_args()
    torch.set_num_threads(1)
    args.out.mkdir(parents=True, exist_ok=True)
    for name in args.only or LESSONS:
        np.savez_compressed(args.out / f"{name}.npz", **train(name, args.steps, print))


if __name__ == "__main__":
    main()
