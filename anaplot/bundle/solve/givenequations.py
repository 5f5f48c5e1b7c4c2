"""A prior that ties unknowns together, at a state, and what it changes of a solution without it.

With d = x - x0 of the q given coordinates, J their derivatives by the unknowns and W = C0^-1, the
normal equations grow by J'WJ (Bayesian paper, eq. 2), which would tie all given points together.
They stay eliminated one by one: W = a D + T'T (`anaplot.bundle.solve.givenprior`), a D goes into
the equations of the points and photos themselves, and T J is q more rows, an update of their
solution as conditions between points are (`anaplot.bundle.solve.conditionupdate`): with N these
equations, G = N^-1 J'T' and M = I + T J G,

    (N + J'T'T J)^-1 = N^-1 - G M^-1 G'.

So the prior holds what the observations leave open - the datum, points of one ray - from the start.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.sparse import csr_array

from anaplot.aliases import Array, Bools
from anaplot.bundle.solve.givenprior import GivenPrior
from anaplot.bundle.solve.imaging import BlockState
from anaplot.errors import NotComputableError
from anaplot.photogrammetry.rotation import angle_derivatives, rotation_angles, wrapped

__all__ = ["GivenEquations", "GivenUpdate", "given_equations", "prior_rounding"]

_Solutions = tuple[Array, Array, Array]  # of photos (n, d, k), of points (p, 3, k), shared (g, k)


@dataclass(frozen=True, eq=False)
class GivenEquations:
    """A prior at a state.

    Attributes
    ----------
    prior
        Which.
    misclosure
        (q,) d [m, rad].
    photos, points
        (q, n d) and (q, 3 p): J; zeros where a coordinate is free of error in the bundle.
    """

    prior: GivenPrior
    misclosure: Array
    photos: csr_array = field(repr=False)
    points: csr_array = field(repr=False)

    @property
    def e(self) -> Array:
        """(q,) misclosures of unit variance, v'Pv being their sum of squares."""
        out: Array = self.prior.root @ self.misclosure
        return out

    def shown(self, photos: Array, points: Array) -> Array:
        """Return (q, k) J of k changes of photos (n, d, k) and points (p, 3, k)."""
        k = points.shape[2]
        out: Array = self.photos @ photos.reshape(-1, k) + self.points @ points.reshape(-1, k)
        return out

    def sides(self, weights: Array) -> tuple[Array, Array]:
        """Return J' of (q, k) weights: (n d, k) of the photos and (3 p, k) of the points."""
        return self.photos.T @ weights, self.points.T @ weights

    def effect(self, photos: Array, points: Array) -> GivenEquations:
        """Return what changes (n, d) and (p, 3) do, in place of the misclosures."""
        return replace(self, misclosure=self.shown(photos[:, :, None], points[:, :, None])[:, 0])

    def less(self, other: GivenEquations) -> GivenEquations:
        """Return the difference of misclosures."""
        return replace(self, misclosure=self.misclosure - other.misclosure)

    def random(self, rng: np.random.Generator, sigma: float) -> GivenEquations:
        """Return misclosures by chance, `sigma` times as large as the covariance says."""
        q = len(self.misclosure)
        drawn: Array = solve_triangular(self.prior.root, rng.normal(size=q) * sigma, lower=True)
        return replace(self, misclosure=drawn)

    def held_points(self, shape: tuple[int, ...]) -> Array:
        """(p, 3) what a D adds to the points' equations."""
        out: Array = self.points.multiply(self.points).T @ self.prior.held
        return out.reshape(shape)

    def photo_rows(self, width: int) -> Array:
        """(n, 6, d) rows of J, in their photo and by their unknown; zeros without."""
        found = self.photos.tocoo()
        photo, unknown = np.divmod(found.col, width)
        out = np.zeros((self.photos.shape[1] // width, 6, width))
        out[photo, self.prior.axis[found.row], unknown] = found.data
        return out

    def held_photos(self, width: int) -> Array:
        """(n, d, d) what a D adds to the photos' equations."""
        rows = self.photo_rows(width)
        weight = np.zeros(rows.shape[:2])
        prior = self.prior
        mine = ~prior.of_point
        weight[prior.owner[mine], prior.axis[mine]] = prior.held[mine]
        out: Array = np.matmul(rows.transpose(0, 2, 1), weight[:, :, None] * rows)
        return out


@dataclass(frozen=True, eq=False)
class GivenUpdate:
    """What the rows T J change of a solution without them.

    Attributes
    ----------
    equations
        The prior at the state.
    photos, points, shared
        (n, d, q), (p, 3, q), (g, q): G.
    inner
        (q, q) M^-1.
    """

    equations: GivenEquations = field(repr=False)
    photos: Array = field(repr=False)
    points: Array = field(repr=False)
    shared: Array = field(repr=False)
    inner: Array = field(repr=False)

    @classmethod
    def of(cls, equations: GivenEquations, gain: _Solutions) -> GivenUpdate:
        """Return the update by a prior whose G is known."""
        photos, points, shared = gain
        spread = equations.prior.rest @ equations.shown(photos, points)
        matrix = np.eye(len(spread)) + 0.5 * (spread + spread.T)
        try:
            inner = cho_solve(cho_factor(matrix), np.eye(len(spread)))
        except np.linalg.LinAlgError:
            raise NotComputableError(
                f"{equations.prior.source}: its covariance and the observations have nothing in "
                "common that could be computed with"
            ) from None
        return cls(equations, photos, points, shared, 0.5 * (inner + inner.T))

    @property
    def gain(self) -> _Solutions:
        """Of G, the parts of photos, points and shared parameters."""
        return self.photos, self.points, self.shared

    def applied(self, found: _Solutions) -> _Solutions:
        """Return k solutions with the prior, of those without its rows."""
        photos, points, shared = found
        left = self.inner @ (self.equations.prior.rest @ self.equations.shown(photos, points))
        return photos - self.photos @ left, points - self.points @ left, shared - self.shared @ left


def prior_rounding(prior: GivenPrior, state: BlockState) -> float:
    """Return the squared norm of what rounding does to `e`, in units of its fineness."""
    mine, centres = prior.of_point, np.abs(state.centres)
    size = np.full(len(prior), np.pi)
    size[mine] = np.abs(state.points)[prior.owner[mine], prior.axis[mine]]
    placed = ~mine & (prior.axis < 3)
    size[placed] = centres[prior.owner[placed], prior.axis[placed]]
    return float((prior.root**2 @ size**2).sum())


def given_equations(
    prior: GivenPrior, state: BlockState, fixed: Bools, width: int
) -> GivenEquations:
    """Return misclosures and derivatives.

    Parameters
    ----------
    prior
        Of the bundle.
    state
        Where.
    fixed
        (p, 3) coordinates free of error.
    width
        Unknowns of a photo.
    """
    q, mine = len(prior), prior.of_point
    d = np.empty(q)
    origin = np.asarray(state.origin)
    k, axis = prior.owner[mine], prior.axis[mine]
    d[mine] = state.points[k, axis] - (prior.value[mine] - origin[axis])
    free = np.flatnonzero(mine)[~fixed[k, axis]]
    column = 3 * prior.owner[free] + prior.axis[free]
    points = csr_array((np.ones(len(free)), (free, column)), shape=(q, state.points.size))
    row, photo, unknown = np.flatnonzero(~mine), prior.owner[~mine], prior.axis[~mine]
    jacobian = np.zeros((len(row), 6))
    placed = unknown < 3
    at, along = photo[placed], unknown[placed]
    d[row[placed]] = state.centres[at, along] - (prior.value[row[placed]] - origin[along])
    jacobian[np.flatnonzero(placed), along] = 1.0
    for turned in np.unique(photo[~placed]):
        i = np.flatnonzero(~placed & (photo == turned))
        rotation, angle = state.rotations[turned], unknown[i] - 3
        off = np.array(rotation_angles(rotation))[angle] - prior.value[row[i]]
        d[row[i]] = wrapped(off)
        jacobian[i, 3:] = angle_derivatives(rotation)[angle]
    columns = width * photo[:, None] + np.arange(6)
    photos = csr_array(
        (jacobian.ravel(), (row.repeat(6), columns.ravel())),
        shape=(q, width * len(state.centres)),
    )
    return GivenEquations(prior, d, photos, points)
