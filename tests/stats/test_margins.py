"""Tables drawn with both margins held fixed, and the tests of tables, against scipy's own."""

import subprocess
import sys
from itertools import count

import numpy as np
import pytest
from scipy import stats

from eyechart.stats import margins
from eyechart.stats.agreement import binomial_tail, trials_needed
from eyechart.stats.association import chi2_test

ALONE = """
import sys
import numpy as np
from eyechart.stats import margins
tables = margins.random_tables(np.array([30, 11, 7]), np.array([25, 23]), 50, np.random.default_rng(3))
assert "scipy.stats" not in sys.modules, "the sampler alone was wanted"
from scipy import stats
drawn = stats.random_table([30, 11, 7], [25, 23], seed=np.random.default_rng(3)).rvs(50, method="patefield")
assert tables.dtype == drawn.dtype and (tables == drawn).all()
"""

COMPILED = """
import sys, threading
from eyechart.stats.statistic import special_functions
over = threading.Event()
if sys.argv[1] == "beside":
    threading.Thread(target=over.wait, daemon=True).start()
found = special_functions()
assert ("scipy.special" in sys.modules) == (sys.argv[1] == "beside"), "the compiled functions alone, by one thread"
import scipy.special, scipy.stats
for name in ("stdtrit", "chdtrc", "bdtrc", "betaincinv", "gammaln"):
    assert getattr(found, name) is getattr(scipy.special, name), name
assert scipy.special.softmax([0.0]) == 1 and scipy.stats.norm.sf(0) == 0.5
with scipy.special.errstate(all="raise"):  # finds a part of scipy.special by its name there
    try:
        scipy.special.gammaln(0)
    except scipy.special.SpecialFunctionError:
        over.set()
assert over.is_set(), "gammaln(0) raises here"
"""


@pytest.mark.parametrize("how", ["alone", "beside"])
def test_compiled_functions_are_those_of_scipy_which_comes_after_them_without_harm(how: str) -> None:
    """Without the rest of ``scipy.special``, unless another thread runs that might import it at once."""
    subprocess.run([sys.executable, "-c", COMPILED, how], check=True)


def test_the_sampler_alone_draws_what_scipy_draws() -> None:
    """In a process that has not imported ``scipy.stats``; that comes after it without harm."""
    subprocess.run([sys.executable, "-c", ALONE], check=True)


def test_a_scipy_without_that_file_draws_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its public door is asked then."""
    rows, columns = np.array([30, 11, 7]), np.array([25, 23])
    drawn = stats.random_table(rows, columns, seed=np.random.default_rng(3)).rvs(50, method="patefield")
    monkeypatch.setattr(margins, "_alone", lambda: None)
    assert (margins.random_tables(rows, columns, 50, np.random.default_rng(3)) == drawn).all()


@pytest.mark.parametrize("correction", [True, False])
def test_chi_squared_is_that_of_scipy(*, correction: bool) -> None:
    """On tables of every shape, 2 x 2 with Yates' correction among them, and close to independence."""
    rng = np.random.default_rng(0)
    for shape in [(2, 2), (2, 5), (4, 3)] * 30:
        table = rng.integers(1, rng.integers(2, 60), shape)
        found, known = chi2_test(table, correction=correction), stats.chi2_contingency(table, correction=correction)
        assert found.value == pytest.approx(known.statistic, rel=1e-12, abs=1e-15)
        assert found.p == pytest.approx(known.pvalue, rel=1e-12)
        assert found.detail is not None
        assert found.detail["dof"] == known.dof
        assert found.detail["smallest_expected"] == known.expected_freq.min()


def _trials_by_whole_tails(true_rate: float, chance: float, alpha: float) -> int:
    """Return the fewest trials of a power of .8, with each tail computed anew."""
    critical = 0
    for n in count(1):
        while critical <= n and binomial_tail(critical, n, chance) > alpha:
            critical += 1
        if critical <= n and binomial_tail(critical, n, true_rate) >= 0.8:
            return n
    raise AssertionError


def test_a_growing_tail_gives_the_trials_of_whole_ones() -> None:
    """For designs of few trials and of thousands, with a chance of 0 and a rate of 1 among them."""
    designs = [(rate, chance) for rate in (0.52, 0.55, 0.65, 0.9, 1.0) for chance in (0.0, 0.2, 0.5)]
    for design in designs:
        for alpha in (0.05, 0.01):
            assert trials_needed(*design, alpha=alpha) == _trials_by_whole_tails(*design, alpha), design
