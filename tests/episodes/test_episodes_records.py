"""Lines of episodes.jsonl: what was written is read back, and damage is named by line and field, never a traceback."""

import copy
import json
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drives import by_depth, drive, make_run
from eyechart.episodes import EPISODES, EpisodeKey, read_episodes, summarise
from eyechart.episodes.worlds import Setup, Worlds
from eyechart.errors import EyechartError, LedgerError
from eyechart.policies import open_policy
from eyechart.simulators import open_simulator
from eyechart.studies.closed_loop import score

WHOLE = drive("reader", by_depth, steps=3, seeds=[1])
GOOD = json.loads(drive("reader", by_depth, steps=3)[0].as_line())

VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5) | st.just(10**400),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=4,
)


def places(value: object, at: tuple[str | int, ...] = ()) -> list[tuple[str | int, ...]]:
    """Return the places of all values inside a value."""
    inside = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [at, *(place for name, one in inside for place in places(one, (*at, name)))]


def changed(where: tuple[str | int, ...], what: object, *, drop: bool) -> object:
    """Return the good episode with one of its values replaced, or left out."""
    if not where:
        return what
    made = copy.deepcopy(GOOD)
    inside = made
    for name in where[:-1]:
        inside = inside[name]
    if drop:
        del inside[where[-1]]
    else:
        inside[where[-1]] = what
    return made


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a run of four good episodes."""
    return make_run(tmp_path_factory.mktemp("fuzz") / "run", WHOLE)


@settings(max_examples=120, deadline=None)
@given(where=st.sampled_from(places(GOOD)), what=VALUES, drop=st.booleans())
def test_a_line_with_any_value_changed_is_an_episode_or_an_error_that_names_it(
    out: Path, where: tuple[str | int, ...], what: object, *, drop: bool
) -> None:
    """And what is taken for an episode can be scored, or the score says in words why not."""
    line = json.dumps(changed(where, what, drop=drop))
    (out / EPISODES).write_text("".join(f"{one.as_line()}\n" for one in WHOLE) + line + "\n")
    try:
        episodes = list(read_episodes(out))
    except LedgerError as error:
        assert f"{out / EPISODES}: line 5 is no episode: " in str(error)  # noqa: PT017 - either is right
        assert "restore the file from a copy, or delete this line" in str(error)  # noqa: PT017 - likewise
        return
    assert len(episodes) == 5
    if not drop:
        assert json.loads(episodes[4].as_line()) == changed(where, what, drop=drop)
    summarise(episodes)
    try:
        score(out, resamples=10).as_dict()
    except EyechartError as error:
        assert "\n" not in str(error)  # noqa: PT017 - either is right


@settings(max_examples=80, deadline=None)
@given(st.binary(max_size=40), st.integers(0, 400))
def test_bytes_that_are_no_episode_are_an_error_of_their_line(
    tmp_path_factory: pytest.TempPathFactory, noise: bytes, cut: int
) -> None:
    """Whatever they are; after the last end of a line they are what a kill left, and no error."""
    out = tmp_path_factory.mktemp("noise")
    good = json.dumps(GOOD).encode()
    (out / EPISODES).write_bytes(good + b"\n" + good[:cut] + noise.replace(b"\n", b""))
    assert len(list(read_episodes(out))) == 1
    (out / EPISODES).write_bytes(good + b"\n" + good[:cut] + noise.replace(b"\n", b"") + b"\n")
    with pytest.raises(LedgerError, match="line 2 is no episode"):
        list(read_episodes(out))


@pytest.mark.parametrize(
    ("where", "what", "said"),
    [
        (("steps", 1, "reward"), [1.0], r"steps\[1\].reward is \[1.0\], not a number"),
        (("steps", 1, "reward"), float("nan"), "it holds NaN, which is no number"),
        (("steps", 1, "reward"), -1e308, r"steps\[1\].reward is -1e\+308, not a number up to 1e\+30"),
        (("steps", 1, "distance_m"), 10**90, r"steps\[1\].distance_m is 10+…, not a number up to 1e\+30"),
        (
            ("steps", 0, "truth", "lead_gap_m"),
            1e31,
            r"steps\[0\].truth.lead_gap_m is 1e\+31, not a number up to 1e\+30",
        ),
        (("key", "seed"), 10**4000, r"key.seed is 10+…, not a number up to 1e\+30"),
        (("steps", 0, "crashed"), 1, r"steps\[0\].crashed is 1, not true or false"),
        (("steps", 0, "truth", "lead_gap_m"), {}, r"steps\[0\].truth.lead_gap_m is {}, not a number"),
        (("steps", 2, "step"), 1, r"steps\[2\].step is 1, but this step's is 2"),
        (("steps", 2, "frame"), "x", r'steps\[2\].frame is "x", but this step.s is "highway/light/0/002"'),
        (("steps", 0, "decision", "action"), None, r"steps\[0\].decision: a Decision has either an action or"),
        (("key", "seed"), "0", 'key.seed is "0", not a whole number'),
        (("ended",), None, "ended is null, not text"),
        (("steps",), {}, "steps is {}, not a list"),
        (("more",), 1, 'it has a field "more", which this eyechart does not know'),
    ],
)
def test_damage_is_named_by_its_field(tmp_path: Path, where: tuple[str | int, ...], what: object, said: str) -> None:
    """What stands there, and what should."""
    (tmp_path / EPISODES).write_text(json.dumps(changed(where, what, drop=False)) + "\n")
    with pytest.raises(LedgerError, match=f"line 1 is no episode: {said}"):
        list(read_episodes(tmp_path))


def test_a_field_that_is_lacking_is_named(tmp_path: Path) -> None:
    """By its step."""
    made = copy.deepcopy(GOOD)
    del made["steps"][1]["truth"], made["steps"][1]["reward"]
    (tmp_path / EPISODES).write_text(json.dumps(made) + "\n")
    with pytest.raises(LedgerError, match=r"line 1 is no episode: steps\[1\] has no truth"):
        list(read_episodes(tmp_path))


def test_a_step_of_an_older_record_has_no_rounded_state(tmp_path: Path) -> None:
    """It is read, and says that it cannot say."""
    made = copy.deepcopy(GOOD)
    for step in made["steps"]:
        del step["rounded_state_sha256"]
    (tmp_path / EPISODES).write_text(json.dumps(made) + "\n")
    (episode,) = read_episodes(tmp_path)
    assert {step.rounded_state_sha256 for step in episode.steps} == {None}


@pytest.mark.parametrize(("name", "scenario"), [("highway", "light"), ("rover", "single"), ("rover-mpc", "single")])
def test_a_step_says_the_rounded_state_that_its_action_led_to(name: str, scenario: str) -> None:
    """Equal in a second drive, another after every step, and blind to what rounding hides; the exact one is not."""
    setup = Setup(name, seed=0, max_steps=3)
    key = EpisodeKey("random", name, scenario, 1)
    space = open_simulator(name).declared.action_space
    one, other = (Worlds(setup).drive(key, open_policy("random", space, lambda _: {})) for _ in range(2))
    digests = [step.rounded_state_sha256 for step in one.steps]
    assert None not in digests
    assert len(set(digests)) == len(digests) == 3
    assert digests == [step.rounded_state_sha256 for step in other.steps]


def test_a_rounded_state_hides_what_is_below_its_decimals() -> None:
    """Two states that differ by an error of rounding have one digest, and a step of a millimetre another."""
    world = open_simulator("rover").drive("single", 1)._world  # type: ignore[attr-defined]
    near, far = (replace(world, seconds=world.seconds + by) for by in (1e-9, 2e-3))
    assert world.as_bytes() != near.as_bytes()
    assert world.as_bytes(3) == near.as_bytes(3) != far.as_bytes(3)
