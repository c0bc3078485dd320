"""Tables of the hierarchy: sources with the paper's values, their intents, and completion."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from eyechart.report.table import Cell, Column, Mark, Table, columns, of_each, stack_tables
from eyechart.studies.closed_loop import PairedDifference
from eyechart.studies.closed_loop.tables import DIFFERENCES, difference_cells, differences_table
from eyechart.studies.hierarchy import Completion, HierarchyScore, IntentSource
from eyechart.studies.hierarchy.plans import PARTS, name_of
from eyechart.studies.hierarchy.scores import NOT_PERCEPTION, PUBLISHED, PUBLISHED_MODELS, UNPUBLISHED, count_of

TITLES = {
    "primary": "Primary ablation: the controller knows the obstacles",
    "second": "Second ablation: the controller does not know the obstacles, except that of mpc-oracle",
}


def tables_of(score: HierarchyScore) -> tuple[Table, ...]:
    """Return every table of a study."""
    primary, second = ((source_table(score.sources, name), intent_table(score.sources, name)) for name in TITLES)
    completed = [completion_table(score.completions)] if score.completions else []
    blind = [blind_table(score)] if score.blind else []
    return *primary, against_table(score.against_mpc_only), *second, *completed, *blind, *long_tables(score)


def of_ablation(sources: Sequence[IntentSource], ablation: str) -> list[IntentSource]:
    """Return the sources of one ablation."""
    return [source for source in sources if source.part.startswith("primary") == (ablation == "primary")]


def source_table(sources: Sequence[IntentSource], ablation: str) -> Table:
    """Return the rows of one ablation with exact 95 % intervals, next to the paper's.

    Episodes that ended in an error are listed with the name, and count in no rate.
    """
    rows = []
    for source in of_ablation(sources, ablation):
        goals, crashes, distance, _ = PUBLISHED.get(source.name, UNPUBLISHED)
        counts = (count_of(source.goals), source.goals.ci, goals, count_of(source.crashes), source.crashes.ci, crashes)
        rows.append(
            (
                Mark(source.name, "", f"+ {source.episodes_in_error} in error" if source.episodes_in_error else ""),
                *counts,
                source.distance_m,
                distance,
            )
        )
    named = (
        Column("intent source"),
        *(Column("goal", "count"), Column("goal 95 %", "interval", 2), Column("paper's goal", "count")),
        *(Column("crash", "count"), Column("crash 95 %", "interval", 2), Column("paper's crash", "count")),
        *(Column("dist. m", "estimate", 1), Column("paper's dist.", "number", 1)),
    )
    return Table(f"sources_{ablation}", TITLES[ablation], named, tuple(rows), "95 %: exact intervals")


def paper_tables(scores: Mapping[str, HierarchyScore]) -> Iterator[Table]:
    """Yield Table t:mpc-intent of studies by name, then the second ablation.

    The paper prints the second one in its text only. Each has the paper's rows too.
    """
    titles = {
        "primary": ("t:mpc-intent", "Intent-source controls with the state-constrained MPC fixed"),
        "second": ("", "The second ablation: without the keep-out constraints, but for mpc-oracle"),
    }
    for ablation, (label, caption) in titles.items():
        mine = {name: of_ablation(score.sources, ablation) for name, score in scores.items()}
        found = {name: _as_published(sources) for name, sources in mine.items() if sources}
        if found:
            n = of_each(source.goals.n for sources in mine.values() for source in sources)
            made = replace(stack_tables(found), caption=f"{caption}, {n} paired worlds per source")
            yield made.labelled(label) if label else replace(made, name="mpc-intent-second")
        for name, one in scores.items():
            if mine[name]:
                title = f"{TITLES[ablation]}, beside the paper's{f' ({name})' if len(scores) > 1 else ''}"
                beside = beside_table(one.sources, ablation)
                yield replace(beside, name=f"mpc-intent-{ablation}-beside", caption=title)


def beside_table(sources: Sequence[IntentSource], ablation: str) -> Table:
    """Return the rows of one ablation with the share of STOP, then the paper's and its model's."""
    mine, table = of_ablation(sources, ablation), source_table(sources, ablation)
    rows: list[tuple[Cell, ...]] = [
        (*row, one.stop_share, PUBLISHED.get(one.name, UNPUBLISHED)[3])
        for row, one in zip(table.rows, mine, strict=True)
    ]
    for name, (goals, crashes, distance, stops) in PUBLISHED_MODELS[ablation].items():
        rows.append((f"{name} (the paper's)", None, None, goals, None, None, crashes, None, distance, None, stops))
    stop = (Column("STOP", "estimate", 1, 100, "%"), Column("paper's STOP", "number", 1, 100, "%"))
    return replace(table, columns=(*table.columns, *stop), rows=tuple(rows))


def _as_published(sources: Sequence[IntentSource]) -> Table:
    """Return goals, crashes, metres and the share of STOP, in the form of Table t:mpc-intent."""
    rows = tuple(
        (source.name, count_of(source.goals), count_of(source.crashes), source.distance_m, source.stop_share)
        for source in sources
    )
    named = (
        *(Column("intent source"), *columns("count", "goal", "crash")),
        *(Column("dist. (m)", "estimate", 1, beside=""), Column("STOP", "estimate", 1, 100, "%", beside="")),
    )
    return Table("", "", named, rows)


def intent_table(sources: Sequence[IntentSource], ablation: str) -> Table:
    """Return each source's intents, the share of STOP among them, and the fail-safe's steps.

    A STOP of the fail-safe counts in no share; ``no decision`` gives their number and reason.
    """
    rows = tuple(
        (
            source.name,
            source.intents_emitted,
            source.stop_share,
            PUBLISHED.get(source.name, UNPUBLISHED)[3],
            source.fail_safe_steps,
            source.solver_failures,
            ", ".join(f"{why} {count}" for why, count in source.no_decision.items()),
            ", ".join(f"{count} {action}" for action, count in source.intents.items() if count),
        )
        for source in of_ablation(sources, ablation)
    )
    named = (
        Column("intent source"),
        Column("intents", "count"),
        Column("STOP", "estimate", 1, 100, "%"),
        Column("paper", "number", 1, 100, "%"),
        *columns("count", "fail-safe", "solver failed"),
        *columns("text", "no decision", "which intents"),
    )
    caption = "Emitted intents: STOP is a share of them, with its 95 % interval; the fail-safe is no intent"
    return Table(f"intents_{ablation}", caption, named, rows)


def completion_table(completions: Sequence[Completion]) -> Table:
    """Return each model's goals with real and other pictures, and whether that shows perception."""
    rows = []
    for completion in completions:
        goals = [completion.goals.get(name) for name in ("real", "mirrored", "blank", "shuffled")]
        said = "differs from both" if completion.is_shown else NOT_PERCEPTION
        rows.append(
            (PARTS[completion.part].simulator, completion.policy, *(each and count_of(each) for each in goals), said)
        )
    named = (Column("arm", "word"), Column("model"), *columns("count", "real", "mirrored", "blank", "shuffled"))
    caption = "Goals of a model with its pictures, and of the same model without"
    return Table("completions", caption, (*named, Column("reads as")), tuple(rows))


def against_table(pairs: Sequence[PairedDifference]) -> Table:
    """Return each source less MPC-only in the same worlds, exact tests, p after Holm."""
    rows = []
    for pair in pairs:
        goals, distance = (pair.differences[name].value for name in ("success_rate", "distance_m"))
        p, q = (pair.holm.get(name) for name in ("success_rate", "distance_m"))
        rows.append((name_of("primary", pair.first), pair.worlds, goals, p, distance, q))
    named = (
        *(Column("intent source"), Column("worlds", "count")),
        *(Column("goals", "number", 1, 100, " points", signed=True), Column("p goals", "p")),
        *(Column("distance m", "number", 1, signed=True), Column("p distance", "p")),
    )
    note = "Exact McNemar for goals, signs flipped for distance"
    return Table("less_mpc_only", "Less MPC-only in the same worlds; p after Holm", named, tuple(rows), note)


def blind_table(score: HierarchyScore) -> Table:
    """Return each planner with real pictures less itself with other ones, in the same worlds."""
    rows = tuple(
        (one.driver.label, PARTS[part].simulator, one.condition, *difference_cells(one.paired))
        for part, one in score.blind
    )
    named = (Column("planner"), *columns("word", "arm", "less"), *DIFFERENCES)
    return Table("blind", "Real less other pictures; p after Holm within an arm", named, rows)


def long_tables(score: HierarchyScore) -> tuple[Table, ...]:
    """Return every source's rates and every paired difference, a row each."""
    actions = score.sources[0].intents if score.sources else ()
    counted = ("fail-safe steps", "solver failures", "episodes in error", *actions)
    named = (
        *columns("text", "name", "part", "simulator", "source", "condition"),
        Column("n", "count"),
        *(
            column
            for name in ("goals", "crashes", "distance m", "STOP share")
            for column in (Column(name, "number"), Column(f"{name} interval", "interval"))
        ),
        *columns("count", *counted),
    )
    rows: list[tuple[Cell, ...]] = [
        (
            *(
                source.name,
                source.part,
                source.driver.simulator,
                source.driver.policy,
                source.driver.condition,
                source.goals.n,
            ),
            *(source.goals.value, source.goals.ci, source.crashes.value, source.crashes.ci),
            *(source.distance_m.value, source.distance_m.ci, source.stop_share.value, source.stop_share.ci),
            *(source.fail_safe_steps, source.solver_failures, source.episodes_in_error, *source.intents.values()),
        )
        for source in score.sources
    ]
    control = [] if score.oracle_mirrored is None else [(score.oracle_mirrored, "positive control")]
    pairs = [
        *((difference, "") for difference in score.against_mpc_only),
        *control,
        *((b.paired, b.finding) for _, b in score.blind),
    ]
    caption = "Differences in the same worlds: from MPC-only, the positive control, and real pictures less others"
    return (
        Table("sources", "Sources of intent above the controller (Table t:mpc-intent)", named, tuple(rows)),
        differences_table(pairs, caption),
    )
