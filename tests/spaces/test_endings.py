"""How a reply ended is read from its finish reason, whatever the server's word and letters for it."""

import pytest

from eyechart.calls import Emptiness, Reply, answer_from_reasoning, is_empty
from eyechart.spaces.discrete import DRIVING
from eyechart.spaces.scene import SCENES
from eyechart.spaces.space import ENDINGS, ending

SCENE = '{"lead_gap_m": 20, "close": false, "left_clear": true, "right_clear": true, "confidence": 0.9}'
CUT = ["length", "max_tokens", "MAX_TOKENS", "model_length", "max_output_tokens", "LENGTH", "error", "abort"]
FILTERED = ["content_filter", "content-filter", "refusal", "SAFETY", "FINISH_REASON_RECITATION", "guardrail_intervened"]


@pytest.mark.parametrize(
    ("words", "missing"), [(CUT, "truncated"), (FILTERED, "refused"), (["stop", "STOP", "eos", "end_turn", None], None)]
)
def test_what_was_cut_off_or_filtered_holds_no_decision(words: list[str | None], missing: str | None) -> None:
    """A part of an answer is none, in every space."""
    for word in words:
        assert DRIVING.read(Reply("STOP", word)).missing == missing, word
        assert SCENES.read(Reply(SCENE, word)).missing == missing, word


def test_a_word_that_is_not_known_is_no_ending() -> None:
    """It may be anything."""
    assert {ending(word) for word in (None, "", "tool_calls", "OTHER", "pause_turn")} == {None}
    assert all(word == word.lower().replace("-", "_") for word in ENDINGS)


def test_reasoning_is_concluded_where_a_reply_ended_by_itself() -> None:
    """By any word for that; what was cut off while it thought has no end."""
    for word in ("stop", "eos", "STOP", None):
        assert answer_from_reasoning(Reply("", word, reasoning="so\nSLOW")).text == "SLOW", word
    for word in ("max_tokens", "SAFETY", "OTHER"):
        assert answer_from_reasoning(Reply("", word, reasoning="so\nSLOW")).text == "", word


def test_replies_that_were_all_cut_off_before_a_word_say_so() -> None:
    """They are not the empty replies of a server that takes the answer for thinking."""
    cut = Reply("", "length", reasoning="Let me")
    assert not is_empty(cut)
    found = Emptiness.of([cut, cut, Reply("", "MAX_TOKENS")])
    assert found.is_whole
    assert found.words == (
        "all 3 replies are empty: 3 were cut off before their first word, 2 of them while the model reasoned; raise "
        "--max-tokens, or switch thinking off"
    )
    assert not Emptiness.of([cut, Reply("STOP", "stop")]).is_whole
    assert Emptiness.of([cut, Reply("", "stop")]).is_whole
    assert Emptiness.of([Reply("", "stop")] * 2).words.startswith("all 2 replies are empty: the server's log")
