"""Whatever ends a writer, and whatever stands in its place: nothing half-written has a final name, nothing is lost."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

import pytest

from banks import build_bank
from eyechart.destination import KINDS, whole, write_files
from eyechart.errors import LedgerError, OutputError
from eyechart.frames import whole_folder
from eyechart.manifest import is_run
from eyechart.paper import Artefacts, write
from eyechart.report.table import Column, Table
from eyechart.studies import battery

MODEL = "scripted:depth"
WRITERS: dict[str, Callable[[Path], AbstractContextManager[Path]]] = {
    "file": lambda out: whole(out, "film"),
    "folder": lambda out: whole_folder(out, OutputError),
}
NAMES = {"long": "y" * 255, "odd": "a b \n\u6f22\u0301", "as usual": "out.gif"}
KILLED = """
import os, signal, sys
from pathlib import Path
from eyechart.destination import whole, write_files
from eyechart.errors import OutputError
from eyechart.frames import whole_folder
def die(*_): os.kill(os.getpid(), signal.SIGKILL)
how, out = sys.argv[1], Path(sys.argv[2])
if how == "file":
    with whole(out, "film") as partial:
        partial.write_bytes(b"GIF8 and half of")
        die()
elif how == "folder":
    with whole_folder(out, OutputError) as work:
        (work / "half").write_bytes(b"half")
        die()
else:
    whole_bytes = Path.write_bytes
    Path.write_bytes = lambda path, content: die() if path.name == "second" else whole_bytes(path, content)
    write_files({"first": b"1", "second": b"2"}, out)
"""


def content_of(folder: Path) -> dict[str, bytes]:
    """Return every file in a folder, hidden ones too."""
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("how", ["file", "folder", "files"])
def test_what_is_killed_while_it_writes_leaves_what_was_there_and_the_next_clears_the_rest(
    how: str, tmp_path: Path
) -> None:
    """SIGKILL in the middle of a file, a folder, and several files of a folder."""
    out = tmp_path / "out"
    if how == "file":
        out.write_bytes(b"GIF8 before")
    elif how == "files":
        out.mkdir()
        (out / "first").write_bytes(b"before")
    done = subprocess.run([sys.executable, "-c", KILLED, how, str(out)], check=False)
    assert done.returncode == -signal.SIGKILL
    if how == "file":
        assert out.read_bytes() == b"GIF8 before"
        with whole(out, "film") as partial:
            partial.write_bytes(b"GIF8 now")
        assert content_of(tmp_path) == {"out": b"GIF8 now"}
    elif how == "folder":
        assert not out.exists()
        with whole_folder(out, OutputError) as work:
            (work / "now").write_bytes(b"")
        assert content_of(tmp_path) == {"out/now": b""}
    else:
        assert (out / "first").read_bytes() == b"before"
        write_files({"first": b"1", "second": b"2"}, out)
        assert content_of(tmp_path) == {"out/first": b"1", "out/second": b"2"}


@pytest.mark.parametrize("writer", WRITERS)
def test_two_writers_of_one_place_do_not_mix(writer: str, tmp_path: Path) -> None:
    """The second is told to wait, and the first ends whole."""
    out, write_there = tmp_path / "out", WRITERS[writer]
    with write_there(out) as made:
        with pytest.raises(OutputError, match=r"another process is writing .*out; wait for it"), write_there(out):
            raise AssertionError("it may not begin")
        if writer == "file":
            made.write_bytes(b"GIF8")
    assert out.exists()
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


@pytest.mark.parametrize("writer", WRITERS)
@pytest.mark.parametrize("name", NAMES)
def test_any_name_that_the_system_takes_is_written(writer: str, name: str, tmp_path: Path) -> None:
    """255 characters, spaces, line breaks and signs of any writing; beside it nothing stays."""
    out = tmp_path / NAMES[name]
    with WRITERS[writer](out) as made:
        if writer == "file":
            made.write_bytes(b"GIF8")
    assert list(tmp_path.iterdir()) == [out]


@pytest.mark.parametrize("writer", WRITERS)
@pytest.mark.parametrize("place", ["loop", "loop above", "file above", "somebody else's", "a link beside"])
def test_what_stands_in_the_way_is_said_and_left(writer: str, place: str, tmp_path: Path) -> None:
    """Links that lead to themselves, a file in the place of a folder, and a name beside it that is not ours."""
    out, before = tmp_path / "out", tmp_path / "before"
    if place in {"loop", "loop above"}:
        out.symlink_to(out)
    elif place == "file above":
        out.write_bytes(b"mine")
    elif place == "somebody else's":
        (tmp_path / ".out.part").mkdir()
    else:
        before.mkdir()
        (tmp_path / ".out.part").symlink_to(before)
    if place.endswith("above"):
        out /= "out"
    if (writer, place) == ("file", "loop"):  # gives way to the file, as any link does
        with whole(out, "film") as made:
            made.write_bytes(b"GIF8")
        assert not out.is_symlink()
        return
    held = sorted(path.name for path in tmp_path.iterdir())
    with pytest.raises((OutputError, OSError)) as said, WRITERS[writer](out):
        raise AssertionError("it may not begin")
    assert "out" in str(said.value) or said.value.args[0] in {17, 20}
    assert sorted(path.name for path in tmp_path.iterdir()) == held


def test_a_file_takes_the_place_of_a_link_and_what_that_leads_to_stays(tmp_path: Path) -> None:
    """A report under a name that leads to an older one does not overwrite that."""
    old, out = tmp_path / "old.gif", tmp_path / "out.gif"
    old.write_bytes(b"GIF8 old")
    out.symlink_to(old)
    with whole(out, "film") as made:
        made.write_bytes(b"GIF8 new")
    assert (old.read_bytes(), out.read_bytes()) == (b"GIF8 old", b"GIF8 new")


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_no_file_of_that_kind_is_not_overwritten(kind: str, tmp_path: Path) -> None:
    """Neither notes, nor a device, whose place a file would take for everybody, nor a folder."""
    notes, pipe = tmp_path / "notes.txt", tmp_path / "pipe"
    notes.write_text("mine")
    os.mkfifo(pipe)
    for out in (notes, pipe, tmp_path, Path("/dev/full")):
        with pytest.raises(OutputError), whole(out, kind):
            raise AssertionError("it may not begin")
    assert Path("/dev/full").is_char_device()


def test_a_folder_that_is_the_working_one_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever stands in it would stand nowhere."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(OutputError, match="the folder that this command runs in"), whole_folder(Path(), OutputError):
        raise AssertionError("it may not begin")


@pytest.mark.parametrize("leads", ["to a folder", "nowhere yet", "to itself", "to a file"])
def test_a_run_follows_a_link(leads: str, tmp_path: Path) -> None:
    """To where it leads, which is made; where it leads to nothing that can be a run, that is said."""
    out, there = tmp_path / "out", tmp_path / "disk" / "there"
    bank = build_bank(tmp_path / "bank").root
    out.symlink_to(out if leads == "to itself" else there)
    if leads in {"to a folder", "to a file"}:
        there.parent.mkdir()
        there.mkdir() if leads == "to a folder" else there.write_text("mine")
    selection = battery.BatterySelection(limit=1, controls="none")
    if leads in {"to itself", "to a file"}:
        with pytest.raises(LedgerError, match=r"out (cannot be made|exists and is no run).*choose another"):
            battery.run(battery.plan(bank, [MODEL], out, extent=selection))
        return
    battery.run(battery.plan(bank, [MODEL], out, extent=selection))
    assert out.is_symlink()
    assert is_run(there)


def test_artefacts_that_find_no_room_leave_the_earlier_ones(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing of an earlier call is removed before all of the new ones are there."""

    def table(name: str) -> Artefacts:
        return Artefacts((Table(name, "", (Column("a"),), (("1",),)),), (), {})

    write(table("first"), tmp_path)
    held = content_of(tmp_path)
    with monkeypatch.context() as full:
        full.setattr(Path, "write_bytes", lambda *_: (_ for _ in ()).throw(OSError(28, "full")))
        with pytest.raises(OutputError, match="the disk is full"):
            write(table("second"), tmp_path)
    assert content_of(tmp_path) == held
    write(table("second"), tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {"second.csv", "second.md", "second.tex", ".paper.json"}
