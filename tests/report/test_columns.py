"""What keeps tables to a page: no number is lost, no list item broken."""

from hypothesis import given
from hypothesis import strategies as st

from anaplot.report.columns import PAGE, cell, column, counted, fitted, shortened, wrapped


def test_long_names_keep_both_ends() -> None:
    assert shortened("p1", 10) == "p1"
    assert shortened("north-face-01", 10) == "nort...-01"
    assert shortened("north-face-02", 10) == "nort...-02"
    assert shortened("a\x1b[31m", 20) == "a\\x1b[31m"


@given(st.text(min_size=1), st.integers(5, 20))
def test_a_name_fits(name: str, width: int) -> None:
    assert len(shortened(name, width)) <= width


def test_numbers_fit_and_stay_numbers() -> None:
    assert fitted(None, 3, 7) == "-"
    assert fitted(1.23456, 3, 7) == "1.235"
    assert fitted(12345.678, 3, 7) == "12345.7"
    assert fitted(37243945.468, 3, 7) == "3.7e+07"
    assert fitted(-0.0004, 3, 7) == "0.000"
    assert fitted(-0.0006, 3, 7) == "-0.001"


@given(st.floats(0.0, 1e90))
def test_any_number_is_shown_within_five_percent(value: float) -> None:
    text = fitted(value, 3, 8)
    assert len(text) <= 8
    assert abs(float(text) - value) <= max(0.05 * value, 0.001)


def test_one_is_not_several() -> None:
    assert [counted(n, "run") for n in (0, 1, 1234567)] == ["0 runs", "1 run", "1234567 runs"]
    assert [counted(n, "base") for n in (1.0, 1.5)] == ["1 base", "1.5 bases"]
    assert [counted(n, "pass", "passes") for n in (1, 2)] == ["1 pass", "2 passes"]


def test_cells_keep_the_usual_layout() -> None:
    assert cell(-12.345, 2, 8) == f"{-12.345:8.2f}"
    assert cell(None, 2, 8) == f"{'-':>8}"
    assert column(12, 5) == f"{12:5d}"
    assert cell(-90998.7, 1, 8) == "  -90999"
    assert cell(2213356.366, 3, 10) == " 2213356.4"


@given(
    st.lists(st.tuples(st.none() | st.floats(), st.integers(0, 6), st.integers(6, 15)), min_size=1)
)
def test_no_cell_touches_its_neighbour(cells: list[tuple[float | None, int, int]]) -> None:
    row = "103-1" + "".join(cell(*one) for one in cells) + column("1e-300" * 3, 9)
    assert len(row.split()) == len(cells) + 2


@given(st.lists(st.text("ab c", min_size=1, max_size=30).filter(lambda s: s == s.strip())))
def test_lists_are_wrapped_between_items(items: list[str]) -> None:
    lines = wrapped("  names: ", items)
    assert max(map(len, lines)) <= PAGE
    joined = " ".join(line.strip() for line in lines)
    assert joined == " ".join(["names:", ", ".join(items)]).strip()
