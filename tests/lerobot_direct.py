"""Asks a checkpoint by LeRobot alone, as the page on LeRobot says a callable does: run by a Python that has it.

    python lerobot_direct.py CHECKPOINT SEEN.npz SEED

SEEN.npz holds ``top`` (h, w, 3) and ``state``. Prints a JSON list: a chunk of ACT, else what `select_action` says for
each step of one.
"""

import json
import sys

import numpy as np
import torch
from lerobot.configs import PreTrainedConfig
from lerobot.policies.factory import get_policy_class, make_pre_post_processors


def main() -> None:
    """Print the chunk."""
    folder, seen, seed = sys.argv[1], np.load(sys.argv[2]), int(sys.argv[3])
    config = PreTrainedConfig.from_pretrained(folder)
    policy = get_policy_class(config.type).from_pretrained(folder).eval()
    before, after = make_pre_post_processors(config, pretrained_path=folder)
    batch = {
        "observation.images.top": torch.tensor(seen["top"]).permute(2, 0, 1)[None] / 255,
        "observation.state": torch.tensor(seen["state"], dtype=torch.float32)[None],
        "task": ["reach the block"],
    }
    policy.reset()
    torch.manual_seed(seed)
    with torch.no_grad():
        if config.type == "act":
            chunk = after(policy.predict_action_chunk(before(batch)))[0]
        else:
            steps = config.n_action_steps if config.type == "diffusion" else config.action_chunk_size
            chunk = torch.cat([after(policy.select_action(before(dict(batch)))) for _ in range(steps)])
    sys.stdout.write("\n" + json.dumps(chunk.tolist()))


if __name__ == "__main__":
    main()
