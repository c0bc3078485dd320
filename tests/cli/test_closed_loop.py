"""``eyechart run closed-loop``: its words, its exit codes, and what it prints where."""

import html
import json
import shutil
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

import pytest

import tiny_worlds
from eyechart import attempts, cli, episodes
from eyechart.episodes import Episode, plans, read_episodes, write_episodes
from eyechart.errors import SpecError
from eyechart.simulators import SIMULATORS
from eyechart.studies.closed_loop import score
from eyechart.studies.closed_loop.page import make_drives_page
from faults import FaultServer

pytestmark = pytest.mark.slow

LOOK = "python:tiny_worlds:look"
FAILING = "python:tiny_worlds:failing"


class Said(NamedTuple):
    """What a command returned and printed."""

    code: object
    out: str
    err: str


Drive = Callable[..., Said]


@pytest.fixture
def drive(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Drive:
    """Return the command as a function of its words, in the tiny worlds; models drive alone unless it is said."""
    for name, place in tiny_worlds.SIMULATORS.items():
        monkeypatch.setitem(SIMULATORS, name, place)

    def run(*words: object, alone: bool = True) -> Said:
        command = ["eyechart", "run", "closed-loop", "--simulator", "tiny", "--out", tmp_path / "run"]
        command += ["--no-marginal"] * alone
        monkeypatch.setattr(sys, "argv", [str(word) for word in [*command, "--processes", 1, *words]])
        with pytest.raises(SystemExit) as left:
            cli.main()
        return Said(left.value.code, *capsys.readouterr())

    return run


def test_a_plan_is_printed_and_driven_and_driven_no_more(drive: Drive, tmp_path: Path) -> None:
    """First the plan alone; then a row for each policy and condition; then nothing is left to do."""
    words = ("--policy", LOOK, "--policy", "oracle", "--scenarios", "whole", "--seeds", "3,5")
    words += ("--condition", "real", "--condition", "blank")
    planned = drive(*words, "--dry-run")
    assert (planned.code, planned.out) == (0, "")
    assert "2 policies × 1 scenario × 2 seeds × 2 conditions: 8 episodes, 0 finished, 8 to drive" in planned.err
    assert f"{LOOK}: about 48 calls, tokens unknown" in planned.err
    assert not (tmp_path / "run").exists()
    driven = drive(*words)
    assert driven.code == 0
    assert "means over episodes" in driven.out
    again = drive(*words, "--json")
    assert again.code == 0
    assert "8 finished, 0 to drive" in again.err
    rows = {(row["policy"], row["condition"]): row for row in json.loads(again.out)["rows"]}
    assert rows[LOOK, "real"] == {**rows["oracle", "real"], "policy": LOOK}
    assert (rows[LOOK, "real"]["crash_rate"], rows[LOOK, "blank"]["crash_rate"]) == (0.0, 1.0)


def test_an_episode_in_error_and_a_limit_have_exit_codes_of_their_own(drive: Drive) -> None:
    """1 with the first error in words; 3 with what is left; the other episodes stand."""
    failed = drive("--policy", "oracle", "--scenarios", "whole,black", "--seeds", 1, "--json")
    assert failed.code == 1
    assert "1 episode ended in an error, first oracle in tiny/black/0: SpecError: the camera shows black" in failed.err
    (row,) = json.loads(failed.out)["rows"]
    assert (row["episodes"], row["errors"], row["crash_rate"]) == (1, 1, 0.0)
    cut = drive("--policy", LOOK, "--scenarios", "whole", "--seeds", 2, "--max-calls", 4)
    assert cut.code == 3
    assert "4 calls were sent, and --max-calls is 4" in cut.err
    assert "a higher limit resumes" in cut.err


def test_a_model_drives_beside_its_own_marginal_unless_it_is_left_out(drive: Drive) -> None:
    """It is in the plan and the rows by default, with real pictures alone, and costs no call."""
    words = ("--policy", LOOK, "--policy", "oracle", "--scenarios", "whole", "--seeds", 1)
    said = drive(*words, "--condition", "real", "--condition", "blank", "--json", alone=False)
    assert (
        "2 policies × 1 scenario × 1 seed × 2 conditions, and the marginal of one with real pictures: "
        "5 episodes, 0 finished, 5 to drive" in said.err
    )
    rows = [(row["policy"], row["condition"]) for row in json.loads(said.out)["rows"]]
    assert rows[-1] == (f"marginal:{LOOK}", "real")
    assert len(rows) == 5
    assert "done:" in said.err


def test_a_world_that_kills_or_hangs_its_sample_costs_the_estimate_alone(
    drive: Drive, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The command says what it cannot estimate, records the world's error, and drives the others."""
    told = drive("--policy", LOOK, "--scenarios", "fatal,whole", "--seeds", 1)
    assert (
        "cannot estimate the costs of the models' calls: tiny/fatal/0: its process ended with exit code -9" in told.err
    )
    assert told.code == 1
    ended = {episode.key.scenario: episode.ended for episode in read_episodes(tmp_path / "run")}
    assert ended == {"fatal": "error", "whole": "goal"}
    monkeypatch.setattr(plans, "PATIENCE_S", 1.0)
    hung = drive("--policy", "python:tiny_worlds:onward", "--scenarios", "hanging", "--seeds", 1, "--dry-run")
    assert (hung.code, "tiny/hanging/0: it did not answer for 1 s" in hung.err) == (0, True)
    raised = drive("--policy", "python:tiny_worlds:onward", "--scenarios", "raising", "--seeds", 1, "--dry-run")
    assert (raised.code, "tiny/raising/0: RuntimeError: the physics" in raised.err) == (0, True)


def test_a_world_that_cannot_be_opened_is_passed_over_by_a_probe(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Even one that takes its process down; the others show their pictures, and where none does that is said."""
    monkeypatch.setitem(SIMULATORS, "unopened", "tiny_worlds:Unopened")
    plan = partial(episodes.plan, "unopened", [LOOK], tmp_path, scenarios=["whole"])
    assert len(plan(seeds=[0, 1]).sample().questions) == 1
    with pytest.raises(SpecError, match="to probe a model with: its process ended with exit code -9"):
        plan(seeds=[0]).sample()


def test_what_a_world_raised_reaches_the_terminal_as_plain_text(tmp_path: Path) -> None:
    """No control character of an exception's does."""
    planned = episodes.plan("highway", ["oracle"], tmp_path, scenarios=["light"], seeds=[0])
    (key,) = planned.keys
    write_episodes(tmp_path, [Episode(key, (), "error", "", "RuntimeError: \x1b[31mred")])
    (words,), code = episodes.errors_ended({"": planned})
    assert code == 1
    assert "first oracle in highway/light/0: RuntimeError: �[31mred" in words


def test_episodes_that_cannot_be_written_end_the_run_with_the_place_and_a_way_on(
    drive: Drive, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """As an error of the ledger's does."""

    def full(*_: object) -> None:
        raise OSError(27, "File too large")

    monkeypatch.setattr(episodes.plans, "write_episodes", full)
    told = drive("--policy", "oracle", "--scenarios", "whole", "--seeds", 1)
    assert told.code == 2
    why = "no file may be longer here (ulimit -f)"
    assert f"{tmp_path / 'run' / 'episodes.jsonl'} cannot be written: {why}" in told.err
    assert "the same command resumes" in told.err


def test_a_run_that_ends_unfinished_says_why_by_policy(drive: Drive) -> None:
    """The errors of the last attempts by kind and count, for people and as JSON; what limits cut met none."""
    words = ("--policy", FAILING, "--policy", LOOK, "--scenarios", "whole", "--seeds", 2, "--concurrency", 1)
    words = (*words, "--condition", "real")
    told = drive(*words)
    assert told.code == 1
    why = "episodes are unfinished, 1 of them begun; the last errors of their calls: exception 10, as: RuntimeError"
    assert f"{FAILING}: 2 {why}" in told.err
    assert "2 episodes are unfinished; the same command continues" in told.err
    found = json.loads(drive("--policy", LOOK, "--seeds", 3, *words[4:6], *words[-2:], "--max-calls", 35, "--json").out)
    (left,) = found["unfinished"]
    assert (left["policy"], left["errors"], left["episodes"], found["left"]) == (LOOK, {}, 1, 1)


def test_calls_that_keep_failing_in_a_way_that_may_pass_are_counted_by_kind(
    drive: Drive, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One call an episode, however often it was tried; the score and the report say it too."""
    monkeypatch.setattr(attempts, "pause_s", lambda *_: 0.0)
    with FaultServer(["500 for ever"]) as server:
        words = ("--policy", "openai:m", "--base-url", server.base_url, "--no-probe", "--policy", "oracle")
        told = drive(*words, "--scenarios", "whole", "--seeds", 2, "--condition", "real")
    assert told.code == 1
    assert (
        "openai:m: 2 episodes are unfinished, 2 of them begun; the last errors of their calls: server_error 2, as: "
        in told.err
    )
    run = tmp_path / "run"
    left = score(run).unfinished
    assert [(one.policy, one.errors) for one in left[""]] == [("openai:m", {"server_error": 2})]
    page = make_drives_page([run], score(run), pictured=0).html.decode()
    assert "the last errors of their calls: server_error 2" in page


def test_a_model_drives_by_other_worlds_pictures_too_where_no_condition_is_named(drive: Drive, tmp_path: Path) -> None:
    """So its claim is tested; a policy that sees nothing drives once, and a run that goes on keeps its conditions."""
    words, run = ("--scenarios", "whole", "--seeds", 1), tmp_path / "run"

    def driven() -> set[tuple[str, str]]:
        return {(episode.key.policy, episode.key.condition) for episode in episodes.read_episodes(run)}

    assert drive("--policy", "oracle", *words).code == 0
    assert driven() == {("oracle", "real")}
    assert drive("--policy", "oracle", "--policy", LOOK, *words).code == 0
    assert driven() == {("oracle", "real"), (LOOK, "real")}
    shutil.rmtree(run)
    told = drive("--policy", LOOK, *words)
    assert (told.code, driven()) == (0, {(LOOK, "real"), (LOOK, "shuffled")})
    assert "1 seed × 2 conditions: 2 episodes" in told.err


def test_what_a_bound_on_steps_ended_goes_on_under_a_larger_one(drive: Drive) -> None:
    """The same command with --again; the message says so, and a smaller bound is refused."""
    words = ("--policy", "oracle", "--scenarios", "whole", "--seeds", 1)
    short = drive(*words, "--max-steps", 3)
    assert (short.code, short.err.count("it did not end within 3 steps")) == (1, 1)
    assert "a larger --max-steps lets those go on that reached the bound" in short.err
    assert drive(*words, "--max-steps", 30).code == 1
    longer = drive(*words, "--max-steps", 30, "--again")
    assert (longer.code, "ended in an error" in longer.err) == (0, False)
    assert drive(*words, "--max-steps", 3).code == 2


def test_a_limit_that_stops_what_is_driven_anew_is_told_as_one(drive: Drive) -> None:
    """The record of the first time stands, and yet the exit code is that of a limit."""
    words = ("--policy", LOOK, "--scenarios", "whole", "--seeds", 1)
    assert drive(*words, "--max-steps", 3).code == 1
    cut = drive(*words, "--max-steps", 30, "--again", "--max-calls", 5)
    assert cut.code == 3
    assert "5 calls were sent, and --max-calls is 5; 1 episode is left; a higher limit resumes" in cut.err
    assert drive(*words, "--max-steps", 30, "--again").code == 0


def test_drives_that_converge_and_a_planted_cache_are_told_apart(
    drive: Drive, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A constant model drives as the constant policy does; two models behind one cache by content are suspect."""
    words = ("--scenarios", "whole", "--seeds", 4, "--condition", "real")
    assert drive("--policy", "python:tiny_worlds:onward", "--policy", "constant:LEFT", *words).code == 0
    code, told, _ = audit(tmp_path, capsys, monkeypatch)
    assert code == 0
    assert "constant policies converge: python:tiny_worlds:onward, constant:LEFT: identical in 4 of 4 worlds" in told
    cached = ("--policy", "python:tiny_worlds:dealt", "--policy", "python:tiny_worlds:dealt_too")
    assert drive(*cached, *words).code == 0
    code, told, _ = audit(tmp_path, capsys, monkeypatch)
    assert code == 1
    assert "suspect caching: python:tiny_worlds:dealt, python:tiny_worlds:dealt_too: identical in 4 of 4" in told


def test_one_word_of_two_models_that_decide_alike_is_no_suspicion(
    drive: Drive, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The word follows from the decision, so exit 0; nor is a cache suspected once the ledger is gone."""
    both = ("--policy", "python:tiny_worlds:brief", "--policy", "python:tiny_worlds:brief_too")
    assert drive(*both, "--scenarios", "whole", "--seeds", 4).code == 0
    code, told, _ = audit(tmp_path, capsys, monkeypatch)
    assert code == 0
    assert "decide alike throughout: python:tiny_worlds:brief, python:tiny_worlds:brief_too: identical in 4" in told
    assert "replies are word for word the same, but nearly each follows from its decision" in told
    (tmp_path / "run" / "ledger.sqlite").unlink()
    code, told, _ = audit(tmp_path, capsys, monkeypatch)
    assert code == 0
    assert "no replies of both can be compared" in told


def audit(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Said:
    """Audit the run."""
    monkeypatch.setattr(sys, "argv", ["eyechart", "audit", str(tmp_path / "run")])
    with pytest.raises(SystemExit) as left:
        cli.main()
    said = Said(left.value.code, *capsys.readouterr())
    return said._replace(out=" ".join(said.out.split()))


def test_a_driver_that_reads_pixels_differs_from_itself_without_and_a_constant_does_not(
    drive: Drive, tmp_path: Path
) -> None:
    """Driven with real and blank pictures and scored; the report says both in words."""
    words = ("--scenarios", "whole", "--seeds", 10, "--condition", "real", "--condition", "blank")
    assert drive("--policy", LOOK, "--policy", "constant:LEFT", *words).code == 0
    scored = score(tmp_path / "run")
    sees, constant = scored.blind
    assert (sees.finding, "crash_rate" in sees.paired.changed) == ("differs", True)
    assert (constant.finding, constant.paired.changed) == ("identical", ())
    page = html.unescape(make_drives_page([tmp_path / "run"], scored, pictured=0).html.decode())
    assert "it drives differently with real pictures than with blank ones in the same 10 worlds" in page
    assert "all 10 drives are the same to the last digit with blank pictures as with real ones" in page


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--policy", "pilot"), "unknown policy 'pilot'; known are constant, random"),
        (("--policy", "oracle", "--seeds", "x"), "a number of worlds, or seeds with commas"),
        (("--policy", "oracle", "--engine", "cloud"), "unknown engine 'cloud'; known are local, ray"),
        (("--policy", "oracle", "--max-tokens", "5"), "would change no model"),
        (("--policy", "oracle", "--actions", "map.toml"), "has actions of its own"),
        ((), "at least one --policy"),
    ],
)
def test_bad_words_are_one_line_and_exit_2(drive: Drive, words: tuple[str, ...], message: str) -> None:
    """And nothing is written."""
    said = drive(*words)
    assert said.code == 2
    assert message in said.err
    assert "Traceback" not in said.err
