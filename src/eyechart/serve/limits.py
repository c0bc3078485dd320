"""The limits of a server."""

from dataclasses import dataclass

from eyechart.errors import GuardianError
from eyechart.guardian import MOST_AT_ONCE
from eyechart.serve.host_names import require_name


@dataclass(frozen=True, slots=True)
class ServerLimits:
    """The limits of the server; raises GuardianError for a wrong value.

    ``concurrency`` pictures are assessed at a time, ``queue`` more may wait, and ``uploads`` are
    read; any more get 503. A picture has at most ``most_bytes``, and at most ``most_pixels`` by its
    header, before it is decoded. A connection without a request is closed after ``idle_s``. A new
    connection beyond ``connections`` gets 503. A request has at most ``headers`` headers. ``hosts``
    are names of the server: a server on this machine alone also has the machine's own names, and
    any other one without ``hosts`` answers to any name. The deadline is the
    guardian's, from the head of a request to its answer.
    """

    concurrency: int = 8
    queue: int = 32
    uploads: int = 64
    most_bytes: int = 4_000_000
    most_pixels: int = 2_100_000
    idle_s: float = 10.0
    connections: int = 256
    headers: int = 64
    hosts: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("concurrency", "uploads", "most_bytes", "most_pixels", "connections", "headers"):
            if getattr(self, name) < 1:
                raise GuardianError(f"{name} must be at least 1, got {getattr(self, name)}")
        if self.queue < 0:
            raise GuardianError(f"the queue must have 0 places or more, got {self.queue}")
        if not self.idle_s > 0:
            raise GuardianError(f"idle_s must be a number of seconds above 0, got {self.idle_s:g}")
        for name in self.hosts:
            require_name(name)
        if self.concurrency > MOST_AT_ONCE:
            raise GuardianError(
                f"a guardian takes at most {MOST_AT_ONCE} pictures at a time, got concurrency={self.concurrency}"
            )
