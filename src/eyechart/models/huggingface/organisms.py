"""Model organisms: tiny real vision-language models with a trained, known use of pictures.

The instrument is tested on them: their weights and decoding are real, their answers known. Each is
an ordinary checkpoint with its card, in the distribution ``eyechart-organisms``.
"""

from dataclasses import dataclass
from pathlib import Path

from eyechart.errors import require_known
from eyechart.models import organisms_folder


@dataclass(frozen=True, slots=True)
class Organism:
    """The training of an organism, and its correct labels on a ``balanced`` bank.

    ``sampled``: its generation config draws its answers, instead of the likeliest tokens.
    """

    says: str
    calibrated: str
    lateral: str
    sampled: bool = False


ORGANISMS: dict[str, Organism] = {
    "grounded": Organism("brakes by distance and turns to the one clear side", "depth_lateral", "turns_clear"),
    "depth_only": Organism("brakes by distance, never turns", "depth", "no_power"),
    "presence_only": Organism("SLOW at any road, STOP at anything else", "presence_only", "no_power"),
    "blind": Organism("answers SLOW, whatever it is shown", "image_invariant", "no_power"),
    "self_inconsistent": Organism(
        "draws any action, whatever it is shown",
        "self_inconsistent",
        "does_not_swap",
        sampled=True,
    ),
}
"""The organisms of the battery on a highway, which answer with an action."""


@dataclass(frozen=True, slots=True)
class OrganismEstimator:
    """The training of an organism that gives scene estimates, and the clauses that it must fail."""

    says: str
    fails: frozenset[str] = frozenset()


ESTIMATORS: dict[str, OrganismEstimator] = {
    "scene": OrganismEstimator(
        "tells the gap in six steps and which sides are clear, from the calibrated view of a highway"
    ),
    "scene_blind": OrganismEstimator(
        "reports a close lead and both sides taken, whatever it is shown",
        frozenset({"close_accuracy", "balanced_accuracy", "actions", "directional"}),
    ),
}
"""``fails`` holds on all pairs of a ``balanced`` highway bank. On only sixteen pairs ``scene`` may
fail an equivariance: its report differs for one reflected scene in four."""

PLANNERS: dict[str, Organism] = {
    "rover": Organism("passes obstacles on a clear side, by its forward camera", "depth_lateral", "turns_clear"),
}
"""Planners for the hierarchy; their labels are those on a ``balanced`` rover bank."""

SAYS: dict[str, str] = {name: one.says for name, one in (ORGANISMS | ESTIMATORS | PLANNERS).items()}
"""Every organism, in words."""


def folder(name: str) -> Path:
    """Return an organism's checkpoint; raises SpecError with the known ones or what to install."""
    require_known(f"organism '{name}'", name, SAYS)
    return organisms_folder(f"'hf:organism:{name}'", "transformers") / "checkpoints" / name
