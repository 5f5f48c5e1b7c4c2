"""Path data: many lines, marks or ellipses in one `d`, written at once.

A tenth of a unit is the finest step: a drawing is some 760 units wide. All places are (n, 2) in
units of the drawing, y down.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from anaplot.aliases import Array

__all__ = [
    "Shape",
    "arrows",
    "dots",
    "ellipses",
    "marks",
    "number",
    "polygons",
    "polyline",
    "segments",
]

Shape = Literal["circle", "triangle", "square", "diamond", "cross", "plus", "down"]
"""A mark; the tip of "triangle" is above, that of "down" below."""


_HEAD = 4.5  # length of an arrow's head, at most half of the arrow
_HALF_WIDTH = 0.42  # of a head, in its lengths
_SHORTEST = 3.0  # an arrow that is shorter has no head


def number(value: float) -> str:
    """Return a number with at most one decimal, as short as it can be written."""
    return _compact(f"{round(float(value), 1) + 0.0:.10g}")


def _compact(text: str) -> str:
    """Leave out blanks before a minus, and the nought before a decimal point."""
    text = text.replace(" -", "-")
    for before in ("M", "l", "a", "L", " ", "-", "m", "h"):
        text = text.replace(f"{before}0.", f"{before}.")
    return text[1:] if text.startswith("0.") else text


def _written(one: str, columns: Array) -> str:
    """Return a template filled with every row of (n, k) numbers."""
    if not np.isfinite(columns).all():
        raise ValueError("a place in a drawing is not finite")
    rounded = np.round(columns, 1) + 0.0  # no minus before nought
    return _compact((one * len(rounded)) % tuple(rounded.ravel().tolist()))


def _steps(places: Array) -> Array:
    """Return (n, k - 1, 2) steps between (n, k, 2) places as they are rounded."""
    return np.diff(np.round(places, 1), axis=1)


def dots(at: Array) -> str:
    """Return lines of no length: with round ends they are discs as wide as the line."""
    return _written("M%.10g %.10gh0", at)


def segments(start: Array, end: Array) -> str:
    """Return a line each from `start` to `end`."""
    step = _steps(np.stack((start, end), axis=1))[:, 0]
    return _written("M%.10g %.10gl%.10g %.10g", np.hstack((start, step)))


def polyline(at: Array) -> str:
    """Return one line through all places."""
    steps = _steps(at[None])[0]
    return _written("M%.10g %.10g", at[:1]) + _written("l%.10g %.10g", steps)


def polygons(corners: Array) -> str:
    """Return closed polygons of (n, k, 2) corners."""
    n, k = corners.shape[:2]
    columns = np.hstack((corners[:, 0], _steps(corners).reshape(n, 2 * (k - 1))))
    return _written("M%.10g %.10g" + "l%.10g %.10g" * (k - 1) + "z", columns)


def arrows(start: Array, end: Array) -> str:
    """Return arrows from `start` to `end`; those that are too short for a head are lines."""
    along = end - start
    length = np.hypot(along[:, 0], along[:, 1])
    long = length >= _SHORTEST
    out = segments(start[~long], end[~long])
    if not long.any():
        return out
    start, end, length = start[long], end[long], length[long]
    back = -along[long] / length[:, None] * np.minimum(_HEAD, 0.5 * length)[:, None]
    aside = _HALF_WIDTH * np.stack((-back[:, 1], back[:, 0]), axis=1)
    steps = _steps(np.stack((start, end, end + back + aside, end, end + back - aside), axis=1))
    # shaft; then from one barb over the tip to the other
    columns = np.hstack((start, steps.reshape(len(start), 8)))
    return out + _written("M%.10g %.10gl%.10g %.10gm%.10g %.10gl%.10g %.10gl%.10g %.10g", columns)


def ellipses(at: Array, covariance: Array) -> str:
    """Return the ellipses whose half axes are the roots of the eigenvalues.

    Parameters
    ----------
    at
        (n, 2) centres.
    covariance
        (n, 2, 2) in units of the drawing squared, y down.
    """
    values, vectors = np.linalg.eigh(covariance)
    half = np.sqrt(np.maximum(values, 0.0))[:, ::-1]  # the longer one first
    along = vectors[:, :, 1] * half[:, :1]
    degrees = np.degrees(np.arctan2(along[:, 1], along[:, 0]))[:, None]
    step = np.round(2.0 * along, 1)
    arc = np.hstack((half, degrees))
    columns = np.hstack((at - along, arc, step, arc, -step))
    return _written("M%.10g %.10g" + 2 * "a%.10g %.10g %.10g 1 0 %.10g %.10g" + "z", columns)


def _outline(shape: Shape) -> tuple[Array, bool]:
    """Return the corners of a mark of half size one, and whether it is closed."""
    outlines: dict[str, tuple[list[tuple[float, float]], bool]] = {
        "triangle": ([(0.0, -1.15), (1.05, 0.75), (-1.05, 0.75)], True),
        "down": ([(0.0, 1.15), (-1.05, -0.75), (1.05, -0.75)], True),
        "square": ([(-0.9, -0.9), (0.9, -0.9), (0.9, 0.9), (-0.9, 0.9)], True),
        "diamond": ([(0.0, -1.25), (1.25, 0.0), (0.0, 1.25), (-1.25, 0.0)], True),
        "cross": ([(-0.9, -0.9), (0.9, 0.9), (-0.9, 0.9), (0.9, -0.9)], False),
        "plus": ([(-1.2, 0.0), (1.2, 0.0), (0.0, -1.2), (0.0, 1.2)], False),
    }
    corners, closed = outlines[shape]
    return np.array(corners), closed


def marks(shape: Shape, at: Array, size: float) -> str:
    """Return a mark at every place, `size` being half of what it is wide."""
    at = np.round(at, 1)
    if shape == "circle":
        r = round(size, 1)
        columns = np.column_stack((at[:, 0] - r, at[:, 1]))
        one = "M%.10g %.10g" + f"a{r:g} {r:g} 0 1 0 {2 * r:g} 0a{r:g} {r:g} 0 1 0 {-2 * r:g} 0z"
        return _written(one, columns)
    corners, closed = _outline(shape)
    places = at[:, None] + size * corners
    if closed:
        return polygons(places)
    ends = places.reshape(-1, 2, 2)
    return segments(ends[:, 0], ends[:, 1])
