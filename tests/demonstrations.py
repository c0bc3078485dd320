"""Demonstrations in HDF5, small and written here, in the layouts of robomimic, LIBERO and ACT."""

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

LENGTH, EPISODES, SIZE = 12, 6, (16, 24)


def walk(episode: int, count: int, length: int = LENGTH) -> Any:  # noqa: ANN401 - of NumPy
    """Return the places of an arm on its way, shape (length, count), float32."""
    rng = np.random.default_rng([5, episode])
    start, goal = rng.normal(size=(2, count))
    shares = np.linspace(0, 1, length)[:, None]
    return (start + (goal - start) * shares + rng.normal(size=(length, count)) * 0.01).astype(np.float32)


def shots(episode: int, seed: int = 0, length: int = LENGTH) -> Any:  # noqa: ANN401 - of NumPy
    """Return pictures, shape (length, h, w, 3), uint8, each different."""
    rng = np.random.default_rng([episode, seed])
    return rng.integers(0, 255, (length, *SIZE, 3), dtype=np.uint8)


def h5py() -> Any:  # noqa: ANN401 - a module of an extra
    """Return h5py."""
    import h5py as module  # noqa: PLC0415 - an extra

    return module


def robomimic(path: Path, *, libero: bool = False, rate: int | None = 20, words: str = "pick the pear") -> Path:
    """Write a file of robomimic, or of LIBERO, with all of its usual members."""
    cameras = ("agentview_rgb", "eye_in_hand_rgb") if libero else ("agentview_image", "robot0_eye_in_hand_image")
    parts = (
        {"ee_states": 6, "ee_pos": 3, "gripper_states": 2, "joint_states": 7}
        if libero
        else {"robot0_eef_pos": 3, "robot0_eef_quat": 4, "robot0_gripper_qpos": 2, "object": 10}
    )
    with h5py().File(path, "w") as file:
        data = file.create_group("data")
        data.attrs["env_args"] = json.dumps({"env_kwargs": {} if rate is None else {"control_freq": rate}})
        if libero:
            data.attrs["problem_info"] = json.dumps({"language_instruction": [*words]})
        for episode in range(EPISODES):
            group = data.create_group(f"demo_{episode}")
            group.attrs["num_samples"] = LENGTH
            places = walk(episode, 7)
            group["actions"] = np.diff(places, axis=0, append=places[-1:]).astype(np.float64)
            group["states"], group["dones"] = np.zeros((LENGTH, 300)), np.zeros(LENGTH, np.uint8)
            group["next_obs/ignored"] = np.zeros((LENGTH, 2))
            for name, count in parts.items():
                group[f"obs/{name}"] = walk(episode, 7)[:, :count] if count <= 7 else walk(episode, count)
            for seed, name in enumerate(cameras):
                group.create_dataset(f"obs/{name}", data=shots(episode, seed), compression="gzip", shuffle=True)
    return path


def act(folder: Path, *, compressed: bool = False) -> Path:
    """Write a folder of ACT: one file an episode, with raw or with encoded pictures."""
    folder.mkdir(parents=True, exist_ok=True)
    for episode in range(EPISODES):
        with h5py().File(folder / f"episode_{episode}.hdf5", "w") as file:
            file.attrs["sim"], file.attrs["compress"] = True, compressed
            places = walk(episode, 14)
            file["observations/qpos"], file["observations/qvel"] = places, np.zeros((LENGTH, 14))
            file["action"] = np.vstack([places[1:], places[-1:]])
            for seed, name in enumerate(("cam_high", "cam_left_wrist")):
                pictures = shots(episode, seed)
                if compressed:
                    encoded = [jpeg(one) for one in pictures]
                    width = max(map(len, encoded))
                    pictures = np.array([np.frombuffer(one.ljust(width, b"\0"), np.uint8) for one in encoded])
                    lengths = file.require_dataset("compress_len", (2, LENGTH), np.int64)
                    lengths[seed] = [*map(len, encoded)]
                file.create_dataset(f"observations/images/{name}", data=pictures, chunks=(1, *pictures.shape[1:]))
    return folder


def jpeg(picture: Any) -> bytes:  # noqa: ANN401 - of NumPy
    """Return a picture as JPEG."""
    held = io.BytesIO()
    Image.fromarray(picture).save(held, "JPEG", quality=90)
    return held.getvalue()
