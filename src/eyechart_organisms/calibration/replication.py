"""One replication: a simulated bank, all known controllers on it, and both sets of rules."""

import hashlib
import random
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import msgspec
import numpy as np

import eyechart
from eyechart import __version__, verdicts
from eyechart.calls import Reply
from eyechart.clusters import Workers, require_engine
from eyechart.conditions import CONDITIONS, CONTROLS, COUNTERFACTUALS
from eyechart.errors import SpecError, require_known
from eyechart.frames import LEAD_GAP
from eyechart.models.scripted import Answer
from eyechart.seeds import key_seed
from eyechart.spaces.discrete import DRIVING
from eyechart.spaces.space import Decision
from eyechart.stats.resamples import holm
from eyechart.stats.statistic import Statistic, not_available
from eyechart.studies.battery.answers import ABSENT, Answers
from eyechart.studies.battery.calibrated_statistics import COUNTERFACTUAL_TESTS, CalibratedTests, LazyStatistics
from eyechart.studies.battery.paper_statistics import Resampling
from eyechart.studies.battery.scores import statistics_of
from eyechart_organisms.adversaries import ADVERSARIES
from eyechart_organisms.calibration.early_stops import MEASURED, count_rejections, sampled, stop_early
from eyechart_organisms.calibration.known_answers import (
    KNOWN,
    NULLS,
    BankCapabilities,
    KnownController,
    answer_all,
    by_sight,
    deserved,
    is_false,
)
from eyechart_organisms.calibration.tally import (
    AdversaryTrial,
    Calibration,
    ReplicationOutcome,
    RuleOutcome,
    label_counts,
    tally,
)
from eyechart_organisms.calibration.world import SETTINGS, Setting, World, make_world

RESAMPLES = 999
"""Resamples of each permutation test; its level does not depend on their number."""

DRAWN = frozenset(name for name, condition in CONDITIONS.items() if "counterfactual" in condition.needs)
"""The conditions that a bank without counterfactual pictures lacks."""

Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True)
class Task:
    """One replication of one setting, the source of all its randomness."""

    setting: str
    replication: int
    seed: int


@dataclass(frozen=True, slots=True)
class ReplicationResult:
    """The results of one task: an outcome per controller, and the default setting's trials."""

    outcomes: list[ReplicationOutcome]
    rejected: list[int]
    tried: list[AdversaryTrial]


def calibrate(
    *,
    replications: int,
    seed: int = 0,
    processes: int = 1,
    settings: Sequence[str] | None = None,
    progress: Progress | None = None,
    keep: Path | None = None,
    engine: str = "local",
) -> Calibration:
    """Simulate ``replications`` banks of every setting and judge all known controllers on each.

    The result depends on the seed alone, not on ``processes`` or ``engine``: processes of this
    machine ("local"), or tasks on a cluster ("ray"). ``progress`` gets (banks done,
    total). ``keep`` is a file of finished banks: they are not simulated again, and new ones are
    appended. Raises SpecError for an unknown setting, a number below 1, or a file with other content.
    """
    chosen = tuple(settings) if settings is not None else tuple(SETTINGS)
    for name in chosen:
        require_known(f"setting '{name}'", name, SETTINGS)
    if replications < 1 or processes < 1:
        raise SpecError(f"give 1 or more replications and processes, not {replications} and {processes}")
    tasks = [Task(name, number, seed) for number in range(replications) for name in chosen]
    require_engine(engine)
    workers = Workers(processes, engine)
    made = _make(tasks, workers, {} if keep is None else _kept(keep, seed), keep, progress)
    outcomes = [(task.setting, made[task].outcomes) for task in tasks]
    counted = tally(outcomes, settings=chosen, replications=replications, seed=seed, resamples=RESAMPLES)
    ever = zip(*(made[task].rejected for task in tasks if made[task].rejected), strict=True)
    tried = (trial for task in tasks for trial in made[task].tried)
    return replace(counted, ever=tuple(map(sum, ever)), adversaries=label_counts(tried))


def _make(
    tasks: Sequence[Task],
    workers: Workers,
    known: Mapping[Task, ReplicationResult],
    keep: Path | None,
    progress: Progress | None,
) -> dict[Task, ReplicationResult]:
    """Return the known results of tasks and those made now, which are appended to ``keep``."""
    result, todo = dict(known), [task for task in tasks if task not in known]
    with ExitStack() as opened:
        file = None if keep is None else opened.enter_context(keep.open("ab"))
        made_now = zip(todo, opened.enter_context(workers.mapped(_whole, todo)), strict=True)
        for done, (task, made) in enumerate(made_now, len(tasks) - len(todo) + 1):
            result[task] = made
            if file is not None:
                file.write(_JSON.encode((task, made)) + b"\n")
                file.flush()
            if progress is not None:
                progress(done, len(tasks))
    return result


_JSON = msgspec.json.Encoder()
KEPT = "eyechart-calibration-banks/1"


def _kept(file: Path, seed: int) -> dict[Task, ReplicationResult]:
    """Return the finished banks of a file; start the file if it is new, and cut off half a line."""
    head = _JSON.encode({"format": KEPT, "eyechart": __version__, "seed": seed, "code": _code()}) + b"\n"
    try:
        if not file.exists():
            file.write_bytes(head)
        text = file.read_bytes()
        if not text.startswith(head):
            raise SpecError(
                f"{file} does not hold banks of seed {seed} that the code of this eyechart {__version__} judged; give "
                "another file"
            )
        whole = text[: text.rindex(b"\n") + 1]
        if whole != text:
            file.write_bytes(whole)
        return dict(msgspec.json.decode(line, type=tuple[Task, ReplicationResult]) for line in whole.splitlines()[1:])
    except (OSError, msgspec.MsgspecError) as error:
        raise SpecError(f"{file}: {error}") from None


def _code() -> str:
    """Return a digest of the modules that draw and judge banks: kept banks of others are not counted."""
    own, core = Path(__file__).parents[1], Path(eyechart.__file__).parent
    rooms = own / "calibration", core / "stats", core / "verdicts", core / "studies" / "battery"
    files = [own / "adversaries.py", *(file for room in rooms for file in sorted(room.glob("*.py")))]
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:12]


def _whole(task: Task) -> ReplicationResult:
    """Return a task's outcomes and, in the default setting, early rejections and adversaries."""
    once = task.setting == "default"
    return ReplicationResult(replicate(task), rejections(task) if once else [], try_adversaries(task) if once else [])


def rejections(task: Task) -> list[int]:
    """Return the rejections of each null of early stopping on the frames of a task's bank."""
    key = ("calibrate", task.seed, task.setting, task.replication)
    world = make_world(SETTINGS[task.setting], np.random.default_rng(key_seed(*key, "world")))
    return count_rejections(world.frames, random.Random(key_seed(*key, "nulls")))  # noqa: S311 - no secret


def try_adversaries(task: Task) -> list[AdversaryTrial]:
    """Return every adversary's labels on the bank of a task, asked in a run's stages."""
    key = ("calibrate", task.seed, task.setting, task.replication)
    world = make_world(SETTINGS[task.setting], np.random.default_rng(key_seed(*key, "world")))
    how = Resampling(resamples=RESAMPLES, seed=key_seed(*key, "tests"), intervals=False)
    result = []
    for name, adversary in ADVERSARIES.items():
        known = KnownController(name, adversary.says, by_sight(adversary.decide), "", "", "")
        rng = random.Random(key_seed(*key, name))  # noqa: S311 - no secret
        answers = answers_of(known, SETTINGS[task.setting], world, rng)
        staged_answers = staged(answers, how)
        statistics = statistics_of(staged_answers, how)
        lateral = verdicts.lateral_rules(statistics, staged_answers.directions())
        turns = verdicts.earns_lateral(statistics, lateral.label)
        label = verdicts.calibrated_rules(statistics, turns=turns)[0].label
        result.append(AdversaryTrial(name, label, lateral.label))
    return result


def staged(answers: Answers, how: Resampling) -> Answers:
    """Return the answers that a run would ask for: controls only where they could matter."""
    decisions = [name for name in answers.decisions if name not in CONTROLS]
    answers = sampled(answers, how.seed)
    while True:
        part = replace(answers, decisions={name: answers.decisions[name] for name in decisions})
        statistics = LazyStatistics(CalibratedTests(part, how).tests())
        more = verdicts.controls_wanted(statistics, supplied=CONTROLS, conditions_run=decisions)
        if not more:
            return part
        decisions += [name for name in more if name in answers.decisions]


def replicate(task: Task) -> list[ReplicationOutcome]:
    """Draw a task's bank; return the labels of every known controller by both sets of rules."""
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


def answers_of(known: KnownController, setting: Setting, world: World, rng: random.Random) -> Answers:
    """Return a controller's answers in a world, read from replies as in a run."""

    @cache
    def decision(answer: Answer | None) -> Decision[str] | None:
        if answer is None:
            return None
        return DRIVING.read(answer if isinstance(answer, Reply) else Reply(text=answer, finish_reason="stop"))

    decisions = {condition: tuple(map(decision, column)) for condition, column in answer_all(known, world, rng).items()}
    gap = LEAD_GAP if setting.gaps else None
    return Answers(known.name, world.frames, DRIVING, gap, decisions)


def without_counterfactuals(answers: Answers, statistics: Mapping[str, Statistic]) -> dict[str, Statistic]:
    """Return the statistics of the same answers on a bank without counterfactual pictures."""
    kept = {name: column for name, column in answers.decisions.items() if name not in DRAWN}
    missing = not_available("the bank has no counterfactual pictures")
    bare = CalibratedTests(replace(answers, decisions=kept), Resampling()).tests()
    of_all = {name: bare[name]() for name in ("kappa_pooled", "turns_boxed")}
    return {**statistics, **dict.fromkeys(COUNTERFACTUAL_TESTS, missing), **of_all}


def _outcome(
    known: KnownController,
    setting: Setting,
    given: tuple[Answers, Answers],
    found: Mapping[str, Statistic],
    corrected: float | None,
    order: int,
) -> ReplicationOutcome:
    """Return a controller's labels from its answers: all that it can give, and those of a run."""
    every, answers = given
    lateral = verdicts.lateral_rules(found, answers.directions()).label
    rulings, early = [], []
    for counterfactuals in (True, False):
        shows = BankCapabilities(
            counterfactuals=counterfactuals,
            exchanges=setting.exchanges,
            scenarios=len(set(answers.scenarios.tolist())),
            varied=_has_varied(answers, counterfactuals=counterfactuals),
        )
        statistics = found if counterfactuals else without_counterfactuals(answers, found)
        label = verdicts.calibrated_rules(statistics, turns=verdicts.earns_lateral(statistics, lateral))[0].label
        rulings.append(RuleOutcome(label, deserved(known, shows), is_false(label, known.name, varied=shows.varied)))
        if setting.name in MEASURED:
            how = {"counterfactuals": counterfactuals, "varied": shows.varied}
            early.append(stop_early(every, label, lateral, seed=order, **how))
    return ReplicationOutcome(
        controller=known.name,
        paper=verdicts.paper_rules(found, {"cramers_v": corrected}).label,
        rulings=(rulings[0], rulings[1]),
        lateral=lateral,
        p_values={test: found[test].p for test in NULLS},
        early=tuple(early),
    )


def _has_varied(answers: Answers, *, counterfactuals: bool) -> bool:
    """Return whether a controller gave more than one answer over all conditions of a bank."""
    first = answers.responses("real")[0]
    drawn = (*COUNTERFACTUALS, *CONTROLS)
    decisions = [name for name in answers.decisions if counterfactuals or name not in drawn]
    return any(bool(((given != first) & (given != ABSENT)).any()) for given in map(answers.responses, decisions))
