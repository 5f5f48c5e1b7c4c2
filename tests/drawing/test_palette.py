"""Contrast by the formula of WCAG 2.1 (relative luminance)."""

from __future__ import annotations

import re
from itertools import pairwise
from typing import Literal

import pytest

from anaplot.drawing.palette import COLOURS, RAMP, SERIES, declarations
from anaplot.drawing.style import STYLE

THEMES: tuple[Literal["light", "dark"], ...] = ("light", "dark")


def luminance(colour: str) -> float:
    parts = [int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one: str, other: str) -> float:
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


def colours(theme: Literal["light", "dark"]) -> dict[str, str]:
    return {each.name: getattr(each, theme) for each in COLOURS}


def test_the_formula_is_that_of_the_standard() -> None:
    assert contrast("#000000", "#ffffff") == pytest.approx(21.0)
    assert contrast("#777777", "#ffffff") == pytest.approx(4.48, abs=0.01)


@pytest.mark.parametrize("theme", THEMES)
@pytest.mark.parametrize("name", ["ink", "soft", "good", "warn", "bad"])
def test_text_is_readable_on_the_paper(theme: Literal["light", "dark"], name: str) -> None:
    of = colours(theme)
    assert contrast(of[name], of["paper"]) >= 4.5


@pytest.mark.parametrize("theme", THEMES)
@pytest.mark.parametrize("name", [f"series-{k}" for k in range(1, SERIES + 1)])
def test_lines_are_seen_on_the_paper(theme: Literal["light", "dark"], name: str) -> None:
    of = colours(theme)
    assert contrast(of[name], of["paper"]) >= 3.0


@pytest.mark.parametrize("theme", THEMES)
@pytest.mark.parametrize("sign", ["minus", "plus"])
@pytest.mark.parametrize("step", [1, 2, 3])
def test_numbers_are_readable_on_tints(
    theme: Literal["light", "dark"], sign: str, step: int
) -> None:
    of = colours(theme)
    assert contrast(of["ink"], of[f"{sign}-{step}"]) >= 4.5


@pytest.mark.parametrize("theme", THEMES)
def test_the_ramp_goes_from_the_paper_to_the_ink(theme: Literal["light", "dark"]) -> None:
    of = colours(theme)
    steps = [contrast(of[f"ramp-{k}"], of["paper"]) for k in range(1, RAMP + 1)]
    assert steps == sorted(steps)
    assert all(b / a > 1.25 for a, b in pairwise(steps))


def test_the_style_asks_for_what_the_palette_has() -> None:
    asked = dict(re.findall(r"var\(--([a-z0-9-]+),(#[0-9a-f]{6})\)", STYLE))
    assert asked == colours("light")
    assert declarations("dark").count(";") == len(COLOURS)


def test_the_style_fetches_nothing() -> None:
    assert "url(" not in STYLE
    assert "@import" not in STYLE
    assert "<" not in STYLE
