"""What answered is watched: a run that several models answered says so, and is no evidence of any of them."""

import json
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from itertools import count
from pathlib import Path

import pytest
from typer.testing import CliRunner

import intents
import short_worlds
import stand_ins
from banks import build_bank
from eyechart import models, simulators
from eyechart.calls import CallKey, Query, Reply, read_in
from eyechart.cli.app import app
from eyechart.integrity import ServedChecks, ServedGuard
from eyechart.ledger import SentAttempt, columns_of
from eyechart.models import scripted
from eyechart.spaces.discrete import DRIVING
from eyechart.studies import battery

pytestmark = pytest.mark.slow

KEY = CallKey("battery", "openai:m", "p", "f", "real")


class Swapped(stand_ins.Held):
    """A model behind an address at which, from the fortieth reply on, another one answers."""

    def __init__(self, before: Reply, after: Reply) -> None:
        """Answer with one reply, and then with the other."""
        self._replies = (before, after)
        self._number: Iterator[int] = count()

    async def answer(self, query: Query) -> Reply:
        """Answer."""
        action = DRIVING.actions[query.seed % len(DRIVING.actions)]
        return replace(self._replies[next(self._number) >= 40], text=action)


def served(**named: str) -> Reply:
    """Return a reply that names what answered."""
    return Reply("SLOW", "stop", **named)  # type: ignore[arg-type]


def guard_of(*replies: Reply) -> ServedGuard | None:
    """Return the guard of these replies, a minute apart."""
    sent = [
        SentAttempt(KEY._replace(frame=f"f{at}"), 1, None, reply, "", final=True, sent_at=f"T00:{at:02d}")
        for at, reply in enumerate(replies)
    ]
    found = ServedChecks(columns_of(sent, read_in(DRIVING)), KEY.model).guards()
    return found[0] if found else None


def ask(*words: object) -> tuple[int, str]:
    """Run a command; return its exit code and what it printed."""
    result = CliRunner().invoke(app, [str(word) for word in words])
    return result.exit_code, result.output


@pytest.mark.parametrize(
    ("after", "differs"),
    [
        (served(served="b", provider="x", system_fingerprint="fp_1"), ["model"]),
        (served(served="a", provider="y", system_fingerprint="fp_1"), ["provider"]),
        (served(served="a", provider="x", system_fingerprint="fp_2"), ["system_fingerprint"]),
        (
            served(served="b", provider="y", system_fingerprint="fp_2"),
            ["model", "provider", "system_fingerprint"],
        ),
    ],
)
def test_a_model_that_is_swapped_during_a_run_is_named_everywhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, after: Reply, differs: list[str]
) -> None:
    """In costs, verdict and JSON, with counts and times; a gate cannot say, but other fingerprints may be allowed."""
    before = served(served="a", provider="x", system_fingerprint="fp_1")
    monkeypatch.setitem(models.ADAPTERS, "standin", "stand_ins")
    monkeypatch.setattr(stand_ins, "open_model", lambda *_: Swapped(before, after))
    run = tmp_path / "run"
    battery.run(battery.plan(build_bank(tmp_path / "bank").root, ["standin:m"], run))

    code, told = ask("costs", run, "--json")
    (guard,) = (one for one in json.loads(told)["guards"]["standin:m"] if one["name"] == "served")
    assert (code, guard["holds"], guard["differs"]) == (0, False, differs)
    first, second = guard["answered"]
    assert (first["replies"], first["model"], first["since"] <= second["since"]) == (40, "a", True)
    assert second["replies"] > 0
    assert second["model"] == after.served
    assert "guard 'served'" in ask("costs", run)[1]
    assert "guard 'served' failed" in "".join(
        json.loads(ask("verdict", run, "--json")[1])["models"]["standin:m"]["failed_guards"]
    )
    assert "served" in ask("verdict", run)[1]

    for words, expected in (((), None), (("--allow-fingerprints",), differs == ["system_fingerprint"] or None)):
        _, told = ask("gate", run, "--require", "swaps", "--max-unparsed", 0.5, "--json", *words)
        (check,) = (one for one in json.loads(told)["checks"] if one["requirement"] == "max_unparsed")
        assert check["holds"] is expected
        assert ("guard 'served' failed" in check["because"]) is (expected is None)


def test_what_is_not_reported_is_no_second_model() -> None:
    """Nor is a failure; where nothing is ever named, there is no guard. A fingerprint may come now and then."""
    one = served(served="a", system_fingerprint="fp")
    assert guard_of(Reply("SLOW"), Reply(error="timeout", served="b")) is None
    guard = guard_of(one, one, served(served="a"), Reply(error="bad_request", served="b"))
    assert guard is not None
    assert guard.holds
    assert sum(each.replies for each in guard.answered) == 3


@pytest.mark.parametrize("unnamed", [1, 5])
def test_a_server_that_names_itself_in_some_replies_only_is_marked(unnamed: int) -> None:
    """Another model may have answered where no name stands."""
    one = served(served="a")
    guard = guard_of(*[one] * 5, *[Reply("SLOW")] * unnamed)
    assert guard is not None
    assert guard.holds is False
    assert f"{unnamed} of {5 + unnamed} replies do not name their model, and the others do" in guard.because


def test_a_model_may_have_a_name_of_several_words() -> None:
    """What stands behind it is a fingerprint only in an older reply, and where it looks like one."""
    old = guard_of(served(served="llava 7b"), served(served="llava 13b"))
    new = guard_of(
        served(served="m fp_1", payload_sha256="0" * 64),
        served(served="m fp_2", payload_sha256="1" * 64),
    )
    for found in (old, new):
        assert found is not None
        assert found.differs == ("model",)


def test_a_fingerprint_of_its_own_for_every_reply_is_no_other_model() -> None:
    """However many there are, of two providers too."""
    guard = guard_of(*(served(served="m", provider="pq"[at % 2], system_fingerprint=f"fp_{at}") for at in range(1500)))
    assert guard is not None
    assert guard.differs == ("provider", "system_fingerprint")
    assert sum(each.replies for each in guard.answered) == 1500


def test_an_older_reply_holds_its_fingerprint_behind_its_model() -> None:
    """So that another fingerprint of one model is no other model."""
    guard = guard_of(
        served(served="a fp_1"), served(served="a fp_2"), served(served="a fp_2", system_fingerprint="fp_2")
    )
    assert guard is not None
    assert (guard.is_by_fingerprint, [each.replies for each in guard.answered]) == (True, [1, 2])
    assert "2 configurations (system_fingerprint) answered: a fp_1 (1 replies, T00:00 to T00:00)" in guard.because


def test_names_without_end_are_bounded() -> None:
    """A server that gives every reply another name makes no long line and no long list."""
    guard = guard_of(*(served(served=f"m{at}" + "x" * 190) for at in range(1200)))
    assert guard is not None
    assert len(guard.answered) == 1001
    assert len(guard.because) < 600


def drive(folder: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Path]:
    """Drive in every study of drives with models behind which another one answers from the third reply on."""
    answer, asked = scripted.ScriptedModel.answer, Counter[int]()

    async def swapped(model: scripted.ScriptedModel, query: Query) -> Reply:
        asked[id(model)] += 1
        return replace(await answer(model, query), served="ab"[asked[id(model)] > 2], provider="x")

    monkeypatch.setattr(scripted.ScriptedModel, "answer", swapped)
    for name, place in short_worlds.SIMULATORS.items():
        monkeypatch.setitem(simulators.SIMULATORS, name, place)
    result = {name: folder / name for name in ("closed-loop", "online", "hierarchy")}
    drives = {
        "closed-loop": ("--simulator", "short", "--seeds", "1,2", "--policy", "scripted:depth"),
        "online": ("--simulator", "short", "--episodes", "1", "--model", "scripted:scene_positive_control"),
    }
    for name, words in drives.items():
        code, told = ask("run", name, *words, "--out", result[name])
        assert code == 0, told
    intents.make_study(result["hierarchy"], "scripted:stopping")
    return result


def test_drives_that_several_models_answered_say_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The score, its JSON and the page name the models, counts and times; nothing is said where one answered."""
    for name, run in drive(tmp_path, monkeypatch).items():
        code, told = ask("score", run)
        assert (code, "guard 'served' failed: " in told) == (0, True), told
        assert "2 models answered: a x (2 replies, " in " ".join(told.split())
        found = json.loads(ask("score", run, "--json")[1])["served"]
        ((who, guard),) = found.items()
        assert (who.startswith("scripted:"), guard["differs"], guard["holds"]) == (True, ["model"], False)
        assert [one["model"] for one in guard["answered"]] == ["a", "b"]
        page = tmp_path / f"{name}.html"
        assert ask("report", run, "--out", page)[0] == 0
        html = page.read_text(encoding="utf-8")
        assert html.count("<strong>More than one model answered:</strong>") == 1
        assert "2 models answered: a x (2 replies, " in html
    monkeypatch.undo()
    one = tmp_path / "one"
    intents.make_study(one, "scripted:stopping")
    assert "'served'" not in ask("score", one)[1]
    assert json.loads(ask("score", one, "--json")[1])["served"] == {}
