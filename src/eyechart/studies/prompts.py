"""The prompt study: what each of several prompts does to the diversity and grounding of answers.

All prompts get the same frames and models. A cell is a battery of real and blank pictures; it is
resumed, accounted for and scored like any other battery. Source: paper, section Prompt formulation
gates measured grounding and Table t:prompts.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from eyechart.costs import ALL, Account
from eyechart.errors import LedgerError, SpecError, counted, listed
from eyechart.integrity import Guard, unfinished
from eyechart.limits import RunOutcome
from eyechart.manifest import is_run
from eyechart.models import OpenedModel
from eyechart.models.prices import Prices, read_prices
from eyechart.modes import RequestMode
from eyechart.planned_run import Bar, PlannedRun, RunAllowance, RunEnding, calls_ended, empty, forecast, moving
from eyechart.prompts import PROMPTS
from eyechart.records import to_json_fields
from eyechart.report.accounts import costs_table
from eyechart.report.table import (
    MARK,
    Cell,
    Column,
    Mark,
    Table,
    columns,
    estimate,
    marked,
    number,
    p_value,
    stack_tables,
)
from eyechart.run import Progress
from eyechart.stats.agreement import rate
from eyechart.stats.resamples import holm
from eyechart.stats.statistic import ModelStatistics, Statistic, not_available
from eyechart.studies import NO_DRIVES, ModelSummary, ReadOptions, StudyReport, Tell, battery, run_json
from eyechart.studies.battery import FrameStudy
from eyechart.studies.probes import beside
from eyechart.verdicts.labels import PROMPTED, Label
from eyechart.verdicts.rules import Axis, Rule, compared, p_below

if TYPE_CHECKING:
    from eyechart.probe import Sample
    from eyechart.report.page import Grid, PageSummary

FRAMES = 100
"""Frames per cell, each shown real and blank: the paper's 100 queries and the same 100 blank."""

NO_FLOOR = "s and IDI_adj need the same picture twice: run with --conditions real,real_repeat,blank"

_ALIKE = ("study", "models", "fingerprint", "conditions", "limit", "seed")
"""The fields that the manifests of all cells of one study share."""
CONDITIONS = ("real", "blank")
LEVEL = 0.05
"""A corrected p below this is called significant at the head of the page."""

DEPENDENCE = ("mutual_information", "obstacle", "cramers_v_real_blank")
"""The tests of scene dependence; each p is corrected over the cells of its model."""


@dataclass(frozen=True)
class PromptStudy(PlannedRun):
    """A prompt study, planned but not yet run: one battery per cell, by the name of its folder."""

    cells: Mapping[str, battery.Battery]
    out: Path

    @property
    def keeper(self) -> battery.Battery:
        """Return the first cell."""
        return next(iter(self.cells.values()))

    def sample(self) -> "Sample":
        """Return a sample of the cells' queries, with the prompt of each."""
        return battery.sample_of(self.cells.values())

    def lines(self, how: RunAllowance) -> Iterator[str]:
        """Yield how many cells and calls there are, and the expected cost of each cell."""
        calls, finished, unknown = self.counts()
        more = sum(sum(cell.more_by_model().values()) for cell in self.cells.values())
        up_to = f", and up to {more} of controls" if more else ""
        size = f"{counted(len(self.cells), 'cell')} × {counted(len(self.keeper.models), 'model')}"
        sent = f"{counted(calls, 'call')}, {finished} finished, {unknown} sent with unknown outcome"
        yield f"{size}: {sent}, {calls - finished} to make{up_to}"
        for name, cell in self.cells.items():
            for one in battery.expected(cell, how.prices, concurrency=how.concurrency):
                yield f"{name}: {one.words}"
        yield from forecast(self.keeper.manifest, self.keeper.models, (), how)

    def make(self, how: RunAllowance, bar: Bar) -> RunOutcome:
        """Make the remaining calls, cell after cell, within limits for all cells together.

        Returns the models set aside in any cell, and the limit that stopped the run, if one did.
        """
        planned = {name: cell.counts()[0] for name, cell in self.cells.items()}
        start, total, uncounted = 0, sum(planned.values()), 0
        set_aside, lasting = dict[str, str](), frozenset[str]()
        with bar("calls", self.unit) as tell:
            for name, cell in self.cells.items():

                def move(done: int, now: int, start: int = start, mine: int = planned[name]) -> None:
                    tell(start + done, total + now - mine)

                outcome = cell.make(beside(cells_in(self.out), cell, how), moving(move))
                uncounted = max(uncounted, outcome.uncounted)
                set_aside |= {f"{spec} in {name}": why for spec, why in outcome.set_aside.items()}
                lasting |= {f"{spec} in {name}" for spec in outcome.lasting}
                if outcome.stopped is not None and cell.left():
                    bounds = {"--max-calls": how.max_calls, "--max-cost": how.max_cost}
                    words = " and ".join(f"{option} {bound:g}" for option, bound in bounds.items() if bound is not None)
                    stopped = f"in cell {name}, within {words} for all cells"
                    return RunOutcome(set_aside, stopped, uncounted, lasting=lasting)
                start += planned[name]
        return RunOutcome(set_aside, None, uncounted, lasting=lasting)

    def ends(self, outcome: RunOutcome, failed: Mapping[str, str]) -> Iterator[RunEnding]:
        """Yield how the calls ended, and which models gave empty replies."""
        calls, finished, _ = self.counts()
        yield calls_ended(outcome, failed, calls - finished)
        yield empty(cells_in(self.out))

    def counts(self) -> tuple[int, int, int]:
        """Return how many calls of all cells are planned, finished, and of unknown outcome."""
        planned, finished, unknown = zip(*(cell.counts() for cell in self.cells.values()), strict=True)
        return sum(planned), sum(finished), sum(unknown)


@dataclass(frozen=True, slots=True)
class Factor:
    """A request setting that varies beside the prompt; None leaves a model's mode unchanged."""

    max_tokens: int | None = None
    structured: str | None = None

    def applied(self, mode: RequestMode | OpenedModel) -> RequestMode | OpenedModel:
        """Return a model's mode under this setting, without token and time measurements.

        A model that is already open keeps its mode.
        """
        if isinstance(mode, OpenedModel):
            return mode
        changed = {name: value for name in self.__slots__ if (value := getattr(self, name)) is not None}
        tokens = ("completion_tokens", "completion_tokens_max", "reasoning_tokens")
        lost: dict[str, Any] = dict.fromkeys((*tokens, "seconds", "seconds_min"))
        measured = None if mode.measured is None else replace(mode.measured, **lost)
        return replace(mode, measured=measured, **changed) if changed else mode

    @property
    def suffix(self) -> str:
        """Return the suffix of the cell's folder name after the prompt's name."""
        return "".join(f"--{value}" for value in (self.max_tokens, self.structured) if value is not None)


def plan(
    bank_path: Path,
    specs: Sequence[str | RequestMode | OpenedModel],
    out: Path,
    *,
    prompts: Sequence[str] = tuple(PROMPTS),
    factors: Sequence[Factor] = (Factor(),),
    conditions: Sequence[str] = CONDITIONS,
    limit: int | None = FRAMES,
    seed: int = 0,
) -> PromptStudy:
    """Plan every cell, or the rest of a study in ``out``; writes nothing and makes no call.

    ``prompts`` are names or TOML files, ``factors`` the settings crossed with them, ``limit`` the
    frames per cell, the same in each. Raises what `battery.plan` raises, and SpecError where two
    cells would be the same.
    """
    modes = [RequestMode(spec) if isinstance(spec, str) else spec for spec in specs]
    cells: dict[str, battery.Battery] = {}
    for prompt in prompts:
        for factor in factors:
            name = f"{Path(prompt).stem if prompt.endswith('.toml') else prompt}{factor.suffix}"
            if name in cells:
                raise SpecError(f"the cell '{name}' is given twice; give each prompt and setting once")
            applied = [factor.applied(mode) for mode in modes]
            cells[name] = battery.plan(
                bank_path,
                applied,
                out / name,
                prompt=prompt,
                conditions=conditions,
                seed=seed,
                extent=battery.BatterySelection(limit),
            )
    if not cells:
        raise SpecError("a prompt study needs at least one prompt, see 'eyechart list prompts'")
    return PromptStudy(cells, out)


def cells_in(out: Path) -> list[Path]:
    """Return the folders of the cells that are begun."""
    return [path for path in sorted(out.iterdir()) if is_run(path)] if out.is_dir() else []


def _asked_in(out: Path) -> list[Path]:
    """Return the folders of the cells with at least one model in their manifest."""
    return [cell for cell in cells_in(out) if run_json(cell).get("models")]


def _read_cells(folder: Path) -> list[Mapping[str, object]]:
    """Return the manifests of a folder's runs; empty where one cannot be read (scoring says so)."""
    try:
        return [run_json(one) for one in _asked_in(folder)] if not is_run(folder) else []
    except LedgerError:
        return []


def is_study(folder: Path) -> bool:
    """Return whether a folder's runs are the cells of one study.

    Cells have the same models and frames, and no two have the same prompt and modes.
    """
    cells = _read_cells(folder)
    alike = {json.dumps([cell.get(name) for name in _ALIKE], sort_keys=True) for cell in cells}
    return len(alike) == 1 < len(cells) == len({repr([cell.get("prompt"), cell.get("modes")]) for cell in cells})


def may_be_study(folder: Path) -> bool:
    """Return whether runs in a folder may be cells of one study that have different models.

    Each cell has a prompt of its own.
    """
    cells = _read_cells(folder)
    alike = {json.dumps([cell.get(name) for name in _ALIKE if name != "models"], sort_keys=True) for cell in cells}
    return len(alike) == 1 < len(cells) == len({repr(cell.get("prompt")) for cell in cells})


def run(
    study: PromptStudy,
    *,
    calls: int | None = None,
    cost_usd: float | None = None,
    prices: Prices | None = None,
    progress: Progress | None = None,
    **how: Any,  # noqa: ANN401 - those of RunAllowance
) -> RunOutcome:
    """Make the remaining calls, cell after cell; run it again to resume a cut study.

    ``calls`` and ``cost_usd`` limit the requests and the cost of all cells together, earlier days
    included. With ``again``, each cell first repeats its calls that failed in transport.
    ``sequential`` is that of `battery.run`.
    """
    allowed = RunAllowance(prices or read_prices(), max_calls=calls, max_cost=cost_usd, **how)
    return study.make(allowed, moving(progress))


@dataclass(frozen=True)
class CellScore:
    """One model under one prompt and setting; ``holm`` has each p corrected over the model's cells.

    ``took`` is the cost of its calls; ``guards`` say whether the calls can be relied on.
    """

    name: str
    model: str
    prompt: str
    max_tokens: int
    structured: str
    planned: int
    answered: int
    statistics: Mapping[str, Statistic]
    holm: Mapping[str, float | None]
    took: Account
    guards: tuple[Guard, ...]

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        names = "model prompt max_tokens structured planned answered statistics holm guards"
        return to_json_fields(self, names, cell=self.name, accounting=self.took)

    @property
    def state(self) -> str:
        """Return how far an unfinished cell is, in words; empty where it is finished."""
        return unfinished(self.answered, self.planned)

    @property
    def marks(self) -> tuple[str, ...]:
        """Return the guards that failed, in words: with one of them the cell is not reliable."""
        return tuple(guard.mark for guard in self.guards if guard.holds is False)

    @cached_property
    def label(self) -> Label:
        """Return the label that says whether the answers depend on the scene."""
        found = {name: replace(self.statistics[name], p=self.holm[name]) for name in DEPENDENCE}
        return PROMPTED[CELLS.evaluate({**self.statistics, **found}).label]


def score(path: Path, *, resamples: int = 5000, reread: bool = False) -> tuple[CellScore, ...]:
    """Score every cell of a study, finished or not, by model and in the built-in prompts' order.

    Raises LedgerError where the folder holds no study, or cells of several banks.
    """
    return _of_batteries(_batteries(path, resamples=resamples, reread=reread))


def _batteries(path: Path, *, resamples: int, reread: bool) -> dict[str, battery.BatteryScore]:
    """Return each cell's battery score by the cell's name, in the order of the built-in prompts."""
    if is_run(path) or not (cells := _asked_in(path)):
        raise LedgerError(f"{path} holds no prompt study; 'eyechart run prompts' makes one")
    scored = {cell.name: battery.score(cell, resamples=resamples, reread=reread) for cell in cells}
    if len({one.manifest.fingerprint for one in scored.values()}) > 1:
        raise LedgerError(f"{path} holds cells on several banks, whose numbers cannot be compared")
    order = {name: place for place, name in enumerate(PROMPTS)}
    places = {name: order.get(one.manifest.prompt.name, len(order)) for name, one in scored.items()}
    return {name: scored[name] for name in sorted(scored, key=lambda name: (places[name], name))}


def _of_batteries(scored: Mapping[str, battery.BatteryScore]) -> tuple[CellScore, ...]:
    models = dict.fromkeys(spec for one in scored.values() for spec in one.models)
    return tuple(cell for spec in models for cell in _of_model(spec, list(scored.items())))


def _of_model(spec: str, named: Sequence[tuple[str, battery.BatteryScore]]) -> list[CellScore]:
    scored = [(name, one) for name, one in named if spec in one.models]
    found = [_statistics(one.models[spec]) for _, one in scored]
    corrected = {test: holm([statistics[test].p for statistics in found]) for test in DEPENDENCE}
    return [
        CellScore(
            name=name,
            model=spec,
            prompt=one.manifest.prompt.key,
            max_tokens=one.manifest.mode(spec).max_tokens,
            structured=one.manifest.mode(spec).structured,
            planned=one.models[spec].planned,
            answered=one.models[spec].answered,
            statistics=statistics,
            holm={test: corrected[test][place] for test in DEPENDENCE},
            took=one.accounting[spec][ALL],
            guards=one.guards[spec],
        )
        for place, ((name, one), statistics) in enumerate(zip(scored, found, strict=True))
    ]


def _statistics(score: battery.ModelScore) -> dict[str, Statistic]:
    """Return a cell's numbers: the diversity of its outputs, and its scene dependence.

    Diversity counts UNPARSED as an output of its own, as the paper's Table t:prompts does: a cell
    with five actions has six outputs.
    """
    outputs = score.answers.responses("real")
    names, counts = np.unique(outputs[outputs != ""], return_counts=True)
    n = int(counts.sum())
    if n:
        modal = rate(int(counts.max()), n)
        distinct = Statistic(float(len(names)), n, method="distinct outputs on real pictures, UNPARSED among them")
    else:
        modal = distinct = not_available("no answers to real pictures")
    statistics = score.statistics
    return {
        "modal_share": modal,
        "distinct_outputs": distinct,
        **{name: statistics[name] for name in ("idi", "noise_floor", "idi_adj")},
        "unparsed_rate": statistics["unparsed_rate"],
        **{name: statistics[name] for name in DEPENDENCE},
    }


def prompts_table(cells: Sequence[CellScore]) -> Table:
    """Return Table t:prompts: the diversity of the answers, and their scene dependence."""
    note = (
        "n_a: distinct outputs, UNPARSED among them. Diversity is not scene dependence. V (real against blank) and "
        "I(A;g) in bits measure scene dependence; p is corrected by Holm over these cells. — cannot say"
    )
    rows = []
    for cell in cells:
        statistics = cell.statistics
        who = (cell.model, Mark(cell.name, "", MARK if cell.marks else ""))
        numbers = [statistics[name].value for name in ("unparsed_rate", "cramers_v_real_blank", "mutual_information")]
        diversity = (statistics["modal_share"], statistics["distinct_outputs"].value, statistics["idi"])
        p, calls = cell.holm["mutual_information"], f"{cell.answered}/{cell.planned}"
        rows.append((*who, *diversity, *numbers, p, calls))
    named = (
        Column("model"),
        Column("cell", "word"),
        Column("modal share", "estimate", 2),
        Column("n_a", "number", 0),
        Column("IDI", "estimate", 2),
        *columns("number", "unparsed", "V", "I(A;g)"),
        Column("p", "p"),
        Column("calls", "count"),
    )
    return Table("prompts", "Table t:prompts", named, tuple(rows), note)


def paper_table(scores: Mapping[str, Sequence[CellScore]]) -> Table:
    """Return Table t:prompts in the paper's form, for cells by study, a row per cell."""
    table = stack_tables({name: _as_published(cells) for name, cells in scores.items()})
    counts = [cell.statistics["modal_share"].n for cells in scores.values() for cell in cells]
    return table.counted(counts, "queries", "with the real picture per cell").labelled("t:prompts")


def _as_published(cells: Sequence[CellScore]) -> Table:
    names = ("modal_share", "distinct_outputs", "idi", "noise_floor", "idi_adj")
    rows: tuple[tuple[Cell, ...], ...] = tuple(
        (cell.model, cell.name, *(cell.statistics[name] for name in names)) for cell in cells
    )
    named = (
        *(Column("model"), Column("prompt", "word"), Column("modal", "estimate", 2, beside="")),
        *(Column("n_a", "estimate", 0, beside=""), *columns("estimate", "IDI", "s", "IDI_adj", digits=2, beside="")),
    )
    caption = "Prompt ablation. Modal share 1.00 is a constant policy; n_a is the number of distinct outputs"
    lacking = any(cell.statistics["noise_floor"].value is None for cell in cells)
    return Table("", caption, named, rows, NO_FLOOR if lacking else "")


@dataclass(frozen=True)
class PromptsScore:
    """Every cell of a prompt study, by model, and their ``batteries`` by name."""

    cells: tuple[CellScore, ...]
    batteries: Mapping[str, battery.BatteryScore]

    def measured(self) -> tuple[ModelStatistics, ...]:
        """Return the statistics of every model under every prompt and setting."""
        return tuple(
            replace(each, where=f"{each.where} under {name}")
            for name, one in self.batteries.items()
            for each in one.measured()
        )

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        return {"study": "prompts", "cells": [cell.as_dict() for cell in self.cells]}


CELLS = Axis(
    "prompts",
    (
        Rule("gap", "mutual_information", (p_below("mutual_information", LEVEL),)),
        Rule("picture", "cramers_v_real_blank", (p_below("cramers_v_real_blank", LEVEL),)),
        Rule("one_answer", "distinct_outputs", (compared("distinct_outputs", "value", "<=", 1.0),)),
        Rule("no_link", "mutual_information"),
    ),
)
"""The labels of a cell's scene dependence; each p is corrected over the cells of its model."""
_GRID = "Bits of the answer about the gap. ● significant; ◐ only a picture from a blank; ○ one answer; ? no link"


@dataclass(frozen=True)
class PromptSensitivity:
    """One model under every prompt, and the prompts under which its answers depend on the gap."""

    model: str
    cells: tuple[CellScore, ...]

    @property
    def seeing(self) -> list[CellScore]:
        """Return the cells whose answers depend on the gap."""
        return [cell for cell in self.cells if cell.label.family == "sees"]

    @property
    def tone(self) -> str:
        """Return "sees" if it looks under every prompt, "partly" if under some.

        "blind" means one answer to every picture. In a cell where no link is shown there may still
        be one: "open".
        """
        tones = {cell.label.family for cell in self.cells}
        if "sees" in tones:
            return "sees" if tones == {"sees"} else "partly"
        return "blind" if tones == {"blind"} else "open"

    @property
    def label(self) -> str:
        """Return in words under which prompts it looks."""
        mine, every = [one.name for one in self.seeing], len(self.cells)
        if not mine:
            return "under none is it shown" if self.tone == "open" else "under none"
        if len(mine) == every:
            return f"all {_NUMBERS.get(every, every)}" if every > 1 else f"under {mine[0]}"
        return f"{listed(mine)} only" if len(mine) <= _MOST_NAMED else f"{len(mine)} of {every} prompts"

    @property
    def words(self) -> str:
        """Return the largest information about the gap in its answers, and the prompt."""
        best = self.best
        found, modal = best.statistics["mutual_information"], best.statistics["modal_share"]
        often = "—" if modal.value is None else f"{100 * modal.value:.0f} %"
        p = p_value(best.holm["mutual_information"])
        return (
            f"Under {best.name} its answers tell {estimate(found)} bits of the gap (p {p}, n {found.n}), and {often} "
            f"of {modal.n} frames get its most frequent answer."
        )

    @property
    def best(self) -> CellScore:
        """Return the cell with the smallest p for the gap, the first of several equal ones."""
        return min(self.cells, key=lambda cell: 2.0 if (p := cell.holm["mutual_information"]) is None else p)

    @property
    def why_not(self) -> str:
        """Return why it is not shown to look under more prompts; empty if it looks under all."""
        rest = [cell for cell in self.cells if cell not in self.seeing]
        sentences = []
        for tone in ("partly", "blind", "open"):
            mine = [cell for cell in rest if cell.label.family == tone]
            if not mine:
                continue
            least = min(mine, key=lambda cell: 2.0 if (p := cell.holm["mutual_information"]) is None else p)
            p = p_value(least.holm["mutual_information"])
            n = max(cell.statistics["mutual_information"].n for cell in mine)
            sentences.append(f"Under {listed([cell.name for cell in mine])} {_WHY[tone].format(p=p, n=n)}.")
        if open_cells := [cell for cell in rest if cell.label.family != "blind"]:
            n = max(open_cell.statistics["mutual_information"].n for open_cell in open_cells)
            sentences.append(f"More than {n} frames may show a weaker link.")
        return " ".join(sentences)


_MOST_LISTED = 4
"""The most models that the sentence at the head of a page names one by one."""
_NUMBERS = {2: "two", 3: "three", 4: "four", 5: "five", 6: "six"}
_MOST_NAMED = 3
_WHY = {
    "partly": "it tells a picture from a blank, but no link to the gap is shown (smallest p {p} after Holm, n {n})",
    "blind": "it gives one answer to every picture",
    "open": "no link to its pictures is shown (smallest p {p} after Holm, n {n})",
}


def by_model(cells: Sequence[CellScore]) -> list[PromptSensitivity]:
    """Return the cells of each model together."""
    models = dict.fromkeys(cell.model for cell in cells)
    return [PromptSensitivity(spec, tuple(cell for cell in cells if cell.model == spec)) for spec in models]


_CELLS = "is a prompt study, with one run per cell: name a cell, as RUN/CELL"


def _sentence(everyone: Mapping[str, PromptSensitivity]) -> str:
    """Return in one sentence under which prompts each model looks; for many models, only counts."""
    if len(everyone) <= _MOST_LISTED:
        return "; ".join(f"{who}: {sensitivity.label}" for who, sensitivity in everyone.items()) + "."
    tones = [sensitivity.tone for sensitivity in everyone.values()]
    phrases = {
        "sees": "under every prompt",
        "partly": "under some",
        "blind": "under none",
        "open": "not shown for",
    }
    parts = [f"{words} {tones.count(tone)}" for tone, words in phrases.items() if tone in tones]
    return f"Of {len(tones)} models look {'; '.join(parts)}."


def _grid(everyone: Mapping[str, PromptSensitivity]) -> "Grid":
    """Return a grid of prompts and models: each cell's information about the gap."""
    from eyechart.report.page import Grid  # noqa: PLC0415 - a score needs no templates

    names = list(dict.fromkeys(cell.name for sensitivity in everyone.values() for cell in sensitivity.cells))
    rows = []
    for name in names:
        cells = [
            next((cell for cell in sensitivity.cells if cell.name == name), None) for sensitivity in everyone.values()
        ]
        rows.append((name, [None if cell is None else _cell_words(cell) for cell in cells]))
    return Grid("prompt", list(everyone), rows)


def _cell_words(cell: CellScore) -> tuple[str, str, str]:
    return cell.label.family, number(cell.statistics["mutual_information"].value, 2), cell.label.says


class Prompts(FrameStudy[PromptsScore]):
    """One battery per prompt and setting, each in a folder of its own."""

    names = ()
    runs_are = "prompts"
    counted = ("look under every prompt", "model")
    question = "Under which prompt does a model look?"
    refuses: ClassVar = {
        **NO_DRIVES,
        **dict.fromkeys(("verdict", "gate", "compare"), _CELLS),
    }

    def holds(self, folder: Path) -> bool:
        """Return whether a folder is not a run itself but holds at least one run."""
        return not is_run(folder) and bool(cells_in(folder))

    def runs(self, folder: Path) -> Mapping[str, Path]:
        """Return the cells."""
        return {cell.name: cell for cell in _asked_in(folder)}

    def score(self, folder: Path, reading: ReadOptions) -> PromptsScore:
        """Score every cell."""
        found = _batteries(folder, reread=reading.reread, resamples=reading.resamples)
        if (prices := reading.prices) is not None:
            priced = {name: self.took_run(folder / name, prices).accounts for name in found}
            found = {name: replace(one, accounting=priced[name]) for name, one in found.items()}
        return PromptsScore(_of_batteries(found), found)

    def whole(self, folder: Path, reading: ReadOptions, tell: Tell) -> tuple[PromptsScore, StudyReport]:
        """Return the score and the report of a bundled study."""
        return self.score(folder, reading), self.report([folder], [], reading, tell)

    def findings(self, score: PromptsScore) -> Mapping[str, ModelSummary]:
        """Return under which prompts each model looks, by the cell with the smallest p."""
        result = {}
        for sensitivity in by_model(score.cells):
            by, marks = (
                f"mutual_information, {sensitivity.best.name}",
                [mark for cell in sensitivity.cells for mark in cell.marks],
            )
            label = sensitivity.label if sensitivity.label.startswith("under") else f"under {sensitivity.label}"
            state = next((cell.state for cell in sensitivity.cells if cell.state), "")
            estimated = sensitivity.best.statistics["mutual_information"]
            result[sensitivity.model] = ModelSummary(
                f"looks {label}", sensitivity.tone, by, estimated, state, tuple(dict.fromkeys(marks))
            )
        return result

    def answer(self, scores: Mapping[str, PromptsScore]) -> "PageSummary":
        """Return under which prompts each model looks, and a grid of models and prompts."""
        from eyechart.report.page import MOST_SAID, PageSummary, VerdictSummary  # noqa: PLC0415 - a score needs no templates

        everyone = {
            f"{name} · {sensitivity.model}" if len(scores) > 1 else sensitivity.model: sensitivity
            for name, score in scores.items()
            for sensitivity in by_model(score.cells)
        }
        said = []
        for who, one in everyone.items():
            state = next((cell.state for cell in one.cells if cell.state), "")
            beware = "not to be relied on" if any(cell.marks for cell in one.cells) else state
            said.append(VerdictSummary(who, one.label, one.tone, one.words, one.why_not, "part-1", beware))
        shown = dict(list(everyone.items())[:MOST_SAID])
        more = f" {len(everyone) - len(shown)} more models stand below." if len(everyone) > len(shown) else ""
        return PageSummary(_sentence(everyone), said, grid=_grid(shown), caption=f"{_GRID}.{more}")

    def paper(self, runs: Sequence[Path], banks: Sequence[Path], reading: ReadOptions, tell: Tell) -> Iterator[Table]:
        """Yield Table t:prompts of all studies."""
        del banks
        yield paper_table({name: one.cells for name, one in self.scored(runs, reading, tell)})

    def printed(self, score: PromptsScore) -> Iterator[Table | str]:
        """Yield a table per model, the marks of its cells, and the cost of each."""
        yield from prompts_table(score.cells).split()
        for cell in score.cells:
            yield from marked(f"{cell.model} in {cell.name}", (*filter(None, [cell.state]), *cell.marks))
        yield costs_table({f"{cell.model} in {cell.name}": {ALL: cell.took} for cell in score.cells}, every=False)
