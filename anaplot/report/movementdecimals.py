"""With how many decimals movements are shown: those of an object of a decimetre are micrometres."""

from __future__ import annotations

from math import floor, log10

import numpy as np

from anaplot.bundle.epochs.series import EpochDifferences, EpochSeries
from anaplot.bundle.hypotheses.verdict import VarianceFactor

__all__ = ["movement_decimals"]

_LEAST, _MOST = 2, 6


def movement_decimals(of: EpochDifferences | EpochSeries) -> int:
    """Return the decimals of a displacement in mm in a table: two digits of its deviation at least.

    A sentence has one less.
    """
    sigma = VarianceFactor(of.vtpv, of.redundancy, of.by_known).used or 1.0
    s = 1e3 * sigma * np.sqrt(np.diag(of.cofactors).clip(0.0))
    s = s[s > 0.0]
    if not len(s):
        return _LEAST
    return min(max(1 - floor(log10(float(np.median(s)))), _LEAST), _MOST)
