"""A run of episodes: what it records, that nothing is asked or driven twice, and what it refuses to resume."""

import json
from collections import Counter
from pathlib import Path

import pytest

import banks
from eyechart import episodes as study
from eyechart.calls import CallKey
from eyechart.episodes import Bounds, Episode, EpisodesRun, read_episodes, read_manifest, write_episodes
from eyechart.episodes.records import recorded
from eyechart.errors import LedgerError, SpecError
from eyechart.ledger import Ledger
from eyechart.limits import Limits
from eyechart.manifest import LEDGER, RUN
from eyechart.models.prices import read_prices
from eyechart.modes import RequestMode
from eyechart.studies import battery

LOOK = "python:tiny_worlds:look"
SILENT = "python:tiny_worlds:silent"


def planned(out: Path, *specs: str, seeds: int = 2, **asked: object) -> EpisodesRun:
    """Plan these drivers in the whole tiny world; what is asked goes to its worlds or to the plan."""
    worlds = {name: asked.pop(name) for name in ("seed", "max_steps") if name in asked}
    asked = {"scenarios": ["whole"], "seeds": range(seeds), **asked}
    return study.plan(study.Setup("tiny", **worlds), specs, out, **asked)  # type: ignore[arg-type]


def by_key(out: Path) -> dict[tuple[str, int, str], Episode]:
    """Return the episodes by policy, seed and condition."""
    return {(episode.key.policy, episode.key.seed, episode.key.condition): episode for episode in read_episodes(out)}


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a run of a looking model, a silent one and two policies, with real and with blank pictures."""
    import tiny_worlds  # noqa: PLC0415
    from eyechart import simulators  # noqa: PLC0415

    out = tmp_path_factory.mktemp("driven") / "run"
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(simulators.SIMULATORS, "tiny", tiny_worlds.SIMULATORS["tiny"])
        plan = planned(out, LOOK, SILENT, "constant:STRAIGHT", "oracle", conditions=["real", "blank"])
        study.run(plan, bounds=Bounds(processes=2, concurrency=3))
    return out


def test_a_model_and_a_policy_that_decide_alike_drive_alike(driven: Path) -> None:
    """The model looks and the oracle is told; on blank pictures the model is a constant one, and crashes as it does."""
    episodes = by_key(driven)
    assert len(episodes) == 4 * 2 * 2
    for seed in range(2):
        looking, told = episodes[LOOK, seed, "real"], episodes["oracle", seed, "real"]
        assert looking.state_sha256 == told.state_sha256
        assert [looking.ended, looking.actions()] == ["goal", told.actions()]
        blind, constant = episodes[LOOK, seed, "blank"], episodes["constant:STRAIGHT", seed, "real"]
        assert blind.state_sha256 == constant.state_sha256 != looking.state_sha256
        assert blind.has_crashed
        assert episodes["oracle", seed, "blank"].actions() == told.actions()


def test_where_there_is_no_decision_the_fail_safe_is_executed_and_never_credited(driven: Path) -> None:
    """A model that answers nothing stands still until the time is over."""
    silent = by_key(driven)[SILENT, 0, "real"]
    assert silent.ended == "time"
    assert {(step.decision.action, step.decision.missing) for step in silent.steps} == {(None, "empty")}
    assert set(silent.actions()) == {"SLOW"}


def test_every_step_of_a_model_is_one_call_of_the_ledger_and_its_reply_is_the_decision(driven: Path) -> None:
    """The key of a call names simulator, scenario, seed and step; policies that are no models make none."""
    prompt, space = read_manifest(driven).prompt.key, read_manifest(driven).action_space
    expected: dict[CallKey, object] = {
        episode.key.call(prompt, step.step): step.decision
        for episode in read_episodes(driven)
        if episode.key.policy in {LOOK, SILENT}
        for step in episode.steps
    }
    with Ledger(driven / LEDGER) as ledger:
        found = {key: space.read(reply) for spec in (LOOK, SILENT, "oracle") for key, reply in ledger.replies(spec)}
        numbers = {sent.number for spec in (LOOK, SILENT) for sent in ledger.attempts(spec)}
    assert found == expected
    assert numbers == {1}
    assert any(key.frame == "tiny/whole/1/003" and key.condition == "blank" for key in found)


def test_a_finished_run_drives_and_asks_nothing_again(driven: Path) -> None:
    """The same plan has nothing left."""
    before = (driven / study.EPISODES).read_bytes(), (driven / LEDGER).stat().st_size
    plan = planned(driven, LOOK, "oracle", conditions=["real", "blank"])
    assert plan.left() == ()
    study.run(plan, bounds=Bounds(processes=2))
    assert ((driven / study.EPISODES).read_bytes(), (driven / LEDGER).stat().st_size) == before


def test_equal_seeds_give_equal_records_in_any_number_of_processes(tmp_path: Path) -> None:
    """Order of ending aside, one process and three write the same episodes."""
    runs = []
    for processes in (1, 3):
        plan = planned(tmp_path / str(processes), "random", LOOK, seeds=3, conditions=["noise", "shuffled"])
        study.run(plan, bounds=Bounds(processes=processes, concurrency=processes))
        runs.append(sorted(episode.as_line() for episode in read_episodes(tmp_path / str(processes))))
    assert runs[0] == runs[1]
    assert len(runs[0]) == 12


def test_a_torn_last_line_is_driven_anew(driven: Path, tmp_path: Path) -> None:
    """What a kill left of the last episode is cut off, and the file is whole again."""
    plan = planned(tmp_path / "run", "oracle")
    study.run(plan)
    file = tmp_path / "run" / study.EPISODES
    whole = file.read_bytes()
    file.write_bytes(whole[:-40])
    assert len(plan.left()) == 1
    study.run(plan)
    assert file.read_bytes() == whole
    write_episodes(tmp_path, read_episodes(driven))
    with (tmp_path / study.EPISODES).open("a") as damaged:
        damaged.write("{}\n")
    with pytest.raises(LedgerError, match="line 17 is no episode: it has no key"):
        list(read_episodes(tmp_path))


def test_policies_seeds_and_conditions_may_be_added_and_nothing_else_may_change(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A run is resumed only as it was begun; the error says what differs."""
    out = tmp_path / "run"
    study.run(planned(out, "oracle", seeds=1))
    study.run(planned(out, "random", seeds=2, conditions=["mirrored"]))
    manifest = read_manifest(out)
    assert (tuple(manifest.policies), manifest.seeds, manifest.conditions) == (
        ("oracle", "random"),
        (0, 1),
        ("real", "mirrored"),
    )
    assert Counter(episode.key.policy for episode in read_episodes(out)) == {"oracle": 1, "random": 2}
    for asked, words in (
        ({"seed": 3}, "has seed 0, now seed 3"),
        ({"prompt": "minimal"}, "has prompt baseline@.*, now prompt minimal@"),
        ({"max_steps": 9}, "has --max-steps 1000, now 9 was asked for"),
    ):
        with pytest.raises(LedgerError, match=words):
            planned(out, "oracle", **asked)
    monkeypatch.setenv("TINY_VERSION", "2")
    with pytest.raises(LedgerError, match=r"has world \{'tiny': '1'\}, now world \{'tiny': '2'\}"):
        planned(out, "oracle")


def test_another_mode_and_a_folder_of_something_else_are_refused(driven: Path, tmp_path: Path) -> None:
    """Two ways of asking in one ledger could not be told apart; no file of anybody else is touched."""
    with pytest.raises(LedgerError, match="in another mode"):
        study.plan("tiny", [RequestMode(LOOK, max_tokens=7)], driven, scenarios=["whole"], seeds=[0])
    (tmp_path / "letter.txt").touch()
    with pytest.raises(LedgerError, match="exists and is no run"):
        planned(tmp_path, "oracle")
    (tmp_path / RUN).write_text(json.dumps({"format": "eyechart-run/2"}))
    with pytest.raises(LedgerError, match="of format 'eyechart-run/2', not 'eyechart-episodes/1'"):
        planned(tmp_path, "oracle")


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"scenarios": ["snow"]}, "'tiny' has no scenario 'snow'; known: whole, black"),
        ({"conditions": ["upside_down"]}, "unknown condition 'upside_down' of a closed loop"),
        ({"seeds": []}, "need seeds from 0 on"),
        ({"prompt": "structured.toml"}, "cannot be read"),
    ],
)
def test_what_cannot_be_driven_is_refused_before_anything_is_written(
    tmp_path: Path, asked: dict[str, object], words: str
) -> None:
    """In words that say what there is."""
    with pytest.raises(SpecError, match=words):
        study.plan("tiny", ["oracle"], tmp_path / "run", **asked)  # type: ignore[arg-type]
    with pytest.raises(SpecError, match="at least one --policy"):
        study.plan("tiny", [], tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_a_limit_cuts_episodes_and_a_higher_one_goes_on_without_asking_again(tmp_path: Path) -> None:
    """Seven calls, and then the rest; each call was made once."""
    plan = planned(tmp_path / "run", LOOK)
    (estimate,) = study.expected(plan, read_prices(None), concurrency=1)
    assert estimate.calls == 24
    first = study.run(plan, bounds=Bounds(limits=Limits(calls=7)))
    assert first.stopped is not None
    assert plan.left()
    (rest,) = study.expected(plan, read_prices(None), concurrency=1)
    assert rest.calls == 24 - 7
    second = study.run(plan, bounds=Bounds(limits=Limits(calls=1000)))
    assert (second.stopped, plan.left()) == (None, ())
    with Ledger(tmp_path / "run" / LEDGER) as ledger:
        sent = list(ledger.attempts(LOOK))
    assert (
        len(sent)
        == len({attempt.key for attempt in sent})
        == sum(len(episode.steps) for episode in read_episodes(tmp_path / "run"))
    )


def test_a_marginal_is_counted_from_a_run_of_either_kind(driven: Path, tmp_path: Path) -> None:
    """Decisions on real pictures, of the one controller that is meant; the fail-safe is nobody's decision."""
    looked = [step.decision.action for seed in range(2) for step in by_key(driven)[LOOK, seed, "real"].steps]
    assert recorded(Path(f"{driven},{LOOK}")) == Counter(looked)
    assert recorded(Path(f"{driven},{SILENT}")) == {}
    with pytest.raises(SpecError, match="holds 4 controllers; name one, as marginal:"):
        recorded(driven)
    with pytest.raises(SpecError, match="no decisions of 'nobody'"):
        recorded(Path(f"{driven},nobody"))
    bank = banks.build_bank(tmp_path / "bank", steps=4)
    battery.run(battery.plan(bank.root, ["scripted:constant"], tmp_path / "asked", conditions=["real", "blank"]))
    assert recorded(tmp_path / "asked") == {"SLOW": len(bank)}
    with pytest.raises(LedgerError, match="no manifest of a run"):
        recorded(tmp_path)


def test_an_environment_of_ones_own_is_driven_by_its_action_map_which_the_run_keeps(tmp_path: Path) -> None:
    """Worlds that tell no scene: the pool of ``shuffled`` is driven at random, and a resume needs no map again."""
    cart = tmp_path / "cart.toml"
    cart.write_text(
        'actions = ["LEFT", "RIGHT"]\nmirror_pairs = [["LEFT", "RIGHT"]]\n[gym]\nmirror = "horizontal"\n'
        "most_steps = 8\n[gym.numbers]\nLEFT = 0\nRIGHT = 1\n",
        encoding="utf-8",
    )
    out = tmp_path / "run"
    asked = {"seeds": [0], "conditions": ["real", "shuffled"]}
    worlds = study.Setup("gym:CartPole-v1", actions=cart)
    study.run(study.plan(worlds, ["random", "constant:LEFT"], out, **asked))  # type: ignore[arg-type]
    cart.unlink()
    assert study.plan("gym:CartPole-v1", ["random"], out, **asked).left() == ()  # type: ignore[arg-type]
    (first, *_) = read_episodes(out)
    assert (first.key.simulator, first.ended in {"crash", "time"}) == ("gym:CartPole-v1", True)
    assert {(episode.distance_m, episode.speed_mps) for episode in read_episodes(out)} == {(None, None)}
    assert '"speed_mps":null,"distance_m":null' in (out / study.EPISODES).read_text()
    row = study.summarise(read_episodes(out))[0]
    assert (row.distance_m, row.speed_mps, row.reward) == (None, None, 8.0)
