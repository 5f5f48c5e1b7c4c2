"""A model from the side of its residuals, also with rows that its orientation leaves out."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from anaplot.adjustment.residualsystem import DenseResiduals
from anaplot.orientation.pair import Stereopair
from anaplot.orientation.results import ModelSolution
from anaplot.orientation.solver import Conditions, State
from anaplot.photogrammetry.block import Precision
from anaplot.photogrammetry.rotation import rotation_matrix

__all__ = ["ModelResiduals", "residual_system", "residuals_at"]

Array = NDArray[np.float64]
Key = tuple[str, str]


@dataclass(frozen=True, slots=True, eq=False)
class ModelResiduals:
    """Rows of a model, linearised at an orientation.

    Attributes
    ----------
    keys
        n rows (point, axis).
    system
        Their residual system.
    unit_um
        (n,) a-priori standard deviation of each row [um].
    """

    keys: tuple[Key, ...]
    system: DenseResiduals = field(repr=False)
    unit_um: Array = field(repr=False)


def residual_system(solution: ModelSolution) -> DenseResiduals:
    """See an oriented model, with the rows that it has, from the side of its residuals."""
    root = np.sqrt(solution.q_l)
    parallax = np.array([row.parx_um for row in solution.table])
    e = parallax / (solution.apriori_um * root)
    return DenseResiduals(
        tuple(row.key for row in solution.table),
        e,
        np.array([row.redn for row in solution.table]),
        float(e @ e),
        solution.redundancy,
        solution.q_vv / root[:, None] / root,
    )


def residuals_at(pair: Stereopair, precision: Precision, solution: ModelSolution) -> ModelResiduals:
    """Linearise all rows of a pair at an orientation that was found without some of them.

    Parameters
    ----------
    pair
        The measurements; rows that are off are no rows.
    precision
        A-priori sigma0 and the tie variance.
    solution
        The orientation; of this pair, with the same or more rows off.

    Notes
    -----
    A tie that has no depth below the left projection centre has no x row here.
    """
    conditions = Conditions(pair, precision.tie_variance)
    bx, by, bz = solution.base
    state = State(bx, by / bx, bz / bx, rotation_matrix(*solution.rotation))
    with np.errstate(all="ignore"):
        rows = conditions.evaluate(state)
    points = pair.points
    keys = [(points[k], "y") for k in conditions.y_index]
    keys += [(points[k], "x") for k in conditions.x_index]
    usable = np.asarray(np.isfinite(rows).all(axis=0))
    rows = rows[:, usable]
    design = rows[conditions.unknown_rows()]
    design = design / np.linalg.norm(design, axis=1, keepdims=True)
    q, _ = np.linalg.qr(design.T)
    matrix = np.eye(rows.shape[1]) - q @ q.T
    e = matrix @ (rows[6] / (precision.image_um * 1e-3))
    kept = tuple(key for key, good in zip(keys, usable.tolist(), strict=True) if good)
    system = DenseResiduals(
        kept,
        e,
        np.maximum(np.diag(matrix), 0.0),
        float(e @ e),
        rows.shape[1] - len(design),
        matrix,
    )
    unit = precision.image_um * np.sqrt(conditions.cofactors(bx)[usable])
    return ModelResiduals(kept, system, unit)
