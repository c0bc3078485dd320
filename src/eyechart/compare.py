"""Comparison of two runs by model: whether each statistic and verdict is replicated."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from eyechart.errors import SpecError
from eyechart.frames import same_moments
from eyechart.integrity import unfinished
from eyechart.records import to_json_fields
from eyechart.report.table import MARK, STATISTIC, Cell, Column, Table, columns, statistic_cells
from eyechart.stats.resamples import holm
from eyechart.stats.statistic import Statistic
from eyechart.studies.battery import BatteryScore, ModelScore, differences
from eyechart.studies.battery.replication import StatisticDifference
from eyechart.verdicts import judge

if TYPE_CHECKING:
    from rich.text import Text

ALPHA = 0.05
"""Level of the tests of difference, after Holm's correction over a model's statistics."""


@dataclass(frozen=True)
class Replication:
    """One model in two runs: its labels, the differences of statistics, and their Holm-corrected p.

    ``labels`` maps ``verdict``, ``lateral`` and ``paper`` to the first and the second run's label.
    """

    model: str
    versions: tuple[str, str]
    labels: Mapping[str, tuple[str, str]]
    differences: Mapping[str, Statistic]
    holm: Mapping[str, float | None]

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        return {"replicated": self.is_replicated, **to_json_fields(self, "versions labels differences holm changed")}

    @property
    def changed(self) -> tuple[str, ...]:
        """Return the statistics that differ significantly after correction."""
        return tuple(name for name, p in self.holm.items() if p is not None and p < ALPHA)

    @property
    def words(self) -> str:
        """Return in words which statistics differ."""
        return f"differs in {', '.join(self.changed)}" if self.changed else "no statistic differs (Holm)"

    @property
    def is_replicated(self) -> bool:
        """Return whether calibrated and lateral label are equal and no statistic differs."""
        same = all(self.labels[name][0] == self.labels[name][1] for name in ("verdict", "lateral"))
        return same and not self.changed


@dataclass(frozen=True)
class Comparison:
    """Every model that is in both runs; ``apart`` says how the runs differ or are unfinished.

    ``marks`` are the failed guards of either run: its numbers are not reliable.
    """

    models: Mapping[str, Replication]
    apart: tuple[str, ...]
    marks: tuple[str, ...] = ()

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        return to_json_fields(self, "apart models", replicated=self.is_replicated, failed_guards=self.marks)

    @property
    def is_replicated(self) -> bool:
        """Return whether every model's verdict and statistics are replicated."""
        return all(model.is_replicated for model in self.models.values())

    def printed(self, *, every: bool) -> "Iterator[Table | Text | str]":
        """Yield how the runs differ, then a table and a line per model, main or ``every`` row."""
        from rich.text import Text  # noqa: PLC0415 - a comparison needs no terminal

        yield from (f"not the same: {line}" for line in self.apart)
        yield from (f"{MARK} {line}" for line in self.marks)
        for model in self.models.values():
            yield replication_table(model, every=every)
            pairs = (f"{name} {a}" if a == b else f"{name} {a}, then {b}" for name, (a, b) in model.labels.items())
            yield Text(f"{model.model}: {'; '.join(pairs)}; {model.words}", style="bold")


def compare(first: BatteryScore, second: BatteryScore, *, resamples: int = 2000) -> Comparison:
    """Compare two batteries on the same frames by model: the second run minus the first.

    Raises SpecError if the banks differ and the runs were not scored on ``frames_in_common``, if
    they share no model, or if one stopped early. Another prompt, seed, version or set of conditions
    is allowed and named; the difference is then the effect of that change. Source: paper, paragraph
    Replication.
    """
    if first.manifest.fingerprint != second.manifest.fingerprint:
        both = set(frames_in_common(first, second))
        if not all(
            {frame.id for frame in model.answers.frames} <= both for model in (*_models(first), *_models(second))
        ):
            raise SpecError(
                f"the runs are on different banks ({first.bank.name} and {second.bank.name}); a replication "
                f"needs the same frames, and they share {len(both)}: score both on these alone"
            )
    common = [spec for spec in first.models if spec in second.models]
    if not common:
        raise SpecError(f"the runs have no model in common: {', '.join(first.models)} and {', '.join(second.models)}")
    for which, run in (("first", first), ("second", second)):
        if stopped := [spec for spec in common if run.models[spec].stopped is not None]:
            raise SpecError(
                f"{stopped[0]} stopped early in the {which} run: its answers chose its frames, so no test can "
                "compare them; leave out --stop-early in runs to compare"
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
    """Return the frames of two runs that show the same moments in both banks.

    Raises SpecError if there are none.
    """
    frames = [{frame.id for model in _models(run) for frame in model.answers.frames} for run in (first, second)]
    moments = same_moments(first.bank.manifest, second.bank.manifest)
    if found := tuple(frame for frame in moments if frame in frames[0] & frames[1]):
        return found
    raise SpecError(
        f"the runs are on different banks ({first.bank.name} and {second.bank.name}) without a frame of equal "
        "geometry. A replication needs the same frames: 'eyechart frames check BANK OTHER' compares them"
    )


def _models(run: BatteryScore) -> Iterable[ModelScore]:
    return run.models.values()


def _apart(first: BatteryScore, second: BatteryScore) -> tuple[str, ...]:
    """Return in words how the two runs differ."""
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
        controls = [", ".join(run.models[spec].controls.controls) or "none" for run in (first, second)]
        said += [both.format(f"{spec} controls", *controls)] if controls[0] != controls[1] else []
        if not first.manifest.mode(spec).is_same_request(second.manifest.mode(spec)):
            said.append(f"{spec} had another request mode in the second run")
    for which, mine, theirs in (("first", first, second), ("second", second, first)):
        said += [f"{spec}: asked in the {which} run only" for spec in mine.models if spec not in theirs.models]
        left = {spec: unfinished(model.answered, model.planned) for spec, model in mine.models.items()}
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
"""The main statistics of a comparison: those of the paper's replication paragraph, and the like."""


def replication_table(replication: Replication, *, every: bool = False) -> Table:
    """Return a row per statistic: both values, the difference with its interval, n and p."""
    rows: list[tuple[Cell, ...]] = []
    for name, found in replication.differences.items():
        if every or name in MAIN or name in replication.changed:
            sides = (found.first, found.second) if isinstance(found, StatisticDifference) else (None, None)
            signed = found.value is not None and name not in {"across_runs", "answer_shift"}
            value = f"{found.value:+.3f}" if signed else found.value
            note = {"across_runs": "share of equal answers", "answer_shift": "distance"}.get(name, found.note)
            rows.append((name, *sides, value, *statistic_cells(found)[1:], replication.holm[name], note))
    named = (Column("statistic", "word"), *columns("number", "first", "second", "difference"), *STATISTIC[1:])
    return Table("replication", replication.model, (*named, Column("p (Holm)", "p"), Column("note")), tuple(rows))


def replications(scores: Mapping[str, BatteryScore]) -> Iterator[tuple[str, Comparison]]:
    """Yield each run's comparison with the first earlier run that it replicates, by their names.

    A replication has the same bank and prompt, and a common model. Runs that stopped early are
    skipped.
    """
    named = [(name, score) for name, score in scores.items() if not any(mine.stopped for mine in score.models.values())]
    for place, (name, later) in enumerate(named):
        for before, first in named[:place]:
            alike = [(one.manifest.fingerprint, one.manifest.prompt.key) for one in (first, later)]
            if alike[0] == alike[1] and first.models.keys() & later.models.keys():
                yield f"{before}, then {name}", compare(first, later)
                break


def replications_table(scores: Mapping[str, BatteryScore]) -> Table | None:
    """Return the statistics of replicated models in both runs; None without a replication."""
    rows, named = [], None
    for name, found in replications(scores):
        for model in found.models.values():
            table = replication_table(model)
            named = named or table.columns
            rows += [(f"{model.model} ({name})", *row) for row in table.rows]
    if named is None:
        return None
    caption = "Replication: the statistics of models in two runs, the second minus the first"
    return Table("replication", caption, (Column("model"), *named), tuple(rows))
