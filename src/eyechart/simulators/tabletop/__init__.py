"""A tabletop on which a tool reaches for a named block: banks of two cameras and a state."""

from collections.abc import Iterator
from functools import partial

import numpy as np

from eyechart.frames import Camera, Scalar
from eyechart.seeds import key_seed
from eyechart.simulators import Declaration
from eyechart.simulators.banks import BankMaker, Moment, Preset, ShownPictures, by_dozens, versions_of
from eyechart.simulators.tabletop.pictures import BLOCKS, CAMERAS, HALF, OTHER_TABLE, TableAppearance, cameras
from eyechart.simulators.tabletop.world import (
    COLOURS,
    HORIZON,
    MOVED,
    Object,
    Workspace,
    direction,
    episode,
    instruction,
    oracle,
    scene,
)
from eyechart.spaces.discrete import Discrete
from eyechart.spaces.motion import Dimension, MotionSpace

INSTRUCTION = "instruction"
STATE = "state"
MOVES = 16
"""Moments of a reach. An episode takes some of them, evenly spread; a longer episode takes all."""
_TOOL = (
    Dimension("x", along="x", sign=-1.0, about=0.5),
    Dimension("y", along="y"),
    Dimension("grip"),
)
_TARGET = (Dimension("target_x", sign=-1.0, about=0.5), Dimension("target_y"))
_DIMENSIONS = (
    Dimension("dx", unit="0.06 of the table", along="x", sign=-1.0),
    Dimension("dy", unit="0.06 of the table", along="y"),
    Dimension("grip", unit="1 closed"),
)
_SCENARIOS = {f"{named}-{side}": {"named": named, "begins": side} for named in COLOURS for side in ("left", "right")}
OBJECTS: tuple[Object, Object] = ("named", "other")


class Tabletop(BankMaker):
    """A reach for one of two blocks: two cameras, the tool's state, an instruction and a motion.

    The motion is the oracle's.
    """

    declared = Declaration(
        name="tabletop",
        picture="drawn tabletop with two blocks and a tool, from above and from the wrist, 32 × 32 pixels",
        mirror_axis="horizontal",
        action_space=Discrete(
            "tabletop", ("LEFT", "RIGHT", "UP", "DOWN", "STAY"), mirror_pairs=(("LEFT", "RIGHT"),), brake=(), proceed=()
        ),
        presets={
            "balanced": "Both blocks anywhere, and a state of the tool alone; reaches begin on both sides.",
            "fixed": "Both blocks always at the same two places, so that the state tells what the pictures tell.",
            "privileged": "As balanced, and the state tells where the named block is.",
        },
    )

    def open_preset(self, name: str) -> Preset:
        """Return the contents of a preset's banks."""
        state = (*_TOOL, *_TARGET) if name == "privileged" else _TOOL
        return Preset(
            _SCENARIOS,
            by_dozens(partial(_moments, name)),
            None,
            cameras=tuple(Camera(camera, "horizontal") for camera in CAMERAS),
            prompt_columns=(INSTRUCTION,),
            state=(STATE,),
            motion=MotionSpace("reach", _DIMENSIONS, HORIZON, "delta", state=state, mirrored=True),
        )

    def versions(self) -> dict[str, str]:
        """Return the versions of this world and of the library that draws it."""
        return {"tabletop": "1", **versions_of(("numpy",))}


def _moments(preset: str, scenario: str, seed: int, steps: int) -> Iterator[Moment]:
    """Yield the moments of an episode with their counterfactuals, drawn from the episode's key."""
    rng = np.random.default_rng(key_seed("tabletop", preset, scenario, seed))
    named, side = scenario.split("-")
    colour = COLOURS[named == COLOURS[1]]
    blocks = scene(rng, fixed=preset == "fixed")
    reach = episode(rng, blocks, colour, max(MOVES, steps), left=side == "left")
    chosen = np.linspace(0, len(reach) - 1, steps).round().astype(int)
    tables = [reach[place] for place in chosen]
    ways = [{which: direction(table, which, rng) for which in OBJECTS} for table in tables]
    decoys = _decoys(blocks, rng)
    drawn = {"": cameras(tables), **_changed(tables, ways, decoys)}
    for number, (table, way) in enumerate(zip(tables, ways, strict=True)):
        seen = {name: {one: many[number] for one, many in views.items()} for name, views in drawn.items()}
        own: ShownPictures = seen.pop("")
        numbers = [*table.tool, table.grip, *(table.target if preset == "privileged" else ())]
        yield Moment(
            truth=_truth(table, way),
            picture=own,
            counterfactuals=seen,
            fields={INSTRUCTION: instruction(table.named)},
            state={STATE: tuple(round(float(one), 6) for one in numbers)},
            motion=tuple(tuple(map(float, np.round(row, 6))) for row in oracle(table)),
        )


def _changed(
    tables: list[Workspace], ways: list[dict[Object, np.ndarray]], decoys: np.ndarray
) -> dict[str, dict[str, np.ndarray]]:
    """Return the pictures of all moments with one thing changed, by its name."""
    result = {}
    for which in OBJECTS:
        for name, sign in (("plus", 1), ("minus", -1)):
            moved = [table.moved(which, sign * MOVED * way[which]) for table, way in zip(tables, ways, strict=True)]
            result[f"{which}_{name}"] = cameras(moved)
    result["exchanged"] = cameras(tables, TableAppearance(blocks=BLOCKS[::-1]))
    result["recoloured"] = cameras(tables, TableAppearance(table=OTHER_TABLE))
    result["decoys"] = cameras(tables, TableAppearance(decoys=decoys))
    return result


def _decoys(blocks: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return the places of two grey blocks that cover neither of the others, shape (2, 2)."""
    drawn = rng.uniform(HALF, 1 - HALF, (64, 2))
    far = np.linalg.norm(drawn[:, None] - blocks[None], axis=2).min(axis=1)
    return np.asarray(drawn[np.argsort(far < 3 * HALF, kind="stable")[:2]])


def _truth(table: Workspace, way: dict[Object, np.ndarray]) -> dict[str, Scalar]:
    """Return the objects' places, each block's direction of motion, and the oracle's response.

    ``named_follow`` compares the oracle's motion along that direction with the block moved forth
    and moved back: the difference in units of dx and dy. ``other_follow`` is the same for the other
    block, if that one were named.
    """
    result: dict[str, Scalar] = {"named": table.named}
    result |= {f"{colour}_{axis}": float(table.blocks[row, i]) for row, colour in enumerate(COLOURS) for i, axis in _XY}
    for which in OBJECTS:
        instructed = table if which == "named" else table.told_otherwise()
        ends = [oracle(instructed.moved("named", sign * MOVED * way[which]))[:, :2].sum(axis=0) for sign in (1, -1)]
        result |= {f"{which}_along_{axis}": float(way[which][i]) for i, axis in _XY}
        result[f"{which}_follow"] = float((ends[0] - ends[1]) @ way[which])
    return result


_XY = ((0, "x"), (1, "y"))
