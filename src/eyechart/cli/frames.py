"""``eyechart frames`` and ``eyechart plan``: frame banks, and what a bank can decide."""

from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eyechart.cli import edit as edits
from eyechart.cli.options import Json, Model, expanded, filled
from eyechart.cli.terminal import print_json, progress, say
from eyechart.errors import SpecError, counted
from eyechart.formats import FORMATS, Format, find_format, takers

if TYPE_CHECKING:
    from eyechart.frames import Provenance
    from eyechart.importing import Choices, Convert, Horizon
    from eyechart.importing.faults import Faults
    from eyechart.importing.numerals import Numerals

app = typer.Typer(help="Build, import, check and show frame banks.", no_args_is_help=True)


@app.command(
    epilog="Example: eyechart frames build highway --preset balanced --out bank\n\n"
    "Example: eyechart frames build --add-to bank"
)
def build(
    simulator: Annotated[str | None, typer.Argument(help="See 'eyechart list simulators'.")] = None,
    out: Annotated[Path | None, typer.Option(help="Folder of the new bank.")] = None,
    preset: Annotated[
        str, typer.Option(help="Which moments of an episode; see 'eyechart list simulators'.")
    ] = "balanced",
    seeds: Annotated[str, typer.Option(help="Seeds of the episodes, with commas.")] = "0,1,2",
    steps: Annotated[int, typer.Option(help="Frames per episode.")] = 12,
    controls_seed: Annotated[int, typer.Option(help="Seed of the distances in the control pictures.")] = 0,
    add_to: Annotated[
        Path | None,
        typer.Option(help="An older bank: add its missing control pictures, or with --out to a copy of it."),
    ] = None,
) -> None:
    """Render a frame bank: scenarios × seeds × steps, with ground truth.

    It also draws counterfactual and control pictures. With --add-to it draws only what an older
    bank lacks, with that bank's simulator, preset and seeds.
    """
    from eyechart.simulators import open_bank_simulator

    if add_to is not None:
        if simulator is not None:
            raise SpecError(f"--add-to uses the simulator of its bank: leave out '{simulator}'")
        _add_to(add_to, out)
        return
    if simulator is None or out is None:
        raise SpecError("give the simulator and --out, as 'eyechart frames build highway --out bank', or --add-to BANK")
    chosen = _seeds(seeds)
    with progress("frames", "frames") as move:
        made_by = open_bank_simulator(simulator)
        bank = made_by.build(out, preset=preset, seeds=chosen, steps=steps, controls_seed=controls_seed, progress=move)
    say(f"{counted(len(bank), 'frame')} in {out}, fingerprint {bank.manifest.fingerprint[:16]}")


def _add_to(root: Path, out: Path | None) -> None:
    """Add the missing pictures to a bank or its copy, and say how many."""
    from eyechart.simulators.additions import add_missing

    with progress("frames", "frames") as move:
        bank, count = add_missing(root, out, move)
    said = f"{counted(count, 'picture')} added" if count else f"{root} lacks none of its control pictures"
    say(f"{said}; {counted(len(bank), 'frame')} in {bank.root}, fingerprint {bank.manifest.fingerprint[:16]}")


@dataclass(frozen=True)
class SourceDescription:
    """The description of a bank's pictures; `FORMATS` says which options a format takes."""

    table: Annotated[Path | None, typer.Option(help="CSV, JSON lines or Parquet, one row per picture.")] = None
    map_: Annotated[
        list[str] | None,
        typer.Option("--map", help="PLACE=COLUMN; places: file, gap, episode, step, scenario, mirror; lead_near, …."),
    ] = None
    mirror: Annotated[str, typer.Option(help="vertical (seen from above), horizontal (forward camera) or none.")] = (
        "none"
    )
    actions: Annotated[Path | None, typer.Option(help="TOML file of the action space; default: the driving one.")] = (
        None
    )
    threshold: Annotated[float | None, typer.Option(help="A gap below this is near.")] = None
    unit: Annotated[str | None, typer.Option(help="Unit of the gap.")] = None
    picture: Annotated[str, typer.Option(help="A short description of the pictures.")] = "pictures of a camera"
    prompt_columns: Annotated[str, typer.Option(help="Columns that prompts may mention, with commas.")] = ""
    strata: Annotated[
        str, typer.Option(help="Columns, besides the scenario, by which results may be split, with commas.")
    ] = ""
    independent: Annotated[
        bool, typer.Option("--independent", help="Declare that the frames are independent draws.")
    ] = False
    format_: Annotated[
        str, typer.Option("--format", help=f"{' or '.join(FORMATS)}; default: recognised from the folder.")
    ] = "table"
    camera: Annotated[str | None, typer.Option(help=f"Camera of {takers('camera')}.")] = None
    rig: Annotated[
        Path | None,
        typer.Option(help="TOML file of several cameras: column and mirror axis of each; state, motion, reflection."),
    ] = None
    horizon: Annotated[
        int | None,
        typer.Option(min=1, help=f"For {takers('ahead')}: make a bank for policies that answer with this many steps."),
    ] = None
    kind: Annotated[
        str | None,
        typer.Option(
            help="With --horizon: the actions are delta, absolute, velocity or waypoints; default: recognised from "
            "the data."
        ),
    ] = None
    state: Annotated[str, typer.Option(help="With --horizon: the features of the state, with commas.")] = ""
    action: Annotated[str, typer.Option(help="With --horizon: the features of the action, with commas.")] = ""
    rate: Annotated[
        float | None, typer.Option(help=f"For {takers('rate')}: frames a second, if the files do not have it.")
    ] = None
    rotation: Annotated[
        list[str] | None,
        typer.Option(
            help="With --horizon: numbers that are a rotation, as action[3:7]=quat_xyzw; also quat_wxyz, axis_angle, "
            "rot6d (first column, then second), euler_xyz (fixed axes; XYZ turns with them; _deg: degrees), or none."
        ),
    ] = None
    every: Annotated[int, typer.Option(min=1, help="Take every Nth frame of an episode.")] = 1
    history: Annotated[
        int,
        typer.Option(
            min=0,
            help="Instants to keep before each frame, for prompts and policies that see several: rows, a step apart.",
        ),
    ] = 0
    convert: Annotated[
        bool, typer.Option("--convert", help="Convert pictures to upright 8-bit RGB; without it, others are refused.")
    ] = False
    background: Annotated[
        str | None,
        typer.Option(help="With --convert: the colour behind transparent pixels, white or #rrggbb; default: white."),
    ] = None
    longest: Annotated[
        int | None, typer.Option(min=1, help="With --convert: at most this many pixels on the longer side.")
    ] = None
    keep_repeats: Annotated[
        bool,
        typer.Option("--keep-repeats", help="Import a recording twice if it is there under two names."),
    ] = False
    no_lead: Annotated[
        str | None,
        typer.Option(help="Numbers or words that mean 'nothing ahead' in the gap, as -1,inf,999; empty: none."),
    ] = None
    numbers: Annotated[
        str, typer.Option(help="How numbers are written: 1234.5 or 1234,5 or 1.234,5 or '1 234,5' or 1,234.5.")
    ] = ""
    made: Annotated[
        str,
        typer.Option(
            help="How the control pictures were made: rendered, staged or edited; default: as edit.json says."
        ),
    ] = ""
    strip: Annotated[
        str, typer.Option(help="The first part of the pictures' paths, if they come from another machine.")
    ] = ""

    def choices(self) -> "Choices":
        """Return the options that every format takes, with the faults found in them."""
        from eyechart.errors import finite_number
        from eyechart.frames import read_made
        from eyechart.importing.bank import Choices
        from eyechart.importing.columns import axis_named, read_places, read_rig
        from eyechart.importing.faults import Faults
        from eyechart.spaces.discrete import DRIVING, read_space

        wrong, space, near = Faults(), DRIVING, self.threshold
        axis = axis_named(self.mirror, wrong)
        if self.rig is not None and self.mirror != "none":
            wrong.add("--rig gives the mirror axis of each camera: leave out --mirror")
        with wrong.noted():
            space = DRIVING if self.actions is None else read_space(self.actions)
        with wrong.noted():
            near = None if self.threshold is None else 0.0
            near = None if self.threshold is None else finite_number("--threshold", self.threshold)
        made: Provenance = ""
        numerals = _numerals(self.numbers, self.no_lead, wrong)
        with wrong.noted():
            made = read_made(self.made)
        return Choices(
            columns=read_places(self.map_ or []),
            mirror=axis,
            rig=None if self.rig is None else read_rig(self.rig, of_table=self.table is not None),
            space=space,
            threshold=near,
            unit=self.unit,
            picture=self.picture,
            prompt_columns=filled(self.prompt_columns),
            strata=filled(self.strata),
            independent=self.independent,
            every=self.every,
            history=self.history,
            convert=_convert(self.background, self.longest, is_wanted=self.convert),
            keep_repeats=self.keep_repeats,
            numerals=numerals,
            strip=self.strip,
            made=made,
            wrong=wrong.lines,
        )

    def format_of(self, folder: Path, *, named: bool) -> Format:
        """Return the ``named`` or the folder's format; raises SpecError for options it lacks."""
        ahead = (self.horizon, self.kind, self.state, self.action, self.rotation or None) != (None, None, "", "", None)
        used = {"table": self.table is not None, "convert": self.convert, "ahead": ahead, "camera": self.camera}
        used["rate"] = self.rate is not None
        return find_format(self.format_ if named else None, folder, [name for name, given in used.items() if given])

    def own(self) -> dict[str, object]:
        """Return the options that only some formats take."""
        return {"table": self.table, "camera": self.camera, "ahead": self._ahead(), "rate": self.rate}

    def _ahead(self) -> "Horizon | None":
        """Return what makes a data set's bank for policies; None without a horizon."""
        from eyechart.importing import Horizon
        from eyechart.spaces.motion import read_kind

        named = {"--kind": self.kind, "--state": self.state, "--action": self.action, "--rotation": self.rotation}
        if self.horizon is None and (given := [name for name, value in named.items() if value]):
            raise SpecError(f"{given[0]} describes the motions of --horizon: give --horizon too")
        if self.horizon is None:
            return None
        rotations = tuple(self.rotation or ())
        return Horizon(self.horizon, read_kind(self.kind), filled(self.state), filled(self.action), rotations)


_UNDESCRIBED = SourceDescription()


@app.command(
    "import",
    epilog="Example: eyechart frames import photos --table photos.csv --map gap=lidar_m --map episode=drive "
    "--threshold 18 --unit m --mirror horizontal --actions rover.toml --picture 'forward camera of our rover' "
    "--out bank\n\nExample of a robot data set: eyechart frames import pusht --format lerobot --every 10 --out bank\n\n"
    "Example for a policy: eyechart frames import so100 --format lerobot --horizon 50 --every 30 --out bank",
)
@expanded
def import_(
    ctx: typer.Context,
    folder: Annotated[
        Path, typer.Argument(help=f"Folder of {', or of '.join(one.folder for one in FORMATS.values())}.")
    ],
    out: Annotated[Path, typer.Option(help="Folder of the new bank.")],
    described: SourceDescription = _UNDESCRIBED,
) -> None:
    """Make a bank of your own pictures.

    It lists all faults at once, and says which tests need columns that are missing.
    """
    from eyechart.importing.costs import costs, taken

    named = str(ctx.get_parameter_source("format_")).endswith("COMMANDLINE")
    choices, source, own = described.choices(), described.format_of(folder, named=named), described.own()
    options = {name: own[name] for name in source.options if name in own}
    with progress("import", "rows and frames") as move:
        bank = source.importer()(folder, out=out, choices=choices, reads=move, progress=move, **options)
    say(f"{counted(len(bank), 'frame')} in {out}, fingerprint {bank.manifest.fingerprint[:16]}")
    say(*taken(bank), *costs(bank))


app.command(epilog=edits.EPILOG)(edits.edit)


@app.command(epilog="Example: eyechart frames declare bank run --made staged")
def declare(
    folders: Annotated[list[Path], typer.Argument(help="Folders of banks, and of runs, which keep their bank's text.")],
    made: Annotated[str, typer.Option(help="rendered (drawn by a program), staged (things were moved) or edited.")],
) -> None:
    """Declare how a bank's control pictures were made, in place.

    A gate asks for it. No picture, fingerprint or answer changes, so runs on the bank stay valid.
    Each run keeps what its bank said when it was made: name the runs too. All folders are checked
    before the first is declared.
    """
    from eyechart.frames import declare as declared
    from eyechart.frames import may_declare, read_made
    from eyechart.manifest import BANK, alone_in, is_run

    word = read_made(made)
    if not word:
        raise SpecError("--made takes rendered, staged or edited")
    runs = {folder for folder in folders if is_run(folder)}
    for folder in folders:
        may_declare(folder / BANK if folder in runs else folder, word)
    for folder in folders:
        with alone_in(folder) if folder in runs else nullcontext():
            before = declared(folder / BANK if folder in runs else folder, word)
        say(f"{folder}: its control pictures are {word}; before: {before or 'not said'}")
    if not any(map(is_run, folders)):
        say("runs that were made on it keep what it said before: name their folders too")


@app.command(epilog="Example: eyechart frames check bank")
def check(
    bank: Annotated[Path, typer.Argument(help="Folder of the bank.")],
    other: Annotated[Path | None, typer.Argument(help="Folder of another bank, to compare the frames of both.")] = None,
    json: Json = False,
) -> None:
    """Recompute a bank's fingerprint and picture hashes, and name what differs.

    With OTHER it also compares frames of one name: they must be the same moments. It compares
    ground truth to 3 decimals, not pixels, because other library versions draw differently. For a
    bank of policies it lists the channels that cannot be exchanged, such as a camera with equal
    pictures, and what looks wrong in the log. Exit 0: as recorded; 1: something differs.
    """
    from eyechart.conditions import by_reason
    from eyechart.frames import check as check_bank
    from eyechart.frames import open_unchecked, shared_frames

    problems = [problem for each in filter(None, (bank, other)) for problem in check_bank(each)]
    undrawn, unshown, noted = ({}, {}, []) if problems else _lacking(bank)
    both = None if other is None else shared_frames(open_unchecked(bank), open_unchecked(other))
    unlike = both is not None and bool(both.unlike or not both.frames)
    if json:
        lacks: dict[str, object] = {"undrawn": undrawn, "unshown": unshown, "notes": noted}
        more = {name: one for name, one in lacks.items() if one}
        more |= {} if both is None else {"other": str(other), "geometry": both.as_dict()}
        print_json({"bank": str(bank), "ok": not problems and not unlike, "problems": problems, **more})
    else:
        lacking = [f"{name}: {count} frames lack it; it could not be drawn" for name, count in undrawn.items()]
        lacking += [f"not asked of a policy: {names}: {why}" for names, why in by_reason(unshown).items()]
        lacking += noted
        fine = [f"{each} matches its manifest" for each in filter(None, (bank, other))]
        say(*([f"eyechart: {problem}" for problem in problems] or [*fine, *lacking]))
        say(*(() if both is None else both.lines()))
    if problems or unlike:
        raise typer.Exit(1)


def _lacking(folder: Path) -> tuple[dict[str, int], dict[str, str], list[str]]:
    """Return the controls that a bank lacks, the channels that cannot be tested, and its notes."""
    from eyechart.conditions import undrawn_controls
    from eyechart.conditions.policies import unshown_channels
    from eyechart.frames import open_bank
    from eyechart.importing.log_warnings import notes

    bank = open_bank(folder)
    return undrawn_controls(bank), {} if bank.manifest.motion is None else unshown_channels(bank), notes(bank)


@app.command(
    epilog="Example: eyechart frames show bank --out sheet.png\n\n"
    "Example: eyechart frames show bank light-0-03 --view --out view.png"
)
def show(
    bank: Annotated[Path, typer.Argument(help="Folder of the bank.")],
    frame: Annotated[str | None, typer.Argument(help="Id of a frame, to write only its picture.")] = None,
    *,
    out: Annotated[Path, typer.Option(help="PNG file to write.")],
    view: Annotated[
        bool, typer.Option("--view", help="Show the frame in the calibrated view that estimators see.")
    ] = False,
    mirrored: Annotated[bool, typer.Option("--mirrored", help="Show the frame's reflection.")] = False,
    counterfactual: Annotated[str | None, typer.Option(help="lead_near, lead_far, recoloured, or a control.")] = None,
    limit: Annotated[int | None, typer.Option(help="At most this many frames, spread over the episodes.")] = None,
) -> None:
    """Write a contact sheet with one row per episode, or the pictures of one FRAME.

    Each picture has its gap and demand. Several cameras stand side by side. A frame for policies
    has its instruction, state and motion above it.
    """
    from dataclasses import replace

    from eyechart.frames import open_bank
    from eyechart.report.contact_sheet import contact_sheet, write_frame
    from eyechart.run import spread

    opened = open_bank(bank)
    if frame is not None:
        write_frame(opened, opened.frame(frame), out, counterfactual=counterfactual, view=view, mirrored=mirrored)
    elif view or mirrored:
        raise SpecError(
            "--view and --mirrored are for one frame: give its id, as 'eyechart frames show BANK FRAME --out FILE.png'"
        )
    else:
        opened = replace(opened, frames=spread(opened.frames, limit))
        contact_sheet(opened, out, counterfactual=counterfactual)
    lacking = sum(counterfactual not in (None, *one.counterfactuals) for one in opened) if frame is None else 0
    say(f"wrote {out}{f'; {lacking} of {len(opened)} frames have no {counterfactual}' if lacking else ''}")


def plan(
    bank: Annotated[Path, typer.Argument(help="Folder of the bank.")],
    model: Model = None,
    noise: Annotated[
        float,
        typer.Option(min=0.0, max=1.0, help="The noise floor to plan for: the share of repeats with another answer."),
    ] = 0.11,
    json: Json = False,
) -> None:
    """Print what a bank can decide, with which power, and what the calls cost, before any call.

    For a bank that defines a motion, it prints what the bank can decide about a policy.
    Example: eyechart plan bank --model scripted:depth
    """
    from eyechart.cli.terminal import print_each
    from eyechart.frames import open_bank
    from eyechart.models import open_model
    from eyechart.studies.battery.power import power_of

    opened = open_bank(bank)
    if opened.manifest.motion is not None and not model:
        from eyechart.calibrate.reach import PolicyReach

        reach = PolicyReach.of(opened)
        print_json(reach.as_dict()) if json else print_each([reach.power.table(), reach.details()])
        return
    specs = list(dict.fromkeys(model or ()))
    for spec in specs:
        open_model(spec)
    found = power_of(opened, noise=noise)
    if json:
        print_json({**found.as_dict(), "models": {spec: found.of_model(spec) for spec in specs}})
        return
    print_each([found.table(), found.odds.table(), found.details(specs)], 160)


def _numerals(style: str, no_lead: str | None, wrong: "Faults") -> "Numerals":
    """Return how a table's numbers are written; an unknown way is a fault."""
    from eyechart.importing.numerals import Numerals

    marks = None if no_lead is None else filled(no_lead)
    with wrong.noted():
        return Numerals(style, marks)
    return Numerals("", marks)


def _convert(background: str | None, longest: int | None, *, is_wanted: bool) -> "Convert | None":
    """Return how pictures are converted; None without --convert."""
    from eyechart.importing import Convert

    if not is_wanted and (background, longest) != (None, None):
        raise SpecError("--background and --longest need --convert: give --convert too")
    return Convert(background or "white", longest) if is_wanted else None


def _seeds(text: str) -> tuple[int, ...]:
    try:
        seeds = tuple(int(part) for part in text.split(","))
    except ValueError as error:
        raise SpecError(f"--seeds takes whole numbers with commas, for example 0,1,2; got '{text}'") from error
    if len(set(seeds)) != len(seeds) or min(seeds) < 0:
        raise SpecError(f"--seeds takes different numbers of 0 or more; got '{text}'")
    return seeds
