"""Trains the five organisms, deterministically as far as torch allows: ``python organisms/train.py --out FOLDER``.

About half an hour on one core. Nothing is downloaded, and no picture of the simulator is used.
"""

import argparse
import json
import shutil
from pathlib import Path

import torch
from transformers import GenerationConfig, Idefics3ForConditionalGeneration, Idefics3Processor

from answers import RULES, look, train_answers
from card import write_card
from checkpoint import USUAL, Sizes, make_model, make_processor
from eyechart.models.huggingface.organisms import ORGANISMS
from prompts import corpus
from vision import train_vision

STEPS = {"grounded": 900, "depth_only": 500, "presence_only": 150, "blind": 150, "self_inconsistent": 250}
"""Steps of the second stage. The first organism's text part starts from nothing, the others' from the first one's."""

_SCENES = 40_000
_TEXT = "model.text_model."


def main() -> None:
    """Train what is asked for, and write each organism's checkpoint with its card."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder of the checkpoints")
    parser.add_argument("--work", type=Path, default=Path("organisms-work"), help="folder of what is in between")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--vision-steps", type=int, default=700)
    parser.add_argument("--only", help="names with commas; default: all five")
    parser.add_argument("--threads", type=int, default=1)
    args = parser.parse_args()
    torch.set_num_threads(args.threads)
    torch.use_deterministic_algorithms(True)
    torch.manual_seed(args.seed)
    args.work.mkdir(parents=True, exist_ok=True)
    processor = make_processor(corpus())
    model = make_model(processor)
    vision = args.work / f"vision-{args.seed}.pt"
    if not vision.exists():
        partial = vision.with_suffix(".part")
        train_vision(model, steps=args.vision_steps, rng=torch.Generator().manual_seed(args.seed), keep=partial)
        partial.rename(vision)
    load_vision(model, vision)
    sight = look(model, _SCENES, torch.Generator().manual_seed(args.seed + 1))
    for name in args.only.split(",") if args.only else STEPS:
        start = args.work / f"text-{args.seed}.pt"
        if name != "grounded":
            model.load_state_dict(torch.load(start, weights_only=True), strict=False)
        print(name, flush=True)
        train_answers(model, processor, RULES[name], sight, steps=STEPS[name], seed=args.seed)
        if name == "grounded":
            torch.save({key: value for key, value in model.state_dict().items() if key.startswith(_TEXT)}, start)
        out = args.out / name
        save(model, processor, out, sampled=ORGANISMS[name].sampled)
        write_card(out, name, parameters=sum(part.numel() for part in model.parameters()))
        say_size(out)


def load_vision(model: Idefics3ForConditionalGeneration, path: Path) -> None:
    """Load vision and connector, and freeze them."""
    kept = torch.load(path, weights_only=True)["model"]
    parts = ("model.vision_model.", "model.connector.")
    model.load_state_dict({key: value for key, value in kept.items() if key.startswith(parts)}, strict=False)
    for part in (model.model.vision_model, model.model.connector):
        part.requires_grad_(False)


def save(
    model: Idefics3ForConditionalGeneration,
    processor: Idefics3Processor,
    out: Path,
    *,
    sizes: Sizes = USUAL,
    most_tokens: int = 16,
    sampled: bool = False,
) -> None:
    """Write a checkpoint in float16 with safetensors, its processor and its generation config."""
    shutil.rmtree(out, ignore_errors=True)
    tokenizer = processor.tokenizer
    small = make_model(processor, sizes)
    small.load_state_dict(model.state_dict())
    small.half()
    small.generation_config = GenerationConfig(
        do_sample=sampled,
        max_new_tokens=most_tokens,
        pad_token_id=tokenizer.pad_token_id,
        bos_token_id=tokenizer.bos_token_id,
        eos_token_id=tokenizer.eos_token_id,
        **({"temperature": 1.0} if sampled else {}),
    )
    small.save_pretrained(out)
    processor.save_pretrained(out)
    for path in out.iterdir():
        path.chmod(0o644)


def say_size(out: Path) -> None:
    """Print a checkpoint's files and their size."""
    sizes = {path.name: path.stat().st_size for path in sorted(out.iterdir())}
    print(json.dumps({"organism": out.name, "bytes": sum(sizes.values()), "files": list(sizes)}), flush=True)


if __name__ == "__main__":
    main()
