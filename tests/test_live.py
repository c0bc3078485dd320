"""A page shows a run while it goes on: its first answers at once, what is amiss, and nothing that it cannot know."""

import re
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from urllib.parse import urlsplit

import pytest

import banks
import stand_ins
from eyechart.costs import Account
from eyechart.models.prices import read_prices
from eyechart.serve.live import NOTHING_FOLLOWS, LiveAnswer, LiveModel, LiveRun, live_server
from report_runs import HOSTILE, hostile, make_run

SLOW = """
import time
from pathlib import Path

def answer(prompt, image):
    with Path(__file__).with_name("asked").open("a") as file:
        file.write("x")
    time.sleep(0.15)
    return "LEFT"
"""


def _get(url: str, **headers: str) -> str:
    with urllib.request.urlopen(urllib.request.Request(url, headers=headers), timeout=5) as answer:  # noqa: S310
        return str(answer.read().decode())


@pytest.mark.slow
def test_a_run_is_watched_without_a_further_request_and_the_page_closes_with_it(tmp_path: Path) -> None:
    """First answers are in sight while it goes on; that all are the same is said; other hosts are refused."""
    (tmp_path / "slow_model.py").write_text(SLOW)
    bank = banks.build_bank(tmp_path / "bank")
    options = ["--frames", str(bank.root), "--out", "run", "--conditions", "real,blank", "--concurrency", "1"]
    command = [sys.executable, "-c", "from eyechart.cli import main; main()", "run", "battery", *options]
    with subprocess.Popen(
        [*command, "--model", "python:slow_model:answer", "--watch"],
        cwd=tmp_path, stderr=subprocess.PIPE, text=True, env={"PYTHONPATH": str(tmp_path), "PATH": "/usr/bin:/bin"},
    ) as run:  # fmt: skip
        assert run.stderr is not None
        url = next(found[1] for line in run.stderr if (found := re.search(r"watch: (http://\S+/)", line)))
        begun, html = time.monotonic(), ""
        while ">LEFT</td>" not in html and time.monotonic() - begun < 20:
            html = _get(url)
            time.sleep(0.2)
        assert time.monotonic() - begun < 5
        assert NOTHING_FOLLOWS in html
        assert run.poll() is None
        with pytest.raises(urllib.error.HTTPError, match="421"):
            _get(url, Host="elsewhere.example")
        time.sleep(3)
        assert re.search(r"Look:</strong> all \d+ answers are the same: LEFT", _get(url))
        assert run.wait(60) == 0
    with pytest.raises(urllib.error.URLError):
        _get(url)
    assert (tmp_path / "asked").read_text() == "x" * (2 * len(bank.frames))


def test_what_is_shown_is_as_it_was_said_and_nothing_is_written(tmp_path: Path) -> None:
    """Replies that mean harm stand as text; a folder that is watched has the files that it had."""
    bank = banks.build_bank(tmp_path / "bank")
    run = make_run(bank.root, tmp_path / "run", {"hostile": hostile, "noisy": stand_ins.noisy})
    before = {path.name: path.read_bytes() for path in run.iterdir() if path.is_file()}
    live, told = LiveRun(run, read_prices()), list[str]()
    live.move(3, 10)
    with live_server(live, told.append):
        html = _get(told[0])
        with pytest.raises(urllib.error.HTTPError, match="404"):
            _get(told[0] + "run.json")
    assert {path.name: path.read_bytes() for path in run.iterdir() if path.is_file()} == before
    assert "3 of 10 calls" in html
    assert HOSTILE[0] not in html
    assert html.count("<script") == 1
    assert "standin:noisy" in html
    assert "connect-src 'self'" in html


def test_files_are_read_so_seldom_that_it_costs_little(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever looks in between gets what was read last; a folder that is no run yet is said to be none."""
    live, reads = LiveRun(tmp_path / "none", read_prices()), list[float]()
    assert b"No call is written yet." in live.html()

    def busy() -> tuple[LiveModel, ...]:
        reads.append(time.thread_time())
        while time.thread_time() - reads[-1] < 0.02:
            pass
        return made

    live = LiveRun(tmp_path, read_prices())
    made = (LiveModel("m", Account(*([0] * 18)), {}, (LiveAnswer("f", "real", "SLOW", "SLOW"),), ()),)  # type: ignore[arg-type]
    monkeypatch.setattr(live, "_read", busy)
    for name in ("_EVERY_S", "_UNTIL_FIRST_S"):
        monkeypatch.setattr(f"eyechart.serve.live.{name}", 0.0)
    ledger, begun = tmp_path / "ledger.sqlite", time.process_time()
    while time.process_time() - begun < 1.0:
        ledger.write_text(f"{len(reads)} {time.process_time()}")
        live.models()
    assert 3 <= len(reads) <= 4 + 0.01 * time.process_time() / 0.02
    assert live.rate is None


def test_files_that_did_not_change_are_not_read_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Somebody who looks while a slow model thinks costs a look at the files' times; an answer is read again."""
    live, reads = LiveRun(tmp_path, read_prices()), list[int]()
    monkeypatch.setattr(live, "_read", lambda: reads.append(1) or ())
    monkeypatch.setattr("eyechart.serve.live._UNTIL_FIRST_S", 0.0)
    for _ in range(20):
        live.html()
    (tmp_path / "ledger.sqlite-wal").write_text("an answer")
    for _ in range(20):
        live.html()
    assert len(reads) == 2


def test_reads_that_found_no_answer_yet_delay_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first answer of a slow server is shown as soon as it is there, however much was read before."""
    live, ledger = LiveRun(tmp_path, read_prices()), tmp_path / "ledger.sqlite"
    account, answer = Account(*([0] * 18)), LiveAnswer("f", "real", "SLOW", "SLOW")  # type: ignore[arg-type]
    said: list[LiveAnswer] = []

    def slow() -> tuple[LiveModel, ...]:
        begun = time.thread_time()
        while time.thread_time() - begun < 0.05:
            pass
        return (LiveModel("m", account, {}, tuple(said), ()),)

    monkeypatch.setattr(live, "_read", slow)
    monkeypatch.setattr("eyechart.serve.live._UNTIL_FIRST_S", 0.0)
    for number in range(6):
        ledger.write_text("x" * number)
        assert live.models()[0].first == ()
    said.append(answer)
    ledger.write_text("an answer")
    assert live.models()[0].first == (answer,)


FLOODED = """
import resource, sys, threading, time
from pathlib import Path
resource.setrlimit(resource.RLIMIT_NOFILE, (int(sys.argv[2]), int(sys.argv[2])))
from eyechart.models.prices import read_prices
from eyechart.serve.live import LiveRun, live_server
with live_server(LiveRun(Path(sys.argv[1]), read_prices()), lambda url: print(url, flush=True)):
    opened = 0
    for line in sys.stdin:  # a run opens a few files at a time, again and again
        for _ in range(50):
            files = [open(__file__) for _ in range(20)]
            opened += len(files)
            for file in files:
                file.close()
            time.sleep(0.001)
        print(opened, flush=True)
"""


@contextmanager
def _flooded(folder: Path, descriptors: int) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """Yield a process that has a page and needs files of its own, and the address of its page."""
    program = folder / "program.py"
    program.write_text(FLOODED)
    with subprocess.Popen(
        [sys.executable, str(program), str(folder), str(descriptors)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        yield process, process.stdout.readline().strip()
        assert process.stdin is not None
        assert process.stderr is not None
        process.stdin.close()
        assert process.wait(30) == 0
        assert process.stderr.read() == ""


def _works(process: "subprocess.Popen[str]") -> bool:
    """Return whether a process opens all files that it needs."""
    assert process.stdin is not None
    assert process.stdout is not None
    process.stdin.write("\n")
    process.stdin.flush()
    return process.stdout.readline() != ""


@pytest.mark.parametrize("descriptors", [128, 1024])
def test_connections_take_no_descriptor_that_the_run_needs(descriptors: int, tmp_path: Path) -> None:
    """Whoever opens more than the run has descriptors is refused; the run opens its files, and nothing is printed."""
    with _flooded(tmp_path, descriptors) as (process, url), ExitStack() as opened:
        port = urlsplit(url).port
        for number in range(1030):
            one = opened.enter_context(socket.socket())
            one.setblocking(False)
            one.connect_ex(("127.0.0.1", port))
            with suppress(OSError):
                one.send((b"", b"GET / HTTP/1.1\r\nHost: localhost\r\nX")[number % 2])
            assert number % 256 or _works(process)
        assert _works(process)


def test_idle_connections_and_large_heads_are_closed_and_print_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As a guardian's server does: one too many gets 503, one without a request is closed, a long head gets 400."""
    monkeypatch.setattr("eyechart.serve.live._CONNECTIONS", 4)
    monkeypatch.setattr("eyechart.serve.live._IDLE_S", 0.2)
    monkeypatch.setattr("eyechart.serve.live._REAP_S", 0.1)
    told = list[str]()
    with live_server(LiveRun(tmp_path, read_prices()), told.append), ExitStack() as opened:
        address = ("127.0.0.1", urlsplit(told[0]).port)
        idle = [opened.enter_context(socket.create_connection(address, timeout=5)) for _ in range(4)]
        time.sleep(0.05)
        assert opened.enter_context(socket.create_connection(address, timeout=5)).recv(100).startswith(b"HTTP/1.1 503")
        assert [one.recv(100) for one in idle] == [b""] * 4
        large = opened.enter_context(socket.create_connection(address, timeout=5))
        large.sendall(b"GET / HTTP/1.1\r\nHost: localhost\r\nX: " + b"a" * 20_000 + b"\r\n\r\n")
        assert large.recv(100).startswith(b"HTTP/1.0 400")
        assert "No call is written yet." in _get(told[0])
    assert capsys.readouterr().err == ""


def test_whoever_does_not_know_the_address_sees_nothing(tmp_path: Path) -> None:
    """The port alone is no address: another user of the machine can guess that, and not the token."""
    told, again = list[str](), list[str]()
    with (
        live_server(LiveRun(tmp_path, read_prices()), told.append),
        live_server(LiveRun(tmp_path, read_prices()), again.append),
    ):
        root, token = re.fullmatch(r"(http://127\.0\.0\.1:\d+/)([\w-]{20,})/", told[0]).groups()  # type: ignore[union-attr]
        for path in ("", "over", f"{token[:-1]}/", f"{again[0].split('/')[-2]}/", f"{token}x/over"):
            with pytest.raises(urllib.error.HTTPError, match="404"):
                _get(root + path)
        assert "No call is written yet." in _get(root + token + "/")


@pytest.mark.parametrize(
    "broken", ["eyechart.serve.live.application", "asyncio.events.new_event_loop", "threading.Thread.start"]
)
def test_a_page_that_cannot_be_served_ends_no_run(
    broken: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It is said, and the run goes on."""

    def fails(*_: object) -> None:
        raise RuntimeError("too many open files")

    monkeypatch.setattr(broken, fails)
    why, over = list[str](), False
    with live_server(LiveRun(tmp_path, read_prices()), lambda _: None, why.append):
        over = True
    assert over
    assert "too many open files" in why[0]
    assert capsys.readouterr().err == ""


def test_a_page_of_a_run_imports_no_server_of_a_guardian() -> None:
    """What serves a guardian takes a tenth of a second to import, more than all looks at a page take."""
    program = "import sys, eyechart.serve.live; print('eyechart.guardian' in sys.modules, 'jinja2' in sys.modules)"
    process = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert process.stdout.split() == ["False", "False"]
