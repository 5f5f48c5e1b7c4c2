"""Tests by model values of sqrt(q_vv), exact ones only where they leave doubt (Gruen 1980)."""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import numpy as np

from anaplot.adjustment.reliability import SPUR
from anaplot.aliases import Array, Bools

__all__ = ["MODEL_TOLERANCE", "ModelDecisions", "beyond_model", "decide_by_model_values"]

MODEL_TOLERANCE = 0.25
"""k_q of the paper: share by which an exact sqrt(q_vv) may differ from its model value."""


class ModelDecisions(NamedTuple):
    """Decisions on residuals by model values; every residual is of exactly one kind.

    Attributes
    ----------
    rejected, accepted
        Far above, and far below the critical size.
    untestable
        The model value is next to zero: nothing can be tested.
    doubtful
        Between, or without a model value: left to the exact cofactor.
    """

    rejected: Bools
    accepted: Bools
    untestable: Bools
    doubtful: Bools


def decide_by_model_values(
    size: Array, root: Array, critical: float, tolerance: float
) -> ModelDecisions:
    """Decide by model values where they leave no doubt (eq. 9 to 11).

    Rejected above c (1 + k) sqrt(q), accepted below c (1 - k) sqrt(q), doubtful between.

    Parameters
    ----------
    size
        Absolute residuals in sigmas, of any shape.
    root
        Their model values of sqrt(q_vv); NaN where there is none.
    critical, tolerance
        c and k.
    """
    known = np.isfinite(root)
    untestable = known & (root <= sqrt(SPUR))
    known &= ~untestable
    limit = critical * np.where(known, root, 0.0)
    rejected = known & (size > limit * (1.0 + tolerance))
    accepted = known & (size < limit * (1.0 - tolerance))
    return ModelDecisions(rejected, accepted, untestable, ~rejected & ~accepted & ~untestable)


def beyond_model(r: Array, root: Array | float, tolerance: float) -> Bools:
    """Return where the exact sqrt(q_vv) is farther from its model value than the tolerance.

    Parameters
    ----------
    r
        (n,) exact redundancy numbers.
    root
        (n,) model values of sqrt(q_vv), or one of all; NaN where there is none.
    tolerance
        Share of the model value. Both count as zero below `SPUR`: they are next to nothing, and
        how far apart they are says nothing.
    """
    exact = np.sqrt(np.where(r >= SPUR, r, 0.0))
    model = np.where(np.greater(root, sqrt(SPUR)), root, 0.0)
    beyond: Bools = np.isfinite(root) & (np.abs(exact - model) > tolerance * model)
    return beyond
