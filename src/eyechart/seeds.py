"""Seeds from keys: a seed depends on what it makes, never on the order of making."""

import hashlib
from json.encoder import encode_basestring_ascii as as_json


def key_seed(*parts: object) -> int:
    """Return a 63-bit seed from the parts of a key, equal on every machine."""
    digest = hashlib.sha256(f"[{', '.join([as_json(str(part)) for part in parts])}]".encode()).digest()
    return int.from_bytes(digest[:8], "big") >> 1
