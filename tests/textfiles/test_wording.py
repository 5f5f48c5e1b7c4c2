"""Outside text controls no terminal and stays readable."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from anaplot.textfiles.wording import plain, typed_path


@given(st.one_of(st.text(max_size=200), st.binary(max_size=200)), st.integers(10, 150))
def test_what_is_shown_is_printable_and_bounded(raw: str | bytes, limit: int) -> None:
    shown = plain(raw, limit)
    assert shown.isprintable()
    assert len(shown) <= limit
    assert plain(shown) == shown


@given(st.text())
def test_what_is_harmless_stays_and_nothing_else(text: str) -> None:
    assert (plain(text) == text) is text.isprintable()
    assert plain(text).isprintable()


@pytest.mark.parametrize(
    ("raw", "shown"),
    [
        (b"\x1b[2J ok\xe9\r", "\\x1b[2J ok\\xe9\\x0d"),
        ("a\u202eb\n\x9b7m\u2028\U000e0001", "a\\u202eb\\x0a\\x9b7m\\u2028\\U000e0001"),
        ("[red]x[/]", "[red]x[/]"),
        ("Müller Πάρνηθα 点 е́", "Müller Πάρνηθα 点 е́"),
    ],
)
def test_letters_of_all_languages_stay_and_controls_are_escaped(
    raw: str | bytes, shown: str
) -> None:
    assert plain(raw) == shown


def test_long_text_is_cut_between_characters_and_says_so() -> None:
    assert plain("x" * 120, 120) == "x" * 120
    assert plain("x" * 121, 120) == "x" * 117 + "..."
    assert plain(b"abc\x00\x00", 10) == "abc\\x00..."
    assert plain("é" * 1000, 5) == "éé..."


@pytest.mark.parametrize("name", ["d'q/b l", "x" * 300, "-b", "a;b", "$HOME", "ü", "d/-b", "~"])
def test_a_path_is_written_as_a_shell_reads_it(name: str) -> None:
    (word,) = shlex.split(typed_path(Path(name)))
    assert Path(word) == Path(name)
    assert not word.startswith("-")


def test_no_path_controls_a_terminal() -> None:
    assert typed_path(Path("a\x1b[2J\nb")) == "'a\\x1b[2J\\x0ab'"
