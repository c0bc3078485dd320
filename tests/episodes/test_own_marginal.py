"""A driver's own marginal drives in the same run: by its decisions on real pictures, drawn as often without looking."""

from collections import Counter
from pathlib import Path

import pytest

import tiny_worlds
from eyechart import episodes as study
from eyechart.episodes import Bounds, EpisodesRun, read_episodes, read_manifest
from eyechart.episodes.records import decided_by
from eyechart.errors import SpecError
from eyechart.limits import Limits
from eyechart.simulators import SIMULATORS
from eyechart.studies.closed_loop import score

LOOK, ONWARD, SILENT = (f"python:tiny_worlds:{name}" for name in ("look", "onward", "silent"))
FAILING = "python:tiny_worlds:failing"


@pytest.fixture(autouse=True)
def corridors(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the tiny worlds be opened."""
    for name, place in tiny_worlds.SIMULATORS.items():
        monkeypatch.setitem(SIMULATORS, name, place)


def planned(
    out: Path, *specs: str, seeds: int = 2, conditions: tuple[str, ...] = ("real",), **how: bool
) -> EpisodesRun:
    """Plan these drivers in the whole tiny world, models beside their own marginals."""
    drivers = study.with_marginals(specs, conditions, out, **how)
    return study.plan(study.Setup("tiny"), drivers, out, scenarios=["whole"], seeds=range(seeds), conditions=conditions)


def decisions(out: Path, policy: str) -> Counter[str]:
    """Return the decisions of who drove, by action or by the reason that there is none."""
    mine = [
        episode for episode in read_episodes(out) if episode.key.policy == policy and episode.key.condition == "real"
    ]
    taken = [step.decision for episode in mine for step in episode.steps]
    return Counter(one.action or f"no decision: {one.missing}" for one in taken)


@pytest.mark.slow
def test_who_is_constant_is_its_own_marginal_and_who_sees_is_not(tmp_path: Path) -> None:
    """Known answers: every drive of the constant model is the same; of who passes blocks its marginal crashes."""
    study.run(planned(tmp_path / "run", LOOK, ONWARD, SILENT, seeds=10, conditions=("real", "blank")))
    by_policy = {
        one.driver.policy: one for one in score(tmp_path / "run", resamples=200).blind if not one.is_of_pictures
    }
    assert {name: one.finding for name, one in by_policy.items()} == {
        LOOK: "differs",
        ONWARD: "identical",
        SILENT: "identical",
    }
    assert "nothing in them needs a picture" in by_policy[ONWARD].sentence
    assert "the timing of its actions matters" in by_policy[LOOK].sentence
    assert decisions(tmp_path / "run", f"marginal:{SILENT}").keys() == {"no decision: empty"}
    driven = {
        episode.key.condition
        for episode in read_episodes(tmp_path / "run")
        if episode.key.policy.startswith("marginal:")
    }
    assert driven == {"real"}, "it looks at no picture, so that other pictures change nothing"


@pytest.mark.slow
def test_it_waits_for_its_driver_and_keeps_the_counts_that_it_began_with(tmp_path: Path) -> None:
    """While the driver is cut it does not drive; more worlds later change nothing of what it draws by."""
    run, own = tmp_path / "run", f"marginal:{LOOK}"
    study.run(planned(run, LOOK), bounds=Bounds(concurrency=1, limits=Limits(calls=15)))
    assert len(list(read_episodes(run))) == 1, "one of its two episodes is over"
    assert (read_manifest(run).policies[own], own in {episode.key.policy for episode in read_episodes(run)}) == (
        "",
        False,
    )
    study.run(planned(run, LOOK))
    assert read_manifest(run).policies[own] == str(dict(sorted(decisions(run, LOOK).items(), reverse=True)))
    first, drawn = (
        read_manifest(run).policies[own],
        [episode for episode in read_episodes(run) if episode.key.policy == own],
    )
    assert len(drawn) == 2
    study.run(planned(run, LOOK, seeds=4))
    assert read_manifest(run).policies[own] == first
    assert str(dict(sorted(decided_by(LOOK, own, read_episodes(run)).items(), reverse=True))) == first
    assert [episode for episode in read_episodes(run) if episode.key.policy == own][:2] == drawn
    assert planned(run, LOOK, seeds=4).left() == ()


@pytest.mark.slow
def test_a_run_without_it_goes_on_so_and_it_may_be_left_out(tmp_path: Path) -> None:
    """An older run is not widened; asked for by name it drives beside whoever drove already."""
    run = tmp_path / "run"
    study.run(planned(run, LOOK, wanted=False))
    assert set(planned(run, LOOK).manifest.policies) == {LOOK}
    assert set(planned(run, LOOK, ONWARD).manifest.policies) == {LOOK, ONWARD, f"marginal:{ONWARD}"}
    assert planned(tmp_path / "blank", LOOK, conditions=("blank",)).manifest.policies.keys() == {LOOK}
    with pytest.raises(SpecError, match="draws from the decisions on real pictures, but this run has none"):
        planned(tmp_path / "blank", LOOK, f"marginal:{LOOK}", conditions=("blank",))
    study.run(planned(run, f"marginal:{LOOK}"))
    assert sum(decisions(run, f"marginal:{LOOK}").values()) > 0


def test_of_who_never_decided_it_is_an_error_that_says_so(tmp_path: Path) -> None:
    """Every call fails, each episode is left unfinished or an error: nothing is drawn, and nothing made up."""
    run = tmp_path / "run"
    worlds = {"scenarios": ["raising"], "seeds": [0]}
    drivers = study.with_marginals([ONWARD], ("real",), run)
    study.run(study.plan(study.Setup("tiny"), drivers, run, **worlds))  # type: ignore[arg-type]
    (model, own) = read_episodes(run)
    assert (model.ended, own.ended, own.steps) == ("error", "error", ())
    assert own.detail == (
        f"{ONWARD} has no decision in an episode with real pictures without an error: nothing to draw from"
    )
    cut = planned(tmp_path / "cut", FAILING)
    study.run(cut)
    assert {one.policy for one in cut.left()} == {FAILING, f"marginal:{FAILING}"}
