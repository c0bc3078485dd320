"""``eyechart guardian`` chooses a committee that watches for hazards, freezes it, and scores it on unseen frames."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eyechart.cli import voting
from eyechart.cli.options import Json
from eyechart.cli.terminal import print_json, say, table_console

if TYPE_CHECKING:
    from collections.abc import Iterable

    from eyechart.stats.committee import Costs, Point
    from eyechart.studies.guardian import GuardianScore

app = typer.Typer(
    name="guardian",
    help="Choose a committee of models that watches for hazards, freeze it, score it, and take it to a stack.",
    no_args_is_help=True,
)

_Votes = Annotated[
    list[Path],
    typer.Argument(
        help="Folder of a run of scene estimates, or a table; of several on the same frames, more.", metavar="VOTES..."
    ),
]
_Guardian = Annotated[Path, typer.Argument(help="File of a guardian, as 'fit' writes it.", metavar="GUARDIAN")]
_Frames = Annotated[Path | None, typer.Option(help="The bank; truth and episodes are then its own.")]
_Hazard = Annotated[str, typer.Option(help="The bank's column of hazards; without it, a gap below its threshold.")]
_About = Annotated[Path | None, typer.Option(help="FILE.toml: bank, prompt, view and the models' versions.")]
_Map = Annotated[list[str] | None, typer.Option("--map", help="ROLE=COLUMN for frame, episode, hazard, split.")]
_Reread = Annotated[
    bool, typer.Option("--reread", help="Read the replies of a run anew that another version of the reader read.")
]
_Size = Annotated[int, typer.Option(help="Models of the committee, 1 to 4.")]
_Models = Annotated[list[str] | None, typer.Option("--model", help="Choose among these only; repeat it.")]
_Miss = Annotated[float | None, typer.Option(help="Cost of a missed hazard; with --cost-false-alarm.")]
_Alarm = Annotated[float | None, typer.Option(help="Cost of a false alarm; with --cost-miss.")]
_Abstain = Annotated[float | None, typer.Option(help="Cost of no answer: the operating point is then chosen too.")]
_Rate = Annotated[float | None, typer.Option(help="How often frames are hazardous in use; default: as in VOTES.")]
_Unseen = Annotated[bool, typer.Option("--unseen", help="Leave out the frames that chose the guardian.")]


@app.command()
def fit(
    votes: _Votes,
    out: Annotated[Path, typer.Option(help="File to write, guardian.json.")],
    calibration: Annotated[Path | None, typer.Option(help="Text file of frame ids, one a line.")] = None,
    frames: _Frames = None,
    hazard: _Hazard = "hazard",
    about: _About = None,
    columns: _Map = None,
    reread: _Reread = False,
    size: _Size = 2,
    models: _Models = None,
    point: Annotated[str | None, typer.Option(help="two_way (default), abstain or unanimous.")] = None,
    cost_miss: _Miss = None,
    cost_false_alarm: _Alarm = None,
    cost_abstain: _Abstain = None,
    hazard_rate: _Rate = None,
    json: Json = False,
) -> None:
    """Choose committee and threshold on calibration frames alone, and freeze them.

    These are the rows whose column split is calibration, or the frames of --calibration, or else all rows. Ties go to
    the first committee in lexicographic order, then to the lowest threshold. Example: eyechart guardian fit votes.csv
    --out guardian.json
    """
    from eyechart.destination import require_free, whole
    from eyechart.report.guardian import choice_lines
    from eyechart.report.members import members_of
    from eyechart.studies import guardian as study

    require_free(out, "guardian")
    table = voting.read(votes, frames, hazard, about, columns, reread=reread)
    table = table.keep(voting.ids_of(calibration)) if calibration is not None else voting.part(table, "calibration")
    costs = _costs(cost_miss, cost_false_alarm, cost_abstain, hazard_rate)
    frozen = study.fit(table, size=size, models=tuple(models or ()), point=_point(point), costs=costs)
    study.require_own(out, frozen)
    with whole(out, "guardian") as partial:
        study.write_frozen(partial, frozen)
    members = members_of(frozen.committee, table, votes, reread=reread)
    if json:
        print_json({**frozen.as_dict(), "members": [one.as_dict() for one in members]})
    else:
        _print(choice_lines(frozen))
        _print(one.words for one in members if not one.doubtful)
    for one in members:
        if one.doubtful:
            say(f"warning: {one.words}")
    say(f"wrote {out}; it refuses to score the {len(table.frames)} frames that chose it")


@app.command()
def score(
    guardian: _Guardian,
    votes: _Votes,
    unseen: _Unseen = False,
    bound: Annotated[Path | None, typer.Option(help="Votes on episodes that serve for nothing else.")] = None,
    bound_episodes: Annotated[str | None, typer.Option(help="Such episodes of VOTES, with commas.")] = None,
    confidence: Annotated[float, typer.Option(help="Of each bound.")] = 0.95,
    risk: Annotated[float, typer.Option(help="What conformal risk control is asked for.")] = 0.05,
    html: Annotated[
        Path | None, typer.Option(help="Write a page: votes, curve, and with --frames what it missed.")
    ] = None,
    frames: _Frames = None,
    hazard: _Hazard = "hazard",
    about: _About = None,
    columns: _Map = None,
    reread: _Reread = False,
    json: Json = False,
) -> None:
    """Score a guardian on frames that it never saw, and bound how often it misses.

    Refuses a frame that chose it, and votes of another bank, prompt, view or version of a model. Rows whose column
    split is bound give the bound. Example: eyechart guardian score guardian.json votes.csv --unseen --json
    """
    from dataclasses import replace

    from eyechart.destination import require_free
    from eyechart.report.guardian import guardian_table, score_lines
    from eyechart.report.members import members_of
    from eyechart.studies import guardian as study

    if html is not None:
        require_free(html, "report")
    frozen = study.read_frozen(guardian)
    table = voting.left(voting.read(votes, frames, hazard, about, columns, reread=reread), frozen, unseen=unseen)
    fresh = None
    if bound is not None:
        fresh = voting.part(voting.read([bound], frames, hazard, about, columns, reread=reread), "bound")
    elif bound_episodes is not None:
        names = [name.strip() for name in bound_episodes.split(",") if name.strip()]
        fresh = table.of_episodes(names)
        table = table.without(fresh.frames)
    elif table.split is not None and "bound" in table.split:
        fresh = table.part("bound")
    table = voting.part(table, "score")
    bounded = None
    if fresh is not None:
        bounded = study.bound(frozen, fresh, scored=table, confidence=confidence, risk=risk)
    found = replace(study.score(frozen, table), bound=bounded)
    members = members_of(frozen.committee, table, votes, reread=reread)
    found = replace(found, warnings=(*found.warnings, *(one.words for one in members if one.doubtful)))
    if html is not None:
        _write_page(found, frames, html)
    if json:
        print_json({**found.as_dict(), "members": [one.as_dict() for one in members]})
        return
    _print([f"{len(table.frames)} frames of {len(set(table.episodes))} episodes, bank {frozen.about.bank_name or '—'}"])
    table_console().print(guardian_table(found))
    _print(score_lines(found))
    _print(one.words for one in members if not one.doubtful)
    for line in found.warnings:
        say(f"warning: {line}")


@app.command()
def nested(
    votes: _Votes,
    frames: _Frames = None,
    hazard: _Hazard = "hazard",
    about: _About = None,
    columns: _Map = None,
    reread: _Reread = False,
    size: _Size = 2,
    models: _Models = None,
    cost_miss: _Miss = None,
    cost_false_alarm: _Alarm = None,
    cost_abstain: _Abstain = None,
    hazard_rate: _Rate = None,
    json: Json = False,
) -> None:
    """Judge every episode by a guardian that was chosen on all the others, selection inside every fold.

    Rows whose column split is bound are left out. Example: eyechart guardian nested votes.csv --size 2
    """
    from eyechart.report.guardian import nested_lines, nested_table
    from eyechart.studies import guardian as study

    costs = _costs(cost_miss, cost_false_alarm, cost_abstain, hazard_rate)
    table = voting.read(votes, frames, hazard, about, columns, reread=reread)
    if table.split is not None and "bound" in table.split:
        left_out = len(table.part("bound").frames)
        table = table.part("calibration", "score")
        say(f"left out: {left_out} frames whose column split is bound, which serve for nothing else")
    found = study.nested(table, size=size, models=tuple(models or ()), costs=costs)
    if json:
        print_json(found.as_dict())
        return
    table_console().print(nested_table(found))
    _print(nested_lines(found))


@app.command()
def modular(
    guardian: _Guardian,
    votes: _Votes,
    frames: Annotated[Path, typer.Option(help="The bank, with its pictures.")],
    unseen: _Unseen = False,
    hazard: _Hazard = "hazard",
    about: _About = None,
    columns: _Map = None,
    reread: _Reread = False,
    json: Json = False,
) -> None:
    """Replay a guardian that brakes, while a deterministic reader of the picture keeps collision and sides.

    Prints agreement with the renderer policy and whether the reflection of every frame gets the reflected action.
    Example: eyechart guardian modular guardian.json votes.csv --frames bank --unseen
    """
    from eyechart.frames import open_bank
    from eyechart.report.guardian import replay_lines
    from eyechart.studies import guardian as study

    frozen = study.read_frozen(guardian)
    table = voting.left(voting.read(votes, frames, hazard, about, columns, reread=reread), frozen, unseen=unseen)
    table = voting.part(table, "score")
    bank = open_bank(frames)
    frozen.may_show(bank)
    found = study.replay(frozen, table, study.reader_of(bank))
    if json:
        print_json(found.as_dict())
        return
    _print(replay_lines(found))
    for line in found.warnings:
        say(f"warning: {line}")


@app.command()
def export(
    guardian: _Guardian,
    out: Annotated[Path, typer.Option(help="File to write.")],
    json: Json = False,
) -> None:
    """Write what a stack needs of a guardian, and nothing else: no frame that it saw, no score.

    Example: eyechart guardian export guardian.json --out stack.json
    """
    from eyechart.destination import require_free, whole
    from eyechart.studies import guardian as study

    require_free(out, "guardian")
    small = study.read_frozen(guardian).exported()
    study.require_own(out, small)
    with whole(out, "guardian") as partial:
        study.write_frozen(partial, small)
    if json:
        print_json(small.as_dict())
    say(f"wrote {out}; 'eyechart serve {out}' serves it")


def _write_page(found: "GuardianScore", frames: Path | None, out: Path) -> None:
    from eyechart.frames import open_bank
    from eyechart.report.guardian_page import guardian_page
    from eyechart.report.page import write_page

    bank = None if frames is None else open_bank(frames)
    if bank is not None:
        found.frozen.may_show(bank)
    write_page(guardian_page(found, bank), out)
    say(f"wrote {out}, {out.stat().st_size / 1e6:.1f} MB")


def _costs(miss: float | None, alarm: float | None, abstain: float | None, rate: float | None) -> "Costs | None":
    from eyechart.errors import GuardianError
    from eyechart.stats.committee import Costs

    if miss is None and alarm is None and abstain is None and rate is None:
        return None
    if miss is None or alarm is None:
        raise GuardianError("costs are given with both --cost-miss and --cost-false-alarm")
    try:
        return Costs(miss, alarm, abstain, rate)
    except ValueError as error:
        raise GuardianError(str(error)) from error


def _point(name: str | None) -> "Point | None":
    from eyechart.errors import GuardianError
    from eyechart.stats.committee import POINTS

    if name is not None and name not in POINTS:
        raise GuardianError(f"--point is one of {', '.join(POINTS)}, not '{name}'")
    return next((point for point in POINTS if point == name), None)


def _print(lines: "Iterable[str]") -> None:
    console = table_console()
    for line in lines:
        console.print(line, markup=False)
