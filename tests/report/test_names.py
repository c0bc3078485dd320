"""Names on a screen: long ones are shortened in the middle, and none looks like another."""

from hypothesis import given
from hypothesis import strategies as st

from eyechart.report.short_names import LONGEST, shorten, shortener

LONG = st.text("ab/", min_size=LONGEST + 1, max_size=3 * LONGEST)


@given(st.lists(st.one_of(LONG, st.text("ab…#2", max_size=LONGEST)), max_size=12), st.sampled_from((24, LONGEST)))
def test_no_two_names_look_alike_and_none_is_long(names: list[str], longest: int) -> None:
    """Whatever the names: each keeps a form of its own, of bounded length, and a short one is left as it is."""
    made = shorten(names, longest)
    assert set(made) == set(names)
    assert len(set(made.values())) == len(made)
    assert all(len(short) <= longest for short in made.values())
    assert all(short == name for name, short in made.items() if len(name) <= longest)


def test_names_that_differ_only_in_the_middle_show_where() -> None:
    """A reader sees which is which; beginning and end stay."""
    one, two = (f"openai:{'a/' * 25}{size}-instruct{'/b' * 25}/final" for size in ("7B", "72B"))
    made = shorten([one, two])
    assert "7B" in made[one]
    assert "72B" in made[two]
    assert all(short.startswith("openai:a/a") and short.endswith("/b/final") for short in made.values())


def test_a_name_that_begins_another_is_not_taken_for_it() -> None:
    """In a text both are shortened, each to its own form."""
    one = "openai:" + "x" * 60
    names = [one, one + "-long"]
    short, made = shortener(names), shorten(names)
    assert short(f"{names[1]} and {names[0]}.") == f"{made[names[1]]} and {made[names[0]]}."
