"""Image refinement: from the fiducial system to ideal image coordinates, and back.

ideal = measured - principal point - distortion, the distortion taken at the measured place
(Brown 1966 for the decentring part). In d = measured - point of symmetry, which is the principal
point where a camera states no other, r = abs(d): radial distortion is dr(r) d / r, decentring
distortion (P1 (r^2 + 2 x^2) + 2 P2 x y, P2 (r^2 + 2 y^2) + 2 P1 x y). A camera whose file states a
[lens] has that instead, and it goes the other way: from the ideal place to the measured one
(`photogrammetry/lens.py`). Refraction and the earth's curvature come last, about the principal
point (`photogrammetry/airandearth.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot
from typing import Self

import numpy as np

from anaplot.aliases import Array
from anaplot.errors import InputError, NotComputableError
from anaplot.photogrammetry.airandearth import AirAndEarth
from anaplot.photogrammetry.camera import (
    CameraCalibration,
    RadialPolynomial,
    RadialTable,
    pixel_size,
)
from anaplot.photogrammetry.lens import lens_places, through_lens, without_lens
from anaplot.photogrammetry.planar import as_points, solve_pairs
from anaplot.photogrammetry.radialshift import RadialShift

__all__ = ["Refinement"]


_STEPS = 50
_NARROW = 0.1  # of c: half the diagonal of the smallest image that a lens is taken to have
_CENTRE = 1e-9  # mm; nearer to the centre the limits are reached to the last digit
_CLOSED = 1e-12  # between a given ideal place and that of its inverse, relative


@dataclass(frozen=True, slots=True)
class Refinement:
    """Principal point and distortion of a camera; without arguments, the identity.

    Attributes
    ----------
    principal_point
        [mm] in the fiducial system.
    radial
        Radial distortion, or None. Between a table's radii dr follows cubic pieces with the slopes
        of the parabolas through neighbouring entries (continuous slope, dr(-r) = -dr(r)); beyond
        its last radius the last dr holds.
    decentring
        P1, P2 [mm^-1].
    symmetry_point
        [mm] in the fiducial system, or None: the principal point.
    lens
        (10,) `LENS_PARAMETERS` about the principal point, instead of all this; or None.
    beyond
        What displaces the image before the lens, or None.
    """

    principal_point: tuple[float, float] = (0.0, 0.0)
    radial: RadialPolynomial | RadialTable | None = None
    decentring: tuple[float, float] = (0.0, 0.0)
    symmetry_point: tuple[float, float] | None = None
    lens: tuple[float, ...] | None = None
    beyond: RadialShift | None = None

    @classmethod
    def of(
        cls,
        calibration: CameraCalibration,
        air: AirAndEarth | None = None,
        *,
        folds: bool = False,
    ) -> Self:
        """Return the refinement of a camera, and of a block's air and earth.

        Parameters
        ----------
        calibration, air
            The camera, and what of air and earth is taken off.
        folds
            Whether it may fold the image: of a camera that was accepted when it was read.

        Raises
        ------
        InputError
            The distortion folds the image within the format: two measured places would have the
            same ideal one; or a lens images nothing at the fiducials, or near the principal point
            of a camera of no known size. Elsewhere points tell where it images nothing.
        """
        lens = None
        if calibration.lens is not None:
            lens = (calibration.c, 0.0, 0.0, *calibration.lens.coefficients)
        made = cls(
            calibration.principal_point,
            calibration.radial,
            calibration.decentring,
            calibration.symmetry_point,
            lens,
            None if air is None else RadialShift.of(air, calibration.c),
        )
        if not folds:
            made._refuse_fold(calibration)
        return made

    def refine(self, xy: Array) -> Array:
        """Return ideal image coordinates.

        Parameters
        ----------
        xy
            (n, 2) measured coordinates [mm] in the fiducial system.

        Returns
        -------
        ndarray
            (n, 2) [mm], origin at the principal point; NaN where a lens images nothing.
        """
        ideal = self._without_camera(as_points(xy))
        return ideal if self.beyond is None else self.beyond.taken_off(ideal)

    def _without_camera(self, measured: Array) -> Array:
        if self.lens is not None:
            away = measured - np.array(self.principal_point)
            direction: Array = without_lens(away, np.array(self.lens))
            return direction * self.lens[0]
        distortion = self._distortion(measured - self._centre())[0]
        ideal: Array = measured - np.array(self.principal_point) - distortion
        return ideal

    def distort(self, xy: Array) -> Array:
        """Return measured coordinates of ideal ones, the inverse of `refine`.

        Parameters
        ----------
        xy
            (n, 2) ideal image coordinates [mm].

        Raises
        ------
        NotComputableError
            A place that no measured one refines to.
        """
        xy = as_points(xy)
        return self._through_camera(xy if self.beyond is None else self.beyond.put_on(xy))

    def _through_camera(self, xy: Array) -> Array:
        if self.lens is not None:
            ideal = xy
            seen = lens_places(ideal / self.lens[0], np.array(self.lens))
            laid: Array = seen + np.array(self.principal_point)
            if not np.allclose(self._without_camera(laid), ideal, rtol=0.0, atol=1e-9):
                raise NotComputableError("the lens folds the image at an ideal place")
            return laid
        ideal = xy + (np.array(self.principal_point) - self._centre())
        away = ideal.copy()
        for _ in range(_STEPS):
            distortion, slope = self._distortion(away)
            gap = away - distortion - ideal
            step = solve_pairs(np.eye(2) - slope, gap)
            away = away - step
            if not np.abs(step).max(initial=0.0) > 1e-14 * (1.0 + np.abs(away).max(initial=0.0)):
                break
        gap = np.abs(away - self._distortion(away)[0] - ideal).max(axis=1, initial=0.0)
        lost = np.flatnonzero(~(gap <= _CLOSED * (1.0 + np.abs(ideal).max(axis=1, initial=0.0))))
        if lost.size:
            x, y = xy[lost[0]].tolist()
            raise NotComputableError(
                f"the distortion cannot be inverted at x = {x:.6g}, y = {y:.6g} mm"
            )
        measured: Array = away + self._centre()
        return measured

    def jacobian(self, xy: Array) -> Array:
        """Return (n, 2, 2) derivatives of `refine` at (n, 2) measured coordinates [mm]."""
        jacobian = self._camera_jacobian(as_points(xy))
        if self.beyond is None:
            return jacobian
        chained: Array = self.beyond.jacobian(self._without_camera(as_points(xy))) @ jacobian
        return chained

    def _camera_jacobian(self, measured: Array) -> Array:
        away = measured - self._centre()
        if self.lens is not None:
            seen = through_lens(without_lens(away, np.array(self.lens)), np.array(self.lens))
            inverse = self.lens[0] * np.linalg.inv(seen.by_direction)
            return np.asarray(inverse, dtype=np.float64)
        jacobian: Array = np.eye(2) - self._distortion(away)[1]
        return jacobian

    def radial_distortion(self, radius: Array) -> tuple[Array, Array]:
        """Return (n,) dr [mm] and its slope at (n,) measured radii [mm]."""
        if isinstance(self.radial, RadialPolynomial):
            square = radius * radius
            k0, k1, k2, k3 = self.radial.k
            ratio = k0 + square * (k1 + square * (k2 + square * k3))
            slope = k0 + square * (3.0 * k1 + square * (5.0 * k2 + square * 7.0 * k3))
            return radius * ratio, slope
        if isinstance(self.radial, RadialTable):
            return _interpolate(self.radial, radius)
        return np.zeros_like(radius), np.zeros_like(radius)

    def _centre(self) -> Array:
        return np.array(self.symmetry_point or self.principal_point)

    def _distortion(self, away: Array) -> tuple[Array, Array]:
        """(n, 2) distortion and its (n, 2, 2) derivatives at (n, 2) places about the centre."""
        x, y = away.T
        radius = np.hypot(x, y)
        dr, slope = self.radial_distortion(radius)
        # dr / r and its derivative along r: both have limits in the centre, where dr is odd
        inside = radius > _CENTRE
        ratio = np.divide(dr, radius, out=slope.copy(), where=inside)
        bend = np.divide(slope - ratio, radius * radius, out=np.zeros_like(dr), where=inside)
        p1, p2 = self.decentring
        out = np.empty_like(away)
        out[:, 0] = x * ratio + p1 * (3.0 * x * x + y * y) + 2.0 * p2 * x * y
        out[:, 1] = y * ratio + p2 * (x * x + 3.0 * y * y) + 2.0 * p1 * x * y
        derivative = np.empty((len(away), 2, 2))
        derivative[:, 0, 0] = ratio + bend * x * x + 6.0 * p1 * x + 2.0 * p2 * y
        derivative[:, 0, 1] = derivative[:, 1, 0] = bend * x * y + 2.0 * p1 * y + 2.0 * p2 * x
        derivative[:, 1, 1] = ratio + bend * y * y + 6.0 * p2 * y + 2.0 * p1 * x
        return out, derivative

    def _refuse_fold(self, calibration: CameraCalibration) -> None:
        sized = calibration.pixels is not None or calibration.format is not None
        if self.lens is not None and sized and not calibration.fiducial_names():
            return  # corners of images often lie beyond what their lens is known for
        if calibration.pixels is not None:
            reach = _reach_of_pixels(calibration.pixels, calibration)
        elif calibration.format is None:
            # through a lens points are told by themselves where it images nothing
            least = calibration.c * (1.0 if self.lens is None else _NARROW)
            reach = max([least, *(hypot(m.x, m.y) for m in calibration.fiducials)])
        else:
            reach = 0.5 * hypot(*calibration.format) + hypot(*self._centre())
        radius, angle = np.meshgrid(np.linspace(0.0, reach, 200), np.linspace(0.0, 2 * np.pi, 25))
        away = np.column_stack(((radius * np.cos(angle)).ravel(), (radius * np.sin(angle)).ravel()))
        if self.lens is not None:
            lost = np.isnan(without_lens(away, np.array(self.lens))).any(axis=1)
            if lost.any():
                where = float(np.hypot(*away[lost].T).min())
                raise InputError(
                    f"camera {calibration.id!r}: the lens images nothing at radius {where:.4g} mm: "
                    f"its coefficients refer to coordinates divided by c"
                )
            return
        with np.errstate(over="ignore", invalid="ignore"):
            determinant = np.linalg.det(np.eye(2) - self._distortion(away)[1])
        folded = ~(determinant > 0.0)
        if folded.any():
            where = float(np.hypot(*away[folded].T).min())
            raise InputError(
                f"camera {calibration.id!r}: the distortion folds the image at radius "
                f"{where:.4g} mm: its coefficients refer to r in mm"
            )


def _reach_of_pixels(pixels: tuple[int, int], calibration: CameraCalibration) -> float:
    """Return how far the corners of an image lie from its principal point [mm]."""
    middle = (pixels[0] / 2.0, pixels[1] / 2.0)
    at = calibration.principal_px or middle
    far = hypot(*(abs(a - m) + m for a, m in zip(at, middle, strict=True)))
    return far * pixel_size(calibration.pixel_um)


def _interpolate(table: RadialTable, radius: Array) -> tuple[Array, Array]:
    """Cubic Hermite pieces through the table and, odd, through its mirror image."""
    r, dr = np.array(table.radius), np.array(table.dr_um) * 1e-3
    if r[0] > 0.0:
        r, dr = np.append(0.0, r), np.append(0.0, dr)
    if len(r) == 1:
        return np.zeros_like(radius), np.zeros_like(radius)
    width = np.diff(r)
    chord = np.diff(dr) / width
    slope = np.empty_like(r)
    slope[0] = chord[0]  # the parabola through (-r1, -d1), (0, 0), (r1, d1) is this line
    slope[1:-1] = (width[1:] * chord[:-1] + width[:-1] * chord[1:]) / (width[1:] + width[:-1])
    # in the last entry the parabola through the last three, in a table of one piece its line
    slope[-1] = 2.0 * chord[-1] - slope[-2] if len(r) > 2 else chord[-1]
    piece = np.clip(np.searchsorted(r, radius, side="right") - 1, 0, len(width) - 1)
    h = width[piece]
    t = (radius - r[piece]) / h
    s0, s1, m = slope[piece], slope[piece + 1], chord[piece]
    second, third = 3.0 * m - 2.0 * s0 - s1, s0 + s1 - 2.0 * m
    value = dr[piece] + h * t * (s0 + t * (second + t * third))
    rate = s0 + t * (2.0 * second + 3.0 * t * third)
    beyond = radius > r[-1]
    return np.where(beyond, dr[-1], value), np.where(beyond, 0.0, rate)
