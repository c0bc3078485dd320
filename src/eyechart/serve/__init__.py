"""A guardian over HTTP."""

from eyechart.serve.limits import Limits
from eyechart.serve.server import application, serve

__all__ = ["Limits", "application", "serve"]
