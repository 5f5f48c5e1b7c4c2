"""Standardized residuals against the distribution that they have where nothing is wrong."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from anaplot.adjustment.reliability import SPUR
from anaplot.adjustment.testdistribution import TestDistribution, distribution_of
from anaplot.adjustment.tested import Tested
from anaplot.aliases import Array, Bools
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.drawing.charts.histogram import histogram
from anaplot.drawing.charts.quantileplot import quantile_plot, shown_ranks
from anaplot.drawing.drawing import Drawing
from anaplot.drawing.plot import Head
from anaplot.report.columns import counted

__all__ = ["histogram_of_w", "image_coordinates", "quantiles_of_w"]

_FEWEST = 8  # values: fewer are better read in the table
_BIN = 0.5
_WIDEST = 8.0  # values beyond stand in the last bins
_BAND = 0.95


class _Values(NamedTuple):
    """Standardized residuals.

    Attributes
    ----------
    w
        (n,) ascending.
    flagged
        (n,) which exceed the critical value.
    distribution
        What they have where nothing is wrong.
    symbol
        "w" or "tau".
    critical
        Of abs(w); None where there is none.
    """

    w: Array
    flagged: Bools
    distribution: TestDistribution
    symbol: str
    critical: float | None

    @property
    def remark(self) -> str:
        """How many there are, and how many are flagged."""
        said = counted(len(self.w), "value")
        if self.critical is None:
            return said
        flagged = int(self.flagged.sum())
        return f"{said}, {flagged} beyond the critical value {self.critical:.2f}"


def image_coordinates(block: AdjustedBlock) -> slice:
    """Return which of a block's tested observations are image coordinates."""
    return slice(0, block.observations.image)


def _values(tested: Tested[Any], of: slice) -> _Values | None:
    distribution = distribution_of(tested.test, tested.redundancy)
    w = tested.w[of]
    good = tested.use[of] & np.isfinite(w) & (tested.r[of] >= SPUR)  # of spurs w is rounding
    if distribution is None or good.sum() < _FEWEST:
        return None
    order = np.argsort(w[good], kind="stable")
    symbol = "w" if distribution.redundancy is None else "tau"
    flagged = tested.flagged[of][good][order]
    return _Values(w[good][order], flagged, distribution, symbol, tested.test.critical)


def histogram_of_w(
    tested: Tested[Any], of: slice = slice(None), *, key: str, what: str
) -> Drawing | None:
    """Return how often standardized residuals of a size occur, and how often they should.

    Parameters
    ----------
    tested
        Tested observations, of a block or of a model.
    of
        Which of them, as `image_coordinates` has it.
    key
        Of the drawing.
    what
        What they are, for people: "image coordinates".

    Returns
    -------
    Drawing or None
        None where there are fewer than eight, or no distribution (f < 2).
    """
    found = _values(tested, of)
    if found is None:
        return None
    w, distribution = found.w, found.distribution
    size = min(float(np.abs(w).max()), _WIDEST)
    size = max(size, 1.2 * (found.critical or 0.0))
    bins = int(np.ceil(size / _BIN))
    edges = _BIN * np.arange(-bins, bins + 1, dtype=np.float64)
    beyond = int(np.count_nonzero(np.abs(w) > edges[-1]))
    counts, _ = np.histogram(np.clip(w, edges[0], edges[-1]), edges)
    x = np.linspace(edges[0], edges[-1], 24 * bins + 1)
    expected = len(w) * (distribution.below(x + _BIN / 2) - distribution.below(x - _BIN / 2))
    title = f"Standardized residuals of {what}"
    outer = w[int(np.argmax(np.abs(w)))]
    notes = (f"Beyond ±{edges[-1]:g}, in the last bars: {counted(beyond, 'value')}.",)
    bounds = () if found.critical is None else (-found.critical, found.critical)
    deviation = float(np.std(w))
    return histogram(
        Head(key, title, f"{found.remark}."),
        counts,
        edges,
        f"Histogram of {found.symbol} of {what}: {found.remark}. Their standard deviation is "
        f"{deviation:.2f}, the value farthest out {outer:.2f}. Compared with the "
        f"{distribution.name}.",
        x_title=found.symbol,
        what=what,
        curve=np.stack((x, expected), axis=1),
        curve_label=distribution.name,
        bounds=bounds,
        bounds_label=f"critical value, alpha {tested.test.alpha:g}",
        notes=notes if beyond else (),
    )


def quantiles_of_w(
    tested: Tested[Any], of: slice = slice(None), *, key: str, what: str
) -> Drawing | None:
    """Return the ordered standardized residuals against the quantiles of their distribution.

    The band holds 95 of 100 values at each place if they were independent; the k-th of n is then
    distributed as the quantile of a beta distribution of k and n - k + 1.

    Parameters and result as `histogram_of_w`.
    """
    from scipy.special import betaincinv

    found = _values(tested, of)
    if found is None:
        return None
    n, distribution = len(found.w), found.distribution
    crossed = found.flagged
    ranks = shown_ranks(n)
    k = ranks.astype(np.float64) + 1.0
    expected = distribution.quantiles((k - 0.5) / n)
    tail = (1.0 - _BAND) / 2.0
    low, high = (
        distribution.quantiles(np.asarray(betaincinv(k, n - k + 1.0, p), dtype=np.float64))
        for p in (tail, 1.0 - tail)
    )
    w = found.w[ranks]
    outside = float(np.mean((w < low) | (w > high)))
    title = f"Quantiles of {found.symbol} of {what}"
    note = f"{len(ranks)} of {n} values are drawn, all of them at both ends."
    return quantile_plot(
        Head(key, title, f"{found.remark}."),
        expected,
        w,
        f"Ordered {found.symbol} of {what} against the {distribution.name}: {found.remark}. "
        f"{100.0 * outside:.0f} percent of the dots lie outside the band; the smallest value is "
        f"{found.w[0]:.2f}, the largest {found.w[-1]:.2f}.",
        x_title=f"quantile of the {distribution.name}",
        y_title=found.symbol,
        band=(low, high),
        band_label="95 of 100 independent samples",
        marked=crossed[ranks],
        marked_label="flagged",
        what=what,
        notes=(note,) if len(ranks) < n else (),
    )
