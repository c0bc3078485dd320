"""Random evidences on policies, the same for a seed in every version: what older rules said of them is recorded."""

import json
from collections.abc import Callable, Mapping
from random import Random

from evidences import as_recorded
from eyechart.stats.statistic import Statistic
from eyechart.verdicts.policy_verdict import PolicyVerdict, judge_policy
from eyechart.verdicts.share_predicates import MissingConditions

Numbers = dict[str, object]
Make = Callable[[str, Statistic, Numbers], Statistic]
"""What gives a statistic of a name the further numbers that its kind has."""

SINGLES = ("camera:top", "camera:wrist")
CHANNELS = ("cameras", *SINGLES, "state", "instruction")
MOVES = tuple(
    f"{told}{which}_{side}" for told in ("", "told_") for which in ("named", "other") for side in ("plus", "minus")
)
WORLD = ("exchanged", "recoloured", "decoys")


def _of(channel: str) -> tuple[str, ...]:
    """Return the conditions of a camera, or of all."""
    over = "" if channel == "cameras" else f"@{channel.partition(':')[2]}"
    return (*(f"{name}@{channel}" for name in ("swapped", "matched", "near")), f"blank{over}", f"exchanged{over}")


CONDITIONS = tuple(
    dict.fromkeys(
        (
            *(name for channel in ("cameras", *SINGLES) for name in _of(channel)),
            *("swapped@state", "swapped@instruction", "real_repeat", "nudged", "noise", *WORLD, *MOVES),
        )
    )
)
FOLLOWS = tuple(f"follow.{which}" for which in ("named", "other", "told", "rather", "logged"))
CLAIMS = ("responds", "responds.shown", "responds.alike")

_SHARES: Mapping[str, tuple[float, float]] = {"used": (0.2, 0.5), "ignored": (0.0, 0.05), "open": (0.01, 0.2)}
_LOWS = (-0.05, 0.0, 0.0199999, 0.02, 0.0200001, 0.03, 0.0300001, 0.05, 0.09, 0.0999999, 0.1, 0.15, 0.3, 0.31, 1.1)
_WIDE = (0.0, 0.02, 0.0499999, 0.05, 0.079, 0.08, 0.3, 1.0)
_PS = (1e-4, 0.001, 0.0010001, 0.0099999, 0.01, 0.0100001, 0.02, 0.3, 1.0)
_NOTES = ("", "the run did not ask this", "one episode alone")
NO_VARIATION = "the answers do not vary from episode to episode"


def _ci(rng: Random) -> tuple[float, float] | None:
    low = rng.choice(_LOWS)
    return None if rng.random() < 0.06 else (low, low + rng.choice(_WIDE))


def drawn_share(rng: Random, usual: str, often: float, make: Make, name: str) -> Statistic | None:
    """Return a share as usual so often, else one at or beside the margins; None where it is not there."""
    if rng.random() < often:
        low, high = _SHARES[usual]
        return make(name, Statistic((low + high) / 2, 72, (low, high)), {"episodes": 12})
    if usual == "ignored" and rng.random() < 0.3:
        return make(name, Statistic(0.0, 72, (0.0, 0.0)), {"episodes": 12, "same": 1.0})
    if (kind := rng.random()) < 0.12:
        return None
    if kind < 0.2:
        return make(name, Statistic(None, rng.choice((0, 9)), note=rng.choice(_NOTES)), {})
    ci = _ci(rng)
    value = rng.choice((-0.01, 0.03, 0.07, 0.4, 1.0, 1.2)) if ci is None else (ci[0] + ci[1]) / 2
    numbers: Numbers = {"episodes": rng.choice((5, 6, 12, 12, 12))} if rng.random() < 0.95 else {}
    p = rng.choice(_PS) if rng.random() < 0.4 else None
    if rng.random() < 0.15:
        numbers["lost"] = rng.choice((0.05, 0.1, 0.1000001, 0.4))
    if rng.random() < 0.15:
        numbers["same"] = rng.choice((0.0, 0.99, 1.0))
    if rng.random() < 0.12:
        numbers["carried"] = dict.fromkeys(("grip", "dx", "step 8", "step 9", "step 10")[: rng.randint(1, 5)], 0.84)
    if rng.random() < 0.15:
        numbers |= {"scatter": rng.choice((0.01, 0.02, 0.0200001, 0.5)), "scatter_p": rng.choice(_PS)}
    if name.startswith("beyond") and rng.random() < 0.3:
        numbers["still"] = ["gripper", "height"][: rng.randint(1, 2)]
    return make(name, Statistic(value, rng.choice((34, 72)), ci, p), numbers)


def drawn_follow(rng: Random, usual: str, often: float, make: Make, name: str) -> Statistic | None:
    """Return how far something is followed, likewise."""
    if rng.random() < often:
        value = {"used": 0.6, "ignored": 0.0, "open": 0.2}[usual]
        p = 0.0002 if usual == "used" else 0.5
        numbers = {"episodes": 12, "smallest_p": 0.0002, "heading": rng.choice((0.5, 0.9, 0.9))}
        return make(name, Statistic(value, 72, (value - 0.2, value + 0.2), p), numbers)
    if (kind := rng.random()) < 0.15:
        return None
    if kind < 0.25:
        return make(name, Statistic(None, 0, note=rng.choice(_NOTES)), {})
    low = rng.choice((-0.9, -0.2, -1e-7, 0.0, 0.05, 0.1, 0.1000001, 0.15, 0.1500001, 0.3, 0.3000001))
    ci = None if rng.random() < 0.06 else (low, low + rng.choice((0.0, 0.1, 0.2, 0.8)))
    value = 0.2 if ci is None else (ci[0] + ci[1]) / 2
    numbers: Numbers = {"episodes": 12}
    if rng.random() < 0.9:
        numbers["smallest_p"] = rng.choice((0.0002, 1 / 128, 0.01, 1 / 64))
    if rng.random() < 0.15:
        numbers["lost"] = rng.choice((0.1, 0.1000001, 0.4))
    if rng.random() < 0.5:
        numbers["heading"] = rng.choice((-1.0000001, -0.5, 0.7, 0.7071, 0.7072, 0.72, 1.0))
    if rng.random() < 0.3:
        parts = {part: rng.choice((0.1, 0.44, 0.45, 0.46, 0.9)) for part in ("along x", "told 'red'", "along y")}
        numbers["parts"] = {part: {"value": one - 0.01, "at_most": one, "episodes": 6} for part, one in parts.items()}
    return make(name, Statistic(value, 72, ci, None if rng.random() < 0.06 else rng.choice(_PS), note=""), numbers)


def responding(rng: Random, name: str, make: Make) -> Statistic | None:
    """Return a share of episodes that respond, with what it may be of a whole data set."""
    if rng.random() < 0.3:
        return None
    if rng.random() < 0.1:
        return make(name, Statistic(None, 0, note="no episodes"), {})
    n = rng.choice((10, 12, 44, 60))
    k = rng.choice((0, 0, 0, 1, 1, 2, 4, 5, 6, n))
    ci = None if rng.random() < 0.05 else (0.0, rng.choice((0.0994, 0.0999999, 0.1, 0.31)))
    return make(name, Statistic(k / n, n, ci), {"k": k})


def guarding(rng: Random, make: Make, *, often: float) -> dict[str, Statistic | None]:
    """Return what the guards read, as usual so often each."""
    usual: dict[str, tuple[Statistic, Numbers]] = {
        "motions": (Statistic(1.0, 72), {}),
        "misfit": (Statistic(0.2, 72), {"offset": 0.1, "spread": 1.1, "offset_of": "dx", "spread_of": "dy"}),
        "variation": (Statistic(0.9, 72), {}),
        "noise": (Statistic(0.0, 72), {}),
        "memory": (Statistic(0.0, 72, p=0.5), {}),
    }
    odd: dict[str, Callable[[], tuple[Statistic, Numbers]]] = {
        "motions": lambda: (Statistic(rng.choice((None, 0.5, 0.89, 0.8999999, 0.9, 0.95)), 100), {}),
        "misfit": lambda: _misfit(rng),
        "variation": lambda: (
            Statistic(rng.choice((None, 0.0, 0.0199999, 0.02, 0.5)), 72, note="all the same"),
            {"still": ["grip", "dx"][: rng.randint(1, 2)]} if rng.random() < 0.4 else {},
        ),
        "noise": lambda: _noise(rng),
        "memory": lambda: (Statistic(rng.choice((0.02, 0.0200001, 0.5)), 90, p=rng.choice(_PS)), {}),
    }
    statistics: dict[str, Statistic | None] = {}
    for name, (one, numbers) in usual.items():
        statistics[name] = make(name, *(odd[name]() if rng.random() > often else (one, numbers)))
    if rng.random() < 0.3:
        statistics["memory"] = rng.choice((None, Statistic(None, 9)))
    return statistics


def _misfit(rng: Random) -> tuple[Statistic, Numbers]:
    value = rng.choice((None, 0.5, 0.9999999, 1.0, 2.0))
    numbers: Numbers = {"far_off": 3, "far_off_of": ["dx", "grip"]} if rng.random() < 0.3 else {}
    if value is not None and rng.random() < 0.9:
        numbers |= {"offset": rng.choice((0.1, 1.0, 1.0000001, 9.0)), "spread": rng.choice((1.0, 3.0, 3.0000001, 9.0))}
        if rng.random() < 0.9:
            numbers |= {"offset_of": "dx", "spread_of": "dy"}
    ci = None if value is None or rng.random() < 0.5 else (value / 2, 2 * value)
    return Statistic(value, 72, ci, note="no logged action"), numbers


def _noise(rng: Random) -> tuple[Statistic, Numbers]:
    numbers: Numbers = {"seeds": 2} if rng.random() < 0.4 else {}
    if rng.random() < 0.2:
        numbers["lost"] = rng.choice((0.1, 0.1000001, 0.4))
    if rng.random() < 0.2:
        return Statistic(None, 72, note=NO_VARIATION), numbers | {"alike": True}
    value = rng.choice((None, 0.0, 0.0099999, 0.01, 0.0100001, 0.02, 0.0200001, 0.0999999, 0.1, 0.3, 0.5, 0.5000001))
    return Statistic(value, 72, note="" if value is not None else rng.choice(_NOTES)), numbers


PROFILES: Mapping[str, tuple[str, str, str]] = {
    "blind": ("ignored", "ignored", "ignored"),
    "presence": ("ignored", "ignored", "used"),
    "pose": ("used", "ignored", "used"),
    "content": ("used", "used", "used"),
    "open": ("open", "open", "open"),
}
"""What other pictures, those at a similar state and grey ones usually are."""


def _camera(rng: Random, channel: str, kind: str, often: float, make: Make) -> dict[str, Statistic | None]:
    """Return the shares of one camera, or of all."""
    swapped, matched, near, blank, exchanged = _of(channel)
    swap, alike, grey = PROFILES[kind]
    usual = {
        f"T.{swapped}": swap,
        f"T.{matched}": alike,
        f"T.{near}": "ignored",
        f"T.{blank}": grey,
        f"T.{exchanged}": "used" if kind == "content" else "ignored",
        f"beyond@{channel}": alike,
        f"swapped.alike@{channel}": swap,
    }
    found = {name: drawn_share(rng, one, often, make, name) for name, one in usual.items()}
    return found | {f"{claim}@{channel}": responding(rng, f"{claim}@{channel}", make) for claim in CLAIMS}


def evidence(rng: Random, axis: str, make: Make) -> dict[str, Statistic]:
    """Return statistics of a policy, of which those of an axis are often odd."""
    odd = rng.choice((0.5, 0.85, 0.95))
    often = {name: odd if name == axis else 0.995 for name in (*RECORDED,)}
    whole = rng.choice((*PROFILES,))
    single = rng.choice((*PROFILES,)) if axis == "single" else whole
    statistics = guarding(rng, make, often=often["guards"])
    statistics |= _camera(rng, "cameras", whole, often["camera"], make)
    for channel in SINGLES:
        statistics |= _camera(rng, channel, single, min(often["single"], often["camera"] + 0.1), make)
    ignored, used, mixed = "ignored", "used", ("used", "ignored", "open")
    for name in ("recoloured", "decoys", "noise", "nudged"):
        statistics[f"T.{name}"] = drawn_share(rng, ignored, min(often["camera"] + 0.1, 0.99), make, f"T.{name}")
    if axis != "guards" or rng.random() < 0.5:
        statistics["T.nudged"] = make("T.nudged", Statistic(0.0, 72, (0.0, 0.0)), {"episodes": 12})
    statistics["T.swapped@state"] = drawn_share(rng, rng.choice(mixed), often["state"], make, "T.swapped@state")
    if rng.random() < 0.4:
        statistics["reads@state"] = drawn_share(rng, rng.choice(mixed), often["state"], make, "reads@state")
    statistics |= {name: responding(rng, name, make) for name in ("responds@state", "responds@instruction")}
    statistic = drawn_share(rng, rng.choice(mixed), often["instruction"], make, "T.swapped@instruction")
    if statistic is not None and statistic.value is not None and rng.random() < 0.5:
        statistic = drawn_texts(rng, make, statistic)
    statistics["T.swapped@instruction"] = statistic
    follows = rng.choice(("all", "none", "all", "none", "absent", "any"))
    for name in FOLLOWS:
        usual = {"all": used, "none": ignored, "absent": ignored, "any": rng.choice(mixed)}[follows]
        often_so = min(often["instruction"], often["camera"])
        statistics[name] = None if follows == "absent" else drawn_follow(rng, usual, often_so, make, name)
    return {name: one for name, one in statistics.items() if one is not None}


def drawn_texts(rng: Random, make: Make, told: Statistic) -> Statistic:
    """Return a share of what it was told, with what was exchanged most often."""
    low = rng.choice((0.0, 0.021, 0.2))
    texts = ["reach  red", "go\nto the " + "very " * rng.choice((0, 20)) + "red one"]
    share = Statistic(told.value, told.n, (low, low + 0.05))
    return make("T.swapped@instruction", share, {"episodes": 12, "texts": texts})


def asked_of(rng: Random) -> MissingConditions:
    """Return what a run did not ask, and what its bank cannot show."""
    if rng.random() < 0.6:
        return MissingConditions()
    few = rng.choice((0.02, 0.1))
    unasked = frozenset(name for name in CONDITIONS if rng.random() < few)
    lacking = {name: f"9 frames have no {name}" for name in CONDITIONS if name not in unasked and rng.random() < few}
    return MissingConditions(unasked, lacking)


def is_read_otherwise(statistics: Mapping[str, Statistic]) -> bool:
    """Return whether a rule that was changed since reads an evidence, so that something else may be said of it.

    What changes not one bit is not used; and what goes beyond noise that hangs on the bytes of the pictures is.
    """
    nudged = statistics["T.nudged"] if "T.nudged" in statistics else Statistic(None, 0)
    bytes_count = (nudged.ci is not None and nudged.ci[0] > 0.02) or (nudged.value or 0.0) > 0.5
    return bytes_count or any(getattr(statistics.get(f"T.swapped@{name}"), "same", None) == 1.0 for name in CHANNELS)


def verdict_of(rng: Random, axis: str, make: Make) -> tuple[Mapping[str, Statistic], PolicyVerdict]:
    """Return the next evidence, and the verdict on it."""
    statistics, asked = evidence(rng, axis, make), asked_of(rng)
    channels = [name for name in CHANNELS if rng.random() < 0.97]
    reads = () if rng.random() < 0.6 else tuple(name for name in CHANNELS if rng.random() < 0.5)
    missing = {"timeout": 2, "refused": 4} if rng.random() < 0.5 else {}
    left = rng.choice((0, 0, 3))
    verdict = judge_policy(
        "m", statistics, channels, scope="here.", missing=missing, left=left, reads=reads, left_out=asked
    )
    return statistics, verdict


def said_of(rng: Random, axis: str, make: Make) -> str:
    """Return what is said of the next evidence: every axis, the guards and the remarks, word by word.

    Nothing of one that is read otherwise since.
    """
    return words_of(*verdict_of(rng, axis, make))


def words_of(statistics: Mapping[str, Statistic], found: PolicyVerdict) -> str:
    """Return what a verdict says of an evidence, likewise."""
    if is_read_otherwise(statistics) or _is_noise(statistics):
        return ""
    axes = {name: (axis.as_dict(), axis.may_be) for name, axis in found.axes.items()}
    words = json.dumps([axes, found.guards, found.remarks, found.headline, found.misfit], sort_keys=True)
    return as_recorded(label_then(words))


def _is_noise(statistics: Mapping[str, Statistic]) -> bool:
    """Return whether noise hides that answers hardly vary: they were constant besides, and now are not."""
    variation, noise = (statistics.get(name, Statistic(None, 0)).value for name in ("variation", "noise"))
    return variation is not None and noise is not None and variation < 0.02 and noise > 0.5


def label_then(words: str) -> str:
    """Return words with the label that stood there when digests were recorded: where more was open, none."""
    return words.replace("uses_camera", "undecided")


RECORDED: Mapping[str, int] = {"camera": 21, "single": 22, "state": 23, "instruction": 24, "guards": 25}
"""The axes of policies of which older rules are recorded, and the seed of each."""
