import asyncio
import time
from pathlib import Path

import numpy as np
import pytest

from eyechart.calls import UNFINISHED, Query, Reply
from eyechart.errors import SpecError
from eyechart.frames import Stimulus, encode
from eyechart.models import Model, open_model
from eyechart.models.python_callable import under_way
from eyechart.modes import RequestMode

MODULE = """
import asyncio, os, threading, time
from eyechart.calls import Reply

def decide(prompt, image):
    return f"{len(image or b'')} {prompt}"

async def decide_later(prompt, image):
    await asyncio.sleep(0)
    return Reply("GO", "stop", prompt_tokens=7)

class Robot:
    def __call__(self, prompt, image):
        return "STOP"
    async def drive(self, prompt, image):
        return "GO"

robot = Robot()
drive = robot.drive

def breaks(prompt, image):
    raise RuntimeError("no motor, and the key is " + os.environ["ROBOT_API_KEY"])

def opens(prompt, image):
    raise OSError(24, "Too many open files", "weights")

def stops(prompt, image):
    raise StopIteration("done")

def counts(prompt, image):
    return 7

def meets(prompt, image, all_eight=threading.Barrier(8)):
    all_eight.wait(30)
    return "SLOW"

def hangs(prompt, image):
    time.sleep(60)

def waits(prompt, image, go_on=threading.Event()):
    go_on.wait(30)
    return "GO"

def names_its_thread(prompt, image):
    return str(threading.get_ident())

def narrow(prompt):
    return "GO"

def whole(prompt, images, state):
    return f"{list(images)} {state['joints']}"

def waiting_whole(prompt, images, state=None):
    return f"{list(images)} {state}"

def optional(prompt, image, state="calm"):
    return f"{type(image).__name__} {state}"

number = 5
"""
PICTURE = encode(np.zeros((4, 4, 3), dtype=np.uint8))
QUERY = Query("Drive.", "Which?", Stimulus.of(PICTURE), 1)


@pytest.fixture(autouse=True)
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Write a module of one's own into the current folder, under a name of its own, and return the name."""
    name = f"robot_{abs(hash(tmp_path))}"
    (tmp_path / f"{name}.py").write_text(MODULE, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("ROBOT_API_KEY", "a-very-secret-value")
    monkeypatch.setattr("sys.path", __import__("sys").path[:])
    return name


def opened(module: str, function: str, **mode: object) -> Model:
    """Open a callable of the module."""
    spec = f"python:{module}:{function}"
    return open_model(spec, RequestMode(spec, **mode))  # type: ignore[arg-type]


def ask(model: Model, query: Query = QUERY) -> Reply:
    """Ask once."""
    return asyncio.run(model.answer(query))


def test_a_callable_gets_the_words_and_the_picture(module: str) -> None:
    """System and user message as one prompt; no picture is None."""
    model = opened(module, "decide")
    assert ask(model).text == f"{len(PICTURE)} Drive.\n\nWhich?"
    assert ask(model, Query("", "Which?", Stimulus(), 1)).text == "0 Which?"


@pytest.mark.parametrize(("function", "text"), [("decide_later", "GO"), ("robot", "STOP"), ("drive", "GO")])
def test_functions_objects_and_coroutines_are_callables(module: str, function: str, text: str) -> None:
    """And a whole Reply is taken as it is."""
    reply = ask(opened(module, function))
    assert (reply.text, reply.error) == (text, None)
    assert reply.prompt_tokens == (7 if function == "decide_later" else None)


@pytest.mark.parametrize(
    ("function", "detail"),
    [
        ("breaks", "RuntimeError: no motor, and the key is [$ROBOT_API_KEY]"),
        ("stops", "RuntimeError: StopIteration: done"),
        ("counts", "the callable returned a int, not a text or a Reply"),
    ],
)
def test_what_a_callable_raises_is_a_reply_without_secrets(module: str, function: str, detail: str) -> None:
    """The run goes on, and no key of the environment is written down."""
    assert ask(opened(module, function)) == Reply(error="exception", error_detail=detail)


def test_a_callable_that_finds_no_descriptor_left_is_asked_again_later(module: str) -> None:
    """This machine lacks one just now, which says nothing about the model: such a call stays unfinished."""
    found = ask(opened(module, "opens"))
    assert found.error in UNFINISHED
    assert str(found.error_detail).startswith("OSError: [Errno 24] Too many open files")


def test_synchronous_callables_run_at_the_same_time(module: str) -> None:
    """Each of eight waits for the other seven."""
    model = opened(module, "meets")

    async def eight() -> list[Reply]:
        return await asyncio.gather(*(model.answer(QUERY) for _ in range(8)))

    assert {reply.text for reply in asyncio.run(eight())} == {"SLOW"}


def test_a_callable_that_hangs_times_out_and_does_not_hold_up_the_end(module: str) -> None:
    """Its thread is left behind."""
    began = time.monotonic()
    reply = ask(opened(module, "hangs", timeout_s=0.2))
    assert (reply.error, reply.error_detail) == ("timeout", "no answer within 0.2 s")
    assert time.monotonic() - began < 30


def test_calls_that_never_return_are_bounded(module: str) -> None:
    """While 16 that were given up still run, a further one is not made; once they are back it is asked."""
    model = opened(module, "waits", timeout_s=0.2)

    async def given_up(count: int) -> list[str]:
        return [reply.error_detail for reply in await asyncio.gather(*(model.answer(QUERY) for _ in range(count)))]

    before = under_way()
    assert set(asyncio.run(given_up(16))) == {"no answer within 0.2 s"}
    for _ in range(3):
        said = "not called: 16 earlier calls have not returned"
        assert ask(model) == Reply(error="not_called", error_detail=said)
    assert len(under_way() - before) == 16
    waits = model.ask  # type: ignore[attr-defined]
    waits.__defaults__[0].set()
    for thread in tuple(model.left):  # type: ignore[attr-defined]
        thread.join(10)
    assert ask(model).text == "GO"


def test_threads_are_kept_for_further_calls(module: str) -> None:
    """Calls one after another are made by one thread, which is no running call between them."""
    model = opened(module, "names_its_thread")
    before = under_way()

    async def one_by_one() -> set[str]:
        return {(await model.answer(QUERY)).text for _ in range(20)}

    assert len(asyncio.run(one_by_one())) == 1
    assert asyncio.run(one_by_one()) == asyncio.run(one_by_one())
    assert under_way() == before


def test_a_thread_whose_call_was_given_up_makes_no_other(module: str) -> None:
    """It ends with that call, while others go on."""
    model = opened(module, "waits", timeout_s=0.2)
    assert ask(model).error == "timeout"
    (thread,) = model.left  # type: ignore[attr-defined]
    assert ask(opened(module, "names_its_thread")).text != str(thread.ident)
    model.ask.__defaults__[0].set()  # type: ignore[attr-defined]
    thread.join(10)
    assert not thread.is_alive()


def test_a_callable_may_take_all_cameras_and_the_state(module: str) -> None:
    """By the name of its third parameter; one that takes an image is not called where that would hide a camera."""
    two = Stimulus({"front": PICTURE, "wrist": PICTURE}, {}, {"joints": (0.5, 1.0)})
    query = Query("", "Which?", two, 1)
    assert ask(opened(module, "whole"), query).text == "['front', 'wrist'] (0.5, 1.0)"
    assert ask(opened(module, "waiting_whole"), QUERY).text == "['main'] {}"
    assert ask(opened(module, "optional"), QUERY).text in {"bytes calm", "NoneType calm"}
    refused = ask(opened(module, "decide"), query)
    assert refused.error == "exception"
    assert "takes one image and the frame has front, wrist; let it take (prompt, images, state)" in refused.error_detail


def test_the_version_is_that_of_the_file(module: str, tmp_path: Path) -> None:
    """A changed file is another version, so that two of them do not mix in a ledger."""
    before = opened(module, "decide").version
    (tmp_path / f"{module}.py").write_text(MODULE + "\n", encoding="utf-8")
    assert opened(module, "decide").version != before


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("decide", "must be python:MODULE:FUNCTION"),
        ("{}:", "must be python:MODULE:FUNCTION"),
        ("no_such_module_at_all:decide", "cannot be imported: No module named 'no_such_module_at_all'"),
        ("{}:nothing", "has no callable 'nothing'"),
        ("{}:number", "has no callable 'number'"),
        ("{}:narrow", r"must take \(prompt, image\)"),
    ],
)
def test_what_is_no_callable_is_refused_with_what_is_missing(module: str, name: str, says: str) -> None:
    """Before any call."""
    spec = f"python:{name.format(module)}"
    with pytest.raises(SpecError, match=says):
        open_model(spec, RequestMode(spec))


@pytest.mark.parametrize(
    ("code", "says"),
    [
        ("1/0", "ZeroDivisionError: division by zero"),
        ("def broken(", "SyntaxError: "),
        ("raise ValueError('no\\n\\n  camera')", "ValueError: no camera$"),
        ("import sys; sys.exit(0)", "SystemExit: 0"),
        ("import os; raise ValueError(os.environ['ROBOT_API_KEY'])", r"ValueError: \[\$ROBOT_API_KEY\]"),
    ],
)
def test_a_module_that_fails_while_it_is_imported_is_told_in_one_line(module: str, code: str, says: str) -> None:
    """Whatever it raises, and never as an end without a word."""
    Path(f"{module}_fails.py").write_text(code, encoding="utf-8")
    with pytest.raises(SpecError, match=f"the import of module .* fails: {says}"):
        open_model(f"python:{module}_fails:decide")
