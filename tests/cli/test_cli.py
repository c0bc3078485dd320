"""The command line: its words, its exit codes, and what it prints where."""

import json
import os
import re
import signal
import subprocess
import sys
import time
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from typer.main import get_command

import banks
import stand_ins
from eyechart import __version__, cli
from eyechart.cli.app import app
from eyechart.cli.help import GROUPS, paragraphs
from eyechart.cli.terminal import table_console
from eyechart.conditions import CONDITIONS
from eyechart.errors import LedgerError
from eyechart.frames import FrameBank
from eyechart.manifest import LEDGER, read_run
from eyechart.models import ADAPTERS
from eyechart.prompts import PROMPTS
from eyechart.simulators import SIMULATORS

NOISY, STEADY = stand_ins.SPECS
COMMANDS = (
    "",
    "demo",
    "look",
    "doctor",
    "probe",
    "frames",
    "frames build",
    "frames import",
    "frames check",
    "frames show",
    "frames declare",
    "frames edit",
    "frames export",
    "run",
    "run battery",
    "run prompts",
    "run closed-loop",
    "run hierarchy",
    "run admission",
    "run structured",
    "run policy",
    "run import",
    "run online",
    "merge",
    "report",
    "ladder",
    "audit",
    "film",
    "bundle",
    "validate",
    "score",
    "verdict",
    "costs",
    "gate",
    "compare",
    "transfer",
    "guardian",
    "guardian fit",
    "guardian score",
    "guardian nested",
    "guardian modular",
    "guardian export",
    "serve",
    "paper",
    "plan",
    "calibrate",
    "list",
    "list models",
    "list conditions",
    "list prompts",
    "list modes",
    "list policies",
    "list simulators",
)


class Said(NamedTuple):
    """What a command returned and printed."""

    code: object
    out: str
    err: str


Eyechart = Callable[..., Said]


@pytest.fixture
def eyechart(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Eyechart:
    """Return the command line as a function of its words, with the stand-in models."""
    monkeypatch.setitem(ADAPTERS, "standin", "stand_ins")

    def run(*words: object) -> Said:
        monkeypatch.setattr(sys, "argv", ["eyechart", *map(str, words)])
        with pytest.raises(SystemExit) as left:
            cli.main()
        return Said(left.value.code, *capsys.readouterr())

    return run


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a bank of twelve frames that no test changes."""
    return banks.build_bank(tmp_path_factory.mktemp("cli") / "bank", scenarios=["light", "dense"])


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_explains_itself(eyechart: Eyechart, command: str) -> None:
    """``--help`` says how to call it and exits 0."""
    said = eyechart(*command.split(), "--help")
    assert said.code == 0
    assert f"eyechart {command}".strip() in said.out
    assert said.err == ""


@pytest.mark.parametrize("command", COMMANDS)
def test_help_at_80_columns_cuts_nothing(eyechart: Eyechart, command: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every word of every option's help stands there whole, and each example on a line of its own."""
    monkeypatch.setenv("COLUMNS", "80")
    found: Any = get_command(app)
    for name in command.split():
        found = found.commands[name]
    lines = eyechart(*command.split(), "--help").out.splitlines()
    said = [param.help for param in found.params if getattr(param, "help", None)]
    said += [one.get_short_help_str(200) for one in getattr(found, "commands", {}).values()]
    whole = "".join("".join(lines).split())
    assert [text for text in said if "".join(text.split()) not in whole] == []
    assert [line for line in lines if re.search(r"(^|\s)(-|\S*[:/])\S*-$", line)] == []  # an option or an address
    examples = [words for name, words in paragraphs(f"{found.help}\n\n{found.epilog or ''}") if name]
    assert [example for example in examples if f"    {example}" not in lines] == []
    assert all(len(line) <= 80 for line in lines if line.strip() not in examples)


def test_every_command_stands_in_one_group_of_the_help() -> None:
    """And no group names one that there is not."""
    named = [name for names in GROUPS.values() for name in names]
    assert sorted(named) == sorted(get_command(app).commands)  # type: ignore[attr-defined]


def test_the_list_of_models_begins_with_what_a_user_fills_in(eyechart: Eyechart) -> None:
    """What has a word in capitals to fill in comes before every known answer."""
    for what in ("models", "policies"):
        names = [line.split()[0].partition(":")[2] for line in eyechart("list", what).out.splitlines()]
        own = [name.isupper() for name in names]
        assert own == sorted(own, reverse=True)
        assert own[0]


def test_the_list_of_commands_in_this_test_is_complete(eyechart: Eyechart) -> None:
    """A command that is added is tested too."""
    found = [""]
    for name, command in get_command(app).commands.items():  # type: ignore[attr-defined]
        found += [name, *(f"{name} {inner}" for inner in getattr(command, "commands", {}))]
    assert sorted(found) == sorted(COMMANDS)
    assert eyechart("--version").out == f"eyechart {__version__}\n"


def test_help_imports_nothing_heavy() -> None:
    """``eyechart --help`` answers at once, because numpy, scipy and pygame stay out."""
    program = (
        "import sys; sys.argv = ['eyechart', '--help']; from eyechart.cli import main\n"
        "try: main()\n"
        "except SystemExit as left: print('code', left.code)\n"
        "heavy = {'numpy', 'scipy', 'pygame', 'PIL', 'gymnasium', 'highway_env', 'matplotlib', 'jinja2'}\n"
        "print('heavy', sorted(heavy & set(sys.modules)))"
    )
    said = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True).stdout
    assert "code 0\n" in said
    assert said.endswith("heavy []\n")


def test_a_run_from_bank_to_verdict(eyechart: Eyechart, bank: FrameBank, tmp_path: Path) -> None:
    """Plan, run, run again, score and judge; what is for programs is JSON alone on standard output."""
    words = ("run", "battery", "--model", STEADY, "--frames", bank.root, "--out", tmp_path / "run", "--limit", 8)
    planned = eyechart(*words, "--dry-run")
    assert planned.code == 0
    assert "1 model × 8 frames × 11 conditions" in planned.err
    assert not (tmp_path / "run").exists()
    ran = eyechart(*words)
    assert (ran.code, ran.out) == (0, "")
    assert ", 0 finished, 0 sent with unknown outcome" in ran.err
    assert ", 0 to make" in eyechart(*words).err
    scored, judged = (eyechart(command, tmp_path / "run", "--json") for command in ("score", "verdict"))
    assert (scored.code, judged.code) == (0, 0)
    statistics = json.loads(scored.out)["models"][STEADY]["statistics"]
    assert all({"value", "n", "ci", "p"} <= set(statistic) for statistic in statistics.values())
    verdict = json.loads(judged.out)["models"][STEADY]
    assert {"paper", "calibrated", "lateral", "evidence", "because", "notes"} <= set(verdict)
    assert STEADY in eyechart("verdict", tmp_path / "run").out
    assert STEADY in eyechart("score", tmp_path / "run").out


@pytest.mark.slow
def test_a_report_is_written_with_its_figures_and_tables(eyechart: Eyechart, bank: FrameBank, tmp_path: Path) -> None:
    """One page; what it lacks is said on standard error, and exit 2 is for folders that are no run."""
    run, out = tmp_path / "run", tmp_path / "out"
    words = ("--frames", bank.root, "--out", run, "--conditions", "real,mirrored,lead_near,lead_far", "--limit", 4)
    assert eyechart("run", "battery", "--model", STEADY, *words).code == 0
    said = eyechart(
        "report", run, "--out", out / "report.html", "--figures", out / "figures", "--tables", out / "tables"
    )
    assert (said.code, said.out) == (0, "")
    assert f"wrote {out / 'report.html'}, 0." in said.err
    assert STEADY in (out / "report.html").read_text(encoding="utf-8")
    assert (out / "figures" / "agreement.pdf").is_file()
    assert (out / "tables" / "verdicts.tex").is_file()
    assert [path.name for path in out.iterdir() if path.name.startswith(".")] == []
    without = eyechart("report", run, "--out", out / "report.html", "--frames", tmp_path / "none")
    assert without.code == 0
    assert "without pictures, because the bank 'none' is not there" in without.err
    refused = eyechart("report", run, tmp_path / "none", "--out", out / "b.html")
    assert refused.code == 2
    assert refused.err.count("\n") == 1
    assert not (out / "b.html").exists()


@pytest.mark.parametrize(
    ("command", "option", "place", "said"),
    [
        ("report", "--out", "run/ledger.sqlite", "belongs to the run"),
        ("report", "--out", "run/bank/new.html", "belongs to the run"),
        ("report", "--out", "bank/manifest.json", "belongs to the bank"),
        ("report", "--out", "bank/images/new.html", "belongs to the bank"),
        ("report", "--out", "notes.txt", "exists and is no report"),
        ("report", "--out", "notes.txt/report.html", "is no folder"),
        ("report", "--out", "bank", "is a folder"),
        ("bundle", "--out", "run/run.json", "belongs to the run"),
        ("bundle", "--out", "notes.txt", "exists and is no bundle"),
        ("bundle", "--out", "link.zip", "belongs to the run"),
        ("gate", "--junit", "run/ledger.sqlite-wal", "belongs to the run"),
        ("gate", "--junit", "notes.txt", "exists and is no JUnit file"),
    ],
)
def test_no_output_takes_the_place_of_something_else(
    eyechart: Eyechart, tmp_path: Path, command: str, option: str, place: str, said: str
) -> None:
    """A wrong path costs no run, no bank and no notes: one line, exit 2, and everything as it was."""
    made = banks.build_bank(tmp_path / "bank", scenarios=["light"])
    words = ("--frames", made.root, "--out", tmp_path / "run", "--conditions", "real,blank", "--limit", 2)
    assert eyechart("run", "battery", "--model", STEADY, *words).code == 0
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "link.zip").symlink_to(tmp_path / "run" / "ledger.sqlite")
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    refused = eyechart(command, tmp_path / "run", option, tmp_path / place)
    assert (refused.code, refused.err.count("\n")) == (2, 1)
    assert said in refused.err
    assert str(tmp_path / place) in refused.err
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before


def test_an_output_takes_the_place_of_its_own_kind_and_makes_its_folders(eyechart: Eyechart, tmp_path: Path) -> None:
    """A report by any name and a JUnit file are written again, in folders that are made; a name too long is said."""
    made = banks.build_bank(tmp_path / "bank", scenarios=["light"])
    run = tmp_path / "run"
    words = ("--frames", made.root, "--out", run, "--conditions", "real,blank", "--limit", 2)
    assert eyechart("run", "battery", "--model", STEADY, *words).code == 0
    for _ in range(2):
        assert eyechart("report", run, "--out", tmp_path / "new" / "report").code == 0
        gated = eyechart("gate", run, "--junit", tmp_path / "deep" / "er" / "gate.xml")
        assert (gated.code, (tmp_path / "deep" / "er" / "gate.xml").is_file()) == (2, True)
    long = eyechart("gate", run, "--junit", tmp_path / ("x" * 300))
    assert (long.code, long.out) == (2, "")
    assert "cannot be written: File name too long" in long.err


def test_a_bundle_is_made_and_validated(eyechart: Eyechart, bank: FrameBank, tmp_path: Path) -> None:
    """Exit 0 where everything follows, 1 with the figure by name where it does not, 2 where there is no bundle."""
    run, out = tmp_path / "run", tmp_path / "run.zip"
    words = ("--frames", bank.root, "--out", run, "--conditions", "real,blank", "--limit", 4)
    assert eyechart("run", "battery", "--model", STEADY, *words).code == 0
    made = eyechart("bundle", run, "--out", out)
    assert (made.code, made.out) == (0, "")
    assert f"wrote {out}: " in made.err
    held = eyechart("validate", out)
    assert (held.code, held.out.startswith("holds: ")) == (0, True)
    changed = tmp_path / "changed.zip"
    with zipfile.ZipFile(out) as old, zipfile.ZipFile(changed, "w") as new:
        for entry in old.infolist():
            content = old.read(entry)
            if entry.filename == "results.json":
                content = content.replace(b'"planned": 8', b'"planned": 9')
            new.writestr(entry, content)
    differs = eyechart("validate", changed)
    assert differs.code == 1
    assert f"differs: results.json, {STEADY}, planned: printed '9', recomputed '8'" in differs.out
    told = json.loads(eyechart("validate", changed, "--json").out)
    assert told["holds"] is False
    assert {"where": f"results.json, {STEADY}, planned", "printed": "9", "recomputed": "8"} in told["differences"]
    none = eyechart("validate", bank.root / "manifest.json")
    assert none.code == 2
    assert none.err.count("\n") == 1
    assert eyechart("bundle", tmp_path / "none", "--out", out).code == 2


def test_a_run_of_another_reader_is_read_anew_only_when_asked(
    eyechart: Eyechart, bank: FrameBank, tmp_path: Path
) -> None:
    """Decisions read by a version of the reader that is not here are never taken for those of today without a word."""
    out = tmp_path / "run"
    assert eyechart("run", "battery", "--model", STEADY, "--frames", bank.root, "--out", out, "--limit", 8).code == 0
    today = eyechart("verdict", out, "--json").out
    recorded = json.loads((out / "run.json").read_text(encoding="utf-8"))
    (out / "run.json").write_text(json.dumps(recorded | {"reader": 0}), encoding="utf-8")
    for command in ("verdict", "score", "gate"):
        refused = eyechart(command, out)
        assert refused.code == 2
        assert "read its replies anew with --reread" in refused.err
    assert eyechart("verdict", out, "--json", "--reread").out == today


def test_shards_are_merged_from_the_command_line(eyechart: Eyechart, bank: FrameBank, tmp_path: Path) -> None:
    """Two shards and their merger; a shard too much is refused."""
    words = ("run", "battery", "--model", STEADY, "--frames", bank.root, "--conditions", "real, blank")
    for index in (1, 2):
        assert eyechart(*words, "--out", tmp_path / str(index), "--shard", f"{index}/2").code == 0
    merged = eyechart("merge", tmp_path / "1", tmp_path / "2", "--out", tmp_path / "merged")
    assert merged.code == 0
    assert merged.err == f"24 calls from 2 shards in {tmp_path / 'merged'}\n"
    assert read_run(tmp_path / "merged")[0].conditions == ("real", "blank")
    again = eyechart("merge", tmp_path / "1", tmp_path / "1", "--out", tmp_path / "twice")
    assert again.code == 2
    assert "finished in both ledgers" in again.err


def test_unfinished_calls_are_reported(
    eyechart: Eyechart, bank: FrameBank, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A run whose endpoint was down does not call itself complete."""
    from eyechart.calls import Reply  # noqa: PLC0415 - nowhere else needed

    monkeypatch.setattr("eyechart.run.random.random", lambda: -1.0)
    monkeypatch.setattr(stand_ins, "open_model", lambda *_: stand_ins.StandIn(lambda _: Reply(error="connection")))
    words = ("--frames", bank.root, "--out", tmp_path / "run", "--conditions", "real", "--limit", 2)
    said = eyechart("run", "battery", "--model", STEADY, *words)
    assert "2 calls are unfinished" in said.err


UNKNOWN = {
    "model": (("--model", "scripted:nobody"), "scripted:nobody", "presence"),
    "adapter": (("--model", "gpt"), "'gpt'", "scripted:NAME"),
    "prompt": (("--prompt", "poem"), "'poem'", ", ".join(PROMPTS)),
    "condition": (("--conditions", "real,snow"), "'snow'", ", ".join(CONDITIONS)),
    "empty conditions": (("--conditions", ""), "''", ", ".join(CONDITIONS)),
    "shard": (("--shard", "3/2"), "'3/2'", "2/4"),
    "limit": (("--limit", "0"), "--limit", "at least 1"),
}


@pytest.mark.parametrize("what", UNKNOWN)
def test_an_unknown_name_is_one_line_that_lists_the_known(
    eyechart: Eyechart, bank: FrameBank, tmp_path: Path, what: str
) -> None:
    """Exit 2, nothing written."""
    words, named, known = UNKNOWN[what]
    model = () if "--model" in words else ("--model", STEADY)
    said = eyechart("run", "battery", *model, *words, "--frames", bank.root, "--out", tmp_path / "run")
    assert (said.code, said.out) == (2, "")
    assert said.err.startswith("eyechart: ")
    assert said.err.count("\n") == 1
    assert named in said.err
    assert known in said.err
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("seeds", ["", "a", "1,,2", "1,1", "-1", "0.5", "1;2"])
def test_bad_seeds_are_refused(eyechart: Eyechart, tmp_path: Path, seeds: str) -> None:
    """In one line that says what seeds are."""
    said = eyechart("frames", "build", "highway", "--out", tmp_path / "bank", f"--seeds={seeds}")
    assert said.code == 2
    assert "--seeds takes" in said.err
    assert f"'{seeds}'" in said.err
    assert not (tmp_path / "bank").exists()


def test_an_unknown_simulator_or_preset_lists_the_known(eyechart: Eyechart, tmp_path: Path) -> None:
    """Exit 2, nothing written."""
    said = eyechart("frames", "build", "boats", "--out", tmp_path / "bank")
    assert (said.code, said.err) == (
        2,
        f"eyechart: unknown simulator 'boats'; known: {', '.join(SIMULATORS)}, gym:ENV_ID\n",
    )
    said = eyechart("frames", "build", "highway", "--out", tmp_path / "bank", "--preset", "hard")
    assert said.code == 2
    assert "'hard'" in said.err
    assert "balanced" in said.err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "words",
    [
        ("run", "battery"),
        ("run", "battery", "--model", STEADY, "--frames", "x", "--out", "y", "--seed", "one"),
        ("run", "battery", "--model", STEADY, "--frames", "x", "--out", "y", "--concurrency", "0"),
        ("frames", "check"),
        ("frames", "polish"),
        ("score",),
        ("sing",),
        ("merge", "x"),
        ("list", "models", "--yaml"),
    ],
)
def test_words_that_make_no_command_exit_2(eyechart: Eyechart, words: tuple[str, ...]) -> None:
    """With a hint on standard error, and no traceback."""
    said = eyechart(*words)
    assert (said.code, said.out) == (2, "")
    assert "Usage: eyechart" in said.err
    assert "Traceback" not in said.err


@pytest.mark.parametrize("command", ["score", "verdict", "frames check", "frames show"])
def test_a_folder_that_is_not_there_is_one_line(eyechart: Eyechart, tmp_path: Path, command: str) -> None:
    """With the command that makes one."""
    out = ("--out", tmp_path / "sheet.png") if command == "frames show" else ()
    said = eyechart(*command.split(), tmp_path / "none", *out)
    assert (said.code, said.out) == (2, "")
    assert said.err.startswith(f"eyechart: {tmp_path / 'none'}")
    assert "'eyechart " in said.err
    assert said.err.count("\n") == 1


def test_a_run_that_is_not_there_names_the_commands_of_models_and_of_policies(
    eyechart: Eyechart, tmp_path: Path
) -> None:
    """Nobody knows which of them was meant."""
    said = eyechart("score", tmp_path / "none")
    assert "'eyechart run battery' makes one of models, 'eyechart run policy' one of policies" in said.err


def test_checking_a_bank_answers_in_words_and_in_json(eyechart: Eyechart, tmp_path: Path) -> None:
    """Exit 0 for a bank as recorded, 1 where something differs, with the file's name."""
    bank = banks.build_bank(tmp_path / "bank", scenarios=["light"])
    assert eyechart("frames", "check", bank.root).code == 0
    fine = eyechart("frames", "check", bank.root, "--json")
    assert (fine.code, json.loads(fine.out)) == (0, {"bank": str(bank.root), "ok": True, "problems": []})
    (bank.root / "images" / "light-0-1.png").write_bytes(b"x")
    damaged = eyechart("frames", "check", bank.root, "--json")
    assert damaged.code == 1
    assert "'images/light-0-1.png'" in json.loads(damaged.out)["problems"][0]


def test_a_contact_sheet_is_written(eyechart: Eyechart, bank: FrameBank, tmp_path: Path) -> None:
    """A picture of every frame, or of a counterfactual; an unknown one is refused."""
    from eyechart.frames import decode  # noqa: PLC0415 - nowhere else needed

    for extra in ((), ("--counterfactual", "lead_far"), ("--limit", "2")):
        out = tmp_path / "sheets" / f"{len(extra)}.png"
        assert eyechart("frames", "show", bank.root, "--out", out, *extra).code == 0
        assert decode(out.read_bytes(), "sheet").std() > 0
    said = eyechart("frames", "show", bank.root, "--out", tmp_path / "no.png", "--counterfactual", "snow")
    assert said.code == 2
    assert "'snow'" in said.err
    assert not (tmp_path / "no.png").exists()


@pytest.mark.parametrize("what", ["models", "conditions", "prompts", "simulators"])
def test_lists_are_for_people_and_for_programs(eyechart: Eyechart, what: str) -> None:
    """Every name stands at the beginning of a line, and as a key of the JSON."""
    listed = json.loads(eyechart("list", what, "--json").out)
    lines = eyechart("list", what).out.splitlines()
    assert len(listed) == len(lines) > 0
    assert all(line.startswith(name) and says in line for line, (name, says) in zip(lines, listed.items(), strict=True))
    expected = {"conditions": set(CONDITIONS), "prompts": set(PROMPTS)}.get(what)
    assert expected is None or expected <= set(listed)
    if what == "conditions":
        assert {"swapped@CHANNEL", "kept@CHANNEL", "noise@CAMERA", "named_plus", "told_other_minus"} <= set(listed)


def test_a_fault_of_the_machine_is_one_line(eyechart: Eyechart, bank: FrameBank, tmp_path: Path) -> None:
    """A file where a folder has to be is said in one line, as bad input is."""
    (tmp_path / "file").touch()
    said = eyechart("frames", "show", bank.root, "--out", tmp_path / "file" / "sheet.png")
    assert said.code == 2
    assert said.err.startswith("eyechart: ")
    assert str(tmp_path / "file") in said.err
    assert said.err.count("\n") == 1


def tool(*words: object) -> subprocess.CompletedProcess[str]:
    """Run the tool in a process of its own."""
    line = [sys.executable, "-c", "from eyechart.cli import main; main()", *map(str, words)]
    return subprocess.run(line, check=False, capture_output=True, text=True)


def test_a_traceback_comes_only_with_debug(eyechart: Eyechart, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """--debug may stand anywhere."""
    plain = eyechart("score", tmp_path)
    assert (plain.code, plain.out) == (2, "")
    assert "Traceback" not in plain.err
    for words in (("--debug", "score", tmp_path), ("score", tmp_path, "--debug")):
        monkeypatch.setattr(sys, "argv", ["eyechart", *map(str, words)])
        with pytest.raises(LedgerError):
            cli.main()
    said = tool("score", tmp_path, "--debug")
    assert said.returncode == 1
    assert "Traceback" in said.stderr
    assert "LedgerError" in said.stderr


def test_ctrl_c_says_what_is_kept_and_exits_130(bank: FrameBank, tmp_path: Path) -> None:
    """The same command then goes on."""
    program = "import stand_ins; stand_ins.install(); stand_ins.PAUSE_S = 0.3; from eyechart.cli import main; main()"
    words = ("run", "battery", "--model", NOISY, "--frames", str(bank.root), "--out", str(tmp_path / "run"))
    env = os.environ | {"PYTHONPATH": str(Path(stand_ins.__file__).parent)}
    with subprocess.Popen(
        [sys.executable, "-c", program, *words], env=env, stderr=subprocess.PIPE, text=True
    ) as running:
        while running.poll() is None and stand_ins.rows_in(tmp_path / "run" / LEDGER, "replies") < 3:
            time.sleep(0.01)
        running.send_signal(signal.SIGINT)
        _, said = running.communicate(timeout=20)
    assert running.returncode == 130
    assert said.endswith("interrupted: finished calls are kept; the same command resumes\n")
    assert "Traceback" not in said
    assert stand_ins.rows_in(tmp_path / "run" / LEDGER, "replies") >= 3


def test_a_closed_pipe_is_no_fault() -> None:
    """``eyechart list prompts | head -1`` ends without a traceback."""
    line = f"{sys.executable} -c 'from eyechart.cli import main; main()' list prompts | head -c 1"
    said = subprocess.run(["bash", "-c", line], check=True, capture_output=True, text=True)
    assert len(said.stdout) == 1
    assert said.stderr == ""


def test_a_table_prints_the_name_of_a_model_as_it_is(capsys: pytest.CaptureFixture[str]) -> None:
    """What stands between colons is a part of it, and no emoji."""
    table_console().print("ollama:smile:latest", markup=False)
    assert capsys.readouterr().out == "ollama:smile:latest\n"
