"""A bundle: one file with a run and its results, which anybody can recompute."""

from eyechart.bundle.drives import ReplayCheck
from eyechart.bundle.validation import Validation, validate
from eyechart.bundle.writer import write_bundle

__all__ = ["ReplayCheck", "Validation", "validate", "write_bundle"]
