"""The variance factors of epochs by themselves: too large, or different."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from scipy.special import fdtr, fdtrc

from anaplot.adjustment.hypothesis import f_test
from anaplot.bundle.hypotheses.verdict import VarianceFactor

__all__ = ["VarianceRatio", "doubtful_epochs", "variance_ratio"]


class VarianceRatio(NamedTuple):
    """Whether both epochs have the same variance factor.

    Attributes
    ----------
    ratio
        First over second.
    redundancies
        Of both.
    significance
        Two-sided probability of a ratio as far from one.
    """

    ratio: float
    redundancies: tuple[int, int]
    significance: float


def variance_ratio(first: tuple[float, int], second: tuple[float, int]) -> VarianceRatio | None:
    """Compare (v'Pv, redundancy) of two epochs.

    None without redundancy in one, or where its residuals are rounding.
    """
    if any(VarianceFactor(*each, by_known=False).sigma is None for each in (first, second)):
        return None
    (a, f), (b, g) = first, second
    ratio = (a / f) / (b / g)
    upper = float(fdtrc(f, g, ratio))
    lower = float(fdtr(f, g, ratio))
    return VarianceRatio(ratio, (f, g), min(1.0, 2.0 * min(upper, lower)))


def doubtful_epochs(
    alone: Sequence[tuple[float, int]], alpha: float, *, without: bool
) -> list[str]:
    """Name the epochs whose sigma0 by itself is too large for its a-priori value.

    Parameters
    ----------
    alone
        (v'Pv, redundancy) of each.
    alpha
        Significance.
    without
        Whether the joint adjustment has additional parameters that these have not.
    """
    by_itself = " (by itself, without additional parameters)" if without else ""
    out = []
    for number, (vtpv, redundancy) in enumerate(alone, start=1):
        if redundancy < 1:
            continue
        test = f_test(vtpv, redundancy, alpha=alpha)
        if test.rejected:
            out.append(
                f"epoch {number}: its global test is rejected{by_itself}: sigma0^2 "
                f"{test.statistic:.3f} against {test.critical:.3f} (alpha {alpha:g})"
            )
    return out
