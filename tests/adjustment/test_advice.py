"""Odds in words: what is compared, and what is left to reckon with."""

from __future__ import annotations

import pytest

from anaplot.adjustment.advice import odds_in_words, to_one


@pytest.mark.parametrize(
    ("more", "less", "said"),
    [
        (0.6, 0.05, "12 to 1"),
        (0.5, 0.25, "2.0 to 1"),
        (0.1, 0.4, "1 to 4.0"),
        (0.9, 0.0, "more than 1000 to 1"),
        (0.9, 1e-4, "more than 1000 to 1"),
    ],
)
def test_ratios(more, less, said) -> None:
    assert to_one(more, less) == said


def test_what_is_clear_is_not_said() -> None:
    assert odds_in_words({"103": 0.92, "104": 0.0767, "105": 0.001}, "103", "104") == (
        "12 to 1 over 104"
    )


def test_no_error_is_the_third_number() -> None:
    # in 12 of 13 cases that one of the two is to blame for: in 60 of 100 of all
    assert odds_in_words({"103": 0.6, "104": 0.05, "105": 0.01}, "103", "104") == (
        "12 to 1 over 104, 1.8 to 1 over no error"
    )
    # where no error is more probable still, a sentence of its own says so
    assert odds_in_words({"103": 0.3, "104": 0.025}, "103", "104") == "12 to 1 over 104"


def test_all_others_together_are_said_where_they_are_more_than_the_rival() -> None:
    chances = {"103": 0.6, "104": 0.05, "105": 0.05, "106": 0.05, "107": 0.05}
    assert odds_in_words(chances, "103", "104") == (
        "12 to 1 over 104, 4.0 to 1 over all others, 3.0 to 1 over no error"
    )


def test_what_is_next_to_impossible_is_said_and_not_divided_by() -> None:
    assert to_one(0.0, 0.9) == "1 to more than 1000"
    assert to_one(1e-9, 0.9) == "1 to more than 1000"
    assert to_one(0.9, 0.0) == "more than 1000 to 1"
    assert to_one(0.1, 0.9) == "1 to 9.0"
