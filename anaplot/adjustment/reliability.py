"""Correlations of residuals and critical transfers, from the cofactors of the residuals."""

from __future__ import annotations

import numpy as np

from anaplot.adjustment.significance import TESTABLE
from anaplot.aliases import Array

__all__ = [
    "ERROR_PRIOR_SIGMAS",
    "HARD_TO_TELL",
    "NONE_PRIOR",
    "SPUR",
    "critical_transfers",
    "residual_correlations",
]


ERROR_PRIOR_SIGMAS = 20.0
"""Prior of a gross error: normal, this many standard deviations of the observation wide."""

HARD_TO_TELL = 0.9
"""Residual correlation from which two rows are named as hard to tell apart."""

SPUR = 1e-4
"""Redundancy number below which no error of a size that occurs can be seen."""

NONE_PRIOR = 0.9
"""Prior probability that there is no gross error at all."""


def residual_correlations(q_vv: Array, r: Array) -> Array:
    """Return (n, n) rho_ij = q_ij / sqrt(q_ii q_jj); NaN in rows that cannot be tested."""
    diagonal = np.einsum("ii->i", q_vv)
    root = np.sqrt(np.where((r >= TESTABLE) & (diagonal > 0.0), diagonal, np.nan))
    out: Array = np.clip(q_vv / root[:, None] / root, -1.0, 1.0)
    return out


def critical_transfers(influence: Array) -> list[tuple[int, int, float]]:
    """Return (i, j, (Q_vv P)_ji) wherever an error in i shows at least as large in j.

    Column i of `influence`, (n, n) Q_vv P, is what a unit error in row i does to every residual:
    abs((Q_vv P)_ji) >= (Q_vv P)_ii - 1e-9 (Kratky and El-Hakim 1983, heavy arrows of Figure 2).
    Rows that cannot be tested are sources of nothing that could be compared and are left out.
    """
    own = np.einsum("ii->i", influence)
    critical = (np.abs(influence) >= own - 1e-9) & (own >= TESTABLE)
    np.einsum("ii->i", critical)[:] = False
    targets, sources = np.nonzero(critical)
    found = [
        (int(i), int(j), float(influence[j, i])) for j, i in zip(targets, sources, strict=True)
    ]
    return sorted(found)
