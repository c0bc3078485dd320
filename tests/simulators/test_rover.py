import json
import math
import os
import subprocess
import sys
from collections import Counter, defaultdict
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import spearmanr

from eyechart.cameras import ROVER
from eyechart.errors import SpecError
from eyechart.frames import FrameBank, check, decode
from eyechart.models.scripted import CONTROLLERS, PLANNERS, Controller
from eyechart.perception.forward import ForwardReading, read_forward
from eyechart.prompts import FORWARD_PROMPTS
from eyechart.simulators.road.layout import FAMILIES, GOAL_M, TRACKS_M, Layout, Obstacle, make_layout
from eyechart.simulators.road.staged_moments import FAR_M, NEAR_M
from eyechart.simulators.road.truth import read_truth, unseen_sides
from eyechart.simulators.road.world import camera_of, draw
from eyechart.simulators.rover import Rover
from eyechart.simulators.rover.world import (
    INNER_S,
    INTENTS,
    RADIUS_M,
    WHEELBASE_M,
    RoverState,
    RoverWorld,
    advance,
    decide,
    start,
)
from eyechart.spaces.discrete import DRIVING
from eyechart.spaces.scene import safe_action
from eyechart.studies import battery
from eyechart.verdicts import judge

EMPTY = Layout("single", ())


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a bank of the default length and two seeds in place of three, for the tests' time."""
    return Rover().build(tmp_path_factory.mktemp("rover") / "bank", seeds=(0, 1))


def world_of(*obstacles: tuple[float, float], y: float = 0.0, track: int = 1) -> RoverWorld:
    """Return a rover at the beginning of a road with obstacles of radius 0.6 m at these places."""
    placed = tuple(Obstacle(x, across, 0.6, 1.0, 0) for x, across in obstacles)
    return RoverWorld(Layout("single", placed), RoverState(0.0, y, 0.0, 1.0), track)


# ---- the plant


def test_the_plant_drives_the_circle_of_its_steering_angle() -> None:
    """At a constant angle the rear axle's middle stays on a circle of radius wheelbase over tangent."""
    angle, state = 0.2, RoverState(0.0, 0.0, 0.0, 3.0)
    radius = WHEELBASE_M / math.tan(angle)
    for _ in range(400):
        state = advance(state, 0.0, angle, 0.05)
        assert math.hypot(state.x, state.y - radius) == pytest.approx(radius, rel=1e-3)


def test_the_plant_accelerates_evenly_and_never_goes_backwards() -> None:
    """Speed and way are those of uniform acceleration; braking ends at a standstill; limits hold."""
    state = RoverState(0.0, 0.0, 0.0, 1.0)
    for _ in range(20):
        state = advance(state, 1.5, 0.0, 0.05)
    assert (state.x, state.speed) == pytest.approx((1.75, 2.5))
    assert advance(RoverState(0, 0, 0, 1.0), -99.0, 0.0, 0.1).speed == pytest.approx(0.5)
    assert advance(RoverState(0, 0, 0, 0.1), -99.0, 0.0, 0.1).speed == 0.0
    assert advance(state, 0.0, 9.0, 0.05) == advance(state, 0.0, 0.5, 0.05)


# ---- drives


@pytest.mark.parametrize(
    ("action", "speed", "y"),
    [("STOP", 0.0, 0.0), ("SLOW", 2.5, 0.0), ("STRAIGHT", 4.5, 0.0), ("LEFT", 4.0, 2.0), ("RIGHT", 4.0, -2.0)],
)
def test_an_action_leads_to_its_speed_and_its_track(action: str, speed: float, y: float) -> None:
    """Within four decisions, without overshooting by more than 2 cm, and it is held; LEFT is to the driver's left."""
    world, highest = start(EMPTY), 0.0
    for _ in range(6):
        world = decide(world, action)
        highest = max(highest, abs(world.state.y))
    assert (world.state.speed, world.state.y) == pytest.approx((speed, y), abs=0.05)
    assert highest < abs(y) + 0.02


def test_braking_and_going_straight_keep_the_track_that_was_asked_for() -> None:
    """One LEFT is one track; then STRAIGHT stays there, and RIGHT comes back."""
    world = decide(start(EMPTY), "LEFT")
    for _ in range(4):
        world = decide(world, "STRAIGHT")
    assert world.state.y == pytest.approx(2.0, abs=0.05)
    world = decide(decide(decide(world, "RIGHT"), "SLOW"), "SLOW")
    assert world.state.y == pytest.approx(0.0, abs=0.1)


@pytest.mark.parametrize(
    ("ahead_m", "sides"), [(-1.5, ""), (-1.0, "left"), (0.0, "left"), (0.9, "left"), (1.3, ""), (6.0, "")]
)
def test_what_stands_beside_a_forward_camera_closes_a_side_and_is_not_in_its_picture(
    ahead_m: float, sides: str
) -> None:
    """Truth counts it, no picture shows it; a reader of the picture says of an unseen side that it is clear."""
    world = world_of((ahead_m, 2.0))
    assert unseen_sides(world) == frozenset(sides.split())
    assert unseen_sides(world.mirrored()) == frozenset(sides.replace("left", "right").split())
    reading = read_forward(draw(world), ROVER)
    assert reading is not None
    assert reading.scene.left_clear == (bool(sides) or bool(read_truth(world)["left_clear"]))


def test_stop_brings_the_fastest_rover_to_rest_before_a_near_obstacle() -> None:
    """From full speed within the distance at which the safety policy demands it, with room to spare."""
    for gap_m in (ROVER.distances.stop_m, 4.0, 3.0):
        world = world_of((gap_m + 0.6, 0.0))
        world = RoverWorld(world.layout, RoverState(0.0, 0.0, 0.0, INTENTS["STRAIGHT"].speed))
        assert read_truth(world)["lead_gap_m"] == pytest.approx(gap_m)
        for _ in range(3):
            world = decide(world, "STOP")
        assert world.state.speed == 0.0
        assert not world.crashed


def drive(scenario: str, seed: int, actions: list[str], *, mirrored: bool = False) -> list[object]:
    """Return everything that a drive shows: moves, truths, states, the pictures of three moments."""
    under_way, seen = Rover().drive(scenario, seed, mirrored=mirrored), []
    for number, action in enumerate(actions):
        moved = under_way.step(action)
        world = under_way.world
        seen.append((moved, under_way.picture() if number < 3 else None, world.state, under_way.truth()))
        if moved.ended is not None:
            break
    return seen


@pytest.mark.parametrize("scenario", list(FAMILIES))
def test_a_mirrored_world_with_mirrored_actions_gives_the_mirrored_drive(scenario: str) -> None:
    """States to the bit, pictures flipped, truths exchanged, over random actions in four worlds."""
    for seed in range(4):
        actions = np.random.default_rng(seed).choice(DRIVING.actions, 40, p=[0.05, 0.25, 0.3, 0.2, 0.2]).tolist()
        one = drive(scenario, seed, actions)
        other = drive(scenario, seed, [DRIVING.reflect(action) for action in actions], mirrored=True)
        assert len(one) == len(other)
        for (moved, picture, state, truth), (moved_m, picture_m, state_m, truth_m) in zip(one, other, strict=True):
            assert moved == moved_m
            assert state_m == state.mirrored()
            assert (truth["left_clear"], truth["lead_gap_m"]) == (truth_m["right_clear"], truth_m["lead_gap_m"])
            assert DRIVING.reflect(truth["demand"]) == truth_m["demand"]
            if picture is not None:
                np.testing.assert_array_equal(picture_m, picture[:, ::-1])


def test_a_hundred_mirrored_worlds_render_to_the_flipped_picture() -> None:
    """To the bit, at a random moment of a random drive in each of 100 worlds."""
    rng = np.random.default_rng(7)
    scenes = [(family, seed) for seed in range(-(-100 // len(FAMILIES))) for family in FAMILIES][:100]
    for family, seed in scenes:
        one, other = Rover().drive(family, seed), Rover().drive(family, seed, mirrored=True)
        for action in rng.choice(DRIVING.actions, int(rng.integers(10)), p=[0.05, 0.25, 0.3, 0.2, 0.2]).tolist():
            other.step(DRIVING.reflect(action))
            if one.step(action).ended is not None:
                break
        np.testing.assert_array_equal(other.picture(), one.picture()[:, ::-1])
    assert len(scenes) == 100


def test_equal_worlds_and_actions_give_equal_drives_and_states() -> None:
    """Bytes of the state are equal here and in a process that hashes strings otherwise; asking changes nothing."""
    code = (
        "from eyechart.simulators import open_simulator; d = open_simulator('rover').drive('clutter', 5)\n"
        "for a in ('STRAIGHT', 'LEFT', 'SLOW'): d.step(a)\n"
        "print(d.state().hex())"
    )
    under_way = Rover().drive("clutter", 5)
    for action in ("STRAIGHT", "LEFT", "SLOW"):
        under_way.picture(), under_way.truth(), under_way.state()
        under_way.step(action)
    environment = {**os.environ, "PYTHONHASHSEED": "12345"}
    there = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment)
    assert there.stdout.strip() == under_way.state().hex()


def careful(truth: dict[str, object]) -> str:
    """Return what a driver with perfect eyes does who takes the left of two free sides."""
    if truth["demand"] != "SLOW":
        return str(truth["demand"])
    return "LEFT" if truth["left_clear"] else "SLOW"


def test_a_driver_with_eyes_reaches_the_goal_and_one_without_does_not() -> None:
    """By the truth 28 of 40 worlds or more are finished without a crash; STRAIGHT alone crashes; STOP stays."""
    ended = defaultdict(Counter)
    for scenario in FAMILIES:
        for seed in range(8):
            for name in ("careful", "STRAIGHT", "STOP"):
                under_way = Rover().drive(scenario, seed)
                moved = None
                while moved is None or moved.ended is None:
                    moved = under_way.step(careful(dict(under_way.truth())) if name == "careful" else name)
                ended[name][moved.ended] += 1
                assert moved.crashed == (moved.ended == "crash")
                assert (moved.distance_m >= GOAL_M) == (moved.ended == "goal")
    assert ended["careful"]["goal"] >= 28
    assert ended["careful"]["crash"] == 0
    assert ended["STRAIGHT"] == {"crash": 40}
    assert ended["STOP"] == {"time": 40}


def test_rewards_are_the_way_made_and_a_crash_costs_ten() -> None:
    """At full speed a decision is worth one; after the end no step is possible."""
    under_way = Rover().drive("single", 0)
    rewards = []
    while not rewards or under_way.world.ended is None:
        rewards.append(under_way.step("STRAIGHT").reward)
    assert max(rewards) == pytest.approx(1.0)
    assert rewards[-1] == -10.0
    with pytest.raises(ValueError, match="this drive is over"):
        under_way.step("STOP")


def test_a_scenario_an_action_or_a_seed_that_is_none_is_refused() -> None:
    """In words that list what there is."""
    with pytest.raises(SpecError, match="simulator 'rover' has no scenario 'merge'; known: offset, single"):
        Rover().drive("merge", 0)
    with pytest.raises(SpecError, match="seed -1 is out of range"):
        Rover().drive("single", -1)
    with pytest.raises(ValueError, match="'BRAKE' is none of STOP, SLOW"):
        Rover().drive("single", 0).step("BRAKE")


# ---- layouts


@pytest.mark.parametrize("family", list(FAMILIES))
def test_a_layout_leaves_a_way_through_unless_a_wall_closes_it(family: str) -> None:
    """Wherever something stands, some track has room for the rover and its margin; a wall leaves less than a rover."""
    closed = 0
    for seed in range(60):
        layout = make_layout(family, seed)
        closed += layout.closed
        for obstacle in layout.obstacles:
            near = [other for other in layout.obstacles if abs(other.x - obstacle.x) < 3.0]
            room = [all(abs(o.y - track) > o.radius + ROVER.beside_m for o in near) for track in TRACKS_M]
            wall = layout.closed and obstacle.radius > 1.0
            assert any(room) != wall
            assert abs(obstacle.y) + obstacle.radius < ROVER.half_width_m
            assert obstacle.x < GOAL_M
            if wall:
                edges = sorted((o.y - o.radius, o.y + o.radius) for o in near)
                spaces = [low[0] - high[1] for high, low in pairwise(edges)]
                assert max(*spaces, edges[0][0] + 4.5, 4.5 - edges[-1][1]) < 2 * RADIUS_M
    assert 0 < closed < 15


# ---- truth


@pytest.mark.parametrize(
    ("world", "truth"),
    [
        (world_of(), {"lead_gap_m": None, "lead_visible": False, "demand": "STRAIGHT", "nearest_side": None}),
        (world_of((9.0, 0.0)), {"lead_gap_m": 8.4, "demand": "SLOW", "nearest_side": "centre", "track": 1}),
        (world_of((9.0, 1.34)), {"lead_gap_m": 8.4, "left_clear": False, "right_clear": True, "demand": "RIGHT"}),
        (world_of((9.0, 1.36)), {"lead_gap_m": None, "left_clear": False, "nearest_side": "left"}),
        (world_of((9.0, 0.0), (15.5, -2.0)), {"right_clear": False, "demand": "LEFT"}),
        (world_of((9.0, 0.0), (15.7, -2.0)), {"right_clear": True, "left_clear": True}),
        (world_of((-1.3, 2.0)), {"left_clear": False, "lead_gap_m": None}),
        (world_of((-1.4, 2.0)), {"left_clear": True}),
        (world_of((40.6, 0.0)), {"lead_gap_m": 40.0, "lead_visible": False, "demand": "STRAIGHT"}),
        (world_of((4.0, 0.0)), {"demand": "STOP"}),
        (
            world_of((9.0, 2.0), y=2.0, track=2),
            {"lead_gap_m": 8.4, "left_clear": False, "right_clear": True, "track": 0},
        ),
    ],
)
def test_truth_is_read_from_the_geometry(world: RoverWorld, truth: dict[str, object]) -> None:
    """Gap, sides, demand and side of the nearest obstacle, by their stated bounds; tracks count from the left."""
    found = read_truth(world)
    assert {name: found[name] for name in truth} == pytest.approx(truth)
    mirrored = read_truth(world.mirrored())
    assert mirrored["left_clear"] == found["right_clear"]
    assert mirrored["lead_gap_m"] == found["lead_gap_m"]


# ---- the bank


def read(bank: FrameBank, frame_id: str, counterfactual: str | None = None) -> ForwardReading:
    """Return what a picture of a frame shows to a reader that knows nothing else."""
    reading = read_forward(decode(bank.image(bank.frame(frame_id), counterfactual), frame_id), ROVER)
    assert reading is not None
    return reading


def test_the_pictures_show_what_the_truth_says(bank: FrameBank) -> None:
    """A reader of pixels alone finds gap (to 5 cm), sides, track, side of the nearest, family and demand everywhere."""
    errors = []
    for frame in bank:
        reading, truth = read(bank, frame.id), frame.truth
        assert (reading.scene.left_clear, reading.scene.right_clear) == (truth["left_clear"], truth["right_clear"])
        assert (2 - reading.track, reading.nearest_side) == (truth["track"], truth["nearest_side"])
        assert safe_action(reading.scene) == truth["demand"]
        assert reading.scenery == list(ROVER.verges)[list(FAMILIES).index(frame.scenario)]
        assert reading.stripe_phase is not None
        assert (reading.scene.gap_m is not None) == truth["lead_visible"]
        if truth["lead_visible"]:
            errors.append(abs(reading.scene.gap_m - truth["lead_gap_m"]))
    assert max(errors) < 0.05
    assert np.mean(errors) < 0.005


def test_left_and_right_are_demanded_often_and_alike_and_no_gap_follows_time(bank: FrameBank) -> None:
    """All five actions in every scenario, LEFT as often as RIGHT, and no trend of the gap in any episode."""
    demands = Counter(frame.truth["demand"] for frame in bank)
    assert demands["LEFT"] == demands["RIGHT"] >= 24
    assert {(frame.scenario, frame.truth["demand"]) for frame in bank} == {
        (scenario, action) for scenario in FAMILIES for action in DRIVING.actions
    }
    episodes = defaultdict(list)
    for frame in bank:
        episodes[frame.episode].append(frame.truth["lead_gap_m"])
    for gaps in episodes.values():
        assert abs(spearmanr(range(len(gaps)), gaps).statistic) <= 0.2
    assert not any(frame.truth["crashed"] for frame in bank)


def test_counterfactuals_move_the_lead_or_repaint_the_hood_and_nothing_else(bank: FrameBank) -> None:
    """Near and far leads stand where their names say on the own track; recolouring changes the hood's pixels only."""
    for frame in bank.frames[::3]:
        assert {"lead_near", "lead_far", "recoloured"} <= frame.counterfactuals.keys()
        real = decode(bank.image(frame), frame.id)
        for name, (low, high) in (("lead_near", (bank.manifest.span[0], NEAR_M[1])), ("lead_far", FAR_M)):
            gap_m = read(bank, frame.id, name).scene.gap_m
            assert gap_m is not None
            assert low - 0.1 <= gap_m <= high + 0.1
        repainted = decode(bank.image(frame, "recoloured"), frame.id)
        np.testing.assert_array_equal((repainted != real).any(axis=2), camera_of(frame.scenario, "rover").hood)
        assert read(bank, frame.id, "recoloured").ego_colour == "red"


@pytest.mark.slow
def test_a_bank_is_whole_declares_its_distances_and_is_the_same_in_every_process(
    bank: FrameBank, tmp_path: Path
) -> None:
    """The manifest says what counts as near, free and clear; another process builds the same geometry and pictures."""
    assert check(bank.root) == []
    assert bank.manifest.gap is not None
    assert (bank.manifest.gap.column, bank.manifest.gap.threshold) == ("lead_gap_m", 8.0)
    assert (bank.manifest.settings["stop_m"], bank.manifest.settings["free_m"]) == (5.0, 15.0)
    assert {frame.mirror_axis for frame in bank} == {"horizontal"}
    code = (
        "import sys; from pathlib import Path; from eyechart.simulators import open_simulator; "
        "open_simulator('rover').build(Path(sys.argv[1]), seeds=(3,), steps=4)"
    )
    environment = {**os.environ, "PYTHONHASHSEED": "12345"}
    subprocess.run([sys.executable, "-c", code, str(tmp_path / "there")], check=True, env=environment)
    here = Rover().build(tmp_path / "here", seeds=(3,), steps=4).manifest
    there = json.loads((tmp_path / "there" / "manifest.json").read_text(encoding="utf-8"))
    assert (here.fingerprint, dict(here.images)) == (there["fingerprint"], there["images"])


ON_EVERY_RUN = ("depth_lateral", "nuisance", "crash_colour", "scene_only")
"""Of the sixteen, those whose label hangs on what the reader sees; docs/simulators.md counts all of them."""

BLINDER = ("distance", "stopping")


def require_declared(bank: FrameBank, known: Mapping[str, Controller], out: Path) -> None:
    """Ask controllers about a bank; each gets its calibrated, lateral and paper label."""
    planned = battery.plan(bank.root, [f"scripted:{name}" for name in known], out)
    assert planned.plan.prompt == FORWARD_PROMPTS["baseline"]
    battery.run(planned, concurrency=8)
    verdicts = judge(battery.score(out, resamples=999))
    for name, controller in known.items():
        verdict, declared = verdicts[f"scripted:{name}"], controller.declared
        found = (verdict.paper.label, verdict.calibrated.label, verdict.lateral.label)
        assert found == (declared.paper, declared.calibrated, declared.lateral), name


@pytest.mark.slow
def test_known_answer_controllers_get_their_labels_on_forward_pictures(bank: FrameBank, tmp_path: Path) -> None:
    """With the horizontal flip as the mirror; so do the hierarchy's planners that see less than both sides."""
    known = {name: CONTROLLERS[name] for name in ON_EVERY_RUN}
    require_declared(bank, known | {name: PLANNERS[name] for name in BLINDER}, tmp_path / "run")


@pytest.mark.models
def test_the_planners_of_the_hierarchy_get_their_labels_on_the_default_bank(tmp_path: Path) -> None:
    """But for the one-sided one: it turns away instead of braking, in about a tenth of the comparisons, the limit."""
    known = {name: planner for name, planner in PLANNERS.items() if name != "left_side"}
    require_declared(Rover().build(tmp_path / "bank"), known, tmp_path / "run")


def test_the_planners_of_the_hierarchy_are_four_and_one_alone_sees_the_side() -> None:
    """One that goes round on the clear side, a one-sided one, one that brakes by distance, and one that stops."""
    deserved = {name: (planner.declared.calibrated, planner.declared.lateral) for name, planner in PLANNERS.items()}
    assert deserved == {
        "clear_side": (
            "content",
            "turns_clear",
        ),  # a blocked side makes it brake too: not its own lane's distance alone
        "left_side": ("depth", "one_sided"),
        "distance": ("depth", "no_power"),
        "stopping": ("image_invariant", "no_power"),
    }


def test_the_inner_loop_is_fine_enough_for_another_law() -> None:
    """A law in the place of the tracking law is asked every inner step, with state, intent and track."""
    asked: list[tuple[float, int]] = []

    def law(state: RoverState, intent: object, track: int) -> tuple[float, float]:
        assert intent is INTENTS["LEFT"]
        asked.append((state.x, track))
        return 0.0, 0.0

    decide(start(EMPTY), "LEFT", law)
    assert len(asked) == round(1.0 / INNER_S)
    assert {track for _, track in asked} == {2}
