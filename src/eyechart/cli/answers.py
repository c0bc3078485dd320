"""Answers made elsewhere: ``eyechart frames export`` and ``run import``."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eyechart.cli import options
from eyechart.cli.terminal import progress, resumable, say
from eyechart.errors import SpecError

if TYPE_CHECKING:
    from eyechart.studies.battery import BatterySettings

_Controls = Annotated[
    str | None,
    typer.Option(
        help="auto: only the control pictures that the answers need, later; all; none. Default: auto, none with "
        "--conditions."
    ),
]


def export(
    bank: Annotated[Path, typer.Argument(help="Folder of the bank.")],
    out: Annotated[Path, typer.Option(help="Folder to write; an interrupted export leaves none.")],
    conditions: options.Conditions = None,
    prompt: options.Prompt = None,
    seed: options.Seed = 0,
    limit: options.Limit = None,
    controls: _Controls = None,
    model: Annotated[
        str | None, typer.Option(help="The SPEC that seeds the calls; with --run, one of the run's models.")
    ] = None,
    run: Annotated[
        Path | None, typer.Option(help="A run: export only its calls without an answer, control pictures included.")
    ] = None,
) -> None:
    """Write every picture of a battery and a table of its calls, to make the calls elsewhere.

    'eyechart run import' reads the answers. With --run, it writes only what that run lacks: the
    calls without an answer, and the control pictures that its answers need.
    Example: eyechart frames export bank --conditions real,real_repeat,blank --out asked
    """
    from eyechart.studies.battery import questions_left, questions_of, write_questions

    if run is not None:
        if (conditions, prompt, seed, limit, controls) != (None, None, 0, None, None):
            raise SpecError(
                "--run decides which calls are written: leave out --conditions, --prompt, --seed, --limit and "
                "--controls"
            )
        questions = questions_left(bank, run, model)
    else:
        questions = questions_of(bank, _asking(prompt, conditions, seed, limit, controls), model)
    for name, why in questions.left_out.items():
        say(f"left out: {name}, because {why}")
    with progress("export", "calls") as move:
        calls, pictures = write_questions(questions, out, progress=move)
    say(f"{calls} calls ({', '.join(f'{count} {name}' for name, count in questions.conditions.items())})")
    say(f"{pictures} pictures and the tables asked.jsonl and asked.csv in {out}")


def import_(
    answers: Annotated[
        Path,
        typer.Argument(
            help="CSV, JSON lines or Parquet; an OpenAI batch's output; a log of Inspect AI (.eval, .json)."
        ),
    ],
    frames: options.Frames,
    out: options.Out,
    model: Annotated[
        str | None, typer.Option(help="The model that answered; default: the file's name, or the model in a log.")
    ] = None,
    prompt: options.Prompt = None,
    conditions: options.Conditions = None,
    seed: options.Seed = 0,
    limit: options.Limit = None,
    controls: _Controls = None,
    accept_loss: options.AcceptLoss = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Check the answers; write nothing.")] = False,
) -> None:
    """Make a battery's run from answers to 'eyechart frames export' that came from elsewhere.

    A table has the columns call and repeat as exported, and text. It may have finish_reason, error,
    served, prompt_tokens, completion_tokens, seconds and cost_usd. A log of Inspect AI is one of
    the task eyechart/battery. In the output of an OpenAI batch (.jsonl), custom_id is the call of
    the export. Give the same options as to the export. If anything is wrong, all faults are listed
    and nothing is written. The same command adds later answers to the run. Exit 1: calls are
    without an answer.
    Example: eyechart run import answers.jsonl --frames bank --model my-vlm --out run
    """
    from eyechart.studies.battery import answer_import

    asking = _asking(prompt, conditions, seed, limit, controls)
    if accept_loss and not dry_run:
        options.accept(out)
    with resumable(), progress("answers", "rows") as move:
        source = answer_import.source_of(answers)
        read = answer_import.read_import(frames, source, out, model, asking, progress=move)
    say(f"{read.spec}: {read.brought.words}; eyechart made none of these calls, and every verdict on them says so")
    for words in read.widened:
        say(f"warning: {words}")
    if dry_run:
        return
    with resumable("imported answers are kept; the same command continues"), progress("import", "rows") as move:
        answer_import.bring(read, progress=move)
    left, more = read.battery.left(), sum(read.battery.more_by_model().values())
    if left:
        say(f"{left} of {read.battery.counts()[0]} calls are without an answer")
    if left or more:
        up_to = f", with up to {more} control pictures that its answers may need" if more else ""
        say(f"'eyechart frames export {frames} --run {out} --out FOLDER' writes the missing calls{up_to}")
    say(f"done: 'eyechart verdict {out}' judges, 'eyechart score {out}' prints every statistic")
    if left:
        raise typer.Exit(1)


def _asking(
    prompt: str | None, conditions: str | None, seed: int, limit: int | None, controls: str | None
) -> "BatterySettings":
    from eyechart.studies.battery import BatterySelection, BatterySettings

    chosen = None if conditions is None else tuple(name.strip() for name in conditions.split(","))
    return BatterySettings(prompt, chosen, seed, BatterySelection(limit, controls=controls))
