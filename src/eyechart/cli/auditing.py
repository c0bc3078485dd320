"""``eyechart ladder``, ``audit`` and ``film``: drivers ranked, told apart by whether they decide, and seen."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eyechart.cli.options import Json
from eyechart.cli.terminal import patience, print_json, progress, resumable, say, table_console

if TYPE_CHECKING:
    from eyechart.studies.closed_loop import ClosedLoopScore

_Against = Annotated[
    str | None, typer.Option(help="The policy that the others are held against; default: the best constant.")
]

DOCS = "docs/reading-drives.md, 'The ladder beside the paper's'"
"""Where it is explained what differs from the paper, and why."""


def ladder(
    out: Annotated[Path, typer.Option(help="Folder of the run; the same one resumes it.")] = Path("ladder"),
    simulator: Annotated[str, typer.Option(help="A name of 'eyechart list simulators'.")] = "highway",
    policy: Annotated[list[str] | None, typer.Option(help="A further policy or model; again for more.")] = None,
    seeds: Annotated[int, typer.Option(min=1, help="So many seeds a scenario, from 0 on.")] = 8,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the run, and so of random's stream.")] = 0,
    processes: Annotated[int, typer.Option(min=1, help="Processes that hold the worlds.")] = 1,
    against: _Against = None,
    json: Json = False,
) -> None:
    """Drive the baselines and print Table t:baselines beside the paper's. Interrupt it at will: it resumes.

    Every constant action, random and the scripted controller in every scenario: in the highway 7 × 4 × 8 episodes.
    Exit 1: episodes are unfinished, or ended in an error. Example: eyechart ladder --out ladder --processes 2
    """
    from eyechart.episodes import Bounds, run
    from eyechart.studies.closed_loop import score
    from eyechart.studies.closed_loop.laddering import plan_ladder

    planned = plan_ladder(out, simulator=simulator, seeds=seeds, further=policy or (), seed=seed)
    say(f"{len(planned.keys)} episodes, {len(planned.keys) - len(planned.left())} driven already")
    if planned.left():
        with resumable(), progress("episodes", "episodes") as move:
            outcome = run(planned, bounds=Bounds(processes=processes), progress=move)
        for spec, why in outcome.set_aside.items():
            say(f"set aside: {spec}: {why}")
    if left := len(planned.left()):
        say(f"{left} episodes are unfinished; the same command goes on")
        raise typer.Exit(1)
    scored = score(out, against_policy=against)
    if json:
        print_json(ladder_dict(scored))
    else:
        print_ladder(scored)
    if failed := sum(one.errors for one in scored.ladder):
        say(f"{failed} episodes ended in an error and count in no number; 'eyechart report {out}' lists them")
        raise typer.Exit(1)


def ladder_dict(scored: "ClosedLoopScore") -> dict[str, object]:
    """Return the ladder's part of a score as plain JSON values, the paper's rows beside it."""
    from eyechart.studies.closed_loop.published import beside_paper

    found = scored.as_dict()
    kept = {name: found[name] for name in ("study", "references", "ladder", "paired", "identical")}
    return {**kept, "beside_paper": [one.as_dict() for one in beside_paper(scored.ladder)]}


def print_ladder(scored: "ClosedLoopScore") -> None:
    """Print the ladder, the paper's beside it, what differs, the paired differences and the identical rows."""
    from eyechart.report.rungs import ladder_table, paired_table, paper_table, paper_words
    from eyechart.studies.closed_loop.published import beside_paper

    console = table_console(160)
    console.print(ladder_table(scored.ladder, scored.references))
    if beside := beside_paper(scored.ladder):
        console.print(paper_table(beside))
        for line in paper_words(beside, scored.ladder):
            console.print(line, markup=False)
        console.print(f"Why, row by row: {DOCS}.", markup=False)
    for name, reference in scored.references.items():
        mine = [one for one in scored.paired if one.first.simulator == name]
        console.print(paired_table(mine, f"{name}: policy less {reference.label}, same worlds; p after Holm"))
    print_twins(scored)


def print_twins(scored: "ClosedLoopScore") -> None:
    """Print which drivers have identical drives, and what repeated requests tell."""
    console = table_console(160)
    for one in scored.twins:
        names = ", ".join(driver.label for driver in one.drivers)
        console.print(f"{one.kind}: {names}: identical in {one.same} of {one.worlds} worlds: {one.words}", markup=False)
    for two in scored.repeats:
        console.print(f"{'suspect caching: ' if two.suspect else ''}{two.driver.label}: {two.words}", markup=False)


def audit(
    runs: Annotated[list[Path], typer.Argument(help="Folders of runs of episodes.", metavar="RUN...")],
    json: Json = False,
) -> None:
    """Tell deciding from varying: Table t:degeneracy, decision-level replay, and drives that are identical.

    Exit 1 where a cache is suspected. Example: eyechart audit run-a run-b --json
    """
    from eyechart.report.rungs import degeneracy_table, degeneracy_words, replay_table
    from eyechart.studies.closed_loop import score

    scored = score(runs)
    if json:
        print_json({"study": "closed_loop", **scored.audit_dict()})
    else:
        console = table_console(160)
        console.print(degeneracy_table(scored.audit))
        for line in degeneracy_words(scored.audit):
            console.print(line, markup=False)
        if scored.replays:
            console.print(replay_table(scored.replays))
        print_twins(scored)
    if scored.suspect:
        raise typer.Exit(1)


def film(
    run: Annotated[Path, typer.Argument(help="Folder of a run of episodes.")],
    episode: Annotated[str, typer.Option(help="Policy, world and condition, or enough of these words.")],
    out: Annotated[Path, typer.Option(help="FILE.mp4, FILE.gif or FILE.html.")],
    fps: Annotated[float, typer.Option(help="Decisions a second.")] = 2.0,
) -> None:
    """Write a film of one drive: camera, decision, executed action and gap. The drive is made anew and checked.

    Example: eyechart film run --episode "oracle highway/dense/3 real" --out drive.gif
    """
    from eyechart.destination import require_free
    from eyechart.report.film import write_film
    from eyechart.studies.closed_loop import read_drives
    from eyechart.studies.closed_loop.replaying import episode_id, find_episode

    require_free(out, "film")
    drives, found = find_episode(read_drives([run]), episode)
    with patience("film") as tell:
        tell(f"driving '{episode_id(found)}' again")
        count = write_film(drives, found, out, fps=fps)
    say(f"wrote {out}, {count} pictures, {out.stat().st_size / 1e6:.1f} MB")


def print_drives(scored: "ClosedLoopScore") -> None:
    """Print all that ``eyechart score`` prints of a run of episodes."""
    from eyechart.report.rungs import blind_table, degeneracy_table, degeneracy_words, replay_table

    print_ladder(scored)
    console = table_console(160)
    if scored.blind:
        console.print(blind_table(scored.blind))
        for one in scored.blind:
            console.print(one.sentence, markup=False)
    console.print(degeneracy_table(scored.audit))
    for line in degeneracy_words(scored.audit):
        console.print(line, markup=False)
    if scored.replays:
        console.print(replay_table(scored.replays))
