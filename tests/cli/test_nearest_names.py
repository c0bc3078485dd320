"""A mistyped word gets the nearest that is known, wherever it is typed, and a word that is right not itself."""

from collections.abc import Callable
from pathlib import Path

import pytest

from eyechart.errors import EyechartError, did_you_mean, suggestion
from eyechart.importing import Choices, import_table
from eyechart.models import open_model
from eyechart.modes import RequestMode
from eyechart.simulators import open_bank_simulator, open_simulator
from eyechart.spaces.motion import read_kind
from eyechart.studies.guardian import read_point

MISTYPED: dict[str, tuple[Callable[[Path], object], str]] = {
    "a place": (
        lambda tmp: import_table(tmp, table_in(tmp), tmp / "bank", Choices(columns={"gpa": "gap_m"})),
        "gap",
    ),
    "a preset": (lambda tmp: open_bank_simulator("rover").build(tmp / "bank", preset="balancd"), "balanced"),
    "a mode's field": (lambda _: RequestMode("openai:m", structured="json_schem"), "json_schema"),  # type: ignore[arg-type]
    "a point": (lambda _: read_point("unanimos"), "unanimous"),
    "a kind": (lambda _: read_kind("absolut"), "absolute"),
}


def table_in(folder: Path) -> Path:
    """Write a table of one picture that is not there."""
    (folder / "t.csv").write_text("file,gap_m\na.png,1\n")
    return folder / "t.csv"


@pytest.mark.parametrize("what", MISTYPED)
def test_the_nearest_name_is_given(what: str, tmp_path: Path) -> None:
    """At the end of what is known."""
    call, near = MISTYPED[what]
    with pytest.raises(EyechartError) as refused:
        call(tmp_path)
    assert f"did you mean '{near}'?" in str(refused.value)


def test_a_scenario_gets_the_nearest() -> None:
    """Of every simulator's drives."""
    with pytest.raises(EyechartError, match=r"known: .*; did you mean 'single'\?"):
        open_simulator("rover").drive("singel", 0)


def test_an_adapter_without_a_name_is_not_meant_for_itself() -> None:
    """It is told that a name comes after it."""
    with pytest.raises(EyechartError) as refused:
        open_model("scripted")
    assert "unknown model 'scripted'; a name comes after 'scripted:';" in str(refused.value)
    assert did_you_mean("scripted", ["scripted"]) == suggestion("scripted", ["scripted"]) == ""
