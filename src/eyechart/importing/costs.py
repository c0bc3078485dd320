"""What an import took from a source, and the tests that missing or guessed columns cost."""

import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from itertools import groupby
from typing import cast

from eyechart.channels import INSTRUCTION, STATE, channels_of
from eyechart.conditions import OVER, by_reason, undrawn_controls
from eyechart.conditions.policies import conditions_of
from eyechart.errors import counted
from eyechart.frames import EXCHANGE, LEAD, Frame, FrameBank
from eyechart.importing import columns as reading
from eyechart.importing.bank import GUESSED, KIND, SAID
from eyechart.importing.cells import loosely_alike, plain_name
from eyechart.importing.doubts import doubts
from eyechart.importing.log_warnings import notes
from eyechart.importing.numerals import unit_named, unit_of
from eyechart.importing.repeats import REPEATS, in_words
from eyechart.spaces.motion import PLACES, MotionSpace

_LARGE = 3_000_000
"""Pixels above which a picture is sent as 5 MB or more, at 1.7 bytes a pixel of a photograph."""
_SIDES = re.compile(r"\b(left|right)\b", re.IGNORECASE)
LEAST_BOUNDED = 6
"""The fewest episodes for a bound on a policy channel's share (docs/decisions/policies.md)."""
_PRICES = {
    "gap": "decisions are held to it as the distance",
    "episode": "its frames are one draw, and are exchanged whole",
    "step": "it orders the frames of an episode",
    "scenario": "other frames are shown within a scenario, and across",
}
"""The effect of a guessed place on the verdict."""
_LEAST_WAYS = 200
"""The fewest ways to exchange episodes for the distance test's two-sided level of .01."""
_MANY = 12
MOST_OF_STRATUM, FEWEST_OF_VALUE = 12, 8
"""A claim is judged in each value of a stratum of up to so many values, if it has at least so many frames."""


def taken(bank: FrameBank) -> list[str]:
    """Return what an imported bank took: renamed columns, conversions, motions and repeats.

    One line for each.
    """
    settings = bank.manifest.settings
    lines = [*_columns_taken(bank)]
    done, how, marks = (_setting(bank, name) for name in ("converted", "convert", "no_lead"))
    if marks:
        lines.append(f"nothing ahead: {', '.join(f'{count} rows of {mark}' for mark, count in marks.items())}")
    if done and how:
        kinds = ", ".join(f"{count} {kind}" for kind, count in done.items() if kind != "pictures")
        lines.append(f"converted to PNG: {done.get('pictures')} pictures ({kinds}), over {how.get('background')}")
    if again := settings.get(REPEATS):
        lines.append(in_words(cast("list[dict[str, object]]", again), kept=bool(settings.get("keep_repeats"))))
    for many in (_setting(bank, KIND).get("said"), settings.get(SAID)):
        lines += map(str, many if isinstance(many, list) else ())
    return lines


def _columns_taken(bank: FrameBank) -> Iterator[str]:
    """Yield the columns with other names than their places: given ones, and guessed ones."""
    columns, gap = _setting(bank, "columns"), bank.manifest.gap
    said = {
        place: f"{place} from '{of}'{f' in {gap.unit}' if gap and place == 'gap' else ''}"
        for place, of in columns.items()
        if place in reading.ROLES and of not in reading.ROLES[place]
    }
    guessed = [said.pop(place) for place in _setting(bank, GUESSED) if place in said]
    if said:
        yield f"columns: {', '.join(said.values())}"
    if guessed:
        yield f"columns, guessed by their names: {', '.join(guessed)}"
    if columns and (unplaced := _unplaced(bank, {*map(str, columns.values())})):
        more = f" and {len(unplaced) - _MANY} more" if len(unplaced) > _MANY else ""
        of = "PLACE=COLUMN gives one a place" if gap else "gap=COLUMN names the distance ahead"
        yield f"columns without a place, kept as ground truth: {', '.join(unplaced[:_MANY])}{more}; --map {of}"


def _unplaced(bank: FrameBank, taken: set[str]) -> list[str]:
    """Return the columns that are no place, no stratum, no distance of a moved thing, and of no prompt."""
    first = bank.frames[0]
    read = {*taken, *first.strata, *first.fields, *first.placed, *_PLACED.values()}
    return [] if bank.manifest.motion is not None else [name for name in first.truth if name not in read]


def _pixels(bank: FrameBank) -> Iterator[int]:
    """Yield the pixels of some of the bank's pictures."""
    for frame in bank.frames[:: max(1, len(bank) // 20)]:
        for high, wide, _ in bank.shapes(frame).values():
            yield high * wide


_PLACED = {
    "lead_mid_near": "lead_mid_near_m",
    "lead_mid_far": "lead_mid_far_m",
    "lead_drawn": LEAD,
    "exchange_own": EXCHANGE,
    "exchange_beside": EXCHANGE,
}
"""The counterfactual pictures with a distance of their own, and its column."""


def costs(bank: FrameBank) -> list[str]:
    """Return one line for each test that the bank's missing columns make impossible."""
    manifest, lines = bank.manifest, []
    if manifest.motion is not None:
        return _costs_of_policies(bank, manifest.motion)
    if manifest.gap is None:
        lines.append("no gap: the test of distance is not run (depth_observational cannot say)")
        lines += _like_a_gap(bank)
    elif "episode" in manifest.absent and not manifest.independent:
        lines.append("no episodes, and not declared --independent: the gap tests cannot say")
    if "scenario" in manifest.absent:
        lines.append("no scenarios: cross_scenario is not shown (scene_cue cannot say)")
    if "step" in manifest.absent and "episode" not in manifest.absent:
        apart = len([*groupby(bank, lambda one: one.drive)]) > len({one.drive for one in bank})
        between = "; rows of others lie between: are two called alike?" * apart
        lines.append(f"no steps: the rows of an episode count as its steps, in their order{between}")
    lines += [*doubts(bank), *_counted_twice(bank), *_nearly_one(bank), *_not_asked_apart(bank)]
    if all(frame.mirror_axis == "none" for frame in bank):
        lines.append("no mirror axis: mirrored is not shown (lateral is not_tested)")
    lines += [
        f"{name}: {lacking} of {len(bank)} frames have no such picture, and are left out of its tests"
        for name, lacking in undrawn_controls(bank).items()
    ]
    lines += _moved_in(bank)
    lines += [
        f"no {column} for some pictures of {name}: these are left out of the tests by distance"
        for name, column in _PLACED.items()
        if any(name in one.counterfactuals and one.truth.get(column) is None for one in bank)
    ]
    lines += _prices(bank)
    if (wide := max(_pixels(bank))) > _LARGE:
        lines.append(
            f"large pictures: they leave as PNG, about {wide * 1.7e-6:.0f} MB each, which many servers refuse; import "
            "them with --convert --longest 1280"
        )
    left_out = manifest.settings.get("left_out")
    if isinstance(left_out, list) and left_out:
        lines.append(f"left out, because a bank needs these names: {', '.join(map(str, left_out))}")
    return lines


def _moved_in(bank: FrameBank) -> Iterator[str]:
    """Yield the unit of moved things' distances if their columns' names end with another."""
    gap, moved = bank.manifest.gap, sorted({name for one in bank for name in one.placed})
    if gap is not None and moved and unit_named(gap.unit) != "m":
        yield f"{', '.join(moved)}: read in {gap.unit}, like the gap"


def _not_asked_apart(bank: FrameBank) -> Iterator[str]:
    """Yield the strata, and the values of strata, by which no claim is judged."""
    for name in dict.fromkeys(name for frame in bank for name in frame.strata):
        frames = Counter(str(one) for frame in bank if (one := frame.strata.get(name)) not in {None, ""})
        if not 1 < len(frames) <= MOST_OF_STRATUM:
            many = f"{counted(len(frames), 'value')}, and a claim is judged by those of 2 to {MOST_OF_STRATUM}"
            yield f"stratum '{name}': it has {many}: a place where a controller is blind is not found by it"
        elif few := [value for value, count in frames.items() if count < FEWEST_OF_VALUE]:
            has = f"{', '.join(few)}: fewer than {FEWEST_OF_VALUE} frames each"
            yield f"stratum '{name}': {has}, so that no claim is judged in them alone"


def _counted_twice(bank: FrameBank) -> Iterator[str]:
    """Yield repeated names of episodes, and moments that occur in two drives."""
    absent = bank.manifest.absent
    drives = Counter(episode for episode, _ in {(frame.episode, frame.scenario) for frame in bank})
    again = 0 if "episode" in absent else sum(count > 1 for count in drives.values())
    recur = len({(frame.episode, frame.step) for frame in bank}) < len(bank)  # a step occurs twice
    if again and ("step" in absent or not recur):
        yield (
            f"{counted(again, 'episode name', 'occur')} in several scenarios, and count as a drive in each; if one "
            "drive went through several, --map scenario= leaves the scenarios out"
        )
    images, first, twice = bank.manifest.images, dict[object, Frame](), list[tuple[Frame, Frame]]()
    for frame in bank:
        shows = (*map(images.get, frame.pictures.values()), *sorted(frame.truth.items()))
        if (other := first.setdefault(shows, frame)).drive != frame.drive:
            twice.append((frame, other))
    if twice:
        yield (
            f"{len(twice)} of {len(bank)} frames have the same picture as a frame of another drive, such as "
            f"'{twice[0][0].id}' and '{twice[0][1].id}': each counts as a separate moment"
        )


def _nearly_one(bank: FrameBank) -> Iterator[str]:
    """Yield names and columns that differ from others only in how they are written."""
    named = {"episodes": {one.episode for one in bank}, "scenarios": {one.scenario for one in bank}}
    for name in (*bank.frames[0].strata, *bank.frames[0].fields):
        found = ({**one.fields, **one.strata}.get(name) for one in bank)
        named[f"values of '{name}'"] = {str(value) for value in found if value is not None}
    for place, names in named.items():
        first: dict[str, str] = {}
        pairs = [
            (other, name) for name in sorted(names) if (other := first.setdefault(loosely_alike(name), name)) != name
        ]
        if pairs and place[:-1] not in bank.manifest.absent:
            more = f", as do {len(pairs) - 1} more" if len(pairs) > 1 else ""
            yield (
                f"the {place} {pairs[0][0]!a} and {pairs[0][1]!a} differ only in how they are "
                f"written, and count as two{more}"
            )
    for place, column in _setting(bank, "columns").items():
        beside = [one for one in bank.frames[0].truth if one != column and plain_name(one) == plain_name(str(column))]
        if beside and column in reading.ROLES.get(place, ()):
            yield f"{place} is '{column}', not the column '{beside[0]}'; --map {place}={beside[0]} takes that one"


def _setting(bank: FrameBank, name: str) -> Mapping[str, object]:
    """Return a setting of an import that is a mapping, empty without it."""
    found = bank.manifest.settings.get(name)
    return found if isinstance(found, dict) else {}


def _like_a_gap(bank: FrameBank) -> Iterator[str]:
    """Yield numeric columns that look like the distance if no gap was named."""
    for name in bank.frames[0].truth if bank.frames else ():
        numbers = [one for frame in bank if isinstance(one := frame.truth.get(name), int | float)]
        if reading.is_distance(name) and len({*numbers}) > 1:
            unit = "" if unit_of(name) else " --unit m (or its unit)"
            yield f"'{name}' looks like the distance: --map gap={name} --threshold N{unit} takes it; below N is near"


def _others_like(bank: FrameBank, column: str) -> str:
    """Return, in words, the other columns that look like the guessed distance."""
    names = [
        name
        for name, one in bank.frames[0].truth.items()
        if name not in {column, *bank.frames[0].placed} and reading.is_distance(name) and not isinstance(one, str)
    ]
    return f", and so could be {', '.join(names)}" if names else ""


def _prices(bank: FrameBank) -> Iterator[str]:
    """Yield the effect of each guessed column on the verdict, and how to leave it out."""
    for place, column in _setting(bank, GUESSED).items():
        if place == "scenario" and bank.manifest.gap is not None and "episode" not in bank.manifest.absent:
            yield _price_of_scenarios(bank, str(column))
        elif place in _PRICES:
            other = _others_like(bank, str(column)) if place == "gap" else ""
            yield f"guessed: {place} is '{column}': {_PRICES[place]}{other}; --map {place}= leaves it out"


def _price_of_scenarios(bank: FrameBank, column: str) -> str:
    """Return the cost of guessed scenarios for the distance test, which exchanges within each."""
    inside = [*Counter(scenario for scenario, _ in {(one.scenario, one.episode) for one in bank}).values()]
    ways, over = (math.prod(math.factorial(min(one, _MANY)) for one in many) for many in (inside, [sum(inside)]))
    lost = ways < _LEAST_WAYS <= over
    each = f"{min(inside)} episodes each" if min(inside) == max(inside) else f"{min(inside)} to {max(inside)} episodes"
    many = f"{len(inside)} scenarios of {each}"
    cost = f"that is {ways} ways, too few to test distance" if lost else "distance is tested within each"
    return (
        f"guessed: scenario is '{column}': whole episodes are exchanged only within a scenario, {many}: {cost}. "
        "--map scenario= exchanges them over all, but then a place that is always near looks like distance"
    )


def _unpaired(motion: MotionSpace) -> list[str]:
    """Return a note on rotations of places that are not measured from the state's, if the state has some."""
    moved, stays = motion.rotations_of("motion"), motion.rotations_of("state")
    alone = sum(one.state is None for one in moved)
    if motion.kind not in PLACES or not stays or not alone:
        return []
    counts = f"the motion has {counted(len(moved), 'rotation')} and the state {len(stays)}"
    how = "Declare as many of each, in one order; in a rig, 'state' of [[motion.rotations]] names each"
    return [f"{counts}: {alone} belong to none of the state's, and are compared as they are, not from its. {how}"]


def _costs_of_policies(bank: FrameBank, motion: MotionSpace) -> list[str]:
    """Return a policy bank's motions, the tests that it cannot support, and oddities of its log."""
    steps, wide = motion.shape
    relative = sum(dimension.state is not None for dimension in motion.dimensions)
    rate = "" if motion.rate_hz is None else f" at {motion.rate_hz:g} Hz"
    kind = f"{motion.kind}, {relative} relative to the state" if motion.kind in PLACES else motion.kind
    lines = [f"motions: {steps} steps of {wide} numbers{rate}, {kind}"]
    if motion.rotations:
        lines.append(f"rotations, compared by their angle: {motion.rotations_in_words()}")
    lines += _unpaired(motion)
    if lacking := sum(not frame.motion for frame in bank):
        lines.append(f"{lacking} of {len(bank)} frames have no logged motion: fewer than {steps} steps follow them")
    if (episodes := len({frame.drive for frame in bank})) < LEAST_BOUNDED:
        lines.append(f"{episodes} episodes: no share can be bounded with fewer than {LEAST_BOUNDED}")
    if INSTRUCTION not in channels_of(bank):
        lines.append("no instruction: following it cannot be tested (no_power)")
    if STATE not in channels_of(bank):
        lines.append("no state: pictures at a similar state are not shown, so the use of pictures stays undecided")
    unshown = {name: why for name, why in conditions_of(bank)[1].items() if OVER in name and "frame" in why}
    return [
        *lines,
        *(f"{names}: {why}" for names, why in by_reason(unshown).items()),
        *_nearly_one(bank),
        *_costs_of_reflection(bank, motion),
        *notes(bank),
    ]


def _costs_of_reflection(bank: FrameBank, motion: MotionSpace) -> Iterator[str]:
    """Yield why the mirrored moment is not shown, or a possible error in its instructions."""
    if (why := conditions_of(bank)[1].get("mirrored")) is not None:
        yield f"mirrored: {why}" + ("" if motion.mirrored else "; declare it in [reflection] of a --rig")
        return
    said = {str(field) for frame in bank for field in frame.fields.values()}
    sided = sorted(one for one in said if _SIDES.search(one) and motion.reflect_text(one) == one)
    if sided:
        words = 'declare exchanged words in [reflection.words], such as left = "right"'
        named = f"{len(sided)} instructions name a side, such as '{sided[0][:60]}', and stay as they are"
        yield f"mirrored: {named}; {words}"
