"""Values are compared key by key, and a list says which differences are on purpose."""

from pathlib import Path

import pytest

from by_key import Difference, Expected, differences, read_expected, unexpected


def test_equal_values_have_no_differences() -> None:
    """NaN equals NaN, and the order of keys does not count."""
    assert not list(differences({"a": [1, float("nan")], "b": None}, {"b": None, "a": [1, float("nan")]}))


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ({"a": {"p": 0.1}}, {"a": {"p": 0.1 + 1e-17}}, "a > p: changed, 0.1 → 0.10000000000000002"),
        ({"a": 1}, {"a": 1.0}, "a: changed, 1 → 1.0"),
        ({"a": 1}, {"a": True}, "a: changed, 1 → True"),
        ({"a": None}, {}, "a: removed, None → None"),
        ({}, {"a": 3}, "a: added, None → 3"),
        ([1, 2], [1, 3], "1: changed, 2 → 3"),
        ([1, 2], [1], "all: changed, [1, 2] → [1]"),
        (["a", "b"], ["a", "c", "b"], "c: added, None → 'c'"),
        (
            [{"policy": "x", "condition": "real", "n": 1}],
            [{"policy": "x", "condition": "blank", "n": 5}, {"policy": "x", "condition": "real", "n": 2}],
            "x real > n: changed, 1 → 2",
        ),
        (
            [{"policy": "x"}],
            [{"policy": "x"}, {"policy": "x"}],
            "all: changed, [{'policy': 'x'}] → [{'policy': 'x'}, {'policy': 'x'}]",
        ),
    ],
)
def test_a_difference_is_named_by_its_key(old: object, new: object, line: str) -> None:
    """The last bit of a number counts, and so does its kind."""
    assert line in [str(difference) for difference in differences(old, new)]
    assert len(list(differences(old, new))) == 1 + line.startswith("x real")


def test_floats_may_be_held_equal_within_a_share() -> None:
    """Anywhere in the value; whole numbers and kinds stay exact."""
    old, new = {"a": [5 / 9, 1e-17, 3]}, {"a": [5 / 9 + 2e-16, 0.0, 3]}
    assert [difference.key for difference in differences(old, new)] == [("a", "0"), ("a", "1")]
    assert not list(differences(old, new, within=1e-12))
    assert list(differences({"a": 0.5}, {"a": 0.5 + 1e-11}, within=1e-12))
    assert list(differences({"a": 3}, {"a": 3.0}, within=1e-12))
    assert list(differences({"a": 10**15}, {"a": 10**15 + 1}, within=1e-12))


def test_a_listed_difference_is_expected_at_its_key_and_of_its_kind_only() -> None:
    """A pattern stands for one part of a key."""
    listed = [Expected("score-*", ("models", "*", "level"), "added", "a statistic carries its level")]
    level = Difference(("models", "scripted:depth", "level"), "added", new=0.95)
    assert not unexpected("score-battery", [level], listed)
    assert unexpected("costs-battery", [level], listed)
    assert unexpected("score-battery", [Difference(("models", "level"), "added")], listed)
    assert unexpected("score-battery", [Difference(level.key, "changed", 0.9, 0.95)], listed)


def test_a_group_is_read_line_by_line(tmp_path: Path) -> None:
    """A line is the answer's name and the key, of the kind under which it stands."""
    path = tmp_path / "differences.toml"
    path.write_text('[[difference]]\nreason = "why"\nadded = ["score-*: models > * > level"]\nchanged = ["a: b"]\n')
    assert read_expected(path) == [
        Expected("score-*", ("models", "*", "level"), "added", "why"),
        Expected("a", ("b",), "changed", "why"),
    ]


@pytest.mark.parametrize(
    "words", ['reason = " "\nadded = ["a: b"]', 'reason = "why"', 'reason = "why"\nother = ["a: b"]']
)
def test_a_difference_without_a_reason_is_refused(tmp_path: Path, words: str) -> None:
    """So is one of an unknown kind, and a reason for nothing."""
    path = tmp_path / "differences.toml"
    path.write_text(f"[[difference]]\n{words}\n")
    with pytest.raises(ValueError, match="needs a reason, and lines of what is added, removed, changed"):
        read_expected(path)
