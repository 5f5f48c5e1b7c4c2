"""Offsets that stated positions and angles share, eliminated from the equations.

A stated position observes X0 + R a + s + d t, with the lever arm a, the shift s and the drift d of
its strip; stated angles are those of R B, with the boresight B. These offsets y stand in no other
observation. With the whitened rows e + A x + D y and K = D'D + W (W: a-priori weights of y), they
are eliminated before anything else,

    y = -K^-1 D'(e + A x),    e~ = (I - D K^-1 D') e,    N~ = N - C K^-1 C',    C = A'D,

so that a state needs no values of them: they are the best ones there. The photos stay apart from
each other in N, and what is missing is an update, as that of conditions between points
(`anaplot.bundle.solve.conditionupdate`), with another sign:

    N~^-1 = N^-1 + G (K - C'G)^-1 G',    G = N^-1 C.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from anaplot.aliases import Array, Index
from anaplot.bundle.solve.laidoffsets import LaidOffsets, OffsetName
from anaplot.errors import NotComputableError
from anaplot.photogrammetry.rotation import (
    rotation_angles,
    rotation_axes,
    rotation_matrix,
    wrapped,
)
from anaplot.textfiles.wording import first_of

__all__ = [
    "OffsetCofactors",
    "OffsetEquations",
    "OffsetUpdate",
    "OffsetsOpenError",
    "best_offsets",
]

_Solutions = tuple[Array, Array, Array]  # of photos (n, d, k), of points (p, 3, k), shared (g, k)

_OPEN = 1e-11  # of its own weight that is left of an offset: rounding
_TURNS = 25  # iterations of the boresight, which is not linear
_STILL = 1e-14  # rad
_GIMBAL = 1e-9  # as `angle_derivatives` has it
_SHARE = 0.3  # of the largest part that an offset has in what is open, to be named


class OffsetsOpenError(NotComputableError):
    """Offsets that the observations leave open.

    Parameters
    ----------
    names
        Which.
    """

    def __init__(self, names: list[OffsetName]) -> None:
        listed = first_of([name.words for name in names], 6)
        super().__init__(
            f"not determined: {listed} of what photos state: nothing else tells it from the "
            "orientations; control must, or a standard deviation of it"
        )


@dataclass(frozen=True, eq=False)
class OffsetEquations:
    """The offsets at a state.

    Attributes
    ----------
    laid
        Which.
    value
        (k,) the best ones there, in their units.
    rows
        (n, 6, 9) D of every photo, whitened, by the nine places of `LaidOffsets.columns`.
    e
        (k,) whitened misclosures of what is known of them beforehand; zeros without.
    """

    laid: LaidOffsets
    value: Array
    rows: Array = field(repr=False)
    e: Array

    @cached_property
    def matrix(self) -> Array:
        """(k, k) K; ones on the diagonal of offsets that nothing is observed of."""
        products = np.matmul(self.rows.transpose(0, 2, 1), self.rows)
        k = len(self.laid)
        columns = self.laid.columns
        at = columns[:, :, None] * (k + 1) + columns[:, None, :]
        whole = np.bincount(at.ravel(), products.ravel(), minlength=(k + 1) ** 2)
        out = np.asarray(whole.reshape(k + 1, k + 1)[:k, :k] + np.diag(self.laid.weight), float)
        dead = ~(np.diag(out) > 0.0)
        out[dead, dead] = 1.0
        return out

    @cached_property
    def inverse(self) -> Array:
        """(k, k) K^-1; raises OffsetsOpenError."""
        size = 1.0 / np.sqrt(np.diag(self.matrix))
        scaled = self.matrix * size[:, None] * size
        try:
            factor = cho_factor(scaled)
        except np.linalg.LinAlgError:
            raise OffsetsOpenError(_weakest(self.laid, scaled)) from None
        if float(np.min(np.abs(np.diag(factor[0])))) ** 2 < _OPEN:
            raise OffsetsOpenError(_weakest(self.laid, scaled))
        found: Array = cho_solve(factor, np.eye(len(size))) * size[:, None] * size
        return 0.5 * (found + found.T)

    def gathered(self, photos: Array) -> Array:
        """Return (k, q) D'x of (n, 6, q) rows of the photos."""
        q = photos.shape[2]
        by_place = np.matmul(self.rows.transpose(0, 2, 1), photos)
        out: Array = self.laid.place @ by_place.reshape(-1, q)
        return out

    def spread(self, offsets: Array) -> Array:
        """Return (n, 6, q) D y of (k, q) offsets."""
        q = offsets.shape[1]
        by_place = (self.laid.place.T @ offsets).reshape(len(self.rows), -1, q)
        return np.asarray(np.matmul(self.rows, by_place))

    def fitted(self, photos: Array, own: Array) -> Array:
        """Return (k, q) the offsets that take up most of misclosures, with the sign turned.

        Parameters
        ----------
        photos, own
            (n, 6, q) of the photos' rows and (k, q) of what is known of the offsets, whitened.
        """
        out: Array = self.inverse @ (
            self.gathered(photos) + np.sqrt(self.laid.weight)[:, None] * own
        )
        return out

    def projected(self, photos: Array, own: Array) -> tuple[Array, Array]:
        """Return what the best offsets leave of misclosures, see `fitted`."""
        best = self.fitted(photos, own)
        return photos - self.spread(best), own - np.sqrt(self.laid.weight)[:, None] * best

    def without(self, photo_e: Array, own: Array) -> tuple[Array, Array]:
        """Return what the best offsets leave of (n, 6) and (k,) misclosures."""
        photos, e = self.projected(photo_e[:, :, None], own[:, None])
        return photos[:, :, 0], e[:, 0]

    def sides(self, photo_rows: Array) -> Array:
        """Return (n, d, k) C, of (n, 6, d) rows A of the photos."""
        n, _, d = photo_rows.shape
        k = len(self.laid)
        out = np.zeros((n, d, k + 1))
        local = np.matmul(photo_rows.transpose(0, 2, 1), self.rows)
        every = np.arange(n)[:, None, None], np.arange(d)[:, None]
        out[(*every, self.laid.columns[:, None, :])] += local
        return out[:, :, :k]

    def boresighted(self, rotations: Array) -> Array:
        """Return (n, 3, 3) the rotations R B whose angles photos state."""
        first = self.laid.columns[:, 6]
        out = np.array(rotations)
        for k in np.unique(first[first < len(self.laid)]).tolist():
            out[first == k] = out[first == k] @ rotation_matrix(*self.value[k : k + 3].tolist())
        return out

    def with_e(self, e: Array) -> OffsetEquations:
        """Return the same with other misclosures of what is known of the offsets."""
        return replace(self, e=e)


def _weakest(laid: LaidOffsets, scaled: Array) -> list[OffsetName]:
    part = np.abs(np.linalg.eigh(scaled)[1][:, 0])
    return [laid.names[k] for k in np.flatnonzero(part > _SHARE * part.max()).tolist()]


def best_offsets(
    laid: LaidOffsets, positions: Array, rotations: Array, stated: Array, prior_sigma: Array
) -> tuple[OffsetEquations, Array]:
    """Return the best offsets at a state, and the misclosures of the photos' rows with them.

    Parameters
    ----------
    laid
        Which offsets.
    positions
        (n, 3) antennas where the state has them minus those stated [m].
    rotations, stated
        (n, 3, 3) image to ground, and (n, 3) stated angles [rad]; NaN without.
    prior_sigma
        (n, 6) standard deviations of what is stated; NaN without.

    Returns
    -------
    OffsetEquations and (n, 6) array
        Whitened.

    Raises
    ------
    OffsetsOpenError
        They are not told apart from each other.
    """
    n = len(rotations)
    known = np.isfinite(prior_sigma)
    weight = np.where(known, 1.0 / np.where(known, prior_sigma, 1.0), 0.0)
    rows, e = np.zeros((n, 6, laid.columns.shape[1])), np.zeros((n, 6))
    rows[:, :3, :6] = laid.linear * weight[:, :3, None]
    e[:, :3] = np.where(known[:, :3], positions, 0.0) * weight[:, :3]
    turned = np.flatnonzero(known[:, 3:].any(axis=1))
    value = np.zeros(len(laid))
    if len(turned):
        value, e[turned, 3:], rows[turned, 3:, 6:] = _boresight(
            laid, laid.columns[turned, 6:], rotations[turned], stated[turned], weight[turned, 3:]
        )
    root = np.sqrt(laid.weight)
    found = OffsetEquations(laid, value, rows, root * value)
    step = found.fitted(e[:, :, None], found.e[:, None])
    value = value - step[:, 0]
    return replace(found, value=value, e=root * value), e - found.spread(step)[:, :, 0]


def _boresight(
    laid: LaidOffsets, columns: Index, rotations: Array, stated: Array, weight: Array
) -> tuple[Array, Array, Array]:
    """Find the boresight, which is not linear.

    Parameters
    ----------
    laid
        The offsets.
    columns
        (t, 3) which of them turn the photos with stated angles.
    rotations, stated, weight
        (t, 3, 3), (t, 3) and (t, 3) of these photos; weights are zero where nothing is stated.

    Returns
    -------
    (k,), (t, 3) and (t, 3, 3) arrays
        The offsets, zeros but for the boresight; misclosures with it, and their derivatives by it.
    """
    count = len(laid)
    value = np.zeros(count + 1)
    groups = np.unique(columns[columns[:, 0] < count, 0]).tolist()
    e, rows = np.zeros(stated.shape), np.zeros(rotations.shape)
    for _ in range(_TURNS):
        seen, axes = rotations.copy(), np.zeros(rotations.shape)
        for first in groups:
            its = columns[:, 0] == first
            b = value[first : first + 3]
            seen[its] = rotations[its] @ rotation_matrix(*b.tolist())
            axes[its] = rotations[its] @ rotation_axes(*b[:2].tolist())
        found = np.array([rotation_angles(one) for one in seen])
        e = np.where(weight > 0.0, wrapped(found - stated), 0.0) * weight
        turns = np.array([rotation_axes(*angles) for angles in found[:, :2].tolist()])
        rows = np.linalg.pinv(turns, rcond=_GIMBAL) @ axes * weight[:, :, None]
        largest = 0.0
        for first in groups:
            its = columns[:, 0] == first
            mine = slice(first, first + 3)
            d = rows[its].reshape(-1, 3)
            right = d.T @ e[its].ravel() + laid.weight[mine] * value[mine]
            matrix = d.T @ d + np.diag(laid.weight[mine])
            step = np.linalg.lstsq(matrix, right, rcond=None)[0]
            largest = max(largest, float(np.abs(step).max()))
            if largest >= _STILL:
                value[mine] -= step
        if largest < _STILL:
            break
    return value[:count], e, rows


@dataclass(frozen=True, eq=False)
class OffsetUpdate:
    """What eliminated offsets change of a solution in which they are held.

    Attributes
    ----------
    equations
        The offsets at the state.
    sides
        (n, d, k) C.
    photos, points, shared
        (n, d, k), (p, 3, k), (g, k): G.
    inner
        (k, k) -(K - C'G)^-1, so that G inner G' goes off the inverse as in other updates.
    """

    equations: OffsetEquations = field(repr=False)
    sides: Array = field(repr=False)
    photos: Array = field(repr=False)
    points: Array = field(repr=False)
    shared: Array = field(repr=False)
    inner: Array = field(repr=False)

    @classmethod
    def of(cls, equations: OffsetEquations, sides: Array, gain: _Solutions) -> OffsetUpdate:
        """Return the update by offsets whose G is known.

        Raises
        ------
        OffsetsOpenError
            The orientations leave some of them open.
        """
        photos, points, shared = gain
        matrix = equations.matrix
        left = matrix - np.tensordot(sides, photos, ((0, 1), (0, 1)))
        size = 1.0 / np.sqrt(np.diag(matrix))
        scaled = 0.5 * (left + left.T) * size[:, None] * size
        if not float(np.linalg.eigvalsh(scaled)[0]) > _OPEN:
            raise OffsetsOpenError(_weakest(equations.laid, scaled))
        inner = -cho_solve(cho_factor(scaled), np.eye(len(size))) * size[:, None] * size
        return cls(equations, sides, photos, points, shared, 0.5 * (inner + inner.T))

    @property
    def gain(self) -> _Solutions:
        """Of G, the parts of photos, points and shared parameters."""
        return self.photos, self.points, self.shared

    def applied(self, found: _Solutions) -> _Solutions:
        """Return k solutions with free offsets, of those in which they are held."""
        photos, points, shared = found
        left = self.inner @ np.tensordot(self.sides, photos, ((0, 1), (0, 1)))
        return photos - self.photos @ left, points - self.points @ left, shared - self.shared @ left


class OffsetCofactors(NamedTuple):
    """Cofactors of offsets, with the a-priori variances.

    Attributes
    ----------
    own
        (k, k) with each other.
    photos
        (n, d, k) of the photos with them.
    r
        (k,) redundancy numbers of what is known of them beforehand; NaN where they are free.
    """

    own: Array
    photos: Array
    r: Array

    @classmethod
    def of(cls, update: OffsetUpdate, later: Iterable[tuple[Array, Array]] = ()) -> OffsetCofactors:
        """Return them from what free offsets change, and what other updates take off after them.

        Not from the inverse with free offsets: where stated positions differ much in weight, that
        has lost them.

        Parameters
        ----------
        update
            That of the offsets.
        later
            Of other updates the (n, d, q) of the photos in G, and (q, q) M^-1.
        """
        equations = update.equations
        own, photos = -update.inner, update.photos @ update.inner
        for gain, inner in later:
            beside = -equations.inverse @ np.tensordot(update.sides, gain, ((0, 1), (0, 1)))
            own = own - beside @ inner @ beside.T
            photos = photos - gain @ (inner @ beside.T)
        laid = equations.laid
        r = np.where(laid.weighted, np.clip(1.0 - np.diag(own) * laid.weight, 0.0, 1.0), np.nan)
        return cls(0.5 * (own + own.T), photos, r)

    def of_rows(self, equations: OffsetEquations, photo_rows: Array) -> Array:
        """Return (n, 6) what the offsets add to the cofactors of the photos' adjusted rows."""
        columns, k = equations.laid.columns, len(equations.laid)
        there = columns < k
        at = np.where(there, columns, 0)
        rows = equations.rows * there[:, None, :]
        n, d = self.photos.shape[:2]
        every = np.arange(n)[:, None, None], np.arange(d)[:, None]
        beside = self.photos[(*every, at[:, None, :])]
        own = self.own[at[:, :, None], at[:, None, :]]
        out: Array = 2.0 * np.einsum("nid,ndj,nij->ni", photo_rows, beside, rows)
        out += np.einsum("nij,njk,nik->ni", rows, own, rows)
        return out
