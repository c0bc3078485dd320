"""Plans and runs of episodes: drivers, worlds and costs; finished episodes are not driven again."""

import asyncio
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from json import dumps
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from eyechart.clusters import require_engine
from eyechart.conditions import require_shown
from eyechart.costs import CostEstimate, estimate
from eyechart.episodes.coordinator import USUAL, Bounds, Drivers, Progress, calls_of, drive
from eyechart.episodes.records import (
    REAL,
    SILENCES,
    Episode,
    EpisodeKey,
    decided_by,
    every_episode,
    mend_episodes,
    read_episodes,
    recorded,
    unfinished,
    write_episodes,
)
from eyechart.episodes.workers import LocalWorker, Worker, WorkerDiedError
from eyechart.episodes.worlds import EpisodeView, Setup
from eyechart.errors import DriveError, EyechartError, LedgerError, SpecError, counted, printable, raising, suggestion
from eyechart.event_loops import to_its_end
from eyechart.frames import Stimulus, alone
from eyechart.ledger import Ledger
from eyechart.limits import RunOutcome
from eyechart.manifest import (
    EPISODES,
    LEDGER,
    MARGINAL,
    EpisodesManifest,
    alone_in,
    is_episodes_run,
    own_marginal,
    read_episodes_manifest,
    today,
    versions,
)
from eyechart.models import open_model, sequential_groups
from eyechart.models.prices import Prices
from eyechart.modes import RequestMode
from eyechart.perception.forward import distances_of
from eyechart.perception.view import NONE, View, through
from eyechart.planned_run import Bar, PlannedRun, RunAllowance, RunEnding, aside, empty, forecast, unasked
from eyechart.policies import Policy, is_policy, open_policy
from eyechart.policies.baselines import Marginal, drawn_like
from eyechart.prompts import Prompt, find_prompt, neutral, require_pictured
from eyechart.simulators import Declaration, open_simulator
from eyechart.spaces.discrete import DRIVING, read_toml

if TYPE_CHECKING:  # a score probes no model
    from eyechart.probe import Sample

ACTION_MAP = "actions.toml"
"""The run's copy of the action map of a ``gym:`` environment."""


_PICTURES = 3
"""The number of worlds that show a picture to a probe before a run."""


@dataclass(frozen=True)
class EpisodesRun(PlannedRun):
    """Planned episodes: the drivers, the episodes, and the folder of their records.

    With ``again``, episodes that ended in an error are driven again. ``engine`` is the place of the
    worlds.
    """

    unit: ClassVar[str] = "episodes"
    kept: ClassVar[str] = "finished episodes and calls are kept; the same command resumes"

    keys: tuple[EpisodeKey, ...]
    drivers: Drivers
    manifest: EpisodesManifest
    setup: Setup
    out: Path
    again: bool = False
    engine: str = "local"

    def begin(self) -> EpisodesManifest:
        """Begin the run without drivers if the folder has none yet, and return its manifest."""
        if not is_episodes_run(self.out):
            nobody = replace(self.manifest, policies={}, modes={}, facts={})
            replace(nobody, scenarios=(), seeds=(), conditions=()).write(self.out)
        return read_episodes_manifest(self.out)

    def sample(self) -> "Sample":
        """Return a probe's sample: the drives' prompt with the first pictures of the first worlds.

        Worlds are opened in a process of their own. A world without a picture is skipped; raises
        SpecError if none has one.
        """
        from eyechart.probe import Sample  # noqa: PLC0415 - a score probes no model

        keys = list({key.world: replace(key, condition="real") for key in self.keys}.values())[:_PICTURES]
        shown = to_its_end(_shown(self.setup, keys))
        stimuli = [through(self.drivers.view, one.stimulus, one.frame) for one in shown if isinstance(one, EpisodeView)]
        if not stimuli:
            raise SpecError(f"no world of {self.manifest.simulator} shows a picture to probe a model with: {shown[-1]}")
        return Sample([(self.drivers.prompt, seen) for seen in stimuli], self.drivers.answers)

    def lines(self, how: RunAllowance) -> Iterator[str]:
        """Yield the size of the run, and the expected costs of the models' calls."""
        yield self.size
        yield from self.forecast(how)

    def make(self, how: RunAllowance, bar: Bar) -> RunOutcome:
        """Drive the remaining episodes."""
        bounds = Bounds(how.processes, how.concurrency, limits=how.limits(self.manifest), sequential=how.sequential)
        with bar(self.unit, self.unit) as move:
            return run(self, engine=self.engine, bounds=bounds, progress=move)

    def ends(self, outcome: RunOutcome, failed: Mapping[str, str]) -> Iterator[RunEnding]:
        """Yield the remaining episodes and why, the failed ones, and models with empty replies."""
        yield drives_ended({"": self}, outcome, failed)
        yield errors_ended({"": self})
        yield empty([self.out])

    @property
    def size(self) -> str:
        """Return the drivers and the numbers of all and of remaining episodes, in words."""
        own = {key.policy for key in self.keys if self.manifest.marginal_of(key.policy)}
        others = [key for key in self.keys if key.policy not in own]
        parts = {
            name: len({getattr(key, name) for key in others or self.keys})
            for name in ("policy", "scenario", "seed", "condition")
        }
        size = " × ".join(counted(count, name) for name, count in parts.items())
        left = len(self.left())
        if own and others:
            who = "the marginal of one" if len(own) == 1 else f"the marginals of {len(own)}"
            size += f", and {who} with real pictures"
        return f"{size}: {counted(len(self.keys), 'episode')}, {len(self.keys) - left} finished, {left} to drive"

    def forecast(self, how: RunAllowance) -> Iterator[str]:
        """Yield the expected costs of the remaining calls, or why they are unknown."""
        estimates: tuple[CostEstimate, ...] = ()
        try:
            estimates = expected(self, how.prices, concurrency=how.concurrency)
        except DriveError as error:
            yield f"cannot estimate the costs of the models' calls: {error}"
        yield from forecast(self.manifest, self.drivers.models, estimates, how)

    def driven(self) -> list[Episode]:
        """Return the existing records of the episodes, in their order."""
        over = {episode.key: episode for episode in read_episodes(self.out)}
        return [over[key] for key in self.keys if key in over]

    def unfinished(self) -> tuple[EpisodeKey, ...]:
        """Return the episodes without a record, whatever their end."""
        return replace(self, again=False).left()

    def left(self) -> tuple[EpisodeKey, ...]:
        """Return the episodes that remain to be driven."""
        over = {episode.key for episode in read_episodes(self.out) if not (self.again and episode.ended == "error")}
        return tuple(key for key in self.keys if key not in over)


def plan(
    simulator: str | Setup,
    specs: Sequence[str | RequestMode],
    out: Path,
    *,
    scenarios: Sequence[str] | None = None,
    seeds: Sequence[int] = tuple(range(8)),
    conditions: Sequence[str] = ("real",),
    prompt: str | Prompt | None = None,
    view: View | None = None,
) -> EpisodesRun:
    """Plan episodes, or the rest of those in ``out``, without calls, drives or files.

    ``simulator`` is its name, or a `Setup` of its worlds. ``specs`` name the drivers: policies, and
    models by SPEC or by their request mode. ``scenarios`` default to all. ``prompt`` is a name, a
    TOML file or the prompt itself. ``view`` is applied to the pictures that models see. Raises
    SpecError for unknown or impossible values, and LedgerError if ``out`` holds something else.
    """
    setup = simulator if isinstance(simulator, Setup) else Setup(simulator)
    setup = replace(setup, actions=setup.actions or (out / ACTION_MAP if (out / ACTION_MAP).is_file() else None))
    opened = open_simulator(setup.simulator, actions=setup.actions)
    held = read_episodes_manifest(out) if is_episodes_run(out) else None
    space = opened.declared.action_space  # a resumed run reads replies as at its beginning
    world = replace(opened.declared, action_space=space if held is None else space.by(held.reader))
    chosen = tuple(dict.fromkeys(scenarios or world.scenarios))
    _require_worlds(world, setup, chosen, seeds, conditions)
    modes = _modes(specs)
    names = tuple(dict.fromkeys(spec.spec if isinstance(spec, RequestMode) else spec for spec in specs))
    if not names:
        raise SpecError("episodes need at least one --policy: constant:SLOW, oracle, or a model's SPEC")
    beside = _marginals(names, conditions, held)
    drivers = _drivers(
        world,
        setup,
        [name for name in names if name not in beside],
        modes,
        prompt if isinstance(prompt, Prompt) else _prompt_for(world, prompt),
    )
    reflected = setup.reflected if held is None else held.reflected
    drivers = replace(drivers, mirror_axis=world.mirror_axis if reflected else None)
    manifest = EpisodesManifest(
        created=today(),
        simulator=world.name,
        scenarios=chosen,
        seeds=tuple(dict.fromkeys(seeds)),
        conditions=tuple(dict.fromkeys(conditions)),
        policies={spec: beside[spec] if spec in beside else _version(spec, drivers) for spec in names},
        action_space=world.action_space,
        picture=world.picture,
        prompt=drivers.prompt,
        seed=setup.seed,
        max_steps=setup.max_steps,
        world=opened.versions(),
        versions=versions(),
        modes=modes,
        facts={spec: dict(model.facts) for spec, model in drivers.models.items() if model.facts},
        reader=drivers.answers.reader,
        view=NONE if view is None else view.key,
        silence=setup.silence,
        reflected=reflected,
    )
    planned = EpisodesRun(every_episode(manifest), replace(drivers, view=view), manifest, setup, out)
    return replace(planned, manifest=_resumed(planned))


def usual_conditions(specs: Sequence[str | RequestMode], out: Path) -> tuple[str, ...]:
    """Return the default conditions of a run: those in ``out``, or else those its claims need.

    A model drives by the true pictures and by those of another world. Blank pictures would test
    only whether there is a picture. A policy that is no model sees no pictures.
    """
    if is_episodes_run(out) and (held := read_episodes_manifest(out).conditions):
        return held
    return ("real", "shuffled") if _modes(specs) else ("real",)


def with_marginals(
    specs: Sequence[str | RequestMode], conditions: Sequence[str], out: Path, *, wanted: bool | None = None
) -> list[str | RequestMode]:
    """Return the drivers with a marginal for each model among them that sees real pictures.

    ``wanted`` decides; None is the default: yes, except for a model that already drove in ``out``
    without a marginal.
    """
    held = read_episodes_manifest(out).policies if wanted is None and is_episodes_run(out) else {}
    models = list(_modes(specs)) if REAL in conditions and wanted is not False else []
    own = [f"{MARGINAL}:{spec}" for spec in models if spec not in held or f"{MARGINAL}:{spec}" in held]
    return [*specs, *(one for one in own if one not in specs)]


def _marginals(names: Sequence[str], conditions: Sequence[str], held: EpisodesManifest | None) -> dict[str, str]:
    """Return the marginals of this run's drivers with their counts, "" before they drive.

    Raises SpecError if no driver sees real pictures, whose decisions a marginal draws from.
    """
    before = {} if held is None else held.policies
    own = {spec: before.get(spec, "") for spec in names if own_marginal(spec, {*before, *names})}
    if own and REAL not in conditions:
        raise SpecError(
            f"'{next(iter(own))}' draws from the decisions on real pictures, but this run has none: add "
            "--condition real, or leave it out"
        )
    return own


def _drivers(
    world: Declaration, setup: Setup, names: Sequence[str], modes: Mapping[str, RequestMode], prompt: Prompt
) -> Drivers:
    """Return the drivers: models by their modes, and every other name as a policy."""
    space, answers = world.action_space, prompt.asks(world.action_space)
    return Drivers(
        policies={spec: open_policy(spec, space, recorded) for spec in names if spec not in modes},
        models={spec: open_model(spec, mode) for spec, mode in modes.items()},
        prompt=prompt,
        space=space,
        seed=setup.seed,
        answers=answers.in_world(distances_of(world.camera)),
        silent=SILENCES[setup.silence],
    )


def _require_worlds(
    world: Declaration, setup: Setup, scenarios: Sequence[str], seeds: Sequence[int], conditions: Sequence[str]
) -> None:
    if setup.silence not in SILENCES:
        raise SpecError(f"unknown silence '{setup.silence}'; known are {' and '.join(SILENCES)}")
    for scenario in scenarios:
        if scenario not in world.scenarios:
            near = suggestion(scenario, world.scenarios)
            raise SpecError(f"'{world.name}' has no scenario '{scenario}'; known: {', '.join(world.scenarios)}{near}")
    if not seeds or min(seeds) < 0:
        raise SpecError(f"episodes need seeds from 0 on, got {list(seeds)}")
    if setup.max_steps < 1:
        raise SpecError(f"an episode needs at least 1 step, got --max-steps {setup.max_steps}")
    for condition in conditions:
        require_shown(condition, alone(world.mirror_axis))


def _modes(specs: Sequence[str | RequestMode]) -> dict[str, RequestMode]:
    models = (spec for spec in specs if isinstance(spec, RequestMode) or (":" in spec and not is_policy(spec)))
    modes = (model if isinstance(model, RequestMode) else RequestMode(model) for model in models)
    return {mode.spec: mode for mode in modes}


def _version(spec: str, drivers: Drivers) -> str:
    if spec in drivers.models:
        return drivers.models[spec].version
    policy = drivers.policies[spec]
    return policy.version if isinstance(policy, Marginal) else ""


def _prompt_for(world: Declaration, name: str | None) -> Prompt:
    """Return the prompt of this name or the baseline; a neutral one for other actions."""
    if name is None and world.action_space != DRIVING:
        return neutral(world.picture, world.action_space)
    prompt = find_prompt(name or "baseline", world.mirror_axis)
    if prompt.fields:
        raise SpecError(f"prompt '{name}' needs {', '.join(prompt.fields)} of a frame, but a drive has no such columns")
    answers = prompt.asks(world.action_space)
    known = world.action_space.actions
    if not answers.is_scene and not (answers.actions and {*answers.actions} <= {*known}):
        raise SpecError(
            f"the answers of prompt '{name}' are not the actions of this world; it executes {', '.join(known)}: "
            "give its answer one field of kind name without values"
        )
    require_pictured(prompt, Stimulus.of(b"a picture"))
    said = " ".join(prompt.render({}, world.action_space.actions)).upper()
    if unsaid := [action for action in world.action_space.actions if action.upper() not in said]:
        raise SpecError(f"prompt '{name}' does not name {', '.join(unsaid)}; give one that does with --prompt")
    return prompt


def _resumed(planned: EpisodesRun) -> EpisodesManifest:
    if is_episodes_run(planned.out):
        return read_episodes_manifest(planned.out).extended(planned.manifest)
    return planned.manifest


def run(
    planned: EpisodesRun,
    *,
    engine: str = "local",
    bounds: Bounds = USUAL,
    progress: Progress | None = None,
) -> RunOutcome:
    """Drive the planned episodes that the folder does not have yet, and return the outcome.

    ``engine`` is the place of the worlds: ``local`` processes, or actors on a ``ray`` cluster.
    Raises LedgerError if another process writes to the same run, or the ledger cannot be written.
    """
    open_worker = _engine(engine, planned.setup)
    with alone_in(planned.out), ExitStack() as opened:
        _begin(planned)
        left = planned.left()
        first = [key for key in left if not planned.manifest.marginal_of(key.policy)]
        keep, ledger = _keeper(planned, len(left), progress), None
        if any(key.policy in planned.drivers.models for key in left):
            ledger = opened.enter_context(Ledger(planned.out / LEDGER, create=True))
        turns = sequential_groups(map(planned.manifest.mode, planned.drivers.models), sequential=bounds.sequential)
        drivers = replace(planned.drivers, turns=turns)
        outcome = drive(first, drivers, open_worker, keep, ledger=ledger, bounds=bounds)
        if len(first) < len(left):
            _drive_marginals(planned, open_worker, keep, bounds)
        return outcome


def _drive_marginals(
    planned: EpisodesRun, open_worker: Callable[[], Worker], keep: Callable[[Episode], None], bounds: Bounds
) -> None:
    """Let each driver's marginal drive after all of the driver's episodes with real pictures.

    Its counts are in the manifest before it first drives, and stay. If the driver decided in no
    episode, the episodes of its marginal are errors that say so.
    """
    left, held = planned.left(), read_episodes_manifest(planned.out)
    episodes = list(read_episodes(planned.out))
    over, policies = {episode.key for episode in episodes}, dict[str, Marginal]()
    todo = [key for key in left if (who := held.marginal_of(key.policy)) and replace(key, policy=who) in over]
    for spec in dict.fromkeys(key.policy for key in todo):
        mine, driver = [key for key in left if key.policy == spec], held.marginal_of(spec)
        if any(replace(key, policy=driver) not in over for key in mine):
            todo = [key for key in todo if key.policy != spec]
        elif counts := decided_by(driver, spec, episodes):
            policies[spec] = drawn_like(counts, held.action_space)
        else:
            why = f"{driver} has no decision in an episode with real pictures without an error: nothing to draw from"
            for key in mine:
                keep(Episode(key, (), "error", "", why))
    counted = {spec: policy.version for spec, policy in policies.items()}
    replace(held, policies={**held.policies, **counted}).write(planned.out)
    driven = [key for key in todo if key.policy in policies]
    drive(driven, replace(planned.drivers, policies=policies, models={}, turns=()), open_worker, keep, bounds=bounds)


def drives_ended(parts: Mapping[str, EpisodesRun], outcome: RunOutcome, failed: Mapping[str, str]) -> RunEnding:
    """Return the ending of drives: what remains and why, with its exit status.

    The status is 3 if a limit stopped them, and 1 for any other reason. ``parts`` are the runs of a
    study by name; a single run has the name ``""``. ``failed`` holds the reasons for models that
    were left out of the plan.
    """
    lines, left = aside(outcome, failed), 0
    for name, planned in parts.items():
        mine = planned.unfinished()
        left += len(mine)
        words = unfinished(planned.out, mine, planned.drivers.models)
        lines += [f"{f'{name}: ' if name else ''}{word.policy}: {word.words}" for word in words]
    waiting = sum(len(planned.left()) for planned in parts.values())  # also the ones to be driven again
    if outcome.stopped is not None and waiting:
        return RunEnding(
            [*lines, f"stopped: {outcome.stopped}; {counted(waiting, 'episode', 'are')} left; a higher limit resumes"],
            3,
        )
    if left:
        return RunEnding([*lines, f"{counted(left, 'episode', 'are')} unfinished; the same command continues them"], 1)
    return RunEnding([*lines, *unasked({}).lines], 1) if failed else RunEnding(lines)


def errors_ended(parts: Mapping[str, EpisodesRun], bound: str = "--max-steps") -> RunEnding:
    """Return the ending for episodes that ended in an error, with status 1 if there is any.

    ``bound`` is the option that lets an episode go on for longer, or empty if there is none.
    """
    found = [
        (name, episode) for name, planned in parts.items() for episode in planned.driven() if episode.ended == "error"
    ]
    if not found:
        return RunEnding()
    failed, part = [one for _, one in found], found[0][0]
    bounded = [one for one in failed if one.max_steps is not None and len(one.steps) >= one.max_steps]
    words = (
        f"{counted(len(failed), 'episode')} ended in an error, first {f'{part}: ' if part else ''}"
        f"{failed[0].key.policy} in {failed[0].key.world}: {printable(failed[0].detail)}; "
        f"--again drives {'it' if len(failed) == 1 else 'them'} again"
        + (f"; a larger {bound} lets those go on that reached the bound" if bounded and bound else "")
    )
    return RunEnding([words], 1)


def _engine(engine: str, setup: Setup) -> Callable[[], Worker]:
    require_engine(engine)
    if engine == "ray":
        from eyechart.episodes.ray_workers import RayWorker  # noqa: PLC0415 - an extra

        return partial(RayWorker, setup)
    return partial(LocalWorker, setup)


def _begin(planned: EpisodesRun) -> None:
    """Write the manifest, read again after other processes, and mend a record that a kill cut."""
    mend_episodes(planned.out)
    _resumed(planned).write(planned.out)
    actions = planned.setup.actions
    copy = planned.out / ACTION_MAP
    if actions is not None and not copy.exists():
        name = "" if "name" in read_toml(actions) else f"name = {dumps(actions.stem, ensure_ascii=False)}\n"
        copy.write_text(name + actions.read_text(encoding="utf-8-sig"), encoding="utf-8")  # keeps the file's own name


def _keeper(planned: EpisodesRun, left: int, progress: Progress | None) -> Callable[[Episode], None]:
    done = len(planned.keys) - left

    def keep(episode: Episode) -> None:
        nonlocal done
        with raising(LedgerError, f"{planned.out / EPISODES} cannot be written", "; the same command resumes"):
            write_episodes(planned.out, [replace(episode, max_steps=planned.setup.max_steps)])
        done += 1
        if progress is not None:
            progress(done, len(planned.keys))

    if progress is not None:
        progress(done, len(planned.keys))
    return keep


PATIENCE_S = 30.0
"""The longest wait for one answer of a world in a sample."""

ALTOGETHER_S = 120.0
"""The longest time for a whole sample."""

_LONGEST_SAMPLE = 200


def expected(planned: EpisodesRun, prices: Prices, *, concurrency: int) -> tuple[CostEstimate, ...]:
    """Return the expected costs of the remaining calls, by model.

    An episode counts as long as one that brakes all the way, in the first of the seeds. If that one
    crashes, it counts as the longest one of a single action. These drives are made here, in a
    process of their own. Finished calls of a cut episode are not counted again. Raises DriveError
    if a drive fails or they take too long; the costs are then unknown.
    """
    left = [key for key in planned.left() if key.policy in planned.drivers.models]
    if not left:
        return ()
    setup = replace(planned.setup, max_steps=min(planned.setup.max_steps, _LONGEST_SAMPLE))
    fail_safe = open_simulator(planned.setup.simulator, actions=planned.setup.actions).declared.fail_safe
    space = planned.drivers.space
    actions = dict.fromkeys((fail_safe, *space.actions))
    constants = [open_policy(f"constant:{action}", space, recorded) for action in actions]
    first = [
        replace(key, policy="constant", seed=planned.manifest.seeds[0])
        for key in {key.scenario: key for key in left}.values()
    ]
    length = to_its_end(_lengths(setup, first, constants))
    each = 2 if planned.manifest.reflected else 1
    with Ledger(planned.out / LEDGER, absent=True) as ledger:
        made = {key: len(calls) for key, calls in calls_of(left, planned.drivers, ledger).items()}
    return tuple(
        estimate(
            planned.manifest.mode(spec),
            sum(max(0, each * length[key.scenario] - made.get(key, 0)) for key in left if key.policy == spec),
            prices,
            concurrency=concurrency,
            sampled=True,
        )
        for spec in planned.drivers.models
    )


async def _lengths(setup: Setup, keys: Sequence[EpisodeKey], policies: Sequence[Policy]) -> dict[str, int]:
    """Return, by scenario, the first policy's steps, or the most of any if it crashes.

    Raises DriveError with the world that fails.
    """
    worker, found, world = LocalWorker(setup, patience_s=PATIENCE_S), list[Episode](), ""
    try:
        async with asyncio.timeout(ALTOGETHER_S):
            for key in keys:
                world = key.world
                for policy in policies:
                    over = await worker.ask("drive", key, policy)
                    assert isinstance(over, Episode)
                    found.append(over)
                    if not over.has_crashed and policy is policies[0]:
                        break
    except TimeoutError:
        raise DriveError(f"{world}: the sample's drives took longer than {ALTOGETHER_S:g} s") from None
    except EyechartError as error:
        raise DriveError(f"{world}: {printable(str(error))}") from error
    finally:
        worker.close()
    for one in found:
        if one.ended == "error" and len(one.steps) < setup.max_steps:
            raise DriveError(f"{one.key.world}: {printable(one.detail)}")
    return {key.scenario: max(len(one.steps) for one in found if one.key == key) for key in keys}


async def _shown(setup: Setup, keys: Sequence[EpisodeKey]) -> list[EpisodeView | str]:
    """Return the first picture of each world, or in words why there is none."""
    result: list[EpisodeView | str] = []
    worker = LocalWorker(setup, patience_s=PATIENCE_S)
    try:
        for key in keys:
            if worker.dead:
                worker.close()
                worker = LocalWorker(setup, patience_s=PATIENCE_S)
            try:
                shown = await worker.ask("open", key)
                await worker.ask("close", key)
            except WorkerDiedError as error:
                shown = Episode(key, (), "error", "", str(error))
            assert isinstance(shown, EpisodeView | Episode)
            result.append(shown if isinstance(shown, EpisodeView) else printable(shown.detail))
    finally:
        worker.close()
    return result
