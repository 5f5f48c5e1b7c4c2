"""The readings, under the name by which other programs know them."""

from anaplot.photogrammetry.readings import (
    KEY,
    UNREFERENCED,
    Fault,
    InPosition,
    Position,
    Reading,
    Record,
    Refused,
)

__all__ = [
    "KEY",
    "UNREFERENCED",
    "Fault",
    "InPosition",
    "Position",
    "Reading",
    "Record",
    "Refused",
]
