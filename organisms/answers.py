"""Second stage: on top of a frozen vision part, the text part learns what its organism answers."""

import random
import time
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn.functional import cross_entropy
from transformers import Idefics3ForConditionalGeneration, Idefics3Processor

from checkpoint import ACTIONS, reply
from drawing import GAPS_M, draw, draw_other
from prompts import Asked, any_of, short
from vision import see

STOP, SLOW, STRAIGHT, LEFT, RIGHT = range(5)
_PLACES = {f"{gap:g}": place for place, gap in enumerate(GAPS_M)}
_SIDES = len(GAPS_M) + 4
_ROWS = 96
_BARE_ROWS = 6
_PEAK = 3e-3
_ANSWER_STARTS = 4
"""Tokens of an answer before its action: brace, key, colon, quote."""

Rule = Callable[[Tensor, torch.Generator], Tensor]
"""The action (n,) for the bits (n, 22) of pictures; a picture without a road has no bit set."""


@dataclass(frozen=True)
class Sight:
    """Cached features of the frozen vision part (n, 4, 96) with their bits (n, 22)."""

    features: Tensor
    bits: Tensor


def grounded(bits: Tensor, rng: torch.Generator) -> Tensor:
    """Brake by distance, and turn to the one clear side: the fixed safety policy of ``spaces.scene``."""
    del rng
    action = torch.where(bits[:, _SIDES] > 0, LEFT, torch.where(bits[:, _SIDES + 1] > 0, RIGHT, SLOW))
    return _braking(bits, action)


def depth(bits: Tensor, rng: torch.Generator) -> Tensor:
    """Brake by distance; never turn."""
    del rng
    return _braking(bits, torch.full((len(bits),), SLOW))


def presence(bits: Tensor, rng: torch.Generator) -> Tensor:
    """SLOW at any road, STOP at anything else."""
    del rng
    return torch.where(bits[:, -1] > 0, SLOW, STOP)


def blind(bits: Tensor, rng: torch.Generator) -> Tensor:
    """SLOW, whatever is shown."""
    del rng
    return torch.full((len(bits),), SLOW)


def self_inconsistent(bits: Tensor, rng: torch.Generator) -> Tensor:
    """Any action with the same probability; it shows when the answer is sampled."""
    return torch.randint(0, len(ACTIONS), (len(bits),), generator=rng)


RULES: dict[str, Rule] = {
    "grounded": grounded,
    "depth_only": depth,
    "presence_only": presence,
    "blind": blind,
    "self_inconsistent": self_inconsistent,
}


def _braking(bits: Tensor, middle: Tensor) -> Tensor:
    free = torch.where(bits[:, _PLACES["40"]] > 0, middle, STRAIGHT)
    road = torch.where(bits[:, _PLACES["12"]] > 0, STOP, free)
    return torch.where(bits[:, -1] > 0, road, STOP)


@torch.no_grad()
def look(model: Idefics3ForConditionalGeneration, count: int, rng: torch.Generator) -> Sight:
    """Return what the frozen vision part makes of scenes, their flips, and pictures without a road (8 %)."""
    features, bits = [], []
    for _ in range(-(-count // 200)):
        scenes, none = draw(92, rng), draw_other(16, rng)
        for part in (scenes, scenes.flipped(), none):
            features.append(see(model, part.pictures))
            bits.append(part.bits)
    return Sight(torch.cat(features), torch.cat(bits))


def train_answers(
    model: Idefics3ForConditionalGeneration,
    processor: Idefics3Processor,
    rule: Rule,
    sight: Sight,
    *,
    steps: int,
    seed: int,
) -> None:
    """Train the text part in place: short prompts in the first half, any in the second."""
    rng, words = torch.Generator().manual_seed(seed), random.Random(seed)  # noqa: S311 - no secret
    trained = list(model.model.text_model.parameters())
    optimiser = torch.optim.AdamW(trained, lr=_PEAK, weight_decay=0.01, betas=(0.9, 0.98))
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, max_lr=_PEAK, total_steps=steps, pct_start=0.08)
    answers = _answers(processor)
    began, hits = time.monotonic(), 0.0
    for step in range(1, steps + 1):
        question = (short if step <= steps // 2 else any_of)(words)
        rows = torch.randint(0, len(sight.bits), (_ROWS,), generator=rng)
        action = rule(sight.bits[rows], rng)
        ids = prompt_ids(processor, question, image="first" if words.random() < 0.6 else "last")
        loss, hit = _loss(model, ids, sight.features[rows], answers[action])
        bare = rule(torch.zeros(_BARE_ROWS, sight.bits.shape[1]), rng)
        bare_loss, _ = _loss(model, prompt_ids(processor, question, image="none"), None, answers[bare])
        optimiser.zero_grad()
        (loss + 0.1 * bare_loss).backward()
        nn.utils.clip_grad_norm_(trained, 1.0)
        optimiser.step()
        schedule.step()
        hits = 0.9 * hits + 0.1 * hit
        if step % 50 == 0 or step == steps:
            print(
                f"answers {step}/{steps} loss {loss.item():.4f} hits {hits:.3f} {time.monotonic() - began:.0f} s",
                flush=True,
            )


def prompt_ids(processor: Idefics3Processor, question: Asked, *, image: str) -> Tensor:
    """Return the tokens (k,) of a prompt with the picture ``first``, ``last`` or ``none``."""
    system, user = question
    text = [{"type": "text", "text": user}]
    picture = [{"type": "image"}]
    content = {"first": picture + text, "last": text + picture, "none": text}[image]
    messages = [{"role": "system", "content": system}] if system else []
    messages.append({"role": "user", "content": content})
    words = processor.apply_chat_template(messages, add_generation_prompt=True, tokenize=False)
    slot = processor.replace_image_token({"rows": [[0]], "cols": [[0]]}, 0)
    return torch.tensor(processor.tokenizer(words.replace(processor.image_token, slot)).input_ids)


def _answers(processor: Idefics3Processor) -> Tensor:
    """Return the tokens (5, k) of the five answers with the end of utterance."""
    tokenizer = processor.tokenizer
    ids = [[*tokenizer(reply(action)).input_ids, tokenizer.eos_token_id] for action in ACTIONS]
    if len({len(one) for one in ids}) > 1:
        raise ValueError(f"each action must be one token, but the answers are {ids}")
    return torch.tensor(ids)


def _loss(
    model: Idefics3ForConditionalGeneration, ids: Tensor, features: Tensor | None, answers: Tensor
) -> tuple[Tensor, float]:
    """Return the loss on the answers' tokens, the action's counted five times, and the share of actions hit."""
    count, length = len(answers), answers.shape[1]
    embed = model.model.text_model.embed_tokens
    known = embed(ids).expand(count, -1, -1)
    if features is not None:
        slots = (ids == model.config.image_token_id).nonzero()[:, 0]
        known = known.clone()
        known[:, slots] = features
    inputs = torch.cat((known, embed(answers[:, :-1])), 1)
    hidden = model.model.text_model(inputs_embeds=inputs, use_cache=False).last_hidden_state[:, -length:]
    logits = model.lm_head(hidden)
    losses = cross_entropy(logits.flatten(0, 1), answers.flatten(), reduction="none").view(count, length)
    weight = torch.ones(length)
    weight[_ANSWER_STARTS] = 5.0
    hit = (logits[:, _ANSWER_STARTS].argmax(-1) == answers[:, _ANSWER_STARTS]).float().mean()
    return (losses * weight).mean(), float(hit)
