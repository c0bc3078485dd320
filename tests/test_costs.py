from dataclasses import replace
from pathlib import Path

import pytest

from eyechart.calls import CallKey, Reply, read_in
from eyechart.costs import ALL, Account, accounts_of, estimate
from eyechart.errors import SpecError
from eyechart.ledger import UNKNOWN, SentAttempt, columns_of
from eyechart.models.prices import Price, Prices, read_prices
from eyechart.modes import ModeMeasurements, RequestMode
from eyechart.report.accounts import costs_table
from eyechart.spaces.discrete import DRIVING

SPEC = "openai:m"
KEY = CallKey("battery", SPEC, "p", "f1", "real")
PRICES = Prices((Price(SPEC, 2.0, 10.0, "2026-01-01", "a test"),))
MODE = RequestMode(SPEC)


def reply(text: str = "SLOW", **fields: object) -> Reply:
    """Return a reply of 100 tokens in and 2 out, in half a second."""
    counted = {
        "finish_reason": "stop",
        "prompt_tokens": 100,
        "completion_tokens": 2,
        "seconds": 0.5,
        "first_byte_s": 0.4,
    }
    return Reply(text, **{**counted, **fields})  # type: ignore[arg-type]


def accounts(sent: list[SentAttempt], prices: Prices = PRICES) -> dict[str, Account]:
    """Return the accounts of these attempts."""
    return accounts_of(columns_of(sent, read_in(DRIVING)), MODE.spec, prices.of(MODE))


def frame(name: str, condition: str = "real") -> CallKey:
    """Return the call about a frame."""
    return KEY._replace(frame=name, condition=condition)


def test_every_attempt_is_counted_where_it_belongs() -> None:
    """Retries by their reason, errors by their kind, missing decisions by theirs, unknown outcomes apart."""
    sent = [
        SentAttempt(frame("a"), 1, None, Reply(error="rate_limited", seconds=0.1)),
        SentAttempt(frame("a"), 2, "rate_limited", reply()),
        SentAttempt(frame("b"), 1, None, None),
        SentAttempt(frame("b"), 2, UNKNOWN, reply("The", finish_reason="length", reasoning_tokens=1)),
        SentAttempt(frame("c", "blank"), 1, None, reply("I'm sorry, I cannot see a road.", seconds=2.5)),
        SentAttempt(frame("d", "blank"), 1, None, Reply(error="wrong_json")),
        SentAttempt(frame("e", "blank"), 1, None, reply("", prompt_tokens=None)),
    ]
    found = accounts(sent)
    assert list(found) == [ALL, "blank", "real"]
    whole = found[ALL]
    assert (whole.calls, whole.attempts, whole.unknown) == (5, 7, 1)
    assert whole.retries == {"rate_limited": 1, UNKNOWN: 1}
    assert whole.errors == {"rate_limited": 1, "wrong_json": 1}
    assert whole.missing == {"truncated": 1, "refused": 1, "empty": 1, "error": 1}
    assert (whole.prompt_tokens, whole.completion_tokens, whole.reasoning_tokens) == (300, 8, 1)
    assert whole.cost_from == {"priced": 3, "unknown": 4}
    assert whole.cost_usd == pytest.approx(3 * (100 * 2 + 2 * 10) / 1e6)
    assert (whole.latency_median_s, whole.first_byte_median_s) == (0.5, 0.4)
    assert whole.latency_p95_s == pytest.approx(2.2)
    assert (whole.energy_j, whole.energy_measured) == (None, 0)
    assert found["real"].attempts + found["blank"].attempts == whole.attempts


def test_what_nobody_reports_is_none_and_not_nothing() -> None:
    """Tokens, cost, latency, energy of a model that says only text."""
    found = accounts([SentAttempt(KEY, 1, None, Reply("SLOW"))], Prices(()))[ALL]
    assert (found.prompt_tokens, found.completion_tokens, found.cost_usd) == (None, None, None)
    assert (found.latency_median_s, found.energy_j, found.cost_from) == (None, None, {"unknown": 1})
    empty = accounts([])[ALL]
    assert (empty.calls, empty.attempts, empty.cost_usd, empty.seconds) == (0, 0, None, 0)


def test_energy_adds_up_where_it_was_measured() -> None:
    """And says of how many attempts."""
    sent = [
        SentAttempt(frame(name), 1, None, reply(energy_j=joules))
        for name, joules in (("a", 1.5), ("b", None), ("c", 2.0))
    ]
    found = accounts(sent)[ALL]
    assert (found.energy_j, found.energy_measured) == (3.5, 2)
    assert "idle draw" in costs_table({"m": {ALL: found}}, every=False).note
    assert costs_table({"m": accounts(sent[1:2])}, every=False).note == ""


def test_a_reported_cost_comes_before_a_price_and_one_s_own_machine_costs_no_dollars() -> None:
    """Each is named for what it is."""
    assert PRICES.cost(MODE, reply(cost_usd=0.7)) == (0.7, "reported")
    assert PRICES.cost(MODE, reply()) == (pytest.approx(0.00022), "priced")
    assert PRICES.cost(MODE, Reply(error="timeout")) == (None, "unknown")
    assert PRICES.cost(RequestMode("openai:other"), reply()) == (None, "unknown")
    assert PRICES.cost(RequestMode("python:a:b"), reply()) == (None, "unknown")
    assert PRICES.cost(RequestMode("ollama:m"), reply()) == (0.0, "own machine")


def test_a_price_may_be_one_server_s() -> None:
    """The same name elsewhere has no price."""
    here = Prices((Price(SPEC, 1, 1, "2026", "a test", base_url="https://api.openai.com/v1"),))
    assert here.of(MODE) is not None
    assert here.of(RequestMode(SPEC, base_url="https://api.openai.com/v1/")) is not None
    assert here.of(RequestMode(SPEC, base_url="http://127.0.0.1:8000/v1")) is None


@pytest.mark.parametrize("priced", ["http://host:8000/v1", "http://HOST:8000/v1/chat/completions/"])
def test_an_address_is_one_however_it_is_spelt(priced: str, tmp_path: Path) -> None:
    """The host's case, a slash, the route and the usual port make no other server, neither here nor in the table."""
    row = f'[[price]]\nmodel = "{SPEC}"\ninput = 1.0\noutput = 2.0\ndate = "2026-01-01"\nsource = "x"\n'
    (tmp_path / "p.toml").write_text(f'{row}base_url = "{priced}"\n')
    prices = read_prices(tmp_path / "p.toml")
    for asked in ("http://host:8000/v1", "http://Host:8000/v1/", "http://HOST:8000/v1/chat/completions"):
        assert prices.of(RequestMode(SPEC, base_url=asked)) is not None
    assert prices.of(RequestMode(SPEC, base_url="http://host:8001/v1")) is None
    here = Prices((Price(SPEC, 1, 1, "2026", "a test", base_url="https://API.openai.com/v1"),))
    for asked in ("", "https://API.OpenAI.com/v1/", "https://api.openai.com:443/v1/chat/completions"):
        assert here.of(RequestMode(SPEC, base_url=asked)) is not None
    (tmp_path / "p.toml").write_text(f'{row}base_url = "http://host:99999/v1"\n')
    with pytest.raises(SpecError, match=r"p\.toml, price 1: base_url must be a URL"):
        read_prices(tmp_path / "p.toml")


def test_every_price_of_the_package_has_a_date_and_a_source() -> None:
    """And an address: a name alone says nothing of a price."""
    table = read_prices().entries
    assert table
    for price in table:
        assert price.date
        assert price.source.startswith("http")
        assert price.base_url
        assert 0 < price.input < price.output


def test_an_estimate_is_what_was_measured_times_the_calls() -> None:
    """Rounds of calls under way at once make the time."""
    mode = replace(MODE, measured=ModeMeasurements(prompt_tokens=1000, completion_tokens=12.5, seconds=2.0))
    found = estimate(mode, 1152, PRICES, concurrency=64)
    assert (found.prompt_tokens, found.completion_tokens) == (1_152_000, 14_400)
    assert found.cost_usd == pytest.approx(1152 * (1000 * 2 + 12.5 * 10) / 1e6)
    assert found.seconds == 36.0
    assert found.words.startswith("openai:m: 1152 calls, 1,152,000 tokens in, 14,400 out, $2.45 ($2 in, $10 out per ")


def test_without_a_measurement_an_estimate_says_that_it_cannot_say() -> None:
    """Nothing is guessed."""
    found = estimate(MODE, 10, PRICES, concurrency=8)
    assert (found.prompt_tokens, found.cost_usd, found.seconds) == (None, None, None)
    assert "tokens unknown, cost unknown" in found.words
    assert "time unknown" in found.words
    assert estimate(RequestMode("scripted:depth"), 10, PRICES, concurrency=8).cost_usd == 0.0
