"""``eyechart look``: from whatever is brought to one answer on one screen, and the same as the long way gives."""

import json
import os
import re
import shlex
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
from PIL import Image
from typer.testing import CliRunner, Result

import brakers
import eyechart
import photographs
from banks import build_bank
from eyechart.cli.app import app
from eyechart.errors import LedgerError, SpecError
from eyechart.ledger import Ledger
from eyechart.looks import Look, LookRequest, PictureResult, Pictures
from eyechart.manifest import LEDGER, read_manifest
from eyechart.modes import RequestMode, read_mode, write_mode
from eyechart.simulators import open_bank_simulator
from eyechart.testing import assert_looks
from faults import FaultServer, Loopback
from known import Demo
from seeing import Endpoint, OllamaEndpoint, Stalled, served
from stand_ins import rows_in

pytestmark = pytest.mark.usefixtures("few_pictures")

ORIENTATION = 0x0112
ANSWERS = ("Yes.", "In part.", "No.", "Inconclusive.")


def look(*words: object) -> Result:
    """Return what a look came to."""
    return CliRunner().invoke(app, ["look", *map(str, words)])


def screen(*words: object, code: int) -> str:
    """Return a look's screen, which is one of 80 columns and begins with its answer."""
    done = look(*words)
    assert done.exit_code == code, done.output
    lines = done.stdout.splitlines()
    assert done.stdout.startswith(ANSWERS)
    assert max(len(line) for line in lines if max(map(len, line.split()), default=0) < 70) <= 80  # a path stays whole
    assert len(lines) <= 32
    return done.stdout


def flat(text: str) -> str:
    """Return a screen as one line, without what breaks its commands."""
    return " ".join(text.replace("\\\n", " ").split())


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a bank of 16 frames."""
    return build_bank(tmp_path_factory.mktemp("look") / "bank", episodes=4, steps=2).root


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return an empty folder, which is the current one."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_look_is_the_long_way_and_asks_nothing_twice(small: Path, here: Path) -> None:
    """The same calls and verdict as of 'run battery --stop-early'; a second look makes no call and says the same."""
    words = ("scripted:presence", "--frames", small)
    first = look(*words, "--json")
    done = CliRunner().invoke(
        app, ["run", "battery", "--model", "scripted:presence", "--frames", str(small), "--out", "long", "--stop-early"]
    )
    assert done.exit_code == 0, done.output
    runs = [here / "looks/scripted-presence/run", here / "long"]
    verdicts = [CliRunner().invoke(app, ["verdict", str(run), "--json"]).stdout for run in runs]
    assert verdicts[0] == verdicts[1]
    ledgers = []
    for run in runs:
        with Ledger(run / LEDGER) as ledger:
            ledgers.append(ledger.finished())
    assert ledgers[0] == ledgers[1]
    again = look(*words, "--json")
    assert again.stdout == first.stdout
    assert "at most 0 calls" in again.stderr
    found = json.loads(first.stdout)
    assert {"answer", "because", "holes", "next", "report", "run"} <= found.keys()
    for command in found["next"]:
        assert command in flat(look(*words).stdout)


@pytest.fixture(scope="module")
def looked(demo: Demo, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, str]]:
    """Return a folder with looks at who sees nothing and who sees, and their screens; no test changes it."""
    folder = tmp_path_factory.mktemp("looked")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        codes = {"constant": 1, "depth": 0}
        return folder, {
            name: screen(f"scripted:{name}", "--frames", demo.bank, code=code) for name, code in codes.items()
        }


def test_who_never_looks_gets_no(looked: tuple[Path, dict[str, str]]) -> None:
    """What may be tried next is said beside it, in another folder."""
    folder, screens = looked
    said = screens["constant"]
    assert said.startswith("No. The camera changes its decision on less than 0.1 of the frames")
    assert "a blank picture                 SLOW" in said
    assert "--prompt FILE.toml --out looks/scripted-constant-2" in flat(said)
    assert (folder / "looks/scripted-constant").is_dir()


def test_the_first_sentence_is_the_rulings_and_that_it_was_settled_early_stands_below(
    demo: Demo, looked: tuple[Path, dict[str, str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of who sees too; the JSON has both."""
    folder, screens = looked
    monkeypatch.chdir(folder)
    for name, said in screens.items():
        lines = said.splitlines()
        first = " ".join(lines[: lines.index("")])
        assert "topped early" not in first
        (below,) = [line for line in lines if line.startswith("Stopped early after ")]
        assert lines.index("") < lines.index(below) < lines.index("Next")
        page = (folder / f"looks/scripted-{name}/report.html").read_text(encoding="utf-8")
        assert not re.search(r">\s*(Yes|No): stopped early", page)
        found = json.loads(look(f"scripted:{name}", "--frames", demo.bank, "--json").stdout)
        assert "topped early" not in found["because"]
        assert not any("nothing on" in line for line in lines)
        assert found["ended"].startswith(below)


def test_who_is_blind_in_one_place_looks_in_part(demo: Demo, here: Path) -> None:
    """The place stands by its name with counts; a callable is named as a module has it."""
    said = flat(screen("brakers:but_four_lanes", "--frames", demo.bank, code=1))
    assert said.startswith("In part. It has no authority in the named places, where its braking hardly answers")
    assert re.search(
        r"Not (in \w+, )*in light(, [^.:]+)?: it brakes harder for the nearer lead on 0 of [1-9]\d* frames", said
    )
    assert (here / "looks/python-brakers-but_four_lanes/run").is_dir()


def test_part_may_be_accepted() -> None:
    """By who says so; nothing else is."""
    part, no = Look("m", "In part", ""), Look("m", "No", "")
    assert (part.exit_code(), part.exit_code(accept_part=True), no.exit_code(accept_part=True)) == (1, 0, 1)


def test_an_endpoint_that_drops_pictures_is_inconclusive_before_a_frame_is_asked(small: Path, here: Path) -> None:
    """Within 30 calls, with the cause, and no run is begun."""
    with served(sees=False, counts_pictures=False) as server:
        said = flat(screen("openai:m", "--base-url", server.base_url, "--frames", small, code=2))
        assert server.requests <= 30
    assert said.startswith("Inconclusive. No call about the frames was made")
    assert "Likely cause:" in said
    assert "eyechart doctor openai:m --base-url" in said
    assert not (here / "looks/openai-m/run").exists()


def test_drawn_pictures_are_asked_once_and_the_mode_is_kept(small: Path, here: Path) -> None:
    """The probe takes what the doctor saw; a second look neither probes nor asks again."""
    with served() as server:
        words = ("openai:m", "--base-url", server.base_url, "--frames", small)
        look(*words)
        colours = sum("RED, GREEN" in str(one["messages"]) for one in server.asked)
        # Six pictures, one again without, some again at once and at the bank's size; where replies are slow by chance,
        # some more, to tell a cache. Asked twice, the six alone would make it twenty.
        assert 6 <= colours <= 18
        before = server.requests
        look(*words)
        assert server.requests == before
    mode = read_mode(here / "looks/openai-m/mode.toml")
    assert mode.measured is not None
    assert mode.measured.sees_image
    manifest = read_manifest(here / "looks/openai-m/run")
    assert manifest.mode("openai:m").is_same_request(mode)
    with Ledger(here / "looks/openai-m/run" / LEDGER) as ledger:
        assert len(ledger.finished()) + (mode.measured.calls or 0) == before


def test_a_model_of_ollama_is_looked_at_over_its_own_api(small: Path, here: Path) -> None:
    """One that sees is asked as its mode says; one without its vision part is inconclusive, with the cause."""
    stand_in = OllamaEndpoint()
    with Loopback(stand_in.app()) as at:
        words = ("ollama:llava", "--base-url", f"http://127.0.0.1:{at.port}", "--frames", small)
        assert "no cost" in look(*words).stderr
        assert read_manifest(here / "looks/ollama-llava/run").mode("ollama:llava").measured is not None
        stand_in.endpoint, stand_in.capabilities = Endpoint(sees=False), ["completion"]
        said = flat(screen(*words, "--out", "blind", code=2))
    assert said.startswith("Inconclusive. No call about the frames was made")
    assert "its capabilities are completion" in said


def test_photographs_and_a_table_are_enough(here: Path) -> None:
    """Sixty without the other pictures: it uses the picture, and distance is said to be not tested."""
    table = photographs.rows(drives=6, ticks=10, places=("yard", "hall", "lane"))
    photographs.take(here / "photos", table)
    (here / "photos.csv").write_text(photographs.as_csv(table))
    words = ["brakers:by_box", "--photos", "photos", "--table", "photos.csv", "--map", "gap=lidar_m"]
    said = flat(screen(*words, "--threshold", 18, "--unit", "m", code=1))
    assert said.startswith("In part. It uses the picture")
    assert "Whether it follows the gap was not tested" in said
    assert "a picture of another moment" in said
    assert (here / "looks/python-brakers-by_box/bank/manifest.json").is_file()
    other = look(*words, "--threshold", 5, "--unit", "m")
    assert isinstance(other.exception, SpecError)
    assert "holds a bank of other pictures (threshold)" in str(other.exception)
    with min(one for one in (here / "photos").rglob("*") if one.is_file()).open("ab") as file:
        file.write(b"taken again")
    other = look(*words, "--threshold", 18, "--unit", "m")
    assert "holds a bank of other pictures (files)" in str(other.exception)
    record = here / "looks/python-brakers-by_box/look.json"
    older = json.loads(record.read_text())
    del older["frames"]["files"]
    record.write_text(json.dumps(older))
    assert look(*words, "--threshold", 18, "--unit", "m").exit_code == 1, "a record of an older version knows no files"


def test_what_a_telephone_turned_by_a_note_is_turned_and_an_error_without_a_picture_is_told(here: Path) -> None:
    """The import says what it took and turned; calls that failed stand on the screen, with the first one's words."""
    table = photographs.rows(drives=3, ticks=4)
    photographs.take(here / "photos", table)
    (here / "photos.csv").write_text(photographs.as_csv(table))
    first = next(here.glob("photos/**/*.*"))
    note = Image.Exif()
    note[ORIENTATION] = 3
    with Image.open(first) as picture:
        picture.rotate(180).save(first, exif=note)
    (here / "needs_one.py").write_text(
        "from pathlib import Path\n\n\ndef decide(prompt, image):\n"
        "    if image is None and not Path('mended').exists():\n        raise TypeError('no picture')\n"
        "    return 'STOP'\n"
    )
    words = ["--map", "gap=lidar_m", "--threshold", 18, "--unit", "m"]
    pictures = ["--photos", "photos", "--table", "photos.csv"]
    done = look("needs_one:decide", *pictures, *words)
    assert "converted to PNG: 1 pictures (1 turned)" in done.stderr
    assert "columns, guessed by their names: " in done.stderr
    said = flat(done.stdout)
    assert (
        "12 calls ended in an error, so 'gate' and assert_looks are inconclusive. The first error: exception: " in said
    )
    assert "TypeError" in said
    gate = CliRunner().invoke(app, ["gate", "looks/python-needs_one-decide/run", "--require", "looks"])
    assert gate.exit_code == 2
    again = json.loads(look("needs_one:decide", *pictures, *words, "--json").stdout)["next"][0]
    assert again.endswith("--out looks/python-needs_one-decide --again")
    (here / "mended").touch()
    done = look(*shlex.split(again)[2:])
    assert "python:needs_one:decide: at most 12 calls" in done.stderr
    assert "ended in an error" not in flat(done.stdout)
    assert "--again" not in done.stdout


@pytest.mark.parametrize(
    ("ci", "words"), [((0.7, 6.7), " [70%, 100%]"), ((2.1, 8.4), ""), ((0.2, 0.6), " [20%, 60%]"), (None, "")]
)
def test_an_interval_of_a_change_has_its_lower_end_first(ci: tuple[float, float] | None, words: str) -> None:
    """Also where both ends are more than all of a motion."""
    assert PictureResult("x", change=4.2, ci=ci).words == f"changes 100% of its motion{words}"


def test_what_is_typed_wrongly_is_answered_with_what_a_look_takes(here: Path) -> None:
    """A policy without motions, a callable that is not there, a key: each names an option that a look has."""
    (here / "own_policy.py").write_text("def act(images, state, instruction):\n    return [[0.0]]\n")
    for spec, said in [
        ("own_policy:act", "'look --dataset FOLDER', or a bank with --frames"),
        ("no_such:decide", "no no_such.py lies in"),
        ("openai:MODEL", "key_env in the file of --mode"),
    ]:
        assert said in str(look(spec).exception)


def test_a_look_that_is_killed_while_it_finds_out_how_to_ask_counts_each_of_its_calls(small: Path, here: Path) -> None:
    """They stand in its folder before they are sent, and then in the mode that the next one finds."""
    endpoint, out = Stalled(), here / "looks/openai-m"
    with FaultServer([endpoint]) as server:
        words = ["look", "openai:m", "--base-url", server.base_url, "--frames", str(small)]
        with subprocess.Popen([sys.executable, "-m", "eyechart", *words], stderr=subprocess.DEVNULL) as running:
            came = endpoint.came.wait(120)
            running.kill()
        assert came
        endpoint.goes_on.set()
        assert server.requests <= json.loads((out / "spent.json").read_text())["calls"] <= server.requests + 1
        look(*words[1:])
        measured = read_mode(out / "mode.toml").measured
        assert measured is not None
        with Ledger(out / "run" / LEDGER) as ledger:
            made = (measured.calls or 0) + sum(1 for _ in ledger.attempts("openai:m"))
        assert server.requests <= made <= server.requests + 1
    assert not (out / "spent.json").exists()


def test_a_record_of_calls_that_is_none_is_refused(small: Path, here: Path) -> None:
    """By its name; nothing is asked, for nobody can say what was."""
    (here / "looks/openai-m").mkdir(parents=True)
    (here / "looks/openai-m/spent.json").write_text("[]")
    with served() as server:
        said = look("openai:m", "--base-url", server.base_url, "--frames", small)
        assert server.requests == 0
    assert isinstance(said.exception, LedgerError)
    assert "spent.json does not say what was spent" in str(said.exception)


def test_a_look_that_was_killed_goes_on(small: Path, here: Path) -> None:
    """Neither the probe nor a finished call is made again; what was under way at that moment is."""
    with served(seconds=0.01) as server:
        words = ["look", "openai:m", "--base-url", server.base_url, "--frames", str(small)]
        begun = subprocess.Popen([sys.executable, "-m", "eyechart", *words], stderr=subprocess.DEVNULL, env=os.environ)
        ledger = here / "looks/openai-m/run" / LEDGER
        while rows_in(ledger, "attempts") < 20:
            assert begun.poll() is None
            time.sleep(0.05)
        begun.send_signal(signal.SIGKILL)
        begun.wait()
        with Ledger(ledger) as read:
            kept, unknown = read.finished(), len(read.unknown())
        assert kept
        done = look(*words[1:], "--json")
        assert done.exit_code in {1, 2}, done.output
        calls = read_mode(here / "looks/openai-m/mode.toml").measured
        assert calls is not None
        with Ledger(ledger) as read:
            finished = read.finished()
        assert kept <= finished
        least = len(finished) + (calls.calls or 0)
        assert least <= server.requests <= least + unknown  # what was under way may have been killed before it was sent
        assert json.loads(done.stdout)["calls"] == len(finished)


def test_a_budget_is_kept_and_what_is_out_of_reach_is_said_before_a_call(demo: Demo, here: Path) -> None:
    """Fewer frames, and fewer calls than were allowed; too few for any answer are refused."""
    done = look("scripted:constant", "--frames", demo.bank, "--budget", 300)
    lines = done.stderr.splitlines()
    assert lines.index(next(line for line in lines if "out of reach: Yes" in line)) < next(
        place for place, line in enumerate(lines) if line.startswith("calls:")
    )
    assert done.exit_code == 2
    assert done.stdout.startswith("Inconclusive.")
    with Ledger(here / "looks/scripted-constant/run" / LEDGER) as ledger:
        assert 100 < len(ledger.finished()) <= 300
    with Ledger(here / "looks/scripted-constant/run" / LEDGER) as ledger:
        kept = ledger.finished()
    more = look("scripted:constant", "--frames", demo.bank, "--budget", 3000)
    said = flat(more.stderr)
    frames = read_manifest(here / "looks/scripted-constant/run").limit
    assert f"was started on {frames} of 144 frames, and keeps those, whatever the budget" in said
    assert "--budget 3000 --out looks/scripted-constant-2" in said
    assert said.index("was started on") < said.index("at most 0 calls")
    with Ledger(here / "looks/scripted-constant/run" / LEDGER) as ledger:
        assert ledger.finished() == kept
    few = look("scripted:constant", "--frames", demo.bank, "--budget", 30, "--out", "few")
    assert isinstance(few.exception, SpecError)
    assert "so few calls can give no answer" in str(few.exception)


def test_what_costs_is_not_begun_where_nobody_agrees(small: Path, here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The bill stands in the error, which says how to agree; nothing was sent and nothing is there."""
    monkeypatch.setenv("OPENAI_API_KEY", "not-a-key")
    done = look("openai:gpt-4o", "--frames", small)
    assert isinstance(done.exception, SpecError)
    assert "this may cost: at most" in str(done.exception)
    assert "give --yes to agree" in str(done.exception)
    assert not (here / "looks/openai-gpt-4o/run").exists()


def test_two_places_for_frames_are_refused(small: Path, here: Path) -> None:
    """And what belongs to one that is not given."""
    assert "both give frames" in str(look("scripted:depth", "--frames", small, "--dataset", here).exception)
    assert "belong together" in str(look("scripted:depth", "--photos", here).exception)
    assert "--threshold needs" in str(look("scripted:depth", "--threshold", 5).exception)
    assert "unknown model 'gpt-4o'" in str(look("gpt-4o").exception)
    assert "did you mean 'openai'" in str(look("opnai:gpt-4o").exception)


def test_a_look_says_what_was_looked_for(here: Path) -> None:
    """Of a callable whose module is not there, and of photographs that are not."""
    said = str(look("my_robot:decide").exception)
    assert f"no my_robot.py lies in {here}, and none is installed" in said
    assert "did you mean 'scripted'" in str(look("scriptd:depth").exception)
    (here / "t.csv").write_text("file\n")
    assert "photos is not a folder; give the folder of the pictures" in str(
        look("scripted:depth", "--photos", "photos", "--table", "t.csv").exception
    )


def test_a_name_of_the_running_process_is_no_module(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A command runs in ``__main__``, which no command can reach; it is refused as a module that is not there."""
    monkeypatch.setattr(sys.modules["__main__"], "__spec__", None)
    done = look("__main__:decide")
    assert isinstance(done.exception, SpecError)
    assert f"no __main__.py lies in {here}" in str(done.exception)


def test_a_folder_holds_a_look_at_one_model(small: Path, here: Path) -> None:
    """Another one is refused before a call, so that neither run nor request mode are mixed up."""
    look("scripted:constant", "--frames", small, "--out", "one")
    before = read_manifest(here / "one/run").models
    refused = "one holds a look at scripted:constant, not at scripted:depth: give another --out"
    assert refused in str(look("scripted:depth", "--frames", small, "--out", "one").exception)
    assert read_manifest(here / "one/run").models == before
    with served() as server:
        write_mode(here / "mode.toml", RequestMode("openai:m", base_url=server.base_url))
        kept = (here / "mode.toml").read_bytes()
        done = look("openai:n", "--base-url", server.base_url, "--frames", small, "--out", here)
        assert "holds a look at openai:m, not at openai:n" in str(done.exception)
        assert server.requests == 0
    assert (here / "mode.toml").read_bytes() == kept


def test_a_look_that_ends_right_after_its_bank_goes_on(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The record of what a bank is made from is there before the bank is."""
    table = photographs.rows(drives=2, ticks=3)
    photographs.take(here / "photos", table)
    (here / "photos.csv").write_text(photographs.as_csv(table))
    words = ["brakers:by_box", "--photos", "photos", "--table", "photos.csv", "--map", "gap=lidar_m"]
    words += ["--threshold", "18", "--unit", "m"]
    with monkeypatch.context() as killed:
        make = Pictures._make  # the process ends behind it

        def ends(*given: object) -> None:
            make(*given)  # type: ignore[arg-type]
            raise SystemExit(137)

        killed.setattr(Pictures, "_make", ends)
        assert look(*words).exit_code == 137
    assert (here / "looks/python-brakers-by_box/bank").is_dir()
    done = look(*words)
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    assert done.stdout.startswith(ANSWERS)


def test_a_policy_that_cannot_be_judged_is_sent_to_the_doctor(here: Path) -> None:
    """More episodes would not help one that never varies; its pictures were shown, and the screen says so."""
    bank = open_bank_simulator("tabletop").build(here / "bank", seeds=(0,), steps=4)
    (here / "own_arms.py").write_text(
        "import random\n\nimport numpy as np\n\nDICE = random.Random(0)\n\n\n"
        "def rests(images, state, instruction):\n    return np.zeros((8, 3))\n\n\n"
        "def draws(images, state, instruction):\n"
        "    return np.array([[DICE.gauss(0, 1) for _ in range(3)] for _ in range(8)])\n"
    )
    done = look("own_arms:rests", "--frames", bank.root)
    assert done.exit_code == 2, done.exception
    said = flat(done.stdout)
    assert "not asked" not in said
    assert "the answers do not vary" in said
    assert "ask more episodes" not in said
    assert f"eyechart doctor python:own_arms:rests --frames {bank.root}" in said
    again = look("own_arms:rests", "--frames", bank.root)
    assert re.search(r"at most 0 calls,", again.stderr)
    done = look("own_arms:draws", "--frames", bank.root)
    most = re.search(r"at most (\d+) calls \(about (\d+) if it repeats its answers\)", done.stderr)
    assert most is not None
    made = read_made(here / "looks/python-own_arms-draws/run")
    assert int(most[2]) < made <= int(most[1])


def read_made(run: Path) -> int:
    """Return the number of finished calls of a run."""
    with Ledger(run / LEDGER) as ledger:
        return len(ledger.finished())


def test_a_function_that_fails_is_looked_at_in_another_folder_once_its_code_is_changed(small: Path, here: Path) -> None:
    """One run holds one version of it, so that the same command would be refused."""
    (here / "broken.py").write_text("def decide(prompt, image):\n    raise RuntimeError('boom')\n")
    done = json.loads(look("broken:decide", "--frames", small, "--json").stdout)
    assert done["next"][0].endswith("--out looks/python-broken-decide")
    assert done["next"][1].endswith("--out looks/python-broken-decide-2")


def test_an_option_that_only_the_import_has_is_said_to_be_one(here: Path) -> None:
    """The error about a table with decimal commas says how they are read, and by which command."""
    table = photographs.rows(drives=2, ticks=3)
    photographs.take(here / "photos", table)
    written = photographs.as_csv(table, delimiter=";").replace(".", ",").replace(",png", ".png").replace(",jpg", ".jpg")
    (here / "photos.csv").write_text(written)
    words = ["--photos", "photos", "--table", "photos.csv", "--map", "gap=lidar_m", "--threshold", "18", "--unit", "m"]
    said = str(look("brakers:by_box", *words).exception)
    assert "a decimal comma is read with " in said
    assert "make the bank with 'eyechart frames import', and give it with --frames" in said


def test_a_summary_keeps_its_table_whatever_an_error_says() -> None:
    """The words of a server may have several lines; a cell of Markdown has one."""
    said = Look("m", "No", "It is so.", ("The first error: a\n\n# b | c",)).markdown()
    assert said.splitlines()[2] == "| **No** | `m` | It is so. The first error: a # b / c |"


def test_a_policy_on_the_tabletop_looks(here: Path) -> None:
    """Its pictures stand with the mean change of its motion; what is blind to them is told apart."""
    bank = open_bank_simulator("tabletop").build(here / "bank", seeds=(0, 1), steps=4)
    said = flat(screen("trained:sees", "--frames", bank.root, code=0))
    assert said.startswith("Yes. ")
    assert "another episode's pictures changes" in said
    assert "of its motion [" in said
    assert "eyechart gate looks/trained-sees/run --require looks" in said
    nothing = flat(screen("faulty_arms:with_batch", "--frames", bank.root, code=2))
    assert "It does not answer as a policy on this bank" in nothing


def test_in_python_a_function_at_hand_is_looked_at(small: Path, here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By the name of its module; its run is what assert_looks asks about, and the screen is what it prints."""
    monkeypatch.setenv("OPENAI_API_KEY", "not-a-key")
    found = eyechart.look(brakers.by_box, bank=small)
    assert found.run == here / "looks/python-brakers-by_box/run"
    assert str(found).startswith(f"{found.answer}. ")
    with pytest.raises(AssertionError, match="looks: "):
        assert_looks(found)
    with pytest.raises(SpecError, match="give yes=True to agree"):
        eyechart.look("openai:gpt-4o", bank=small)
    with pytest.raises(TypeError, match="unexpected keyword argument 'frames'"):
        eyechart.look("scripted:depth", frames=small)


def test_a_command_that_goes_on_repeats_all_that_was_given(tmp_path: Path) -> None:
    """From Python and from the command line alike; a function of a notebook has no command, and gets Python."""
    photos = Pictures(photos=tmp_path, table=tmp_path / "t.csv", columns={"gap": "range m"}, threshold=18.0, unit="m")
    mode = RequestMode("openai:m", base_url="http://127.0.0.1:1/v1")
    wanted = LookRequest(mode, photos, tmp_path / "out", prompt="minimal", seed=4, budget=90)
    common = f"--photos {tmp_path} --table {tmp_path}/t.csv --threshold 18.0 --unit m --map 'gap=range m'"
    asked = f"{common} --base-url http://127.0.0.1:1/v1 --prompt minimal --seed 4 --budget 90 --out {tmp_path}/out"
    assert wanted.command() == f"eyechart look openai:m {asked}"
    assert "--threshold 0.0" in replace(wanted, pictures=replace(photos, threshold=0.0)).command()
    by_file = replace(wanted, file=Path("mode.toml"), by_file=True)
    assert "--mode mode.toml" in by_file.command()
    assert "--base-url" not in by_file.command()
    own = LookRequest(RequestMode("python:__main__:decide"), Pictures(frames=tmp_path), tmp_path / "out", seed=4)
    again = own.command(prompt="FILE.toml", out=tmp_path / "two")
    expected = f"eyechart.look(decide, bank='{tmp_path}', seed=4, prompt='FILE.toml', out='{tmp_path}/two')"
    assert again == expected


def test_a_look_that_ended_before_a_run_fails_with_its_screen() -> None:
    """And not with an error of a folder that is not there."""
    unseen = Look("m", "Inconclusive", "No call about the frames was made.")
    with pytest.raises(AssertionError, match=r"Inconclusive\. No call about"):
        assert_looks(unseen)


def test_a_fixture_makes_the_run_and_keeps_it(
    small: Path, here: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """In pytest's cache: the second session finds it there."""
    (here / "conftest.py").write_text('pytest_plugins = ["eyechart.fixtures"]\n')
    (here / "test_it.py").write_text(
        "def test_it(looked):\n"
        f"    found = looked('scripted:constant', 'constant', bank={str(small)!r})\n"
        "    assert found.run.is_dir()\n"
    )
    page, written = here / ".pytest_cache/d/eyechart/constant/report.html", []
    for _ in range(2):
        done = subprocess.run(
            [sys.executable, "-m", "pytest", "-q", "--basetemp", tmp_path_factory.mktemp("inner"), here],
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stdout
        written.append(page.stat().st_mtime_ns)
    assert written[0] == written[1]


def test_a_record_that_cannot_be_read_is_refused(here: Path) -> None:
    """Nobody knows then of what the folder's bank is made."""
    place = here / "looks/scripted-depth"
    (place / "bank").mkdir(parents=True)
    for text in ("", "[]", "{}"):
        (place / "look.json").write_text(text)
        done = look("scripted:depth")
        assert isinstance(done.exception, SpecError)
        assert "another --out" in str(done.exception)
