"""The later organisms' two stages: a vision part learns bits of its pictures, then a text part which reply they need.

The words stand before the picture, so what they make of them is computed once for a batch, and learns nothing itself.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn.functional import binary_cross_entropy_with_logits, cross_entropy
from transformers import Idefics3ForConditionalGeneration, Idefics3Processor

from answers import prompt_ids
from drawing import Scenes
from prompts import Asked
from vision import see

_ROWS = 64
_PEAK = 4e-3
_NONE = -100
_TOLD_WEIGHT = 4.0
_BARE_EVERY = 20


@dataclass(frozen=True)
class Shown:
    """What the vision part makes of pictures, (n, k, width), and the number of the reply that each needs, (n,)."""

    features: Tensor
    kinds: Tensor


@dataclass(frozen=True)
class Replies:
    """The tokens (kinds, k) of every reply that there is, with their weights (k,); -100 where a reply is over."""

    ids: Tensor
    weights: Tensor


def tune_vision(
    model: Idefics3ForConditionalGeneration, take: Callable[[int], Scenes], *, steps: int, peak: float
) -> None:
    """Train vision and connector in place; ``take`` gives a batch by the number of its step."""
    bits = take(0).bits.shape[1]
    probe = nn.Linear(model.config.text_config.hidden_size, bits)
    trained = [*model.model.vision_model.parameters(), *model.model.connector.parameters(), *probe.parameters()]
    optimiser = torch.optim.AdamW(trained, lr=peak, weight_decay=0.01, betas=(0.9, 0.98))
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, max_lr=peak, total_steps=steps, pct_start=0.1)
    began = time.monotonic()
    for step in range(1, steps + 1):
        scenes = take(step)
        logits = probe(see(model, scenes.pictures).mean(1))
        road = scenes.bits[:, -1:]
        weight = torch.cat((road.expand(-1, bits - 1), torch.ones_like(road)), 1)
        loss = binary_cross_entropy_with_logits(logits, scenes.bits, weight=weight)
        optimiser.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(trained, 1.0)
        optimiser.step()
        schedule.step()
        if step % 20 == 0 or step == steps:
            right = ((logits > 0) == (scenes.bits > 0)).float()[road[:, 0] > 0].mean(0)
            spent = f"{time.monotonic() - began:.0f} s, {time.process_time():.0f} s of CPU"
            print(f"vision {step}/{steps} loss {loss.item():.4f} bits {right.mean():.3f}, {spent}", flush=True)


def read_replies(processor: Idefics3Processor, replies: Sequence[str]) -> Replies:
    """Return the tokens of replies with their ends; a token counts more where the longest replies differ."""
    tokenizer = processor.tokenizer
    rows = [[*tokenizer(reply).input_ids, tokenizer.eos_token_id] for reply in replies]
    length = max(map(len, rows))
    ids = torch.tensor([row + [_NONE] * (length - len(row)) for row in rows])
    usual = ids[(ids != _NONE).all(1)]
    differ = (usual != usual[0]).any(0)
    return Replies(ids, torch.where(differ, _TOLD_WEIGHT, 1.0))


def train_replies(
    model: Idefics3ForConditionalGeneration,
    processor: Idefics3Processor,
    replies: Replies,
    shown: Shown,
    *,
    question: Callable[[int], Asked],
    steps: int,
    rng: torch.Generator,
) -> None:
    """Train the text part in place; where there is no picture the last reply is right.

    ``question`` gives the question by the number of its step. One step in twenty shows no picture.
    """
    trained = list(model.model.text_model.parameters())
    optimiser = torch.optim.AdamW(trained, lr=_PEAK, weight_decay=0.01, betas=(0.9, 0.98))
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, max_lr=_PEAK, total_steps=steps, pct_start=0.1)
    began, hits = time.monotonic(), 0.0
    for step in range(1, steps + 1):
        bare = step % _BARE_EVERY == 0
        rows = torch.randint(0, len(shown.kinds), (_ROWS,), generator=rng)
        ids = prompt_ids(processor, question(step), image="none" if bare else "last")
        if bare:
            loss, hit = _loss(model, ids, None, replies.ids[-1:], replies.weights)
        else:
            loss, hit = _loss(model, ids, shown.features[rows], replies.ids[shown.kinds[rows]], replies.weights)
        optimiser.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(trained, 1.0)
        optimiser.step()
        schedule.step()
        hits = hits if bare else 0.9 * hits + 0.1 * hit
        if step % 25 == 0 or step == steps:
            spent = f"{time.monotonic() - began:.0f} s, {time.process_time():.0f} s of CPU"
            print(f"replies {step}/{steps} loss {loss.item():.4f} whole {hits:.3f}, {spent}", flush=True)


def _loss(
    model: Idefics3ForConditionalGeneration, ids: Tensor, features: Tensor | None, answers: Tensor, weights: Tensor
) -> tuple[Tensor, float]:
    """Return the weighted loss on the replies' tokens, and the share of replies that are right to the last token."""
    text, count, length = model.model.text_model, len(answers), answers.shape[1]
    slots = (ids == model.config.image_token_id).nonzero()[:, 0]
    cut = int(slots[0]) if features is not None else len(ids) - 4
    with torch.no_grad():
        past = text(input_ids=ids[None, :cut], use_cache=True).past_key_values
        past.batch_repeat_interleave(count)
    known = text.embed_tokens(ids[cut:]).expand(count, -1, -1)
    if features is not None:
        known = known.clone()
        known[:, slots - cut] = features
    inputs = torch.cat((known, text.embed_tokens(answers[:, :-1].clamp(min=0))), 1)
    hidden = text(inputs_embeds=inputs, past_key_values=past, use_cache=True).last_hidden_state[:, -length:]
    logits = model.lm_head(hidden)
    losses = cross_entropy(logits.flatten(0, 1), answers.flatten(), reduction="none", ignore_index=_NONE)
    right = ((logits.argmax(-1) == answers) | (answers == _NONE)).all(1).float().mean()
    return (losses.view(count, length) * weights).mean(), float(right)
