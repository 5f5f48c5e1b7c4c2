"""Control of which all three coordinates are known: what can lie somewhere else as a whole."""

from __future__ import annotations

import numpy as np

from anaplot.bundle.solve.problem import Problem

__all__ = ["whole_control"]


def whole_control(problem: Problem) -> dict[str, int]:
    """Return the points of a bundle with three coordinates held or observed: numbers by name."""
    whole = np.flatnonzero(problem.controlled.all(axis=1)).tolist()
    return {problem.points[k]: k for k in whole}
