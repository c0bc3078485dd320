from collections import Counter
from functools import cache

import pytest

from eyechart.frames import decode
from eyechart.probe.pictures import CHOICES, DEAL, Question, questions, road, words
from seeing import colour, count, side

LOOKS = {"colour": colour, "side": side, "count": count}


@cache
def every() -> list[Question]:
    """Return the questions of sixteen seeds, whose pictures are drawn once, and not while tests are collected."""
    return [question for seed in range(16) for question in questions(seed)]


@pytest.mark.parametrize("kind", CHOICES)
def test_the_picture_shows_the_answer(kind: str) -> None:
    """Another program reads it off the pixels, whatever was drawn by chance around it."""
    mine = [question for question in every() if question.kind == kind]
    assert [LOOKS[kind](decode(question.picture, "it")) for question in mine] == [question.answer for question in mine]
    assert {question.answer for question in mine} == set(CHOICES[kind])


def test_a_deal_repeats_no_answer_and_no_picture() -> None:
    """So that one answer to all questions of a kind is right once at most."""
    for seed in range(16):
        dealt = every()[14 * seed : 14 * seed + 14]
        assert Counter(question.kind for question in dealt) == {kind: sum(counts) for kind, counts in DEAL.items()}
        assert (
            len({(question.kind, question.answer) for question in dealt})
            == len({question.picture for question in dealt})
            == len(dealt)
        )


def test_answers_are_dealt_evenly() -> None:
    """Over 16 seeds no colour is left out or always there: each is expected in 12 deals."""
    counts = Counter(question.answer for question in every() if question.kind == "colour")
    assert min(counts.values()) >= 6
    assert max(counts.values()) <= 15


def test_some_questions_come_in_the_same_words_and_others_in_words_never_sent() -> None:
    """The words say what may be answered, in an order that does not depend on the answer, and never the answer."""
    same = {(question.kind, question.words) for question in every() if not question.fresh}
    assert same == {(kind, words(kind)) for kind in CHOICES}
    fresh = [question.words for question in every() if question.fresh]
    assert len(set(fresh)) == len(fresh)
    assert all(question.words.endswith(words(question.kind)) for question in every())


def test_a_seed_gives_the_same_questions_again() -> None:
    """And another one others; the first is always of a colour in the same words, for the repeats."""
    assert questions(3) == questions(3)
    assert questions(3) != questions(4)
    firsts: list[Question] = [questions(seed)[0] for seed in range(5)]
    assert {(question.kind, question.fresh) for question in firsts} == {("colour", False)}
    assert decode(road(0), "a road").shape == (150, 600, 3)
    assert road(0) == road(0) != road(1)
