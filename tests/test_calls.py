import os
import subprocess
import sys
from dataclasses import fields, replace
from itertools import combinations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eyechart.calls import ANY_ACTION, MOST, TRANSIENT, CallKey, Query, Reply, bounded
from eyechart.frames import Stimulus
from eyechart.spaces.discrete import Discrete

KEY = CallKey("battery", "scripted:depth", "baseline@0", "f1", "real")
TWO = Discrete("two", ("GO", "STOP"), (), (), ())
WORDS = st.text(st.characters(exclude_categories=["C"]))


def test_a_query_has_no_field_for_ground_truth() -> None:
    """What a model may see: the words, the picture, a seed for its sampling, and the form of an answer."""
    assert [field.name for field in fields(Query)] == ["system", "user", "stimulus", "seed", "schema", "messages"]
    with pytest.raises((AttributeError, TypeError)):
        Query("", "", Stimulus(), 0).lead_gap_m = 5.0  # type: ignore[attr-defined]


def test_a_keys_seed_differs_by_every_field_and_by_the_run() -> None:
    """Also between real and its repeat, so that a model that samples may disagree with itself."""
    changed = [KEY._replace(**{name: "x"}) for name in CallKey._fields if name != "repeat"]
    changed += [KEY, KEY._replace(repeat=1), KEY._replace(condition="real_repeat"), KEY._replace(repeat=11)]
    seeds = [key.seed(0) for key in changed] + [KEY.seed(1)]
    assert len(set(seeds)) == len(seeds)
    assert all(0 <= seed < 2**63 for seed in seeds)


@given(st.lists(st.tuples(st.integers(0, 99), *[WORDS] * 5, st.integers(0, 9)), min_size=2, max_size=6, unique=True))
def test_different_keys_have_different_seeds(parts: list[tuple[int, str, str, str, str, str, int]]) -> None:
    """A field's end cannot be taken for the next one's beginning."""
    seeds = [CallKey(*key).seed(run) for run, *key in parts]
    assert all(one != other for one, other in combinations(seeds, 2))


@pytest.mark.parametrize("hash_seed", ["0", "1", "12345"])
def test_a_keys_seed_is_equal_in_every_process(hash_seed: str) -> None:
    """Python's own hash of a string is not; this one is."""
    program = f"from eyechart.calls import CallKey; print({KEY!r}.seed(7))"
    env = os.environ | {"PYTHONHASHSEED": hash_seed}
    process = subprocess.run([sys.executable, "-c", program], env=env, check=True, capture_output=True, text=True)
    assert int(process.stdout) == KEY.seed(7)


def test_the_digest_of_a_query_tells_no_picture_from_an_empty_one() -> None:
    """And words from picture, and where one ends and the next begins; the seed has no part in it."""
    queries = [
        Query("a", "b", Stimulus(), 0, TWO.schema()),
        Query("a", "b", Stimulus(), 0),
        Query("a", "b", Stimulus.of(b""), 0),
        Query("a", "b", Stimulus.of(b"-"), 0),
        Query("a", "b", Stimulus.of(b"+"), 0),
        Query("ab", "", Stimulus(), 0),
        Query("", "ab", Stimulus(), 0),
        Query("a", "b-", Stimulus(), 0),
        Query("b", "a", Stimulus(), 0),
        Query("a", "b", Stimulus(), 0, schema={"type": "object"}),
    ]
    assert len({query.sha256() for query in queries}) == len(queries)
    assert replace(queries[0], seed=5).sha256() == queries[0].sha256()


def test_the_digest_of_one_picture_is_that_of_0_1_0() -> None:
    """Whatever its camera is called; so the requests of old ledgers can be compared."""
    query = Query("You drive.", "Which?", Stimulus.of(b"picture"), 3, TWO.schema())
    assert query.sha256() == "4834713d43179aaf9026848a36280deaa35489b5c236c2b9320db5d82d8ddc18"
    assert replace(query, stimulus=Stimulus({"wrist": b"picture"})).sha256() == query.sha256()
    assert (
        Query("", "", Stimulus(), 3, {"type": "object"}).sha256()
        == "9e4d89ce3eae1dc8a28dcd8b854b9fc35fe0ec3d5013706579ee9393ee24ed4f"
    )


def test_the_digest_of_several_pictures_tells_them_apart() -> None:
    """By camera and order, and from one picture; the state has a part in it, what a prompt says only by its words."""
    images = [{"a": b"1", "b": b"2"}, {"a": b"2", "b": b"1"}, {"b": b"2", "a": b"1"}, {"a": b"1"}, {"a": b"12"}, {}]
    seen = [Stimulus(image) for image in images] + [
        Stimulus({}, {}, {"joints": (1.0,)}),
        Stimulus({}, {}, {"joints": (2.0,)}),
    ]
    assert len({Query("", "", stimulus, 0).sha256() for stimulus in seen}) == len(seen)
    assert Query("", "", Stimulus({}, {"speed": 5}), 0).sha256() == Query("", "", Stimulus(), 0).sha256()


def test_a_query_binds_the_form_of_its_answer_where_it_asks_for_no_action() -> None:
    """The schema is of any form; without one it is that of an action."""
    assert Query("", "", Stimulus(), 0, schema={"type": "array"}).schema == {"type": "array"}
    assert Query("", "", Stimulus(), 0).schema == ANY_ACTION


def test_no_reply_is_an_error_of_its_own_accord() -> None:
    """An empty Reply says nothing, and claims neither a token nor a second."""
    assert Reply() == Reply("", None, None, "", None, None, None)
    assert "exception" not in TRANSIENT


NOBODY = (float("nan"), float("inf"), -float("inf"), 1e308, -1, -1e-9, 2**63, 10**400)


@pytest.mark.parametrize("name", MOST)
@pytest.mark.parametrize("value", NOBODY)
def test_a_number_that_nobody_can_have_measured_is_not_reported(name: str, value: float) -> None:
    """Each number of a reply has a bound; the rest of the reply, and numbers at their bounds, stay."""
    assert bounded(replace(Reply("GO", served="m"), **{name: value})) == Reply("GO", served="m")
    for possible in (0, MOST[name], None):
        whole = replace(Reply("GO"), **{name: possible})
        assert bounded(whole) is whole


def test_every_number_of_a_reply_has_a_bound() -> None:
    """A field that is added later too."""
    assert {field.name for field in fields(Reply) if field.type in (int | None, float | None)} == MOST.keys()


def test_a_digest_binds_the_instants_before_and_their_order() -> None:
    """Pictures and state of each; the same instants in another order are another query."""
    one, other = Stimulus({"main": b"1"}), Stimulus({"main": b"2"}, {"gap": 3}, {"joints": (1.0,)})
    pasts = [(), (one,), (other,), (one, other), (other, one), (replace(other, state={"joints": (2.0,)}),)]
    queries = [Query("", "", replace(one, past=past), 0) for past in pasts]
    assert len({query.sha256() for query in queries}) == len(queries)
