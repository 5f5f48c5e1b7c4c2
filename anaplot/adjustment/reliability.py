"""Correlations of residuals and transfers of errors, from the cofactors of the residuals."""

from __future__ import annotations

import numpy as np

from anaplot.adjustment.significance import TESTABLE
from anaplot.aliases import Array

__all__ = [
    "ERROR_PRIOR_SIGMAS",
    "HARD_TO_TELL",
    "NONE_PRIOR",
    "SERIOUS",
    "SPUR",
    "error_transfers",
    "is_critical",
    "residual_correlations",
]


_EQUAL = 1e-9  # between redundancy numbers

ERROR_PRIOR_SIGMAS = 20.0
"""Prior of a gross error: normal, this many standard deviations of the observation wide."""

HARD_TO_TELL = 0.9
"""Residual correlation from which two rows are named as hard to tell apart."""

SPUR = 1e-4
"""Redundancy number below which no error of a size that occurs can be seen."""

SERIOUS = 0.6
"""Share of what an error shows in its own row from which another row that shows it misleads."""

NONE_PRIOR = 0.9
"""Prior probability that there is no gross error at all."""


def residual_correlations(q_vv: Array, r: Array) -> Array:
    """Return (n, n) rho_ij = q_ij / sqrt(q_ii q_jj); NaN in rows that cannot be tested."""
    diagonal = q_vv.diagonal()
    root = np.sqrt(np.where((r >= TESTABLE) & (diagonal > 0.0), diagonal, np.nan))
    # `clip` costs as much as all the rest where rows are few
    out: Array = np.maximum(np.minimum(q_vv / root[:, None] / root, 1.0), -1.0)
    return out


def is_critical(value: float, own: float) -> bool:
    """Whether an error that shows with `own` in its row shows at least as large elsewhere."""
    return abs(value) >= own - _EQUAL


def error_transfers(influence: Array) -> list[tuple[int, int, float]]:
    """Return (i, j, (Q_vv P)_ji) wherever an error in i shows nearly as large, or larger, in j.

    Column i of `influence`, (n, n) Q_vv P, is what a unit error in row i does to every residual.
    Those with abs((Q_vv P)_ji) >= (Q_vv P)_ii - 1e-9 are critical, "misleading and worthless" to
    test by (Kratky and El-Hakim 1983, heavy arrows of Figure 2); those with `SERIOUS` of it "less
    critical, but still serious enough to be misleading" (dotted arrows).
    Rows that cannot be tested are sources of nothing that could be compared and are left out.
    """
    own = influence.diagonal()
    least = np.where(own >= TESTABLE, np.minimum(SERIOUS * own, own - _EQUAL), np.inf)
    targets, sources = np.nonzero(np.abs(influence) >= least)
    pairs = zip(sources.tolist(), targets.tolist(), strict=True)
    return sorted((i, j, float(influence[j, i])) for i, j in pairs if i != j)
