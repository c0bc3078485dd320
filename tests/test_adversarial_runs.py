"""Newcomers in a simulated world, and the known answers through the real run on a fresh bank: rows that are kept."""

import importlib
import json
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

from newcomers import ADVERSARIES_BY_KIND, PARTS, READERS, WORST

pytestmark = pytest.mark.slow

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"
Measure = Callable[..., dict[str, Any]]
Truths = Mapping[tuple[str, int], dict[str, Any]]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of the rows."""
    return tmp_path_factory.mktemp("rows")


@pytest.fixture(scope="module")
def measure(folder: Path) -> Iterator[Measure]:
    """Return a function that measures groups in a world, in this process, and returns what is said of the world.

    What a controller does in truth is found from a third of the draws: of all newcomers the same as from all of them.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(BENCHMARKS)
        truth, runs = (importlib.import_module(name) for name in ("adversary_truth", "adversarial_runs"))
        for name, draws in {"DRAWS": 16, "CURVE_DRAWS": 8, "WARM": 1000}.items():
            patch.setattr(truth, name, draws)

        def run(world: str, group: str) -> dict[str, Any]:
            result = folder / "adversaries.json"
            words = ["--worlds", f"{world}=1", "--groups", group, "--out", str(folder / group), "--result", str(result)]
            patch.setattr("sys.argv", ["adversarial_runs.py", *words])
            runs.main()
            found: dict[str, Any] = json.loads(result.read_text(encoding="utf-8"))[world]
            return found

        yield run


@pytest.fixture(scope="module")
def newcomers(measure: Measure) -> dict[str, Any]:
    """Return what is said of all newcomers in a simulated world of 144 frames."""
    return measure("simulated-144", "new")


@pytest.fixture(scope="module")
def truths(newcomers: dict[str, Any], folder: Path) -> Truths:
    """Return the truth of every newcomer in the simulated world, of readers at both temperatures."""
    del newcomers
    cold = importlib.import_module("stranger_door").COLD
    rows = map(json.loads, (folder / "new" / "truths.jsonl").read_text(encoding="utf-8").splitlines())
    return {
        (row["name"].removesuffix(cold), 0 if row["name"].endswith(cold) else 1): row
        for row in rows
        if "named" not in row
    }


@pytest.mark.parametrize("kind", ADVERSARIES_BY_KIND)
def test_five_of_each_kind_deserve_no_depth_or_turn_without_looking(kind: str, truths: Truths) -> None:
    """Some are wrong on so few pairs that nothing is asked, or that depth is true of them."""
    said = [truths[name, 1] for name in ADVERSARIES_BY_KIND[kind]]
    wrong = [one["turns" if kind == "turns" else "says"] for one in said].count("no")
    assert wrong >= 5, said
    assert len(said) >= 5


@pytest.mark.parametrize("name", [*READERS, *WORST])
@pytest.mark.parametrize("temperature", [0, 1])
def test_a_reader_deserves_depth_at_both_temperatures(name: str, temperature: int, truths: Truths) -> None:
    """Its errors are small, whether they repeat or not."""
    assert truths[name, temperature]["says"] == "depth", truths[name, temperature]


@pytest.mark.parametrize("name", [name for name in PARTS if not name.startswith("mostly")])
def test_a_blind_spot_is_a_place_that_the_truth_names(name: str, truths: Truths) -> None:
    """Each is none of it in some place, or in all; of who reads a fifth of the frames there nothing is asked."""
    places = truths[name, 1]["places"]
    assert isinstance(places, dict)
    assert "no" in (truths[name, 1]["says"], *places.values())


def test_hardly_a_newcomer_earns_what_it_does_not_deserve(
    newcomers: dict[str, Any], measure: Measure, folder: Path
) -> None:
    """In a simulated world of 144 frames; a second run makes no row anew."""
    for claim, most in (("depth", 2), ("depth_lateral", 0), ("turns_clear", 2)):
        said = newcomers["untrue"][claim]["by kind"]["new"]
        assert int(said.split()[0]) <= most, newcomers["untrue"][claim]
    right, _, readers, *_ = newcomers["readers told so"]["one error"]["all"].split()
    assert int(right) >= 0.8 * int(readers), newcomers["readers told so"]
    rows = folder / "new" / "rows.jsonl"
    before = rows.read_bytes()
    measure("simulated-144", "new")
    assert rows.read_bytes() == before


def test_the_known_answers_are_right_through_the_real_run(measure: Measure, folder: Path) -> None:
    """On a fresh bank of the highway; what a picture shows was read once, and no run is left."""
    found = measure("highway", "known")
    right, _, tried, *_ = found["known answers right"].split()
    assert int(tried) == 16
    assert int(right) >= 15, found["called"]
    assert not list((folder / "known").glob("run-*"))
