"""A bundle: one file with a run and its results, which anybody can recompute."""

from eyechart.bundle.drives import Again
from eyechart.bundle.validating import Validation, validate
from eyechart.bundle.writer import write_bundle

__all__ = ["Again", "Validation", "validate", "write_bundle"]
