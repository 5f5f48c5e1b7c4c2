"""Control of which all three coordinates are known, or those in plan: what can lie elsewhere."""

from __future__ import annotations

import numpy as np

from anaplot.bundle.solve.problem import Problem

__all__ = ["plan_control", "whole_control"]


def whole_control(problem: Problem) -> dict[str, int]:
    """Return the points of a bundle with three coordinates held or observed: numbers by name."""
    return _controlled(problem, 3)


def plan_control(problem: Problem) -> dict[str, int]:
    """Return those with X and Y held or observed, whatever of Z is."""
    return _controlled(problem, 2)


def _controlled(problem: Problem, coordinates: int) -> dict[str, int]:
    found = np.flatnonzero(problem.controlled[:, :coordinates].all(axis=1)).tolist()
    return {problem.points[k]: k for k in found}
