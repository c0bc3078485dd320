"""A bundle of drives holds until one number in it is changed, and then that is named, since worlds are driven again."""

import json
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import banks
import drives
from bundles import Change, edited, in_results, opened_ledger, repacked
from eyechart import episodes
from eyechart.bundle import ReplayCheck, Validation, validate, write_bundle
from eyechart.bundle import drives as checked
from eyechart.episodes import EPISODES, read_manifest
from eyechart.errors import SpecError
from eyechart.manifest import RUN
from eyechart.studies import hierarchy, prompts
from eyechart.studies.closed_loop.study import score
from eyechart.studies.structured import online
from eyechart.studies.structured.online import WorldCheck

pytestmark = pytest.mark.slow

MODEL = "scripted:distance"
POLICIES = ("constant:SLOW", "oracle", MODEL)
CARTPOLE = """
name = "cart"
actions = ["LEFT", "RIGHT"]
[gym]
numbers = { LEFT = 0, RIGHT = 1 }
"""


def _driven(out: Path, simulator: str = "rover", policies: tuple[str, ...] = POLICIES, **how: object) -> Path:
    """Drive a few short worlds."""
    worlds: dict[str, Any] = {"scenarios": ("single",), "seeds": (0,), **how}
    episodes.run(episodes.plan(simulator, policies, out, **worlds))
    return out


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a run in which two policies and a model drive."""
    return _driven(tmp_path_factory.mktemp("drives") / "ladder")


@pytest.fixture(scope="module")
def packed(run: Path) -> Path:
    """Return its bundle."""
    write_bundle(run, run.with_suffix(".zip"), resamples=100)
    return run.with_suffix(".zip")


def said(found: Validation) -> str:
    """Return every difference as a line."""
    return "\n".join(map(str, found.differences))


def _prompts(folder: Path) -> Path:
    bank = banks.build_bank(folder / "bank")
    prompts.run(prompts.plan(bank.root, ["scripted:depth"], folder / "study", prompts=("baseline", "minimal"), limit=6))
    return folder / "study"


def _hierarchy(folder: Path) -> Path:
    for part in ("lateral", "constrained"):
        found = hierarchy.PARTS[part]
        _driven(folder / "study" / part, found.simulator, found.policies, scenarios=("offset",))
    return folder / "study"


def _online(folder: Path, seeds: tuple[int, ...] = (0,)) -> Path:
    passed = tuple(WorldCheck("offset", seed, 24, "goal", {"STRAIGHT": 1}, 0.0) for seed in seeds)
    planned = online.plan("rover", ["scripted:scene_side_blind"], folder / "run", episodes=len(seeds), vetted=passed)
    simulator, view = online.open_simulator("rover"), planned.episodes.drivers.view
    online.run(replace(planned, vetted=tuple(online.check_world(simulator, "offset", seed, view) for seed in seeds)))
    online.check_seen(folder / "run")
    return folder / "run"


@pytest.fixture(scope="module")
def online_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return an online run of one world that no test changes."""
    return _online(tmp_path_factory.mktemp("online"))


def _cart(folder: Path) -> Path:
    (folder / "cart.toml").write_text(CARTPOLE)
    setup = episodes.Setup("gym:CartPole-v1", actions=folder / "cart.toml")
    episodes.run(episodes.plan(setup, ["constant:LEFT", "random"], folder / "run", seeds=(0,)))
    return folder / "run"


KINDS: dict[str, Callable[[Path], Path]] = {
    "gymnasium": _cart,
    "hierarchy": _hierarchy,
    "prompts": _prompts,
}


@pytest.mark.parametrize("kind", [*KINDS, "closed loop", "online"])
def test_a_bundle_of_each_kind_holds_in_a_fresh_process_elsewhere(
    kind: str, run: Path, online_run: Path, tmp_path: Path
) -> None:
    """Nothing of the run is left but the file; it is said beforehand how much is driven, and nothing is uncompared."""
    made, elsewhere = tmp_path / "made", tmp_path / "elsewhere"
    made.mkdir()
    elsewhere.mkdir()
    file = elsewhere / "it.zip"
    held = {"closed loop": run, "online": online_run}
    driven = KINDS[kind](made) if kind in KINDS else shutil.copytree(held[kind], made / "run")
    write_bundle(driven, file, resamples=100)
    made.rename(tmp_path / "gone")
    command = [sys.executable, "-c", "from eyechart.cli import main; main()", "validate", file.name, "--processes", "1"]
    done = subprocess.run(command, cwd=elsewhere, capture_output=True, text=True, check=False)
    assert done.stdout.startswith("holds: "), done.stdout + done.stderr
    assert done.returncode == 0
    again = re.search(r"(\d+) episodes driven again, (\d+) steps", done.stdout)
    assert (again is None) == (kind == "prompts")
    if again:
        words = r"driving (\d+) of \1 episodes? of \S+ again: \d+ steps? in 1 process, none longer"
        assert re.search(words, done.stderr)
        assert int(again[1]) > 0
    more = {
        "online": r"; then in one process: 1 world vetted again, [1-9]\d* steps, and [1-9]\d* frames checked anew",
        "prompts": r"recomputing 24 requests and the results of their replies, of 2 models in 2 cells: no call",
    }
    assert re.search(more.get(kind, ""), done.stderr)
    assert ("vetted again" in done.stderr) == (kind == "online")


def test_a_sample_bounds_the_worlds_that_are_vetted_again(tmp_path: Path) -> None:
    """As it does the episodes; what is left out is said, and the bound counts what is done."""
    write_bundle(_online(tmp_path, (0, 1)), tmp_path / "online.zip", resamples=100)
    heard: list[str] = []
    found = validate(tmp_path / "online.zip", again=ReplayCheck(sample=1, announce=heard.append))
    assert (found.differences, found.compared["vetted worlds"]) == ([], 1)
    assert "1 of 2 vetted worlds" in found.uncompared
    assert "1 world vetted again" in heard[0]


def test_the_same_drives_give_the_same_bytes(run: Path, packed: Path, tmp_path: Path) -> None:
    """So that a bundle's digest can be published; what a kill left half written is in none."""
    copied = shutil.copytree(run, tmp_path / run.name)
    with (copied / EPISODES).open("a") as file:
        file.write('{"key": {"policy": "ora')
    write_bundle(copied, tmp_path / "again.zip", resamples=100)
    assert (tmp_path / "again.zip").read_bytes() == packed.read_bytes()


def _record(change: Callable[[list[dict[str, Any]]], None]) -> Change:
    def apply(folder: Path) -> None:
        path = folder / "run" / EPISODES
        lines = [json.loads(line) for line in path.read_text().splitlines()]
        change(sorted(lines, key=lambda line: line["key"]["policy"]))
        path.write_text("".join(json.dumps(line, ensure_ascii=False, separators=(",", ":")) + "\n" for line in lines))

    return apply


def _action(lines: list[dict[str, Any]]) -> None:
    lines[0]["steps"][3]["decision"]["action"] = lines[0]["steps"][3]["executed_action"] = "STRAIGHT"


def _state(lines: list[dict[str, Any]]) -> None:
    digest = lines[1]["steps"][2]["rounded_state_sha256"]
    lines[1]["steps"][2]["rounded_state_sha256"] = ("1" if digest[0] == "0" else "0") + digest[1:]


def _reward(lines: list[dict[str, Any]]) -> None:
    lines[1]["steps"][4]["reward"] += 0.001


def _parameter(lines: list[dict[str, Any]]) -> None:
    lines[0]["key"]["seed"] = 1
    for step in lines[0]["steps"]:
        step["frame"] = step["frame"].replace("single/0", "single/1")


def _end(lines: list[dict[str, Any]]) -> None:
    digest = lines[0]["state_sha256"]
    lines[0]["state_sha256"] = ("1" if digest[0] == "0" else "0") + digest[1:]


def _bound(lines: list[dict[str, Any]]) -> None:
    lines[1]["max_steps"] += 1


def _failed(policy: str, steps: int, **said: object) -> Change:
    """Return a lie of whoever drove: an episode that went on is said to have ended in an error after so many steps."""

    def lie(lines: list[dict[str, Any]]) -> None:
        (one,) = (line for line in lines if line["key"]["policy"] == policy)
        one.update({"ended": "error", "detail": "worker lost", "state_sha256": "", **said})
        del one["steps"][steps:]

    return _record(lie)


@pytest.mark.parametrize(
    ("steps", "said"), [(0, {}), (2, {}), (2, {"detail": "it did not end within 2 steps", "max_steps": 2})]
)
def test_an_episode_in_error_is_driven_again_also_without_a_step(
    steps: int, said: dict[str, object], run: Path, tmp_path: Path
) -> None:
    """An error takes an episode out of every statistic: one that does not come again is named, and nothing holds."""
    (tmp_path / "made").mkdir()
    shutil.copytree(run, tmp_path / "made" / "run")
    for policy in POLICIES:
        _failed(policy, steps, **said)(tmp_path / "made")
    write_bundle(tmp_path / "made" / "run", tmp_path / "it.zip", resamples=100)
    found = validate(tmp_path / "it.zip")
    assert found.compared["episodes driven again"] == 3
    assert found.uncompared == ["how 3 episodes failed"]
    for policy in POLICIES:
        assert any(note.startswith("an error that did not happen again: ") and policy in note for note in found.notes)


def test_an_error_that_comes_again_is_compared(tmp_path: Path) -> None:
    """As the bound on decisions, which every episode of a run meets at the same step."""
    made = tmp_path / "run"
    planned = episodes.plan(episodes.Setup("rover", max_steps=3), POLICIES, made, scenarios=("single",), seeds=(0,))
    episodes.run(planned)
    write_bundle(made, tmp_path / "it.zip", resamples=100)
    found = validate(tmp_path / "it.zip")
    assert (found.outcome, found.uncompared, found.compared["episodes driven again"]) == ("holds", [], 3)


def _manifest(**values: object) -> Change:
    def change(folder: Path) -> None:
        held = read_manifest(folder / "run")
        (folder / "run" / RUN).write_text(replace(held, **values).as_text())

    return change


def _reply(folder: Path) -> None:
    with opened_ledger(folder) as ledger:
        changed = ledger.execute("UPDATE replies SET text = 'LEFT', row_sha256 = NULL WHERE rowid = 2").rowcount
        assert changed == 1


TEN: dict[str, tuple[Change, str]] = {
    "a step's action": (_record(_action), r"^episode 'constant:SLOW rover/single/0 real', step 3, decision: .*'SLOW'$"),
    "a state": (_record(_state), r"^episode 'oracle rover/single/0 real', step 2, rounded state \(SHA-256\): printed"),
    "a reward": (_record(_reward), r"^episode 'oracle rover/single/0 real', step 4, reward: printed"),
    "the state at the end": (_record(_end), r"^episode 'constant:SLOW .* real', state at the end \(SHA-256\): printed"),
    "a reply": (
        _reply,
        rf"^episode '{MODEL} rover/single/0 real', step 1, decision: printed '\w+', recomputed 'LEFT'$",
    ),
    "a seed": (_manifest(seed=1), r"^results\.json, runs, run, seed: printed '0', recomputed '1'$"),
    "a world's parameter": (_record(_parameter), r"^episode 'constant:SLOW rover/single/1 real', step 0, truth \w+:"),
    "a score": (
        in_results(lambda raw: raw["score"]["ladder"][0]["statistics"]["reward"].update(value=99.0)),
        r"^results\.json, ladder, 0, reward, value: printed '99\.0', recomputed '",
    ),
    "a table cell": (
        edited("tables/ladder.csv", r"(?<=,)\d+\.\d+", "98765.4"),
        r"^tables/ladder\.csv, .*: printed '98765\.4', recomputed '",
    ),
    "a figure": (edited("report.html", r'(?<=<path d="M )\d+', "9"), r"^report\.html, .*path d: printed 'M 9"),
    "a price": (
        in_results(lambda raw: raw["prices"][MODEL].update(input=3.0)),
        rf"^results\.json, prices, {MODEL}, input: printed '3\.0', recomputed '0\.0'$",
    ),
    "the bound of an episode": (
        _record(_bound),
        r"^results\.json, episodes_sha256, run, oracle: printed '\w+', recomputed '\w+'$",
    ),
    "a manifest field": (
        _manifest(max_steps=999),
        r"^results\.json, runs, run, max_steps: printed '1000', recomputed '999'$",
    ),
    "the controllers' source": (
        edited("source/eyechart/policies/scripted.py", "LEFT", "RIGHT"),
        r"^source/eyechart/policies/scripted\.py: printed 'another text', recomputed 'this eyechart's'$",
    ),
}


TOGETHER = (
    ("a step's action", "a state", "a reply"),
    ("a reward", "the state at the end"),
    ("a world's parameter", "the bound of an episode"),
    ("a seed", "a manifest field"),
    ("a score", "a table cell", "a figure", "a price", "the controllers' source"),
)
"""Changes that have nothing to do with each other, and are made in one bundle."""


def test_every_change_is_made_in_one_bundle() -> None:
    """None is forgotten."""
    assert sorted(TEN) == sorted(what for together in TOGETHER for what in together)


@pytest.mark.parametrize("together", TOGETHER)
def test_one_changed_number_is_named(together: tuple[str, ...], packed: Path, tmp_path: Path) -> None:
    """Each of several; whoever changed it has mended the digests of all files."""

    def change(folder: Path) -> None:
        for what in together:
            TEN[what][0](folder)

    found = validate(repacked(packed, tmp_path, change))
    for what in together:
        assert re.search(TEN[what][1], said(found), re.MULTILINE), said(found)
    assert not found.holds


def test_a_frame_that_is_said_to_pass_is_checked_again(online_run: Path, tmp_path: Path) -> None:
    """An online run's record of checked frames: one frame more, and a fault that nobody finds, are named."""
    write_bundle(online_run, tmp_path / "online.zip", resamples=100)
    lies = (
        ('"why": null', '"why": "frame 3: dark"', "why: printed 'frame 3: dark', recomputed 'None'"),
        ('"frames": ', '"frames": 1', "frames seen in 'scripted:scene_side_blind rover/offset/0', frames: printed '1"),
    )

    def change(folder: Path) -> None:
        for old, new, _ in lies:
            edited("run/seen.json", old, new)(folder)

    found = validate(repacked(tmp_path / "online.zip", tmp_path, change))
    for *_, line in lies:
        assert line in said(found), said(found)


def test_of_an_episode_the_first_step_that_differs_is_named_alone(packed: Path, tmp_path: Path) -> None:
    """Every later one follows from it."""
    lines = said(validate(repacked(packed, tmp_path, _record(_action)))).splitlines()
    steps = {re.search(r"step (\d+)", line)[1] for line in lines if line.startswith("episode 'constant")}  # type: ignore[index]
    assert steps == {"3"}


def test_a_changed_action_map_is_another_world(tmp_path: Path) -> None:
    """Of an environment that Gymnasium ships: LEFT pushes to the right."""
    write_bundle(_cart(tmp_path), tmp_path / "cart.zip", resamples=100)
    change = edited(f"run/{episodes.ACTION_MAP}", "LEFT = 0, RIGHT = 1", "LEFT = 1, RIGHT = 0")
    found = validate(repacked(tmp_path / "cart.zip", tmp_path, change))
    assert re.search(r"^actions\.toml, digest: printed '\w+', recomputed '\w+'$", said(found), re.MULTILINE)
    assert re.search(
        r"^episode 'constant:LEFT gym:CartPole-v1/default/0 real', step 0, rounded", said(found), re.MULTILINE
    )


def test_with_other_versions_truth_is_compared_and_nothing_is_said_to_hold(run: Path, tmp_path: Path) -> None:
    """The first step that differs in the third decimal is named; the outcome is neither "holds" nor "differs"."""
    other = tmp_path / "other"
    other.mkdir()
    for name in (RUN, EPISODES, "ledger.sqlite", "ledger.sqlite.counter"):
        (other / name).write_bytes((run / name).read_bytes())
    held = read_manifest(other)
    name, here = next(iter(held.world.items()))
    (other / RUN).write_text(replace(held, world={**held.world, name: "0.0.1"}).as_text())
    write_bundle(other, tmp_path / "same.zip", resamples=100)
    same = validate(tmp_path / "same.zip")
    assert same.outcome == "holds, 3 episodes, driven with other versions not compared"
    assert f"not comparable: driven with {name} 0.0.1, here {here}" in same.notes
    assert "decisions and truth to 3 decimals are the same at every step" in same.notes

    def further(lines: list[dict[str, Any]]) -> None:
        step = next(line for line in lines if line["key"]["policy"] == "oracle")["steps"][5]
        step["truth"]["lead_gap_m"] = (step["truth"]["lead_gap_m"] or 0.0) + 0.01

    (tmp_path / "bundle" / "run").mkdir(parents=True)
    (tmp_path / "bundle" / "run" / EPISODES).write_bytes((other / EPISODES).read_bytes())
    _record(further)(tmp_path / "bundle")
    (other / EPISODES).write_bytes((tmp_path / "bundle" / "run" / EPISODES).read_bytes())
    write_bundle(other, tmp_path / "apart.zip", resamples=100)
    apart = validate(tmp_path / "apart.zip")
    assert (apart.differences, apart.holds) == ([], False)
    assert any(
        "first step that differs: episode 'oracle rover/single/0 real', step 5, truth" in note for note in apart.notes
    )


def test_a_module_that_a_run_names_is_never_imported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are recomputed, no world is opened, and that is said; so of what the hierarchy says it was driven in."""
    (tmp_path / "evil_world.py").write_text("raise SystemExit('imported')")
    monkeypatch.syspath_prepend(tmp_path)
    simulator = "gym:evil_world:Thing-v0"
    made = drives.drive("constant:SLOW", drives.always("SLOW"), simulator=simulator, seeds=range(2), steps=4)
    run = drives.make_run(tmp_path / "run", made, simulator=simulator)
    write_bundle(run, tmp_path / "it.zip", resamples=100)
    found = validate(tmp_path / "it.zip")
    assert (found.differences, found.uncompared) == ([], [f"the drives of {simulator}"])
    assert (
        f"nothing was driven again: '{simulator}' names a module, and a validation runs no foreign code" in found.notes
    )
    (tmp_path / "study").mkdir()
    run.rename(tmp_path / "study" / "lateral")
    write_bundle(_hierarchy(tmp_path / "honest"), tmp_path / "honest.zip", resamples=100)
    evil = {name: (tmp_path / "study" / "lateral" / name).read_bytes() for name in (RUN, EPISODES)}

    def change(folder: Path) -> None:
        for name, content in evil.items():
            (folder / "run" / "lateral" / name).write_bytes(content)

    lines = said(validate(repacked(tmp_path / "honest.zip", tmp_path, change)))
    assert "run/lateral is no part of the hierarchy: it is not driven in rover-mpc-lateral" in lines
    assert "evil_world" not in sys.modules


def test_a_marginal_draws_by_the_counts_that_its_run_recorded(run: Path, tmp_path: Path) -> None:
    """The run that it was made of is not in the bundle; other counts are other decisions."""
    made = _driven(tmp_path / "run", policies=(f"marginal:{run},oracle",))
    write_bundle(made, tmp_path / "it.zip", resamples=100)
    assert validate(tmp_path / "it.zip").holds
    spec = f"marginal:{run},oracle"
    found = validate(repacked(tmp_path / "it.zip", tmp_path, _manifest(policies={spec: "{'SLOW': 7}"})))
    assert re.search(
        r"^episode 'marginal:.*', step \d+, decision: printed '\w+', recomputed 'SLOW'$", said(found), re.MULTILINE
    )


def test_the_marginal_of_a_driver_of_the_run_is_held_to_that_drivers_decisions(tmp_path: Path) -> None:
    """It is driven again by the counts of the record; others are named as such, and so is the first other decision."""
    own = f"marginal:{MODEL}"
    write_bundle(_driven(tmp_path / "run", policies=(MODEL, own)), tmp_path / "it.zip", resamples=100)
    assert validate(tmp_path / "it.zip").holds
    counts = read_manifest(tmp_path / "run").policies
    lines = said(validate(repacked(tmp_path / "it.zip", tmp_path, _manifest(policies={**counts, own: "{'SLOW': 7}"}))))
    assert f"""run.json, counts of '{own}': printed '{{'SLOW': 7}}', recomputed '{counts[own]}'""" in lines


def test_what_is_not_driven_again_is_said(packed: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By a sample that was asked for, or by the bound of the work."""
    heard: list[str] = []
    found = validate(packed, again=ReplayCheck(sample=1, announce=heard.append))
    assert found.outcome == "holds, 2 of 3 episodes of rover not compared"
    assert (found.compared["episodes driven again"], found.differences) == (1, [])
    assert re.match(r"driving 1 of 3 episodes of rover again: \d+ steps in 1 process, none longer than 30 s", heard[0])
    monkeypatch.setattr(checked, "MOST_DRIVEN", 1)
    assert validate(packed).uncompared == ["3 of 3 episodes of rover"]
    monkeypatch.setattr(checked, "MOST_STEPS", 5)
    assert "it has more than 5 steps, the most that are validated: nothing is recomputed" in said(validate(packed))


def test_a_machine_that_computes_other_last_bits_is_told_from_a_changed_record(packed: Path, tmp_path: Path) -> None:
    """Every exact state is another, each to another, and the rounded ones are the same: not compared, and said."""

    def turned(lines: list[dict[str, Any]]) -> None:
        for line in lines:
            line["state_sha256"] = line["state_sha256"][::-1]

    found = validate(repacked(packed, tmp_path, _record(turned)))
    assert found.uncompared == ["exact states"]
    assert "another kind of machine" in "\n".join(found.notes)


def test_drives_are_not_read_anew_in_a_bundle(run: Path, tmp_path: Path) -> None:
    """They went as their replies were read then."""
    with pytest.raises(SpecError, match="--reread is for one run on a bank"):
        write_bundle(run, tmp_path / "it.zip", reread=True)
    assert score(run).ladder
