"""The reliability models that Gruen (1980) prints for regular 60/60 blocks."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from anaplot.aliases import Array, Axis
from anaplot.bundle.errors.snooping import ObservationClass
from anaplot.bundle.solve.adjusted import AdjustedBlock

__all__ = ["PaperModel", "paper_models", "regular_block"]

_AXES: tuple[Axis, Axis] = ("x", "y")
_BETWEEN = 15.0  # points a photo: the mean of nine and 25 by their ratio
_NEAR = 0.1  # bases: the paper's pairs of control stand closer together
# sqrt(q_vv) of control at a bridging distance of i bases: constant, factor of i
_CURVES = {
    (False, 3, False): (0.735, -0.018),
    (False, 5, False): (0.825, -0.013),
    (False, 3, True): (0.885, -0.004),
    (False, 5, True): (0.920, -0.002),
    (True, 3, False): (0.835, -0.015),
    (True, 5, False): (0.870, -0.008),
    (True, 3, True): (0.920, -0.010),
    (True, 5, True): (0.940, -0.007),
}


class PaperModel(NamedTuple):
    """Which of the paper's blocks.

    Attributes
    ----------
    side
        Points per photo, 3 x 3 or 5 x 5.
    twin
        Control in pairs.
    bridging
        Bases between control points, for the curves of control; None: their means in Table 2.
    """

    side: Literal[3, 5]
    twin: bool = False
    bridging: float | None = None


def paper_models(model: PaperModel) -> dict[ObservationClass, float]:
    """Return sqrt(q_vv) of the paper's classes; other classes have none.

    Parameters
    ----------
    model
        Which block: the values of Table 2 recommended for it, and of control the curves below
        Figure 8 where a bridging distance is given.
    """
    first, twin = model.side == 3, model.twin
    outer_2y = (0.41 if twin else 0.39) if first else 0.64 if twin else 0.63
    outer_3x = (0.36 if twin else 0.34) if first else 0.43 if twin else 0.42
    outer_3y = (0.52 if twin else 0.49) if first else 0.72 if twin else 0.71
    inner_3 = 0.81 if twin else 0.80
    outer_4 = (0.68 if twin else 0.65) if first else 0.78
    inner_4 = 0.88
    control_outer = 0.82 if twin else (0.68 if first else 0.78)
    control_inner = 0.92 if twin else 0.89
    if model.bridging is not None:
        control_outer = _on_curve(model, model.bridging, inner=False)
        control_inner = _on_curve(model, model.bridging, inner=True)
    values: dict[ObservationClass, float] = {
        ObservationClass(2, False, False, "x"): 0.0,
        ObservationClass(2, False, False, "y"): outer_2y,
        ObservationClass(3, False, False, "x"): outer_3x,
        ObservationClass(3, False, False, "y"): outer_3y,
    }
    for axis in _AXES:
        values[ObservationClass(3, True, False, axis)] = inner_3
        values[ObservationClass(4, False, False, axis)] = outer_4
        values[ObservationClass(4, True, False, axis)] = inner_4
        values[ObservationClass(4, False, True, axis)] = control_outer
        values[ObservationClass(4, True, True, axis)] = control_inner
    return values


def _on_curve(model: PaperModel, bridging: float, *, inner: bool) -> float:
    constant, factor = _CURVES[model.twin, model.side, inner]
    return max(constant + factor * bridging, 0.0)


def regular_block(block: AdjustedBlock) -> PaperModel:
    """Return which of the paper's blocks is most like one.

    Parameters
    ----------
    block
        The adjusted block: by the median number of points in a photo, and by how near to each
        other most of its full control stands.
    """
    problem = block.problem
    pairs = np.unique(np.column_stack([problem.photo, problem.point]), axis=0)
    points = float(np.median(np.bincount(pairs[:, 0], minlength=len(problem.photos))))
    full = block.state.points[problem.controlled.all(axis=1), :2]
    twin = False
    if len(full) > 1 and len(problem.photos) > 1:
        base = float(np.median(_nearest(block.state.centres[:, :2])))
        twin = bool(np.median(_nearest(full)) < _NEAR * base)
    return PaperModel(3 if points <= _BETWEEN else 5, twin)


def _nearest(places: Array) -> Array:
    """(n,) distance of each place to its nearest neighbour."""
    # scipy's trees take a good part of what reading a small block takes
    from scipy.spatial import KDTree

    distances, _ = KDTree(places).query(places, k=2)
    found: Array = np.asarray(distances)[:, 1]
    return found
