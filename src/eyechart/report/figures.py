"""The figures of a report of batteries by section."""

from collections.abc import Sequence

from eyechart.report.comparisons import agreement, information, noise_floor, pairs
from eyechart.report.drawing import Drawing, style
from eyechart.report.evidence import Subject
from eyechart.report.portraits import counterfactual, gap_by_action, mirror


def figures(everyone: Sequence[Subject]) -> dict[str, list[Drawing]]:
    """Return the figures by section; a section whose data are missing has none."""
    with style():
        return {
            "agreement": [agreement(everyone)] if everyone else [],
            "gap": [one for place, who in enumerate(everyone, 1) for one in gap_by_action(who, place)],
            "information": information(everyone),
            "mirror": [one for place, who in enumerate(everyone, 1) for one in mirror(who, place)],
            "pairs": pairs(everyone),
            "counterfactual": [one for place, who in enumerate(everyone, 1) for one in counterfactual(who, place)],
            "noise": [noise_floor(everyone)] if everyone else [],
        }
