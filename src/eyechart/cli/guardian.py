"""``eyechart guardian`` and ``serve``: choose a committee, freeze, score and serve it."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from eyechart.cli.options import Json, Reread, expanded, filled
from eyechart.cli.terminal import print_each, print_json, say
from eyechart.errors import GuardianError, VoteError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eyechart.stats.committee_votes import Costs
    from eyechart.studies.guardian import VoteTable

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
        from eyechart.frames import open_bank
        from eyechart.studies.guardian import join, votes_from

        bank, columns = None if frames is None else open_bank(frames), dict[str, str]()
        for one in self.columns or ():
            role, sign, column = one.partition("=")
            if not sign or not column:
                raise VoteError(f"--map is given as ROLE=COLUMN; got '{one[:40]}'")
            columns[role] = column
        how: Any = {"about": self.about, "hazard": self.hazard, "reread": self.reread}
        return join([votes_from(one, bank=bank, columns=columns, **how) for one in votes])


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
    table = table.keep(study.read_ids(calibration)) if calibration is not None else table.for_use("calibration")
    chosen = study.read_point(point)
    frozen = study.fit(table, size=size, models=tuple(models or ()), point=chosen, costs=costing.made())
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
    table, left, words = frozen.scorable(how.read(votes, frames), unseen=unseen)
    if bound is None:
        table, fresh = table.parted(None if bound_episodes is None else filled(bound_episodes))
    else:
        table, fresh = table.for_use("score"), how.read([bound], frames).for_use("bound")
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
    table, left, words = frozen.scorable(how.read(votes, frames), unseen=unseen)
    table = table.for_use("score")
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
