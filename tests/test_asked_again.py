"""What ended in a failure on the way is asked once more where somebody says so; a reply never is."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

import stand_ins
from banks import build_bank
from eyechart import models
from eyechart.calls import Query, Reply
from eyechart.cli.app import app
from eyechart.ledger import AGAIN, Ledger
from eyechart.manifest import LEDGER

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
    assert {before[key].error_detail for key in changed} == {one.error_detail for one in FAILURES[:MENDED]}
    assert {after[key].text for key in changed} == {"SLOW"}
    assert len(changed) == sum(one.reason == AGAIN for one in attempts) == MENDED
    assert len(attempts) == sent + MENDED

    told = json.loads(run(app, ["costs", str(out), "--json"]).output)
    account = told["accounting"]["standin:m"]["all"]
    (guard,) = (one for one in told["guards"]["standin:m"] if one["name"] == "outcomes")
    assert (account["retries"], account["missing"]["error"], account["finished"]) == ({"again": MENDED}, 1, len(after))
    assert guard["holds"]
    assert f"{MENDED} calls asked again after a failure" in guard["because"]
    assert run(app, [*words, "--again"]).exit_code == 0
    assert model.asked == sent + MENDED
