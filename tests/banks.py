"""Tiny synthetic banks that need no simulator: a green box, a red one ahead of it, and a code in the top row."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from eyechart.conditions import COUNTERFACTUALS
from eyechart.frames import (
    LEAD_GAP,
    MAIN,
    RGB,
    BankManifest,
    BankWriter,
    Camera,
    Frame,
    FrameBank,
    MirrorAxis,
    alone,
    encode,
    open_bank,
)
from eyechart.spaces.discrete import DRIVING

SCENARIOS = ("light", "dense", "merge")
WRISTS = (Camera("left", "horizontal", "right"), Camera("right", "horizontal", "left"))
STAGED = ("lane_own", "lane_beside", "lead_mid_near", "lead_mid_far", "lead_absent", "real_again", "nudged")
"""The controls of banks that hold none over the whole range."""
ALONG = ("lead_drawn", "exchange_own", "exchange_beside", "exchange_apart", "lead_absent")
"""The pictures of banks that hold controls over the whole range."""
DRAWN_CONTROLS = STAGED[:5]
_GAPS_M = (6.0, 14.0, 25.0, 38.0, None)
NEAR_M, FAR_M = 5.0, 40.0


def manifest(**settings: object) -> BankManifest:
    """Return the manifest of a bank that is about to be written."""
    return BankManifest("boxes", "tiny", "boxes on grey", DRIVING, LEAD_GAP, settings, {"boxes": "1"})


def draw(gap_m: float | None, code: int, *, lane: int = 1, green: int = 200, beside_m: float | None = None) -> RGB:
    """Draw a road, shape (16, 60, 3): the lead ``gap_m`` pixels ahead, and ``code`` in the pixels of the top row.

    ``beside_m`` is how far ahead a vehicle of a neighbouring lane is, where there is one.
    """
    pixels = np.full((16, 60, 3), 100, dtype=np.uint8)
    pixels[0, :24, 2] = [255 * (code >> bit & 1) for bit in range(24)]
    top = 3 + 4 * lane
    pixels[top : top + 3, 4:10] = (50, green, 0)
    if gap_m is not None:
        left = 10 + round(gap_m)
        pixels[top : top + 3, left : left + 6] = (200, 0, 0)
    if beside_m is not None:
        top, left = 3 + 4 * ((lane + 1) % 3), 10 + round(beside_m)
        pixels[top : top + 3, left : left + 6] = (200, 0, 0)
    return pixels


def one(frame_id: str, place: tuple[str, str, int], axis: MirrorAxis, file: str, **more: Mapping[str, Any]) -> Frame:
    """Return a frame of one camera, at its place of scenario, episode and step."""
    return Frame(frame_id, *place, alone(axis), {MAIN: file}, **more)


def frames_of(
    scenarios: Sequence[str],
    episodes: int,
    steps: int,
    axis: MirrorAxis,
    *,
    drawn: bool,
    controls: bool = False,
    ranged: bool = False,
) -> list[Frame]:
    """Return the frames of a bank: episodes and steps of every scenario, gaps mixed over them."""
    kinds = (*COUNTERFACTUALS, *(ALONG if ranged else DRAWN_CONTROLS if controls else ())) if drawn else ()
    frames: list[Frame] = []
    for scenario in scenarios:
        for episode in range(episodes):
            for step in range(steps):
                name = f"{scenario}-{episode}-{step}"
                gap_m = _GAPS_M[(2 * step + episode + len(frames)) % len(_GAPS_M)]
                truth = {"lead_gap_m": gap_m, "demand": "LEFT" if step % 2 else "RIGHT", "crashed": False}
                if ranged and gap_m is not None:
                    truth |= _placed(len(frames))
                pictures = {kind: {MAIN: f"{kind}/{name}.png"} for kind in kinds if gap_m is not None}
                place = scenario, f"{scenario}-{episode}", step
                frames.append(one(name, place, axis, f"images/{name}.png", truth=truth, counterfactuals=pictures))
    return frames


def _placed(number: int) -> dict[str, float]:
    """Return where the pictures along the range put a vehicle, spread evenly in the logarithm over frames."""
    shares = [(number * step) % 1 for step in (0.618034, 0.754878)]
    ends = ((5.0, 40.0), (5.6, 33.0))
    lead_m, exchange_m = (
        round(low * (high / low) ** share, 1) for (low, high), share in zip(ends, shares, strict=True)
    )
    return {"lead_near_m": NEAR_M, "lead_far_m": FAR_M, "lead_drawn_m": lead_m, "exchange_m": exchange_m}


def pictures_of(frame: Frame, code: int) -> tuple[dict[str, bytes], dict[str, dict[str, bytes]]]:
    """Return a frame's encoded picture and those of its counterfactuals."""
    gap_m, lane = frame.truth["lead_gap_m"], frame.step % 3
    assert gap_m is None or isinstance(gap_m, float)
    drawn = {
        "lead_near": draw(5.0, code, lane=lane),
        "lead_far": draw(40.0, code, lane=lane),
        "recoloured": draw(gap_m, code, lane=lane, green=255),
        "lane_own": draw(5.0, code, lane=lane, beside_m=40.0),
        "lane_beside": draw(40.0, code, lane=lane, beside_m=5.0),
        "lead_mid_near": draw(14.0, code, lane=lane),
        "lead_mid_far": draw(27.0, code, lane=lane),
        "lead_absent": draw(None, code, lane=lane),
    }
    if "lead_drawn_m" in frame.truth:
        lead_m, exchange_m = (float(str(frame.truth[name])) for name in ("lead_drawn_m", "exchange_m"))
        drawn |= {
            "lead_drawn": draw(lead_m, code, lane=lane),
            "exchange_own": draw(exchange_m, code, lane=lane, beside_m=FAR_M),
            "exchange_beside": draw(FAR_M, code, lane=lane, beside_m=exchange_m),
            "exchange_apart": draw(FAR_M, code, lane=lane, beside_m=FAR_M),
        }
    real = {MAIN: encode(draw(gap_m, code, lane=lane))}
    return real, {name: {MAIN: encode(drawn[name])} for name in frame.counterfactuals}


def build_rig(out: Path, *, cameras: tuple[Camera, ...] = WRISTS, frames: int = 12) -> FrameBank:
    """Write a bank of several cameras, whose pictures differ, and of a state of three numbers."""
    with BankWriter(out, replace(manifest(), cameras=cameras, state=("joints",))) as writer:
        for step in range(frames):
            place, seen = (
                ("light" if step % 2 else "dense", f"e{step % 4}", step),
                {camera.name: step for camera in cameras},
            )
            files = {name: f"images/{name}/{step}.png" for name in seen}
            truth, state = {"lead_gap_m": float(step)}, {"joints": (step / 10, 0.25, -step / 7)}
            images = {name: encode(draw(step, 16 * step + code)) for code, name in enumerate(seen)}
            writer.add(Frame(f"f{step}", *place, cameras, files, truth, state=state), images, {})
    return open_bank(out)


def build_bank(
    out: Path,
    *,
    scenarios: Sequence[str] = SCENARIOS,
    episodes: int = 2,
    steps: int = 3,
    axis: MirrorAxis = "vertical",
    drawn: bool = True,
    controls: bool = False,
    ranged: bool = False,
) -> FrameBank:
    """Write a bank of ``scenarios`` × ``episodes`` × ``steps``.

    ``drawn`` adds counterfactuals where a lead is, ``controls`` the control pictures of an older bank too, and
    ``ranged`` those along the whole range.
    """
    frames = frames_of(scenarios, episodes, steps, axis, drawn=drawn, controls=controls, ranged=ranged)
    with BankWriter(out, manifest()) as writer:
        for code, frame in enumerate(frames):
            writer.add(frame, *pictures_of(frame, code))
    return open_bank(out)
