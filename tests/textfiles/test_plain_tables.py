"""Plain tables at the end of a TOML text are read as tomllib reads them, or left to it."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from anaplot.errors import InputError
from anaplot.textfiles import tomlplain, tomlvalues
from anaplot.textfiles.tomlplain import PlainTables, plain_tables
from anaplot.textfiles.tomltable import parse_toml
from anaplot.textfiles.tomlvalues import TomlError, toml_values

KEYS = st.sampled_from(["id", "camera", "position", "a-b", "1", "base"])
VALUES = st.sampled_from(
    [
        *('"x"', '"\u00e4 b"', '""', '"a = b"', '"[[photo]]"', '",}"', '"},{"', r'"\u0041"', "'y'"),
        *("0.1", "-1e-7", "1E+05", "-0", "-0.0", "12", "1_000", "0x10", "nan", "01", "1.", "1e400"),
        *("[1.0, -2]", '["p", "q"]', "[]", "[1,2]", "[[1.0], [2.0]]", "true", "2020-01-01"),
        *('{ omega = 0.1, unit = "deg" }', "{}", "{ a = 1, a = 2 }", "{ a.b = 1 }", "null"),
        *('"""', "'''", "[", '"a" # said', '"\x7f"', '"\t"', "9" * 5000),
    ]
)
LINES = st.one_of(
    st.sampled_from(["[[photo]]", "[[photo]]", "[[strip]]", "[photo]", "[photo.lens]", "[[a.b]]"]),
    st.sampled_from(["", "", "# said", " ", '"""', "'''", "]", "photo.id = 1", "[[photo]] # one"]),
    st.builds("{} = {}".format, KEYS, VALUES),
    st.builds("{} = {}".format, KEYS, st.sampled_from(['"x"', "0.5", "[0.1, 2.0]"])),
)


@given(st.lists(LINES, max_size=14), st.sampled_from(["\n", "\n", "\r\n"]), st.booleans())
def test_texts_say_what_tomllib_reads(lines: list[str], end: str, closed: bool) -> None:
    text = end.join(lines) + (end if closed else "")
    try:
        expected = repr(tomllib.loads(text))  # the order of keys, and of what kind a number is
    except ValueError:
        with pytest.raises(TomlError):
            toml_values(text)
    else:
        assert repr(toml_values(text)) == expected


@pytest.mark.parametrize(
    "name", ['",}"', '"},{"', '"a = b"', '"[[photo]]"', r'"\u0041"', '"#"', '", "']
)
def test_names_are_no_punctuation(name: str) -> None:
    text = f"[[photo]]\nid = {name}\n\n[[photo]]\nid = {name}\nposition = [0.5, {name}]\n"
    assert toml_values(f"a = 1\n{text}") == tomllib.loads(f"a = 1\n{text}")


def test_what_programs_write_is_plain() -> None:
    photo = (
        '[[photo]]\nid = "DSC 1.jpg"\ncamera = "c"\nposition = [1.5, -2e-05, 3.0]\n'
        'rotation = { omega = -0.1, phi = 0.0, kappa = 3.1, unit = "rad" }\ntime = 4.0\n'
    )
    strips = '[[strip]]\nid = "1"\nphotos = ["DSC 1.jpg", "2"]\n\n'
    found = plain_tables(f"format = 1\n\n{strips}{photo}\n{photo}")
    assert found is not None
    assert (found.name, len(found.tables)) == ("photo", 2)
    assert found.tables[1] == tomllib.loads(photo)["photo"][0]
    before = plain_tables(found.before)
    assert before is not None
    assert (before.name, before.before) == ("strip", "format = 1\n\n")


def test_many_names_of_tables_are_no_passes_of_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[int] = []

    def counted(text: str) -> PlainTables | None:
        read.append(len(text))
        return plain_tables(text)

    monkeypatch.setattr(tomlvalues, "plain_tables", counted)
    others = "".join(f"[[a{k}]]\nb = {k}\n" for k in range(100))
    for end in ("", '[[photo]]\nid = "1"\n[[strip]]\nid = "1"\n'):
        read.clear()
        assert toml_values(others + end) == tomllib.loads(others + end)
        assert 1 <= len(read) <= 3


def test_a_key_is_looked_for_where_a_word_begins_alone() -> None:
    # else a text of n letters would be gone through n times
    assert tomlplain._NAMED.match("photo = ", 0) is not None
    assert not any(tomlplain._NAMED.match("photo-1 = ", k) for k in range(1, 7))


@pytest.mark.parametrize(
    ("last", "why"),
    [
        ("id = x", "line 9: not valid TOML"),
        ('id = "3"\nid = "3"', "line 10: not valid TOML"),
        ('id = "3"\nbase = ', "line 10: not valid TOML"),
    ],
)
def test_what_is_wrong_behind_plain_tables_keeps_its_line(last: str, why: str) -> None:
    text = '[[photo]]\nid = "1"\n\n[[photo]]\nid = "2"\n\n\n[[photo]]\n' + last + "\n"
    with pytest.raises(InputError, match=why):
        parse_toml(text, Path("block.toml"))
