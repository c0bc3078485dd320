"""Control pictures at distances of the whole range: highway, rover and drone show what they say, and nothing else."""

import hashlib
import json
import math
import shutil
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from eyechart.cameras import EGO_COLUMN, FORWARD, HEIGHT_PX, PX_PER_M
from eyechart.conditions import NUDGES, RANGED, is_available, is_nudged, show, sources
from eyechart.errors import BankError
from eyechart.frames import (
    APART,
    EXCHANGE,
    LEAD,
    MAIN,
    BankManifest,
    Frame,
    FrameBank,
    check,
    decode,
    draws_of,
    exchanged,
    open_bank,
)
from eyechart.perception.forward import read_forward
from eyechart.perception.renderer import read_picture
from eyechart.simulators import open_bank_simulator
from eyechart.simulators.banks import BOXED, DOZENS
from eyechart.simulators.highway import Highway
from eyechart.simulators.road import staged_moments
from eyechart.simulators.road.staged_moments import EXCHANGED_FAR_M
from eyechart.simulators.road.truth import find_lead, gap_to
from eyechart.simulators.road.world import AnyWorld, draw
from eyechart.simulators.rover import Rover
from eyechart.spaces.discrete import DRIVING
from eyechart.spaces.scene import Scene

DRAWN = tuple(name for name in RANGED if name not in NUDGES)
LOWEST_M = {"highway": 5.0, "rover": 1.7, "drone": 2.5}
HALF_LANE_PX, LANE_PX, CAR_M = 2 * PX_PER_M, 4 * PX_PER_M, 3.6


@pytest.fixture(scope="module", params=tuple(LOWEST_M))
def bank(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a bank of one seed."""
    return open_bank_simulator(request.param).build(tmp_path_factory.mktemp("ranged") / "bank", seeds=(5,))


def pixels(bank: FrameBank, frame: Frame, name: str | None = None) -> npt.NDArray[np.int16]:
    """Return a picture of a frame."""
    return decode(bank.image(frame, name), frame.id).astype(np.int16)


def read(bank: FrameBank, frame: Frame, name: str) -> Scene:
    """Return what a picture shows to a reader that knows nothing else."""
    picture, simulator = decode(bank.image(frame, name), frame.id), bank.manifest.simulator
    found = read_picture(picture) if simulator == "highway" else read_forward(picture, FORWARD[simulator])
    assert found is not None
    return found.scene


def metres(frame: Frame, name: str) -> float:
    """Return a distance of a frame."""
    value = frame.truth[name]
    assert isinstance(value, float)
    return value


def having(bank: FrameBank, name: str) -> list[Frame]:
    """Return the frames that have a picture."""
    return [frame for frame in bank if name in frame.counterfactuals]


def test_every_frame_has_them_with_their_distances_and_the_bank_is_whole(bank: FrameBank) -> None:
    """A few of the exchange cannot be shown; where a picture is, its distance is."""
    assert check(bank.root) == []
    assert bank.manifest.span == (LOWEST_M[bank.manifest.simulator], {"highway": 60.0}.get(bank.manifest.simulator, 27))
    assert len(having(bank, "lead_drawn")) == len(bank)
    assert len(having(bank, "exchange_own")) >= 0.95 * len(bank)
    for frame in bank:
        assert {name in frame.counterfactuals for name in DRAWN if name != "lead_drawn"} == {EXCHANGE in frame.truth}
        assert {LEAD, "lead_near_m", "lead_far_m"} <= frame.placed
        assert all(is_available(name, frame) == is_available(of, frame) for name, of in NUDGES.items())


def test_the_lead_alone_is_spread_evenly_over_all_that_can_be_shown(bank: FrameBank) -> None:
    """Each eighth of the range, in the logarithm, holds an eighth of the frames, one more or less."""
    assert bank.manifest.span is not None
    shares = np.histogram([metres(frame, LEAD) for frame in bank], np.geomspace(*bank.manifest.span, 9))[0]
    assert shares.sum() == len(bank)
    assert np.abs(shares - len(bank) / 8).max() <= 1


def test_the_two_distances_of_a_frame_are_a_factor_apart(bank: FrameBank) -> None:
    """And the exchange keeps away from both ends."""
    assert bank.manifest.span is not None
    low, high = exchanged(bank.manifest.span)
    for frame in having(bank, "exchange_own"):
        one, other = sorted((metres(frame, LEAD), metres(frame, EXCHANGE)))
        assert other >= APART * one
        assert low - 0.001 <= metres(frame, EXCHANGE) <= high + 0.001


def test_a_reader_of_pixels_finds_the_lead_where_the_bank_says(bank: FrameBank) -> None:
    """Drawn alone and in the exchange; also where its counterfactuals put it; far where the exchange says far."""
    far = {"highway": (50.0, 60.0)}.get(bank.manifest.simulator, EXCHANGED_FAR_M)
    for frame in bank:
        told = {"lead_drawn": LEAD, "exchange_own": EXCHANGE, "lead_near": "lead_near_m", "lead_far": "lead_far_m"}
        for name in told.keys() & frame.counterfactuals.keys():
            assert read(bank, frame, name).gap_m == pytest.approx(metres(frame, told[name]), abs=0.2, rel=0.03)
        for name in {"exchange_beside", "exchange_apart"} & frame.counterfactuals.keys():
            gap_m = read(bank, frame, name).gap_m
            assert gap_m is not None
            assert 0.96 * far[0] <= gap_m <= 1.04 * far[1]
        drawn = read(bank, frame, "lead_drawn")
        if bank.manifest.simulator == "highway":
            assert (drawn.left_clear, drawn.right_clear) == (frame.truth["left_clear"], frame.truth["right_clear"])


def test_on_the_highway_only_the_lead_and_one_vehicle_beside_move(tmp_path: Path) -> None:
    """Own and apart differ in the own lane alone, beside and apart in one lane beside, each at its two places."""
    bank = Highway().build(tmp_path / "bank", seeds=(5,), steps=6)
    for frame in having(bank, "exchange_own"):
        seen = {name: pixels(bank, frame, name) for name in DRAWN}
        own_m = metres(frame, EXCHANGE)
        for name, near_m, lanes in (
            ("exchange_own", own_m, ({0.0},)),
            ("exchange_beside", math.sqrt(own_m**2 - 16), ({1.0}, {-1.0})),
        ):
            rows, columns = np.nonzero((seen[name] != seen["exchange_apart"]).any(axis=2))
            assert set(np.round((rows - HEIGHT_PX / 2) / LANE_PX).tolist()) in lanes
            ahead = (columns - EGO_COLUMN) / PX_PER_M
            at_near, at_far = np.abs(ahead - near_m) < CAR_M, (ahead > 50 - CAR_M) & (ahead < 60 + CAR_M)
            assert (at_near | at_far).all()
            assert at_near.any()
            assert at_far.any()
        rows, _ = np.nonzero((seen["lead_drawn"] != pixels(bank, frame)).any(axis=2))
        assert np.abs(rows - HEIGHT_PX / 2).max(initial=0) <= HALF_LANE_PX


@pytest.mark.parametrize("simulator", ["rover", "drone"])
def test_on_the_road_only_the_lead_and_one_obstacle_beside_move(
    simulator: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both are alike and at one distance from the vehicle's middle; all else stands in every picture as it stood."""
    worlds: dict[bytes, AnyWorld] = {}

    def drawn(world: AnyWorld, *, red: bool = False) -> npt.NDArray[np.uint8]:
        picture = draw(world, red=red)
        worlds.setdefault(picture.tobytes(), world)
        return picture

    monkeypatch.setattr(staged_moments, "draw", drawn)
    bank = open_bank_simulator(simulator).build(tmp_path / "bank", seeds=(5,), steps=6)
    for frame in having(bank, "exchange_own"):
        names = ("exchange_own", "exchange_beside", "exchange_apart")
        made = [worlds[decode(bank.image(frame, name), name).tobytes()] for name in names]
        leads = [find_lead(world) for world in made]
        pairs = zip(made, leads, strict=True)
        others = [{obstacle for obstacle in world.layout.obstacles if obstacle is not lead} for world, lead in pairs]
        stay = set.intersection(*others)
        first, near, last = (list(one - stay) for one in others)
        assert (len(first), len(near), first) == (1, 1, last)
        before = set(worlds[decode(bank.image(frame), "real").tobytes()].layout.obstacles)
        assert stay <= before
        assert len(before - stay) <= 2
        own, far, apart = (gap_to(world, lead) for world, lead in zip(made, leads, strict=True) if lead is not None)
        assert (own, far) == (pytest.approx(metres(frame, EXCHANGE)), apart)
        state, lead = made[1].state, leads[0]
        assert lead is not None
        away = [math.hypot(one.x - state.x, one.y - state.y) for one in (near[0], lead)]
        assert away[0] == pytest.approx(away[1])
        assert (near[0].radius, near[0].height, near[0].paint) == (lead.radius, lead.height, lead.paint)


def test_a_nudge_is_one_pixel_by_one_level(bank: FrameBank) -> None:
    """Of its own picture, the same for every model, another for another run, and of the files of that picture."""
    for frame in bank.frames[:12]:
        for name, of in NUDGES.items():
            if is_available(name, frame):
                first = show(name, frame, bank, 7).images[MAIN]
                assert is_nudged(first, bank.image(frame, of))
                assert first == show(name, frame, bank, 7).images[MAIN]
                assert sources(name, frame, bank, 7) == tuple(frame.counterfactuals[of].values())
    assert not is_nudged(bank.image(bank.frames[0]), bank.image(bank.frames[0]))
    assert len({show("lead_drawn_nudged", bank.frames[0], bank, seed).images[MAIN] for seed in range(8)}) > 4


def test_a_bank_says_by_what_a_claim_may_be_asked(bank: FrameBank) -> None:
    """The colour of the lead, on the highway the lanes, beside the ground truth: the fingerprint does not hold them."""
    assert all(frame.strata.keys() == bank.manifest.strata[frame.id].keys() for frame in bank)
    colours = {(frame.scenario, frame.strata["lead_colour"]) for frame in bank}
    if bank.manifest.simulator == "highway":
        assert colours == {("light", "blue"), ("dense", "blue"), ("merge", "blue"), ("blocked", "yellow")}
        assert all(frame.strata["lanes"] == frame.truth["lanes"] for frame in bank)
    else:
        assert {colour for _, colour in colours} == {"orange", "magenta", "blue"}
    assert "lead_colour" not in bank.frames[0].truth


def spoiled(bank: FrameBank, to: Path, change: Mapping[str, object]) -> list[str]:
    """Return what is wrong with a copy of a bank in which a frame's distances are changed in the manifest."""
    shutil.copytree(bank.root, to)
    raw = json.loads((to / "manifest.json").read_text())
    kept = raw["controls"]["distances"][bank.frames[0].id]
    raw["controls"]["distances"][bank.frames[0].id] = {
        name: value for name, value in {**kept, **change}.items() if value is not None
    }
    (to / "manifest.json").write_text(json.dumps(raw))
    return check(to)


@pytest.mark.parametrize("name", DRAWN)
def test_a_changed_picture_is_found(name: str, tmp_path: Path) -> None:
    """By its digest, as every other."""
    bank = Rover().build(tmp_path / "bank", seeds=(3,), steps=4)
    frame = having(bank, name)[0]
    (bank.root / frame.counterfactuals[name][MAIN]).write_bytes(bank.image(frame))
    assert [frame.counterfactuals[name][MAIN] in line for line in check(bank.root)] == [True]


def test_the_distances_are_drawn_again_by_the_check(tmp_path: Path) -> None:
    """One that the seed does not draw, one that is missing, and one too many are named with their frame."""
    bank = Rover().build(tmp_path / "bank", seeds=(3,), steps=4)
    frame = bank.frames[0]
    assert {LEAD, EXCHANGE} <= frame.truth.keys()
    for number, (change, word) in enumerate(
        (
            ({LEAD: metres(frame, LEAD) + 0.001}, "does not draw"),
            ({EXCHANGE: metres(frame, EXCHANGE) * 1.2}, "does not draw"),
            ({LEAD: None}, "only one of"),
            ({EXCHANGE: None}, "only one of"),
        )
    ):
        found = spoiled(bank, tmp_path / str(number), change)
        assert found
        assert all(frame.id in line for line in found)
        assert any(word in line for line in found), found


def test_another_seed_draws_other_distances_and_the_same_draws_them_again() -> None:
    """A seed is of the bank; which frames there are decides who gets which share of the range."""
    ids = [f"f{place}" for place in range(40)]
    lists = [
        [next(draws_of(seed, (5.0, 60.0), frames)["f0"].lead()) for _ in range(2)]
        for seed, frames in ((0, ids), (1, ids), (0, ids[:20]))
    ]
    assert all(one == other for one, other in lists)
    assert len({one for one, _ in lists}) == 3
    for one in draws_of(4, (5.0, 60.0), ids).values():
        tried = list(one.exchange(17.0))
        assert len(tried) > 10
        assert all(max(m, 17.0) >= APART * min(m, 17.0) for m in tried)
    with pytest.raises(BankError, match="distances are drawn from"):
        BankManifest("boxes", "tiny", "boxes", DRIVING, None, span=(0.0, 3.0))


def test_a_sixth_of_the_moments_has_no_clear_side(bank: FrameBank) -> None:
    """And the lead is near at the lowest distance that can be shown; LEFT and RIGHT are asked for alike."""
    assert check(bank.root) == []
    assert bank.manifest.settings["staging"] == BOXED
    for episode in {frame.episode for frame in bank}:
        shut = [
            frame
            for frame in bank
            if frame.episode == episode and not (frame.truth["left_clear"] or frame.truth["right_clear"])
        ]
        assert len(shut) >= 2
    demands = [frame.truth["demand"] for frame in bank]
    assert demands.count("LEFT") == demands.count("RIGHT") > len(bank) / 5
    for frame in bank:
        lowest = LOWEST_M[bank.manifest.simulator]
        assert metres(frame, "lead_near_m") == lowest
        assert read(bank, frame, "lead_near").gap_m == pytest.approx(lowest, abs=0.1)


@pytest.mark.parametrize("simulator", LOWEST_M)
def test_the_presets_of_before_can_still_be_built(simulator: str, tmp_path: Path) -> None:
    """Where a build asks for the older version of the staging."""
    bank = open_bank_simulator(simulator).build(tmp_path / "bank", seeds=(5,), staging=DOZENS)
    assert bank.manifest.settings["staging"] == 2
    low, high = {"highway": (7.0, 9.0)}.get(bank.manifest.simulator, (2.6, 4.4))
    assert all(low <= metres(frame, "lead_near_m") <= high for frame in bank)


PINNED = {"rover": "1eba6e8f159723cf", "drone": "994f3e17a7f64853"}


@pytest.mark.parametrize("simulator", ["rover", "drone"])
def test_the_pictures_of_before_are_those_of_before(simulator: str, tmp_path: Path) -> None:
    """To the bit: the frames, their counterfactuals and the controls that there were, and the bank's fingerprint."""
    bank = open_bank_simulator(simulator).build(tmp_path / "bank", seeds=(3,), steps=4, staging=DOZENS)
    sums = hashlib.sha256(bank.manifest.fingerprint.encode())
    for frame in bank:
        for name in (None, *sorted(frame.counterfactuals.keys() - set(RANGED))):
            sums.update(decode(bank.image(frame, name), frame.id).tobytes())
    assert sums.hexdigest()[:16] == PINNED[simulator]


def test_the_papers_preset_has_none_of_this(tmp_path: Path) -> None:
    """Its bank is the one that it was."""
    paper = Highway().build(tmp_path / "bank", preset="paper", seeds=(0,), steps=4, staging=BOXED)
    assert (paper.manifest.span, paper.manifest.strata, paper.manifest.settings["staging"]) == (None, {}, 2)
    for frame in open_bank(paper.root):
        assert frame.counterfactuals.keys().isdisjoint(RANGED)
        assert frame.placed.isdisjoint({LEAD, EXCHANGE, "lead_near_m", "lead_far_m"})
