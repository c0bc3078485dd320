import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from banks import one
from eyechart.spaces.discrete import DRIVING
from eyechart.spaces.space import Decision
from eyechart.stats import agreement, association, correlation, paired_tests, resamples
from eyechart.stats.statistic import Statistic
from eyechart.studies.battery.answers import Answers
from eyechart.studies.battery.paper_statistics import PaperStatistics, Resampling

HERE = Path(__file__).parent
COPY = HERE / "paper_vectors.json"


def in_order(names: str, metrics: dict) -> list[float]:
    """Return the named metrics as the paper's tables list them."""
    return [metrics[name].value for name in names.split()]


def scored(**columns: list[str]) -> dict[str, Statistic]:
    """Return the paper's statistics of a battery with these decisions, a list a condition, a decision a frame."""
    frames = tuple(one(f"f{i}", ("s", f"e{i}", 0), "vertical", "-") for i in range(len(columns["real"])))
    given = {name: tuple(map(Decision, column)) for name, column in columns.items()}
    return PaperStatistics(Answers("m", frames, DRIVING, None, given), Resampling(intervals=False)).statistics()


def idi_adj(agree_blank: int, disagree_repeat: int, n: int) -> float | None:
    """Return IDI_adj of answers that agree with the real ones on so many blanks, and on all but so many repeats."""
    blank = ["SLOW"] * agree_blank + ["STOP"] * (n - agree_blank)
    repeat = ["STOP"] * disagree_repeat + ["SLOW"] * (n - disagree_repeat)
    return scored(real=["SLOW"] * n, blank=blank, real_repeat=repeat)["idi_adj"].value


def spelled(counts: dict[str, int]) -> list[str]:
    """Return every action as often as it is counted."""
    return [action for action, count in counts.items() for _ in range(count)]


def kappa(agree: float, marginal: list[int]) -> float | None:
    """Return kappa of two raters with one marginal of three labels, who disagree in equal numbers in a ring."""
    n, size = sum(marginal), len(marginal)
    apart = round((1 - agree) * n / size)
    first = [label for label, count in enumerate(marginal) for _ in range(count)]
    starts = [sum(marginal[:label]) for label in range(size)]
    second = list(first)
    for label, start in enumerate(starts):
        second[start : start + apart] = [(label + 1) % size] * apart
    return agreement.cohens_kappa(first, second).value


FUNCTIONS: dict[str, Callable[[dict], object]] = {
    "rate": lambda i: agreement.rate(i["k"], i["n"]).value,
    "cramers_v": lambda i: association.cramers_v(i["table"], correction=i["correction"]).value,
    "chi2_p": lambda i: association.chi2_test(i["table"], correction=i["correction"]).p,
    "chi2_p_below_1e-4": lambda i: association.chi2_test(i["table"], correction=i["correction"]).p < 1e-4,
    "idi_adj": lambda i: idi_adj(i["agree_blank"], i["disagree_repeat"], i["n"]),
    "clears_floor": lambda i: agreement.clears_floor(i["IDI"], i["s"]),
    "agreement_with_constant": lambda i: (
        scored(real=spelled(i["real_counts"]), blank=[i["constant"]] * sum(i["real_counts"].values()))[
            "agree.blank"
        ].value
    ),
    "permutation_p": lambda i: resamples.permutation_p(i["exceedances"], i["resamples"]),
    "mutual_information_bits": lambda i: resamples.permute_mutual_information(i["table"], seed=0, resamples=1).value,
    "holm_smallest": lambda i: min(p for p in resamples.holm(i["p"]) if p is not None),
    "mcnemar_exact": lambda i: paired_tests.mcnemar_exact(i["b"], i["c"]).p,
    "pearson_p": lambda i: correlation.pearson_p(i["r"], i["n"]).p,
    "binary_metrics": lambda i: in_order(
        "acc bal sens spec",
        agreement.binary_metrics(tp=i["TP"], fn=i["FN"], tn=i["TN"], fp=i["FP"]),
    ),
    "selective_metrics": lambda i: in_order(
        "coverage acc bal sens spec",
        agreement.selective_metrics(tp=i["TP"], fn=i["FN"], tn=i["TN"], fp=i["FP"], n=i["n"]),
    ),
    "kappa_from_marginal": lambda i: kappa(i["agree_repeat"], i["marginal"]),
}


def check(vector: dict) -> None:
    """Fail unless eyechart computes the expected number from the vector's inputs."""
    function, expected = FUNCTIONS.get(vector["function"]), vector["expected"]
    if function is None:
        pytest.fail(f"'{vector['id']}' asks for the function '{vector['function']}', which no test knows")
    try:
        got = function(vector["inputs"])
    except KeyError as error:
        pytest.fail(f"'{vector['id']}': the inputs of {vector['function']} lack {error}")
    if isinstance(expected, bool) or isinstance(got, bool):
        assert got is expected, f"{vector['id']}: {got}, the paper has {expected}"
        return
    if vector["function"] == "rate" and expected > 1:
        got *= 100  # the crash rates of Table t:baselines are printed in percent
    pairs = zip(got, expected, strict=True) if isinstance(expected, list) else [(got, expected)]
    for ours, papers in pairs:
        assert abs(ours - papers) <= vector["tolerance"], f"{vector['id']}: {got}, the paper has {expected}"


def test_a_number_of_the_paper_follows_from_its_inputs(vector: dict) -> None:
    """Every published statistic and rate comes out of eyechart's own functions."""
    check(vector)


def test_what_is_not_checked_is_counted_by_kind(left_out: dict, pytestconfig: pytest.Config) -> None:
    """Arithmetic and feasibility entries call no function of eyechart; the test's name says how many."""
    entries = json.loads(pytestconfig.getoption("vectors").read_text(encoding="utf-8"))
    assert sum(left_out.values()) == sum(entry["function"] is None for entry in entries)


@pytest.mark.parametrize("function", sorted(FUNCTIONS))
def test_a_changed_expected_value_fails(function: str) -> None:
    """No entry of the repository's copy passes by accident: moved by a tenth it fails."""
    vector = next(v for v in json.loads(COPY.read_text(encoding="utf-8")) if v["function"] == function)
    expected, step = vector["expected"], 0.1 + 2 * vector["tolerance"]
    if isinstance(expected, bool):
        changed = not expected
    elif isinstance(expected, list):
        changed = [*expected[:-1], expected[-1] - step]
    else:
        changed = expected + step
    with pytest.raises(AssertionError, match="the paper has"):
        check({**vector, "expected": changed})


def test_an_unknown_function_fails_by_name() -> None:
    """A vector that nobody computes must not pass in silence."""
    vector = {"id": "new", "function": "phi", "inputs": {}, "expected": 1.0, "tolerance": 0.1}
    with pytest.raises(pytest.fail.Exception, match="'new' asks for the function 'phi'"):
        check(vector)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "cannot be read"),
        ("[{", "are not JSON"),
        ("[]", "hold no entry of kind statistic or rate"),
        ('[{"id": "a", "kind": "rate"}]', r"entry number 0 lacks \['function', "),
    ],
    ids=["missing", "cut_short", "without_an_entry", "without_inputs"],
)
def test_a_missing_or_malformed_file_is_a_collection_error(
    request: pytest.FixtureRequest, tmp_path: Path, content: str | None, message: str
) -> None:
    """Which says what is wrong with it."""
    path = tmp_path / "vectors.json"
    if content is not None:
        path.write_text(content, encoding="utf-8")
    (plugin,) = {one for one in request.config.pluginmanager.get_plugins() if hasattr(one, "read_vectors")}
    with pytest.raises(pytest.Collector.CollectError, match=message):
        plugin.read_vectors(path)


def test_a_collection_error_stops_the_run(tmp_path: Path) -> None:
    """With --vectors pointing at such a file, pytest ends with an error that says what is wrong."""
    path = tmp_path / "vectors.json"
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-k", "number_of_the_paper"]
    run = subprocess.run(
        [*command, __file__, "--vectors", str(path)],
        capture_output=True,
        text=True,
        check=False,
        cwd=HERE.parents[1],
    )
    assert run.returncode != 0
    assert "cannot be read" in run.stdout + run.stderr
