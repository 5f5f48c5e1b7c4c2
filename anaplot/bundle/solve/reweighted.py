"""A linearised block adjusted with other weights: its own normal equations, formed anew.

With p the factor of a row's weight, the row and its misclosure are multiplied by the root of p.
Conditions between points share parameters and are not weighted row by row: those of reduced weight
are changed from the columns of R of the weighted block, see `adjustment.reweighting`. So is what
belongs to a point or a photo that the reduced weights alone would leave undetermined.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Protocol

import numpy as np

from anaplot.adjustment.residualsystem import ResidualSystem
from anaplot.adjustment.reweighting import weighted_misclosures
from anaplot.aliases import Array, Bools
from anaplot.bundle.solve.factor import NotPositiveError
from anaplot.bundle.solve.linearised import Linearised, effect
from anaplot.bundle.solve.normal import NormalEquations, PointError
from anaplot.bundle.solve.observations import Observations
from anaplot.bundle.solve.reliability import Cofactors

__all__ = ["ReweightedBlock", "WeighedBlock"]


_DIFFERENT, _FEW = 0.1, 20  # weights that differ by so much, and how many of them may
_MOST_STEPS = 8
_FEWEST, _WORTH = 2, 12  # steps of an adjustment near the weights formed; those a factor is worth
_EXACT = 1e-9  # of all misclosures together [sigmas]: change below which an adjustment is exact


class WeighedBlock(ResidualSystem, Protocol):
    """What is asked of a block: its rows, its equations, and to be adjusted by others."""

    @property
    def cofactors(self) -> Cofactors:
        """With the equations and their factor."""
        ...

    @property
    def rows(self) -> Observations:
        """Which observations they are."""
        ...

    def adjusted(self, normal: NormalEquations) -> WeighedBlock:
        """Return the rows with other equations and what one adjustment by these leaves of them."""
        ...


class ReweightedBlock:
    """A linearised block that is adjusted with one set of weights after another.

    Where weights have changed little since the equations were last formed, these precondition
    conjugate gradients on the new ones (Golub and Van Loan, Matrix Computations, 11.5), which cost
    a solution a step instead of a factor.

    Parameters
    ----------
    system
        All rows; e is what its equations leave of the misclosures.
    """

    def __init__(self, system: WeighedBlock) -> None:
        self._system = system
        self._formed: _Formed | None = None

    def misclosures(self, weights: Array) -> Array:
        """Return (n,) misclosures of the adjustment with weights multiplied by factors.

        Parameters
        ----------
        weights
            (n,) factors from 0 to 1; rows of weight zero are zero in the result.
        """
        system, third = self._system, self._system.rows.starts[2]
        row_by_row = np.arange(len(weights)) < third
        if self._formed is not None and (weights[third:] == 1.0).all():
            found = self._formed.gone_on(weights)
            if found is not None:
                return found
        self._formed = None
        while True:
            used = np.where(row_by_row, weights, 1.0)
            try:
                weighted = _weighted(system, used)
            except (PointError, NotPositiveError) as error:
                row_by_row &= ~_next_of(system, error, row_by_row)
                continue
            linear = weighted.cofactors.normal.linear
            if row_by_row[:third].all() and linear.conditions is None and linear.given is None:
                self._formed = _Formed(weighted, used)
            out = weighted_misclosures(weighted, np.where(row_by_row, 1.0, weights))
            out[weights == 0.0] = 0.0
            return _unscaled(out, used)


class _Formed:
    """The equations of one set of weights, and the misclosures where the last adjustment ended."""

    def __init__(self, weighted: WeighedBlock, weights: Array) -> None:
        self._weighted, self._weights = weighted, weights
        linear = weighted.cofactors.normal.linear
        self._left = _joined(linear) + self._effect(linear)
        self._change = np.zeros_like(self._left)
        self._share, self._lost = 0.0, 0

    def gone_on(self, weights: Array) -> Array | None:
        """Return the misclosures with other weights; None where these are too different."""
        weighted, known = self._weighted, self._weights
        rows, linear = weighted.rows, weighted.cofactors.normal.linear
        _, second, third, _ = rows.starts
        different = weights != known
        if linear.offsets is not None and different[second:third].any():
            return None
        if (known[different] == 0.0).any():
            return None
        if int((np.abs(weights - known) > _DIFFERENT).sum()) > _FEW or self._lost > _WORTH:
            return None
        ratio = np.divide(weights, known, out=np.zeros_like(weights), where=known > 0.0)
        image, ground, photo = _by_kind(weighted, ratio)
        factor = np.ones_like(self._left)
        kinds = np.concatenate((image.ravel(), ground.ravel(), photo.ravel()))
        factor[: len(kinds)] = kinds
        # weights that settle change what is left by a steady share of the change before
        left = self._left + self._share * self._change
        along, size = np.zeros_like(left), 1.0
        for step in range(_MOST_STEPS):
            force = factor * left
            effect_of = self._effect(_parted(linear, force))
            square = -float(effect_of @ force)
            if square < _EXACT**2:
                self._went(left + effect_of, step)
                return self._rows()
            along = effect_of + (square / size) * along
            left += (square / float(along @ (factor * along))) * along
            size = square
        return None

    def _went(self, left: Array, steps: int) -> None:
        """Remember where an adjustment ended, and how many steps it took."""
        change, before = left - self._left, self._change
        size = float(before @ before)
        self._share = min(max(float(change @ before) / size, 0.0), 1.0) if size > 0.0 else 0.0
        self._left, self._change = left, change
        self._lost += max(steps - _FEWEST, 0)

    def _effect(self, misclosures: Linearised) -> Array:
        """Return what the step that misclosures ask for changes in them."""
        cofactors = self._weighted.cofactors
        normal = cofactors.normal
        step = normal.step(cofactors.factor, misclosures)
        return _joined(effect(normal.problem, normal.linear, step))

    def _rows(self) -> Array:
        """(n,) misclosures, observed minus computed, in sigmas of the full weights."""
        weighted = self._weighted
        left = _parted(weighted.cofactors.normal.linear, -self._left)
        return _unscaled(weighted.rows.gathered(left), self._weights)


def _joined(linear: Linearised) -> Array:
    return np.concatenate([part.ravel() for part in linear.misclosures])


def _parted(linear: Linearised, misclosures: Array) -> Linearised:
    """Return the same with other misclosures, as `_joined` has them."""
    ends = np.cumsum([part.size for part in linear.misclosures])
    e, point_e, photo_e, own_e, shared_e, *own = (
        part.reshape(like.shape)
        for part, like in zip(np.split(misclosures, ends[:-1]), linear.misclosures, strict=True)
    )
    offsets = linear.offsets if linear.offsets is None else linear.offsets.with_e(own[0])
    return replace(
        linear,
        e=e,
        point_e=point_e,
        photo_e=photo_e,
        own_e=own_e,
        shared_e=shared_e,
        offsets=offsets,
    )


def _unscaled(misclosures: Array, weights: Array) -> Array:
    """Return misclosures of rows multiplied by the roots of weights; zero where these are."""
    out = np.zeros_like(misclosures)
    return np.divide(misclosures, np.sqrt(weights), out=out, where=weights > 0.0)


def _weighted(system: WeighedBlock, weights: Array) -> WeighedBlock:
    """Return the system with other weights."""
    known = system.cofactors.normal
    linear = _scaled(system, np.sqrt(weights))
    return system.adjusted(
        NormalEquations(known.problem, known.structure, linear, 0.0, known.anchor)
    )


def _by_kind(system: WeighedBlock, values: Array) -> tuple[Array, Array, Array]:
    """Return values of the rows as (m, 2), (2, points, 3), (photos, 6); ones where no row is."""
    linear, rows = system.cofactors.normal.linear, system.rows
    first, second, third, _ = rows.starts
    ground, photo = np.ones(linear.point_weight.shape), np.ones(linear.photo_e.shape)
    ground[tuple(rows.ground.T)] = values[first:second]
    photo[tuple(rows.priors.T)] = values[second:third]
    return values[:first].reshape(-1, 2), ground, photo


def _scaled(system: WeighedBlock, root: Array) -> Linearised:
    """Return the derivatives and misclosures with the rows multiplied by (n,) factors."""
    linear = system.cofactors.normal.linear
    image, ground, photo = _by_kind(system, root)
    photo_e, offsets = photo * linear.photo_e, linear.offsets
    if offsets is not None:
        offsets = replace(offsets, rows=offsets.rows * photo[:, :, None])
        photo_e, own = offsets.without(photo_e, offsets.e)
        offsets = offsets.with_e(own)
    return replace(
        linear,
        a=linear.a * image[:, :, None],
        b=linear.b * image[:, :, None],
        h=linear.h * image[:, :, None],
        e=linear.e * image,
        point_weight=linear.point_weight * ground**2,
        point_e=linear.point_e * ground,
        photo_rows=linear.photo_rows * photo[:, :, None],
        photo_e=photo_e,
        offsets=offsets,
    )


def _next_of(
    system: WeighedBlock, error: PointError | NotPositiveError, row_by_row: Bools
) -> Bools:
    """(n,) rows to take out of the equations' weights next, some of them still in `row_by_row`.

    Elimination comes to a stop at its last photo also where the datum is lost, by weights of
    control elsewhere: then it is the ground and priors, and at last all.
    """
    first, _, third, _ = system.rows.starts
    known = np.zeros(len(row_by_row), dtype=bool)
    known[first:third] = True
    for rows in (_of(system, error), known):
        if (rows & row_by_row).any():
            return rows
    return np.ones(len(row_by_row), dtype=bool)


def _of(system: WeighedBlock, error: PointError | NotPositiveError) -> Bools:
    """(n,) rows of what is not determined; all where nobody knows of what."""
    problem, rows = system.rows.problem, system.rows
    first, second, third, _ = rows.starts
    out = np.zeros(len(rows.names), dtype=bool)
    if isinstance(error, PointError):
        ray = np.isin(problem.point, error.points)
        out[first:second] = np.isin(rows.ground[:, 1], error.points)
    elif error.photo is None:
        return ~out
    else:
        ray = problem.photo == error.photo
        out[second:third] = rows.priors[:, 0] == error.photo
    out[:first] = np.repeat(ray, 2)
    return out
