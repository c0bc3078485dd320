"""The paper's cases arise from servers that behave so: asked over HTTP, run and scored as any model, then judged."""

from collections.abc import Callable
from pathlib import Path

import behaving
import pytest
from behaving import Behaving, Habit

from eyechart.frames import FrameBank
from eyechart.modes import RequestMode
from eyechart.stats.statistic import Statistic
from eyechart.studies import battery
from eyechart.verdicts import Verdict, judge

MODEL = "openai:m"
CALLS = 144 * 8

Asked = tuple[dict[str, Statistic], Verdict]
Ask = Callable[..., Asked]


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return the 144 frames that every server is asked about."""
    return behaving.build_bank(tmp_path_factory.mktemp("arising") / "bank")


@pytest.fixture
def ask(bank: FrameBank, tmp_path: Path) -> Ask:
    """Return a function that runs a whole battery on a server, and gives its statistics and its verdict."""

    def asked(habit: Habit, course: int = 0, *, max_tokens: int = 1024) -> Asked:
        out = tmp_path / f"run-{max_tokens}"
        with Behaving(habit, course) as server:
            mode = RequestMode(MODEL, base_url=server.base_url, seed=True, max_tokens=max_tokens)
            outcome = battery.run(
                battery.plan(bank.root, [mode], out, extent=battery.BatterySelection(controls="none")), concurrency=16
            )
        assert (outcome.stopped, dict(outcome.set_aside), server.requests) == (None, {}, CALLS)
        score = battery.score(out)
        return dict(score.models[MODEL].statistics), judge(score)[MODEL]

    return asked


def note(verdict: Verdict, begins: str) -> str:
    """Return the one note that begins with these words."""
    (result,) = [one for one in verdict.notes if one.startswith(begins)]
    return result


def absent(verdict: Verdict, *begin: str) -> bool:
    """Return whether no note begins so."""
    return not [one for one in verdict.notes if one.startswith(begin)]


@pytest.mark.slow
def test_a_server_that_declines_grey_pictures_shows_a_refusal_effect(ask: Ask) -> None:
    """54 of 144 blank and 1 of 144 real replies hold no action: V = .46, p < 1e-4; over decisions V = 0, p = 1."""
    found, verdict = ask(behaving.declines_grey, 37)
    response, decision = found["cramers_v_real_blank"], found["cramers_v_real_blank.decision"]
    table = dict(zip(response.detail["rows"], response.detail["table"], strict=True))
    assert {name: dict(zip(response.detail["columns"], row, strict=True)) for name, row in table.items()} == {
        "blank": {"SLOW": 90, "UNPARSED": 54},
        "real": {"SLOW": 143, "UNPARSED": 1},
    }
    assert (round(response.value, 2), response.p < 1e-4, decision.value, decision.p) == (0.46, True, 0.0, 1.0)
    assert (verdict.calibrated.label, verdict.paper.label) == ("refusal_effect", "refusal_effect")
    assert verdict.trust == (
        "It refuses some non-pictures; what a picture shows changes its decision on less than 0.1 of the frames: "
        "no authority."
    )
    words = note(verdict, "refusal effect: the picture decides whether it answers, not what it answers: ")
    assert "V(real, blank) = 0.459, p = 6.4e-15 over outputs" in words
    assert "V(real, blank) = 0.000, p = 1.0000 over decisions" in words
    assert words.endswith("no decision in 54 of 144 to blank and 1 of 144 to real")
    assert [guard.name for guard in verdict.failed] == ["degeneracy"]
    assert absent(verdict, "noise floor", "truncated", "image token")


@pytest.mark.slow
def test_a_server_that_tosses_a_coin_is_told_by_its_noise_floor_alone(ask: Ask) -> None:
    """With s = .79 and IDI = .77, IDI_adj is -.021, although V has p < 1e-4 and I(A;g) p < .05: self-inconsistent."""
    found, verdict = ask(behaving.tosses, 14252)
    assert found["noise_floor"].detail["k"] == 144 - 30
    assert [round(found[name].value, 3) for name in ("noise_floor", "idi", "idi_adj")] == [0.792, 0.771, -0.021]
    assert (round(found["cramers_v"].value, 3), found["cramers_v"].p < 1e-4) == (0.302, True)
    assert found["mutual_information.decision"].p < 0.05
    assert found["clears_floor"].value == 0.0
    assert (verdict.calibrated.label, verdict.paper.label) == ("self_inconsistent", "self_inconsistent")
    assert verdict.paper.decided_by == "clears_floor"
    words = note(verdict, "noise floor: it repeats its answer on 21% of identical pictures (s = 0.792): ")
    assert "IDI = 0.771 is not above 1.5 s, and IDI_adj = -0.021" in words
    assert "not told from its own noise, whatever Cramér's V says (V = 0.302, p = " in words
    assert absent(verdict, "refusal effect", "truncated", "image token")
    assert verdict.failed == ()


@pytest.mark.slow
def test_a_server_that_thinks_past_its_budget_is_not_scored(ask: Ask) -> None:
    """28 % of the calls are cut at 4096 tokens, and 64 % of them at 1024: the budget decides, and is named."""
    for budget, cut, share in ((4096, 325, "28.2%"), (1024, 737, "64.0%")):
        found, verdict = ask(behaving.thinks_long, 177, max_tokens=budget)
        assert found["unparsed_rate"].detail["reasons"] == {"truncated": cut}
        assert found["unparsed_rate"].n == CALLS
        assert (verdict.calibrated.label, verdict.paper.label) == ("not_scorable", "not_scorable")
        words = note(
            verdict, f"truncated: {cut} of 1152 replies ({share}) were cut off at the budget of {budget} tokens"
        )
        assert "nothing stands in their place" in words
        assert absent(verdict, "refusal effect", "image token")


@pytest.mark.slow
def test_a_server_that_minds_whether_there_is_a_picture_and_hardly_which(ask: Ask) -> None:
    """agree(blank) = .903 with agree(text_only) = .097: the presence of an image matters more than its content.

    The paper gives this model no verdict. Its rules call it presence_only; ours see besides that the glare in 14 frames
    does change its answer.
    """
    found, verdict = ask(behaving.minds_its_slot)
    assert [found[f"agree.{name}"].detail["k"] for name in ("blank", "text_only")] == [130, 14]
    assert [round(found[f"agree.{name}"].value, 3) for name in ("blank", "text_only")] == [0.903, 0.097]
    assert found["image_token"].value == pytest.approx(116 / 144)
    assert found["image_token.decision"].as_dict()["detail"] == {"b": 130, "c": 14}
    assert (verdict.calibrated.label, verdict.paper.label) == ("content", "presence_only")
    words = note(verdict, "image token: agree(blank) = 0.903 with agree(text_only) = 0.097: ")
    assert "that there is a picture matters more than what it shows (difference 0.806 [" in words
    assert absent(verdict, "refusal effect", "noise floor", "truncated")
    assert words in str(verdict)
