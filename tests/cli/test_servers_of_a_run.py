"""A whole ``eyechart run battery`` on servers that spoil pictures, and on their healthy twins: exit code and words."""

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from aiohttp import web

import banks
from eyechart import cli
from eyechart.frames import BankWriter, Camera, Frame, FrameBank, encode, open_bank
from eyechart.ledger import Ledger
from eyechart.manifest import LEDGER
from eyechart.spaces.space import why_unanswered
from eyechart.studies import battery
from faults import FaultServer, completion, gemini
from seeing import Endpoint, read
from ways import Kept, OnTheWay, Rig, enlarged

MODEL = "openai:m"
Say = Callable[..., tuple[int, str]]


def build(out: Path, cameras: tuple[Camera, ...]) -> FrameBank:
    """Write a bank of eight frames whose pictures are as large as a camera's."""
    with BankWriter(out, replace(banks.manifest(), cameras=cameras if len(cameras) > 1 else ())) as writer:
        for step in range(8):
            files = {camera.name: f"images/{camera.name}/{step}.png" for camera in cameras}
            place = ("light" if step % 2 else "dense", f"e{step % 4}", step)
            images = {
                name: enlarged(encode(banks.draw(step + 3.0, 16 * step + code))) for code, name in enumerate(files)
            }
            truth = {"lead_gap_m": float(step + 3), "demand": "LEFT", "crashed": False}
            writer.add(Frame(f"f{step}", *place, cameras, files, truth), images, {})
    return open_bank(out)


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a bank of one camera."""
    return build(tmp_path_factory.mktemp("one") / "bank", (Camera("main", "vertical"),))


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a bank of two cameras."""
    return build(tmp_path_factory.mktemp("two") / "bank", banks.WRISTS)


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Say:
    """Return a function that runs a battery at an address: the exit code, and what was said."""
    monkeypatch.setattr("eyechart.attempts.pause_s", lambda *_: 0.0)

    def ask(asked: FrameBank, address: str, *options: str) -> tuple[int, str]:
        words = ["--model", MODEL, "--base-url", address, "--conditions", "real,real_repeat,text_only", *options]
        given = ["eyechart", "run", "battery", "--frames", str(asked.root), "--out", str(tmp_path / "run"), *words]
        monkeypatch.setattr(sys, "argv", given)
        capsys.readouterr()
        with pytest.raises(SystemExit) as left:
            cli.main()
        return int(left.value.code or 0), " ".join("".join(capsys.readouterr()).split())

    return ask


@pytest.mark.parametrize(
    ("endpoint", "says"),
    [
        (OnTheWay(way="drops", honest=True), "'picture' fails: the server drops this run's pictures of 640×400"),
        (OnTheWay(way="drops"), "'picture' fails: pictures of this run's size (640×400) do not arrive"),
        (OnTheWay(way="mixes"), "'picture' fails: the server mixes up the pictures of parallel calls"),
        (Kept(), "'cache' fails: every answer fits the first"),
    ],
    ids=["dropped by size", "dropped and counted", "swapped under load", "prefix cache"],
)
def test_a_server_that_spoils_pictures_ends_the_run_before_it_is_paid(
    bank: FrameBank, tmp_path: Path, run: Say, endpoint: Endpoint, says: str
) -> None:
    """With exit code 1, the guard by its name, and no call of the battery."""
    with FaultServer([endpoint]) as server:
        code, said = run(bank, server.base_url)
    assert (code, says in said) == (1, True), said
    assert "Traceback" not in said, said
    assert not (tmp_path / "run" / LEDGER).exists()


def test_pictures_of_one_query_that_collapse_end_the_run_before_it_is_paid(
    rig: FrameBank, tmp_path: Path, run: Say
) -> None:
    """Of two cameras one arrives."""
    with FaultServer([Rig(hands_on=1)]) as server:
        code, said = run(rig, server.base_url)
    assert (code, "'picture' fails: of 2 pictures" in said) == (1, True), said
    assert not (tmp_path / "run" / LEDGER).exists()


def finished(run: Path) -> dict[str, bool | None]:
    """Return the guards of a run all of whose calls are finished."""
    _, guards = battery.took(run)
    return {one.name: one.holds for one in guards[MODEL]}


@pytest.mark.parametrize(
    "endpoint",
    [Endpoint(), OnTheWay(tokens=3), OnTheWay(tokens=0), OnTheWay(tokens=1105), OnTheWay(way="caches")],
    ids=["plain", "few tokens a picture", "no usage", "tiled pictures", "counts after a cached prefix"],
)
def test_a_healthy_server_is_asked_to_the_end(bank: FrameBank, tmp_path: Path, run: Say, endpoint: Endpoint) -> None:
    """With exit code 0, and no guard of pictures, caches or load fails."""
    with FaultServer([endpoint]) as server:
        code, said = run(bank, server.base_url)
    assert code == 0, said
    found = finished(tmp_path / "run")
    assert found["outcomes"] is True
    assert not [name for name in ("picture", "cache", "load", "served", "shown") if found.get(name) is False]


def test_a_healthy_server_of_several_cameras_is_asked_to_the_end(rig: FrameBank, tmp_path: Path, run: Say) -> None:
    """All pictures of a query arrive."""
    with FaultServer([Rig()]) as server:
        code, said = run(rig, server.base_url)
    assert code == 0, said
    assert finished(tmp_path / "run")["picture"] is True


def test_one_at_a_time_a_server_that_mixes_pictures_is_asked_to_the_end(bank: FrameBank, run: Say) -> None:
    """As the words of the fault say."""
    with FaultServer([OnTheWay(way="mixes")]) as server:
        assert run(bank, server.base_url, "--concurrency", "1")[0] == 0


def test_a_limit_a_minute_that_speaks_of_billing_is_waited_for(bank: FrameBank, tmp_path: Path, run: Say) -> None:
    """Gemini's 429 sets no model aside: every call is finished."""
    endpoint, came = Endpoint(), []

    async def busy(request: web.Request, asked: dict[str, object], attempt: int) -> web.StreamResponse:
        came.append(attempt)
        if len(came) % 4 == 3:
            return web.json_response(gemini("0.01s"), status=429)
        return await endpoint(request, asked, attempt)

    with FaultServer([busy]) as server:
        code, said = run(bank, server.base_url)
    assert code == 0, said
    assert "set aside" not in said
    assert finished(tmp_path / "run")["outcomes"] is True


@pytest.mark.parametrize("number", [0, 3, 6])
def test_a_frame_that_a_filter_always_blocks_is_a_refusal_of_a_finished_run(
    bank: FrameBank, tmp_path: Path, run: Say, number: int
) -> None:
    """The other frames are answered; also where the probe asks about that frame, first or later."""
    endpoint, blocked = Endpoint(), bank.image(bank.frames[number])

    async def filters(request: web.Request, asked: dict[str, object], attempt: int) -> web.StreamResponse:
        if read(asked)[1] == blocked:
            return web.json_response({**completion(""), "choices": []})
        return await endpoint(request, asked, attempt)

    with FaultServer([filters]) as server:
        code, said = run(bank, server.base_url)
    assert code == 0, said
    assert finished(tmp_path / "run")["outcomes"] is True
    with Ledger(tmp_path / "run" / LEDGER) as ledger:
        refused = [
            key for key, one in ledger.replies(MODEL) if why_unanswered(one.finish_reason, one.error) == "refused"
        ]
    assert {(key.frame, key.condition) for key in refused} == {(f"f{number}", "real"), (f"f{number}", "real_repeat")}


def test_an_address_of_azure_is_asked_with_its_query(bank: FrameBank, tmp_path: Path, run: Say) -> None:
    """By the probe and by every call."""
    endpoint, asked_at = Endpoint(), set[str]()

    async def azure(request: web.Request, asked: dict[str, object], attempt: int) -> web.StreamResponse:
        asked_at.add(str(request.rel_url))
        return await endpoint(request, asked, attempt)

    with FaultServer([azure]) as server:
        code, said = run(bank, f"{server.base_url}?api-version=2024-10-21")
    assert code == 0, said
    assert asked_at == {"/v1/chat/completions?api-version=2024-10-21"}
    assert finished(tmp_path / "run")["outcomes"] is True
