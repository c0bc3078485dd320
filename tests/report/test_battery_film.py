"""A film of a battery shows what was shown and what was answered, condition by condition."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

import banks
import stand_ins
from eyechart.cli.app import app
from eyechart.errors import SpecError
from eyechart.frames import FrameBank
from eyechart.studies.battery.film import WIDTH, cards, draw, write_film
from report_runs import make_run


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a bank of eighteen frames."""
    return banks.build_bank(tmp_path_factory.mktemp("film") / "bank")


@pytest.fixture(scope="module")
def run(bank: FrameBank) -> Path:
    """Return a run of two models."""
    return make_run(bank.root, bank.root.parent / "run", {"noisy": stand_ins.noisy, "same": stand_ins.noisy})


def test_each_condition_has_its_picture_and_every_answer(run: Path, bank: FrameBank) -> None:
    """The pictures are those that the models were shown; a blank one is grey, and without one there is a word."""
    shown, made = cards(run, "light-0-1")
    assert shown == "light-0-1"
    by_name = {card.condition: card for card in made}
    assert {"real", "blank", "text_only", "mirrored"} <= set(by_name)
    real, blank = (by_name[name].pictures[0] for name in ("real", "blank"))
    assert np.array_equal(real, np.asarray(Image.open(bank.root / bank.frame("light-0-1").file).convert("RGB")))
    assert (blank == 128).all()
    assert by_name["text_only"].pictures == ()
    assert all(set(card.answers) == {"standin:noisy", "standin:same"} for card in made)
    page = draw(by_name["real"], shown, ["standin:noisy"], 200, 0)
    assert page.getpixel((5, 5)) == tuple(real[0, 0])
    assert page.width == WIDTH


def test_the_frame_is_the_one_whose_answers_vary_the_most(run: Path) -> None:
    """Where none is named."""
    found, made = cards(run)

    def variety(frame: str) -> int:
        return len({(spec, said) for card in cards(run, frame)[1] for spec, said in card.answers.items()})

    assert variety(found) == max(variety(frame) for frame in ("light-0-1", "dense-0-0", found))
    assert made[0].condition == "real"


def test_the_command_writes_a_gif_and_says_what_it_needs(run: Path, tmp_path: Path) -> None:
    """One picture a condition, the same bytes each time; other files, frames and options are refused by name."""
    result = CliRunner().invoke(app, ["film", str(run), "--out", str(tmp_path / "a.gif")], catch_exceptions=False)
    assert result.exit_code == 0
    with Image.open(tmp_path / "a.gif") as film:
        assert (film.n_frames, film.width) == (len(cards(run)[1]), WIDTH)
    assert write_film(run, tmp_path / "b.gif") > 6
    assert (tmp_path / "a.gif").read_bytes() == (tmp_path / "b.gif").read_bytes()
    with pytest.raises(SpecError, match=r"a film of a battery is written as \.gif"):
        write_film(run, tmp_path / "a.mp4")
    with pytest.raises(SpecError, match="--frame 'nope' names no frame with an answer"):
        cards(run, "nope")
    with pytest.raises(SpecError, match="--episode is for drives"):
        CliRunner().invoke(
            app, ["film", str(run), "--out", str(tmp_path / "c.gif"), "--episode", "x"], catch_exceptions=False
        )
