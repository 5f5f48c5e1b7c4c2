from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from anaplot.plotter.template import TemplateError, parse_template


@pytest.mark.parametrize(
    ("template", "values", "expected"),
    [
        ("P {x:+09.4f}", {"x": 12.3456}, b"P +012.3456"),
        ("P {x:+09.4f}", {"x": -0.00001}, b"P +000.0000"),
        ("{x.sign}{x.abs:10.4f}", {"x": -5.23}, b"-    5.2300"),
        ("{x.sign}{x.abs:10.4f}", {"x": -0.00001}, b"+    0.0000"),
        ("{n:d} {n:+010d} {n:04X}", {"n": 171.2}, b"171 +000000171 00AB"),
        ("{{{s}}}", {"s": "a"}, b"{a}"),
        ("\x02{s}", {"s": b"\xff"}, b"\x02\xff"),
        ("{s:5s}|", {"s": "ab"}, b"ab   |"),
        ("", {}, b""),
    ],
)
def test_render(template, values, expected):
    assert parse_template(template).render(values) == expected


@pytest.mark.parametrize(
    "text",
    [
        "{",
        "}",
        "{}",
        "{x",
        "{x!r}",
        "{x.__class__}",
        "{x[0]}",
        "{0}",
        "{x:>5f}",
        "{x:999f}",
        "{x:.4d}",
        "a" * 301,
        "\u4e2d",
        "{X}",
        "{x:{y}f}",
    ],
)
def test_what_is_no_template_is_refused(text):
    with pytest.raises(TemplateError):
        parse_template(text)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), "a", b"a"])
def test_a_number_is_needed(value):
    with pytest.raises(TemplateError):
        parse_template("{x:.3f}").render({"x": value})
    with pytest.raises(TemplateError):
        parse_template("{x.sign}").render({"x": value if isinstance(value, str | bytes) else "b"})


def test_a_missing_value_is_an_error():
    with pytest.raises(TemplateError, match="no value"):
        parse_template("{x}").render({})


@given(st.floats(-999.9, 999.9), st.floats(-999.9, 999.9))
def test_the_matcher_reads_back_what_was_written(x, y):
    template = parse_template("G {x:+09.4f} {y:+09.4f}")
    match = template.matcher().fullmatch(template.render({"x": x, "y": y}))
    assert match is not None
    assert abs(float(match["x"]) - x) <= 5.1e-5
    assert abs(float(match["y"]) - y) <= 5.1e-5


@given(st.floats(-999.9, 999.9), st.integers(-99_999, 99_999), st.floats(-99.9, 99.9))
def test_numbers_are_read_back_in_every_form(x, y, z):
    template = parse_template("{x.sign}{x.abs:08.3f} {y:x} {z:+8.2f}")
    assert template.told == {"x", "y", "z"}
    match = template.matcher().fullmatch(template.render({"x": x, "y": y, "z": z}))
    assert match is not None
    assert abs(template.number(match, "x") - x) <= 5.1e-4
    assert template.number(match, "y") == y
    assert abs(template.number(match, "z") - z) <= 5.1e-3


def test_a_sign_alone_tells_no_number():
    template = parse_template("{x.sign} {y.abs:d} {z}")
    assert template.told == {"y", "z"}
    match = template.matcher().fullmatch(b"- 12 a")
    assert match is not None
    with pytest.raises(ValueError, match="could not convert"):
        template.number(match, "z")
