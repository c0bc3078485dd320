"""LeRobot's own DiffusionPolicy on the tabletop, asked with one seed for all calls and without: how verdicts compare.

    LEROBOT_PYTHON=/path/to/python make long-diffusion

``LEROBOT_PYTHON`` is a Python (3.12 or newer) that has ``lerobot[diffusion]`` and eyechart. Two small policies are
trained as those of `act_tabletop` are, with and without a state that tells where the block is. Each is asked twice:
with noise from the seed that all calls share (``seedable``), and with noise of its own, four answers to each call. A
policy that is trained, and a run that is finished, are not made again. Writes ``benchmarks/results/diffusion.json``;
exit 1 where the verdicts differ, or are not as they should be.
"""

import argparse
import json
import os
import sys
from pathlib import Path
from typing import Any

import numpy as np

import act_tabletop
from act_tabletop import HERE, HORIZON, PRESETS, TOLD, asked, backbone, bank_of, features, moment, moments

RESULT = HERE / "results" / "diffusion.json"
CACHE = Path(os.environ.get("EYECHART_DIFFUSION", "build/diffusion"))
STEPS, KEYPOINTS = 12_000, 16
EPISODES, FRAMES = 36, 4
"""Of a bank: of 12 episodes some labels stood at their bounds, which no equal labels can be asked of."""
NO_CONTENT = ("ignores_camera", "pose_only", "uses_camera", "undecided")
EXPECTED = {"sees": act_tabletop.EXPECTED["sees"], "privileged": {"camera": NO_CONTENT}}
"""Trained so briefly, the policy whose state tells all still reads something of its own pose from the wrist: how much
of it, from below .10 to above, goes with the training, and no content may be said of it."""
AXES = ("camera", "cameras", "state", "instruction", "guards")
"""What both ways of asking are to say alike."""


def policy_of(states: int) -> Any:  # noqa: ANN401 - of LeRobot
    """Return LeRobot's DiffusionPolicy with a small backbone and a small U-Net, and ten steps of inference."""
    from lerobot.policies.diffusion.configuration_diffusion import DiffusionConfig  # noqa: PLC0415
    from lerobot.policies.diffusion.modeling_diffusion import DiffusionPolicy, SpatialSoftmax  # noqa: PLC0415

    config = DiffusionConfig(
        **features(states),
        n_obs_steps=1,
        horizon=HORIZON,
        n_action_steps=HORIZON,
        pretrained_backbone_weights=None,
        use_group_norm=True,
        spatial_softmax_num_keypoints=KEYPOINTS,
        down_dims=(48, 96),
        kernel_size=3,
        diffusion_step_embed_dim=32,
        prediction_type="sample",
        noise_scheduler_type="DDIM",
        num_train_timesteps=50,
        num_inference_steps=10,
    )
    made = DiffusionPolicy(config)
    for encoder in made.diffusion.rgb_encoder:
        encoder.backbone, encoder.pool = backbone(), SpatialSoftmax((32, 8, 8), KEYPOINTS)
    return made


def timed(batch: dict[str, Any]) -> dict[str, Any]:
    """Return a batch whose state has an axis for the one moment that the policy sees."""
    return {**batch, "observation.state": batch["observation.state"][:, None]}


def train(kind: str, steps: int) -> None:
    """Train a policy and keep its weights."""
    import torch  # noqa: PLC0415

    data = moments(kind)
    policy = policy_of(data["state"].shape[1])
    before, _ = act_tabletop.processors(policy.config, data)
    took = act_tabletop.learn(policy, data, steps, lambda batch: timed(before(batch)))
    torch.save(policy.state_dict(), CACHE / f"{kind}.pt")
    (CACHE / f"{kind}.json").write_text(json.dumps({"steps": steps, "cpu_seconds": took}))


class Trained:
    """A trained policy as a callable, loaded when it is first asked; ``seedable`` ones draw their noise from a seed."""

    def __init__(self, kind: str, *, seedable: bool) -> None:
        self.kind, self.seedable, self.version, self._loaded = kind, seedable, "1", None

    def __call__(
        self, images: dict[str, np.ndarray], state: np.ndarray, instruction: str | None, seed: int | None = None
    ) -> np.ndarray:
        """Return a motion of ten steps of denoising."""
        import torch  # noqa: PLC0415

        if self._loaded is None:
            data = moments(self.kind)
            policy = policy_of(data["state"].shape[1])
            policy.load_state_dict(torch.load(CACHE / f"{self.kind}.pt", weights_only=True))
            policy.eval()
            self._loaded = (policy, *act_tabletop.processors(policy.config, data))
        policy, before, after = self._loaded
        noise = np.random.default_rng(seed).standard_normal((1, HORIZON, 3)).astype(np.float32)
        with torch.no_grad():
            chunk = policy.predict_action_chunk(
                timed(before(moment(images, state, instruction))), noise=torch.tensor(noise)
            )
        return np.asarray(after(chunk)[0], np.float32)

    def reset(self) -> None:
        """Empty its queues."""
        if self._loaded is not None:
            self._loaded[0].reset()


sees_seeded, sees_drawn = (Trained("sees", seedable=own) for own in (True, False))
privileged_seeded, privileged_drawn = (Trained("privileged", seedable=own) for own in (True, False))


def main() -> int:
    """Train what is not trained, ask both ways, and write the result; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=STEPS)
    args = parser.parse_args()
    CACHE.mkdir(parents=True, exist_ok=True)
    amiss, policies = [], {}
    for kind, preset in PRESETS.items():
        if not (CACHE / f"{kind}.json").is_file():
            train(kind, args.steps)
        found = {
            way: asked(
                f"python:diffusion_tabletop:{kind}_{way}",
                bank_of(preset, CACHE, EPISODES, FRAMES),
                CACHE / f"run-{kind}-{way}",
            )
            for way in ("seeded", "drawn")
        }
        one, other = found["seeded"], found["drawn"]
        amiss += [
            f"{kind}: {axis} {one[axis]} seeded, {other[axis]} drawn" for axis in AXES if one[axis] != other[axis]
        ]
        amiss += [
            f"{kind} {way}: {axis} {each[axis]}"
            for axis, labels in EXPECTED[kind].items()
            for way, each in found.items()
            if each[axis] not in labels
        ]
        told = {way: {name: each[name] for name in TOLD} for way, each in found.items()}
        policies[kind] = {**json.loads((CACHE / f"{kind}.json").read_text()), **told}
    RESULT.write_text(json.dumps({**act_tabletop.about(), "policies": policies, "amiss": amiss}, indent=1) + "\n")
    sys.stdout.write("\n".join([*amiss, f"wrote {RESULT}"]) + "\n")
    return int(bool(amiss))


if __name__ == "__main__":
    sys.exit(main())
