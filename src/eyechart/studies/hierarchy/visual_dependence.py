"""Which planners complete worlds by their pictures, and why that is not shown of the others."""

from collections.abc import Mapping, Sequence

from eyechart.studies import NO_VERDICT, ModelSummary
from eyechart.studies.closed_loop import DIFFERS, BlindBaseline, bounds
from eyechart.studies.closed_loop.visual_dependence import comparison_words
from eyechart.studies.hierarchy.plans import PARTS
from eyechart.studies.hierarchy.scores import NEEDED, Completion, HierarchyScore, count_of, shows


def pairs_of(score: HierarchyScore) -> dict[tuple[str, str], list[BlindBaseline]]:
    """Return each planner's comparisons with other pictures, by part and planner."""
    pairs: dict[tuple[str, str], list[BlindBaseline]] = {}
    for part, one in score.blind:
        pairs.setdefault((part, one.driver.policy), []).append(one)
    return pairs


def why_not(many: Sequence[BlindBaseline]) -> str:
    """Return why sight is not shown for a planner; empty if it is shown."""
    held = {baseline.condition: baseline for baseline in many}
    if lacking := [name for name in NEEDED if name not in held]:
        return f"It did not drive the same worlds with {' and '.join(lacking)} pictures, which the comparison needs."
    unshown = [held[name] for name in NEEDED if not shows(held[name])]
    if not unshown:
        return ""
    if unshown[0].finding != DIFFERS:
        return comparison_words(unshown[0], "success_rate")[1]
    names = " and ".join(one.condition for one in unshown)
    return (
        f"It drives differently with {names} pictures, but it does not complete significantly fewer worlds: "
        f"{bounds(unshown[0].paired, 'success_rate')} in {unshown[0].paired.worlds} worlds."
    )


def findings(score: HierarchyScore) -> dict[str, ModelSummary]:
    """Return each planner's finding for an index, over all of its arms: by its pictures, or not."""
    pairs = pairs_of(score)
    result = dict.fromkeys((completion.policy for completion in score.completions), NO_VERDICT)
    for spec in result:
        mine = [
            completion
            for completion in score.completions
            if completion.policy == spec and (completion.part, spec) in pairs
        ]
        if mine:
            result[spec] = _finding(score, mine, {completion.part: pairs[completion.part, spec] for completion in mine})
    return result


def _finding(
    score: HierarchyScore, mine: Sequence[Completion], pairs: Mapping[str, Sequence[BlindBaseline]]
) -> ModelSummary:
    """Return one planner's finding: the strictest comparison of the arm that shows most."""
    spec, tones = mine[0].policy, [completion.label.family for completion in mine]
    tone = tones[0] if len(set(tones)) == 1 else "partly" if "sees" in tones else "open"
    best = mine[tones.index("sees") if "sees" in tones else 0]
    least = min(
        pairs[best.part], key=lambda baseline: NEEDED.index(baseline.condition) if baseline.condition in NEEDED else 9
    )
    by = (
        f"{PARTS[best.part].simulator}, {count_of(best.goals['real'])} goals: success_rate, real less {least.condition}"
    )
    lacking = dict.fromkeys(one.words for many in score.unfinished.values() for one in many if one.policy == spec)
    marks = [one.mark for name, one in score.served.items() if name.partition(" in ")[0] == spec]
    return ModelSummary(best.label.says, tone, by, least.paired.differences["success_rate"], "; ".join(lacking), marks)
