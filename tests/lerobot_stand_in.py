"""A stand-in for LeRobot and torch with the entry points that a policy's process calls, and checkpoints for it.

What its policy does stands in the checkpoint's weights: `DOES` names it. It answers ``CHUNK`` steps of three numbers:
how bright its first picture is, what the first number of the normalised state is, and a number drawn by torch. With
a window the first two are what changed in it, and the third is how many instants it has.
"""

import json
import os
import textwrap
from pathlib import Path
from typing import Any

CHUNK = 8
DOES = ("answers", "dies", "hangs", "raises", "prints", "begins another", "dies once")
TORCH = """
import numpy as np

class Tensor(np.ndarray):
    def float(self):
        return self.astype(np.float32)
    def cpu(self):
        return self
    def numpy(self):
        return np.asarray(self)

class no_grad:
    def __enter__(self):
        return self
    def __exit__(self, *_):
        return None

RNG = []

def manual_seed(seed):
    RNG[:] = [np.random.default_rng(seed)]

def from_numpy(array):
    return array.view(Tensor)

def stack(many, dim):
    return np.stack(many, axis=dim).view(Tensor)
"""
CONFIGS = """
import json, types

class Feature(types.SimpleNamespace):
    pass

class PreTrainedConfig:
    @classmethod
    def from_pretrained(cls, folder, local_files_only):
        assert local_files_only
        print("a library prints on its output")
        made = cls()
        vars(made).update(json.load(open(f"{folder}/config.json")))
        return made
"""
FACTORY = """
import json, os, subprocess, sys, time
import numpy as np
import torch

class Policy:
    @classmethod
    def from_pretrained(cls, folder, config, local_files_only, strict):
        assert local_files_only and strict
        assert config.pretrained_backbone_weights is None
        made = cls()
        made.config, made.queue, made.folder = config, None, folder
        made.does = open(f"{folder}/model.safetensors").read()
        if made.does == "cannot be loaded":
            raise RuntimeError("Missing key(s) in state_dict: model.head.weight")
        return made

    def reset(self):
        self.queue = []

    def select_action(self, batch):
        self.queue.append(batch)

    def predict_action_chunk(self, batch):
        assert "action" not in batch
        if self.does == "dies" or (self.does == "dies once" and not os.path.exists(self.folder + "/died")):
            open(self.folder + "/died", "w").close()
            print("out of luck", file=sys.stderr, flush=True)
            os._exit(7)
        if self.does == "hangs":
            time.sleep(300)
        if self.does == "raises":
            raise ValueError("the arm is tired")
        if self.does == "prints":
            os.write(1, b"a kernel writes here")
            sys.stdin.read()
        if self.does == "begins another":
            child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(300)"])
            open(self.folder + "/child", "w").write(str(child.pid))
        if self.config.type == "vqbet":
            window = self.queue
        elif self.config.type == "diffusion":
            assert not self.queue and batch["observation.images.top"].ndim == 5
            names = ("observation.images.top", "observation.state")
            window = [{name: batch[name][:, n] for name in names} for n in range(batch[names[0]].shape[1])]
        else:
            window = [batch]
        assert len(window) == self.config.n_obs_steps
        batch = window[-1]
        picture = batch["observation.images.top"]
        assert picture.dtype == np.float32 and picture.shape[1] == 3 and 0 <= picture.min() and picture.max() <= 1
        state = batch["observation.state"].reshape(-1)[-3:] if "observation.state" in batch else [len(batch["task"][0])]
        row = np.array([picture[0, 0].mean(), state[0], torch.RNG[0].standard_normal()], np.float32)
        if len(window) > 1:
            row[0] -= window[0]["observation.images.top"][0, 0].mean()
            row[1] -= window[0]["observation.state"][0, 0]
            row[2] = len(window)
        steps = np.arange(1, CHUNK + 1, dtype=np.float32)[:, None]
        return (row * steps)[None].view(torch.Tensor)

class Step:
    def __init__(self, features, norm_map, numbers, keys=None):
        self.features, self.norm_map, self.numbers, self.normalize_observation_keys = features, norm_map, numbers, keys
    def state_dict(self):
        return self.numbers

class NormalizerProcessorStep(Step):
    def __call__(self, batch):
        if "observation.state" not in batch:
            return {**batch, "action": None}
        mean, std = (np.float32(self.numbers["observation.state." + one]) for one in ("mean", "std"))
        return {**batch, "observation.state": (batch["observation.state"] - mean) / std, "action": None}

class UnnormalizerProcessorStep(Step):
    def __call__(self, chunk):
        return chunk * np.float32(self.numbers["action.std"]) + np.float32(self.numbers["action.mean"])

class Pipeline:
    def __init__(self, step):
        self.steps = [step]
    def __call__(self, given):
        return self.steps[0](given)
    def reset(self):
        pass

class Named(str):
    @property
    def value(self):
        return str(self)

def get_policy_class(kind):
    return Policy

def make_pre_post_processors(config, pretrained_path, preprocessor_overrides):
    assert preprocessor_overrides == {"device_processor": {"device": config.device}}
    from lerobot.configs import Feature
    made = []
    for side, kind in (("pre", NormalizerProcessorStep), ("post", UnnormalizerProcessorStep)):
        numbers = json.load(open(f"{pretrained_path}/policy_{side}processor_numbers.safetensors"))
        features = {n: Feature(type=f["type"]) for n, f in {**config.input_features, **config.output_features}.items()}
        modes = {one: Named(mode) for one, mode in config.normalization_mapping.items()}
        made.append(Pipeline(kind(features, modes, numbers)))
    return tuple(made)
"""


def install(folder: Path, *, lerobot: bool = True) -> Path:
    """Write both packages into a folder, which a Python is to have on its path; one may be left out."""
    packages = {"torch": {"__init__": TORCH}}
    if lerobot:
        factory = FACTORY.replace("CHUNK", str(CHUNK))
        packages["lerobot"] = {"__init__": "", "configs": CONFIGS, "policies/__init__": "", "policies/factory": factory}
    for name, modules in packages.items():
        for module, text in modules.items():
            path = folder / name / f"{module}.py"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(textwrap.dedent(text))
        about = folder / f"{name}-0.6.1.dist-info"
        about.mkdir(exist_ok=True)
        (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 0.6.1\n")
    return folder


def environment(folder: Path) -> dict[str, str]:
    """Return the variables by which a process finds the packages of `install`."""
    return {"PYTHONPATH": os.pathsep.join(filter(None, [str(folder), os.environ.get("PYTHONPATH", "")]))}


def checkpoint(folder: Path, does: str = "answers", **config: Any) -> Path:  # noqa: ANN401 - fields of all kinds
    """Write a checkpoint for banks of ``tabletop``, with other fields of its configuration; return its folder."""
    folder.mkdir(parents=True, exist_ok=True)
    pictures = {f"observation.images.{name}": {"type": "VISUAL", "shape": [3, 32, 32]} for name in ("top", "wrist")}
    usual = {
        "type": "act",
        "device": "cpu",
        "n_obs_steps": 1,
        "input_features": {**pictures, "observation.state": {"type": "STATE", "shape": [3]}},
        "output_features": {"action": {"type": "ACTION", "shape": [3]}},
        "normalization_mapping": {"VISUAL": "IDENTITY", "STATE": "MEAN_STD", "ACTION": "MEAN_STD"},
        "pretrained_backbone_weights": "ResNet18_Weights.IMAGENET1K_V1",
        **dict.fromkeys(("chunk_size", "n_action_steps", "action_chunk_size"), CHUNK),
    }
    (folder / "config.json").write_text(json.dumps({**usual, **config}))
    (folder / "model.safetensors").write_text(does)
    steps = {
        "policy_preprocessor": ["rename_observations_processor", "device_processor", "normalizer_processor"],
        "policy_postprocessor": ["unnormalizer_processor"],
    }
    for file, names in steps.items():
        rows: list[dict[str, Any]] = [{"registry_name": name, "config": {}} for name in names]
        rows[-1]["state_file"] = f"{file}_numbers.safetensors"
        (folder / f"{file}.json").write_text(json.dumps({"name": file, "steps": rows}))
    of_state = {"observation.state.mean": [0.5, 0, 0], "observation.state.std": [0.25, 1, 1]}
    (folder / "policy_preprocessor_numbers.safetensors").write_text(json.dumps(of_state))
    of_action = {"action.mean": [0, 0, 10], "action.std": [2, 2, 2]}
    (folder / "policy_postprocessor_numbers.safetensors").write_text(json.dumps(of_action))
    return folder
