"""A call is a key with its attempts: what was asked of which model about which frame, and what came back."""

import hashlib
from dataclasses import dataclass, fields
from typing import Literal

from eyechart.seeds import key_seed

ErrorKind = Literal["exception", "timeout", "rate_limited", "server_error", "connection", "bad_response", "auth"]
"""What went wrong when no answer came; later adapters use the network's kinds."""

TRANSIENT: frozenset[str] = frozenset({"timeout", "rate_limited", "server_error", "connection"})
"""The kinds that may pass when the same call is made again."""


@dataclass(frozen=True, slots=True)
class Query:
    """Everything that a model may see, and a seed for its sampling. There is no field for ground truth.

    ``image`` is an encoded picture (PNG or JPEG bytes) or None where the condition shows none. ``seed`` is
    derived from the call's key, so that a model that samples answers the same call alike after a resume.
    """

    system: str
    user: str
    image: bytes | None
    seed: int

    def sha256(self) -> str:
        """Return the digest of the content (not of the seed), an audit column and never a cache key."""
        digest = hashlib.sha256()
        for part in (
            self.system.encode(),
            self.user.encode(),
            b"-" if self.image is None else b"+" + self.image,
        ):
            digest.update(len(part).to_bytes(8, "big") + part)
        return digest.hexdigest()


@dataclass(frozen=True, slots=True)
class Reply:
    """What came back, verbatim. A failure is a Reply with its ``error`` kind, never made-up text.

    ``finish_reason`` uses the names of OpenAI's chat API (``stop``, ``length``, ``content_filter``);
    ``seconds`` is wall time; token counts are None where the model does not report them.
    """

    text: str = ""
    finish_reason: str | None = None
    error: ErrorKind | None = None
    error_detail: str = ""
    prompt_tokens: int | None = None
    completion_tokens: int | None = None
    seconds: float | None = None


@dataclass(frozen=True, slots=True, order=True)
class CallKey:
    """The identity of a call: never its content (docs/decisions/0001)."""

    study: str
    model: str
    prompt: str
    frame: str
    condition: str
    repeat: int = 0

    def seed(self, run_seed: int) -> int:
        """Return a 63-bit seed that depends on this key and the run's seed only."""
        return key_seed(run_seed, *(str(getattr(self, field.name)) for field in fields(self)))
