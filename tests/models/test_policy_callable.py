"""Callables as policies: what they are given, what becomes of what they answer, and what they declare."""

import asyncio
import re
import sys
import time
import types
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from eyechart.calls import Query, Reply
from eyechart.errors import SpecError
from eyechart.frames import Stimulus, encode
from eyechart.models import open_model
from eyechart.models.policy_callable import DECLARED
from eyechart.modes import RequestMode
from eyechart.spaces.motion import Motion

PICTURE = np.arange(48, dtype=np.uint8).reshape(4, 4, 3)
SEEN = Stimulus({"top": encode(PICTURE)}, {}, {"arm": (0.5, 1.0), "hand": (2.0,)})


def opened(act: object, monkeypatch: pytest.MonkeyPatch, timeout_s: float = 5.0):  # noqa: ANN201
    """Return a policy that is this callable."""
    module = types.ModuleType("an_arm")
    module.act = act
    monkeypatch.setitem(sys.modules, "an_arm", module)
    return open_model("python:an_arm:act", RequestMode("python:an_arm:act", timeout_s=timeout_s), answering="policy")


def answer(act: Callable[..., object], monkeypatch: pytest.MonkeyPatch, told: str = "go", seed: int = 3) -> Reply:
    """Return what becomes of one call."""
    return asyncio.run(opened(act, monkeypatch).answer(Query("", told, SEEN, seed)))


def test_it_is_given_pictures_by_camera_a_flat_state_and_words(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of its own: what it changes no later call sees."""
    given = []

    def act(images: dict, state: np.ndarray, instruction: str | None) -> np.ndarray:
        given.append((images["top"].copy(), state.copy(), instruction))
        images["top"][:], state[:] = 0, 0
        return np.ones((2, 3))

    policy = opened(act, monkeypatch)
    for told in ("go", ""):
        assert asyncio.run(policy.answer(Query("", told, SEEN, 3))).error is None
    for (picture, state, _), told in zip(given, ("go", None), strict=True):
        assert (picture == PICTURE).all()
        assert state.tolist() == [0.5, 1.0, 2.0]
        assert given[0 if told else 1][2] == told


@pytest.mark.parametrize(
    ("said", "words"),
    [
        ("left", "a text is no array of numbers"),
        (None, "a NoneType is no array of numbers"),
        ([[1.0], [2.0, 3.0]], "no array"),
        (np.zeros(200_000), "too large"),
    ],
)
def test_what_is_no_array_is_an_error_in_words(monkeypatch: pytest.MonkeyPatch, said: object, words: str) -> None:
    """And no made-up motion."""
    reply = answer(lambda *_: said, monkeypatch)
    assert (reply.error, reply.text) == ("exception", "")
    assert words in reply.error_detail


CHUNK = np.arange(6.0).reshape(2, 3)
KEYS = "a dict is no array of numbers; its keys are"


@pytest.mark.parametrize(
    "said",
    [
        {"actions": CHUNK},
        {"action": CHUNK.tolist()},
        {"actions": CHUNK, "policy_timing": {"infer_ms": np.float64(3.0)}, "done": False, "told": "go"},
        types.MappingProxyType({"action": CHUNK}),
        CHUNK.tolist(),
        tuple(CHUNK),
    ],
)
def test_one_array_under_the_name_of_actions_is_the_answer(monkeypatch: pytest.MonkeyPatch, said: object) -> None:
    """Of a dict with nothing else that is an array, and of rows one by one."""
    assert (Motion.read(answer(lambda *_: said, monkeypatch).text).array == CHUNK).all()


@pytest.mark.parametrize(
    ("said", "words"),
    [
        ({"actions": CHUNK, "action": CHUNK}, f"{KEYS} 'actions', 'action': return the array (horizon, dimensions)"),
        ({"actions": CHUNK, "state": np.zeros(3)}, f"{KEYS} 'actions', 'state': return the array"),
        ({"actions": CHUNK, "info": {"state": [0.0]}}, f"{KEYS} 'actions', 'info' (a dict of 'state'): return"),
        ({"action.arm": CHUNK, "action.hand": CHUNK}, f"{KEYS} 'action.arm', 'action.hand': return"),
        ({"action": {"arm": CHUNK}}, f"{KEYS} 'action' (a dict of 'arm'): return"),
        ({"chunk": CHUNK}, f"{KEYS} 'chunk': return"),
        ({"actions": None}, f"{KEYS} 'actions': return"),
        ({}, f"{KEYS} none: return"),
        ((CHUNK, {"latency": 3}), "a tuple of 2 (ndarray, dict) is no array; return the first alone"),
        ([{"arm": CHUNK}, {}], "a list of 2 (dict, dict) is no array; return the first alone"),
        ((CHUNK, CHUNK), "a tuple of 2 (ndarray, ndarray) is no array; return the first alone"),
        ((CHUNK.tolist(), None), "a tuple of 2 (list, NoneType) is no array; return the first alone"),
        ({"actions": (CHUNK, 1.0)}, "a tuple of 2 (ndarray, float) is no array; return the first alone"),
    ],
)
def test_an_answer_of_several_arrays_is_named_and_not_guessed(
    monkeypatch: pytest.MonkeyPatch, said: object, words: str
) -> None:
    """By its keys, or by the types of its parts."""
    reply = answer(lambda *_: said, monkeypatch)
    assert (reply.error, reply.text) == ("exception", "")
    assert words in reply.error_detail


def test_a_method_of_an_object_is_a_policy_with_the_version_of_its_file(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """By dotted names; one that is not there is named."""
    code = "class Arm:\n    def act(self, *given):\n        return [[1.0]]\n\narm = Arm()\nact = arm.act\n"
    (tmp_path / "an_object_s_arm.py").write_text(code, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    policies = [
        open_model(spec, RequestMode(spec), answering="policy")
        for spec in ("python:an_object_s_arm:arm.act", "python:an_object_s_arm:act")
    ]
    assert [asyncio.run(one.answer(Query("", "", SEEN, 3))).error for one in policies] == [None, None]
    assert policies[0].version == policies[1].version != "no file"
    for name in ("arm.nothing", "nothing.act", "arm.", "arm..act"):
        spec = f"python:an_object_s_arm:{name}"
        with pytest.raises(SpecError, match=rf"has no callable '{re.escape(name)}'"):
            open_model(spec, RequestMode(spec), answering="policy")
    monkeypatch.delitem(sys.modules, "an_object_s_arm")


class Half:
    """A tensor of bfloat16, as torch has it."""

    def __array__(self, *_: object, **__: object) -> np.ndarray:
        """Refuse, in torch's words."""
        raise TypeError("Got unsupported ScalarType BFloat16")


def test_half_precision_that_numpy_lacks_is_an_error_with_a_way_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of torch, and of an array whose type another library has added."""
    reply = answer(lambda *_: Half(), monkeypatch)
    assert reply.error_detail.endswith("BFloat16; numpy has no such numbers: return .float()")
    added = np.zeros((2, 2), np.longdouble)
    assert answer(lambda *_: added, monkeypatch).error_detail.endswith("of up to 64 bits; return it as float32")


def test_numbers_that_are_none_are_kept_as_they_came(monkeypatch: pytest.MonkeyPatch) -> None:
    """The space says that they are no motion; the ledger holds what was answered."""
    reply = answer(lambda *_: np.full((2, 2), np.nan, np.float32), monkeypatch)
    assert reply.error is None
    assert np.isnan(Motion.read(reply.text).array).all()


def test_what_it_raises_and_what_takes_too_long_has_its_kind(monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither ends a run."""

    def slow(*_: object) -> np.ndarray:
        time.sleep(1)
        return np.zeros((1, 1))

    assert "KeyError: 'wrist'" in answer(lambda images, *_: images["wrist"], monkeypatch).error_detail
    late = asyncio.run(opened(slow, monkeypatch, timeout_s=0.1).answer(Query("", "go", SEEN, 3)))
    assert late.error == "timeout"


def test_a_seed_is_given_only_to_whom_takes_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """And every call is preceded by a reset where there is one."""
    calls = []

    def act(*_: object, **more: int) -> np.ndarray:
        calls.append(more)
        return np.zeros((1, 1))

    answer(act, monkeypatch)
    act.seedable, act.reset = True, lambda: calls.append("reset")
    answer(act, monkeypatch, seed=9)
    assert calls == [{}, "reset", {"seed": 9}]


def test_what_it_declares_of_itself_is_kept_or_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its version stands for it; a declaration of another kind is an error that names it."""

    def act(*_: object) -> np.ndarray:
        return np.zeros((1, 1))

    act.version, act.channels = "v7", ["cameras", "state"]
    policy = opened(act, monkeypatch)
    assert (policy.version, policy.facts["channels"], policy.facts["seedable"]) == ("v7", "cameras, state", "false")
    wrong = {
        "seedable": (1, "True or False"),
        "version": (7, "a text"),
        "channels": ("state", "a list of texts, as ['cameras', 'state']: of cameras (all of them), camera:NAME, state"),
        "reset": (3, "a function that takes nothing"),
        "step": (-1, "a whole number from 0 on"),
        "history": (-1, "a whole number from 0 to 50, of instants before the frame: LeRobot's n_obs_steps less 1"),
        "batch": (0, "a whole number from 1 to 1024: it then takes and returns lists of so many or fewer"),
    }
    assert wrong.keys() == DECLARED.keys()
    for name, (value, words) in wrong.items():
        kept = getattr(act, name, None)
        setattr(act, name, value)
        with pytest.raises(SpecError, match=re.escape(f"declares {name} = {value!r}; it must be {words}")):
            opened(act, monkeypatch)
        setattr(act, name, DECLARED[name] if kept is None else kept)
    with pytest.raises(SpecError, match="no callable 'act'"):
        opened("words", monkeypatch)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("mine.looks", "did you mean 'python:mine:looks'"),
        ("robots.mine.looks", "did you mean 'python:robots.mine:looks'"),
        ("mine", "for example python:my_robot:decide"),
        ("./mine.py:looks", "a module's name, not its file: give 'python:mine:looks'"),
        ("mine.py:looks", "a module's name, not its file: give 'python:mine:looks'"),
        ("robots/mine:looks", "a module's name, not its file: give 'python:mine:looks'"),
    ],
)
def test_a_name_that_is_no_module_and_function_is_told_what_is_meant(name: str, said: str) -> None:
    """As a model and as a policy."""
    for answering in ("model", "policy"):
        with pytest.raises(SpecError, match=re.escape(said)):
            open_model(f"python:{name}", answering=answering)


class Looks:
    """A callable once it is made."""

    def __call__(self, *_: object) -> np.ndarray:
        """Return a motion."""
        return np.zeros((1, 1))


def test_a_class_is_told_to_be_made_first(monkeypatch: pytest.MonkeyPatch) -> None:
    """A class is called as its objects are, and would answer with one of them."""
    said = "it is a class: make an object of it in its module, as looks = Looks\\(\\)"
    with pytest.raises(SpecError, match=said):
        opened(Looks, monkeypatch)
    with pytest.raises(SpecError, match=said):
        open_model("python:an_arm:act")
    opened(Looks(), monkeypatch)
