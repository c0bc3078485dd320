import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy import stats

from eyechart.stats import association

tables = hnp.arrays(np.int64, st.tuples(st.integers(1, 5), st.integers(1, 5)), elements=st.integers(0, 30))


def test_the_table_counts_labels_in_sorted_order() -> None:
    """Rows are the first array's labels, columns the second's."""
    contingency = association.contingency(["STOP", "LEFT", "STOP"], [1, 0, 0])
    assert (contingency.rows, contingency.columns) == (("LEFT", "STOP"), (0, 1))
    assert contingency.table.tolist() == [[1, 0], [1, 1]]


def test_arrays_of_two_lengths_make_no_table() -> None:
    """The error names both lengths."""
    with pytest.raises(ValueError, match="2 labels against 3"):
        association.contingency([0, 1], [0, 1, 1])


@given(table=tables.filter(lambda t: t.sum() > 0), correction=st.booleans())
@settings(max_examples=60)
def test_chi_squared_is_scipys_after_empty_rows_and_columns_are_dropped(table: np.ndarray, *, correction: bool) -> None:
    """Reference: scipy.stats.chi2_contingency(table without empty lines, correction=correction)."""
    kept = table[table.sum(axis=1) > 0][:, table.sum(axis=0) > 0]
    result = association.chi2_test(table, correction=correction)
    if min(kept.shape) == 1:
        assert (result.value, result.p) == (0.0, 1.0)
    else:
        expected = stats.chi2_contingency(kept, correction=correction)
        assert (result.value, result.p) == pytest.approx((expected.statistic, expected.pvalue))


@given(table=tables.filter(lambda t: t.sum() > 0), data=st.data())
@settings(max_examples=60)
def test_v_and_information_are_unchanged_by_relabelling(table: np.ndarray, data: st.DataObject) -> None:
    """Any order of rows and columns, and the transposed table, give the same numbers; none leaves its range."""
    rows = data.draw(st.permutations(range(table.shape[0])))
    columns = data.draw(st.permutations(range(table.shape[1])))
    other = table[rows][:, columns].T
    v, both = association.cramers_v(table), np.zeros((2, max(table.shape), max(table.shape)))
    both[0, : table.shape[0], : table.shape[1]], both[1, : other.shape[0], : other.shape[1]] = table, other
    information, again = association.information_of_tables(both)
    assert association.cramers_v(other).value == pytest.approx(v.value, abs=1e-12)
    assert again == pytest.approx(information, abs=1e-12)
    assert 0 <= v.value <= 1 + 1e-12
    ceiling = min(association.entropy_of_counts(table.sum(axis=axis)[None])[0] for axis in (0, 1))
    assert 0 <= information <= ceiling + 1e-12


@given(table=tables.filter(lambda t: t.sum() > 0))
@settings(max_examples=60)
def test_information_is_the_divergence_of_the_table_from_independence(table: np.ndarray) -> None:
    """Reference: scipy.stats.entropy(joint, product of the margins, base=2)."""
    joint = table / table.sum()
    product = np.outer(joint.sum(axis=1), joint.sum(axis=0))
    inside = product > 0
    expected = stats.entropy(joint[inside], product[inside], base=2)
    assert association.information_of_tables(table[None])[0] == pytest.approx(expected, abs=1e-9)


def test_entropy_and_mode_of_the_qwen_marginal() -> None:
    """H(57, 37, 50) is 1.5629 bits (paper_vectors.json, MI_ceiling_Qwen); the mode is STOP."""
    labels = ["STOP"] * 57 + ["SLOW"] * 37 + ["LEFT"] * 50
    assert association.entropy_bits(labels).value == pytest.approx(1.5629, abs=5e-5)
    mode = association.modal_share(labels)
    assert (mode.value, mode.detail["mode"]) == (57 / 144, "STOP")


def test_empty_data_cannot_say() -> None:
    """None everywhere, and never a 0 that looks measured."""
    nothing = np.zeros((2, 2), dtype=int)
    for result in (
        association.chi2_test(nothing),
        association.cramers_v(nothing),
        association.entropy_bits([]),
        association.modal_share([]),
    ):
        assert (result.value, result.p) == (None, None)
        assert result.note


@pytest.mark.parametrize("table", [[[1, -1], [2, 3]], [[0.5, 1], [2, 3]], [1, 2, 3]])
def test_what_is_no_table_of_counts_is_refused(table: list) -> None:
    """Negative numbers, fractions and vectors are no counts."""
    with pytest.raises(ValueError, match="a contingency table is a matrix of counts"):
        association.cramers_v(table)


def test_tied_gaps_merge_two_quartiles() -> None:
    """As pandas.qcut(gap, 4, duplicates="drop"): 57 gaps of 5.0 m leave bins of 72, 36 and 36."""
    gap = np.concatenate([np.full(57, 5.0), np.linspace(6, 60, 87)])
    found = association.quantile_bins(gap)
    assert found.sizes == (72, 36, 36)
    assert found.edges == pytest.approx(tuple(np.quantile(gap, [0.5, 0.75])))
    assert found.codes[[0, 56, 143]].tolist() == [0, 0, 2]


def test_a_gap_on_an_edge_belongs_to_the_bin_below() -> None:
    """As pandas.qcut([1, 2, 3], 2, labels=False), which gives 0 0 1."""
    found = association.quantile_bins([1.0, 2.0, 3.0], 2)
    assert (found.codes.tolist(), found.edges) == ([0, 0, 1], (2.0,))


def test_no_lead_is_the_farthest_gap() -> None:
    """None, NaN and infinity share the last bin with the far gaps."""
    found = association.quantile_bins([4.0, 5.0, 6.0, 7.0, 8.0, None, math.nan, math.inf])
    assert found.codes.tolist() == [0, 0, 1, 1, 2, 2, 2, 2]
    assert not found.no_lead_bin


def test_no_lead_gets_a_bin_of_its_own_on_request() -> None:
    """The quantiles are then those of the gaps that exist."""
    found = association.quantile_bins([4.0, None, 5.0, 6.0, 7.0, math.inf], 2, no_lead_bin=True)
    assert found.codes.tolist() == [0, 2, 0, 1, 1, 2]
    assert (found.sizes, found.no_lead_bin) == ((2, 2, 2), True)
    alone = association.quantile_bins([None, None], no_lead_bin=True)
    assert (alone.codes.tolist(), alone.sizes) == ([0, 0], (2,))


@given(
    gaps=st.lists(st.one_of(st.none(), st.integers(0, 50).map(float)), max_size=60),
    bins=st.integers(1, 6),
    own=st.booleans(),
)
def test_farther_gaps_never_get_a_nearer_bin(gaps: list, bins: int, *, own: bool) -> None:
    """Codes rise with the gap, equal gaps share a bin and the sizes add up."""
    found = association.quantile_bins(gaps, bins, no_lead_bin=own)
    ranks = np.array([math.inf if gap is None else gap for gap in gaps])
    order = np.argsort(ranks, kind="stable")
    assert (np.diff(found.codes[order]) >= 0).all()
    assert (np.diff(found.codes[order])[np.diff(np.nan_to_num(ranks[order], posinf=99)) == 0] == 0).all()
    assert sum(found.sizes) == len(gaps)
    assert len(found.sizes) <= bins + own


def test_a_gap_of_minus_infinity_is_refused() -> None:
    """The error says which gap."""
    with pytest.raises(ValueError, match="gap number 1 is -inf"):
        association.quantile_bins([1.0, -math.inf])


def test_many_tables_at_once_are_each_what_one_alone_is() -> None:
    """Of different shapes inside one stack: empty rows, empty columns, single counts, one row left, nothing."""
    tables = np.array(
        [
            [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
            [[5, 1, 0], [2, 6, 0], [0, 0, 0]],
            [[5, 0, 1], [2, 0, 6], [3, 0, 3]],
            [[1, 4, 2], [0, 0, 0], [3, 1, 1]],
            [[1, 4, 2], [0, 0, 0], [0, 0, 0]],
            [[1, 0, 0], [4, 0, 0], [2, 0, 0]],
            [[0, 0, 0], [0, 0, 0], [0, 0, 0]],
        ],
        dtype=np.float64,
    )
    alone = [association.cramers_v(table.astype(np.int64), correction=False).value for table in tables]
    assert alone[-1] is None
    assert association.cramers_v_of_tables(tables).tolist()[:-1] == pytest.approx(alone[:-1])
    assert np.isnan(association.cramers_v_of_tables(tables)[-1])
