"""Votes are read by rules of their own: the table of classes of replies, over HTTP, in a run and in a stack."""

import asyncio
import json
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from aiohttp import web
from hypothesis import given
from hypothesis import strategies as st

import voters
from banks import build_bank, draw
from eyechart.calls import Query, Reply
from eyechart.errors import GuardianError, VoteError
from eyechart.frames import Stimulus, encode
from eyechart.guardian import Guardian, interface_of
from eyechart.models import ADAPTERS, open_model
from eyechart.modes import RequestMode
from eyechart.prompts import PROMPTS, SCENE, close_m_of, scene_prompt
from eyechart.spaces.scene import HIGHWAY, SCENES, Estimate
from eyechart.studies import guardian as study
from eyechart.studies.guardian.reply_votes import LEAD_IN, VOTED, Unvoted
from reply_classes import CLOSE_M, OBJECTS, ROWS
from reply_classes import reply as row_reply

GAPS = st.none() | st.floats(min_value=0.0, max_value=1000.0)
ESTIMATES = st.builds(Estimate, GAPS, st.booleans(), st.booleans(), st.booleans(), st.floats(0.0, 1.0))
ANSWERS = {True: "hazard", False: "clear"}


def outcome(reply: Reply) -> str:
    """Return what a reply counts for, in the words of the table."""
    vote = study.read_vote(reply, CLOSE_M)
    return f"abstain: {vote.why}" if vote.hazard is None else ANSWERS[vote.hazard]


def test_the_table_has_every_reason_and_both_votes() -> None:
    """At least sixty classes of different names, and each reason that the rules know among them."""
    expected = {row.expected.removeprefix("abstain: ") for row in ROWS}
    assert len({row.name for row in ROWS}) == len(ROWS) >= 60
    assert {"clear", "hazard", *get_args(Unvoted)} <= expected
    assert sum(row.expected == "clear" for row in ROWS) >= 20


def outcomes(bodies: Sequence[object]) -> list[str]:
    """Return what replies with these bodies count for, read by the adapter from a server over HTTP."""
    left = iter(bodies)

    async def answer(request: web.Request) -> web.Response:
        await request.read()
        return web.json_response(next(left))

    async def ask() -> list[str]:
        app = web.Application()
        app.router.add_post("/v1/chat/completions", answer)
        runner = web.AppRunner(app, access_log=None)
        await runner.setup()
        await web.TCPSite(runner, "127.0.0.1", 0).start()
        url = f"http://127.0.0.1:{runner.addresses[0][1]}/v1"
        model = open_model("openai:m", RequestMode("openai:m", base_url=url, timeout_s=20.0))
        query = Query("", "what is there?", Stimulus.of(encode(draw(8.0, 3))), 1)
        result = [outcome(await model.answer(query)) for _ in bodies]
        await model.close()
        await runner.cleanup()
        return result

    return asyncio.run(ask())


def test_every_class_of_reply_has_the_outcome_that_was_written_before(monkeypatch: pytest.MonkeyPatch) -> None:
    """Read by the adapter from a server over HTTP, as a member of a guardian is."""
    monkeypatch.delenv("OPENAI_API_KEY", raising=False)
    found = outcomes([{"model": "m", "choices": [row.choice]} for row in ROWS])
    assert dict(zip((row.name for row in ROWS), found, strict=True)) == {row.name: row.expected for row in ROWS}


def said(*contents: object, ended: object = "stop", **more: object) -> dict[str, object]:
    """Return the body of a reply with a choice a content."""
    messages = [{"role": "assistant", "content": content, **more} for content in contents]
    return {"model": "m", "choices": [{"message": message, "finish_reason": ended} for message in messages]}


CLEAR, NEAR = OBJECTS["@clear"], OBJECTS["@hazard"]
TEXT = {"type": "text", "text": CLEAR}
ODD = {
    "an estimate in parts": (said([TEXT]), "clear"),
    "two choices that say the same": (said(CLEAR, CLEAR), "clear"),
    "an end that is an object": (said(CLEAR, ended={"type": "error"}), "abstain: ended"),
    "an end that is a number": (said(CLEAR, ended=3), "abstain: ended"),
    "an end that is false": (said(CLEAR, ended=False), "abstain: ended"),
    "an end that is a list": (said(CLEAR, ended=["stop"]), "abstain: ended"),
    "an end that is an empty object": (said(CLEAR, ended={}), "abstain: ended"),
    "a refusal that is an object": (said(CLEAR, refusal={"reason": "policy"}), "abstain: refused"),
    "a refusal that is true": (said(CLEAR, refusal=True), "abstain: refused"),
    "a refusal in parts": (said(CLEAR, refusal=[{"type": "text", "text": "I can't."}]), "abstain: refused"),
    "a part that refuses": (said([TEXT, {"type": "refusal", "refusal": "I can't."}]), "abstain: refused"),
    "a part that refuses without a word": (said([{"type": "refusal"}, TEXT]), "abstain: refused"),
    "a second choice that says otherwise": (said(CLEAR, NEAR), "abstain: ended"),
    "a mark that denies": (said(f"!{CLEAR}"), "abstain: words_around"),
    "a mark that denies, behind a label": (said(f"Answer: !{CLEAR}"), "abstain: words_around"),
    "a mark of exclamation behind a word": (said(f"Sure! {CLEAR}"), "clear"),
    "a second choice that says otherwise, near first": (said(NEAR, CLEAR), "abstain: ended"),
}
"""Bodies that no API describes, and what each counts for: what speaks against an estimate does so in any form."""


def test_what_speaks_against_an_estimate_does_so_in_any_form(monkeypatch: pytest.MonkeyPatch) -> None:
    """A finish reason or a refusal that is no text is one; choices that differ are no answer."""
    monkeypatch.delenv("OPENAI_API_KEY", raising=False)
    found = outcomes([body for body, _ in ODD.values()])
    assert dict(zip(ODD, found, strict=True)) == {name: expected for name, (_, expected) in ODD.items()}


@given(ESTIMATES, st.sampled_from(["stop", None]))
def test_an_estimate_alone_votes_what_close_says_or_contradicts_itself(found: Estimate, ended: str | None) -> None:
    """A clear vote never has a gap below the threshold, a hazard never one above it, and neither no confidence."""
    vote = study.read_vote(Reply(str(found), ended), CLOSE_M)
    near, far = ((gap := found.gap_m) is not None and gap < CLOSE_M), (gap is None or gap > CLOSE_M)
    fits = not (far if found.close else near) and found.confidence > 0
    assert vote.hazard == (found.close if fits else None)
    assert bool(vote.why) == (vote.hazard is None)


def test_what_the_reader_of_scenes_holds_against_a_reply_is_no_vote() -> None:
    """Although votes go on being read by the version of its rules that does not."""
    held = [row for row in ROWS if SCENES.read(row_reply(row)).why == "says_error"]
    assert {row.name for row in held} >= {"an error within", "denied within, in words"}
    assert all(VOTED.read(row_reply(row)).action is not None for row in held)
    assert [row.name for row in held if study.read_vote(row_reply(row), CLOSE_M).hazard is not None] == []


@given(st.text(max_size=40), st.text(max_size=40), st.sampled_from(sorted(OBJECTS)))
def test_nothing_stands_around_a_vote_but_words_of_the_list(before: str, after: str, sign: str) -> None:
    """Whatever stands before it is in the list, and behind it stands no word at all."""
    if study.read_vote(Reply(f"{before}{OBJECTS[sign]}{after}", "stop"), CLOSE_M).hazard is not None:
        visible = before.rpartition("</think>")[2].replace("\u2019", "'")
        assert set(re.findall(r"[^\W_]+(?:'[^\W_]+)?", visible.lower())) <= LEAD_IN | {"json"}
        assert not re.search(r"\w", after.replace("_", ""))


@given(word=st.text(alphabet=st.characters(categories=["L", "N", "So"]), min_size=1, max_size=12), behind=st.booleans())
def test_one_word_that_is_not_in_the_list_is_enough(word: str, *, behind: bool) -> None:
    """In any script and at any place, also beside harmless ones."""
    said = OBJECTS["@clear"]
    text = f"Here is the JSON: {said} {word}" if behind else f"Here is the {word} JSON: {said}"
    harmless = re.fullmatch(r"[a-zA-Z]+", word) and word.lower() in LEAD_IN and not behind
    assert study.read_vote(Reply(text, "stop"), CLOSE_M).hazard is (False if harmless else None)


def test_no_harmless_word_takes_anything_back() -> None:
    """The list has no negation, doubt, condition, quotation or refusal."""
    bad = (
        "no not never none n't if may might could would should maybe perhaps probably guess example sample wrong false"
    )
    bad += (
        " incorrect sorry unable cannot said says previous other another format placeholder template or but i this it"
    )
    assert not set(bad.split()) & LEAD_IN


def test_a_question_says_which_leads_are_close_and_another_prompt_does_not() -> None:
    """By the words that the models are told, of highway-env and of any other world."""
    assert close_m_of(SCENE) == HIGHWAY.close_m
    assert close_m_of(scene_prompt("a yard", replace(HIGHWAY, close_m=2.25), None)) == 2.25
    assert [close_m_of(prompt) for prompt in PROMPTS.values()] == [None] * len(PROMPTS)
    twice = replace(SCENE, user=f"{SCENE.user}\n{SCENE.user}")
    assert close_m_of(twice) is None


@pytest.fixture
def classes(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Return a class of every outcome that a callable can have, and make ``voter:class N`` a SPEC."""
    monkeypatch.setitem(ADAPTERS, "voter", "voters")
    first = {row.expected: number for number, row in enumerate(ROWS) if not row.more}
    return sorted(first.values())


def test_a_run_and_a_stack_read_the_same_votes(classes: list[int], tmp_path: Path) -> None:
    """Of every outcome a member: what a run's votes are scored by is what the stack says of its pictures."""
    bank = build_bank(tmp_path / "bank", scenarios=("merge",), episodes=2, steps=2, drawn=False)
    table = voters.ask_all(bank.root, tuple(f"class {number}" for number in classes), tmp_path / "run")
    assert table.about.voting == study.VOTE_READER
    picture = encode(draw(8.0, 3))
    for number in classes:
        row, name = ROWS[number], f"voter:class {number}"
        place, why = table.models.index(name), row.expected.removeprefix("abstain: ")
        voted = {"hazard": 1, "clear": 0}.get(why, -1)
        assert np.unique(table.votes[place]).tolist() == [voted], row.name
        assert table.reasons(name) == ({why: 8} if voted < 0 else {})
        frozen = study.FrozenGuardian((name,), 1, "two_way", table.about.only((name,)), None, "chosen")
        study.write_frozen(tmp_path / "guardian.json", frozen)
        with Guardian.load(tmp_path / "guardian.json", deadline_s=20.0) as guardian:
            found = guardian.assess(picture)
        assert found.answer == ("abstain" if voted < 0 else why), row.name
        assert all(reason.startswith(f"no vote: {why}") for reason in found.missing.values())


def test_a_guardian_knows_the_rules_that_it_was_chosen_under(classes: list[int], tmp_path: Path) -> None:
    """Other rules are refused by name; one of 0.1.0, which knew none, is served, and its score warns."""
    bank = build_bank(tmp_path / "bank", scenarios=("merge",), episodes=3, steps=6, drawn=False)
    del classes
    table = voters.ask_all(bank.root, ("sees", "looks"), tmp_path / "run")
    path, frozen = tmp_path / "guardian.json", study.fit(table.rows(range(6)))
    assert json.loads(json.dumps(frozen.as_dict()))["voting"] == study.VOTE_READER
    study.write_frozen(path, replace(frozen, about=replace(frozen.about, voting=99)))
    assert study.read_frozen(path).about.voting == 99
    with pytest.raises(GuardianError, match="the rules for votes differ"):
        Guardian.load(path)
    with pytest.raises(GuardianError, match="the rules for votes differ"):
        study.score(study.read_frozen(path), table.rows(range(6, 18)))
    old = replace(frozen, about=replace(frozen.about, voting=None), made_by="0.1.0")
    assert "voting" not in old.as_dict()
    assert any("0.1.0 chose this guardian" in line for line in study.score(old, table.rows(range(6, 18))).warnings)
    study.write_frozen(path, replace(frozen, about=replace(frozen.about, voting=None)))
    with Guardian.load(path, deadline_s=20.0) as guardian:
        assert guardian.assess(encode(draw(8.0, 3))).answer == "hazard"
    with pytest.raises(VoteError, match="the voting of"):
        study.join([table, replace(table, models=("a", "b"), about=replace(table.about, voting=99))])


def test_a_prompt_that_names_no_distance_gives_no_votes() -> None:
    """Nothing could be held against a reply's own gap."""
    wording = replace(SCENE, user="What do you see?")
    about = study.VoteProvenance(prompt=wording.key, view="none", wording=wording, axis="vertical")
    with pytest.raises(GuardianError, match="does not say which leads are close"):
        interface_of(study.FrozenGuardian(("a",), 1, "two_way", about, None))


def test_the_study_that_measures_reads_as_it_did() -> None:
    """What is no vote is an estimate all the same: words around it, two that agree, and a gap against close."""
    torn = replace(SCENES.read(Reply(OBJECTS["@hazard"], "stop")).action, close=False)  # type: ignore[type-var]
    for text in (f"This is NOT true: {OBJECTS['@clear']}", OBJECTS["@clear"] * 2, str(torn)):
        assert SCENES.read(Reply(text, "stop")).action is not None
        assert study.read_vote(Reply(text, "stop"), CLOSE_M).hazard is None
