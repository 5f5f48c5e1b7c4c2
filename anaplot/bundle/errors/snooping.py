"""Modified data snooping (Gruen 1980): model values of sqrt(q_vv), exact ones only in doubt.

A residual far above or far below its critical size needs no exact cofactor: a value typical of its
class, known to a tolerance k_q, decides. Only what lies between is computed exactly, one
back-substitution each. Beside it stands the exact test, and what the two decide differently is
counted, not hidden: the paper's tolerance of 25 % does not cover every observation.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from anaplot.adjustment.reliability import SPUR, beyond_model
from anaplot.adjustment.significance import TESTABLE
from anaplot.adjustment.stepwise import MODEL_TOLERANCE
from anaplot.aliases import Array, Axis, Bools, Index
from anaplot.bundle.solve.factor import Factor
from anaplot.bundle.solve.normal import NormalEquations
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.solve.reliability import cofactor_column

__all__ = [
    "PAPER_TOLERANCE",
    "ClassModel",
    "ObservationClass",
    "Snooping",
    "classify",
    "estimate_models",
    "paper_models",
    "snoop",
]


PAPER_TOLERANCE = MODEL_TOLERANCE
"""k_q of the paper: share by which an exact sqrt(q_vv) may differ from its model value."""


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


class ClassModel(NamedTuple):
    """A model value: sqrt(q_vv) in units of the a-priori sigma, and its tolerance as a share."""

    root: float
    tolerance: float


@dataclass(frozen=True, slots=True, eq=False)
class Snooping:
    """The outcome of both tests.

    Attributes
    ----------
    rejected
        (m, 2) what the modified test rejects.
    computed
        (m, 2) which cofactors it had to compute exactly.
    untestable
        (m, 2) what cannot be tested in the modified test, by a model value of next to zero.
    exact
        (m, 2) what the exact test rejects; None when there was nothing to compare with.
    wrongly_accepted, wrongly_rejected
        Numbers of decisions that differ; None likewise.
    beyond_tolerance
        Number of exact sqrt(q_vv) that lie farther from their model value than the tolerance;
        None likewise.
    """

    rejected: Bools
    computed: Bools
    untestable: Bools
    exact: Bools | None
    wrongly_accepted: int | None
    wrongly_rejected: int | None
    beyond_tolerance: int | None


def classify(problem: Problem) -> dict[ObservationClass, tuple[Index, int]]:
    """Return the rays of every class, and the axis (0, 1) it speaks of."""
    pair = problem.point * len(problem.photos) + problem.photo
    _, of_pair, times = np.unique(pair, return_inverse=True, return_counts=True)
    inner = times[of_pair] > 1
    seen = np.unique(pair) // len(problem.photos)
    photos = np.bincount(seen, minlength=len(problem.points))[problem.point]
    rays = np.minimum(photos, 4)
    control = np.asarray(np.isfinite(problem.known).any(axis=1))[problem.point]
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


def paper_models(side: Literal[3, 5], *, twin: bool = False) -> dict[ObservationClass, ClassModel]:
    """Return the values of Table 2 recommended for regular 60/60 blocks.

    Parameters
    ----------
    side
        Points per photo, 3 x 3 or 5 x 5.
    twin
        Control in pairs.
    """
    first = side == 3
    outer_2y = (0.41 if twin else 0.39) if first else 0.64 if twin else 0.63
    outer_3x = (0.36 if twin else 0.34) if first else 0.43 if twin else 0.42
    outer_3y = (0.52 if twin else 0.49) if first else 0.72 if twin else 0.71
    inner_3 = 0.81 if twin else 0.80
    outer_4 = (0.68 if twin else 0.65) if first else 0.78
    inner_4 = 0.88
    control_outer = 0.82 if twin else (0.68 if first else 0.78)
    control_inner = 0.92 if twin else 0.89
    values: dict[ObservationClass, float] = {
        ObservationClass(2, False, False, "x"): 0.0,
        ObservationClass(2, False, False, "y"): outer_2y,
        ObservationClass(3, False, False, "x"): outer_3x,
        ObservationClass(3, False, False, "y"): outer_3y,
    }
    for axis in ("x", "y"):
        values[ObservationClass(3, True, False, axis)] = inner_3
        values[ObservationClass(4, False, False, axis)] = outer_4
        values[ObservationClass(4, True, False, axis)] = inner_4
        values[ObservationClass(4, False, True, axis)] = control_outer
        values[ObservationClass(4, True, True, axis)] = control_inner
    return {kind: ClassModel(value, PAPER_TOLERANCE) for kind, value in values.items()}


def estimate_models(
    normal: NormalEquations, factor: Factor, *, samples: int = 8, seed: int = 0
) -> dict[ObservationClass, ClassModel]:
    """Estimate model values for any block from a few exact cofactors of each class.

    Parameters
    ----------
    normal, factor
        Normal equations without damping, and their factor.
    samples
        Exact values for each class; the smallest and largest of them set the tolerance.

    Notes
    -----
    The tolerance is the largest deviation seen, widened by half; a class may still hold smaller
    values than any of its samples.
    """
    rng = np.random.default_rng(seed)
    out: dict[ObservationClass, ClassModel] = {}
    for kind, (rays, axis) in classify(normal.problem).items():
        chosen = rays if len(rays) <= samples else rng.choice(rays, samples, replace=False)
        roots = []
        for ray in np.sort(chosen).tolist():
            value = float(cofactor_column(normal, factor, ray, axis)[ray, axis])
            roots.append(max(value, 0.0) ** 0.5)
        mean = float(np.mean(roots))
        spread = max(abs(root - mean) for root in roots) / mean if mean > 1e-3 else 0.0
        out[kind] = ClassModel(mean, min(0.95, 1.5 * spread + 0.02))
    return out


def snoop(
    normal: NormalEquations,
    factor: Factor,
    v: Array,
    sigma: float,
    critical: float,
    models: Mapping[ObservationClass, ClassModel],
    *,
    exact_r: Array | None = None,
) -> Snooping:
    """Test every image coordinate by model values, exactly only where they leave doubt.

    Parameters
    ----------
    normal, factor
        Normal equations without damping, and their factor.
    v
        (m, 2) residuals in units of their a-priori sigmas.
    sigma
        Standard deviation of unit weight of the test.
    critical
        Critical value c.
    models
        Model values; a class without one is computed exactly.
    exact_r
        (m, 2) exact redundancy numbers, to count the differences.

    Notes
    -----
    Eq. (9): rejected above c (1 + k) sigma; eq. (10): accepted below c (1 - k) sigma; eq. (11):
    exact between.
    """
    rejected = np.zeros(v.shape, dtype=bool)
    computed = np.zeros(v.shape, dtype=bool)
    untestable = np.zeros(v.shape, dtype=bool)
    beyond = 0
    for kind, (rays, axis) in classify(normal.problem).items():
        size = np.abs(v[rays, axis])
        model = models.get(kind)
        if model is None:
            doubtful = np.ones(len(rays), dtype=bool)
        elif model.root <= SPUR**0.5:
            # a model value of next to zero says that nothing can be tested in this class
            doubtful = np.zeros(len(rays), dtype=bool)
            untestable[rays, axis] = True
        else:
            limit = critical * sigma * model.root
            above = size > limit * (1.0 + model.tolerance)
            below = size < limit * (1.0 - model.tolerance)
            rejected[rays[above], axis] = True
            doubtful = ~above & ~below
        if exact_r is not None and model is not None:
            off = beyond_model(exact_r[rays, axis], model.root, model.tolerance)
            beyond += int(off.sum())
        for ray in rays[doubtful].tolist():
            q = float(cofactor_column(normal, factor, ray, axis)[ray, axis])
            computed[ray, axis] = True
            testable = q >= TESTABLE
            rejected[ray, axis] = testable and abs(v[ray, axis]) > critical * sigma * q**0.5
    if exact_r is None:
        return Snooping(rejected, computed, untestable, None, None, None, None)
    testable_all = exact_r >= TESTABLE
    exact = testable_all & (np.abs(v) > critical * sigma * np.sqrt(np.maximum(exact_r, TESTABLE)))
    return Snooping(
        rejected,
        computed,
        untestable,
        exact,
        int((exact & ~rejected).sum()),
        int((rejected & ~exact).sum()),
        beyond,
    )
