"""A seed comes from the key of the thing it makes, so that no order of making can change it."""

import hashlib
import json


def key_seed(*parts: object) -> int:
    """Return a 63-bit seed from the parts of a key, equal on every machine and in every process."""
    digest = hashlib.sha256(json.dumps([str(part) for part in parts]).encode()).digest()
    return int.from_bytes(digest[:8], "big") >> 1
