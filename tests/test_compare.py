"""Comparing runs, and holding external scores against them."""

import json
import re
import shutil
import sqlite3
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.stats
from typer.testing import CliRunner

import banks
import drives
from eyechart import cli
from eyechart.cli.app import app
from eyechart.compare import compare, frames_in_common
from eyechart.errors import SpecError
from eyechart.frames import MAIN, BankWriter, FrameBank, Scalar, encode, open_bank
from eyechart.manifest import LEDGER
from eyechart.seeds import key_seed
from eyechart.studies import battery, closed_loop
from eyechart.transfer import read_scores, transfer
from eyechart.verdicts import judge

SPECS = ("scripted:depth", "scripted:constant", "scripted:presence", "scripted:refuse_blank")


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a bank of six frames."""
    return banks.build_bank(tmp_path_factory.mktemp("compare") / "bank")


@pytest.fixture(scope="module")
def runs(bank: FrameBank) -> tuple[Path, Path]:
    """Return two runs of the same models with different seeds."""
    made = bank.root.parent / "first", bank.root.parent / "second"
    for seed, out in enumerate(made):
        battery.run(battery.plan(bank.root, SPECS, out, seed=seed))
    return made


def test_a_replication_of_the_same_models_replicates(runs: tuple[Path, Path]) -> None:
    """Labels are equal, no corrected p is small, and what the runs did not share is named."""
    found = compare(*map(battery.score, runs), resamples=199)
    assert found.is_replicated
    assert found.apart == ("seed: 0 in the first run, 1 in the second",)
    assert found.models["scripted:depth"].labels["verdict"] == ("undecided", "undecided")
    assert found.models["scripted:constant"].differences["across_runs"].value == 1
    json.dumps(found.as_dict(), allow_nan=False)


def test_runs_that_share_no_bank_or_no_model_are_refused(runs: tuple[Path, Path], tmp_path: Path) -> None:
    """The message says what they have instead."""
    other = banks.build_bank(tmp_path / "bank", scenarios=["light"])
    battery.run(battery.plan(other.root, ["scripted:depth"], tmp_path / "elsewhere"))
    first = battery.score(runs[0])
    elsewhere = battery.score(tmp_path / "elsewhere")
    assert len(frames_in_common(first, elsewhere)) == len(other)
    strange = banks.build_bank(tmp_path / "strange", scenarios=["strange"])
    battery.run(battery.plan(strange.root, ["scripted:depth"], tmp_path / "nothing"))
    with pytest.raises(SpecError, match="without a frame of equal geometry"):
        frames_in_common(first, battery.score(tmp_path / "nothing"))
    bank = runs[0].parent / "bank"
    battery.run(battery.plan(bank, ["scripted:random"], tmp_path / "another"))
    with pytest.raises(SpecError, match="no model in common"):
        compare(first, battery.score(tmp_path / "another"))


def test_replicates_of_a_model_are_one_cell(runs: tuple[Path, Path]) -> None:
    """Two runs of four models are four cells, not eight; what has no score, and no model, is named."""
    scores = {spec: float(rank) for rank, spec in enumerate(SPECS[1:])} | {"nobody": 3.0}
    found = transfer([battery.score(run) for run in runs], scores, measure="idi")
    assert [(cell.model, cell.runs) for cell in found.cells] == [(spec, 2) for spec in SPECS[1:]]
    assert found.pearson.note == "3 pairs are too few for a correlation; 4 are the least"
    assert found.left_out[-1] == "nobody: a score, but no run has it"
    assert found.left_out[0].startswith("scripted:depth on ")
    with pytest.raises(SpecError, match="there is no statistic 'idea'; these runs have unparsed_rate, "):
        transfer([battery.score(runs[0])], scores, measure="idea")


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("name,score\na,1\n", "has no column 'model'; it has name, score"),
        ("model,score\na,high\n", "row 2: the score of 'a' is 'high', not a number"),
        ("model,score\na,1\nb,nan\n", "row 3: the score of 'b' is 'nan', not a finite number"),
        ("model,score\na,1\na,2\n", "row 3: 'a' has two scores"),
        ("model,score\na\n", "row 2: the score of 'a' is '', not a number"),
        ("", "has no column 'model'; it has none"),
    ],
)
def test_a_bad_table_of_scores_is_refused_by_row(tmp_path: Path, text: str, named: str) -> None:
    """The message names the file, the row and the cell."""
    path = tmp_path / "scores.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(SpecError) as refused:
        read_scores(path)
    assert named in str(refused.value)
    assert str(path) in str(refused.value)


def test_a_table_of_scores_that_is_no_text_is_refused(tmp_path: Path) -> None:
    """A missing file, a folder and a picture give one line each."""
    (tmp_path / "binary.csv").write_bytes(b"\x89PNG\xff")
    for path, why in (
        (tmp_path / "none.csv", "No such file"),
        (tmp_path, "directory"),
        (tmp_path / "binary.csv", "no CSV"),
    ):
        with pytest.raises(SpecError, match=why):
            read_scores(path)


@pytest.mark.slow
def test_the_commands_answer_in_words_in_json_and_by_exit_code(
    runs: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """``compare`` exits 0 where all came out again, else 1; ``transfer`` prints both correlations."""

    def said(*words: object) -> tuple[int, str]:
        monkeypatch.setattr(sys, "argv", ["eyechart", *map(str, words)])
        with pytest.raises(SystemExit) as left:
            cli.main()
        return int(left.value.code or 0), capsys.readouterr().out

    code, out = said("compare", *runs)
    assert code == 0
    assert "not the same: seed: 0 in the first run, 1 in the second" in out
    assert "scripted:depth: verdict undecided; " in out
    changed = tmp_path / "changed"
    shutil.copytree(runs[0], changed)
    with sqlite3.connect(changed / LEDGER) as ledger:
        (guard,) = ledger.execute("SELECT sql FROM sqlite_master WHERE name = 'replies_UPDATE'").fetchone()
        ledger.execute("DROP TRIGGER replies_UPDATE")
        ledger.execute("UPDATE replies SET text = 'LEFT', row_sha256 = NULL")
        ledger.execute(guard)
    code, out = said("compare", runs[0], changed, "--json")
    assert code == 1
    assert json.loads(out)["models"]["scripted:depth"]["changed"] == ["answer_shift"]
    (tmp_path / "scores.csv").write_text("model,score\n" + "".join(f"{spec},{len(spec)}\n" for spec in SPECS))
    code, out = said("transfer", *runs, "--scores", tmp_path / "scores.csv", "--measure", "idi")
    assert code == 0
    assert out.count("(mean of 2 runs)") == 4
    twice = said("transfer", runs[0], f"{runs[0]}/../{runs[0].name}", "--scores", tmp_path / "scores.csv")[1]
    assert "mean of" not in twice, "one run under two names is one run"
    assert "Pearson r = " in out
    assert "Spearman r = " in out
    assert re.search(r"Pearson r = .*, p \S+ \(t test; over all orders \S+\), n 4", out)
    assert re.search(r"Spearman r = .*, p \S+ \(exact, over all orders\), n 4", out)


def moved_bank(bank: FrameBank, out: Path) -> FrameBank:
    """Write a bank again with the first lead half a metre farther, and two frames more."""
    first, *rest = bank
    moved = replace(first, truth={**first.truth, "lead_gap_m": first.truth["lead_gap_m"] + 0.5})
    more = [replace(first, id=f"more-{n}", step=90 + n, pictures={MAIN: f"images/more{n}.png"}) for n in range(2)]
    with BankWriter(out, banks.manifest()) as writer:
        for code, frame in enumerate([moved, *rest, *more]):
            writer.add(replace(frame, counterfactuals={}), {MAIN: encode(banks.draw(20.0, code))}, {})
    return open_bank(out)


def test_two_banks_are_compared_frame_by_frame(bank: FrameBank) -> None:
    """What they share, how far the numbers lie apart, and which frame is another moment."""
    other = moved_bank(bank, bank.root.parent / "moved")
    done = CliRunner().invoke(app, ["frames", "check", str(bank.root), str(other.root)])
    assert done.exit_code == 1
    first = next(iter(bank)).id
    assert f"{len(bank)} frames are in both banks ({len(bank)} and {len(bank) + 2} frames)" in done.output
    assert f"{len(bank) - 1} are the same moments" in done.output
    assert f"{first} differs in lead_gap_m" in done.output
    assert "lead_gap_m: at most 0.500 apart" in done.output
    same = CliRunner().invoke(app, ["frames", "check", str(bank.root), str(bank.root), "--json"])
    assert (same.exit_code, json.loads(same.stdout)["geometry"]["equal"]) == (0, len(bank))
    none = banks.build_bank(bank.root.parent / "none", scenarios=["strange"])
    apart = CliRunner().invoke(app, ["frames", "check", str(bank.root), str(none.root)])
    assert (apart.exit_code, "frames have no name in common" in apart.output) == (1, True)


def test_runs_on_two_banks_are_compared_on_the_frames_that_both_have(
    runs: tuple[Path, Path], bank: FrameBank, tmp_path: Path
) -> None:
    """As if both had been asked about these alone: here all but one of the small bank's, and the verdict is theirs."""
    other = moved_bank(bank, tmp_path / "bank")
    battery.run(battery.plan(other.root, SPECS[:2], tmp_path / "second"))
    done = CliRunner().invoke(app, ["compare", str(runs[0]), str(tmp_path / "second"), "--resamples", "999", "--json"])
    found = json.loads(done.stdout)
    assert f"bank, compared on the {len(bank) - 1} frames that both have" in found["apart"][0]
    depth = found["models"]["scripted:depth"]
    assert depth["differences"]["across_runs"]["n"] == len(bank) - 1
    shared = [frame.id for frame in bank][1:]
    alone = battery.score(runs[0], frames=shared)
    assert alone.models["scripted:depth"].answers.frames == tuple(bank)[1:]
    assert depth["labels"]["verdict"][0] == judge(alone)["scripted:depth"].calibrated.label
    with pytest.raises(SpecError, match=f"and they share {len(bank) - 1}: score both on these alone"):
        compare(battery.score(runs[0]), battery.score(tmp_path / "second"))
    with pytest.raises(SpecError, match="it has none of them"):
        battery.score(runs[0], frames=["nowhere"])


EDGE = {"a": 0.031, "b": 0.42, "c": 0.7, "d": 0.18}
"""Scores of four models that no run of this file decided."""


def by_noise(share: float) -> drives.Decide:
    """Brake by the gap, but at this share of moments as it comes."""
    toss = drives.tossing(f"noise {share}")

    def decide(truth: Mapping[str, Scalar], step: int, seed: int) -> str | None:
        noisy = key_seed("noisy", share, str(truth["lead_gap_m"]), step, seed) % 1000 < 1000 * share
        return toss(truth, step, seed) if noisy else drives.by_depth(truth, step, seed)

    return decide


@pytest.fixture(scope="module")
def platforms(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Return drives of four models in two simulators: constants, noise and readers, as in Table t:degeneracy."""
    folder, noise = tmp_path_factory.mktemp("edge"), {"a": 1.0, "b": 0.7, "c": 0.3}
    made = []
    for simulator in ("drone", "rover"):
        how = {"simulator": simulator, "seeds": range(2), "forward": True}
        found = [one for who, share in noise.items() for one in drives.drive(who, by_noise(share), **how)]
        found += drives.drive("d", drives.always("STRAIGHT"), **how)
        found += drives.drive("a", drives.by_depth, condition="blank", **how)
        found += drives.drive("oracle", drives.by_depth, **how)
        made.append(drives.make_run(folder / simulator, found, models=tuple(EDGE), simulator=simulator))
    return made[0], made[1]


def test_scores_are_set_beside_the_eight_cells_of_the_audit(platforms: tuple[Path, Path], tmp_path: Path) -> None:
    """MI and entropy are the audit's, of models and real pictures; both correlations are scipy's, with an exact p."""
    table = _scores(tmp_path, EDGE)
    audited = {
        (row.driver.policy, row.driver.simulator): row.statistics
        for row in closed_loop.score(platforms).audit
        if row.driver.policy in EDGE and row.driver.condition == "real"
    }
    for measure, name in (
        ("mutual_information.decision", "information_bits"),
        ("entropy", "entropy_bits"),
        ("information_bits", "information_bits"),
    ):
        words = ["transfer", *map(str, platforms), "--scores", str(table), "--measure", measure, "--json"]
        done = CliRunner().invoke(app, words)
        found = json.loads(done.stdout)
        cells = {(one["model"], one["bank"]): one["measured"] for one in found["cells"]}
        assert cells == pytest.approx({key: statistics[name].value for key, statistics in audited.items()})
        assert len(cells) == 8
        x, y = [EDGE[model] for model, _ in cells], list(cells.values())
        for kind, tested in (("pearson", scipy.stats.pearsonr(x, y)), ("spearman", scipy.stats.spearmanr(x, y))):
            assert (found[kind]["value"], found[kind]["n"]) == (pytest.approx(tested.statistic), 8)
        assert found["pearson"]["p"] == pytest.approx(scipy.stats.pearsonr(x, y).pvalue)
        rng = np.random.default_rng(0)
        near = [abs(np.corrcoef(rng.permutation(x), y)[0, 1]) for _ in range(4000)]
        drawn = np.mean(np.array(near) >= abs(found["pearson"]["value"]) - 1e-9)
        assert found["pearson"]["detail"]["p_exact"] == pytest.approx(drawn, abs=0.04)
        assert "exact over 40320 orders" in found["spearman"]["method"]
    assert cells["d", "rover"] == 0.0  # a constant tells nothing, and is a cell


def test_batteries_and_drives_are_cells_of_one_correlation(
    runs: tuple[Path, Path], platforms: tuple[Path, Path], tmp_path: Path
) -> None:
    """A bank and a simulator are two places; a statistic that one kind lacks leaves its cells out by name."""
    scores = {"scripted:depth": 1.0, **EDGE}
    scored = [battery.score(runs[0]), closed_loop.score(platforms[0])]
    found = transfer(scored, scores)
    assert {cell.bank for cell in found.cells} == {scored[0].bank.name, "drone"}
    assert len(found.cells) == 5
    lacking = transfer(scored, scores, measure="idi")
    assert [cell.model for cell in lacking.cells] == ["scripted:depth"]
    assert "a on drone: its run has no idi" in lacking.left_out
    done = CliRunner().invoke(app, ["transfer", str(platforms[0]), "--scores", str(_scores(tmp_path, EDGE))])
    assert "over all orders" in " ".join(done.stdout.split())


def _scores(folder: Path, scores: Mapping[str, float]) -> Path:
    path = folder / "scores.csv"
    path.write_text("model,score\n" + "".join(f"{name},{score}\n" for name, score in scores.items()))
    return path
