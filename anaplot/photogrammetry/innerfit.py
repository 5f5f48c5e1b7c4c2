"""What every way to fit a plate's fiducials returns, and how it refuses."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from anaplot.adjustment.leastsquares import CombinedAdjustment
from anaplot.aliases import Array
from anaplot.photogrammetry.innercofactors import InnerCofactors
from anaplot.photogrammetry.innerresults import DistanceRow
from anaplot.photogrammetry.platetransformation import PlateTransformation

__all__ = ["STEPS", "FittedPlate", "InnerFit", "in_brackets", "no_end", "rows3", "rows4"]


STEPS = 30
"""Iterations of an adjustment before it is given up."""


class FittedPlate(NamedTuple):
    """The adjusted plate coordinates [mm in the image], the first n of an adjustment.

    Attributes
    ----------
    w
        (n,) what was added to them.
    q_l
        (n,) their a-priori cofactors.
    q_vv
        (n, n) cofactors of `w`.
    r
        (n,) redundancy numbers.
    vtpv
        Weighted sum of squares of the whole adjustment.
    redundancy
        Of the whole adjustment.
    """

    w: Array
    q_l: Array
    q_vv: Array
    r: Array
    vtpv: float
    redundancy: int

    @classmethod
    def of(
        cls, solved: CombinedAdjustment, cofactors: Array, n: int, reach: float = 1.0
    ) -> FittedPlate:
        """Return the first n observations of an adjustment in units of `reach` mm."""
        whole = solved.conditions
        return cls(
            solved.v[:n] * reach,
            cofactors[:n],
            solved.q_vv[:n, :n],
            np.maximum(solved.r[:n], 0.0),
            whole.vtpv * reach**2,
            whole.redundancy,
        )


class InnerFit(NamedTuple):
    """A fitted transformation.

    Attributes
    ----------
    transformation
        Plate to image.
    adjustment
        Of the 2 n plate coordinates.
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
    adjustment: FittedPlate
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
