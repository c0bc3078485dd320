"""A controller that works: a callable for `ray_workers.py`, in a file of its own, which is its version."""

import hashlib

ROUNDS = 1_750_000
"""Rounds of PBKDF2 a call: about a third of a second, without the lock of the interpreter."""


def works(prompt: str, picture: bytes | None) -> str:
    """Answer by the picture, after a third of a second of work."""
    digest = hashlib.pbkdf2_hmac("sha256", picture or b"", prompt.encode(), ROUNDS)
    return ("FASTER", "IDLE", "SLOWER")[digest[0] % 3]
