"""The readings, under the name by which other programs know them."""

from anaplot.photogrammetry.readings import (
    AWAY,
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
    "AWAY",
    "KEY",
    "UNREFERENCED",
    "Fault",
    "InPosition",
    "Position",
    "Reading",
    "Record",
    "Refused",
]
