"""Callables that answer several queries in a call: each query has its own row, and its own failure."""

import asyncio
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest

import banks
import movers
from arm_logs import arm_bank, by_front
from eyechart.calls import Query, Reply
from eyechart.errors import SpecError
from eyechart.frames import FrameBank, Stimulus, encode
from eyechart.ledger import Ledger
from eyechart.limits import Limits
from eyechart.manifest import LEDGER
from eyechart.models import ask, open_policy
from eyechart.models import open_model as open_spec
from eyechart.models.batches import WAIT_S, Batches, NotEachError
from eyechart.probe.policies import examine_policy
from eyechart.studies import policy
from eyechart.studies.battery import plan as plan_battery
from eyechart.studies.battery import run as run_battery
from eyechart.studies.policy.scores import judge

Many = Sequence[Mapping[str, np.ndarray]]
SIZES: list[int] = []
"""The sizes of the batches that were made."""


def single(images: Mapping[str, np.ndarray], state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Do as the log does, but raise an error where a picture is of one colour."""
    if np.ptp(images["front"].reshape(-1, 3), axis=0).max() == 0:
        raise ValueError("no object found")
    return by_front(images, state, instruction)


def batched(images: Many, states: Sequence[np.ndarray], instructions: Sequence[str | None]) -> list[np.ndarray]:
    """Do the same of lists."""
    SIZES.append(len(images))
    assert {type(images), type(states), type(instructions)} == {list}
    return [single(*one) for one in zip(images, states, instructions, strict=True)]


batched.batch = 8  # type: ignore[attr-defined]


def stacked(images: Many, states: Sequence[np.ndarray], instructions: Sequence[str | None]) -> dict[str, np.ndarray]:
    """Return one array of all answers under its name."""
    return {"actions": np.stack([by_front(*one) for one in zip(images, states, instructions, strict=True)])}


stacked.batch = 3  # type: ignore[attr-defined]


def seeds(
    images: Many, states: Sequence[np.ndarray], instructions: Sequence[str | None], *, seed: Sequence[int]
) -> list[np.ndarray]:
    """Draw each answer by its own seed."""
    every = zip(images, states, instructions, seed, strict=True)
    return [by_front(*one) + np.random.default_rng(own).normal(size=2) / 100 for *one, own in every]


seeds.batch, seeds.seedable = 8, True  # type: ignore[attr-defined]


def reversed_(images: Many, states: Sequence[np.ndarray], instructions: Sequence[str | None]) -> list[np.ndarray]:
    """Answer in the wrong order."""
    return stacked(images, states, instructions)["actions"][::-1]  # type: ignore[return-value]


reversed_.batch = 8  # type: ignore[attr-defined]


def centred(images: Many, states: Sequence[np.ndarray], instructions: Sequence[str | None]) -> np.ndarray:
    """Answer by how a query differs from its batch, as a normalisation by the batch does."""
    answers = np.array(stacked(images, states, instructions)["actions"])
    return answers - answers.mean(axis=0)


centred.batch = 8  # type: ignore[attr-defined]


def too_few(images: Many, states: Sequence[np.ndarray], instructions: Sequence[str | None]) -> list[np.ndarray]:
    """Answer one query of many."""
    return stacked(images, states, instructions)["actions"][:1]  # type: ignore[return-value]


too_few.batch = 8  # type: ignore[attr-defined]


def half(images: Many, states: Sequence[np.ndarray], instructions: Sequence[str | None]) -> list[np.ndarray | None]:
    """Have no answer where a picture is of one colour, and say so in the place of that one."""
    found: list[np.ndarray | None] = []
    for one in zip(images, states, instructions, strict=True):
        try:
            found.append(single(*one))
        except ValueError:
            found.append(None)
    return found


half.batch = 8  # type: ignore[attr-defined]


def slow(images: Many, states: Sequence[np.ndarray], instructions: Sequence[str | None]) -> list[np.ndarray]:
    """Take too long."""
    time.sleep(0.3)
    return [by_front(*one) for one in zip(images, states, instructions, strict=True)]


slow.batch = 2  # type: ignore[attr-defined]


def words(prompts: Sequence[str], images: Sequence[bytes | None]) -> list[str]:
    """Brake by the length of a picture's file; of lists."""
    SIZES.append(len(prompts))
    return [("STOP" if image is None or len(image) % 2 else "STRAIGHT") for image in images]


words.batch = 4  # type: ignore[attr-defined]


def word(prompt: str, image: bytes | None) -> str:
    """Do the same of one."""
    return words([prompt], [image])[0]


def moving(images: Many, states: Sequence[np.ndarray], instructions: Sequence[str | None]) -> list[np.ndarray]:
    """Go on as the two states before each answer went, by what two pictures show of them."""
    SIZES.append(len(images))
    alone = zip(images, states, instructions, strict=True)
    return [moves(*one) for one in alone]


def moves(images: Mapping[str, np.ndarray], state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Do the same of one query."""
    del instruction
    assert {one.shape[0] for one in images.values()} == {len(state)} == {2}
    seen = np.stack([movers.middle(images[name]) for name in ("top", "side")], axis=1)
    return np.repeat(np.diff(seen + state, axis=0), movers.HORIZON, axis=0)


moving.batch, moving.history, moves.history = 5, 1, 1  # type: ignore[attr-defined]


def said(prompts: Sequence[str], images: Many, state: Sequence[Mapping[str, object]]) -> list[str]:
    """Answer lists by the windows of each."""
    SIZES.append(len(prompts))
    return [says(*one) for one in zip(prompts, images, state, strict=True)]


def says(prompt: str, images: Mapping[str, object], state: Mapping[str, object]) -> str:
    """Say where the block was and is, and how large the pictures are."""
    del prompt
    assert {len(many) for many in (*images.values(), *state.values())} == {2}  # type: ignore[arg-type]
    return f"{state['block']} {[len(one) for one in images['top']]}"  # type: ignore[attr-defined]


said.batch, said.history, says.history = 5, 1, 1  # type: ignore[attr-defined]


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a bank of eight episodes of an arm."""
    return arm_bank(tmp_path_factory.mktemp("batches") / "arm")


def spec(name: str) -> str:
    """Return the SPEC of a callable of this file."""
    return f"python:{__name__}:{name}"


def query(bright: int, seed: int = 3) -> Query:
    """Return a query about one picture."""
    pixels = np.full((6, 8, 3), bright, np.uint8)
    pixels[:, 4:] = 9
    return Query("", "go", Stimulus({"front": encode(pixels)}, {}, {"j": [0.5, 0.1]}), seed)


def test_a_batch_gives_the_answers_of_single_calls_with_a_row_each(bank: FrameBank, tmp_path: Path) -> None:
    """Whatever shares it: motions, failures and verdict are equal, and calls are counted one by one."""
    SIZES.clear()
    names = ("single", "batched", "half")
    for name in names:
        policy.run(policy.plan(bank.root, [spec(name)], tmp_path / name))
    scores = {name: policy.score(tmp_path / name) for name in names}
    alone, *others = (scores[name].models[spec(name)] for name in names)
    for other in others:
        assert other.motions.finished == alone.motions.finished
        assert other.motions.missing == alone.motions.missing
        assert other.motions.fails_on == alone.motions.fails_on == {"blank": (len(bank), len(bank))}
        for condition, answers in alone.motions.answers.items():
            assert np.array_equal(other.motions.answers[condition], answers, equal_nan=True), condition
    verdicts = [judge(scores[name])[spec(name)] for name in names]
    assert len({one.headline for one in verdicts}) == 1
    assert max(SIZES) == 8
    assert Counter(SIZES)[8] > 0.9 * alone.motions.finished / 8


def test_a_batch_of_windows_gives_the_answers_of_single_windows(tmp_path: Path) -> None:
    """Of policies and of controllers: each query has its own instants, the oldest first, in full batches."""
    bank = movers.mover_bank(tmp_path / "movers", history=2)
    for name, alone in (("moving", "moves"), ("said", "says")):
        SIZES.clear()
        many, single_ones = (windowed(bank, one, tmp_path / one) for one in (name, alone))
        assert many == single_ones
        assert len(set(many.values())) > 2
        assert max(SIZES) == 5
        assert sum(SIZES) == len(many) > 5


def windowed(bank: FrameBank, name: str, out: Path) -> dict[tuple[str, str, int], str]:
    """Run a policy or a controller on some frames, and return its answer to each call."""
    if name.startswith("mov"):
        policy.run(policy.plan(bank.root, [spec(name)], out, conditions=("real", "swapped@cameras")))
    else:
        run_battery(plan_battery(bank.root, [spec(name)], out, conditions=("real", "blank")))
    with Ledger(out / LEDGER) as ledger:
        found = {(key.frame, key.condition, key.repeat): reply for key, reply in ledger.replies(spec(name))}
    assert {reply.error for reply in found.values()} == {None}
    return {key: reply.text for key, reply in found.items()}


def test_a_run_that_was_cut_goes_on_in_other_batches(bank: FrameBank, tmp_path: Path) -> None:
    """The rest of the calls is asked with other neighbours, and the answers stay equal."""
    planned = policy.plan(bank.root, [spec("stacked")], tmp_path / "cut")
    policy.run(planned, limits=Limits(calls=50))
    policy.run(policy.plan(bank.root, [spec("stacked")], tmp_path / "cut"))
    policy.run(policy.plan(bank.root, [spec("stacked")], tmp_path / "whole"))
    cut, whole = (policy.score(tmp_path / name).models[spec("stacked")] for name in ("cut", "whole"))
    assert cut.motions.finished == whole.motions.finished == planned.counts()[0]
    for condition, answers in whole.motions.answers.items():
        assert np.array_equal(cut.motions.answers[condition], answers, equal_nan=True)


def test_each_query_of_a_batch_has_its_own_seed(bank: FrameBank) -> None:
    """Equal seeds give equal answers in any batch, and others give others."""
    model = open_policy(spec("seeds")).model
    del bank

    async def asked() -> list[Reply]:
        return await asyncio.gather(*(ask(model, query(100, seed)) for seed in (1, 2, 1, 3)))

    first, second, third, fourth = asyncio.run(asked())
    assert first.text == third.text
    assert len({first.text, second.text, fourth.text}) == 3
    assert asyncio.run(ask(model, query(100, 1))).text == first.text


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("reversed_", "are they in the order of the queries"),
        ("batched", "two frames in a batch get the answers that each gets alone"),
        (
            "centred",
            "in a batch its answers differ from those alone, which are the same for two frames: are they in the order",
        ),
        ("too_few", "two frames in a batch fail, so each was asked alone, as a run does: ValueError: 2 queries got 1"),
    ],
)
def test_the_doctor_holds_a_batch_against_single_calls(bank: FrameBank, name: str, said: str) -> None:
    """Answers that change places are found, and a batch of too few, each of which is asked alone."""
    found = {one.name: one for one in examine_policy(spec(name), bank).findings}["batch"]
    assert said in found.says
    assert found.fine is (name == "batched")
    assert "batch" not in {one.name for one in examine_policy(spec("single"), bank).findings}


def test_a_batch_of_so_many_has_so_many_times_the_time() -> None:
    """Two queries of .2 seconds have .4 together; one alone has not enough."""
    model = open_policy(spec("slow"), 0.2).model

    async def asked(count: int) -> list[Reply]:
        return await asyncio.gather(*(ask(model, query(100 + place)) for place in range(count)))

    assert [one.error for one in asyncio.run(asked(2))] == [None, None]
    (alone,) = asyncio.run(asked(1))
    assert (alone.error, alone.error_detail) == ("timeout", "no answer within 0.2 s")


@pytest.mark.parametrize("declared", [0, -1, 1.5, True, "8", 5000])
def test_what_is_no_size_of_a_batch_is_refused(declared: object, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a policy and of a model of words."""
    monkeypatch.setattr(batched, "batch", declared)
    with pytest.raises(SpecError, match=r"declares batch = .* it must be a whole number from 1 to 1024"):
        open_policy(spec("batched"))
    monkeypatch.setattr(words, "batch", declared)
    with pytest.raises(SpecError, match=r"declares batch = .* it must be a whole number from 1 to 1024"):
        open_spec(spec("words"))


def test_a_model_of_words_answers_lists_too(tmp_path: Path) -> None:
    """The rows are those of single calls, each with its own text."""
    made = banks.build_bank(tmp_path / "bank")
    texts = []
    for name in ("words", "word"):
        SIZES.clear()
        run_battery(plan_battery(made.root, [spec(name)], tmp_path / name))
        with Ledger(tmp_path / name / "ledger.sqlite") as ledger:
            texts.append(
                {(key.frame, key.condition, key.repeat): reply.text for key, reply in ledger.replies(spec(name))}
            )
        assert (Counter(SIZES)[4] > Counter(SIZES)[1]) is (name == "words")
    assert texts[0] == texts[1]
    assert texts[0]


def test_a_call_without_a_reply_for_each_leaves_no_query_waiting() -> None:
    """Each gets the error."""

    async def call(queries: Sequence[Query]) -> list[Reply]:
        return [Reply(text="one")] * (len(queries) - 1)

    async def made() -> list[Reply | BaseException]:
        batches = Batches(2, call)
        async with asyncio.timeout(5):
            return await asyncio.gather(*(batches.answer(query(9, seed)) for seed in (1, 2)), return_exceptions=True)

    assert [type(one) for one in asyncio.run(made())] == [ValueError, ValueError]


def test_a_failure_that_several_share_is_asked_of_each() -> None:
    """Who causes it fails, and the others have their answers; a batch that is not full does not wait for ever."""
    asked: list[int] = []

    async def call(queries: Sequence[Query]) -> list[Reply]:
        asked.append(len(queries))
        bad = [one.seed == 2 for one in queries]
        if len(queries) > 1 and any(bad):
            raise NotEachError
        return [
            Reply(error="exception") if wrong else Reply(text=str(one.seed))
            for one, wrong in zip(queries, bad, strict=True)
        ]

    async def made() -> list[Reply]:
        batches = Batches(8, call)
        began = time.perf_counter()
        replies = await asyncio.gather(*(batches.answer(query(9, seed)) for seed in (1, 2, 3)))
        assert time.perf_counter() - began < 100 * WAIT_S
        return replies

    replies = asyncio.run(made())
    assert [(one.text, one.error) for one in replies] == [("1", None), ("", "exception"), ("3", None)]
    assert asked == [3, 1, 1, 1]
