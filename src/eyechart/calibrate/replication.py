"""One replication: one simulated bank, all known controllers on it, and both sets of rules on what they answered."""

import random
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import msgspec
import numpy as np

from eyechart import __version__, verdicts
from eyechart.calibrate.early import MEASURED, count_rejections, sampled, stop_early
from eyechart.calibrate.known import KNOWN, NULLS, Known, Shows, adversaries, answer_all, by_sight, deserved, is_false
from eyechart.calibrate.tally import Calibration, Outcome, Ruled, Tried, called, tally
from eyechart.calibrate.world import SETTINGS, Setting, World, make_world
from eyechart.calls import Reply
from eyechart.conditions import CONDITIONS, CONTROLS, COUNTERFACTUALS
from eyechart.errors import SpecError, require_known
from eyechart.frames import LEAD_GAP
from eyechart.models.scripted import Answer
from eyechart.processes import open_pool
from eyechart.seeds import key_seed
from eyechart.spaces.discrete import DRIVING
from eyechart.spaces.space import Decision
from eyechart.stats.resampling import holm
from eyechart.stats.statistic import Statistic, cannot_say
from eyechart.studies.battery.answers import ABSENT, Answers
from eyechart.studies.battery.calibrated import COUNTERFACTUAL_TESTS, Calibrated, Found
from eyechart.studies.battery.published import Resampling
from eyechart.studies.battery.scoring import statistics_of

RESAMPLES = 999
"""Resamples of each permutation test; the level of such a test does not depend on their number."""

DRAWN = frozenset(name for name, one in CONDITIONS.items() if "counterfactual" in one.needs)
"""What a bank without counterfactual pictures lacks."""

Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True)
class Task:
    """One replication of one setting. Everything random in it comes from these three."""

    setting: str
    replication: int
    seed: int


@dataclass(frozen=True, slots=True)
class Made:
    """What came of one task: an outcome a controller, and in the default setting what else is tried."""

    outcomes: list[Outcome]
    rejected: list[int]
    tried: list[Tried]


def calibrate(
    *,
    replications: int,
    seed: int = 0,
    processes: int = 1,
    settings: Sequence[str] | None = None,
    progress: Progress | None = None,
    keep: Path | None = None,
) -> Calibration:
    """Simulate ``replications`` banks of every setting and judge all known controllers on each.

    The result depends on the seed and on nothing else, least of all on ``processes``. ``progress`` is called with
    (banks done, banks in all). ``keep`` names a file of what was found so far: banks that stand in it are not simulated
    again, the others are appended as they are done. Raises SpecError for an unknown setting, a number below 1, a file
    that holds something else, or where ``eyechart-organisms`` is not installed.
    """
    adversaries()
    chosen = tuple(settings) if settings is not None else tuple(SETTINGS)
    for name in chosen:
        require_known(f"setting '{name}'", name, SETTINGS)
    if replications < 1 or processes < 1:
        raise SpecError(f"give 1 or more replications and processes, not {replications} and {processes}")
    tasks = [Task(name, number, seed) for number in range(replications) for name in chosen]
    made = _make(tasks, processes, {} if keep is None else _kept(keep, seed), keep, progress)
    outcomes = [(task.setting, made[task].outcomes) for task in tasks]
    counted = tally(outcomes, settings=chosen, replications=replications, seed=seed, resamples=RESAMPLES)
    ever = zip(*(made[task].rejected for task in tasks if made[task].rejected), strict=True)
    tried = (one for task in tasks for one in made[task].tried)
    return replace(counted, ever=tuple(map(sum, ever)), adversaries=called(tried))


def _make(
    tasks: Sequence[Task], processes: int, known: Mapping[Task, Made], keep: Path | None, progress: Progress | None
) -> dict[Task, Made]:
    """Return what is known of tasks and what is made of the others, which is appended to a file where one is named."""
    found, todo = dict(known), [task for task in tasks if task not in known]
    with ExitStack() as opened:
        file = None if keep is None else opened.enter_context(keep.open("ab"))
        made_now = zip(todo, opened.enter_context(_mapped(todo, processes)), strict=True)
        for done, (task, made) in enumerate(made_now, len(tasks) - len(todo) + 1):
            found[task] = made
            if file is not None:
                file.write(_JSON.encode((task, made)) + b"\n")
                file.flush()
            if progress is not None:
                progress(done, len(tasks))
    return found


_JSON = msgspec.json.Encoder()
KEPT = "eyechart-calibration-banks/1"


def _kept(file: Path, seed: int) -> dict[Task, Made]:
    """Return what a file holds of banks that are done, and begin it where it is not there; half a line is cut off."""
    head = _JSON.encode({"format": KEPT, "eyechart": __version__, "seed": seed}) + b"\n"
    try:
        if not file.exists():
            file.write_bytes(head)
        text = file.read_bytes()
        if not text.startswith(head):
            raise SpecError(
                f"{file} does not hold banks of seed {seed} and of eyechart {__version__}; name another file"
            )
        whole = text[: text.rindex(b"\n") + 1]
        if whole != text:
            file.write_bytes(whole)
        return dict(msgspec.json.decode(line, type=tuple[Task, Made]) for line in whole.splitlines()[1:])
    except (OSError, msgspec.MsgspecError) as error:
        raise SpecError(f"{file}: {error}") from None


@contextmanager
def _mapped(tasks: Sequence[Task], processes: int) -> Iterator[Iterator[Made]]:
    """Yield what is made of tasks in their order, by this process or by several others."""
    if processes == 1:
        yield map(_whole, tasks)
        return
    with open_pool(processes) as pool:
        yield pool.map(_whole, tasks)


def _whole(task: Task) -> Made:
    """Return the outcomes of a task and, once a replication, rejections of early stopping and what adversaries got."""
    once = task.setting == "default"
    return Made(replicate(task), rejections(task) if once else [], try_adversaries(task) if once else [])


def rejections(task: Task) -> list[int]:
    """Return how often each null of early stopping was ever rejected, on the frames of the task's bank."""
    key = ("calibrate", task.seed, task.setting, task.replication)
    world = make_world(SETTINGS[task.setting], np.random.default_rng(key_seed(*key, "world")))
    return count_rejections(world.frames, random.Random(key_seed(*key, "nulls")))  # noqa: S311 - no secret


def try_adversaries(task: Task) -> list[Tried]:
    """Return what every adversary is called on the bank of a task, asked in stages as a run asks."""
    key = ("calibrate", task.seed, task.setting, task.replication)
    world = make_world(SETTINGS[task.setting], np.random.default_rng(key_seed(*key, "world")))
    how = Resampling(resamples=RESAMPLES, seed=key_seed(*key, "tests"), intervals=False)
    found = []
    for name, one in adversaries().items():
        known = Known(name, one.says, by_sight(one.decide), "", "", "")
        rng = random.Random(key_seed(*key, name))  # noqa: S311 - no secret
        answers = answers_of(known, SETTINGS[task.setting], world, rng)
        asked = staged(answers, how)
        statistics = statistics_of(asked, how)
        lateral = verdicts.lateral_rules(statistics, asked.directions())
        turns = verdicts.earns_lateral(statistics, lateral.label)
        label = verdicts.calibrated_rules(statistics, turns=turns)[0].label
        found.append(Tried(name, label, lateral.label))
    return found


def staged(answers: Answers, how: Resampling) -> Answers:
    """Return those of a model's answers that a run would have asked for: controls only where they could matter."""
    asked = [name for name in answers.decisions if name not in CONTROLS]
    answers = sampled(answers, how.seed)
    while True:
        part = replace(answers, decisions={name: answers.decisions[name] for name in asked})
        found = Found(Calibrated(part, how))
        more = verdicts.controls_wanted(found, supplied=CONTROLS, asked=asked)
        if not more:
            return part
        asked += [name for name in more if name in answers.decisions]


def replicate(task: Task) -> list[Outcome]:
    """Draw the bank of a task and return what both sets of rules say of every known controller on it."""
    setting = SETTINGS[task.setting]
    key = ("calibrate", task.seed, task.setting, task.replication)
    world = make_world(setting, np.random.default_rng(key_seed(*key, "world")))
    how = Resampling(resamples=RESAMPLES, seed=key_seed(*key, "tests"), intervals=False)
    given = {
        name: answers_of(one, setting, world, random.Random(key_seed(*key, name)))  # noqa: S311 - no secret
        for name, one in KNOWN.items()
    }
    answered = {name: staged(one, how) for name, one in given.items()}
    found = {name: statistics_of(one, how) for name, one in answered.items()}
    # The paper corrects over the models of a run; here these are all controllers on one bank.
    corrected = holm([one["cramers_v"].p for one in found.values()])
    order = key_seed(*key, "order")
    return [
        _outcome(KNOWN[name], setting, (given[name], answered[name]), found[name], p, order)
        for name, p in zip(found, corrected, strict=True)
    ]


def answers_of(known: Known, setting: Setting, world: World, rng: random.Random) -> Answers:
    """Return a controller's answers to a world, read from its replies as those of a run are."""

    @cache
    def decision(answer: Answer | None) -> Decision[str] | None:
        if answer is None:
            return None
        return DRIVING.read(answer if isinstance(answer, Reply) else Reply(text=answer, finish_reason="stop"))

    decisions = {condition: tuple(map(decision, column)) for condition, column in answer_all(known, world, rng).items()}
    gap = LEAD_GAP if setting.gaps else None
    return Answers(known.name, world.frames, DRIVING, gap, decisions)


def without_counterfactuals(answers: Answers, found: Mapping[str, Statistic]) -> dict[str, Statistic]:
    """Return the statistics that the same answers would give on a bank without counterfactual pictures."""
    kept = {name: column for name, column in answers.decisions.items() if name not in DRAWN}
    missing = cannot_say("the bank has no counterfactual pictures")
    bare = Calibrated(replace(answers, decisions=kept), Resampling()).tests()
    of_all = {name: bare[name]() for name in ("kappa_pooled", "turns_boxed")}
    return {**found, **dict.fromkeys(COUNTERFACTUAL_TESTS, missing), **of_all}


def _outcome(
    known: Known,
    setting: Setting,
    given: tuple[Answers, Answers],
    found: Mapping[str, Statistic],
    corrected: float | None,
    order: int,
) -> Outcome:
    """Return what was said of a controller by its answers, all that it can give and those that a run asked for."""
    every, answers = given
    lateral = verdicts.lateral_rules(found, answers.directions()).label
    rulings, early = [], []
    for counterfactuals in (True, False):
        shows = Shows(
            counterfactuals=counterfactuals,
            exchanges=setting.exchanges,
            scenarios=len(set(answers.scenarios.tolist())),
            varied=_varied(answers, counterfactuals=counterfactuals),
        )
        statistics = found if counterfactuals else without_counterfactuals(answers, found)
        label = verdicts.calibrated_rules(statistics, turns=verdicts.earns_lateral(statistics, lateral))[0].label
        rulings.append(Ruled(label, deserved(known, shows), is_false(label, known.name, varied=shows.varied)))
        if setting.name in MEASURED:
            how = {"counterfactuals": counterfactuals, "varied": shows.varied}
            early.append(stop_early(every, label, lateral, seed=order, **how))
    return Outcome(
        controller=known.name,
        paper=verdicts.paper_rules(found, {"cramers_v": corrected}).label,
        rulings=(rulings[0], rulings[1]),
        lateral=lateral,
        p_values={test: found[test].p for test in NULLS},
        early=tuple(early),
    )


def _varied(answers: Answers, *, counterfactuals: bool) -> bool:
    """Return whether a controller gave more than one answer over all conditions of a bank."""
    first = answers.responses("real")[0]
    drawn = (*COUNTERFACTUALS, *CONTROLS)
    shown = [name for name in answers.decisions if counterfactuals or name not in drawn]
    return any(bool(((given != first) & (given != ABSENT)).any()) for given in map(answers.responses, shown))
