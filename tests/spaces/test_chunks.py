"""A space that nobody named: chunks of 8 × 3 numbers go from a run through its ledger to what statistics ask for."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest

import banks
from eyechart.calls import Query, Reply
from eyechart.ledger import Ledger
from eyechart.prompts import Prompt
from eyechart.run import Plan, execute
from eyechart.spaces.space import Answer, Decision, SpaceDefaults, why_unanswered
from eyechart.studies.battery.answers import Answers, read_answers
from eyechart.studies.battery.calibrated_statistics import CalibratedTests
from eyechart.studies.battery.paper_statistics import Resampling
from stand_ins import StandIn

STEPS, PARTS = 8, ("steer", "go", "brake")
SCALE = (1.0, 1.0, 2.0)
CONDITIONS = ("real", "real_repeat", "mirrored", "blank", "blank@right")
Chunk = tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class Chunks(SpaceDefaults):
    """The next eight commands at once, each of three numbers; the first of them is exchanged by a reflection."""

    reader: ClassVar[int] = 1
    readers: ClassVar[tuple[int, ...]] = (1,)
    name: ClassVar[str] = "chunks"
    actions: ClassVar[tuple[str, ...]] = ()

    def schema(self) -> Mapping[str, object]:
        """Return the schema of a chunk."""
        row = {"type": "array", "items": {"type": "number"}, "minItems": len(PARTS), "maxItems": len(PARTS)}
        return {"type": "array", "items": row, "minItems": STEPS, "maxItems": STEPS}

    def read(self, reply: Answer) -> Decision[Chunk]:
        """Read a chunk; one of another shape is none."""
        if (missing := why_unanswered(reply.finish_reason, reply.error)) is not None:
            return Decision(None, missing)
        rows = json.loads(reply.text)
        if np.shape(rows) != (STEPS, len(PARTS)):
            return Decision(None, "unparsed", "wrong_shape")
        return Decision(tuple(tuple(map(float, row)) for row in rows))

    def distance(self, one: Chunk, other: Chunk) -> float:
        """Return the root mean square of the difference, in units of scale."""
        return float(np.sqrt(np.mean(((np.array(one) - np.array(other)) / SCALE) ** 2)))

    def project(self, action: Chunk, axis: str) -> float | None:
        """Return the mean of a part over the chunk."""
        return float(np.mean(np.array(action)[:, PARTS.index(axis)])) if axis in PARTS else None

    def reflect(self, action: Chunk) -> Chunk:
        """Return the chunk that steers to the other side."""
        return tuple((-steer, go, brake) for steer, go, brake in action)

    def symbol(self, action: Chunk) -> str:
        """Return the first command in words."""
        return " ".join(f"{number:.2f}" for number in action[0])

    def role(self, symbol: str) -> str:
        """Return that no chunk has a role."""
        del symbol
        return "other"


def respond(query: Query) -> Reply:
    """Answer with a chunk that follows from what was shown and asked, and now and then with one that is too short."""
    assert list(query.stimulus.images) == ["left", "right"]
    assert f"At {query.stimulus.state['joints'][0]:g}, 0.25, " in query.user
    dice = np.random.default_rng(int(query.sha256()[:12], 16))
    rows = np.round(dice.uniform(-1, 1, (STEPS, len(PARTS))), 3)
    cut = np.random.default_rng(query.seed).random() < 0.2
    return Reply(json.dumps(rows[: 3 if cut else STEPS].tolist()), "stop")


@pytest.fixture(scope="module")
def answered(tmp_path_factory: pytest.TempPathFactory) -> tuple[Answers, Mapping[tuple[str, str], Decision[Chunk]]]:
    """Return what a run's ledger gives, and the same decisions read one by one."""
    folder = tmp_path_factory.mktemp("chunks")
    bank = banks.build_rig(folder / "bank", frames=18)
    prompt = Prompt("chunks", "", "At {joints}, give the next eight commands.", template=True, space=Chunks())
    plan = Plan("battery", bank, prompt, ("m",), CONDITIONS, bank.frames, seed=3)
    with Ledger(folder / "ledger.sqlite", create=True) as ledger:
        execute(plan, {"m": StandIn(respond)}, ledger)
        replies = list(ledger.replies("m"))
    read = {(key.frame, key.condition): Chunks().read(reply) for key, reply in replies}
    return read_answers("m", replies, plan), read


Answered = tuple[Answers, Mapping[tuple[str, str], Decision[Chunk]]]


def pairs(answered: Answered, first: str, second: str) -> list[tuple[Chunk, Chunk]]:
    """Return two conditions' chunks on the frames that have both."""
    answers, read = answered
    both = [(read[frame.id, first].action, read[frame.id, second].action) for frame in answers.frames]
    return [(one, other) for one, other in both if one is not None and other is not None]


def test_the_distance_of_two_conditions_is_that_of_the_space(answered: Answered) -> None:
    """Frame by frame, where both replies hold a chunk; what was asked twice alike is 0 apart."""
    apart, have = answered[0].distance("real", "blank")
    both = pairs(answered, "real", "blank")
    assert apart.tolist() == [Chunks().distance(*pair) for pair in both]
    assert 0 < len(both) == have.sum() < len(have)
    assert answered[0].distance("real", "real_repeat")[0].tolist() == [0.0] * len(
        pairs(answered, "real", "real_repeat")
    )


def test_what_one_camera_decides_is_told_from_what_both_do(answered: Answered) -> None:
    """A condition over one camera leaves the other's picture and the state as they are."""
    one, _ = answered[0].distance("real", "blank@right")
    assert one.tolist() == [Chunks().distance(*pair) for pair in pairs(answered, "real", "blank@right")]
    assert (one > 0).all()


def test_a_reply_without_a_chunk_is_one_apart_from_every_chunk(answered: Answered) -> None:
    """At response level every frame counts, and two replies without a chunk are alike."""
    answers, read = answered
    apart, have = answers.distance("real", "blank", "response")
    assert have.all()
    for frame, found in zip(answers.frames, apart, strict=True):
        one, other = read[frame.id, "real"].action, read[frame.id, "blank"].action
        if one is None or other is None:
            assert found == float(one is not other)


def test_the_projection_is_along_a_named_axis(answered: Answered) -> None:
    """It is not a number where there is no chunk, and there is none along an axis that the space does not have."""
    answers, read = answered
    along = answers.projection("real", "brake")
    assert along is not None
    for frame, found in zip(answers.frames, along, strict=True):
        action = read[frame.id, "real"].action
        assert math.isnan(found) if action is None else found == Chunks().project(action, "brake")
    assert answers.projection("real", "lift") is None


def test_the_reflection_is_held_against_the_mirrored_picture(answered: Answered) -> None:
    """A chunk of the real picture is reflected, and compared with that of the mirrored one."""
    apart, _ = answered[0].distance("real", "mirrored", reflect=True)
    expected = [Chunks().distance(Chunks().reflect(one), other) for one, other in pairs(answered, "real", "mirrored")]
    assert apart.tolist() == expected


def test_tests_of_agreement_ask_the_space_alone(answered: Answered) -> None:
    """A model that answers equal pictures alike never disagrees with itself, whatever its actions are."""
    found = CalibratedTests(answered[0], Resampling(resamples=100)).statistics()
    assert found["self_disagreement"].value == 0.0
    assert found["image_token"].value is None


def test_a_run_of_chunks_says_what_it_asks_for() -> None:
    """Its prompt's key changes with the space, as with a wording."""
    plain, asked = (Prompt("chunks", "", "Give the next eight commands.", space=space) for space in (None, Chunks()))
    assert plain.key != asked.key
