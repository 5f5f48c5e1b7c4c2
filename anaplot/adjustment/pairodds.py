"""Odds over no, one and two gross errors."""

from __future__ import annotations

from collections.abc import Collection
from math import log

import numpy as np

from anaplot.adjustment.findings import PairOdds
from anaplot.adjustment.leftout import ReducedSystem, remaining, spread
from anaplot.adjustment.reliability import ERROR_PRIOR_SIGMAS, NONE_PRIOR
from anaplot.adjustment.residualsystem import ResidualSystem
from anaplot.adjustment.stepwise import NO_SIGMA
from anaplot.adjustment.tested import sigma0_known
from anaplot.aliases import Array, Index, TestKind

__all__ = ["MOST_ROWS_OF_PAIRS", "pair_odds", "pair_odds_of"]


MOST_ROWS_OF_PAIRS = 3000
"""Largest number of rows whose pairs are weighed."""

_MOST_PAIRS = 20  # that are returned


def pair_odds(
    system: ResidualSystem,
    *,
    kind: TestKind = "baarda",
    left_out: Collection[int] = (),
) -> PairOdds:
    """Weigh no, one and two gross errors against each other.

    Parameters
    ----------
    system
        All rows, at most `MOST_ROWS_OF_PAIRS`.
    kind
        "baarda": sigma known; "tau": sigma estimated, see `sigma_of`.
    left_out
        Rows that are out for good: not weighed.

    Notes
    -----
    Errors are normal, 20 standard deviations wide, independent of each other. Prior: none 0.9, and
    each further error a tenth as probable as the number before it: one 0.9 * 0.1 and two
    0.9 * 0.01, each shared equally by all rows or pairs, before all is divided by the sum. With
    R2 = R[(i, j), (i, j)], g = 400 and q = e2' (R2 + I / g)^-1 e2, sigma known:
    log BF = -log det(I + g R2) / 2 + q / 2.

    Sigma unknown, its prior 1 / sigma and the errors 20 of the true standard deviations wide: the
    residuals of f redundancies have the density sigma^-f det^-1/2 exp(-(v'Pv - q) / 2 sigma^2),
    which integrated over sigma gives
    log BF = -log det(I + g R2) / 2 - f / 2 log(1 - q / v'Pv).
    For one row these are the factors of `error_odds`.

    Raises
    ------
    ValueError
        Too many rows.
    NotSeparableError
        The other rows do not check one that is left out.
    """
    every = len(system.e)
    if every > MOST_ROWS_OF_PAIRS:
        raise ValueError(f"odds over pairs of {every} rows: at most {MOST_ROWS_OF_PAIRS}")
    rest = ReducedSystem(system, left_out) if left_out else system
    return pair_odds_of(rest, remaining(every, left_out), kind)


def _log_factors(
    system: ResidualSystem, determinant: Array, square: Array, kind: TestKind
) -> Array:
    """Return log BF from det(I + g R) and q of sets of rows; zero where sigma does not exist."""
    if sigma0_known(kind):
        return -0.5 * np.log(determinant) + 0.5 * square
    f, vtpv = system.redundancy, system.vtpv
    if f < 1 or vtpv <= f * NO_SIGMA**2:
        return np.zeros(len(square))
    # q cannot come nearer to v'Pv than this but for rounding
    share = np.minimum(square / vtpv, 1.0 - 1.0 / (1.0 + ERROR_PRIOR_SIGMAS**2))
    return -0.5 * np.log(determinant) - 0.5 * f * np.log1p(-share)


def pair_odds_of(system: ResidualSystem, rows: Index, kind: TestKind) -> PairOdds:
    """As `pair_odds`, over some rows of a system."""
    e, r = np.asarray(system.e, dtype=float)[rows], np.asarray(system.r, dtype=float)[rows]
    every, n = len(system.e), len(rows)
    g = ERROR_PRIOR_SIGMAS**2
    further = 1.0 - NONE_PRIOR
    own = r + 1.0 / g
    single = _log_factors(system, g * own, e**2 / own, kind) + log(further / max(n, 1))
    a, b = np.triu_indices(n, 1)
    logs = np.zeros(0)
    if n > 1:
        matrix = system.columns(rows)[rows]
        c = matrix[a, b]
        determinant = np.maximum(own[a] * own[b] - c * c, 1e-300)
        square = (e[a] ** 2 * own[b] - 2.0 * e[a] * e[b] * c + e[b] ** 2 * own[a]) / determinant
        logs = _log_factors(system, g * g * determinant, square, kind)
        logs += log(further**2 / len(a))
    top = max(0.0, float(single.max(initial=0.0)), float(logs.max(initial=0.0)))
    none, one, two = np.exp(-top), np.exp(single - top), np.exp(logs - top)
    total = float(none + one.sum() + two.sum())
    one, two = one / total, two / total
    best = np.argsort(-two, kind="stable")[:_MOST_PAIRS]
    marginal = one + np.bincount(a, two, n) + np.bincount(b, two, n)
    return PairOdds(
        float(none) / total,
        spread(one, rows, every),
        rows[a[best]],
        rows[b[best]],
        two[best],
        float(two.sum()),
        spread(marginal, rows, every),
    )
