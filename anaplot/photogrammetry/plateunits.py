"""In what plate coordinates are: millimetres, or whatever a scanner or comparator counts.

The fiducials find the scale of any unit. Only of a unit whose length is known beforehand can be
said by how much film has shrunk.
"""

from __future__ import annotations

from typing import NamedTuple

__all__ = ["MILLIMETRE", "PLATE_UNITS", "PlateUnit"]


class PlateUnit(NamedTuple):
    """A unit of plate coordinates.

    Attributes
    ----------
    name
        What a person calls it.
    per_mm
        How many are a millimetre; None where only the fiducials say it.
    most
        Largest coordinate that is believed.
    """

    name: str
    per_mm: float | None
    most: float


MILLIMETRE = PlateUnit("mm", 1.0, 1e4)  # no plate carrier travels ten metres

PLATE_UNITS: dict[str, PlateUnit] = {
    unit.name: unit
    for unit in (
        MILLIMETRE,
        PlateUnit("um", 1e3, 1e7),
        PlateUnit("px", None, 1e9),
        PlateUnit("count", None, 1e9),
    )
}
"""All units by name."""
