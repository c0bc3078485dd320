"""A film as MP4, where PyAV is installed (extra film)."""

from pathlib import Path

import numpy as np
import pytest

from corridors import corridor_run, open_corridors
from eyechart.simulators import SIMULATORS
from eyechart.studies.closed_loop import read_drives
from eyechart.studies.closed_loop.film import write_film
from eyechart.studies.closed_loop.replay import find_episode

pytestmark = pytest.mark.models


def test_an_mp4_plays_every_moment_in_order(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Seven pictures come back out of it, each lighter than the one before, as the corridor draws them."""
    import av  # noqa: PLC0415 - an extra

    monkeypatch.setitem(SIMULATORS, "corridor", f"{open_corridors.__module__}:open_corridors")
    run = corridor_run(tmp_path / "run")
    drives, found = find_episode(read_drives([run]), "constant:SLOW corridor/light/1 real")
    assert write_film(drives, found, tmp_path / "film.mp4", fps=4) == 7
    with av.open(str(tmp_path / "film.mp4")) as opened:
        assert opened.streams.video[0].average_rate == 4
        light = [float(np.mean(frame.to_ndarray(format="rgb24")[20:60])) for frame in opened.decode(video=0)]
    assert len(light) == 7
    assert light == sorted(light)
