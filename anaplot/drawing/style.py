"""The one style sheet of all drawings: classes, and the custom properties that colour them."""

from __future__ import annotations

from typing import Final

from anaplot.drawing.palette import COLOURS, RAMP, SERIES
from anaplot.drawing.textwidth import SMALL, TEXT, TINY

__all__ = ["FONT", "STYLE"]

FONT: Final = "system-ui, -apple-system, 'Segoe UI', 'Noto Sans', 'DejaVu Sans', sans-serif"
"""Fonts of every system; none is fetched."""

_LIGHT = {colour.name: colour.light for colour in COLOURS}


def _colour(name: str) -> str:
    return f"var(--{name},{_LIGHT[name]})"


def _sheet() -> str:
    """Return the rules: text, what is drawn as line (l-) and what is filled (f-), by colour."""
    ink, soft, paper = _colour("ink"), _colour("soft"), _colour("paper")
    rules = [
        ".drawing{display:block;width:100%;height:auto;font-family:" + FONT + ";"
        f"font-size:{TEXT:g}px;font-variant-numeric:tabular-nums;background:" + paper + "}",
        f".drawing text{{fill:{ink};stroke:none}}",
        f".drawing text.t-soft{{fill:{soft}}}",
        f".drawing text.t-bad{{fill:{_colour('bad')}}}",
        ".drawing text.t-title{font-size:15px;font-weight:600}",
        f".drawing text.t-small{{font-size:{SMALL:g}px}}",
        f".drawing text.t-tiny{{font-size:{TINY:g}px}}",
        ".drawing text.t-strong{font-weight:600}",
        ".drawing text.t-mid{text-anchor:middle}",
        ".drawing text.t-end{text-anchor:end}",
        # names over lines and dots: a rim of paper keeps them readable
        f".drawing text.t-halo{{paint-order:stroke;stroke:{paper};stroke-width:3px;"
        "stroke-linejoin:round}",
        ".drawing .line{fill:none;stroke-width:1.25;stroke-linecap:round;stroke-linejoin:round}",
        ".drawing .dot{fill:none;stroke-linecap:round}",  # its width is its stroke's
        ".drawing .thin{stroke-width:.75}",
        ".drawing .bold{stroke-width:2}",
        ".drawing .dashed{stroke-dasharray:5 4}",
        ".drawing .dotted{stroke-dasharray:1.5 3}",
        ".drawing .faint{opacity:.45}",
        ".drawing .tint{fill-opacity:.14}",
        f".drawing .frame{{fill:none;stroke:{soft};stroke-width:1}}",
        f".drawing .grid{{fill:none;stroke:{_colour('grid')};stroke-width:1}}",
        f".drawing .rim{{stroke:{ink};stroke-width:.75}}",
        f".drawing .gap{{stroke:{paper};stroke-width:1}}",
    ]
    names = ["ink", "soft", "paper", "grid", "good", "warn", "bad"]
    names += [f"series-{k}" for k in range(1, SERIES + 1)]
    names += [f"ramp-{k}" for k in range(1, RAMP + 1)]
    names += [f"{sign}-{k}" for sign in ("minus", "plus") for k in (1, 2, 3)]
    rules += [f".drawing .l-{name}{{stroke:{_colour(name)}}}" for name in names]
    rules += [f".drawing .f-{name}{{fill:{_colour(name)}}}" for name in names]
    return "\n".join(rules) + "\n"


STYLE: Final = _sheet()
"""What a page that holds drawings puts into a `<style>`, once.

The page may set the custom properties (`anaplot/drawing/palette.py`); without them drawings are
light."""
