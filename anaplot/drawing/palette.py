"""The colours, for light and dark paper: told apart by the colour-blind, never all that is told.

Series colours are those of Okabe and Ito (2008, "Color Universal Design"), made darker for white
paper until lines have a contrast of 3 to 1 (WCAG 2.1, 1.4.11); texts have 4.5 to 1 (1.4.3). The
ramp is viridis in five steps, from what is inconspicuous on the paper to what is conspicuous.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

__all__ = ["COLOURS", "RAMP", "SERIES", "Colour", "declarations"]

SERIES = 8
"""How many series colours there are: `--series-1` to `--series-8`."""

RAMP = 5
"""How many steps the ordered colours have: `--ramp-1` (low) to `--ramp-5` (high)."""


class Colour(NamedTuple):
    """A colour on either paper.

    Attributes
    ----------
    name
        Of its custom property, without the hyphens before it.
    light, dark
        "#rrggbb" on light and on dark paper.
    """

    name: str
    light: str
    dark: str


COLOURS: tuple[Colour, ...] = (
    Colour("paper", "#ffffff", "#15181c"),
    Colour("ink", "#1d2329", "#e8ebee"),
    Colour("soft", "#59636e", "#a3adb8"),  # second in rank: tick labels, remarks
    Colour("grid", "#d9dee3", "#333a42"),  # may be missed without loss
    Colour("series-1", "#0072b2", "#56a8e8"),
    Colour("series-2", "#d55e00", "#f2803a"),
    Colour("series-3", "#00805d", "#2fbf94"),
    Colour("series-4", "#b0528a", "#dd8fc0"),
    Colour("series-5", "#a87000", "#e6a117"),
    Colour("series-6", "#3786bd", "#7cc7f2"),
    Colour("series-7", "#7a6a00", "#e3d94a"),
    Colour("series-8", "#5b6470", "#a8b1bb"),
    Colour("good", "#00805d", "#2fbf94"),
    Colour("warn", "#986400", "#e6a117"),
    Colour("bad", "#c2330f", "#ff7a59"),
    Colour("ramp-1", "#fde725", "#5c3a86"),
    Colour("ramp-2", "#5ec962", "#4a6db0"),
    Colour("ramp-3", "#21918c", "#21918c"),
    Colour("ramp-4", "#3b528b", "#5ec962"),
    Colour("ramp-5", "#440154", "#fde725"),
    # tints under the ink's text: of negative and of positive numbers
    Colour("minus-1", "#e3eef8", "#1d2b38"),
    Colour("minus-2", "#aed0eb", "#234763"),
    Colour("minus-3", "#74b0df", "#265f8f"),
    Colour("plus-1", "#fdebdd", "#38291c"),
    Colour("plus-2", "#f6c49c", "#634020"),
    Colour("plus-3", "#ee9a55", "#8a4f1c"),
)
"""Every custom property that a drawing asks for."""


def declarations(theme: Literal["light", "dark"]) -> str:
    """Return the custom properties of a theme, as the inside of a CSS rule: "--ink:#1d2329;..."."""
    return "".join(f"--{each.name}:{getattr(each, theme)};" for each in COLOURS)
