"""What the operator of a simulated plotter sees in the eyepieces: two patches of the photographs.

The ground is a synthetic texture, drawn in the left photograph. Where a detail of the right
photograph lies in the left one is known at the common points and interpolated between them, so
that both patches show the same details, displaced as the points truly are: parallax is cleared
when the two look alike around the mark.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from anaplot.aliases import Array
from anaplot.plotter.readings import Position

__all__ = ["MarkedPoint", "StereoGround", "StereoPair"]

Whole = NDArray[np.int64]
Points = Mapping[str, tuple[float, float]]

_SMALLEST_FIELD, _LARGEST_FIELD = 0.01, 100.0  # mm
_MOST_CELLS = 1024  # along either side of a patch
_FINEST = 4.0  # cells: shorter waves would be ragged when the texture moves by parts of a cell
_SHARES = (0.5, 0.9, 1.0, 0.5)  # of the waves, the shortest first
_PATHS = ((2, 14.0, 0.95), (3, 28.0, 0.95))  # along which waves, how narrow, how light
_CONTRAST, _DARKER = 2.2, 0.6
_SIGNAL_MM = 0.015  # radius of the white disc that marks a point
_SIGNAL_CELLS = 2.2  # its radius at least
_RING = 2.0  # outer radius of the dark ring around it, in radii of the disc
_MOST_POINTS = 64
_NEAR = 1e-12  # mm^2: at a point itself the point alone counts
_TURNS = 2.0 * math.pi * np.arange(256) / 256.0
_COS, _SIN = np.cos(_TURNS), np.sin(_TURNS)
_MIX = tuple(np.uint64(k) for k in (0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB))


@dataclass(frozen=True, slots=True)
class MarkedPoint:
    """A marked point in a patch.

    Attributes
    ----------
    point
        Its name.
    column, row
        Where it lies [cells], (0, 0) being the middle of the upper left cell.
    radius
        Of its signal, dark ring included [cells].
    """

    point: str
    column: float
    row: float
    radius: float


@dataclass(frozen=True, slots=True, eq=False)
class StereoPair:
    """The patches around the mark.

    Attributes
    ----------
    left, right
        (rows, columns) grey, 0 black to 1 white; x grows along the columns, y against the rows.
        The mark is in the exact middle.
    left_marks, right_marks
        Points inside the patches.
    field_mm
        Width of a patch [mm].
    nearest
        The common point nearest to the mark in the left photograph, or None when there is none.
    x, y
        How far the left mark must move to it [mm].
    px, py
        What the parallaxes px = x' - x'', py = y' - y'' of the mark lack of that point's [mm]:
        both are zero when the mark lies on it in both photographs.
    """

    left: Array
    right: Array
    left_marks: tuple[MarkedPoint, ...]
    right_marks: tuple[MarkedPoint, ...]
    field_mm: float
    nearest: str | None
    x: float
    y: float
    px: float
    py: float


class StereoGround:
    """The ground that two photographs show.

    Parameters
    ----------
    left, right
        Names of the photographs: they alone decide what the texture looks like.
    left_points, right_points
        True plate coordinates [mm] by point.

    Notes
    -----
    From the right photograph to the left one: an affine trend through the common points, and what
    is left at each of them weighted by the inverse fourth power of the distance (Shepard 1968).
    The map is exact at the points and level around each, so that nothing but the trend deforms
    the surroundings of a point.
    """

    def __init__(self, left: str, right: str, left_points: Points, right_points: Points) -> None:
        self._points = dict(left_points), dict(right_points)
        digest = hashlib.sha256(repr((left, right)).encode()).digest()
        self._seed = np.uint64(int.from_bytes(digest[:8], "big"))
        self._common = tuple(name for name in left_points if name in right_points)
        self._left = _array([left_points[name] for name in self._common])
        self._right = _array([right_points[name] for name in self._common])
        shift = self._left - self._right
        self._centre, self._mean = np.zeros(2), np.zeros(2)
        self._trend: Array = np.zeros((2, 2))
        if self._common:
            self._centre, self._mean = self._right.mean(axis=0), shift.mean(axis=0)
            # centred, so that one point, two, or many on a line determine what they can
            self._trend[:] = np.linalg.lstsq(
                self._right - self._centre, shift - self._mean, rcond=1e-6
            )[0]
        self._rest = shift - self._mean - (self._right - self._centre) @ self._trend

    def in_left(self, right: Array) -> Array:
        """Return where details of the right photograph lie in the left one.

        Parameters
        ----------
        right
            (n, 2) plate coordinates [mm].

        Returns
        -------
        array
            (n, 2) plate coordinates [mm].
        """
        shift = self._mean + (right - self._centre) @ self._trend
        if self._common:
            # farther points weigh nothing that shows
            near = np.argsort(((self._right - right.mean(axis=0)) ** 2).sum(axis=1))[:_MOST_POINTS]
            x, y = self._right[near].T
            away = (right[:, :1] - x) ** 2 + (right[:, 1:] - y) ** 2
            away = np.maximum(away, _NEAR)
            weight = (away.min(axis=1, keepdims=True) / away) ** 2
            shift += weight @ self._rest[near] / weight.sum(axis=1, keepdims=True)
        return np.asarray(right + shift)

    def look(self, at: Position, columns: int, rows: int, field_mm: float) -> StereoPair:
        """Return what is seen with the carriages at a position.

        Parameters
        ----------
        at
            Plate coordinates of the marks [mm].
        columns, rows
            Size of each patch in square cells.
        field_mm
            Width of a patch [mm].

        Raises
        ------
        ValueError
            The patch has no cells or too many, or the field is outside its limits.
        """
        if not (0 < columns <= _MOST_CELLS and 0 < rows <= _MOST_CELLS):
            raise ValueError(f"a patch has 1 to {_MOST_CELLS} cells a side, not {columns} x {rows}")
        if not _SMALLEST_FIELD <= field_mm <= _LARGEST_FIELD:
            raise ValueError(
                f"a field is {_SMALLEST_FIELD:g} to {_LARGEST_FIELD:g} mm, not {field_mm:g}"
            )
        cell = field_mm / columns
        across = (np.arange(columns) - (columns - 1) / 2.0) * cell
        down = -(np.arange(rows) - (rows - 1) / 2.0) * cell
        offsets = np.stack(np.meshgrid(across, down), axis=2).reshape(-1, 2)
        left, right = np.array([at.xl, at.yl]), np.array([at.xr, at.yr])
        patches = (
            self._texture(offsets + left, cell),
            self._texture(self.in_left(offsets + right), cell),
        )
        left_patch, right_patch = (patch.reshape(rows, columns) for patch in patches)
        nearest, x, y, px, py = self._lacking(at)
        return StereoPair(
            left_patch,
            right_patch,
            _mark_points(left_patch, self._points[0], at.xl, at.yl, cell),
            _mark_points(right_patch, self._points[1], at.xr, at.yr, cell),
            field_mm,
            nearest,
            x,
            y,
            px,
            py,
        )

    def _lacking(self, at: Position) -> tuple[str | None, float, float, float, float]:
        if not self._common:
            return None, 0.0, 0.0, 0.0, 0.0
        to_left = self._left - (at.xl, at.yl)
        to_right = self._right - (at.xr, at.yr)
        i = int(np.argmin((to_left**2).sum(axis=1)))
        (x, y), (px, py) = to_left[i].tolist(), (to_left[i] - to_right[i]).tolist()
        return self._common[i], x, y, px, py

    def _texture(self, ground: Array, cell: float) -> Array:
        """Return the grey (n,) at places (n, 2) [mm] of the left photograph.

        Waves whose lengths are powers of two micrometres, from about `_FINEST` cells upwards: a
        change of the field changes which of them are seen, but not where they lie. Light paths
        run along the nodes of the longer ones: lines lead the eye better than spots.
        """
        finest = math.ceil(math.log2(_FINEST * cell * 1000.0))
        waves = [
            self._wave(ground * (1000.0 / 2.0**level), level)
            for level in range(finest, finest + len(_SHARES))
        ]
        total = sum(share * wave for share, wave in zip(_SHARES, waves, strict=True))
        grey = _DARKER * (0.5 + 0.5 * np.tanh(_CONTRAST * total))
        for k, narrow, light in _PATHS:
            grey += (1.0 - grey) * light * np.exp(-((narrow * waves[k]) ** 2))
        return np.asarray(grey)

    def _wave(self, at: Array, level: int) -> Array:
        """Return smooth noise (n,) of wave length 1, about -1 to 1 (Perlin 2002)."""
        cos, sin = math.cos(0.9 * level), math.sin(0.9 * level)
        x, y = at.T
        x, y = cos * x + sin * y, cos * y - sin * x  # no direction is common to all waves
        column, row = np.floor(x), np.floor(y)
        x, y = x - column, y - row
        column, row = column.astype(np.int64), row.astype(np.int64)
        total = np.zeros(len(at))
        for right, weight_x in ((0, 1.0 - _ease(x)), (1, _ease(x))):
            for up, weight_y in ((0, 1.0 - _ease(y)), (1, _ease(y))):
                turn = self._drawn(column + right, row + up, level)
                total += (_COS[turn] * (x - right) + _SIN[turn] * (y - up)) * weight_x * weight_y
        return np.asarray(math.sqrt(2.0) * total)

    def _drawn(self, column: Whole, row: Whole, level: int) -> Whole:
        """Return which slope (n,) each corner has, the same every time."""
        mixed = column.astype(np.uint64) * _MIX[0] + row.astype(np.uint64) * _MIX[1]
        mixed += self._seed ^ np.uint64(level % 2**16)
        for factor, shift in ((_MIX[1], 30), (_MIX[2], 27)):  # SplitMix64 (Steele et al. 2014)
            mixed = (mixed ^ (mixed >> np.uint64(shift))) * factor
        return np.asarray(mixed >> np.uint64(56), dtype=np.int64)


def _ease(part: Array) -> Array:
    """Return the part of a step, without a kink at either end."""
    return np.asarray(part**3 * (part * (6.0 * part - 15.0) + 10.0))


def _array(pairs: list[tuple[float, float]]) -> Array:
    return np.array(pairs, dtype=np.float64).reshape(-1, 2)


def _mark_points(
    grey: Array, points: Points, x: float, y: float, cell: float
) -> tuple[MarkedPoint, ...]:
    """Paint the points in and around a patch, its middle at (x, y) [mm]; return those inside."""
    rows, columns = grey.shape
    radius = max(_SIGNAL_MM / cell, _SIGNAL_CELLS)
    inside = []
    for name, (px, py) in points.items():
        column = (columns - 1) / 2.0 + (px - x) / cell
        row = (rows - 1) / 2.0 - (py - y) / cell
        outside = max(-column, column - columns + 1, -row, row - rows + 1)
        if outside < _RING * radius + 1.0:
            _signalize(grey, column, row, radius)
        if outside <= 0.5:
            inside.append(MarkedPoint(name, column, row, _RING * radius))
    return tuple(inside)


def _signalize(grey: Array, column: float, row: float, radius: float) -> None:
    """Paint a white disc in a dark ring, its edges soft so that parts of a cell show."""
    reach = math.ceil(_RING * radius) + 1
    top, left = max(round(row) - reach, 0), max(round(column) - reach, 0)
    part = grey[top : round(row) + reach + 1, left : round(column) + reach + 1]
    down = np.arange(top, top + part.shape[0])[:, None] - row
    across = np.arange(left, left + part.shape[1])[None, :] - column
    away = np.hypot(down, across)
    ring = np.clip(_RING * radius + 0.5 - away, 0.0, 1.0)
    disc = np.clip(radius + 0.5 - away, 0.0, 1.0)
    part[...] = part * (1.0 - ring) + disc
