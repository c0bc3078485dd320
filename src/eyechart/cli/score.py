"""Commands that read runs and change nothing."""

from pathlib import Path
from typing import Annotated, Any

import typer

from eyechart.cli.options import Against, Fresh, Independent, Json, PriceFile, Reread, Steps
from eyechart.cli.terminal import as_read, print_each, print_json, print_line, print_read, say
from eyechart.errors import SpecError
from eyechart.kept import kept

_Run = Annotated[Path, typer.Argument(help="Folder of the run.")]


def score(
    run: _Run,
    every: Annotated[bool, typer.Option("--all", help="Print every statistic, in groups.")] = False,
    json: Json = False,
    independent: Independent = False,
    reread: Reread = False,
    against: Against = None,
    fresh: Fresh = False,
) -> None:
    """Print the statistics of a run with interval, n and p.

    By default these are the ones that decided the verdict or kept it from a stronger one, and the
    main ones. --json says how each was found. Example: eyechart score run --all
    """

    def read() -> Any:  # noqa: ANN401 - JSON
        from eyechart.studies import ReadOptions, Study, study_of

        study = study_of(run, "score" if against is None else "score --against")
        scored = study.score(run, ReadOptions(independent, reread, against, fresh=fresh))
        if json:
            return scored.as_dict()
        shown = study.printed(scored) if every else study.brief(scored)
        more = not every and type(study).brief is not Study.brief
        return {"shown": as_read(shown, 160 if every else None, names=study.models(run)), "more": more}

    request = ["score", json, every, independent, reread, against]
    found = kept(run, request, read, fresh=fresh)
    if json:
        print_json(found)
        return
    print_read(found["shown"])
    if found["more"]:
        say(f"every statistic: 'eyechart score {run} --all'; the method of each: --json")


def verdict(
    run: _Run, json: Json = False, independent: Independent = False, reread: Reread = False, fresh: Fresh = False
) -> None:
    """Print every model's verdict and what decided it. Example: eyechart verdict run."""

    def read() -> Any:  # noqa: ANN401 - JSON
        from eyechart.studies import ReadOptions, study_of

        study = study_of(run, "verdict")
        scored = study.score(run, ReadOptions(independent, reread, fresh=fresh))
        return study.verdict_json(scored) if json else as_read(study.verdict_printed(scored), names=study.models(run))

    found = kept(run, ["verdict", json, independent, reread], read, fresh=fresh)
    print_json(found) if json else print_read(found)


def costs(
    run: _Run,
    prices: PriceFile = None,
    every: Annotated[bool, typer.Option("--all", help="Add a line for every condition.")] = False,
    unread: Annotated[
        bool, typer.Option("--unread", help="List the replies without a decision, and count them.")
    ] = False,
    json: Json = False,
    fresh: Fresh = False,
) -> None:
    """Print the calls of a run by model: attempts, outcomes, tokens, dollars, seconds, joules.

    Then print the costs of decisions: dollars per 1000, tokens per call, truncated calls, joules. A
    prompt study is split by cell, a hierarchy by run. --unread lists instead the replies without a
    decision; for policies, the faults of their answers and their errors. Example: eyechart costs
    run --all --json
    """

    def read() -> Any:  # noqa: ANN401 - JSON
        from eyechart.models.prices import read_prices
        from eyechart.records import plain
        from eyechart.studies import study_of

        study = study_of(run)
        if unread and json:
            return {"unread": plain(study.unread(run))}
        if json:
            return study.took(run, read_prices(prices), fresh=fresh).as_dict()
        if unread:
            from eyechart.report.accounts import unread_table

            return as_read([unread_table(study.unread(run))], names=study.models(run))
        return as_read(
            study.costs_printed(run, read_prices(prices), every=every, fresh=fresh), 160, names=study.models(run)
        )

    request = ["costs", json, every, unread]
    found = kept(run, request, read, fresh=fresh, beside=[] if prices is None else [prices])
    print_json(found) if json else print_read(found)


def gate(
    run: _Run,
    require: Annotated[
        str | None,
        typer.Option(
            help="depth (default), depth_lateral, swaps, turns_clear, any other label, or looks. Scene estimates: "
            "admission (default) or its clauses. Policies: an axis and a label, as camera:camera_content "
            "(default) or instruction:instruction_followed. Several with commas."
        ),
    ] = None,
    order: Annotated[
        float | None, typer.Option(help="Bound on the share of comparisons in the wrong order, as 0.05.")
    ] = None,
    max_unparsed: Annotated[float | None, typer.Option(help="Highest rate of calls without a decision.")] = None,
    allow_fingerprints: Annotated[
        bool, typer.Option("--allow-fingerprints", help="Accept a run in which one model named several fingerprints.")
    ] = False,
    made_elsewhere: Annotated[
        bool, typer.Option("--made-elsewhere", help="Accept a run whose answers eyechart did not ask for itself.")
    ] = False,
    evidence: Annotated[
        str | None, typer.Option(help="Accept labels of distance that rest on edited photographs: edited.")
    ] = None,
    junit: Annotated[Path | None, typer.Option(help="Write the checks as JUnit XML.")] = None,
    json: Json = False,
    independent: Independent = False,
    reread: Reread = False,
    fresh: Fresh = False,
) -> None:
    """Check a run against your requirements.

    Exit 0: all hold; 1: one fails; 2: inconclusive, or bad input. An empty or unfinished run never
    passes, nor a run with answers from several models or providers. A run of imported answers
    passes only with --made-elsewhere. In an admission or structured run, every clause of admission
    is a check.
    Example: eyechart gate run --require depth,swaps --junit gate.xml
    """
    from eyechart.report.short_names import shortener

    if junit is not None:
        from eyechart.destination import require_free

        require_free(junit, "JUnit file")

    def read() -> Any:  # noqa: ANN401 - JSON
        from eyechart.gate import read_requirements
        from eyechart.studies import HELD, ReadOptions, study_of

        study = study_of(run, "gate")
        wanted = read_requirements(require or study.required, study.requirements)
        score = study.score(run, ReadOptions(independent, reread, fresh=fresh))
        held = study.gate(
            score,
            wanted,
            order=order,
            max_unparsed=max_unparsed,
            allow_fingerprints=allow_fingerprints,
            made_elsewhere=made_elsewhere,
            evidence=evidence,
        )
        lines = [f"{HELD[one.holds]:<10}  {one.model}  {one.requirement}: {one.because}" for one in held.checks]
        said = held.as_dict()
        return {"said": said, "lines": lines, "junit": held.junit().decode(), "models": study.models(run)}

    request = ["gate", require, order, max_unparsed, allow_fingerprints, made_elsewhere, evidence, independent, reread]
    found = kept(run, request, read, fresh=fresh)
    if json:
        print_json(found["said"])
    else:
        print_line(*map(shortener(found["models"]), found["lines"] or ["cannot say: the run holds no model"]))
    if junit is not None:
        from eyechart.destination import whole

        with whole(junit, "JUnit file") as partial:
            partial.write_bytes(found["junit"].encode())
    if found["said"]["exit_code"]:
        raise typer.Exit(found["said"]["exit_code"])


def compare(
    first: Annotated[Path, typer.Argument(help="Folder of a run.")],
    second: Annotated[
        Path | None, typer.Argument(help="Folder of its replication; for policies one run is enough.")
    ] = None,
    every: Annotated[bool, typer.Option("--all", help="Print every statistic, not only the main ones.")] = False,
    resamples: Annotated[
        int, typer.Option(min=999, help="Number of exchanges between the runs, and of resamples of episodes.")
    ] = 2000,
    step: Steps = None,
    json: Json = False,
) -> None:
    """Compare two runs on the same frames: verdicts, and statistics with a test of difference.

    Runs on two banks are scored anew on the frames that show the same moments. Each policy is
    compared with the one before it, in their order or by training step. Policies declare that step,
    or --step gives it. 'eyechart report' draws the course.
    Exit 0: every verdict and statistic was replicated; 1: something differs; 2: the runs cannot be
    compared.
    Example: eyechart compare monday tuesday
    """
    from dataclasses import replace

    from eyechart.compare import compare as compared
    from eyechart.compare import frames_in_common
    from eyechart.studies import ReadOptions, read_steps, study_of

    runs = [run for run in (first, second) if run is not None]
    study, *others = (study_of(run, "compare") for run in runs)
    if any(type(other) is not type(study) for other in others):
        raise SpecError(f"{first} and {second} are not runs of one kind")
    reading = ReadOptions(steps=read_steps(step, [study]))
    scores = [study.score(run, reading) for run in runs]
    names = dict.fromkeys(name for run in runs for name in study.models(run))
    if (course := study.course(scores, reading)) is not None:
        print_json(course.as_dict()) if json else print_each(course.printed(), 200, names=names)
        if not course.is_replicated:
            raise typer.Exit(1)
        return
    if second is None:
        raise SpecError(f"{first} needs another run to compare with: give the folder of its replication")
    if scores[0].manifest.fingerprint != scores[1].manifest.fingerprint:
        reading = replace(reading, frames=frames_in_common(*scores))
        scores = [study.score(run, reading) for run in runs]
    found = compared(*scores, resamples=resamples)
    print_json(found.as_dict()) if json else print_each(found.printed(every=every), names=names)
    if not found.is_replicated:
        raise typer.Exit(1)


def transfer(
    runs: Annotated[list[Path], typer.Argument(help="Folders of runs.")],
    scores: Annotated[Path, typer.Option(help="CSV file with the columns model and score.")],
    measure: Annotated[
        str, typer.Option(help="The statistic that measures grounding, as 'eyechart score' names it.")
    ] = "mutual_information.decision",
    json: Json = False,
) -> None:
    """Correlate external scores with grounding, over the models of runs of any kind.

    A model on two banks, in two simulators, or under two prompts is two cells. For drives the
    statistics are those of the audit; for policies, shares of their motion, as T.swapped@cameras.
    Example: eyechart transfer run-highway drives-rover --scores perception.csv
    """
    from eyechart.studies import ReadOptions, each_once, study_of
    from eyechart.transfer import read_scores
    from eyechart.transfer import transfer as correlated

    external, runs = read_scores(scores), each_once(runs)
    studies = [study_of(run, "transfer") for run in runs]
    scored = [study.score(run, ReadOptions()) for study, run in zip(studies, runs, strict=True)]
    found = correlated(scored, external, measure=measure)
    if json:
        print_json(found.as_dict())
        return
    names = {name for study, run in zip(studies, runs, strict=True) for name in study.models(run)}
    print_each(found.lines(), names=sorted(names | set(external)))
