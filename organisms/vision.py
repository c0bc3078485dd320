"""First stage: the vision part and its connector learn the geometry of drawn roads, and are frozen from then on."""

import time
from pathlib import Path

import torch
from torch import Tensor, nn
from torch.nn.functional import binary_cross_entropy_with_logits
from transformers import Idefics3ForConditionalGeneration

from checkpoint import normalise
from drawing import BITS, Scenes, draw, draw_other

BATCH = 256
_PEAK = 3e-3
_WARM_UP = 60


def see(model: Idefics3ForConditionalGeneration, pictures: Tensor) -> Tensor:
    """Return what the text part is shown of pictures (n, 3, 64, 64): (n, 4, 96)."""
    hidden = model.model.vision_model(pixel_values=normalise(pictures)).last_hidden_state
    return model.model.connector(hidden)


def train_vision(model: Idefics3ForConditionalGeneration, *, steps: int, rng: torch.Generator, keep: Path) -> nn.Linear:
    """Train vision and connector in place; return the probe that reads the bits from the mean of the tokens."""
    probe = nn.Linear(96, len(BITS))
    trained = [*model.model.vision_model.parameters(), *model.model.connector.parameters(), *probe.parameters()]
    optimiser = torch.optim.AdamW(trained, lr=_PEAK, weight_decay=0.01, betas=(0.9, 0.98))
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimiser, max_lr=_PEAK, total_steps=steps, pct_start=_WARM_UP / steps, anneal_strategy="cos"
    )
    began = time.monotonic()
    for step in range(1, steps + 1):
        scenes = _paired(rng)
        logits = probe(see(model, scenes.pictures).mean(1))
        road = scenes.bits[:, -1:]
        weight = road.expand(-1, len(BITS)).clone()
        weight[:, -1] = 1.0
        loss = binary_cross_entropy_with_logits(logits, scenes.bits, weight=weight)
        optimiser.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(trained, 1.0)
        optimiser.step()
        schedule.step()
        if step % 50 == 0 or step == steps:
            right = ((logits > 0) == (scenes.bits > 0)).float()[road[:, 0] > 0]
            print(
                f"vision {step}/{steps} loss {loss.item():.4f} gap {right[:, :15].mean():.3f} "
                f"sides {right[:, 15:21].mean():.3f} {time.monotonic() - began:.0f} s",
                flush=True,
            )
            torch.save({"model": model.state_dict(), "probe": probe.state_dict()}, keep)
    return probe


def _paired(rng: torch.Generator) -> Scenes:
    """Return a batch in which every scene stands beside its flip, and one in sixteen shows no road."""
    other = BATCH // 16
    scenes = draw((BATCH - other) // 2, rng)
    flipped, none = scenes.flipped(), draw_other(other, rng)
    parts = (scenes, flipped, none)
    return Scenes(torch.cat([part.pictures for part in parts]), torch.cat([part.bits for part in parts]))
