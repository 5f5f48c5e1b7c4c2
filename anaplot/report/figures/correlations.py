"""The matrix of correlations of additional parameters."""

from __future__ import annotations

import numpy as np

from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.parametercorrelations import parameter_matrix as correlated_parameters
from anaplot.drawing.charts.matrix import LARGEST, correlation_matrix
from anaplot.drawing.drawing import Drawing
from anaplot.drawing.plot import Head
from anaplot.drawing.ticks import written
from anaplot.report.columns import counted

__all__ = ["parameter_matrix"]


def parameter_matrix(block: AdjustedBlock) -> Drawing | None:
    """Return the correlations of a block's additional parameters.

    None where there are fewer than two that belong to several photos: those of each photo have a
    matrix of their own each.
    """
    found = correlated_parameters(block)
    if found is None or len(found[0]) < 2:
        return None
    owned, rho = found
    several = len({owner for owner, _ in owned}) > 1
    names = [f"{unknown} of {owner}" if several else unknown for owner, unknown in owned]
    title = "Correlations of the additional parameters"
    n = len(names)
    notes: tuple[str, ...] = ()
    size = np.tril(np.abs(np.nan_to_num(rho)), -1)
    if n > LARGEST:
        # those that are correlated most stay
        kept = np.sort(np.argsort(-np.maximum(size.max(axis=0), size.max(axis=1)))[:LARGEST])
        names, rho = [names[k] for k in kept.tolist()], rho[np.ix_(kept, kept)]
        size = np.tril(np.abs(np.nan_to_num(rho)), -1)
        notes = (f"{LARGEST} of {n} rows are drawn: those that are correlated most.",)
    i, j = (int(k) for k in np.unravel_index(int(np.argmax(size)), size.shape))
    largest = written(float(rho[i, j]), 3)
    said = (
        f"{counted(n, 'parameter')}; largest correlation {largest}, of {names[i]} with {names[j]}"
    )
    large = int(np.count_nonzero(size >= 0.9))
    remark = f"{said}; {large} of 0.9 and more."
    return correlation_matrix(
        Head("parameters", title, remark),
        names,
        rho,
        f"{title}: {remark}",
        notes=notes,
    )
