"""A guardian over HTTP."""

from eyechart.serve.limits import ServerLimits
from eyechart.serve.server import application, serve

__all__ = ["ServerLimits", "application", "serve"]
