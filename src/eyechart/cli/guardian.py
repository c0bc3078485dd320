"""``eyechart guardian`` and ``serve``: choose a committee, freeze, score and serve it."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eyechart.cli.options import Json, Reread, expanded
from eyechart.cli.terminal import print_each, print_json, say
from eyechart.errors import BankError, GuardianError, VoteError, raising, suggestion

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eyechart.stats.committee_votes import Costs, Point
    from eyechart.studies.guardian import FrozenGuardian, VoteTable

app = typer.Typer(
    name="guardian",
    help="Choose a committee of models that watches for hazards, freeze it, score it, and export it for a stack.",
    no_args_is_help=True,
)

_Votes = Annotated[
    list[Path],
    typer.Argument(
        help="Folder of a run of scene estimates, or a table of votes; give several if they are on the same frames.",
        metavar="VOTES...",
    ),
]
_Guardian = Annotated[Path, typer.Argument(help="File of a guardian, as 'fit' writes it.", metavar="GUARDIAN")]
_Frames = Annotated[Path | None, typer.Option(help="The bank; its truth and episodes are then used.")]
_Size = Annotated[int, typer.Option(help="Number of models in the committee, 1 to 4.")]
_Models = Annotated[list[str] | None, typer.Option("--model", help="Choose only among these models; repeat it.")]
_UnseenOnly = Annotated[bool, typer.Option("--unseen", help="Leave out the frames that chose the guardian.")]


@dataclass(frozen=True)
class VoteSource:
    """Options that say how votes were made and how their frames are labelled."""

    hazard: Annotated[
        str, typer.Option(help="The bank's column of hazards; without it, a gap below its threshold.")
    ] = "hazard"
    about: Annotated[Path | None, typer.Option(help="FILE.toml: bank, prompt, view and the models' versions.")] = None
    columns: Annotated[
        list[str] | None, typer.Option("--map", help="ROLE=COLUMN for frame, episode, hazard, split.")
    ] = None
    reread: Reread = False

    def read(self, votes: "Sequence[Path]", frames: Path | None) -> "VoteTable":
        """Read the votes of runs and tables as one table; ``frames`` is their bank."""
        from eyechart.studies.guardian import join

        return join([self._read(vote, frames) for vote in votes])

    def _read(self, votes: Path, frames: Path | None) -> "VoteTable":
        from eyechart.frames import open_bank
        from eyechart.studies.guardian import read_votes, votes_of_run

        if not votes.exists():
            raise VoteError(f"{votes} does not exist: give the folder of a run of scene estimates, or a table of votes")
        bank = None if frames is None else open_bank(frames)
        if votes.is_dir():
            if self.about is not None or self.columns:
                raise VoteError(
                    f"{votes} is a run and already records how its votes were made: leave out --about and --map"
                )
            _require_run(votes)
            table = votes_of_run(votes, hazard=self.hazard, reread=self.reread)
            if bank is not None and bank.manifest.fingerprint != table.about.bank:
                raise VoteError(
                    f"{votes} is a run on the bank {table.about.bank_name}, and {frames} is another one: the "
                    "bank differs; give that run's bank to --frames, or leave that out"
                )
            return table
        named = {}
        for one in self.columns or ():
            role, sign, column = one.partition("=")
            if not sign or not column:
                raise VoteError(f"--map is given as ROLE=COLUMN; got '{one[:40]}'")
            named[role] = column
        return read_votes(votes, bank=bank, about=self.about, columns=named, hazard=self.hazard)


@dataclass(frozen=True)
class CostOptions:
    """Costs of a wrong answer and of an abstention, in any unit."""

    cost_miss: Annotated[float | None, typer.Option(help="Cost of a missed hazard; needs the cost below.")] = None
    cost_false_alarm: Annotated[float | None, typer.Option(help="Cost of a false alarm; needs --cost-miss.")] = None
    cost_abstain: Annotated[
        float | None, typer.Option(help="Cost of an abstention; the operating point is then chosen too.")
    ] = None
    hazard_rate: Annotated[
        float | None, typer.Option(help="Share of hazardous frames in use; default: as in VOTES.")
    ] = None

    def made(self) -> "Costs | None":
        """Return the costs, or None; raises GuardianError if some are missing."""
        from eyechart.stats.committee_votes import Costs

        if (self.cost_miss, self.cost_false_alarm, self.cost_abstain, self.hazard_rate) == (None,) * 4:
            return None
        if self.cost_miss is None or self.cost_false_alarm is None:
            raise GuardianError("give both --cost-miss and --cost-false-alarm")
        try:
            return Costs(self.cost_miss, self.cost_false_alarm, self.cost_abstain, self.hazard_rate)
        except ValueError as error:
            raise GuardianError(str(error)) from error


AS_TOLD, NO_COSTS = VoteSource(), CostOptions()


@app.command()
@expanded
def fit(
    votes: _Votes,
    out: Annotated[Path, typer.Option(help="File to write, guardian.json.")],
    calibration: Annotated[Path | None, typer.Option(help="Text file of frame ids, one a line.")] = None,
    frames: _Frames = None,
    how: VoteSource = AS_TOLD,
    size: _Size = 2,
    models: _Models = None,
    point: Annotated[str | None, typer.Option(help="two_way (default), abstain or unanimous.")] = None,
    costing: CostOptions = NO_COSTS,
    json: Json = False,
) -> None:
    """Choose committee and threshold on calibration frames alone, and freeze them.

    These are the rows whose column split is calibration, or the frames of --calibration, or else
    all rows. In a tie, a committee in which every model votes hazard somewhere wins. Then the first
    in lexicographic order wins, then the lowest threshold. Example: eyechart guardian fit votes.csv
    --out guardian.json
    """
    from eyechart.destination import require_free, whole
    from eyechart.guardian.members import members_of
    from eyechart.guardian.page import choice_lines
    from eyechart.studies import guardian as study

    require_free(out, "guardian")
    table = how.read(votes, frames)
    table = table.keep(_ids_of(calibration)) if calibration is not None else _part(table, "calibration")
    frozen = study.fit(table, size=size, models=tuple(models or ()), point=_point(point), costs=costing.made())
    study.require_own(out, frozen)
    with whole(out, "guardian") as partial:
        study.write_frozen(partial, frozen)
    members = members_of(frozen.committee, table, votes, reread=how.reread)
    if json:
        print_json({**frozen.as_dict(), "members": [member.as_dict() for member in members]})
    else:
        print_each([*choice_lines(frozen), *(member.words for member in members if not member.is_doubtful)])
    for line in (*table.mute_words(frozen.committee), *(member.words for member in members if member.is_doubtful)):
        say(f"warning: {line}")
    say(f"wrote {out}; it refuses to score the {len(table.frames)} frames that chose it")


@app.command()
@expanded
def score(
    guardian: _Guardian,
    votes: _Votes,
    unseen: _UnseenOnly = False,
    bound: Annotated[Path | None, typer.Option(help="Votes on episodes that are used only for the bound.")] = None,
    bound_episodes: Annotated[
        str | None, typer.Option(help="Episodes of VOTES that are used only for the bound, with commas.")
    ] = None,
    confidence: Annotated[float, typer.Option(help="Confidence of each bound.")] = 0.95,
    risk: Annotated[float, typer.Option(help="Risk level for conformal risk control.")] = 0.05,
    html: Annotated[
        Path | None, typer.Option(help="Write a page with votes, curve and, with --frames, the missed hazards.")
    ] = None,
    frames: _Frames = None,
    how: VoteSource = AS_TOLD,
    json: Json = False,
) -> None:
    """Score a guardian on frames that it never saw, and bound its miss rate.

    It refuses frames that chose the guardian, and votes from another bank, prompt, view or model
    version. Rows whose column split is bound give the bound. Example: eyechart guardian score
    guardian.json votes.csv --unseen --json
    """
    from dataclasses import replace

    from eyechart.destination import require_free
    from eyechart.frames import open_bank
    from eyechart.guardian.members import members_of
    from eyechart.guardian.page import guardian_page, guardian_table, score_lines
    from eyechart.report.page import write_page
    from eyechart.studies import guardian as study

    if html is not None:
        require_free(html, "report")
    frozen = study.read_frozen(guardian)
    table, left, words = _left(how.read(votes, frames), frozen, unseen=unseen)
    table, fresh = _parted(table, bound_episodes, None if bound is None else how.read([bound], frames))
    bounded = None
    if fresh is not None:
        bounded = study.bound(frozen, fresh, scored=table, confidence=confidence, risk=risk)
    found = replace(study.score(frozen, table), bound=bounded)
    say(*words)
    members = members_of(frozen.committee, table, votes, reread=how.reread)
    found = replace(found, warnings=(*found.warnings, *(member.words for member in members if member.is_doubtful)))
    if html is not None:
        bank = None if frames is None else open_bank(frames)
        if bank is not None:
            frozen.may_show(bank)
        write_page(guardian_page(found, bank), html)
        say(f"wrote {html}, {html.stat().st_size / 1e6:.1f} MB")
    if json:
        print_json({**found.as_dict(), **left, "members": [member.as_dict() for member in members]})
        return
    named = f"{len(table.frames)} frames of {len(set(table.episodes))} episodes, bank {frozen.about.bank_name or '—'}"
    sound = (member.words for member in members if not member.is_doubtful)
    print_each([named, guardian_table(found), *score_lines(found), *sound])
    for line in found.warnings:
        say(f"warning: {line}")


@app.command()
@expanded
def nested(
    votes: _Votes,
    frames: _Frames = None,
    how: VoteSource = AS_TOLD,
    size: _Size = 2,
    models: _Models = None,
    costing: CostOptions = NO_COSTS,
    json: Json = False,
) -> None:
    """Judge every episode by a guardian chosen on all other episodes.

    Rows whose column split is bound are left out. Example: eyechart guardian nested votes.csv
    --size 2
    """
    from eyechart.guardian.page import nested_lines, nested_table
    from eyechart.studies import guardian as study

    table = how.read(votes, frames)
    if table.split is not None and "bound" in table.split:
        left_out = len(table.part("bound").frames)
        table = table.part("calibration", "score")
        say(f"left out: {left_out} frames whose column split is bound; they are used only for the bound")
    found = study.nested(table, size=size, models=tuple(models or ()), costs=costing.made())
    print_json(found.as_dict()) if json else print_each([nested_table(found), *nested_lines(found)])


@app.command()
@expanded
def modular(
    guardian: _Guardian,
    votes: _Votes,
    frames: Annotated[Path, typer.Option(help="The bank, with its pictures.")],
    unseen: _UnseenOnly = False,
    how: VoteSource = AS_TOLD,
    json: Json = False,
) -> None:
    """Replay a guardian that brakes, while a deterministic picture reader handles the rest.

    That reader decides on collisions and sides. It prints the agreement with the renderer policy,
    the most that a perfect guardian reaches, and whether each frame's reflection gets the reflected
    action.
    Example: eyechart guardian modular guardian.json votes.csv --frames bank --unseen
    """
    from eyechart.frames import open_bank
    from eyechart.guardian.page import replay_lines
    from eyechart.studies import guardian as study

    frozen = study.read_frozen(guardian)
    table, left, words = _left(how.read(votes, frames), frozen, unseen=unseen)
    table = _part(table, "score")
    bank = open_bank(frames)
    frozen.may_show(bank)
    found = study.replay(frozen, table, study.reader_of(bank))
    say(*words)
    if json:
        print_json({**found.as_dict(), **left})
        return
    print_each(replay_lines(found))
    for line in found.warnings:
        say(f"warning: {line}")


@app.command()
def export(
    guardian: _Guardian,
    out: Annotated[Path, typer.Option(help="File to write.")],
    json: Json = False,
) -> None:
    """Write only what a stack needs of a guardian, without its frames and scores.

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


def serve(
    guardian: Annotated[Path, typer.Argument(help="File of a guardian, exported or not.", metavar="GUARDIAN")],
    host: Annotated[str, typer.Option(help="Address to listen on; there is no password.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="Port; 0 takes a free one.", min=0, max=65535)] = 8600,
    deadline: Annotated[float, typer.Option(help="Seconds from a request's head to its answer.")] = 2.0,
    concurrency: Annotated[int, typer.Option(help="Concurrent pictures.", min=1, max=64)] = 8,
    queue: Annotated[int, typer.Option(help="Most pictures that wait; further ones get status 503.", min=0)] = 32,
    max_bytes: Annotated[int, typer.Option(help="Most bytes of a picture.", min=1)] = 4_000_000,
    max_pixels: Annotated[
        int,
        typer.Option(
            help="Most pixels of a picture, width × height in its header; a larger one is not decoded.", min=1
        ),
    ] = 2_100_000,
    allow_host: Annotated[
        list[str] | None,
        typer.Option(help="A further host name for requests, beside this machine's own on loopback; repeat it."),
    ] = None,
    no_warm_up: Annotated[
        bool,
        typer.Option(
            "--no-warm-up", help="Do not first ask each model about a blank picture, which takes at most 60 s."
        ),
    ] = False,
    mode: Annotated[
        list[Path] | None,
        typer.Option(help="FILE.toml: another address, key or header for the model that it names."),
    ] = None,
) -> None:
    """Serve a guardian: POST a picture to /assess.

    It also serves /health, /metrics (Prometheus) and /openapi.json.
    Example: eyechart serve guardian.json, then curl --data-binary @frame.png -H 'Content-Type:
    image/png' http://127.0.0.1:8600/assess
    """
    import asyncio

    from eyechart.guardian import Guardian
    from eyechart.modes import read_mode
    from eyechart.serve.lifecycle import serve as run
    from eyechart.serve.server import ServerLimits

    modes = {one.spec: one for one in map(read_mode, mode or ())}
    limits = ServerLimits(
        concurrency=concurrency,
        queue=queue,
        most_bytes=max_bytes,
        most_pixels=max_pixels,
        hosts=tuple(allow_host or ()),
    )
    with Guardian.load(guardian, deadline_s=deadline, modes=modes) as loaded:
        served = run(
            loaded,
            host=host,
            port=port,
            limits=limits,
            warm_up_s=0.0 if no_warm_up else 60.0,
            tell=say,
            started=lambda url: say(f"{guardian} at {url}"),
        )
        asyncio.run(served)
    say("stopped")


def _require_run(folder: Path) -> None:
    """Raise VoteError if a folder is no run; for a bank, say what to do."""
    from eyechart.frames import open_bank
    from eyechart.manifest import is_run

    if is_run(folder):
        return
    try:
        open_bank(folder)
    except BankError:
        return  # the reader of the run reports the error
    asked = "admission", "structured"
    ways = " or ".join(f"'eyechart run {one} --model SPEC --frames {folder} --out RUN'" for one in asked)
    raise VoteError(f"{folder} is a bank, which holds no votes: ask models with {ways}, and give that run's folder")


def _ids_of(path: Path) -> list[str]:
    """Read ids of frames, one a line."""
    with raising(VoteError, f"{path} is no list of frame ids, one a line", of=(OSError, ValueError)):
        return [line.strip() for line in path.read_text(encoding="utf-8-sig").splitlines() if line.strip()]


def _left(
    table: "VoteTable", frozen: "FrozenGuardian", *, unseen: bool
) -> "tuple[VoteTable, dict[str, object], list[str]]":
    """Return the frames of a table that a guardian may be scored on.

    Also return how many frames were left out for each reason, as numbers and in words. Without
    ``unseen`` nothing is left out.
    """
    if not unseen:
        return table, {}, []
    kept, left = frozen.unseen(table), frozen.left_out(table)
    if table.frames and not kept.frames:
        raise GuardianError(
            f"all {len(table.frames)} frames of {table.name} chose this guardian, so none is left to score: "
            "give votes on other frames, as 'eyechart run structured' makes them"
        )
    why = ", ".join(f"{count} {words}" for words, count in left.items())
    words = f"{sum(left.values())} of {len(table.frames)} frames are left out{why and f': {why}'}"
    return kept, {"left_out": left}, [words]


def _parted(
    table: "VoteTable", bound_episodes: str | None, other: "VoteTable | None"
) -> "tuple[VoteTable, VoteTable | None]":
    """Return the votes to score, and those for the bound: a table, some episodes, or a split."""
    if other is not None:
        return _part(table, "score"), _part(other, "bound")
    if bound_episodes is not None:
        fresh = table.of_episodes([name.strip() for name in bound_episodes.split(",") if name.strip()])
        return _part(table.without(fresh.frames), "score"), fresh
    bound = table.part("bound") if table.split is not None and "bound" in table.split else None
    return _part(table, "score"), bound


def _part(table: "VoteTable", name: str) -> "VoteTable":
    """Return the rows of a part by the column ``split``, or all rows without that column."""
    return table if table.split is None else table.part(name)


def _point(name: str | None) -> "Point | None":
    from eyechart.stats.committee_votes import POINTS

    if name is not None and name not in POINTS:
        raise GuardianError(f"--point is one of {', '.join(POINTS)}, not '{name}'{suggestion(name, POINTS)}")
    return next((point for point in POINTS if point == name), None)
