"""What ended in a failure on the way is asked once more where somebody says so; a reply never is."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import arms
import stand_ins
from banks import build_bank
from eyechart import models
from eyechart.calls import Query, Reply
from eyechart.cli.app import app
from eyechart.ledger import AGAIN, Ledger
from eyechart.manifest import LEDGER
from eyechart.simulators import open_bank_simulator
from eyechart.studies import policy

WRONG = Reply(error="bad_request", status=400, error_detail="HTTP 400: maximum context length is 4096 tokens")
ROAD = Reply(error="bad_request", status=413, error_detail="HTTP 413: <html>")
FAILURES = (
    ROAD,
    Reply(error="wrong_json", error_detail="no JSON"),
    Reply(error="exception", error_detail="OSError"),
    WRONG,
    Reply("I cannot help with that.", "refusal"),
    Reply("The vehicle", "length"),
    Reply("banana", "stop"),
)
MENDED = 3
"""The first of them are of the road."""


class Failing(stand_ins.Held):
    """A model that fails in every way in turn, and answers once it is mended."""

    def __init__(self) -> None:
        """Begin with the first failure."""
        self.asked, self.mended = 0, False

    async def answer(self, query: Query) -> Reply:
        """Answer or fail."""
        del query
        self.asked += 1
        return Reply("SLOW", "stop") if self.mended or self.asked > len(FAILURES) else FAILURES[self.asked - 1]


def test_only_failures_of_the_road_are_asked_again_and_the_last_reply_counts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The earlier replies stay; costs and the guard say how many; asked once more, nothing is left to ask."""
    model = Failing()
    monkeypatch.setitem(models.ADAPTERS, "standin", "stand_ins")
    monkeypatch.setattr(stand_ins, "open_model", lambda *_: model)
    bank, out = build_bank(tmp_path / "bank").root, tmp_path / "run"
    words = ["run", "battery", "--model", "standin:m", "--frames", str(bank), "--out", str(out), "--controls", "none"]
    run = CliRunner().invoke
    assert run(app, words).exit_code == 0
    with Ledger(out / LEDGER) as ledger:
        before = dict(ledger.replies("standin:m"))
    sent, model.mended = model.asked, True

    assert run(app, words).exit_code == 0
    assert model.asked == sent
    assert run(app, [*words, "--again"]).exit_code == 0
    assert model.asked == sent + MENDED
    with Ledger(out / LEDGER) as ledger:
        after, attempts = dict(ledger.replies("standin:m")), list(ledger.attempts("standin:m"))
        assert ledger.damaged() == []
    changed = {key for key, reply in before.items() if after[key] != reply}
    assert {before[key].error_detail for key in changed} == {failure.error_detail for failure in FAILURES[:MENDED]}
    assert {after[key].text for key in changed} == {"SLOW"}
    assert len(changed) == sum(attempt.reason == AGAIN for attempt in attempts) == MENDED
    assert len(attempts) == sent + MENDED

    told = json.loads(run(app, ["costs", str(out), "--json"]).output)
    account = told["accounting"]["standin:m"]["all"]
    (guard,) = (one for one in told["guards"]["standin:m"] if one["name"] == "outcomes")
    assert (account["retries"], account["missing"]["error"], account["finished"]) == ({"again": MENDED}, 1, len(after))
    assert guard["holds"]
    assert f"{MENDED} calls repeated after a failure" in guard["because"]
    assert run(app, [*words, "--again"]).exit_code == 0
    assert model.asked == sent + MENDED


def test_every_cell_of_a_prompt_study_is_asked_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The failures of the road of all its cells, once more, and nothing else."""
    model = Failing()
    monkeypatch.setitem(models.ADAPTERS, "standin", "stand_ins")
    monkeypatch.setattr(stand_ins, "open_model", lambda *_: model)
    bank, out = build_bank(tmp_path / "bank").root, tmp_path / "study"
    words = ["run", "prompts", "--model", "standin:m", "--frames", str(bank), "--out", str(out), "--limit", "6"]
    words += ["--prompt", "baseline", "--prompt", "minimal"]
    run = CliRunner().invoke
    assert run(app, words).exit_code == 0
    sent, model.mended = model.asked, True
    assert run(app, words).exit_code == 0
    assert model.asked == sent
    assert run(app, [*words, "--again"]).exit_code == 0
    assert model.asked == sent + MENDED
    again = 0
    for cell in out.glob("*/ledger.sqlite"):
        with Ledger(cell) as ledger:
            again += sum(attempt.reason == AGAIN for attempt in ledger.attempts("standin:m"))
    assert again == MENDED


LEFT = [0]
"""So many calls of the policy below fail."""


def failing_arm(images: arms.Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Fail, and then answer as the policy that reads all."""
    if LEFT[0]:
        LEFT[0] -= 1
        raise OSError("the arm is not there")
    return arms.reach(images, state, instruction)


def test_a_policy_is_asked_again(tmp_path: Path) -> None:
    """What raised on the way is asked once more; then the run says what an undisturbed one does."""
    bank, spec = (
        open_bank_simulator("tabletop").build(tmp_path / "bank", seeds=(0,), steps=4),
        f"python:{__name__}:failing_arm",
    )
    few = ("--conditions", "real,real_repeat,blank")
    words = ["run", "policy", "--policy", spec, "--frames", str(bank.root), "--out", str(tmp_path / "run"), *few]
    LEFT[0] = 5
    run = CliRunner().invoke
    assert run(app, words).exit_code == 0
    with Ledger(tmp_path / "run" / LEDGER) as ledger:
        assert sum(reply.error == "exception" for _, reply in ledger.replies(spec)) == 5
    assert run(app, [*words, "--again"]).exit_code == 0
    assert run(app, [*words, "--again"]).exit_code == 0
    with Ledger(tmp_path / "run" / LEDGER) as ledger:
        assert not any(reply.error for _, reply in ledger.replies(spec))
        assert sum(attempt.reason == AGAIN for attempt in ledger.attempts(spec)) == 5
    assert run(app, [*words[:-3], str(tmp_path / "other"), *few]).exit_code == 0
    first, second = (policy.score(tmp_path / name).as_dict()["policies"] for name in ("run", "other"))
    assert first == second
