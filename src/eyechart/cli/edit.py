"""``eyechart frames edit``: control pictures made from annotated photographs."""

from pathlib import Path
from typing import Annotated

import typer

from eyechart.cli.options import Json
from eyechart.cli.terminal import print_json, progress, say
from eyechart.errors import SpecError, require_known

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
    from eyechart.edits import CUTS, EditSource, Moves, annotations_of, edit_photographs, import_command, usual_cut

    if cut is not None:
        require_known(f"--cut '{cut}'", cut, CUTS)
    moves = Moves.read(near, far, lane, eye, seed, shadow)
    if from_foot is not None and not 0 < from_foot < 1e9:
        raise SpecError(f"--from-foot is focal length times camera height in px·m, above 0; not {from_foot:g}")
    annotations = annotations_of(format_, photos, objects, table, boxes)
    cuts, finds = cut or usual_cut(), format_ != "table"
    source = EditSource(photos, annotations, objects.parent, boxes, cuts, from_foot, finds_leads=finds)
    with progress("edit", "photographs") as move:
        record = edit_photographs(source, moves, out, move)
    following = import_command(out, moves)
    if json:
        values = {name: value for name, value in record.as_dict().items() if name != "digests"}
        print_json({"out": str(out), **values, "next": following})
        return
    say(*record.lines(out), f"then: {following}")
