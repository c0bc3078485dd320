"""The report page: one self-contained HTML file; it makes no request and escapes all model text."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from eyechart.conditions import CONDITIONS, CONTROLS, of_bank
from eyechart.costs import ALL, Account
from eyechart.integrity import Guard
from eyechart.report.accounts import deployment_tables
from eyechart.report.charts import Drawing
from eyechart.report.page import Page, fill
from eyechart.report.table import Column, level, p_value
from eyechart.spaces.discrete import Discrete
from eyechart.spaces.space import MISSING
from eyechart.stats.evalues import EValue
from eyechart.stats.statistic import Statistic
from eyechart.studies import Tell
from eyechart.studies.battery.album import BUDGET_BYTES, LEAST_BYTES, NO_PICTURE, Album, make_album
from eyechart.studies.battery.browser import Texts, about_packed, collect_texts, frames_shown, packed_data
from eyechart.studies.battery.figures import agreement_down, figures
from eyechart.studies.battery.plans import conditions_of, plan_of
from eyechart.studies.battery.subjects import Evidence, Subject, accounts_of, subjects
from eyechart.studies.battery.summary import opening
from eyechart.studies.battery.tables import (
    depth_table,
    frontier_table,
    judged_of,
    series_table,
    statistics_table,
    verdict_table,
)
from eyechart.verdicts import LABELS, StoppingPoint, shared_notes
from eyechart.verdicts.ruling import number as value_of

MODELS_DRAWN = 24
"""The most models with figures of their own in the page."""
MOST_CHARACTERS = 14_500_000
"""The most characters of a page with packed replies, so that it can be sent by mail."""
LEAST_PACKED = 2_500_000
"""The least room for packed replies, in characters, whatever else is in the page."""
GUARDS_SHOWN = 4
"""Up to this many models, every guard of each has its row."""
SHOWN_TOGETHER = (
    *("lead_near", "lead_drawn", "lead_mid_near", "lead_mid_far", "lead_far"),
    *(
        "exchange_own",
        "exchange_beside",
        "exchange_apart",
        "lane_own",
        "lane_beside",
        "lead_absent",
        "real",
        "recoloured",
    ),
)
"""Conditions whose pictures of a frame stand side by side."""

PAIRS_SHOWN = 4
"""The most counterfactual frames shown side by side; fewer with many models."""


def make_page(evidence: Sequence[Evidence], *, tell: Tell = lambda _: None) -> Page:
    """Return the report of runs; the same runs give the same bytes. ``tell`` receives progress."""
    everyone, shown = subjects(evidence), frames_shown(evidence)
    judged = judged_of(everyone)
    shared = shared_notes({who.label: who.verdict for who in everyone})
    tell("figures")
    drawn = figures(everyone)
    texts, room = collect_texts(evidence, shown), MOST_CHARACTERS - characters_beside(everyone)
    pictures = 3 * (room - about_packed(evidence, shown, texts)) // 4
    album = make_album(evidence, shown, budget=min(max(pictures, LEAST_BYTES), BUDGET_BYTES), tell=tell)
    tell("the page")
    room = max(LEAST_PACKED, room - sum(map(len, album.uris)))
    texts, data, packed = packed_data(evidence, album, texts, shown, room)
    notes = _notes(evidence, shown, album, texts, len(everyone))
    html = fill(
        "page.html",
        scripts=("layout.js", "browser.js", "page.js"),
        data=data,
        packed=packed,
        title=", ".join(run.name for run in evidence),
        answer=opening(evidence, everyone, album),
        runs=[_run(run) for run in evidence],
        cards=[_card(who, shared) for who in everyone],
        shared=shared,
        figures={section: many[:MODELS_DRAWN] for section, many in drawn.items()},
        narrow=agreement_down(everyone),
        silent=silent(evidence, everyone, drawn),
        pairs=[
            pair
            for run, places in zip(evidence, album.places, strict=True)
            for pair in pairs(run, places, album, len(everyone))
        ],
        along=[*depth_table(judged).split(), *series_table(judged).split()],
        statistics=list(statistics_table(judged).split()),
        tables=[verdict_table(judged), frontier_table(judged)],
        conditions=[
            CONDITIONS[name] for name in dict.fromkeys(name for run in evidence for name in of_bank(run.score.bank))
        ],
        stopped=any(who.model.stopped for who in everyone),
        accounting=[_accounting(who) for who in everyone],
        reasons=MISSING,
        costs=deployment_tables(accounts_of(everyone)),
        notes=notes,
    )
    return Page(html, drawn, tuple(notes))


def characters_beside(everyone: Sequence[Subject]) -> int:
    """Return the most characters of a page besides pictures and replies: figures, tables, style."""
    drawn = sum(65_000 + 150 * len(who.run.frames) for who in everyone[:MODELS_DRAWN])
    return 300_000 + drawn + 45_000 * len(everyone)


def _notes(
    evidence: Sequence[Evidence], shown: Sequence[Sequence[int]], album: Album, texts: Texts, models: int
) -> list[str]:
    """Return in words what the page leaves out or changes."""
    notes = [*album.notes]
    every, listed = sum(len(run.frames) for run in evidence), sum(map(len, shown))
    if listed < every:
        notes.append(
            f"The browser lists {listed:,} of {every:,} frames, evenly from every episode; every number on this page "
            "counts all of them."
        )
    if texts.cut:
        notes.append(f"{texts.cut} replies are cut after {texts.limit:,} characters; the ledger has all of them.")
    if models > MODELS_DRAWN:
        notes.append(f"Figures of single models stand here for the first {MODELS_DRAWN} of {models} models.")
    return notes


def _card(who: Subject, shared: Mapping[str, str]) -> dict[str, object]:
    verdict = who.verdict
    label = LABELS[verdict.calibrated.label]
    deciding = who.model.statistics[verdict.calibrated.decided_by]
    held = {one.name for one in verdict.numbers if one.outcome == "holds"}  # the table below has all of them
    return {
        "model": who.label,
        "version": who.model.version,
        "family": label.family,
        "glyph": label.glyph,
        "verdict": verdict,
        "notes": [note for note in verdict.notes if note not in shared],
        "numbers": _numbers(deciding, verdict.stopped),
        "because": verdict.calibrated.reason,
        "measures": {name: words for name, words in verdict.measures.items() if name not in held},
    }


def _numbers(statistic: Statistic, stopped: StoppingPoint | None) -> list[tuple[str, str]]:
    if stopped is not None and isinstance(statistic, EValue):
        value, calls = f"{statistic.value:.4g}", f"{stopped.calls} of {stopped.planned}"
        return [
            ("e-value", value),
            ("settled at", f"{statistic.threshold:g}"),
            ("frames", str(statistic.n)),
            ("calls", calls),
        ]
    interval = (f"{level(statistic)} interval".strip(), Column("", "interval").shown(statistic.ci))
    return [("value", value_of(statistic)), interval, ("n", str(statistic.n)), ("p", p_value(statistic.p))]


def _run(run: Evidence) -> dict[str, object]:
    rows = [counts(who) for who in subjects([run])]
    return {
        "evidence": run,
        "manifest": run.score.manifest,
        "bank": run.score.bank,
        "controls": len(run.score.conditions) - len(run.score.manifest.conditions),
        "counts": sum_counts(rows),
        "counts_by_model": list(zip(run.score.models, rows, strict=True)),
        "guards": guards(run),
        "not_covered": not_covered(run),
    }


def _accounting(who: Subject) -> dict[str, object]:
    took = who.run.score.accounting[who.spec][ALL]
    return {"who": who, "model": who.model, "took": took, "missing": _reasons(took)}


def _reasons(took: Account | None) -> tuple[int, ...]:
    return tuple(0 if took is None else took.missing.get(reason, 0) for reason in MISSING)


def silent(
    evidence: Sequence[Evidence], everyone: Sequence[Subject], drawn: Mapping[str, Sequence[Drawing]]
) -> dict[str, list[tuple[str, str]]]:
    """Return, by section, the runs that have no figure there, each with the reason."""
    result: dict[str, list[tuple[str, str]]] = {"gap": [], "information": [], "mirror": [], "counterfactual": []}
    for run in evidence:
        mine = [who for who in everyone if who.run is run]
        labels = {who.label for who in mine}
        for section in ("gap", "mirror", "counterfactual"):
            if not any(drawing.of in labels for drawing in drawn[section]):
                result[section].append((run.name, _why(section, mine)))
        if all(who.model.statistics["mutual_information.decision"].value is None for who in mine):
            result["information"].append((run.name, _why("gap", mine)))
    return result


def _why(section: str, models: Sequence[Subject]) -> str:
    """Return in words why a section has no figure of these models."""
    if section == "counterfactual":
        return "the run has no answers to counterfactual pictures, so distance was not tested by intervention"
    name = "mirror_swap_rate" if section == "mirror" else "mutual_information.decision"
    notes = dict.fromkeys(who.model.statistics[name].note for who in models)
    return "; ".join(note for note in notes if note) or "the run names no model"


def guards(run: Evidence) -> list[tuple[str, Guard]]:
    """Return the guards that do not hold; with few models all guards, else the others once."""
    result = [(spec, guard) for spec, many in run.score.guards.items() for guard in many]
    if len(run.score.models) <= GUARDS_SHOWN:
        return result
    every = f"all {len(run.score.models)} models"
    held = {guard.name for _, guard in result} - {guard.name for _, guard in result if guard.holds is not True}
    return [
        *((spec, guard) for spec, guard in result if guard.holds is not True),
        *((every, Guard(name, True, "it holds for each model")) for name in sorted(held)),
    ]


def pairs(run: Evidence, places: dict[str, tuple[int, ...]], album: Album, models: int) -> list[dict[str, object]]:
    """Return some frames, evenly taken, with their counterfactual pictures and the decisions."""
    names = [name for name in SHOWN_TOGETHER if name in run.conditions]
    drawn = [
        place for place, frame in enumerate(run.frames) if {"lead_near", "lead_far"} & frame.counterfactuals.keys()
    ]
    if not drawn or not {"lead_near", "lead_far", "recoloured"} & set(names):
        return []
    count = PAIRS_SHOWN if models <= 8 else PAIRS_SHOWN // 2
    step, space = max(1, len(drawn) // count), run.score.bank.manifest.action_space
    return [
        {
            "frame": run.frames[place].id,
            "run": run.name,
            "columns": [
                (name, None if (at := places[name][place]) <= NO_PICTURE else album.uris[at]) for name in names
            ],
            "rows": [(who.spec, [_word(who, name, place, space) for name in names]) for who in subjects([run])],
        }
        for place in drawn[::step][:count]
    ]


def _word(who: Subject, condition: str, place: int, space: Discrete) -> tuple[str, str]:
    """Return a decision's role (brake, proceed, other, none, "" without a reply) and its word."""
    given = who.model.answers.decisions.get(condition)
    decision = None if given is None else given[place]
    if decision is None:
        return "", "—"
    if decision.action is None:
        return "none", f"({decision.missing})"
    return space.role(decision.action), decision.action


@dataclass(frozen=True, slots=True)
class ConditionCalls:
    """The calls of one condition: planned, answered, their attempts, and calls without a decision.

    ``partial`` says that calls remain to be made; a run that stopped early leaves some out for
    good. ``errors`` counts attempts that ended in an error, ``unknown`` attempts of unknown
    outcome. ``missing`` counts the calls without a decision by reason, in the order of ``MISSING``.
    All numbers are those of the run's accounts.
    """

    condition: str
    planned: int
    answered: int
    attempts: int
    errors: int
    unknown: int
    missing: tuple[int, ...]
    partial: bool = False

    @property
    def without(self) -> int:
        """Return how many calls hold no decision, for any reason."""
        return sum(self.missing)


def counts(who: Subject) -> list[ConditionCalls]:
    """Return the counts of a model's calls, one row per condition."""
    planned: dict[str, int] = dict.fromkeys(who.run.conditions, 0)
    plan = plan_of(who.run.score.manifest, who.run.score.bank)
    cells = replace(plan, controls={who.spec: who.model.controls.controls}).cells(who.spec)
    for (condition, _), shown in cells.items():
        planned[condition] += int(shown.sum())
    result = []
    for name, count in planned.items():
        took = who.run.score.accounting[who.spec].get(name)
        sums = (0, 0, 0, 0) if took is None else (took.finished, took.attempts, took.failed, took.unknown)
        result.append(ConditionCalls(name, count, *sums, _reasons(took), sums[0] < count and who.model.stopped is None))
    return result


def sum_counts(rows: Sequence[Sequence[ConditionCalls]]) -> list[ConditionCalls]:
    """Return the counts of several models of one run together, one row per condition."""
    return [
        ConditionCalls(
            condition=many[0].condition,
            planned=sum(one.planned for one in many),
            answered=sum(one.answered for one in many),
            attempts=sum(one.attempts for one in many),
            errors=sum(one.errors for one in many),
            unknown=sum(one.unknown for one in many),
            missing=tuple(map(sum, zip(*(one.missing for one in many), strict=True))),
            partial=any(one.partial for one in many),
        )
        for many in zip(*rows, strict=True)
    ]


def not_covered(run: Evidence) -> list[str]:
    """Return in words what a run does not cover: conditions, frames, calls and tests."""
    manifest, bank = run.score.manifest, run.score.bank
    _, why = conditions_of(bank, manifest.prompt)
    unasked = "no model's answers called for it" if manifest.controls == "auto" else "it was not chosen (--controls)"
    lines = [
        f"condition {name} was not run: {why.get(name, unasked if name in CONTROLS else 'it was not chosen')}"
        for name in of_bank(bank)
        if name not in run.conditions
    ]
    if len(run.frames) < len(bank):
        lines.append(f"{len(bank) - len(run.frames)} of the bank's {len(bank)} frames were not used (--limit)")
    if manifest.shard is not None:
        lines.append(
            f"this is shard {manifest.shard[0]} of {manifest.shard[1]}: the calls of the other shards are not here"
        )
    for spec, model in run.score.models.items():
        if model.stopped is not None:
            lines.append(
                f"{spec}: {model.stopped.words()}; the paper's tests, which need the whole run, are not judged"
            )
        elif model.answered < model.planned:
            lines.append(f"{spec}: {model.planned - model.answered} of {model.planned} planned calls are not finished")
    return [*lines, *_silent(run), "not tested by any run: other prompts, other cameras, closed loop"]


def _silent(run: Evidence) -> list[str]:
    """Return the tests that cannot say; those with one reason and the same models in one line."""
    reasons: dict[tuple[str, str], list[str]] = {}
    for spec, model in run.score.models.items():
        for name, found in model.statistics.items():
            if found.value is None and found.p is None:
                reasons.setdefault((name, found.note or "no reason given"), []).append(spec)
    grouped: dict[tuple[str, tuple[str, ...]], list[str]] = {}
    for (name, note), specs in reasons.items():
        grouped.setdefault((note, tuple(specs)), []).append(name)
    everyone = tuple(run.score.models)
    return [
        f"cannot say: {', '.join(names)}{'' if specs == everyone else ' for ' + ', '.join(specs)} ({note})"
        for (note, specs), names in grouped.items()
    ]
