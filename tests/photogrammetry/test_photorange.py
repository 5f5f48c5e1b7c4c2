"""Photos named by a range."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from anaplot.photogrammetry.photorange import MAX_PHOTOS, photo_range, split_range


def test_ranges_count_up_and_down_and_keep_zeros() -> None:
    assert photo_range("101", "104") == ("101", "102", "103", "104")
    assert photo_range("220", "218") == ("220", "219", "218")
    assert photo_range("L-098", "L-101") == ("L-098", "L-099", "L-100", "L-101")
    assert photo_range("9", "11") == ("9", "10", "11")
    assert photo_range("0", "10")[-1] == "10"
    assert photo_range("7", "7") == ("7",)


@pytest.mark.parametrize(
    ("first", "last", "words"),
    [
        ("a", "b", "no number at its end"),
        ("", "1", "no number at its end"),
        ("a1", "b2", "differ before"),
        ("098", "1001", "equally long"),
        ("1", str(MAX_PHOTOS + 1), "more than"),
    ],
)
def test_what_is_no_range(first: str, last: str, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        photo_range(first, last)


@given(
    st.text("abc-_ /", max_size=5),
    st.integers(0, 99_000),
    st.integers(-300, 300),
    st.integers(0, 6),
)
def test_a_range_begins_and_ends_where_it_says(
    before: str, start: int, length: int, width: int
) -> None:
    end = max(0, start + length)
    first, last = f"{before}{start:0{width}d}", f"{before}{end:0{width}d}"
    if len(first) != len(last) and any(
        name.removeprefix(before).startswith("0") and len(name) > len(before) + 1
        for name in (first, last)
    ):
        return  # zeros that cannot be kept
    photos = photo_range(first, last)
    assert photos[0] == first
    assert photos[-1] == last
    assert len(set(photos)) == len(photos) == abs(end - start) + 1
    assert photo_range(last, first) == photos[::-1]
    if first.strip() == first and first[:1] != "-":
        assert split_range(f"{first}-{last}") is not None


def test_a_range_in_one_word() -> None:
    assert split_range("101-120") == ("101", "120")
    assert split_range(" 101 - 120 ") == ("101", "120")
    assert split_range("A-1-A-9") == ("A-1", "A-9")
    assert split_range("101") is None
    assert split_range("a-b") is None
    assert split_range("101-b20") is None
