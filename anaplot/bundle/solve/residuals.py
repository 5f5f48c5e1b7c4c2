"""An adjusted block from the side of its residuals: what a search for gross errors asks of it.

All observations stand in one vector of whitened rows: image coordinates (x and y of every ray),
weighted control, priors of points, of orientations and of additional parameters, conditions
between points. Columns of R come from
the factor of the reduced normal equations, several right-hand sides at once; nothing of the size
of the block is inverted. The state need not be a minimum: e is what one more linear adjustment
would leave.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from anaplot.adjustment.residualsystem import WeightedAdjustments
from anaplot.aliases import Array, Index
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.datum import anchor
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.linearised import Linearised, linearise
from anaplot.bundle.solve.normal import NormalEquations
from anaplot.bundle.solve.observations import ObservationName, Observations, observations_of
from anaplot.bundle.solve.offsetequations import OffsetEquations
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.solve.reliability import Cofactors, compute_cofactors
from anaplot.bundle.solve.reweighted import ReweightedBlock
from anaplot.bundle.solve.structure import Structure

__all__ = [
    "BlockResiduals",
    "NamedRows",
    "block_residuals",
    "designed",
    "residuals_at",
    "residuals_of",
]


_PORTION = 60_000_000  # bytes of the largest array while columns are solved for


class NamedRows:
    """Observations of a block, by their identities."""

    __slots__ = ()

    rows: Observations

    @property
    def names(self) -> Sequence[ObservationName]:
        """Identities of the n rows."""
        return self.rows.names

    @property
    def units(self) -> Sequence[str]:
        """Units of the n rows."""
        return self.rows.units

    @property
    def sigma(self) -> Array:
        """(n,) a-priori standard deviations in the units."""
        return self.rows.sigma


@dataclass(frozen=True, slots=True, eq=False)
class BlockResiduals(NamedRows):
    """A block as a residual system, see `ResidualSystem`.

    Attributes
    ----------
    cofactors
        With the equations they come from; nothing is rejected in them.
    rows
        Which observations they are.
    e, r
        (n,) misclosures left, observed minus computed in a-priori sigmas, and redundancy numbers.
    vtpv, redundancy
        Sum of the squares of e and of a prior that ties unknowns together, which is no row: never
        suspected; observations minus unknowns.
    """

    cofactors: Cofactors = field(repr=False)
    rows: Observations = field(repr=False)
    e: Array = field(repr=False)
    r: Array = field(repr=False)
    vtpv: float
    redundancy: int
    _known: dict[int, Array] = field(default_factory=dict, repr=False)

    @property
    def problem(self) -> Problem:
        """The bundle."""
        return self.cofactors.normal.problem

    @property
    def linear(self) -> Linearised:
        """Derivatives and misclosures of all rows."""
        return self.cofactors.normal.linear

    @property
    def whole(self) -> BlockResiduals:
        """Itself; see `LaterResiduals`."""
        return self

    def columns(self, rows: Index) -> Array:
        """Return (n, k): the columns of R that belong to k rows; each is solved for once."""
        wanted = np.asarray(rows, dtype=np.intp)
        missing = [k for k in dict.fromkeys(wanted.tolist()) if k not in self._known]
        problem = self.problem
        step = max(1, _PORTION // (8 * len(problem.photo) * problem.per_photo))
        for start in range(0, len(missing), step):
            mine = missing[start : start + step]
            for k, column in zip(mine, self._solved(np.array(mine)).T, strict=True):
                self._known[k] = np.ascontiguousarray(column)
        out = np.empty((len(wanted), len(self.e)))
        for at, k in enumerate(wanted.tolist()):
            out[at] = self._known[k]
        return out.T

    def moves(self, rows: Index) -> Array:
        """Return (p, 3, k) what an error of one sigma in each of k rows does to the points [m].

        In the datum of the solution.
        """
        cofactors = self.cofactors
        _, points, _ = cofactors.normal.solve(cofactors.factor, *self._sides(rows))
        update = cofactors.normal.update(cofactors.factor)
        fourth = self.rows.starts[3]
        if update is not None:
            mine = np.flatnonzero(rows >= fourth)
            own = update.equations.contrasts[rows[mine] - fourth]
            points[:, :, mine] += update.points @ (own @ update.inner).T
        return points

    def solved(self, points: Array) -> tuple[Array, Array]:
        """Return what k functions of the points have to do with the points and the rows.

        Parameters
        ----------
        points
            (p, 3, k) gradients of the functions; zeros for coordinates free of error.

        Returns
        -------
        (p, 3, k) and (n, k) arrays
            Their cofactors with the points, and what an error of one sigma in each row changes
            them by; in the datum of the solution.
        """
        normal, factor, k = self.cofactors.normal, self.cofactors.factor, points.shape[2]
        photos = np.zeros((len(self.problem.photos), self.problem.per_photo, k))
        found = normal.solve(factor, photos, points, np.zeros((len(normal.corner), k)))
        rows = designed(self, *found)
        update = normal.update(factor)
        if update is not None:
            # G M^-1 G' has been taken away: what is left of G' by an error of the contrasts
            direct = update.points.reshape(-1, update.inner.shape[0]).T @ points.reshape(-1, k)
            rows[self.rows.starts[3] :] = update.equations.contrasts @ (update.inner @ direct)
        return found[1], rows

    def design(self) -> csr_array | None:
        """Return (n, u) derivatives, each row divided by its sigma: photos, points, shared ones.

        None where a prior that ties unknowns together is none of the rows.
        """
        normal, problem = self.cofactors.normal, self.problem
        if problem.given is not None:
            return None
        linear = normal.linear
        wide = problem.per_photo
        point_start = wide * len(problem.photos)
        shared_start = point_start + 3 * len(problem.points)
        first, second, third, fourth = self.rows.starts
        image = np.arange(first).reshape(-1, 2, 1)
        at: list[tuple[NDArray[Any], NDArray[Any], Array]] = [
            (image, wide * problem.photo[:, None, None] + np.arange(wide), linear.a),
            (image, point_start + 3 * problem.point[:, None, None] + np.arange(3), linear.b),
        ]
        shared = len(normal.corner)
        if shared:
            columns = normal.border_columns(problem.additional_group)
            at.append((image, shared_start + columns[:, None, :], linear.h))
        kind, point, axis = self.rows.ground.T
        held = np.sqrt(linear.point_weight[kind, point, axis])
        at.append((np.arange(first, second), point_start + 3 * point + axis, held))
        photo_of, unknown_of = self.rows.priors.T
        at.append(
            (
                np.arange(second, third)[:, None],
                wide * photo_of[:, None] + np.arange(wide),
                linear.photo_rows[photo_of, unknown_of],
            )
        )
        number = self.rows.additional[: self.rows.first_offset - third]
        if problem.photo_invariant:
            photo, index = np.divmod(number, max(wide - 6, 1))
            column, weight = wide * photo + 6 + index, linear.own_weight[photo, index]
        else:
            column, weight = shared_start + number, linear.shared_weight[number]
        at.append((third + np.arange(len(number)), column, np.sqrt(weight)))
        wide = shared_start + shared
        if linear.offsets is not None:
            laid, k = linear.offsets.laid, len(linear.offsets.laid)
            own = laid.columns[photo_of, :]
            rows_of = linear.offsets.rows[photo_of, unknown_of] * (own < k)
            at.append((np.arange(second, third)[:, None], wide + np.minimum(own, k - 1), rows_of))
            mine = self.rows.offsets
            root = np.sqrt(laid.weight[mine])
            at.append((np.arange(self.rows.first_offset, fourth), wide + mine, root))
            wide += k
        if linear.conditions is not None:
            derivatives = linear.conditions.derivatives.tocoo()
            white = derivatives.data / linear.conditions.sigma[derivatives.row]
            white[self._condition_rejected[derivatives.row]] = 0.0
            at.append((fourth + derivatives.row, point_start + derivatives.col, white))
            spanned = linear.conditions.spanned.tocoo()
            at.append((fourth + spanned.row, wide + spanned.col, spanned.data))
            wide += spanned.shape[1]
        parts = [np.broadcast_arrays(*part) for part in at]
        rows, columns, values = (np.concatenate([p[k].ravel() for p in parts]) for k in range(3))
        return csr_array((values, (rows, columns)), shape=(len(self.names), wide))

    def reweighting(self) -> WeightedAdjustments:
        """Return the adjustments with other weights; see `Reweightable`."""
        return ReweightedBlock(self).misclosures

    def adjusted(self, normal: NormalEquations) -> BlockResiduals:
        """Return the rows with other equations and what one adjustment by these leaves of them.

        At a minimum nothing changes. Redundancy numbers stay what they are.

        Raises
        ------
        NotPositiveError
            Not all unknowns are determined.
        """
        own = normal is self.cofactors.normal
        factor = self.cofactors.factor if own else normal.factor()
        there = replace(
            self, cofactors=replace(self.cofactors, normal=normal, factor=factor), _known={}
        )
        linear = normal.linear
        photos, points, shared = normal.step(factor)
        moved = designed(there, photos[:, :, None], points[:, :, None], shared[:, None])
        left = -(self.rows.gathered(linear, normal.conditions_left(factor)) + moved[:, 0])
        vtpv = float(left @ left)
        if linear.given is not None:
            of_given = linear.given.effect(photos, points).misclosure + linear.given.misclosure
            of_prior = linear.given.prior.root @ of_given
            vtpv += float(of_prior @ of_prior)
        return replace(there, e=left, vtpv=vtpv)

    @property
    def _condition_rejected(self) -> NDArray[Any]:
        conditions = self.problem.conditions
        return np.zeros(0, dtype=bool) if conditions is None else conditions.rejected

    def _solved(self, rows: Index) -> Array:
        cofactors = self.cofactors
        photos, points, shared = self._sides(rows)
        x, p, s = cofactors.normal.solve(cofactors.factor, photos, points, shared)
        out: Array = -designed(self, x, p, s)
        out[rows, np.arange(len(rows))] += 1.0
        if cofactors.normal.linear.offsets is not None:
            out -= self._by_offsets(cofactors.normal.linear.offsets, rows)
        fourth = self.rows.starts[3]
        update = cofactors.normal.update(cofactors.factor)
        if update is None:
            out[fourth:] = 0.0
            return out
        contrasts = update.equations.contrasts
        mine = np.flatnonzero(rows >= fourth)
        # R between the conditions and all other rows
        beside = (contrasts @ (designed(self, *update.gain)[:fourth] @ update.inner).T).T
        out[:fourth, mine] = -beside[:, rows[mine] - fourth]
        others = np.flatnonzero(rows < fourth)
        out[fourth:, others] = -beside[rows[others]].T
        out[fourth:, mine] = update.rows[:, rows[mine] - fourth]
        return out

    def _units(self, rows: Index) -> tuple[Array, Array]:
        """(photos, 6, k), (offsets, k): ones where the photos' priors and the offsets' are k rows.

        Zeros for rows of other kinds.
        """
        problem, k = self.problem, len(rows)
        _, second, third, fourth = self.rows.starts
        offsets = 0 if problem.offsets is None else len(problem.offsets)
        photos, own = np.zeros((len(problem.photos), 6, k)), np.zeros((offsets, k))
        at = _between(rows, second, third)
        photo, unknown = self.rows.priors[rows[at] - second].T
        photos[photo, unknown, at] = 1.0
        at = _between(rows, self.rows.first_offset, fourth)
        own[self.rows.additional[rows[at] - third] - self.rows.parameters, at] = 1.0
        return photos, own

    def _by_offsets(self, equations: OffsetEquations, rows: Index) -> Array:
        """(n, k) columns of D K^-1 D' of the photos' priors: what the offsets take up of errors."""
        photos, own = self._units(rows)
        return self._of_priors(photos, own) - self._of_priors(*equations.projected(photos, own))

    def _of_priors(self, photos: Array, own: Array) -> Array:
        """(n, k) rows of (photos, 6, k) priors and of (offsets, k) of the offsets."""
        out = np.zeros((len(self.names), photos.shape[2]))
        _, second, third, fourth = self.rows.starts
        out[second:third] = photos[tuple(self.rows.priors.T)]
        out[self.rows.first_offset : fourth] = own[self.rows.offsets]
        return out

    def _sides(self, rows: Index) -> tuple[Array, Array, Array]:
        """Rows of the design as right-hand sides: (photos, d, k), (points, 3, k), (g, k).

        Of photos' priors with offsets what is left of the rows without these.
        """
        normal, problem = self.cofactors.normal, self.problem
        linear = normal.linear
        k = len(rows)
        photos = np.zeros((len(problem.photos), problem.per_photo, k))
        points = np.zeros((len(problem.points), 3, k))
        shared = np.zeros((len(normal.corner), k))
        first, second, third, _ = self.rows.starts
        at = _between(rows, 0, first)
        ray, axis = np.divmod(rows[at], 2)
        photos[problem.photo[ray], :, at] = linear.a[ray, axis]
        points[problem.point[ray], :, at] = linear.b[ray, axis]
        if len(shared) and len(at):
            columns = normal.border_columns(problem.additional_group[ray])
            shared[columns, at[:, None]] = linear.h[ray, axis]
        at = _between(rows, first, second)
        kind, point, axis = self.rows.ground[rows[at] - first].T
        points[point, axis, at] = np.sqrt(linear.point_weight[kind, point, axis])
        if linear.offsets is not None:
            left = linear.offsets.projected(*self._units(rows))[0]
            photos += np.einsum("nid,nik->ndk", linear.photo_rows, left)
        else:
            at = _between(rows, second, third)
            photo, unknown = self.rows.priors[rows[at] - second].T
            photos[photo, :, at] = linear.photo_rows[photo, unknown]
        at = _between(rows, third, self.rows.first_offset)
        number = self.rows.additional[rows[at] - third]
        if problem.photo_invariant:
            photo, index = np.divmod(number, problem.per_photo - 6)
            photos[photo, 6 + index, at] = np.sqrt(linear.own_weight[photo, index])
        else:
            shared[number, at] = np.sqrt(linear.shared_weight[number])
        return photos, points, shared


def _between(rows: Index, first: int, end: int) -> Index:
    """Return which of some rows are rows from `first` on and before `end`."""
    return np.flatnonzero((rows >= first) & (rows < end))


def designed(system: BlockResiduals, x: Array, p: Array, s: Array) -> Array:
    """Return (n, k): the design times k solutions of all unknowns; not of conditions."""
    normal, problem = system.cofactors.normal, system.problem
    linear = normal.linear
    k = x.shape[2]
    first, second, third, _ = system.rows.starts
    out = np.zeros((len(system.names), k))
    out[:first] = normal.seen(x, p, s).reshape(first, k)
    kind, point, axis = system.rows.ground.T
    out[first:second] = np.sqrt(linear.point_weight[kind, point, axis])[:, None] * p[point, axis]
    if linear.offsets is not None:
        seen = np.einsum("nid,ndj->nij", linear.photo_rows, x)
        own = np.zeros((len(linear.offsets.e), k))
        out += system._of_priors(*linear.offsets.projected(seen, own))
    else:
        photo, unknown = system.rows.priors.T
        out[second:third] = np.einsum("kd,kdj->kj", linear.photo_rows[photo, unknown], x[photo])
    end = system.rows.first_offset
    number = system.rows.additional[: end - third]
    if problem.photo_invariant:
        photo, index = np.divmod(number, max(problem.per_photo - 6, 1))
        out[third:end] = np.sqrt(linear.own_weight[photo, index])[:, None] * x[photo, 6 + index]
    else:
        out[third:end] = np.sqrt(linear.shared_weight[number])[:, None] * s[number]
    return out


def residuals_of(block: AdjustedBlock) -> BlockResiduals:
    """Return an adjusted block as a residual system; rejected rows are zero in it."""
    tested, rows = block.tested, block.observations
    e = np.where(tested.use, -tested.residual / rows.sigma, 0.0)
    r = np.where(tested.use, tested.r, 0.0)
    return BlockResiduals(block.cofactors, rows, e, r, block.vtpv, block.redundancy)


def block_residuals(
    problem: Problem,
    state: BlockState,
    structure: Structure,
    progress: Callable[[float], None] | None = None,
    linear: Linearised | None = None,
) -> BlockResiduals:
    """See a block from the side of its residuals, linearised anywhere.

    Parameters
    ----------
    problem
        The bundle; nothing is rejected in it but what is off, rows of zeros.
    state
        Where it is linearised: its minimum, or that without some observations.
    structure
        Of the normal equations.
    progress
        Called with the fraction done.
    linear
        Its derivatives and misclosures there, where they are known.

    Raises
    ------
    PointError, NotPositiveError
        Not all unknowns are determined there.
    ValueError
        Image coordinates are rejected.
    """
    if problem.newly_rejected.any():
        raise ValueError("a residual system holds all rows: none may be rejected")
    weights = anchor(problem, state).weights if problem.defect else None
    if linear is None:
        linear = linearise(problem, state)
    normal = NormalEquations(problem, structure, linear, 0.0, weights)
    return residuals_at(compute_cofactors(normal, normal.factor(), progress=progress))


def residuals_at(cofactors: Cofactors) -> BlockResiduals:
    """See a block from the side of its residuals where its cofactors are known.

    Parameters
    ----------
    cofactors
        In the datum of the solution; nothing is rejected in them but what is off.
    """
    normal, problem = cofactors.normal, cofactors.normal.problem
    rows = observations_of(cofactors)
    own = problem.photo_invariant
    held = cofactors.r_own if own else cofactors.r_shared
    r = rows.gather(
        cofactors.r,
        cofactors.r_ground,
        cofactors.r_photo,
        np.clip(held, 0.0, 1.0),
        cofactors.r_conditions,
        None if cofactors.offsets is None else cofactors.offsets.r,
    )
    return BlockResiduals(cofactors, rows, np.zeros(0), r, 0.0, problem.redundancy).adjusted(normal)
