"""Real weights that plan by the rover's camera, under the controller that knows nothing of the obstacles."""

import contextlib
import io
import sys
from pathlib import Path

import pytest

from eyechart import cli
from eyechart.studies.closed_loop import outcomes_of, read_drives

pytestmark = [pytest.mark.models, pytest.mark.filterwarnings("ignore")]

WORLDS = ("--scenarios", "offset,gate", "--seeds", "3")
"""Two families in which one side is taken: whoever does not look meets an obstacle there."""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Let the organism drive six worlds with real pictures and the same six with mirrored ones."""
    out = tmp_path_factory.mktemp("planning") / "drives"
    words = ["run", "closed-loop", "--simulator", "rover-mpc-lateral", "--policy", "hf:organism:rover", *WORLDS]
    words += ["--condition", "real", "--condition", "mirrored", "--concurrency", "12", "--out", str(out)]
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(io.StringIO()):
        patch.setattr(sys, "argv", ["eyechart", *words])
        with pytest.raises(SystemExit) as left:
            cli.main()
    assert left.value.code == 0
    return out


def test_its_driving_depends_on_its_eyes(run: Path) -> None:
    """It gets farther with real pictures than mirrored, in worlds that only a look at the side can get through."""
    drives = {drive.driver.condition: drive for drive in read_drives([run]) if drive.driver.policy.startswith("hf:")}
    reached = {
        condition: sum(map(outcomes_of(list(drives.values())).is_success, drive.episodes))
        for condition, drive in drives.items()
    }
    metres = {condition: sum(episode.distance_m for episode in drives[condition].episodes) for condition in drives}
    assert reached["real"] > reached["mirrored"] == 0
    assert metres["real"] > 1.3 * metres["mirrored"]


def test_every_reply_of_every_drive_is_an_action(run: Path) -> None:
    """No fail-safe is executed for it, and it names each of the actions that its worlds ask for."""
    for drive in read_drives([run]):
        said = [step.decision.action for step in drive.steps]
        assert {"LEFT", "RIGHT", "STRAIGHT"} <= set(said) <= {"LEFT", "RIGHT", "STRAIGHT", "SLOW", "STOP"}
