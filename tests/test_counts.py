"""Counts of calls, attempts, errors and replies without a decision are the same wherever they are said."""

import json
import re
from collections.abc import Mapping
from html import unescape
from pathlib import Path

import pytest
from typer.testing import CliRunner

import banks
import report_runs
import stand_ins
from eyechart.calls import KINDS, Query, Reply
from eyechart.cli.app import app
from eyechart.ledger import Ledger, ledger
from eyechart.limits import Limits
from eyechart.manifest import LEDGER
from eyechart.models import ADAPTERS
from eyechart.spaces.space import MISSING
from eyechart.studies import battery

SPEC = "standin:troubled"
OVER, LATER = ([kind for kind, (then, _) in KINDS.items() if then == name] for name in ("over", "again"))
"""Errors that finish a call, and those that leave it to be tried again."""
TROUBLE = (
    Reply("STOP", "stop", prompt_tokens=3),
    Reply("Brake!", "stop"),
    Reply("I'm sorry, I can't help with that.", "stop"),
    Reply("STOP or", "length"),
    Reply("STOP", "content_filter"),
    Reply("", "stop"),
    *(Reply("", None, kind) for kind in OVER),
    Reply("LEFT", "stop"),
)
"""What comes of calls: decisions, every way to hold none, and errors that are final."""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a run with every kind of trouble: errors that passed, some that did not, attempts that never came back."""
    folder = tmp_path_factory.mktemp("counts")
    bank = banks.build_bank(folder / "bank", drawn=False).root
    queries: list[Query] = []

    def troubled(query: Query) -> Reply:
        queries.append(query)
        return TROUBLE[len(queries) % len(TROUBLE)]

    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(ADAPTERS, "standin", "stand_ins")
        patch.setattr(stand_ins, "open_model", lambda *_: stand_ins.StandIn(troubled))
        planned = battery.plan(bank, [SPEC], folder / "run", conditions=["real", "real_repeat", "blank"])
        battery.run(planned, concurrency=1, limits=Limits(calls=30))
    with Ledger(folder / "run" / LEDGER, create=True) as ledger:
        asked_again = iter(sorted(set(planned.plan.keys()) - ledger.finished(), key=str))
        for kind in LATER:
            for then in (Reply("STOP", "stop"), None):
                key = next(asked_again)
                ledger.close(ledger.begin(key, ""), Reply("", None, kind))
                if then is not None:
                    ledger.close(ledger.begin(key, ""), then)
        ledger.begin(next(asked_again), "")
    return folder / "run"


def told(*words: str) -> str:
    """Return what a command prints."""
    result = CliRunner().invoke(app, list(words))
    assert result.exit_code in {0, 1, 2}, result.output
    return result.stdout


def from_ledger(run: Path) -> dict[str, int]:
    """Return the counts as the rows themselves have them."""
    with Ledger(run / LEDGER) as ledger:
        sent = list(ledger.attempts(SPEC))
    return {
        "attempts": len(sent),
        "calls": len({attempt.key for attempt in sent}),
        "errors": sum(attempt.reply is not None and attempt.reply.error is not None for attempt in sent),
        "unknown": sum(attempt.reply is None for attempt in sent),
    }


def test_costs_are_derived_once(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Both tables, of calls and of decisions, come from one reading of the ledger."""
    read, columns = list[bool](), ledger.read_columns
    monkeypatch.setattr(ledger, "read_columns", lambda *given, **how: read.append(True) or columns(*given, **how))
    said = told("costs", str(run), "--fresh")
    assert "per 1000" in re.sub(r"\s+", " ", said)
    assert read == [True]


def test_every_command_says_the_same(run: Path, tmp_path: Path) -> None:
    """The costs, their JSON, guards and unread replies, the score and the report, against the ledger's rows."""
    rows = from_ledger(run)
    account = json.loads(told("costs", str(run), "--json"))["accounting"][SPEC]
    whole = account["all"]
    assert {name: whole[name] for name in ("attempts", "calls", "unknown")} == {
        name: rows[name] for name in ("attempts", "calls", "unknown")
    }
    assert sum(whole["errors"].values()) == rows["errors"] > 0
    assert set(whole["errors"]) == {*LATER, *OVER}
    assert json.loads(told("score", str(run), "--json"))["accounting"][SPEC] == account
    for name in ("calls", "attempts", "finished", "unknown"):
        assert whole[name] == sum(one[name] for condition, one in account.items() if condition != "all")

    said = re.sub(r"\s+", " ", told("costs", str(run)))
    counted = (
        f"{rows['attempts']} attempts, {rows['attempts'] - rows['calls']} of them repeated, "
        f"{rows['unknown']} of unknown outcome, {whole['missing']['error']} calls failed "
        f"({rows['errors']} attempts ended in an error: "
    )
    assert counted in said

    unread = json.loads(told("costs", str(run), "--unread", "--json"))["unread"][SPEC]
    found: dict[str, int] = dict.fromkeys(MISSING, 0)
    for one in unread:
        found[one["missing"]] += one["count"]
    assert {name: count for name, count in found.items() if count} == {
        name: count for name, count in whole["missing"].items() if name != "error"
    }

    page = tmp_path / "report.html"
    told("report", str(run), "--out", str(page))
    table = re.search(r"<table[^>]*><caption>Calls by model.*?</table>", page.read_text(encoding="utf-8"), re.DOTALL)
    assert table is not None
    heads = [unescape(re.sub("<[^>]+>", "", one)) for one in re.findall(r"<th scope=.col.>(.*?)</th>", table[0])]
    cells = [unescape(re.sub("<[^>]+>", "", one)) for one in re.findall(r"<td>(.*?)</td>", table[0])]
    shown = dict(zip(heads[1:], cells, strict=True))
    assert (shown["attempts"], shown["errors"], shown["unknown"]) == tuple(
        str(rows[name]) for name in ("attempts", "errors", "unknown")
    )
    for name in MISSING:
        assert shown[name].replace("·", "0") == str(whole["missing"].get(name, 0))
    assert shown["tokens in, out"] == f"{whole['prompt_tokens']}, —"


def test_a_verdict_and_a_gate_count_as_costs_do(run: Path) -> None:
    """The reasons for which calls hold no decision, each with its count."""
    missing = json.loads(told("costs", str(run), "--json"))["accounting"][SPEC]["all"]["missing"]
    verdict = re.sub(r"\s+", " ", told("verdict", str(run)))
    assert f"hold no decision: {listed(missing)}" in verdict


def listed(missing: Mapping[str, int]) -> str:
    """Return reasons as a verdict lists them."""
    return ", ".join(f"{count} {name.replace('_', ' ')}" for name, count in sorted(missing.items()))


def test_a_verdict_says_what_it_leaves_out_of_its_rate(tmp_path: Path) -> None:
    """The rate is over the conditions of the paper; where others were asked too, the counts of all are beside it."""
    made = report_runs.make_run(banks.build_bank(tmp_path / "bank").root, tmp_path / "run", {"noisy": stand_ins.noisy})
    missing = json.loads(told("costs", str(made), "--json"))["accounting"]["standin:noisy"]["all"]["missing"]
    verdict = re.sub(r"\s+", " ", told("verdict", str(made)))
    assert f"; with edited pictures and controls, {listed(missing)}" in verdict
