"""What a driver is shown in a closed loop, condition by condition."""

from pathlib import Path

import numpy as np
import pytest

import tiny_worlds
from eyechart.conditions import OF_WORLDS, require_shown
from eyechart.episodes import EpisodeKey
from eyechart.episodes.worlds import POOL_SEEDS, EpisodeView, Setup, Worlds
from eyechart.errors import SpecError
from eyechart.frames import MAIN, RGB, alone, decode
from eyechart.spaces.space import Decision

GO = Decision("LEFT")


def pictures(condition: str, *, policy: str = "m", seed: int = 1, run: int = 0, steps: int = 4) -> list[RGB]:
    """Return what is shown at the first steps of an episode."""
    worlds, key = Worlds(Setup("tiny", run)), EpisodeKey(policy, "tiny", "whole", seed, condition)
    shown = [worlds.open(key)]
    shown += [worlds.act(key, GO) for _ in range(steps - 1)]
    worlds.close(key)
    return [decode(one.stimulus.images[MAIN], one.frame) for one in shown if isinstance(one, EpisodeView)]


def same(one: list[RGB], other: list[RGB]) -> bool:
    """Return whether two drives were shown the same."""
    return all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))


def test_real_blank_frozen_and_mirrored_are_what_they_say() -> None:
    """The camera's picture, mid-grey of its size, the first one for ever, and the flip across the mirror axis."""
    real = pictures("real")
    assert len({picture.tobytes() for picture in real}) == 4
    assert all((picture == 128).all() and picture.shape == real[0].shape for picture in pictures("blank"))
    assert same(pictures("frozen"), [real[0]] * 4)
    assert same(pictures("mirrored"), [picture[::-1] for picture in real])


def test_noise_and_shuffled_belong_to_the_moment_whoever_drives() -> None:
    """Another policy is shown the same, another seed of the run or another world something else."""
    for condition in ("noise", "shuffled"):
        shown = pictures(condition)
        assert len({picture.tobytes() for picture in shown}) > 1
        assert same(shown, pictures(condition, policy="another"))
        assert not same(shown, pictures(condition, run=1))
        assert not same(shown, pictures(condition, seed=2))


def test_shuffled_shows_moments_of_other_worlds_only() -> None:
    """Also where the episode is one of the worlds of the pool. The colour of a corridor's column is its seed."""
    for seed in (1, POOL_SEEDS[0]):
        columns = {int(picture[0].max(axis=0)[1]) for picture in pictures("shuffled", seed=seed, steps=8)}
        assert columns <= {other % 200 for other in POOL_SEEDS if other != seed}


def test_policies_are_shown_the_condition_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a policy that looks gets is what a model would get."""
    seen: list[RGB] = []

    class Looking:
        def decide(self, observation: object) -> Decision[str]:
            seen.append(observation.picture())  # type: ignore[attr-defined]
            return GO

    monkeypatch.setattr(tiny_worlds, "STEPS", 3)
    Worlds(Setup("tiny", 0)).drive(EpisodeKey("p", "tiny", "whole", 1, "shuffled"), Looking())
    assert same(seen, pictures("shuffled", steps=3))


def test_every_condition_is_known_by_name_and_an_axis_is_required() -> None:
    """An unknown one lists the known ones; without a mirror axis nothing can be mirrored."""
    for name in (*OF_WORLDS, "blank@main"):
        require_shown(name, alone("vertical"))
    known = "known are real, real_repeat, blank, noise, shuffled, text_only, mirrored, frozen"
    with pytest.raises(SpecError, match=known):
        require_shown("lead_near", alone("vertical"))
    with pytest.raises(SpecError, match="needs a simulator with a mirror axis"):
        require_shown("mirrored", alone("none"))
    with pytest.raises(SpecError, match=r"there is no camera '.*'; there are main"):
        require_shown("blank@wrist", alone("vertical"))


def test_a_moment_shows_the_highway_of_the_banks(tmp_path: Path) -> None:
    """The first picture of a real episode is the drive's own, byte for byte after decoding."""
    from eyechart.simulators import open_simulator  # noqa: PLC0415

    del tmp_path
    worlds, key = Worlds(Setup("highway", 0)), EpisodeKey("m", "highway", "merge", 2)
    shown = worlds.open(key)
    assert isinstance(shown, EpisodeView)
    assert np.array_equal(
        decode(shown.stimulus.images[MAIN], "x"), open_simulator("highway").drive("merge", 2).picture()
    )
