"""Table t:frontier and its verdicts out of a ledger: decisions to statistics to verdict, nothing put in by hand."""

import json
import math
from collections import Counter
from pathlib import Path

import hosted
import pytest
from typer.testing import CliRunner

from eyechart import models
from eyechart.cli.app import app
from eyechart.studies import battery
from eyechart.studies.battery.tables import frontier_rows
from eyechart.verdicts import judge

MODELS = ("Qwen2.5-VL-72B", "Cosmos3-SR-33B", "MiniCPM-V-4.5", "Kimi-K2.6", "Kimi-K3")

FRONTIER = """
unparsed rate           0.000  0.000  0.000  0.282  0.007
noise floor s           0.021  0.125  0.000  0.410  0.792
agree(blank)            0.396  0.222  0.000  0.007  0.229
agree(noise)            0.396  0.090  0.000  0.000  0.188
agree(text_only)        0.396  0.222  0.000  0.000  0.167
agree(cross_scenario)   0.333  0.479  0.986  0.424  0.208
Cramér's V              0.502  0.557  0.710  0.453  0.302
IDI_adj                 0.583  0.653  1.000  0.583  -0.021
clears noise floor      yes    yes    yes    yes    no
n_dir                   50     13     0      3      40
mirror swap rate        0.000  0.000  —      0.000  0.225
I(A;g) (bits)           0.408  0.198  0.028  0.106  0.122
p (permutation)         0.0002 0.0002 0.125  0.244  0.030
p (action vs. obstacle) <10⁻⁴  0.0016 0.370  0.483  0.120
"""
"""Table t:frontier as the paper prints it, in the words of `frontier_rows`."""

VERDICTS = ("depth", "depth", "presence_only", "not_scorable", "self_inconsistent")

NOT_DETERMINED = {
    ("p (permutation)", "Cosmos3-SR-33B"): "1/5001 says that no draw exceeded; with a p of .0001 4 seeds in 7 say so",
    ("p (permutation)", "MiniCPM-V-4.5"): "a share of 5000 random permutations, whose draws are not published",
    ("p (permutation)", "Kimi-K2.6"): "likewise",
    ("p (permutation)", "Kimi-K3"): "likewise",
}
"""Cells that no counts determine to the last digit. They are met within the error of two times 5000 draws."""

RESAMPLES = 5000


def cells() -> list[tuple[str, str, str]]:
    """Return the cells of the table: row, model, what the paper prints."""
    rows = [line.rsplit(maxsplit=len(MODELS)) for line in FRONTIER.strip().splitlines()]
    return [(row, model, cell) for row, *found in rows for model, cell in zip(MODELS, found, strict=True)]


EXACT = [cell for cell in cells() if cell[:2] not in NOT_DETERMINED]
DRAWN = [cell for cell in cells() if cell[:2] in NOT_DETERMINED]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of the run that holds the five models' replies."""
    folder = tmp_path_factory.mktemp("hosted")
    return hosted.write_ledger(folder / "run", hosted.build_bank(folder / "bank"), hosted.MODELS)


@pytest.fixture(scope="module")
def scored(run: Path) -> battery.BatteryScore:
    """Return the score of that run."""
    return battery.score(run)


@pytest.fixture(scope="module")
def columns(scored: battery.BatteryScore) -> dict[str, dict[str, str]]:
    """Return the columns of the table that we print."""
    return {spec: frontier_rows(model) for spec, model in scored.models.items()}


def test_the_bank_has_the_papers_gaps(scored: battery.BatteryScore) -> None:
    """81 of 144 frames are below 18 m, spread over all scenarios, and ties leave four unequal quantile bins."""
    near = [frame.scenario for frame in scored.bank if frame.truth["lead_gap_m"] < 18]
    assert (len(scored.bank), len(near)) == (144, 81)
    assert min(Counter(near).values()) > 15
    assert scored.models["MiniCPM-V-4.5"].statistics["mutual_information"].detail["bin_sizes"] == (62, 10, 36, 36)


@pytest.mark.parametrize(("row", "model", "cell"), EXACT, ids=[f"{model}-{row}" for row, model, _ in EXACT])
def test_a_cell_is_printed_as_in_the_paper(columns: dict, row: str, model: str, cell: str) -> None:
    """Every digit of every cell that counts can determine."""
    assert columns[model][row] == cell


@pytest.mark.parametrize(("row", "model", "cell"), DRAWN, ids=[f"{model}-{row}" for row, model, _ in DRAWN])
def test_a_drawn_cell_is_met_within_its_error(columns: dict, row: str, model: str, cell: str) -> None:
    """Two independent sets of 5000 permutations differ by less than three deviations of their difference."""
    deviation = math.sqrt(2 * float(cell) * (1 - float(cell)) / RESAMPLES)
    assert float(columns[model][row]) == pytest.approx(float(cell), abs=3 * deviation)


def test_the_table_leaves_nothing_out() -> None:
    """Seventy cells: 66 to the last digit, and four that are shares of random draws."""
    assert (len(EXACT), len(DRAWN)) == (66, 4)
    assert {cell[:2] for cell in cells()} >= set(NOT_DETERMINED)


def test_the_verdicts_are_the_papers(scored: battery.BatteryScore) -> None:
    """Two depth, one presence only, one not scorable, one self-inconsistent: four regimes."""
    assert tuple(one.paper.label for one in judge(scored).values()) == VERDICTS


@pytest.mark.parametrize(
    ("model", "n", "median_m"),
    [
        ("Qwen2.5-VL-72B", {"STOP": 57, "SLOW": 37, "LEFT": 50}, {"STOP": 5.0, "SLOW": 26.8, "LEFT": 33.2}),
        (
            "Cosmos3-SR-33B",
            {"STRAIGHT": 86, "SLOW": 32, "STOP": 13, "RIGHT": 8, "LEFT": 5},
            {"STRAIGHT": 22.1, "SLOW": 12.3, "STOP": 5.0, "RIGHT": 5.0, "LEFT": 5.0},
        ),
    ],
)
def test_actions_are_ordered_by_gap_as_in_table_qwenorder(
    scored: battery.BatteryScore, model: str, n: dict, median_m: dict
) -> None:
    """The count and the median gap of every emitted action of the two grounded models."""
    statistics = scored.models[model].statistics
    assert statistics["modal_share"].detail["counts"] == n
    assert statistics["gap_order"].detail["median_by_action"] == pytest.approx(median_m)
    assert statistics["gap_order"].value > 0


@pytest.mark.parametrize(
    ("model", "turned"),
    [
        ("Qwen2.5-VL-72B", {"SLOW": 25, "LEFT": 24, "STOP": 1}),
        ("Cosmos3-SR-33B", {"STRAIGHT": 6, "SLOW": 3, "STOP": 2, "RIGHT": 2}),
    ],
)
def test_reflection_gives_the_answers_of_table_qwenorder(
    scored: battery.BatteryScore, model: str, turned: dict
) -> None:
    """What the mirrored picture yields on the frames whose real picture gave a direction."""
    answers = scored.models[model].answers
    pairs = zip(answers.actions("real"), answers.actions("mirrored"), strict=True)
    assert Counter(str(other) for real, other in pairs if real in {"LEFT", "RIGHT"}) == turned


def test_cosmos_goes_straight_on_39_of_the_81_near_frames(scored: battery.BatteryScore) -> None:
    """With 19 SLOW, 12 STOP, 8 RIGHT and 3 LEFT beside them, the one completion that gives p = .0016."""
    detail = scored.models["Cosmos3-SR-33B"].statistics["obstacle"].detail
    near = [row[detail["columns"].index("near")] for row in detail["table"]]
    assert dict(zip(detail["rows"], near, strict=True)) == {
        "STRAIGHT": 39,
        "SLOW": 19,
        "STOP": 12,
        "RIGHT": 8,
        "LEFT": 3,
    }


def test_k26_brakes_far_and_proceeds_near(scored: battery.BatteryScore) -> None:
    """On the parsed remainder braking has its median at 27.3 m and proceeding at 6.2 m: inverted."""
    statistic = scored.models["Kimi-K2.6"].statistics["gap_order"]
    assert statistic.value == pytest.approx(6.2 - 27.3)


def test_k3_looks_dependent_on_every_test_but_its_noise_floor(scored: battery.BatteryScore) -> None:
    """V at p < 1e-4 and I(A;g) at p < .05, and yet IDI .771 is not above 1.5 s: the paper's fourth regime."""
    statistics = scored.models["Kimi-K3"].statistics
    assert statistics["cramers_v"].p < 1e-4
    assert statistics["mutual_information.decision"].p < 0.05
    assert statistics["idi"].value == pytest.approx(0.771, abs=5e-4)
    assert judge(scored)["Kimi-K3"].paper.decided_by == "clears_floor"


def test_the_command_line_prints_the_table(run: Path, columns: dict) -> None:
    """`eyechart score RUN --all` ends with the same cells, row by row, and the verdicts below."""
    result = CliRunner().invoke(app, ["score", str(run), "--all"])
    assert result.exit_code == 0
    printed = [line.strip() for line in result.stdout[result.stdout.rindex("metric ") :].splitlines()]
    for row, *_ in {cell[0]: cell for cell in cells()}.values():
        (line,) = [line for line in printed if line.startswith(row)]
        assert line.removeprefix(row).split() == [columns[model][row] for model in MODELS]
    (line,) = [line for line in printed if line.startswith("verdict (paper)")]
    assert tuple(line.split()[2:]) == VERDICTS


def test_the_command_line_gives_the_labels_as_json(run: Path) -> None:
    """`eyechart verdict RUN --json` holds the paper's label of every model under its name."""
    result = CliRunner().invoke(app, ["verdict", str(run), "--json"])
    found = json.loads(result.stdout)["models"]
    assert tuple(found[model]["paper"] for model in MODELS) == VERDICTS


def test_a_refusal_of_blanks_is_an_effect_on_outputs_only(tmp_path: Path) -> None:
    """54 of 144 blank and 1 of 144 real replies fail to parse, one action otherwise: V = .46 and V = 0, p = 1."""
    bank = hosted.build_bank(tmp_path / "bank")
    score = battery.score(hosted.write_ledger(tmp_path / "run", bank, {"refuses": hosted.REFUSES_BLANKS}))
    statistics = score.models["refuses"].statistics
    response, decision = statistics["cramers_v_real_blank"], statistics["cramers_v_real_blank.decision"]
    assert response.value == pytest.approx(0.46, abs=5e-3)
    assert response.p < 1e-4
    assert (decision.value, decision.p) == (0.0, 1.0)
    assert statistics["refusal_effect"].value == 1.0
    assert judge(score)["refuses"].paper.label == "refusal_effect"


def test_a_policy_that_reads_its_pixels_shows_in_v_and_hardly_in_idi(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On frames of which 12 of 144 are lopsided IDI is .083; V over all eight conditions is far above it.

    The paper has V = .61 for such a policy. Ours is called, not written: V(real, blank) is .21, because a symmetric
    frame is answered like a grey one, and noise, which is never quite symmetric, makes the difference.
    """
    monkeypatch.setitem(models.ADAPTERS, "pixels", "hosted")
    hosted.build_symmetric_bank(tmp_path / "bank", lopsided=12)
    battery.run(battery.plan(tmp_path / "bank", ["pixels:symmetric"], tmp_path / "run"))
    score = battery.score(tmp_path / "run")
    statistics = score.models["pixels:symmetric"].statistics
    assert statistics["idi"].value == 12 / 144
    assert statistics["cramers_v_real_blank"].value == pytest.approx(0.21, abs=0.01)
    assert f"{statistics['cramers_v'].value:.3f}".lstrip("0") == ".583"  # as docs/paper.md says
    assert statistics["cramers_v"].ci[0] > 0.4
    assert statistics["cramers_v"].p < 1e-4
    assert (statistics["mirror_swap_rate"].value, statistics["mirror_swap_rate"].n) == (1.0, 12)
