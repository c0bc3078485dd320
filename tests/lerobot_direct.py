"""Asks a checkpoint by LeRobot alone, as the page on LeRobot says a callable does: run by a Python that has it.

    python lerobot_direct.py CHECKPOINT SEEN.npz SEED

SEEN.npz holds ``top`` (2, h, w, 3) and ``state`` (2, n), the older instant first. Prints a chunk as a JSON list.
"""

import json
import sys

import numpy as np
import torch
from lerobot.configs import PreTrainedConfig
from lerobot.policies.factory import get_policy_class, make_pre_post_processors
from lerobot.policies.utils import populate_queues


def main() -> None:
    """Print the chunk."""
    folder, seen, seed = sys.argv[1], np.load(sys.argv[2]), int(sys.argv[3])
    config = PreTrainedConfig.from_pretrained(folder)
    policy = get_policy_class(config.type).from_pretrained(folder).eval()
    before, after = make_pre_post_processors(config, pretrained_path=folder)
    policy.reset()
    for top, state in zip(seen["top"], seen["state"], strict=True):
        batch = before(
            {
                "observation.images.top": torch.tensor(top).permute(2, 0, 1)[None] / 255,
                "observation.state": torch.tensor(state, dtype=torch.float32)[None],
                "task": ["reach the block"],
            }
        )
        if config.n_obs_steps > 1:
            batch = {
                "observation.state": batch["observation.state"],
                "observation.images": torch.stack([batch["observation.images.top"]], dim=-4),
            }
            policy._queues = populate_queues(policy._queues, batch)
    torch.manual_seed(seed)
    with torch.no_grad():
        chunk = after(policy.predict_action_chunk(batch))[0]
    sys.stdout.write("\n" + json.dumps(chunk.tolist()))


if __name__ == "__main__":
    main()
