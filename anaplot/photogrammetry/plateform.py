"""Places by the one form of all transformations from plate to photograph, many at once.

(xi, eta) = f0 + F (x, y)
x = (a0 + a1 xi + a2 eta + a3 xi eta) / (1 + c1 xi + c2 eta), and y alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np

from anaplot.aliases import Array
from anaplot.errors import NotComputableError
from anaplot.photogrammetry.planar import as_points, solve_pairs

__all__ = ["PlateForm"]

_STEPS = 50
_CLOSED = 1e-12  # between a given image place and that of its inverse, relative


class PlateForm(NamedTuple):
    """The numbers of `anaplot.photogrammetry.platetransformation.PlateTransformation` as arrays.

    Attributes
    ----------
    frame
        (2, 3) (f0, F) by rows: plate [mm] to (xi, eta).
    numerator
        (2, 4) a0, a1, a2, a3 of x and of y [mm].
    denominator
        (2,) c1, c2.
    """

    frame: Array
    numerator: Array
    denominator: Array

    @classmethod
    def of(
        cls,
        frame: Sequence[Sequence[float]],
        numerator: Sequence[Sequence[float]],
        denominator: Sequence[float],
    ) -> Self:
        """Return the form of these numbers."""
        return cls(np.array(frame), np.array(numerator), np.array(denominator))

    def to_image(self, plate: Array) -> Array:
        """Return (n, 2) image places of (n, 2) places on the plate, as the transformation does."""
        return self._evaluate(self._to_frame(as_points(plate)))[0]

    def jacobian(self, plate: Array) -> Array:
        """Return (n, 2, 2) derivatives of `to_image` at (n, 2) plate coordinates [mm]."""
        _, slope = self._evaluate(self._to_frame(as_points(plate)))
        by_plate: Array = slope @ self.frame[:, 1:]
        return by_plate

    def to_plate(self, image: Array) -> Array:
        """Return (n, 2) places on the plate, the inverse of `to_image`.

        Raises
        ------
        NotComputableError
            A place to which no place of the plate belongs.
        """
        wanted = as_points(image)
        a, c, frame = self.numerator, self.denominator, self.frame
        # without a product term the form is linear in (xi, eta): this is the inverse itself
        at = solve_pairs(a[None, :, 1:3] - wanted[:, :, None] * c, wanted - a[:, 0])
        if a[:, 3].any():
            for _ in range(_STEPS):
                value, slope = self._evaluate(at)
                step = solve_pairs(slope, value - wanted)
                at = at - step
                size = np.abs(at).max(initial=0.0)
                if not np.abs(step).max(initial=0.0) > 1e-15 * (1.0 + size):
                    break
        gap = np.abs(self._evaluate(at)[0] - wanted).max(axis=1, initial=0.0)
        lost = np.flatnonzero(~(gap <= _CLOSED * (1.0 + np.abs(wanted).max(axis=1, initial=0.0))))
        if lost.size:
            x, y = wanted[lost[0]].tolist()
            raise NotComputableError(
                f"no place on the plate belongs to the image coordinates x = {x:.6g}, "
                f"y = {y:.6g} mm"
            )
        return solve_pairs(np.broadcast_to(frame[:, 1:], (len(at), 2, 2)), at - frame[:, 0])

    def inverse_jacobian(self, image: Array) -> Array:
        """Return (n, 2, 2) derivatives of `to_plate` at (n, 2) image coordinates [mm].

        Raises
        ------
        NotComputableError
            As `to_plate`.
        """
        slope = self.jacobian(self.to_plate(image))
        along_x = solve_pairs(slope, np.tile((1.0, 0.0), (len(slope), 1)))
        along_y = solve_pairs(slope, np.tile((0.0, 1.0), (len(slope), 1)))
        return np.stack((along_x, along_y), axis=2)

    def origin(self) -> tuple[list[float], list[list[float]]]:
        """Return where the origin of the fiducial system lies on the plate, and derivatives there.

        Raises
        ------
        NotComputableError
            The origin has no place on the plate.
        """
        origin = np.zeros((1, 2))
        place: list[float] = self.to_plate(origin)[0].tolist()
        slopes: list[list[float]] = self.inverse_jacobian(origin)[0].tolist()
        return place, slopes

    def _to_frame(self, plate: Array) -> Array:
        at: Array = plate @ self.frame[:, 1:].T + self.frame[:, 0]
        return at

    def _evaluate(self, at: Array) -> tuple[Array, Array]:
        """(n, 2) values and (n, 2, 2) derivatives with respect to (xi, eta)."""
        a, c = self.numerator, self.denominator
        xi, eta = at[:, 0], at[:, 1]
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            terms = np.column_stack((np.ones_like(xi), xi, eta, xi * eta))
            under = 1.0 + at @ c
            value: Array = (terms @ a.T) / under[:, None]
            slope: Array = a[None, :, 1:3] + a[None, :, 3:] * at[:, None, ::-1]
            slope = (slope - value[:, :, None] * c) / under[:, None, None]
        return value, slope
