"""A guardian over HTTP."""

from eyechart.serve.server import ServerLimits, application, serve

__all__ = ["ServerLimits", "application", "serve"]
