"""Shapley values: additive parts keep their own, and what two are worth only together is halved between them."""

from itertools import permutations, product

import numpy as np
import pytest

from eyechart.stats.total_effect import shapley_values, squared_distance, subsets

NAMES = ("cameras", "state", "instruction")
SIGNS = np.array(list(product((-1.0, 1.0), repeat=3)))


def worths(answer: object) -> dict[frozenset[str], np.ndarray]:
    """Return half squared distances over all pairs of worlds of three signs, with each subset exchanged."""
    own, other = (np.array(pair) for pair in zip(*product(SIGNS, SIGNS), strict=True))
    result = {}
    for some in subsets(NAMES):
        mixed = np.where([name in some for name in NAMES], other, own)
        result[some] = squared_distance(*(np.array([[answer(*one)] for one in each])[None] for each in (own, mixed)))
    return result


def test_an_addition_and_an_interaction_are_divided_as_by_hand() -> None:
    """Of x + y z over independent signs: of the variance 2, x has 1, and y and z have half of the other 1 each."""
    found = shapley_values(worths(lambda x, y, z: x + y * z))
    assert {name: values.mean() for name, values in found.items()} == pytest.approx(
        {"cameras": 1.0, "state": 0.5, "instruction": 0.5}
    )


def test_additive_parts_keep_their_own_and_a_part_unused_has_none() -> None:
    """Of 3 x + y: 9 and 1, and nothing for z."""
    found = shapley_values(worths(lambda x, y, z: 3 * x + y + 0 * z))
    assert {name: values.mean() for name, values in found.items()} == pytest.approx(
        {"cameras": 9.0, "state": 1.0, "instruction": 0.0}
    )


def test_it_is_the_mean_over_all_orders_and_adds_up() -> None:
    """Of any worth whatever: the mean of what a part adds when it comes, over all orders of the parts."""
    rng = np.random.default_rng(3)
    worth = {some: rng.normal(size=5) for some in subsets(("a", "b", "c", "d"))}
    found = shapley_values(worth)
    orders = list(permutations("abcd"))
    for name, values in found.items():
        before = [frozenset(order[: order.index(name)]) for order in orders]
        assert values == pytest.approx(np.mean([worth[some | {name}] - worth[some] for some in before], axis=0))
    assert sum(found.values()) == pytest.approx(worth[frozenset("abcd")] - worth[frozenset()])


def test_a_missing_subset_is_named() -> None:
    """Nothing is guessed of a subset that nobody asked."""
    with pytest.raises(ValueError, match=r"\['a', 'b'\]"):
        shapley_values({frozenset(): 0.0, frozenset("a"): 1.0, frozenset("b"): 1.0})


def test_what_is_right_or_wrong_has_a_worth() -> None:
    """Two parts that are right only together, as truth values: half each."""
    found = shapley_values({frozenset(some): set(some) == {"a", "b"} for some in ("", "a", "b", "ab")})
    assert {name: float(one) for name, one in found.items()} == {"a": 0.5, "b": 0.5}
