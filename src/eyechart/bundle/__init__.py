"""A bundle is one file with a run and all that follows from it, which anybody can recompute without trusting it."""

from eyechart.bundle.contents import write_bundle
from eyechart.bundle.validating import Validation, validate

__all__ = ["Validation", "validate", "write_bundle"]
