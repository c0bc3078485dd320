"""A bundle holds until one thing in it is changed, and then the figure is named; it was recomputed, not looked up."""

import hashlib
import json
import re
import shutil
import sqlite3
import zipfile
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import banks
import stand_ins
from bundles import Change, opened_ledger, repacked
from eyechart.bundle import Validation, validate, validation, write_bundle
from eyechart.bundle.contents import DerivedResults, derive
from eyechart.cli.app import app
from eyechart.errors import BundleError
from eyechart.frames import BankManifest, encode, open_unchecked
from eyechart.manifest import read_manifest, read_run
from eyechart.prompts import Prompt
from report_runs import make_run

Try = Callable[[Change], Validation]
MODEL = "standin:noisy"


@pytest.fixture(scope="module")
def packed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a bundle of a run of eighteen frames."""
    folder = tmp_path_factory.mktemp("packed")
    bank = banks.build_bank(folder / "bank")
    run = make_run(bank.root, folder / "run", {"noisy": stand_ins.noisy})
    write_bundle(run, folder / "run.zip", resamples=200)
    return folder / "run.zip"


@pytest.fixture(autouse=True, scope="module")
def _derived_once() -> Iterator[None]:
    """Derive once what follows from one and the same run; from a run of which any byte differs it is derived anew."""
    derived: dict[str, DerivedResults] = {}

    def derive_once(run: Path, *given: object) -> DerivedResults:
        _, _, recipe, _ = given
        files = sorted(path for path in run.rglob("*") if path.is_file())
        held = [(path.relative_to(run).as_posix(), hashlib.sha256(path.read_bytes()).hexdigest()) for path in files]
        key = repr((held, recipe))
        if key not in derived:
            derived[key] = derive(run, *given)  # type: ignore[arg-type]
        return derived[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(validation, "derive", derive_once)
        yield


@pytest.fixture
def changed(packed: Path, tmp_path: Path) -> Try:
    """Return a function that validates the bundle after a change, whose author has mended every digest of a file."""
    return lambda change: validate(repacked(packed, tmp_path, change))


def said(found: Validation) -> str:
    """Return every difference as a line."""
    return "\n".join(map(str, found.differences))


def edit(name: str, old: str, new: str, count: int = 1) -> Change:
    """Return a change of a text in a file, which has to be there."""

    def change(folder: Path) -> None:
        text = (folder / name).read_bytes().decode()
        assert old in text
        (folder / name).write_bytes(text.replace(old, new, count).encode())

    return change


def in_ledger(sql: str, rows: int = 1) -> Change:
    """Return a change of some rows of the ledger that leaves its tables and its triggers as they were."""

    def change(folder: Path) -> None:
        with opened_ledger(folder) as ledger:
            assert ledger.execute(sql).rowcount == rows

    return change


REPLY = """UPDATE replies SET text = {text} WHERE call = (SELECT calls.id FROM calls JOIN replies r ON r.call = calls.id
WHERE condition = '{condition}' AND r.text = 'STOP' ORDER BY frame LIMIT 1)"""


def test_an_honest_bundle_holds(packed: Path) -> None:
    """Everything was compared, nothing differs, and nothing was left out."""
    found = validate(packed)
    assert said(found) == ""
    assert found.holds
    assert found.notes == []
    counted = found.compared
    assert (counted["models"], counted["frames"], counted["tables"]) == (1, 18, 13)
    assert counted["requests"] == counted["calls"] > 150
    assert counted["statistics"] > 40


def test_one_changed_reply_changes_the_figures_that_rest_on_it(changed: Try) -> None:
    """Statistics by name with both values, the reply in the browser of frames, and the figures of the page."""
    found = changed(in_ledger(REPLY.format(text="'LEFT'", condition="real")))
    lines = said(found)
    assert re.search(
        rf"^results\.json, {MODEL}, agree\.blank, value: printed '0\.\d+', recomputed '0\.\d+'", lines, re.MULTILINE
    )
    assert re.search(rf"^results\.json, replies_sha256, {MODEL}, real: printed", lines, re.MULTILINE)
    assert re.search(
        rf"^report\.html, frames, {MODEL}, real, frame [\w-]+: printed 'STOP', recomputed 'LEFT'$", lines, re.MULTILINE
    )
    assert "figure 'Agreement with the action given to the real frame'" in lines
    assert re.search(rf"^tables/statistics\.csv, {MODEL} agree\.blank, value: printed", lines, re.MULTILINE)
    assert re.search(r"^tables/frontier\.tex, line \d+ \(agree\(blank\)", lines, re.MULTILINE)


def test_a_reply_that_means_the_same_is_still_another_reply(changed: Try) -> None:
    """No statistic moves; the reply's digest, and its text in the page, do."""
    found = changed(in_ledger(REPLY.format(text="'STOP '", condition="mirrored")))
    assert [
        difference.where
        for difference in found.differences
        if "statistics" in difference.where or "value" in difference.where
    ] == []
    assert f"results.json, replies_sha256, {MODEL}, mirrored" in said(found)
    assert "report.html, frames" in said(found)


def _set_gap(folder: Path, row: int, gap: float) -> str:
    path = folder / "run" / "bank" / "metadata.jsonl"
    rows = [json.loads(line) for line in path.read_text().splitlines()]
    rows[row]["lead_gap_m"] = gap
    path.write_text("".join(json.dumps(one, ensure_ascii=False) + "\n" for one in rows))
    return str(rows[row]["frame_id"])


def test_one_changed_gap_is_named_with_what_rests_on_it(changed: Try) -> None:
    """The frame, the statistics of the gap, and their figures."""
    lines = said(changed(lambda folder: _set_gap(folder, 1, 39.5) and None))
    assert re.search(r"^bank, ground truth of frame 'light-0-1' \(lead_gap_m 39\.5\): printed", lines, re.MULTILINE)
    assert re.search(rf"^results\.json, {MODEL}, mutual_information", lines, re.MULTILINE)
    assert f"figure 'Gap by action, {MODEL}'" in lines
    assert re.search(r"^report\.html, frames, frame light-0-1, truth .*recomputed '39\.5'$", lines, re.MULTILINE)


def test_a_gap_whose_digests_were_all_mended_is_found_by_its_figures(changed: Try) -> None:
    """The fingerprint that the results print is not that of the bank, and the statistics are not its own."""

    def change(folder: Path) -> None:
        frame, bank = _set_gap(folder, 1, 39.5), folder / "run" / "bank"
        raw = json.loads((bank / "manifest.json").read_text())
        raw["geometry"][frame] = open_unchecked(bank).frame(frame).geometry()
        mended: BankManifest = open_unchecked(bank).manifest
        object.__setattr__(mended, "geometry", raw["geometry"])
        raw["fingerprint"] = mended.fingerprint
        (bank / "manifest.json").write_text(json.dumps(raw, indent=1, ensure_ascii=False) + "\n")
        run = json.loads((folder / "run" / "run.json").read_text())
        run["fingerprint"] = mended.fingerprint
        (folder / "run" / "run.json").write_text(json.dumps(run))

    lines = said(changed(change))
    assert "bank, ground truth" not in lines
    assert re.search(r"^results\.json, fingerprint: printed", lines, re.MULTILINE)
    assert re.search(rf"^results\.json, {MODEL}, mutual_information", lines, re.MULTILINE)


def _paint(folder: Path) -> str:
    path = folder / "run" / "bank" / "images" / "light-0-1.png"
    pixels = np.full((16, 60, 3), 100, dtype=np.uint8)
    pixels[5, 5] = 0
    path.write_bytes(encode(pixels))
    return hashlib.sha256(path.read_bytes()).hexdigest()


def test_one_changed_picture_is_named_with_the_calls_that_saw_it(changed: Try) -> None:
    """By its file, its frame and conditions, by the requests in the ledger, and in the page."""
    lines = said(changed(lambda folder: _paint(folder) and None))
    assert re.search(r"^bank, picture images/light-0-1\.png \(shown for .*light-0-1 under real, ", lines, re.MULTILINE)
    assert f"ledger, request of {MODEL} about frame 'light-0-1' under real:" in lines
    assert "report.html, frames, picture of frame light-0-1 under real" in lines


def test_a_picture_whose_digest_was_mended_is_not_the_one_that_was_sent(
    changed: Try,
) -> None:
    """The ledger recorded the digest of every request before it was sent."""

    def change(folder: Path) -> None:
        digest, path = _paint(folder), folder / "run" / "bank" / "manifest.json"
        raw = json.loads(path.read_text())
        raw["images"]["images/light-0-1.png"] = digest
        path.write_text(json.dumps(raw, indent=1, ensure_ascii=False) + "\n")

    lines = said(changed(change))
    assert "bank, picture" not in lines
    assert f"ledger, request of {MODEL} about frame 'light-0-1' under mirrored:" in lines


def test_another_wording_is_not_what_was_asked(changed: Try) -> None:
    """The prompt is part of the request, even where its key was mended."""

    def change(folder: Path) -> None:
        path = folder / "run" / "run.json"
        raw = json.loads(path.read_text())
        prompt = Prompt(raw["prompt"]["name"], raw["prompt"]["system"], raw["prompt"]["user"] + " Please.")
        path.write_text(json.dumps(raw | {"prompt": prompt.as_dict()}))

    assert "under text_only: printed" in said(changed(change))


def test_another_word_of_who_was_asked_is_named(changed: Try) -> None:
    """The manifest says it, and no figure rests on it."""

    def change(folder: Path) -> None:
        path = folder / "run" / "run.json"
        held = read_manifest(folder / "run")
        path.write_text(replace(held, facts={MODEL: {"endpoint": "https://models.example/v1"}}).as_text())

    assert f"results.json, runs, run, facts, {MODEL}: printed 'nothing', recomputed" in said(changed(change))


def _result(path: list[str], value: object) -> Change:
    def change(folder: Path) -> None:
        file = folder / "results.json"
        whole = json.loads(file.read_text())
        inner = whole
        for name in path[:-1]:
            inner = inner[name]
        assert path[-1] in inner
        inner[path[-1]] = value
        file.write_text(json.dumps(whole, indent=1, ensure_ascii=False) + "\n")

    return change


STATISTICS = ["score", "models", MODEL, "statistics"]


@pytest.mark.parametrize(
    ("change", "where"),
    [
        (_result([*STATISTICS, "entropy", "value"], 0.5), rf"results\.json, {MODEL}, entropy, value: printed '0\.5'"),
        (_result([*STATISTICS, "cramers_v", "p"], 0.0001), rf"results\.json, {MODEL}, cramers_v, p: printed '0\.0001'"),
        (_result([*STATISTICS, "idi", "n"], 19), rf"results\.json, {MODEL}, idi, n: printed '19', recomputed '\d+'"),
        (_result(["score", "models", MODEL, "holm", "obstacle"], 0.01), rf"results\.json, {MODEL}, holm, obstacle:"),
        (
            _result(["verdicts", MODEL, "calibrated"], "depth"),
            rf"results\.json, verdicts, {MODEL}, calibrated: printed",
        ),
        (_result(["verdicts", MODEL, "scope"], "everywhere"), rf"results\.json, verdicts, {MODEL}, scope: printed"),
        (
            _result(["score", "accounting", MODEL, "all", "attempts"], 7),
            rf"results\.json, accounting, {MODEL}, all, attempts:",
        ),
        (edit("results.json", '"seed": 0', '"seed": 7, "seed": 0'), r"results\.json: printed 'written in another way'"),
        (edit("results.json", "{", "["), r"results\.json: printed 'no JSON'"),
        (lambda folder: (folder / "results.json").unlink(), r"results\.json: printed 'no file'"),
        (lambda folder: (folder / "tables" / "verdicts.md").unlink(), r"tables/verdicts\.md: printed 'no file'"),
    ],
)
def test_a_changed_result_is_named(changed: Try, change: Change, where: str) -> None:
    """By model, statistic and field, with what is printed and what was recomputed; nothing else differs."""
    found = changed(change)
    assert len(found.differences) == 1
    assert re.match(where, said(found))


def _number_after(name: str, marker: str, digits: int = 3) -> Change:
    """Return a change of the last of at most so many decimals of the first number that has any behind a text."""

    def change(folder: Path) -> None:
        head, found, tail = (folder / name).read_text(encoding="utf-8").partition(marker)
        assert found
        digit = re.search(rf"\d\.\d{{0,{digits - 1}}}(\d)", tail)
        assert digit is not None
        at = digit.start(1)
        tail = tail[:at] + str((int(tail[at]) + 1) % 10) + tail[at + 1 :]
        (folder / name).write_bytes((head + found + tail).encode())

    return change


@pytest.mark.parametrize(
    ("change", "where"),
    [
        (
            _number_after("report.html", "<dt>value</dt><dd>"),
            rf"report\.html, verdicts, verdict card of {MODEL}, value:",
        ),
        (
            _number_after("report.html", "<bdi>idi</bdi>"),
            rf"report\.html, statistics, table '{MODEL}', idi",
        ),
        (
            _number_after("report.html", 'id="agreement-text_', digits=1),
            r"report\.html, agreement, figure 'Agreement with the",
        ),
        (
            _number_after("report.html", 'id="information-PathCollection', digits=1),
            r"report\.html, information, figure 'Action entr",
        ),
        (
            edit("report.html", "<h2", "<script>alert(1)</script><h2"),
            r"report\.html, verdicts: printed 'element script'",
        ),
        (edit("report.html", "<h2", "<!-- so --><h2"), r"report\.html, verdicts: printed 'comment so'"),
        (edit("report.html", "<h2 id", "<h2  id"), r"report\.html, its markup: printed 'written in another way'"),
        (
            edit("report.html", "script-src &#39;", "script-src &#39;unsafe-inline&#39; &#39;"),
            r"report\.html, meta content:",
        ),
        (
            edit("report.html", '"texts":["', '"texts":["X'),
            rf"report\.html, frames, {MODEL}, real, frame [\w-]+, reply:",
        ),
        (edit("report.html", '"texts":[', '"texts":[],"texts":['), r"report\.html, frames, data: printed 'written in"),
        (
            _number_after("tables/statistics.csv", f"{MODEL},entropy,"),
            rf"tables/statistics\.csv, {MODEL} entropy, value:",
        ),
        (
            _number_after("tables/statistics.csv", f"{MODEL},idi,"),
            rf"tables/statistics\.csv, {MODEL} idi, value: printed",
        ),
        (
            _number_after("tables/statistics.md", "| idi |"),
            rf"tables/statistics\.md, line \d+ \({MODEL} idi\): printed",
        ),
        (_number_after("tables/frontier.md", "IDI"), r"tables/frontier\.md, line \d+ \(IDI"),
        (_number_after("tables/frontier.tex", r"IDI\_adj"), r"tables/frontier\.tex, line \d+ \(IDI\\_adj"),
        (edit("tables/verdicts.csv", MODEL, "standin:other"), r"tables/verdicts\.csv, standin:noisy, model: printed"),
        (edit("tables/verdicts.tex", "interval", "Interval"), r"tables/verdicts\.tex, line \d+ \(model answer\)"),
    ],
)
def test_a_changed_number_in_the_page_or_a_table_is_named(changed: Try, change: Change, where: str) -> None:
    """By section, figure, table, row and column."""
    found = changed(change)
    assert 1 <= len(found.differences) <= 2
    assert re.match(where, said(found)), said(found)


def test_a_file_that_is_not_the_one_packed_is_named(packed: Path, tmp_path: Path) -> None:
    """Even where nothing follows from it."""
    with zipfile.ZipFile(packed) as old, zipfile.ZipFile(tmp_path / "b.zip", "w") as new:
        for entry in old.infolist():
            new.writestr(entry, old.read(entry) + (b" " if entry.filename == "README.txt" else b""))
    lines = said(validate(tmp_path / "b.zip")).split("\n")
    assert re.fullmatch(r"file README\.txt, SHA-256: printed '\w+', recomputed '\w+'", lines[0])
    assert lines[1:] == ["README.txt: printed 'another text', recomputed 'that of every bundle'"]


def test_a_file_that_is_neither_used_nor_made_is_named(changed: Try) -> None:
    """Whatever lies beside the run's own bank, or beside its tables, did not follow from it."""

    def change(folder: Path) -> None:
        (folder / "run" / "bank" / "images" / "more.png").write_bytes(b"more")
        (folder / "tables" / "best.md").write_text("| depth |")

    assert said(changed(change)).split("\n") == [
        f"file {name}: printed 'in the bundle', recomputed 'neither used by the run nor made from it'"
        for name in ("run/bank/images/more.png", "tables/best.md")
    ]


def test_what_is_no_file_is_not_said_to_be_missing(tmp_path: Path) -> None:
    """A folder and a device are there, and are no bundle."""
    for path, what in ((tmp_path, "a folder"), (Path("/dev/null"), "a device or a pipe")):
        with pytest.raises(BundleError, match=f"is no bundle file but {what}"):
            validate(path)


def test_the_word_of_a_bundle_excuses_no_request_of_the_same_library(changed: Try) -> None:
    """Requests of all frames under one condition differ, and no library is another one."""
    sql = "UPDATE attempts SET request_sha256 = 'f' WHERE call IN (SELECT id FROM calls WHERE condition = 'noise')"
    lines = said(changed(in_ledger(sql, rows=18)))
    assert f"ledger, request of {MODEL} about frame 'light-0-1' under noise:" in lines


def test_a_ledger_with_more_than_its_tables_is_not_read(changed: Try) -> None:
    """A view or a trigger in a file from elsewhere may do anything; it is named."""

    def change(folder: Path) -> None:
        with closing(sqlite3.connect(folder / "run" / "ledger.sqlite")) as ledger:
            ledger.execute("CREATE VIEW more AS SELECT 1")
            ledger.commit()

    assert "is no plain ledger: more of its schema differ" in said(changed(change))


def test_a_damaged_ledger_is_a_difference(changed: Try) -> None:
    """Pages of nothing are named, not a traceback."""

    def change(folder: Path) -> None:
        path = folder / "run" / "ledger.sqlite"
        path.write_bytes(path.read_bytes()[:8192] + bytes(len(path.read_bytes()) - 8192))

    found = changed(change)
    assert re.search("everything that follows from the run: .*(damaged|no ledger|malformed)", said(found))


def test_the_place_of_unpacking_is_not_said(changed: Try) -> None:
    """A difference reads the same wherever it was found."""
    lines = said(changed(edit("run/bank/metadata.jsonl", '"frame_id"', '"frame"')))
    assert "run/bank/metadata.jsonl, line 1" in lines
    assert "eyechart-validate-" not in lines


def test_another_library_of_pictures_is_said_and_not_blamed(packed: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What hangs on the bytes that a library makes is left out by name; every number is still compared."""
    here = {"matplotlib": "0", "pillow": "0", "webp": "0", "zlib": "0"}
    monkeypatch.setattr("eyechart.bundle.validation.drawn_with", lambda: here)
    found = validate(packed)
    assert not found.holds
    assert (found.differences, found.outcome) == ([], "holds, drawings and pictures not compared")
    assert found.as_dict()["uncompared"] == ["drawings", "pictures"]
    code = CliRunner().invoke(app, ["validate", str(packed)]).exit_code
    assert (code, CliRunner().invoke(app, ["validate", str(packed), "--allow-uncompared"]).exit_code) == (2, 0)
    assert "of the drawings only the words were compared" in found.notes
    assert "the pictures in the page were not compared with those of the bank" in found.notes


def test_the_run_in_a_bundle_can_be_reported_by_itself(packed: Path, tmp_path: Path) -> None:
    """Unpacked anywhere, its pictures are found, and no path of the machine that made it is in it."""
    from report_runs import read_evidence  # noqa: PLC0415 - nowhere else needed

    with zipfile.ZipFile(packed) as file:
        file.extractall(tmp_path)
    (evidence,) = read_evidence([tmp_path / "run"])
    assert evidence.pictures is not None
    assert read_run(tmp_path / "run")[0].bank_path == "bank"
    assert all(str(packed.parent).encode() not in path.read_bytes() for path in tmp_path.rglob("*") if path.is_file())
    shutil.rmtree(tmp_path / "run" / "bank" / "images")
    assert read_evidence([tmp_path / "run"])[0].pictures is None
