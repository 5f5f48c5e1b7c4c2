"""How much is known of where a block lies, beside its images, and what that leaves unchecked."""

from __future__ import annotations

import numpy as np

from anaplot.bundle.solve.problem import SEVEN, Problem

__all__ = ["as_likely_wrong", "known_values"]


def known_values(problem: Problem) -> int:
    """Return the number of coordinates and angles that are held or observed."""
    priors = (problem.ground_sigma, problem.position_sigma, problem.rotation_sigma)
    return int(problem.fixed.sum()) + sum(int(np.isfinite(sigma).sum()) for sigma in priors)


def as_likely_wrong(problem: Problem) -> list[str]:
    """Return control points of which any may be the wrong one, where control contradicts the rays.

    Without one of them no more is known than holds the block, and the others fit whatever they
    are: of three points known in all coordinates, each.
    """
    if problem.defect or problem.given is not None or problem.conditions is not None:
        return []
    own = problem.controlled.sum(axis=1)
    alike = (own > 0) & (known_values(problem) - own <= SEVEN)
    return [problem.points[k] for k in np.flatnonzero(alike).tolist()]
