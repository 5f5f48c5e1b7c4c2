"""Whether the a-priori sigma agrees with the size of most residuals."""

from __future__ import annotations

from math import ceil, floor, log10
from typing import NamedTuple

import numpy as np
from scipy.special import ndtri

from anaplot.adjustment.findings import Findings
from anaplot.adjustment.partners import WEAK
from anaplot.adjustment.residualsystem import ResidualSystem
from anaplot.adjustment.significance import critical_normal
from anaplot.aliases import Array
from anaplot.errors import NotComputableError

__all__ = [
    "LARGEST",
    "LEAST_REDUNDANCY",
    "SMALLEST",
    "AprioriSigma",
    "ScaleError",
    "check_scale",
    "common_factor",
    "robust_scale",
    "scale_error",
]


LARGEST, SMALLEST = 5.0, 0.2
"""Robust scales beyond which the a-priori sigma is doubted."""

LEAST_REDUNDANCY = 6
"""Redundancy below which a few gross errors explain as much."""

_LEAST_OF_SMALL = 10  # redundancy below which residuals are small by chance

_NO_NOISE = 1e-3  # scale of a simulation without noise

_ENOUGH = 50  # redundancy below which gross errors, spread over all residuals, look like noise

_UNLIKE = 1.2  # root mean square over robust scale, 1 of noise; in our tests 1.28 of gross errors


class AprioriSigma(NamedTuple):
    """An a-priori sigma that a person has given.

    Attributes
    ----------
    of
        What is weighted by it: "block demo".
    name, value, unit
        How it is called, and its value: "image_um", 5.0, "um".
    rows
        How many rows, the first ones, have it: what others measure says nothing of it. None: all.
    idle
        How many of these are switched off, and have no weight.
    """

    of: str
    name: str
    value: float
    unit: str
    rows: int | None = None
    idle: int = 0

    @classmethod
    def image_um(
        cls, of: str, value: float, rows: int | None = None, idle: int = 0
    ) -> AprioriSigma:
        """Return that of image coordinates."""
        return cls(of, "image_um", value, "um", rows, idle)


class ScaleError(NotComputableError):
    """The a-priori sigma is far from the size of the residuals: no test by it means anything.

    Attributes
    ----------
    doubt
        What is doubted, and which value fits.
    """

    def __init__(self, doubt: str) -> None:
        self.doubt = doubt
        super().__init__(f"{doubt}; --as-given cleans all the same")


def robust_scale(w: Array, r: Array, trimmed: float = 0.0) -> float | None:
    """Return the median of abs(w) as an estimate of sigma0, in a-priori sigmas.

    Parameters
    ----------
    w
        (n,) standardized residuals; NaN: no test.
    r
        (n,) redundancy numbers; rows below .01 say nothing of themselves.
    trimmed
        Share of the rows, those with the largest abs(w), that are missing from `w`.

    Returns
    -------
    float or None
        Median over the one that a normal distribution has (.6745 where nothing is missing); None
        without rows.
    """
    size = np.abs(w[np.isfinite(w) & (r > WEAK)])
    if not len(size):
        return None
    return float(np.median(size) / ndtri(0.5 + (1.0 - trimmed) / 4.0))


def common_factor(v: Array, r: Array) -> float | None:
    """Return the factor by which nearly all residuals contradict the a-priori sigma.

    A wrong sigma leaves the residuals as they are distributed: their root mean square and their
    robust scale agree. Gross errors, also those that the adjustment spreads, make the first larger.

    Parameters
    ----------
    v
        (n,) residuals in units of the a-priori sigma.
    r
        (n,) redundancy numbers.

    Returns
    -------
    float or None
        The root mean square; None where most residuals agree with the sigma (a factor of 0.2 to
        5), where they are unlike each other, and where they are too few to tell: a redundancy
        below 50, of residuals that are too small below 10.
    """
    good = r > WEAK
    redundancy = float(r[good].sum())
    if redundancy < _LEAST_OF_SMALL:
        return None
    factor = float(np.sqrt(v[good] @ v[good] / redundancy))
    scale = robust_scale(v[good] / np.sqrt(r[good]), r[good])
    if not scale:
        return None
    large = min(scale, factor) > LARGEST and redundancy >= _ENOUGH
    # the median of few is off by chance
    alike = factor <= max(_UNLIKE, 1.0 + 2.0 / redundancy**0.5) * scale
    return factor if alike and (large or max(scale, factor) < SMALLEST) else None


def check_scale(
    system: ResidualSystem, found: Findings | None, alpha: float, apriori: AprioriSigma
) -> None:
    """Raise where most residuals contradict the a-priori sigma.

    Parameters
    ----------
    system
        All rows.
    found
        What a strategy found: the rows that it leaves may not be too large. None: before any, when
        all rows may not be too small; too large they are also by a single error.
    alpha
        Significance of one row.
    apriori
        What is doubted.

    Raises
    ------
    ScaleError
        The scale is above 5 (where its rows have a redundancy of 6 or more) or below 0.2 (10 or
        more); not where there is no noise at all.
    """
    # what is not solved with all rows yet is so only to complain
    if found is not None and _scale_left(found, apriori) <= LARGEST:
        return
    r = np.asarray(system.r, dtype=float)
    redundancy: float = system.redundancy
    if apriori.rows is not None:
        redundancy = min(redundancy, float(r[: apriori.rows].sum()))
    if redundancy < LEAST_REDUNDANCY:
        return
    w = np.full(len(r), np.nan)
    good = r > WEAK
    if apriori.rows is not None:
        good[apriori.rows :] = False
    w[good] = np.asarray(system.e, dtype=float)[good] / np.sqrt(r[good])
    if found is not None:
        scale = _scale_left(found, apriori)
        raise scale_error(apriori, scale, float(np.nanmax(np.abs(w))) / critical_normal(alpha))
    one = robust_scale(w, r)
    if one is not None and redundancy >= _LEAST_OF_SMALL and _NO_NOISE < one < SMALLEST:
        raise scale_error(apriori, one, one)


def _scale_left(found: Findings, apriori: AprioriSigma) -> float:
    """Return the scale of what a strategy leaves; 0 without rows."""
    kept, r = found.at_end.w.copy(), found.at_end.r
    kept[list(found.rows)] = np.nan
    gone, good = len(found.rows), r > WEAK
    if apriori.rows is not None:
        kept[apriori.rows :], good[apriori.rows :] = np.nan, False
        gone = sum(row < apriori.rows for row in found.rows)
    share = gone / max(int(good.sum()), 1)
    return robust_scale(kept, r, min(share, 0.9)) or 0.0


def scale_error(apriori: AprioriSigma, scale: float, fits: float) -> ScaleError:
    """Return the error about an a-priori sigma.

    Parameters
    ----------
    apriori
        What is doubted.
    scale
        Of the residuals, in units of it.
    fits
        The factor with which nothing is flagged.
    """
    times = f"{scale:.0f}" if scale >= 100.0 else f"{scale:.2g}"
    return ScaleError(
        f"{apriori.of}: most residuals are {times} times what their standard deviations say: "
        f"is {apriori.name} = {apriori.value:g} right? With {_up(fits * apriori.value)} "
        f"{apriori.unit} nothing is flagged"
    )


def _up(value: float) -> str:
    """Return a value with two digits, rounded up."""
    unit = 10.0 ** (floor(log10(value)) - 1)
    return f"{ceil(value / unit) * unit:g}"
