"""From the plotter's plates to the photographs' image systems, and back.

The plates lie in the image system: inner orientation has its place here and is the identity.
"""

from __future__ import annotations

from anaplot.plotter.readings import Position
from anaplot.station.snapshot import ReadOut

__all__ = ["image_of", "plate_of"]


def image_of(position: Position) -> ReadOut:
    """Return image coordinates [mm] of plate coordinates."""
    return ReadOut(position.xl, position.yl, position.xr, position.yr)


def plate_of(xl: float, yl: float, xr: float, yr: float) -> Position:
    """Return plate coordinates [mm] of image coordinates."""
    return Position(xl, yl, xr, yr)
