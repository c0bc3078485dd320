"""Compare prompts: how each changes the looking and the answers of models on the same frames."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Unpack

from eyechart.api.battery import AskedModel, _Mode, _models
from eyechart.api.reports import row_of, written_page
from eyechart.api.subjects import placed, require_arguments, require_several, still
from eyechart.compare import Comparison, compare, replication_table
from eyechart.errors import SpecError, speaks_of_arguments, whole_number
from eyechart.frames import FrameBank
from eyechart.models.prices import read_prices
from eyechart.planned_run import RunAllowance, moving
from eyechart.prompts import PROMPTS
from eyechart.records import to_json_fields
from eyechart.report.table import Table
from eyechart.run import Progress
from eyechart.studies import ReadOptions
from eyechart.studies import prompts as study
from eyechart.studies.probes import accept_losses
from eyechart.studies.prompts import Prompts, PromptSensitivity, PromptsScore, PromptStudy


@dataclass(frozen=True, repr=False)
class PromptsReport:
    """A scored prompt study: ``report["scripted:depth"]`` says under which prompts a model looks.

    ``path`` is the study's folder with a run per prompt, and ``score`` holds their statistics.
    ``against`` maps every prompt but the first to its differences from the first. Each difference
    of a statistic is over the shared frames, with an interval, and a p corrected over the
    statistics of a model. ``print`` it for the sentences.
    """

    path: Path
    score: PromptsScore
    first: str
    against: Mapping[str, Comparison]

    @property
    def models(self) -> dict[str, PromptSensitivity]:
        """Return each model's labels under every prompt, by SPEC."""
        return {sensitivity.model: sensitivity for sensitivity in study.by_model(self.score.cells)}

    @speaks_of_arguments
    def __getitem__(self, model: str) -> PromptSensitivity:
        """Return a model's labels under every prompt; raises SpecError that lists the models."""
        if model not in self.models:
            raise SpecError(f"{self.path} holds no model '{model}'; it holds {', '.join(self.models)}")
        return self.models[model]

    def __repr__(self) -> str:
        return f"<PromptsReport on {self.path}: {', '.join(f'{who}: {one.label}' for who, one in self.models.items())}>"

    def __str__(self) -> str:
        """Return in words under which prompts each model looks, and how others differ."""
        words = [
            " ".join(filter(None, (f"{who} looks: {model.label}.", model.words, model.why_not)))
            for who, model in self.models.items()
        ]
        for name, found in self.against.items():
            words += [f"{spec}, {name} against {self.first}: {model.words}." for spec, model in found.models.items()]
        return "\n".join(words)

    def table(self) -> Table:
        """Return a row per model and prompt: the answers' variety and scene dependence."""
        return study.prompts_table(self.score.cells)

    def differences(self, *, every: bool = False) -> list[Table]:
        """Return a table per model and prompt: differences in main or ``every`` statistics."""
        return [
            replace(replication_table(model, every=every), caption=f"{spec}: {name} against {self.first}")
            for name, found in self.against.items()
            for spec, model in found.models.items()
        ]

    def rows(self) -> list[dict[str, object]]:
        """Return every statistic of every model and prompt as plain values, like `Report.rows`."""
        return [
            {"prompt": cell.name, **row_of("model", cell.model, name, statistic, p_holm=cell.holm.get(name))}
            for cell in self.score.cells
            for name, statistic in cell.statistics.items()
        ]

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values: the cells of ``eyechart score --json``, and differences."""
        return self.score.as_dict() | to_json_fields(self, "first against")

    @speaks_of_arguments
    def to_html(self, out: Path | str) -> Path:
        """Write the report as one page, as ``eyechart report`` does, and return its path."""
        return written_page(lambda: Prompts().report([self.path], [], ReadOptions(), lambda *_: None).page, out)


class _ComparisonOptions(_Mode, total=False):
    """The options of a comparison: request-mode fields, and those of ``eyechart run prompts``."""

    limit: int
    seed: int
    conditions: Sequence[str]
    again: bool
    accept_loss: bool
    moved: bool


@speaks_of_arguments
def compare_prompts(
    bank: FrameBank | Path | str,
    models: Sequence[AskedModel] | AskedModel | Mapping[str, Callable[..., object]],
    prompts: Sequence[Path | str],
    out: Path | str,
    *,
    concurrency: int = 8,
    probe: bool = True,
    progress: Progress | None = None,
    **asking: Unpack[_ComparisonOptions],
) -> PromptsReport:
    """Ask models about the same frames under several prompts, and compare the results.

    ``prompts`` are names of ``eyechart list prompts`` or files; each is compared with the first.
    Each is a run in the folder ``out``, where the same call resumes. ``models``, ``probe``,
    ``concurrency``, ``again``, ``accept_loss``, ``moved``, ``progress`` and the fields of a request
    mode are those of `run_battery`. ``limit`` is the number of frames (100). ``conditions`` are
    shown for each (``real`` and ``blank``).

    Raises BankError, SpecError or LedgerError as the study's ``plan`` does, and ProbeError if a
    probe fails.
    """
    several, place = [prompts] if isinstance(prompts, str | Path) else prompts, Path(out).absolute()
    if len(several) < 2:
        raise SpecError(f"compare_prompts takes two prompts or more, see {', '.join(PROMPTS)}; got {len(several)}")
    require_arguments("compare_prompts", asking, _ComparisonOptions)
    how: dict[str, Any] = {**asking}
    at_once, again = whole_number("concurrency", concurrency, 1), how.pop("again", False)
    moved = how.pop("moved", False)
    extent: dict[str, Any] = {name: how.pop(name) for name in ("limit", "seed", "conditions") if name in how}
    extent |= {name: whole_number(name, extent[name], least) for name, least in _LEAST.items() if name in extent}
    if "conditions" in extent:
        require_several("conditions", extent["conditions"], '["real", "blank"]')
    if how.pop("accept_loss", False):
        list(accept_losses(place))
    cells = partial(study.plan, placed(bank), out=place, prompts=[*map(str, several)], **extent)
    allowed = RunAllowance(read_prices(), no_probe=not probe, concurrency=at_once, again=again, moved=moved)
    planned: PromptStudy = _models(models, how).planned(cells, study.cells_in(place), allowed)
    planned.make(allowed, moving(progress))
    return _read(still(out, place), list(planned.cells))


_LEAST = {"limit": 1, "seed": 0}


def _read(path: Path, names: Sequence[str]) -> PromptsReport:
    """Score a study, and compare its cells with the first of these names."""
    score = Prompts().score(path, ReadOptions())
    first, *others = (score.batteries[name] for name in names)
    return PromptsReport(
        path, score, names[0], {name: compare(first, one) for name, one in zip(names[1:], others, strict=True)}
    )
