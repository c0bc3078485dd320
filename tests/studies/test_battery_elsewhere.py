"""Answers made elsewhere: what is exported is what a run asks, and a run of what came back is the run itself."""

import asyncio
import csv
import hashlib
import json
import math
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

import banks
import stand_ins
from eyechart.bundle import validate, write_bundle
from eyechart.calls import CallKey, Query, Reply
from eyechart.cli.app import app
from eyechart.errors import LedgerError, OutputError, SourceError, SpecError
from eyechart.frames import MAIN, FrameBank, Stimulus
from eyechart.ledger import Attempt, Ledger
from eyechart.manifest import LEDGER, RUN, read_manifest
from eyechart.models import ADAPTERS, open_model
from eyechart.records import plain
from eyechart.studies import battery as study
from eyechart.studies.battery import BatterySelection, BatterySettings, answer_import
from eyechart.studies.battery.answer_import import ImportedAnswers
from eyechart.testing import assert_grounded
from eyechart.verdicts import judge
from known import Demo

pytestmark = pytest.mark.slow

Row = dict[str, Any]
KEYS = ("call", "frame", "condition", "repeat")
NOISY = "standin:noisy"
INSPECT_LOG = Path(__file__).parents[1] / "inspect_logs" / "battery.json"
ALL = BatterySettings(extent=BatterySelection(controls="all"))


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a bank of eighteen frames with controls, which no test changes."""
    return banks.build_bank(tmp_path_factory.mktemp("elsewhere") / "bank", controls=True)


def exported(bank: Path, out: Path, asking: BatterySettings | None = None, model: str | None = None) -> list[Row]:
    """Export a battery's calls, and return the rows of its table, with what only the exporter knows of them."""
    asked = study.questions_of(bank, asking or BatterySettings(), model)
    study.write_questions(asked, out)
    return known(asked, rows_of(out))


def known(asked: study.Questions, rows: Iterable[Row]) -> list[Row]:
    """Return rows with the frame and the condition of their calls, as exports of the first format had them."""
    about = {asked.keys.call(key.condition, key.frame): key for key in asked.left}
    return [row | {"frame": about[row["call"]].frame, "condition": about[row["call"]].condition} for row in rows]


def rows_of(folder: Path) -> list[Row]:
    """Return the rows of an export."""
    return [json.loads(line) for line in (folder / "asked.jsonl").read_text(encoding="utf-8").splitlines()]


def query_of(row: Mapping[str, Any], folder: Path) -> Query:
    """Return what a row asks, by nothing but the row and its files."""
    images = {MAIN: (folder / row["picture"]).read_bytes()} if row["picture"] else {}
    return Query(row["system"], row["user"], Stimulus(images), row["seed"])


def answered(rows: Iterable[Row], folder: Path, answer: Callable[[Query], Reply]) -> list[Row]:
    """Return the rows that whoever was asked elsewhere gives back."""
    return [answer_row(row, answer(query_of(row, folder))) for row in rows]


def answer_row(row: Row, reply: Reply) -> Row:
    """Return what comes back for a row."""
    told = {"finish_reason": reply.finish_reason, "prompt_tokens": reply.prompt_tokens}
    return {**{name: row[name] for name in KEYS if name in row}, "text": reply.text, **told}


def by_model(spec: str) -> Callable[[Query], Reply]:
    """Return what a scripted controller answers."""
    model = open_model(spec)
    return lambda query: asyncio.run(model.answer(query))


def json_lines(path: Path, rows: Iterable[Row]) -> Path:
    """Write rows as JSON lines."""
    path.write_text("".join(json.dumps(row) + "\n" for row in rows), encoding="utf-8")
    return path


def as_csv(path: Path, rows: list[Row]) -> Path:
    """Write rows as CSV."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    return path


def as_parquet(path: Path, rows: list[Row]) -> Path:
    """Write rows as Parquet."""
    import pyarrow as pa  # noqa: PLC0415 - an extra that not every environment has
    from pyarrow import parquet  # noqa: PLC0415

    parquet.write_table(pa.Table.from_pylist(rows), path)
    return path


def as_log(path: Path, rows: list[Row]) -> Path:
    """Write rows as a log in the form of one that Inspect AI wrote: its first sample with each row's call and reply."""
    log = json.loads(INSPECT_LOG.read_text(encoding="utf-8"))
    whole = log["samples"][0]
    log["samples"] = [
        {
            **whole,
            "id": row["call"],
            "epoch": row["repeat"] + 1,
            "metadata": {name: row[name] for name in ("call", "frame", "condition") if name in row},
            "output": {
                **whole["output"],
                "choices": [{"message": {"role": "assistant", "content": row["text"]}, "stop_reason": "stop"}],
                "completion": row["text"],
            },
        }
        for row in rows
    ]
    path.write_text(json.dumps(log), encoding="utf-8")
    return path


def imported(
    bank: Path, answers: Path, out: Path, asking: BatterySettings | None = None, name: str = "vlm"
) -> ImportedAnswers:
    """Import answers into a run; return what they held."""
    return answer_import.bring(
        answer_import.read_import(bank, answer_import.source_of(answers), out, name, asking or BatterySettings())
    )


@cache
def statistics_of(run: Path) -> tuple[object, ...]:
    """Return every statistic of the one model of a run, how much of it is answered, and the labels of its verdict."""
    score = study.score(run, resamples=120)
    (model,), (verdict,) = score.models.values(), judge(score).values()
    labels = verdict.calibrated.label, verdict.lateral.label, verdict.paper.label
    return plain(model.statistics), plain(model.holm), model.planned, model.answered, model.controls, labels


def test_a_demo_controller_asked_elsewhere_has_the_statistics_of_its_own_run(demo: Demo, tmp_path: Path) -> None:
    """Export, answer from the files alone, import, and again for the controls that the answers call for."""
    out, native = tmp_path / "run", demo.alone("depth_lateral", tmp_path / "native")
    answer, rounds, asked = by_model("scripted:depth_lateral"), 0, study.questions_of(demo.bank, BatterySettings())
    while asked.left:
        rounds += 1
        folder = tmp_path / f"asked-{rounds}"
        study.write_questions(asked, folder)
        given = answered(rows_of(folder), folder, answer)
        name, write = (("1.csv", as_csv), ("2.jsonl", json_lines))[rounds % 2]
        imported(demo.bank, write(tmp_path / name, given), out)
        asked = study.questions_left(demo.bank, out)
    assert rounds > 1
    for words, ended in ((("--max-unparsed", "0.5"), 2), (("--max-unparsed", "0.5", "--made-elsewhere"), 0)):
        held = CliRunner().invoke(app, ["gate", str(out), "--require", "depth", *words])
        assert held.exit_code == ended, held.output
    with pytest.raises(AssertionError, match="cannot say: eyechart did not make these calls"):
        assert_grounded(out, "depth", resamples=120)
    assert_grounded(out, "depth", resamples=999, made_elsewhere=True)
    (found, *rest), (known_of, *known_rest) = statistics_of(out), statistics_of(native)
    assert isinstance(found, dict)
    assert isinstance(known_of, dict)
    assert found.pop("picture_before")["value"] is None  # in which order it was asked, nobody knows
    assert known_of.pop("picture_before")["value"] < 0
    assert (found, rest) == (known_of, known_rest)
    assert rest[-1] == ("depth_lateral", "turns_clear", "depth_lateral")
    said = "whether earlier pictures move its braking was not tested, and depth_lateral does not say"
    assert any(note.startswith(said) for note in judge(study.score(out, resamples=120))["elsewhere:vlm"].notes)
    assert digests_of(out) == digests_of(native)


@pytest.fixture(scope="module")
def noisy(bank: FrameBank, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, list[Row]]:
    """Return a run of a model that draws its answers by the calls' seeds, an export, and its answers to that."""
    folder = tmp_path_factory.mktemp("noisy")
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(ADAPTERS, "standin", "stand_ins")
        study.run(study.plan(bank.root, [NOISY], folder / "native", extent=BatterySelection(controls="all")))
    rows = exported(bank.root, folder / "asked", ALL, NOISY)
    return folder / "native", folder / "asked", answered(rows, folder / "asked", stand_ins.noisy)


def test_what_is_exported_is_what_a_run_asks(noisy: tuple[Path, Path, list[Row]]) -> None:
    """Call by call: the words, the seed, and the picture, whose file is named by its content alone."""
    native, folder, answers = noisy
    about = {row["call"]: key_of(row) for row in answers}
    rows, asked = rows_of(folder), digests_of(native)
    assert {about[row["call"]]: row["request_sha256"] for row in rows} == asked
    assert all(query_of(row, folder).stimulus.images.keys() <= {MAIN} for row in rows)
    pictures = {row["picture"] for row in rows} - {""}
    assert sorted(f"pictures/{path.name}" for path in (folder / "pictures").iterdir()) == sorted(pictures)
    for name in pictures:
        assert hashlib.sha256((folder / name).read_bytes()).hexdigest()[:24] == Path(name).stem
    assert len({(row["call"], row["repeat"]) for row in rows}) == len(rows) == len(asked)
    with (folder / "asked.csv").open(encoding="utf-8", newline="") as file:
        assert [{**row, "seed": int(row["seed"]), "repeat": int(row["repeat"])} for row in csv.DictReader(file)] == rows
    order = [key.frame + key.condition for key, *_ in attempts_of(native)]
    assert ["".join(about[row["call"]]) for row in rows] == order, "the order in which a run asks"


@pytest.mark.parametrize("model", [None, "elsewhere:vlm", NOISY])
def test_an_export_names_no_condition_and_no_frame(bank: FrameBank, tmp_path: Path, model: str | None) -> None:
    """In no file of it, nor by a key that can be found by trying; whoever has the bank finds it again."""
    asked = study.questions_of(bank.root, ALL, model)
    study.write_questions(asked, tmp_path / "asked")
    names = {*(frame.id for frame in bank), *asked.conditions} - {"real", "blank", "noise"}
    for file in (tmp_path / "asked").iterdir():
        text = file.read_text(encoding="utf-8") if file.is_file() else ""
        assert not [name for name in names if name in text], file
        assert not re.search(r'["=,](real|blank|noise)[",]', text), file
    rows, about = rows_of(tmp_path / "asked"), json.loads((tmp_path / "asked" / "asked.json").read_text("utf-8"))
    assert set(rows[0]) == {"call", "repeat", "seed", "system", "user", "picture", "request_sha256"}
    public = set(re.findall(r"[0-9a-f]{64}", json.dumps([rows[:1], about])))
    tried = (json.dumps((digest, *pair)) for digest in public for pair in product(asked.conditions, bank_ids(bank)))
    guessed = {hashlib.sha256(one.encode()).hexdigest()[:20] for one in tried}
    assert guessed.isdisjoint(row["call"][9:] for row in rows)
    assert {row["call"] for row in known(asked, rows)} == {row["call"] for row in rows}
    if model != NOISY:
        seeds = {key.seed(asked.manifest.seed) for key in asked.left}
        assert seeds.isdisjoint(row["seed"] for row in rows)


def bank_ids(bank: FrameBank) -> list[str]:
    """Return the ids of a bank's frames."""
    return [frame.id for frame in bank]


def older(rows: Iterable[Row], asked: study.Questions) -> list[Row]:
    """Return rows as an export of the first format had them: keyed by what stands in it, with frame and condition."""
    return [row | {"call": asked.keys.older(row["condition"], row["frame"])} for row in rows]


@pytest.mark.parametrize("form", ["now", "first", "both"])
def test_answers_to_older_exports_are_imported_too(
    bank: FrameBank, noisy: tuple[Path, Path, list[Row]], tmp_path: Path, form: str
) -> None:
    """By the keys of the first format, with their frames and conditions; one call has one answer, by whichever key."""
    native, _, answers = noisy
    asked = study.questions_of(bank.root, ALL, NOISY)
    bare = [{name: row[name] for name in row if name not in {"frame", "condition"}} for row in answers]
    before = older(answers, asked)
    rows = {"now": bare, "first": before, "both": bare[:50] + before[50:]}[form]
    imported(bank.root, json_lines(tmp_path / "a.jsonl", rows), tmp_path / "run", ALL)
    assert statistics_of(tmp_path / "run") == statistics_of(native)
    assert digests_of(tmp_path / "run") == digests_of(native)
    with pytest.raises(SourceError, match="is answered twice"):
        imported(bank.root, json_lines(tmp_path / "b.jsonl", [bare[0], before[0]]), tmp_path / "other", ALL)
    few = replace(ALL, extent=BatterySelection(limit=2, controls="all"))
    with pytest.raises(SourceError, match="is not among the --limit 2 frames of this run"):
        imported(bank.root, json_lines(tmp_path / "c.jsonl", bare), tmp_path / "other", few)


@pytest.mark.parametrize(
    ("ending", "write"),
    [
        (".jsonl", json_lines),
        (".csv", as_csv),
        (".json", as_log),
        pytest.param(".parquet", as_parquet, marks=pytest.mark.models),
    ],
)
def test_what_came_back_is_the_run_statistic_by_statistic(
    bank: FrameBank,
    noisy: tuple[Path, Path, list[Row]],
    tmp_path: Path,
    ending: str,
    write: Callable[[Path, list[Row]], Path],
) -> None:
    """Of a model that draws its answers too, for the seeds are those of a run of it."""
    native, _, rows = noisy
    found = imported(bank.root, write(tmp_path / f"a{ending}", rows), tmp_path / "run", ALL)
    assert (found.new, found.errors, found.repeats, found.there) == (len(rows), 0, 0, 0)
    assert statistics_of(tmp_path / "run") == statistics_of(native)
    held, came = (
        {key: (reply.text, reply.finish_reason) for key, reply in replies_of(run).items()}
        for run in (native, tmp_path / "run")
    )
    assert came == held


def test_a_run_gets_another_model_only_where_it_is_named(
    bank: FrameBank, noisy: tuple[Path, Path, list[Row]], tmp_path: Path
) -> None:
    """The name of a file is no choice of a second model; what a run gets besides answers is said."""
    rows, out = noisy[2], tmp_path / "run"
    first = answer_import.source_of(json_lines(tmp_path / "first.jsonl", rows[:20]))
    assert answer_import.bring(answer_import.read_import(bank.root, first, out, None, ALL)).new == 20
    before = read_manifest(out)
    rest = answer_import.source_of(json_lines(tmp_path / "rest.jsonl", rows[20:40]))
    with pytest.raises(SpecError, match=r"holds answers of first, and .* would be those of 'rest': say with --model"):
        answer_import.read_import(bank.root, rest, out, None, ALL)
    same = answer_import.read_import(bank.root, rest, out, "first", ALL)
    assert (same.widened, answer_import.bring(same).new) == ((), 20)
    assert read_manifest(out).models == before.models
    (words,) = answer_import.read_import(bank.root, rest, out, "rest", ALL).widened
    assert "elsewhere:rest is a model besides elsewhere:first" in words


def test_an_import_says_what_else_a_run_is_asked_now(
    bank: FrameBank, noisy: tuple[Path, Path, list[Row]], tmp_path: Path
) -> None:
    """More conditions, more frames, other controls."""
    out, real = tmp_path / "run", [row for row in noisy[2] if row["condition"] == "real"]
    few = BatterySettings(conditions=("real",), extent=BatterySelection(limit=6, controls="none"))
    asked = {row["call"] for row in exported(bank.root, tmp_path / "asked", few)}
    answers = json_lines(tmp_path / "a.jsonl", [row for row in real if row["call"] in asked])
    assert imported(bank.root, answers, out, few).new == 6
    more = BatterySettings(conditions=("real", "blank"), extent=BatterySelection(limit=8, controls="auto"))
    words = answer_import.read_import(bank.root, answer_import.source_of(answers), out, "vlm", more).widened
    assert [word.removeprefix(f"{out} grows: ").partition(",")[0].partition(":")[0] for word in words] == [
        "it now has blank too",
        "it now has 8 frames",
        "its controls are now 'auto'",
    ]
    assert answer_import.read_import(bank.root, answer_import.source_of(answers), out, "vlm", few).widened == ()


@pytest.mark.parametrize("word", ["None", "nan", "NaN", "null", " N/A"])
def test_words_that_programs_write_for_nothing_are_counted(
    bank: FrameBank, noisy: tuple[Path, Path, list[Row]], tmp_path: Path, word: str
) -> None:
    """A model may have said them; where no answer came, they are no answer that is unread."""
    rows = [{**row, "text": word} if place < 3 else row for place, row in enumerate(noisy[2])]
    found = imported(bank.root, json_lines(tmp_path / "a.jsonl", rows), tmp_path / "run", ALL)
    assert found.nothing == 3
    assert "3 of them None, nan or null, taken as the model's words: leave a cell empty where none came" in found.words


@pytest.mark.parametrize("name", ["", "  ", "x" * 201, "a\nb"])
def test_a_name_that_is_no_line_is_refused(
    bank: FrameBank, noisy: tuple[Path, Path, list[Row]], tmp_path: Path, name: str
) -> None:
    """It stands in the SPEC of every table."""
    with pytest.raises(SpecError, match="in a line of 1 to 200 signs"):
        imported(bank.root, json_lines(tmp_path / "a.jsonl", noisy[2]), tmp_path / "run", ALL, name)


def test_further_answers_without_a_first_are_said(
    bank: FrameBank, noisy: tuple[Path, Path, list[Row]], tmp_path: Path
) -> None:
    """Repeats are counted from 0, which whoever counts from 1 is told."""
    late = [{**row, "repeat": 1} for row in noisy[2]]
    with pytest.raises(SourceError, match=f"all {len(late)} have a repeat of 1 or more, and the first .* has repeat 0"):
        imported(bank.root, json_lines(tmp_path / "a.jsonl", late), tmp_path / "run", ALL)
    found = imported(bank.root, json_lines(tmp_path / "b.jsonl", [*noisy[2][:9], *late[9:12]]), tmp_path / "run", ALL)
    assert (found.new, found.firstless) == (9, 3)
    assert "3 calls with further answers and no first (repeat 0)" in found.words
    found = imported(bank.root, json_lines(tmp_path / "c.jsonl", [*noisy[2][:9], *late[:9]]), tmp_path / "run", ALL)
    assert (found.there, found.repeats, found.firstless) == (9, 9, 0)


@pytest.mark.parametrize("write", [json_lines, as_csv])
def test_columns_are_known_in_whatever_letters(
    bank: FrameBank, noisy: tuple[Path, Path, list[Row]], tmp_path: Path, write: Callable[[Path, list[Row]], Path]
) -> None:
    """'Finish Reason' is the finish reason; it was a column that says nothing."""
    other = {"call": "Call", "text": "TEXT", "finish_reason": "Finish Reason", "prompt_tokens": "Prompt-Tokens"}
    rows = [{other.get(name, name.title()): value for name, value in row.items()} for row in noisy[2]]
    answers = write(tmp_path / f"a{'.csv' if write is as_csv else '.jsonl'}", rows)
    assert imported(bank.root, answers, tmp_path / "run", ALL).new == len(rows)
    came = replies_of(tmp_path / "run")
    assert {(reply.finish_reason, reply.prompt_tokens) for reply in came.values()} == {("stop", 3)}


def test_no_word_of_an_answer_brings_a_key_of_this_machine(
    bank: FrameBank, noisy: tuple[Path, Path, list[Row]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whichever column holds it: the ledger is passed on."""
    key = "sk-elsewhere-0123456789"
    monkeypatch.setenv("SOME_API_KEY", key)
    words = ("text", "reasoning", "finish_reason", "served", "provider", "system_fingerprint")
    rows = [{**noisy[2][0], **dict.fromkeys(words, f"a {key}")}, {**noisy[2][1], "text": "", "error": f"no {key}"}]
    imported(bank.root, json_lines(tmp_path / "a.jsonl", rows), tmp_path / "run", ALL)
    assert key not in repr(replies_of(tmp_path / "run"))
    assert repr(replies_of(tmp_path / "run")).count("[$SOME_API_KEY]") == len(words) + 1


def test_a_blank_error_is_none(bank: FrameBank, noisy: tuple[Path, Path, list[Row]], tmp_path: Path) -> None:
    """As it stands beside every answer in some programs' tables."""
    rows = [{**row, "error": "  "} for row in noisy[2][:9]]
    assert imported(bank.root, json_lines(tmp_path / "a.jsonl", rows), tmp_path / "run", ALL).errors == 0


@pytest.mark.models
def test_a_column_of_a_type_that_is_not_read_is_named(
    bank: FrameBank, noisy: tuple[Path, Path, list[Row]], tmp_path: Path
) -> None:
    """A Parquet file has a column of that name, and its owner looks at it."""
    rows = [{**row, "text": row["text"].encode()} for row in noisy[2]]
    with pytest.raises(SourceError, match=r"no column 'text'.*; of a type that is not read are 'text' \(binary\)"):
        imported(bank.root, as_parquet(tmp_path / "a.parquet", rows), tmp_path / "run", ALL)


def test_a_run_of_imported_answers_says_so_and_its_guards_cannot_say(
    bank: FrameBank, noisy: tuple[Path, Path, list[Row]], tmp_path: Path
) -> None:
    """In the manifest, in the scope of its verdict, and in every guard that needs to have seen the call."""
    rows = [{**row, "served": "m-1", "prompt_tokens": 300} for row in noisy[2]]
    answers, out = json_lines(tmp_path / "mine.jsonl", rows), tmp_path / "run"
    imported(bank.root, answers, out, ALL)
    manifest = read_manifest(out)
    assert manifest.models == {"elsewhere:vlm": "imported"}
    assert manifest.facts["elsewhere:vlm"]["calls"] == "not made by eyechart"
    assert hashlib.sha256(answers.read_bytes()).hexdigest()[:16] in manifest.facts["elsewhere:vlm"]["imported"]
    found = study.score(out, resamples=120)
    held = {one.name: one.holds for one in found.guards["elsewhere:vlm"]}
    unseen = dict.fromkeys(("calls", "picture", "cache", "served"))
    assert held == unseen | {"outcomes": True, "geometry": True, "degeneracy": True, "truncation": True}
    assert "called elsewhere and not by eyechart" in judge(found)["elsewhere:vlm"].scope
    unsaid = [{name: value for name, value in row.items() if name != "finish_reason"} for row in rows]
    imported(bank.root, json_lines(tmp_path / "b.jsonl", unsaid), tmp_path / "b", ALL)
    (guard,) = (
        one for one in study.score(tmp_path / "b", resamples=120).guards["elsewhere:vlm"] if one.name == "truncation"
    )
    assert guard.holds is None
    assert f"{len(rows)} of {len(rows)} answers name no finish reason" in guard.because
    rows[3]["served"] = "m-2"
    imported(bank.root, json_lines(tmp_path / "c.jsonl", rows), tmp_path / "c", ALL)
    (guard,) = (
        one for one in study.score(tmp_path / "c", resamples=120).guards["elsewhere:vlm"] if one.name == "served"
    )
    assert guard.holds is False


def test_commands_that_read_runs_read_an_imported_one(
    bank: FrameBank, noisy: tuple[Path, Path, list[Row]], tmp_path: Path
) -> None:
    """Score, verdict, costs, report, gate, bundle, validate and compare."""
    out = tmp_path / "run"
    imported(bank.root, json_lines(tmp_path / "a.jsonl", noisy[2]), out, ALL)
    for words in (["score", out], ["verdict", out], ["costs", out], ["costs", out, "--unread"]):
        assert CliRunner().invoke(app, [str(word) for word in words]).exit_code == 0, words
    held = CliRunner().invoke(app, ["gate", str(out), "--require", "depth"])
    assert held.exit_code in {1, 2}
    assert "only their maker knows the questions and the model; accept that with --made-elsewhere" in held.output
    result = CliRunner().invoke(app, ["report", str(out), "--out", str(tmp_path / "report.html")])
    assert result.exit_code == 0
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "eyechart did not make these calls" in page
    write_bundle(out, tmp_path / "run.zip", resamples=100)
    found = validate(tmp_path / "run.zip")
    assert found.holds, found.differences
    assert found.compared["requests"] == len(noisy[2])
    same = CliRunner().invoke(app, ["compare", str(out), str(out), "--resamples", "999"])
    assert same.exit_code == 0


def test_missing_cells_repeats_and_failures_are_counted(
    bank: FrameBank, noisy: tuple[Path, Path, list[Row]], tmp_path: Path
) -> None:
    """What is missing is no answer and no guess; of repeats the first counts; a failure is one, with its words."""
    rows, out = [dict(row) for row in noisy[2]], tmp_path / "run"
    gone, failed, blank = rows.pop(5), rows[7], rows[9]
    failed |= {"text": "", "error": "the server was away", "finish_reason": None, "prompt_tokens": None}
    blank |= {"text": "", "finish_reason": None, "prompt_tokens": None}
    rows += [{**rows[0], "repeat": 1, "text": "STOP"}, {**rows[0], "repeat": 2, "text": "SLOW"}]
    found = imported(bank.root, json_lines(tmp_path / "a.jsonl", rows), out, ALL)
    assert (found.new, found.errors, found.repeats, found.blank) == (len(noisy[2]) - 2, 1, 2, 1)
    (model,) = study.score(out, resamples=120).models.values()
    assert model.planned - model.answered == 2
    replies = replies_of(out)
    assert (replies[key_of(rows[0])].text, replies[key_of(failed)].error_detail) == (
        rows[0]["text"],
        "the server was away",
    )
    assert {key_of(gone), key_of(blank)}.isdisjoint(replies)
    left = study.questions_left(bank.root, out)
    assert {(key.frame, key.condition) for key in left.left} == {key_of(gone), key_of(failed), key_of(blank)}
    worse = [{**failed, "error": "away again"}]
    assert imported(bank.root, json_lines(tmp_path / "worse.jsonl", worse), out, ALL).again == 1
    assert replies_of(out)[key_of(failed)].error_detail == "away again"
    later = [{**one, "text": "SLOW", "error": "", "finish_reason": "stop"} for one in (gone, failed, blank)]
    more = imported(bank.root, json_lines(tmp_path / "b.jsonl", later), out, ALL)
    assert (more.new, more.again) == (3, 1)
    assert {replies_of(out)[key_of(one)].text for one in later} == {"SLOW"}
    assert read_manifest(out).facts["elsewhere:vlm"]["imported"].count("SHA-256") == 3
    assert study.score(out, resamples=120).guards["elsewhere:vlm"][3].holds, "one outcome each, asked again or not"


def test_an_import_goes_on_where_it_was_killed_and_refuses_other_answers(
    bank: FrameBank, noisy: tuple[Path, Path, list[Row]], tmp_path: Path
) -> None:
    """What the run holds is not written twice, and what it holds otherwise is named."""
    rows, out = noisy[2], tmp_path / "run"
    read = answer_import.read_import(
        bank.root, answer_import.source_of(json_lines(tmp_path / "a.jsonl", rows)), out, "vlm", ALL
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("eyechart.studies.battery.answer_import._AT_ONCE", 40)
        begin, begun = Ledger.begin, []

        def killed(self: Ledger, key: CallKey, digest: str, *, again: bool) -> Attempt:
            begun.append(1)
            if len(begun) == 100:
                raise KeyboardInterrupt
            return begin(self, key, digest, again=again)

        patch.setattr(Ledger, "begin", killed)
        with pytest.raises(KeyboardInterrupt):
            answer_import.bring(read)
    assert len(replies_of(out)) == 80
    found = imported(bank.root, tmp_path / "a.jsonl", out, ALL)
    assert (found.there, found.new) == (80, len(rows) - 80)
    assert statistics_of(out) == statistics_of(noisy[0])
    before = (out / LEDGER).read_bytes(), (out / RUN).read_bytes()
    other = [{**row, "text": "LEFT" if row["text"] == "STOP" else "STOP"} for row in rows[:3]]
    with pytest.raises(SourceError, match="has another answer in") as raised:
        imported(bank.root, json_lines(tmp_path / "b.jsonl", other), out, ALL)
    assert str(raised.value).count("row ") == 3
    assert ((out / LEDGER).read_bytes(), (out / RUN).read_bytes()) == before
    with pytest.raises(LedgerError, match="has seed 0, now seed 1"):
        imported(bank.root, tmp_path / "a.jsonl", out, replace(ALL, seed=1))


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"call": "0123abcd-0000"}, "call '0123abcd-0000' is of another export: give the bank, --prompt and --seed"),
        ({"call": "own"}, "is not that of frame '{frame}' under real: keep that column"),
        ({"frame": "moon-1"}, "has frame 'moon-1', and its call is about"),
        ({"call": "x", "frame": "moon-1"}, "frame 'moon-1' is not of the bank boxes-tiny"),
        ({"condition": "blank"}, "has condition 'blank', and its call is about 'real'"),
        ({"call": ""}, "has no call; keep that column"),
        ({"repeat": 1.5}, "'repeat' is 1.5, not a whole number from 0 to 999"),
        ({"repeat": -1}, "'repeat' is -1, not a whole number"),
        ({"text": "x" * 100_001}, "'text' has 100001 characters; the limit is 100000"),
        ({"prompt_tokens": "many"}, "'prompt_tokens' is 'many', not a number"),
        ({"prompt_tokens": 2.5}, "'prompt_tokens' is 2.5, not a whole number"),
        ({"prompt_tokens": 1e30}, "'prompt_tokens' is 1e+30, not a number from 0 to 1e+09"),
        ({"cost_usd": -1}, "'cost_usd' is -1, not a number from 0"),
        ({"seconds": "inf"}, "'seconds' is 'inf', not a number"),
        ({"served": "m\n=1+1"}, "'served' is not one line of at most 200 printable characters"),
        ({"error": "timeout"}, "has a text and an error"),
        ({"request_sha256": "0" * 64}, "was asked with another picture or other words"),
    ],
)
def test_a_row_that_is_no_answer_to_a_call_is_named(
    bank: FrameBank, noisy: tuple[Path, Path, list[Row]], tmp_path: Path, changed: Row, said: str
) -> None:
    """With its number; nothing is written."""
    rows = [dict(row) for row in noisy[2] if row["condition"] == "real"]
    said = said.replace("{frame}", rows[2]["frame"])
    rows[2] |= changed | ({"call": rows[2]["call"][:9]} if changed.get("call") == "own" else {})
    with pytest.raises(SourceError, match=re.escape(said)) as raised:
        imported(
            bank.root,
            json_lines(tmp_path / "a.jsonl", [dict.fromkeys([*rows[0], *changed]) | row for row in rows]),
            tmp_path / "run",
            ALL,
        )
    assert "a.jsonl, row 3" in str(raised.value)
    assert not (tmp_path / "run").exists()


def test_what_is_no_number_is_an_empty_cell(
    bank: FrameBank, noisy: tuple[Path, Path, list[Row]], tmp_path: Path
) -> None:
    """As pandas writes a missing one: no words 'nan', no finish reason, no failure."""
    rows = [{**row, "finish_reason": math.nan, "error": math.nan} for row in noisy[2]]
    rows[3] |= {"text": math.nan, "prompt_tokens": math.nan}
    found = imported(bank.root, json_lines(tmp_path / "a.jsonl", rows), tmp_path / "run", ALL)
    assert (found.new, found.blank, found.errors) == (len(rows) - 1, 1, 0)
    held = replies_of(tmp_path / "run")
    assert {reply.finish_reason for reply in held.values()} == {None}
    assert not [reply for reply in held.values() if "nan" in reply.text]


def test_a_table_that_tells_more_of_the_same_answers_is_not_taken_for_the_same(
    bank: FrameBank, noisy: tuple[Path, Path, list[Row]], tmp_path: Path
) -> None:
    """A corrected finish reason is another answer, refused in words; the same table brings nothing new."""
    rows, out = noisy[2], tmp_path / "run"
    imported(bank.root, json_lines(tmp_path / "a.jsonl", rows), out, ALL)
    assert imported(bank.root, json_lines(tmp_path / "a.jsonl", rows), out, ALL).new == 0
    cut = [{**row, "finish_reason": "length"} for row in rows]
    with pytest.raises(SourceError, match="has another answer in"):
        imported(bank.root, json_lines(tmp_path / "b.jsonl", cut), out, ALL)


def test_all_faults_are_named_at_once(bank: FrameBank, noisy: tuple[Path, Path, list[Row]], tmp_path: Path) -> None:
    """A duplicate, a foreign call, and a limit; what is no table of answers is refused before."""
    rows = [dict(row) for row in noisy[2][:20]]
    rows += [rows[4], {**rows[5], "call": "elsewhere"}]
    with pytest.raises(SourceError, match=r"a\.jsonl has 2 faults") as raised:
        imported(bank.root, json_lines(tmp_path / "a.jsonl", rows), tmp_path / "run", ALL)
    assert "row 21: frame" in str(raised.value)
    assert "is answered twice" in str(raised.value)
    few = replace(ALL, extent=BatterySelection(limit=2, controls="all"))
    with pytest.raises(SourceError, match="is not among the --limit 2 frames of this run"):
        imported(bank.root, json_lines(tmp_path / "b.jsonl", rows[:20]), tmp_path / "run", few)
    with pytest.raises(SourceError, match="is none of this run: give the --conditions"):
        imported(
            bank.root,
            json_lines(tmp_path / "b.jsonl", rows[:20]),
            tmp_path / "run",
            BatterySettings(conditions=("real",)),
        )
    for lacking in ("call", "text"):
        bare = [{name: value for name, value in row.items() if name != lacking} for row in rows[:2]]
        with pytest.raises(SourceError, match=f"has no column '{lacking}'"):
            imported(bank.root, as_csv(tmp_path / "c.csv", bare), tmp_path / "run", ALL)
    text = as_csv(tmp_path / "c.csv", rows[:3]).read_text(encoding="utf-8")
    (tmp_path / "c.csv").write_text(f"{text}one,cell,more,than,the,header,has,here\n", encoding="utf-8")
    with pytest.raises(SourceError, match="row 4 has 8 cells"):
        imported(bank.root, tmp_path / "c.csv", tmp_path / "run", ALL)
    double = [{**rows[0], "latency": 1, "seconds": 1}]
    with pytest.raises(SourceError, match="row 1 has two columns for seconds"):
        imported(bank.root, json_lines(tmp_path / "d.jsonl", double), tmp_path / "run", ALL)
    with pytest.raises(SourceError, match="holds no answer"):
        imported(bank.root, json_lines(tmp_path / "e.jsonl", [{"call": rows[0]["call"]}]), tmp_path / "run", ALL)
    assert not (tmp_path / "run").exists()


def test_the_export_is_there_whole_or_not_at_all(bank: FrameBank, tmp_path: Path) -> None:
    """Nothing is written over, and an export that is cut leaves no part."""
    (tmp_path / "taken").mkdir()
    (tmp_path / "taken" / "notes.txt").write_text("mine")
    asked = study.questions_of(bank.root, BatterySettings(conditions=("real", "blank")))
    with pytest.raises(OutputError, match="exists and is not empty"):
        study.write_questions(asked, tmp_path / "taken")

    def cut(done: int, _: int) -> None:
        if done == 10:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        study.write_questions(asked, tmp_path / "out", progress=cut)
    assert [path.name for path in tmp_path.iterdir()] == ["taken"]
    assert study.write_questions(asked, tmp_path / "out") == (36, 19)
    assert (tmp_path / "out").stat().st_mode & 0o777 == 0o755


def test_what_a_killed_export_left_is_cleared_by_the_next(bank: FrameBank, tmp_path: Path) -> None:
    """Beside the folder stands at most one part, whoever was killed; one that is being written is not taken over."""
    out, left = tmp_path / "out", tmp_path / ".out.part"
    script = (
        "import os, sys; from pathlib import Path; from eyechart.studies import battery as study;"
        "settings = study.BatterySettings(conditions=('real', 'blank'));"
        "study.write_questions(study.questions_of(Path(sys.argv[1]), settings),"
        "Path(sys.argv[2]), progress=lambda done, _: os.kill(os.getpid(), 9) if done == 10 else None)"
    )
    killed = subprocess.run([sys.executable, "-c", script, str(bank.root), str(out)], check=False)
    assert killed.returncode == -9
    assert [path.name for path in tmp_path.iterdir()] == [left.name]
    asked = study.questions_of(bank.root, BatterySettings(conditions=("real", "blank")))

    def second(done: int, _: int) -> None:
        if done == 10:
            with pytest.raises(OutputError, match="another process is writing"):
                study.write_questions(asked, out)

    assert study.write_questions(asked, out, progress=second) == (36, 19)
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
    assert sorted(path.name for path in out.iterdir()) == [
        "README.txt",
        "asked.csv",
        "asked.json",
        "asked.jsonl",
        "pictures",
    ]
    shutil.rmtree(out)
    left.mkdir()
    (left / "mine.txt").write_text("mine")
    with pytest.raises(OutputError, match="exists, and eyechart did not make it"):
        study.write_questions(asked, out)
    assert (left / "mine.txt").read_text() == "mine"


def test_words_of_a_bank_are_no_formula_in_the_sheet(tmp_path: Path) -> None:
    """The exact words stand in the lines of JSON."""
    made = banks.build_bank(tmp_path / "bank", scenarios=["light"])
    (tmp_path / "ask.toml").write_text('name = "ask"\nsystem = "=1+1"\nuser = "{actions}"\n')
    rows = exported(made.root, tmp_path / "out", BatterySettings(str(tmp_path / "ask.toml"), ("real",)))
    assert rows[0]["system"] == "=1+1"
    with (tmp_path / "out" / "asked.csv").open(encoding="utf-8", newline="") as file:
        assert next(csv.DictReader(file))["system"] == "'=1+1"


def test_what_a_run_lacks_is_asked_of_the_bank_and_model_that_it_has(
    bank: FrameBank, noisy: tuple[Path, Path, list[Row]], tmp_path: Path
) -> None:
    """Another bank, another model, and a run that lacks nothing are refused in words."""
    out = tmp_path / "run"
    imported(bank.root, json_lines(tmp_path / "a.jsonl", noisy[2]), out, ALL)
    other = banks.build_bank(tmp_path / "other", scenarios=["light", "dense"])
    with pytest.raises(LedgerError, match="was made on another bank"):
        study.questions_left(other.root, out)
    with pytest.raises(SpecError, match="holds elsewhere:vlm: name one with --model"):
        study.questions_left(bank.root, out, "elsewhere:nobody")
    with pytest.raises(SpecError, match="no call is left to be exported"):
        study.write_questions(study.questions_left(bank.root, out), tmp_path / "left")


def test_the_commands_from_export_to_verdict(bank: FrameBank, tmp_path: Path) -> None:
    """One folder out, one table back; what is without an answer is said, and exits 1."""
    run = CliRunner()
    words = ["--conditions", "real,real_repeat,blank", "--limit", "6"]
    result = run.invoke(app, ["frames", "export", str(bank.root), "--out", str(tmp_path / "asked"), *words])
    assert result.exit_code == 0, result.output
    assert "18 calls (6 real, 6 real_repeat, 6 blank)" in result.output
    given = answered(rows_of(tmp_path / "asked"), tmp_path / "asked", stand_ins.stop)
    answers, out = json_lines(tmp_path / "my vlm.jsonl", given[1:]), tmp_path / "run"
    tried = run.invoke(
        app, ["run", "import", str(answers), "--frames", str(bank.root), "--out", str(out), *words, "--dry-run"]
    )
    assert (tried.exit_code, out.exists()) == (0, False)
    found = run.invoke(app, ["run", "import", str(answers), "--frames", str(bank.root), "--out", str(out), *words])
    assert found.exit_code == 1
    assert "elsewhere:my vlm: 17 new answers; eyechart made none of these calls" in found.output
    assert "1 of 18 calls are without an answer" in found.output
    more = run.invoke(app, ["frames", "export", str(bank.root), "--run", str(out), "--out", str(tmp_path / "more")])
    assert more.exit_code == 0
    assert [row["call"] for row in rows_of(tmp_path / "more")] == [given[0]["call"]]
    answers = json_lines(tmp_path / "my vlm.jsonl", given)
    assert (
        run.invoke(
            app, ["run", "import", str(answers), "--frames", str(bank.root), "--out", str(out), *words]
        ).exit_code
        == 0
    )
    assert "elsewhere:my vlm" in run.invoke(app, ["verdict", str(out)]).output
    both = run.invoke(
        app, ["frames", "export", str(bank.root), "--run", str(out), "--out", str(tmp_path / "x"), *words]
    )
    assert "--run decides which calls are written" in str(both.exception)


def attempts_of(run: Path) -> list[Any]:
    """Return the attempts at the calls of the one model of a run."""
    (spec,) = read_manifest(run).models
    with Ledger(run / LEDGER) as ledger:
        return list(ledger.attempts(spec))


def digests_of(run: Path) -> dict[tuple[str, str], str]:
    """Return the digest of each request of a run, by frame and condition."""
    return {(sent.key.frame, sent.key.condition): sent.request_sha256 for sent in attempts_of(run)}


def replies_of(run: Path) -> dict[tuple[str, str], Reply]:
    """Return the reply that counts of each call of a run, by frame and condition."""
    (spec,) = read_manifest(run).models
    with Ledger(run / LEDGER) as ledger:
        return {(key.frame, key.condition): reply for key, reply in ledger.replies(spec)}


def key_of(row: Row) -> tuple[str, str]:
    """Return which call a row is about."""
    return row["frame"], row["condition"]
