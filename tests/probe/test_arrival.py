"""A probe shows that a run's pictures arrive: at their size, several at once, each with its own call."""

import itertools
import math
import random
from collections import Counter
from dataclasses import replace

import pytest

from eyechart.modes import RequestMode
from eyechart.probe import ProbeError, ProbeResult, default_sample, doctor, probe
from eyechart.probe.arrival import AT_ONCE, FLICKERS, MISSED
from eyechart.probe.arrival import MOST_CALLS as OF_ARRIVAL
from eyechart.probe.mode_probe import MOST_CALLS
from eyechart.probe.sample import Sample
from faults import FaultServer
from seeing import Endpoint
from ways import Kept, OnTheWay, Rig, enlarged


def large_sample(kind: str = "PNG") -> Sample:
    """Return the built-in sample with pictures of 640×400 pixels in this format."""
    plain = default_sample()
    asked = [
        (prompt, replace(seen, images={name: enlarged(image, kind) for name, image in seen.images.items()}))
        for prompt, seen in plain.questions
    ]
    return replace(plain, questions=asked)


def pinned(endpoint: Endpoint) -> ProbeResult:
    """Return what the probe finds of an endpoint that is asked about large pictures."""
    with FaultServer([endpoint]) as server:
        result = probe(RequestMode("openai:m", base_url=server.base_url), sample=large_sample())
        assert server.requests == result.spent.calls <= MOST_CALLS
        return result


@pytest.mark.parametrize(
    ("endpoint", "said"),
    [
        (OnTheWay(way="drops", honest=True), r"'picture' fails: the server drops this run's pictures of 640×400"),
        (OnTheWay(way="drops"), r"'picture' fails: pictures of this run's size \(640×400\) do not arrive"),
        (OnTheWay(way="drops", tokens=0), r"'picture' fails: pictures of this run's size \(640×400\)"),
        (
            OnTheWay(way="mixes"),
            r"'picture' fails: the server mixes up the pictures of parallel calls.*--concurrency 1",
        ),
    ],
)
def test_a_server_that_drops_or_mixes_pictures_is_found_before_the_run_is_paid(endpoint: Endpoint, said: str) -> None:
    """By its count of tokens, or by what is named at the run's size and at once; with what to do."""
    with FaultServer([endpoint]) as server:
        with pytest.raises(ProbeError, match=said):
            probe(RequestMode("openai:m", base_url=server.base_url), sample=large_sample())
        assert server.requests <= MOST_CALLS


@pytest.mark.parametrize("tokens", [85, 0])
@pytest.mark.parametrize("kind", ["JPEG", "WEBP"])
def test_a_server_that_drops_pictures_by_their_format_is_found_before_the_run_is_paid(kind: str, tokens: int) -> None:
    """A run's pictures are drawn in their own format; a server that shows them to the model is probed as ever."""
    for way, healthy in (("knows PNG", False), ("", True)):
        with FaultServer([OnTheWay(way=way, tokens=tokens)]) as server:
            mode = RequestMode("openai:m", base_url=server.base_url)
            if healthy:
                assert probe(mode, sample=large_sample(kind)).measured.sees_image is True
                continue
            with pytest.raises(ProbeError, match=rf"'picture' fails: .*\(640×400 as {kind}\) do not arrive.*as PNG"):
                probe(mode, sample=large_sample(kind))


@pytest.mark.parametrize("honest", [True, False])
def test_pictures_that_arrive_in_some_calls_only_are_found_before_the_run_is_paid(*, honest: bool) -> None:
    """Where every other call goes to a server without eyes: half of what is right in one call is missed in another."""
    with FaultServer([OnTheWay(way="takes turns", honest=honest)]) as server:
        with pytest.raises(ProbeError, match="'picture' fails: pictures arrive in some calls only"):
            probe(RequestMode("openai:m", base_url=server.base_url), sample=large_sample())
        assert server.requests <= MOST_CALLS


def test_a_model_that_says_now_and_then_that_it_sees_nothing_is_probed_as_ever() -> None:
    """In one of ten calls at random: some pictures are named in one call and missed in another then."""
    for seed in range(4):
        endpoint = OnTheWay(way="blinks", dice=random.Random(seed))  # noqa: S311
        assert pinned(endpoint).measured.sees_image is True


@pytest.mark.parametrize(("right", "missed"), [(0.9, 0.05), (0.9, 0.1), (0.85, 0.15), (0.6, 0.15), (0.4, 0.1)])
def test_pictures_seldom_seem_to_come_in_some_calls_only(right: float, missed: float) -> None:
    """By chance in less than 3 of 10,000 probes, at each rate of right answers and of those that there is none."""
    rates = {"right": right, "missed": missed, "wrong": 1 - right - missed}
    chance = Counter({(0, 0, 0): 1.0})
    for _ in range(AT_ONCE):
        before, chance = chance, Counter()
        for (gone, back, every), has in before.items():
            for three in itertools.product(rates, repeat=3):
                key = (
                    gone + (three[:2] == ("right", "missed")),
                    back + (three[:2] == ("missed", "right")),
                    every + three.count("missed"),
                )
                chance[key] += has * math.prod(rates[one] for one in three)
    found = (has for (gone, back, every), has in chance.items() if min(gone, back) >= FLICKERS and every >= MISSED)
    assert sum(found) < 3e-4


def test_the_largest_picture_of_a_run_is_the_one_that_is_drawn() -> None:
    """Also where the first frame's is small, and the server drops the others by their size."""
    small, large = default_sample().questions, large_sample().questions
    with (
        FaultServer([OnTheWay(way="drops")]) as server,
        pytest.raises(ProbeError, match=r"'picture' fails: pictures of this run's size \(640×400\)"),
    ):
        probe(
            RequestMode("openai:m", base_url=server.base_url),
            sample=replace(default_sample(), questions=[small[0], *large[1:]]),
        )


HEALTHY = (
    Endpoint(),
    OnTheWay(tokens=3),
    OnTheWay(tokens=0),
    OnTheWay(tokens=1105),
    OnTheWay(way="caches"),
    Endpoint(noise=0.1),
)


@pytest.mark.parametrize("endpoint", HEALTHY)
def test_a_healthy_server_is_probed_as_ever(endpoint: Endpoint) -> None:
    """Whether it counts pictures in many tokens, in few, in none, or only what no cache held."""
    assert pinned(endpoint).measured.sees_image is True


def test_what_is_shown_at_once_takes_few_calls_more() -> None:
    """And they stand in the bound that is shown before."""
    assert OF_ARRIVAL <= 16
    assert MOST_CALLS == 60 + OF_ARRIVAL


def test_a_cache_by_prefix_is_named_as_the_cause() -> None:
    """Every answer fits the first picture of its kind."""
    with FaultServer([OnTheWay(way="keeps")]) as server:
        found = doctor(RequestMode("openai:m", base_url=server.base_url))
    assert found.sight.outcome == "blind"
    assert "a prefix cache" in found.causes[0]


def rig_sample(cameras: tuple[str, ...] = ("front", "rear")) -> Sample:
    """Return the sample with several cameras."""
    plain = default_sample()
    asked = [
        (prompt, replace(seen, images=dict.fromkeys(cameras, one)))
        for prompt, seen in plain.questions
        for one in [enlarged(next(iter(seen.images.values())))]
    ]
    return replace(plain, questions=asked)


def test_pictures_of_one_query_that_collapse_are_found_before_the_run() -> None:
    """Answers name one of two colours, and the tokens do not grow; a model that looks at one is noted only."""
    with FaultServer([Rig(hands_on=1)]) as server, pytest.raises(ProbeError, match="'picture' fails: of 2 pictures"):
        probe(RequestMode("openai:m", base_url=server.base_url), sample=rig_sample())
    for endpoint, noted in ((Rig(), False), (Rig(hands_on=1, counts_all=True), True)):
        with FaultServer([endpoint]) as server:
            found = probe(RequestMode("openai:m", base_url=server.base_url), sample=rig_sample())
            assert server.requests <= MOST_CALLS
        assert any("it names 1 of 2 pictures" in note for note in found.notes) is noted


@pytest.mark.parametrize("counts", [True, False])
def test_a_model_that_names_one_of_two_pictures_once_is_probed_as_ever(*, counts: bool) -> None:
    """Also where the server counts the tokens of words alone, which do not fall where a picture is left out."""
    calls = itertools.count()
    endpoint = Rig(lists=lambda named: named if next(calls) else named[:1], counts_pictures=counts)
    with FaultServer([endpoint]) as server:
        found = probe(RequestMode("openai:m", base_url=server.base_url), sample=rig_sample())
    said = "the server counts all of them" if counts else "one of two answers names 1 of 2 pictures"
    assert any(said in note for note in found.notes)


@pytest.mark.parametrize("hands_on", [1, 2, 3])
def test_a_server_that_hands_on_some_of_three_pictures_is_found_before_the_run(hands_on: int) -> None:
    """The last camera has a colour of its own too; one that counts all pictures is noted only."""
    sample = rig_sample(("front", "left", "right"))
    with FaultServer([Rig(hands_on=hands_on)]) as server:
        mode = RequestMode("openai:m", base_url=server.base_url)
        if hands_on == 3:
            assert not any("pictures" in note for note in probe(mode, sample=sample).notes)
        else:
            with pytest.raises(
                ProbeError, match=rf"'picture' fails: of 3 pictures of one size in one query {hands_on}"
            ):
                probe(mode, sample=sample)
    with FaultServer([Rig(hands_on=hands_on, counts_all=True)]) as server:
        found = probe(RequestMode("openai:m", base_url=server.base_url), sample=sample)
    assert any("the server counts all of them" in note for note in found.notes) is (hands_on < 3)


@pytest.mark.parametrize(
    ("endpoint", "noted"),
    [
        (Rig(turns=True), True),
        (Rig(), False),
        (Rig(lists=sorted), False),
        (Rig(lists=lambda named: named[::-1]), False),
    ],
)
def test_pictures_of_one_query_that_are_exchanged_are_named_before_the_run(endpoint: Rig, *, noted: bool) -> None:
    """By their order in two answers and the first of a third; a model that lists them in an order of its own is not."""
    with FaultServer([endpoint]) as server:
        found = probe(RequestMode("openai:m", base_url=server.base_url), sample=rig_sample())
        assert server.requests <= MOST_CALLS
    assert any("of 2 pictures in one query it takes the first for another" in note for note in found.notes) is noted


def test_a_camera_whose_size_does_not_arrive_is_found_beside_one_that_does() -> None:
    """Each camera's picture is drawn at the size that it has in the run."""
    sample = default_sample()
    asked = [
        (prompt, replace(seen, images={"front": one, "rear": enlarged(one)}))
        for prompt, seen in sample.questions
        for one in [next(iter(seen.images.values()))]
    ]
    sample = replace(sample, questions=asked)
    with (
        FaultServer([Rig(most=500 * 384)]) as server,
        pytest.raises(ProbeError, match="'picture' fails: of 2 pictures"),
    ):
        probe(RequestMode("openai:m", base_url=server.base_url), sample=sample)
    with FaultServer([Rig()]) as server:
        assert probe(RequestMode("openai:m", base_url=server.base_url), sample=sample).measured.sees_image is True


def test_a_cache_by_prefix_ends_the_probe_and_a_model_of_one_answer_does_not() -> None:
    """By two pictures of another size: the first is right there, and the second gets its answer."""
    with FaultServer([Kept()]) as server, pytest.raises(ProbeError, match="'cache' fails: every answer fits the first"):
        probe(RequestMode("openai:m", base_url=server.base_url))
    for seed in range(8):  # in one of eight the first picture has the colour that it always names
        with FaultServer([Endpoint(sees=False, dumb="")]) as server:
            assert probe(RequestMode("openai:m", base_url=server.base_url), seed=seed).measured.sees_image is False


def test_one_at_a_time_a_server_that_mixes_pictures_serves_a_run() -> None:
    """As the hint of the fault says."""
    with FaultServer([OnTheWay(way="mixes")]) as server:
        sample = replace(large_sample(), at_once=1)
        found = probe(RequestMode("openai:m", base_url=server.base_url), sample=sample)
    assert found.measured.facts["repeats alone"] == "5 of 5"
