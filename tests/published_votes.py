"""Votes of six models on 288 frames with the paper's counts: the confusion matrices that its printed rates allow."""

import csv
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from eyechart.studies.guardian import VIEWS, VoteProvenance, VoteTable

GEMMA, QWEN = "Gemma4-12B", "Qwen3.5-9B"
OTHERS = ("MiniCPM-V-4.5", "Ministral3-8B", "Qwen2.5-VL-7B", "Qwen3-VL-8B")
EPISODES = 12

ABOUT = VoteProvenance(
    "f" * 64, "paper", "prompt-digest", "view-digest", dict.fromkeys((GEMMA, QWEN, *OTHERS), "digest-1")
)

CELLS = (
    # part, hazard, Gemma's votes on original and reflection, Qwen3.5's, frames
    ("score", True, (1, 1), (1, 1), 125),  # unanimous: sensitivity .992 needs one unanimous miss
    ("score", True, (1, 1), (1, 0), 23),
    ("score", True, (0, 1), (1, 1), 10),  # three votes, one of them not Gemma's original
    ("score", True, (1, 0), (1, 0), 23),
    ("score", True, (0, 1), (0, 1), 22),  # 45 splits on hazards
    ("score", True, (1, 0), (0, 0), 3),
    ("score", True, (0, 0), (0, 1), 5),
    ("score", True, (0, 0), (0, 0), 1),
    ("score", False, (0, 0), (0, 0), 50),
    ("score", False, (1, 0), (0, 0), 3),
    ("score", False, (0, 0), (1, 0), 4),
    ("score", False, (1, 0), (1, 0), 2),
    ("score", False, (0, 1), (0, 1), 1),  # 3 splits on clear frames
    ("calibration", True, (1, 0), (0, 1), 4),
    ("calibration", True, (1, 1), (0, 0), 1),
    ("calibration", True, (1, 0), (0, 0), 1),
    ("calibration", True, (0, 0), (0, 0), 2),
    ("calibration", False, (0, 0), (0, 0), 6),
    ("calibration", False, (1, 0), (0, 0), 2),
)
"""Of the calibration Gemma is right on 6 and 6, the pair at two votes on 5 and 8: .951 over 288 frames needs that."""


def rows() -> Iterator[tuple[str, bool, tuple[int, int], tuple[int, int]]]:
    """Yield part, truth and the two models' votes, frame by frame."""
    for part, hazard, gemma, qwen, frames in CELLS:
        yield from [(part, hazard, gemma, qwen)] * frames


def published() -> VoteTable:
    """Return the votes on all 288 frames, hazards and clear frames spread over 12 episodes."""
    listed = list(rows())
    models = tuple(sorted((GEMMA, QWEN, *OTHERS)))
    votes = np.ones((6, len(listed), 2), dtype=np.int8)  # the others always say hazard
    votes[models.index(GEMMA)] = [row[2] for row in listed]
    votes[models.index(QWEN)] = [row[3] for row in listed]
    return VoteTable(
        "votes.csv",
        tuple(f"f{number:03}" for number in range(len(listed))),
        tuple(f"e{number % EPISODES:02}" for number in range(len(listed))),
        np.array([row[1] for row in listed]),
        models,
        votes,
        ABOUT,
        tuple(row[0] for row in listed),
    )


def write(table: VoteTable, folder: Path) -> tuple[Path, Path]:
    """Write a table as CSV with the file that says how its votes came about."""
    votes, about = folder / "votes.csv", folder / "votes.toml"
    names = {1: "true", 0: "false", -1: ""}
    with votes.open("w", newline="") as file:
        out = csv.writer(file)
        heads = [f"{model}/{view}" for model in table.models for view in VIEWS]
        out.writerow(["frame", "episode", "hazard", "split", *heads])
        for place, frame in enumerate(table.frames):
            said = [names[int(vote)] for model in table.votes for vote in model[place]]
            split = table.split[place] if table.split else "score"
            out.writerow([frame, table.episodes[place], bool(table.hazard[place]), split, *said])
    lines = [f'{name} = "{getattr(table.about, name)}"' for name in ("bank", "bank_name", "prompt", "view")]
    lines += [f'[models."{model}"]\nversion = "{version}"' for model, version in table.about.versions.items()]
    about.write_text("\n".join(lines) + "\n")
    return votes, about
