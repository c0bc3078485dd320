"""Adversaries and readers on fresh banks: which claims each gets, beside what it does in truth.

    make long-adversaries
    python benchmarks/adversarial_runs.py --worlds simulated-72=10,simulated-288=10,highway=10,rover=5,drone=5

On a bank of a simulator a real run asks: pictures, ledger, stages, score and verdict. What a picture shows is read from
its pixels once for all. In a simulated world the same stages ask about its readings. A controller's row is kept as soon
as it is there, with a digest of the code that judges, so that an interrupted measurement goes on, and only what another
code judged is made anew. Truth is measured by moving one thing, see `adversary_truth`.

Writes ``benchmarks/results/adversaries.json``; exit 1 where a claim is untrue more often than is promised, or a reader
of distance is told so too seldom.
"""

import argparse
import datetime as dt
import json
import random
import shutil
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache, partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import adversary_door
from adversarial_counts import KNOWN, LIMIT, Code, Row, named_places, said_of, write
from adversary_pictures import SIMULATED, Pictures, pictures_of
from adversary_truth import find_rest, find_truth
from eyechart import verdicts
from eyechart.calls import Query, Reply
from eyechart.conditions import CONTROLS, asked_in_stages
from eyechart.frames import LEAD_GAP
from eyechart.models import OpenedModel
from eyechart.models.scripted import CONTROLLERS, Answer, PerceivedPicture
from eyechart.modes import RequestMode
from eyechart.simulators import open_bank_simulator
from eyechart.simulators.banks import BOXED, STAGING
from eyechart.spaces.discrete import DRIVING
from eyechart.spaces.space import Decision
from eyechart.studies import battery
from eyechart.studies.battery.answers import Answers
from eyechart.studies.battery.calibrated_statistics import CalibratedTests, LazyStatistics
from eyechart.studies.battery.paper_statistics import Resampling
from eyechart.studies.battery.scores import statistics_of
from eyechart_organisms.adversaries import ADVERSARIES, Adversary
from eyechart_organisms.calibration.early_stops import sampled
from eyechart_organisms.calibration.world import SETTINGS, Setting, World, make_world
from newcomers import NEWCOMERS, paint
from stranger_door import COLD, open_stranger
from strangers import ENDS, LANES, NOISE, PLACES, READERS, STAGES, TURNS

ROOT = Path(__file__).parents[1]
RESULT = ROOT / "benchmarks" / "results" / "adversaries.json"
WORLDS = "simulated-72=10,simulated-288=10,simulated-144=10,highway=10,rover=5,drone=5"
FIRST_SEED = 7000
"""Banks of other seeds than any that a rule was chosen on."""
RESAMPLES = 999
TOGETHER = 30
"""So many controllers are asked in one run."""

SHIPPED = ("shipped", "files", KNOWN)
WARM_AND_COLD = ("readers", "worst", "stranger readers")
KINDS: Mapping[str, Sequence[str]] = {
    **{kind: tuple(names) for kind, names in NEWCOMERS.items()},
    "stranger noise": tuple(NOISE),
    "stranger lanes": tuple(LANES),
    "stranger stages": tuple(STAGES),
    "stranger turns": tuple(TURNS),
    "stranger ends": tuple(ENDS),
    "stranger places": tuple(PLACES),
    "stranger readers": tuple(READERS),
    "shipped": tuple(ADVERSARIES),
    "files": (*adversary_door.FILES, *adversary_door.PIXELS, *adversary_door.SIZES),
    KNOWN: tuple(CONTROLLERS),
}
"""Who is tried, by kind: newcomers, strangers, those that calibrate has, those of real files, the known answers."""

GROUPS: Mapping[str, Sequence[str]] = {
    "new": tuple(NEWCOMERS),
    "strangers": tuple(kind for kind in KINDS if kind.startswith("stranger ")),
    "shipped": ("shipped", "files"),
    "known": (KNOWN,),
}
"""Kinds that are tried together."""

NOT_FORWARD = frozenset({"stops_at_flipped", "second_nearest", "rearmost", "own_lane", "brightness", "blue_share"})
"""What makes no sense of a picture seen forward, or was written for the pixels of the other."""

Look = Callable[[bytes | None], str]
See = Callable[[bytes | None], PerceivedPicture]


@dataclass(frozen=True)
class Bank:
    """A bank to be made: a simulator with a number, or a simulated world of so many frames."""

    world: str
    number: int

    @property
    def name(self) -> str:
        """Return its name."""
        return f"{self.world}-{self.number}"

    @property
    def is_simulated(self) -> bool:
        """Return whether no picture of it is drawn."""
        return self.world.startswith(SIMULATED)

    @property
    def seed(self) -> int:
        """Return the seed of its first episodes, and of those who are asked about it."""
        return FIRST_SEED + 10 * self.number


def names_of(kind: str, bank: Bank) -> list[str]:
    """Return who of a kind is tried on a bank; readers at both temperatures."""
    if kind == "files" and bank.is_simulated:
        return []
    names = [one for one in KINDS[kind] if bank.world == "highway" or bank.is_simulated or one not in NOT_FORWARD]
    return [name + cold for name in names for cold in (("", COLD) if kind in WARM_AND_COLD else ("",))]


def opened(name: str, kind: str, seed: int) -> Adversary:
    """Return a new controller, that remembers nothing."""
    if kind == KNOWN:
        return Adversary(CONTROLLERS[name].says, CONTROLLERS[name].decide)
    return adversary_door.adversary(name) if kind in SHIPPED else open_stranger(name, seed)


# simulated worlds


def setting_of(frames: int) -> Setting:
    """Return the setting of a simulated world of so many frames, its near lead where the banks' staging has it."""
    setting = Setting("frames_72", "8 episodes of 9 frames", episodes=2, frames=9)
    found = {72: setting, 144: SETTINGS["default"], 288: SETTINGS["frames_288"]}[frames]
    return replace(found, lowest=STAGING >= BOXED)


@cache
def simulated_world(bank: Bank) -> World:
    """Return a simulated world, whose frames bear the colour of their lead."""
    world = make_world(setting_of(int(bank.world.rpartition("-")[2])), np.random.default_rng(bank.seed))
    frames = []
    for frame, one in zip(world.frames, world.shown["real"], strict=True):
        reading = one.sight.reading if one else None
        colour = paint(reading) if reading else None
        frames.append(replace(frame, strata={**frame.strata, "lead_colour": colour}))
    return replace(world, frames=tuple(frames))


@cache
def read(answer: Answer) -> Decision[str]:
    """Return what a run reads of an answer."""
    return DRIVING.read(answer if isinstance(answer, Reply) else Reply(text=answer, finish_reason="stop"))


class Asking:
    """A controller that is asked about a simulated world in stages, each in a random order, as a run asks."""

    def __init__(self, one: Adversary, world: World, rng: random.Random) -> None:
        self.one, self.world, self.rng, self.calls = one, world, rng, 0
        self.given: dict[str, list[Decision[str] | None]] = {}
        self.sent: dict[str, NDArray[np.int64]] = {}

    def ask(self, names: Iterable[str], may: Mapping[str, Sequence[bool]]) -> None:
        """Ask about what some conditions show, of the frames of which that ``may`` be."""
        keys = [
            (name, number)
            for name in names
            for number, shown in enumerate(self.world.shown[name])
            if shown is not None and may.get(name, (True,) * (number + 1))[number]
        ]
        self.rng.shuffle(keys)
        frames = len(self.world.frames)
        for name, number in keys:
            shown = self.world.shown[name][number]
            assert shown is not None
            column = self.given.setdefault(name, [None] * frames)
            column[number] = read(self.one.decide(shown.sight, self.rng))
            self.sent.setdefault(name, np.full(frames, -1))[number] = self.calls
            self.calls += 1

    def answers(self, name: str) -> Answers:
        """Return its answers so far."""
        decisions = {condition: tuple(column) for condition, column in self.given.items()}
        return Answers(name, self.world.frames, DRIVING, LEAD_GAP, decisions, sent=self.sent)


def sampled_frames(world: World, seed: int) -> dict[str, list[bool]]:
    """Return of which frames the sampled controls may be asked."""
    whole = {
        name: tuple(None if one is None else read("SLOW") for one in column) for name, column in world.shown.items()
    }
    few = sampled(Answers("", world.frames, DRIVING, LEAD_GAP, whole), seed).decisions
    return {name: [one is not None for one in few[name]] for name in few if few[name] != whole[name]}


def judge_simulated(bank: Bank, name: str, kind: str) -> Row:
    """Return what is said of a controller on a simulated world."""
    begun, world = time.process_time(), simulated_world(bank)
    found = judge_in_world(opened(name, kind, bank.seed), world, f"{bank.seed}/{name}", bank.seed)
    row = replace(found, bank=bank.name, name=name, kind=kind)
    return replace(row, seconds=round(time.process_time() - begun, 3))


def judge_in_world(one: Adversary, world: World, chance: str, seed: int) -> Row:
    """Return what is said of a new controller that is asked in stages, in an order and with coins of ``chance``."""
    asking, may = Asking(one, world, random.Random(chance)), sampled_frames(world, seed)  # noqa: S311 - no secret
    wanted = [name for name in world.shown if name not in CONTROLS]
    supplied = asked_in_stages([name for name in CONTROLS if name in world.shown])
    how, asked = Resampling(resamples=RESAMPLES, seed=seed, intervals=False), list[str]()
    while wanted:
        asking.ask(wanted, may)
        asked += wanted
        given = replace(asking.answers(chance), sent={})  # as a run finds its stages
        statistics = LazyStatistics(CalibratedTests(given, how).tests())
        wanted = list(verdicts.controls_wanted(statistics, supplied=supplied, conditions_run=asked))
    answers = asking.answers(chance)
    statistics = statistics_of(answers, how)
    lateral = verdicts.lateral_rules(statistics, answers.directions())
    ruling = verdicts.calibrated_rules(statistics, turns=verdicts.earns_lateral(statistics, lateral.label))[0]
    places = getattr(ruling.statistic, "places", ()) if ruling.label == "partial_depth" else ()
    return Row(
        bank="",
        name="",
        kind="",
        frames=len(world.frames),
        label=ruling.label,
        lateral=lateral.label,
        decided_by=str(ruling.decided_by),
        holes=tuple(f"{place.of} {place.name}" for place in places),
        calls=asking.calls,
        seconds=0.0,
    )


# banks of a simulator


@dataclass
class Door:
    """A controller behind the door of a model; what it sees of a file was read once for all."""

    one: Adversary
    rng: random.Random
    look: Look | None = None
    see: See = adversary_door.see_frame
    version: str = "1"

    def __post_init__(self) -> None:
        """Begin without a fact."""
        self.facts: dict[str, str] = {}

    async def answer(self, query: Query) -> Reply:
        """Answer from the query's picture."""
        said = self.look(query.image) if self.look else self.one.decide(self.see(query.image), self.rng)
        return said if isinstance(said, Reply) else Reply(text=said, finish_reason="stop")

    async def close(self) -> None:
        """Hold nothing, so let go of nothing."""


def door_of(name: str, kind: str, seed: int) -> OpenedModel:
    """Return a controller as a model that is open already."""
    pixels = name in adversary_door.PIXELS or name in adversary_door.SIZES
    rng = random.Random(f"{seed}/{name}")  # noqa: S311 - no secret
    look = partial(adversary_door.look, name) if pixels else None
    sees = adversary_door.see_plain if kind == KNOWN else adversary_door.see_frame
    return OpenedModel(RequestMode(f"python:{name}"), Door(opened(name, kind, seed), rng, look, sees))


def judge_rendered(bank: Bank, named: Sequence[tuple[str, str]], folder: Path) -> Iterator[Row]:
    """Yield what a real run says of some controllers, (name, kind) each, on a bank of a simulator."""
    begun = time.process_time()
    root, run = folder / f"{bank.name}-staging-{STAGING}", folder / f"run-{bank.name}"
    seen = root.with_suffix(".sights")
    if not root.exists():
        seeds = (bank.seed, bank.seed + 1, bank.seed + 2)
        open_bank_simulator(bank.world).build(root, seeds=seeds, steps=12)
    adversary_door.turn_to(root)
    adversary_door.recall(seen)
    shutil.rmtree(run, ignore_errors=True)
    models = [door_of(name, kind, bank.seed) for name, kind in named]
    planned = battery.plan(root, models, run, seed=bank.seed, extent=battery.BatterySelection(LIMIT, controls=None))
    battery.run(planned)
    adversary_door.keep(seen)
    score = battery.score(run, resamples=RESAMPLES)
    found = verdicts.judge(score)
    seconds = (time.process_time() - begun) / len(named)
    for name, kind in named:
        one, model = found[f"python:{name}"], score.models[f"python:{name}"]
        yield Row(
            bank=bank.name,
            name=name,
            kind=kind,
            frames=len(model.answers.frames),
            label=one.calibrated.label,
            lateral=one.lateral.label,
            decided_by=str(one.calibrated.decided_by),
            holes=tuple(f"{place.of} {place.name}" for place in one.holes),
            calls=model.answered,
            seconds=round(seconds, 3),
        )
    shutil.rmtree(run)


# rows


def measured(name: str, kind: str, pictures: Pictures) -> dict[str, object]:
    """Return the truth of a controller in a world; of one that knows files what it declares."""
    if name in adversary_door.FILES:
        adversary = adversary_door.adversary(name)
        says = {True: "depth", False: "no", None: "none"}
        return {"says": says[adversary.follows], "turns": "no", "places": {}}
    found = find_truth(partial(opened, name, kind, 1), pictures, _look(name, pictures))
    if name.endswith(COLD):  # what repeats counts in all; of the few pictures of a place it says what befell those
        warm = find_truth(partial(opened, name.removesuffix(COLD), kind, 1), pictures)
        found = replace(found, places=warm.places)
    return found.plain()


def _look(name: str, pictures: Pictures) -> str:
    """Return the rule of the pixels that a controller is, "" for one that sees."""
    if name not in adversary_door.PIXELS and name not in adversary_door.SIZES:
        return ""
    return name if pictures.looked[0] else next(iter(adversary_door.SIZES))


def measured_rest(row: Row, pictures: Pictures) -> Mapping[str, str]:
    """Return the truth of the places outside of those that a row names; of one that knows files nothing."""
    if row.name in adversary_door.FILES:
        return {}
    warm = partial(opened, row.name.removesuffix(COLD), row.kind, 1)
    return find_rest(warm, pictures, named_places(row), _look(row.name, pictures))


def main() -> int:
    """Make the rows that are missing, count them, and write the result."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--worlds", default=WORLDS, help="how many fresh banks of each world")
    options.add_argument("--groups", default=",".join(GROUPS), help="who is tried, the first first; or single kinds")
    earlier = "digests of earlier code, of rules and truth: what it made counts where today's made nothing"
    options.add_argument("--also", nargs=2, default=("", ""), metavar=("RULES", "TRUTH"), help=earlier)
    options.add_argument("--out", type=Path, default=ROOT / "build" / "adversaries", help="folder of banks and rows")
    options.add_argument("--result", type=Path, default=RESULT, help="file of the result")
    given = options.parse_args()
    folder = given.out.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    asked = [(world, int(count)) for world, _, count in (one.partition("=") for one in given.worlds.split(","))]
    kept = Kept(folder, Code(*given.also))
    for group in given.groups.split(","):
        for world, count in asked:
            for number in range(count):
                make_rows(Bank(world, number), GROUPS.get(group, (group,)), kept)
                print(f"{group}: {world} {number + 1} of {count}", file=sys.stderr, flush=True)
            kept.write(given.result)
    return kept.write(given.result)


class Kept:
    """Rows and truths that are there, in two files to which each is appended as it comes."""

    def __init__(self, folder: Path, also: Code) -> None:
        self.folder, self.code = folder, said_of(ROOT)
        self._rows, self._truths = folder / "rows.jsonl", folder / "truths.jsonl"
        found = [Row(**{**one, "holes": tuple(one["holes"])}) for one in map(json.loads, _lines(self._rows))]
        ranked = [one for code in (also.rules, self.code.rules) for one in found if one.code == code]
        self._found = {(one.bank, one.name): one for one in ranked}
        known = [json.loads(line) for line in _lines(self._truths)]
        self.truths = {
            (str(one["world"]), str(one["name"])): one
            for code in (also.truth, self.code.truth)
            for one in known
            if one["code"] == code and "named" not in one
        }
        self.rests = {
            (str(one["world"]), str(one["name"]), tuple(one["named"])): one["places"]
            for one in known
            if one["code"] == self.code.truth and "named" in one
        }

    def has(self, bank: Bank, name: str) -> bool:
        """Return whether there is a row of today's code."""
        one = self._found.get((bank.name, name))
        return one is not None and one.code == self.code.rules

    def add(self, row: Row) -> None:
        """Keep a row."""
        made = replace(row, code=self.code.rules, date=dt.datetime.now(dt.UTC).isoformat(timespec="seconds"))
        self._found[made.bank, made.name] = made
        _append(self._rows, asdict(made))

    def require_truth(self, world: str, name: str, kind: str) -> None:
        """Measure what a controller does in a world, where that is not known."""
        if (world, name) not in self.truths:
            found = measured(name, kind, _pictures(world, self.folder))
            row = {"world": world, "name": name, "kind": kind, "code": self.code.truth, **found}
            self.truths[world, name] = row
            _append(self._truths, row)

    def _require_truths(self) -> None:
        """Measure what every row is judged by: also what is done outside of the places that it names."""
        for row in self.rows():
            world, named = SIMULATED if row.world.startswith(SIMULATED) else row.world, named_places(row)
            if row.kind != KNOWN:
                self.require_truth(world, row.name, row.kind)
            if row.label == "partial_depth" and row.kind != KNOWN and (world, row.name, named) not in self.rests:
                found = measured_rest(row, _pictures(world, self.folder))
                self.rests[world, row.name, named] = found
                line = {"world": world, "name": row.name, "named": named, "code": self.code.truth, "places": found}
                _append(self._truths, line)

    def write(self, result: Path) -> int:
        """Write what the rows come to; returns the exit code."""
        self._require_truths()
        return write(self.rows(), self.truths, self.rests, result)

    def rows(self) -> list[Row]:
        """Return the rows of who is tried today."""
        tried = {name + cold for names in KINDS.values() for name in names for cold in ("", COLD)}
        return [one for one in self._found.values() if one.name in tried]


@cache
def _pictures(world: str, folder: Path) -> Pictures:
    return pictures_of(world, folder)


def _lines(file: Path) -> list[str]:
    return file.read_text(encoding="utf-8").splitlines() if file.is_file() else []


def _append(file: Path, row: Mapping[str, object]) -> None:
    with file.open("a", encoding="utf-8") as opened_file:
        opened_file.write(json.dumps(row) + "\n")


def make_rows(bank: Bank, kinds: Sequence[str], kept: Kept) -> None:
    """Make those rows of some kinds on a bank that are missing."""
    named = [(name, kind) for kind in kinds for name in names_of(kind, bank)]
    todo = [(name, kind) for name, kind in named if not kept.has(bank, name)]
    if bank.is_simulated:
        for name, kind in todo:
            kept.add(judge_simulated(bank, name, kind))
        return
    for first in range(0, len(todo), TOGETHER):
        for row in judge_rendered(bank, todo[first : first + TOGETHER], kept.folder):
            kept.add(row)


if __name__ == "__main__":
    sys.exit(main())
