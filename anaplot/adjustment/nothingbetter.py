"""Whether rows that are out explain a place better than any others would.

The objective is that of `search`: v'Pv of what is in, and c^2 for every row that is out. Of rows M
that are out, with estimated errors z, and e, R of what they leave, let P of M come back and u other
rows U go instead. With what stays out of M taken out, v'Pv changes by

    min -2 e_U' d_U + d' R' d,    d_P = -z_P,

that is z_P' R'_PP z_P, what P explains, less what U does then. Of lengths no less than a share m is
left by correlations, 1 less the largest sum of others in a row (Gershgorin): U explains at most
sum(w_U^2) / m, and the whole is at least m sum(r z_P^2) less sum(e_U^2 / r) / m. So it is often
plain of all sets that none is better, without a look at them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from anaplot.adjustment.places import Places, inverse_among
from anaplot.adjustment.residualsystem import DenseResiduals
from anaplot.adjustment.significance import TESTABLE
from anaplot.aliases import Array, Bools, Index

__all__ = ["explained", "no_set_better", "nothing_better", "surely_best"]


_SEPARATE = 1e-6  # of their redundancy numbers that two rows leave of each other
_CLEARLY = 1e-6  # of a cost: by so much less it is less however it is computed
_MOST_OUT = 6  # rows of which every part is looked at


def nothing_better(system: DenseResiduals, rows: Sequence[int], critical: float) -> bool:
    """Whether one or two rows explain a place better than others, and than one more or one less.

    Where all that one more could explain is less than its cost. Of more rows nothing is said.
    """
    if len(rows) not in (1, 2):
        return False
    cost = critical**2
    e, r, matrix = system.e, system.r, system.matrix
    good = r >= TESTABLE
    single = np.where(good, e**2 / np.where(good, r, 1.0), 0.0)
    a, b = np.triu_indices(len(e), 1)
    c = matrix[a, b]
    determinant = r[a] * r[b] - c * c
    both = determinant > _SEPARATE * r[a] * r[b]
    a, b, c, determinant = a[both], b[both], c[both], determinant[both]
    pair = (e[a] ** 2 * r[b] - 2.0 * e[a] * e[b] * c + e[b] ** 2 * r[a]) / determinant
    if len(rows) == 1:
        own = single[rows[0]]
        return bool(own >= single.max() and np.max(pair, initial=0.0) - own < cost)
    mine = (a == min(rows)) & (b == max(rows))
    own = float(pair[mine][0]) if mine.any() else 0.0
    if not own >= np.max(pair, initial=0.0) or own - single.max() <= cost:
        return False
    # what a third row explains once two are out
    x = (e[a] * r[b] - e[b] * c) / determinant
    y = (e[b] * r[a] - e[a] * c) / determinant
    left = e - matrix[a] * x[:, None] - matrix[b] * y[:, None]
    of_a, of_b = matrix[a], matrix[b]
    taken = of_a**2 * r[b][:, None] - 2.0 * of_a * of_b * c[:, None] + of_b**2 * r[a][:, None]
    rest = r - taken / determinant[:, None]
    third = rest > _SEPARATE * r
    gain = np.where(third, left**2 / np.where(third, rest, 1.0), 0.0).max(axis=1)
    return bool(np.max(pair + gain) - own < cost)


def surely_best(places: Places, out: Bools, critical: float) -> Bools:
    """Return of which places `nothing_better` is plain, all of them at once.

    Parameters
    ----------
    places
        The places.
    out
        (c, k) rows that explain them.
    critical
        Critical value of w, the square of which every row costs.

    Returns
    -------
    ndarray
        (c,); False also where it is only not plain.
    """
    sure, count = np.zeros(len(out), dtype=bool), out.sum(axis=1)
    for size in (1, 2):
        some = np.flatnonzero(count == size)
        if len(some):
            rows = np.nonzero(out[some])[1].reshape(-1, size)
            sure[some] = _plainly_best(places.e[some], places.matrix[some], rows, critical**2)
    return sure


def _plainly_best(e: Array, matrix: Array, rows: Index, cost: float) -> Bools:
    """(c,) whether (c, q) rows surely explain more, with the costs, than any others up to q + 1.

    The bound is that of the correlations with all rows in, of all that may be out: one for all.
    """
    (count, q), k = rows.shape, e.shape[1]
    each = np.arange(count)[:, None]
    r = np.einsum("cii->ci", matrix)
    live = r > 0.0
    root = np.where(live, 1.0 / np.sqrt(np.where(live, r, 1.0)), 0.0)
    own = matrix[each, rows]
    among = np.take_along_axis(own, rows[:, None], axis=2)
    apart = np.linalg.det(among) > _SEPARATE * np.prod(r[each, rows], axis=1)
    inverse = np.linalg.inv(np.where(apart[:, None, None], among, np.eye(q)))
    error = np.einsum("cij,cj->ci", inverse, e[each, rows])
    left = (e - np.einsum("ci,cik->ck", error, own)) * root
    left[each, rows] = 0.0
    # one more: exactly
    below = (1.0 - _CLEARLY) * cost
    rest = 1.0 - np.einsum("cik,cij,cjk->ck", own, inverse, own) * root**2
    checked = rest > _SEPARATE
    sure = apart & np.all(~live | np.where(checked, left**2 < below * rest, left == 0.0), axis=1)
    back = _sums(np.sort(error**2 * r[each, rows], axis=1))
    most = min(q + 1, k)
    instead = _sums(-np.sort(-(left**2), axis=1)[:, :most])
    beside = min(2 * q, k - 1)
    m = _shares(matrix, live, beside)
    for p in range(1, q + 1):
        for u in range(min(p + 1, most) + 1):
            least = m[:, min(q + u - 1, beside)]
            with np.errstate(divide="ignore", invalid="ignore"):
                gain = least * back[:, p] - instead[:, u] / least
            sure &= (least > 0.0) & (gain > (p - u + _CLEARLY) * cost)
    return np.asarray(sure)


def _sums(values: Array) -> Array:
    """Return the sums of none, the first, the first two, ... along the last axis."""
    none = np.zeros((*values.shape[:-1], 1))
    return np.concatenate((none, np.cumsum(values, axis=-1)), axis=-1)


def no_set_better(system: DenseResiduals, rows: Sequence[int], critical: float) -> bool:
    """Whether surely no other rows, however many, explain a place better than those that are out.

    Parameters
    ----------
    system
        Of the place.
    rows
        Which are out.
    critical
        Critical value of w, the square of which every row costs.
    """
    e, matrix, cost = system.e, system.matrix, critical**2
    q, k = len(rows), len(e)
    if not 0 < q <= _MOST_OUT:
        return False
    back = np.zeros((2**q, k), dtype=bool)
    back[:, rows] = np.arange(2**q)[:, None] >> np.arange(q) & 1
    others, gone = system.r > 0.0, np.zeros_like(back)
    others[list(rows)], gone[:, rows] = False, ~back[:, rows]
    try:
        inverse = inverse_among(np.broadcast_to(matrix, (2**q, k, k)), gone)
    except np.linalg.LinAlgError:
        return False
    error = inverse @ e
    left, whole = e - error @ matrix, matrix - matrix @ inverse @ matrix
    most = explained(np.where(others, left[0], 0.0), whole[0] * np.outer(others, others))
    r = np.einsum("cii->ci", whole)
    if not (r[:, others] > _SEPARATE).all():
        return False
    # so many more than come back what they leave can pay for, at most
    several = int(most / cost + _CLEARLY)
    returned = np.where(back, error[0], 0.0)
    lost = np.einsum("ci,cij,cj->c", returned, whole, returned)
    least = np.einsum("ci,ci->c", returned**2, r)
    apart, together = _shares(whole, others, k), _shares(whole, back | others, k)
    mine = np.where(others, 1.0 / np.where(others, r, 1.0), 0.0)
    instead, beside = (
        _sums(-np.sort(-(part**2) * mine, axis=1))
        for part in (left, np.broadcast_to(left[0], left.shape))
    )
    p = back.sum(axis=1)
    for u in range(min(q + several, int(others.sum())) + 1):
        over = (p - u + _CLEARLY) * cost
        with np.errstate(divide="ignore", invalid="ignore"):
            one, both = apart[:, max(u - 1, 0)], together[np.arange(2**q), np.maximum(p + u - 1, 0)]
            sure = (one > 0.0) & (lost - instead[:, u] / one > over)
            sure |= (both > 0.0) & (both * least - beside[:, u] / both > over)
        if not (sure | (u > p + several) | (p + u == 0)).all():
            return False
    return True


def explained(e: Array, matrix: Array) -> float:
    """Return no less v'Pv than all rows of a place can explain together, of e and R of theirs.

    What nothing checks has nothing to explain but rounding: nor can it be left out.
    """
    size, along = np.linalg.eigh(matrix)
    return float(np.sum((e @ along) ** 2 / np.maximum(size, TESTABLE)))


def _shares(matrix: Array, rows: Bools, most: int) -> Array:
    """(c, most + 1) shares of their lengths that 1, 2, ... of some rows keep beside each other."""
    r = np.einsum("cii->ci", matrix)
    good = rows & (r > 0.0)
    root = np.where(good, 1.0 / np.sqrt(np.where(good, r, 1.0)), 0.0)
    size = np.abs(matrix) * root[:, :, None] * root[:, None, :]
    np.einsum("cii->ci", size)[:] = 0.0
    largest = -np.sort(np.partition(-size, most - 1, axis=2)[:, :, :most], axis=2)
    return np.asarray(1.0 - _sums(largest).max(axis=1))
