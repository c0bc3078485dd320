"""What goes wrong in Python is said of arguments, and what a test suite asks for fails on one screen."""

import ast
import re
from collections.abc import Callable
from pathlib import Path

import pytest

import eyechart
from arms import reach
from banks import build_bank
from eyechart import api, importing, testing
from eyechart.api import read_report, run_battery
from eyechart.errors import EyechartError, in_arguments
from eyechart.frames import FrameBank
from eyechart.gate import REQUIREMENTS
from eyechart.importing import Choices, Convert, import_lerobot, import_table
from eyechart.modes import RequestMode
from eyechart.testing import assert_grounded
from known import Demo

OPTION = re.compile(r"--[a-z]")
COMMAND = re.compile(r"'(?:eyechart|hf|python -m) [^']*'|pip install .*")
PACKAGE = Path(eyechart.__file__).parent


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a small bank."""
    return build_bank(tmp_path_factory.mktemp("bank") / "bank")


def literals() -> list[str]:
    """Return every text of the package, outside its commands, that names an option and is no docstring."""
    found = []
    for path in sorted(PACKAGE.rglob("*.py")):
        if "cli" in path.parts or path.name == "errors.py":
            continue
        tree = ast.parse(path.read_text(encoding="utf-8"))
        inside = {id(part) for node in ast.walk(tree) if isinstance(node, ast.JoinedStr) for part in node.values}
        for one in ast.walk(tree):
            if isinstance(one, ast.JoinedStr):
                parts = (part.value if isinstance(part, ast.Constant) else "7" for part in one.values)
                found.append("".join(map(str, parts)))
            elif isinstance(one, ast.Constant) and isinstance(one.value, str) and id(one) not in inside:
                found.append(one.value)
    return [text for text in found if OPTION.search(text) and "var(--" not in text]


def test_every_message_of_the_package_can_be_said_in_arguments() -> None:
    """No option is left, whatever message it stands in; a command that is to be run stays as it is."""
    texts = literals()
    assert len(texts) > 100
    for text in texts:
        said = in_arguments(text)
        assert not OPTION.search(COMMAND.sub("", said)), (text, said)
        assert COMMAND.findall(said) == COMMAND.findall(text.replace("'eyechart run' with --", "--"))
        assert in_arguments(said) == said


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("choose another --out for this bank", "choose another out for this bank"),
        ("try --base-url http://127.0.0.1:8000/v1; or", "try base_url='http://127.0.0.1:8000/v1'; or"),
        ("name it with --map file=COLUMN; it has", "name it with columns={'file': 'COLUMN'}; it has"),
        ("leave it out with --map gap=", "leave it out with columns={'gap': ''}"),
        ("--no-probe", "probe=False"),
        ("or continue a run with --moved, which records it", "or continue a run with moved=True, which records it"),
        ("a --mode file, or use --no-probe", "a RequestMode, or use probe=False"),
        ("--temperature default", "temperature='default'"),
        ("begun with --limit 20, now --limit 5", "begun with limit=20, now limit=5"),
        ("'eyechart bundle RUN --out FILE' makes one", "'eyechart bundle RUN --out FILE' makes one"),
        ("or 'eyechart run' with --moved to continue", "or moved=True to continue"),
        ("a folder my--out, a dash -- and --", "a folder my--out, a dash -- and --"),
    ],
)
def test_an_option_is_said_as_its_argument(words: str, said: str) -> None:
    """With its value, where the message gives one."""
    assert in_arguments(words) == said


def wrong_calls(bank: FrameBank, demo: Demo, tmp: Path) -> dict[str, Callable[[], object]]:
    """Return calls of every function for Python that cannot be, by what is wrong."""
    (tmp / "file").write_text("no folder")
    (tmp / "taken").mkdir()
    (tmp / "taken" / "else").write_text("of somebody")
    (tmp / "t.csv").write_text("photo,tick\nnone.png,x\n")
    (tmp / "many.csv").write_text("name,a\n1,2,3\n4\n")
    run = tmp / "run"
    run_battery(bank, "scripted:depth", run, limit=1)
    table = api.build_bank(tmp / "table", simulator="tabletop", steps=4)
    report = read_report(run)
    own = RequestMode("openai:m", base_url="http://127.0.0.1:9/v1")
    return {
        "build_bank simulator": lambda: api.build_bank(tmp / "b", simulator="highwya"),
        "build_bank preset": lambda: api.build_bank(tmp / "b", preset="none"),
        "build_bank steps": lambda: api.build_bank(tmp / "b", steps="3"),
        "build_bank seeds": lambda: api.build_bank(tmp / "b", seeds=3),
        "build_bank one seed": lambda: api.build_bank(tmp / "b", seeds=("0",)),
        "build_bank taken": lambda: api.build_bank(tmp / "taken"),
        "build_bank gym": lambda: api.build_bank(tmp / "b", simulator="gym:CarRacing-v3"),
        "run_battery no bank": lambda: run_battery(tmp / "none", "scripted:depth", tmp / "r"),
        "run_battery no model": lambda: run_battery(bank, [], tmp / "r"),
        "run_battery unknown": lambda: run_battery(bank, "scripted:depht", tmp / "r"),
        "run_battery no key": lambda: run_battery(bank, "openai:m", tmp / "r", key_env="NO_SUCH_KEY"),
        "run_battery controls": lambda: run_battery(bank, "scripted:depth", tmp / "r", controls="some"),
        "run_battery limit": lambda: run_battery(bank, "scripted:depth", tmp / "r", limit=0),
        "run_battery prompt": lambda: run_battery(bank, "scripted:depth", tmp / "r", prompt="none"),
        "run_battery taken": lambda: run_battery(bank, "scripted:depth", tmp / "taken"),
        "run_battery a file": lambda: run_battery(bank, "scripted:depth", tmp / "file"),
        "run_battery other seed": lambda: run_battery(bank, "scripted:depth", run, seed=5),
        "run_battery other mode": lambda: run_battery(bank, "scripted:depth", run, max_tokens=5),
        "run_battery nobody there": lambda: run_battery(bank, "openai:m", tmp / "r", base_url="http://127.0.0.1:9/v1"),
        "run_battery no change": lambda: run_battery(bank, own, tmp / "r", max_tokens=5),
        "run_battery a word for a number": lambda: run_battery(bank, "scripted:depth", tmp / "r", limit="3"),
        "run_battery no whole seed": lambda: run_battery(bank, "scripted:depth", tmp / "r", seed=0.5),
        "run_battery concurrency": lambda: run_battery(bank, stop, tmp / "r", concurrency=True),
        "run_battery a name lost": lambda: run_battery(bank, {"x": "scripted:depth"}, tmp / "r"),
        "run_battery a name of another kind": lambda: run_battery(bank, {1: stop}, tmp / "r"),
        "run_battery secret": lambda: run_battery(bank, "openai:m", tmp / "r", headers={"Authorization": "Bearer x"}),
        "look two places": lambda: api.look("scripted:depth", bank=tmp, dataset=tmp),
        "look no table": lambda: api.look("scripted:depth", photos=tmp),
        "look of no use": lambda: api.look("scripted:depth", threshold=5.0, columns={"gap": "x"}),
        "look threshold": lambda: api.look("scripted:depth", bank=bank, threshold="near"),
        "look nobody": lambda: api.look(7, bank=bank),
        "look unknown": lambda: api.look("scripted:depht", bank=bank, out=tmp / "l"),
        "look budget": lambda: api.look("scripted:depth", bank=bank, out=tmp / "l", budget=20),
        "look no whole budget": lambda: api.look("scripted:depth", bank=bank, budget="20"),
        "look rows": lambda: api.look("scripted:depth", photos=tmp, table=tmp / "many.csv", out=tmp / "l"),
        "read_report no run": lambda: read_report(tmp / "taken"),
        "read_report independent": lambda: read_report(run, independent=True),
        "read_report resamples": lambda: read_report(run, resamples="many"),
        "run_policies no motions": lambda: api.run_policies(bank, "trained:sees", tmp / "r"),
        "run_policies unknown": lambda: api.run_policies(table, "trained:seas", tmp / "r"),
        "run_policies none": lambda: api.run_policies(table, [], tmp / "r"),
        "run_policies no policy": lambda: api.run_policies(table, [7], tmp / "r"),
        "run_policies a SPEC is named": lambda: api.run_policies(table, {"x": "trained:sees"}, tmp / "r"),
        "run_policies two of a name": lambda: api.run_policies(table, [reach, reach], tmp / "r"),
        "run_policies what it takes": lambda: api.run_policies(table, stop, tmp / "r"),
        "run_policies answers": lambda: api.run_policies(table, reach, tmp / "r", answers=1),
        "run_policies a word for a number": lambda: api.run_policies(table, reach, tmp / "r", limit="3"),
        "run_policies condition": lambda: api.run_policies(table, reach, tmp / "r", conditions=["swapped@nose"]),
        "run_policies shapley": lambda: api.run_policies(table, reach, tmp / "r", shapley="yes"),
        "run_policies taken": lambda: api.run_policies(table, reach, tmp / "taken"),
        "read_policies no run": lambda: api.read_policies(tmp / "taken"),
        "read_policies of models": lambda: api.read_policies(run),
        "examine_policy two": lambda: api.examine_policy(table, {"one": reach, "other": reach}),
        "examine_policy no motions": lambda: api.examine_policy(bank, reach),
        "compare_prompts one": lambda: api.compare_prompts(bank, "scripted:depth", ["baseline"], tmp / "p"),
        "compare_prompts unknown": lambda: api.compare_prompts(bank, "scripted:depth", ["baseline", "loud"], tmp / "p"),
        "compare_prompts limit": lambda: api.compare_prompts(
            bank, "scripted:depth", ["baseline", "minimal"], tmp, limit=0
        ),
        "report model": lambda: report["scripted:none"],
        "report page taken": lambda: report.to_html(tmp / "taken"),
        "assert_grounded no run": lambda: assert_grounded(tmp / "taken"),
        "assert_grounded requirement": lambda: assert_grounded(run, "dephth"),
        "assert_grounded rate": lambda: assert_grounded(run, max_unparsed=7.0),
        "assert_grounded order": lambda: assert_grounded(demo.run, order=2.0),
        "assert_grounded no order": lambda: assert_grounded(run, order="strict"),
        "assert_grounded resamples": lambda: assert_grounded(run, resamples=0),
        "assert_grounded no rate": lambda: assert_grounded(run, max_unparsed="few"),
        "assert_grounded independent": lambda: assert_grounded(demo.run, independent=True),
        "import_table columns": lambda: import_table(tmp, tmp / "t.csv", tmp / "b", Choices(threshold=3.0)),
        "import_table rows": lambda: import_table(tmp, tmp / "many.csv", tmp / "b", Choices(every=0)),
        "import_table threshold": lambda: import_table(tmp, tmp / "t.csv", tmp / "b", Choices(threshold="near")),
        "import_table great threshold": lambda: import_table(tmp, tmp / "t.csv", tmp / "b", Choices(threshold=1e308)),
        "import_table no float": lambda: import_table(tmp, tmp / "t.csv", tmp / "b", Choices(threshold=10**400)),
        "import_table no table": lambda: import_table(tmp, tmp / "none.csv", tmp / "b", Choices()),
        "import_table axis": lambda: import_table(
            tmp, tmp / "t.csv", tmp / "b", Choices(mirror="vertical", columns={"mirror": "tick", "colour": "x"})
        ),
        "import_lerobot": lambda: import_lerobot(tmp / "taken", tmp / "b", Choices()),
        "import_hdf5": lambda: importing.import_hdf5(tmp / "taken", tmp / "b", Choices()),
        "import_hdf5 rate": lambda: importing.import_hdf5(tmp / "none.hdf5", tmp / "b", Choices(), rate=-1),
        "import_lerobot place": lambda: import_lerobot(tmp, tmp / "b", Choices(columns={"lead_near": "x"})),
        "read_rig": lambda: importing.read_rig(tmp / "t.csv"),
        "convert": lambda: Convert(longest=0),
    }


def test_errors_speak_of_arguments(bank: FrameBank, demo: Demo, tmp_path: Path) -> None:
    """Of every function for Python, called in ways that cannot be; the kind of the error is the command's."""
    calls = wrong_calls(bank, demo, tmp_path)
    for name, call in calls.items():
        with pytest.raises(EyechartError) as caught:
            call()
        said = str(caught.value)
        assert said, name
        assert not OPTION.search(COMMAND.sub("", said)), (name, said)
    tried = {name.split()[0] for name in calls}
    assert tried >= {"build_bank", "run_battery", "read_report", "assert_grounded", "import_table", "import_lerobot"}
    kinds = {"Report", "PolicyReport", "PromptsReport", "AskedModel", "AskedPolicy"}
    assert {*api.__all__} - kinds == {name for name in tried if hasattr(api, name)}
    of_tables = {name for name in importing.__all__ if name.startswith(("import", "read"))}
    assert of_tables - tried == {"read_answer_table"}, "which commands take too"
    assert [name for name in vars(testing) if name.startswith("assert")] == ["assert_grounded", "assert_looks"]


def stop(prompt: str, image: bytes | None) -> str:
    """Answer STOP to all."""
    del prompt, image
    return "STOP"


@pytest.mark.slow
def test_a_failure_fits_on_one_screen(demo: Demo, bank: FrameBank, tmp_path: Path) -> None:
    """Sixteen models and every requirement, long names too: what fails first, the rest counted, 24 lines of 80."""
    for require in (("depth",), tuple(REQUIREMENTS)):
        with pytest.raises(AssertionError) as caught:
            assert_grounded(demo.run, *require, resamples=100)
        lines = str(caught.value).splitlines()
        assert len(lines) <= 24
        assert max(map(len, lines)) <= 80 - len("E       ")
        first, *told, last = lines
        assert re.fullmatch(r"\d+ of \d+ checks do not hold", first)
        count = int(first.split()[0])
        shown = sum(bool(re.search(r": (fails|cannot say)", line)) for line in told)
        assert last == f"and {count - shown} more; eyechart.gate.hold gives them all"
        kinds = [line.split(": ")[1] for line in told if re.search(r"^\S+ \S+: (fails|cannot say): ", line)]
        assert kinds == sorted(kinds, reverse=True)
    long = {f"{'a' * 150}{end}": stop for end in ("1", "2")}
    run_battery(bank, long, tmp_path / "run", limit=2)
    with pytest.raises(AssertionError) as caught:
        assert_grounded(tmp_path / "run")
    lines = str(caught.value).splitlines()
    assert len(lines) <= 9
    assert max(map(len, lines)) <= 72
    assert len({line.split()[0] for line in lines if "depth: " in line}) == 2
