"""A rover that answers with steering and speed: its logs as a bank, and models behind a server that state numbers."""

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from aiohttp import web
from PIL import Image

from data_sets import write_table
from eyechart.frames import FrameBank, decode, encode
from eyechart.importing import Choices, import_table, read_rig
from faults import completion
from seeing import Endpoint, OllamaEndpoint, read

PICTURE = "observation.images.front"
PROMPT = """
name = "drive"
user = '''
You drive a rover by its camera. It drives at {pace} m/s now. Your task: {task}.
Reply as JSON: {"steer": <radians, left is positive>, "speed": <m/s>}.
'''
[answer]
fields = [
    {name = "steer", kind = "number", key = "steer", unit = "rad"},
    {name = "speed", kind = "number", key = "speed", unit = "m/s"},
]
"""


def rover_bank(folder: Path, *, episodes: int = 16, length: int = 5, horizon: int = 1) -> FrameBank:
    """Return a bank of drives: a bright post says where to steer, the pace and the task how fast to go."""
    rng = np.random.default_rng(3)
    folder.mkdir(parents=True, exist_ok=True)
    lines = ["front,drive,step,task,pace,steer,speed"]
    for drive in range(episodes):
        post = int(rng.integers(2, 22))
        for step in range(length):
            place, pace = post + int(rng.integers(-1, 2)), round(float(rng.uniform(0.5, 2.5)), 2)
            pixels = np.full((16, 24, 3), 60 + 5 * (drive % 7), np.uint8)
            pixels[4:12, place : place + 1] = 255
            Image.fromarray(pixels).save(folder / f"{drive}-{step}.png")
            task = ("cross the yard", "park")[drive % 2]
            steer, speed = steering(place), pacing(pace, task)
            lines.append(f"{drive}-{step}.png,{drive},{step},{task},{pace},{steer:.4f},{speed:.4f}")
    (folder / "t.csv").write_text("\n".join(lines))
    (folder / "rig.toml").write_text(
        '[[camera]]\nname = "front"\ncolumn = "front"\n[state]\npace = ["pace"]\n'
        f'[motion]\nhorizon = {horizon}\nkind = "delta"\n'
        '[[motion.number]]\ncolumn = "steer"\nunit = "rad"\n[[motion.number]]\ncolumn = "speed"\nunit = "m/s"\n'
    )
    chosen = Choices(rig=read_rig(folder / "rig.toml"), prompt_columns=("task",), picture="forward camera of a rover")
    return import_table(folder, folder / "t.csv", folder / "bank", chosen)


def rover_set(root: Path, *, episodes: int = 12, length: int = 6) -> None:
    """Write a LeRobotDataset of drives: the post says the heading to take, pace and task the pace to take."""
    rng, tasks = np.random.default_rng(3), ("cross the yard", "park")
    names = (PICTURE, "observation.state", "action", "timestamp", "frame_index", "episode_index", "index", "task_index")
    columns: dict[str, list[object]] = {name: [] for name in names}
    for drive in range(episodes):
        post = int(rng.integers(2, 22))
        heading, pace = steering(post), round(float(rng.uniform(0.5, 2.5)), 2)
        for step in range(length):
            place = post + int(rng.integers(-1, 2))
            pixels = np.full((16, 24, 3), 60 + 5 * (drive % 7), np.uint8)
            pixels[4:12, place : place + 1] = 255
            done = [steering(place), pacing(pace, tasks[drive % 2])]
            places = (np.float32(step / 10), step, drive, drive * length + step, drive % 2)
            row = ({"bytes": encode(pixels), "path": None}, [heading, pace], done, *places)
            for name, cell in zip(names, row, strict=True):
                columns[name].append(cell)
            heading, pace = done
    lengths = {"episode_index": [*range(episodes)], "length": [length] * episodes}
    write_table(root / "data/chunk-000/file-000.parquet", dict(columns))
    write_table(root / "meta/episodes/chunk-000/file-000.parquet", dict(lengths))
    write_table(root / "meta/tasks.parquet", {"task_index": [0, 1], "__index_level_0__": [*tasks]})
    features: dict[str, object] = {PICTURE: {"dtype": "image", "shape": [16, 24, 3]}}
    for name, parts in (("observation.state", ["heading", "pace"]), ("action", ["steer", "speed"])):
        features[name] = {"dtype": "float32", "shape": [2], "names": parts}
    (root / "meta/info.json").write_text(json.dumps({"codebase_version": "v3.0", "fps": 10, "features": features}))


def steering(place: float) -> float:
    """Return where to steer, by the column of the post."""
    return (11.5 - place) / 12


def pacing(pace: float, task: str) -> float:
    """Return how fast to go."""
    return 0.5 * pace + (1.0 if "yard" in task else 0.2)


@dataclass
class Driver(Endpoint):
    """Answers a driver's prompt with numbers: from its picture if it ``looks``, from the words alone if not."""

    looks: bool = True
    trembles: float = 0.0
    odd: Sequence[tuple[str, str]] = ()
    """Every other reply to a driver is one of these in turn: its text, and how it ended."""
    driven: int = 0

    async def __call__(self, request: web.Request, asked: dict[str, object], attempt: int) -> web.StreamResponse:
        """Answer one request; some replies to a driver are odd."""
        self.driven += "rover" in read(asked)[0]
        if self.odd and self.driven % 2 and "rover" in read(asked)[0]:
            text, end = self.odd[self.driven // 2 % len(self.odd)]
            return web.json_response(completion(text, end, usage={"prompt_tokens": 9, "completion_tokens": 3}))
        return await super().__call__(request, asked, attempt)

    def say(self, user: str, picture: bytes | None, asked: dict[str, object]) -> str:
        """Return the answer; a driver's is JSON in any mode."""
        return self.answer(user, picture, asked) if "rover" in user else super().say(user, picture, asked)

    def answer(self, user: str, picture: bytes | None, asked: dict[str, object]) -> str:
        """Return steering and speed for a driver's prompt."""
        if "rover" not in user:
            return super().answer(user, picture, asked)
        paces = (r"(\d+(?:\.\d+)?) m/s now", r"\(pace\): (\d+(?:\.\d+)?)", r"pace: \S+, (\d+(?:\.\d+)?)")
        found = next(filter(None, (re.search(one, user) for one in paces)), None)
        pace = 1.0 if found is None else float(found[1])
        heading = re.search(r"pace: (-?\d+(?:\.\d+)?), ", user)
        speed, steer = pacing(pace, user), 0.3 * (pace - 1.5) if heading is None else float(heading[1])
        if self.looks and picture is not None:
            pixels = decode(picture, "it").astype(float).sum(axis=2)[4:12].mean(axis=0)
            steer = steering(float(pixels.argmax())) if pixels.max() > pixels.min() + 1 else 0.0
        steer += self.trembles * self.dice.uniform(-1, 1) * bool(asked.get("temperature"))
        if '"motion"' in user:
            return json.dumps({"motion": [[round(steer, 4), round(speed, 4)]]})
        return json.dumps({"steer": round(steer, 4), "speed": round(speed, 4)})


class OllamaDriver(OllamaEndpoint):
    """The same behind Ollama's API."""

    endpoint = Driver()
