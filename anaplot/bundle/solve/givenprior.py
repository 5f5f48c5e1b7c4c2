"""Coordinates that an earlier adjustment leaves, with their full covariance, as a prior.

Which of them a bundle knows, what it is that they weigh, and how that is parted: with W = C0^-1, of
W the part a D, D its diagonal and a the largest factor (but for a half) that leaves W - a D = T'T
positive, goes into the equations of single points and photos; see
`anaplot.bundle.solve.givenequations`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.linalg import solve_triangular

from anaplot.aliases import Array, Bools, Index
from anaplot.errors import InputError
from anaplot.photogrammetry.posterior import CoordinateName, Posterior

__all__ = ["GivenPrior", "Located", "is_regular", "locate"]


_SINGULAR = 1e-13  # eigenvalue of the correlations below which nothing is left but rounding
_SHARE = 0.5  # of the largest a
_BYTES = 1_200_000_000  # of the solutions that the prior's rows bring
_EQUAL = 1e-9  # of a coordinate: values free of error that are the same


@dataclass(frozen=True, eq=False)
class GivenPrior:
    """Given coordinates among the unknowns of a bundle.

    Attributes
    ----------
    names
        Of the q coordinates.
    owner, axis
        (q,) index of their point or photo, and number of the unknown there.
    value
        (q,) [m, rad].
    covariance
        (q, q), regular.
    source
        What messages call it.
    exact
        How many more are free of error, and held so.
    unknown
        How many more the bundle does not have: they are left out of x and C.
    """

    names: tuple[CoordinateName, ...] = field(repr=False)
    owner: Index = field(repr=False)
    axis: Index = field(repr=False)
    value: Array = field(repr=False)
    covariance: Array = field(repr=False)
    source: str
    exact: int
    unknown: int

    def __len__(self) -> int:
        return len(self.names)

    @cached_property
    def of_point(self) -> Bools:
        """(q,) which coordinates are those of points; the others are of photos."""
        return np.array([name.kind == "point" for name in self.names], dtype=bool)

    @cached_property
    def sigma(self) -> Array:
        """(q,) standard deviations [m, rad]."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @cached_property
    def root(self) -> Array:
        """(q, q) U with U'U = W."""
        scaled = self.covariance / self.sigma[:, None] / self.sigma
        lower = np.linalg.cholesky(scaled)
        out: Array = solve_triangular(lower, np.diag(1.0 / self.sigma), lower=True)
        return out

    @cached_property
    def weight(self) -> Array:
        """(q, q) W."""
        out: Array = self.root.T @ self.root
        return out

    @cached_property
    def held(self) -> Array:
        """(q,) a D."""
        diagonal = np.diag(self.weight)
        size = np.sqrt(diagonal)
        least = float(np.linalg.eigvalsh(self.weight / size[:, None] / size)[0])
        return np.asarray(_SHARE * max(least, np.finfo(float).eps) * diagonal)

    @cached_property
    def rest(self) -> Array:
        """(q, q) T."""
        size = np.sqrt(np.diag(self.weight))
        scaled = (self.weight - np.diag(self.held)) / size[:, None] / size
        return np.asarray(np.linalg.cholesky(scaled).T * size)

    def points_given(self, count: int) -> Bools:
        """(points,) which points have a given coordinate."""
        out = np.zeros(count, dtype=bool)
        out[self.owner[self.of_point]] = True
        return out


@dataclass(frozen=True, eq=False)
class Located:
    """Where given coordinates belong.

    Attributes
    ----------
    given
        What is given.
    row, of_point, owner, axis
        (k,) of each that is known: its row in `given`, whether it is of a point, the index of point
        or photo, and the number of the unknown.
    """

    given: Posterior = field(repr=False)
    row: Index
    of_point: Bools
    owner: Index
    axis: Index

    @property
    def exact(self) -> Bools:
        """(k,) which are free of error."""
        return np.asarray(np.diag(self.given.covariance)[self.row] == 0.0)

    def counts(self, points: int, photos: int) -> tuple[Index, Index]:
        """Return (points,) and (photos,) how many coordinates are observed by it."""
        weighted = ~self.exact
        at_points = np.bincount(self.owner[weighted & self.of_point], minlength=points)
        return at_points, np.bincount(self.owner[weighted & ~self.of_point], minlength=photos)

    def hold(self, names: Sequence[str], known: Array, sigma: Array, fixed: Bools) -> None:
        """Put what is free of error among the control that is, and approximate values beside it.

        Parameters
        ----------
        names
            Of the points.
        known, sigma, fixed
            (points, 3) as a `Problem` has them; changed in place.

        Raises
        ------
        InputError
            Control says something else of what is free of error, or that is of a photo.
        """
        given, exact = self.given, self.exact
        photo = np.flatnonzero(exact & ~self.of_point)
        if len(photo):
            name = given.names[int(self.row[photo[0]])]
            raise InputError(
                f"{given.source}: {name.unknown} of photo {name.owner} is free of error: only "
                f"points are held so; leave the photo out (--given-without photo:{name.owner})"
            )
        for k in np.flatnonzero(self.of_point).tolist():
            at, value = (int(self.owner[k]), int(self.axis[k])), float(given.x[self.row[k]])
            if exact[k]:
                same = fixed[at] and abs(known[at] - value) <= _EQUAL * max(abs(value), 1.0)
                if np.isfinite(sigma[at]) or (fixed[at] and not same):
                    said = "has another value" if fixed[at] else "is weighted"
                    raise InputError(
                        f"{given.source}: {'XYZ'[at[1]]} of point {names[at[0]]} is free of error, "
                        f"but {said} in control.csv"
                    )
                known[at], fixed[at] = value, True
            elif not (fixed[at] or np.isfinite(sigma[at])):
                known[at] = value

    def approximate(self, position: Array, position_sigma: Array, at: int) -> None:
        """Put given values in place of approximate positions (at = 0) or rotations (at = 3)."""
        mine = ~self.of_point & (self.axis >= at) & (self.axis < at + 3)
        for photo in np.unique(self.owner[mine]).tolist():
            its = np.flatnonzero(mine & (self.owner == photo))
            if len(its) == 3 and not np.isfinite(position_sigma[photo]).any():
                position[photo, self.axis[its] - at] = self.given.x[self.row[its]]

    def among(self, points: Index, photos: Index, width: int, block: str) -> GivenPrior | None:
        """Return the prior on what is left of points and photos; None where all is exact.

        Parameters
        ----------
        points, photos
            New index of every old one; -1: gone.
        width
            Unknowns of a photo.
        block
            Name of the block, for messages.

        Raises
        ------
        InputError
            None of the coordinates is known, they are too many, or C is singular.
        """
        given = self.given
        # of kinds apart: an index of a point may be none of a photo
        new = np.full(len(self.owner), -1, dtype=np.intp)
        new[self.of_point] = points[self.owner[self.of_point]]
        new[~self.of_point] = photos[self.owner[~self.of_point]]
        there, exact = new >= 0, self.exact
        if not there.any():
            raise InputError(
                f"{given.source}: block {block} knows none of its {len(given.x)} coordinates"
            )
        used = np.flatnonzero(there & ~exact)
        if not len(used):
            return None
        count = 3 * int((points >= 0).sum()) + width * int((photos >= 0).sum())
        if 8 * count * len(used) > _BYTES:
            most = _BYTES // (8 * count)
            raise InputError(
                f"{given.source}: {len(used)} coordinates as a prior of {count} unknowns: at most "
                f"{most} are held in memory; choose fewer with --posterior-of"
            )
        rows = self.row[used]
        covariance = given.covariance[np.ix_(rows, rows)]
        covariance = 0.5 * (covariance + covariance.T)
        names = tuple(given.names[k] for k in rows.tolist())
        _check_regular(given.source, names, covariance)
        return GivenPrior(
            names,
            new[used],
            self.axis[used],
            given.x[rows],
            covariance,
            given.source,
            int((there & exact).sum()),
            len(given.x) - int(there.sum()),
        )


def locate(given: Posterior, points: Sequence[str], photos: Sequence[str]) -> Located:
    """Find the points and photos that are given coordinates of.

    Parameters
    ----------
    given
        What is given.
    points, photos
        Names.
    """
    places = {
        "point": {name: k for k, name in enumerate(points)},
        "photo": {name: k for k, name in enumerate(photos)},
    }
    found = [
        (row, name.kind == "point", places[name.kind][name.owner], name.axis)
        for row, name in enumerate(given.names)
        if name.owner in places[name.kind]
    ]
    table = np.array(found, dtype=np.intp).reshape(-1, 4)
    return Located(given, table[:, 0], table[:, 1] == 1, table[:, 2], table[:, 3])


def is_regular(covariance: Array) -> bool:
    """Return whether every combination of (q,) coordinates has a variance; none is free of error.

    As far as rounding tells: a prior must have one.
    """
    size = np.sqrt(np.diag(covariance))
    scaled = covariance / size[:, None] / size
    scaled[np.diag_indices(len(scaled))] -= _SINGULAR * len(scaled)
    try:
        np.linalg.cholesky(scaled)
    except np.linalg.LinAlgError:
        return False
    return True


def _check_regular(source: str, names: tuple[CoordinateName, ...], covariance: Array) -> None:
    """Raise InputError where a combination of coordinates has no variance, or a negative one."""
    if is_regular(covariance):
        return
    size = np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh(covariance / size[:, None] / size)
    if values[0] < -1e-9 * len(values):
        raise InputError(f"{source}: C is no covariance: a combination has a negative variance")
    share = np.abs(vectors[:, 0])
    some = [names[k].text for k in np.argsort(-share, kind="stable")[:3].tolist()]
    raise InputError(
        f"{source}: C is singular: a combination of coordinates ({', '.join(some)} ...) has no "
        "variance, as by a free datum or by conditions free of error; it can be no prior, but "
        "without some of them (--given-without)"
    )
