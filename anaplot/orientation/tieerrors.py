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

import numpy as np

from anaplot.aliases import Array
from anaplot.errors import NotComputableError
from anaplot.orientation.conditionequations import ConditionEquations, ModelUnknowns
from anaplot.orientation.pair import Stereopair, TieErrors
from anaplot.photogrammetry.block import TieVariance

__all__ = [
    "ExactStatistics",
    "exact_statistics",
    "misclosure_covariance",
    "moved_by_errors",
    "point_cofactors",
    "residual_weight",
    "stationary_errors",
]


@dataclass(frozen=True, slots=True, eq=False)
class ExactStatistics:
    """What is known of a model's rows when the ties' errors count as they are.

    Attributes
    ----------
    misclosures
        (n, n) Sigma_F, covariance of the misclosures.
    influence
        (n, n) R = Q_vv P, what an error in each row does to every parallax.
    residuals
        (n, n) S = R Sigma_F R', covariance of the residuals.
    weight
        (n, n) W = Sigma_F^-1 - Sigma_F^-1 B (B' Sigma_F^-1 B)^-1 B' Sigma_F^-1, of rank f: a
        generalized inverse of S, v'W v = v'S+ v, and the cofactors of W F.
    unknowns
        (u, u) covariance of the unknowns.
    effects
        (n,) how far an error of one a-priori sigma0 in a row moves the unknowns, at most, in
        standard deviations of a function of them.
    ties
        What the model's points bring to the next model.
    points
        (n, 3, 3) covariance of each point in the model's system.
    """

    misclosures: Array = field(repr=False)
    influence: Array = field(repr=False)
    residuals: Array = field(repr=False)
    weight: Array = field(repr=False)
    unknowns: Array = field(repr=False)
    effects: Array = field(repr=False)
    ties: TieErrors = field(repr=False)
    points: Array = field(repr=False)


def exact_statistics(
    pair: Stereopair,
    conditions: ConditionEquations,
    state: ModelUnknowns,
    design: Array,
    q_vv: Array,
) -> ExactStatistics:
    """Return the statistics of a model's rows with the errors of its ties.

    Parameters
    ----------
    pair, conditions
        The measurements and their conditions.
    state
        The converged unknowns.
    design
        (n, u) derivatives of the rows with respect to the unknowns, image units.
    q_vv
        (n, n) cofactors of the residuals by the weights of the solution.

    Raises
    ------
    ValueError
        The preceding model brings no covariance of its points.
    """
    q_l = conditions.cofactors(state.bx)
    rows = _RowDerivatives(pair, conditions, state)
    sigma = rows.covariance()
    influence = q_vv / q_l
    gain = np.linalg.pinv(design / np.sqrt(q_l)[:, None]) / np.sqrt(q_l)
    unknowns = gain @ sigma @ gain.T
    # columns of unknowns of different units would make the factor's pivots meaningless
    scale = np.sqrt(np.einsum("ii->i", unknowns))
    root = np.linalg.cholesky(unknowns / scale[:, None] / scale)
    effects = np.linalg.norm(np.linalg.solve(root, gain / scale[:, None]), axis=0)
    return ExactStatistics(
        sigma,
        influence,
        influence @ sigma @ influence.T,
        residual_weight(sigma, design),
        unknowns,
        effects,
        rows.carried(sigma),
        rows.points(sigma),
    )


def point_cofactors(
    pair: Stereopair, conditions: ConditionEquations, state: ModelUnknowns
) -> Array:
    """Return (n, 3, 3) cofactors of each point in the model's system, its ties free of error.

    The left photo is held, and in a first model the base: what is left are the errors of the
    image coordinates measured here, directly and by way of the orientation.
    """
    tied = tuple(pair.points[k] for k in conditions.x_index)
    m = len(tied)
    free = TieErrors(tied, np.zeros((3 * m, 3 * m)), np.zeros((3 * m, 2 * m)))
    rows = _RowDerivatives(replace(pair, tie_errors=free), conditions, state)
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
    return _RowDerivatives(pair, conditions, state).covariance()


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
    _, turned, gain = rows.moves()
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


def moved_by_errors(
    pair: Stereopair, tie_variance: TieVariance, state: ModelUnknowns, rays: Array, ties: Array
) -> tuple[Array, Array]:
    """Say how errors move a model, to first order: its points and its unknowns.

    Parameters
    ----------
    pair, tie_variance
        The measurements, and the weights with which they were adjusted.
    state
        The converged unknowns.
    rays
        (n, 4, e) what each of e errors does to a point's xl, yl, xr, yr [mm].
    ties
        (n, 3, e) what it does to the points as ties, seen from the left photo [mm]; any where a
        point is none.

    Returns
    -------
    ndarray
        (n, 3, e) its effect on the points as seen from the right photo [mm].
    ndarray
        (6, e) on the unknowns: ln bx (0 in a first model), beta_y, beta_z, three turns about the
        strip's axes.
    """
    conditions = ConditionEquations(pair, tie_variance)
    tied = tuple(pair.points[k] for k in conditions.x_index)
    known = TieErrors(
        tied, np.zeros((3 * len(tied), 3 * len(tied))), np.zeros((3 * len(tied), 2 * len(tied)))
    )
    rows = _RowDerivatives(replace(pair, tie_errors=known), conditions, state)
    direct, turned, gain = rows.moves()
    unknowns = np.zeros((6, rays.shape[2]))
    used = conditions.unknown_rows()
    unknowns[used] = -gain @ rows.misclosures(rays, ties[conditions.x_index])
    points = np.einsum("kac,kce->kae", direct, rays)
    points += (turned @ unknowns[used]).reshape(points.shape)
    return points, unknowns


def residual_weight(sigma: Array, design: Array) -> Array:
    """Return W = Sigma^-1 - Sigma^-1 B (B' Sigma^-1 B)^-1 B' Sigma^-1, (n, n) of rank n - u."""
    root = np.linalg.cholesky(sigma)
    whitener = np.linalg.solve(root, np.eye(len(sigma)))
    white = whitener @ design
    q, _ = np.linalg.qr(white / np.linalg.norm(white, axis=0))
    left = whitener - q @ (q.T @ whitener)
    return np.asarray(left.T @ left)


class _RowDerivatives:
    """A model's rows and points with their derivatives by what was measured, at a state."""

    def __init__(
        self, pair: Stereopair, conditions: ConditionEquations, state: ModelUnknowns
    ) -> None:
        self._pair, self._conditions, self._state = pair, conditions, state
        y, x = conditions.y_index, conditions.x_index
        self._point = np.array([*y, *x], dtype=np.intp)
        self._ties = slice(len(y), len(y) + len(x))
        n, m = len(pair.points), len(x)
        with np.errstate(all="ignore"):
            image, self._by_tie = _misclosure_derivatives(pair, conditions, state)
        # (rows, n, 4): every row by every point's xl, yl, xr, yr
        self._by_image = np.zeros((len(self._point), n, 4))
        self._by_image[np.arange(len(self._point)), self._point] = image
        self._c = np.zeros((m, 3, m, 3))
        self._d = np.zeros((m, 3, n, 2))  # ties with left coordinates
        if m:
            self._take(pair)

    def _take(self, pair: Stereopair) -> None:
        """Take C of the ties that have rows, and D of the left rays that were there before."""
        known = pair.tie_errors
        if known is None:
            raise ValueError(f"model {pair.name}: its ties come without their covariance")
        at = {name: k for k, name in enumerate(known.points)}
        ties = np.array([at[pair.points[k]] for k in self._conditions.x_index], dtype=np.intp)
        count = len(known.points)
        c = known.covariance.reshape(count, 3, count, 3)
        self._c = c[ties][:, :, ties]
        again = [k for k, name in enumerate(pair.points) if name in pair.once and name in at]
        before = [at[pair.points[k]] for k in again]
        d = known.with_right.reshape(count, 3, count, 2)
        self._d[:, :, again] = d[ties][:, :, before]

    def covariance(self) -> Array:
        """Return Sigma_F (rows, rows)."""
        flat = self._by_image.reshape(len(self._point), -1)
        out: Array = flat @ flat.T
        ties = self._ties
        by = self._by_tie
        out[ties, ties] += np.einsum("ia,iajb,jb->ij", by, self._c, by)
        both = np.einsum("rkc,iakc,ia->ri", self._by_image[:, :, :2], self._d, by)
        out[:, ties] += both
        out[ties] += both.T
        return 0.5 * (out + out.T)

    def carried(self, sigma: Array) -> TieErrors:
        """Return covariance of the points as seen from the right photo, and with its rays."""
        names, n = self._pair.points, len(self._pair.points)
        direct, turned, gain = self.moves()
        with np.errstate(invalid="ignore"):
            mixed = self._common(direct).reshape(3 * n, -1) @ gain.T @ turned.T
            covariance = turned @ (gain @ sigma @ gain.T) @ turned.T - mixed - mixed.T
            each = np.arange(n)
            covariance.reshape(n, 3, n, 3)[each, :, each] += direct @ direct.transpose(0, 2, 1)
            by_right = self._by_image[:, :, 2:].reshape(len(self._point), -1)
            with_right = -turned @ (gain @ by_right)
            with_right.reshape(n, 3, n, 2)[each, :, each] += direct[:, :, 2:]
        return TieErrors(names, covariance, with_right)

    def misclosures(self, rays: Array, ties: Array) -> Array:
        """Return (rows, e) of errors in the rays (n, 4, e) and in the ties with rows (m, 3, e)."""
        out: Array = np.einsum("rkc,kce->re", self._by_image, rays)
        out[self._ties] += np.einsum("ia,iae->ie", self._by_tie, ties)
        return out

    def points(self, sigma: Array) -> Array:
        """Return (n, 3, 3) covariance of each point in the model's system."""
        direct, turned, gain = self.moves(from_right=False)
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
        out[:, :, self._ties] += np.einsum(
            "kac,ibkc,ib->kai", direct[:, :, :2], self._d, self._by_tie
        )
        return out

    def moves(self, *, from_right: bool = True) -> tuple[Array, Array, Array]:
        """Say what moves the points, as seen from the right photo or in the model's system.

        Returns
        -------
        ndarray
            (n, 3, 4) derivatives by the point's own image coordinates.
        ndarray
            (3n, u) derivatives by the unknowns.
        ndarray
            (u, rows) G: misclosures dF move the unknowns by -G dF.
        """
        conditions, state = self._conditions, self._state
        used = conditions.unknown_rows()
        weighted = conditions.evaluate(state)[used]
        gain = np.linalg.pinv(weighted.T) / np.sqrt(conditions.cofactors(state.bx))
        with np.errstate(all="ignore"):
            by_all = _point_derivatives(self._pair, conditions, state, from_right=from_right)
        turned = by_all[:, :, 4:][:, :, used].reshape(3 * len(by_all), -1)
        return by_all[:, :, :4], turned, gain

    def gain_of_ties(self, gain: Array) -> Array:
        """Return (u, 3m) G B_t."""
        own = gain[:, self._ties]
        return (own[:, :, None] * self._by_tie).reshape(len(own), -1)


def _misclosure_derivatives(
    pair: Stereopair, conditions: ConditionEquations, state: ModelUnknowns
) -> tuple[Array, Array]:
    """(rows, 4) of F / a by xl, yl, xr, yr of the row's point; (m, 3) by the tie seen from left."""
    left, right = pair.fixed.rotation, state.rotation
    beta = np.array((1.0, state.beta_y, state.beta_z))
    y, x = conditions.y_index, conditions.x_index
    x1, x2 = conditions.x1[:, y], right @ conditions.p2[:, y]
    by_left = left.T @ np.cross(x2, beta[:, None], axis=0)
    by_right = right.T @ np.cross(beta[:, None], x1, axis=0)
    plane = np.concatenate((by_left[:2], by_right[:2])) / -x1[2]
    tie = conditions.tie_points
    dx, dz = tie[0] - state.bx, tie[2] - state.bx * state.beta_z
    x2 = right @ conditions.p2[:, x]
    none = np.zeros(len(x))
    by_right = right.T @ np.array((-dz, none, dx))
    line = np.concatenate((np.zeros((2, len(x))), by_right[:2])) / -dz
    by_tie = left.T @ np.array((x2[2], none, -x2[0])) / -dz
    return np.concatenate((plane, line), axis=1).T, by_tie.T


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
    axes = np.eye(3)[:, None, :]
    d_x2[:, :, 7:] = np.cross(axes, x2[:, :, None], axis=0)
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
    moved[:, :, 7:] -= np.cross(axes, seen[:, :, None], axis=0)
    return np.asarray(np.einsum("ba,bkc->kac", right, moved))
