"""The guardian from the command line: the paper's table from a CSV file, and refusals in one line."""

import json
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

import published_votes
from eyechart import cli

Say = Callable[..., tuple[object, str, str]]


@pytest.fixture
def say(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Say:
    """Return the command line as a function: exit code, standard output, standard error."""

    def run(*words: object) -> tuple[object, str, str]:
        monkeypatch.setattr(sys, "argv", ["eyechart", *map(str, words)])
        with pytest.raises(SystemExit) as left:
            cli.main()
        return left.value.code, *capsys.readouterr()

    return run


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path]:
    """Return the files of the published votes."""
    return published_votes.write(published_votes.published(), tmp_path)


def test_from_votes_to_the_papers_table(say: Say, files: tuple[Path, Path], tmp_path: Path) -> None:
    """Fit on what the column split gives, score the rest: Table t:positive-guardian, McNemar and the warning."""
    votes, about = files
    guardian = tmp_path / "guardian.json"
    code, chosen, told = say("guardian", "fit", votes, "--about", about, "--out", guardian)
    assert code == 0
    assert "committee: Gemma4-12B, Qwen3.5-9B; hazard from 2 of 4 votes; two_way" in chosen
    assert "it refuses to score the 16 frames that chose it" in told
    code, printed, warned = say("guardian", "score", guardian, votes, "--about", about)
    assert code == 0
    rows = {line.split("  ")[0].strip(): line.split()[-6:] for line in printed.splitlines() if "0." in line}
    table = {name: " ".join(word for word in row if word[0] in "01") for name, row in rows.items()}
    wanted = {
        "Gemma4-12B, original": ("1.000 0.842 0.869", "0.821/0.917"),
        "guardian of 2, hazard from 2 of 4 *": ("1.000 0.956 0.954", "0.958/0.950"),
        "guardian, abstain on 2–2": ("0.824 0.960 0.973", "0.946/1.000"),
        "guardian, unanimous only": ("0.647 0.994 0.996", "0.992/1.000"),
    }
    for name, (numbers, pair) in wanted.items():
        assert table[name].startswith(numbers)
        assert table[name].endswith(pair.replace("/", " "))
    printed = " ".join(printed.split())
    assert "35 errors corrected, 4 made; exact McNemar p <10⁻⁴ (3.35e-07), frames taken as independent" in printed
    assert "by flipping the signs of whole episodes' differences: p 0.0005 (n 12)" in printed
    assert "95% interval over episodes" in printed
    assert "warning: 12 of 12 scored episodes also gave frames that chose the guardian" in warned


def test_what_must_not_be_scored_ends_in_one_line(say: Say, files: tuple[Path, Path], tmp_path: Path) -> None:
    """A frame that it saw, another bank, an edited file, costs without their other half: exit 2."""
    votes, about = files
    guardian, ids = tmp_path / "guardian.json", tmp_path / "ids.txt"
    ids.write_text("\n".join(f"f{number}" for number in range(264, 280)))
    assert say("guardian", "fit", votes, "--about", about, "--calibration", ids, "--out", guardian)[0] == 0
    other = tmp_path / "other.toml"
    other.write_text(about.read_text().replace("f" * 64, "e" * 64))
    edited = tmp_path / "edited.json"
    edited.write_text(guardian.read_text().replace('"two_way"', '"abstain"'))
    scored = ("guardian", "score", guardian, votes, "--about")
    for words, why in (
        ((*scored, about), "frame 'f264' is one of 8"),
        ((*scored, other, "--unseen"), "the bank differs"),
        ((*scored, about, "--unseen", "--bound-episodes", "e00"), "episode 'e00' chose this guardian"),
        ((*scored, about, "--unseen", "--bound-episodes", "e00", "--confidence", 2), "the confidence must lie"),
        (
            ("guardian", "fit", votes, "--out", tmp_path / "x.json", "--calibration", tmp_path),
            "is no list of frame ids",
        ),
        (("guardian", "score", edited, votes), "was edited after it was frozen"),
        (("guardian", "fit", votes, "--out", tmp_path / "x.json", "--cost-miss", 1), "both --cost-miss and"),
        (("guardian", "fit", votes, "--out", tmp_path / "x.json", "--point", "maybe"), "--point is one of two_way"),
        (("guardian", "fit", votes, "--out", about), "is no guardian; it is not overwritten"),
        (("guardian", "fit", votes, "--out", tmp_path / "x.json", "--map", "frame"), "ROLE=COLUMN"),
        (("guardian", "nested", tmp_path / "none.csv"), "does not exist"),
        (("serve", votes), "is no guardian"),
    ):
        code, out, err = say(*words)
        assert (code, out, err.count("\n"), why in err) == (2, "", 1, True), err


def test_each_command_speaks_json(say: Say, files: tuple[Path, Path], tmp_path: Path) -> None:
    """Fit, score with a bound, nested and export; numbers are where a program finds them."""
    votes, about = files
    table = published_votes.published()
    parts = tuple(
        "calibration" if episode < "e04" else "score" if episode < "e07" else "bound" for episode in table.episodes
    )
    votes, about = published_votes.write(replace(table, split=parts), tmp_path)
    guardian, stack = tmp_path / "guardian.json", tmp_path / "stack.json"
    code, out, _ = say("guardian", "fit", votes, "--about", about, "--out", guardian, "--json")
    assert (code, json.loads(out)["threshold"]) == (0, 2)
    code, out, _ = say("guardian", "score", guardian, votes, "--about", about, "--json")
    found = json.loads(out)
    assert (code, found["episodes"], found["bound"]["episodes"]) == (0, 3, 5)
    assert found["bound"]["scope"].startswith("valid only for episodes exchangeable with those of bank paper")
    assert found["bound"]["episodes_needed_for_one_percent_without_a_miss"] == 299
    assert found["warnings"] == []
    code, out, _ = say("guardian", "score", guardian, votes, "--about", about)
    assert "In expectation only (conformal risk control, no confidence; expected share of a next episode's" in out
    assert "from 5 episodes" in out
    code, out, _ = say("guardian", "export", guardian, "--out", stack, "--json")
    assert (code, "selection" in json.loads(out)) == (0, False)
    assert json.loads(stack.read_text()) == json.loads(out)


def test_nested_says_what_the_folds_chose(say: Say, files: tuple[Path, Path]) -> None:
    """12/12 folds, .951 pooled."""
    code, out, _ = say("guardian", "nested", files[0])
    assert code == 0
    assert "12/12 folds: Gemma4-12B + Qwen3.5-9B, hazard from 2, two_way" in out
    assert "0.951" in out
