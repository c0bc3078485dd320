"""``eyechart run`` makes calls about a bank's frames and only appends; ``merge`` joins shards."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer
from typer.main import get_command

from eyechart.cli import options, probe
from eyechart.cli.help import Command, CommandGroup
from eyechart.cli.terminal import output_kept, progress, resumable, say
from eyechart.errors import SpecError, counted, suggestion

if TYPE_CHECKING:
    from contextlib import AbstractContextManager

    from eyechart.limits import Usage
    from eyechart.modes import RequestMode
    from eyechart.planned_run import PlannedRun, RunAllowance, RunEnding
    from eyechart.probe import ProbeError, ProbeResult, Sample
    from eyechart.probe.asker import ProbeOptions
    from eyechart.studies.battery import Battery
    from eyechart.studies.policy import PolicyRun
    from eyechart.studies.probes import Planner, RunModes
    from eyechart.studies.prompts import PromptStudy

P = TypeVar("P", bound="PlannedRun")


class RunKinds(CommandGroup):
    """The kinds of run; studies without an own command share one."""

    def list_commands(self, ctx: Any) -> list[str]:  # noqa: ANN401 - they differ between versions of typer
        """Return all names."""
        from eyechart.studies import STUDIES

        own = super().list_commands(ctx)
        return [*own, *(name for name in STUDIES if name.replace("_", "-") not in own)]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:  # noqa: ANN401
        """Return a kind's command; None if there is no such kind."""
        result = super().get_command(ctx, cmd_name)
        if result is not None or cmd_name not in self.list_commands(ctx):
            return result
        alone = typer.Typer()
        alone.command(cmd_name, cls=Command)(output_kept()(options.from_one_folder(_study)))
        return get_command(alone)


app = typer.Typer(help="Run a study: make its calls and append them to a ledger.", no_args_is_help=True, cls=RunKinds)

View = Annotated[
    str | None, typer.Option(help="calibrated or none; default: calibrated if the pictures have such a view.")
]


@app.command(
    epilog="Example: eyechart run battery --model scripted:depth --frames bank --out run. With --stop-early, the "
    "chance of a false early verdict is at most .05 per model, however often one looks. It is .01 for each of "
    "not_scorable, depth_associated, presence_only, refusal_effect and image_invariant; depth is judged by the rules "
    "of a whole run. The chance to stop with another verdict where the whole run would have been not_scorable is at "
    "most .02. An observed relation with the gap never stops a run. Try it with --dry-run first."
)
@options.expanded
def battery(
    frames: options.Frames,
    out: options.Out,
    model: options.Model = None,
    mode: options.Mode = None,
    prompt: options.Prompt = None,
    conditions: options.Conditions = None,
    seed: options.Seed = 0,
    limit: options.Limit = None,
    shard: options.Shard = None,
    controls: Annotated[
        str | None,
        typer.Option(
            help="auto: the control pictures that each model's answers need; all; none. Default: auto, none with "
            "--conditions; a resumed run keeps its own."
        ),
    ] = None,
    stop_early: Annotated[
        bool, typer.Option("--stop-early", help="Stop asking a model when its verdict is settled; see below.")
    ] = False,
    series: Annotated[
        str | None,
        typer.Option(
            help="Corruptions with commas, or all: how far down fog, rain, night, sun, blur, grain, jpeg, pixels, dirt "
            "or exposure its effect holds. At most three of five steps are asked of each."
        ),
    ] = None,
    fresh_controls: Annotated[
        bool,
        typer.Option("--fresh-controls", help="Draw the distances of the control pictures anew, only for this run."),
    ] = False,
    making: options.ModelRunOptions = options.MADE,
) -> None:
    """Run the input-ablation battery; the same command resumes after an interrupt.

    The options from --base-url to --option are for models without a --mode file. Such a model, if
    served elsewhere, is probed first (as 'eyechart probe' does), and the run keeps the findings.
    Exit 1: calls are unfinished; 3: stopped at --max-calls or --max-cost.
    """
    from eyechart.run import read_shard
    from eyechart.studies import battery as study
    from eyechart.studies.battery.series import read_series

    corruptions = () if series is None else read_series(series)
    if fresh_controls:
        frames = study.with_fresh_controls(frames, out, shard, dry_run=making.dry_run, tell=say, bar=progress)

    def planned(modes: "Sequence[RequestMode]") -> "Battery":
        part = None if shard is None else read_shard(shard)
        extent, names = (
            study.BatterySelection(limit, part, stop_early, controls, corruptions),
            options.names(conditions),
        )
        return study.plan(frames, modes, out, prompt=prompt, conditions=names, seed=seed, extent=extent)

    done = f"'eyechart verdict {out}' judges, 'eyechart score {out}' prints every statistic"
    make(planned, [out], making.run_modes(model, mode), making.allowed(out, shard=shard), done)


@options.expanded
def prompts(
    frames: options.Frames,
    out: Annotated[Path, typer.Option(help="Folder of the study, with a run per cell; the same one resumes it.")],
    model: options.Model = None,
    mode: options.Mode = None,
    prompt: Annotated[
        list[str] | None, typer.Option(help="A prompt's name or FILE.toml; repeat for more. Default: the six built-in.")
    ] = None,
    budget: Annotated[list[int] | None, typer.Option(min=1, help="Tokens of a reply; repeat to compare.")] = None,
    json_mode: Annotated[
        list[str] | None, typer.Option(help="none, json_object, json_schema or tool_call; repeat to compare.")
    ] = None,
    conditions: Annotated[
        str, typer.Option(help="Conditions with commas; real_repeat adds s and IDI_adj; 'all': a battery.")
    ] = "real,blank",
    limit: Annotated[int, typer.Option(min=1, help="Frames per cell, the same in each.")] = 100,
    seed: options.Seed = 0,
    making: options.FormRunOptions = options.FORMS_MADE,
) -> None:
    """Run the prompt study: diversity beside scene dependence (Table t:prompts).

    A model that is served elsewhere and has no --mode file is probed first, with all prompts. Exit
    1: calls are unfinished; 3: stopped at --max-calls or --max-cost.
    Example: eyechart run prompts --model scripted:depth --frames bank --out prompts --prompt
    baseline --prompt minimal
    """
    from itertools import product

    from eyechart.modes import STRUCTURED
    from eyechart.prompts import PROMPTS
    from eyechart.studies import prompts as study

    for one in json_mode or ():
        if one not in STRUCTURED:
            raise SpecError(f"--json-mode '{one}' is not one of {', '.join(STRUCTURED)}{suggestion(one, STRUCTURED)}")

    def planned(modes: "Sequence[RequestMode]") -> "PromptStudy":
        return study.plan(
            frames,
            modes,
            out,
            prompts=prompt or tuple(PROMPTS),
            factors=[study.Factor(*setting) for setting in product(budget or (None,), json_mode or (None,))],
            conditions=() if conditions == "all" else options.names(conditions) or (),
            limit=limit,
            seed=seed,
        )

    done = f"'eyechart score {out}' prints the table, 'eyechart score {out}/CELL' every statistic of a cell"
    # A cell with its own budget says nothing about the others. The form of replies is a factor
    # here, so the probe may not fix it.
    run_modes, allowed, fixed = making.run_modes(model, mode), making.allowed(out), {"structured": "none"}
    make(planned, study.cells_in(out), run_modes, allowed, done, fixed=fixed, whole=not budget)


@options.expanded
def admission(
    frames: options.Frames,
    out: options.Out,
    model: options.Model = None,
    mode: options.Mode = None,
    view: View = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the choice of pairs and the order of calls.")] = 0,
    making: options.ModelRunOptions = options.MADE,
) -> None:
    """Ask for scene estimates of 16 balanced frame/mirror pairs, to check admission.

    'eyechart score OUT' prints each clause of admission with its value, interval and n. A model
    that is served elsewhere and has no --mode file is probed first. Exit 1: calls are unfinished;
    3: stopped at --max-calls or --max-cost. Example: eyechart run admission --model
    scripted:scene_side_blind --frames bank --out adm
    """
    from eyechart.studies import structured as study

    plan = partial(study.plan, study.ADMISSION, frames, out=out, view=view, seed=seed)
    make(plan, [out], making.run_modes(model, mode), making.allowed(out), _SCENES.format(out))


@options.expanded
def structured(
    frames: options.Frames,
    out: options.Out,
    model: options.Model = None,
    mode: options.Mode = None,
    view: View = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the order of calls and of sampling.")] = 0,
    limit: options.Limit = None,
    making: options.ModelRunOptions = options.MADE,
) -> None:
    """Ask for scene estimates of every frame and its reflection (Table t:controller-local).

    The paper has 288 pairs: 'frames build highway --steps 24'. A model that is served elsewhere and
    has no --mode file is probed first. Exit 1: calls are unfinished; 3: stopped at --max-calls or
    --max-cost.
    Example: eyechart run structured --model scripted:scene_positive_control --frames bank --out
    scenes
    """
    from eyechart.studies import structured as study

    plan = partial(study.plan, study.STRUCTURED, frames, out=out, view=view, seed=seed, limit=limit)
    make(plan, [out], making.run_modes(model, mode), making.allowed(out), _SCENES.format(out))


@options.expanded
def _study(
    ctx: typer.Context,
    frames: options.Frames,
    out: options.Out,
    model: options.Model = None,
    mode: options.Mode = None,
    seed: options.Seed = 0,
    limit: options.Limit = None,
    making: options.ModelRunOptions = options.MADE,
) -> None:
    """Ask models this study's question about every frame of a bank.

    A model that is served elsewhere and has no --mode file is probed first. Exit 1: calls are
    unfinished; 3: stopped at --max-calls or --max-cost.
    """
    from eyechart.studies import open_study

    study = open_study(str(ctx.info_name))
    plan = partial(study.plan, frames, out=out, seed=seed, limit=limit)
    make(plan, [out], making.run_modes(model, mode), making.allowed(out), f"'eyechart score {out}' prints the results")


@options.expanded
def policy(
    frames: options.Frames,
    out: options.Out,
    policy: Annotated[list[str] | None, typer.Option(help="A policy's SPEC; repeat for more policies.")] = None,
    mode: options.Mode = None,
    prompt: Annotated[
        str | None,
        typer.Option(
            help="FILE.toml that asks a model for a motion in words (openai:, ollama:, hf:); default: plain words."
        ),
    ] = None,
    conditions: Annotated[
        str | None, typer.Option(help="Conditions with commas; default: all that the bank can show.")
    ] = None,
    answers: Annotated[
        int, typer.Option(help="Answers per question from a policy that samples its answers; others are asked once.")
    ] = 4,
    shapley: Annotated[
        bool,
        typer.Option(
            "--shapley", help="Ask about every subset of the channels, for Shapley shares; prints the number of calls."
        ),
    ] = False,
    seed: options.Seed = 0,
    limit: options.Limit = None,
    shard: options.Shard = None,
    timeout_s: Annotated[float | None, typer.Option(min=0.1, help="Seconds for an answer.")] = None,
    lerobot_python: options.LeRobotPython = None,
    making: options.PolicyRunOptions = options.POLICIES_MADE,
) -> None:
    """Ask policies about every frame of a bank, with channels exchanged between episodes.

    A policy answers with a motion: python:MODULE:FUNCTION takes (images, state, instruction) and
    returns an array (horizon, dimensions). lerobot:CHECKPOINT is a folder that LeRobot's
    save_pretrained wrote. A model that answers with numbers is a policy too: it states them in
    words, and is probed and asked as in 'run battery'. Exit 1: calls are unfinished, or a policy
    never gave a motion; 3: stopped at --max-calls or --max-cost.
    Example: eyechart run policy --policy python:my_robot:act --frames bank --out run
    """
    from eyechart.models import require_lerobot, states
    from eyechart.run import read_shard
    from eyechart.studies import policy as study

    given = {} if timeout_s is None else {"timeout_s": timeout_s}
    run_modes = making.run_modes(policy, mode, **given)
    require_lerobot((one.spec for one in run_modes.modes), lerobot_python)

    def planned(modes: "Sequence[RequestMode]") -> "PolicyRun":
        extent = study.PolicySelection(limit, None if shard is None else read_shard(shard), answers, shapley)
        names = options.names(conditions)
        return study.plan(frames, modes, out, seed=seed, extent=extent, conditions=names, prompt=prompt)

    allowed = making.allowed(out, shard=shard, in_words=any(states(one.spec) for one in run_modes.modes))
    done = f"'eyechart verdict {out}' judges, 'eyechart report {out} --out page.html' makes the page"
    make(planned, [out], run_modes, allowed, done)


_SCENES = "'eyechart score {}' prints the table, the clauses and every figure"


def make(
    plan: "Callable[[Sequence[RequestMode]], P]",
    runs: Sequence[Path],
    run_modes: "RunModes",
    allowed: "RunAllowance",
    done: str = "",
    *,
    fixed: Mapping[str, object] | None = None,
    show: "Callable[[P], object]" = lambda _: None,
    **how: bool,
) -> None:
    """Plan a run of any study, probe its models, make its calls and print how it ended.

    ``runs`` and ``how`` are those of a `Planner`. A probe changes no field that is ``fixed`` or set
    by an option. ``show`` prints results before the end; ``done`` is the last line.
    """
    from eyechart.studies.probes import Planner

    planned, failed = _probed(Planner(plan, runs, **how), run_modes, allowed, fixed or {})
    say(*planned.lines(allowed))
    if allowed.dry_run:
        return
    with _live_page(planned, allowed) as also, resumable(planned.kept):
        outcome = planned.make(allowed, partial(_bar, also=also))
    show(planned)
    for end in planned.ends(outcome, failed):
        _end(end)
    if done:
        say(f"done: {done}")


def _end(end: "RunEnding") -> None:
    say(*end.lines)
    if end.code:
        raise typer.Exit(end.code)


def _probed(
    study: "Planner[P]", run_modes: "RunModes", allowed: "RunAllowance", fixed: Mapping[str, object]
) -> "tuple[P, dict[str, str]]":
    """Plan a study with its models probed, and why some were left out; exit 1 without any."""
    from eyechart.planned_run import unasked
    from eyechart.probe import ProbeError
    from eyechart.probe.mode_probe import MOST_CALLS
    from eyechart.report.accounts import probe_words
    from eyechart.studies import probes

    def ask(
        mode: "RequestMode", sample: "Sample", most: float | None, spend: "Callable[[Usage], None]"
    ) -> "ProbeResult | ProbeError":
        say(f"{mode.spec} is probed first, in at most {MOST_CALLS} calls; --no-probe skips that")
        kept = "the probe's calls are counted; the same command probes again"
        bounds: ProbeOptions = {"prices": allowed.prices, "max_cost": most, "spend": spend}
        try:
            result = probe.probed(mode, {**run_modes.given, **fixed}, sample, kept, **bounds)
        except ProbeError as error:
            return error
        say(*probe_words(result))
        if result.sight.outcome == "blind":
            say(f"warning: {mode.spec} did not see the probe's pictures: guard 'picture' will mark its verdict")
        return result

    planned, failed = probes.plan_probed(study, run_modes, allowed, ask, say)
    if planned is None:
        _end(unasked(failed))
    assert planned is not None
    return planned, failed


@contextmanager
def _bar(what: str, unit: str, also: Callable[[int, int], None]) -> "Iterator[Callable[[int, int], None]]":
    """Show a bar; yield the function that moves it and the run's page."""
    with progress(what, unit) as move:

        def both(done: int, total: int) -> None:
            also(done, total)
            move(done, total)

        yield both


def _live_page(planned: "PlannedRun", allowed: "RunAllowance") -> "AbstractContextManager[Callable[[int, int], None]]":
    """With --watch, return what serves a page of the run during a block; it yields what moves its bar."""
    if not allowed.watch:
        return nullcontext(lambda *_: None)
    from eyechart.serve.live import watched

    return watched(planned, allowed.prices, say)


def merge(
    shards: Annotated[list[Path], typer.Argument(help="Folders of the shards.")],
    out: Annotated[Path, typer.Option(help="Folder of the merged run.")],
) -> None:
    """Merge the shards of one run into a new run. Example: eyechart merge run-1 run-2 --out run."""
    from eyechart.studies import battery as study

    calls = study.merge(shards, out)
    say(f"{counted(calls, 'call')} from {counted(len(shards), 'shard')} in {out}")
    say(*study.begun(out).left_lines())
