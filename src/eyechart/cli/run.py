"""``eyechart run`` makes calls about the frames of a bank and only appends; ``eyechart merge`` joins shards."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eyechart.cli import options
from eyechart.cli.probe import plan_probed, say_aside, tell_empty, tell_none
from eyechart.cli.terminal import progress, resumable, say
from eyechart.errors import LedgerError, SpecError, perhaps

if TYPE_CHECKING:
    from eyechart.costs import CostEstimate
    from eyechart.limits import Outcome, Spent
    from eyechart.manifest import Manifest
    from eyechart.modes import RequestMode
    from eyechart.probe import Sample
    from eyechart.run import Plan
    from eyechart.studies.battery import Battery
    from eyechart.studies.probed import Allowed, Asked
    from eyechart.studies.prompts import PromptStudy

app = typer.Typer(help="Run a study: make its calls and append them to a ledger.", no_args_is_help=True)

View = Annotated[
    str | None, typer.Option(help="calibrated or none; default: calibrated where the pictures have such a view.")
]
_WORTH_SAYING_GB = 0.1
"""Smaller weights fit everywhere."""


@app.command(
    epilog="Example: eyechart run battery --model scripted:depth --frames bank --out run. With --stop-early, for each "
    "model, a false early verdict has a chance of at most .05 however often one looks (.01 for each of not_scorable, "
    "depth by intervention, presence_only, refusal_effect and image_invariant; that the whole run would have been "
    "not_scorable, .02); success at following the gap by observation never stops a run. Try it with --dry-run first."
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
    concurrency: options.Concurrency = 8,
    how: options.Options = options.AS_USUAL,
    spending: options.Spending = options.NO_LIMIT,
    controls: Annotated[
        str | None,
        typer.Option(
            help="auto: of each model the control pictures that its answers call for; all; none. Default: auto, none "
            "with --conditions, and as begun for a run that is there."
        ),
    ] = None,
    stop_early: Annotated[
        bool, typer.Option("--stop-early", help="Ask a model no more once its verdict is settled; see below.")
    ] = False,
    fresh_controls: Annotated[
        bool,
        typer.Option("--fresh-controls", help="Draw the distances of the bank's controls anew, for this run alone."),
    ] = False,
    again: options.AskAgain = False,
    dry_run: options.DryRun = False,
) -> None:
    """Run the input-ablation battery. Interrupt it at will: the same command goes on where it stopped.

    The options from --base-url to --option are for the models without a --mode file; of these, one that is served
    elsewhere is probed first (as 'eyechart probe' does), and what is found is kept in the run. Exit 1: calls are
    unfinished; 3: stopped at --max-calls or --max-cost.
    """
    from eyechart.run import read_shard
    from eyechart.studies import battery as study

    asked_about = _with_fresh_controls(frames, out, shard, dry_run=dry_run) if fresh_controls else frames

    def planned_for(modes: "Sequence[RequestMode]", probes: "Mapping[str, Spent]") -> "Battery":
        return study.plan(
            asked_about,
            modes,
            out,
            prompt=prompt,
            conditions=None if conditions is None else [name.strip() for name in conditions.split(",")],
            seed=seed,
            extent=study.Extent(limit, None if shard is None else read_shard(shard), stop_early, controls),
        ).counting(probes)

    done = "'eyechart verdict {0}' judges, 'eyechart score {0}' prints every statistic"
    asked, allowed = options.read_modes(model, mode, how.given()), spending.allowed(out, dry_run=dry_run, shard=shard)
    _make_calls(asked, planned_for, out, allowed, concurrency, sizes, done, again=again)


@options.expanded
def prompts(
    frames: options.Frames,
    out: Annotated[Path, typer.Option(help="Folder of the study, one run a cell; the same one resumes it.")],
    model: options.Model = None,
    mode: options.Mode = None,
    prompt: Annotated[
        list[str] | None, typer.Option(help="A prompt's name or FILE.toml; again for more. Default: the six built-in.")
    ] = None,
    budget: Annotated[list[int] | None, typer.Option(min=1, help="Tokens of a reply; again to compare.")] = None,
    json_mode: Annotated[
        list[str] | None, typer.Option(help="none, json_object or json_schema; again to compare them.")
    ] = None,
    conditions: Annotated[
        str, typer.Option(help="With commas; real_repeat too gives s and IDI_adj; 'all': a battery.")
    ] = "real,blank",
    limit: Annotated[int, typer.Option(min=1, help="Frames a cell, the same in each.")] = 100,
    seed: options.Seed = 0,
    concurrency: options.Concurrency = 8,
    how: options.Addressing = options.ADDRESSED,
    spending: options.Spending = options.NO_LIMIT,
    again: options.AskAgain = False,
    dry_run: options.DryRun = False,
) -> None:
    """Run the prompt study: diversity, and beside it the scene dependence that diversity is not (Table t:prompts).

    A model that is served elsewhere, and that no --mode file says how to ask, is probed first with all of the prompts.
    Exit 1: calls are unfinished; 3: stopped at --max-calls or --max-cost.
    Example: eyechart run prompts --model scripted:depth --frames bank --out prompts --prompt baseline --prompt minimal
    """
    from itertools import product

    from eyechart.modes import STRUCTURED
    from eyechart.prompts import PROMPTS
    from eyechart.studies import prompts as study
    from eyechart.studies.battery import keep_probes, sample_of
    from eyechart.studies.probed import Probing

    for one in json_mode or ():
        if one not in STRUCTURED:
            raise SpecError(f"--json-mode '{one}' is none of {', '.join(STRUCTURED)}{perhaps(one, STRUCTURED)}")
    asked, allowed = options.read_modes(model, mode, how.given()), spending.allowed(out, dry_run=dry_run)

    def planned_for(modes: "Sequence[RequestMode]", probes: "Mapping[str, Spent]") -> "PromptStudy":
        return study.plan(
            frames,
            modes,
            out,
            prompts=prompt or tuple(PROMPTS),
            factors=[study.Factor(*setting) for setting in product(budget or (None,), json_mode or (None,))],
            conditions=() if conditions == "all" else [name.strip() for name in conditions.split(",")],
            limit=limit,
            seed=seed,
        ).counting(probes)

    planned, failed = plan_probed(
        Probing(
            planned_for,
            lambda one: sample_of(one.cells.values()),
            lambda one, probes: keep_probes(next(iter(one.cells.values())), probes),
            study.cells_in(out),
            whole=not budget,  # a cell with a budget of its own says nothing of the others'
        ),
        asked,
        allowed,
        {"structured": "none"},  # the form of an answer is a factor of this study
    )
    calls, finished, unknown = planned.counts()
    more = sum(sum(cell.more_by_model().values()) for cell in planned.cells.values())
    up_to = f", and up to {more} of controls" if more else ""
    say(
        f"{len(planned.cells)} cells × {len(asked.modes) - len(failed)} models: {calls} calls, {finished} finished, "
        f"{unknown} sent with unknown outcome, {calls - finished} to make{up_to}"
    )
    first = next(iter(planned.cells.values()))
    say(
        *planned.expected(allowed.prices, concurrency=concurrency),
        *in_turns(first.manifest, first.plan.models, (), allowed.sequential),
    )
    if dry_run:
        return
    with watched_progress("calls", "calls", out, allowed) as move:
        outcome = study.run(
            planned,
            concurrency=concurrency,
            calls=spending.max_calls,
            cost_usd=spending.max_cost,
            prices=allowed.prices,
            progress=move,
            again=again,
            sequential=allowed.sequential,
        )
    calls, finished, _ = planned.counts()
    _tell(outcome, failed, calls - finished)
    tell_empty(study.cells_in(out))
    say(f"done: 'eyechart score {out}' prints the table, 'eyechart score {out}/CELL' every statistic of a cell")


@options.expanded
def admission(
    frames: options.Frames,
    out: options.Out,
    model: options.Model = None,
    mode: options.Mode = None,
    view: View = None,
    seed: Annotated[int, typer.Option(min=0, help="Chooses the pairs, and the order of calls.")] = 0,
    concurrency: options.Concurrency = 8,
    how: options.Options = options.AS_USUAL,
    spending: options.Spending = options.NO_LIMIT,
    again: options.AskAgain = False,
    dry_run: options.DryRun = False,
) -> None:
    """Ask for scene estimates of 16 balanced frame/mirror pairs, and hold them against the clauses of admission.

    'eyechart score OUT' prints each clause with its value, interval and n. A model that is served elsewhere, and that
    no --mode file says how to ask, is probed first. Exit 1: calls are unfinished; 3: stopped at --max-calls or
    --max-cost. Example: eyechart run admission --model scripted:scene_side_blind --frames bank --out adm
    """
    from eyechart.studies import structured as study

    def planned_for(modes: "Sequence[RequestMode]", probes: "Mapping[str, Spent]") -> "Battery":
        return study.plan(study.ADMISSION, frames, modes, out, view=view, seed=seed).counting(probes)

    asked, allowed = options.read_modes(model, mode, how.given()), spending.allowed(out, dry_run=dry_run)
    _make_calls(asked, planned_for, out, allowed, concurrency, again=again)


@options.expanded
def structured(
    frames: options.Frames,
    out: options.Out,
    model: options.Model = None,
    mode: options.Mode = None,
    view: View = None,
    seed: Annotated[int, typer.Option(min=0, help="Of the order of calls and of sampling.")] = 0,
    limit: options.Limit = None,
    concurrency: options.Concurrency = 8,
    how: options.Options = options.AS_USUAL,
    spending: options.Spending = options.NO_LIMIT,
    again: options.AskAgain = False,
    dry_run: options.DryRun = False,
) -> None:
    """Ask for scene estimates of every frame of a bank and of its reflection (Table t:controller-local).

    The paper has 288 pairs: 'frames build highway --steps 24'. A model that is served elsewhere, and that no --mode
    file says how to ask, is probed first. Exit 1: calls are unfinished; 3: stopped at --max-calls or --max-cost.
    Example: eyechart run structured --model scripted:scene_positive_control --frames bank --out scenes
    """
    from eyechart.studies import structured as study

    def planned_for(modes: "Sequence[RequestMode]", probes: "Mapping[str, Spent]") -> "Battery":
        return study.plan(study.STRUCTURED, frames, modes, out, view=view, seed=seed, limit=limit).counting(probes)

    asked, allowed = options.read_modes(model, mode, how.given()), spending.allowed(out, dry_run=dry_run)
    _make_calls(asked, planned_for, out, allowed, concurrency, again=again)


def policy(
    frames: options.Frames,
    out: options.Out,
    policy: Annotated[list[str] | None, typer.Option(help="A policy's SPEC; give it again for more policies.")] = None,
    conditions: Annotated[str | None, typer.Option(help="With commas; default: all that the bank can show.")] = None,
    answers: Annotated[
        int, typer.Option(help="How often a policy that draws its answers is asked for each; no other is asked twice.")
    ] = 4,
    shapley: Annotated[
        bool, typer.Option("--shapley", help="Ask every subset of the channels, for Shapley shares; says the cost.")
    ] = False,
    seed: options.Seed = 0,
    limit: options.Limit = None,
    shard: options.Shard = None,
    concurrency: Annotated[int, typer.Option(min=1, help="Calls under way at once, a policy.")] = 1,
    timeout_s: Annotated[float | None, typer.Option(min=0.1, help="Seconds for an answer.")] = None,
    max_calls: Annotated[int | None, typer.Option(min=1, help="Stop at so many calls, all told.")] = None,
    again: options.AskAgain = False,
    accept_loss: options.AcceptLoss = False,
    dry_run: options.DryRun = False,
) -> None:
    """Ask policies about every frame of a bank, with each of their channels exchanged for another episode's.

    A policy answers with a motion: python:MODULE:FUNCTION takes (images, state, instruction) and returns an array
    (horizon, dimensions). Exit 1: calls are unfinished, or of a policy none holds a motion; 3: stopped at --max-calls.
    Example: eyechart run policy --policy trained:sees --frames bank --out run
    """
    from eyechart.conditions import by_reason
    from eyechart.importing.notes import notes
    from eyechart.limits import Limits
    from eyechart.run import read_shard
    from eyechart.studies import policy as study

    if accept_loss and not dry_run:
        options.accept(out)
    planned = study.plan(
        frames,
        policy or (),
        out,
        seed=seed,
        extent=study.Extent(limit, None if shard is None else read_shard(shard), answers, shapley),
        conditions=None if conditions is None else [name.strip() for name in conditions.split(",")],
        timeout_s=timeout_s,
    )
    plan, (calls, finished, unknown) = planned.plan, planned.counts()
    for names, why in by_reason(planned.left_out).items():
        say(f"left out: {names}, because {why}")
    say(*notes(plan.bank))
    size = f"{len(plan.models)} policies × {len(plan.frames)} frames × {len(plan.conditions)} conditions"
    say(
        f"{size}{_unshown(plan)}: {calls} calls, "
        f"{finished} finished, {unknown} sent with unknown outcome, {calls - finished} to make; a policy that turns "
        f"out to draw its answers is asked {answers} times"
    )
    if shapley:
        say(f"of these for Shapley shares alone: {planned.of_shapley} calls, as far as it is known who draws")
    if dry_run:
        return
    with resumable(), progress("calls", "calls") as move:
        outcome = study.run(planned, concurrency=concurrency, limits=Limits(max_calls), progress=move, again=again)
    calls, finished, _ = planned.counts()
    nothing = planned.motionless()
    for spec, (count, why) in nothing.items():
        last = "" if spec in outcome.set_aside else f", the last one ended with {why}"
        say(f"nothing can be judged: {spec}: of {count} finished calls none holds a motion{last}")
    _tell(outcome, {}, calls - finished, nothing=bool(nothing))
    say(f"done: 'eyechart verdict {out}' judges, 'eyechart report {out} --out page.html' makes the page")


def _of_scenes(planned: "Battery") -> list[str]:
    modes = [planned.manifest.mode(spec) for spec in planned.plan.models]
    return [f"view: {planned.manifest.view}", *sizes(planned), *bound(modes)]


def _make_calls(
    asked: "Asked",
    plan: "Callable[[Sequence[RequestMode], Mapping[str, Spent]], Battery]",
    out: Path,
    allowed: "Allowed",
    concurrency: int,
    lines: "Callable[[Battery], Sequence[str]]" = _of_scenes,
    done: str = "'eyechart score {}' prints the table, the clauses and every figure",
    *,
    again: bool = False,
) -> None:
    """Probe the models that are to be, say in ``lines`` what is planned, and make the calls."""
    from eyechart.studies import battery as study
    from eyechart.studies.probed import Probing

    def sample(one: "Battery") -> "Sample":
        return replace(study.sample_of([one]), at_once=concurrency)

    probing = Probing(plan, sample, study.keep_probes, [out])
    planned, failed = plan_probed(probing, asked, allowed)
    early = planned.manifest.stop_early
    expected = study.expected(planned, allowed.prices, concurrency=concurrency)
    turns = in_turns(planned.manifest, planned.plan.models, expected, allowed.sequential)
    say(*lines(planned), *(one.words for one in expected), *turns, *(_before(planned) if early else ()))
    if allowed.dry_run:
        return
    limits = planned.manifest.within(allowed.prices, calls=allowed.max_calls, cost_usd=allowed.max_cost)
    with watched_progress("calls", "calls", out, allowed) as move:
        outcome = study.run(
            planned,
            concurrency=concurrency,
            limits=limits,
            progress=move,
            again=again,
            sequential=allowed.sequential,
        )
    say(*(_after(planned) if early else ()))
    _tell(outcome, failed, 0 if outcome.whole and not early else planned.left())
    tell_empty([out])
    say(f"done: {done.format(out)}")


def _with_fresh_controls(frames: Path, out: Path, shard: str | None, *, dry_run: bool) -> Path:
    """Return the bank of a run that has controls of its own: it stands in the run's folder, and is made there once."""
    from secrets import randbelow

    from eyechart.frames import open_bank
    from eyechart.manifest import BANK, OWN, is_free, is_run
    from eyechart.simulators.banks import MOST_SEED, redraw

    if shard is not None:
        raise SpecError(
            "--fresh-controls needs one run, for shards share their pictures: leave out --shard, or build one bank for "
            "all of them with 'eyechart frames build SIMULATOR --controls-seed N --out BANK'"
        )
    own = out / BANK
    if not is_free(out):
        bank = open_bank(frames)
        if (
            not (own / bank.frames[0].file).is_file()
            or open_bank(own).manifest.fingerprint != bank.manifest.fingerprint
        ):
            begun = "a run that was begun without --fresh-controls, or on another bank" if is_run(out) else "no run"
            raise LedgerError(f"{out} holds {begun}; choose another --out")
        return own
    if dry_run:
        say("controls: their distances will be drawn anew, into the run's folder")
        return frames
    with progress("controls", "frames") as move:
        seed = redraw(frames, own, randbelow(MOST_SEED), move).manifest.controls.seed
    (own / OWN).touch()
    say(f"controls: drawn anew into {own} by seed {seed}")
    return own


@contextmanager
def watched_progress(
    what: str, unit: str, out: Path, allowed: "Allowed", kept: str | None = None
) -> "Iterator[Callable[[int, int], None]]":
    """Show a bar while a run goes on, and serve its page where ``allowed`` asks for one."""
    with live_page(out, unit, allowed) as also, moved(what, unit, also, kept) as move:
        yield move


@contextmanager
def moved(
    what: str, unit: str, also: Callable[[int, int], None], kept: str | None = None
) -> "Iterator[Callable[[int, int], None]]":
    """Show a bar, and yield what moves it and another."""
    with resumable(kept) if kept else resumable(), progress(what, unit) as move:

        def both(done: int, total: int) -> None:
            also(done, total)
            move(done, total)

        yield both


@contextmanager
def live_page(out: Path, unit: str, allowed: "Allowed") -> "Iterator[Callable[[int, int], None]]":
    """Serve a page that shows a run while the block lasts, where that is asked for; yield what moves its count."""
    if not allowed.watch:
        yield lambda *_: None
        return
    from eyechart.serve.live import Live, watched

    live = Live(out, allowed.prices, unit=unit)
    words = "the page of this run is not served, and the run goes on"
    with watched(
        live,
        lambda url: say(f"watch: {url} shows this run while it goes on"),
        lambda why: say(f"watch: {words}: {why}"),
    ):
        yield live.move


def _unshown(plan: "Plan") -> str:
    """Say that some frames cannot be shown every condition, so that a product is more than the calls."""
    every = all(plan.shows(condition, frame) for condition in plan.conditions for frame in plan.frames)
    return "" if every else " (not every frame can be shown every condition)"


def sizes(planned: "Battery") -> list[str]:
    """Say what is left out and why, and how many calls there are."""
    from eyechart.conditions import by_reason

    plan, (calls, finished, unknown) = planned.plan, planned.counts()
    to_make = f"{'at most ' if planned.manifest.stop_early else ''}{planned.left()}"
    size = f"{len(plan.models)} models × {len(plan.frames)} frames × {len(plan.conditions)} conditions{_unshown(plan)}"
    return [
        *(f"left out: {names}, because {why}" for names, why in by_reason(planned.left_out).items()),
        f"{size}: {calls} calls, {finished} finished, {unknown} sent with unknown outcome, {to_make} to make",
        *_controls(planned),
        *_out_of_reach(planned),
    ]


def _out_of_reach(planned: "Battery") -> list[str]:
    """Say which verdicts so few frames cannot give, before they are paid; nothing of a shard, or where none is left."""
    from eyechart.studies.battery.reach import unreached

    plan, manifest = planned.plan, planned.manifest
    if manifest.shard is not None or not planned.left():
        return []
    never = ", ".join(unreached(plan.bank, plan.frames, plan.conditions))
    more = f"'eyechart plan {manifest.bank_path}' says what does"
    return [f"these {len(plan.frames)} frames cannot show, whoever is asked: {never}; {more}"][: bool(never)]


def _controls(planned: "Battery") -> list[str]:
    """Say how many calls of controls may come, and where a shard leaves them."""
    if planned.manifest.controls == "auto" and planned.manifest.shard is not None:
        return ["controls: none in a shard, which lacks the answers that call for them; the merged run, resumed, asks"]
    more = sum(planned.more_by_model().values())
    return [f"controls: up to {more} calls more, of models whose answers claim what these could take away"][: more > 0]


def in_turns(
    manifest: "Manifest", models: "Iterable[str]", expected: "Sequence[CostEstimate]", sequential: bool | None
) -> list[str]:
    """Say which models are asked one after another, how long that takes, and what weights need of this memory.

    Before that, what the models themselves give to think about.
    """
    from eyechart.costs import duration
    from eyechart.models import turns_of

    asked, facts = list(models), manifest.facts
    lines = [f"warning: {spec}: {facts[spec]['warning']}" for spec in asked if "warning" in facts.get(spec, {})]
    seconds = {one.model: one.seconds for one in expected}
    turns = turns_of(map(manifest.mode, asked), sequential=sequential)
    for turn in turns:
        if len(turn) > 1:
            known = [seconds.get(spec) for spec in turn]
            took = sum(one for one in known if one is not None)
            time = f", about {duration(took)} in all" if took and None not in known else ""
            lines.append(
                f"one after another, each closed before the next is opened{time}: {', '.join(turn)}; --together asks "
                "them at once"
            )
    return lines + _weights(manifest, turns)


def _weights(manifest: "Manifest", turns: "Sequence[Sequence[str]]") -> list[str]:
    """Say what the weights that this machine holds at one time take, where models tell what theirs do."""
    from eyechart.models import HERE, MEMORY_GB, WEIGHTS_GB, machine_of, memory_here_gb

    facts = {spec: one for spec, one in manifest.facts.items() if machine_of(manifest.mode(spec)) == HERE}
    needed = {spec: float(one[WEIGHTS_GB]) for spec, one in facts.items() if WEIGHTS_GB in one}
    asked = [[spec for spec in turn if spec in needed] for turn in turns]
    once = sum(max((needed[spec] for spec in turn), default=0.0) for turn in asked)
    if once < _WORTH_SAYING_GB:
        return []
    each = ", ".join(f"{spec} {needed[spec]:.3g} GB" for turn in asked for spec in turn)
    there = min(
        (float(facts[spec][MEMORY_GB]) for spec in needed if MEMORY_GB in facts[spec]), default=memory_here_gb()
    )
    of = "" if there is None else f" of {there:.3g} GB"
    lines = [f"memory: at most {once:.3g} GB{of} for weights at once, and what answering takes on top ({each})"]
    if there is not None and once > there >= max(needed.values()):
        lines.append("warning: these weights do not fit together: ask the models with --sequential")
    return lines


def bound(modes: "Sequence[RequestMode]") -> list[str]:
    """Say of each model whether its server is told the schema, and warn where a probe found that it does not bind."""
    lines = []
    for mode in modes:
        if mode.spec.startswith("scripted:"):
            continue
        if mode.spec.startswith("hf:"):
            lines.append(f"{mode.spec}: replies are read strictly; a checkpoint run here binds no schema")
        elif mode.structured != "json_schema":
            lines.append(f"{mode.spec}: replies are read strictly; --json-mode json_schema binds the schema")
        elif mode.measured is not None and mode.measured.schema_binds is False:
            lines.append(f"warning: {mode.spec}: the schema is sent, but a probe found that this server ignores it")
    return lines


def _tell(outcome: "Outcome", failed: Mapping[str, str], left: int, *, nothing: bool = False) -> None:
    """Print how a run ended; raise Exit 3 where a limit stopped it, 1 where calls are unfinished.

    Or where ``nothing`` that came can be judged, whatever stopped it.
    """
    whole = replace(outcome, set_aside={**failed, **outcome.set_aside})
    say_aside(whole)
    for model, words in outcome.failed.items():
        if model not in whole.set_aside:
            say(f"{model}: {words}")
    if outcome.stopped is not None and left:
        say(f"stopped: {outcome.stopped}; {left} calls are left; a higher limit resumes")
        raise typer.Exit(1 if nothing else 3)
    if not left and whole.set_aside:
        tell_none({})
    if left:
        say(f"{left} calls are unfinished: {_to_finish(outcome)}")
    if left or nothing:
        raise typer.Exit(1)


def _to_finish(outcome: "Outcome") -> str:
    """Return in words what makes the calls that are unfinished."""
    tries = "their last error may pass, and the same command tries them again"
    lasting = sorted(outcome.lasting & outcome.set_aside.keys())
    if not lasting:
        return tries
    mend = (
        f"mend what is wrong with {', '.join(lasting)}, and the same command makes them; a Python file that was "
        "changed is another version, and needs another --out"
    )
    passing = {*outcome.set_aside, *outcome.failed} - outcome.lasting
    return f"{mend}. Of the others {tries}" if passing else mend


def _before(planned: "Battery") -> list[str]:
    """Say what stopping early guarantees, and the most and the typical number of calls."""
    from eyechart.verdicts import GUARANTEE, VALIDITY

    more = planned.more_by_model()
    most = max(sum(1 for _ in planned.plan.keys_of(model)) + more[model] for model in planned.plan.models)
    counts = sorted(planned.typical().items(), key=lambda one: one[1])
    typical = ", ".join(f"{count} ({label})" for label, count in counts)
    return [
        f"stop early: {GUARANTEE}",
        f"stop early: {VALIDITY}",
        f"stop early: at most {most} calls a model; of a controller that never wavers {typical or 'as many'}",
    ]


def _after(planned: "Battery") -> list[str]:
    """Say which models were stopped early, and the calls saved."""
    lines, planned_calls, saved = [], 0, 0
    for model, one in planned.progress().items():
        calls = sum(1 for _ in planned.plan.keys_of(model)) if one.stopped is None else one.stopped.planned
        planned_calls += calls
        if one.stopped is None:
            lines.append(f"{model}: not stopped early, {one.left} of {calls} calls left")
            continue
        saved += one.stopped.saved
        beyond = f", {one.stopped.beyond} ended after the stop and do not count" if one.stopped.beyond else ""
        share = f"{one.stopped.saved} calls saved ({one.stopped.saved / calls:.0%})"
        lines.append(f"{model}: {one.stopped.words()}: {share}{beyond}")
    return [*lines, f"calls saved: {saved} of {planned_calls} ({saved / max(planned_calls, 1):.0%})"]


def merge(
    shards: Annotated[list[Path], typer.Argument(help="Folders of the shards.")],
    out: Annotated[Path, typer.Option(help="Folder of the merged run.")],
) -> None:
    """Merge the shards of one run into a new run. Example: eyechart merge run-1 run-2 --out run."""
    from eyechart.studies import battery as study

    calls = study.merge(shards, out)
    say(f"{calls} calls from {len(shards)} shards in {out}")
    whole = study.begun(out)
    left, more = whole.left(), sum(whole.more_by_model().values())
    if left or more:
        up_to = f", and up to {more} of controls" if more else ""
        asked = whole.manifest
        who = " ".join(f"--{'policy' if asked.study == 'policy' else 'model'} {spec}" for spec in asked.models)
        command = f"'eyechart run {asked.study} {who} --frames {asked.bank_path} --out {out}'"
        say(f"{left} calls are left{up_to}: {command}, with the options of the shards, makes them")
