"""The output of an OpenAI batch is a run: usage and finish reasons are kept, and errors are failures by kind."""

import json
from pathlib import Path
from typing import Any

import pytest

import banks
from eyechart.errors import SourceError
from eyechart.frames import FrameBank
from eyechart.ledger import Ledger
from eyechart.manifest import LEDGER
from eyechart.studies import battery as study
from eyechart.studies.battery import BatterySettings, answer_import


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a bank that no test changes."""
    return banks.build_bank(tmp_path_factory.mktemp("batch") / "bank")


Lines = list[dict[str, Any]]


def completed(call: str, text: str, **choice: object) -> dict[str, Any]:
    """Return the line of a request that was answered."""
    message = {"role": "assistant", "content": text}
    usage = {"prompt_tokens": 40, "completion_tokens": 3, "completion_tokens_details": {"reasoning_tokens": 2}}
    body = {
        "model": "gpt-x-2026",
        "system_fingerprint": "fp",
        "choices": [{"index": 0, "message": message, "finish_reason": "stop", **choice}],
        "usage": usage,
    }
    response = {"status_code": 200, "request_id": "r", "body": body}
    return {"id": "batch_req_1", "custom_id": call, "response": response, "error": None}


def failed(call: str, status: int, message: str) -> dict[str, Any]:
    """Return the line of a request that the server refused, from the batch's file of errors."""
    response = {"status_code": status, "request_id": "r", "body": {"error": {"message": message, "param": "messages"}}}
    return {"id": "batch_req_2", "custom_id": call, "response": response, "error": None}


def expired(call: str) -> dict[str, Any]:
    """Return the line of a request that was not made within the batch's time."""
    return {"id": "x", "custom_id": call, "response": None, "error": {"code": "batch_expired", "message": "too late"}}


def calls_of(bank: Path, folder: Path) -> list[str]:
    """Return the calls of an export."""
    study.write_questions(study.questions_of(bank, BatterySettings(), None), folder)
    return [json.loads(line)["call"] for line in (folder / "asked.jsonl").read_text(encoding="utf-8").splitlines()]


def write(path: Path, lines: Lines) -> Path:
    """Write a batch's output."""
    path.write_text("".join(json.dumps(line) + "\n" for line in lines), encoding="utf-8")
    return path


def test_a_batch_becomes_a_run_with_its_tokens_reasons_and_failures(bank: FrameBank, tmp_path: Path) -> None:
    """By the model that its lines name; an expired request may be asked again, and is then answered."""
    calls = calls_of(bank.root, tmp_path / "asked")
    lines = [completed(call, "BRAKE") for call in calls[:-5]]
    lines += [completed(calls[-5], "BRA", finish_reason="length"), failed(calls[-4], 400, "Invalid image in messages")]
    lines += [failed(calls[-3], 429, "Rate limit reached"), expired(calls[-2])]
    refusal = {"role": "assistant", "content": None, "refusal": "I cannot help with that"}
    lines += [completed(calls[-1], "", message=refusal)]
    out = tmp_path / "run"
    source = answer_import.source_of(write(tmp_path / "out.jsonl", lines))
    assert (source.answered_by, source.made_by) == ("gpt-x-2026", "the output of an OpenAI batch")
    answer_import.bring(answer_import.read_import(bank.root, source, out, None, BatterySettings()))
    with Ledger(out / LEDGER) as ledger:
        replies = [reply for _, reply in ledger.replies("elsewhere:gpt-x-2026")]
    assert len(replies) == len(calls)
    told = {(one.prompt_tokens, one.completion_tokens, one.reasoning_tokens) for one in replies if one.error is None}
    assert told == {(40, 3, 2)}
    ends = sorted(one.finish_reason or "" for one in replies if one.error is None)
    assert ends == sorted([*["stop"] * (len(calls) - 5), "length", "refusal"])
    kinds = {one.error: one.error_detail for one in replies if one.error}
    assert kinds.keys() == {"bad_request", "rate_limited", "not_called"}
    assert "too late (batch_expired)" in kinds["not_called"]
    again = answer_import.source_of(write(tmp_path / "again.jsonl", [completed(calls[-2], "STOP")]))
    brought = answer_import.bring(answer_import.read_import(bank.root, again, out, None, BatterySettings()))
    assert (brought.new, brought.errors) == (1, 0)


WRONG: dict[str, tuple[Any, str]] = {
    "no key": ({"custom_id": "", "response": None, "error": None}, "row 2 has no custom_id"),
    "neither": ({"custom_id": "c", "response": None, "error": None}, "row 2 has no error and no response"),
    "no body": ({"custom_id": "c", "response": {"status_code": 200}, "error": None}, "row 2 has no error and no"),
    "status": ({"custom_id": "c", "response": {"status_code": True, "body": {"a": 1}}}, "row 2 has no error and no"),
    "a list": ([1], "row 2 is a list, no JSON object"),
    "half a letter": (completed("c", "\ud83d"), "row 2: the body cannot be read"),
    "great number": (completed("c", "x", index=2**70), "row 2: the body cannot be read"),
    "another endpoint": (
        {"custom_id": "c", "response": {"status_code": 200, "body": {"object": "response", "output": []}}},
        "row 2: its body is a response, of another endpoint",
    ),
    "another export's": (completed("3ed34849-nobody", "x"), "row 2: call '3ed34849-nobody'"),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_faulty_line_is_named_and_nothing_is_written(bank: FrameBank, tmp_path: Path, name: str) -> None:
    """As of every source of answers, whole lines only."""
    line, why = WRONG[name]
    calls = calls_of(bank.root, tmp_path / "asked")
    source = answer_import.source_of(write(tmp_path / "out.jsonl", [completed(calls[0], "STOP"), line]))
    with pytest.raises(SourceError, match=why):
        answer_import.read_import(bank.root, source, tmp_path / "run", None, BatterySettings())
    assert not (tmp_path / "run").exists()


def test_the_first_choice_counts_wherever_it_stands_and_two_models_are_two_files(
    bank: FrameBank, tmp_path: Path
) -> None:
    """Choices are numbered; the answers of a second model are not credited to the first."""
    calls = calls_of(bank.root, tmp_path / "asked")
    line = completed(calls[0], "STOP")
    second = {"index": 1, "message": {"role": "assistant", "content": "LEFT"}, "finish_reason": "stop"}
    line["response"]["body"]["choices"].insert(0, second)
    source = answer_import.source_of(write(tmp_path / "two.jsonl", [line]))
    answer_import.bring(answer_import.read_import(bank.root, source, tmp_path / "run", None, BatterySettings()))
    with Ledger(tmp_path / "run" / LEDGER) as ledger:
        ((_, reply),) = ledger.replies("elsewhere:gpt-x-2026")
    assert reply.text == "STOP"
    other = completed(calls[1], "STOP")
    other["response"]["body"]["model"] = "gpt-y"
    with pytest.raises(SourceError, match="answers of several models: gpt-x-2026, gpt-y"):
        answer_import.source_of(write(tmp_path / "models.jsonl", [completed(calls[0], "STOP"), other]))


def test_a_table_with_columns_of_its_own_is_no_batch(tmp_path: Path) -> None:
    """Nor is a file whose first line is no JSON: a table's reader says what is wrong."""
    both = '{"custom_id": "r", "call": "c", "text": "STOP", "error": ""}\n'
    for text in (both, '{"custom_id": "c", "text": "STOP"}\n', '{"call": "c", "text": "STOP"}\n', "no JSON\n", "\n"):
        (tmp_path / "t.jsonl").write_text(text)
        assert answer_import.source_of(tmp_path / "t.jsonl").made_by == "a table"
