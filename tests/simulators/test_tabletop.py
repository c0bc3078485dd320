"""The tabletop: its pictures show its truth, its oracle goes to the block that is named, and its mirror is a mirror."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from eyechart.frames import FrameBank, decode, open_bank
from eyechart.simulators import open_bank_simulator
from eyechart.simulators.tabletop import INSTRUCTION, STATE
from eyechart.simulators.tabletop.pictures import BLOCKS, SIZE, cameras
from eyechart.simulators.tabletop.world import COLOURS, MOVED, REACH, Workspace, episode, oracle, scene


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a small bank."""
    return open_bank_simulator("tabletop").build(tmp_path_factory.mktemp("tabletop") / "bank", seeds=(0, 1), steps=6)


def middle(picture: np.ndarray, colour: tuple[int, int, int]) -> np.ndarray | None:
    """Return where a colour's pixels lie in the middle, in shares of the picture, None where there are none."""
    near = np.abs(picture.astype(int) - colour).sum(axis=2) < 60
    return None if not near.any() else (np.argwhere(near)[:, ::-1].mean(axis=0) + 0.5) / SIZE


def seen(bank: FrameBank, frame: object, changed: str | None = None) -> Mapping[str, np.ndarray]:
    """Return a frame's pictures by camera."""
    return {name: decode(image, name) for name, image in bank.images(frame, changed).items()}


def test_its_bank_is_twelve_episodes_of_two_cameras_a_state_an_instruction_and_a_motion(tmp_path: Path) -> None:
    """As ``frames build tabletop`` makes it without an option; every episode has one instruction."""
    made = open_bank_simulator("tabletop").build(tmp_path / "bank")
    assert (len(made), len({frame.episode for frame in made})) == (144, 12)
    for frame in made:
        assert [camera.name for camera in frame.cameras] == ["top", "wrist"]
        assert {one.shape for one in seen(made, frame).values()} == {(32, 32, 3)}
        assert len(frame.state[STATE]) == 3
        assert min(frame.state[STATE]) >= 0
        assert max(frame.state[STATE]) <= 1
        assert np.shape(frame.motion) == (8, 3)
        assert frame.fields[INSTRUCTION] == f"reach the {frame.truth['named']} block"
    told = {(frame.episode, frame.fields[INSTRUCTION]) for frame in made}
    assert len(told) == 12
    assert sum("red" in words for _, words in told) == 6


def test_the_top_camera_shows_where_the_blocks_are(bank: FrameBank) -> None:
    """Each where its truth says, to a pixel, while the tool is not on it; moved ones a fixed way further."""
    off, early = [], [frame for frame in bank if frame.step < 2]
    for frame in early:
        for colour, paint in zip(COLOURS, BLOCKS, strict=True):
            place = np.array([frame.truth[f"{colour}_x"], frame.truth[f"{colour}_y"]])
            off.append(np.abs(middle(seen(bank, frame)["top"], paint) - place).max())
    assert np.quantile(off, 0.8) < 1 / SIZE
    apart = []
    for frame in early:
        paint, along = (
            BLOCKS[COLOURS.index(frame.truth["named"])],
            [frame.truth[f"named_along_{axis}"] for axis in "xy"],
        )
        ends = [middle(seen(bank, frame, f"named_{side}")["top"], paint) for side in ("plus", "minus")]
        apart.append((ends[0] - ends[1]) @ along)
    assert np.median(apart) == pytest.approx(2 * MOVED, abs=0.02)


def test_only_what_was_moved_is_moved(bank: FrameBank) -> None:
    """The other block stays where it is, and the wrist shows the same moment."""
    frame = bank.frames[0]
    other = BLOCKS[1 - COLOURS.index(frame.truth["named"])]
    moved = seen(bank, frame, "named_plus")
    assert middle(moved["top"], other) == pytest.approx(middle(seen(bank, frame)["top"], other))
    assert set(frame.counterfactuals) == {
        *(f"{which}_{side}" for which in ("named", "other") for side in ("plus", "minus")),
        *("exchanged", "recoloured", "decoys"),
    }


def test_the_oracle_reaches_the_named_block() -> None:
    """Followed without an unsteady hand, every reach ends at its block, closed."""
    rng = np.random.default_rng(4)
    for _ in range(30):
        colour = COLOURS[int(rng.integers(2))]
        table = Workspace(rng.uniform(0.1, 0.9, 2), 0.0, scene(rng), colour)
        tool = table.tool.copy()
        for _ in range(20):
            first = oracle(Workspace(tool, 0.0, table.blocks, colour))[0]
            tool = tool + REACH * first[:2]
        assert np.hypot(*(tool - table.target)) < 1e-9
        assert first[2] == 1.0


def test_following_is_what_the_oracle_does_with_the_block_moved(bank: FrameBank) -> None:
    """The declared way along its direction; twice .12 of the table are four moves."""
    follows = [frame.truth["named_follow"] for frame in bank]
    assert max(follows) <= 2 * MOVED / REACH + 1e-6
    assert np.mean(follows) > 0.5 * 2 * MOVED / REACH


def test_the_mirrored_table_is_the_flipped_picture() -> None:
    """Of both cameras, so that a mirrored picture shows what the mirrored world would."""
    rng = np.random.default_rng(1)
    tables = episode(rng, scene(rng), "red", 8, left=True)
    flipped = [
        Workspace(
            np.array([1 - table.tool[0], table.tool[1]]),
            table.grip,
            np.array([[1, 0]]) + [[-1, 1]] * table.blocks,
            "red",
        )
        for table in tables
    ]
    for name, pictures in cameras(tables).items():
        assert np.abs(pictures[:, :, ::-1].astype(int) - cameras(flipped)[name]).max() <= 1
    for one, other in zip(tables, flipped, strict=True):
        assert oracle(other) == pytest.approx(oracle(one) * [-1, 1, 1])


def test_presets_say_what_the_state_tells(tmp_path: Path) -> None:
    """``privileged`` tells where the named block is; ``fixed`` has it at two places only."""
    simulator = open_bank_simulator("tabletop")
    told = simulator.build(tmp_path / "privileged", preset="privileged", seeds=(0,), steps=4)
    for frame in told:
        target = [frame.truth[f"{frame.truth['named']}_{axis}"] for axis in "xy"]
        assert frame.state[STATE][3:] == pytest.approx(target, abs=1e-3)
    fixed = simulator.build(tmp_path / "fixed", preset="fixed", seeds=(0, 1), steps=4)
    assert {(frame.truth["red_x"], frame.truth["blue_x"]) for frame in fixed} == {(0.3, 0.7)}
    assert len(open_bank(told.root).manifest.motion.state) == 5
