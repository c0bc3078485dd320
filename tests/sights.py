"""Random drives, prompts and scene estimates, the same for a seed in every version, and what is said of each."""

import hashlib
from collections.abc import Callable, Mapping
from pathlib import Path
from random import Random

from evidences import as_recorded
from eyechart.costs import Account
from eyechart.episodes import Episode, EpisodeKey, Step
from eyechart.spaces.discrete import DRIVING
from eyechart.spaces.space import Decision
from eyechart.stats.statistic import Statistic
from eyechart.studies import closed_loop, hierarchy, prompts
from eyechart.studies.closed_loop.drives import Driver, Drives
from eyechart.studies.closed_loop.visual_dependence import comparison_words, findings
from eyechart.studies.hierarchy import visual_dependence as planners
from eyechart.verdicts.admission import ADMITS, CLAUSES, hold
from eyechart.verdicts.labels import ADMITTED

WAYS = ("steady", "steady", "steady", "better", "worse", "coin", "varied", "silent", "halting", "failed")
"""How a driver drives under a condition; who drives steadily under two drives the same."""
SHOWN = ("blank", "text_only", "noise", "shuffled", "frozen", "mirrored", "real_repeat")
_PS = (1e-6, 0.001, 0.0499999, 0.05, 0.2, 1.0, None)


def _decision(rng: Random, way: str, number: int) -> Decision[str]:
    if way == "silent" or (way == "halting" and number % 2 == 0):
        return Decision(None, "unparsed", "no_action")
    if way == "failed" and rng.random() < 0.4:
        return Decision(None, "error")
    return Decision(rng.choice(DRIVING.actions) if way in {"coin", "varied"} else "SLOW")


def _episode(rng: Random, key: EpisodeKey, way: str, ends: str) -> Episode:
    """Return a drive of two steps that ended well, in a crash, or as its way has it."""
    well = {"better": 0.95, "worse": 0.1, "coin": 0.5}.get(way)
    good = Random(key.world).random() < 0.5 if well is None else rng.random() < well  # noqa: S311 - no secret
    pace = rng.choice((1.0, 2.0, 3.0)) if way in {"coin", "varied"} else 1.0 + good
    steps = tuple(
        Step(
            number,
            key.frame(number),
            _decision(rng, way, number),
            "SLOW",
            {},
            reward=pace,
            speed_mps=pace,
            distance_m=pace * (1 + number),
            crashed=not good and number == 1,
        )
        for number in range(2)
    )
    ended = ends if good else "crash"
    return Episode(key, steps, ended, hashlib.sha256(f"{key.world} {pace} {ended}".encode()).hexdigest())


def drives_of(rng: Random, policy: str, simulator: str, conditions: tuple[str, ...], worlds: int) -> list[Drives]:
    """Return who drove in so many worlds with real pictures, and with others as well, as well as not, or otherwise."""
    drives, ends = [], rng.choice(("goal", "time"))
    mostly = rng.choice(("better", "steady", *WAYS))
    for condition in ("real", *conditions):
        way = mostly if condition == "real" or rng.random() < 0.3 else rng.choice(("worse", "worse", *WAYS))
        keys = [EpisodeKey(policy, simulator, "light", seed, condition) for seed in range(worlds)]
        episodes = tuple(_episode(rng, key, way, ends) for key in keys)
        driver = Driver(simulator, policy, condition)
        drives.append(Drives(driver, Path(), episodes, (), DRIVING, is_model=policy.startswith("model")))
    return drives


def _shown(one: Statistic | None) -> str:
    return "" if one is None else f"{one.value} {one.n} {one.p}"


def of_drives(rng: Random) -> str:
    """Return what is said of the comparisons of the next drivers, and of each of them in an index."""
    worlds, drives = rng.choice((0, 3, 5, 8, 12, 25, 25)), list[Drives]()
    for policy in rng.sample(("model-a", "model-b", "constant:SLOW"), rng.choice((1, 2))):
        drives += drives_of(rng, policy, "highway", tuple(rng.sample(SHOWN, rng.choice((1, 2, 3)))), worlds)
    if rng.random() < 0.4:
        drawn = drives_of(rng, "marginal:a", "highway", (), worlds)[0]
        marginal = Drives(
            drawn.driver, drawn.path, drawn.episodes, (), DRIVING, is_model=False, marginal_of=drives[0].driver.policy
        )
        drives.append(marginal)
    score = closed_loop.ClosedLoopScore(tuple(drives), None, 99, ())
    said = [
        " ".join(
            (one.finding, one.label.family, one.label.says, str(comparison_words(one)), one.decisive, one.sentence)
        )
        + f" {one.as_dict()}"
        for one in score.blind
    ]
    index = findings(score).items()
    said += [f"{who} {one.label} {one.tone} {one.decided_by} {_shown(one.estimate)}" for who, one in index]
    return as_recorded("\n".join(said))


def of_planners(rng: Random) -> str:
    """Return what is said of the next planners in each arm, and of each in an index."""
    arms = [name for name in hierarchy.PARTS if name.endswith("-models")]
    drives: dict[str, tuple[Drives, ...]] = {}
    for part in rng.sample(arms, rng.choice((1, 2, 3))):
        conditions = rng.choice((("mirrored", "blank", "shuffled"), ("blank", "shuffled"), ("blank",), ("shuffled",)))
        simulator, worlds = hierarchy.PARTS[part].simulator, rng.choice((3, 8, 25, 25))
        drives[part] = tuple(drives_of(rng, "model-a", simulator, conditions, worlds))
    score = hierarchy.HierarchyScore(drives, 99)
    labels = {(completion.part, completion.policy): completion.label for completion in score.completions}
    said = [
        f"{part} {labels[part, spec].family} {planners.why_not(many)}"
        for (part, spec), many in planners.pairs_of(score).items()
    ]
    index = planners.findings(score).items()
    said += [f"{who} {one.label} {one.tone} {one.decided_by} {_shown(one.estimate)}" for who, one in index]
    return "\n".join([*said, *score.words])


def of_prompts(rng: Random) -> str:
    """Return what is said of the next model under its prompts, and of each cell."""
    cells, usual = [], rng.choice((_PS, (1e-6,), (0.2, None), (None,)))
    varied = rng.choice(((1.0,), (1.0, 2.0, None), (3.0,)))
    for number in range(rng.choice((1, 1, 2, 3, 5, 7))):
        n, p = rng.choice((10, 100)), {name: rng.choice(usual) for name in prompts.DEPENDENCE}
        found = {name: Statistic(rng.choice((None, 0.1, 0.7)), n, p=p[name]) for name in prompts.DEPENDENCE}
        found |= {"modal_share": Statistic(rng.choice((None, 0.4, 1.0)), n)}
        found |= {"distinct_outputs": Statistic(rng.choice(varied), n)}
        cells.append(prompts.CellScore(f"p{number}", "m", "p@1", 64, "none", n, n, found, p, _ACCOUNT, ()))
    (held,) = prompts.by_model(cells)
    each = [f"{cell.name} {(cell.label.family, cell.label.says)}" for cell in cells]
    return "\n".join([held.tone, held.label, held.words, held.why_not, *each])


_ACCOUNT = Account(0, 0, 0, {}, 0, {}, {}, None, None, None, None, {}, None, None, None, 0.0, None, 0)


def estimates(rng: Random) -> dict[str, Statistic]:
    """Return the statistics of an estimator, at, beside and away from what the clauses of admission ask for."""
    usual, result = rng.choice((1.0, 0.9, 0.6)), dict[str, Statistic]()
    for name in CLAUSES:
        least = _LEAST[name]
        value = 10.0 if rng.random() < usual else rng.choice((least, least - 1e-6, least + 0.1, 0.0, None))
        result[name] = Statistic(value, rng.choice((0, 16, 32)), note="nothing was asked" if value is None else "")
    return result


_LEAST: Mapping[str, float] = {
    "parse": 0.95,
    "close_accuracy": 0.75,
    "balanced_accuracy": 0.75,
    "scene_equivariance": 0.65,
    "action_equivariance": 0.75,
    "actions": 3,
    "directional": 2,
}


def of_admission(rng: Random) -> str:
    """Return whether the next estimator is admitted, and what is said of each clause."""
    found = estimates(rng)
    ruling = ADMITS.evaluate(found)
    tone = {"sees": "good", "blind": "bad", "open": "open"}[ADMITTED[ruling.label].family]
    first = f"{ruling.label.replace('_', ' ')} {tone} {ruling.decided_by} {_shown(ruling.statistic)}"
    return "\n".join([first, *(f"{one.name} {one.passes} {one.words} {one.as_dict()}" for one in hold(found))])


SAID: Mapping[str, tuple[Callable[[Random], str], int, int]] = {
    "drives": (of_drives, 21, 40),
    "planners": (of_planners, 22, 40),
    "prompts": (of_prompts, 23, 1000),
    "admission": (of_admission, 24, 1000),
}
"""What is said of the next of a kind, by the seed of the kind, and how many are a block."""
