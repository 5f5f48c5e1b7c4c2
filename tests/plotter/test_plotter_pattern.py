from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from anaplot.plotter.pattern import MAX_PATTERN, PatternError, compile_pattern


@pytest.mark.parametrize(
    ("pattern", "yes", "no"),
    [
        (r"^a$", b"a", b"ab"),
        (r"^\d{2,3}$", b"123", b"1"),
        (r"^(?P<v>[-+ ][ 0-9.]{4})(?: mm)?$", b"- 1.5 mm", b"- 1.5 m"),
        (r"^(?:P|R) \d$", b"R 1", b"Q 1"),
        (r"^(?:(?P<a>x)|(?P<b>y))?z$", b"yz", b"xyz"),
        (r"^\x02[\x80-\xff]$", b"\x02\xfe", b"\x02\x10"),
        (r"^.$", b"\n", b""),
        (r"^[]a]+$", b"]a", b"b"),
        (r"^[^\d]$", b"x", b"1"),
        (r"^\$\.\[$", b"$.[", b"a.["),
    ],
)
def test_patterns_match_as_in_python(pattern, yes, no):
    compiled = compile_pattern(pattern)
    assert compiled.fullmatch(yes)
    assert not compiled.fullmatch(no)
    assert bool(re.fullmatch(pattern[1:-1].encode("latin-1"), yes, re.DOTALL))
    assert not re.fullmatch(pattern[1:-1].encode("latin-1"), no, re.DOTALL)


@pytest.mark.parametrize(
    "pattern",
    [
        "a$",
        "^a",
        r"^a\$",
        "^(a)$",
        r"^(?P<x>a)\1$",
        "^(?P<x>a)(?P=x)$",
        "^(?=a)a$",
        "^(?!a)b$",
        "^(?<=a)b$",
        "^(?i)a$",
        "^(?:a+)+$",
        "^(?:a|b)*$",
        "^(?:a){3}$",
        "^a**$",
        "^a+?$",
        "^a++$",
        "^a{3}{3}$",
        "^a{,3}$",
        "^a{9999}$",
        "^a{3,1}$",
        "^*$",
        "^a^b$",
        "^[a$",
        "^[z-a]$",
        "^(?:a$",
        "^a)$",
        "^(?P<x>a)(?P<x>b)$",
        r"^\Q$",
        r"^\x1$",
        "^\u4e2d$",
        "^" + "a" * MAX_PATTERN + "$",
        "^" + "(?:" * 9 + "a" + ")" * 9 + "$",
        "^" + "".join(f"(?P<g{n}>a)?" for n in range(10)) + "$",
        "^(?#comment)$",
        "^(?P<Upper>a)$",
    ],
)
def test_what_is_outside_the_language_is_refused(pattern):
    with pytest.raises(PatternError):
        compile_pattern(pattern)


def test_matching_never_goes_back():
    # in Python's own language these would need giving back, and nested forms of it stall
    assert not compile_pattern(r"^a*a$").fullmatch(b"aaa")
    assert not compile_pattern(r"^(?:a|ab)c$").fullmatch(b"abc")
    awkward = compile_pattern("^" + "(?:a|a)" * 60 + "b$")
    assert not awkward.fullmatch(b"a" * 60 + b"c")
    awkward = compile_pattern("^" + "a*" * 200 + "b$")
    assert not awkward.fullmatch(b"a" * 1000)


@pytest.mark.parametrize("text", ["[1--]", "[a-c--z]", "[^a--]", "[.--9]"])
def test_a_doubled_hyphen_in_a_class_may_come_to_mean_a_difference(text):
    with pytest.raises(PatternError, match="-- inside a class"):
        compile_pattern(f"^{text}$")


def test_a_hyphen_beside_a_hyphen_can_be_written():
    assert compile_pattern(r"^[+-\-]$").fullmatch(b",")
    assert compile_pattern(r"^[--9]$").fullmatch(b".")
    assert not compile_pattern(r"^[^--9]$").fullmatch(b".")


@given(st.text(alphabet=r"^$ab\d.[]()?P<x>:|{},12*+-", max_size=40), st.binary(max_size=30))
def test_any_text_is_a_pattern_or_an_error_and_what_matches_python_matches_too(text, data):
    try:
        compiled = compile_pattern(f"^{text}$")
    except PatternError:
        return
    if compiled.fullmatch(data):
        assert re.fullmatch(f"(?:{text})".encode("latin-1"), data, re.DOTALL)
