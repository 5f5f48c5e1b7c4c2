"""A model from the side of its residuals, also with rows that its orientation leaves out."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from anaplot.adjustment.correlatedrows import correlated_units, residual_weight
from anaplot.adjustment.residualsystem import DenseResiduals
from anaplot.aliases import Array, RowKey
from anaplot.orientation.conditionequations import ConditionEquations, ModelUnknowns
from anaplot.orientation.pair import Stereopair
from anaplot.orientation.results import ModelSolution
from anaplot.orientation.tieerrors import misclosure_covariance
from anaplot.photogrammetry.block import Precision
from anaplot.photogrammetry.rotation import rotation_matrix

__all__ = ["ModelResiduals", "residual_system", "residuals_at"]


@dataclass(frozen=True, slots=True, eq=False)
class ModelResiduals(DenseResiduals):
    """Rows (point, axis) of a model, linearised at an orientation.

    Attributes
    ----------
    sigma
        (n,) a-priori standard deviation of each row [um]; of correlated rows, given the others.
    """

    names: tuple[RowKey, ...]
    sigma: Array = field(repr=False, kw_only=True)

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the rows."""
        return ("um",) * len(self.names)


def residual_system(solution: ModelSolution) -> ModelResiduals:
    """See an oriented model, with the rows that it has, from the side of its residuals.

    By the weights of its solution; under "exact" by the weight Sigma_F^-1, which makes the most
    of rows that are correlated: an error then shows nowhere larger than in its own row.
    """
    if solution.exact is not None:
        return _correlated(
            tuple(solution.tested.keys),
            solution.tested.residual / solution.apriori_um,
            solution.exact.weight,
            solution.redundancy,
            solution.exact.units,
            solution.apriori_um,
        )
    root = np.sqrt(solution.q_l)
    e = solution.tested.residual / (solution.apriori_um * root)
    return ModelResiduals(
        tuple(solution.tested.keys),
        e,
        solution.tested.r,
        float(e @ e),
        solution.redundancy,
        solution.q_vv / root[:, None] / root,
        sigma=solution.apriori_um * root,
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
    conditions = ConditionEquations(pair, precision.tie_variance)
    bx, by, bz = solution.base
    state = ModelUnknowns(bx, by / bx, bz / bx, rotation_matrix(*solution.rotation))
    with np.errstate(all="ignore"):
        rows = conditions.evaluate(state)
    points = pair.points
    keys = [(points[k], "y") for k in conditions.y_index]
    keys += [(points[k], "x") for k in conditions.x_index]
    usable = np.asarray(np.isfinite(rows).all(axis=0))
    rows = rows[:, usable]
    kept = tuple(key for key, good in zip(keys, usable.tolist(), strict=True) if good)
    design = rows[conditions.unknown_rows()]
    root = np.sqrt(conditions.cofactors(bx)[usable])
    if precision.tie_variance == "exact":
        sigma = misclosure_covariance(pair, conditions, state)[np.ix_(usable, usable)]
        unit = correlated_units(sigma)
        return _correlated(
            kept,
            rows[6] * root / (precision.image_um * 1e-3),
            residual_weight(sigma, (design * root).T),
            rows.shape[1] - len(design),
            unit,
            precision.image_um,
        )
    # unknowns in mm and rad alike: the chain of sets of many rows goes by the last digits
    design = design / np.linalg.norm(design, axis=1, keepdims=True)
    q, _ = np.linalg.qr(design.T)
    matrix = np.eye(rows.shape[1]) - q @ q.T
    e = matrix @ (rows[6] / (precision.image_um * 1e-3))
    return ModelResiduals(
        kept,
        e,
        np.maximum(np.diag(matrix), 0.0),
        float(e @ e),
        rows.shape[1] - len(design),
        matrix,
        sigma=precision.image_um * root,
    )


def _correlated(
    keys: tuple[RowKey, ...],
    misclosures: Array,
    weight: Array,
    redundancy: int,
    unit: Array,
    sigma0_um: float,
) -> ModelResiduals:
    """Return the residual system of rows with W = Sigma^-1 - Sigma^-1 B N^-1 B' Sigma^-1.

    Parameters
    ----------
    keys
        n rows.
    misclosures
        (n,) at any unknowns, in units of sigma0.
    weight
        (n, n) W in these units.
    redundancy
        Its rank.
    unit
        (n,) unit of each row, in units of sigma0.
    sigma0_um
        sigma0 [um].
    """
    left = weight @ misclosures
    matrix = weight * (unit[:, None] * unit)
    return ModelResiduals(
        keys,
        left * unit,
        np.maximum(np.diag(matrix), 0.0),
        max(float(misclosures @ left), 0.0),  # by rounding, where nothing is left
        redundancy,
        matrix,
        sigma=sigma0_um * unit,
    )
