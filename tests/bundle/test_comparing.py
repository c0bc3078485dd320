"""What counts as the same: values within a tolerance, printed digits up to a tie of rounding, drawings by place."""

import pytest

from eyechart.bundle.differences import RoundedNumbers, compare_tables, compare_values, is_same_drawing, is_same_number
from eyechart.bundle.pages import Tolerance, compare_pages
from eyechart.report.page import pack

EXACT = RoundedNumbers(())
STRICT = Tolerance(drawings=True, pictures=True)


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        (0.25, 0.25 + 1e-12, True),
        (0.25, 0.2500001, False),
        (1e12, 1e12 + 100, True),
        (0.0, 1e-16, True),
        (0.0, 2.3e-10, False),
        (2.3e-10, 2.3e-10 * (1 + 1e-12), True),
    ],
)
def test_numbers_are_the_same_within_the_tolerance(one: float, other: float, same: bool) -> None:  # noqa: FBT001
    """Relative to the larger of them; what rounding leaves of nothing is nothing."""
    assert is_same_number(one, other) is same is is_same_number(other, one)


@pytest.mark.parametrize(
    ("values", "printed", "recomputed", "same"),
    [
        ((0.3125,), "idi 0.312 [0.1]", "idi 0.313 [0.1]", True),
        ((0.3125 + 1e-12,), "idi 0.312", "idi 0.313", True),
        ((0.3127,), "idi 0.312", "idi 0.313", False),
        ((0.3125,), "idi 0.312", "idi 0.314", False),
        ((0.3125,), "idi 0.312", "ida 0.313", False),
        ((12.5,), "12 frames", "13 frames", False),
        ((0.3125,), "0.31", "0.313", False),
        ((), "0.312", "0.313", False),
        ((), "p <10⁻⁴", "p <10⁻⁴", True),
    ],
)
def test_a_last_digit_may_differ_where_a_value_lies_between(
    values: tuple[float, ...],
    printed: str,
    recomputed: str,
    same: bool,  # noqa: FBT001 - read by its name in the table above
) -> None:
    """Machines may round a tie otherwise; counts and words never."""
    assert RoundedNumbers(values).is_same(printed, recomputed) is same


def test_no_p_is_too_small_to_be_compared() -> None:
    """In results and in tables a tiny p is a number of its own, and 0 is another."""
    for place, tiny in ((("m", "p"), 2.3e-10), (("m", "p"), 1e-30), (("holm", "m"), 1e-30)):
        printed, recomputed = ({place[0]: {place[1]: value}} for value in (0.0, tiny))
        assert len([*compare_values(printed, recomputed, EXACT, str)]) == 1
    for column in ("p", "Holm p"):
        tables = (f"model,{column}\na,{value}\n" for value in ("0.0", "1.5e-30"))
        assert [table.where for table in compare_tables("t.csv", *tables, EXACT)] == [f"t.csv, a, {column}"]


def test_values_are_compared_by_type_and_by_place() -> None:
    """A number is no word, a flag no number, and what is missing on either side is named."""
    printed = {"a": 1, "b": [1.0, 2.0], "c": True, "d": "x", "more": 0}
    recomputed = {"a": 1.0, "b": [1.0], "c": 1, "d": "x", "less": None}
    differences = compare_values(printed, recomputed, EXACT, lambda path: "/".join(map(str, path)))
    assert [(difference.where, difference.printed, difference.recomputed) for difference in differences] == [
        ("a", "1", "1.0"),
        ("b", "2 values", "1 values"),
        ("c", "True", "1"),
        ("less", "nothing", "None"),
        ("more", "0", "nothing"),
    ]


def test_numbers_of_results_are_known_to_the_rounding() -> None:
    """All of them, in lists and beneath names; flags are none."""
    assert RoundedNumbers.of({"a": [1, 2.5, {"b": -3.0}], "c": True, "d": "7"}).values == (-3.0, 1.0, 2.5)


def test_drawings_are_the_same_where_nothing_can_be_seen_to_move() -> None:
    """A fiftieth of a point."""
    assert is_same_drawing("M 10.001 20 L 3 4", "M 10.002 20 L 3 4")
    assert not is_same_drawing("M 10.1 20 L 3 4", "M 10.2 20 L 3 4")
    assert not is_same_drawing("M 10 20", "L 10 20")


def test_a_csv_cell_is_named_by_row_and_column() -> None:
    """With full digits it may differ beyond the ninth."""
    text = "model,value\na,0.123456789012\nb,2\n"
    assert list(compare_tables("t.csv", text, text.replace("9012", "9013"), EXACT)) == []
    (found,) = compare_tables("t.csv", text.replace("b,2", "b,3"), text, EXACT)
    assert (found.where, found.printed, found.recomputed) == ("t.csv, b, value", "3", "2")
    (lines,) = compare_tables("t.csv", text.replace("\n", "\r\n"), text, EXACT)
    assert lines.where == "t.csv, its writing"


PAGE = (
    '<section id="s"><h2>Title</h2><table><caption>Counts</caption><thead><tr><th>model</th><th>n</th></tr></thead>'
    "<tbody><tr><th>m1</th><td>5</td></tr></tbody></table>"
    '<svg><title>Drawing</title><path d="M 1 2"/><text>0.5</text></svg></section>'
    '<script type="application/json" id="data">{}</script>'
)


@pytest.mark.parametrize(
    ("old", "new", "where"),
    [
        ("<td>5", "<td>6", "report.html, s, table 'Counts', m1, n"),
        ("M 1 2", "M 1 3", "report.html, s, figure 'Drawing', path d"),
        (">0.5<", ">0.6<", "report.html, s, figure 'Drawing'"),
        ("<td>5", "<td hidden>5", "report.html, s, table 'Counts', m1, n, td hidden"),
        ("Title", "Titel", "report.html, s"),
    ],
)
def test_a_difference_in_a_page_is_named_by_its_place(old: str, new: str, where: str) -> None:
    """Section, figure, table, row and column."""
    (found,) = compare_pages(PAGE.replace(old, new), PAGE, EXACT, STRICT)
    assert found.where == where


def test_without_the_same_library_drawings_are_compared_by_their_words() -> None:
    """Lines may lie elsewhere; numbers may not."""
    loose = Tolerance(drawings=False, pictures=True)
    assert list(compare_pages(PAGE.replace("M 1 2", "M 9 9 L 1 1"), PAGE, EXACT, loose)) == []
    assert len(list(compare_pages(PAGE.replace(">0.5<", ">0.6<"), PAGE, EXACT, loose))) == 1


@pytest.mark.parametrize("more", ["<!doctype html>", "<?pi x?>", "<!-- c -->", '<p a="1">', "</p>", "<", "t"])
def test_nothing_in_a_page_is_overlooked(more: str) -> None:
    """Comments, declarations and instructions are found too, on either side."""
    for pages in ((PAGE + more, PAGE), (PAGE, PAGE + more)):
        assert len(list(compare_pages(*pages, EXACT, STRICT))) == 1


def _packed(text: str) -> str:
    frame = {"id": "f1", "scenario": "light"}
    model = {"name": "m", "calls": {"real": [[0, "STOP", True]]}}
    run = {"name": "r", "frames": [frame], "pictures": {"real": [0]}, "models": [model]}
    return (
        f'{PAGE}<script type="application/octet-stream" id="packed">{pack({"texts": [text], "runs": [run]})}</script>'
    )


@pytest.mark.parametrize(
    ("printed", "found"),
    [
        (_packed("I stop."), []),
        (_packed("I go."), [("report.html, frames, m, real, frame f1, reply", "I go.")]),
        (_packed("I stop." * 10_000), [("report.html, frames", "data that cannot be read")]),
        (
            _packed("I stop.").replace('id="packed">e', 'id="packed">f'),
            [("report.html, frames", "data that cannot be read")],
        ),
    ],
    ids=["the same", "a reply changed", "far more than recomputed", "damaged"],
)
def test_packed_replies_are_compared_as_those_that_lie_open(printed: str, found: list[tuple[str, str]]) -> None:
    """A changed reply is named by its call; what unpacks to far more, or not at all, is no data."""
    assert [(page.where, page.printed) for page in compare_pages(printed, _packed("I stop."), EXACT, STRICT)] == found
