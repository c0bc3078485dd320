"""Writes a small LeRobotDataset and checkpoints with random weights, by LeRobot alone: run by a Python that has it.

    python lerobot_checkpoints.py FOLDER

Writes FOLDER/data (6 episodes of 24 steps, one camera of 64 × 64, five numbers of state, three of action), and
FOLDER/act, FOLDER/vqbet and FOLDER/diffusion, each with its processors. The last two read two instants.
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import torch
from lerobot.configs.types import FeatureType, PolicyFeature
from lerobot.datasets.lerobot_dataset import LeRobotDataset
from lerobot.policies.factory import get_policy_class, make_policy_config, make_pre_post_processors

SIZE, STATE, ACTION, CHUNK = 64, 5, 3, 8
EPISODES, STEPS = 6, 24
CAMERA = "observation.images.top"
BACKBONE = {"vision_backbone": "resnet18", "pretrained_backbone_weights": None}
KINDS: dict[str, dict[str, Any]] = {
    "act": {
        **BACKBONE,
        "chunk_size": CHUNK,
        "n_action_steps": CHUNK,
        "dim_model": 32,
        "n_heads": 2,
        "dim_feedforward": 32,
        "n_encoder_layers": 1,
        "n_decoder_layers": 1,
        "use_vae": False,
    },
    "vqbet": {
        **BACKBONE,
        "n_obs_steps": 2,
        "n_action_pred_token": 1,
        "action_chunk_size": CHUNK,
        "crop_shape": (56, 56),
        "vqvae_n_embed": 4,
        "vqvae_embedding_dim": 16,
        "vqvae_enc_hidden_dim": 16,
        "gpt_n_layer": 1,
        "gpt_n_head": 2,
        "gpt_hidden_dim": 32,
        "gpt_output_dim": 32,
        "spatial_softmax_num_keypoints": 4,
    },
    "diffusion": {
        **BACKBONE,
        "n_obs_steps": 2,
        "horizon": 2 * CHUNK,
        "n_action_steps": CHUNK,
        "down_dims": (16, 32),
        "kernel_size": 3,
        "diffusion_step_embed_dim": 8,
        "num_train_timesteps": 10,
        "num_inference_steps": 2,
        "spatial_softmax_num_keypoints": 4,
    },
}


def write_data(folder: Path) -> Any:  # noqa: ANN401 - of LeRobot
    """Write the data set, a picture a row, and return its statistics."""
    features = {
        CAMERA: {"dtype": "image", "shape": (SIZE, SIZE, 3), "names": ["height", "width", "channels"]},
        "observation.state": {"dtype": "float32", "shape": (STATE,), "names": [f"joint_{n}" for n in range(STATE)]},
        "action": {"dtype": "float32", "shape": (ACTION,), "names": [f"joint_{n}" for n in range(ACTION)]},
    }
    data = LeRobotDataset.create("here/data", fps=10, features=features, root=folder, use_videos=False)
    rng = np.random.default_rng(0)
    for _ in range(EPISODES):
        state, aim = rng.uniform(-1, 1, STATE), rng.uniform(-1, 1, STATE)
        for _ in range(STEPS):
            picture = rng.integers(0, 60, (SIZE, SIZE, 3)).astype(np.uint8)
            x, y = ((aim[:2] + 1) / 2 * (SIZE - 12)).astype(int)
            picture[y : y + 12, x : x + 12] = (220, 40, 40)
            move = 0.1 * (aim - state)
            row = {CAMERA: picture, "observation.state": state.astype(np.float32), "task": "reach the block"}
            data.add_frame({**row, "action": move[:ACTION].astype(np.float32)})
            state = state + move
        data.save_episode()
    data.finalize()
    return data.meta.stats


def write_checkpoint(kind: str, folder: Path, stats: Any) -> None:  # noqa: ANN401 - of LeRobot
    """Write a policy with random weights, and its processors with the data's statistics."""
    torch.manual_seed(0)
    config = make_policy_config(
        kind,
        input_features={
            CAMERA: PolicyFeature(FeatureType.VISUAL, (3, SIZE, SIZE)),
            "observation.state": PolicyFeature(FeatureType.STATE, (STATE,)),
        },
        output_features={"action": PolicyFeature(FeatureType.ACTION, (ACTION,))},
        device="cpu",
        **KINDS[kind],
    )
    get_policy_class(kind)(config).save_pretrained(folder)
    for processor in make_pre_post_processors(config, dataset_stats=stats):
        processor.save_pretrained(folder)


def main() -> None:
    """Write all below the folder of the first argument."""
    root = Path(sys.argv[1])
    stats = write_data(root / "data")
    for kind in KINDS:
        write_checkpoint(kind, root / kind, stats)


if __name__ == "__main__":
    main()
