"""How accurate places are, and differences of places: error ellipses, heights, distances."""

from __future__ import annotations

from itertools import combinations
from typing import Literal, NamedTuple

import numpy as np

from anaplot.aliases import Array
from anaplot.bundle.solve.covariances import Covariance
from anaplot.photogrammetry.posterior import CoordinateName

__all__ = [
    "Ellipse",
    "PairAccuracy",
    "Place",
    "PlaceAccuracy",
    "error_ellipse",
    "error_ellipses",
    "pair_accuracies",
    "place_accuracies",
]

_Three = tuple[float, float, float]


class Ellipse(NamedTuple):
    """A standard ellipse in plan; two coordinates lie in it with the probability .39.

    Attributes
    ----------
    a, b
        Semi-axes [m], a the larger.
    direction
        Of the larger one, from X towards Y [rad], in (-pi/2, pi/2].
    """

    a: float
    b: float
    direction: float


class Place(NamedTuple):
    """A point, or the projection centre of a photo."""

    kind: Literal["point", "photo"]
    name: str


class PlaceAccuracy(NamedTuple):
    """Standard deviations of a place [m] and its ellipse; NaN where there is no sigma."""

    place: Place
    s: _Three
    ellipse: Ellipse


class PairAccuracy(NamedTuple):
    """Two places beside each other; NaN where there is no sigma.

    Attributes
    ----------
    first, second
        Which.
    difference, s
        Coordinates of the second minus those of the first, and their standard deviations [m].
    distance, s_distance
        Distance in space and its standard deviation [m]; that of places that coincide is NaN.
    ellipse
        The relative ellipse: of the difference in plan.
    """

    first: Place
    second: Place
    difference: _Three
    s: _Three
    distance: float
    s_distance: float
    ellipse: Ellipse


def error_ellipse(covariance: Array) -> Ellipse:
    """Return the standard ellipse of a (2, 2) covariance [m^2]."""
    a, b, direction = error_ellipses(covariance[None])[0].tolist()
    return Ellipse(a, b, direction)


def error_ellipses(covariances: Array) -> Array:
    """Return (n, 3) a, b [m] and direction [rad] of the ellipses of (n, 2, 2) covariances [m^2]."""
    xx, xy, yy = covariances[:, 0, 0], covariances[:, 0, 1], covariances[:, 1, 1]
    half, off = 0.5 * (xx - yy), np.hypot(0.5 * (xx - yy), xy)
    direction = np.where(off > 0.0, 0.5 * np.arctan2(xy, half), off)
    direction = np.where(direction <= -0.5 * np.pi, direction + np.pi, direction)
    # the smaller of two that cancel, by the product of both
    large = 0.5 * (xx + yy) + off
    rest = np.maximum(xx * yy - xy * xy, 0.0)
    small = np.divide(rest, large, out=large.copy(), where=large > 0.0)
    return np.stack([np.sqrt(large), np.sqrt(small), direction], axis=1)


def place_accuracies(covariance: Covariance) -> tuple[PlaceAccuracy, ...]:
    """Return the points and photos all of whose coordinates are in a covariance, in its order."""
    matrix = covariance.matrix
    out = []
    for place, at in _places(covariance).items():
        own = matrix[np.ix_(at, at)]
        out.append(PlaceAccuracy(place, _deviations(own), error_ellipse(own[:2, :2])))
    return tuple(out)


def pair_accuracies(covariance: Covariance) -> tuple[PairAccuracy, ...]:
    """Return every two points and photos all of whose coordinates are in a covariance."""
    matrix, values = covariance.matrix, covariance.values
    out = []
    for (first, a), (second, b) in combinations(_places(covariance).items(), 2):
        both = matrix[np.ix_(a, a)] + matrix[np.ix_(b, b)]
        cross = matrix[np.ix_(a, b)]
        own = both - cross - cross.T
        step = values[b] - values[a]
        length = float(np.linalg.norm(step))
        along = step / length if length > 0.0 else np.full(3, np.nan)
        variance = float(along @ own @ along)
        out.append(
            PairAccuracy(
                first,
                second,
                _triple(step),
                _deviations(own),
                length,
                # what a condition holds has a variance of rounding, of either sign
                float(np.sqrt(0.0 if variance < 0.0 else variance)),
                error_ellipse(own[:2, :2]),
            )
        )
    return tuple(out)


def _places(covariance: Covariance) -> dict[Place, list[int]]:
    """Return where X, Y and Z of the places stand."""
    axes: dict[Place, dict[str, int]] = {}
    for k, name in enumerate(covariance.names):
        if isinstance(name, CoordinateName) and name.axis < 3:
            axes.setdefault(Place(name.kind, name.owner), {})[name.unknown] = k
    return {
        place: [of[axis] for axis in "XYZ"] for place, of in axes.items() if len(of) == len("XYZ")
    }


def _deviations(own: Array) -> _Three:
    diagonal = np.diag(own)
    return _triple(np.sqrt(np.where(diagonal < 0.0, 0.0, diagonal)))


def _triple(values: Array) -> _Three:
    x, y, z = values.tolist()
    return x, y, z
