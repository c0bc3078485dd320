"""``eyechart look``: one command that gives one answer about any model or policy."""

import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eyechart.cli.options import AskAgain, Json, LeRobotPython, Seed
from eyechart.cli.terminal import as_typed, from_here, print_json, print_line, progress, resumable, say
from eyechart.errors import SpecError

if TYPE_CHECKING:
    from eyechart.looks import Bill
    from eyechart.modes import RequestMode


def look(
    spec: Annotated[
        str, typer.Argument(help="A model's or a policy's SPEC, or a callable's MODULE:FUNCTION.", metavar="SPEC")
    ],
    frames: Annotated[
        Path | None, typer.Option(help="A bank; default: one of eyechart's, drawn into the look's folder.")
    ] = None,
    photos: Annotated[Path | None, typer.Option(help="Folder of photographs; with --table.")] = None,
    table: Annotated[Path | None, typer.Option(help="Table of the photographs, one row each.")] = None,
    dataset: Annotated[
        Path | None, typer.Option(help="Folder of a LeRobotDataset, or of demonstrations in HDF5.")
    ] = None,
    objects: Annotated[
        Path | None,
        typer.Option(help="Table of the photographs' objects: edit them as 'frames edit' does, and stop at the sheet."),
    ] = None,
    near: Annotated[str | None, typer.Option(help="With --objects: where the lead is near, as 5:9.")] = None,
    far: Annotated[str | None, typer.Option(help="With --objects: where the lead is far, as 40:60.")] = None,
    lane: Annotated[float | None, typer.Option(help="With --objects: width of a way in metres.")] = None,
    eye: Annotated[float | None, typer.Option(help="With --objects: height of the camera in metres.")] = None,
    threshold: Annotated[float | None, typer.Option(help="A distance below this is near, so that one brakes.")] = None,
    unit: Annotated[str | None, typer.Option(help="Unit of the distance.")] = None,
    map_: Annotated[
        list[str] | None, typer.Option("--map", help="PLACE=COLUMN, as 'frames import' takes it; repeat for more.")
    ] = None,
    base_url: Annotated[str | None, typer.Option(help="Address of the model's server.")] = None,
    mode: Annotated[Path | None, typer.Option(help="FILE.toml that says how to ask the model.")] = None,
    prompt: Annotated[str | None, typer.Option(help="A prompt's name or FILE.toml.")] = None,
    seed: Seed = 0,
    budget: Annotated[int | None, typer.Option(min=1, help="At most this many calls in total.")] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for all files; default: looks/NAME.")] = None,
    again: AskAgain = False,
    lerobot_python: LeRobotPython = None,
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask for consent to calls that may cost.")] = False,
    json: Json = False,
    accept: Annotated[str | None, typer.Option(help="part: exit 0 for 'In part' too.")] = None,
) -> None:
    """Find out whether a model, a callable or a policy looks, and show it on one screen.

    Frames come from a bank, from photographs or from a data set; otherwise eyechart draws them. A
    served model is first tested on drawn pictures. Then it is asked until its verdict is settled,
    on as few frames as can give every answer. With --objects it first edits the photographs, and
    stops at the sheet, before any call. The number of calls is printed first; if they may
    cost, you are asked for consent. The same command resumes and repeats no call.
    Exit 0: Yes; 1: No, or In part; 2: Inconclusive, or bad input. Example: eyechart look
    scripted:depth
    """
    from eyechart.importing.columns import read_places
    from eyechart.looks import LookRequest, Pictures, Watch, folder_name, look_at_sheet, spec_of
    from eyechart.looks import look as looked
    from eyechart.models import require_lerobot

    if accept not in (None, "part"):
        raise SpecError(f"--accept takes only 'part', not '{accept}'")
    pictures = Pictures(frames, photos, table, dataset, read_places(map_ or []), threshold, unit)
    request_mode = _request_mode(spec_of(spec), mode, base_url)
    require_lerobot([request_mode.spec], lerobot_python)
    place = out or from_here(Path("looks") / folder_name(request_mode.spec))
    from_here(Path(f"{as_typed(str(place))}-2"))  # records the folder of a second try as typed, too
    wanted = LookRequest(
        request_mode,
        pictures,
        place,
        by_file=mode is not None,
        prompt=prompt,
        seed=seed,
        budget=budget,
        file=mode,
        again=again,
        python=lerobot_python,
    )
    if objects is None and (near, far, lane, eye) != (None,) * 4:
        raise SpecError("--near, --far, --lane and --eye are for photographs that are edited: give --objects too")
    watch = Watch(say, progress, partial(_agree, yes=yes))
    with resumable():
        if objects is None:
            found = looked(wanted, watch)
        else:
            from eyechart.edits import Moves

            found = look_at_sheet(wanted, objects, Moves.read(near, far, lane, eye), watch)
    if json:
        print_json(found.as_dict())
    else:
        print_line(*found.lines(as_typed))
    raise typer.Exit(found.exit_code(accept_part=accept == "part"))


def _request_mode(spec: str, mode: Path | None, base_url: str | None) -> "RequestMode":
    """Return a model's request mode; raises SpecError for another model's, or two addresses."""
    from eyechart.modes import mode_of
    from eyechart.studies.probes import read_modes

    given = {} if base_url is None else {"base_url": base_url}
    if mode is None:
        return mode_of(spec, given)
    (only,) = read_modes(None, [mode], given, say).modes
    if only.spec != spec:
        raise SpecError(f"the mode {mode} is for '{only.spec}', not for '{spec}': give that model's mode")
    return only


def _agree(bill: "Bill", *, yes: bool) -> None:
    """Print the bill, and get consent if it may cost; raises SpecError without consent."""
    say(f"{bill.mode.spec}: {bill.words}")
    if bill.is_free or yes:
        return
    if not (sys.stdin.isatty() and sys.stderr.isatty()):
        raise SpecError(
            f"this may cost: {bill.words}; give --yes to agree, or --budget CALLS for less (no call was made yet)"
        )
    if not typer.confirm("Make these calls?", err=True):
        raise SpecError("no call was made: --budget CALLS takes fewer")
