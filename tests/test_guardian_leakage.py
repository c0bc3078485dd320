"""The ways in which a guardian is scored on what chose it by accident: what each does, one by one."""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

import banks
import voters
from eyechart.errors import GuardianError
from eyechart.frames import MAIN, BankWriter, FrameBank, encode, open_bank
from eyechart.models import ADAPTERS
from eyechart.studies import guardian as study
from published_votes import published, write

CHOSE = 12


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a bank of 24 pictures of boxes."""
    return banks.build_bank(tmp_path_factory.mktemp("leak") / "bank", scenarios=("merge",), episodes=4, steps=6)


@pytest.fixture(scope="module")
def votes(bank: FrameBank, tmp_path_factory: pytest.TempPathFactory) -> study.VoteTable:
    """Return the votes of two models on it."""
    patch = pytest.MonkeyPatch()
    patch.setitem(ADAPTERS, "voter", "voters")
    table = voters.ask_all(bank.root, ("sees", "looks"), tmp_path_factory.mktemp("leak") / "run")
    patch.undo()
    return table


@pytest.fixture(scope="module")
def frozen(votes: study.VoteTable) -> study.FrozenGuardian:
    """Return the guardian that the first frames choose."""
    return study.fit(votes.keep(votes.frames[:CHOSE]))


def rebuilt(bank: FrameBank, out: Path, name: Callable[[str], str] = str) -> FrameBank:
    """Write the bank again with other bytes of every picture, and perhaps with other names of its frames."""
    with BankWriter(out, banks.manifest()) as writer:
        for number, frame in enumerate(bank):
            pixels = banks.draw(frame.truth["lead_gap_m"], number + 4096, lane=frame.step % 3)  # type: ignore[arg-type]
            writer.add(replace(frame, id=name(frame.id), counterfactuals={}), {MAIN: encode(pixels)}, {})
    return open_bank(out)


def test_the_same_frames_as_pictures_of_other_bytes_are_known_by_their_names(
    bank: FrameBank, votes: study.VoteTable, frozen: study.FrozenGuardian, tmp_path: Path
) -> None:
    """A bank that was drawn or encoded anew has the fingerprint of its geometry, and the names of its frames."""
    again = rebuilt(bank, tmp_path / "again")
    assert again.manifest.fingerprint == bank.manifest.fingerprint
    assert again.manifest.images != bank.manifest.images
    table = replace(votes, pictures=study.pictures_of(again, votes.frames))
    with pytest.raises(GuardianError, match=f"is one of {CHOSE} in run that chose this guardian"):
        study.score(frozen, table)
    assert len(frozen.unseen(table).frames) == len(votes.frames) - CHOSE


def test_the_same_episodes_in_another_bank_are_another_bank(
    bank: FrameBank, votes: study.VoteTable, frozen: study.FrozenGuardian, tmp_path: Path
) -> None:
    """With other names of its frames it has another fingerprint; the name of its folder is nothing."""
    renamed = rebuilt(bank, tmp_path / "renamed", lambda name: f"new-{name}")
    about = replace(votes.about, bank=renamed.manifest.fingerprint, bank_name=votes.about.bank_name)
    table = replace(votes, frames=tuple(f"new-{frame}" for frame in votes.frames), about=about, pictures=None)
    with pytest.raises(GuardianError, match="the bank differs"):
        study.score(frozen, table)
    shutil.copytree(bank.root, tmp_path / "copy")
    assert open_bank(tmp_path / "copy").manifest.fingerprint == bank.manifest.fingerprint
    kept = replace(votes, about=replace(votes.about, bank_name="copy"))
    with pytest.raises(GuardianError, match="that chose this guardian"):
        study.score(frozen, kept)


def test_one_picture_by_two_names_is_known_by_its_bytes(votes: study.VoteTable, frozen: study.FrozenGuardian) -> None:
    """A bank may hold a picture twice; the frame that stayed for the score then shows what was seen, and is named."""
    assert frozen.selection is not None
    assert votes.pictures is not None
    rest = votes.without(frozen.selection.frames)
    assert rest.pictures is not None
    twice = replace(rest, pictures=(frozen.selection.pictures[3], *rest.pictures[1:]))
    message = f"frame '{rest.frames[0]}' in run shows the very picture of '{frozen.selection.frames[3]}'"
    for refused in (study.score, study.bound):
        with pytest.raises(GuardianError, match=message):
            refused(frozen, twice)
    assert frozen.unseen(twice).frames == rest.frames[1:]
    assert len(study.score(frozen, rest).answers) == len(rest.frames)


@pytest.mark.parametrize("name", ["{}.png", "{}.JPG", "./{}.jpeg", "MERGE"])
def test_a_name_in_another_spelling_is_the_same_name(
    frozen: study.FrozenGuardian, votes: study.VoteTable, name: str
) -> None:
    """Of a table that names files: another ending after encoding anew, capitals, a path that begins with a dot."""
    rest = frozen.unseen(votes)
    assert frozen.selection is not None
    seen = frozen.selection.frames[0]
    spelt = seen.upper() if name == "MERGE" else name.format(seen)
    table = replace(rest, frames=(spelt, *rest.frames[1:]))
    with pytest.raises(GuardianError, match=f"has the name of '{seen}', which chose this guardian, but for"):
        study.score(frozen, table)
    assert frozen.unseen(table).frames == rest.frames[1:]


def test_a_guardian_whose_memory_was_edited_is_refused(frozen: study.FrozenGuardian, tmp_path: Path) -> None:
    """A picture that is taken out of it, or all of them; and what is read back still remembers them."""
    path = tmp_path / "guardian.json"
    study.write_frozen(path, frozen)
    assert study.read_frozen(path) == frozen
    raw = json.loads(path.read_text())
    for kept in (raw["selection"]["pictures"][1:], []):
        edited = {**raw, "selection": {**raw["selection"], "pictures": kept}}
        path.write_text(json.dumps(edited))
        with pytest.raises(GuardianError, match="was edited after it was frozen"):
            study.read_frozen(path)
    assert frozen.exported().selection is None
    assert frozen.selection is not None
    assert not any(picture in json.dumps(frozen.exported().as_dict()) for picture in frozen.selection.pictures)


def test_what_a_table_does_not_record_is_said_and_cannot_be_found(tmp_path: Path) -> None:
    """Without --about and --frames renamed frames pass: the score warns of it, and of episodes that are shared."""
    csv, _ = write(published(), tmp_path)
    table = study.read_votes(csv)
    frozen = study.fit(table.part("calibration"))
    renamed = replace(table.part("calibration"), frames=tuple(f"new{number}" for number in range(16)))
    warned = " ".join(study.score(frozen, renamed).warnings)
    assert "not recorded, so a change of it cannot be noticed: bank, prompt, view" in warned
    assert "scored episodes also gave frames that chose the guardian" in warned
