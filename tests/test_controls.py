"""Which controls a model is asked: those that could take away what its answers have come to, and no others."""

import pytest

import simulated
from eyechart.stats.statistic import Statistic
from eyechart.studies.battery.paper_statistics import Resampling
from eyechart.studies.battery.scores import statistics_of
from eyechart.verdicts import ALPHA, MARGIN, controls_wanted

ALL = ("lane_own", "lane_beside", "lead_mid_near", "lead_mid_far", "lead_absent", "real_again", "nudged")
EXCHANGE = ("lane_own", "lane_beside")
NAMES = tuple(statistics_of(simulated.answers(lambda *_: "SLOW", simulated.frames(steps=1)), Resampling(resamples=9)))


def found(
    unparsed: float | None = 0.0, net: float = 0.5, lane: float | None = None, **p: float | None
) -> dict[str, Statistic]:
    """Return the statistics of a model of which nothing could be claimed, but for what is given."""
    bare = {name: Statistic(None, 0) for name in NAMES}
    by_p = {name: Statistic(None, 100, p=one) for name, one in {"depth_interventional": 1.0, **p}.items()}
    nets = {"depth_net": Statistic(net, 100, (net, 1.0))}
    if lane is not None:
        nets["lane_net"] = Statistic(lane, 100, (lane, lane + 0.05))
    return {**bare, "unparsed_reference": Statistic(unparsed, 100), **by_p, **nets}


def wanted(statistics: dict[str, Statistic], *asked: str) -> tuple[str, ...]:
    """Return what a bank that supplies every control would be asked next."""
    return controls_wanted(statistics, supplied=ALL, conditions_run=asked)


def test_a_model_of_which_nothing_was_tested_is_asked_no_control() -> None:
    """Where nothing could be claimed, nothing could be taken away."""
    assert wanted(found()) == ()


def test_a_model_whose_replies_hold_no_decision_is_asked_no_control() -> None:
    """Too few decisions, or none at all, end every question."""
    assert wanted(found(unparsed=0.06, depth_interventional=1e-9)) == ()
    assert wanted(found(unparsed=None, depth_interventional=1e-9)) == ()
    assert wanted(found(unparsed=0.05, depth_interventional=1e-9)) == EXCHANGE


def test_a_reader_of_distance_is_asked_the_exchange_first_and_then_the_dose() -> None:
    """Five controls in two stages: own and beside, then the mids and the nudge."""
    reads = found(depth_interventional=1e-9)
    assert wanted(reads) == EXCHANGE
    exchanged = found(depth_interventional=1e-9, lane=0.5)
    assert wanted(exchanged, *EXCHANGE) == ("lead_mid_near", "lead_mid_far", "nudged")
    assert wanted(exchanged, *ALL) == ()


def test_a_follower_of_the_layout_is_not_asked_the_dose() -> None:
    """Once the exchange has failed only the nudge could take anything away."""
    for lane in (0.0, 0.07):  # bounded below the margin, and not shown to reach it
        assert wanted(found(depth_interventional=1e-9, lane=lane), *EXCHANGE) == ("nudged",)


@pytest.mark.parametrize("p", [ALPHA, None])
def test_the_thresholds_are_those_of_the_rules(p: float | None) -> None:
    """A p of .01 is none below it, and a bound of .10 reaches the margin."""
    assert wanted(found(depth_interventional=p)) == ()
    assert wanted(found(depth_interventional=ALPHA - 1e-9, net=MARGIN)) == EXCHANGE
    assert wanted(found(depth_interventional=ALPHA - 1e-9, net=MARGIN - 1e-9)) == ("nudged",)
    small = found(depth_interventional=1e-9, lane=MARGIN - 1e-9)
    assert wanted(small, *EXCHANGE) == ("nudged",)


def test_only_content_is_asked_the_nudge_alone() -> None:
    """Content by either test, corrected for both (Holm), is one condition more."""
    assert wanted(found(content_shuffled=0.004)) == ("nudged",)
    assert wanted(found(content_recoloured=0.004)) == ("nudged",)
    assert wanted(found(content_shuffled=0.006, content_recoloured=1.0)) == ()
    assert wanted(found(content_shuffled=0.006)) == ("nudged",)
    assert wanted(found(content_shuffled=0.006), "nudged") == ()


@pytest.mark.parametrize(
    "p",
    [
        {"presence": 1e-9, "bound_content_shuffled": 1e-9},
        {"bound_blank": 1e-9, "bound_content_shuffled": 1e-9},
        {"presence_response": 1e-9, "presence": 0.5, "bound_content_shuffled": 1e-9},
        {"presence": 1e-9, "bound_content_shuffled": ALPHA, "bound_blank": 1.0},
        {"bound_blank": 0.02, "bound_content_shuffled": 0.3},
    ],
    ids=["presence_only", "image_invariant", "refusal_effect", "undecided of content", "undecided of a blank"],
)
def test_an_absence_and_what_is_open_are_asked_a_picture_without_the_lead(p: dict[str, float]) -> None:
    """Who brakes for any lead seems to look at nothing, or to notice pictures, where every picture has a lead."""
    assert wanted(found(**p)) == ("lead_absent", "real_again")
    assert wanted(found(**p), "lead_absent", "real_again") == ()


def test_who_follows_the_file_is_asked_no_picture_without_the_lead() -> None:
    """It is undecided, and no answer to that picture would be sight."""
    assert wanted(found(repeat_over_nudged=1e-9, bound_blank=0.3), "nudged") == ()


def test_braking_that_goes_with_distance_by_observation_is_asked_the_nudge() -> None:
    """Without counterfactual pictures there is no exchange; with them the observation has no say."""
    assert wanted(found(depth_interventional=None, depth_observational=1e-9)) == ("nudged",)
    assert wanted(found(depth_interventional=0.5, depth_observational=1e-9)) == ()


def test_what_the_bank_cannot_supply_is_not_asked() -> None:
    """Half an exchange is none; a photograph bank is asked the nudge, and a bank without controls nothing."""
    reads = found(depth_interventional=1e-9)
    assert controls_wanted(reads, supplied=("lane_own", "nudged"), conditions_run=()) == ("nudged",)
    assert controls_wanted(reads, supplied=(), conditions_run=()) == ()
    exchanged = found(depth_interventional=1e-9, lane=0.5)
    assert controls_wanted(exchanged, supplied=(*EXCHANGE, "nudged"), conditions_run=EXCHANGE) == ("nudged",)


def test_the_exchange_is_asked_whole_and_once() -> None:
    """Where a bank supplies nothing else; and a model that was asked it in vain is asked the nudge."""
    reads = found(depth_interventional=1e-9)
    assert controls_wanted(reads, supplied=EXCHANGE, conditions_run=()) == EXCHANGE
    assert controls_wanted(reads, supplied=ALL, conditions_run=EXCHANGE) == ("nudged",)
    assert controls_wanted(reads, supplied=ALL, conditions_run=("lane_own",)) == ("lane_beside",)
