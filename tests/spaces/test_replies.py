"""The corpus of replies: what is read is what a reader reads, and nothing is read that nobody chose.

`replies.jsonl` holds 690 replies as models write them, in seven action spaces. They were written, and labelled in two
passes over shuffled texts, before the rules of reading were looked at; both passes are by one author. Where the
passes differ, neither label counts as what the reply says, and reading it as an action is wrong. A third of the corpus,
by the hash of the text, was held back until the rules were done: they were then right about 151 of the 154 replies that
they read an action in, and read 151 of the 158 that hold one; the rules were mended by what they missed.

`hard_replies.jsonl` holds 826 more, most of which choose nothing and are worded as if they did. They were labelled in
one pass: a first round before the rules were looked at, two more after the rules had been mended by the round before.
At first sight of the three the rules read an action that nobody chose in 43, 51 and 18 of them; eight labels were
corrected afterwards, where the same wording is read otherwise in the first file.
"""

from pathlib import Path

import pytest

from eyechart.calls import Reply
from eyechart.errors import SpecError
from eyechart.spaces.discrete import DRIVING, Discrete, read_space
from eyechart.spaces.reader import READER
from eyechart.spaces.space import Decision
from mutated_replies import PARTS, SPACES, count_wrong, read_corpus

CORPUS = read_corpus()
ALIASED = Discrete(
    "bay", ("HALT", "ROLL", "PORT"), (), ("HALT",), ("ROLL",), (("BRAKE", "HALT"), ("TURN LEFT", "PORT"))
)


def read(space: Discrete, text: str) -> str | None:
    """Return the action that is read in a reply, None where there is none."""
    return space.read(Reply(text, "stop", None)).action


@pytest.mark.parametrize("part", PARTS)
def test_nothing_is_read_that_a_reader_does_not_read(part: str) -> None:
    """Precision 1.000: whatever is read as an action, both passes read as that action."""
    otherwise = [
        (one.text, found, one.first, one.second)
        for one in CORPUS
        if one.part == part and (found := read(SPACES[one.space], one.text)) is not None
        if {found} != {one.first, one.second}
    ]
    assert otherwise == []


@pytest.mark.parametrize("part", PARTS)
def test_what_both_passes_read_is_read(part: str) -> None:
    """Recall of at least .97 where both passes read the same action, of .96 where replies are hard."""
    agreed = [one for one in CORPUS if one.part == part and one.first is not None and one.first == one.second]
    missed = [one.text for one in agreed if read(SPACES[one.space], one.text) is None]
    assert len(agreed) > 150
    assert 1 - len(missed) / len(agreed) >= (0.96 if part == "hard" else 0.97), missed


def test_the_corpus_is_large_and_both_of_its_parts_are() -> None:
    """At least 300 replies, of which a third was held back, in several spaces and of several answers."""
    assert len({(one.space, one.text) for one in CORPUS}) == len(CORPUS) >= 300
    seen, held, hard = (sum(one.part == part for one in CORPUS) for part in PARTS)
    assert 0.3 < held / (seen + held) < 0.37
    assert hard > 800
    assert {one.space for one in CORPUS} == set(SPACES)
    assert sum(one.first is None for one in CORPUS) > 150


def test_no_mutated_reply_raises_or_is_read_in_two_ways() -> None:
    """Provenance from the corpus by cuts, joins, repetitions and strange signs; `make long-replies` makes a million."""
    assert list(count_wrong(CORPUS, range(1000))) == []


@pytest.mark.parametrize(
    "text", ["Brake", "BRAKE", "brake hard.", "ACTION: BRAKE", '{"action": "BRAKE"}', "I would brake."]
)
def test_a_word_that_the_space_does_not_name_is_no_action(text: str) -> None:
    """STOP and SLOW both brake: which of them was meant, nobody can say; where a space declares it, it is read."""
    assert read(DRIVING, text) is None
    assert read(ALIASED, text) == "HALT"


@pytest.mark.parametrize("text", ["turn left", "TURN_LEFT", "Action: turn-left", "I choose TURN LEFT, not ROLL."])
def test_an_alias_is_read_like_a_name(text: str) -> None:
    """In any of the ways in which a name may be written."""
    assert read(ALIASED, text) == "PORT"


def test_an_alias_never_says_more_than_the_action_it_stands_for() -> None:
    """The action is read, in a list with another one neither."""
    assert read(ALIASED, "HALT, that is BRAKE") == "HALT"
    assert read(ALIASED, "BRAKE or ROLL") is None
    assert read(ALIASED, "not BRAKE") is None


def test_aliases_stand_in_the_file_of_a_space(tmp_path: Path) -> None:
    """As a table of name and action; what a bank's manifest holds gives them back."""
    file = tmp_path / "bay.toml"
    file.write_text('actions = ["HALT", "ROLL"]\n[aliases]\nBRAKE = "HALT"\n"GO ON" = "ROLL"\n', encoding="utf-8")
    space = read_space(file)
    assert space.aliases == (("BRAKE", "HALT"), ("GO ON", "ROLL"))
    assert Discrete.from_dict(space.as_dict()) == space
    assert read(space, "go on") == "ROLL"
    assert "aliases" not in DRIVING.as_dict()


@pytest.mark.parametrize(
    ("aliases", "named"),
    [
        ((("BRAKE", "SLOW"),), "aliases names 'SLOW'"),
        ((("halt", "HALT"),), "the alias 'halt' is an action's name, or given twice"),
        ((("GO-ON", "ROLL"), ("go on", "HALT")), "the alias 'go on' is an action's name, or given twice"),
        ((("!", "HALT"),), "'!' cannot be read from a reply"),
        ((("UNPARSED", "HALT"),), "'UNPARSED' cannot be read from a reply"),
    ],
)
def test_an_alias_that_could_mean_two_things_is_refused(aliases: tuple[tuple[str, str], ...], named: str) -> None:
    """By name, before anything is read."""
    with pytest.raises(SpecError, match="action space 'bay'") as refused:
        Discrete("bay", ("HALT", "ROLL"), (), (), (), aliases)
    assert named in str(refused.value)


def test_a_space_read_by_version_3_reads_as_it_did() -> None:
    """A run of an older eyechart keeps the rules that it was begun under, right or wrong."""
    before = DRIVING.by(3)
    assert (before.reader, DRIVING.reader, DRIVING.by(99).reader) == (3, READER, READER)
    assert before == DRIVING
    reply = Reply("The left lane is clear.", "stop", None)
    assert before.read(reply) == Decision("LEFT")
    assert DRIVING.read(reply) == Decision(None, "unparsed", "not_chosen")
    negated = Reply("STOP. I would not go LEFT.", "stop", None)
    assert (before.read(negated).action, DRIVING.read(negated).action) == (None, "STOP")


@pytest.mark.parametrize(
    ("text", "missing"),
    [
        ('Please provide the image so that I can answer like {"action": "STOP"}', "refused"),
        ('Could you upload the picture? Then I can reply with {"action": "STOP"}', "refused"),
        ('If you can, please kindly attach a camera frame. {"action": "SLOW"}', "refused"),
        ('{"action": "STOP"}\n\nPlease send the next frame.', None),
        ("STOP. Please provide the next image when it is there.", None),
        ('Looking at the image you provided, {"action": "STRAIGHT"}', None),
        ('The frame shows a car that will share the lane. {"action": "SLOW"}', None),
    ],
)
def test_who_asks_for_a_picture_has_seen_none(text: str, missing: str | None) -> None:
    """What stands beside that is how it would answer; an answer before it asks for the next one stays."""
    assert DRIVING.read(Reply(text, "stop", None)).missing == missing
