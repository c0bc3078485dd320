"""``eyechart ladder``, ``audit`` and ``film``: drivers ranked, told apart by whether they decide, and seen."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eyechart.cli import asking
from eyechart.cli.drives import (
    MOST_SEEDS,
    Wanted,
    drive,
    plan_drives,
    require_drives,
    say_expected,
    tell_errors,
    tell_left,
)
from eyechart.cli.options import NO_LIMIT, Json, Spending, expanded
from eyechart.cli.terminal import patience, print_json, say, table_console

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from eyechart.episodes import Episodes
    from eyechart.limits import Spent
    from eyechart.modes import RequestMode
    from eyechart.studies.closed_loop import ClosedLoopScore

Against = Annotated[
    str | None, typer.Option(help="Of drives: the policy that the others are held against; default: the best constant.")
]

DOCS = "docs/reading-drives.md, 'The ladder beside the paper's'"
"""Where it is explained what differs from the paper, and why."""


@expanded
def ladder(
    out: Annotated[Path, typer.Option(help="Folder of the run; the same one resumes it.")] = Path("ladder"),
    simulator: Annotated[str, typer.Option(help="See 'eyechart list simulators'; or gym:ENV_ID.")] = "highway",
    policy: Annotated[list[str] | None, typer.Option(help="A further policy or model; again for more.")] = None,
    mode: asking.Mode = None,
    seeds: Annotated[int, typer.Option(min=1, max=MOST_SEEDS, help="So many seeds a scenario, from 0 on.")] = 8,
    actions: Annotated[Path | None, typer.Option(help="FILE.toml: the action map of gym:ENV_ID.")] = None,
    prompt: Annotated[str | None, typer.Option(help="A name of 'eyechart list prompts', or FILE.toml.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the run, and so of random's stream.")] = 0,
    processes: Annotated[int, typer.Option(min=1, help="Processes that hold the worlds.")] = 1,
    concurrency: Annotated[int, typer.Option(min=1, help="Episodes of a model under way at once.")] = 8,
    how: asking.Options = asking.AS_USUAL,
    spending: Spending = NO_LIMIT,
    against: Against = None,
    again: Annotated[bool, typer.Option("--again", help="Drive anew what ended in an error.")] = False,
    no_probe: asking.NoProbe = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Print the plan; drive nothing, ask nothing.")] = False,
    json: Json = False,
) -> None:
    """Drive the baselines and print Table t:baselines beside the paper's. Interrupt it at will: it resumes.

    Every constant action, random and the scripted controller in every scenario: in the highway 7 × 4 × 8 episodes. A
    model among the further policies is asked, probed and paid for as in 'run closed-loop'. Exit 1: episodes are
    unfinished, or ended in an error; 3: stopped at --max-calls or --max-cost.
    Example: eyechart ladder --out ladder --processes 2
    """
    from eyechart.episodes import Bounds
    from eyechart.limits import Outcome
    from eyechart.studies.closed_loop import score
    from eyechart.studies.closed_loop.laddering import plan_ladder, require_reference

    def planned_for(drivers: "Sequence[str | RequestMode]", probes: "Mapping[str, Spent]") -> "Episodes":
        made = plan_ladder(
            out,
            simulator=simulator,
            seeds=seeds,
            further=drivers,
            actions=actions,
            prompt=prompt,
            seed=seed,
            again=again,
            probes=probes,
        )
        if not probes:  # before anything is asked or driven
            require_reference(made, against)
        return made

    wanted = Wanted(policy or (), mode, how, spending, no_probe, dry_run, alone=False)
    planned, failed = plan_drives(wanted, out, planned_for)
    say(f"{len(planned.keys)} episodes, {len(planned.keys) - len(planned.left())} driven already")
    say_expected(planned, spending.table(), concurrency)
    if dry_run:
        return
    outcome = Outcome({})
    if planned.left():
        outcome = drive(planned, Bounds(processes=processes, concurrency=concurrency), spending)
    if planned.unfinished():
        tell_left({"": planned}, outcome, failed)
    scored = score(out, against_policy=against)
    print_json(ladder_dict(scored)) if json else print_ladder(scored)
    tell_left({"": planned}, outcome, failed)
    tell_errors({"": planned})


def ladder_dict(scored: "ClosedLoopScore") -> dict[str, object]:
    """Return the ladder's part of a score as plain JSON values, the paper's rows beside it."""
    from eyechart.studies.closed_loop.published import beside_paper

    found = scored.as_dict()
    kept = {
        name: found[name]
        for name in ("study", "references", "references_chosen_on_these_data", "ladder", "paired", "identical")
    }
    return {**kept, "beside_paper": [one.as_dict() for one in beside_paper(scored.ladder)]}


def print_ladder(scored: "ClosedLoopScore") -> None:
    """Print the ladder, the paper's beside it, what differs, the paired differences and the identical rows."""
    from eyechart.report.rungs import ladder_table, paper_table, paper_words, reference_tables
    from eyechart.studies.closed_loop.published import beside_paper

    console = table_console(160)
    console.print(ladder_table(scored.ladder, scored.references))
    if beside := beside_paper(scored.ladder):
        console.print(paper_table(beside))
        for line in paper_words(beside, scored.ladder):
            console.print(line, markup=False)
        console.print(f"Why, row by row: {DOCS}.", markup=False)
    for table in reference_tables(scored):
        console.print(table)
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

    require_drives(runs)
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
    episode: Annotated[str, typer.Option(help="Policy, scenario, seed, condition: enough of these words.")],
    out: Annotated[Path, typer.Option(help="FILE.mp4, FILE.gif or FILE.html.")],
    fps: Annotated[float, typer.Option(help="Decisions a second.")] = 2.0,
) -> None:
    """Write a film of one drive: camera, decision, executed action and gap. The drive is made anew and checked.

    Of the hierarchy it shows the controller's plan over the picture.

    Example: eyechart film run --episode "oracle highway/dense/3 real" --out drive.gif
    """
    from eyechart.destination import require_free
    from eyechart.report.film import write_film
    from eyechart.studies.closed_loop import read_drives
    from eyechart.studies.closed_loop.replaying import episode_id, find_episode

    require_free(out, "film")
    require_drives([run])
    drives, found = find_episode(read_drives([run]), episode)
    with patience("film") as tell:
        tell(f"driving '{episode_id(found)}' again")
        count = write_film(drives, found, out, fps=fps)
    say(f"wrote {out}, {count} pictures, {out.stat().st_size / 1e6:.1f} MB")


def print_drives(scored: "ClosedLoopScore") -> None:
    """Print all that ``eyechart score`` prints of a run of episodes."""
    from eyechart.report.rungs import (
        blind_table,
        degeneracy_table,
        degeneracy_words,
        long_tables,
        replay_table,
        unfinished_words,
    )

    print_ladder(scored)
    console = table_console(160)
    for line in unfinished_words(scored.unfinished):
        console.print(line, markup=False)
    if scored.blind:
        console.print(blind_table(scored.blind))
        for one in scored.blind:
            console.print(one.sentence, markup=False)
    console.print(degeneracy_table(scored.audit))
    for line in degeneracy_words(scored.audit):
        console.print(line, markup=False)
    if scored.replays:
        console.print(replay_table(scored.replays))
    for table in long_tables(scored):
        console.print(table)
