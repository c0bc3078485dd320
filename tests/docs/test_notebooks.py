"""The notebooks run from their first cell to their last, and their output holds what they are there to show."""

import contextlib
import io
import json
import linecache
from pathlib import Path

import pytest

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("few_pictures")]

NOTEBOOKS = sorted((Path(__file__).parents[2] / "docs" / "notebooks").glob("*.ipynb"))
SAID = {
    "a-model": ("Yes. ", "\nNo. ", "scripted:presence presence_only", "scripted:depth looks: all two"),
    "a-policy": (
        "python:to_red camera_content instruction_ignored",
        "trained:sees object_grounded instruction_followed",
    ),
}
"""Words of each notebook's output without which it would not show what it says."""


def cells(path: Path) -> list[str]:
    """Return the code of a notebook, cell by cell; raises AssertionError where outputs are kept, which would age."""
    code = [one for one in json.loads(path.read_text(encoding="utf-8"))["cells"] if one["cell_type"] == "code"]
    assert all(one["outputs"] == [] and one["execution_count"] is None for one in code)
    return ["".join(one["source"]) for one in code]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs_to_its_end(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its cells run in order in an empty folder, and its functions have source, as those of a notebook do."""
    monkeypatch.chdir(tmp_path)
    said, names = io.StringIO(), dict[str, object]({"__name__": "__main__"})
    with contextlib.redirect_stdout(said):
        for number, code in enumerate(cells(path)):
            place = f"<cell {number} of {path.stem}>"
            linecache.cache[place] = (len(code), None, code.splitlines(keepends=True), place)
            exec(compile(code, place, "exec"), names)  # noqa: S102 - our own notebook
    for words in SAID[path.stem]:
        assert words in said.getvalue(), said.getvalue()
    assert (tmp_path / path.stem / "report.html").is_file()


def test_each_notebook_is_held_to_what_it_shows() -> None:
    """A notebook that is added says here what its output must hold."""
    assert {path.stem for path in NOTEBOOKS} == set(SAID)
