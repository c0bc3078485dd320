"""A table with what a robot did becomes a bank for policies: cameras, state, instruction, and the motion ahead."""

import csv
import json
import shutil
from collections.abc import Callable, Sequence
from functools import partial
from itertools import count
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from arm_logs import arm_bank
from eyechart.calibrate.policies import power
from eyechart.channels import reflected
from eyechart.cli.app import app
from eyechart.conditions import show
from eyechart.errors import SourceError, SpecError
from eyechart.frames import Frame, FrameBank, alone, check, decode, encode, open_bank
from eyechart.importing import Choices, costs, import_table, read_rig
from eyechart.importing.costs import taken
from eyechart.importing.log_warnings import notes
from eyechart.importing.motion_log import LogDescription, MotionSegment, tell
from eyechart.importing.repeats import repeats
from eyechart.simulators import open_bank_simulator
from eyechart.studies import policy
from eyechart.studies.policy.scores import judge

EPISODES, LENGTH = 8, 9
RIG = """
[[camera]]
name = "front"
column = "front"

[[camera]]
name = "side"
column = "side"

[state]
joints = ["j0", "j1"]

[motion]
horizon = 3
kind = "absolute"
rate_hz = 10

[[motion.number]]
column = "a0"
name = "pan"
unit = "rad"
state = "j0"

[[motion.number]]
column = "a1"
scale = 0.5
state = "j1"
"""
HEAD = "front,side,drive,step,task,j0,j1,a0,a1"


def act(images: dict[str, np.ndarray], state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Go from the state toward where the front picture is bright; to the other side if told to leave."""
    sign = -1 if instruction == "leave" else 1
    x, y = (float(images["front"][0, place].mean()) / 255 for place in (0, -1))
    return np.stack([state + sign * step * np.array([x - 0.5, y - 0.5]) for step in (1, 2, 3)])


act.channels = ("camera:front", "state", "instruction")  # type: ignore[attr-defined]


def rows(folder: Path, *, gap: int | None = None) -> list[str]:
    """Write the pictures of a log, and return the lines of its table; without step ``gap`` in the first episode."""
    rng, lines = np.random.default_rng(0), [HEAD]
    for drive in range(EPISODES):
        bright = rng.integers(0, 256, (2, 3), dtype=np.uint8)
        state = rng.uniform(0, 1, 2)
        for step in range(LENGTH):
            names = [f"{drive}-{step}-{one}.png" for one in ("front", "side")]
            pixels = np.zeros((4, 6, 3), np.uint8)
            pixels[:, :3], pixels[:, 3:] = bright
            for name in names:
                Image.fromarray(pixels if "front" in name else pixels[::-1] // 2).save(folder / name)
            task = "go" if drive % 2 else "leave"
            after = act({"front": pixels}, state, task)[0]
            numbers = [*state, *after]
            if not (drive == 0 and step == gap):
                lines.append(",".join([*names, str(drive), str(step), task, *(f"{number:.6f}" for number in numbers)]))
            state = after + rng.normal(0, 0.02, 2)
    return lines


def imported(folder: Path, lines: Sequence[str], rig: str = RIG, **choices: int) -> FrameBank:
    """Import a table with a rig."""
    (folder / "t.csv").write_text("\n".join(lines))
    (folder / "rig.toml").write_text(rig)
    chosen = Choices(rig=read_rig(folder / "rig.toml"), prompt_columns=("task",), **choices)  # type: ignore[arg-type]
    return import_table(folder, folder / "t.csv", folder / "bank", chosen)


def test_each_frame_has_the_motion_of_the_rows_that_follow_it(tmp_path: Path) -> None:
    """Also of rows that become no frame; where the episode ends before, it has none."""
    lines = rows(tmp_path)
    bank = imported(tmp_path, lines, every=2)
    space = bank.manifest.motion
    assert space is not None
    assert (space.shape, space.kind, space.rate_hz) == ((3, 2), "absolute", 10)
    assert [(dimension.name, dimension.unit, dimension.scale, dimension.state) for dimension in space.dimensions] == [
        ("pan", "rad", None, 0),
        ("a1", "", 0.5, 1),
    ]
    assert check(bank.root) == []
    cells = [line.split(",") for line in lines[1:]]
    for frame in bank:
        row = int(frame.episode) * LENGTH + frame.step
        wanted = tuple((float(cell[7]), float(cell[8])) for cell in cells[row : row + 3])
        assert frame.motion == (wanted if frame.step <= LENGTH - 3 else ())
        assert not {"a0", "a1", "j0"} & frame.truth.keys()
        assert frame.state == {"joints": (float(cells[row][5]), float(cells[row][6]))}
    assert "8 of 40 frames have no logged motion: fewer than 3 steps follow them" in costs(bank)
    assert bank.manifest.picture == "pictures of 2 cameras (front, side)"


RNG = np.random.default_rng(0)
STATES = np.cumsum(RNG.normal(size=(200, 3)), axis=0)
AHEAD = STATES + RNG.normal(scale=0.1, size=STATES.shape)
CHANGES = np.diff(STATES, axis=0, append=STATES[-1:])


def told(done: np.ndarray, states: np.ndarray, named: Sequence[int | None]) -> LogDescription:
    """Return what a log of one episode says."""
    return tell([MotionSegment(done, states)], named)


@pytest.mark.parametrize(
    ("done", "named", "kind", "pairs"),
    [
        (AHEAD, (None, None, None), "absolute", (0, 1, 2)),
        (AHEAD[:, ::-1], (None, None, None), "absolute", (2, 1, 0)),
        (AHEAD[:, [2, 0]], (None, None), "absolute", (2, 0)),
        (AHEAD[:, ::-1], (2, 1, 0), "absolute", (2, 1, 0)),
        (CHANGES, (None, None, None), "delta", (None, None, None)),
        (np.ones((200, 3)), (None, None, None), None, (None, None, None)),
        (AHEAD[:9], (None, None, None), None, (None, None, None)),
    ],
)
def test_the_data_tell_places_from_changes(
    done: np.ndarray, named: tuple[int | None, ...], kind: str | None, pairs: tuple[int | None, ...]
) -> None:
    """By how near the numbers stay to the state that they follow: named, of the same place, or the nearest."""
    found = told(done, STATES[: len(done)], named)
    assert (found.kind, found.pairs) == (kind, pairs)


@pytest.mark.parametrize(("done", "kind"), [(AHEAD, "absolute"), (CHANGES, "delta")])
@pytest.mark.parametrize("still", [1, 2])
def test_numbers_of_a_state_that_stand_still_tell_nothing(done: np.ndarray, kind: str, still: int) -> None:
    """And keep nothing back that the others tell, while these are a third; nothing is told where all stand still."""
    states = STATES.copy()
    states[:, -still:] = 1.0
    found = told(done, states, (0, 1, 2))
    assert (found.kind, found.pairs, found.count) == (kind, (0, 1, 2), 3 - still)
    found = told(done, np.ones_like(states), (0, 1, 2))
    assert (found.ratio, found.kind, found.count) == (None, None, 0)


def test_what_lies_between_places_and_changes_is_not_told() -> None:
    """Nor anything without a state."""
    noise = RNG.normal(size=STATES.shape) * STATES.std(axis=0)
    found = told(STATES + noise, STATES, (0, 1, 2))
    assert found.ratio is not None
    assert 0.5 <= found.ratio <= 1
    assert found.kind is None
    assert told(AHEAD, np.empty((200, 0)), (None,) * 3).ratio is None


Logs = tuple[np.ndarray, np.ndarray]
"""States and what was done from each."""


def joints_of(hand: np.ndarray) -> np.ndarray:
    """Return the joints of a made-up arm whose hand is at these places, (n, 3), as no straight lines of them."""
    x, y, z = hand.T
    away = np.linalg.norm(hand, axis=1)
    return np.stack([np.arctan2(y, x), np.arccos(np.clip(away, -1, 1)), 3 * z - away, np.sin(5 * x), np.cos(4 * y)], 1)


def turned(hand: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return unit quaternions, each with a sign of its own: both signs are one rotation."""
    whole = np.concatenate([np.ones((len(hand), 1)), 3 * hand], axis=1)
    whole *= rng.choice([-1.0, 1.0], size=(len(hand), 1))
    return whole / np.linalg.norm(whole, axis=1, keepdims=True)


def scaled(hand: np.ndarray, rng: np.random.Generator) -> Logs:
    """Return changes in units of 5 cm, and two numbers that follow nothing."""
    steps = np.clip(np.diff(hand, axis=0) / 0.05, -1, 1)
    return hand[:-1], np.concatenate([steps, rng.normal(size=(len(steps), 2))], axis=1)


def next_turned(hand: np.ndarray, rng: np.random.Generator) -> Logs:
    """Return the rotation that comes next, with the sign that it has there."""
    every = turned(hand, rng)
    return every[:-1], every[1:]


CONVENTIONS: dict[str, tuple[Callable[[np.ndarray, np.random.Generator], Logs], str | None]] = {
    "changes": (lambda hand, _: (hand[:-1], np.diff(hand, axis=0)), "delta"),
    "changes in other units": (scaled, "delta"),
    "changes made two steps later": (lambda hand, _: (hand[:-3], np.diff(hand, axis=0)[2:]), "delta"),
    "velocities": (lambda hand, _: (joints_of(hand)[:-1], 10 * np.diff(joints_of(hand), axis=0)), "delta"),
    "places of the leader": (lambda hand, _: (joints_of(hand)[:-4], joints_of(hand)[4:]), "absolute"),
    "poses beside joints": (lambda hand, _: (joints_of(hand)[:-1], hand[1:]), None),
    "radians beside degrees": (lambda hand, _: (np.degrees(joints_of(hand))[:-1], joints_of(hand)[1:]), None),
    "rotations of either sign": (lambda hand, rng: (turned(hand[:-1], rng), turned(hand[1:], rng)), None),
    "the next rotation": (next_turned, None),
    "nothing of the state": (lambda hand, rng: (hand[:-1], rng.normal(size=(len(hand) - 1, 3))), None),
}


@pytest.mark.parametrize("way", ["even", "smooth", "slowing down"])
@pytest.mark.parametrize("name", CONVENTIONS)
def test_changes_have_evidence_of_their_own(name: str, way: str) -> None:
    """That numbers are far from the state says nothing of what else they are: places of another frame, or unit."""
    convention, kind = CONVENTIONS[name]
    rng, walks = np.random.default_rng(3), []
    time = np.linspace(0, 1, 31)
    ways = {"even": time, "smooth": time**3 * (10 - 15 * time + 6 * time**2), "slowing down": 1 - np.exp(-3 * time)}
    for _ in range(12):
        goal = rng.uniform(-0.2, 0.2, 3) + np.array([0.4, 0, 0.2])
        start = np.array([0.3, 0, 0.4]) + 0.02 * rng.normal(size=3)
        hand = start + (goal - start) * ways[way][:, None] + 0.001 * rng.normal(size=(31, 3))
        states, done = convention(hand, rng)
        walks.append(MotionSegment(done, states))
    assert tell(walks, (None,) * walks[0].done.shape[1]).kind == kind


@pytest.mark.parametrize("unit", [1e-7, 1.0, 1e9])
def test_the_evidence_is_the_same_in_every_unit(unit: float) -> None:
    """Changes in nanometres follow the state as those in metres do."""
    plain, other = (told(CHANGES * one, STATES * one, (None,) * 3) for one in (1.0, unit))
    assert (other.kind, other.follows, other.alike) == ("delta", plain.follows, plain.alike)


def test_a_rig_whose_kind_the_data_deny_is_warned_of(tmp_path: Path) -> None:
    """Places that a rig takes for changes; the kind that it says is taken all the same."""
    assert not [line for line in taken(imported(tmp_path, rows(tmp_path))) if "kind" in line]
    (tmp_path / "bank").rename(tmp_path / "first")
    bank = imported(tmp_path, rows(tmp_path), RIG.replace('kind = "absolute"\n', ""))
    assert bank.manifest.motion is not None
    assert bank.manifest.motion.kind == "delta"
    (said,) = (line for line in taken(bank) if line.startswith("warning: these numbers look like places"))
    assert said.endswith("taken for delta as [motion] of --rig says")


def test_no_motion_goes_over_a_step_that_is_missing(tmp_path: Path) -> None:
    """A log that skips a row would else tell of a jump that nobody made."""
    bank = imported(tmp_path, rows(tmp_path, gap=4))
    without = [frame.step for frame in bank if frame.episode == "0" and not frame.motion]
    assert without == [2, 3, 7, 8]


@pytest.mark.slow
def test_a_policy_of_an_imported_bank_gets_a_verdict(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One that reads the front picture and its task, and neither the side camera nor the state beyond its place."""
    bank = imported(tmp_path, rows(tmp_path))
    monkeypatch.syspath_prepend(Path(__file__).parent)
    spec = "python:test_importing_motions:act"
    policy.run(policy.plan(bank.root, [spec], tmp_path / "run"))
    found = judge(policy.score(tmp_path / "run"))[spec]
    assert found.guards == {}
    assert found.cameras["side"].label == "ignores_camera"
    assert found.cameras["front"].label != "ignores_camera"
    assert (found.state.label, "places that go along with it" in found.state.because) == ("undecided", True)
    assert found.instruction.label == "instruction_followed"


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('state = "j1"', 'state = "j9"', "the motion's 'a1' belongs to 'j9', but the state has j0, j1"),
        ("horizon = 3", "horizon = 0", "Expected `int` >= 1"),
        ('kind = "absolute"', 'kind = "sideways"', "Invalid enum value 'sideways'"),
        (
            'column = "a1"',
            'column = "a7"',
            "rig: the motion 1 is declared as column 'a7': t.csv has no column 'a7'; it has front",
        ),
        ('"j0", "j1"]', '"j0", "j1", "j7"]', "rig: the state joints 2 is declared as column 'j7': t.csv has no column"),
        ("horizon = 3", "horizon = 30", "no episode has 30 consecutive steps, and at most 9 follow each other"),
    ],
)
def test_a_motion_that_the_table_does_not_have_is_one_line(tmp_path: Path, old: str, new: str, said: str) -> None:
    """And no bank is written."""
    with pytest.raises((SourceError, SpecError)) as refused:
        imported(tmp_path, rows(tmp_path), RIG.replace(old, new))
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)
    assert not (tmp_path / "bank").exists()


def test_a_horizon_that_gaps_leave_no_room_for_is_refused_with_the_longest_that_fits(tmp_path: Path) -> None:
    """That of the rows that follow each other, not of all rows of an episode; with it the bank is made."""
    lines = [line for line in rows(tmp_path) if line.split(",")[3] not in {"2", "6"}]
    with pytest.raises(SourceError, match="no episode has 4 consecutive steps, and at most 3 follow each other"):
        imported(tmp_path, lines, RIG.replace("horizon = 3", "horizon = 4"))
    assert sum(bool(frame.motion) for frame in imported(tmp_path, lines)) == EPISODES


def test_a_cell_that_is_no_number_is_a_fault_and_episodes_are_needed(tmp_path: Path) -> None:
    """Named by row and column; without episodes nobody knows which step follows."""
    lines = rows(tmp_path)
    broken = [lines[0], *(line.rpartition(",")[0] + ",nan" if place == 4 else line for place, line in enumerate(lines))]
    del broken[1]
    with pytest.raises(SourceError, match=r"row 4: 'a1' is 'nan', not a number"):
        imported(tmp_path, broken)
    with pytest.raises(SourceError, match="name the episode's column"):
        imported(tmp_path, [lines[0].replace("drive", "who"), *lines[1:]])


AXES = RIG.replace('column = "front"', 'column = "front"\nmirror_axis = "horizontal"').replace(
    'column = "side"', 'column = "side"\nmirror_axis = "horizontal"'
)
REFLECTION = """
[reflection.numbers]
j0 = { mirrors = "j1" }
pan = { mirrors = "a1" }
"""


def leans(images: dict[str, np.ndarray], state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Do as `act` does, and more to one side."""
    return act(images, state, instruction) + np.array([0.3, 0.0])


def test_a_mirrored_moment_of_an_imported_log_is_shown_and_scored(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Pictures flipped, joints exchanged; who does the same on both sides fits the reflection, who leans does not."""
    bank = imported(tmp_path, rows(tmp_path), AXES + REFLECTION)
    space = bank.manifest.motion
    assert space is not None
    assert [one.mirrors for one in (*space.dimensions, *space.state)] == ["a1", "pan", "j1", "j0"]
    frame = bank.frames[0]
    seen, own = reflected(show("mirrored", frame, bank, 0), space), decode(bank.images(frame)["front"], "front")
    assert (decode(seen.images["front"], "front") == own[:, ::-1]).all()
    assert seen.state["joints"] == frame.state["joints"][::-1]
    monkeypatch.syspath_prepend(Path(__file__).parent)
    specs = [f"python:test_importing_motions:{name}" for name in ("act", "leans")]
    policy.run(policy.plan(bank.root, specs, tmp_path / "run", conditions=("real", "real_repeat", "mirrored")))
    even, leaning = (model.statistics["mirror"].value for model in policy.score(tmp_path / "run").models.values())
    assert even == pytest.approx(0, abs=1e-9)
    assert leaning is not None
    assert leaning > 0.05


def test_a_side_that_is_named_is_exchanged_or_asked_about(tmp_path: Path) -> None:
    """An instruction that names a side, without words that are exchanged, is said at the import."""
    lines = [line.replace(",go,", ",go to the left,") for line in rows(tmp_path)]
    silent = imported(tmp_path, lines, AXES + REFLECTION)
    assert any("1 instructions name a side, such as 'go to the left'" in line for line in costs(silent))
    (tmp_path / "bank").rename(tmp_path / "first")
    bank = imported(tmp_path, lines, AXES + REFLECTION + '[reflection.words]\nleft = "right"\n')
    assert not [line for line in costs(bank) if "mirrored" in line]
    space = open_bank(bank.root).manifest.motion
    assert space is not None
    said = {reflected(show("mirrored", frame, bank, 0), space).fields["task"] for frame in bank}
    assert said == {"go to the right", "leave"}


def test_cameras_that_exchange_places_show_each_other_s_reflection(tmp_path: Path) -> None:
    """As a left and a right wrist do."""
    rig = (AXES + REFLECTION).replace('name = "front"', 'name = "front"\nmirrors = "side"')
    bank = imported(tmp_path, rows(tmp_path), rig.replace('name = "side"', 'name = "side"\nmirrors = "front"'))
    seen, own = show("mirrored", bank.frames[0], bank, 0).images, bank.images(bank.frames[0])
    assert (decode(seen["front"], "front") == decode(own["side"], "side")[:, ::-1]).all()


def test_without_a_reflection_the_import_says_that_nothing_is_mirrored(tmp_path: Path) -> None:
    """And who says how."""
    bank = imported(tmp_path, rows(tmp_path), AXES)
    why = "mirrored: the bank does not say what a reflected motion is; declare it in [reflection] of a rig"
    assert why in costs(bank)


@pytest.mark.parametrize(
    ("rig", "said"),
    [
        (AXES + REFLECTION.replace("pan =", "pen ="), "names 'pen'; did you mean 'pan'"),
        (AXES + REFLECTION.replace('"a1"', '"j1"'), "'pan' mirrors 'j1', which is not of the same numbers"),
        (RIG + REFLECTION, "needs the mirror_axis of every camera; 'front' has none"),
        (AXES + "[reflection.numbers]\npan = { mirrors = 'a1' }", "must be measured relative to the reflected 'j0'"),
        (AXES + "[reflection.numbers]\npan = { sign = 2 }", "a reflection has sign 1 or -1"),
        (AXES.partition("[motion]")[0] + REFLECTION, "there is no [motion]"),
        (AXES.replace('column = "side"', ""), "camera 'side' has no column"),
    ],
)
def test_a_reflection_that_cannot_be_is_one_line(tmp_path: Path, rig: str, said: str) -> None:
    """It names what is wrong, and no bank is written."""
    with pytest.raises(SpecError) as refused:
        imported(tmp_path, rows(tmp_path), rig)
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)
    assert not (tmp_path / "bank").exists()


Rows = list[dict[str, str]]


def log(folder: Path, change: Callable[[Path, Rows], None], rig: str = "", **arm: object) -> FrameBank:
    """Import the log of an arm of three joints and two cameras, its rows changed, the ``rig`` behind its own."""
    arm_bank(folder, **{"joints": 3, "side": "moving", "tasks": ("go",), **arm})  # type: ignore[arg-type]
    with (folder / "t.csv").open(newline="") as file:
        lines = [*csv.DictReader(file)]
    change(folder, lines)
    with (folder / "t.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, [*lines[0]])
        writer.writeheader()
        writer.writerows(lines)
    (folder / "rig.toml").write_text((folder / "rig.toml").read_text() + rig)
    chosen = Choices(rig=read_rig(folder / "rig.toml"), prompt_columns=("task",))
    return import_table(folder, folder / "t.csv", folder / "changed", chosen)


def sets(column: str, value: Callable[[int], object]) -> Callable[[Path, Rows], None]:
    """Return what writes into a column the value of each row's number, where that is not None."""

    def change(_: Path, lines: Rows) -> None:
        for number, line in enumerate(lines):
            if (one := value(number)) is not None:
                line[column] = str(one)

    return change


def stops(*drives: int, black: bool = False) -> Callable[[Path, Rows], None]:
    """Return what makes the front camera show one picture all through some drives."""

    def change(folder: Path, lines: Rows) -> None:
        first = folder / lines[0]["front"]
        if black:
            Image.fromarray(np.zeros((6, 8, 3), np.uint8)).save(first)
        for line in lines[1:]:
            if int(line["drive"]) in drives:
                shutil.copy(first, folder / line["front"])

    return change


NOISE = np.random.default_rng(3).normal(size=48)
FAR = {
    "motion 'aj1': a few numbers lie far from all others (1e+03 from the median, where 95 of 100 are within 0.99), in "
    "2 of 40 logged motions: answers are not compared with these, and they set no scale; correct them, or "
    "declare the scale if it is a rare move": sets("aj1", lambda number: 1000 if number == 14 else None),
    "motion 'aj1': a few numbers lie far from all others (50 from the median, where 95 of 100 are within 1.1), in "
    "several episodes: a rare move, or wrong rows, which would set the scale of all others; correct them, or "
    "declare the scale": sets("aj1", lambda number: 50 if number in {12, 36} else None),
    "state 'j2': a few numbers lie far from all others (1e+03 from the median, where 95 of 100 are within 1.2), in 1 "
    "of 48 moments. Partners at a similar state are chosen by its spread, and places are measured from it; correct "
    "them": sets("j2", lambda number: -1000 if number == 14 else None),
}
SMALL = {
    "'aj1' is 0 in every row: the log gives no scale there, and an answer counts in its own unit; declare "
    "its scale in --rig (scale = …), or leave it out": sets("aj1", lambda _: 0),
    "'aj2' varies by 1e-05, the others by 0.41: an error of that size counts as much as one of theirs; if it has "
    "the same unit, declare its scale in --rig (scale = …), or leave it out": sets(
        "aj2", lambda number: f"{0.1 + 1e-5 * NOISE[number]:.9f}"
    ),
}
FROZEN = "camera 'front' shows the same picture all through {} of 8 episodes: was it frozen, or covered?"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        *((change, said) for said, change in (FAR | SMALL).items()),
        (stops(0, 3, 5), FROZEN.format(3)),
        (stops(2, 5, black=True), FROZEN.format(2)),
    ],
)
def test_what_looks_wrong_in_a_log_is_one_line(tmp_path: Path, change: Callable[[Path, Rows], None], said: str) -> None:
    """Numbers far from all others, a dimension that stays or hardly varies, a camera that shows nothing new."""
    bank = log(tmp_path, change)
    assert notes(bank) == [said]
    assert said.replace("--rig", "rig") in costs(bank)


def test_a_log_in_which_nothing_looks_wrong_has_no_notes(tmp_path: Path) -> None:
    """Nor a bank of a simulator, nor a camera whose pictures are all alike, of which other words say it."""
    assert notes(log(tmp_path / "fine", lambda *_: None)) == []
    assert notes(log(tmp_path / "alike", lambda *_: None, side="still")) == []
    for name in ("tabletop", "rover"):
        assert notes(open_bank_simulator(name).build(tmp_path / name, seeds=(0, 1), steps=6)) == []


@pytest.mark.parametrize(("column", "said"), [("aj1", min(SMALL)), ("aj2", max(SMALL))])
def test_a_dimension_with_a_declared_scale_may_hardly_vary(tmp_path: Path, column: str, said: str) -> None:
    """It counts by that scale."""
    assert notes(log(tmp_path, SMALL[said])) == [said]
    rig, number = tmp_path / "rig.toml", f'column = "{column}"'
    rig.write_text(rig.read_text().replace(number, f"{number}\nscale = 0.1"))
    chosen = Choices(rig=read_rig(rig), prompt_columns=("task",))
    assert notes(import_table(tmp_path, tmp_path / "t.csv", tmp_path / "declared", chosen)) == []


def test_every_command_on_a_bank_says_what_looks_wrong_in_its_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The import, the check, the plan and a run, before it asks."""
    monkeypatch.setattr("eyechart.calibrate.policies.power", partial(power, draws=1))
    bank, said = log(tmp_path, stops(0, 3, 5)), FROZEN.format(3)
    again = ["frames", "import", tmp_path, "--table", tmp_path / "t.csv", "--rig", tmp_path / "rig.toml"]
    asked = ["run", "policy", "--policy", "python:arm_logs:by_front", "--frames", bank.root, "--out", tmp_path / "run"]
    for words in ([*again, "--out", tmp_path / "again"], ["frames", "check", bank.root], [*asked, "--dry-run"]):
        result = CliRunner().invoke(app, [str(word) for word in words])
        assert result.exit_code == 0, result.output
        assert result.stderr.splitlines().count(said) == 1
    assert said in " ".join(CliRunner().invoke(app, ["plan", str(bank.root)]).stdout.split())
    for words in (["plan", str(bank.root)], ["frames", "check", str(bank.root)]):
        assert json.loads(CliRunner().invoke(app, [*words, "--json"]).stdout)["notes"] == [said]


def again(*drives: int, redraw: Callable[[np.ndarray], np.ndarray] = np.copy, steps: int = 6) -> Callable[..., None]:
    """Return what appends some drives to a log under other names, so many steps of each, the front pictures redrawn."""

    def change(folder: Path, lines: Rows) -> None:
        for line in [one for one in lines if int(one["drive"]) in drives and int(one["step"]) < steps]:
            new = {**line, "drive": f"{line['drive']}b"}
            for camera in ("front", "side"):
                new[camera] = f"again-{line[camera]}"
                shutil.copy(folder / line[camera], folder / new[camera])
            pixels = redraw(np.asarray(Image.open(folder / line["front"])))
            Image.fromarray(pixels).save(folder / new["front"])
            lines.append(new)

    return change


def encoded(pixels: np.ndarray) -> np.ndarray:
    """Return a picture as another encoding may show it: each value up to two levels off."""
    noise = np.random.default_rng(0).integers(-2, 3, pixels.shape)
    return np.clip(pixels.astype(int) + noise, 0, 255).astype(np.uint8)


def moved(pixels: np.ndarray) -> np.ndarray:
    """Return a picture with something small in it, which changes it by less than three levels on average."""
    result = np.pad(pixels, ((0, 34), (0, 32), (0, 0)), mode="edge")
    result[20:24, 20:24] = 255 - result[20:24, 20:24]
    return result


def forks(folder: Path, lines: Rows) -> None:
    """Add two episodes that begin as others and go another way from the middle on."""
    again(2, 5)(folder, lines)
    for line in (*lines[-9:-6], *lines[-3:]):
        line.update({name: str(1 - float(line[name])) for name in line if name[-1] in "012"})


def larger(folder: Path, lines: Rows) -> None:
    """Make the front pictures of a log larger, as `moved` does."""
    for line in lines:
        pixels = np.asarray(Image.open(folder / line["front"]))
        Image.fromarray(np.pad(pixels, ((0, 34), (0, 32), (0, 0)), mode="edge")).save(folder / line["front"])


def repeated(bank: FrameBank) -> list[str]:
    """Return what the import says of episodes that are others again."""
    return [line for line in taken(bank) if " repeat" in line]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            again(7),
            "episode '7b' repeats episode '7' (same pictures and numbers): left out, 6 frames",
        ),
        (
            again(2, 5, redraw=encoded),
            "2 episodes repeat others: '2b' is '2', '5b' is '5' (same pictures and numbers): left out",
        ),
        (
            again(4, steps=5),
            "episode '4b' repeats episode '4' (same pictures and numbers): left out, 5",
        ),
    ],
)
def test_a_recording_that_is_there_twice_is_imported_once(
    tmp_path: Path, change: Callable[[Path, Rows], None], said: str
) -> None:
    """Also encoded otherwise, and a part of it; the bank is that of the log without it, and whole."""
    plain = log(tmp_path / "plain", lambda *_: None)
    bank = log(tmp_path / "twice", change)
    assert bank.manifest.fingerprint == plain.manifest.fingerprint
    assert [frame.id for frame in bank] == [frame.id for frame in plain]
    assert check(bank.root) == []
    assert not [*bank.root.rglob("again-*")]
    (line,) = repeated(bank)
    assert line.startswith(said)
    assert repeated(plain) == []
    assert not {"repeats", "keep_repeats"} & plain.manifest.settings.keys()


def test_a_repeat_that_is_told_otherwise_is_one_too_and_the_longer_one_is_kept(tmp_path: Path) -> None:
    """Whichever comes first."""

    def change(folder: Path, lines: Rows) -> None:
        again(3)(folder, lines)
        del lines[18]
        for line in lines[-6:]:
            line["task"] = "go there"

    bank = log(tmp_path, change)
    assert [frame.step for frame in bank if frame.episode == "3b"] == [*range(6)]
    assert not [frame for frame in bank if frame.episode == "3"]
    (said,) = repeated(bank)
    assert said.startswith("episode '3' repeats episode '3b' (same pictures and numbers, another instr")


def still(folder: Path, lines: Rows) -> None:
    """Make a log one of a robot that stands still and is filmed by cameras that see nothing else."""
    stops(*range(8))(folder, lines)
    for line in lines:
        shutil.copy(folder / lines[0]["front"], folder / line["side"])
        line.update(dict.fromkeys((name for name in line if name[-1] in "012"), "0.5"))


@pytest.mark.parametrize(
    "changes",
    [
        (still,),
        (forks,),
        (again(2, 5, redraw=lambda pixels: 255 - pixels),),
        (larger, again(2, 5, redraw=lambda pixels: moved(pixels[:6, :8]))),
        (again(2, 5, redraw=lambda pixels: pixels[:, :7]),),
    ],
)
def test_what_is_no_recording_twice_is_imported_whole(
    tmp_path: Path, changes: Sequence[Callable[[Path, Rows], None]]
) -> None:
    """A robot that stands still; the same numbers with other pictures, be it one small thing, or of another size."""

    def change(folder: Path, lines: Rows) -> None:
        for one in changes:
            one(folder, lines)

    bank = log(tmp_path, change)
    assert len(bank) == (48 if changes == (still,) else 60)
    assert repeated(bank) == []


def test_repeats_that_are_wanted_are_kept_with_a_warning(tmp_path: Path) -> None:
    """The bank says that they were asked for; without any it says nothing of them."""
    log(tmp_path, again(2, 5))
    words = ["frames", "import", tmp_path, "--table", tmp_path / "t.csv", "--rig", tmp_path / "rig.toml"]
    words += ["--prompt-columns", "task"]
    for keep, out, frames in ((["--keep-repeats"], "kept", 60), ([], "left", 48)):
        result = CliRunner().invoke(app, [str(one) for one in [*words, *keep, "--out", tmp_path / out]])
        assert result.exit_code == 0, result.output
        bank = open_bank(tmp_path / out)
        assert len(bank) == frames
        assert bank.manifest.settings.get("keep_repeats") is (True if keep else None)
        pairs = [(one["episode"], one["of"]) for one in bank.manifest.settings["repeats"]]  # type: ignore[attr-defined]
        assert pairs == [("2b", "2"), ("5b", "5")]
        (said,) = repeated(bank)
        assert said in result.stderr.splitlines()
        assert said.startswith("warning: 2 episodes repeat others: " if keep else "2 episodes repeat others: ")
        assert said.endswith(
            "kept, as --keep-repeats says, and counted twice" if keep else "--keep-repeats imports them"
        )


def test_the_time_that_repeats_take_goes_with_the_frames() -> None:
    """Also of a log whose episodes all have the same numbers and other pictures: few are looked at of each."""
    pictures = count()
    read = lambda _: encode(np.full((4, 4, 3), 40 * (next(pictures) % 6), np.uint8))  # noqa: E731
    camera, calls = alone("none"), 400
    frames = [
        Frame(f"{drive}-{step}", "all", str(drive), step, camera, {"main": "x"}, {}, {}, {}, {"state": (step + 0.5,)})
        for drive in range(calls)
        for step in range(5)
    ]
    assert repeats(frames, read) == []
    assert next(pictures) <= calls * 3 * 2
