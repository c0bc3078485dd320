"""Commands in which policies and models drive, and those that read drives."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eyechart.cli import options
from eyechart.cli.run import View, make
from eyechart.cli.terminal import patience, print_each, print_json, processors, progress, resumable, say
from eyechart.errors import SpecError

if TYPE_CHECKING:
    from eyechart.episodes import EpisodesRun
    from eyechart.modes import RequestMode
    from eyechart.planned_run import RunAllowance

_Simulator = Annotated[str, typer.Option(help="See 'eyechart list simulators'; or gym:ENV_ID.")]
_Actions = Annotated[Path | None, typer.Option(help="FILE.toml: the action map of gym:ENV_ID.")]
_Prompt = Annotated[str | None, typer.Option(help="A name of 'eyechart list prompts', or FILE.toml.")]
_Marginal = Annotated[
    bool | None,
    typer.Option(
        "--marginal/--no-marginal",
        help="Add each model's marginal policy: it draws from the model's decisions on real pictures, without "
        "looking. Default: yes, after the model; a model that drove here without one continues without.",
    ),
]
_Seed = Annotated[int, typer.Option(min=0, help="Seed of stimuli, sampling and the order of episodes.")]

MOST_SEEDS = 100_000
"""The most worlds of a scenario."""


@options.expanded
def closed_loop(
    out: options.Out,
    simulator: _Simulator = "highway",
    policy: Annotated[
        list[str] | None,
        typer.Option(
            help="The driver; repeat for more: constant:ACTION, random, marginal:RUN, marginal:SPEC of another "
            "driver of this run, oracle, positive_control, or a model's SPEC."
        ),
    ] = None,
    mode: options.Mode = None,
    scenarios: Annotated[str | None, typer.Option(help="Scenarios with commas; default: all of the simulator.")] = None,
    seeds: Annotated[str, typer.Option(help="Number of worlds per scenario, or their seeds with commas.")] = "8",
    condition: Annotated[
        list[str] | None,
        typer.Option(
            help="real, shuffled (another world's pictures), blank, noise, frozen or mirrored; repeat for more. "
            "Default: real and shuffled, or real alone without a model; a resumed run keeps its own."
        ),
    ] = None,
    marginal: _Marginal = None,
    processes: Annotated[
        int | None, typer.Option(min=1, help="Processes that hold worlds; default: one per processor.")
    ] = None,
    engine: Annotated[str, typer.Option(help="Where the worlds run: local, or ray for a cluster.")] = "local",
    actions: _Actions = None,
    prompt: _Prompt = None,
    seed: _Seed = 0,
    max_steps: Annotated[int, typer.Option(min=1, help="A longer episode is an error.")] = 1000,
    silence: Annotated[
        str, typer.Option(help="How a call that hangs or keeps failing counts: unfinished, or fail-safe (executed).")
    ] = "unfinished",
    making: options.DriveOptions = options.DRIVEN,
    json: options.Json = False,
) -> None:
    """Let policies and models drive: policies × scenarios × seeds × conditions.

    You may interrupt it at any time: the same command resumes. The options from --base-url to
    --option are for models without a --mode file. Such a model, if served elsewhere, is probed
    first with the first pictures of the first worlds.
    A model drives with real pictures and with those of another world. Only the comparison shows
    whether its driving depends on the camera. This doubles the calls; --condition real leaves it
    out. Afterwards its marginal policy drives, without calls.
    Exit 1: episodes are unfinished or ended in an error; 3: stopped at --max-calls or --max-cost.
    Example: eyechart run closed-loop --policy constant:SLOW --policy scripted:depth_lateral --out
    drives
    """
    from eyechart import episodes as study
    from eyechart.clusters import require_engine

    if not making.dry_run:
        require_engine(engine)

    def planned(drivers: "Sequence[str | RequestMode]") -> "EpisodesRun":
        shown = condition or study.usual_conditions(drivers, out)
        made = study.plan(
            study.Setup(simulator, seed, max_steps, actions, silence),
            study.with_marginals(drivers, shown, out, wanted=marginal),
            out,
            scenarios=options.names(scenarios),
            seeds=_seeds(seeds),
            conditions=shown,
            prompt=prompt,
        )
        return replace(made, again=making.again, engine=engine)

    allowed = making.allowed(out, processes=processes or processors())
    done = f"'eyechart score {out}' compares the drivers, 'eyechart report {out} --out page.html' shows every drive"
    _drive(policy or (), mode, making, allowed, out, planned, done, show=partial(_show, json=json))


@options.expanded
def hierarchy(
    out: Annotated[Path, typer.Option(help="Folder of the study; the same one resumes it.")] = Path("hierarchy"),
    policy: Annotated[
        list[str] | None, typer.Option(help="A model's SPEC as the source of intent; repeat for more.")
    ] = None,
    mode: options.Mode = None,
    sources: Annotated[
        str | None, typer.Option(help="Scripted sources with commas, by name or policy; or none. Default: all.")
    ] = None,
    arms: Annotated[
        str | None, typer.Option(help="primary, constrained, unaware or lateral, with commas; default: all.")
    ] = None,
    worlds: Annotated[str | None, typer.Option(help="Families of obstacles, with commas; default: all.")] = None,
    seeds: Annotated[
        str | None,
        typer.Option(
            help="Number of worlds per family, or their seeds with commas. Default: 5 and 8, as in the paper."
        ),
    ] = None,
    prompt: _Prompt = None,
    seed: _Seed = 0,
    processes: Annotated[int, typer.Option(min=1, help="Processes that hold the worlds.")] = 2,
    silence: Annotated[
        str, typer.Option(help="How a call that hangs or keeps failing counts: fail-safe (STOP), or unfinished.")
    ] = "fail-safe",
    making: options.DriveOptions = options.DRIVEN,
    json: options.Json = False,
) -> None:
    """Let sources of intent plan for a rover under a model-predictive controller.

    The tables stand beside the paper's. Sources are scripted, and a model if you give one, with
    real, mirrored and blank pictures and with those of other worlds. A model that is served
    elsewhere is probed first. A planner without an answer within --timeout stops the rover. You may
    interrupt it at any time: the same command resumes.
    Exit 1: episodes are unfinished or ended in an error; 3: stopped at --max-calls or --max-cost.
    Example: eyechart run hierarchy --policy scripted:clear_side --sources route,random --seeds 2
    --out hierarchy
    """
    from eyechart.studies.hierarchy import PARTS, Arms, plan, read_choice, score
    from eyechart.studies.hierarchy.study import Hierarchy

    choice = read_choice(sources, arms, worlds, None if seeds is None else _seeds(seeds))

    def planned(modes: "Sequence[RequestMode]") -> Arms:
        parts = plan(out, modes, choice=choice, seed=seed, prompt=prompt, silence=silence, again=making.again)
        return Arms(parts, out)

    def show(_: Arms) -> None:
        found = score(out)
        print_json(found.as_dict()) if json else print_each(Hierarchy().printed(found), 160)

    runs, others = [out / name for name in PARTS], choice.sources != frozenset()
    allowed = making.allowed(out, processes=processes)
    make(planned, runs, making.run_modes(policy, mode), allowed, show=show, others=others)


@options.expanded
def online(
    out: options.Out,
    simulator: Annotated[str, typer.Option(help="See 'eyechart list simulators'.")] = "highway",
    model: options.Model = None,
    mode: options.Mode = None,
    view: View = None,
    episodes: Annotated[int, typer.Option(min=1, help="Number of worlds, spread over the scenarios.")] = 12,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the order of episodes and of sampling.")] = 0,
    reflections: Annotated[
        bool,
        typer.Option("--reflections/--no-reflections", help="Ask about each reflection too: twice the calls."),
    ] = True,
    concurrency: options.Episodes = 8,
    how: options.RequestOptions = options.AS_USUAL,
    spending: options.CostLimits = options.NO_LIMIT,
    dry_run: options.DryRun = False,
) -> None:
    """Let scene estimates drive through the safety policy, in vetted worlds.

    Each world must pass renderer integrity and the positive control, or another takes its place.
    Afterwards every frame that an estimator saw is checked in the same way. 'eyechart score OUT'
    prints crash rates, decisions, fail-safes and the clauses of admission over the frames of the
    drives. 'eyechart gate OUT' checks the run against these clauses. A model that is served
    elsewhere and has no --mode file is probed after the vetting.
    Exit 1: episodes are unfinished or ended in an error; 3: stopped at --max-calls or --max-cost.
    Example: eyechart run online --model scripted:scene_side_blind --out online
    """
    from eyechart.episodes import Setup
    from eyechart.studies.structured import online as study

    setup = Setup(simulator, seed, reflected=reflections)

    def planned(modes: "Sequence[RequestMode]") -> study.OnlineRun:
        with resumable("no call was made yet; the same command starts anew"), progress("vetting", "worlds") as move:
            return study.plan(setup, modes, out, view=view, episodes=episodes, progress=move)

    def check(_: study.OnlineRun) -> None:
        kept = "the drives are kept; the same command checks the rest"
        with resumable(kept), progress("checking", "episodes") as move:
            study.check_seen(out, move)

    making = options.ModelRunOptions(concurrency, how, spending, dry_run=dry_run)
    done = (
        f"'eyechart score {out}' prints the results, 'eyechart gate {out}' checks them against the clauses of admission"
    )
    make(planned, [out], making.run_modes(model, mode), making.allowed(out), done, show=check)


@options.expanded
def ladder(
    out: options.Out = Path("ladder"),
    simulator: _Simulator = "highway",
    policy: Annotated[
        list[str] | None, typer.Option(help="A policy or model to add to the ladder; repeat for more.")
    ] = None,
    mode: options.Mode = None,
    marginal: _Marginal = None,
    seeds: Annotated[int, typer.Option(min=1, max=MOST_SEEDS, help="Number of seeds per scenario, from 0 on.")] = 8,
    actions: _Actions = None,
    prompt: _Prompt = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the run, and of the random policy.")] = 0,
    processes: Annotated[int, typer.Option(min=1, help="Processes that hold the worlds.")] = 1,
    making: options.DriveOptions = options.DRIVEN,
    against: options.Against = None,
    json: options.Json = False,
) -> None:
    """Drive the baselines and print Table t:baselines beside the paper's.

    Every constant action, random and the scripted controller drive in every scenario: in the
    highway 7 × 4 × 8 episodes. Models are probed and paid for as in 'run closed-loop', and each is
    followed by its marginal policy. You may interrupt it at any time: the same command resumes.
    Exit 1: episodes are unfinished or ended in an error; 3: stopped at --max-calls or --max-cost.
    Example: eyechart ladder --out ladder --processes 2
    """
    from eyechart.episodes import with_marginals
    from eyechart.studies.closed_loop import score
    from eyechart.studies.closed_loop.ladder import plan_ladder, require_reference
    from eyechart.studies.closed_loop.tables import beside_paper, ladder_printed

    def planned(drivers: "Sequence[str | RequestMode]") -> "EpisodesRun":
        made = plan_ladder(
            out,
            simulator=simulator,
            seeds=seeds,
            further=with_marginals(drivers, ("real",), out, wanted=marginal),
            actions=actions,
            prompt=prompt,
            seed=seed,
            again=making.again,
        )
        require_reference(made, against)  # before any call or drive
        return made

    def show(run: "EpisodesRun") -> None:
        if run.unfinished():
            return
        scored = score(out, against_policy=against)
        if not json:
            print_each(ladder_printed(scored), 160)
            return
        parts = ("study", "references", "references_chosen_on_these_data", "ladder", "paired", "identical")
        kept = {name: one for name, one in scored.as_dict().items() if name in parts}
        print_json({**kept, "beside_paper": [comparison.as_dict() for comparison in beside_paper(scored.ladder)]})

    allowed = making.allowed(out, processes=processes)
    _drive(policy or (), mode, making, allowed, out, planned, alone=False, show=show)


def audit(
    runs: Annotated[list[Path], typer.Argument(help="Folders of runs of episodes.", metavar="RUN...")],
    json: options.Json = False,
) -> None:
    """Show whether drivers decide or only vary.

    It prints Table t:degeneracy, the replay of decisions, and identical drives. Exit 1: a cache is
    suspected. Example: eyechart audit run-a run-b --json
    """
    from eyechart.studies import require_single
    from eyechart.studies.closed_loop import score
    from eyechart.studies.closed_loop.tables import audit_printed

    require_single(runs)
    scored = score(runs)
    if json:
        print_json({"study": "closed_loop", **scored.audit_dict()})
    else:
        print_each(audit_printed(scored, twins=True), 160)
    if scored.is_suspect:
        raise typer.Exit(1)


def film(
    run: Annotated[Path, typer.Argument(help="Folder of a run of drives, or of a battery.")],
    out: Annotated[Path, typer.Option(help="FILE.mp4, FILE.gif or FILE.html; for a battery FILE.gif.")],
    episode: Annotated[
        str | None,
        typer.Option(help="For drives: policy, scenario, seed, condition; as many of these words as name one drive."),
    ] = None,
    frame: Annotated[
        str | None, typer.Option(help="For a battery: a frame; default: the one with the most varied answers.")
    ] = None,
    frames: Annotated[Path | None, typer.Option(help="For a battery: the bank, if it has moved.")] = None,
    fps: Annotated[float, typer.Option(help="For drives: decisions per second.")] = 2.0,
    seconds: Annotated[float, typer.Option(help="For a battery: seconds per picture.")] = 1.4,
) -> None:
    """Write a film of one drive, or of one battery frame under its conditions with every answer.

    A drive is made anew and checked; its film shows camera, decision, executed action and gap. For
    the hierarchy the controller's plan lies over the picture.
    Example: eyechart film run --episode "oracle highway/dense/3 real" --out drive.gif
    """
    from eyechart.destination import require_free
    from eyechart.studies import is_episodes, require_single
    from eyechart.studies.battery.film import write_film as write_battery_film
    from eyechart.studies.closed_loop import read_drives
    from eyechart.studies.closed_loop.film import write_film
    from eyechart.studies.closed_loop.replay import episode_id, find_episode

    require_free(out, "film")
    require_single([run])
    if not is_episodes(run):
        if episode is not None:
            raise SpecError(f"{run} is a run on a bank: use --frame with a frame's id, because --episode is for drives")
        banks = () if frames is None else (frames,)
        count = write_battery_film(run, out, frame=frame, banks=banks, seconds=seconds)
    elif episode is None or frame is not None:
        raise SpecError(f"{run} is a run of drives: name one with --episode, as 'eyechart score {run}' lists them")
    else:
        drives, found = find_episode(read_drives([run]), episode)
        with patience("film") as tell:
            tell(f"driving '{episode_id(found)}' again")
            count = write_film(drives, found, out, fps=fps)
    say(f"wrote {out}, {count} pictures, {out.stat().st_size / 1e6:.1f} MB")


def _drive(
    policies: Sequence[str],
    modes: Sequence[Path] | None,
    making: options.DriveOptions,
    allowed: "RunAllowance",
    out: Path,
    plan: "Callable[[Sequence[str | RequestMode]], EpisodesRun]",
    done: str = "",
    *,
    alone: bool = True,
    show: "Callable[[EpisodesRun], object]",
) -> None:
    """Plan drives and make them; ``policies`` holds policies and models as they were given.

    ``alone`` says that the command has no other drivers.
    """
    from eyechart.policies import is_policy

    run_modes = making.run_modes([policy for policy in policies if ":" in policy and not is_policy(policy)], modes)
    names = list(dict.fromkeys([*policies, *(mode.spec for mode in run_modes.modes)]))
    models = {mode.spec for mode in run_modes.modes}

    def planned(modes: "Sequence[RequestMode]") -> "EpisodesRun":
        by_spec = {mode.spec: mode for mode in modes}
        return plan([by_spec.get(spec, spec) for spec in names if spec in by_spec or spec not in models])

    others = not alone or len(models) < len(names)
    make(planned, [out], run_modes, allowed, done, show=show, others=others)


def _seeds(given: str) -> list[int]:
    try:
        numbers = [int(one) for one in given.split(",") if one.strip()]
    except ValueError as error:
        raise SpecError(
            f"--seeds takes a number of worlds, or seeds with commas such as 0,3,5; got '{given}'"
        ) from error
    if "," in given:
        return numbers
    if len(numbers) != 1 or not 1 <= numbers[0] <= MOST_SEEDS:
        raise SpecError(f"--seeds takes a number from 1 to {MOST_SEEDS}, or seeds with commas; got '{given}'")
    return list(range(numbers[0]))


def _show(planned: "EpisodesRun", *, json: bool) -> None:
    """Print means over episodes for each policy and condition, as JSON or as a table."""
    from eyechart.episodes import summarise, unfinished

    rows = summarise(planned.driven())
    if json:
        left = planned.unfinished()
        why = [one.as_dict() for one in unfinished(planned.out, left, planned.drivers.models)]
        summary = {"run": str(planned.out), "left": len(left), "unfinished": why}
        print_json({**summary, "rows": [row.as_dict() for row in rows]})
        return
    from eyechart.studies.closed_loop.tables import means_table

    print_each([means_table(planned.manifest.simulator, rows)])
