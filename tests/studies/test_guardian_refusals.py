"""What a guardian is refused for, word for word, and where it is not: each difference alone, and at its limits."""

import hashlib
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from banks import build_bank
from eyechart.errors import GuardianError, OutputError
from eyechart.modes import RequestMode
from eyechart.studies import guardian as study
from eyechart.studies.guardian.frozen import Selection, require_own, shared_frames
from published_votes import GEMMA, QWEN, published

Change = Callable[[study.VoteProvenance], study.VoteProvenance]


@pytest.fixture(scope="module")
def table() -> study.VoteTable:
    """Return the votes with the paper's counts."""
    return published()


@pytest.fixture(scope="module")
def frozen(table: study.VoteTable) -> study.FrozenGuardian:
    """Return the guardian that the 16 calibration frames choose."""
    return study.fit(table.part("calibration"))


def refused(call: Callable[[], object], error: type[Exception] = GuardianError) -> str:
    """Return what a refusal says."""
    with pytest.raises(error) as raised:
        call()
    return str(raised.value)


ASKED = RequestMode(spec=QWEN, base_url="http://127.0.0.1:1")
LONG = f"'{'f' * 24}…'"
DIFFERENCES: dict[str, tuple[str, str, Change]] = {
    f"'{'0' * 24}'": ("bank", LONG, lambda about: replace(about, bank="0" * 24)),
    f"'{'0' * 24}…'": ("bank", LONG, lambda about: replace(about, bank="0" * 25)),
    "none recorded": ("bank", LONG, lambda about: replace(about, bank="")),
    "'another'": ("prompt", "'prompt-digest'", lambda about: replace(about, prompt="another")),
    "'a view'": ("view", "'view-digest'", lambda about: replace(about, view="a view")),
    "'2'": ("reader", "none recorded", lambda about: replace(about, reader=2)),
}
"""What is said of the votes, by what of them is another, what the guardian has, and the change."""

VERSIONS: dict[str, tuple[str, Change]] = {
    "'digest-2'": (QWEN, lambda about: replace(about, versions={**about.versions, QWEN: "digest-2"})),
    "'digest-1 served as gemma…'": (GEMMA, lambda about: replace(about, served={GEMMA: "gemma-next"})),
    "none recorded": (GEMMA, lambda about: replace(about, versions={})),
}
"""Likewise of the models' versions."""


@pytest.mark.parametrize("what", DIFFERENCES)
def test_votes_that_came_about_otherwise_are_refused_by_name(
    table: study.VoteTable, frozen: study.FrozenGuardian, what: str
) -> None:
    """Another bank, prompt, view or reader: each said by name, and both sides of it."""
    name, mine, change = DIFFERENCES[what]
    other = replace(table.part("score"), about=change(table.about))
    assert refused(lambda: frozen.may_score(other)) == (
        f"the {name} differs: this guardian was chosen with {mine}, votes.csv is of {what}; "
        f"choose a guardian for this {name} with 'eyechart guardian fit'"
    )


@pytest.mark.parametrize("what", VERSIONS)
def test_votes_of_another_version_of_a_model_are_refused(
    table: study.VoteTable, frozen: study.FrozenGuardian, what: str
) -> None:
    """By its digest, or by what its replies name as their model."""
    model, change = VERSIONS[what]
    other = replace(table.part("score"), about=change(table.about))
    assert refused(lambda: frozen.may_score(other)) == (
        f"the model '{model}' differs: this guardian was chosen with version 'digest-1', votes.csv has votes of "
        f"{what}; choose a guardian for this version with 'eyechart guardian fit'"
    )


def test_what_a_guardian_does_not_read_may_differ(table: study.VoteTable, frozen: study.FrozenGuardian) -> None:
    """A model of no committee, and the name of the bank; a mode where one side knows none."""
    about = table.about
    for other in (
        replace(about, bank_name="another"),
        replace(about, versions={**about.versions, "Ministral3-8B": "digest-2"}),
        replace(about, modes={QWEN: ASKED}),
    ):
        frozen.may_score(replace(table.part("score"), about=other))


def test_a_model_that_was_asked_otherwise_is_refused_and_one_that_was_asked_elsewhere_is_not(
    table: study.VoteTable, frozen: study.FrozenGuardian
) -> None:
    """By its mode: another budget is another model, another address is the same."""
    knows = replace(frozen, about=replace(frozen.about, modes={QWEN: ASKED}))

    def asked(mode: RequestMode) -> study.VoteTable:
        return replace(table.part("score"), about=replace(table.about, modes={QWEN: mode}))

    knows.may_score(asked(replace(ASKED, base_url="http://127.0.0.1:2")))
    assert refused(lambda: knows.may_score(asked(replace(ASKED, max_tokens=7)))) == (
        f"the mode of '{QWEN}' differs: votes.csv has votes from other requests than those that chose this "
        "guardian; choose a guardian for this mode with 'eyechart guardian fit'"
    )


@pytest.mark.parametrize(
    ("mine", "theirs", "fits"), [(1, 1, True), (1, 2, False), (None, 2, True), (1, None, True), (None, None, True)]
)
def test_what_counts_as_a_vote_must_be_the_same_where_both_say(
    table: study.VoteTable, frozen: study.FrozenGuardian, mine: int | None, theirs: int | None, *, fits: bool
) -> None:
    """Version 0.1.0 did not write it, so that its guardians and votes fit any."""
    chosen = replace(frozen, about=replace(frozen.about, voting=mine))
    votes = replace(table.part("score"), about=replace(table.about, voting=theirs))
    if fits:
        chosen.may_score(votes)
    else:
        assert refused(lambda: chosen.may_score(votes)) == (
            "the rules for votes differ: this guardian was chosen under version 1, votes.csv is read under version 2; "
            "choose a guardian with 'eyechart guardian fit'"
        )


def test_frames_that_chose_it_are_named(table: study.VoteTable, frozen: study.FrozenGuardian) -> None:
    """By their names, their pictures, or their names in another spelling; all are left out of what it never saw."""
    assert refused(lambda: frozen.may_score(table)) == (
        "frame 'f272' is one of 16 in votes.csv that chose this guardian; a score on them says nothing: leave them out "
        "with --unseen"
    )
    one = table.part("score").keep(("f000", "f001"))
    assert frozen.selection is not None
    pictures = tuple(f"digest of {frame}" for frame in frozen.selection.frames)
    seeing = replace(frozen, selection=_with_pictures(frozen.selection, pictures))
    same = replace(one, pictures=("digest of f273", "another"))
    assert refused(lambda: seeing.may_score(same)) == (
        "frame 'f000' in votes.csv shows the very picture of 'f273', which chose this guardian; a score on it says "
        "nothing: leave it out with --unseen"
    )
    assert seeing.unseen(same).frames == ("f001",)
    spelt = replace(one, frames=("f000", "./F274.PNG"))
    assert refused(lambda: frozen.may_score(spelt)) == (
        "frame './F274.PNG' in votes.csv has the name of 'f274', which chose this guardian, but for its spelling or "
        "its ending; a score on it says nothing: leave it out with --unseen"
    )
    assert list(shared_frames(spelt, frozen.selection.frames, ())) == [("./F274.PNG", "f274", "has the name of")]
    assert frozen.unseen(spelt).frames == ("f000",)
    assert frozen.exported().unseen(spelt) is spelt
    assert frozen.exported().left_out(spelt) == {}
    assert frozen.left_out(table) == {"chose this guardian": 16}
    both = replace(table, frames=("f000", "f1", "F274.png", *table.frames[3:]), pictures=("digest of f273",) * 288)
    assert list(seeing.left_out(both).items()) == [
        ("chose this guardian", 16),
        ("show the very picture of one that did", 272),
    ]
    other = replace(both, pictures=None)
    assert list(frozen.left_out(other).items()) == [
        ("chose this guardian", 16),
        ("have the name of one that did, but for its spelling or its ending", 1),
    ]
    assert refused(lambda: frozen.exported().may_score(one)) == (
        "an exported guardian does not hold the frames that chose it, so it cannot score: give the guardian.json that "
        "it was made of"
    )


def _with_pictures(chosen: Selection, pictures: tuple[str, ...]) -> Selection:
    return type(chosen)(**{name: getattr(chosen, name) for name in chosen.__struct_fields__} | {"pictures": pictures})


def test_a_guardian_overwrites_itself_and_no_other(frozen: study.FrozenGuardian, tmp_path: Path) -> None:
    """Nothing there, an empty file, and the same guardian may be written over; what is no guardian may not."""
    out = tmp_path / "guardian.json"
    require_own(out, frozen)
    out.touch()
    require_own(out, frozen)
    study.write_frozen(out, frozen)
    require_own(out, frozen)
    words = f"{out} holds another guardian, and is not overwritten: choose another place, or remove it"
    assert refused(lambda: require_own(out, replace(frozen, threshold=3)), OutputError) == words
    out.write_text("votes", encoding="utf-8")
    assert refused(lambda: require_own(out, frozen), OutputError) == words


def test_a_guardian_is_shown_pictures_of_its_own_bank_alone(frozen: study.FrozenGuardian, tmp_path: Path) -> None:
    """One that knows no bank may be shown any."""
    bank = build_bank(tmp_path / "bank")
    own = replace(frozen, about=replace(frozen.about, bank=bank.manifest.fingerprint))
    own.may_show(bank)
    replace(frozen, about=replace(frozen.about, bank=None)).may_show(bank)
    assert refused(lambda: frozen.may_show(bank)) == (
        f"the bank differs: this guardian is of paper, {bank.root} is {bank.name}"
    )


def redigested(frozen: study.FrozenGuardian, path: Path, **change: object) -> Path:
    """Write a guardian of which something was changed, and its digest with it."""
    raw = {name: one for name, one in {**frozen.as_dict(), **change}.items() if name != "digest"}
    raw["digest"] = hashlib.sha256(json.dumps(raw, sort_keys=True).encode()).hexdigest()
    path.write_text(json.dumps(raw), encoding="utf-8")
    return path


def test_a_file_that_cannot_be_a_guardian_says_why(
    frozen: study.FrozenGuardian, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A part that is missing, a committee that is none, names too long to print, and more bytes than one has."""
    path = tmp_path / "guardian.json"
    cannot = f"{path} is no guardian that this eyechart can read: "

    def said(**change: object) -> str:
        return refused(lambda: study.read_frozen(redigested(frozen, path, **change)))

    chosen = frozen.as_dict()["selection"]
    assert isinstance(chosen, dict)
    none = "its committee is no list of different models: "
    assert said(committee=[GEMMA, GEMMA]) == f"{cannot}it: {none}{GEMMA}, {GEMMA}"
    assert said(committee=["a" * 300]) == f"{cannot}it: {none}{'a' * 200}"
    assert said(views=["reflected", "original"]) == f"{cannot}it: its views are not original and reflected"
    for threshold in (0, 5):
        limits = f"its threshold is {threshold}, and no whole number from 1 to its 4 votes"
        assert said(threshold=threshold) == f"{cannot}it: {limits}"
    single = "its best single model is none of its models: "
    assert said(selection={**chosen, "best_single_model": "n" * 90}) == f"{cannot}it: {single}{'n' * 80}"
    twice = {**chosen, "frames": ["f280"] * 2}
    assert said(selection=twice) == f"{cannot}selection: the frames that chose it are missing or repeated"
    assert said(selection={**chosen, "pictures": ["a"] * 17}) == (
        f"{cannot}selection: it remembers 17 pictures of 16 frames, so that some would not be known again"
    )
    assert said(selection={**chosen, "worth": 1.5}) == (
        f"{cannot}selection: its worth on the frames that chose it is 1.5, which is impossible"
    )
    assert said(selection={**chosen, "tie_breaks": "luck"}) == (
        f"{cannot}selection: its rule for ties is unknown to this eyechart"
    )
    assert said(prompt={"key": None, "wording": {}}) == f"{cannot}it has no 'name'"
    models = {name: {"version": None, "served": None, "mode": ASKED.as_dict()} for name in (GEMMA, QWEN)}
    assert said(models=models).startswith(f"{cannot}the mode of '{GEMMA}' is that of '{QWEN}'")
    assert refused(lambda: study.read_frozen(tmp_path)) == f"{tmp_path} cannot be read: Is a directory"
    study.write_frozen(path, frozen)
    size = path.stat().st_size
    monkeypatch.setattr("eyechart.studies.guardian.frozen._MOST_BYTES", size)
    assert study.read_frozen(path) == frozen
    monkeypatch.setattr("eyechart.studies.guardian.frozen._MOST_BYTES", size - 1)
    assert refused(lambda: study.read_frozen(path)) == (
        f"{path} has more than {size - 1} bytes, too many for a guardian"
    )


def test_what_is_chosen_and_what_nested_says_is_plain_json(
    table: study.VoteTable, frozen: study.FrozenGuardian
) -> None:
    """Each key of a file, and each fold with its committee, threshold and point."""
    said = frozen.as_dict()
    assert (said["format"], frozen.exported().as_dict()["format"]) == (
        "eyechart-guardian/1",
        "eyechart-guardian-stack/1",
    )
    assert (said["committee"], said["views"], said["threshold"], said["operating_point"]) == (
        [GEMMA, QWEN],
        ["original", "reflected"],
        2,
        "two_way",
    )
    assert said["models"] == {name: {"version": "digest-1", "served": None, "mode": None} for name in (GEMMA, QWEN)}
    assert said["prompt"] == {"key": "prompt-digest", "wording": None}
    assert (said["view"], said["mirror_axis"], said["reader"]) == ("view-digest", None, None)
    assert said["bank"] == {"name": "paper", "fingerprint": "f" * 64}
    found = study.nested(table)
    told = found.as_dict()
    assert set(told) == {"frames", "folds", "folds_that_chose_alike", "pooled"}
    assert (told["frames"], told["folds_that_chose_alike"]) == (288, 12)
    assert told["folds"] == {
        f"e{number:02}": {"committee": [GEMMA, QWEN], "threshold": 2, "operating_point": "two_way"}
        for number in range(12)
    }
    assert told["pooled"] == {name: one.as_dict() for name, one in found.pooled.items()}


def test_what_cannot_choose_says_why(table: study.VoteTable) -> None:
    """A committee too large, one class, an unfinished run, no votes, one episode, and a class in one episode alone."""
    size = "a committee has 1 to 4 models, of {} that voted; got {}"
    assert refused(lambda: study.fit(table, size=0)) == size.format(6, 0)
    assert refused(lambda: study.fit(table, size=5)) == size.format(6, 5)
    assert refused(lambda: study.fit(table, size=3, models=(GEMMA, QWEN, GEMMA))) == size.format(2, 3)
    unfinished = replace(table, unfinished={GEMMA: 3})
    assert refused(lambda: study.fit(unfinished)).endswith("; finish it, or name the finished models with --model")
    assert "3" in refused(lambda: study.fit(unfinished))
    assert study.fit(unfinished, size=1, models=(QWEN,)).committee == (QWEN,)
    mute = replace(table, votes=np.full_like(table.votes, -1))
    assert refused(lambda: study.fit(mute, size=1, models=(QWEN, GEMMA))) == (
        f"votes.csv: no vote by {GEMMA}, {QWEN} on any of 288 frames, so nothing can be chosen; for votes from "
        "scene estimates, 'eyechart score' counts the reasons"
    )
    one = replace(table, episodes=("e00",) * 288)
    assert refused(lambda: study.nested(one)) == (
        "votes.csv: all frames are of one episode; leaving one out needs two or more"
    )
    apart = replace(table, episodes=tuple(f"e{int(hazard)}" for hazard in table.hazard))
    assert refused(lambda: study.nested(apart)) == (
        "votes.csv: without one of its episodes a class is empty, so nothing can be chosen"
    )
