"""The page of runs of scene estimates: who is admitted and by which clause, every figure, and the worst frames."""

from collections.abc import Sequence

from eyechart.costs import ALL
from eyechart.report.charts import BLUE, INK, MUTED, VERMILLION, Drawing, canvas, style
from eyechart.report.page import Page, fill
from eyechart.studies.battery.subjects import Tell
from eyechart.studies.structured.estimates import Estimates, Estimator, estimators
from eyechart.studies.structured.frames import listed_frames, shown_frames
from eyechart.studies.structured.tables import clauses_table, controller_table, figures_table, marks, scored_of

_DRAWN = 12
"""Models that have a figure of their own in the page."""


def make_estimates_page(evidence: Sequence[Estimates], *, tell: Tell = lambda _: None) -> Page:
    """Return the report of admission and structured runs; the same runs give the same bytes."""
    everyone = estimators(evidence)
    tell("figures")
    with style():
        drawn = [drawing for place, who in enumerate(everyone[:_DRAWN], 1) for drawing in gaps(who, place)]
    tell("pictures")
    frames, notes = shown_frames(evidence)
    listed, more = listed_frames(everyone)
    if len(everyone) > _DRAWN:
        more.append(f"Figures of one model each stand here for the first {_DRAWN} of {len(everyone)} models.")
    notes += more
    tell("the page")
    scored = scored_of(everyone)
    html = fill(
        "estimates.html",
        styles=("estimates.css",),
        title=", ".join(run.name for run in evidence),
        studies=_studies(evidence),
        runs=[_run(run) for run in evidence],
        cards=[_card(who) for who in everyone],
        controllers=controller_table(scored),
        figures=list(figures_table(scored).split()),
        drawings=drawn,
        frames=frames,
        listed=listed,
        accounting=[(who, who.run.score.accounting[who.spec][ALL]) for who in everyone],
        notes=notes,
    )
    return Page(html, {"gaps": drawn}, tuple(notes))


def gaps(who: Estimator, place: int) -> list[Drawing]:
    """Draw the gap that a model told against the true one, where a lead is in the picture; nothing where none was."""
    told, one = who.score.told, who.score.statistics["gap_mae_m"]
    pairs = [
        (float(told.gap_m[number]), estimate.gap_m)
        for number, estimate in enumerate(told.estimates("real"))
        if estimate is not None and estimate.gap_m is not None and told.visible[number]
    ]
    if one.value is None:
        return []
    figure, axes = canvas(3.6, 3.1, (0.6, 0.15, 0.5, 0.15))
    most = 1.06 * max(max(pair) for pair in pairs)
    close = told.distances.close_m
    axes.plot([0, most], [0, most], color=MUTED, linewidth=0.8)
    for side in (axes.axvline, axes.axhline):
        side(close, color=VERMILLION, linewidth=0.8, linestyle=(0, (4, 3)))
    axes.plot([x for x, _ in pairs], [y for _, y in pairs], "o", color=BLUE, markersize=3, alpha=0.6)
    axes.text(close, 0.99 * most, f" close below {close:g} m", color=INK, fontsize=8, va="top")
    axes.set_xlim(0, most)
    axes.set_ylim(0, most)
    axes.set_xlabel("true gap, m")
    axes.set_ylabel("told gap, m")
    words = f"{one.n} frames with a lead in the picture; mean absolute error {one.value:.3f} m. A line marks equality."
    return [Drawing(f"gap-told-{place}", f"Told and true gap: {who.label}", words, figure, of=who.label)]


def _studies(evidence: Sequence[Estimates]) -> str:
    return " and ".join(dict.fromkeys(run.score.manifest.study for run in evidence))


def _run(run: Estimates) -> dict[str, object]:
    return {
        "evidence": run,
        "manifest": run.score.manifest,
        "bank": run.score.bank,
        "guards": [(spec, guard) for spec, many in run.score.guards.items() for guard in many],
        "unfinished": [
            f"{spec}: {one.answered} of {one.planned} calls are answered; the rest is missing from every figure"
            for spec, one in run.score.models.items()
            if one.answered < one.planned
        ],
    }


def _card(who: Estimator) -> dict[str, object]:
    score = who.score
    state = "" if score.answered >= score.planned else f"unfinished: {score.answered} of {score.planned} calls"
    fails = [one.name for one in score.clauses if one.passes is False]
    unsaid = [one.name for one in score.clauses if one.passes is None]
    words = "meets every clause" if score.admitted else f"fails {', '.join(fails)}" if fails else "fails no clause"
    if unsaid:
        words += f"; cannot say: {', '.join(unsaid)}"
    told = score.told
    return {
        "model": who.label,
        "version": score.version,
        "admitted": score.admitted,
        "state": state,
        "words": words,
        "marks": marks(who.run.score, who.spec),
        "clauses": next(clauses_table([(who.label, score, ())]).split(), None),
        "reasons": list(told.reasons.items()),
        "repairs": list(told.repairs.items()),
    }
