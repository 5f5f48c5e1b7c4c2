"""Whether a block lies upright: level control fits many blocks upside down as well."""

from __future__ import annotations

import numpy as np

from anaplot.aliases import Array
from anaplot.bundle.solve.problem import Problem

__all__ = ["look_up", "upright_sentences"]

_STEEP = 0.7  # cosine between upward and where a photo looks


def look_up(problem: Problem, rotations: Array) -> bool:
    """Return whether most photos look up steeply, and nothing that is stated says that they do.

    A level rectangle of control with two corners exchanged fits a block upside down as well.

    Parameters
    ----------
    problem
        The bundle.
    rotations
        (photos, 3, 3) of its photos, image to ground.
    """
    if not float(np.median(-rotations[:, 2, 2])) > _STEEP:
        return False
    stated = problem.stated_rotations[:, 2, 2]
    stated = stated[np.isfinite(stated)]
    return not (len(stated) and float(np.median(-stated)) > _STEEP)


def upright_sentences(problem: Problem, rotations: Array) -> tuple[str, ...]:
    """Return what is said where control has most photos look up.

    Parameters
    ----------
    problem, rotations
        As in `look_up`.
    """
    if problem.defect or not look_up(problem, rotations):
        return ()
    return (
        "most photos look up at their points: does Z point down, are X and Y of control exchanged, "
        "or control points interchanged?",
    )
