"""The words of a look: what its drawn pictures showed, and commands that can be pasted."""

import ast
import unicodedata
from dataclasses import replace
from pathlib import Path

import pytest

import banks
import by_hand as hand
from eyechart.conditions import RANGED
from eyechart.errors import SpecError
from eyechart.formats import FORMATS, format_of_data_set
from eyechart.frames import IMPORTED
from eyechart.looks.answer import Look, NextStep, pasted
from eyechart.looks.models import _holes, _may_be_blind, _settled_by, _sight
from eyechart.looks.pictures import Pictures
from eyechart.looks.request import LookRequest
from eyechart.modes import ModeMeasurements, RequestMode
from eyechart.report.table import coded, number
from eyechart.stats.order import Order
from eyechart.stats.paired_tests import Place, Places
from eyechart.verdicts import judge_one


class Verdict:
    """A verdict of which only the answer is read."""

    def __init__(self, answer: str) -> None:
        self.answer = answer


@pytest.mark.parametrize("sees", [True, False, None])
def test_a_look_says_that_a_model_sees_only_where_that_was_shown(sees: bool | None) -> None:  # noqa: FBT001
    """A model that answers with actions alone has shown nothing, and a No beside it may be the road's."""
    facts = {"picture": "none of 14 replies names any of the choices"}
    mode = RequestMode("openai:m", measured=ModeMeasurements(date="2026-11-29", sees_image=sees, facts=facts))
    assert ("it sees its pictures" in _sight(mode)) is (sees is True)
    assert ("none of 14 replies" in _sight(mode)) is (sees is not True)
    assert _may_be_blind(Verdict("No"), mode) is (sees is not True)  # type: ignore[arg-type]
    assert not _may_be_blind(Verdict("Yes"), mode)  # type: ignore[arg-type]


def test_what_is_not_excluded_takes_few_lines() -> None:
    """The places in which a noisy reader may not answer are one line, and a kind of pairs is another."""
    places = tuple(Place("scenario", name, 12, 6, 3, 0.25, -0.1, 0.6) for name in ("dense", "light", "merge"))
    pairs = Order(0.05, 20, (0.0, 0.3), lost=1, won=19, contradicted=0)
    found = hand.moved(place_open=Places(3.0, 7, note="in `dense` (6 of 12)", places=places), order_drawn=pairs)
    assert [*_holes(judge_one(hand.evidence(found)))] == [
        "Not excluded: that comparisons of drawn distances come out the wrong way round.",
        "Not excluded: that its braking does not answer in `dense`, in `light`, in `merge`.",
    ]


def test_what_photographs_lack_is_no_command_of_a_simulator(tmp_path: Path) -> None:
    """Nothing can be drawn of an imported bank: its pictures have to be taken again, as a built bank's need not."""
    built = banks.build_bank(tmp_path / "bank")
    lacking = hand.evidence(hand.older(), absent=RANGED, replies=hand.ASKED, bank="bank")
    why = judge_one(lacking).why_not
    assert why is not None
    assert "'eyechart frames build --add-to bank' draws them" in _settled_by(why, built)
    imported = replace(built, manifest=replace(built.manifest, simulator=IMPORTED))
    said = _settled_by(why, imported)
    assert said.startswith("pictures of each moment again (lead_drawn: the lead anywhere between; exchange_own: ")
    assert "eyechart" not in said
    asked = replace(why, conditions=(), first="", settle="about 49 frames")
    assert _settled_by(asked, imported) == "about 49 frames"


def test_python_code_is_pasted_as_it_was() -> None:
    """A path with a blank and a long call stay one call, on lines of at most 80 columns."""
    code = "eyechart.look(cautious, bank='/a folder/of mine/bank', prompt='FILE.toml', out='/a folder/of mine/looks-2')"
    lines = [*pasted(code)]
    assert max(map(len, lines)) <= 80
    assert ast.dump(ast.parse("\n".join(lines).strip())) == ast.dump(ast.parse(code))
    screen = str(Look("python:__main__:cautious", "No", "It does not.", next=(NextStep("try another", code),)))
    assert "'eyechart.look(" not in screen


def test_a_wide_character_takes_two_of_the_80_columns() -> None:
    """A path in Chinese stays whole in its letters, and no line of the screen is cut by a terminal."""
    name = "車道保持" * 12
    lines = [*Look("scripted:depth", "Yes", "It does.", report=Path(f"/{name}/report.html")).lines()]
    assert max(sum(1 + (unicodedata.east_asian_width(sign) == "W") for sign in line) for line in lines) <= 80
    assert f"/{name}/report.html" in "".join(lines)


def test_a_look_into_a_file_is_refused_before_any_bill(tmp_path: Path) -> None:
    """A folder is asked for by the option that names it."""
    (tmp_path / "there").touch()
    with pytest.raises(SpecError, match="there is a file, and a look needs a folder: give another --out"):
        LookRequest(RequestMode("scripted:depth"), Pictures(), tmp_path / "there").require_own_folder()


def test_a_data_set_is_recognised_by_its_content(tmp_path: Path) -> None:
    """HDF5 by its first bytes; where nothing tells, a LeRobotDataset, whose error says what is missing."""
    (tmp_path / "demos").mkdir()
    (tmp_path / "demos/one.hdf5").write_bytes(b"\x89HDF\r\n\x1a\n")
    assert format_of_data_set(tmp_path / "demos") is FORMATS["hdf5"]
    assert format_of_data_set(tmp_path) is FORMATS["lerobot"]


def test_a_place_in_backticks_is_code_and_no_zero_is_negative() -> None:
    """What stands in them is escaped; backticks of others are text."""
    assert str(coded("not in `a<b`: 0")) == "not in <code>a&lt;b</code>: 0"
    assert str(coded("its reply `d` and **e**")) == "its reply `d` and **e**"
    assert number(-0.0001) == "0.000"
    assert number(-0.001) == "-0.001"
