"""LeRobot's own data sets and checkpoints, from import to gate, through ``lerobot:CHECKPOINT`` and as a callable.

    LEROBOT_PYTHON=/path/to/python make long-checkpoints

``LEROBOT_PYTHON`` is a Python (3.12 or newer) that has ``lerobot[dataset,diffusion]`` and eyechart. First the data sets
of `lerobot_sets` are compared with what was written. Then four policies are trained on episodes of the tabletop, whose
tool reaches for the red block: two of ACT, one of which has the block's place in its state, and one each of VQ-BeT and
Diffusion, which read two instants. LeRobot saves them and their processors, and its own writer writes the episodes that
each bank is imported from. All are asked by the command line as ``lerobot:CHECKPOINT``, in a process of its own, and
ACT also as a callable that loads the same folder here. Training and banks are as small as two processors that others
use too allow: ACT learns what its labels need, and of the others, trained for a minute, no label is expected. A row
that is finished is kept, and not made again. Writes ``benchmarks/results/checkpoints.json``; exit 1 where something
read is not as it was written, the verdicts of the two ways differ, or are not as they should be.
"""

import argparse
import json
import os
import shutil
import sys
from collections.abc import Callable as Made
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import act_tabletop
import lerobot_sets
from act_tabletop import HERE, HORIZON, MOVES
from lerobot_policy import EYECHART, made

RESULT = HERE / "results" / "checkpoints.json"
CACHE = Path(os.environ.get("EYECHART_CHECKPOINTS", "build/checkpoints")).absolute()
TRAINED, SHOWN, EVERY = 400, 12, 4
"""Episodes to train on, those of the bank's data set, and every which of their frames is taken."""
KEPT = ("camera", "cameras", "state", "guards", "channels")
SEEING = ("camera_content", "object_grounded")


@dataclass(frozen=True)
class Kind:
    """A policy: its type, whether its state tells the block's place, its training, and the labels that it should get.

    Its bank is of ``episodes``. ``history`` are the instants before a moment that it reads, and pictures are shown
    ``larger`` by so many times: the other types lose all but 2 × 2 places of 64 pixels. ``chunk`` are the actions that
    it is trained on.
    """

    type: str
    steps: int
    batch: int = 16
    tells: bool = False
    episodes: int = SHOWN
    history: int = 0
    larger: int = 1
    chunk: int = HORIZON
    expected: tuple[tuple[str, tuple[str, ...]], ...] = ()

    @property
    def states(self) -> int:
        """Return the numbers of its state."""
        return 5 if self.tells else 3


KINDS = {
    "sees": Kind("act", 1000, expected=(("camera", SEEING),)),
    "privileged": Kind(
        "act", 1000, tells=True, episodes=24, expected=(("camera", ("ignores_camera",)), ("state", ("state_shortcut",)))
    ),
    "vqbet": Kind("vqbet", 250, 4, history=1, larger=2, chunk=1 + HORIZON),
    "diffusion": Kind("diffusion", 150, 4, history=1, larger=2, chunk=12),
}
CAMERA = "observation.images.top"
SMALL: dict[str, dict[str, Any]] = {
    "act": act_tabletop.SMALL,
    "vqbet": {
        "n_obs_steps": 2,
        "n_action_pred_token": 1,
        "action_chunk_size": HORIZON,
        "crop_shape": None,
        "use_group_norm": True,
        "n_vqvae_training_steps": 100,
        "vqvae_n_embed": 8,
        "vqvae_embedding_dim": 32,
        "vqvae_enc_hidden_dim": 32,
        "gpt_n_layer": 2,
        "gpt_n_head": 2,
        "gpt_input_dim": 64,
        "gpt_hidden_dim": 64,
        "gpt_output_dim": 64,
        "spatial_softmax_num_keypoints": 16,
    },
    "diffusion": {
        "n_obs_steps": 2,
        "horizon": 12,
        "n_action_steps": HORIZON,
        "use_group_norm": True,
        "spatial_softmax_num_keypoints": 16,
        "down_dims": (48, 96),
        "kernel_size": 3,
        "diffusion_step_embed_dim": 32,
        "prediction_type": "sample",
        "noise_scheduler_type": "DDIM",
        "num_train_timesteps": 50,
        "num_inference_steps": 10,
    },
}
"""The sizes of policies that learn on a processor in minutes."""


def tables(kind: str, which: str, episodes: int) -> list[list[Any]]:
    """Return episodes of the tabletop; those of the bank and of the training are drawn apart."""
    from eyechart.seeds import key_seed  # noqa: PLC0415 - of the other environment
    from eyechart.simulators.tabletop.world import episode, scene  # noqa: PLC0415

    rng = np.random.default_rng(key_seed("checkpoints", kind, which))
    return [episode(rng, scene(rng), "red", MOVES, left=turn % 2 == 0) for turn in range(episodes)]


def moments(kind: str, episode: list[Any]) -> dict[str, np.ndarray]:
    """Return pictures, states and chunks of an episode's moments."""
    from eyechart.simulators.tabletop.pictures import cameras  # noqa: PLC0415
    from eyechart.simulators.tabletop.world import oracle  # noqa: PLC0415

    own = KINDS[kind]
    state = [[*table.tool, table.grip, *(table.target if own.tells else ())] for table in episode]
    chunks = np.stack([oracle(table) for table in episode]).astype(np.float32)
    top = cameras(episode)["top"].repeat(own.larger, axis=1).repeat(own.larger, axis=2)
    return {"top": top, "state": np.array(state, np.float32), "action": chunks}


def learned(kind: str, episode: list[Any]) -> dict[str, np.ndarray]:
    """Return what a policy is trained on, of an episode's moments: windows and what was done from their begin on."""
    found, own = moments(kind, episode), KINDS[kind]
    if not own.history:
        return found
    rows = np.arange(1, len(found["state"]))
    pairs = np.stack([rows - 1, rows], axis=1)
    ahead = np.minimum(rows[:, None] - 1 + np.arange(own.chunk), len(found["state"]) - 1)
    return {"top": found["top"][pairs], "state": found["state"][pairs], "action": found["action"][ahead, 0]}


def write_data(kind: str, folder: Path) -> None:
    """Write the bank's episodes as a data set, by LeRobot's own writer."""
    from lerobot.datasets.lerobot_dataset import LeRobotDataset  # noqa: PLC0415

    shutil.rmtree(folder, ignore_errors=True)
    size, names = 32 * KINDS[kind].larger, ["x", "y", "grip", "target_x", "target_y"][: KINDS[kind].states]
    features = {CAMERA: {"dtype": "image", "shape": (size, size, 3), "names": ["height", "width", "channels"]}}
    features["observation.state"] = {"dtype": "float32", "shape": (len(names),), "names": names}
    features["action"] = {"dtype": "float32", "shape": (3,), "names": ["dx", "dy", "grip"]}
    data = LeRobotDataset.create(f"here/{kind}", fps=10, features=features, root=folder, use_videos=False)
    for episode in tables(kind, "shown", KINDS[kind].episodes):
        seen = moments(kind, episode)
        for row in range(len(episode)):
            shown = {CAMERA: seen["top"][row]}
            own = {"observation.state": seen["state"][row], "action": seen["action"][row, 0]}
            data.add_frame({**shown, **own, "task": "reach the red block"})
        data.save_episode()
    data.finalize()


def config_of(kind: str) -> Any:  # noqa: ANN401 - of LeRobot
    """Return the configuration of a small policy with a ResNet of its own weights."""
    from lerobot.configs.types import FeatureType, PolicyFeature  # noqa: PLC0415
    from lerobot.policies.factory import make_policy_config  # noqa: PLC0415

    own, features = KINDS[kind], act_tabletop.features(KINDS[kind].states)
    size = 32 * own.larger
    features["input_features"] = {
        CAMERA: PolicyFeature(FeatureType.VISUAL, (3, size, size)),
        "observation.state": features["input_features"]["observation.state"],
    }
    return make_policy_config(own.type, **features, **{"pretrained_backbone_weights": None, **SMALL[own.type]})


def train(kind: str) -> dict[str, Any]:
    """Train a policy, save it with its processors as LeRobot does, and return what it took."""
    from lerobot.policies.factory import get_policy_class  # noqa: PLC0415

    own, folder = KINDS[kind], CACHE / kind
    shutil.rmtree(folder, ignore_errors=True)
    many = [learned(kind, episode) for episode in tables(kind, "trained", TRAINED)]
    data = {name: np.concatenate([one[name] for one in many]) for name in many[0]}
    config = config_of(kind)
    policy = get_policy_class(own.type)(config)
    if own.type == "act":
        for name, buffer in policy.model.backbone.named_buffers():
            if name.endswith("bn2.weight"):  # a frozen normalisation leaves each block twice as loud as the one before
                buffer.fill_(0.3)
    before, after = act_tabletop.processors(policy.config, data)
    took = act_tabletop.learn(policy, data, own.steps, before, batch_size=own.batch)
    for part in (policy, before, after):
        part.save_pretrained(folder)
    return {"type": own.type, "steps": own.steps, "batch": own.batch, "cpu_seconds": took}


class Callable:
    """The checkpoint of an ACT as the page on LeRobot loads it; loaded when it is first asked."""

    def __init__(self, kind: str) -> None:
        self.kind, self.version, self.channels, self._loaded = kind, "1", ["camera:top", "state"], None
        self.seedable = True

    def __call__(
        self, images: dict[str, np.ndarray], state: np.ndarray, instruction: str | None, *, seed: int
    ) -> np.ndarray:
        """Return a chunk; it draws nothing, whatever the seed."""
        import torch  # noqa: PLC0415
        from lerobot.policies.act.modeling_act import ACTPolicy  # noqa: PLC0415
        from lerobot.policies.factory import make_pre_post_processors  # noqa: PLC0415

        del seed
        if self._loaded is None:
            policy = ACTPolicy.from_pretrained(CACHE / self.kind).eval()
            self._loaded = (policy, *make_pre_post_processors(policy.config, pretrained_path=str(CACHE / self.kind)))
        policy, before, after = self._loaded
        batch = {
            f"observation.images.{name}": torch.tensor(one).permute(2, 0, 1)[None] / 255 for name, one in images.items()
        }
        batch |= {"observation.state": torch.tensor(state, dtype=torch.float32)[None], "task": [instruction or ""]}
        with torch.no_grad():
            return np.asarray(after(policy.predict_action_chunk(before(batch)))[0], np.float32)


sees, privileged = Callable("sees"), Callable("privileged")


def kept(name: str, make: Made[[], dict[str, Any]]) -> dict[str, Any]:
    """Return a row from disk, or make it and keep it there."""
    file = CACHE / "rows" / f"{name.replace(' ', '-')}.json"
    if not file.is_file():
        row = make()
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps(row))
        sys.stdout.write(f"{name}: done\n")
        sys.stdout.flush()
    return dict(json.loads(file.read_text()))


def asked(kind: str, way: str) -> dict[str, Any]:
    """Ask a policy by the command line, up to a gate; return its verdict, and what each command took."""
    bank, run, name = CACHE / f"bank-{kind}", CACHE / f"run-{way}-{kind}", f"{way}-{kind}"
    spec = f"lerobot:{CACHE / kind}" if way == "lerobot" else f"python:lerobot_checkpoints:{kind}"
    steps = {
        "run": ["run", "policy", "--policy", spec, "--frames", str(bank), "--out", str(run)],
        "verdict": ["verdict", str(run), "--json"],
    }
    took = {step: made(CACHE, f"{name}-{step}", [*EYECHART, *words]) for step, words in steps.items()}
    verdict = json.loads((CACHE / f"{name}-verdict.out").read_text())["policies"][spec]
    code = 2 if verdict["guards"] or verdict["camera"] == "undecided" else int(verdict["camera"] not in SEEING)
    gate = ["gate", str(run), "--require", "camera:camera_content"]
    took["gate"] = made(CACHE, f"{name}-gate", [*EYECHART, *gate], code)
    return {**{part: verdict[part] for part in KEPT}, "gate": code, "took": took}


def imported(kind: str) -> dict[str, Any]:
    """Have LeRobot write the bank's data set, import it by the command line, and plan; return what each took."""
    data, bank, history = CACHE / f"data-{kind}", CACHE / f"bank-{kind}", KINDS[kind].history
    write_data(kind, data)
    words = ["--format", "lerobot", "--horizon", str(HORIZON), "--every", str(EVERY), "--kind", "delta"]
    words += ["--history", str(history)] if history else []
    steps = {"import": ["frames", "import", str(data), *words, "--out", str(bank)], "plan": ["plan", str(bank)]}
    return {step: made(CACHE, f"{kind}-{step}", [*EYECHART, *words]) for step, words in steps.items()}


def policy_of(kind: str) -> tuple[dict[str, Any], list[str]]:
    """Return all that is found of a policy, and what of it is not as it should be."""
    ways = ("lerobot", "callable") if KINDS[kind].type == "act" else ("lerobot",)
    found = {"trained": kept(f"trained {kind}", lambda: train(kind))}
    found["bank"] = kept(f"bank {kind}", lambda: imported(kind))
    found |= {way: kept(f"{way} {kind}", lambda way=way: asked(kind, way)) for way in ways}
    said = [{part: found[way][part] for part in (*KEPT, "gate")} for way in ways]
    amiss = [f"{kind}: the two ways differ"] if said[0] != said[-1] else []
    for axis, labels in KINDS[kind].expected:
        amiss += [f"{kind}: {axis} {said[0][axis]}"] if said[0][axis] not in labels else []
    return found, amiss


def sets_of() -> tuple[dict[str, Any], list[str]]:
    """Return what is found of each data set, and what of it is not as it was written."""
    found = {
        name: kept(f"set {place}", lambda name=name, place=place: lerobot_sets.compare(name, CACHE / f"set-{place}"))
        for place, name in enumerate(lerobot_sets.SETS)
    }
    return found, [line for one in found.values() for line in one.pop("amiss")]


def write(sets: dict[str, Any], policies: dict[str, Any], amiss: list[str]) -> None:
    """Write what there is so far; ``left`` names the policies that are not finished."""
    found = {**act_tabletop.about(), "left": [kind for kind in KINDS if kind not in policies]}
    RESULT.write_text(json.dumps({**found, "sets": sets, "policies": policies, "amiss": amiss}, indent=1) + "\n")


def main() -> int:
    """Make the rows that are missing, and write the result after each policy; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.parse_args()
    CACHE.mkdir(parents=True, exist_ok=True)
    os.environ.setdefault("EYECHART_LEROBOT_PYTHON", sys.executable)
    policies: dict[str, Any] = {}
    sets, amiss = sets_of()
    write(sets, policies, amiss)
    for kind in KINDS:
        policies[kind], wrong = policy_of(kind)
        amiss += wrong
        write(sets, policies, amiss)
    sys.stdout.write("\n".join([*amiss, f"wrote {RESULT}"]) + "\n")
    return int(bool(amiss))


if __name__ == "__main__":
    sys.exit(main())
