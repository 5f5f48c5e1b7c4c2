"""A random aerial block of tilted photos, linearised: what is seen, what it checks, and the ground.

Two strips of five photos at 1 : 10 000 with 60 and 30 % overlap, tilted by some degrees, over
ground with heights; points near the standard places and further ones anywhere, many of them with
two rays only; control of 5 cm in eight places.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.sparse import csr_array

from anaplot.adjustment.residualsystem import DenseResiduals
from anaplot.aliases import Array, Index
from anaplot.photogrammetry.collinearity import project
from anaplot.photogrammetry.rotation import rotation_matrix
from anaplot.planning.linearrows import image_design

__all__ = ["TiltedBlock", "tilted_block"]


_C, _SIGMA = 150.0, 0.005  # [mm]
_REACH = 112.0  # half of the format in which points are seen [mm]
_HEIGHT, _BASE, _SPACING = 1500.0, 920.0, 1610.0  # [m]
_PHOTOS, _STRIPS = 5, 2
_CENTRE, _PLACE, _RELIEF = 20.0, 60.0, 50.0  # how far from regular [m]
_TILT_DEG = 3.0
_FURTHER = 20
_CONTROL = (0, 2, 4, 10, 14, 20, 22, 24)
_CONTROL_SIGMA = 0.05  # [m]


@dataclass(frozen=True, slots=True, eq=False)
class TiltedBlock:
    """The linearised block.

    Attributes
    ----------
    names
        ("image", photo, point, axis) and ("control", point, axis) of the n rows.
    image_rows
        How many of them are image coordinates, the first ones.
    design
        (n, u) derivatives, each row divided by its sigma.
    matrix
        (n, n) R.
    inverse
        (3 q, n) what an error of one sigma in a row moves the q points by [m].
    """

    names: tuple[tuple[str, ...], ...]
    image_rows: int
    design: csr_array = field(repr=False)
    matrix: Array = field(repr=False)
    inverse: Array = field(repr=False)

    def residuals(self, errors: Array) -> DenseResiduals:
        """See the block from the side of its residuals, its rows in error by (n,) sigmas."""
        e, r = self.matrix @ errors, np.maximum(np.diag(self.matrix), 0.0)
        redundancy = self.design.shape[0] - self.design.shape[1]
        return DenseResiduals(self.names, e, r, float(e @ e), redundancy, self.matrix, self.design)

    def point_errors(self, errors: Array, left_out: tuple[int, ...]) -> Array:
        """Return (q, 3) errors of the points on the ground, some rows left out [m].

        Parameters
        ----------
        errors
            (n,) of the rows in sigmas.
        left_out
            Rows that are rejected; the others determine the block.
        """
        rows = list(left_out)
        if rows:
            seen = (self.matrix @ errors)[rows]
            errors = errors.copy()
            errors[rows] -= np.linalg.solve(self.matrix[np.ix_(rows, rows)], seen)
        return np.asarray((self.inverse @ errors).reshape(-1, 3))


def tilted_block(rng: np.random.Generator) -> TiltedBlock:
    """Draw a block in which every standard place is seen twice at least."""
    while True:
        centres, rotations, points = _scene(rng)
        rays = _rays(centres, rotations, points)
        seen = np.bincount(rays[:, 1], minlength=len(points)) >= 2
        if seen[: len(points) - _FURTHER].all():
            break
    numbers = np.cumsum(seen) - 1
    rays = rays[seen[rays[:, 1]]]
    rays[:, 1] = numbers[rays[:, 1]]
    points = points[seen]
    known = np.zeros(points.shape, dtype=bool)
    image = image_design(centres, rotations, _C, points, rays, known) / _SIGMA
    first = image.shape[1] - points.size
    control = np.zeros((3 * len(_CONTROL), image.shape[1]))
    axes = 3 * np.array(_CONTROL)[:, None] + np.arange(3)
    control[np.arange(len(control)), first + axes.ravel()] = 1.0 / _CONTROL_SIGMA
    design = np.vstack((image, control))
    length = np.sqrt(np.einsum("ij,ij->j", design, design))
    left, singular, right = np.linalg.svd(design / length, full_matrices=False)
    inverse = (right.T / singular) @ left.T / length[:, None]
    names: list[tuple[str, ...]] = [
        ("image", str(photo), str(point), axis) for photo, point in rays.tolist() for axis in "xy"
    ]
    names += [("control", str(point), axis) for point in _CONTROL for axis in "XYZ"]
    return TiltedBlock(
        tuple(names),
        len(image),
        csr_array(design),
        np.eye(len(design)) - left @ left.T,
        inverse[first:],
    )


def _scene(rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Draw (p, 3) projection centres, (p, 3, 3) rotations and (q, 3) points."""
    at = [
        (k * _BASE, strip * _SPACING, _HEIGHT) for strip in range(_STRIPS) for k in range(_PHOTOS)
    ]
    centres = np.array(at) + rng.normal(0.0, _CENTRE, (len(at), 3))
    tilts = np.radians(rng.uniform(-_TILT_DEG, _TILT_DEG, (len(at), 3)))
    rotations = np.array([rotation_matrix(*angles) for angles in tilts.tolist()])
    levels = 0.5 * _SPACING * np.arange(-1, 2 * _STRIPS)
    places = np.array([(k * _BASE, y) for y in levels for k in range(_PHOTOS)])
    places += rng.uniform(-_PLACE, _PLACE, places.shape)
    low, high = places.min(axis=0), places.max(axis=0)
    plan = np.vstack((places, rng.uniform(low, high, (_FURTHER, 2))))
    heights = rng.uniform(-_RELIEF, _RELIEF, len(plan))
    return centres, rotations, np.column_stack((plan, heights))


def _rays(centres: Array, rotations: Array, points: Array) -> Index:
    """Return (m, 2) photo and point of all rays."""
    p, q = len(centres), len(points)
    photo, point = np.divmod(np.arange(p * q), q)
    xy = project(centres[photo], rotations[photo], np.full(p * q, _C), points[point]).xy
    inside = (np.abs(xy) <= _REACH).all(axis=1)
    return np.column_stack((photo, point))[inside].astype(np.intp)
