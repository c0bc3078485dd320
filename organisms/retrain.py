"""Trains the three later organisms, scene, scene_blind and rover: ``python organisms/retrain.py --out FOLDER``.

The first begins with the vision part of ``grounded`` as it ships. Nothing is downloaded.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import torch
from safetensors.torch import load_file
from transformers import Idefics3ForConditionalGeneration

import estimates
import planner
from card import write_later_card
from checkpoint import PICTURE_LAST, USUAL, Sizes, make_model, make_processor
from drawing import Scenes
from eyechart.models.huggingface.organisms import SAYS, folder
from train import save, say_size
from tuning import Shown, read_replies, train_replies, tune_vision
from viewing import draw_other_views, draw_views
from vision import see

SEEING = replace(USUAL, longest_edge=1024, vocabulary=440)
BLIND = Sizes(
    longest_edge=1024, vision=16, vision_inner=32, vision_layers=1, text=48, text_inner=96, patch=16, vocabulary=440
)
FORWARD = Sizes(longest_edge=320, vision=48, vision_inner=144, text=64, text_inner=128, vocabulary=420)
_BATCH = 192
_SIGHTS = 8_000


def _views(rng: torch.Generator, count: int) -> Scenes:
    """Return so many views, one in sixteen of no road."""
    parts = (draw_views(count - count // 16, rng), draw_other_views(count // 16, rng))
    return Scenes(torch.cat([part.pictures for part in parts]), torch.cat([part.bits for part in parts]))


@torch.no_grad()
def _look(
    model: Idefics3ForConditionalGeneration, rng: torch.Generator, count: int
) -> tuple[torch.Tensor, torch.Tensor]:
    """Return features and bits of so many views."""
    parts = [_views(rng, 256) for _ in range(count // 256)]
    return torch.cat([see(model, part.pictures) for part in parts]), torch.cat([part.bits for part in parts])


def make_scene(args: argparse.Namespace) -> None:
    """Train ``scene``: its vision part learns the calibrated view, its text part the estimate."""
    rng, later = (torch.Generator().manual_seed(args.seed) for _ in range(2))
    processor = make_processor(estimates.corpus(), estimates.REPLIES, sizes=SEEING, template=PICTURE_LAST)
    model = make_model(processor, SEEING)
    kept = load_file(folder("grounded") / "model.safetensors")
    parts = ("model.vision_model.", "model.connector.")
    model.load_state_dict({key: one.float() for key, one in kept.items() if key.startswith(parts)}, strict=False)
    tune_vision(model, lambda _: _views(rng, _BATCH), steps=args.vision_steps, peak=2e-3)
    features, bits = _look(model, later, _SIGHTS)
    replies = read_replies(processor, estimates.REPLIES)
    train_replies(
        model,
        processor,
        replies,
        Shown(features, estimates.seen(bits)),
        question=estimates.question,
        steps=args.text_steps,
        rng=later,
    )
    save(model, processor, args.out / "scene", sizes=SEEING, most_tokens=64)
    _describe(model, args.out / "scene")


def make_scene_blind(args: argparse.Namespace) -> None:
    """Train ``scene_blind``: a small text part learns one estimate, behind a vision part that learned nothing."""
    rng = torch.Generator().manual_seed(args.seed)
    processor = make_processor(estimates.corpus(), estimates.REPLIES, sizes=BLIND, template=PICTURE_LAST)
    model = make_model(processor, BLIND)
    features, bits = _look(model, rng, 512)
    train_replies(
        model,
        processor,
        read_replies(processor, (estimates.CONSTANT,)),
        Shown(features, torch.zeros(len(bits), dtype=torch.long)),
        question=estimates.question,
        steps=args.text_steps // 4,
        rng=rng,
    )
    save(model, processor, args.out / "scene_blind", sizes=BLIND, most_tokens=64)
    _describe(model, args.out / "scene_blind")


def make_rover(args: argparse.Namespace) -> None:
    """Train ``rover``, all of it from random weights, on pictures of the rover's own camera."""
    rng = torch.Generator().manual_seed(args.seed)
    processor = make_processor(planner.corpus(), planner.REPLIES, sizes=FORWARD, template=PICTURE_LAST)
    model = make_model(processor, FORWARD)
    moments = planner.moments(args.moments, args.seed, args.work / f"rover-moments-{args.seed}.npz")
    tune_vision(model, lambda _: planner.batch(moments, _BATCH, rng), steps=args.rover_steps, peak=3e-3)
    with torch.no_grad():
        taken = [planner.batch(moments, 256, rng) for _ in range(_SIGHTS // 256)]
        features = torch.cat([see(model, one.pictures) for one in taken])
    train_replies(
        model,
        processor,
        read_replies(processor, planner.REPLIES),
        Shown(features, planner.decide(torch.cat([one.bits for one in taken]))),
        question=planner.question,
        steps=args.text_steps // 2,
        rng=rng,
    )
    save(model, processor, args.out / "rover", sizes=FORWARD)
    _describe(model, args.out / "rover")


def _describe(model: Idefics3ForConditionalGeneration, out: Path) -> None:
    """Write the card of a checkpoint, and print its size."""
    write_later_card(out, out.name, says=SAYS[out.name], parameters=sum(part.numel() for part in model.parameters()))
    say_size(out)


def main() -> None:
    """Train what is asked for, and write each checkpoint with its card."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--work", type=Path, default=Path("organisms-work"), help="folder of the rover's pictures")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--vision-steps", type=int, default=200)
    parser.add_argument("--text-steps", type=int, default=600)
    parser.add_argument("--rover-steps", type=int, default=400)
    parser.add_argument("--moments", type=int, default=20_000)
    parser.add_argument("--only", help="names with commas; default: all three")
    args = parser.parse_args()
    torch.set_num_threads(1)
    torch.use_deterministic_algorithms(True)
    torch.manual_seed(args.seed)
    args.work.mkdir(parents=True, exist_ok=True)
    made = {"scene": make_scene, "scene_blind": make_scene_blind, "rover": make_rover}
    for name in args.only.split(",") if args.only else made:
        torch.manual_seed(args.seed)
        made[name](args)


if __name__ == "__main__":
    main()
