"""What comes from files is text in a drawing, whatever it looks like."""

from __future__ import annotations

import unicodedata

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from svgs import parsed, sound, texts

from anaplot.drawing.element import Svg, element, escaped, shortened, text
from anaplot.drawing.frame import equal_frame
from anaplot.drawing.plot import Head, Plot
from anaplot.drawing.standalone import standalone
from anaplot.textfiles.wording import plain

HOSTILE = [
    "<script>alert(1)</script>",
    '"><svg onload=alert(1)>',
    "]]><!--",
    "&lt;b&gt;&#x3c;",
    "‮txet desrever",
    "\x1b[31m\x00\x07",
    "אבג 12",
    "x" * 5000,
    "\ud800",
    "ab",
    "\ufffe\uffff",
]


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_name_is_text(name: str) -> None:
    root = parsed(f"<svg>{text(1, 2, name, most=14)}</svg>")
    assert [one.tag for one in root.iter()].count("script") == 0
    shown = root[0]
    title = shown.find("title")
    whole = plain(name, 2000)
    if title is None:
        assert shown.text == whole
    else:
        assert title.text == whole
        assert len(title.tail or "") <= 14


@given(st.text(max_size=200))
def test_escaped_text_comes_back(name: str) -> None:
    root = parsed(f"<a b='{escaped(name)}'>{escaped(name)}</a>")
    assert (root.text or "") == plain(name, 2000)
    assert root.get("b") == plain(name, 2000)
    kinds = {unicodedata.category(c) for c in root.text or ""}
    assert not kinds & {"Cc", "Cf", "Cs", "Co", "Cn"}


@given(st.text(max_size=60), st.integers(min_value=3, max_value=30))
def test_a_short_name_keeps_its_ends(name: str, most: int) -> None:
    short, whole = shortened(name, most), plain(name)
    assert len(short) <= most
    if len(whole) <= most:
        assert short == whole
    else:
        first, last = short.split("…", 1) if "…" not in whole else (whole[:1], whole[-1:])
        assert abs(len(first) - len(last)) <= 1 or "…" in whole
        assert whole.startswith(first)
        assert whole.endswith(last)


@given(st.text(max_size=80), st.text(max_size=80), st.text(max_size=80))
def test_a_drawing_of_foreign_words_is_sound(title: str, name: str, note: str) -> None:
    head = Head("one", f"Photo {title}", f"1 of {title}")
    plot = Plot(head, equal_frame(head.bottom, np.array([[0.0, 0.0], [2.0, 1.0]])))
    plot.axes("X [m]", "Y [m]")
    plot.names(np.array([[1.0, 0.5]]), [name])
    plot.note(note)
    drawing = plot.drawing(f"1 point {name}")
    root = sound(drawing)
    assert root[0].text == plain(f"Photo {title}", 2000)
    assert shortened(name, 14) in texts(root) or not name.strip()
    assert parsed(standalone(drawing)).tag == root.tag


def test_attributes_are_escaped_and_numbers_short() -> None:
    one = element("path", class_='a" onload="x', x=0.25, y=-0.5, width=3.0, stroke_width=None)
    root = parsed(one)
    assert root.attrib == {"class": 'a" onload="x', "x": ".2", "y": "-.5", "width": "3"}


def test_elements_hold_elements() -> None:
    inner = element("title", escaped("a & b"))
    assert element("g", inner) == Svg("<g><title>a &amp; b</title></g>")
