"""What the ladder's episodes cost: as ``Highway`` drives them, and as stock highway-env is stepped in the plain way.

The same episodes with the same actions, four ways: eyechart's drives with the ground truth of every moment, and
``gym.make``, ``env.reset(seed=…)`` and ``env.step`` with nothing patched and no rendering; then both once more with a
picture before every decision, the stock one by ``env.render`` as a user would. Every vehicle's position, heading and
speed must be equal byte for byte after every step before a ratio is printed. Gated: without pictures, at least 3 times
less CPU time than stock, in the greatest of ten pairs that alternate (one where pictures are drawn, which is reported).

``--seeds 1`` measures 28 of the 224 episodes. ``--processes`` measures what two processes of ``eyechart ladder`` cost
over two runs of one process each at the same time, which share nothing: at most 15 % more CPU time in the least of ten
pairs. Writes ``results/bench_drives.json``.
"""

import argparse
import hashlib
import json
import multiprocessing
import os
import resource
import statistics
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from eyechart.episodes import Bounds, run
from eyechart.policies import Observation, open_policy
from eyechart.seeds import key_seed
from eyechart.simulators import open_simulator
from eyechart.simulators.highway import Highway
from eyechart.simulators.highway.drives import LADDER
from eyechart.simulators.highway.world import SIMULATION_HZ
from eyechart.studies.closed_loop.ladder import plan_ladder
from pairs import PAIRS, alternating, keep, ratios

BOUND = 3.0
OVERHEAD = 1.15
MEANS = Highway.declared.commands
POLICIES = (*(f"constant:{action}" for action in MEANS), "random", "oracle")

Actions = dict[tuple[str, str, int], list[str]]
"""What was executed in each episode: policy, scenario and seed to actions."""
Digests = dict[tuple[str, str, int], list[str]]


def digest(world: Any) -> str:  # noqa: ANN401  (highway-env has no types)
    """Return the digest of the raw floats of every vehicle."""
    rows = [[*vehicle.position, vehicle.heading, vehicle.speed] for vehicle in world.road.vehicles]
    return hashlib.sha256(np.array(rows, dtype=np.float64).tobytes()).hexdigest()


def episodes(seeds: int) -> Iterator[tuple[str, str, int]]:
    """Yield every episode: policy, scenario and seed."""
    yield from ((policy, scenario, seed) for policy in POLICIES for scenario in LADDER for seed in range(seeds))


def drive(seeds: int, *, pictures: bool) -> tuple[Actions, Digests]:
    """Drive every episode as eyechart does, with the ground truth of every moment."""
    highway = open_simulator("highway")
    actions: Actions = {}
    digests: Digests = {}
    for spec, scenario, seed in episodes(seeds):
        policy = open_policy(spec, highway.declared.action_space, lambda _: {})
        world = highway.drive(scenario, seed)
        taken, seen, ended = [], [], None
        while ended is None:
            truth, frame = world.truth(), f"{scenario}/{seed}/{len(taken)}"
            if pictures:
                world.picture()
            moment = Observation(
                frame, len(taken), world.picture, truth, highway.declared.action_space, key_seed("bench", spec, frame)
            )
            action = policy.decide(moment).action
            assert action is not None
            ended = world.step(action).ended
            taken.append(action)
            seen.append(hashlib.sha256(world.state()).hexdigest())
        world.close()
        actions[spec, scenario, seed], digests[spec, scenario, seed] = taken, seen
    return actions, digests


def drive_stock(actions: Actions, *, pictures: bool) -> Digests:
    """Take the same actions in stock highway-env, by its public functions."""
    digests: Digests = {}
    for (spec, scenario, seed), taken in actions.items():
        setting = LADDER[scenario]
        config = {**setting.config, "simulation_frequency": SIMULATION_HZ}
        env: Any = gym.make(setting.env, config=config, render_mode="rgb_array" if pictures else None)
        env.reset(seed=seed)
        indexes = env.unwrapped.action_type.actions_indexes
        seen = []
        for action in taken:
            if pictures:
                env.render()
            env.step(indexes[MEANS[action]])
            seen.append(digest(env.unwrapped))
        env.close()
        digests[spec, scenario, seed] = seen
    return digests


def measure(seeds: int, pairs: int, *, pictures: bool) -> dict[str, float]:
    """Time both ways, with pictures or without; raises SystemExit where a state differs."""
    actions, ours = drive(seeds, pictures=False)

    def stock() -> None:
        seen = drive_stock(actions, pictures=pictures)
        for key, states in ours.items():
            if seen[key] != states:
                raise SystemExit(f"episode {key} has another state than in stock highway-env")

    mine, theirs = alternating(lambda: drive(seeds, pictures=pictures), stock, pairs)
    steps, found = sum(map(len, actions.values())), ratios(mine, theirs)
    seconds = {"eyechart_cpu_s": min(mine), "stock_cpu_s": min(theirs), "ratio": max(found)}
    middle = {"ratio_at_the_median": statistics.median(found)}
    return {"pairs": pairs, "episodes": len(actions), "steps": steps, **seconds, **middle}


def processes(seeds: int, pairs: int) -> dict[str, float]:
    """Return the CPU seconds of the ladder in one process, in two, and in one beside another that has nothing to share.

    Two busy cores make the same work cost more CPU time than one, whoever does it. So what two processes of a run lose
    is told against half of what two separate runs of one process each take at the same time. Of so many pairs that
    alternate the least ratio counts: other work on the machine comes and goes.
    """
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # with it every worker compiles its source anew
    seconds: dict[str, list[float]] = {"one": [], "two": [], "apart": []}
    for name in ("one", *("two", "apart", "apart", "two") * (pairs // 2)):
        before = _cpu()
        if name == "apart":
            beside = [multiprocessing.get_context("fork").Process(target=_ladder, args=(seeds, 1)) for _ in range(2)]
            for run_beside in beside:
                run_beside.start()
            for run_beside in beside:
                run_beside.join()
        else:
            _ladder(seeds, 2 if name == "two" else 1)
        seconds[name].append((_cpu() - before) / (2 if name == "apart" else 1))
    one, two, apart = (min(seconds[name]) for name in ("one", "two", "apart"))
    found = sorted(ratios(seconds["apart"], seconds["two"]))
    return {
        "one_process_cpu_s": one,
        "two_processes_cpu_s": two,
        "two_runs_apart_cpu_s_each": apart,
        "over_one": two / one,
        "overhead": found[0],
        "overhead_at_the_median": statistics.median(found),
        "pairs": len(found),
    }


def _ladder(seeds: int, count: int) -> None:
    with tempfile.TemporaryDirectory() as folder:
        run(plan_ladder(Path(folder) / "run", seeds=seeds), bounds=Bounds(processes=count))


def _cpu() -> float:
    who = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    return sum(used.ru_utime + used.ru_stime for used in map(resource.getrusage, who))


def main() -> None:
    """Measure, print, and exit 1 beyond a bound."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--seeds", type=int, default=8, help="seeds a scenario; 8 make 224 episodes")
    parser.add_argument("--pictures", action="store_true", help="measure with a picture a decision too")
    parser.add_argument("--processes", action="store_true", help="measure what two processes cost over one")
    parser.add_argument("--pairs", type=int, default=PAIRS, help="pairs that alternate, an even number")
    options = parser.parse_args()
    stages: dict[str, Callable[[], dict[str, float]]] = {
        "without_pictures": lambda: measure(options.seeds, options.pairs, pictures=False)
    }
    if options.pictures:
        stages["with_pictures"] = lambda: measure(options.seeds, 1, pictures=True)
    if options.processes:
        stages["processes"] = lambda: processes(options.seeds, options.pairs)
    found: dict[str, dict[str, float]] = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # gymnasium warns of what highway-env does on its own
        for name, stage in stages.items():
            found[name] = stage()
            if not options.json:
                values = ", ".join(f"{key} {value:.4g}" for key, value in found[name].items())
                print(f"{name.replace('_', ' ')}: {values}", flush=True)
    result = {"bound": BOUND, "bound_of_processes": OVERHEAD, **found}
    keep("bench_drives", result)
    if options.json:
        print(json.dumps(result, indent=1))
    else:
        print(f"states equal after every step; bound on the ratio without pictures {BOUND}")
    slow = found["without_pictures"]["ratio"] < BOUND
    sys.exit(1 if slow or found.get("processes", {}).get("overhead", 0.0) > OVERHEAD else 0)


if __name__ == "__main__":
    main()
