"""What keeps tables to a page: no number is lost, no list item broken."""

from hypothesis import given
from hypothesis import strategies as st

from anaplot.report.columns import PAGE, fitted, shortened, wrapped


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


@given(st.floats(0.0, 1e90))
def test_any_number_is_shown_within_five_percent(value: float) -> None:
    text = fitted(value, 3, 8)
    assert len(text) <= 8
    assert abs(float(text) - value) <= max(0.05 * value, 0.001)


@given(st.lists(st.text("ab c", min_size=1, max_size=30).filter(lambda s: s == s.strip())))
def test_lists_are_wrapped_between_items(items: list[str]) -> None:
    lines = wrapped("  names: ", items)
    assert max(map(len, lines)) <= PAGE
    joined = " ".join(line.strip() for line in lines)
    assert joined == " ".join(["names:", ", ".join(items)]).strip()
