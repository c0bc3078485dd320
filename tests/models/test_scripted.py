"""Known-answer controllers: what each does with the pictures that a battery shows."""

import asyncio

import numpy as np
import pytest

from eyechart.calls import Query, Reply
from eyechart.errors import SpecError
from eyechart.frames import Stimulus, decode, encode, open_bank
from eyechart.models import open_model
from eyechart.models.scripted import CONTROLLERS, PLANNERS, names, see
from eyechart.perception.estimators import ESTIMATORS
from eyechart.spaces.discrete import DRIVING
from eyechart.verdicts import LABELS, PAPER_LABELS

pytestmark = pytest.mark.slow

GREY = encode(np.full((150, 600, 3), 128, dtype=np.uint8))
NOISE = encode(np.random.default_rng(0).integers(0, 256, (150, 600, 3), dtype=np.uint8))


def ask(name: str, image: bytes | None, seed: int = 0) -> Reply:
    """Return a controller's reply to one picture."""
    return asyncio.run(open_model(f"scripted:{name}").answer(Query("", "", Stimulus.of(image), seed)))


@pytest.mark.parametrize("name", CONTROLLERS)
@pytest.mark.parametrize("image", [None, GREY, NOISE], ids=["none", "grey", "noise"])
def test_every_controller_answers_every_non_picture(name: str, image: bytes | None) -> None:
    """A reply to a non-picture is an action, a refusal or a cut-off, never an exception."""
    reply = ask(name, image)
    decision = DRIVING.read(reply)
    assert decision.action in DRIVING.actions or decision.missing in {"refused", "truncated"}


@pytest.mark.parametrize("name", CONTROLLERS)
def test_the_same_query_gets_the_same_reply(name: str) -> None:
    """What is left to chance comes from the query's seed, so a resumed run repeats itself."""
    assert [ask(name, GREY, seed) for seed in range(5)] == [ask(name, GREY, seed) for seed in range(5)]


@pytest.mark.parametrize("name", ["random", "noisy_depth", "self_inconsistent", "truncating"])
def test_another_seed_may_get_another_reply(name: str) -> None:
    """Controllers that sample do not give one reply for all seeds."""
    assert len({ask(name, GREY, seed) for seed in range(40)}) > 1


def test_refuse_blank_refuses_only_the_uniform_picture() -> None:
    """Noise and no picture are answered, mid-grey is refused."""
    read = [DRIVING.read(Reply(ask("refuse_blank", image).text, "stop", None)) for image in (GREY, NOISE, None)]
    assert [one.missing for one in read] == ["refused", None, None]


@pytest.mark.parametrize("name", CONTROLLERS)
def test_declared_labels_are_labels(name: str) -> None:
    """Declarations use the words of the two sets of rules."""
    declared = CONTROLLERS[name].declared
    assert declared.paper in PAPER_LABELS
    assert declared.calibrated in LABELS


def test_an_unknown_controller_lists_the_known() -> None:
    """A wrong name is told what there is."""
    near = r"did you mean 'depth'\?"
    with pytest.raises(SpecError, match=f"unknown controller 'scripted:dept'; {near} known are constant, random"):
        open_model("scripted:dept")


@pytest.mark.parametrize("spec", ["depth", "nowhere:depth", ":", ""])
def test_an_unknown_adapter_is_refused_by_name(spec: str) -> None:
    """A SPEC without a known adapter names the form that is needed."""
    with pytest.raises(SpecError, match=r"a model is given as .*scripted:NAME"):
        open_model(spec)


def test_there_are_sixteen() -> None:
    """The list for people and the table of controllers agree."""
    assert list(names()) == [*CONTROLLERS, *PLANNERS, *ESTIMATORS]
    assert len(CONTROLLERS) == 16


def test_depth_lateral_exchanges_its_turns_under_the_flip(demo) -> None:  # noqa: ANN001
    """On every frame of a real bank the flipped picture gets the mirrored action."""
    turns, bank = 0, open_bank(demo.bank)
    for frame in bank:
        pixels = decode(bank.image(frame), frame.file)
        action = ask("depth_lateral", encode(pixels)).text
        assert ask("depth_lateral", encode(np.ascontiguousarray(pixels[::-1]))).text == DRIVING.reflect(action)
        turns += action in DRIVING.directional
    assert turns >= 48


def test_a_reading_is_kept_for_equal_pictures() -> None:
    """The same bytes are read once; other bytes are read anew."""
    assert see(GREY) is see(bytes(GREY))
    assert see(GREY) is not see(NOISE)
