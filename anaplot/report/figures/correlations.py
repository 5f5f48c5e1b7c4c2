"""Matrices of correlations: of orientations, of residuals, of additional parameters."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from anaplot.aliases import Array
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.parametercorrelations import parameter_matrix as correlated_parameters
from anaplot.drawing.charts.matrix import LARGEST, correlation_matrix
from anaplot.drawing.drawing import Drawing
from anaplot.drawing.plot import Head
from anaplot.drawing.ticks import written
from anaplot.orientation.accuracy import model_accuracy
from anaplot.orientation.results import ModelSolution
from anaplot.report.columns import counted

__all__ = ["orientation_matrix", "parameter_matrix", "residual_matrix"]


def orientation_matrix(model: ModelSolution, *, key: str = "orientation") -> Drawing:
    """Return the correlations of the elements of a model's orientation."""
    accuracy = model_accuracy(model)
    title = f"Correlations of the orientation of model {model.name}"
    return _drawn(key, title, "element", accuracy.elements, accuracy.correlations)


def residual_matrix(model: ModelSolution, *, key: str = "residuals-correlated") -> Drawing | None:
    """Return the correlations of a model's residuals; None with fewer than two rows."""
    keys = model.tested.keys
    if len(keys) < 2:
        return None
    names = [f"{point} {axis}" for point, axis in keys]
    title = f"Correlations of the residuals of model {model.name}"
    return _drawn(key, title, "row", names, model.tested.correlations())


def parameter_matrix(block: AdjustedBlock, *, key: str = "parameters") -> Drawing | None:
    """Return the correlations of a block's additional parameters.

    None where there are fewer than two that belong to several photos: those of each photo have a
    matrix of their own each.
    """
    found = correlated_parameters(block)
    if found is None or len(found[0]) < 2:
        return None
    names, rho = found
    several = len({owner for owner, _ in names}) > 1
    labels = [f"{unknown} of {owner}" if several else unknown for owner, unknown in names]
    title = "Correlations of the additional parameters"
    return _drawn(key, title, "parameter", labels, rho)


def _drawn(key: str, title: str, one: str, names: Sequence[str], rho: Array) -> Drawing:
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
    said = f"{counted(n, one)}; largest correlation {largest}, of {names[i]} with {names[j]}"
    large = int(np.count_nonzero(size >= 0.9))
    remark = f"{said}; {large} of 0.9 and more."
    return correlation_matrix(
        Head(key, title, remark),
        names,
        rho,
        f"{title}: {remark}",
        notes=notes,
    )
