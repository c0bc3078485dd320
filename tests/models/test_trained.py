"""The trained policies: what ships is what is declared, they answer by numpy alone, and the demo finds them out."""

import asyncio
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from eyechart.calls import Query
from eyechart.cli.app import app
from eyechart.errors import SpecError
from eyechart.frames import Stimulus, encode
from eyechart.models import known_models, open_model, organisms_folder
from eyechart.models.trained import TRAINED
from eyechart.spaces.motion import Motion
from eyechart.verdicts.labels import CAMERA, INSTRUCTION, STATE

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def folder() -> Path:
    """Return where the weights lie."""
    return organisms_folder("this test") / "policies"


def test_each_ships_in_some_fifty_kilobytes(folder: Path) -> None:
    """One file a policy, in half precision, without anything pickled."""
    assert {path.stem for path in folder.glob("*.npz")} == set(TRAINED)
    for name in TRAINED:
        file = folder / f"{name}.npz"
        assert file.stat().st_size < 60_000
        with np.load(file, allow_pickle=False) as kept:
            assert {kept[one].dtype for one in kept.files} == {np.dtype(np.float16), np.dtype(np.float32)}
            assert sum(kept[one].size for one in kept.files) < 30_000


def test_each_declares_labels_that_there_are() -> None:
    """Of all three axes, and of single cameras where one follows from its training."""
    for one in TRAINED.values():
        assert one.camera in CAMERA
        assert one.state in STATE
        assert one.instruction in INSTRUCTION
        assert set(one.cameras.values()) <= set(CAMERA)


def asked(name: str, state: tuple[float, ...], told: str = "reach the red block") -> object:
    """Return what a trained policy answers to grey pictures."""
    grey = encode(np.full((32, 32, 3), 128, np.uint8))
    query = Query("", told, Stimulus({"top": grey, "wrist": grey}, {}, {"state": state}), 1)
    return asyncio.run(open_model(f"trained:{name}", answering="policy").answer(query))


def test_they_answer_with_a_motion_and_only_the_one_that_samples_differs() -> None:
    """Eight steps of three numbers; the same question twice."""
    for name, one in TRAINED.items():
        state = (0.2, 0.5, 0.0, 0.7, 0.7) if one.preset == "privileged" else (0.2, 0.5, 0.0)
        first, again = asked(name, state), asked(name, state)
        assert Motion.read(first.text).shape == (8, 3)
        assert (first.text == again.text) == (not one.samples)


def test_a_state_of_another_length_is_an_error_in_words() -> None:
    """A policy that was trained with a privileged state cannot do without."""
    reply = asked("privileged", (0.2, 0.5, 0.0))
    assert reply.error == "exception"
    assert "trained with 5 numbers of state, and got 3" in reply.error_detail


def test_no_torch_is_imported() -> None:
    """Numpy is enough."""
    program = (
        "import sys; from eyechart.models.trained import TRAINED, open_model\n"
        "from eyechart.modes import RequestMode\n"
        "open_model('sees', RequestMode('trained:sees')).act({c: __import__('numpy').zeros((32, 32, 3), 'u1') for c in "
        "('top', 'wrist')}, __import__('numpy').zeros(3), None)\n"
        "print('torch' in sys.modules)"
    )
    said = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True).stdout
    assert said == "False\n"


def test_they_are_listed_and_others_refused() -> None:
    """With what each was trained to do."""
    from eyechart.models import POLICIES  # noqa: PLC0415 - the registry is what is asked

    assert {f"trained:{name}" for name in TRAINED} <= set(known_models(POLICIES))
    with pytest.raises(SpecError, match="known are sees, privileged"):
        open_model("trained:nobody", answering="policy")
    with pytest.raises(SpecError, match="unknown model 'trained:sees'"):
        open_model("trained:sees")


def test_the_demo_finds_every_policy_as_it_was_trained(tmp_path: Path) -> None:
    """Six verdicts with their shares, beside what each was trained to do; a second call asks nothing more."""
    done = CliRunner().invoke(app, ["demo", "--policy", "--out", str(tmp_path / "demo")])
    assert done.exit_code == 0, done.output
    assert "6 of 6 policies got the labels that they were trained for." in done.stdout
    result = CliRunner().invoke(app, ["verdict", str(tmp_path / "demo" / "run-privileged-0"), "--json"])
    one = json.loads(result.stdout)["policies"]["trained:privileged"]
    assert (one["camera"], one["state"]) == ("ignores_camera", "state_shortcut")
    assert one["channels"]["cameras"]["n"] == 72
    again = CliRunner().invoke(app, ["demo", "--policy", "--out", str(tmp_path / "demo")])
    assert again.stdout == done.stdout
