"""What to change of a request that an endpoint refuses for a field that its model does not take."""

import re
from collections.abc import Collection
from dataclasses import replace

from eyechart.calls import Reply
from eyechart.modes import RequestMode, TokenField

_REFUSES = re.compile(
    r"unsupported|not supported|does not support|only the default|not permitted|unrecogni[sz]ed|unknown",
    re.IGNORECASE,
)


def amended(mode: RequestMode, reply: Reply, fixed: Collection[str] = ()) -> tuple[RequestMode, str] | None:
    """Return a mode that does without what a failed reply refuses, and what was changed in words, or None.

    Fields in ``fixed`` are not changed. Hosted models that think refuse ``max_tokens`` and a temperature of their own.
    """
    detail = reply.error_detail
    if reply.error != "bad_request" or not _REFUSES.search(detail):
        return None
    newer: TokenField = "max_completion_tokens"
    other: TokenField = "max_tokens" if mode.token_field == newer else newer
    if "token_field" not in fixed and re.search(rf"\b{mode.token_field}\b", detail):
        return replace(mode, token_field=other), f"{mode.token_field} is refused: asked with --token-field {other}"
    if "temperature" not in fixed and mode.temperature is not None and "temperature" in detail.lower():
        words = f"temperature {mode.temperature:g} is refused: asked with --temperature default"
        return replace(mode, temperature=None), words
    if "seed" not in fixed and mode.seed and re.search(r"\bseed\b", detail):
        return replace(mode, seed=False), "a seed is refused: asked without one"
    return None
