"""A bundle of a run of scene estimates holds until one thing in it is changed, and then the figure is named."""

import re
import sqlite3
import zipfile
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

import roads
from bundles import repacked
from eyechart.bundle import Validation, validate, write_bundle
from eyechart.errors import LedgerError
from eyechart.studies import battery, structured

CONTROL = "scripted:scene_positive_control"


@pytest.fixture(scope="module")
def packed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a bundle of the estimates of four pictures through the rover's view, and of their reflections."""
    folder = tmp_path_factory.mktemp("estimates")
    bank = roads.build_bank(folder / "bank", roads.GAPS_M[2:6])
    battery.run(structured.plan("structured", bank.root, [CONTROL], folder / "run"))
    write_bundle(folder / "run", folder / "run.zip", resamples=200)
    return folder / "run.zip"


def said(found: Validation) -> str:
    """Return every difference as a line."""
    return "\n".join(map(str, found.differences))


def test_an_honest_bundle_of_estimates_holds(packed: Path) -> None:
    """Requests were compared through the view that the models were shown, and page and tables follow."""
    found = validate(packed)
    assert (said(found), found.holds, found.notes) == ("", True, [])
    assert (found.compared["requests"], found.compared["calls"], found.compared["tables"]) == (8, 8, 12)
    with zipfile.ZipFile(packed) as file:
        assert {"report.html", "results.json", "tables/clauses.csv", "run/ledger.sqlite"} <= set(file.namelist())


def test_only_what_was_compared_is_counted(tmp_path: Path) -> None:
    """Of a run of two of a bank's frames, two frames and the two pictures that the bundle holds."""
    bank = roads.build_bank(tmp_path / "bank", roads.GAPS_M[2:6])
    battery.run(structured.plan("structured", bank.root, [CONTROL], tmp_path / "run", limit=2))
    write_bundle(tmp_path / "run", tmp_path / "run.zip", resamples=200)
    compared = validate(tmp_path / "run.zip").compared
    with zipfile.ZipFile(tmp_path / "run.zip") as file:
        pictures = [name for name in file.namelist() if name.endswith(".png")]
    assert (compared["frames"], compared["pictures"], len(pictures)) == (2, 2, 2)


def test_a_changed_estimate_changes_what_rests_on_it(packed: Path, tmp_path: Path) -> None:
    """The figure, its row in the tables and on the page, and the digest of the replies."""

    def change(folder: Path) -> None:
        with closing(sqlite3.connect(folder / "run" / "ledger.sqlite")) as ledger:
            triggers = [row[0] for row in ledger.execute("SELECT sql FROM sqlite_master WHERE type = 'trigger'")]
            for trigger in triggers:
                ledger.execute(f"DROP TRIGGER {trigger.split()[2]}")
            changed = ledger.execute(_CHANGE).rowcount
            for trigger in triggers:
                ledger.execute(trigger)
            ledger.commit()
        assert changed == 1

    lines = said(validate(repacked(packed, tmp_path, change)))
    assert f"results.json, {CONTROL}, close_accuracy, value: printed '0.75', recomputed '1.0'" in _exchanged(lines)
    for part in (f"results.json, replies_sha256, {CONTROL}, real", "report.html", "tables/clauses.csv"):
        assert part in lines


def test_a_changed_point_of_a_figure_is_named_and_nothing_else(packed: Path, tmp_path: Path) -> None:
    """A page without a browser of frames holds no data, and none is missed in it."""

    def change(folder: Path) -> None:
        page = folder / "report.html"
        text, count = re.subn(r'(<use xlink:href="#gap-told-1-[^>]* x=")[\d.]+', r"\g<1>1", page.read_text(), count=1)
        assert count == 1
        page.write_text(text)

    (line,) = said(validate(repacked(packed, tmp_path, change))).splitlines()
    assert re.match(r"report\.html, gaps, figure 'Estimated and true gap: .*', use x: printed '1'", line)


_CHANGE = """UPDATE replies SET text = replace(text, '"close": true', '"close": false') WHERE call = (SELECT calls.id
FROM calls JOIN replies r ON r.call = calls.id WHERE condition = 'real' AND r.text LIKE '%"close": true%' LIMIT 1)"""


def _exchanged(lines: str) -> str:
    """Return lines as if what was recomputed from the changed ledger had been printed."""
    return lines.replace("printed '1.0', recomputed '0.75'", "printed '0.75', recomputed '1.0'")


def test_another_view_in_the_manifest_is_found(packed: Path, tmp_path: Path) -> None:
    """Every request differs from the one that was recorded."""

    def change(folder: Path) -> None:
        path = folder / "run" / "run.json"
        view = path.read_text().partition('"view": "')[2].partition('"')[0]
        path.write_text(path.read_text().replace(view, "none"))

    assert "request of" in said(validate(repacked(packed, tmp_path, change)))


def test_a_run_under_another_reader_is_refused_without_reread(
    packed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As the score refuses it."""
    run: Callable[..., object] = write_bundle
    monkeypatch.setattr("eyechart.studies.structured.scores.SCENE_READERS", (99,))
    with pytest.raises(LedgerError, match="was started with version"):
        run(packed.parent / "run", tmp_path / "x.zip")
