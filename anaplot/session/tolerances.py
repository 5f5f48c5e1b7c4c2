"""How far pointings at one place may differ before something is wrong."""

from __future__ import annotations

from math import sqrt

__all__ = ["tolerance_of_check_mm", "tolerance_of_offsets_mm"]

_SIGMAS = 5.0
"""Standard deviations of a difference that are believed."""


def tolerance_of_check_mm(image_um: float) -> float:
    """Return by how much a coordinate may differ from the one on record [mm].

    Parameters
    ----------
    image_um
        Standard deviation of a pointing [um]; the difference is one of two.
    """
    return _believed_mm(2, image_um)


def tolerance_of_offsets_mm(image_um: float) -> float:
    """Return by how much two offsets of the counters may differ [mm].

    Parameters
    ----------
    image_um
        Standard deviation of a pointing [um]. An offset is made of two pointings (the former one
        and this one), a difference of offsets of four.
    """
    return _believed_mm(4, image_um)


def _believed_mm(pointings: int, image_um: float) -> float:
    return _SIGMAS * sqrt(pointings) * image_um / 1000.0
