"""Callables and the options of a request mode go into a battery from Python as they are."""

import shutil
import warnings
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path

import pytest

from banks import build_bank
from eyechart.api import run_battery
from eyechart.calls import Reply
from eyechart.errors import LedgerError, MissingCallsWarning, SpecError
from eyechart.frames import FrameBank, decode
from eyechart.manifest import LEDGER
from eyechart.models import open_model
from eyechart.modes import RequestMode
from eyechart.studies import battery
from seeing import served


def decide(prompt: str, image: bytes | None) -> str:
    """Answer by how bright the picture is."""
    del prompt
    return "STRAIGHT" if image is None or decode(image, "shown").mean() < 110 else "STOP"


async def decide_later(prompt: str, images: Mapping[str, bytes], state: Mapping[str, tuple[float, ...]]) -> str:
    """Answer so, with all that there is."""
    del state
    return decide(prompt, images.get("main"))


class Driver:
    """A controller with a state of its own."""

    def __init__(self, word: str) -> None:
        """Hold the only answer."""
        self.word = word

    def __call__(self, prompt: str, image: bytes | None) -> str:
        """Answer."""
        del prompt, image
        return self.word

    def drive(self, prompt: str, image: bytes | None) -> str:
        """Answer too."""
        return self(prompt, image)


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a small bank."""
    return build_bank(tmp_path_factory.mktemp("bank") / "bank")


def test_a_callable_is_asked_as_its_spec_would_be(bank: FrameBank, tmp_path: Path) -> None:
    """Under the name and the version that a command gives it, so that either goes on with the other's run."""
    report = run_battery(bank, decide, tmp_path / "run", limit=4)
    (spec,) = report
    assert spec == f"python:{__name__}:decide"
    manifest = report.score.manifest
    assert manifest.models[spec] == open_model(spec).version
    assert manifest.mode(spec) == RequestMode(spec)
    planned = battery.plan(bank.root, [spec], tmp_path / "run", extent=battery.BatterySelection(limit=4))
    assert planned.left() == 0
    battery.run(battery.plan(bank.root, [spec], tmp_path / "other", extent=battery.BatterySelection(limit=4)))
    assert battery.score(tmp_path / "other").as_dict()["models"] == report.score.as_dict()["models"]


def test_callables_of_every_kind_have_a_name(bank: FrameBank, tmp_path: Path) -> None:
    """A coroutine, an object, a method, a partial, a function within one; beside a SPEC and a mode."""

    def inner(prompt: str, image: bytes | None) -> str:
        return decide(prompt, image)

    mode = RequestMode("scripted:depth")
    several = [decide_later, Driver("STOP"), Driver("SLOW").drive, partial(decide), inner, "scripted:constant", mode]
    report = run_battery(bank, several, tmp_path / "run", limit=2)
    inside = "test_callables_of_every_kind_have_a_name.inner"
    own = [f"python:{__name__}:{one}" for one in ("decide_later", "Driver", "Driver.drive", "decide", inside)]
    assert list(report) == [*own, "scripted:constant", "scripted:depth"]
    asked = {spec: model.answers.decisions["real"] for spec, model in report.score.models.items()}
    assert asked[own[0]] == asked[own[3]] == asked[own[4]]
    assert {one.action for one in asked[own[1]] if one is not None} == {"STOP"}
    assert {one.action for one in asked[own[2]] if one is not None} == {"SLOW"}


def test_names_may_be_given_and_must_differ(bank: FrameBank, tmp_path: Path) -> None:
    """Two objects of one class have one name of their own."""
    named = run_battery(bank, {"stops": Driver("STOP"), "slows": Driver("SLOW")}, tmp_path / "run", limit=1)
    assert list(named) == ["python:stops", "python:slows"]
    said = rf"two callables are called 'python:{__name__}:Driver'; name each: models=\{{'one': f, 'other': g\}}"
    with pytest.raises(SpecError, match=said):
        run_battery(bank, [Driver("STOP"), Driver("SLOW")], tmp_path / "twice")
    several = [RequestMode("scripted:constant", max_tokens=7), "scripted:constant"]
    with pytest.raises(SpecError, match="models name 'scripted:constant' twice, to be asked in two ways"):
        run_battery(bank, several, tmp_path / "twice")
    with pytest.raises(SpecError, match="a model is a SPEC, a RequestMode or a callable, not a int"):
        run_battery(bank, [3], tmp_path / "none")  # type: ignore[list-item]
    with pytest.raises(SpecError, match=r"must take \(prompt, image\) or \(prompt, images, state\)"):
        run_battery(bank, {"short": lambda prompt: prompt}, tmp_path / "none")
    own = f"python:{__name__}:decide"
    for both in ([decide, own], [own, decide], [decide, RequestMode(own)], [RequestMode(own), decide]):
        with pytest.raises(SpecError, match=f"models hold '{own}' as a callable and by its SPEC: keep one of them"):
            run_battery(bank, both, tmp_path / "twice")
    assert not (tmp_path / "twice").exists()
    assert not (tmp_path / "none").exists()


def of_a_notebook(code: str) -> Callable[..., object]:
    """Return the function ``f`` of code that no file holds."""
    cell: dict[str, object] = {"__name__": "cell"}
    exec(compile(code, "<a cell>", "exec"), cell)  # noqa: S102 - what a notebook does
    result = cell["f"]
    assert callable(result)
    return result


def test_a_callable_of_a_notebook_that_was_changed_is_another_version(bank: FrameBank, tmp_path: Path) -> None:
    """Run again unchanged it makes no call; changed, it does not go on with the run."""
    code = (
        "def f(prompt, image):\n asked.append(1)\n return {'a': 'STOP'}['a'] if 'x' in {'x', 'y'} else ''\nasked = []"
    )
    first = of_a_notebook(code)
    report = run_battery(bank, first, tmp_path / "run", limit=1)
    assert list(report) == ["python:cell:f"]
    again = of_a_notebook(f"\n\n{code}")
    assert run_battery(bank, again, tmp_path / "run", limit=1).verdicts == report.verdicts
    assert again.__globals__["asked"] == []  # type: ignore[attr-defined]
    with pytest.raises(LedgerError, match=r"asked python:cell:f at version .*, which is now .*: give another out"):
        run_battery(bank, of_a_notebook(code.replace("STOP", "SLOW")), tmp_path / "run", limit=1)


def test_options_of_a_mode_say_how_the_models_are_asked(bank: FrameBank, tmp_path: Path) -> None:
    """Those that are given by a SPEC or as callables; a model with a mode of its own is asked as that says."""
    with served() as server:
        how = {"base_url": server.base_url, "max_tokens": 77, "temperature": None, "headers": {"X-Team": "a"}}
        other = RequestMode("openai:other", base_url=server.base_url)
        report = run_battery(bank, ["openai:m", other], tmp_path / "run", limit=1, probe=False, **how)  # type: ignore[arg-type]
    manifest = report.score.manifest
    mode = manifest.mode("openai:m")
    assert (mode.max_tokens, mode.temperature, mode.headers) == (77, None, {"X-Team": "a"})
    assert manifest.mode("openai:other") == other
    assert report.score.models["openai:m"].answered == report.score.models["openai:m"].planned > 0
    patient = run_battery(bank, decide, tmp_path / "patient", limit=1, timeout_s=7.0).score.manifest
    assert patient.mode(f"python:{__name__}:decide").timeout_s == 7.0
    with pytest.raises(SpecError, match="max_tokens would change no model"):
        run_battery(bank, other, tmp_path / "none", max_tokens=3)
    with pytest.raises(SpecError, match="max_tokens"):
        run_battery(bank, "openai:m", tmp_path / "none", max_tokens=-3)


def test_a_served_model_is_probed_with_what_is_given(bank: FrameBank, tmp_path: Path) -> None:
    """What a probe finds does not take its place."""
    with served() as server:
        given = run_battery(bank, "openai:m", tmp_path / "run", limit=1, base_url=server.base_url, max_tokens=900)
    mode = given.score.manifest.mode("openai:m")
    assert (mode.max_tokens, mode.measured is not None) == (900, True)
    with served() as moved:
        with pytest.raises(LedgerError, match="or continue a run with moved=True, which records it"):
            run_battery(bank, "openai:m", tmp_path / "run", limit=2, base_url=moved.base_url, max_tokens=900)
        how = {"base_url": moved.base_url, "max_tokens": 900, "moved": True}
        more = run_battery(bank, "openai:m", tmp_path / "run", limit=2, **how)  # type: ignore[arg-type]
    assert more.score.manifest.mode("openai:m").base_url == moved.base_url


def failing() -> Iterator[object]:
    """Fail in two ways of the road, then answer."""
    yield from (Reply(error="wrong_json"), Reply(error="exception"))
    while True:
        yield "STOP"


def test_failures_on_the_way_are_asked_again(bank: FrameBank, tmp_path: Path) -> None:
    """Once more, where that is said; nothing else is."""
    replies, asked = failing(), []

    def answer(prompt: str, image: bytes | None) -> object:
        del image
        asked.append(prompt)
        return next(replies)

    first = run_battery(bank, {"m": answer}, tmp_path / "run", limit=2, controls="none")
    assert run_battery(bank, {"m": answer}, tmp_path / "run", limit=2, controls="none").rows() == first.rows()
    before = len(asked)
    again = run_battery(bank, {"m": answer}, tmp_path / "run", limit=2, controls="none", again=True)
    assert len(asked) == before + 2
    missing = [one.score.evidence()["python:m"].reasons().get("error", 0) for one in (first, again)]
    assert missing == [2, 0]


def test_callables_that_hold_other_things_are_other_models(bank: FrameBank, tmp_path: Path) -> None:
    """Partials, closures, objects and lambdas of one file; the same again goes on."""

    def saying(word: str, prompt: str = "", image: bytes | None = None) -> str:
        del prompt, image
        return word

    class Says:
        def __init__(self, word: str) -> None:
            self.word, self.calls = word, 0

        def __call__(self, prompt: str, image: bytes | None) -> str:
            del prompt, image
            self.calls += 1
            return self.word

    def closing(word: str):  # noqa: ANN202
        return lambda prompt, image: word  # noqa: ARG005

    for number, make in enumerate((partial(partial, saying), Says, closing)):
        first, other = make("STOP"), make("SLOW")
        run = tmp_path / f"run-{number}"
        rows = run_battery(bank, {"m": first}, run, limit=1, controls="none").rows()
        assert run_battery(bank, {"m": first}, run, limit=1, controls="none").rows() == rows
        with pytest.raises(LedgerError, match="One run cannot hold two versions"):
            run_battery(bank, {"m": other}, run, limit=1, controls="none")
        assert run_battery(bank, {"m": make("STOP")}, run, limit=1, controls="none").rows() == rows


def test_a_loss_is_accepted_where_that_is_said(bank: FrameBank, tmp_path: Path) -> None:
    """An older ledger in the place of the run's: refused in words of arguments, then the lost calls are made anew."""
    run = tmp_path / "run"
    run_battery(bank, decide, run, limit=1, controls="none")
    shutil.copyfile(run / LEDGER, tmp_path / "older")
    run_battery(bank, decide, run, limit=2, controls="none")
    (run / LEDGER).write_bytes((tmp_path / "older").read_bytes())
    for beside in ("-wal", "-shm"):
        Path(f"{run / LEDGER}{beside}").unlink(missing_ok=True)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MissingCallsWarning)
        with pytest.raises(LedgerError, match="or continue without them with accept_loss=True"):
            run_battery(bank, decide, run, limit=2, controls="none")
    score = run_battery(bank, decide, run, limit=2, controls="none", accept_loss=True).score
    (model,) = score.models.values()
    assert model.answered == model.planned
