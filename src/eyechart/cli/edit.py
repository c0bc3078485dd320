"""``eyechart frames edit``: control pictures made from annotated photographs."""

import math
import shlex
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from eyechart.cli.options import Json
from eyechart.cli.terminal import print_json, progress, say
from eyechart.errors import SpecError, counted, require_known

if TYPE_CHECKING:
    from eyechart.edits import Annotations, EditResult, Moves
    from eyechart.frames import Span
    from eyechart.looks import Look, LookRequest

_SHOWN = 12
"""Reasons are printed up to this number; edit.json has every one."""

EPILOG = (
    "Example: eyechart frames edit photos --table photos.csv --objects objects.csv --near 5:9 --far 40:60 --lane 3.5 "
    "--eye 1.65 --out edited"
)


def edit(
    photos: Annotated[Path, typer.Argument(help="Folder of the photographs.")],
    *,
    objects: Annotated[
        Path,
        typer.Option(
            help="A row an object: file, role (lead, empty, own, ignored), x0, y0, x1, y1, distance_m; optional mask, "
            "truncated, occluded. With --format its own file or folder."
        ),
    ],
    near: Annotated[str, typer.Option(help="Where the lead is near, as 5:9, in metres.")],
    far: Annotated[str, typer.Option(help="Where the lead is far, as 40:60.")],
    out: Annotated[Path, typer.Option(help="New folder of the pictures, the table, the sheet and the record.")],
    table: Annotated[
        Path | None,
        typer.Option(
            help="A row a photograph: file, episode, step, scenario; optional horizon, vanishing, beside, clear_to_m. "
            "With --format it may be left out."
        ),
    ] = None,
    format_: Annotated[
        str, typer.Option("--format", help="Form of the objects: table, kitti, nuscenes, coco, yolo or mot.")
    ] = "table",
    lane: Annotated[float | None, typer.Option(help="Width of a way in metres; the exchange needs it.")] = None,
    eye: Annotated[float | None, typer.Option(help="Height of the camera in metres; the exchange needs it.")] = None,
    boxes: Annotated[
        str, typer.Option(help="What x0, y0, x1, y1 are: xyxy, xywh, cxcywh, or percent (x, y, width, height).")
    ] = "xyxy",
    cut: Annotated[
        str | None,
        typer.Option(help="How objects without a mask are cut out: grabcut or box; default: grabcut with OpenCV."),
    ] = None,
    shadow: Annotated[
        float, typer.Option(help="Strip of road around the foot that goes along, as a share of the lead's height.")
    ] = 0.08,
    from_foot: Annotated[
        float | None,
        typer.Option(help="Focal length times camera height in px·m, for objects without a distance; needs horizon."),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the distances at which copies are placed.")] = 0,
    json: Json = False,
) -> None:
    """Make the control pictures of a bank from photographs of which a lead was annotated.

    The lead is cut out, the hole is filled with the road itself, and copies are put near, far and
    beside. Look at sheet.png before anything is asked: it is for you to say whether these are
    pictures of a road. What cannot be edited well is refused by picture, with a reason.
    """
    from eyechart.edits import CUTS, EditSource, edit_photographs, usual_cut

    if cut is not None:
        require_known(f"--cut '{cut}'", cut, CUTS)
    moves = moves_of(near, far, lane, eye, seed=seed, shadow=shadow)
    if from_foot is not None and not 0 < from_foot < 1e9:
        raise SpecError(f"--from-foot is focal length times camera height in px·m, above 0; not {from_foot:g}")
    annotations = _annotations(photos, objects, table, form=format_, boxes=boxes)
    cuts, finds = cut or usual_cut(), format_ != "table"
    source = EditSource(photos, annotations, objects.parent, boxes, cuts, from_foot, finds_leads=finds)
    with progress("edit", "photographs") as move:
        record = edit_photographs(source, moves, out, move)
    following = import_command(out, _between(moves))
    if json:
        print_json({"out": str(out), **_without_digests(record), "next": following})
        return
    say(*words_of(record, out), f"then: {following}")


def moves_of(
    near: str | None,
    far: str | None,
    lane: float | None,
    eye: float | None,
    **more: Any,  # noqa: ANN401 - of Moves
) -> "Moves":
    """Return where copies are put; raises SpecError without the two ranges."""
    from eyechart.edits import Moves

    if near is None or far is None:
        raise SpecError("give --near and --far, the ranges of the lead's distances in metres, as 5:9 and 40:60")
    return Moves(_span("near", near), _span("far", far), lane, eye, **more)


def look_at_sheet(wanted: "LookRequest", objects: Path, moves: "Moves") -> "Look":
    """Edit a look's photographs into its folder, and return the answer that stops at the sheet."""
    from eyechart.edits import EditSource, edit_photographs, read_annotations
    from eyechart.looks import Look, NextStep

    photos, table, out = wanted.pictures.photos, wanted.pictures.table, wanted.out / "edited"
    if photos is None or table is None:
        raise SpecError("--objects belongs to --photos FOLDER and --table FILE: they say what these objects are in")
    threshold = wanted.pictures.threshold or _between(moves)
    brought = replace(wanted.pictures, photos=out, table=out / "table.csv", threshold=threshold, unit="m")
    step = NextStep("go on, if these are pictures of a road", replace(wanted, pictures=brought).command())
    if out.exists():
        raise SpecError(f"{out} was edited already: look at {out / 'sheet.png'}, then '{step.command}'")
    source = EditSource(photos, read_annotations(photos, table, objects), objects.parent)
    with progress("edit", "photographs") as move:
        record = edit_photographs(source, moves, out, move)
    say(*words_of(record, out))
    because = f"No call was made yet. First look at {out / 'sheet.png'}: are these pictures of a road?"
    return Look(wanted.spec, "Inconclusive", because, next=(step,))


def _between(moves: "Moves") -> float:
    """Return a distance between near and far, below which a lead is near."""
    return round(math.sqrt(moves.near[1] * moves.far[0]), 1)


def _annotations(photos: Path, objects: Path, table: Path | None, *, form: str, boxes: str) -> "Annotations":
    """Return what two tables say, or objects in another form; raises SpecError for options that do not fit."""
    from eyechart.edits import ANNOTATION_FORMATS, BOXES, read_annotations, read_format

    require_known(f"--format '{form}'", form, ("table", *ANNOTATION_FORMATS))
    require_known(f"--boxes '{boxes}'", boxes, BOXES)
    if form != "table":
        if boxes != BOXES[0]:
            raise SpecError(f"--boxes is for the table of objects: --format {form} says itself what its boxes are")
        return read_format(form, photos, objects, table)
    if table is None:
        raise SpecError("give --table, the table of the photographs with a row each, or the --format of the objects")
    return read_annotations(photos, table, objects, boxes)


def _span(name: str, text: str) -> "Span":
    """Return a range of distances ``A:B``; raises SpecError."""
    first, colon, last = text.partition(":")
    try:
        return float(first), float(last if colon else first)
    except ValueError as error:
        raise SpecError(f"--{name} takes two distances in metres, as 5:9; got '{text}'") from error


def _without_digests(record: "EditResult") -> dict[str, object]:
    return {name: value for name, value in record.as_dict().items() if name != "digests"}


def import_command(out: Path, threshold: float) -> str:
    """Return the command that makes a bank of an edited folder."""
    words = [
        "eyechart",
        "frames",
        "import",
        str(out),
        "--table",
        str(out / "table.csv"),
        "--threshold",
        f"{threshold:g}",
    ]
    return shlex.join([*words, "--unit", "m", "--mirror", "horizontal", "--out", "bank"])


def words_of(record: "EditResult", out: Path) -> list[str]:
    """Return what an edit made and refused, a line each."""
    lines = [f"{counted(count, 'photograph')} with {name}" for name, count in record.pictures.items()]
    reasons = record.by_reason()
    refused = [
        f"not made, {counted(count, 'picture')} or all of a photograph: {why}"
        for why, count in [*reasons.items()][:_SHOWN]
    ]
    more = [f"and {len(reasons) - _SHOWN} more reasons, in {out / 'edit.json'}"] if len(reasons) > _SHOWN else []
    return [*lines, *refused, *more, *record.notes, f"look at {out / 'sheet.png'} before you go on"]
