"""Figures have names for those who cannot see them, ids of their own, and files as SVG and PDF."""

import re
from pathlib import Path
from unittest.mock import Mock
from xml.etree import ElementTree as ET

import numpy as np
import pytest

import report_runs
import stand_ins
from eyechart.calls import Query, Reply
from eyechart.report.charts import GridLabels, grid, luminance, plain
from eyechart.report.page import write_figures
from eyechart.studies.battery import BatterySelection
from eyechart.studies.battery import figures as drawn
from eyechart.studies.battery.figures import figures, pair_counts, pair_words
from eyechart.studies.battery.subjects import Subject, subjects
from report_runs import Reported, make_run, read_evidence

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def everyone(hostile: Reported) -> list[Subject]:
    """Return the two models of the hostile run."""
    return subjects(read_evidence([hostile.run]))


def test_every_figure_has_an_accessible_name(hostile: Reported) -> None:
    """A title and a description, which the figure's root names, in the page and in the file."""
    drawn = [one for many in hostile.made.drawings.values() for one in many]
    assert len(drawn) == 4 + 3 * 2
    for drawing in drawn:
        root = ET.fromstring(drawing.svg())  # noqa: S314 - drawn here
        names = [child.text for child in root if child.tag in {f"{SVG}title", f"{SVG}desc"}]
        ids = [child.get("id") for child in root if child.tag in {f"{SVG}title", f"{SVG}desc"}]
        assert (root.get("role"), root.get("aria-labelledby", "").split()) == ("img", ids)
        assert all(name and len(name) > 20 for name in names)
    page = hostile.html
    upright = 1  # agreement stands twice: upright where the screen is narrow
    assert page.count('<svg xmlns="http://www.w3.org/2000/svg"') == page.count('role="img"') == len(drawn) + upright


def test_no_id_stands_twice_in_the_page(hostile: Reported) -> None:
    """Matplotlib gives every figure the same ids; each gets its figure's name before it."""
    static = re.sub(r"<script.*?</script>", "", hostile.html, flags=re.DOTALL)
    ids = re.findall(r'\sid="([^"]*)"', static)
    assert len(ids) == len(set(ids)) > 50
    used = set(re.findall(r'(?:url\(|xlink:href="|aria-labelledby="|href=")#?([\w.-]+)', static))
    assert used - set(ids) == set()


def test_figures_are_files_as_svg_and_pdf(everyone: list[Subject], tmp_path: Path) -> None:
    """One of each a figure, without scripts and without dates."""
    written = write_figures(figures(everyone), tmp_path / "figures")
    names = {path.stem for path in written}
    assert {"agreement", "information", "noise-floor", "gap-01", "mirror-02", "counterfactual-01"} <= names
    for name in names:
        svg, pdf = (tmp_path / "figures" / f"{name}.{suffix}" for suffix in ("svg", "pdf"))
        assert pdf.read_bytes().startswith(b"%PDF")
        assert b"CreationDate" not in pdf.read_bytes()
        text = svg.read_text(encoding="utf-8")
        ET.fromstring(text)  # noqa: S314 - drawn here
        assert "<script" not in text
        assert "dc:date" not in text


def test_the_heat_map_prints_the_share_of_equal_answers(everyone: list[Subject]) -> None:
    """A steady model agrees with itself everywhere; the other's numbers are the run's statistics."""
    (drawing,) = figures(everyone)["agreement"]
    steady = drawing.description.partition("standin:steady: ")[2]
    assert re.findall(r"\d\.\d\d", steady) == ["1.00"] * 10
    statistics = everyone[0].model.statistics
    assert f"blank {statistics['agree.blank'].value:.2f}" in drawing.description
    assert f"real_repeat {statistics['agree.real_repeat'].value:.2f}" in drawing.description
    assert "noise floor" in drawing.svg()


def test_a_matrix_counts_every_pair_of_answers(everyone: list[Subject]) -> None:
    """Real against mirrored, in frames."""
    drawing = figures(everyone)["mirror"][0]
    real, mirrored, _ = everyone[0].model.answers.both("real", "mirrored", "response")
    counts = re.findall(r"(\w+) to (\w+): (\d+)", drawing.description)
    assert sum(int(count) for _, _, count in counts) == len(real)
    for one, other, count in counts:
        assert int(count) == int(np.count_nonzero((real == one) & (mirrored == other)))


def test_the_counterfactual_pairs_are_counted(bank: Path, tmp_path: Path) -> None:
    """A model that looks for red ahead brakes harder near in every pair."""

    def by_red(query: Query) -> Reply:
        from eyechart.frames import decode  # noqa: PLC0415 - nowhere else needed

        if query.image is None:
            return Reply("STRAIGHT", "stop")
        red = np.argwhere(decode(query.image, "query")[1:, :, 0] == 200)
        return Reply("STOP" if len(red) and red[:, 1].min() < 20 else "STRAIGHT", "stop")

    run = make_run(bank, tmp_path / "run", {"by_red": by_red, "steady": stand_ins.stop})
    one, other = subjects(read_evidence([run]))
    pairs = len(one.model.answers.both("lead_near", "lead_far", "decision")[0])
    assert pairs > 5
    assert (pair_counts(one), pair_counts(other)) == ((pairs, 0, 0), (0, pairs, 0))
    assert pair_words((pairs, 0, 0)) == f"{pairs} of {pairs} pairs are braked harder near, 0 harder far, 0 equally"
    assert pair_words((0, 0, 0)) == "no counterfactual pair has two decisions"
    (drawing,) = figures([one, other])["pairs"]
    assert f"standin:steady: 0 of {pairs} pairs" in drawing.description


def test_a_label_keeps_no_control_sign_and_is_not_too_long() -> None:
    """A figure's label is one line; its beginning and its end are kept."""
    assert plain("a\x00b\u202ec\nd") == "a�b�c�d"
    long = plain("begin" + "x" * 100 + "end")
    assert len(long) <= 40
    assert long.startswith("begin")
    assert long.endswith("end")


def test_a_name_in_a_figure_is_not_read_as_a_formula(bank: Path, tmp_path: Path) -> None:
    """Dollar signs stay dollar signs, and what the font lacks is no error."""
    name = "$\\frac{1}{0}$<b>漢😀"
    run = make_run(bank, tmp_path / "run", {name: report_runs.hostile}, extent=BatterySelection(4))
    drawn = figures(subjects(read_evidence([run])))
    text = drawn["agreement"][0].svg()
    assert "$\\frac{1}{0}$&lt;b&gt;漢😀" in text
    assert drawn["agreement"][0].pdf().startswith(b"%PDF")


@pytest.mark.parametrize("name", ["_REDS", "_STAYS", "_MOVED", "_BLUES"])
@pytest.mark.parametrize("share", np.linspace(0, 1, 21))
def test_a_number_in_a_cell_can_be_read_on_its_colour(name: str, share: float) -> None:
    """Ink and face differ by a contrast of 4.5 at least, as WCAG asks of text, wherever on the scale a cell is."""
    figure = grid((1, 1), (0, 0, 0, 0), [[(share, "0.50", getattr(drawn, name))]], GridLabels([""], [""]))
    (faces, _), (text, *_) = figure.artists, figure.texts
    dark, light = sorted((luminance(faces.get_facecolor()[0]), luminance(text.get_color())))
    assert (light + 0.05) / (dark + 0.05) >= 4.5


def test_reflections_as_the_paper_prints_them_are_grey(
    everyone: list[Subject], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Who is right to keep straight on in the reflection is not painted as one who cannot see."""
    painted: dict[bool, list[object]] = {}
    for as_paper in (True, False):
        drawing = Mock(wraps=grid)
        monkeypatch.setattr(drawn, "grid", drawing)
        says = drawn.agreement(everyone[:1], as_paper=as_paper).description
        assert ("Grey columns" in says) is as_paper
        painted[as_paper] = [colours for _, _, colours in drawing.call_args.args[2][0]]
    conditions = [name for name in everyone[0].run.conditions if name != "real"]
    place = conditions.index("mirrored")
    assert painted[True][place] is drawn._MOVED
    assert painted[False][place] is drawn._STAYS
    assert painted[True][conditions.index("blank")] is drawn._REDS
