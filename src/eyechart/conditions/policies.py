"""The conditions that a bank can show a policy, and why it cannot show the others."""

from collections.abc import Sequence

from eyechart.channels import (
    ALONE,
    BY_STATE,
    CAMERA,
    CAMERAS,
    INSTRUCTION,
    STATE,
    TOLD,
    channels_of,
    instruction_column,
    partners,
    whose,
)
from eyechart.conditions import (
    CONDITIONS,
    EXCHANGED,
    FROZEN,
    ONE_INSTANT,
    OVER,
    PARTNERS,
    TABLE,
    asked_of,
    is_available,
    is_of_one_instant,
)
from eyechart.corruptions import CORRUPTIONS, STEPS
from eyechart.frames import FrameBank
from eyechart.stats.partners import NOBODY
from eyechart.stats.total_effect import Subset, subsets

LEAST_MATCHED = 0.25
"""The least share of frames with a partner at a similar state; below it no frame is asked."""
_DRAWN = tuple(one.name for one in asked_of("policy") if "counterfactual" in one.needs)
_PLAIN = {"real", "real_repeat", "nudged", "blank", "noise", "mirrored"}
COMPUTED = frozenset({"blank", "noise", "mirrored", *_DRAWN})
"""The conditions whose pictures no camera took; a policy may fail on these and on no others."""
_FURTHER = tuple(one.name for one in asked_of("policy") if one.name not in {*_PLAIN, *_DRAWN, *PARTNERS, FROZEN})


def conditions_of(bank: FrameBank, *, reading: bool = True) -> tuple[tuple[str, ...], dict[str, str]]:
    """Return the conditions of a policy on a bank, and why others are left out.

    Without ``reading`` no picture is opened, for a run without a copy of them; ``mirrored`` is then
    left out.
    """
    every, left_out = ["real", "real_repeat", "nudged"], {}
    for channel in channels_of(bank):
        over = channel.removeprefix(CAMERA) if channel.startswith(CAMERA) else ""
        every += [f"{name}{OVER}{channel}" for name in PARTNERS if name != ALONE and not (over and name == "kept")]
        if channel == CAMERAS:
            every += ["blank", "noise"]
        elif over:
            every.append(f"blank{OVER}{over}")
            every += [f"{EXCHANGED}{OVER}{over}"] if all(EXCHANGED in frame.counterfactuals for frame in bank) else []
    every += [*([FROZEN] if bank.manifest.history else []), *(["mirrored"] if reading else []), *_DRAWN, *_FURTHER]
    for name in every:
        if why := _lacking(name, bank):
            left_out[name] = why
    return tuple(name for name in every if name not in left_out), left_out


def further_conditions(bank: FrameBank) -> tuple[str, ...]:
    """Return the conditions that a bank can show but that are asked only by name.

    With several cameras they are noise in one camera, and one camera alone kept.
    """
    names = [channel.removeprefix(CAMERA) for channel in channels_of(bank) if channel.startswith(CAMERA)]
    wanted = [one for name in names for one in (f"noise{OVER}{name}", f"kept{OVER}{CAMERA}{name}")]
    return tuple(one for one in wanted if not _lacking(one, bank))


def listed_conditions() -> dict[str, str]:
    """Return all conditions in words, first those of policies over a channel or a camera."""
    every = {f"{name}{OVER}CHANNEL": TABLE[name] for name in PARTNERS} | {name: TABLE[name] for name in _DRAWN}
    listed = {name: f"{one.image}: {one.asks}" for name, one in every.items()}
    for one in (TABLE[name] for name in ("blank", "noise", EXCHANGED)):
        listed[f"{one.name}{OVER}CAMERA"] = f"{one.image}, in one camera: {one.asks}"
    listed |= {name: f"{condition.image}: {condition.asks}" for name, condition in CONDITIONS.items()}
    steps = f"{STEPS[0]} to {STEPS[-1]}"
    return listed | {
        f"{one.name}_{STEPS[0]} ... {one.name}_{STEPS[-1]}": f"true frame under {one.words}, steps {steps}: how far?"
        for one in CORRUPTIONS.values()
    }


def unshown_channels(bank: FrameBank) -> dict[str, str]:
    """Return the channels of a bank that cannot be exchanged, with the reason."""
    left_out = conditions_of(bank)[1]
    names = {channel: f"swapped{OVER}{channel}" for channel in channels_of(bank)}
    return {channel: left_out[name] for channel, name in names.items() if name in left_out}


def subset_conditions(bank: FrameBank) -> dict[Subset, str]:
    """Return the condition under which each subset of channels comes from the partner.

    The channels are cameras, state and instruction. The empty subset is ``real``. The full set
    would be the partner's own moment and is left out. All subsets use the same partner. Empty if
    the bank has cameras only.
    """
    whole = [name for name in channels_of(bank) if not name.startswith(CAMERA)]
    if len(whole) < 2:
        return {}
    return {some: _subset_condition(some, whole) for some in subsets(whole)[:-1]}


def _subset_condition(some: Subset, whole: Sequence[str]) -> str:
    if not some:
        return "real"
    if some == {CAMERAS}:
        return f"swapped{OVER}{CAMERAS}"
    if len(some) == len(whole) - 1:
        return f"kept{OVER}{next(name for name in whole if name not in some)}"
    return f"{ALONE}{OVER}{next(iter(some))}"


def _lacking(name: str, bank: FrameBank) -> str:
    """Return why a bank cannot show a condition; empty if it can."""
    base, _, channel = name.partition(OVER)
    if base in PARTNERS:
        return _unpartnered(base, channel, bank)
    if base.startswith(TOLD) and instruction_column(bank) is None:
        return "the bank has no instruction"
    if name == "mirrored" and (bank.manifest.motion is None or not bank.manifest.motion.mirrored):
        return "the bank does not say what a reflected motion is"
    if name == "mirrored" and (pair := _unlike_pair(bank)):
        return f"the pictures of {pair}, which exchange places, differ in size"
    if is_of_one_instant(base, bank):
        return ONE_INSTANT
    lacking = sum(not is_available(name, frame, bank) for frame in bank)
    what = "mirror axis" if name == "mirrored" else "such picture"
    return f"{lacking} of {len(bank)} frames have no {what}" if lacking else ""


def _unlike_pair(bank: FrameBank) -> str:
    """Return in words two cameras that a reflection exchanges and whose pictures differ in size."""
    first = bank.frames[0]
    pairs = [(camera.name, camera.mirrors) for camera in first.cameras if camera.mirrors]
    shapes = bank.shapes(first) if pairs else {}
    return next((f"'{one}' and '{other}'" for one, other in pairs if shapes[one] != shapes[other]), "")


def _unpartnered(base: str, channel: str, bank: FrameBank) -> str:
    """Return why frames lack partners, or partners at a similar state; empty if they have them."""
    if base in BY_STATE and channel in {STATE, INSTRUCTION}:
        return "only pictures are matched by the state"
    if base in BY_STATE and not bank.manifest.state:
        return "the bank has no state to match by"
    without = _alone("swapped", channel, bank)
    if without:
        return f"{without} of {len(bank)} frames have no frame of another episode that differs in {_its_name(channel)}"
    if base in BY_STATE and (without := _alone(base, channel, bank)) > (1 - LEAST_MATCHED) * len(bank):
        return f"{without} of {len(bank)} frames have no frame of another episode at a similar state"
    return ""


def _its_name(channel: str) -> str:
    return f"the {channel.removeprefix(CAMERA)} camera" if channel.startswith(CAMERA) else f"its {channel}"


def _alone(base: str, channel: str, bank: FrameBank) -> int:
    """Return the number of frames without a partner."""
    return int(
        (partners(bank.frames, *whose(base, channel), bank.manifest.images, bank.manifest.motion) == NOBODY).sum()
    )
