"""The probe pins the mode in which an endpoint of known ways is best asked, or says why there is none."""

from pathlib import Path

import pytest

from eyechart.models.prices import Price, Prices
from eyechart.modes import RequestMode, read_mode, write_mode
from eyechart.probe import ProbeError, ProbeResult, default_sample, doctor, probe
from eyechart.probe.mode_probe import MOST_CALLS, MOST_TOKENS
from eyechart.spaces.discrete import DRIVING
from faults import FaultServer, Loopback
from seeing import Endpoint, OllamaEndpoint, served

PRICED = Prices((Price("openai:m", 1000.0, 1000.0, "2026-01-01", "a test"),))


def pinned(prompt: str = "baseline", given: dict[str, object] | None = None, **what: object) -> ProbeResult:
    """Return what the probe finds of an endpoint, asked with the fields that are given; every call is told."""
    fields = given or {}
    with served(**what) as server:
        mode = RequestMode.from_dict({"spec": "openai:m", "base_url": server.base_url, **fields})
        result = probe(mode, fixed=fields, sample=default_sample(prompt))
        assert result.spent.calls == server.requests == result.measured.calls <= MOST_CALLS
        return result


def test_what_is_measured_stands_in_the_mode_and_its_file(tmp_path: Path) -> None:
    """Tokens, seconds, what the picture adds, what binds and matters, and what names the model."""
    result = pinned()
    measured = result.measured
    assert (measured.sees_image, measured.image_tokens, measured.completion_tokens_max) == (True, 85, 3)
    assert measured.prompt_tokens == 85 + len(default_sample().query(0).user.split())
    assert (measured.schema_binds, measured.temperature_matters, measured.seed_matters) == (True, True, True)
    assert measured.unknown_fields_ignored is True
    assert measured.seconds >= measured.seconds_min > 0
    assert measured.facts["served"] == "fault-model-2026-01-01 fp_1"
    assert measured.facts["picture"] == "14 of 14 right, where guessing gives 2.4 (p <10⁻⁴)"
    write_mode(tmp_path / "mode.toml", result.mode)
    assert read_mode(tmp_path / "mode.toml") == result.mode


def test_a_schema_is_pinned_where_it_binds_and_the_prompt_asks_for_json() -> None:
    """The prompt decides the form of the answer; a schema that is ignored, or an error, pins nothing."""
    assert pinned("structured").mode.structured == "json_schema"
    assert pinned("baseline").mode.structured == "none"
    ignored = pinned("structured", binds_schema=False)
    assert (ignored.mode.structured, ignored.measured.schema_binds) == ("none", False)
    result = pinned("structured", {"structured": "json_schema"}, binds_schema=False)
    assert result.mode.structured == "json_schema"
    assert "the mode has a schema, but the probe did not see it bind" in result.notes[0]


def test_fields_that_are_refused_are_found_by_the_error() -> None:
    """A hosted model that thinks takes another token field, no temperature, and no unknown field."""
    result = pinned(only_new_tokens=True, only_default_temperature=True, refuses_unknown=True)
    assert (result.mode.token_field, result.mode.temperature, result.mode.seed) == ("max_completion_tokens", None, True)
    assert (result.measured.unknown_fields_ignored, result.measured.temperature_matters) == (False, None)
    assert len(result.notes) == 3


@pytest.mark.parametrize(("needs", "budget"), [(3, 256), (200, 448), (700, 1408), (9000, 18048)])
def test_the_budget_grows_until_replies_complete_and_gets_a_margin(needs: int, budget: int) -> None:
    """Twice the longest complete reply, in steps of 64, and 256 at least."""
    result = pinned(thinks=needs)
    assert (result.mode.max_tokens, result.measured.completion_tokens_max) == (budget, needs)


def test_a_budget_that_never_suffices_or_that_was_given_is_an_error() -> None:
    """With what to do."""
    with pytest.raises(ProbeError, match=f"cut off even at {MOST_TOKENS} tokens") as never:
        pinned(thinks=MOST_TOKENS + 1)
    assert never.value.spent.calls == 5
    with pytest.raises(ProbeError, match="50 tokens: raise --max-tokens"):
        pinned(given={"max_tokens": 50}, thinks=60)
    assert pinned(given={"max_tokens": 77}).mode.max_tokens == 77


def test_a_blind_model_is_pinned_as_one_that_does_not_see() -> None:
    """With the cause, which the guard will quote."""
    result = pinned(sees=False, counts_pictures=False)
    assert (result.measured.sees_image, result.measured.image_tokens) == (False, 0)
    assert "the picture is dropped on the way" in result.measured.facts["picture"]


def test_one_that_cannot_be_asked_is_an_error_with_the_cause() -> None:
    """A text-only backend, a limit on cost, a cost that nobody knows."""
    with pytest.raises(ProbeError, match="text-only backend"):
        pinned(takes_pictures=False)
    with served() as server:
        mode = RequestMode("openai:m", base_url=server.base_url)
        with pytest.raises(ProbeError, match="--max-cost is 1") as dear:
            probe(mode, prices=PRICED, max_cost=1.0)
        assert dear.value.limit
        assert dear.value.spent.calls == server.requests
        nearly = probe(mode, prices=PRICED).spent.cost_usd - 0.01
        with pytest.raises(ProbeError, match=r"was not finished: .* were spent"):
            probe(mode, prices=PRICED, max_cost=nearly - 0.5)
        with pytest.raises(ProbeError, match="the cost of openai:m is not known, so --max-cost cannot hold"):
            probe(mode, max_cost=1.0)


def test_a_server_that_draws_by_itself_is_told_by_its_repeats() -> None:
    """A seed that changes nothing, and a temperature of 0 that repeats nothing, matter not."""

    class Drawing(Endpoint):
        def answer(self, user: str, picture: bytes | None, asked: dict[str, object]) -> str:
            return str(self.dice.random()) if "sentence" in user else super().answer(user, picture, asked)

    with FaultServer([Drawing()]) as server:
        measured = probe(RequestMode("openai:m", base_url=server.base_url)).measured
    assert (measured.temperature_matters, measured.seed_matters) == (False, False)


def test_a_model_of_one_reply_says_nothing_of_temperature_and_seed() -> None:
    """It would be the same under any; one that is greedy whatever it is asked for is told from it."""

    class Greedy(Endpoint):
        def answer(self, user: str, picture: bytes | None, asked: dict[str, object]) -> str:
            return "A red fox runs home." if "sentence" in user else super().answer(user, picture, asked)

    measured = pinned(dumb='{"action": "STOP"}').measured
    assert (measured.temperature_matters, measured.seed_matters) == (None, None)
    with FaultServer([Greedy()]) as server:
        measured = probe(RequestMode("openai:m", base_url=server.base_url)).measured
    assert (measured.temperature_matters, measured.seed_matters) == (False, None)


def test_the_sample_is_the_runs_own_question() -> None:
    """The default is a built-in prompt on sketches, with the driving actions for a schema."""
    sample = default_sample("structured")
    query = sample.query(4)
    assert (query.system, query.user) == (sample.questions[0][0].system, sample.questions[0][0].user)
    assert query.schema == DRIVING.schema()
    assert sample.query(4, picture=False).image is None
    assert sample.wants_json
    assert not default_sample("minimal").wants_json


def test_a_model_of_ollama_is_probed_and_examined_over_its_own_api() -> None:
    """Its format binds, its budget grows as num_predict, and its capabilities are named where it is blind."""
    stand_in = OllamaEndpoint()
    stand_in.endpoint = Endpoint(thinks=300)
    with Loopback(stand_in.app()) as at:
        mode = RequestMode("ollama:llava", base_url=f"http://127.0.0.1:{at.port}")
        found = probe(mode, sample=default_sample("structured"))
        assert (found.mode.structured, found.mode.max_tokens, found.measured.sees_image) == ("json_schema", 640, True)
        assert found.measured.facts["quantisation"] == "Q4_K_M"
        assert "template" not in found.measured.facts
        stand_in.endpoint = Endpoint(sees=False)
        stand_in.capabilities = ["completion"]
        blind = doctor(mode)
    assert blind.exit_code == 1
    assert "its capabilities are completion" in blind.causes[-1]
