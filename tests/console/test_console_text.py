from hypothesis import given
from hypothesis import strategies as st
from rich.cells import cell_len

from anaplot.console.text import cell, fit, fit_end, number, wrap
from anaplot.textfiles.wording import plain


@given(st.text(), st.integers(0, 40), st.booleans())
def test_fitted_text_has_its_width(text, width, right):
    assert cell_len(fit(text, width, right=right)) == width


def test_long_text_says_that_it_goes_on():
    assert fit("abcdef", 4) == "abc…"
    assert fit("abcd", 4) == "abcd"
    assert fit("ab", 4, right=True) == "  ab"


@given(st.text(), st.integers(2, 40))
def test_wrapped_lines_fit_and_lose_no_word(text, width):
    lines = wrap(text, width)
    assert all(cell_len(line) <= width for line in lines)
    assert "".join("".join(lines).split()) == "".join(plain(text).split())


def test_words_stay_whole_where_they_can():
    assert wrap("remeasure 103 (y): 12 to 1", 14) == ["remeasure 103", "(y): 12 to 1"]
    assert wrap("", 5) == []


def test_numbers_keep_their_column():
    assert number(3.14159, 7, 2) == "   3.14"
    assert number(None, 6, 2) == "     –"
    assert number(float("nan"), 6, 2) == "     –"
    assert number(123456.78, 6, 1) == "123457"
    assert number(-0.04, 6, 1) == "   0.0"
    assert number(1.5e12, 6, 1) == " 2e+12"


@given(st.floats(-1e300, 1e300), st.integers(7, 12), st.integers(0, 4))
def test_a_number_is_never_wider_than_its_column(value, width, decimals):
    assert len(number(value, width, decimals)) == width


@given(st.floats(-1e300, 1e300), st.integers(7, 12), st.integers(0, 4))
def test_a_cell_never_touches_its_neighbour(value, width, decimals):
    assert len(f"7{cell(value, width, decimals)}{cell(value, width, decimals)}".split()) == 3
    assert len(cell(value, width + 1, decimals)) == width + 1
    assert cell(-1.25, 7, 2) == number(-1.25, 7, 2)


@given(st.text(), st.integers(1, 40))
def test_names_have_their_width_and_keep_their_end(text, width):
    shown = fit_end(text, width)
    assert cell_len(shown) == width
    assert shown.startswith("…") or shown.rstrip() == plain(text).rstrip()


def test_names_that_differ_at_the_end_stay_different():
    assert fit_end("10203-1'", 6) == "…03-1'"
    assert fit_end("102-1'", 6) == "102-1'"
    assert fit_end("点点点", 4) == "…点 "
