"""A callable is a guest: nothing that it does to what it is given changes what another is shown, or what is counted."""

import asyncio
import os
import pickle
import sqlite3
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from copy import deepcopy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from banks import build_bank
from eyechart.api import run_battery
from eyechart.calls import Query, Reply
from eyechart.errors import BankError
from eyechart.frames import FrameBank, Stimulus, decode, encode
from eyechart.ledger import Ledger
from eyechart.limits import Limits
from eyechart.manifest import LEDGER
from eyechart.models import open_model
from eyechart.models.python_callable import LEFT_AT_MOST
from eyechart.modes import RequestMode
from eyechart.studies import battery

BLACK = encode(np.zeros((4, 4, 3), dtype=np.uint8))
Images = dict[str, bytes]
State = dict[str, tuple[float, ...]]


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a small bank."""
    return build_bank(tmp_path_factory.mktemp("bank") / "bank")


def by_brightness(prompt: str, images: Images, state: State) -> str:
    """Answer by how bright the picture is."""
    del prompt, state
    image = images.get("main")
    return "STRAIGHT" if image is None or decode(image, "shown").mean() < 110 else "STOP"


def replaces(prompt: str, images: Images, state: State) -> str:
    """Prepare the pictures in the dictionary that it was given."""
    del prompt, state
    for name in images:
        images[name] = BLACK
    return "SLOW"


def empties(prompt: str, images: Images, state: State) -> str:
    """Take out what it was given."""
    del prompt
    images.clear()
    state.clear()
    return "SLOW"


def adds(prompt: str, images: Images, state: State) -> str:
    """Put a camera and a number of its own beside what it was given."""
    del prompt
    images["mine"], state["mine"] = BLACK, (1.0,)
    return "SLOW"


def rows(run: Path, model: str) -> dict[tuple[str, str], tuple[str, str]]:
    """Return the digest and the reply of each call of a model."""
    with Ledger(run / LEDGER) as ledger:
        return {
            (attempt.key.frame, attempt.key.condition): (
                attempt.request_sha256,
                attempt.reply.text if attempt.reply else "",
            )
            for attempt in ledger.attempts(model)
        }


@pytest.mark.parametrize("guest", [replaces, empties, adds])
def test_no_callable_changes_what_another_model_is_shown(
    bank: FrameBank, tmp_path: Path, guest: Callable[[str, Images, State], str]
) -> None:
    """Beside a careless one, another is asked and answers as it does alone."""
    run_battery(bank, {"reader": by_brightness}, tmp_path / "alone", limit=6)
    run_battery(bank, {"guest": guest, "reader": by_brightness}, tmp_path / "both", limit=6)
    assert rows(tmp_path / "both", "python:reader") == rows(tmp_path / "alone", "python:reader")


def test_a_bank_that_changes_under_a_run_ends_it_and_no_other_picture_is_shown(tmp_path: Path) -> None:
    """What was asked before is kept; with its pictures back the same command goes on."""
    root = build_bank(tmp_path / "bank").root
    one, other = sorted(root.rglob("*.png"))[-2:]
    before = one.read_bytes()

    def changes(prompt: str, image: bytes | None) -> str:
        del prompt, image
        one.write_bytes(other.read_bytes())
        return "SLOW"

    with pytest.raises(BankError, match="is not the picture in the bank's manifest"):
        run_battery(root, {"guest": changes}, tmp_path / "run", concurrency=1)
    assert rows(tmp_path / "run", "python:guest")
    one.write_bytes(before)


def test_a_call_that_is_made_again_is_shown_what_it_was_shown_first(bank: FrameBank, tmp_path: Path) -> None:
    """Whatever the attempt before, which was too slow, did to its pictures."""
    seen: list[bytes] = []

    def slow_at_first(prompt: str, images: Images, state: State) -> str:
        del prompt, state
        if "main" not in images:
            return "SLOW"
        image, images["main"] = images["main"], BLACK
        seen.append(image)
        if len(seen) == 1:
            time.sleep(0.6)
        return "STOP" if image == BLACK else "SLOW"

    run_battery(bank, {"slow": slow_at_first}, tmp_path / "run", limit=2, timeout_s=0.3, concurrency=1)
    assert BLACK not in seen
    assert {text for _, text in rows(tmp_path / "run", "python:slow").values()} == {"SLOW"}
    assert "timeout" in _kinds(tmp_path / "run")


def test_a_stimulus_cannot_be_changed_and_can_be_copied() -> None:
    """Also not by changing what it was made of; a worker in another process gets one that is equal."""
    images, state = {"main": BLACK}, {"joints": (1.0,)}
    stimulus = Stimulus(images, {"speed": 3}, state)
    images["main"], state["joints"] = b"", (2.0,)
    assert (stimulus.images["main"], stimulus.state["joints"]) == (BLACK, (1.0,))
    for part in (stimulus.images, stimulus.fields, stimulus.state):
        with pytest.raises(TypeError):
            part["main"] = b""  # type: ignore[index]
    for copied in (pickle.loads(pickle.dumps(stimulus)), deepcopy(stimulus)):  # noqa: S301 - its own
        assert copied == stimulus


class Changes:
    """A model that changes the schema that it is given, and fails at first."""

    version, facts = "1", {}

    def __init__(self) -> None:
        self.seen: list[str] = []

    async def answer(self, query: Query) -> Reply:
        """Keep the digest of what came, change it, and answer the second time."""
        self.seen.append(query.sha256())
        query.schema["properties"]["action"]["enum"] = ["MINE"]  # type: ignore[index]
        return Reply("SLOW", "stop") if len(self.seen) % 2 == 0 else Reply(error="server_error")

    async def close(self) -> None:
        """Hold nothing."""


def test_no_model_changes_the_schema_that_another_call_is_given(
    bank: FrameBank, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither of the same call when it is made again, nor of those of another model."""
    monkeypatch.setattr("eyechart.attempts.pause_s", lambda *_: 0)
    planned = battery.plan(bank.root, ["scripted:depth", "scripted:constant"], tmp_path / "run", conditions=["real"])
    careless = Changes()
    battery.run(replace(planned, models={**planned.models, "scripted:depth": careless}), concurrency=1)
    asked = [rows(tmp_path / "run", spec) for spec in ("scripted:depth", "scripted:constant")]
    digests = [{key: digest for key, (digest, _) in one.items()} for one in asked]
    assert digests[0] == digests[1]
    assert sorted(careless.seen) == sorted([*digests[0].values()] * 2)
    schema = {"type": "object", "properties": {"action": {"enum": ["A"]}}}
    one, other = (Query("", "", Stimulus(), 0, schema) for _ in range(2))
    one.schema["properties"]["action"]["enum"].append("MINE")  # type: ignore[index]
    assert other.schema == schema == {"type": "object", "properties": {"action": {"enum": ["A"]}}}


def guard(run: Path, name: str) -> dict[str, bool | None]:
    """Return of each model whether a guard of this name holds, of those that have it."""
    _, kept = battery.took(run)
    return {spec: one.holds for spec, guards in kept.items() for one in guards if one.name == name}


def test_two_digests_of_one_frame_and_condition_fail_a_guard_of_both_models(bank: FrameBank, tmp_path: Path) -> None:
    """Whichever of the two was shown something else; a third, that was asked as one of them in all else, is named."""
    two = ["scripted:depth", "scripted:constant"]
    battery.run(battery.plan(bank.root, two, tmp_path / "run", extent=battery.BatterySelection(limit=4)))
    assert guard(tmp_path / "run", "shown") == {}
    _change_digest(tmp_path / "run", "scripted:constant")
    assert guard(tmp_path / "run", "shown") == dict.fromkeys(two, False)


def test_two_digests_of_one_call_fail_a_guard(bank: FrameBank, tmp_path: Path) -> None:
    """Where a call was made again, and shown something else."""
    battery.run(battery.plan(bank.root, ["scripted:depth"], tmp_path / "run", extent=battery.BatterySelection(limit=4)))
    with Ledger(tmp_path / "run" / LEDGER, create=True) as ledger:
        key, reply = next(iter(ledger.replies("scripted:depth")))
        ledger.close(ledger.begin(key, "0" * 64, again=True), reply)
    assert guard(tmp_path / "run", "shown") == {"scripted:depth": False}
    assert guard(tmp_path / "run", "outcomes") == {"scripted:depth": True}


def _change_digest(run: Path, model: str) -> None:
    """Have one call of a model be of another picture, as it was where a guest had changed it before it was sent."""
    with Ledger(run / LEDGER) as ledger:
        sent = [attempt for spec in ledger.models() for attempt in ledger.attempts(spec)]
    for file in run.glob("ledger*"):
        file.unlink()
    changed = next(attempt.key for attempt in sent if attempt.key.model == model)
    with Ledger(run / LEDGER, create=True) as ledger:
        for one in sent:
            assert one.reply is not None
            ledger.close(ledger.begin(one.key, "0" * 64 if one.key == changed else one.request_sha256), one.reply)


@pytest.fixture
def hanging(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """Write a module whose callable hangs while a file is there; let its threads go in the end."""
    name = f"hanging_{abs(hash(tmp_path))}"
    code = f"import time\nfrom pathlib import Path\nFLAG = Path({str(tmp_path / 'HANG')!r})\n"
    code += "def decide(prompt, image):\n    while FLAG.exists(): time.sleep(0.02)\n    return 'SLOW'\n"
    (tmp_path / f"{name}.py").write_text(code, encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "HANG").touch()
    yield f"python:{name}:decide"
    (tmp_path / "HANG").unlink(missing_ok=True)
    for thread in threading.enumerate():
        if thread.name == "eyechart-call":
            thread.join(10)


def test_a_call_that_was_never_made_is_made_later(
    bank: FrameBank, tmp_path: Path, hanging: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No failure of it is kept, and no limit of calls counts it."""
    monkeypatch.setattr("eyechart.attempts.pause_s", lambda *_: 0.0)
    mode, extent = RequestMode(hanging, timeout_s=1.0), battery.BatterySelection(limit=6)
    planned = battery.plan(bank.root, [mode], tmp_path / "run", extent=extent)
    battery.run(planned, concurrency=LEFT_AT_MOST)
    assert planned.left() == planned.counts()[0]
    kinds = _kinds(tmp_path / "run")
    assert set(kinds) == {"timeout", "not_called"}
    (tmp_path / "HANG").unlink()
    most = kinds["timeout"] + planned.counts()[0]
    again = battery.plan(bank.root, [mode], tmp_path / "run", extent=extent)
    outcome = battery.run(again, limits=Limits(calls=most))
    assert (again.left(), outcome.stopped) == (0, None)
    assert _kinds(tmp_path / "run")["answer"] == again.counts()[0]


def _kinds(run: Path) -> dict[str, int]:
    with closing(sqlite3.connect(f"file:{run / LEDGER}?mode=ro", uri=True)) as held:
        found = held.execute("SELECT coalesce(error, 'answer'), count(*) FROM replies GROUP BY 1").fetchall()
    return dict(found)


def test_a_policy_that_was_never_called_has_not_failed(hanging: str, tmp_path: Path) -> None:
    """As a model has not."""
    name = hanging.split(":")[1]
    code = (tmp_path / f"{name}.py").read_text(encoding="utf-8")
    code = code.replace("(prompt, image)", "(images, state, instruction)").replace("'SLOW'", "[[0.0]]")
    (tmp_path / f"{name}_arm.py").write_text(code, encoding="utf-8")
    spec = f"python:{name}_arm:decide"
    policy = open_model(spec, RequestMode(spec, timeout_s=0.05), answering="policy")
    query = Query("", "", Stimulus.of(BLACK), 1)

    async def one_more() -> str | None:
        await asyncio.gather(*(policy.answer(query) for _ in range(LEFT_AT_MOST)))
        return (await policy.answer(query)).error

    assert asyncio.run(one_more()) == "not_called"


def test_a_callable_that_changes_the_folder_changes_no_path_in_python(
    bank: FrameBank, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither that of the bank nor that of the run; a report is named as it was asked for while that leads there."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "away").mkdir()
    (tmp_path / "bank").symlink_to(bank.root)

    def leaves(prompt: str, image: bytes | None) -> str:
        del prompt, image
        os.chdir(tmp_path / "away")
        return "SLOW"

    report = run_battery("bank", {"leaves": leaves}, "run", limit=3)
    assert report.score.models["python:leaves"].answered
    assert (Path("run").exists(), (tmp_path / "run" / LEDGER).is_file()) == (False, True)
    assert list((tmp_path / "away").iterdir()) == []
