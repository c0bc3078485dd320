"""Processes of ours end when the one that began them is killed, whatever they are doing."""

import ast
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest

import eyechart

ROOT = Path(eyechart.__file__).parent
BEGIN = ("ProcessPoolExecutor", "Popen", "Process", "Pool", "fork", "forkpty", "posix_spawn", "spawnv")
"""What begins a process."""
SOON_S = 10.0
ENDS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
"""How the parent of a process is ended."""

POOL = """
import os, sys, time
from eyechart import processes
if WITHOUT_PRCTL:
    processes._is_ended_by_the_system = lambda: False
def work(seconds):
    os.write(1, f"{os.getpid()}\\n".encode())
    end = time.monotonic() + seconds
    while BUSY and time.monotonic() < end:
        pass
if __name__ == "__main__":
    with processes.open_pool(2) as pool:
        list(pool.map(work, [300, 300] if BUSY else [0, 0]))
        time.sleep(300)
"""
WORLD = """
import os, time
from eyechart.episodes.workers import LocalWorker
from eyechart.episodes.worlds import Setup
worker = LocalWorker(Setup("rover"))
os.write(1, f"{worker._process.pid}\\n".encode())
time.sleep(300)
"""
HUNG = '''
import os, subprocess, sys, time
program = """import os, sys
from eyechart.processes import end_with
end_with(int(sys.argv[1]))
os.write(1, b'%d ' % os.getpid() + os.linesep.encode())
while True: pass"""
subprocess.Popen([sys.executable, "-c", program, str(os.getpid())], process_group=0)
time.sleep(300)
'''


def is_there(pid: int) -> bool:
    """Return whether a process runs; one that ended and was not waited for does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def left_after_a_kill(
    *words: object, lines: int = 0, workers: int = 0, how: signal.Signals = signal.SIGKILL
) -> list[int]:
    """Start a program, end it once it printed numbers of processes or has workers, and return who remains."""
    command = [sys.executable, *map(str, words)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, start_new_session=True, stderr=subprocess.DEVNULL) as parent:
        assert parent.stdout is not None
        named = [int(parent.stdout.readline()) for _ in range(lines)]
        while len(children := [*named, *_group(parent.pid)]) < workers and parent.poll() is None:
            time.sleep(0.05)
        assert children
        assert all(map(is_there, named))
        parent.send_signal(how)
        end = time.monotonic() + SOON_S
        with suppress(subprocess.TimeoutExpired):
            parent.wait(SOON_S)
        children = [*children, parent.pid]
        while any(map(is_there, children)) and time.monotonic() < end:
            time.sleep(0.05)
        left = [child for child in children if is_there(child)]
        for one in left:
            os.kill(one, signal.SIGKILL)
    return left


def _group(leader: int) -> list[int]:
    """Return the other processes of a group."""
    result = []
    for path in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if os.getpgid(int(path.name)) == leader != int(path.name):
                result.append(int(path.name))
    return result


@pytest.mark.parametrize("without_prctl", ["False", "True"])
@pytest.mark.parametrize("busy", ["False", "True"])
def test_a_pool_ends_with_its_killed_parent(busy: str, without_prctl: str, tmp_path: Path) -> None:
    """Its workers, waiting or at work, and what watches over their resources; also where the system helps nobody."""
    program = tmp_path / "program.py"
    program.write_text(POOL.replace("WITHOUT_PRCTL", without_prctl).replace("BUSY", busy))
    assert not left_after_a_kill(program, lines=2)


@pytest.mark.parametrize("how", ENDS)
@pytest.mark.parametrize("program", [WORLD, HUNG], ids=["waits", "hangs"])
def test_a_world_ends_with_its_parent(program: str, how: signal.Signals, tmp_path: Path) -> None:
    """While it waits for a question, and where it never comes to the end of its socket."""
    (tmp_path / "program.py").write_text(program)
    assert not left_after_a_kill(tmp_path / "program.py", lines=1, how=how)


@pytest.mark.slow
@pytest.mark.parametrize("how", ENDS)
@pytest.mark.parametrize("more", [(), ("--policies",)])
def test_nothing_of_an_ended_calibration_remains(more: tuple[str, ...], how: signal.Signals) -> None:
    """As an out-of-memory killer, a time-out of CI and a person end it."""
    words = ["calibrate", "--processes", "2", "--replications", "50", *more]
    assert not left_after_a_kill("-m", "eyechart", *words, workers=3, how=how)


def test_processes_are_begun_in_two_places_alone() -> None:
    """The pool of new interpreters, and the worker of worlds: both tell what they begin whose end is theirs."""
    found = set()
    for file in ROOT.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            name = node.func if isinstance(node, ast.Call) else None
            word = name.attr if isinstance(name, ast.Attribute) else name.id if isinstance(name, ast.Name) else ""
            if word in BEGIN or (word == "run" and isinstance(name, ast.Attribute) and _is_of(name, "subprocess")):
                found.add(file.relative_to(ROOT).as_posix())
    assert found == {"processes.py", "episodes/workers.py"}


def _is_of(name: ast.Attribute, module: str) -> bool:
    return isinstance(name.value, ast.Name) and name.value.id == module


def test_a_pool_that_is_interrupted_waits_for_nobody(tmp_path: Path) -> None:
    """Its workers are at what may take minutes: an interrupt ends them too."""
    program = tmp_path / "program.py"
    heeds = (
        "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"  # which a background job ignores
    )
    program.write_text(heeds + POOL.replace("WITHOUT_PRCTL", "False").replace("BUSY", "True"))
    with subprocess.Popen(
        [sys.executable, str(program)],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    ) as parent:
        assert parent.stdout is not None
        children = [int(parent.stdout.readline()) for _ in range(2)]
        parent.send_signal(signal.SIGINT)
        assert parent.wait(SOON_S) != 0
        assert not any(map(is_there, children))
