"""Modified data snooping (Gruen 1980): model values of sqrt(q_vv), exact ones only in doubt.

A residual far above or far below its critical size needs no exact cofactor: a value typical of its
class, known to a tolerance k_q, decides; only what lies between needs its exact one. What the exact
test decides otherwise is counted, not hidden: the paper's tolerance of 25 % does not cover every
observation.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from anaplot.adjustment.modelvalues import MODEL_TOLERANCE, decide_by_model_values
from anaplot.aliases import Array, Axis, Bools, Index
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.factor import Factor
from anaplot.bundle.solve.normal import NormalEquations
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.solve.reliability import cofactor_column
from anaplot.bundle.solve.residuals import BlockResiduals

__all__ = [
    "ObservationClass",
    "Snooping",
    "class_roots",
    "classify",
    "estimate_models",
    "model_values",
    "snoop",
]

_SAMPLES = 8  # exact values of each class from which its model value is estimated


class ObservationClass(NamedTuple):
    """What the size of sqrt(q_vv) mainly depends on (1980, section 3).

    Attributes
    ----------
    rays
        Photos in which the point is measured: 1, 2, 3, or 4 for four and more.
    inner
        Whether the ray is measured in more than one model.
    control
        Whether the point is control.
    axis
        "x" or "y".
    """

    rays: int
    inner: bool
    control: bool
    axis: Axis


@dataclass(frozen=True, slots=True, eq=False)
class Snooping:
    """The outcome of the modified test.

    Attributes
    ----------
    rejected
        (m, 2) what it rejects.
    computed
        (m, 2) which cofactors it had to compute exactly.
    untestable
        (m, 2) what cannot be tested, by a model value of next to zero.
    """

    rejected: Bools
    computed: Bools
    untestable: Bools


def classify(problem: Problem) -> dict[ObservationClass, tuple[Index, int]]:
    """Return the rays of every class, and its axis (0, 1)."""
    pair = problem.point * len(problem.photos) + problem.photo
    _, of_pair, times = np.unique(pair, return_inverse=True, return_counts=True)
    inner = times[of_pair] > 1
    seen = np.unique(pair) // len(problem.photos)
    photos = np.bincount(seen, minlength=len(problem.points))[problem.point]
    rays = np.minimum(photos, 4)
    control = np.asarray(problem.controlled.any(axis=1))[problem.point]
    key = rays * 4 + inner * 2 + control
    out: dict[ObservationClass, tuple[Index, int]] = {}
    for value in np.unique(key).tolist():
        for axis in (0, 1):
            mine = key == value
            if problem.rejected is not None:
                mine &= ~problem.rejected[:, axis]
            index = np.nonzero(mine)[0]
            if not len(index):
                continue
            name: Axis = "y" if axis else "x"
            kind = ObservationClass(value // 4, bool(value & 2), bool(value & 1), name)
            out[kind] = index, axis
    return out


def estimate_models(normal: NormalEquations, factor: Factor) -> dict[ObservationClass, float]:
    """Estimate the model value of every class of any block: the mean of a few exact ones.

    Parameters
    ----------
    normal, factor
        Normal equations without damping, and their factor.
    """
    rng = np.random.default_rng(0)
    out: dict[ObservationClass, float] = {}
    for kind, (rays, axis) in classify(normal.problem).items():
        chosen = rays if len(rays) <= _SAMPLES else rng.choice(rays, _SAMPLES, replace=False)
        roots = []
        for ray in np.sort(chosen).tolist():
            value = float(cofactor_column(normal, factor, ray, axis)[ray, axis])
            roots.append(max(value, 0.0) ** 0.5)
        out[kind] = float(np.mean(roots))
    return out


def class_roots(problem: Problem, models: Mapping[ObservationClass, float]) -> Array:
    """Return (m, 2) model values of all image coordinates; NaN for classes without one."""
    out = np.full((len(problem.photo), 2), np.nan)
    for kind, (rays, axis) in classify(problem).items():
        out[rays, axis] = models.get(kind, np.nan)
    return out


def snoop(
    block: AdjustedBlock,
    models: Mapping[ObservationClass, float],
    tolerance: float = MODEL_TOLERANCE,
) -> Snooping:
    """Test every image coordinate by model values, by its exact cofactor where they leave doubt.

    Parameters
    ----------
    block
        The adjusted block; it has a critical value.
    models
        Model values; a class without one is decided exactly.
    tolerance
        k_q, a share.
    """
    assert block.critical is not None
    assert block.sigma is not None
    by = decide_by_model_values(
        np.abs(block.v),
        class_roots(block.problem, models),
        block.critical * block.sigma,
        tolerance,
    )
    counts = ~block.rejected
    computed = counts & by.doubtful
    rejected = (counts & by.rejected) | (computed & block.flagged)
    return Snooping(rejected, computed, counts & by.untestable)


def model_values(system: BlockResiduals) -> Array:
    """Return (n,) model values of sqrt(q_vv) for modified snooping, by classes of 1980.

    Estimated from a few exact ones of every class; NaN for control and priors, which have none.
    """
    out = np.full(len(system.names), np.nan)
    models = estimate_models(system.cofactors.normal, system.cofactors.factor)
    out[: system.rows.image] = class_roots(system.problem, models).ravel()
    return out
