"""Who drives by sight, in a word: of each driver the comparison that asks the most of it, and why it shows no more."""

from collections.abc import Mapping

from eyechart.studies import Finding
from eyechart.studies.closed_loop import ClosedLoopScore
from eyechart.studies.closed_loop.blind import CAMERA, CANNOT_SAY, DIFFERS, NO_DIFFERENCE, OUTCOMES, SAME, Blind, bounds

WORDS = {
    "sees": "drives by what it sees",
    "partly": "its pictures matter in part",
    "blind": "drives the same without its pictures",
}
FINDINGS = {NO_DIFFERENCE: "no difference found", SAME: "identical drives", CANNOT_SAY: "cannot say"}
_NOT_ASKED = f" Whether it depends on {CAMERA} was not asked"


def by_sight(score: ClosedLoopScore) -> dict[str, Blind]:
    """Return by name who drove the same worlds with other pictures too, each with what asks the most of it.

    Where models were asked, they are the ones that count, and not the scripted policies beside them.
    """
    told: dict[str, Blind] = {}
    asked = {one.driver.label for one in score.drives if one.asked}
    for one in (one for one in score.blind if one.of_pictures and (not asked or one.driver.label in asked)):
        who = named(one, score)
        if who not in told or (one.of_camera and not told[who].of_camera):
            told[who] = one
    return told


def named(one: Blind, score: ClosedLoopScore) -> str:
    """Return who drove, and where there are several simulators, in which."""
    return f"{one.driver.label} in {one.driver.simulator}" if len(score.simulators) > 1 else one.driver.label


def word(one: Blind) -> str:
    """Return in a word whether pictures matter to a driver."""
    return WORDS.get(one.tone) or FINDINGS.get(one.finding, "its drives differ")


def told_of(one: Blind, measure: str = "reward") -> tuple[str, str]:
    """Return what a comparison shows of a driver, and why it shows no more; either may be empty."""
    text = one.sentence.removeprefix(f"{one.driver.policy}, {one.condition}: ")
    text = text[:1].upper() + text[1:]
    if one.finding == CANNOT_SAY:
        return "", text
    if one.finding == NO_DIFFERENCE:
        return "", (
            f"No difference from {one.condition} pictures was found in {one.paired.worlds} worlds. That is not none: "
            f"the data allow {bounds(one.paired, measure)}, and more worlds narrow it."
        )
    if one.finding == SAME:
        return text, f"It drove {one.paired.worlds} worlds, and what it does in others was not asked."
    shows, apart, rest = text.partition(_NOT_ASKED)
    if apart:
        return shows, f"{apart.strip()}{rest}"
    return text, "What of its pictures it follows is not asked by driving: 'eyechart run battery' asks."


def findings(score: ClosedLoopScore) -> dict[str, Finding]:
    """Return what an index says of each driver: whether it drives by sight, by the measure that differs most surely."""
    lacking = {one.policy: one.words for many in score.unfinished.values() for one in many}
    served = {spec.partition(" in ")[0]: guard for spec, guard in score.served.items()}
    found: dict[str, Finding] = {}
    for one in by_sight(score).values():
        spec, name = one.driver.policy, decisive(one)
        guard = served.get(spec)
        marks = [f"guard '{guard.name}' failed: {guard.because}"] if guard else []
        by, state = f"{name}, real less {one.condition}", lacking.get(spec, "")
        found.setdefault(spec, Finding(word(one), one.tone, by, one.paired.differences[name], state, marks))
    return found


def decisive(one: Blind) -> str:
    """Return the outcome in which a driver differs with the smallest p after Holm; of none that does, the reward."""
    holm: Mapping[str, float | None] = one.paired.holm
    changed = {name: p for name in OUTCOMES if name in one.paired.changed and (p := holm.get(name)) is not None}
    if one.finding == DIFFERS and changed:
        return min(changed, key=lambda name: changed[name])
    known = [name for name in ("reward", *OUTCOMES) if one.paired.differences[name].value is not None]
    return known[0] if known else "reward"
