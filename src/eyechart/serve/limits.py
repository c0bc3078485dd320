"""What bounds a server: the size, the number and the kinds of what is sent to it."""

from dataclasses import dataclass

from eyechart.errors import GuardianError
from eyechart.guardian import MOST_AT_ONCE

TYPES = ("image/png", "image/jpeg", "image/webp", "image/bmp", "application/octet-stream")
"""What a picture may be sent as; what it is, its bytes say."""


@dataclass(frozen=True, slots=True)
class Limits:
    """What bounds the server.

    ``concurrency`` pictures are asked about at a time, ``queue`` more may wait, and ``uploads`` be read; what comes
    then is refused with 503. A picture has at most ``most_bytes``. A connection without a request is closed after
    ``idle_s``. The deadline, from a request's head to its answer, is the guardian's.
    """

    concurrency: int = 8
    queue: int = 32
    uploads: int = 64
    most_bytes: int = 4_000_000
    idle_s: float = 10.0

    def __post_init__(self) -> None:
        if min(self.concurrency, self.uploads, self.most_bytes) < 1 or self.queue < 0 or not self.idle_s > 0:
            raise GuardianError(f"limits must be positive numbers, the queue 0 or more; got {self}")
        if self.concurrency > MOST_AT_ONCE:
            raise GuardianError(
                f"a guardian takes at most {MOST_AT_ONCE} pictures at a time, got concurrency={self.concurrency}"
            )
