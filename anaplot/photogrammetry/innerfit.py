"""What every way to fit a plate's fiducials returns, and how it refuses."""

from __future__ import annotations

from typing import NamedTuple

from anaplot.adjustment.leastsquares import Adjustment
from anaplot.aliases import Array
from anaplot.photogrammetry.innercofactors import InnerCofactors
from anaplot.photogrammetry.innerresults import DistanceRow
from anaplot.photogrammetry.platetransformation import PlateTransformation

__all__ = ["STEPS", "InnerFit", "in_brackets", "no_end", "rows3", "rows4"]


STEPS = 30
"""Iterations of an adjustment before it is given up."""


class InnerFit(NamedTuple):
    """A fitted transformation.

    Attributes
    ----------
    transformation
        Plate to image.
    adjustment
        The adjustment of the 2 n plate coordinates [mm in the image].
    iterations
        Count.
    remarks
        Sentences on how it came about.
    distances
        Differences of calibrated distances.
    exchanged
        Two fiducials that seem to be exchanged, or None.
    cofactors
        Of the transformation; None where distances determine it.
    """

    transformation: PlateTransformation
    adjustment: Adjustment
    iterations: int
    remarks: tuple[str, ...]
    distances: tuple[DistanceRow, ...] = ()
    exchanged: tuple[str, str] | None = None
    cofactors: InnerCofactors | None = None


def in_brackets(names: tuple[str, ...]) -> str:
    """Return " (a, b, c)", nothing for no names."""
    return f" ({', '.join(names)})" if names else ""


def no_end(kind: str, names: tuple[str, ...]) -> str:
    """Return the message about an adjustment that does not converge."""
    return (
        f"the {kind} transformation of fiducials {', '.join(names)} does not converge: "
        "one of them, or their order, is grossly wrong"
    )


def rows3(a: Array) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Return a (2, 3) array as tuples."""
    (a0, a1, a2), (b0, b1, b2) = a.tolist()
    return (a0, a1, a2), (b0, b1, b2)


def rows4(
    a: Array,
) -> tuple[tuple[float, float, float, float], tuple[float, float, float, float]]:
    """Return a (2, 4) array as tuples."""
    (a0, a1, a2, a3), (b0, b1, b2, b3) = a.tolist()
    return (a0, a1, a2, a3), (b0, b1, b2, b3)
