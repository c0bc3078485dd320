"""The page of the hierarchy: what completion shows, both ablations, and the worlds from above."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from eyechart.report.charts import Drawing
from eyechart.report.page import Page, PageSummary, VerdictSummary, fill, parted
from eyechart.report.table import Table, p_value
from eyechart.studies import Tell
from eyechart.studies.closed_loop import LEVEL, PairedDifference
from eyechart.studies.closed_loop.page import made, sight_of
from eyechart.studies.closed_loop.tables import SIGNED, served_words, unfinished_words
from eyechart.studies.hierarchy import PARTS, HierarchyScore
from eyechart.studies.hierarchy.figures import CONDITION_NAMES, ENDS, SIGNS, groups, outcomes
from eyechart.studies.hierarchy.scores import count_of, unless_shown
from eyechart.studies.hierarchy.tables import (
    TITLES,
    against_table,
    blind_table,
    completion_table,
    intent_table,
    long_tables,
    of_ablation,
    source_table,
)
from eyechart.studies.hierarchy.visual_dependence import pairs_of, why_not

_ANSWERS = {
    "sees": ("it completes by its pictures", "in"),
    "blind": ("completion shows no sight", "in"),
    "open": ("cannot say", "for"),
}
_ARMS = {
    "rover-mpc": "the controller knows the obstacles",
    "rover-mpc-unaware": "it does not; speed and track count",
    "rover-mpc-lateral": "it does not; only the track counts",
}


def make_hierarchy_page(
    study: Path, score: HierarchyScore, *, costs: Sequence[Table] = (), tell: Tell = lambda _: None
) -> Page:
    """Return the report of a study; the same study gives the same bytes.

    ``costs`` are the prices and times of decisions; ``tell`` receives progress messages.
    """
    tell("figures")
    drawn = {name: [one for one in [outcomes(score, name)] if one is not None] for name in TITLES}
    tell("the worlds from above")
    ways, notes = groups(score)
    tell("the page")
    cards = _cards(score)
    html = fill(
        "hierarchy.html",
        styles=("hierarchy.css",),
        title=study.resolve().name,
        score=score,
        episodes=sum(len(one.episodes) for many in score.drives.values() for one in many),
        errors=[
            (one.driver.label, episode) for many in score.drives.values() for one in many for episode in one.errors
        ],
        unfinished=unfinished_words(score.unfinished),
        served=served_words(score.served),
        planners=list(dict.fromkeys(one.driver.policy for _, one in score.blind)),
        control=_control(score.oracle_mirrored),
        cards=cards,
        answer=_opening(score, cards),
        pairs=blind_table(score) if score.blind else None,
        rows={
            name: (source_table(score.sources, name), intent_table(score.sources, name))
            for name in TITLES
            if of_ablation(score.sources, name)
        },
        against=against_table(score.against_mpc_only) if score.against_mpc_only else None,
        completions=completion_table(score.completions) if score.completions else "",
        numbers=long_tables(score),
        figures=drawn,
        groups=ways,
        signs=[(SIGNS[kind], words) for kind, words in ENDS.items()],
        named=CONDITION_NAMES,
        made=[(name, made(study / name)) for name in score.drives],
        costs=costs,
        notes=notes,
    )
    drawings: dict[str, list[Drawing]] = {**drawn, "ways": [drawing for group in ways for drawing in group.drawings]}
    return Page(html, drawings, tuple(notes))


def _opening(score: HierarchyScore, cards: Sequence[Mapping[str, object]]) -> PageSummary:
    """Return the opening: which planner completes by its pictures, and where."""
    said = [
        VerdictSummary(
            f"{card['planner']} in {card['simulator']}",
            str(card["label"]),
            str(card["family"]),
            f"{'; '.join(_rates(card))}.",
            str(card["why_not"]),
            "answer",
        )
        for card in cards
    ]
    if not said:
        return PageSummary("No planner drove: only scripted sources did, and these see no pictures.")
    of_camera = [one for _, one in score.blind if one.is_of_camera]
    shown, which = (of_camera, "shuffled ones") if of_camera else ([one for _, one in score.blind], "others")
    return PageSummary(
        parted(said, _ANSWERS, "arms that a planner drove"),
        said,
        figure=sight_of({f"{one.driver.policy} in {one.driver.simulator}": one for one in shown}, "success_rate"),
        caption=f"Real pictures less {which}; right of the line: more goals with real ones. Filled: significant.",
    )


def _rates(card: Mapping[str, Any]) -> Iterator[str]:
    """Yield how often a planner reached its goal, by condition."""
    yield f"goals with real pictures {card['real']}"
    yield from (f"{CONDITION_NAMES[name]} {goals}" for name, goals, *_ in card["others"])


def _control(difference: PairedDifference | None) -> dict[str, object] | None:
    """Return the positive control's result: whether this arm tells a side from its mirror image."""
    if difference is None:
        return None
    goals = difference.differences["success_rate"]
    is_significant = goals.value is not None and goals.value > 0 and goals.p is not None and goals.p < LEVEL
    return {
        "points": "—" if goals.value is None else f"{100 * goals.value:+.0f} points",
        "interval": "—" if goals.ci is None else f"{100 * goals.ci[0]:+.0f} to {100 * goals.ci[1]:+.0f}",
        "p": "—" if goals.p is None else f"{goals.p:.2g}",
        "worlds": difference.worlds,
        "tells": is_significant,
    }


def _cards(score: HierarchyScore) -> list[dict[str, object]]:
    """Return a card for each planner in each arm: its goals with real and with other pictures."""
    pairs = pairs_of(score)
    goals = {
        (source.part, source.driver.policy, source.driver.condition): count_of(source.goals) for source in score.sources
    }
    completions = {(completion.part, completion.policy): completion for completion in score.completions}
    cards: list[dict[str, object]] = []
    for (part, policy), many in pairs.items():
        label = completions[part, policy].label
        cards.append(
            {
                "planner": policy,
                "arm": _ARMS.get(PARTS[part].simulator, PARTS[part].simulator),
                "simulator": PARTS[part].simulator,
                "family": label.family,
                "glyph": label.glyph,
                "label": label.says,
                "why_not": why_not(many),
                "real": goals[part, policy, "real"],
                "others": [(one.condition, goals[part, policy, one.condition], *_goals(one.paired)) for one in many],
                "words": [completions[part, policy].sentence, *(one.sentence + unless_shown(one) for one in many)],
                "worlds": max(one.paired.worlds for one in many),
            }
        )
    return cards


def _goals(difference: PairedDifference) -> tuple[str, str]:
    points = replace(SIGNED["success_rate"], unit="").shown(difference.differences["success_rate"])
    return points, p_value(difference.holm.get("success_rate"))
