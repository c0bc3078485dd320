"""What is said where the distribution of the organisms is not installed, and what goes on without it."""

import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

import eyechart_organisms
from eyechart.cli.app import app
from eyechart.errors import SpecError
from eyechart.models import known_models, open_model
from eyechart.models.huggingface import organisms
from eyechart.models.huggingface.checkpoint import digest

BARE = "pip install 'eyechart[organisms]' (in a checkout: pip install ./organisms)"
WITH = "pip install 'eyechart[organisms,transformers]' (in a checkout: pip install '.[transformers]' ./organisms)"


@pytest.fixture
def absent(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have the import of the package fail."""
    monkeypatch.setitem(sys.modules, "eyechart_organisms", None)


@pytest.mark.usefixtures("absent")
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("demo", "--vlm"), f"'hf:organism:grounded' needs eyechart-organisms: {WITH}"),
        (("demo", "--policy"), f"'trained:sees' needs eyechart-organisms: {BARE}"),
        (("doctor", "hf:organism:scene"), f"'hf:organism:scene' needs eyechart-organisms: {WITH}"),
        (("look", "trained:sampling"), f"'trained:sampling' needs eyechart-organisms: {BARE}"),
        (("calibrate", "--replications", "1"), f"'eyechart calibrate' needs eyechart-organisms: {BARE}"),
    ],
)
def test_a_command_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...], said: str
) -> None:
    """In one sentence, before anything is built."""
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, words)
    assert isinstance(done.exception, SpecError), done.output
    assert str(done.exception) == said
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("absent")
def test_python_says_the_same() -> None:
    """Of the known names; one that there is not is said to be unknown."""
    with pytest.raises(SpecError, match="needs eyechart-organisms"):
        open_model("hf:organism:blind")
    with pytest.raises(SpecError, match="unknown organism 'giant'; known are grounded"):
        open_model("hf:organism:giant")


@pytest.mark.usefixtures("absent")
def test_what_there_is_stays_listed() -> None:
    """A list needs no weights."""
    assert {f"hf:organism:{name}" for name in organisms.SAYS} <= set(known_models())


def test_organisms_of_another_version_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Rather than mixed with what they were not made for."""
    monkeypatch.setattr(eyechart_organisms, "__version__", "0.1.9")
    with pytest.raises(SpecError, match=r"and 0\.1\.9 is installed: pip install 'eyechart\[organisms\]=="):
        open_model("trained:sees", answering="policy")


def test_no_command_imports_them_before_they_are_asked() -> None:
    """Nor does anything that the core does."""
    program = (
        "import sys, eyechart.api, eyechart.calibrate.reach, eyechart.cli.app, eyechart.models.huggingface.organisms\n"
        "import eyechart.models.trained, eyechart.studies.policy.demo; print('eyechart_organisms' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True)
    assert done.stdout == "False\n"


def test_they_are_what_older_runs_asked() -> None:
    """A run goes on with the model that it began with: the digest of a checkpoint is its version, as it always was."""
    assert {name: digest(organisms.folder(name))[:16] for name in organisms.SAYS} == {
        "grounded": "d289daaaf9d114ca",
        "depth_only": "6f49a60d2b453b7c",
        "presence_only": "86f66f760a123752",
        "blind": "5ab54775ac87aa67",
        "self_inconsistent": "8f502c02d68218d4",
        "scene": "06b7452ff2d58816",
        "scene_blind": "6e717eb3cba6c196",
        "rover": "1660d27b2ef9ff34",
    }
    versions = {"sees": "e352d7484aca", "privileged": "c1cd3bc91ea5", "memorised": "f8dbc6380661"}
    versions |= {"one_object": "7e00bac0d285", "top_only": "dbfed869c286", "sampling": "a0234d3afeb9"}
    for name, version in versions.items():
        assert open_model(f"trained:{name}", answering="policy").version == version
