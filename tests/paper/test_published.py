"""`eyechart paper` over runs with the paper's counts prints the paper's tables: each cell that counts determine."""

import csv
import json
from html import unescape
from pathlib import Path

import hosted
import published_runs
import pytest
from test_frontier import MODELS, NOT_DETERMINED, cells
from typer.testing import CliRunner

import published_votes
from eyechart.cli.app import app
from eyechart.paper import LABELS
from eyechart.report.table import p_value

Rows = list[dict[str, str]]


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder that one command wrote, of a run of every kind with the paper's counts."""
    folder = tmp_path_factory.mktemp("published")
    votes, about = published_votes.write(published_votes.published(), folder)
    guardian = folder / "guardian.json"
    runs = [
        hosted.write_ledger(folder / "hosted", hosted.build_bank(folder / "hosted-bank"), hosted.MODELS),
        published_runs.ladder_run(folder),
        published_runs.static_run(folder),
        published_runs.online_run(folder),
        published_runs.hierarchy_study(folder),
        published_runs.prompt_study(folder),
        *published_runs.edge_runs(folder),
    ]
    for words in (
        ("guardian", "fit", votes, "--about", about, "--out", guardian),
        ("paper", *runs, votes, "--guardian", guardian, "--out", folder / "out"),
    ):
        done = CliRunner().invoke(app, [*map(str, words)])
        assert done.exit_code == 0, done.output
    return folder / "out"


def rows(out: Path, name: str) -> Rows:
    """Return the rows of a table as programs read them."""
    with (out / f"{name}.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def shown(out: Path, name: str) -> dict[str, list[str]]:
    """Return the cells of a table as people read them, by its first column."""
    lines = unescape((out / f"{name}.md").read_text(encoding="utf-8")).splitlines()
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines if line.startswith("| ")][2:]
    return {row[0].replace("\\", ""): [cell.replace("\\", "") for cell in row[1:]] for row in cells}


def test_every_label_is_written(out: Path) -> None:
    """But the calibrated view: these pictures are a few pixels wide. tests/test_paper.py has it."""
    names = {path.name.partition(".")[0].replace("-", ":", 1) for path in out.iterdir()}
    assert LABELS.keys() - names == {"fgr:vlm-interface"}


@pytest.mark.parametrize(("row", "model", "cell"), [cell for cell in cells() if cell[:2] not in NOT_DETERMINED])
def test_the_frontier_is_the_papers(out: Path, row: str, model: str, cell: str) -> None:
    """Every cell of Table t:frontier but four p of random draws."""
    assert shown(out, "t-frontier")[row][MODELS.index(model)] == cell


def test_the_order_of_gaps_is_the_papers(out: Path) -> None:
    """Counts, medians and reflections of both grounded models."""
    found = {
        (row["model"], row["action"]): (row["n"], row["med. gap (m)"], row["under reflection"])
        for row in rows(out, "t-qwenorder")
        if row["model"] in MODELS[:2]
    }
    qwen, cosmos = MODELS[:2]
    assert found == {
        (qwen, "STOP"): ("57", "5.0", ""),
        (qwen, "LEFT"): ("50", "33.2", "SLOW 25, LEFT 24, STOP 1"),
        (qwen, "SLOW"): ("37", "26.8", ""),
        (cosmos, "STRAIGHT"): ("86", "22.1", ""),
        (cosmos, "SLOW"): ("32", "12.3", ""),
        (cosmos, "STOP"): ("13", "5.0", ""),
        (cosmos, "RIGHT"): ("8", "5.0", found[cosmos, "RIGHT"][2]),
        (cosmos, "LEFT"): ("5", "5.0", found[cosmos, "LEFT"][2]),
    }


GUARDIAN = """
Gemma4-12B, original                 1.000 0.842 0.869 0.821 0.917
guardian of 2, hazard from 2 of 4    1.000 0.956 0.954 0.958 0.950
guardian, abstain on 2–2             0.824 0.960 0.973 0.946 1.000
guardian, unanimous only             0.647 0.994 0.996 0.992 1.000
"""

LOCAL = """
Renderer positive 1.000 1.000 0.090  1.000 1.000 1.000 10  0.167
Qwen3-VL-8B       1.000 0.445 15.345 0.253 0.365 0.119 134 0.083
Gemma4-12B        1.000 0.858 16.014 0.399 0.497 0.000 43  0.667
Qwen3.5-9B        1.000 0.867 13.125 0.031 0.538 0.097 93  0.083
Qwen2.5-VL-7B     1.000 0.502 53.653 0.000 0.872 0.000 1   1.000
Ministral3-8B     1.000 0.534 6.240  0.010 0.556 0.134 112 0.083
MiniCPM-V-4.5     1.000 0.641 11.049 0.007 0.215 0.020 199 0.083
"""

INTENT = """
MPC-only                 23/25 0/25
oracle intent            23/25 0/25
random intent            14/25 0/25
constant LEFT            24/25 0/25
ollama:gemma4            8/25  0/25
ollama:gemma4, mirrored  8/25  0/25
ollama:gemma4, blank     0/25  0/25
"""

SECOND = """
mpc-oracle                              30/32 2/32
mpc-blind                               1/32  31/32
ollama:gemma4, full intent              0/32  11/32
ollama:gemma4, lateral intent           0/32  32/32
ollama:gemma4, lateral intent, mirrored 5/32  27/32
"""


def printed(text: str, columns: int) -> dict[str, list[str]]:
    """Return the cells of a table of the paper by its first column."""
    lines = [line.rsplit(maxsplit=columns) for line in text.strip().splitlines()]
    return {name: cells for name, *cells in lines}


def test_the_guardian_is_the_papers(out: Path) -> None:
    """All rows of Table t:positive-guardian."""
    assert shown(out, "t-positive-guardian") == printed(GUARDIAN, 5)


def test_the_local_estimators_are_the_papers(out: Path) -> None:
    """All rows of Table t:controller-local, the crash column joined from the online run."""
    found = shown(out, "t-controller-local")
    for name, wanted in printed(LOCAL, 8).items():
        assert found[name] == [*wanted[:5], f"{wanted[5]} ({wanted[6]})", wanted[7]], name


def test_the_crashes_of_the_ladder_are_the_papers(out: Path) -> None:
    """The column of Table t:baselines that counts determine."""
    crashes = {name.rpartition(" ")[2]: cells[-1] for name, cells in shown(out, "t-baselines").items()}
    assert crashes == {
        "constant:SLOW": "3.1%",
        "oracle": "37.5%",
        "random": "78.1%",
        "constant:LEFT": "87.5%",
        "constant:RIGHT": "100.0%",
        "constant:STRAIGHT": "100.0%",
    }


def test_goals_and_crashes_of_the_hierarchy_are_the_papers(out: Path) -> None:
    """Both ablations, and the STOP of a blank picture; STRAIGHT is MPC-only under its other name."""
    found = shown(out, "t-mpc-intent")
    assert found.pop("constant STRAIGHT") == found["MPC-only"]
    assert {name: cells[:2] for name, cells in found.items()} == printed(INTENT, 2)
    assert found["ollama:gemma4, blank"][-1] == "100.0%"
    assert {name: cells[:2] for name, cells in shown(out, "mpc-intent-second").items()} == printed(SECOND, 2)


EDGE = """
drone Qwen2-VL-2B  1.000 0.00 ---   ---
drone Qwen2-VL-7B  1.000 0.00 ---   ---
drone LLaVA-1.5-7B 0.928 0.45 0.032 0.071
drone SmolVLM      0.485 1.82 0.146 0.080
rover Qwen2-VL-2B  1.000 0.00 ---   ---
rover LLaVA-1.5-7B 1.000 0.00 ---   ---
rover Qwen2-VL-7B  0.982 0.13 0.037 0.283
rover SmolVLM      0.649 0.94 0.033 0.035
"""


def test_the_audit_has_the_papers_shares_and_bits(out: Path) -> None:
    """All eight cells of Table t:degeneracy but p, which depends on counts that the paper does not print."""
    text = unescape((out / "t-degeneracy.md").read_text(encoding="utf-8")).replace("\\", "").replace("—", "---")
    lines = [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines()]
    found = {(line[0], line[1].rpartition(" ")[2]): line[2:6] for line in lines if line[0] in {"drone", "rover"}}
    assert found == {(where, model): cells for where, model, *cells in map(str.split, EDGE.strip().splitlines())}


def test_the_family_of_the_audit_are_the_cells_that_vary(out: Path) -> None:
    """Holm over four; the second of eight could not be the paper's .037, whatever the permutations gave."""
    found = rows(out, "t-degeneracy")
    assert sum(row["p"] == "" for row in found) == 4
    smallest = min(float(row["p"]) for row in found if row["p"])
    assert smallest == pytest.approx(4 / 5001)
    second = {f"{7 * k / 5001:.3f}" for k in range(1, 5002)}
    assert "0.037" not in second
    assert "0.037" in {f"{3 * k / 5001:.3f}" for k in range(1, 5002)}


@pytest.mark.parametrize("prompt", published_runs.PROMPTS)
def test_the_prompts_are_the_papers(out: Path, prompt: str) -> None:
    """Modal share, distinct outputs and IDI of every cell of Table t:prompts."""
    found = {row["model"]: row for row in rows(out, "t-prompts") if row["prompt"] == prompt}
    wanted = published_runs.PROMPTS[prompt]
    assert {spec: [float(found[spec][name]) for name in ("modal", "n_a", "IDI")] for spec in found} == {
        spec: [modal / 100, distinct, pytest.approx(changed / 100)]
        for spec, (modal, distinct, changed) in wanted.items()
    }


def test_rates_of_the_vectors_stand_in_the_tables(out: Path) -> None:
    """Each rate of the estimators that the paper's vectors hold, to their tolerance."""
    vectors = json.loads((Path(__file__).parent / "paper_vectors.json").read_text(encoding="utf-8"))
    column = {"scene_eq": "scene eq.", "action_eq": "action eq.", "swap": "swap", "crash": "crash"}
    whose = {
        "Qwen3-VL": "Qwen3-VL-8B",
        "Gemma4": "Gemma4-12B",
        "Qwen2.5-VL": "Qwen2.5-VL-7B",
        "MiniCPM": "MiniCPM-V-4.5",
    }
    table = {row["estimator"]: row for row in rows(out, "t-controller-local")}
    checked = [vector for vector in vectors if vector["id"].startswith("local_") and vector["kind"] == "rate"]
    assert len(checked) == 16
    for one in checked:
        _, model, figure = one["id"].split("_", 2)
        found = table[whose[model]]
        assert float(found[column[figure]]) == pytest.approx(one["expected"], abs=one["tolerance"]), one["id"]
        assert int(found[f"{column[figure]} n"]) == one["inputs"]["n"]


def test_p_of_a_permutation_that_nothing_exceeded_is_the_papers(out: Path) -> None:
    """Qwen's .0002 is 1/5001."""
    assert shown(out, "t-frontier")["p (permutation)"][0] == p_value(1 / 5001)
