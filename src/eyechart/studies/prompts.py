"""The prompt study: the same frames and models under several prompts, and what each does to diversity and to grounding.

A cell is a battery of its own, of real and blank pictures, so that it resumes, is accounted for and is scored like any.
Source: paper, section Prompt formulation gates measured grounding and Table t:prompts.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from eyechart.costs import ALL, Account
from eyechart.errors import LedgerError, SpecError, counted
from eyechart.integrity import Guard, unfinished
from eyechart.limits import Outcome
from eyechart.manifest import is_run
from eyechart.models import Opened
from eyechart.models.prices import Prices, read_prices
from eyechart.modes import RequestMode
from eyechart.planned import Allowed, Bar, Ending, Planned, calls_ended, empty, forecast, moving
from eyechart.prompts import PROMPTS
from eyechart.records import Written
from eyechart.report.accounts import costs_table
from eyechart.report.table import MARK, Cell, Column, Mark, Table, columns, estimate, marked, number, p_value, stacked
from eyechart.run import Progress
from eyechart.stats.agreement import rate
from eyechart.stats.resampling import holm
from eyechart.stats.statistic import Measured, Statistic, cannot_say
from eyechart.studies import NO_DRIVES, Finding, Made, Reading, Tell, battery, run_json
from eyechart.studies.battery import OfFrames
from eyechart.studies.probed import beside
from eyechart.verdicts.labels import PROMPTED, Label
from eyechart.verdicts.rules import Axis, Rule, compared, p_below

if TYPE_CHECKING:
    from eyechart.probe import Sample
    from eyechart.report.page import Grid, Opening

FRAMES = 100
"""Frames a cell, each shown real and blank: the paper's 100 queries, and the same 100 blank."""

NO_FLOOR = "s and IDI_adj need the same picture twice: ask for it with --conditions real,real_repeat,blank"

_ALIKE = ("study", "models", "fingerprint", "conditions", "limit", "seed")
"""What the manifests of the cells of one study have in common."""
CONDITIONS = ("real", "blank")
LEVEL = 0.05
"""Below it a corrected p is called significant at the head of the page."""

DEPENDENCE = ("mutual_information", "obstacle", "cramers_v_real_blank")
"""What a cell says of scene dependence, which diversity is not; each p is corrected over the cells of its model."""


@dataclass(frozen=True)
class PromptStudy(Planned):
    """A prompt study that was planned and not yet run: one battery a cell, by the name of its folder."""

    cells: Mapping[str, battery.Battery]
    out: Path

    @property
    def keeper(self) -> battery.Battery:
        """Return the first cell."""
        return next(iter(self.cells.values()))

    def sample(self) -> "Sample":
        """Return what the cells will ask, with the prompt of each."""
        return battery.sample_of(self.cells.values())

    def lines(self, how: Allowed) -> Iterator[str]:
        """Yield how many cells and calls there are, and what each cell is expected to take."""
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

    def make(self, how: Allowed, bar: Bar) -> Outcome:
        """Make the calls that are left, cell after cell, in limits of all cells together.

        Returns what was set aside in any cell, and the limit that stopped it, if one did.
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
                    words = " and ".join(f"{option} {one:g}" for option, one in bounds.items() if one is not None)
                    stopped = f"in cell {name}, within {words} for all cells"
                    return Outcome(set_aside, stopped, uncounted, lasting=lasting)
                start += planned[name]
        return Outcome(set_aside, None, uncounted, lasting=lasting)

    def ends(self, outcome: Outcome, failed: Mapping[str, str]) -> Iterator[Ending]:
        """Yield how the calls ended, and whose replies are empty."""
        calls, finished, _ = self.counts()
        yield calls_ended(outcome, failed, calls - finished)
        yield empty(cells_in(self.out))

    def counts(self) -> tuple[int, int, int]:
        """Return how many calls are planned, finished, and sent with unknown outcome, over all cells."""
        planned, finished, unknown = zip(*(cell.counts() for cell in self.cells.values()), strict=True)
        return sum(planned), sum(finished), sum(unknown)


@dataclass(frozen=True, slots=True)
class Factor:
    """A setting of the request that the study varies beside the prompt: None leaves a model's mode as it is."""

    max_tokens: int | None = None
    structured: str | None = None

    def applied(self, mode: RequestMode | Opened) -> RequestMode | Opened:
        """Return a model's mode under this setting; what replies took under another is not kept.

        A model that is open already is asked as it was opened.
        """
        if isinstance(mode, Opened):
            return mode
        changed = {name: value for name in self.__slots__ if (value := getattr(self, name)) is not None}
        tokens = ("completion_tokens", "completion_tokens_max", "reasoning_tokens")
        lost: dict[str, Any] = dict.fromkeys((*tokens, "seconds", "seconds_min"))
        measured = None if mode.measured is None else replace(mode.measured, **lost)
        return replace(mode, measured=measured, **changed) if changed else mode

    @property
    def suffix(self) -> str:
        """Return what tells the cell's folder from that of the prompt alone."""
        return "".join(f"--{value}" for value in (self.max_tokens, self.structured) if value is not None)


def plan(
    bank_path: Path,
    specs: Sequence[str | RequestMode | Opened],
    out: Path,
    *,
    prompts: Sequence[str] = tuple(PROMPTS),
    factors: Sequence[Factor] = (Factor(),),
    conditions: Sequence[str] = CONDITIONS,
    limit: int | None = FRAMES,
    seed: int = 0,
) -> PromptStudy:
    """Plan every cell, or the rest of a study that ``out`` holds already; nothing is written or asked yet.

    ``prompts`` are names or TOML files, ``factors`` the settings that are crossed with them, ``limit`` the frames a
    cell, the same in each. Raises what `battery.plan` raises, and SpecError where two cells would be the same.
    """
    modes = [RequestMode(one) if isinstance(one, str) else one for one in specs]
    cells: dict[str, battery.Battery] = {}
    for prompt in prompts:
        for factor in factors:
            name = f"{Path(prompt).stem if prompt.endswith('.toml') else prompt}{factor.suffix}"
            if name in cells:
                raise SpecError(f"the cell '{name}' is asked for twice; give each prompt and setting once")
            asked = [factor.applied(mode) for mode in modes]
            cells[name] = battery.plan(
                bank_path,
                asked,
                out / name,
                prompt=prompt,
                conditions=conditions,
                seed=seed,
                extent=battery.Extent(limit),
            )
    if not cells:
        raise SpecError("a prompt study needs at least one prompt, see 'eyechart list prompts'")
    return PromptStudy(cells, out)


def cells_in(out: Path) -> list[Path]:
    """Return the folders of a study's cells, as far as they are begun."""
    return [one for one in sorted(out.iterdir()) if is_run(one)] if out.is_dir() else []


def _asked_in(out: Path) -> list[Path]:
    """Return the folders of the cells in which a model was asked, and not only how it is to be asked."""
    return [one for one in cells_in(out) if run_json(one).get("models")]


def _read_cells(folder: Path) -> list[Mapping[str, object]]:
    """Return what the runs in a folder say of themselves; none where one cannot be read, which its scoring says."""
    try:
        return [run_json(one) for one in _asked_in(folder)] if not is_run(folder) else []
    except LedgerError:
        return []


def is_study(folder: Path) -> bool:
    """Return whether a folder's runs are the cells of one study: the same models and frames, each asked otherwise."""
    cells = _read_cells(folder)
    alike = {json.dumps([one.get(name) for name in _ALIKE], sort_keys=True) for one in cells}
    return len(alike) == 1 < len(cells) == len({repr([one.get("prompt"), one.get("modes")]) for one in cells})


def may_be_study(folder: Path) -> bool:
    """Return whether runs in a folder may be cells of one study that ask other models: each has a prompt of its own."""
    cells = _read_cells(folder)
    alike = {json.dumps([one.get(name) for name in _ALIKE if name != "models"], sort_keys=True) for one in cells}
    return len(alike) == 1 < len(cells) == len({repr(one.get("prompt")) for one in cells})


def run(
    study: PromptStudy,
    *,
    calls: int | None = None,
    cost_usd: float | None = None,
    prices: Prices | None = None,
    progress: Progress | None = None,
    **how: Any,  # noqa: ANN401 - those of Allowed
) -> Outcome:
    """Make the calls that are left, cell after cell; a cut study is resumed by running it again.

    ``calls`` and ``cost_usd`` bound the requests and the cost of all cells together, those of earlier days included.
    With ``again``, those of each cell that ended in a failure of the road are made once more before its others.
    ``sequential`` is that of `battery.run`.
    """
    allowed = Allowed(prices or read_prices(), max_calls=calls, max_cost=cost_usd, **how)
    return study.make(allowed, moving(progress))


@dataclass(frozen=True)
class CellScore(Written):
    """One model under one prompt and setting. ``holm`` maps a test to its p corrected over the model's cells.

    ``took`` says what its calls took, ``guards`` whether they are to be believed.
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
    written = "cell=name model prompt max_tokens structured planned answered statistics holm accounting=took guards"

    @property
    def state(self) -> str:
        """Return in words how far a cell is that is not finished; empty where it is."""
        return unfinished(self.answered, self.planned)

    @property
    def marks(self) -> tuple[str, ...]:
        """Return the guards that failed, in words: with one of them the cell is not to be relied on."""
        return tuple(guard.mark for guard in self.guards if guard.holds is False)

    @cached_property
    def label(self) -> Label:
        """Return what its answers hold of the scene."""
        found = {name: replace(self.statistics[name], p=self.holm[name]) for name in DEPENDENCE}
        return PROMPTED[CELLS.evaluate({**self.statistics, **found}).label]


def score(path: Path, *, resamples: int = 5000, reread: bool = False) -> tuple[CellScore, ...]:
    """Score every cell of a study, finished or not: by model, and in the order of the built-in prompts.

    Raises LedgerError where the folder holds no study, or cells of several banks.
    """
    return _of_batteries(_batteries(path, resamples=resamples, reread=reread))


def _batteries(path: Path, *, resamples: int, reread: bool) -> dict[str, battery.BatteryScore]:
    """Return what each cell's run shows, by the cell's name, in the order of the built-in prompts."""
    if is_run(path) or not (cells := _asked_in(path)):
        raise LedgerError(f"{path} holds no prompt study; 'eyechart run prompts' makes one")
    scored = {one.name: battery.score(one, resamples=resamples, reread=reread) for one in cells}
    if len({one.manifest.fingerprint for one in scored.values()}) > 1:
        raise LedgerError(f"{path} holds cells on several banks, whose numbers cannot stand side by side")
    order = {name: place for place, name in enumerate(PROMPTS)}
    places = {name: order.get(one.manifest.prompt.name, len(order)) for name, one in scored.items()}
    return {name: scored[name] for name in sorted(scored, key=lambda name: (places[name], name))}


def _of_batteries(scored: Mapping[str, battery.BatteryScore]) -> tuple[CellScore, ...]:
    models = dict.fromkeys(spec for one in scored.values() for spec in one.models)
    return tuple(cell for spec in models for cell in _of_model(spec, list(scored.items())))


def _of_model(spec: str, named: Sequence[tuple[str, battery.BatteryScore]]) -> list[CellScore]:
    asked = [(name, one) for name, one in named if spec in one.models]
    found = [_statistics(one.models[spec]) for _, one in asked]
    corrected = {test: holm([one[test].p for one in found]) for test in DEPENDENCE}
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
        for place, ((name, one), statistics) in enumerate(zip(asked, found, strict=True))
    ]


def _statistics(score: battery.ModelScore) -> dict[str, Statistic]:
    """Return a cell's numbers: the diversity of its outputs, as the paper counts it, and its scene dependence.

    Diversity counts UNPARSED as an output of its own, as in Table t:prompts: a cell there has six outputs, of five
    actions.
    """
    outputs = score.answers.responses("real")
    names, counts = np.unique(outputs[outputs != ""], return_counts=True)
    n = int(counts.sum())
    if n:
        modal = rate(int(counts.max()), n)
        distinct = Statistic(float(len(names)), n, method="distinct outputs on real pictures, UNPARSED among them")
    else:
        modal = distinct = cannot_say("no answers to real pictures")
    found = score.statistics
    return {
        "modal_share": modal,
        "distinct_outputs": distinct,
        **{name: found[name] for name in ("idi", "noise_floor", "idi_adj")},
        "unparsed_rate": found["unparsed_rate"],
        **{name: found[name] for name in DEPENDENCE},
    }


def prompts_table(cells: Sequence[CellScore]) -> Table:
    """Return Table t:prompts: diversity, and beside it what the answers hold of the scene."""
    note = (
        "n_a: distinct outputs, UNPARSED among them. Diversity is not scene dependence, which V (real against blank), "
        "I(A;g) in bits and its p, corrected by Holm over these cells, look at. — cannot say"
    )
    rows = []
    for cell in cells:
        found = cell.statistics
        who = (cell.model, Mark(cell.name, "", MARK if cell.marks else ""))
        numbers = [found[name].value for name in ("unparsed_rate", "cramers_v_real_blank", "mutual_information")]
        diversity = (found["modal_share"], found["distinct_outputs"].value, found["idi"])
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
    """Return Table t:prompts in the paper's form, of the cells of studies by name, a row a cell."""
    made = stacked({name: _as_published(cells) for name, cells in scores.items()})
    counts = [cell.statistics["modal_share"].n for cells in scores.values() for cell in cells]
    return made.counted(counts, "queries", "with the real picture per cell").labelled("t:prompts")


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
    """Every cell of a prompt study, by model, and the ``batteries`` that they are, by name."""

    cells: tuple[CellScore, ...]
    batteries: Mapping[str, battery.BatteryScore]

    def measured(self) -> tuple[Measured, ...]:
        """Return the statistics of every model under every prompt and setting, a place each."""
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
"""What the answers of a cell hold of the scene; each p is corrected over the cells of its model."""
_GRID = (
    "Bits of the answer that tell the gap. ● significant; ◐ only a picture from a blank; ○ one answer; ? no link shown"
)


@dataclass(frozen=True)
class Held:
    """One model under every prompt: under which its answers go with the gap."""

    model: str
    cells: tuple[CellScore, ...]

    @property
    def seeing(self) -> list[CellScore]:
        """Return the cells whose answers go with the gap."""
        return [one for one in self.cells if one.label.family == "sees"]

    @property
    def tone(self) -> str:
        """Return sees where it looks under every prompt, partly where under some; blind where its answer never varies.

        A cell in which no link is shown may yet have one.
        """
        tones = {one.label.family for one in self.cells}
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
        """Return the most that its answers tell of the gap, and under which prompt."""
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
        """Return the cell with the smallest p of the gap, the first of those that are alike."""
        return min(self.cells, key=lambda one: 2.0 if (p := one.holm["mutual_information"]) is None else p)

    @property
    def why_not(self) -> str:
        """Return why it is not shown to look under more prompts; empty where it is under all."""
        rest = [one for one in self.cells if one not in self.seeing]
        told = []
        for tone in ("partly", "blind", "open"):
            mine = [one for one in rest if one.label.family == tone]
            if not mine:
                continue
            least = min(mine, key=lambda one: 2.0 if (p := one.holm["mutual_information"]) is None else p)
            p = p_value(least.holm["mutual_information"])
            n = max(one.statistics["mutual_information"].n for one in mine)
            told.append(f"Under {listed([one.name for one in mine])} {_WHY[tone].format(p=p, n=n)}.")
        if open_cells := [one for one in rest if one.label.family != "blind"]:
            n = max(one.statistics["mutual_information"].n for one in open_cells)
            told.append(f"More than {n} frames may show a weaker link.")
        return " ".join(told)


_MOST_LISTED = 4
"""Models that the sentence at the head of a page names each."""
_NUMBERS = {2: "two", 3: "three", 4: "four", 5: "five", 6: "six"}
_MOST_NAMED = 3
_WHY = {
    "partly": "a picture is told from a blank, and no link to the gap is shown (smallest p {p} after Holm, n {n})",
    "blind": "it gives one answer to every picture",
    "open": "no link to its pictures is shown (smallest p {p} after Holm, n {n})",
}


def listed(names: Sequence[str]) -> str:
    """Return names as words list them."""
    return " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))


def by_model(cells: Sequence[CellScore]) -> list[Held]:
    """Return what each model's cells hold together."""
    models = dict.fromkeys(one.model for one in cells)
    return [Held(spec, tuple(one for one in cells if one.model == spec)) for spec in models]


_CELLS = "is a prompt study, of one run a cell: name a cell, as RUN/CELL"


def _sentence(everyone: Mapping[str, Held]) -> str:
    """Return in one sentence under which prompts each model looks; of many models, how many under all and some."""
    if len(everyone) <= _MOST_LISTED:
        return "; ".join(f"{who}: {one.label}" for who, one in everyone.items()) + "."
    tones = [one.tone for one in everyone.values()]
    told = {
        "sees": "under every prompt",
        "partly": "under some",
        "blind": "under none",
        "open": "not shown for",
    }
    parts = [f"{words} {tones.count(tone)}" for tone, words in told.items() if tone in tones]
    return f"Of {len(tones)} models look {'; '.join(parts)}."


def _grid(everyone: Mapping[str, Held]) -> "Grid":
    """Return a grid of prompts and models: what the answers of each tell of the gap."""
    from eyechart.report.page import Grid  # noqa: PLC0415 - a score needs no templates

    names = list(dict.fromkeys(cell.name for one in everyone.values() for cell in one.cells))
    rows = []
    for name in names:
        cells = [next((cell for cell in one.cells if cell.name == name), None) for one in everyone.values()]
        rows.append((name, [None if cell is None else _told(cell) for cell in cells]))
    return Grid("prompt", list(everyone), rows)


def _told(cell: CellScore) -> tuple[str, str, str]:
    return cell.label.family, number(cell.statistics["mutual_information"].value, 2), cell.label.says


class Prompts(OfFrames[PromptsScore]):
    """A battery a prompt and setting, in the folders of one."""

    names = ()
    runs_are = "prompts"
    counted = ("look under every prompt", "model")
    question = "Under which prompt does a model look?"
    refuses: ClassVar = {
        **NO_DRIVES,
        **dict.fromkeys(("verdict", "gate", "compare"), _CELLS),
    }

    def holds(self, folder: Path) -> bool:
        """Return whether a folder is no run itself, but holds one run or more in its folders."""
        return not is_run(folder) and bool(cells_in(folder))

    def runs(self, folder: Path) -> Mapping[str, Path]:
        """Return the cells."""
        return {cell.name: cell for cell in _asked_in(folder)}

    def score(self, folder: Path, reading: Reading) -> PromptsScore:
        """Score every cell."""
        found = _batteries(folder, reread=reading.reread, resamples=reading.resamples)
        if (prices := reading.prices) is not None:
            priced = {name: self.took_run(folder / name, prices).accounts for name in found}
            found = {name: replace(one, accounting=priced[name]) for name, one in found.items()}
        return PromptsScore(_of_batteries(found), found)

    def whole(self, folder: Path, reading: Reading, tell: Tell) -> tuple[PromptsScore, Made]:
        """Return the score and the report of a study in a bundle."""
        return self.score(folder, reading), self.report([folder], [], reading, tell)

    def findings(self, score: PromptsScore) -> Mapping[str, Finding]:
        """Return under which prompts each model looks, by the cell with the smallest p of the gap."""
        found = {}
        for one in by_model(score.cells):
            by, marks = f"mutual_information, {one.best.name}", [mark for cell in one.cells for mark in cell.marks]
            label = one.label if one.label.startswith("under") else f"under {one.label}"
            state = next((cell.state for cell in one.cells if cell.state), "")
            estimated = one.best.statistics["mutual_information"]
            found[one.model] = Finding(f"looks {label}", one.tone, by, estimated, state, tuple(dict.fromkeys(marks)))
        return found

    def answer(self, scores: Mapping[str, PromptsScore]) -> "Opening":
        """Return under which prompts each model looks, a line a model, and a grid of models and prompts."""
        from eyechart.report.page import MOST_SAID, Opening, Said  # noqa: PLC0415 - a score needs no templates

        everyone = {
            f"{name} · {one.model}" if len(scores) > 1 else one.model: one
            for name, score in scores.items()
            for one in by_model(score.cells)
        }
        said = []
        for who, one in everyone.items():
            state = next((cell.state for cell in one.cells if cell.state), "")
            beware = "not to be relied on" if any(cell.marks for cell in one.cells) else state
            said.append(Said(who, one.label, one.tone, one.words, one.why_not, "part-1", beware))
        shown = dict(list(everyone.items())[:MOST_SAID])
        more = f" {len(everyone) - len(shown)} more models stand below." if len(everyone) > len(shown) else ""
        return Opening(_sentence(everyone), said, grid=_grid(shown), caption=f"{_GRID}.{more}")

    def paper(self, runs: Sequence[Path], banks: Sequence[Path], reading: Reading, tell: Tell) -> Iterator[Table]:
        """Yield Table t:prompts of all studies."""
        del banks
        yield paper_table({name: one.cells for name, one in self.scored(runs, reading, tell)})

    def printed(self, score: PromptsScore) -> Iterator[Table | str]:
        """Yield a table a model, the marks of its cells, and what each took."""
        yield from prompts_table(score.cells).split()
        for cell in score.cells:
            yield from marked(f"{cell.model} in {cell.name}", (*filter(None, [cell.state]), *cell.marks))
        yield costs_table({f"{cell.model} in {cell.name}": {ALL: cell.took} for cell in score.cells}, every=False)
