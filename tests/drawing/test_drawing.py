from __future__ import annotations

import pytest

from anaplot.drawing.drawing import Drawing


def test_a_drawing_keeps_what_it_is_given() -> None:
    drawing = Drawing("block-map", "Block", "Three photos.", '<svg role="img"></svg>')
    assert (drawing.key, drawing.title) == ("block-map", "Block")


@pytest.mark.parametrize(
    "key", ["", "Map", "a/b", "..", "a--b", "-a", "a-", "a b", "å", "a" * 81, "a\n"]
)
def test_a_key_can_name_a_file(key: str) -> None:
    with pytest.raises(ValueError, match="no key"):
        Drawing(key, "Block", "Three photos.", '<svg role="img"></svg>')


@pytest.mark.parametrize("text", ["", "<svg></svg>", "<p></p>", '<svg role="img"></svg>\n'])
def test_a_drawing_is_an_svg_element(text: str) -> None:
    with pytest.raises(ValueError, match="no svg element"):
        Drawing("map", "Block", "Three photos.", text)
