"""COLMAP's camera models: held as they are, or measured pixels made those of a pinhole camera.

With u = (X / Z, Y / Z), x right and y down, a model says where u is measured. SIMPLE_PINHOLE to
OPENCV, and FULL_OPENCV without a denominator, are our lens. The others are polynomials in u, or of
a fisheye in a = u atan(|u|) / |u|, whose length is the angle off the axis,

    d = a (1 + k1 r2 + ..) / (1 + k4 r2 + ..) + (2 p1 x y + p2 (r2 + 2 x^2) + s1 r2,
                                                 2 p2 x y + p1 (r2 + 2 y^2) + s2 r2),

undone by Newton's method, or FOV and division models, undone in closed form. The source is COLMAP's
`sensor/models.h`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array
from anaplot.photogrammetry.camera import BrownLens
from anaplot.photogrammetry.planar import solve_pairs

__all__ = [
    "MODELS",
    "ColmapCamera",
    "canvas",
    "magnification",
    "model_number",
    "our_lens",
    "pinhole_directions",
    "pinhole_spread",
    "undistorted",
    "undistorted_spread",
]


class _Model(NamedTuple):
    name: str
    two: bool  # fx, fy instead of f
    more: int  # parameters behind the principal point
    kind: str = "lens"  # "lens", "polynomial", "fisheye", "fov", "division"; "" is not read

    @property
    def parameters(self) -> int:
        """How many it has."""
        return (4 if self.two else 3) + self.more


MODELS = {
    0: _Model("SIMPLE_PINHOLE", False, 0),
    1: _Model("PINHOLE", True, 0),
    2: _Model("SIMPLE_RADIAL", False, 1),
    3: _Model("RADIAL", False, 2),
    4: _Model("OPENCV", True, 4),
    5: _Model("OPENCV_FISHEYE", True, 4, "fisheye"),
    6: _Model("FULL_OPENCV", True, 8, "polynomial"),
    7: _Model("FOV", True, 1, "fov"),
    8: _Model("SIMPLE_RADIAL_FISHEYE", False, 1, "fisheye"),
    9: _Model("RADIAL_FISHEYE", False, 2, "fisheye"),
    10: _Model("THIN_PRISM_FISHEYE", True, 8, "fisheye"),
    11: _Model("RAD_TAN_THIN_PRISM_FISHEYE", True, 12, ""),
    12: _Model("SIMPLE_DIVISION", False, 1, "division"),
    13: _Model("DIVISION", True, 1, "division"),
    14: _Model("SIMPLE_FISHEYE", False, 0, "fisheye"),
    15: _Model("FISHEYE", True, 0, "fisheye"),
    16: _Model("EUCM", True, 2, ""),
    17: _Model("EQUIRECTANGULAR", False, -1, ""),  # width and height alone
}
"""Camera models by COLMAP's numbers."""

_STEEPEST = np.tan(np.radians(80.0))  # what lies farther off the axis is no ray of a pinhole
_SAMPLES = 4000
_HALVINGS = 24
_STEPS = 20
_CLOSED = 1e-12
_SMALL_FOV = 1e-4  # square of omega below which COLMAP takes a series


def model_number(name: str) -> int | None:
    """Return COLMAP's number of a camera model, or None."""
    return next((number for number, model in MODELS.items() if model.name == name), None)


class ColmapCamera(NamedTuple):
    """A camera as COLMAP has it.

    Attributes
    ----------
    id
        COLMAP's number.
    model
        COLMAP's number of its model.
    width, height
        Of its images [px].
    params
        Parameters of the model, in COLMAP's order.
    """

    id: int
    model: int
    width: int
    height: int
    params: tuple[float, ...]

    @property
    def focal(self) -> tuple[float, float]:
        """fx, fy [px]."""
        return self.params[0], self.params[1 if MODELS[self.model].two else 0]

    @property
    def principal(self) -> tuple[float, float]:
        """cx, cy [px]."""
        at = 2 if MODELS[self.model].two else 1
        return self.params[at], self.params[at + 1]

    @property
    def more(self) -> tuple[float, ...]:
        """What stands behind the principal point."""
        return self.params[4 if MODELS[self.model].two else 3 :]


def our_lens(camera: ColmapCamera) -> BrownLens | None:
    """Return the lens that holds a camera's model exactly; None where there is none."""
    fx, fy = camera.focal
    b1 = fx / fy - 1.0
    more = camera.more
    match MODELS[camera.model].name:
        case "SIMPLE_PINHOLE" | "PINHOLE":
            return BrownLens(b1=b1)
        case "SIMPLE_RADIAL" | "RADIAL":
            return replace(BrownLens(*more), b1=b1)
        case "OPENCV":
            return BrownLens(more[0], more[1], 0.0, more[2], more[3], b1)
        case "FULL_OPENCV" if not any(more[5:]):
            return BrownLens(more[0], more[1], more[4], more[2], more[3], b1)
        case _:
            return None


def pinhole_directions(camera: ColmapCamera, pixels: Array) -> Array:
    """Return (n, 2) directions X / Z, Y / Z, y down, of (n, 2) pixels of a camera.

    NaN where the model images no direction within 80 degrees of its axis there.
    """
    measured = (pixels - camera.principal) / camera.focal
    kind = MODELS[camera.model].kind
    if kind == "fov":
        bent = _undo_fov(measured, camera.more[0])
    elif kind == "division":
        bent = measured / (1.0 + camera.more[0] * _squares(measured))[:, None]
        bent[1.0 + camera.more[0] * _squares(measured) <= 0.0] = np.nan
    else:
        most = np.radians(80.0) if kind == "fisheye" else _STEEPEST
        bent = _undo(measured, _coefficients(camera), float(most))
        if kind == "fisheye":
            angle = np.hypot(*bent.T)
            small = angle < 1e-8
            bent = bent * np.where(small, 1.0, np.tan(angle) / np.where(small, 1.0, angle))[:, None]
    bent[~(np.hypot(*bent.T) <= _STEEPEST * (1.0 + 1e-9))] = np.nan
    return bent


def undistorted(measured: Array, radial: tuple[float, ...], p1: float, p2: float) -> Array:
    """Return (n, 2) directions of (n, 2) measured ones, y down, of OPENCV with any radial terms.

    NaN where nothing is imaged within 80 degrees of the axis.
    """
    return _undo(measured, _Coefficients(radial, (), p1, p2, 0.0, 0.0), float(_STEEPEST))


def pinhole_spread(camera: ColmapCamera, pixels: Array, directions: Array) -> Array:
    """Return (n, 2, 2) derivatives of `pinhole_directions` by (n, 2) pixels over focal lengths.

    Parameters
    ----------
    camera, pixels
        As there.
    directions
        What it returned.
    """
    measured = (pixels - camera.principal) / camera.focal
    kind = MODELS[camera.model].kind
    away = np.hypot(*measured.T)
    far = np.hypot(*directions.T)
    with np.errstate(all="ignore"):
        if kind == "fov" and camera.more[0] ** 2 >= _SMALL_FOV:
            omega = abs(camera.more[0])
            half = 2.0 * np.tan(0.5 * omega)
            along = omega * (1.0 + (half * far) ** 2) / half
            across = np.where(away > 0.0, far / away, omega / half)
            return _radial_map(measured, along, across)
        if kind == "division":
            bend = camera.more[0] * away * away
            return _radial_map(measured, (1.0 - bend) / (1.0 + bend) ** 2, 1.0 / (1.0 + bend))
        if kind == "fov":
            base, series = _small_fov(camera.more[0])
            return _inverse(_seen(directions, series)[1] * base)
        angle = np.arctan(far)
        small = far < 1e-8
        if kind == "fisheye":
            factor = np.where(small, 1.0, far / np.where(small, 1.0, angle))
            bent = directions / factor[:, None]
            onward = _radial_map(bent, 1.0 + far * far, factor)
            out: Array = onward @ _inverse(_seen(bent, _coefficients(camera))[1])
            return out
        return _inverse(_seen(directions, _coefficients(camera))[1])


def undistorted_spread(directions: Array, radial: tuple[float, ...], p1: float, p2: float) -> Array:
    """Return (n, 2, 2) derivatives of `undistorted`, where it returned these directions."""
    return _inverse(_seen(directions, _Coefficients(radial, (), p1, p2, 0.0, 0.0))[1])


def magnification(spread: Array, pixels: Array) -> Array:
    """Return by how much (n,) errors of a pixel are larger where it was corrected to.

    Parameters
    ----------
    spread
        (n, 2, 2) derivatives of corrected by measured directions.
    pixels
        (2, 2) derivatives of pixels by directions, of both alike.

    Returns
    -------
    magnification
        The root mean square of the two singular values: a circle becomes an ellipse, and a sigma
        for both coordinates is right on the mean of their squares.
    """
    both = pixels @ spread @ _inverse(pixels[None])
    out: Array = np.sqrt(0.5 * (both * both).sum(axis=(1, 2)))
    return out


def canvas(
    pixels: Array, size: tuple[int, int], principal: tuple[float, float]
) -> tuple[Array, tuple[int, int], tuple[float, float]]:
    """Return pixels, size and principal point of an image that has room for all of the pixels.

    What a wide lens sees lies far outside of its own image when it is corrected.
    """
    low = np.floor(np.minimum(np.nanmin(pixels, axis=0, initial=0.0), 0.0))
    high = np.ceil(np.maximum(np.nanmax(pixels, axis=0, initial=0.0), size))
    width, height = (high - low).tolist()
    place = principal[0] - float(low[0]), principal[1] - float(low[1])
    return pixels - low, (int(width), int(height)), place


class _Coefficients(NamedTuple):
    above: tuple[float, ...]  # of r2, r2^2, ..
    below: tuple[float, ...]
    p1: float
    p2: float
    s1: float
    s2: float


def _coefficients(camera: ColmapCamera) -> _Coefficients:
    k = camera.more
    match MODELS[camera.model].name:
        case "FULL_OPENCV":
            return _Coefficients((k[0], k[1], k[4]), k[5:], k[2], k[3], 0.0, 0.0)
        case "THIN_PRISM_FISHEYE":
            return _Coefficients((k[0], k[1], k[4], k[5]), (), k[2], k[3], k[6], k[7])
        case _:
            return _Coefficients(k, (), 0.0, 0.0, 0.0, 0.0)


def _squares(xy: Array) -> Array:
    out: Array = (xy * xy).sum(axis=1)
    return out


def _undo_fov(measured: Array, omega: float) -> Array:
    """Undo FOV: |d| = atan(2 |u| tan(omega / 2)) / omega; a small omega as COLMAP computes it."""
    away = np.hypot(*measured.T)
    if omega * omega < _SMALL_FOV:
        base, series = _small_fov(omega)
        return _undo(measured / base, series, float(_STEEPEST))
    angle = away * abs(omega)
    true = np.tan(np.minimum(angle, 1.57)) / (2.0 * np.tan(abs(omega) / 2.0))
    out: Array = measured * np.divide(true, away, out=np.ones_like(away), where=away > 0)[:, None]
    out[angle >= 1.57] = np.nan
    return out


def _small_fov(omega: float) -> tuple[float, _Coefficients]:
    """Return a factor and a polynomial: |d| = |u| (1 + omega^2 (|u|^2 / 3 - 1/12))."""
    square = omega * omega
    base = 1.0 - square / 12.0
    return base, _Coefficients((square / 3.0 / base,), (), 0.0, 0.0, 0.0, 0.0)


def _inverse(matrices: Array) -> Array:
    """Return inverses of (n, 2, 2) matrices; not finite where they are singular."""
    unit = np.zeros((2, len(matrices), 2))
    unit[0, :, 0] = unit[1, :, 1] = 1.0
    return np.stack([solve_pairs(matrices, column) for column in unit], axis=2)


def _radial_map(places: Array, along: Array, across: Array) -> Array:
    """Return (n, 2, 2) derivatives of a map that moves (n, 2) places along their radius."""
    away = np.hypot(*places.T)
    unit = places / np.where(away > 0.0, away, 1.0)[:, None]
    outer = unit[:, :, None] * unit[:, None, :]
    out: Array = across[:, None, None] * np.eye(2) + (along - across)[:, None, None] * outer
    return out


def _radial(r2: Array, of: _Coefficients) -> tuple[Array, Array]:
    """Return the radial factor and its derivative by r2."""
    above, below = (np.polynomial.Polynomial([1.0, *part]) for part in (of.above, of.below))
    up, down = above(r2), below(r2)
    return up / down, (above.deriv()(r2) - up / down * below.deriv()(r2)) / down


def _seen(xy: Array, of: _Coefficients) -> tuple[Array, Array]:
    """Return where (n, 2) places are measured, and the (n, 2, 2) derivatives."""
    x, y = xy.T
    r2 = x * x + y * y
    factor, slope = _radial(r2, of)
    across = 2.0 * x * y
    out = np.stack(
        (
            x * factor + of.p1 * across + of.p2 * (r2 + 2.0 * x * x) + of.s1 * r2,
            y * factor + of.p2 * across + of.p1 * (r2 + 2.0 * y * y) + of.s2 * r2,
        ),
        axis=1,
    )
    by = np.empty((len(xy), 2, 2))
    both = slope * across + 2.0 * of.p1 * x + 2.0 * of.p2 * y
    by[:, 0, 0] = factor + 2.0 * x * x * slope + 2.0 * of.p1 * y + 6.0 * of.p2 * x + 2.0 * of.s1 * x
    by[:, 0, 1] = both + 2.0 * of.s1 * y
    by[:, 1, 0] = both + 2.0 * of.s2 * x
    by[:, 1, 1] = factor + 2.0 * y * y * slope + 2.0 * of.p2 * x + 6.0 * of.p1 * y + 2.0 * of.s2 * y
    return out, by


def _undo(measured: Array, of: _Coefficients, most: float) -> Array:
    """Return what is measured there, no farther from the axis than `most`; NaN where nothing is."""
    with np.errstate(all="ignore"):
        grid = np.linspace(0.0, 1.05 * most, _SAMPLES)
        factor, slope = _radial(grid * grid, of)
        rising = factor + 2.0 * grid * grid * slope > 0.0
        fold = float(grid[-1] if rising.all() else grid[max(int(np.argmin(rising)) - 1, 0)])
        radius = np.hypot(*measured.T)
        low, high = np.zeros(len(measured)), np.full(len(measured), fold)
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            short = middle * _radial(middle * middle, of)[0] < radius
            low, high = np.where(short, middle, low), np.where(short, high, middle)
        start = np.divide(0.5 * (low + high), radius, out=np.ones_like(radius), where=radius > 0)
        xy = measured * start[:, None]
        for _ in range(_STEPS):
            seen, by = _seen(xy, of)
            step = solve_pairs(by, seen - measured)
            xy = xy - step
            if not (np.abs(step) > 1e-16 * (1.0 + np.abs(xy))).any():
                break
        seen, by = _seen(xy, of)
        gap = np.abs(seen - measured).max(axis=1, initial=0.0)
        good = (gap <= _CLOSED * (1.0 + radius)) & (np.linalg.det(by) > 0.0)
        good &= np.hypot(*xy.T) <= 1.001 * fold
    return np.where(good[:, None], xy, np.nan)
