"""A small study of the hierarchy, whose planner's name means harm."""

from collections.abc import Mapping
from pathlib import Path

import pytest

from corridors import HOSTILE_NAME
from eyechart.episodes import Bounds, run
from eyechart.modes import RequestMode
from eyechart.studies import hierarchy
from eyechart.studies.hierarchy import Part, plans

PARTS: Mapping[str, Part] = {
    "primary": Part("rover-mpc", ("constant:STRAIGHT", "constant:STOP", "route"), ("offset",), 2),
    "primary-models": Part("rover-mpc", (), ("offset",), 2, ("real", "blank"), models=True),
    "unaware": Part("rover-mpc-unaware", ("constant:STRAIGHT",), ("offset",), 2),
    "lateral": Part("rover-mpc-lateral", ("route", "mirrored:route"), ("offset",), 2),
}
"""The study in two worlds."""


def make_study(out: Path, called: str = HOSTILE_NAME) -> Path:
    """Run the study, and give its planner a name, that would be markup unless another is chosen."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plans, "PARTS", PARTS)
        for planned in hierarchy.plan(out, [RequestMode("scripted:stopping")]).values():
            run(planned, bounds=Bounds(processes=1))
    for name in ("run.json", "episodes.jsonl"):
        file = out / "primary-models" / name
        file.write_text(file.read_text().replace("scripted:stopping", called))
    return out
