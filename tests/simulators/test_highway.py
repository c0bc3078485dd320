import json
import os
import subprocess
import sys
from collections import Counter, defaultdict
from itertools import combinations, pairwise
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from highway_env.vehicle.behavior import IDMVehicle
from scipy.stats import spearmanr

from eyechart.cameras import EGO_COLUMN, HEIGHT_PX, PX_PER_M
from eyechart.errors import BankError, SpecError
from eyechart.frames import Frame, FrameBank, check, decode, open_bank
from eyechart.perception.renderer import HighwayReading, read_picture
from eyechart.simulators import SIMULATORS, find_simulator, open_bank_simulator, open_simulator
from eyechart.simulators.highway import Highway
from eyechart.simulators.highway.counterfactuals import record
from eyechart.simulators.highway.drives import DRIVES, open_drive
from eyechart.simulators.highway.speedups import speedups
from eyechart.simulators.highway.staged_moments import _LANES, GAPS, STAGES, _set_up, drive_naturally
from eyechart.simulators.highway.truth import find_lead, read_truth
from eyechart.simulators.highway.world import StockCamera, World
from eyechart.simulators.plan import Lanes, make_plan, share, trend
from eyechart.spaces.scene import safe_action

pytestmark = pytest.mark.slow

SCENARIOS = ("light", "dense", "merge", "blocked")
DEFAULT = "the default bank"


@pytest.fixture(scope="session", params=[DEFAULT, "one long seed"])
def balanced(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a balanced bank: the default one, which is the demo's, and one of another seed and twice as many steps."""
    if request.param == DEFAULT:
        return open_bank(request.getfixturevalue("demo").bank)
    return Highway().build(tmp_path_factory.mktemp("balanced") / "bank", seeds=(41,), steps=24)


@pytest.fixture(scope="session")
def paper(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return the bank nearest to the published one."""
    return Highway().build(tmp_path_factory.mktemp("paper") / "bank", preset="paper")


def gap(frame: Frame) -> float:
    """Return a frame's gap in metres."""
    value = frame.truth["lead_gap_m"]
    assert isinstance(value, float)
    return value


def episodes(bank: FrameBank) -> dict[str, list[Frame]]:
    """Return a bank's frames by episode, in order."""
    result = defaultdict(list)
    for frame in bank:
        result[frame.episode].append(frame)
    return result


def pixels(bank: FrameBank, frame: Frame, counterfactual: str | None = None) -> npt.NDArray[np.uint8]:
    """Return a picture of a frame."""
    return decode(bank.image(frame, counterfactual), frame.id)


def read(bank: FrameBank, frame: Frame, counterfactual: str | None = None) -> HighwayReading:
    """Return what a picture of a frame shows to a reader that knows nothing else."""
    reading = read_picture(pixels(bank, frame, counterfactual))
    assert reading is not None
    return reading


# ---- the balanced bank


def test_every_scenario_has_near_middle_and_far_gaps(balanced: FrameBank) -> None:
    """Of each scenario's frames at least a sixth are nearer than 12 m, half between, and a tenth beyond 40 m."""
    for scenario in SCENARIOS:
        gaps = [gap(frame) for frame in balanced if frame.scenario == scenario]
        near, far = sum(each < 12 for each in gaps), sum(each > 40 for each in gaps)
        assert near >= len(gaps) / 6
        assert far >= len(gaps) / 10
        assert len(gaps) - near - far >= len(gaps) / 2


def test_some_leads_lie_beyond_the_pictures_edge(balanced: FrameBank) -> None:
    """A few leads cannot be seen; their gap is still true, and the demand is as if there were none."""
    unseen = [frame for frame in balanced if not frame.truth["lead_visible"]]
    assert 0 < len(unseen) < len(balanced) / 8
    for frame in unseen:
        assert gap(frame) > 76.4
        assert frame.truth["demand"] == "STRAIGHT"
        assert read(balanced, frame).scene.gap_m is None


def test_the_gap_has_no_trend_in_any_episode(balanced: FrameBank) -> None:
    """Spearman's correlation of step and gap, by scipy, is at most .2 in size."""
    for frames in episodes(balanced).values():
        assert abs(spearmanr([frame.step for frame in frames], [gap(frame) for frame in frames]).statistic) <= 0.2


def test_left_and_right_are_demanded_often_and_alike(balanced: FrameBank) -> None:
    """At least 24 frames ask for LEFT, as many for RIGHT, and every action is asked for in every scenario."""
    demands = Counter(frame.truth["demand"] for frame in balanced)
    assert demands["LEFT"] == demands["RIGHT"] >= 24
    asked = {(frame.scenario, frame.truth["demand"]) for frame in balanced}
    assert asked == {(scenario, action) for scenario in SCENARIOS for action in demands}
    assert len(demands) == 5


def test_no_balanced_frame_shows_a_crash(balanced: FrameBank) -> None:
    """No frame is marked, and no picture shows the red of a crash."""
    assert not any(frame.truth["crashed"] for frame in balanced)
    assert all(read(balanced, frame).ego_colour == "green" for frame in balanced)


def test_the_pictures_show_what_the_truth_says(balanced: FrameBank) -> None:
    """A reader of pixels alone finds gap (to 0.2 m), sides, lane and demand of every frame."""
    for frame in balanced:
        reading, truth = read(balanced, frame), frame.truth
        assert (reading.scene.left_clear, reading.scene.right_clear) == (truth["left_clear"], truth["right_clear"])
        assert (reading.lanes, reading.lane_from_left) == (truth["lanes"], truth["ego_lane"])
        assert safe_action(reading.scene) == truth["demand"]
        if truth["lead_visible"]:
            assert reading.scene.gap_m == pytest.approx(gap(frame), abs=0.2)


def test_a_scenario_can_be_told_by_its_road(balanced: FrameBank) -> None:
    """The number of lanes and the ramp are seen in every picture and differ between scenarios."""
    roads = {
        scenario: {
            (reading.lanes, reading.ramp)
            for frame in balanced
            if frame.scenario == scenario
            for reading in [read(balanced, frame)]
        }
        for scenario in SCENARIOS
    }
    assert roads == {"light": {(4, False)}, "dense": {(3, False)}, "merge": {(2, True)}, "blocked": {(5, False)}}


def test_the_lane_and_the_stripes_vary_within_a_scenario(balanced: FrameBank) -> None:
    """Every scenario shows the ego in several lanes, and at many phases of the dashed lines."""
    for scenario in SCENARIOS:
        frames = [frame for frame in balanced if frame.scenario == scenario]
        assert len({frame.truth["ego_lane"] for frame in frames}) == len(_LANES[scenario].ego)
        phases = {round(4 * float(str(frame.truth["ego_x_m"])) / 4.33) % 4 for frame in frames}
        assert len(phases) == 4


def test_a_counterfactual_lead_differs_from_the_picture_only_in_the_own_lane_ahead(balanced: FrameBank) -> None:
    """Moving the lead changes pixels between the lines of the own lane and before the ego, and no others.

    The nearest lead there can be stands bumper to bumper with the ego: its tyres stick out by half a metre.
    """
    half_lane, bumper, half_tyre = 2 * PX_PER_M, EGO_COLUMN + 2.5 * PX_PER_M, 0.5 * PX_PER_M
    for frame in balanced:
        real = pixels(balanced, frame)
        for name, least in (("lead_near", bumper - half_tyre - 1), ("lead_far", bumper)):
            rows, columns = np.nonzero((pixels(balanced, frame, name) != real).any(axis=2))
            assert rows.size
            assert np.abs(rows - HEIGHT_PX / 2).max() <= half_lane
            assert columns.min() >= least


def test_a_counterfactual_lead_stands_where_its_name_says(balanced: FrameBank) -> None:
    """A reader of pixels finds it at 5 m, bumper to bumper, or at 50 to 60 m with nothing between; sides unchanged."""
    for frame in balanced:
        sides = (frame.truth["left_clear"], frame.truth["right_clear"])
        for name, low, high in (("lead_near", 5, 5), ("lead_far", 50, 60)):
            scene = read(balanced, frame, name).scene
            assert scene.gap_m is not None
            assert low - 0.2 <= scene.gap_m <= high + 0.2
            assert (scene.left_clear, scene.right_clear) == sides


def test_recolouring_changes_the_egos_box_only(balanced: FrameBank) -> None:
    """The ego is red as after a crash, which the world has not had, and no pixel outside its body changes."""
    for frame in balanced:
        recoloured = pixels(balanced, frame, "recoloured")
        rows, columns = np.nonzero((recoloured != pixels(balanced, frame)).any(axis=2))
        assert rows.size > 200
        assert np.abs(columns - EGO_COLUMN).max() <= 2.5 * PX_PER_M + 1
        assert np.abs(rows - HEIGHT_PX / 2).max() <= PX_PER_M + 1
        assert read(balanced, frame, "recoloured").ego_colour == "red"


def test_a_bank_is_whole_and_named_as_promised(balanced: FrameBank) -> None:
    """Every file is what the manifest says; ids, files and the mirror axis follow one rule."""
    assert check(balanced.root) == []
    for frame in balanced:
        assert frame.id == f"{frame.episode}-{frame.step:02d}"
        assert frame.file == f"images/{frame.id}.png"
        assert {"lead_near", "lead_far", "recoloured"} <= frame.counterfactuals.keys()
        for name, files in frame.counterfactuals.items():
            assert files == {"main": f"counterfactuals/{frame.id}-{name}.png"}
        assert frame.mirror_axis == "vertical"
        assert pixels(balanced, frame).shape == (150, 600, 3)


# ---- staging and the plan


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_no_staged_vehicles_overlap(scenario: str) -> None:
    """Bodies of 5 × 2 m never touch, wherever the lead and the side vehicles are put."""
    world, rng = STAGES[scenario].open(5), np.random.default_rng(5)
    with speedups():
        instants = drive_naturally(world, 12)
    for number, wish in enumerate(make_plan(_LANES[scenario], GAPS, 12, rng)):
        _set_up(world, instants[number * len(instants) // 12], wish, still=False, rng=rng)
        for one, other in combinations(world.road.vehicles, 2):
            ahead, aside = np.abs(one.position - other.position)
            assert ahead > 5.5 or aside > 2.5


@pytest.mark.parametrize("steps", [*range(4, 26), 101])
def test_any_number_of_steps_is_planned_without_a_trend(steps: int) -> None:
    """From four steps on there are near, LEFT, RIGHT and far moments, and the gap's trend is at most .2."""
    rng = np.random.default_rng(steps)
    counts = share(steps, rng)
    assert sum(counts.values()) == steps
    assert min(counts[kind] for kind in ("near", "left", "right", "far")) >= 1
    assert abs(counts["left"] - counts["right"]) <= 1
    gaps = [wish.gap_m for wish in make_plan(Lanes(4, (1, 2)), GAPS, steps, rng)]
    assert len(gaps) == steps
    assert abs(spearmanr(range(steps), gaps).statistic) <= 0.2


def test_the_trend_is_spearmans() -> None:
    """The plan's own correlation is scipy's."""
    gaps = np.random.default_rng(1).uniform(5, 100, 17)
    assert trend(gaps) == pytest.approx(spearmanr(range(17), gaps).statistic)


def test_sides_and_lanes_are_drawn_without_regard_to_the_gap() -> None:
    """Over 400 episodes, near, middle and far gaps have the same sides and the same lanes equally often."""
    shares: dict[str, list[tuple[float, float, float]]] = defaultdict(list)
    for seed in range(400):
        for wish in make_plan(_LANES["dense"], GAPS, 12, np.random.default_rng(seed)):
            kind = "near" if wish.gap_m < 12 else "far" if wish.gap_m > 40 else "middle"
            shares[kind].append((wish.sides[0], wish.sides[1], wish.lane))
    means = {kind: np.mean(rows, axis=0) for kind, rows in shares.items()}
    for one, other in combinations(means.values(), 2):
        np.testing.assert_allclose(one, other, atol=0.06)


# ---- the paper's bank


def test_the_paper_bank_reaches_the_published_numbers(paper: FrameBank) -> None:
    """As measured: 76 of 144 frames nearer than 18 m (published 81) and 61 in contact at 5.0 m (published 57)."""
    gaps = [gap(frame) for frame in paper]
    assert len(gaps) == 144
    assert sum(each < 18 for each in gaps) == 76
    assert sum(each < 5.05 for each in gaps) == 61


def test_paper_frames_after_a_crash_are_marked_and_have_no_counterfactuals(paper: FrameBank) -> None:
    """A crash ends neither the episode nor the mark; the ego is red there, and nothing is drawn beside."""
    crashed = [frame for frame in paper if frame.truth["crashed"]]
    assert len(crashed) == 61
    for frame in crashed:
        assert dict(frame.counterfactuals) == {}
        assert read(paper, frame).ego_colour == "red"
    for frames in episodes(paper).values():
        assert not any(before.truth["crashed"] and not after.truth["crashed"] for before, after in pairwise(frames))


def test_paper_frames_before_a_crash_can_be_recoloured_and_most_leads_moved(paper: FrameBank) -> None:
    """Where there was no crash the ego is recoloured, and a counterfactual lead stands where its name says."""
    drawn: Counter[str] = Counter()
    for frame in paper:
        if frame.truth["crashed"]:
            continue
        drawn.update(list(frame.counterfactuals))
        for name, low, high in (("lead_near", 7, 9), ("lead_far", 50, 60)):
            if name in frame.counterfactuals:
                found = read(paper, frame, name).scene.gap_m
                assert found is not None
                assert low - 0.2 <= found <= high + 0.2
    assert drawn["recoloured"] == 83
    assert min(drawn["lead_near"], drawn["lead_far"]) > 60


def meet(world: World, *others: tuple[float, float]) -> None:
    """Leave on the road the ego and vehicles at these distances ahead and aside, in metres."""
    ego = world.vehicle
    places = [[ego.position[0] + ahead, ego.position[1] + aside] for ahead, aside in others]
    world.road.vehicles = [ego, *(IDMVehicle(world.road, place) for place in places)]


@pytest.mark.parametrize(
    ("others", "drawn"),
    [
        (((30.0, 0.0),), {"lead_near", "lead_far", "recoloured"}),
        (((30.0, 0.0), (45.0, 0.0)), {"lead_near", "recoloured"}),
        (((30.0, 0.0), (10.0, 2.2)), {"lead_far", "recoloured"}),
        (((90.0, 0.0),), {"lead_near", "lead_far", "recoloured"}),
        (((20.0, 4.0),), {"recoloured"}),
        ((), {"recoloured"}),
    ],
)
def test_a_lead_is_moved_only_along_a_free_way(others: tuple[tuple[float, float], ...], drawn: set[str]) -> None:
    """It jumps over nobody and into nobody; where there is no lead, none is invented."""
    world = open_drive("light", 0)
    meet(world, *others)
    before = [vehicle.position.tolist() for vehicle in world.road.vehicles]
    moment = record(world, StockCamera(world), np.random.default_rng(0))
    assert set(moment.counterfactuals) == drawn
    assert [vehicle.position.tolist() for vehicle in world.road.vehicles] == before
    assert getattr(world.vehicle, "color", None) is None


# ---- truth


@pytest.mark.parametrize(
    ("others", "truth"),
    [
        ((), {"lead_gap_m": None, "lead_visible": False, "demand": "STRAIGHT"}),
        (((80.0, 0.0),), {"lead_gap_m": 80.0, "lead_visible": False, "demand": "STRAIGHT"}),
        (((76.0, 0.0),), {"lead_gap_m": 76.0, "lead_visible": True, "demand": "STRAIGHT"}),
        (((30.0, 1.9), (20.0, 2.1), (-9.0, 0.0)), {"lead_gap_m": 30.0, "right_clear": False, "left_clear": True}),
        (((30.0, 0.0), (-11.9, -4.0)), {"left_clear": False, "right_clear": True, "demand": "RIGHT"}),
        (((30.0, 0.0), (-12.1, -4.0), (40.1, 4.0)), {"left_clear": True, "right_clear": True, "demand": "SLOW"}),
        (((30.0, 0.0), (39.9, 4.0)), {"left_clear": True, "right_clear": False, "demand": "LEFT"}),
        (((11.0, 0.0), (20.0, 4.0)), {"demand": "STOP", "vehicles_in_view": 2, "crashed": False}),
    ],
)
def test_truth_is_read_from_the_geometry(others: tuple[tuple[float, float], ...], truth: dict[str, object]) -> None:
    """Lead, sides, demand and what is in view follow from where the vehicles are, by their stated bounds."""
    world = open_drive("light", 1)
    world.vehicle.position = np.array([300.0, 4.0])
    world.vehicle.on_state_update()
    meet(world, *others)
    found = read_truth(world)
    assert (found["ego_lane"], found["lanes"], found["ego_x_m"]) == (1, 3, 300.0)
    assert {name: found[name] for name in truth} == pytest.approx(truth)
    assert (find_lead(world) is None) == (found["lead_gap_m"] is None)


def test_a_lane_that_does_not_exist_is_not_clear() -> None:
    """In the outermost lane of an empty road only the inner side is clear."""
    world = open_drive("light", 1)
    for y, sides in ((0.0, (False, True)), (4.0, (True, True)), (8.0, (True, False))):
        world.vehicle.position = np.array([300.0, y])
        world.vehicle.on_state_update()
        meet(world)
        found = read_truth(world)
        assert (found["left_clear"], found["right_clear"]) == sides


# ---- the camera


@pytest.mark.parametrize("scenario", list(DRIVES))
def test_the_picture_is_highway_envs_own(scenario: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a viewer, and with a dummy video driver too, every pixel is that of ``env.render()``."""
    world = open_drive(scenario, 0)
    world.step(1)
    world.render_mode = "rgb_array"
    stock = world.render()
    assert len(np.unique(stock)) > 5
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    camera = StockCamera(world)
    np.testing.assert_array_equal(camera.draw(), stock)
    monkeypatch.delenv("SDL_VIDEODRIVER")
    world.enable_auto_render = False
    world.step(1)
    np.testing.assert_array_equal(camera.draw(), world.render())


# ---- building


def small(out: Path, **changes: Any) -> FrameBank:  # noqa: ANN401  (any of build's arguments)
    """Build the smallest bank."""
    return Highway().build(out, **{"seeds": (3,), "steps": 4, **changes})


@pytest.mark.parametrize("preset", list(Highway.declared.presets))
def test_a_bank_is_the_same_in_every_process(tmp_path: Path, preset: str) -> None:
    """Geometry and pictures are equal here, again, and in a process that hashes strings otherwise."""
    here = small(tmp_path / "here", preset=preset).manifest
    again = small(tmp_path / "again", preset=preset).manifest
    code = (
        "import sys; from pathlib import Path; from eyechart.simulators import open_bank_simulator, open_simulator; "
        "open_simulator('highway').build(Path(sys.argv[1]), preset=sys.argv[2], seeds=(3,), steps=4)"
    )
    command = [sys.executable, "-c", code, str(tmp_path / "there"), preset]
    subprocess.run(command, check=True, env={**os.environ, "PYTHONHASHSEED": "12345"})
    there = json.loads((tmp_path / "there" / "manifest.json").read_text(encoding="utf-8"))
    assert here.fingerprint == again.fingerprint == there["fingerprint"]
    assert dict(here.images) == dict(again.images) == there["images"]


def test_an_episode_does_not_depend_on_the_others(tmp_path: Path) -> None:
    """The frames of a seed are the same whichever seeds stand beside it; another seed gives other frames."""
    alone = small(tmp_path / "alone").manifest.geometry
    beside = small(tmp_path / "beside", seeds=(9, 3)).manifest.geometry
    assert {name: digest for name, digest in beside.items() if "-3-" in name} == dict(alone)
    assert len(set(beside.values())) == len(beside) == 32


def test_building_leaves_numpys_global_random_state_alone(tmp_path: Path) -> None:
    """No draw is taken from the generator that the whole process shares."""
    before = np.random.get_state(legacy=False)  # noqa: NPY002  (it is this state that must not move)
    small(tmp_path / "bank")
    after = np.random.get_state(legacy=False)  # noqa: NPY002
    assert repr(before) == repr(after)


def test_progress_is_told_frame_by_frame(tmp_path: Path) -> None:
    """Each frame is counted once, of the bank's total."""
    told: list[tuple[int, int]] = []
    bank = small(tmp_path / "bank", progress=lambda done, total: told.append((done, total)))
    assert told == [(done, 16) for done in range(1, len(bank) + 1)]


def test_an_interrupted_bank_leaves_nothing(tmp_path: Path) -> None:
    """When the user stops it half-way, neither the bank nor a part of it stays on disk."""

    def stop(done: int, _total: int) -> None:
        if done == 6:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        small(tmp_path / "bank", progress=stop)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"steps": 3}, "an episode needs 4 steps or more to contain every kind of moment, not 3"),
        ({"seeds": (1, -2)}, "seed -2 is out of range; give seeds from 0 to 9223372036854775807"),
        ({"seeds": (2**63,)}, "seed 9223372036854775808 is out of range; give seeds from 0 to 9223372036854775807"),
        ({"seeds": (4, 4)}, "seed 4 is given twice; each seed is an episode of its own"),
        ({"seeds": ()}, "a bank needs at least one seed"),
        ({"preset": "ideal"}, "simulator 'highway' has no preset 'ideal'; known: balanced, paper"),
    ],
)
def test_a_bank_that_cannot_be_is_refused_in_words(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    """Nothing is written, and the error names what is wrong and what to do."""
    with pytest.raises(SpecError) as error:
        small(tmp_path / "bank", **changes)
    assert str(error.value) == message
    assert list(tmp_path.iterdir()) == []


def test_the_largest_seed_works(tmp_path: Path) -> None:
    """The bound that the message names can be reached."""
    assert len(small(tmp_path / "bank", seeds=(2**63 - 1,))) == 16


def test_a_place_that_is_taken_is_refused_before_anything_is_drawn(tmp_path: Path) -> None:
    """A folder with something in it is not overwritten."""
    (tmp_path / "mine.txt").write_text("mine", encoding="utf-8")
    with pytest.raises(BankError, match="exists already"):
        small(tmp_path, progress=lambda _done, _total: pytest.fail("a frame was drawn"))


# ---- the registry


@pytest.mark.parametrize("name", list(SIMULATORS))
def test_every_simulator_opens_with_sentences_on_its_presets(name: str) -> None:
    """Each entry of the registry leads to a simulator of that name, with described presets or words on why none."""
    declared = find_simulator(name).declared
    if declared.scenarios:
        assert open_simulator(name).declared.name == name
    else:
        with pytest.raises(SpecError, match=f"simulator '{name}' only makes banks"):
            open_simulator(name)
    if not declared.presets:
        with pytest.raises(SpecError, match=f"simulator '{name}' makes no banks: {declared.no_banks}"):
            open_bank_simulator(name)
        return
    presets = open_bank_simulator(name).declared.presets
    assert "balanced" in presets
    assert all(sentence.endswith(".") for sentence in presets.values())


def test_an_unknown_simulator_is_refused_with_the_known_ones() -> None:
    """The error lists what could have been meant."""
    with pytest.raises(SpecError) as error:
        open_simulator("motorway")
    assert str(error.value) == f"unknown simulator 'motorway'; known: {', '.join(SIMULATORS)}, gym:ENV_ID"


def test_asking_for_presets_does_not_import_highway_env() -> None:
    """Listing the simulators stays quick: the second that highway-env takes is spent when a bank is built."""
    code = (
        "import sys; from eyechart.simulators import open_bank_simulator as door; door('highway').declared.presets; "
        "sys.exit('highway_env' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
