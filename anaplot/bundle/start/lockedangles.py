"""Stated angles of photos that look along the X axis of the ground.

With phi near 90 degrees omega and kappa turn about nearly the same axis: small turns of a photo
change both by up to 1 / cos(phi) of themselves, correlated by nearly one. As observations of their
own with rotation_sigma they contradict good photographs there.
"""

from __future__ import annotations

from math import cos, radians

import numpy as np

from anaplot.bundle.solve.problem import Problem
from anaplot.textfiles.wording import first_of

__all__ = ["locked_angles"]

_LEAST = cos(radians(70.0))  # cosine of phi below which a turn counts three times in omega
_NAMED = 3


def locked_angles(problem: Problem) -> str | None:
    """Return a sentence on photos whose stated omega and kappa are observations near the lock.

    None where there is no such photo.
    """
    observed = np.isfinite(problem.rotation_sigma[:, [0, 2]]).any(axis=1)
    cosine = np.abs(np.cos(problem.rotation[:, 1]))
    at = np.flatnonzero(observed & (cosine < _LEAST))
    if not len(at):
        return None
    names = first_of([problem.photos[k] for k in at.tolist()], _NAMED)
    least = float(np.degrees(np.arcsin(cosine[at].min())))
    one = len(at) == 1
    return (
        f"{'photo' if one else 'photos'} {names} {'looks' if one else 'look'} along X, phi "
        f"is within {least:.1f} degrees of 90: omega and kappa turn about nearly the same axis "
        "there, and their rotation_sigma says too little of their errors; turn the ground system "
        "about Z, or state the rotations without it"
    )
