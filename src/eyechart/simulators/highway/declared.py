"""What the simulator says of itself before highway-env is imported: its picture, commands, seeds and versions."""

from collections.abc import Mapping
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version

PICTURE = "top-down drawing of a highway (highway-env, 600 × 150 pixels)"
MOST_SEED = 2**63 - 1

MEANS: Mapping[str, str] = {
    "STOP": "SLOWER",
    "SLOW": "SLOWER",
    "STRAIGHT": "FASTER",
    "LEFT": "LANE_LEFT",
    "RIGHT": "LANE_RIGHT",
}
"""The meta-action of highway-env that each action is. Its speeds are 20, 25 and 30 m/s: there is no stop, so STOP and
SLOW drive alike. IDLE in the place of FASTER would drive STRAIGHT at 24 m/s, which the paper's table (28.1) excludes.
"""


def versions() -> dict[str, str]:
    """Return the versions of what drives and draws; pygame comes under either of two names."""
    found = {}
    for name in ("highway-env", "gymnasium", "numpy", "pygame-ce", "pygame"):
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    return found
