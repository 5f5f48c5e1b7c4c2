"""Truncated least squares by graduated non-convexity: a reference that the strategies are held to.

min sum min(v^2, c^2), approached through convex functions (Yang, Antonante, Tzoumas, Carlone 2020,
"Graduated non-convexity for robust spatial perception", eq. 12 to 15); what lies beyond c at the
end is rejected.
"""

from __future__ import annotations

import numpy as np

from anaplot.adjustment.residualsystem import ResidualSystem
from anaplot.adjustment.reweighting import weighted_misclosures
from anaplot.aliases import Array

__all__ = ["truncated_residuals"]


_STEP = 1.4  # factor of the control parameter
_MOST_ITERATIONS = 200


def truncated_residuals(system: ResidualSystem, critical: float) -> Array:
    """Return (n,) residuals of the truncated least squares, c the critical value.

    Parameters
    ----------
    system
        All rows.
    critical
        c [a-priori sigmas].
    """
    v = np.asarray(system.e, dtype=float)
    largest = float(np.square(v).max(initial=0.0))
    square = critical * critical
    if largest <= square:
        return v.copy()
    control = square / (2.0 * largest - square)
    for _ in range(_MOST_ITERATIONS):
        size = np.square(v)
        middle = np.sqrt(square * control * (control + 1.0) / np.maximum(size, 1e-300)) - control
        weights = np.where(size <= control / (control + 1.0) * square, 1.0, middle)
        weights[size >= (control + 1.0) / control * square] = 0.0
        v = weighted_misclosures(system, weights)
        if (np.minimum(weights, 1.0 - weights) < 1e-6).all():
            break
        control *= _STEP
    return v
