"""Tables of drives: ladder, the paper's ladder, paired differences, audit, replayed decisions."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import astuple, dataclass, replace

from eyechart.episodes import EpisodeMeans, UnfinishedEpisodes
from eyechart.integrity import ServedGuard
from eyechart.report.table import STATISTIC, Cell, Column, Mark, Table, columns, number, statistic_cells
from eyechart.stats.statistic import Statistic
from eyechart.studies.closed_loop import (
    BlindBaseline,
    ClosedLoopScore,
    Degeneracy,
    Driver,
    LadderRow,
    PairedDifference,
    ReplayComparison,
)
from eyechart.studies.closed_loop.audit import is_in_table

PUBLISHED: Mapping[str, Mapping[str, float]] = {
    "constant:SLOW": {"distance_m": 514.4, "reward": 19.64, "speed_mps": 20.1, "crash_rate": 0.031},
    "oracle": {"distance_m": 444.5, "reward": 16.34, "speed_mps": 23.5, "crash_rate": 0.375},
    "random": {"distance_m": 339.3, "reward": 12.05, "speed_mps": 22.7, "crash_rate": 0.781},
    "constant:LEFT": {"distance_m": 211.3, "reward": 6.92, "speed_mps": 25.0, "crash_rate": 0.875},
    "constant:RIGHT": {"distance_m": 197.0, "reward": 7.01, "speed_mps": 25.0, "crash_rate": 1.0},
    "constant:STRAIGHT": {"distance_m": 145.8, "reward": 5.13, "speed_mps": 28.1, "crash_rate": 1.0},
}
"""The paper's Table t:baselines: 32 episodes per policy in highway-env, without STOP (as SLOW)."""

SIMULATOR = "highway"
EPISODES = 32
NEAR = 0.02
"""A relative difference from the paper's number up to this counts as none."""


@dataclass(frozen=True)
class PaperComparison:
    """A row and its relative differences from the paper's; for the crash rate in points."""

    rung: LadderRow
    differences: Mapping[str, float]

    @property
    def apart(self) -> tuple[str, ...]:
        """Return what differs from the paper by more than 2 %, for crashes by over one episode."""
        one_episode = 1.0 / max(1, self.rung.statistics["crash_rate"].n) + 0.001  # the paper prints one digit
        near = {name: one_episode if name == "crash_rate" else NEAR for name in self.differences}
        return tuple(name for name, by in self.differences.items() if abs(by) > near[name])

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        policy = self.rung.driver.policy
        return {"policy": policy, "paper": dict(PUBLISHED[policy]), "differences": dict(self.differences)}


def beside_paper(rungs: Sequence[LadderRow]) -> list[PaperComparison]:
    """Return the rows that the paper's table has too: real pictures in highway, in its order."""
    mine = {
        rung.driver.policy: rung
        for rung in rungs
        if (rung.driver.simulator, rung.driver.condition) == (SIMULATOR, "real")
    }
    result = []
    for policy, row in PUBLISHED.items():
        if policy in mine:
            values = {name: mine[policy].statistics[name].value for name in row}
            differences = {
                name: value - row[name] if name == "crash_rate" else value / row[name] - 1
                for name, value in values.items()
                if value is not None
            }
            result.append(PaperComparison(mine[policy], differences))
    return result


def unlike(rows: Sequence[PaperComparison]) -> str:
    """Return a warning where rows have another number of episodes than the paper's, else ""."""
    counts = sorted({row.rung.statistics["reward"].n for row in rows} - {EPISODES})
    if not counts:
        return ""
    mine = " or ".join(map(str, counts))
    return f"the paper's rows have {EPISODES} episodes in four scenarios, these have {mine}: drive the whole ladder"


def leads(rungs: Sequence[LadderRow]) -> dict[str, list[str]]:
    """Return the best drivers by distance, reward and crash rate; several where they are equal."""
    best: dict[str, list[str]] = {}
    for name, sign in (("distance_m", 1), ("reward", 1), ("crash_rate", -1)):
        values = {
            rung.driver.label: sign * value for rung in rungs if (value := rung.statistics[name].value) is not None
        }
        best[name] = [label for label, value in values.items() if value == max(values.values())]
    return best


MEASURES = {
    "distance_m": Column("distance (m)", "estimate", 1),
    "reward": Column("reward", "estimate", 2),
    "speed_mps": Column("speed (m/s)", "estimate", 1),
    "crash_rate": Column("crash", "estimate", 1, 100, "%"),
    "success_rate": Column("success", "estimate", 1, 100, "%"),
}
"""The columns of the ladder."""
NAMES = {name: measure.name for name, measure in MEASURES.items()}
SIGNED = {name: replace(measure, signed=True) for name, measure in MEASURES.items()}
DIFFERENCES = (
    Column("worlds", "count"),
    *(each for one in SIGNED.values() for each in (one, Column(f"p {one.name.partition(' (')[0]}", "p"))),
)
"""The columns of a pair's differences, whose cells ``difference_cells`` returns."""
DOCS = "docs/reading-drives.md, 'The ladder beside the paper's'"
"""The page that explains the differences from the paper."""
_SIMULATOR = Column("simulator", "word", varies=True)
_WHO = (_SIMULATOR, Column("policy"), *columns("text", "condition", "run", varies=True))


def tables_of(score: ClosedLoopScore) -> tuple[Table, ...]:
    """Return every table of runs of episodes."""
    beside = beside_paper(score.ladder)
    return (
        ladder_table(score.ladder, score.references),
        *([paper_table(beside)] if beside else []),
        *reference_tables(score),
        *([blind_table(score.blind)] if score.blind else []),
        degeneracy_table(score.audit),
        *([replay_table(score.replays)] if score.replays else []),
        *long_tables(score),
    )


def long_tables(score: ClosedLoopScore) -> tuple[Table, ...]:
    """Return the ladder, the paired differences and the audit, a row per number."""
    every = [(one, "") for one in score.paired] + [(one.paired, one.finding) for one in score.blind]
    beware = f" (beware: {score.caveat})" if score.caveat else ""
    paired = f"Differences in the same worlds: from the reference{beware}, and real pictures less others"
    head = (*_WHO, Column("statistic"), *STATISTIC)
    ladder = ((row.driver, name, each, each.method) for row in score.ladder for name, each in row.statistics.items())
    audit = (
        (degeneracy.driver, name, each, each.note)
        for degeneracy in score.audit
        for name, each in degeneracy.statistics.items()
    )
    return (
        Table("ladder", "The ladder (Table t:baselines), row by row", (*head, Column("method")), _numbers(ladder)),
        differences_table(every, paired),
        Table("audit", "The degeneracy audit, every number", (*head, Column("note")), _numbers(audit)),
    )


def _numbers(found: Iterable[tuple[Driver, str, Statistic, str]]) -> tuple[tuple[Cell, ...], ...]:
    return tuple((*astuple(driver)[:4], name, *statistic_cells(one), last) for driver, name, one, last in found)


def differences_table(found: Sequence[tuple[PairedDifference, str]], caption: str) -> Table:
    """Return a row for each statistic of pairs, with the finding."""
    rows = tuple(
        (one.first.label, one.second.label, name, *statistic_cells(each), one.holm.get(name), finding)
        for one, finding in found
        for name, each in one.differences.items()
    )
    named = (*columns("text", "first", "second", "statistic"), *STATISTIC, Column("Holm p", "p"), Column("finding"))
    return Table("paired", caption, named, rows)


def ladder_table(rungs: Sequence[LadderRow], references: Mapping[str, Driver]) -> Table:
    """Return one row per driver, the best by reward first; the reference is marked."""
    note = "[ ] exact 95 % interval of a rate (Clopper-Pearson); means have none. * the reference of the others"
    rows = []
    for rung in sorted(rungs, key=lambda each: (each.driver.simulator, -(each.statistics["reward"].value or 0.0))):
        star = "*" if references.get(rung.driver.simulator) == rung.driver else ""
        errors = f" + {rung.errors} in error" if rung.errors else ""
        n = rung.statistics["reward"].n
        who = (rung.driver.simulator, Mark(rung.driver.label, "", star), f"{n}{errors}" if errors else n)
        rows.append((*who, *(rung.statistics[name] for name in MEASURES)))
    named = (_SIMULATOR, Column("policy"), Column("n", "count"), *MEASURES.values())
    return Table("ladder_summary", "The ladder, best reward first", named, tuple(rows), note)


def paper_table(rows: Sequence[PaperComparison]) -> Table:
    """Return Table t:baselines: ours, the paper's, and the difference in % (crashes: points)."""
    names = ("distance_m", "reward", "speed_mps", "crash_rate")
    made = []
    for row in rows:
        cells: list[Cell] = [row.rung.driver.policy]
        for name in names:
            value, theirs = row.rung.statistics[name].value, PUBLISHED[row.rung.driver.policy][name]
            form, by = MEASURES[name], row.differences.get(name)
            mine, paper = (number(None if one is None else form.scale * one, form.digits) for one in (value, theirs))
            cells.append(f"{mine} | {paper} ({'—' if by is None else f'{100 * by:+.1f}'})")
        made.append(tuple(cells))
    caption = "Table t:baselines: ours | the paper's (difference in %, of crashes in points)"
    return Table(
        "baselines", caption, (Column("policy"), *columns("count", *(NAMES[one] for one in names))), tuple(made)
    )


def paper_tables(score: ClosedLoopScore) -> Iterator[Table]:
    """Yield Tables t:baselines and t:degeneracy in the paper's form, its own rows, and replay."""
    rungs = [row for row in score.ladder if (row.driver.simulator, row.driver.condition) == (SIMULATOR, "real")]
    if rungs:
        yield baselines_table(rungs)
    if beside := beside_paper(score.ladder):
        yield replace(paper_table(beside), name="baselines-beside", note=unlike(beside))
    if rows := degeneracy_audit(score):
        yield audited_table(rows)
    if score.replays:
        yield complete_replay_table(score.replays)


def degeneracy_audit(score: ClosedLoopScore) -> list[Degeneracy]:
    """Return the audit of models with real pictures, as in Table t:degeneracy and figure fgr:mi."""
    listed = {drive.driver for drive in score.drives if is_in_table(drive)}
    return [degeneracy for degeneracy in score.audit if degeneracy.driver in listed]


def baselines_table(rungs: Sequence[LadderRow]) -> Table:
    """Return Table t:baselines in the paper's form, a row per policy, longest distance first."""
    names = ("distance_m", "reward", "speed_mps", "crash_rate")
    far = sorted(rungs, key=lambda rung: -(rung.statistics["distance_m"].value or 0.0))
    rows: tuple[tuple[Cell, ...], ...] = tuple(
        (rung.driver.label, *(rung.statistics[name] for name in names)) for rung in far
    )
    forms = (replace(MEASURES[name], beside="") for name in names)
    table = Table("", "Closed-loop baseline ladder", (Column("policy"), *forms), rows)
    return table.counted([rung.statistics["reward"].n for rung in far], "episodes", "per policy").labelled(
        "t:baselines"
    )


def audited_table(rows: Sequence[Degeneracy]) -> Table:
    """Return Table t:degeneracy in the paper's form, with the episode-safe p beside the paper's."""
    names = ("modal_share", "entropy_bits", "information_bits", "information_share")
    made = []
    for row in rows:
        found = [row.statistics[name] for name in names]
        tests = (*(found[2:] if row.varies else (None, None)), row.holm_naive, row.holm)
        made.append((row.driver.simulator, row.driver.label, *found[:2], *tests))
    named = (
        *(Column("platform", "word"), Column("model")),
        *(Column("modal", "estimate", beside=""), Column("H (b)", "estimate", 2, beside="")),
        *(*columns("estimate", "MI (b)", "MI/H", beside=""), *columns("p", "p", "p (episodes)")),
    )
    caption = (
        "Policy degeneracy audit on closed-loop logs. MI/H is the fraction of the model's own action variability "
        "explained by scene geometry. Both p are Holm-corrected over the cells that vary"
    )
    counts = [row.statistics["modal_share"].n for row in rows]
    return Table("", caption, named, tuple(made)).counted(counts, "decisions", "per cell").labelled("t:degeneracy")


def paper_words(rows: Sequence[PaperComparison], rungs: Sequence[LadderRow]) -> list[str]:
    """Return the best policies, and rows that differ from the paper's by 2 % (crashes: one)."""
    words = [unlike(rows)] if unlike(rows) else []
    real = [rung for rung in rungs if rung.driver.condition == "real"]
    best = {NAMES[name]: " and ".join(who) for name, who in leads(real).items()}
    if best:
        words.append("best: " + "; ".join(f"{name} {who}" for name, who in best.items()))
    near = [row.rung.driver.policy for row in rows if not row.apart]
    if near:
        words.append(f"within 2 % of the paper, and one episode in crashes: {', '.join(near)}")
    for row in rows:
        if row.apart:
            apart = ", ".join(
                f"{NAMES[name]} {100 * row.differences[name]:+.1f}{' points' if name == 'crash_rate' else ' %'}"
                for name in row.apart
            )
            words.append(f"differs: {row.rung.driver.policy}: {apart}")
    return words


def unfinished_words(found: Mapping[str, Sequence[UnfinishedEpisodes]]) -> list[str]:
    """Return the missing episodes of the runs and the reason, a line per policy."""
    return [f"{f'{run} · ' if run else ''}{one.policy}: {one.words}" for run, left in found.items() for one in left]


def served_words(guards: Mapping[str, ServedGuard]) -> list[str]:
    """Return a line per model that several models answered for: its numbers belong to no one."""
    named = (replace(guard, because=f"{who}: {guard.because}") for who, guard in guards.items())
    return [f"{one.mark}; none of its numbers belongs to one model" for one in named]


def reference_tables(score: ClosedLoopScore) -> list[Table]:
    """Return per simulator one row per policy: less the reference, same worlds, p after Holm."""
    return [
        Table(
            f"less_reference_{place}",
            f"{name}: policy less {reference.label}, same worlds; p after Holm",
            (Column("policy"), *DIFFERENCES),
            tuple((one.first.label, *difference_cells(one)) for one in score.paired if one.first.simulator == name),
            score.caveat,
        )
        for place, (name, reference) in enumerate(score.references.items(), 1)
    ]


def blind_table(found: Sequence[BlindBaseline]) -> Table:
    """Return one row per policy and condition: real less the condition, with p after Holm."""
    rows = tuple(
        (
            f"{one.driver.run} · {one.driver.policy}" if one.driver.run and one.driver.needed else one.driver.policy,
            one.condition,
            one.asks,
            Mark(one.finding.replace("_", " "), one.label.family),
            *difference_cells(one.paired),
        )
        for one in found
    )
    named = (Column("policy"), Column("less", "word"), Column("asks"), Column("finding", "word"), *DIFFERENCES)
    return Table("blind", "Real pictures less others, same worlds", named, rows, "p after Holm")


def difference_cells(difference: PairedDifference) -> tuple[Cell, ...]:
    """Return each difference in the same worlds, with p after Holm."""
    each = [(difference.differences[name], difference.holm.get(name)) for name in MEASURES]
    return difference.worlds, *(cell for pair in each for cell in pair)


def degeneracy_table(rows: Sequence[Degeneracy]) -> Table:
    """Return Table t:degeneracy, with the episode-safe p and the parse failures."""
    names = ("modal_share", "distinct_actions", "entropy_bits", "information_bits", "information_share")
    made = tuple(
        (
            *astuple(row.driver)[:4],
            row.statistics["modal_share"].n,
            *(row.statistics[name].value for name in names[:3]),
            *(row.statistics[name].value if row.varies else None for name in names[3:]),
            row.holm_naive,
            row.holm,
            row.statistics["unparsed_rate"].value,
            row.geometry,
            row.label,
            ", ".join(f"{count} {reason}" for reason, count in row.reasons.items()),
        )
        for row in rows
    )
    named = (
        *_WHO,
        Column("n", "count"),
        Column("modal_share", "number"),
        Column("distinct_actions", "number", 0),
        Column("entropy_bits", "number", 2),
        *columns("number", "information_bits", "information_share"),
        *columns("p", "p (paper)", "p (episodes)"),
        Column("no decision", "number", 1, 100, " %"),
        Column("scene", varies=True),
        *columns("word", "label", "reasons"),
    )
    caption = "Policy degeneracy audit (Table t:degeneracy); both p Holm-corrected"
    note = "With a modal share of .98 or more a policy is called constant."
    return Table("degeneracy", caption, named, made, note)


def degeneracy_words(rows: Sequence[Degeneracy]) -> list[str]:
    """Return the table's notes: the geometry, the meaning of both p, and why one is missing."""
    words = []
    geometries: dict[str, list[str]] = {}
    for row in rows:
        geometries.setdefault(row.geometry or "none: the truth has no gap", []).append(row.driver.simulator)
    words += [f"scene geometry in {', '.join(dict.fromkeys(who))}: {what}" for what, who in geometries.items()]
    words.append(
        "p (paper): steps permuted one by one, as if they were independent; p (episodes): whole episodes exchanged. "
        "Both are Holm-corrected over the policies that vary; models with real pictures are a family of their own"
    )
    for row in rows:
        safe = row.statistics["information_episode_safe"]
        if safe.value is None and safe.p is None and not row.is_constant:
            words.append(f"{row.driver.label}: no episode-safe p: {safe.note}")
    return words


def replay_table(found: Sequence[ReplayComparison]) -> Table:
    """Return one row per driver and controller: agreement, the best constant's, random order's."""
    rows = tuple(
        (
            comparison.driver.simulator,
            comparison.driver.label,
            comparison.controller,
            comparison.agreement.n,
            comparison.agreement,
            None
            if comparison.best_constant is None
            else f"{comparison.best_constant[0]} {comparison.best_constant[1]:.3f}",
            comparison.shuffled,
            comparison.shuffled.p,
        )
        for comparison in found
    )
    named = (
        _SIMULATOR,
        Column("model"),
        Column("controller", "word"),
        Column("n", "count"),
        Column("agrees", "estimate"),
        Column("best constant", "count"),
        Column("random order", "estimate"),
        Column("p", "p"),
    )
    return Table("replay", "Decision-level replay: agreement with a scripted controller", named, rows)


def complete_replay_table(comparisons: Sequence[ReplayComparison]) -> Table:
    """Return the complete replay table, as the paper releases it, with all constants."""
    actions = list(dict.fromkeys(name for comparison in comparisons for name in comparison.constants))
    rows = tuple(
        (
            *(comparison.driver.simulator, comparison.driver.label, comparison.controller, comparison.agreement),
            *(comparison.constants.get(name) for name in actions),
            *(comparison.shuffled, comparison.shuffled.p),
        )
        for comparison in comparisons
    )
    named = (
        *(_SIMULATOR, Column("model"), Column("controller", "word")),
        *columns("estimate", "agrees", *(f"constant {name}" for name in actions), "random order", beside=""),
        Column("p", "p"),
    )
    caption = "Decision-level replay: agreement with a scripted controller, of constants, and in random order"
    return Table("replay", caption, named, rows)


def ladder_printed(score: ClosedLoopScore) -> Iterator[Table | str]:
    """Yield the ladder, the comparison with the paper, the paired differences, identical drives."""
    yield ladder_table(score.ladder, score.references)
    if beside := beside_paper(score.ladder):
        yield paper_table(beside)
        yield from paper_words(beside, score.ladder)
        yield f"Why, row by row: {DOCS}."
    yield from reference_tables(score)
    yield from _twins_printed(score)


def audit_printed(score: ClosedLoopScore, *, twins: bool = False) -> Iterator[Table | str]:
    """Yield the degeneracy audit and decision-level replay; ``twins`` adds the identical drives."""
    yield degeneracy_table(score.audit)
    yield from degeneracy_words(score.audit)
    if score.replays:
        yield replay_table(score.replays)
    if twins:
        yield from _twins_printed(score)


def _twins_printed(score: ClosedLoopScore) -> Iterator[str]:
    """Yield the drivers with identical drives, and the repeated requests."""
    for twin in score.twins:
        names = ", ".join(driver.label for driver in twin.drivers)
        yield f"{twin.kind}: {names}: identical in {twin.same} of {twin.worlds} worlds: {twin.words}"
    for two in score.repeats:
        yield f"{'suspect caching: ' if two.suspect else ''}{two.driver.label}: {two.words}"


def means_table(simulator: str, rows: Sequence[EpisodeMeans]) -> Table:
    """Return the means over the episodes of each policy under each condition."""
    named = (
        *(Column("policy", "word"), Column("condition", "word"), Column("episodes", "count")),
        *(Column("distance m", "number", 1), Column("reward", "number", 2), Column("speed m/s", "number", 1)),
        *(Column("crashed", "number", 1, 100, "%"), Column("no decision", "number", 1, 100, "%")),
        Column("errors", "count"),
    )
    cells = tuple(
        (
            *(row.policy, row.condition, row.episodes, row.distance_m, row.reward, row.speed_mps),
            *(row.crash_rate, row.without_decision, row.errors),
        )
        for row in rows
    )
    return Table("means", f"{simulator}: means over episodes", named, cells)
