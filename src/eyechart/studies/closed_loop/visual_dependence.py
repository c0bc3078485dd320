"""Whether each driver drives by sight: its strictest comparison, and why it shows no more."""

from eyechart.studies import ModelSummary
from eyechart.studies.closed_loop import ClosedLoopScore
from eyechart.studies.closed_loop.blind_baseline import CANNOT_SAY, NO_DIFFERENCE, SAME, BlindBaseline, bounds


def blind_comparisons(score: ClosedLoopScore) -> dict[str, BlindBaseline]:
    """Return the strictest comparison of each driver with other pictures in the same worlds.

    Where models drove, only they count, and not the scripted policies beside them.
    """
    baselines: dict[str, BlindBaseline] = {}
    models = {drive.driver.label for drive in score.drives if drive.is_model}
    for one in (one for one in score.blind if one.is_of_pictures and (not models or one.driver.label in models)):
        who = named(one, score)
        if who not in baselines or (one.is_of_camera and not baselines[who].is_of_camera):
            baselines[who] = one
    return baselines


def named(one: BlindBaseline, score: ClosedLoopScore) -> str:
    """Return the driver's name, and its simulator where there are several."""
    return f"{one.driver.label} in {one.driver.simulator}" if len(score.simulators) > 1 else one.driver.label


def comparison_words(one: BlindBaseline, measure: str = "reward") -> tuple[str, str]:
    """Return what a comparison shows of a driver, and why it shows no more; either may be empty."""
    first = one.shows[:1].upper() + one.shows[1:]
    text = f"{first} {one.rest}".strip()
    if one.finding == CANNOT_SAY:
        return "", text
    if one.finding == NO_DIFFERENCE:
        return "", (
            f"No difference from {one.condition} pictures was found in {one.paired.worlds} worlds. There may still be "
            f"one: the data allow {bounds(one.paired, measure)}, and more worlds narrow it."
        )
    if one.finding == SAME:
        return text, f"It drove {one.paired.worlds} worlds; other worlds were not tested."
    if one.unasked:
        return first, f"{one.unasked} {one.rest}".strip()
    return text, "Drives do not show which part of its pictures it follows: use 'eyechart run battery'."


def findings(score: ClosedLoopScore) -> dict[str, ModelSummary]:
    """Return whether each driver drives by sight, by the measure that differs most surely."""
    lacking = {one.policy: one.words for many in score.unfinished.values() for one in many}
    served = {spec.partition(" in ")[0]: guard for spec, guard in score.served.items()}
    summaries: dict[str, ModelSummary] = {}
    for blind_comparison in blind_comparisons(score).values():
        spec, name, label = blind_comparison.driver.policy, blind_comparison.decisive, blind_comparison.label
        marks = [served[spec].mark] if spec in served else []
        by, state = f"{name}, real less {blind_comparison.condition}", lacking.get(spec, "")
        summaries.setdefault(
            spec, ModelSummary(label.says, label.family, by, blind_comparison.paired.differences[name], state, marks)
        )
    return summaries
