"""A guardian in a stack: from a run to an answer about a picture, by the deadline, whatever its models do."""

import asyncio
import json
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import voters
from banks import build_bank, draw
from eyechart.errors import GuardianError, SpecError, VoteError
from eyechart.frames import FrameBank, encode
from eyechart.guardian import Guardian
from eyechart.models import ADAPTERS
from eyechart.modes import RequestMode
from eyechart.spaces.scene import SCENES
from eyechart.studies import guardian as study
from eyechart.studies.guardian.vote_sources import _served_as

NEAR, FAR = encode(draw(8.0, 3)), encode(draw(38.0, 4))


@pytest.fixture(autouse=True)
def voter(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make ``voter:NAME`` a SPEC."""
    monkeypatch.setitem(ADAPTERS, "voter", "voters")
    monkeypatch.setitem(voters.VERSION, "all", "1")


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a bank of boxes with gaps on both sides of the threshold."""
    return build_bank(tmp_path_factory.mktemp("boxes") / "bank", episodes=3, steps=4, drawn=False)


@pytest.fixture
def table(bank: FrameBank, tmp_path: Path) -> study.VoteTable:
    """Return the votes of a run of two voters who see."""
    return voters.ask_all(bank.root, ("sees", "looks"), tmp_path / "run")


def loaded(table: study.VoteTable, folder: Path, models: Sequence[str], **options: object) -> Guardian:
    """Return a guardian that was chosen on a run, with these voters in its place."""
    frozen = study.fit(table)
    names = tuple(f"voter:{name}" for name in models)
    about = replace(frozen.about, versions=dict.fromkeys(names, "1"), served=dict.fromkeys(names, "itself"), modes={})
    options = {"threshold": 2, **options}
    study.write_frozen(folder / "guardian.json", replace(frozen, committee=names, about=about, **options).exported())
    return Guardian.load(folder / "guardian.json", deadline_s=20.0)


@pytest.fixture
def watched() -> Iterator[None]:
    """Fail where a test leaves a thread of a guardian that was closed."""
    before = set(threading.enumerate())
    yield
    for _ in range(500):
        if not [one for one in set(threading.enumerate()) - before if one.name == "eyechart-guardian"]:
            return
        time.sleep(0.02)
    raise AssertionError("a closed guardian's event loop still runs")


def test_a_runs_votes_are_what_its_estimates_say(table: study.VoteTable, bank: FrameBank) -> None:
    """Close is hazard; truth is the gap below the bank's threshold; how they came about is known whole."""
    assert table.models == ("voter:looks", "voter:sees")
    assert np.array_equal(table.votes[0, :, 0] == 1, table.hazard)
    assert np.array_equal(table.votes[:, :, 0], table.votes[:, :, 1])
    assert table.about.unrecorded(table.models) == []
    assert (table.about.bank, table.about.axis) == (bank.manifest.fingerprint, "vertical")


def test_what_is_no_run_of_estimates_has_no_votes(table: study.VoteTable, tmp_path: Path) -> None:
    """A reply without a scene is a missing vote; a run of another reader is refused."""
    assert table.frames
    manifest = tmp_path / "run" / "run.json"
    said = json.loads(manifest.read_text())
    manifest.write_text(json.dumps({**said, "reader": 0}))
    with pytest.raises(VoteError, match="version 0 of the reader"):
        study.votes_of_run(tmp_path / "run")
    assert study.votes_of_run(tmp_path / "run", reread=True).frames == table.frames


def test_a_guardian_goes_on_with_runs_of_each_reader_of_scenes(table: study.VoteTable, tmp_path: Path) -> None:
    """What the later one holds against a reply is no vote in any case, so the votes of both are the same."""
    manifest = tmp_path / "run" / "run.json"
    said = json.loads(manifest.read_text())
    for reader in SCENES.readers:
        manifest.write_text(json.dumps({**said, "reader": reader}))
        again = study.votes_of_run(tmp_path / "run")
        assert np.array_equal(again.votes, table.votes)
        assert again.about == table.about
    assert table.about.reader == SCENES.readers[0]


@pytest.mark.usefixtures("watched")
def test_an_assessment_says_what_was_voted(table: study.VoteTable, tmp_path: Path) -> None:
    """Hazard and clear, sync and async, from an exported guardian; the same pictures as in the run."""
    with loaded(table, tmp_path, ("sees", "looks")) as guardian:
        near, far = guardian.assess(NEAR), asyncio.run(guardian.assess_async(FAR))
    assert (near.answer, far.answer) == ("hazard", "clear")
    assert near.votes == {"voter:sees": (True, True), "voter:looks": (True, True)}
    assert near.why == "4 of 4 votes say hazard (hazard from 2 on, two_way)"
    assert near.missing == {}
    assert 0 < near.latency_s < 20.0
    assert json.loads(json.dumps(far.as_dict()))["votes"]["voter:sees"] == {"original": False, "reflected": False}


@pytest.mark.parametrize("failing", ["late", "raises", "refused", "prose", "misfit", "replaced"])
@pytest.mark.parametrize("threshold", [1, 2, 3, 4])
def test_what_fails_is_missing_and_missing_is_never_clear(
    table: study.VoteTable, tmp_path: Path, failing: str, threshold: int
) -> None:
    """Beside a model that says clear, one that says nothing: abstain at every threshold, by the deadline, with why."""
    with loaded(table, tmp_path, ("never", failing), threshold=threshold) as guardian:
        began = time.perf_counter()
        found = guardian.assess(FAR, deadline_s=0.5 if failing == "late" else 20.0)
        assert time.perf_counter() - began < voters.LATE_S / 2
    assert found.answer == "abstain"
    assert found.votes[f"voter:{failing}"] == (None, None)
    words = {
        "late": "late",
        "raises": "RuntimeError: out of memory",
        "refused": "rate_limited",
        "prose": "no vote: no_object",
        "misfit": "no reply: its text is a NoneType",
        "replaced": "another model answered: another, not itself",
    }
    said = found.missing[f"voter:{failing}/original"]
    assert words[failing] in said or (failing == "late" and "by the deadline" in said)  # on a machine as slow as it
    missing = sum(vote is None for votes in found.votes.values() for vote in votes)  # a slow machine is late too
    assert f"{missing} missing, which never count as clear" in found.why
    assert missing == 2 or failing == "late"


def test_a_hazard_that_the_missing_could_not_undo_is_said(table: study.VoteTable, tmp_path: Path) -> None:
    """Two votes of two needed are there; at unanimity they are not enough."""
    with loaded(table, tmp_path, ("always", "raises")) as guardian:
        assert guardian.assess(FAR).answer == "hazard"
    with loaded(table, tmp_path, ("always", "raises"), point="unanimous") as guardian:
        assert guardian.assess(FAR).answer == "abstain"


@pytest.mark.usefixtures("watched")
def test_a_model_that_holds_the_event_loop_holds_no_caller(table: study.VoteTable, tmp_path: Path) -> None:
    """The answer comes by the deadline although the models' loop does not turn."""
    voters.GO_ON.clear()
    with loaded(table, tmp_path, ("holds", "never")) as guardian:
        for ask in (guardian.assess, lambda image, **how: asyncio.run(guardian.assess_async(image, **how))):
            began = time.perf_counter()
            found = ask(FAR, deadline_s=0.2)
            assert time.perf_counter() - began < voters.LATE_S / 2  # the model holds the loop until it is told to go on
            assert found.answer == "abstain"
            assert set(found.votes.values()) == {(None, None)}
        voters.GO_ON.set()


def test_what_is_no_picture_is_abstained_from(table: study.VoteTable, tmp_path: Path) -> None:
    """A camera that sends nonsense does not end the control loop; a deadline of nonsense is the caller's error."""
    with loaded(table, tmp_path, ("sees", "looks")) as guardian:
        for picture in (b"", b"\x89PNG broken", NEAR[:60]):
            found = guardian.assess(picture)
            assert (found.answer, len(found.missing)) == ("abstain", 4)
            assert found.why.startswith("no picture that can be shown")
        with pytest.raises(GuardianError, match="deadline_s=0"):
            guardian.assess(NEAR, deadline_s=0)
    with pytest.raises(GuardianError, match="was closed"):
        guardian.assess(NEAR)
    guardian.close()


def test_several_threads_may_ask_at_once(table: study.VoteTable, tmp_path: Path) -> None:
    """Each gets the answer to its own picture."""
    wrong: list[str] = []
    with loaded(table, tmp_path, ("sees", "looks")) as guardian:

        def work(picture: bytes, wanted: str) -> None:
            wrong.extend(found.answer for _ in range(5) if (found := guardian.assess(picture)).answer != wanted)

        pairs = ((NEAR, "hazard"), (FAR, "clear")) * 4
        threads = [threading.Thread(target=work, args=pair) for pair in pairs]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert wrong == []


def test_a_stack_that_is_not_as_the_guardian_was_chosen_is_refused_by_name(
    table: study.VoteTable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another version of a model, another view, another prompt, another mode, and a file that was edited."""
    frozen, path = study.fit(table), tmp_path / "guardian.json"

    def refused(about: study.VoteProvenance, message: str) -> None:
        study.write_frozen(path, replace(frozen, about=about))
        with pytest.raises((GuardianError, SpecError), match=message):
            Guardian.load(path)

    monkeypatch.setitem(voters.VERSION, "all", "2")
    refused(frozen.about, "the model 'voter:looks' differs: it was chosen with version '1', here is '2'")
    monkeypatch.setitem(voters.VERSION, "all", "1")
    refused(replace(frozen.about, view="highway@00000000"), "there is no view 'highway@00000000'")
    refused(replace(frozen.about, prompt="scene@00000000"), "the prompt differs")
    refused(replace(frozen.about, reader=0), "the reader differs")
    refused(replace(frozen.about, wording=None), "came from a table")
    refused(replace(frozen.about, axis="none"), "mirror axis 'none'")
    study.write_frozen(path, frozen)
    other = {"voter:sees": RequestMode("voter:sees", max_tokens=9)}
    with pytest.raises(GuardianError, match="'voter:sees' would get other requests"):
        Guardian.load(path, modes=other)
    with pytest.raises(GuardianError, match="has no model 'voter:prose'"):
        Guardian.load(path, modes={"voter:prose": RequestMode("voter:prose")})
    Guardian.load(path, modes={"voter:sees": RequestMode("voter:sees", base_url="http://127.0.0.1:1/v1")}).close()
    path.write_text(path.read_text().replace('"threshold": 1', '"threshold": 2'))
    with pytest.raises(GuardianError, match="was edited"):
        Guardian.load(path)


def test_what_a_models_replies_name_is_asked_of_its_votes() -> None:
    """One model whatever its configuration; of several models no reply is, so that none of them votes."""
    assert _served_as({}) is None
    assert _served_as({"m fp_1": "m"}) == "m fp_1"
    assert _served_as({"m fp_1": "m", "m fp_2": "m"}) == "m"
    assert _served_as({"a": "a", "b": "b"}) == "a and b"
