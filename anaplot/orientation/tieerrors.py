"""What a model's ties bring along: the statistics of tie_variance = "exact" (conventions).

Ties are points of the preceding model. Their errors are correlated, for they share the errors of
its orientation, and with them those of all models before. To first order a model's misclosures
are F = B_l l + B_t t, l the errors of the image coordinates measured in it and t those of the ties
as seen from its left photo; by the normal equations they move the unknowns, and these, with l, the
model's own points as seen from its right photo, the left one of the next model.

Seen so, from the photo that the next model holds, neither its place nor its rotation has an error,
and the conditions do not ask for them: where rays and ties agree they are free of the choice of
axes. All covariances are in units of sigma0^2; every image coordinate has the standard deviation
sigma0, which makes the cofactors of y rows 2, as the weights have them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from anaplot.adjustment import lapack
from anaplot.adjustment.correlatedrows import correlated_units, whitener
from anaplot.adjustment.leastsquares import Adjustment, MadeAgain
from anaplot.aliases import Array, Index
from anaplot.errors import NotComputableError
from anaplot.orientation.conditionequations import ConditionEquations, ModelUnknowns
from anaplot.orientation.pair import Stereopair, TieErrors
from anaplot.orientation.solver import ConvergedOrientation
from anaplot.photogrammetry.block import TieVariance
from anaplot.photogrammetry.conditions import misclosure_coefficients
from anaplot.photogrammetry.similarity import similarity_effects

__all__ = [
    "ExactStatistics",
    "MovedModel",
    "exact_statistics",
    "misclosure_covariance",
    "moved_by_errors",
    "point_cofactors",
    "stationary_errors",
]


@dataclass(frozen=True, eq=False)
class ExactStatistics(MadeAgain):
    """What is known of a model's rows when the ties' errors count as they are.

    Attributes
    ----------
    adjusted
        The rows, adjusted by the weights of the solution.
    weighted
        (n, n) covariance of the weighted misclosures, P^1/2 Sigma_F P^1/2.
    left
        (n, n) what it leaves in the weighted residuals, P^1/2 S P^1/2.
    along
        (u, u) covariance of the steps along the columns of the adjustment's basis.
    across
        (n - u, n - u) covariance of what is left, along the columns of its complement.
    vtpv
        v'S+ v.
    effects
        (n,) how far an error of one a-priori standard deviation of a row moves the unknowns, at
        most, in standard deviations of a function of them.
    rows
        The rows with their derivatives.
    """

    adjusted: Adjustment = field(repr=False)
    weighted: Array = field(repr=False)
    left: Array = field(repr=False)
    along: Array = field(repr=False)
    across: Array = field(repr=False)
    vtpv: float
    effects: Array = field(repr=False)
    rows: _RowDerivatives = field(repr=False)

    @cached_property
    def misclosures(self) -> Array:
        """(n, n) Sigma_F, covariance of the misclosures, image units."""
        return _image_units(self.weighted, self.adjusted.root)

    @cached_property
    def residuals(self) -> Array:
        """(n, n) S = R Sigma_F R', covariance of the residuals, R = Q_vv P, image units."""
        return _image_units(self.left, self.adjusted.root)

    @cached_property
    def unknowns(self) -> Array:
        """(u, u) covariance of the unknowns."""
        return np.asarray(self.adjusted.back.dot(self.along).dot(self.adjusted.back.T))

    @cached_property
    def weight(self) -> Array:
        """(n, n) W = Sigma_F^-1 - Sigma_F^-1 B (B' Sigma_F^-1 B)^-1 B' Sigma_F^-1, of rank f.

        A generalized inverse of S, v'W v = v'S+ v, and the cofactors of W F. As B' annuls W and S
        is V Z V' in weighted units, W is V Z^-1 V' in these.
        """
        if not len(self.across):
            return np.zeros_like(self.weighted)
        complement = self.adjusted.complement / self.adjusted.root[:, None]
        left = whitener(self.across).dot(complement.T)
        return np.asarray(left.T.dot(left))

    @cached_property
    def units(self) -> Array:
        """(n,) standard deviations of the rows, each given all others: `correlated_units`."""
        return self.adjusted.root * correlated_units(self.weighted)

    @cached_property
    def ties(self) -> TieErrors:
        """What the model's points bring to the next model."""
        return self.rows.carried(self.weighted)

    @cached_property
    def points(self) -> Array:
        """(n, 3, 3) covariance of each point in the model's system."""
        return self.rows.points(self.weighted)


def exact_statistics(
    pair: Stereopair,
    conditions: ConditionEquations,
    solution: ConvergedOrientation,
    adjusted: Adjustment,
) -> ExactStatistics:
    """Return the statistics of a model's rows with the errors of its ties.

    Parameters
    ----------
    pair, conditions
        The measurements and their conditions.
    solution
        The converged unknowns, and the coefficients of the conditions.
    adjusted
        Its rows, adjusted by the weights of the solution, with all columns.

    Raises
    ------
    ValueError
        The preceding model brings no covariance of its points.

    Notes
    -----
    With U the basis of the weighted design, V its complement and Sigma the covariance of the
    weighted misclosures, the unknowns have the covariance T = U' Sigma U along U, and an error in
    row i moves them by row i of U. What is left has the covariance Z = V' Sigma V along V, and so
    S = V Z V'. The residuals v lie along the first column of V, all of them: v'S+ v = v'v over the
    variance of this component given all others.
    """
    between = solution.coefficients[6].reshape(6, 3)
    rows = _RowDerivatives(pair, conditions, solution.state, between)
    sigma, complete, u = rows.covariance(), adjusted.columns, len(adjusted.unknowns)
    basis, complement = complete[:, :u], complete[:, u:]
    turned = complete.T.dot(sigma).dot(complete)
    along, across = turned[:u, :u], turned[u:, u:]
    _, moved, failed = lapack.dposv(along, basis.T)
    vtpv = 0.0
    if len(across) and not failed:
        # in a triangular factor the last is what is given all others: hence the order turned round
        triangle, failed = lapack.dpotrf(across[::-1, ::-1])
        vtpv = adjusted.vtpv / float(triangle[-1, -1]) ** 2
    if failed:
        raise np.linalg.LinAlgError("Matrix is not positive definite")
    return ExactStatistics(
        adjusted=adjusted,
        weighted=sigma,
        left=complement.dot(across).dot(complement.T),
        along=along,
        across=across,
        vtpv=vtpv,
        effects=np.sqrt(basis.dot(moved).diagonal()),
        rows=rows,
    )


def _image_units(weighted: Array, root: Array) -> Array:
    """(n, n) covariance of rows of which that of the weighted ones is known."""
    return weighted * (root[:, None] * root)


def point_cofactors(
    pair: Stereopair, conditions: ConditionEquations, state: ModelUnknowns
) -> Array:
    """Return (n, 3, 3) cofactors of each point in the model's system, its ties free of error.

    The left photo is held, and in a first model the base: what is left are the errors of the
    image coordinates measured here, directly and by way of the orientation.
    """
    rows = _RowDerivatives(_with_free_ties(pair, conditions), conditions, state)
    return rows.points(rows.covariance())


def misclosure_covariance(
    pair: Stereopair, conditions: ConditionEquations, state: ModelUnknowns
) -> Array:
    """Return Sigma_F (n, n) = B_l B_l' + B_t C B_t' of a model's rows at a state.

    Raises
    ------
    ValueError
        The preceding model brings no covariance of its points.
    """
    with np.errstate(all="ignore"):
        weighted = _RowDerivatives(pair, conditions, state).covariance()
    return _image_units(weighted, np.sqrt(conditions.cofactors(state.bx)))


def stationary_errors(
    model: Stereopair, state: ModelUnknowns, onward: Mapping[str, str]
) -> TieErrors:
    """Return how ties err far along a strip of equal models, every photo measured anew in each.

    Parameters
    ----------
    model, state
        Any model of the strip, and its unknowns.
    onward
        For each of its ties, the point of it that is this tie in the next model.

    Raises
    ------
    NotComputableError
        The errors grow from model to model.

    Notes
    -----
    Ties reach the next model through the unknowns alone: with C = Q + M Z M' for the points, Q
    what they would have with ties free of error, the covariance Z of what ties do to the unknowns
    is Z = K C K' with K = G B_t. The scale of the strip has no stationary state, as every model
    adds to its errors. No residual knows of it either, so that the ties are taken at their best
    scale, by H = I - t t' / t't: Z = K H Q H' K' + (K H M) Z (K H M)'.
    """
    conditions = ConditionEquations(model, "exact")
    tied = tuple(model.points[k] for k in conditions.x_index)
    at = [model.points.index(onward[name]) for name in tied]
    index = (3 * np.array(at)[:, None] + np.arange(3)).ravel()
    count = len(index)
    none = TieErrors(tied, np.zeros((count, count)), np.zeros((count, 2 * len(tied))))
    rows = _RowDerivatives(replace(model, tie_errors=none), conditions, state)
    _, turned, gain = rows.from_right
    own = rows.carried(rows.covariance()).covariance[np.ix_(index, index)]
    t = (conditions.tie_points.T @ model.fixed.rotation).ravel()
    level = np.eye(count) - np.outer(t, t) / (t @ t)
    ties = rows.gain_of_ties(gain)
    moved = level @ turned[index]
    again = ties @ moved
    if not np.abs(np.linalg.eigvals(again)).max() < 1.0 - 1e-9:
        raise NotComputableError(
            f"model {model.name}: in a strip of such models errors grow without end"
        )
    own = level @ own @ level
    u = len(again)
    alone = ties @ own @ ties.T
    z = np.linalg.solve(np.eye(u * u) - np.kron(again, again), alone.ravel()).reshape(u, u)
    return TieErrors(tied, own + moved @ (0.5 * (z + z.T)) @ moved.T, none.with_right)


class MovedModel(NamedTuple):
    """How e independent errors move a model, to first order.

    The points are those as seen from the right photo. What e errors do to n of them is as much as
    they are long, and is made of what follows where it is asked for.

    Attributes
    ----------
    columns
        (n, 4) which of the errors a point's xl, yl, xr, yr have.
    direct
        (n, 3, 4) derivatives of the points by them.
    turned
        (n, 3, 6) derivatives of the points by the unknowns.
    unknowns
        (6, e) effects on the unknowns: ln bx (0 in a first model), beta_y, beta_z, three turns
        about the strip's axes.
    """

    columns: Index
    direct: Array
    turned: Array
    unknowns: Array

    def points(self, which: Index) -> Array:
        """Return (m, 3, e) effects on some of the points [mm]."""
        return self._effects(which, self.direct[which], self.turned[which], self.unknowns)

    def carried_by(self, rotation: Array, arms: Array, photo: Array) -> Array:
        """Return (n, 3, e) effects on the points in the system in which the right photo errs.

        Parameters
        ----------
        rotation
            (3, 3) from the right photo to that system.
        arms
            (n, 3) from its centre to the points there [mm].
        photo
            (6, e) effects on its centre [mm] and on a turn of it about that system's axes.
        """
        rigid = similarity_effects(arms)[:, :, :6]
        by = np.concatenate((rotation @ self.turned, rigid), axis=2)
        every = np.arange(len(arms))
        moves = np.concatenate((self.unknowns, photo))
        return self._effects(every, rotation @ self.direct, by, moves)

    def _effects(self, which: Index, direct: Array, by: Array, moves: Array) -> Array:
        out = by.reshape(3 * len(which), -1) @ moves
        effects: Array = out.reshape(len(which), 3, -1)
        at = np.arange(len(which))[:, None]
        effects[at, :, self.columns[which]] += direct.transpose(0, 2, 1)
        return effects


def moved_by_errors(
    pair: Stereopair,
    tie_variance: TieVariance,
    state: ModelUnknowns,
    columns: Index,
    count: int,
    ties: Array,
    exact: ExactStatistics | None = None,
) -> MovedModel:
    """Say how errors move a model, to first order.

    Parameters
    ----------
    pair, tie_variance
        The measurements, and the weights with which they were adjusted.
    state
        The converged unknowns.
    columns, count
        (n, 4) which of `count` errors a point's xl, yl, xr, yr [mm] have: each one of its own.
    ties
        (n, 3, e) what the first e errors do to the points as ties, seen from the left photo [mm];
        any where a point is none.
    exact
        The statistics of the model, where it has them: its derivatives are known then.
    """
    rows = _free_rows(pair, tie_variance, state) if exact is None else exact.rows
    conditions = rows.conditions
    direct, by_unknowns, gain = rows.from_right
    n, m, first = len(columns), len(conditions.x_index), ties.shape[2]
    steps = np.zeros((len(gain), count))
    by_ties = ties[conditions.x_index].reshape(3 * m, first)
    steps[:, :first] = -rows.gain_of_ties(gain) @ by_ties
    steps[:, columns] -= rows.gain_of_rays(gain)
    used = conditions.unknown_rows()
    unknowns, turned = np.zeros((6, count)), np.zeros((n, 3, 6))
    unknowns[used] = steps
    turned[:, :, used] = by_unknowns.reshape(n, 3, -1)
    return MovedModel(columns, direct, turned, unknowns)


def _free_rows(
    pair: Stereopair, tie_variance: TieVariance, state: ModelUnknowns
) -> _RowDerivatives:
    """Return a model's rows with ties that have no error."""
    conditions = ConditionEquations(pair, tie_variance)
    return _RowDerivatives(_with_free_ties(pair, conditions), conditions, state)


def _with_free_ties(pair: Stereopair, conditions: ConditionEquations) -> Stereopair:
    tied = tuple(pair.points[k] for k in conditions.x_index)
    m = len(tied)
    return replace(
        pair, tie_errors=TieErrors(tied, np.zeros((3 * m, 3 * m)), np.zeros((3 * m, 2 * m)))
    )


class _RowDerivatives(MadeAgain):
    """A model's weighted rows and its points with their derivatives, at a state.

    The derivatives are those by what was measured: image coordinates and ties.
    """

    def __init__(
        self,
        pair: Stereopair,
        conditions: ConditionEquations,
        state: ModelUnknowns,
        between: Array | None = None,
    ) -> None:
        self._pair, self.conditions, self._state = pair, conditions, state
        n, m = len(conditions.y_index), len(conditions.x_index)
        self._point = conditions.point
        self._ties = slice(n, n + m)
        if between is None:
            between = misclosure_coefficients(*state, conditions.tie_weight(state.bx))
        self._image, self._by_tie = _misclosure_derivatives(pair, conditions, state, between)
        by_ties = np.zeros(((n + m) * m, 3))
        by_ties[n * m :: m + 1] = self._by_tie  # each on the diagonal of the x rows
        self._by_ties = by_ties.reshape(n + m, 3 * m)  # B_t
        self._known: Array | None = None  # C of the ties, (3m, 3m)
        self._shared: Array | None = None  # D of the ties, (m, 3, points, 2); None: all is zero
        if m:
            self._take(pair)

    def _take(self, pair: Stereopair) -> None:
        """Take C of the ties that have rows, and D of the left rays that were there before."""
        known = pair.tie_errors
        if known is None:
            raise ValueError(f"model {pair.name}: its ties come without their covariance")
        names = known.points
        ties, count = list(map(names.index, self.conditions.x_points)), len(names)
        by_points = known.covariance.reshape(count, 3, count, 3)
        of_ties = by_points.take(ties, axis=0).take(ties, axis=2)
        self._known = of_ties.reshape(3 * len(ties), -1)
        again = []
        if pair.once:
            once = pair.once.intersection(names)
            again = [k for k, name in enumerate(pair.points) if name in once]
        if again:
            before = [names.index(pair.points[k]) for k in again]
            d = known.with_right.reshape(count, 3, count, 2)
            self._shared = np.zeros((len(ties), 3, len(pair.points), 2))
            self._shared[:, :, again] = d[ties][:, :, before]

    @cached_property
    def _by_image(self) -> Array:
        """(rows, n, 4) derivatives of every row by every point's xl, yl, xr, yr."""
        out = np.zeros((len(self._point), len(self._pair.points), 4))
        out[np.arange(len(out)), self._point] = self._image
        return out

    def covariance(self) -> Array:
        """Return Sigma_F (rows, rows)."""
        out: Array = self._image.dot(self._image.T)
        # one where two rows are of the same point; arrays of equal shape need not be spread out
        count = len(self._pair.points)
        same = np.zeros((count, count))
        same.reshape(-1)[:: count + 1] = 1.0  # np.eye takes several times as long
        out *= same.take(self._point, axis=0).take(self._point, axis=1)
        if self._known is not None:
            out += self._by_ties.dot(self._known).dot(self._by_ties.T)
        if self._shared is not None:
            ties = self._ties
            image = self._by_image[:, :, :2]
            both = np.einsum("rkc,iakc,ia->ri", image, self._shared, self._by_tie)
            out[:, ties] += both
            out[ties] += both.T
        return out

    def carried(self, sigma: Array) -> TieErrors:
        """Return covariance of the points as seen from the right photo, and with its rays."""
        names, n = self._pair.points, len(self._pair.points)
        direct, turned, gain = self.from_right
        with np.errstate(invalid="ignore"):
            mixed = self._common(direct).reshape(3 * n, -1) @ gain.T @ turned.T
            covariance = turned @ (gain @ sigma @ gain.T) @ turned.T - mixed - mixed.T
            each = np.arange(n)
            covariance.reshape(n, 3, n, 3)[each, :, each] += direct @ direct.transpose(0, 2, 1)
            by_right = self._by_image[:, :, 2:].reshape(len(self._point), -1)
            with_right = -turned @ (gain @ by_right)
            with_right.reshape(n, 3, n, 2)[each, :, each] += direct[:, :, 2:]
        return TieErrors(names, covariance, with_right)

    def points(self, sigma: Array) -> Array:
        """Return (n, 3, 3) covariance of each point in the model's system."""
        direct, turned, gain = self._moves(from_right=False)
        n = len(direct)
        with np.errstate(invalid="ignore"):
            by_rows = turned.reshape(n, 3, -1) @ gain
            mixed = np.einsum("kar,kbr->kab", self._common(direct), by_rows)
            out: Array = np.einsum("kar,rs,kbs->kab", by_rows, sigma, by_rows, optimize=True)
            out += direct @ direct.transpose(0, 2, 1) - mixed - mixed.transpose(0, 2, 1)
        return out

    def _common(self, direct: Array) -> Array:
        """Return (n, 3, rows) what the points and the misclosures have in common."""
        out: Array = np.einsum("kac,rkc->kar", direct, self._by_image)
        if self._shared is not None:
            out[:, :, self._ties] += np.einsum(
                "kac,ibkc,ib->kai", direct[:, :, :2], self._shared, self._by_tie
            )
        return out

    @cached_property
    def from_right(self) -> tuple[Array, Array, Array]:
        """What moves the points as seen from the right photo, as `_moves` has it."""
        return self._moves(from_right=True)

    def _moves(self, *, from_right: bool) -> tuple[Array, Array, Array]:
        """Say what moves the points, as seen from the right photo or in the model's system.

        Returns
        -------
        ndarray
            (n, 3, 4) derivatives by the point's own image coordinates.
        ndarray
            (3n, u) derivatives by the unknowns.
        ndarray
            (u, rows) G: weighted misclosures dF move the unknowns by -G dF.
        """
        conditions, state = self.conditions, self._state
        used = conditions.unknown_rows()
        weighted = conditions.evaluate(state)[used]
        gain = np.asarray(np.linalg.pinv(weighted.T), dtype=np.float64)
        with np.errstate(all="ignore"):
            by_all = _point_derivatives(self._pair, conditions, state, from_right=from_right)
        turned = by_all[:, :, 4:][:, :, used].reshape(3 * len(by_all), -1)
        return by_all[:, :, :4], turned, gain

    def gain_of_ties(self, gain: Array) -> Array:
        """Return (u, 3m) G B_t."""
        return np.asarray(gain @ self._by_ties)

    def gain_of_rays(self, gain: Array) -> Array:
        """Return (u, n, 4) G B_l."""
        _, n, of_point = self._by_image.shape
        by_all = gain @ self._by_image.reshape(-1, n * of_point)
        return np.asarray(by_all.reshape(-1, n, of_point))


def _misclosure_derivatives(
    pair: Stereopair, conditions: ConditionEquations, state: ModelUnknowns, between: Array
) -> tuple[Array, Array]:
    """(rows, 4) by xl, yl, xr, yr of the row's point; (m, 3) by the tie as seen from the left.

    Both conditions are bilinear, F = a . T p'' with the left ray or the tie for a; `between` is T.
    """
    n, fixed, right = len(conditions.y_index), pair.fixed.rotation, conditions.right.T
    depths = conditions.tie_depths(state.bx * state.beta_z)
    by_image = np.zeros((conditions.row_count, 4))
    by_left = right[:n].dot(between[:3].T.dot(fixed[:, :2]))
    by_image[:n, :2] = by_left * _columns(conditions.plane, 2)
    by_image[:, 2:] = by_right = conditions.left.T.dot(between[:, :2])
    by_image[n:, 2:] = by_right[n:] / _columns(depths, 2)
    by_tie: Array = right[n:].dot(between[3:5].T.dot(fixed[::2]))
    return by_image, by_tie / _columns(depths, 3)


def _columns(values: Array, count: int) -> Array:
    """(n, count) columns of equal values, where to spread them out takes longer."""
    return values.repeat(count).reshape(-1, count)


def _point_derivatives(
    pair: Stereopair, conditions: ConditionEquations, state: ModelUnknowns, *, from_right: bool
) -> Array:
    """(n, 3, 10) of the points by xl, yl, xr, yr and the unknowns.

    The points are those in the model's system, or as seen from the right photo.
    The unknowns are those of the conditions: ln bx, beta_y, beta_z and three turns.
    """
    bx, beta_y, beta_z, right = state
    base = bx * np.array((1.0, beta_y, beta_z))
    x1, x2 = conditions.x1, right @ conditions.p2
    n = x1.shape[1]
    d_x1, d_x2 = np.zeros((3, n, 10)), np.zeros((3, n, 10))
    d_x1[:, :, :2] = pair.fixed.rotation[:, None, :2]
    d_x2[:, :, 2:4] = right[:, None, :2]
    d_x2[:, :, 7:] = _by_turns(x2)
    d_base = np.zeros((3, 1, 10))
    d_base[:, 0, 4] = base
    d_base[1, 0, 5] = d_base[2, 0, 6] = bx
    meet = conditions.meet(state)
    along1, along2 = meet.left[:, None], meet.right[:, None]
    # both rays give the same X and Z: two equations for how far along them the point moves
    h = d_base - along1 * d_x1 + along2 * d_x2
    a, b = x1[:, :, None], x2[:, :, None]
    determinant = b[0] * a[2] - a[0] * b[2]
    d_along1 = (b[0] * h[2] - b[2] * h[0]) / determinant
    d_along2 = (a[0] * h[2] - a[2] * h[0]) / determinant
    moved = d_along1 * a + along1 * d_x1
    moved[1] = 0.5 * (moved[1] + (d_base + d_along2 * b + along2 * d_x2)[1])
    if not from_right:
        return np.asarray(moved.transpose(1, 0, 2))
    moved = moved - d_base
    seen = meet.points - base[:, None]
    moved[:, :, 7:] -= _by_turns(seen)
    return np.asarray(np.einsum("ba,bkc->kac", right, moved))


def _by_turns(at: Array) -> Array:
    """Return (3, n, 3): what turns about the three axes do to (3, n) places."""
    return similarity_effects(at.T)[:, :, 3:6].transpose(1, 0, 2)
