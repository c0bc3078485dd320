"""A guardian over HTTP: one picture a request, an answer by the deadline, and a refusal rather than a long queue.

It listens on this machine only unless told otherwise, answers to its own names only, has no password, and keeps no
picture.
"""

from eyechart.serve.described import TYPES, openapi
from eyechart.serve.life import serve
from eyechart.serve.limits import ServerLimits
from eyechart.serve.server import Metrics, Server, application

__all__ = ["TYPES", "Metrics", "Server", "ServerLimits", "application", "openapi", "serve"]
