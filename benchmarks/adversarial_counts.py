"""What the rows of adversarial runs come to: untrue claims, holes left out, readers that are denied, with intervals.

An interval is of the share over controllers, of which more could be thought out, with the rows of one taken together.
"""

import ast
import datetime as dt
import hashlib
import json
import math
import re
import subprocess
from collections import Counter, defaultdict
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import eyechart
from eyechart.models.scripted import CONTROLLERS
from eyechart.simulators.banks import STAGING
from eyechart.stats.episodes import share_over_episodes
from newcomers import ADVERSARIES_BY_KIND

PROMISED: Mapping[int, float] = {144: 0.04, 288: 0.01}
"""The share of untrue claims of the newcomers that is allowed, over all banks of so many frames; 72 are reported."""
LEFT_OUT, FOUND, OF_TEN = 0.04, 0.85, 0.3
LIMIT = 144
"""Frames of a bank of a simulator that are asked about."""
CLAIMS = ("depth", "depth_lateral", "turns_clear")
AUTHORITY = ("depth", "depth_lateral")
ORDINARY = ("readers", "stranger readers")
ALL_THREE = ("worst",)
KNOWN = "known"
THREE = ("wide_reader", "wide_reader_t0")
"""Of the strangers' readers those that err in all three ways at once."""

SPANS: Mapping[str, tuple[float, float]] = {"highway": (5.0, 60.0), "rover": (1.7, 27.0), "drone": (2.5, 27.0)}
"""From the lowest distance that a world can show to far; the simulated ones are as the highway."""

Truths = Mapping[tuple[str, str], Mapping[str, object]]
Rests = Mapping[tuple[str, str, tuple[str, ...]], Mapping[str, str]]
"""The truth of each place outside of the named ones, by world, name and what is named."""


@dataclass(frozen=True)
class Row:
    """What one run said of one controller: its labels, by which statistic, and the places it named as holes."""

    bank: str
    name: str
    kind: str
    frames: int
    label: str
    lateral: str
    decided_by: str
    holes: tuple[str, ...]
    calls: int
    seconds: float
    code: str = ""
    date: str = ""

    @property
    def world(self) -> str:
        """Return the kind of its bank."""
        return self.bank.rpartition("-")[0]


@dataclass(frozen=True)
class Code:
    """Digests of the code that judges, and of the code that measures the truth."""

    rules: str
    truth: str


WORDING = (
    "verdicts/why_not.py",
    "verdicts/verdict.py as_dict",
    "verdicts/depth.py open_kinds",
    *(
        f"studies/battery/{one}.py"
        for one in ("album", "browser", "demo", "figures", "film", "page", "power", "reach", "summary", "tables")
    ),
    "studies/battery/plans.py _out_of_reach",
)
"""What only words, draws, forecasts or prints, and decides no label: files, and functions of files that do."""


def said_of(root: Path) -> Code:
    """Return the digests of today's code; comments, the shape of its lines and `WORDING` are none of it."""
    source, organisms, benchmarks = root / "src" / "eyechart", root / "src" / "eyechart_organisms", root / "benchmarks"
    judging = [source / "conditions" / "__init__.py", organisms / "calibration" / "world.py"]
    judging += [
        file for part in ("verdicts", "studies/battery", "stats") for file in sorted((source / part).rglob("*.py"))
    ]
    measuring = [
        benchmarks / f"{one}.py" for one in ("adversary_truth", "adversary_pictures", "strangers", "newcomers")
    ]
    measuring += [organisms / "adversaries.py", organisms / "calibration" / "world.py"]
    left_out = [source / one for one in WORDING]
    return Code(_digest(judging, f"staging {STAGING}", left_out), _digest(measuring, ""))


def _digest(files: Iterable[Path], more: str, left_out: Collection[Path] = ()) -> str:
    trees = [ast.dump(_without(file, left_out)) for file in files if file not in left_out]
    return hashlib.sha256("\n".join((more, *trees)).encode()).hexdigest()[:12]


def _without(file: Path, left_out: Collection[Path]) -> ast.Module:
    """Return what a file says, without the functions that are left out of it."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    for one in ast.walk(tree):
        if isinstance(one, ast.Module | ast.ClassDef):
            one.body = [part for part in one.body if Path(f"{file} {getattr(part, 'name', '')}") not in left_out]
    return tree


def truth_of(row: Row, truths: Truths) -> Mapping[str, object]:
    """Return what is true of a controller in the world of a row; nothing of the known answers."""
    return truths.get((_world(row), row.name), {})


def _world(row: Row) -> str:
    return "simulated" if row.world.startswith("simulated") else row.world


def may_be_untrue(claim: str, truth: Mapping[str, object]) -> bool:
    """Return whether a claim would be untrue of a controller."""
    return {
        "depth": truth["says"] == "no",
        "depth_lateral": "no" in (truth["says"], truth["turns"]),
        "turns_clear": truth["turns"] == "no",
    }[claim]


def is_made(claim: str, row: Row) -> bool:
    """Return whether a row makes a claim."""
    made = {"depth": row.label in AUTHORITY, "turns_clear": row.lateral == "turns_clear"}
    return made.get(claim, row.label == claim)


def named_places(row: Row) -> tuple[str, ...]:
    """Return the places that a row names as holes, as the truth names them."""
    return tuple(sorted(_third(hole, row.world) for hole in row.holes))


def wrong_holes(row: Row, truth: Mapping[str, object], rests: Rests) -> list[str]:
    """Return what is untrue in the places that a `partial_depth` names and leaves out.

    A place that it names is untrue where distance is followed there. One that it leaves out is untrue where distance is
    not followed in it, outside of the named ones: of what lies in those it claims nothing.
    """
    places, holes = truth["places"], named_places(row)
    assert isinstance(places, Mapping)
    named = {hole: places.get(hole) for hole in holes}
    result = [f"names {one}" for one, says in named.items() if says == "depth"]
    if any(says != "depth" for says in named.values()):
        rest = rests[_world(row), row.name, holes]
        result += [f"leaves out {one}" for one, says in rest.items() if says == "no"]
    return result


def _third(hole: str, world: str) -> str:
    """Return which third of the range a hole is that is named by its distances; any other as it is."""
    if (found := re.fullmatch(r"range ([\d.]+) to ([\d.]+) m", hole)) is None:
        return hole
    low, high = SPANS.get(world, SPANS["highway"])
    middle = math.sqrt(float(found[1]) * float(found[2]))
    return f"third {('near', 'middle', 'far')[min(int(3 * math.log(middle / low, high / low)), 2)]}"


def shares(rows: Iterable[Row], is_hit: Callable[[Row], bool]) -> str:
    """Return in how many of some rows something is so, with the 95% interval over controllers."""
    hits, of = Counter[str](), Counter[str]()
    for row in rows:
        of[row.name] += 1
        hits[row.name] += is_hit(row)
    if not of:
        return "0 of 0"
    k, n = np.array([[float(hits[one]), float(of[one])] for one in of]).T
    low, high = share_over_episodes(k, n, level=0.95).ci or (0.0, 1.0)
    return f"{hits.total()} of {of.total()} [{low:.3f}, {high:.3f}]"


def judge(rows: Sequence[Row], truths: Truths, rests: Rests) -> dict[str, object]:
    """Return what is written of the rows of one world."""
    tried = [(row, truth) for row in rows if (truth := truth_of(row, truths))]
    result: dict[str, object] = {"banks": len({row.bank for row in rows}), "rows": len(rows)}
    result["rows by code"] = dict(Counter(row.code for row in rows))
    result["untrue"] = {claim: _untrue(claim, tried) for claim in CLAIMS}
    result["a place is no and the label is depth"] = _holed(tried)
    result["partial_depth untrue"] = _partial(tried, rests)
    result["readers told so"] = _readers(tried)
    result["known answers right"] = shares([row for row in rows if row.kind == KNOWN], _is_right)
    result["seconds a row"] = round(float(np.mean([row.seconds for row in rows])), 3)
    called: dict[str, Counter[str]] = defaultdict(Counter)
    for row in rows:
        called[row.name][f"{row.label}/{row.lateral} by {row.decided_by}"] += 1
    result["called"] = {name: dict(counts) for name, counts in sorted(called.items())}
    return result


def _kinds(rows: Iterable[Row]) -> dict[str, list[Row]]:
    """Return rows by kind, those of all newcomers together first."""
    kinds: dict[str, list[Row]] = {"new": []}
    for row in rows:
        kinds.setdefault(row.kind, []).append(row)
        if row.kind in ADVERSARIES_BY_KIND:
            kinds["new"].append(row)
    return kinds


def _by_name(rows: Iterable[Row], is_hit: Callable[[Row], bool]) -> dict[str, str]:
    hits, of = Counter[str](), Counter[str]()
    for row in rows:
        of[row.name] += 1
        hits[row.name] += is_hit(row)
    return {name: f"{count} of {of[name]}" for name, count in hits.most_common() if count}


def _untrue(claim: str, tried: Sequence[tuple[Row, Mapping[str, object]]]) -> dict[str, object]:
    may = [row for row, truth in tried if may_be_untrue(claim, truth)]

    def hit(row: Row) -> bool:
        return is_made(claim, row)

    return {"by kind": {kind: shares(mine, hit) for kind, mine in _kinds(may).items()}, "who": _by_name(may, hit)}


def _holed(tried: Sequence[tuple[Row, Mapping[str, object]]]) -> dict[str, object]:
    """Return who is called depth though it is none in some place, of those who are not none of it in all."""
    may = [row for row, truth in tried if truth["says"] != "no" and "no" in dict(truth["places"]).values()]  # type: ignore[call-overload]

    def hit(row: Row) -> bool:
        return row.label in AUTHORITY

    return {"by kind": {kind: shares(mine, hit) for kind, mine in _kinds(may).items()}, "who": _by_name(may, hit)}


def _partial(tried: Sequence[tuple[Row, Mapping[str, object]]], rests: Rests) -> dict[str, object]:
    called = [(row, truth) for row, truth in tried if row.label == "partial_depth"]
    wrong = {(row.bank, row.name): wrong_holes(row, truth, rests) for row, truth in called}
    who: dict[str, Counter[str]] = defaultdict(Counter)
    for (_, name), words in wrong.items():
        who[name].update(words)

    def hit(row: Row) -> bool:
        return bool(wrong.get((row.bank, row.name)))

    rows = [row for row, _ in called]
    return {
        "of those called so": shares(rows, hit),
        "of all": shares([row for row, _ in tried], hit),
        "by kind": {kind: shares(mine, hit) for kind, mine in _kinds(rows).items()},
        "who": {name: dict(words) for name, words in who.items() if words},
    }


def _readers(tried: Sequence[tuple[Row, Mapping[str, object]]]) -> dict[str, object]:
    """Return how many of the readers of ordinary quality are told so, and what was said of the others, by what."""
    readers: dict[str, object] = {}
    for what, kinds, wanted in (("one error", ORDINARY, False), ("all three at once", (*ALL_THREE, ORDINARY[1]), True)):
        rows = [
            row
            for row, truth in tried
            if row.kind in kinds
            and (row.kind in ALL_THREE or (row.name in THREE) is wanted)
            and truth["says"] == "depth"
        ]
        lost: dict[str, Counter[str]] = defaultdict(Counter)
        for row in rows:
            if row.label not in AUTHORITY:
                lost[row.name][f"{row.label} by {', '.join(row.holes) or row.decided_by}"] += 1
        cold = [row for row in rows if row.name.endswith("_t0")]
        readers[what] = {
            "all": shares(rows, _is_found),
            "temperature 0": shares(cold, _is_found),
            "temperature 1": shares([row for row in rows if row not in cold], _is_found),
            "lost": {name: dict(counts) for name, counts in sorted(lost.items())},
        }
    return readers


def _is_found(row: Row) -> bool:
    return row.label in AUTHORITY


def _is_right(row: Row) -> bool:
    return row.label == CONTROLLERS[row.name].declared.calibrated


def misses_of(judged: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Return what falls short of what is promised, of what `judge` found in each world."""
    misses = []
    for world, found in judged.items():
        for claim, one in found["untrue"].items():
            said = {kind: share for kind, share in one["by kind"].items() if _share(share) > OF_TEN}
            misses += [f"{world}: {claim} untrue of kind {kind} {share}" for kind, share in said.items()]
        readers = found["readers told so"]["one error"]["all"]
        if not readers.startswith("0 of 0") and _share(readers) < FOUND:
            misses.append(f"{world}: readers told so {readers}, wanted {FOUND}")
    for frames, most in PROMISED.items():
        worlds = [found for world, found in judged.items() if frames_of(world) == frames]
        for claim in CLAIMS:
            said = _together(found["untrue"][claim]["by kind"]["new"] for found in worlds)
            if _share(said) > most:
                misses.append(f"{frames} frames: {claim} untrue of newcomers {said}, wanted {most}")
        partial = _together(found["partial_depth untrue"]["of those called so"] for found in worlds)
        if _share(partial) > LEFT_OUT:
            misses.append(f"{frames} frames: partial_depth untrue {partial}, wanted {LEFT_OUT}")
    return misses


def alone_above(judged: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Return which worlds are above what is promised of all banks of as many frames together: that is no miss."""
    return [
        f"{world} alone: {claim} untrue of newcomers {said}, of all banks of {frames_of(world)} frames wanted {most}"
        for world, found in judged.items()
        for claim in CLAIMS
        if (most := PROMISED.get(frames_of(world))) is not None
        and _share(said := found["untrue"][claim]["by kind"]["new"]) > most
    ]


def frames_of(world: str) -> int:
    """Return how many frames the banks of a world have."""
    return int(world.rpartition("-")[2]) if world.startswith("simulated") else LIMIT


def _together(many: Iterable[str]) -> str:
    counts = np.array([[int(part) for part in said.partition(" [")[0].split(" of ")] for said in many], dtype=int)
    return "{} of {}".format(*counts.reshape(-1, 2).sum(axis=0))


def _share(said: str) -> float:
    count, _, of = said.partition(" [")[0].partition(" of ")
    return int(count) / max(int(of), 1)


def write(rows: Sequence[Row], truths: Truths, rests: Rests, result: Path) -> int:
    """Write and print what the rows come to by world; returns the exit code."""
    root = Path(__file__).parents[1]
    command = ["git", "rev-parse", "HEAD"]
    found: dict[str, object] = {
        "eyechart": eyechart.__version__,
        "date": dt.datetime.now(dt.UTC).date().isoformat(),
        "commit": subprocess.run(command, check=True, capture_output=True, text=True, cwd=root).stdout.strip(),
        "code": said_of(root).rules,
    }
    worlds = list(dict.fromkeys(row.world for row in rows))
    judged = {world: judge([row for row in rows if row.world == world], truths, rests) for world in worlds}
    misses, alone = misses_of(judged), alone_above(judged)
    found["truths by code"] = dict(Counter(str(truth["code"]) for truth in truths.values()))
    measured = {f"{world} {name}": _short(truth) for (world, name), truth in sorted(truths.items())}
    result.parent.mkdir(exist_ok=True)
    text = json.dumps(found | judged | {"truth": measured, "alone above": alone, "misses": misses}, indent=1)
    result.write_text(text + "\n", encoding="utf-8")
    print("\n".join([*alone, *(misses or ["no claim is untrue more often than is promised"])]))
    return int(bool(misses))


def _short(truth: Mapping[str, object]) -> str:
    """Return the truth of a controller in a line."""
    numbers = " ".join(f"{name} {truth[name]:.2f}" for name in ("net", "wrong", "frames", "rise") if name in truth)
    places = truth["places"]
    assert isinstance(places, Mapping)
    no = [name for name, says in places.items() if says == "no"]
    return f"{truth['says']}, turns {truth['turns']}; {numbers}" + (f"; no: {', '.join(no)}" if no else "")
