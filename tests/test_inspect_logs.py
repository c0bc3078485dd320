"""Logs that Inspect AI itself wrote are read: tests/inspect_logs/make.py made them."""

import json
import zipfile
from collections import Counter
from pathlib import Path

import pytest

import eyechart.inspect
from eyechart.errors import SourceError
from eyechart.importing import Faults, ImportedAnswer, open_log
from eyechart.inspect import battery

FOLDER = Path(__file__).parent / "inspect_logs"
JSON = FOLDER / "battery.json"


def answers(path: Path) -> list[ImportedAnswer]:
    """Return the answers of a log, which has no fault."""
    faults = Faults()
    found = list(open_log(path).answers(faults))
    faults.require_none(path.name)
    return found


def test_a_log_in_json_holds_every_reply_as_the_model_gave_it() -> None:
    """Text, thought, end, tokens, cost and what answered; a second epoch is a repeat; a failure is one."""
    log = open_log(JSON)
    assert (log.model, log.version, log.count) == ("mockllm/eye", "0.3.285", 24)
    found = answers(JSON)
    assert Counter(answer.repeat for answer in found) == {0: 12, 1: 12}
    assert Counter(answer.condition for answer in found) == {"real": 8, "blank": 8, "text_only": 8}
    replies = [answer.reply for answer in found if answer.reply is not None]
    assert len(replies) == 24
    failed = [reply for reply in replies if reply.error]
    assert {(reply.text, reply.error, reply.error_detail) for reply in failed} == {
        ("", "exception", "the server was away")
    }
    came = [reply for reply in replies if not reply.error]
    assert {reply.text for reply in came} <= {"STOP", "SLOW", "LEFT"}
    assert {reply.finish_reason for reply in came} <= {"stop", "length"}
    told = {
        (reply.prompt_tokens, reply.completion_tokens, reply.reasoning_tokens, reply.cost_usd, reply.served)
        for reply in came
    }
    assert told == {(7, 2, 1, 0.25, "eye-1")}
    thought = {answer.condition: answer.reply.reasoning for answer in found if answer.reply and not answer.reply.error}
    assert thought["text_only"] == "no picture"
    assert thought["real"] == ""


@pytest.mark.models
def test_a_log_in_eval_holds_the_same_replies() -> None:
    """Its samples are packed with Zstandard."""
    said = [
        {
            (answer.call, answer.repeat, answer.reply.text, answer.reply.error, answer.reply.reasoning)
            for answer in answers(path)
            if answer.reply
        }
        for path in (JSON, FOLDER / "battery.eval")
    ]
    assert said[0] == said[1]
    assert len(said[0]) == 24


def test_what_is_no_log_is_refused_in_words(tmp_path: Path) -> None:
    """Another JSON, another ZIP file, a damaged one, and samples that were asked by another task."""
    log = json.loads(JSON.read_text(encoding="utf-8"))
    other = tmp_path / "a.json"
    for text, said in (("[]", "no JSON object"), ("{}", "no list of them"), ("{", "is no JSON")):
        other.write_text(text)
        with pytest.raises(SourceError, match=said):
            open_log(other)
    packed = tmp_path / "a.eval"
    packed.write_bytes(b"PK\x03\x04 nothing")
    with pytest.raises(SourceError, match="cannot be read as a log"):
        open_log(packed)
    with zipfile.ZipFile(packed, "w") as archive:
        archive.writestr("readme.txt", "hello")
    with pytest.raises(SourceError, match=r"it has no header\.json"):
        open_log(packed)
    log["samples"][0] |= {"metadata": {}, "id": 1}
    log["samples"][1]["epoch"] = "two"
    other.write_text(json.dumps(log))
    faults = Faults()
    assert len(list(open_log(other).answers(faults))) == 22
    with pytest.raises(SourceError, match="2 faults") as raised:
        faults.require_none("a.json")
    assert "has no call in its metadata: is it a sample of the task eyechart/battery?" in str(raised.value)


def test_a_log_packed_as_older_versions_do_is_read_within_bounds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Deflated; a sample that unpacks to more than the bound is refused."""
    log, packed = json.loads(JSON.read_text(encoding="utf-8")), tmp_path / "a.eval"
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("header.json", json.dumps({"eval": log["eval"]}))
        for sample in log["samples"]:
            archive.writestr(f"samples/{sample['id']}_epoch_{sample['epoch']}.json", json.dumps(sample))
    assert [answer.reply for answer in answers(packed)] == [answer.reply for answer in answers(JSON)]
    monkeypatch.setattr("eyechart.importing.inspect_log.MOST_SAMPLE", 5000)
    with pytest.raises(SourceError, match="has more than 5000 bytes"):
        answers(packed)


def test_a_number_that_nobody_can_have_measured_is_not_reported(tmp_path: Path) -> None:
    """Infinite, negative, or of another kind."""
    log, other = json.loads(JSON.read_text(encoding="utf-8")), tmp_path / "a.json"
    sample = next(one for one in log["samples"] if one["output"]["choices"])
    sample["output"] |= {"time": 1e400, "usage": {"input_tokens": -3, "output_tokens": "x", "total_cost": 1e300}}
    other.write_text(json.dumps(log | {"samples": [sample]}))
    (reply,) = (answer.reply for answer in answers(other))
    assert reply is not None
    assert (reply.seconds, reply.prompt_tokens, reply.completion_tokens, reply.cost_usd) == (None, None, None, None)


def test_without_inspect_the_task_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    """The module itself is there."""
    monkeypatch.setattr(eyechart.inspect, "HERE", False)
    with pytest.raises(SourceError, match="pip install inspect-ai"):
        battery("asked")
