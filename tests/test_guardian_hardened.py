"""What a guardian withstands: models that raise SystemExit, another mode, files that were edited, runs half done."""

import asyncio
import json
import sys
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import published_votes
import voters
from banks import build_bank, draw
from eyechart import cli
from eyechart.calls import Query, Reply
from eyechart.errors import BankError, GuardianError, VoteError
from eyechart.frames import encode, open_bank
from eyechart.guardian import Guardian, interface_of
from eyechart.guardian import guardian as asking_module
from eyechart.guardian.page import guardian_page
from eyechart.limits import Limits
from eyechart.models import ADAPTERS, Model
from eyechart.modes import RequestMode
from eyechart.prompts import SCENE
from eyechart.spaces.scene import Scene
from eyechart.studies import battery, structured
from eyechart.studies import guardian as study
from published_votes import GEMMA, QWEN, published
from stand_ins import Held

NEAR = encode(draw(8.0, 3))


@pytest.fixture(scope="module")
def table() -> study.VoteTable:
    """Return the votes with the paper's counts."""
    return published()


@pytest.fixture(scope="module")
def frozen(table: study.VoteTable) -> study.FrozenGuardian:
    """Return the guardian that the 16 calibration frames choose."""
    return study.fit(table.part("calibration"))


@pytest.fixture
def say(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Callable[..., tuple[object, str, str]]:
    """Return the command line as a function: exit code, standard output, standard error."""

    def run(*words: object) -> tuple[object, str, str]:
        monkeypatch.setattr(sys, "argv", ["eyechart", *map(str, words)])
        with pytest.raises(SystemExit) as left:
            cli.main()
        return left.value.code, *capsys.readouterr()

    return run


Say = Callable[..., tuple[object, str, str]]


class Quits(Held):
    """A model that ends its program, at once or in a task of its own."""

    def __init__(self, *, apart: bool) -> None:
        self.apart = apart

    async def answer(self, query: Query) -> Reply:
        """Raise what no `except Exception` catches."""
        assert query.image
        if self.apart:
            self.task = asyncio.get_running_loop().create_task(self.leave())
            self.task.add_done_callback(lambda done: done.exception())  # else asyncio logs it when it is let go
            await asyncio.sleep(0.01)
            return voters.says(None)
        return await self.leave()

    async def leave(self) -> Reply:
        """Raise it."""
        raise SystemExit(3)

    async def close(self) -> None:
        """Raise it once more."""
        raise SystemExit(4)


class Holds(Held):
    """A model that holds the event loop until it is told to go on."""

    def __init__(self) -> None:
        self.holds, self.go_on = threading.Event(), threading.Event()

    async def answer(self, query: Query) -> Reply:
        """Wait without letting the loop turn."""
        assert query.image
        self.holds.set()
        self.go_on.wait(60)
        return voters.says(None)


def guardian_of(frozen: study.FrozenGuardian, model: Model) -> Guardian:
    """Return a guardian whose every voter is this model, shown the drawn pictures."""
    about = replace(frozen.about, wording=SCENE, prompt=SCENE.key, axis="vertical", view="none")
    chosen = replace(frozen, about=about)
    return Guardian(chosen, dict.fromkeys(chosen.committee, model), interface_of(chosen), deadline_s=0.5)


@pytest.mark.parametrize("apart", [False, True])
def test_a_model_that_exits_ends_neither_the_loop_nor_the_stack(frozen: study.FrozenGuardian, *, apart: bool) -> None:
    """Its votes are missing, or its task is lost; the next picture is answered too, and closing is no error."""
    guardian = guardian_of(frozen, Quits(apart=apart))
    with guardian:
        for _ in range(3):
            found = guardian.assess(NEAR, deadline_s=10.0)
            assert found.answer == ("clear" if apart else "abstain")
            assert apart or "SystemExit: 3" in found.why
    assert guardian._thread is not None
    assert not guardian._thread.is_alive()


def test_an_interface_that_exits_is_abstained_from(frozen: study.FrozenGuardian) -> None:
    """What makes the views is as little trusted as a model."""

    def exits(picture: bytes) -> tuple[bytes, bytes]:
        raise SystemExit(len(picture))

    with guardian_of(frozen, Holds()) as guardian:
        guardian._interface = replace(guardian._interface, views=exits)
        for _ in range(2):
            assert "the picture could not be prepared: SystemExit" in guardian.assess(NEAR, deadline_s=10.0).why


def test_a_loop_that_is_held_does_not_gather_pictures(
    frozen: study.FrozenGuardian, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Beyond so many it is abstained at once; when the loop turns again there is room again."""
    monkeypatch.setattr(asking_module, "MOST_AT_ONCE", 3)
    model = Holds()
    with guardian_of(frozen, model) as guardian:
        first = threading.Thread(target=guardian.assess, args=(NEAR,), kwargs={"deadline_s": 30.0})
        first.start()
        assert model.holds.wait(20)
        for _ in range(2):
            assert "by the deadline" in guardian.assess(NEAR, deadline_s=0.05).why
        began = time.perf_counter()
        for _ in range(20):
            assert "are under way already" in guardian.assess(NEAR, deadline_s=30.0).why
        assert asyncio.run(guardian.assess_async(NEAR, deadline_s=30.0)).answer == "abstain"
        assert time.perf_counter() - began < 25.0
        model.go_on.set()
        first.join(20)
        for _ in range(500):
            if not guardian._under_way:
                break
            time.sleep(0.01)
        assert guardian.assess(NEAR, deadline_s=10.0).answer == "clear"


def test_votes_that_were_asked_for_in_another_mode_are_refused(table: study.VoteTable) -> None:
    """A budget of tokens is another question; an address is not; what was not recorded cannot be compared."""
    mode = RequestMode(QWEN, max_tokens=64)

    def of(part: str, modes: Mapping[str, RequestMode]) -> study.VoteTable:
        return replace(table.part(part), about=replace(table.about, modes=modes))

    chosen, scored = study.fit(of("calibration", {QWEN: mode})), "score"
    chosen.may_score(of(scored, {QWEN: replace(mode, base_url="http://127.0.0.1:1/v1", timeout_s=9)}))
    chosen.may_score(of(scored, {}))
    for other in (replace(mode, max_tokens=9), replace(mode, temperature=1.0), replace(mode, structured="json_object")):
        with pytest.raises(GuardianError, match=f"the mode of '{QWEN}' differs"):
            chosen.may_score(of(scored, {QWEN: other}))


def test_the_column_split_is_heeded_wherever_votes_are_read(say: Say, table: study.VoteTable, tmp_path: Path) -> None:
    """The rows of --bound FILE that are bound, and for nested those that are not."""
    parts = np.array(
        ["calibration" if episode < "e04" else "score" if episode < "e07" else "bound" for episode in table.episodes]
    )
    votes, about = published_votes.write(replace(table, split=tuple(parts)), tmp_path)
    guardian = tmp_path / "guardian.json"
    assert say("guardian", "fit", votes, "--about", about, "--out", guardian)[0] == 0
    code, out, err = say("guardian", "score", guardian, votes, "--about", about, "--bound", votes, "--json")
    assert (code, json.loads(out)["bound"]["episodes"], err) == (0, 5, "")
    code, out, err = say("guardian", "nested", votes, "--json")
    assert (code, json.loads(out)["frames"]) == (0, int(np.sum(parts != "bound")))
    assert f"left out: {np.sum(parts == 'bound')} frames whose column split is bound" in err


def test_a_guardian_is_not_overwritten_by_another(say: Say, table: study.VoteTable, tmp_path: Path) -> None:
    """Neither by its own export nor by another choice; the same guardian may be written again."""
    votes, about = published_votes.write(table, tmp_path)
    guardian, stack = tmp_path / "guardian.json", tmp_path / "stack.json"
    fit = ("guardian", "fit", votes, "--about", about, "--out")
    assert [say(*fit, guardian)[0] for _ in range(2)] == [0, 0]
    kept = guardian.read_bytes()
    for words in (("guardian", "export", guardian, "--out", guardian), (*fit, guardian, "--size", 1)):
        code, _, err = say(*words)
        assert (code, "holds another guardian" in err, err.count("\n")) == (2, True, 1)
        assert guardian.read_bytes() == kept
    assert [say("guardian", "export", guardian, "--out", stack)[0] for _ in range(2)] == [0, 0]


def test_a_run_that_is_not_finished_chooses_no_guardian(
    table: study.VoteTable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It says how many calls are left; a score on it warns of them; models that are finished may be named."""
    monkeypatch.setitem(ADAPTERS, "voter", "voters")
    bank = build_bank(tmp_path / "bank", episodes=3, steps=4, drawn=False)
    plan = structured.plan("structured", bank.root, ["voter:sees", "voter:looks"], tmp_path / "run")
    battery.run(plan, limits=Limits(calls=30))
    half = study.votes_of_run(tmp_path / "run")
    left = sum(half.unfinished.values())
    assert left == 2 * 2 * len(half.frames) - 30
    for choose in (study.fit, study.nested):
        with pytest.raises(GuardianError, match=f"not finished: {left} calls are left"):
            choose(half)
    frozen = study.fit(table.part("calibration"))
    some = replace(table.part("score"), unfinished={GEMMA: 7, "another": 1})
    assert any("not finished: 7 calls are left" in warning for warning in study.score(frozen, some).warnings)
    with pytest.raises(GuardianError, match=r"not finished: 7 calls are left.*before you take a bound from it"):
        study.bound(frozen, some)
    battery.run(plan)
    assert not study.votes_of_run(tmp_path / "run").left(half.models)


def test_every_command_that_reads_a_run_says_that_it_is_not_finished(
    tmp_path: Path, say: Callable[..., tuple[object, str, str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those that choose or bound refuse it, those that measure warn: a missing vote abstains, as sight may."""
    monkeypatch.setitem(ADAPTERS, "voter", "voters")
    bank = build_bank(tmp_path / "bank", scenarios=("merge",), episodes=3, steps=6, drawn=False)
    whole, half, guardian = tmp_path / "whole", tmp_path / "half", tmp_path / "guardian.json"
    pair = ["voter:sees", "voter:looks"]
    battery.run(structured.plan("structured", bank.root, pair, whole))
    battery.run(structured.plan("structured", bank.root, pair, half), limits=Limits(calls=36))
    ids = tmp_path / "ids.txt"
    ids.write_text("\n".join(frame.id for frame in bank if frame.episode.endswith("-0")))
    assert say("guardian", "fit", whole, "--calibration", ids, "--out", guardian)[0] == 0
    scene = Scene(30.0, left_clear=True, right_clear=True)
    monkeypatch.setattr(study, "reader_of", lambda _: lambda _: (scene, scene))
    asked = (half, "--unseen")
    for words, code, why in (
        (("score", guardian, *asked), 0, "not finished: 36 calls are left; their votes count as missing"),
        (("modular", guardian, *asked, "--frames", bank.root), 0, "not finished: 36 calls are left"),
        (("modular", guardian, whole, "--unseen", "--frames", bank.root), 0, ""),
        (("score", guardian, *asked, "--bound-episodes", "merge/merge-1"), 2, "before you take a bound from it"),
        (("fit", half, "--out", tmp_path / "new.json"), 2, "not finished: 36 calls are left"),
        (("nested", half), 2, "not finished: 36 calls are left"),
    ):
        found, _, err = say("guardian", *words)
        assert (found, why in err, "not finished" in err) == (code, True, bool(why)), (words, err)
        assert ("frames are left out: " in err) == ("--unseen" in words and code == 0), (words, err)
    _, out, _ = say("guardian", "modular", guardian, *asked, "--frames", bank.root, "--json")
    assert "not finished" in json.loads(out)["warnings"][0]


def test_episodes_that_do_not_differ_give_no_interval_of_no_width(table: study.VoteTable) -> None:
    """Where nobody errs, a share has the exact bound and balanced accuracy is no surer than its parts."""
    frozen = study.fit(table.part("calibration"))
    score = table.part("score")
    right = np.repeat(score.hazard[None, :, None], len(score.models), axis=0).repeat(2, axis=2).astype(np.int8)
    row = study.score(frozen, replace(score, votes=right), resamples=50).rows["two_way"]
    for name in ("coverage", "acc", "sens", "spec"):
        assert row[name].ci == (pytest.approx(0.05 ** (1 / 12), abs=2e-4), 1.0), "exact, over the 12 episodes"
        assert "exact" in row[name].method
    assert row["bal"].ci == (pytest.approx(0.05 ** (1 / 12), abs=2e-4), 1.0)
    assert row["sens"].detail == {"k": int(score.hazard.sum()), "episodes": 12}


def test_a_picture_that_is_not_the_banks_is_not_read_nor_shown(table: study.VoteTable, tmp_path: Path) -> None:
    """Modular replay and the page of a score compare it with the manifest."""
    bank = build_bank(tmp_path / "bank", episodes=1, steps=4, drawn=False)
    frame = bank.frames[0]
    study.reader_of(bank)(frame.id)
    score = table.part("score")
    ids = (frame.id, *score.frames[1:])
    frozen = study.fit(table.part("calibration"))
    found = study.score(frozen, replace(score, frames=ids), resamples=50)
    found = replace(found, missed=(frame.id,))
    guardian_page(found, bank)
    (bank.root / frame.file).write_bytes(NEAR)
    for use in (lambda: study.reader_of(open_bank(bank.root))(frame.id), lambda: guardian_page(found, bank)):
        with pytest.raises(BankError, match="its SHA-256 differs"):
            use()


def test_numbers_that_name_frames_are_the_same_in_every_table(tmp_path: Path) -> None:
    """1.0 is 1 in text and in JSON; what is no finite number names nothing."""
    text, lines = tmp_path / "votes.csv", tmp_path / "votes.jsonl"
    text.write_text("frame,episode,hazard,m/original,m/reflected\n1.0,2.00,1,1,1\n1.5,v1.0,0,0,0\n")
    row = {"frame": 1.0, "episode": 2.0, "hazard": True, "m/original": True, "m/reflected": True}
    other = {**row, "frame": 1.5, "episode": "v1.0", "hazard": False}
    lines.write_text(f"{json.dumps(row)}\n{json.dumps(other)}\n")
    for path in (text, lines):
        read = study.read_votes(path)
        assert (read.frames, read.episodes) == (("1", "1.5"), ("2", "v1.0"))
    for column in ("frame", "episode"):
        for value in (float("nan"), float("inf"), -float("inf")):
            lines.write_text(json.dumps({**row, column: value}) + "\n")
            with pytest.raises(VoteError, match=f"row 1: '{column}' is -?(nan|inf)"):
                study.read_votes(lines)


def test_a_mode_that_is_no_table_is_refused(table: study.VoteTable, tmp_path: Path) -> None:
    """A key that has no effect would be taken for one that has."""
    votes, about = published_votes.write(table, tmp_path)
    about.write_text(f'[models."{QWEN}"]\nversion = "1"\nmode = 7\n')
    with pytest.raises(VoteError, match=f"the mode of '{QWEN}' is 7"):
        study.read_votes(votes, about=about)


@pytest.mark.parametrize(
    "changes", [{"threshold": 9}, {"threshold": 0}, {"committee": (GEMMA, GEMMA)}, {"committee": ()}]
)
def test_a_guardian_that_cannot_be_is_no_guardian(
    frozen: study.FrozenGuardian, tmp_path: Path, changes: Mapping[str, object]
) -> None:
    """Although its digest matches."""
    path = tmp_path / "guardian.json"
    study.write_frozen(path, replace(frozen, **changes))  # type: ignore[arg-type]
    with pytest.raises(GuardianError, match="is no guardian that this eyechart can read"):
        study.read_frozen(path)
