"""Two runs are compared model by model: whether each statistic and each verdict came out again."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from eyechart.errors import SpecError
from eyechart.frames import same_moments
from eyechart.integrity import unfinished
from eyechart.records import Written
from eyechart.report.table import MARK, STATISTIC, Cell, Column, Table, columns, statistic_cells
from eyechart.stats.resampling import holm
from eyechart.stats.statistic import Statistic
from eyechart.studies.battery import BatteryScore, ModelScore, differences
from eyechart.studies.battery.replication import Difference
from eyechart.verdicts import judge

if TYPE_CHECKING:
    from rich.text import Text

ALPHA = 0.05
"""Level of the tests of difference, after Holm's correction over the statistics of a model."""


@dataclass(frozen=True)
class Replication(Written):
    """One model in two runs: its labels, each statistic's difference, and the p of those corrected by Holm.

    ``labels`` maps ``verdict``, ``lateral`` and ``paper`` to what the first and the second run say.
    """

    written = "replicated versions labels differences holm changed"

    model: str
    versions: tuple[str, str]
    labels: Mapping[str, tuple[str, str]]
    differences: Mapping[str, Statistic]
    holm: Mapping[str, float | None]

    @property
    def changed(self) -> tuple[str, ...]:
        """Return the statistics that differ significantly, after correction."""
        return tuple(name for name, p in self.holm.items() if p is not None and p < ALPHA)

    @property
    def words(self) -> str:
        """Return in words which statistics differ."""
        return f"differs in {', '.join(self.changed)}" if self.changed else "no statistic differs (Holm)"

    @property
    def replicated(self) -> bool:
        """Return whether the calibrated verdict and the lateral label came out again and no statistic differs."""
        same = all(self.labels[name][0] == self.labels[name][1] for name in ("verdict", "lateral"))
        return same and not self.changed


@dataclass(frozen=True)
class Comparison(Written):
    """Every model that both runs asked. ``apart`` says in words what the two runs did not have in common.

    A run that is not finished is named there too.

    ``marks`` are the guards that failed in either run: its numbers are not to be relied on.
    """

    written = "replicated apart failed_guards=marks models"

    models: Mapping[str, Replication]
    apart: tuple[str, ...]
    marks: tuple[str, ...] = ()

    @property
    def replicated(self) -> bool:
        """Return whether every model's verdict and statistics came out again."""
        return all(one.replicated for one in self.models.values())

    def printed(self, *, every: bool) -> "Iterator[Table | Text | str]":
        """Yield what the runs did not share, and of each model a table and a line; ``every`` statistic, or the main."""
        from rich.text import Text  # noqa: PLC0415 - a comparison needs no terminal

        yield from (f"not the same: {line}" for line in self.apart)
        yield from (f"{MARK} {line}" for line in self.marks)
        for one in self.models.values():
            yield replication_table(one, every=every)
            pairs = (f"{name} {a}" if a == b else f"{name} {a}, then {b}" for name, (a, b) in one.labels.items())
            yield Text(f"{one.model}: {'; '.join(pairs)}; {one.words}", style="bold")


def compare(first: BatteryScore, second: BatteryScore, *, resamples: int = 2000) -> Comparison:
    """Compare two batteries on the same frames, model by model; the second run's numbers minus the first's.

    Raises SpecError where the runs are on different banks and were not scored on the frames that both have
    (``frames_in_common``), have no model in common, or stopped early. Another prompt, seed, version or set of
    conditions is allowed and named: then the difference is what that change did. Source: paper, paragraph Replication.
    """
    if first.manifest.fingerprint != second.manifest.fingerprint:
        both = set(frames_in_common(first, second))
        if not all({frame.id for frame in one.answers.frames} <= both for one in (*_models(first), *_models(second))):
            raise SpecError(
                f"the runs are on different banks ({first.bank.name} and {second.bank.name}); a replication asks about "
                f"the same frames, of which they share {len(both)}: score both on these alone"
            )
    common = [spec for spec in first.models if spec in second.models]
    if not common:
        raise SpecError(f"the runs have no model in common: {', '.join(first.models)} and {', '.join(second.models)}")
    for which, run in (("first", first), ("second", second)):
        if stopped := [spec for spec in common if run.models[spec].stopped is not None]:
            raise SpecError(
                f"{stopped[0]} stopped early in the {which} run: its answers chose its frames, so no test compares them"
                "; leave --stop-early out of runs that are to be compared"
            )
    judged = judge(first), judge(second)
    models = {}
    for spec in common:
        one, other = (judgement[spec] for judgement in judged)
        found = differences(
            first.models[spec].answers, second.models[spec].answers, seed=first.manifest.seed, resamples=resamples
        )
        models[spec] = Replication(
            model=spec,
            versions=(first.models[spec].version, second.models[spec].version),
            labels={
                "verdict": (one.calibrated.label, other.calibrated.label),
                "lateral": (one.lateral.label, other.lateral.label),
                "paper": (one.paper.label, other.paper.label),
            },
            differences=found,
            holm=dict(zip(found, holm([value.p for value in found.values()]), strict=True)),
        )
    marks = [
        f"{spec} in the {which} run: {words}"
        for which, judgement in zip(("first", "second"), judged, strict=True)
        for spec in common
        for words in judgement[spec].marks
    ]
    return Comparison(models, _apart(first, second), tuple(marks))


def frames_in_common(first: BatteryScore, second: BatteryScore) -> tuple[str, ...]:
    """Return the frames that two runs asked about and that are the same moments in their banks.

    Raises SpecError where there is none.
    """
    asked = [{frame.id for one in _models(run) for frame in one.answers.frames} for run in (first, second)]
    moments = same_moments(first.bank.manifest, second.bank.manifest)
    if found := tuple(frame for frame in moments if frame in asked[0] & asked[1]):
        return found
    raise SpecError(
        f"the runs are on different banks ({first.bank.name} and {second.bank.name}) that share no frame of equal "
        "geometry; a replication asks about the same frames: 'eyechart frames check BANK OTHER' compares them"
    )


def _models(run: BatteryScore) -> Iterable[ModelScore]:
    return run.models.values()


def _apart(first: BatteryScore, second: BatteryScore) -> tuple[str, ...]:
    """Return what the two runs do not have in common, in words."""
    pairs = {
        "prompt": (first.manifest.prompt.key, second.manifest.prompt.key),
        "seed": (first.manifest.seed, second.manifest.seed),
        "conditions": (", ".join(first.manifest.conditions), ", ".join(second.manifest.conditions)),
    }
    both = "{}: {} in the first run, {} in the second"
    if first.manifest.fingerprint != second.manifest.fingerprint:
        count = len(frames_in_common(first, second))
        words = [f"{run.bank.name} ({len(run.bank)} frames)" for run in (first, second)]
        pairs |= {f"bank, compared on the {count} frames that both have": (words[0], words[1])}
    said = [both.format(name, one, other) for name, (one, other) in pairs.items() if one != other]
    for spec in first.models.keys() & second.models.keys():
        one, other = first.models[spec].version, second.models[spec].version
        said += [both.format(f"{spec} version", one, other)] if one != other else []
        asked = [", ".join(run.models[spec].controls.controls) or "none" for run in (first, second)]
        said += [both.format(f"{spec} controls", *asked)] if asked[0] != asked[1] else []
        if not first.manifest.mode(spec).same_request(second.manifest.mode(spec)):
            said.append(f"{spec} was asked in another request mode in the second run")
    for which, mine, theirs in (("first", first, second), ("second", second, first)):
        said += [f"{spec}: asked in the {which} run only" for spec in mine.models if spec not in theirs.models]
        left = {spec: unfinished(one.answered, one.planned) for spec, one in mine.models.items()}
        said += [
            f"{spec}: the {which} run is {words}" for spec, words in left.items() if words and spec in theirs.models
        ]
    return tuple(sorted(said))


MAIN = (
    "across_runs",
    "answer_shift",
    "unparsed_rate",
    "noise_floor",
    "idi",
    "idi_adj",
    "cramers_v",
    "mutual_information.decision",
    "obstacle.decision",
    "mirror_swap_rate",
    "modal_share",
)
"""What a comparison prints unless all statistics are asked for: the paper's replication paragraph, and its like."""


def replication_table(one: Replication, *, every: bool = False) -> Table:
    """Return one row a statistic: both runs' values, the difference with its interval, n and p."""
    rows: list[tuple[Cell, ...]] = []
    for name, found in one.differences.items():
        if every or name in MAIN or name in one.changed:
            sides = (found.first, found.second) if isinstance(found, Difference) else (None, None)
            signed = found.value is not None and name not in {"across_runs", "answer_shift"}
            value = f"{found.value:+.3f}" if signed else found.value
            note = {"across_runs": "share answered alike", "answer_shift": "distance"}.get(name, found.note)
            rows.append((name, *sides, value, *statistic_cells(found)[1:], one.holm[name], note))
    named = (Column("statistic", "word"), *columns("number", "first", "second", "difference"), *STATISTIC[1:])
    return Table("replication", one.model, (*named, Column("p (Holm)", "p"), Column("note")), tuple(rows))


def replications(scores: Mapping[str, BatteryScore]) -> Iterator[tuple[str, Comparison]]:
    """Yield each run, with the first of the runs before it that it replicates, compared: its names, and what was found.

    A run replicates another one on the same bank, with the same prompt and a model in common; runs that stopped early
    are compared with none.
    """
    named = [(name, one) for name, one in scores.items() if not any(mine.stopped for mine in one.models.values())]
    for place, (name, later) in enumerate(named):
        for before, first in named[:place]:
            alike = [(one.manifest.fingerprint, one.manifest.prompt.key) for one in (first, later)]
            if alike[0] == alike[1] and first.models.keys() & later.models.keys():
                yield f"{before}, then {name}", compare(first, later)
                break


def replications_table(scores: Mapping[str, BatteryScore]) -> Table | None:
    """Return the statistics of each model that a second run asked again, of both runs; None where none did."""
    rows, named = [], None
    for name, found in replications(scores):
        for one in found.models.values():
            made = replication_table(one)
            named = named or made.columns
            rows += [(f"{one.model} ({name})", *row) for row in made.rows]
    if named is None:
        return None
    caption = "Replication: the statistics of models asked twice, the second run less the first"
    return Table("replication", caption, (Column("model"), *named), tuple(rows))
