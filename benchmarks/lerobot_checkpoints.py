"""Checkpoints of LeRobot's ACT, named as they are: with a state that tells where the block is, and without.

    LEROBOT_PYTHON=/path/to/python make long-checkpoints

``LEROBOT_PYTHON`` is a Python (3.12 or newer) that has ``lerobot[dataset]`` and eyechart. Two policies are trained on
episodes of the tabletop, whose tool reaches for the red block: one has the block's place in its state. LeRobot saves
them and their processors, and its own writer writes the episodes that the bank is imported from. Each is asked twice:
as ``lerobot:CHECKPOINT``, in a process of its own, and as a callable that loads the same folder here. A policy that is
trained, a bank, and a run that is finished are not made again. Writes ``benchmarks/results/checkpoints.json``; exit 1
where the verdicts of the two ways differ, or are not as they should be.
"""

import argparse
import json
import os
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

import act_tabletop
from act_tabletop import HERE, HORIZON, MOVES, asked

RESULT = HERE / "results" / "checkpoints.json"
CACHE = Path(os.environ.get("EYECHART_CHECKPOINTS", "build/checkpoints"))
TRAINED, SHOWN, EVERY, BATCH = 400, 16, 3, 16
"""Episodes to train on, those of the bank's data set, every which of their frames is taken, moments of a step."""
STATES = {"sees": 3, "privileged": 5}
KEPT = ("camera", "cameras", "state", "guards", "channels")
EXPECTED = {
    "sees": {"camera": ("camera_content",)},
    "privileged": {"camera": ("ignores_camera",), "state": ("state_shortcut",)},
}
CAMERA = "observation.images.top"
WAYS = ("lerobot", "callable")


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

    told = kind == "privileged"
    state = [[*table.tool, table.grip, *(table.target if told else ())] for table in episode]
    chunks = np.stack([oracle(table) for table in episode]).astype(np.float32)
    return {**cameras(episode), "state": np.array(state, np.float32), "action": chunks}


def write_data(kind: str, folder: Path) -> None:
    """Write the bank's episodes as a data set, by LeRobot's own writer."""
    from lerobot.datasets.lerobot_dataset import LeRobotDataset  # noqa: PLC0415

    names = ["x", "y", "grip", "target_x", "target_y"][: STATES[kind]]
    features = {CAMERA: {"dtype": "image", "shape": (32, 32, 3), "names": ["height", "width", "channels"]}}
    features["observation.state"] = {"dtype": "float32", "shape": (len(names),), "names": names}
    features["action"] = {"dtype": "float32", "shape": (3,), "names": ["dx", "dy", "grip"]}
    data = LeRobotDataset.create(f"here/{kind}", fps=10, features=features, root=folder, use_videos=False)
    for episode in tables(kind, "shown", SHOWN):
        seen = moments(kind, episode)
        for row in range(len(episode)):
            shown = {CAMERA: seen["top"][row]}
            own = {"observation.state": seen["state"][row], "action": seen["action"][row, 0]}
            data.add_frame({**shown, **own, "task": "reach the red block"})
        data.save_episode()
    data.finalize()


def config_of(kind: str) -> Any:  # noqa: ANN401 - of LeRobot
    """Return the configuration of a small ACT with a ResNet of its own weights."""
    from lerobot.policies.act.configuration_act import ACTConfig  # noqa: PLC0415

    features = act_tabletop.features(STATES[kind])
    del features["input_features"]["observation.images.wrist"]
    return ACTConfig(
        **features,
        **act_tabletop.SMALL,
    )


def train(kind: str, steps: int, folder: Path) -> None:
    """Train a policy, and save it with its processors as LeRobot does."""
    from lerobot.policies.act.modeling_act import ACTPolicy  # noqa: PLC0415

    many = [moments(kind, episode) for episode in tables(kind, "trained", TRAINED)]
    data = {name: np.concatenate([one[name] for one in many]) for name in many[0]}
    policy = ACTPolicy(config_of(kind))
    for name, buffer in policy.model.backbone.named_buffers():
        if name.endswith("bn2.weight"):  # a frozen normalisation leaves each block twice as loud as the one before
            buffer.fill_(0.3)
    before, after = act_tabletop.processors(policy.config, data)
    took = act_tabletop.learn(policy, data, steps, before, batch_size=BATCH)
    for part in (policy, before, after):
        part.save_pretrained(folder)
    (folder / "trained.json").write_text(json.dumps({"steps": steps, "cpu_seconds": took}))


class Callable:
    """The same checkpoint as the page on LeRobot loads it; loaded when it is first asked."""

    def __init__(self, kind: str) -> None:
        self.kind, self.version, self.channels, self._loaded = kind, "1", ["camera:top", "state"], None

    def __call__(self, images: dict[str, np.ndarray], state: np.ndarray, instruction: str | None) -> np.ndarray:
        """Return a chunk."""
        import torch  # noqa: PLC0415
        from lerobot.policies.act.modeling_act import ACTPolicy  # noqa: PLC0415
        from lerobot.policies.factory import make_pre_post_processors  # noqa: PLC0415

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


def bank_of(kind: str) -> Path:
    """Return the bank of a kind's data set, imported once."""
    from eyechart.formats import FORMATS  # noqa: PLC0415
    from eyechart.importing.bank import Choices  # noqa: PLC0415
    from eyechart.importing.lerobot import Horizon  # noqa: PLC0415

    data, bank = CACHE / f"data-{kind}", CACHE / f"bank-{kind}"
    if not data.is_dir():
        write_data(kind, data)
    if not bank.is_dir():
        FORMATS["lerobot"].importer()(data, out=bank, choices=Choices(every=EVERY), ahead=Horizon(HORIZON, "delta"))
    return bank


def main() -> int:
    """Train what is not trained, ask in both ways, and write the result; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=1500)
    args = parser.parse_args()
    CACHE.mkdir(parents=True, exist_ok=True)
    os.environ.setdefault("EYECHART_LEROBOT_PYTHON", sys.executable)
    found, amiss = {}, []
    for kind, expected in EXPECTED.items():
        folder, bank = CACHE / kind, bank_of(kind)
        if not (folder / "trained.json").is_file():
            train(kind, args.steps, folder)
        own = found[kind] = {"trained": json.loads((folder / "trained.json").read_text())}
        for way, spec in zip(WAYS, (f"lerobot:{folder}", f"python:lerobot_checkpoints:{kind}"), strict=True):
            begun = time.monotonic()
            verdict = asked(spec, bank, CACHE / f"run-{way}-{kind}")
            own[way] = {**{name: verdict[name] for name in KEPT}, "seconds": round(time.monotonic() - begun)}
        said = [{name: own[way][name] for name in KEPT} for way in WAYS]
        amiss += [f"{kind}: the two ways differ"] if said[0] != said[1] else []
        amiss += [
            f"{kind}: {axis} {own['lerobot'][axis]}"
            for axis, labels in expected.items()
            if own["lerobot"][axis] not in labels
        ]
    RESULT.write_text(json.dumps({**act_tabletop.about(), "policies": found, "amiss": amiss}, indent=1) + "\n")
    sys.stdout.write("\n".join([*amiss, f"wrote {RESULT}"]) + "\n")
    return int(bool(amiss))


if __name__ == "__main__":
    sys.exit(main())
