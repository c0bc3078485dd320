"""LeRobot's own ACT on the tabletop, trained with and without a state that tells where the block is: opposite verdicts.

    LEROBOT_PYTHON=/path/to/python make long-act

``LEROBOT_PYTHON`` is a Python (3.12 or newer) that has LeRobot and eyechart; it trains, and it asks. ACT reads no text,
so that the callable hands it the named block as two numbers of its state. Its backbone is a small one, since nothing is
downloaded. A policy that is trained, and a run that is finished, are not made again. Writes
``benchmarks/results/act.json``; exit 1 where a verdict is not as it should be.
"""

import argparse
import datetime as dt
import json
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).parent
RESULT = HERE / "results" / "act.json"
CACHE = Path(os.environ.get("EYECHART_ACT", "build/act"))
EPISODES, MOVES, BATCH, HORIZON = 400, 18, 32, 8
TOLD = ("camera", "cameras", "state", "instruction", "guards", "channels")
"""What of a verdict a result keeps."""
PRESETS = {"sees": "balanced", "privileged": "privileged"}
EXPECTED = {
    "sees": {"camera": ("object_grounded", "camera_content"), "instruction": ("instruction_followed",)},
    "privileged": {"camera": ("ignores_camera",), "state": ("state_shortcut",)},
}

SMALL: dict[str, Any] = {
    "chunk_size": HORIZON,
    "n_action_steps": HORIZON,
    "pretrained_backbone_weights": None,
    "dim_model": 64,
    "n_heads": 4,
    "dim_feedforward": 128,
    "n_encoder_layers": 1,
    "n_decoder_layers": 1,
    "n_vae_encoder_layers": 1,
    "latent_dim": 8,
    "dropout": 0.0,
    "use_vae": False,
}
"""The size of an ACT that learns on two processors in minutes."""


def moments(kind: str) -> dict[str, np.ndarray]:
    """Return the training data: pictures, states with the named block, and motions, of episodes that no bank holds."""
    from eyechart.seeds import key_seed  # noqa: PLC0415 - of the other environment
    from eyechart.simulators.tabletop.pictures import cameras  # noqa: PLC0415
    from eyechart.simulators.tabletop.world import COLOURS, episode, oracle, scene  # noqa: PLC0415

    rng, tables = np.random.default_rng(key_seed("act", kind)), []
    for turn in range(EPISODES):
        tables += episode(rng, scene(rng), COLOURS[turn % 2], MOVES, left=turn % 4 < 2)
    seen = cameras(tables)
    own = [[*table.tool, table.grip, *(table.target if kind == "privileged" else ())] for table in tables]
    told = [[float(table.named == colour) for colour in COLOURS] for table in tables]
    return {
        "top": seen["top"],
        "wrist": seen["wrist"],
        "state": np.concatenate([np.array(own), np.array(told)], axis=1).astype(np.float32),
        "action": np.stack([oracle(table) for table in tables]).astype(np.float32),
    }


def features(states: int) -> dict[str, Any]:
    """Return what LeRobot's configurations are told of the tabletop; torch begins at one seed, with one thread."""
    import torch  # noqa: PLC0415
    from lerobot.configs.types import FeatureType, PolicyFeature  # noqa: PLC0415

    torch.set_num_threads(1)
    torch.manual_seed(0)
    visual = {f"observation.images.{name}": PolicyFeature(FeatureType.VISUAL, (3, 32, 32)) for name in ("top", "wrist")}
    return {
        "input_features": {**visual, "observation.state": PolicyFeature(FeatureType.STATE, (states,))},
        "output_features": {"action": PolicyFeature(FeatureType.ACTION, (3,))},
        "device": "cpu",
    }


def backbone() -> Any:  # noqa: ANN401 - of torch
    """Return a small network from pictures (n, 3, 32, 32) to maps (n, 32, 8, 8)."""
    import torch  # noqa: PLC0415

    first, second, third = (torch.nn.Conv2d(*one) for one in ((3, 12, 5, 2, 2), (12, 24, 3, 2, 1), (24, 32, 3, 1, 1)))
    between = torch.nn.ReLU()
    return torch.nn.Sequential(first, between, second, between, third, between)


def policy_of(states: int) -> Any:  # noqa: ANN401 - of LeRobot
    """Return LeRobot's ACT with a small backbone."""
    import torch  # noqa: PLC0415
    from lerobot.policies.act.configuration_act import ACTConfig  # noqa: PLC0415
    from lerobot.policies.act.modeling_act import ACTPolicy  # noqa: PLC0415

    class Small(torch.nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.net = backbone()

        def forward(self, pictures: Any) -> dict[str, Any]:  # noqa: ANN401 - of torch
            return {"feature_map": self.net(pictures)}

    config = ACTConfig(
        **features(states),
        **SMALL,
    )
    made = ACTPolicy(config)
    made.model.backbone = Small()
    made.model.encoder_img_feat_input_proj = torch.nn.Conv2d(32, 64, 1)
    return made


def processors(config: Any, data: dict[str, np.ndarray]) -> tuple[Any, Any]:  # noqa: ANN401 - of LeRobot
    """Return what normalises a policy's inputs, and what un-normalises its answers."""
    import torch  # noqa: PLC0415
    from lerobot.policies.factory import make_pre_post_processors  # noqa: PLC0415

    state, action = torch.tensor(data["state"]), torch.tensor(data["action"])
    picture = {"mean": torch.full((3, 1, 1), 0.6), "std": torch.full((3, 1, 1), 0.25)}
    stats = {f"observation.images.{name}": picture for name in ("top", "wrist")}
    for name, one in {"observation.state": state, "action": action}.items():
        own = one.flatten(0, -2)
        stats[name] = {"mean": own.mean(0), "std": own.std(0) + 1e-6, "min": own.amin(0), "max": own.amax(0)}
    return tuple(make_pre_post_processors(config, dataset_stats=stats))  # type: ignore[return-value]


def shown(pictures: dict[str, np.ndarray], state: np.ndarray) -> dict[str, Any]:
    """Return a batch as LeRobot's processors take it; pictures (n, h, w, 3), or (n, instants, h, w, 3)."""
    import torch  # noqa: PLC0415

    made = {
        f"observation.images.{name}": torch.tensor(picture).movedim(-1, -3).float() / 255
        for name, picture in pictures.items()
    }
    return {**made, "observation.state": torch.tensor(state), "task": [""] * len(state)}


def moment(images: dict[str, np.ndarray], state: np.ndarray, instruction: str | None) -> dict[str, Any]:
    """Return a batch of one moment; which block is named is told as two numbers of the state."""
    told = [float(colour in (instruction or "")) for colour in ("red", "blue")]
    return shown({name: image[None] for name, image in images.items()}, np.array([[*state, *told]], np.float32))


def learn(
    policy: Any,  # noqa: ANN401 - of LeRobot
    data: dict[str, np.ndarray],
    steps: int,
    given: Callable[[Any], Any],
    *,
    batch_size: int = BATCH,
) -> int:
    """Train a policy and return seconds of CPU; ``given`` makes of a batch, as `shown` makes it, what goes in."""
    import torch  # noqa: PLC0415

    optimiser, rng, begun = (
        torch.optim.AdamW(policy.parameters(), 1e-3, fused=True),
        np.random.default_rng(0),
        time.process_time(),
    )
    policy.train()
    for turn in range(steps):
        for group in optimiser.param_groups:
            group["lr"] = 1e-3 * (1 - 0.95 * turn / steps)
        rows = rng.integers(0, len(data["state"]), batch_size)
        action = torch.tensor(data["action"][rows])
        batch = shown({name: data[name][rows] for name in data.keys() & {"top", "wrist"}}, data["state"][rows])
        batch |= {"action": action, "action_is_pad": torch.zeros(action.shape[:2], dtype=torch.bool)}
        loss, _ = policy.forward(given(batch))
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        if turn % 200 == 0:
            sys.stdout.write(f"{turn} {loss.item():.4f} {time.process_time() - begun:.0f} s of CPU\n")
            sys.stdout.flush()
    return round(time.process_time() - begun)


def train(kind: str, steps: int) -> None:
    """Train a policy and keep its weights."""
    import torch  # noqa: PLC0415

    data = moments(kind)
    policy = policy_of(data["state"].shape[1])
    took = learn(policy, data, steps, processors(policy.config, data)[0])
    torch.save(policy.state_dict(), CACHE / f"{kind}.pt")
    (CACHE / f"{kind}.json").write_text(json.dumps({"steps": steps, "cpu_seconds": took}))


class Trained:
    """A trained policy as a callable; loaded when it is first asked."""

    def __init__(self, kind: str) -> None:
        self.kind, self.version, self._loaded = kind, "1", None

    def __call__(self, images: dict[str, np.ndarray], state: np.ndarray, instruction: str | None) -> np.ndarray:
        """Return a motion; the named block is told as two numbers of the state."""
        import torch  # noqa: PLC0415

        if self._loaded is None:
            data = moments(self.kind)
            policy = policy_of(data["state"].shape[1])
            policy.load_state_dict(torch.load(CACHE / f"{self.kind}.pt", weights_only=True))
            policy.eval()
            self._loaded = (policy, *processors(policy.config, data))
        policy, before, after = self._loaded
        with torch.no_grad():
            chunk = policy.predict_action_chunk(before(moment(images, state, instruction)))
        return np.asarray(after(chunk)[0], np.float32)

    def reset(self) -> None:
        """Empty its queue."""
        if self._loaded is not None:
            self._loaded[0].reset()


sees, privileged = Trained("sees"), Trained("privileged")


def bank_of(preset: str, folder: Path, episodes: int = 12, steps: int = 6) -> Path:
    """Return a bank of a preset, so many episodes of four scenarios, ``steps`` frames each; built once in a folder."""
    from eyechart.simulators import open_bank_simulator  # noqa: PLC0415

    bank = folder / f"bank-{preset}-{episodes}-{steps}"
    if not bank.is_dir():
        open_bank_simulator("tabletop").build(bank, preset=preset, seeds=range(episodes // 4), steps=steps)
    return bank


def asked(spec: str, bank: Path, run: Path, answers: int = 4) -> dict[str, Any]:
    """Run a callable of this folder on a bank and return its verdict."""
    from eyechart.studies import policy  # noqa: PLC0415
    from eyechart.studies.policy.plans import PolicySelection  # noqa: PLC0415
    from eyechart.studies.policy.scores import judge  # noqa: PLC0415

    sys.path.insert(0, str(HERE))
    policy.run(policy.plan(bank, [spec], run, extent=PolicySelection(answers=answers)))
    return judge(policy.score(run))[spec].as_dict()


def about() -> dict[str, str]:
    """Return what a result says of its making."""
    import lerobot  # noqa: PLC0415

    import eyechart  # noqa: PLC0415

    today = dt.datetime.now(dt.UTC).date().isoformat()
    return {"eyechart": eyechart.__version__, "lerobot": lerobot.__version__, "date": today}


def main() -> int:
    """Train what is not trained, ask, and write the result; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=3000)
    args = parser.parse_args()
    CACHE.mkdir(parents=True, exist_ok=True)
    found = {}
    for kind, preset in PRESETS.items():
        if not (CACHE / f"{kind}.json").is_file():
            train(kind, args.steps)
        found[kind] = asked(f"python:act_tabletop:{kind}", bank_of(preset, CACHE), CACHE / f"run-{kind}")
    amiss = [
        f"{kind}: {axis} {found[kind][axis]}"
        for kind, axes in EXPECTED.items()
        for axis, labels in axes.items()
        if found[kind][axis] not in labels
    ]
    policies = {
        kind: {**json.loads((CACHE / f"{kind}.json").read_text()), **{name: one[name] for name in TOLD}}
        for kind, one in found.items()
    }
    RESULT.write_text(json.dumps({**about(), "policies": policies, "amiss": amiss}, indent=1) + "\n")
    sys.stdout.write("\n".join([*amiss, f"wrote {RESULT}"]) + "\n")
    return int(bool(amiss))


if __name__ == "__main__":
    sys.exit(main())
