"""How control pictures were made: in banks, in rules, in verdicts and at the gate."""

import errno
import hashlib
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from scipy.stats import binom, multinomial
from typer.testing import CliRunner

import banks
import by_hand as hand
from drawn import by_hand
from eyechart.cli.app import app
from eyechart.errors import BankError, LedgerError, SourceError, SpecError
from eyechart.frames import Provenance, check, declare, encode, open_bank, own_folder
from eyechart.gate import Gate, hold
from eyechart.importing import Choices, import_table
from eyechart.manifest import alone_in
from eyechart.spaces.discrete import DRIVING
from eyechart.spaces.space import Decision
from eyechart.stats.exact_difference import exact_bounds
from eyechart.stats.paired_tests import ChangedPairs
from eyechart.stats.statistic import Statistic, not_available
from eyechart.studies.battery import merge
from eyechart.studies.battery.answers import Answers
from eyechart.studies.battery.calibrated_statistics import CalibratedTests, LazyStatistics
from eyechart.studies.battery.depth import NAMES
from eyechart.studies.battery.paper_statistics import Resampling
from eyechart.verdicts import Evidence, Verdict, controls_wanted, judge_one
from eyechart.verdicts.depth import STAGE

FACT = {"photographed": Statistic(1.0, 60)}
FOLLOWS = {"depth_observational": Statistic(-4.0, 60, p=0.0099999)}


def bound(high: float, n: int = 60) -> dict[str, Statistic]:
    """Return the bound of an edit's effect."""
    return {"patched_bound": Statistic(0.0, n, (-high, high))}


def excess(p: float) -> dict[str, Statistic]:
    """Return the test of an edit's effect: 23 of 60 decisions changed by it, none by a repeat."""
    return {"patched_excess": ChangedPairs(23 / 60, 60, p=p, b=23, c=0, changed=23, repeated=0)}


EDITED = {**FACT, **FOLLOWS, **excess(0.01), **bound(0.0999)}


class Run:
    """A scored run of one model, by its statistics and by how its control pictures were made."""

    def __init__(self, found: Mapping[str, Statistic], made: Provenance) -> None:
        self._evidence = replace(hand.evidence({**hand.reader(), **by_hand(**found)}), made=made, run="my run")

    def evidence(self) -> dict[str, Evidence]:
        """Return the evidence on its model."""
        return {"m": self._evidence}

    @property
    def verdict(self) -> Verdict:
        """Return its verdict."""
        return judge_one(self._evidence)

    def gate(self, require: str = "depth", evidence: str | None = None) -> Gate:
        """Return whether it meets a requirement."""
        return hold(self, [require], evidence=evidence)


@pytest.mark.parametrize(
    ("found", "made", "label"),
    [
        ({}, "rendered", "depth"),
        ({**FACT, **FOLLOWS}, "staged", "depth"),
        ({**FACT, "depth_observational": Statistic(-1.0, 60, p=0.01)}, "staged", "depth_associated"),
        ({**FACT, "depth_observational": not_available("three episodes")}, "staged", "depth_associated"),
        ({**FACT, **FOLLOWS}, "", "depth"),
        ({**FACT, "depth_observational": Statistic(-1.0, 60, p=0.01)}, "", "depth_associated"),
        (EDITED, "edited", "depth"),
        ({**EDITED, "depth_observational": Statistic(-1.0, 60, p=0.01)}, "edited", "depth_associated"),
        ({**EDITED, **excess(0.0099999)}, "edited", "content"),
        ({**EDITED, **bound(0.1)}, "edited", "depth_associated"),
        ({**EDITED, "patched_bound": not_available("no patched picture")}, "edited", "depth_associated"),
        (
            {**EDITED, "patched_excess": not_available("none"), "patched_bound": not_available("none")},
            "edited",
            "depth_associated",
        ),
    ],
)
def test_depth_needs_more_where_nobody_rendered_the_pictures(
    found: Mapping[str, Statistic], made: Provenance, label: str
) -> None:
    """The photographs as taken where they are not rendered, and the edit excluded where they are edited."""
    assert Run(found, made).verdict.calibrated.label == label


def test_who_answers_to_the_edit_is_told_so_in_its_own_words() -> None:
    """With the shares of decisions that the edit and a repeat change."""
    verdict = Run({**EDITED, **excess(1e-6)}, "edited").verdict
    assert "it answers to the edit: pasted back where it stood" in verdict.calibrated.reason
    assert "another decision on 38% of the frames (a repeat: 0%)" in verdict.calibrated.reason
    assert verdict.why_not is not None
    assert verdict.why_not.decided_by == "patched_excess"


def test_too_few_frames_are_told_with_how_many_are_needed() -> None:
    """Of 22 frames without a change the edit is not excluded; 44 would exclude it."""
    ends = exact_bounds(0, 0, 22)
    assert ends is not None
    verdict = Run({**EDITED, "patched_bound": Statistic(0.0, 22, ends)}, "edited").verdict
    assert "that it answers to the edit was not excluded: n = 22, about 44 frames are needed" in (
        verdict.calibrated.reason
    )
    assert verdict.why_not is not None
    assert verdict.why_not.frames == 44


def test_a_verdict_has_fields_for_who_made_the_pictures() -> None:
    """In its JSON, its headline and its grade of evidence; the label itself stays."""
    rendered, edited = Run({}, "rendered").verdict, Run(EDITED, "edited").verdict
    assert (edited.calibrated.label, edited.headline, edited.evidence) == ("depth", "depth (edited)", "edited")
    assert (rendered.headline, rendered.evidence) == ("depth", "controlled")
    said = edited.as_dict()
    assert (said["made"], said["rests_on_controls"], said["calibrated"]) == ("edited", True, "depth")
    assert any(note.startswith("moved were cut-outs in photographs, not things") for note in edited.notes)
    observed = Run({"depth_interventional": not_available("no pair")}, "").verdict
    assert observed.as_dict()["rests_on_controls"] is False


@pytest.mark.parametrize(
    ("found", "made", "evidence", "code"),
    [
        ({}, "rendered", None, 0),
        ({**FACT, **FOLLOWS}, "staged", None, 0),
        ({**FACT, **FOLLOWS}, "", None, 2),
        ({**FACT, **FOLLOWS}, "", "edited", 2),
        (EDITED, "edited", None, 1),
        (EDITED, "edited", "edited", 0),
        ({**EDITED, **excess(1e-6)}, "edited", "edited", 1),
        ({**EDITED, **bound(0.1)}, "edited", "edited", 2),
    ],
)
def test_a_gate_asks_who_made_the_control_pictures(
    found: Mapping[str, Statistic], made: Provenance, evidence: str | None, code: int
) -> None:
    """Rendered and staged ones pass, edited ones where that is accepted; what is not said cannot."""
    gate = Run(found, made).gate(evidence=evidence)
    assert gate.exit_code == code, gate.checks
    if code == 2 and not made:
        assert "'eyechart frames declare 'my run' --made staged'" in gate.checks[0].because


@pytest.mark.parametrize("made", ["", "edited"])
def test_that_it_looks_rests_on_no_control_picture(made: Provenance) -> None:
    """Whoever follows an edit looks too."""
    found = EDITED if made else {**FACT, **FOLLOWS}
    assert Run(found, made).gate("looks").exit_code == 0


def test_a_gate_accepts_edited_pictures_and_nothing_else_by_name() -> None:
    """Another word is refused, with those that there are."""
    with pytest.raises(SpecError, match="--evidence 'staged'"):
        Run({}, "rendered").gate(evidence="staged")


def test_patched_is_asked_with_the_pictures_along_the_range_where_a_bank_has_it() -> None:
    """And of nobody whose bank has it not."""
    found = {**hand.reader(), **dict.fromkeys(NAMES, not_available("not asked"))}
    assert controls_wanted(found, supplied=(*STAGE, "patched"), conditions_run=()) == (*STAGE, "patched")
    assert controls_wanted(found, supplied=STAGE, conditions_run=()) == STAGE


def answered(changed: int, repeated: int, n: int, made: Provenance) -> LazyStatistics:
    """Return the tests of a model whose decision the edit and a repeat change so often, on other frames."""

    def column(which: range) -> tuple[Decision[str], ...]:
        return tuple(Decision("STOP" if place in which else "SLOW") for place in range(n))

    decisions = {
        "real": column(range(0)),
        "patched": column(range(changed)),
        "real_repeat": column(range(changed, changed + repeated)),
    }
    frames = tuple(banks.one(str(place), ("a", "a-0", place), "none", f"{place}.png") for place in range(n))
    return LazyStatistics(
        CalibratedTests(Answers("", frames, DRIVING, None, decisions, made=made), Resampling()).tests()
    )


def test_the_two_tests_of_an_edit_count_frames_with_all_three_answers() -> None:
    """One-sided and exact; the bound is exact too, and both are of edited banks alone."""
    found = answered(7, 1, 50, "edited")
    one = found["patched_excess"]
    assert isinstance(one, ChangedPairs)
    assert (one.value, one.n, one.changed, one.repeated) == (pytest.approx(0.12), 50, 7, 1)
    assert one.p == pytest.approx(float(binom.sf(6, 8, 0.5)))
    assert found["patched_bound"].ci == exact_bounds(7, 1, 50)
    for made in ("staged", "", "rendered"):
        assert "patched_excess" not in answered(7, 1, 50, made)
        assert ("photographed" in answered(7, 1, 50, made)) is (made != "rendered")


bounds = cache(exact_bounds)
"""Of an outcome, whose chance alone hangs on the truth."""


def test_an_exact_bound_holds_what_was_seen() -> None:
    """Also where everything changed one way, or as often as back."""
    for b, c, n in ((0, 0, 5), (5, 0, 5), (0, 5, 5), (7, 1, 50), (1, 7, 50), (22, 23, 45)):
        low, high = bounds(b, c, n) or (1.0, -1.0)
        assert low <= (b - c) / n <= high


def test_forty_four_frames_without_a_change_exclude_a_tenth() -> None:
    """Which is 1 - .01^(1/n)."""
    for n in (5, 22, 43, 44, 60, 173):
        ends = exact_bounds(0, 0, n)
        assert ends is not None
        assert ends[1] == pytest.approx(1 - 0.01 ** (1 / n), abs=1e-5)
        assert (ends[1] < 0.1) is (n >= 44)


@pytest.mark.parametrize(("n", "first", "second"), [(20, 0.1, 0.0), (20, 0.3, 0.2), (45, 0.1, 0.0), (45, 0.13, 0.03)])
def test_an_exact_bound_covers(n: int, first: float, second: float) -> None:
    """Over the outcomes: it lies below the true difference with a chance of .01 at most.

    The rarest, of which all together have a chance of 1e-4, are not tried, and count as if it did.
    """
    tried = np.array([(b, c, n - b - c) for b in range(n + 1) for c in range(n + 1 - b)])
    weights = multinomial.pmf(tried, n, [first, second, 1 - first - second])
    rising = np.argsort(weights)
    rare = np.cumsum(weights[rising]) < 1e-4
    chance = float(weights[rising][rare].sum())
    for outcome in rising[~rare]:
        b, c, _ = map(int, tried[outcome])
        if (b - c) / n < first - second:  # else the bound, which is not below what was seen, is not below the truth
            ends = bounds(b, c, n)
            assert ends is not None
            chance += float(weights[outcome]) * (ends[1] < first - second - 1e-6)
    assert chance <= 0.01 + 1e-4


def imported(folder: Path, **choices: object) -> Path:
    """Import a bank's pictures as somebody's photographs; return the new bank."""
    banks.build_bank(folder / "made")
    return _import_again(folder, **choices)


def record(folder: Path, **changed: object) -> Path:
    """Write the record of an edit beside the table."""
    files = {
        one.relative_to(folder).as_posix(): hashlib.sha256(one.read_bytes()).hexdigest()
        for one in folder.rglob("*.png")
    }
    said = {
        "made": "edited",
        "method": "edit/1",
        "parameters": {"near_m": [5, 9]},
        "pictures": {"lead_near": 8},
        "refused": [{"file": "a.png", "picture": "lead_far", "reason": "too small"}],
        "digests": files,
        **changed,
    }
    path = folder / "edit.json"
    path.write_text(json.dumps(said))
    return path


def test_an_import_says_how_its_control_pictures_were_made(tmp_path: Path) -> None:
    """By --made, or not at all; a simulator's bank is rendered, also one of before."""
    said = open_bank(imported(tmp_path / "one", made="staged")).manifest
    silent = open_bank(imported(tmp_path / "two")).manifest
    assert (said.provenance, silent.provenance) == ("staged", "")
    assert open_bank(tmp_path / "one" / "made").manifest.provenance == "rendered"
    assert (said.fingerprint, said.declaration) == (silent.fingerprint, silent.declaration)
    assert "made" not in silent.as_dict()


def test_the_record_of_an_edit_beside_the_table_is_read(tmp_path: Path) -> None:
    """Its method, its parameters and its counts are in the bank's manifest."""
    record(banks.build_bank(tmp_path / "made").root)
    made = open_bank(_import_again(tmp_path)).manifest
    assert made.provenance == "edited"
    assert made.edit["method"] == "edit/1"
    assert made.edit["refused"] == {"lead_far": 1}
    assert made.edit["parameters"] == {"near_m": [5, 9]}


def _import_again(root: Path, **choices: object) -> Path:
    bank = open_bank(root / "made")
    lines = ["file,gap,episode,scenario,lead_near,lead_far"]
    for frame in bank:
        near, far = (frame.counterfactuals.get(name, {}).get("main", "") for name in ("lead_near", "lead_far"))
        lines.append(f"{frame.file},{frame.truth['lead_gap_m'] or ''},{frame.episode},{frame.scenario},{near},{far}")
    table = root / "made" / "table.csv"
    table.write_text("\n".join(lines))
    return import_table(root / "made", table, root / "bank", Choices(threshold=18.0, unit="m", **choices)).root  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("changed", "choices", "says"),
    [
        ({}, {"made": "rendered"}, "says that the control pictures are edited, and made says rendered"),
        ({"made": "staged"}, {}, "is no record of an edit"),
        ({"digests": {}}, {}, "is no picture that edit.json names"),
        ({"pictures": "many"}, {}, "is no record of an edit"),
    ],
)
def test_a_record_that_does_not_fit_is_refused(
    tmp_path: Path, changed: dict[str, object], choices: dict[str, object], says: str
) -> None:
    """A contradiction, a damaged file, and pictures that it does not name; no bank is left."""
    record(banks.build_bank(tmp_path / "made").root, **changed)
    with pytest.raises(SourceError, match=says):
        _import_again(tmp_path, **choices)
    assert not (tmp_path / "bank").exists()


def test_a_picture_that_was_changed_after_the_edit_is_refused(tmp_path: Path) -> None:
    """By its digest."""
    bank = banks.build_bank(tmp_path / "made")
    record(bank.root)
    file = bank.root / bank.frames[0].counterfactuals["lead_near"]["main"]
    file.write_bytes(encode(np.zeros((4, 6, 3), np.uint8)))
    lines = ["file,gap,lead_near", f"{bank.frames[0].file},3,{file.relative_to(bank.root)}"]
    (bank.root / "table.csv").write_text("\n".join(lines))
    with pytest.raises(SourceError, match="its SHA-256 differs"):
        import_table(bank.root, bank.root / "table.csv", tmp_path / "bank", Choices(threshold=9.0, unit="m"))


def test_a_patched_picture_is_edited_and_no_copy_of_the_photograph(tmp_path: Path) -> None:
    """The photograph itself would show that nothing answers to the edit."""
    bank = banks.build_bank(tmp_path / "made")
    one, other = bank.frames[:2]
    table = bank.root / "table.csv"
    table.write_text(f"file,gap,patched\n{one.file},3,{one.file}\n")
    with pytest.raises(SourceError, match="patched and file are the same picture"):
        import_table(bank.root, table, tmp_path / "bank", Choices(threshold=9.0, unit="m"))
    table.write_text(f"file,gap,patched\n{one.file},3,{other.file}\n")
    with pytest.raises(SourceError, match="is edited, but made says staged"):
        import_table(bank.root, table, tmp_path / "bank", Choices(threshold=9.0, unit="m", made="staged"))


def test_a_bank_is_declared_in_place_and_its_runs_stay_valid(tmp_path: Path) -> None:
    """The manifest alone changes, without its digests; a run's own copy is declared by the run's folder."""
    root = imported(tmp_path)
    before, pictures = open_bank(root).manifest, {one: one.read_bytes() for one in root.rglob("*.png")}
    run = tmp_path / "run"
    words = ["run", "battery", "--frames", str(root), "--model", "scripted:depth", "--out", str(run)]
    assert CliRunner().invoke(app, words).exit_code == 0
    printed = json.loads(CliRunner().invoke(app, ["verdict", str(run), "--json"]).stdout)
    assert printed["models"]["scripted:depth"]["made"] == ""
    said = CliRunner().invoke(app, ["frames", "declare", str(root), str(run), "--made", "staged"])
    assert said.exit_code == 0, said.output
    assert "its control pictures are staged; before: not said" in said.output
    after = open_bank(root).manifest
    assert (after.made, after) == ("staged", replace(before, made="staged"))
    assert (after.fingerprint, after.declaration) == (before.fingerprint, before.declaration)
    assert check(root) == []
    assert {one: one.read_bytes() for one in root.rglob("*.png")} == pictures
    printed = json.loads(CliRunner().invoke(app, ["verdict", str(run), "--json"]).stdout)
    assert printed["models"]["scripted:depth"]["made"] == "staged"
    assert not list(root.glob(".manifest*"))


def everything(root: Path) -> dict[str, bytes]:
    """Return every file of a folder and beside it, hidden ones too."""
    return {str(one): one.read_bytes() for one in sorted(root.parent.rglob("*")) if one.is_file()}


def test_a_declaration_that_finds_no_room_changes_nothing(tmp_path: Path) -> None:
    """It is called a full disk, and no part of a manifest is left."""
    root = imported(tmp_path)
    before = everything(root)
    (root / ".manifest.json.part").symlink_to("/dev/full")
    with pytest.raises(BankError, match=r"manifest\.json cannot be replaced: the disk is full; it is as it was"):
        declare(root, "staged")
    assert everything(root) == before
    assert declare(root, "staged") == ""


@pytest.mark.parametrize("refused", ["mkdir", "replace"])
def test_a_declaration_of_what_is_read_only_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, refused: str
) -> None:
    """Of the folder around the bank and of the bank; both stay as they are."""
    root = imported(tmp_path)
    before = everything(root)

    def fails(*_: object, **__: object) -> None:
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    with monkeypatch.context() as patched:
        patched.setattr(Path, refused, fails)
        with pytest.raises(BankError, match="Read-only file system"):
            declare(root, "staged")
    assert everything(root) == before


KILLED = """
import os, signal, sys
from pathlib import Path
from eyechart.frames import declare
place = sys.argv[2]
def killed(*_): os.kill(os.getpid(), signal.SIGKILL)
if place == "sync": os.fsync = killed
if place == "replace": Path.replace = killed
declare(Path(sys.argv[1]), "staged")
"""


@pytest.mark.parametrize("place", ["sync", "replace"])
def test_a_declaration_that_is_killed_leaves_the_bank_as_it_was(tmp_path: Path, place: str) -> None:
    """The same command then declares it, and takes away what was left."""
    root = imported(tmp_path)
    before = everything(root)
    done = subprocess.run([sys.executable, "-c", KILLED, str(root), place], check=False)
    assert done.returncode == -signal.SIGKILL
    assert {file: content for file, content in everything(root).items() if ".part" not in file} == before
    assert open_bank(root).manifest.provenance == ""
    assert check(root) == []
    assert declare(root, "staged") == ""
    assert {*everything(root)} == {*before}
    assert open_bank(root).manifest.provenance == "staged"


def test_a_bank_or_a_run_that_is_written_is_not_declared(tmp_path: Path) -> None:
    """Whoever adds pictures replaces the manifest too, and one of the two would be lost."""
    root, run = imported(tmp_path), tmp_path / "run"
    words = ["run", "battery", "--frames", str(root), "--model", "scripted:depth", "--out", str(run)]
    assert CliRunner().invoke(app, words).exit_code == 0
    before = everything(root)
    with own_folder(root, BankError):
        said = CliRunner().invoke(app, ["frames", "declare", str(root), "--made", "staged"])
    assert f"another process is writing {root}; wait for it" in str(said.exception)
    with alone_in(run):
        said = CliRunner().invoke(app, ["frames", "declare", str(run), "--made", "staged"])
    assert f"another process is writing to {run}; wait for it" in str(said.exception)
    assert everything(root) == before


def test_all_folders_are_checked_before_one_is_declared(tmp_path: Path) -> None:
    """A simulator's bank among them keeps the others as they are."""
    root = imported(tmp_path)
    said = CliRunner().invoke(app, ["frames", "declare", str(root), str(tmp_path / "made"), "--made", "staged"])
    assert "rendered the pictures" in str(said.exception)
    assert open_bank(root).manifest.provenance == ""


def test_a_gate_on_edited_evidence_changes_nothing_and_needs_no_room(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It reads a run and may keep its reading; where nothing can be written it says the same."""
    record(banks.build_bank(tmp_path / "made").root)
    root, run = _import_again(tmp_path), tmp_path / "run"
    words = ["run", "battery", "--frames", str(root), "--model", "scripted:depth", "--out", str(run)]
    assert CliRunner().invoke(app, words).exit_code == 0
    before = everything(root)
    words = ["gate", str(run), "--require", "depth", "--evidence", "edited", "--json"]

    def refusing(does: Callable[..., Path | None]) -> Callable[..., Path | None]:
        def fails(path: Path, *more: Any, **named: Any) -> Path | None:  # noqa: ANN401 - as it takes them
            if path.is_relative_to(run):
                raise OSError(errno.EROFS, os.strerror(errno.EROFS))
            return does(path, *more, **named)

        return fails

    with monkeypatch.context() as patched:
        patched.setattr(Path, "mkdir", refusing(Path.mkdir))
        patched.setattr(Path, "replace", refusing(Path.replace))
        refused = CliRunner().invoke(app, words)
        assert everything(root) == before
    said = CliRunner().invoke(app, words)
    assert (refused.exit_code, refused.stdout) == (said.exit_code, said.stdout) == (2, said.stdout)
    assert json.loads(said.stdout)["checks"]
    assert {file: content for file, content in everything(root).items() if "/.reading/" not in file} == before


@pytest.mark.parametrize(("made", "says"), [("staged", "rendered the pictures"), ("edited", "they are not edited")])
def test_what_a_simulator_drew_is_rendered(tmp_path: Path, made: Provenance, says: str) -> None:
    """Nobody's word makes it something else."""
    root = banks.build_bank(tmp_path / "made").root
    with pytest.raises(BankError, match=says):
        declare(root, made)
    assert declare(root, "rendered") == "rendered"


def test_what_an_edit_made_is_not_declared_otherwise(tmp_path: Path) -> None:
    """The record of the edit is in the bank."""
    record(banks.build_bank(tmp_path / "made").root)
    root = _import_again(tmp_path)
    with pytest.raises(BankError, match="which an edit makes"):
        declare(root, "rendered")
    assert declare(root, "edited") == "edited"


def test_an_unknown_word_is_refused_with_those_that_there_are(tmp_path: Path) -> None:
    """By the import and by the declaration; the bank stays."""
    root = imported(tmp_path)
    said = CliRunner().invoke(app, ["frames", "declare", str(root), "--made", "stagd"])
    assert "--made takes rendered, staged, edited, not 'stagd'; did you mean 'staged'?" in str(said.exception)
    assert open_bank(root).manifest.provenance == ""


def test_a_run_and_its_bank_that_say_different_things_go_no_further(tmp_path: Path) -> None:
    """A corrected bank leaves its runs behind: the command says so, and a resumed run asks which holds."""
    root, run = imported(tmp_path, made="staged"), tmp_path / "run"
    words = ["run", "battery", "--model", "scripted:constant", "--frames", str(root), "--out", str(run)]
    words += ["--conditions", "real,blank"]
    assert CliRunner().invoke(app, words).exit_code == 0
    said = CliRunner().invoke(app, ["frames", "declare", str(root), "--made", "edited"])
    assert "keep what it said before: name their folders too" in said.stderr
    assert open_bank(run / "bank").manifest.made == "staged"
    again = CliRunner().invoke(app, words)
    assert isinstance(again.exception, LedgerError)
    assert f"are edited by {root}, and staged by the run in {run}: say which with" in str(again.exception)
    assert open_bank(run / "bank").manifest.made == "staged"
    said = CliRunner().invoke(app, ["frames", "declare", str(root), str(run), "--made", "edited"])
    assert "name their folders too" not in said.stderr
    assert CliRunner().invoke(app, words).exit_code == 0


def test_shards_that_say_different_things_are_no_one_run(tmp_path: Path) -> None:
    """The merged run has what one of them says, whichever comes first, and no word for another."""
    root = imported(tmp_path)
    shards = [tmp_path / "one", tmp_path / "two"]
    for number, shard in enumerate(shards, 1):
        words = ["run", "battery", "--model", "scripted:constant", "--frames", str(root), "--out", str(shard)]
        words += ["--conditions", "real,blank", "--shard", f"{number}/2"]
        assert CliRunner().invoke(app, words).exit_code == 0
    declare(shards[1] / "bank", "edited")
    merge(shards, tmp_path / "merged")
    assert open_bank(tmp_path / "merged" / "bank").manifest.made == "edited"
    declare(shards[0] / "bank", "staged")
    for order in (shards, shards[::-1]):
        with pytest.raises(LedgerError, match="say which with 'eyechart frames declare'"):
            merge(order, tmp_path / "other")
        assert not (tmp_path / "other").exists()


@pytest.mark.parametrize("made", ["", "staged", "rendered"])
def test_pictures_of_an_edit_are_edited_by_whatever_table_they_come(tmp_path: Path, made: Provenance) -> None:
    """A table elsewhere leaves the record behind; only the photographs themselves are imported without it."""
    edited = tmp_path / "all" / "edited"
    for name in ("taken", "lead_near", "lead_far"):
        (edited / name).mkdir(parents=True)
        for number in range(3):
            pixels = np.full((12, 16, 3), 20 * number + len(name), np.uint8)
            Image.fromarray(pixels).save(edited / name / f"{number}.png")
    record(edited, pictures={"lead_near": 3, "lead_far": 3})
    moved = tmp_path / "moved.csv"
    for folder, below in ((edited, ""), (tmp_path / "all", "edited/")):
        cells = ("taken", "lead_near", "lead_far")
        rows = [",".join(f"{below}{name}/{number}.png" for name in cells) for number in range(3)]
        moved.write_text("\n".join(["file,lead_near,lead_far", *rows]))
        with pytest.raises(SourceError, match=r"'.*lead_near/0.png' was made by an edit, as .*edit.json says"):
            import_table(folder, moved, tmp_path / "bank", Choices(made=made))
        assert not (tmp_path / "bank").exists()
    assert import_table(edited.parent, moved, tmp_path / "bank", Choices(made="edited")).manifest.made == "edited"
    moved.write_text("\n".join(["file", *(f"taken/{number}.png" for number in range(3))]))
    assert import_table(edited, moved, tmp_path / "plain", Choices()).manifest.made == ""


@pytest.mark.parametrize("beside", [True, False])
def test_a_bank_of_edited_pictures_says_so_wherever_its_pictures_are_imported_again(
    tmp_path: Path,
    beside: bool,  # noqa: FBT001 - a parameter
) -> None:
    """Its manifest is the record; no import of them is rendered, and the new bank keeps the record."""
    record(banks.build_bank(tmp_path / "made").root)
    old = open_bank(_import_again(tmp_path))
    near = [f"{frame.file},3,{frame.counterfactuals['lead_near']['main']}" for frame in list(old)[:3]]
    table = (old.root if beside else tmp_path) / "again.csv"
    table.write_text("\n".join(["file,gap,lead_near", *near]))
    choices = Choices(threshold=18.0, unit="m")
    for made in ("rendered", "staged", *([] if beside else [""])):
        with pytest.raises(SourceError, match=r"manifest.json says"):
            import_table(old.root, table, tmp_path / "new", replace(choices, made=made))  # type: ignore[arg-type]
        assert not (tmp_path / "new").exists()
    new = import_table(old.root, table, tmp_path / "new", replace(choices, made="edited")).manifest
    assert new.provenance == "edited"
    if not beside:
        return
    assert new.edit == old.manifest.edit
    assert import_table(old.root, table, tmp_path / "silent", choices).manifest.edit == old.manifest.edit
    with pytest.raises(BankError, match="which an edit makes; they are not staged"):
        declare(tmp_path / "new", "staged")


def test_a_manifest_of_another_program_says_nothing_of_pictures(tmp_path: Path) -> None:
    """A folder of photographs may hold any file of that name."""
    bank = banks.build_bank(tmp_path / "made")
    (tmp_path / "photos").mkdir()
    (bank.root / bank.frames[0].file).rename(tmp_path / "photos" / "a.png")
    (tmp_path / "photos" / "manifest.json").write_text('{"made": "edited"}')
    table = tmp_path / "photos" / "t.csv"
    table.write_text("file\na.png\n")
    assert import_table(table.parent, table, tmp_path / "bank", Choices()).manifest.made == ""
