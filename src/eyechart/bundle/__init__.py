"""A bundle is one file with a run and all that follows from it, which anybody can recompute without trusting it."""

from eyechart.bundle.drives import Again
from eyechart.bundle.validating import Validation, validate
from eyechart.bundle.writer import write_bundle

__all__ = ["Again", "Validation", "validate", "write_bundle"]
