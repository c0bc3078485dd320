"""What the simulator says of itself before highway-env is imported: its picture, its seeds, its versions."""

from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version

PICTURE = "top-down drawing of a highway (highway-env, 600 × 150 pixels)"
MOST_SEED = 2**63 - 1


def versions() -> dict[str, str]:
    """Return the versions of what drives and draws; pygame comes under either of two names."""
    found = {}
    for name in ("highway-env", "gymnasium", "numpy", "pygame-ce", "pygame"):
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    return found
