"""The open part of the corpus of numbers, letters and phrases: nothing is read that no reader reads, and most is."""

import pytest

from marked_replies import SETS, SPACES, counted, marked
from mutated_replies import count_wrong


@pytest.mark.parametrize("kind", SETS)
def test_nothing_is_read_that_a_reader_of_marks_does_not_read(kind: str) -> None:
    """Precision 1.000; where the readers differ, an answer that is neither's is wrong."""
    found = ((one, one.read) for one in marked("open", kind))
    assert [(one, action) for one, action in found if one.is_wrong(action)] == []


@pytest.mark.parametrize("kind", SETS)
def test_what_both_readers_of_marks_read_is_read(kind: str) -> None:
    """At least .95 of the replies where both chose the same action."""
    agreed = [one for one in marked("open", kind) if one.agreed]
    missed = [one.text for one in agreed if one.read is None]
    assert 1 - len(missed) / len(agreed) >= 0.95, missed


@pytest.mark.parametrize("kind", SETS)
def test_each_kind_of_marks_has_replies_enough(kind: str) -> None:
    """At least 150, of which a third to a half is kept, each once, and with the names of its own space."""
    kept = [*marked("kept", kind), *marked("second", kind)]
    both = [*marked("open", kind), *kept]
    assert len(both) >= 150
    assert 0.3 < len(kept) / len(both) < 0.5
    assert len({(one.space, one.text) for one in both}) == len(both)
    assert all({one.first, one.second} <= {None, *SPACES[one.space].actions} for one in both)


def test_the_counts_of_marks_are_of_both_readers() -> None:
    """What the kept part was counted by."""
    found = counted(marked("open", "numbers"))
    assert (found["replies"], found["both agree"], found["wrong"], found["precision"]) == (264, 263, 0, 1.0)
    assert found["both choose the same action"] == 149


def test_no_mutated_reply_of_marks_raises_or_is_read_in_two_ways() -> None:
    """Provenance from the open part by cuts, joins, repetitions and strange signs."""
    corpus = tuple(one for kind in SETS for one in marked("open", kind))
    assert list(count_wrong(corpus, range(500), SPACES)) == []
