"""One photo and its points adjusted from many places side by side, while all other photos stay.

A photo that returns to where it was does so in the block, too: what three of its rays make are a
score of places, and one or two to which they lead.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array, Bools, Index
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.problem import Problem
from anaplot.photogrammetry.collinearity import project_with_derivatives, turns

__all__ = ["Places", "settled_places"]

_STEPS = 30
_LITTLE = 1e-3  # share of v'Pv: a step that brings less is the last
_DAMPING = 1e-3  # of the first step
_STUCK = 1e3  # damping from which no step is tried
_HELD = 1e-12  # of the largest of a diagonal: what holds something that nothing determines
_TINY = 1e-300
_LEAST = 1e-9  # damping
_FAR = 1e6  # mm: farther off is as far


class Places(NamedTuple):
    """Places of a photo.

    Attributes
    ----------
    centres, rotations
        (k, 3) and (k, 3, 3).
    points
        (k, n, 3) the photo's points, in the order of their numbers, as they are from there.
    """

    centres: Array
    rotations: Array
    points: Array

    def some(self, which: Index | Bools) -> Places:
        """Return some of them."""
        return Places(*(part[which] for part in self))


def settled_places(
    problem: Problem, state: BlockState, photo: int, start: Places, names: Index
) -> tuple[Places, Array]:
    """Return where damped Gauss-Newton steps of a photo and its points lead, the best first.

    By stated lenses, without what is additional, and without what ties points or photos together:
    the bundle goes on from there.

    Parameters
    ----------
    problem, state
        The bundle, and where it is.
    photo, start
        The photo, and places to begin with.
    names
        (n,) numbers of the photo's points, in ascending order.

    Returns
    -------
    Places and (k,) floats
        Where that leads, and v'Pv of all rays and of the control of these points there, less that
        where the photo is.
    """
    rays = _PhotoRays.of(problem, state, photo, names)
    here = Places(state.centres[[photo]], state.rotations[[photo]], state.points[names][None])
    before = float(rays.seen(here).value[0])
    at = Places(*(part.copy() for part in start))
    seen = rays.seen(at)
    damping = np.full(len(at.centres), _DAMPING)
    running = np.isfinite(seen.value)
    for _ in range(_STEPS):
        some = np.flatnonzero(running)
        if not len(some):
            break
        try:
            trial = rays.moved(at.some(some), seen.some(some), damping[some])
        except np.linalg.LinAlgError:
            break
        found = rays.seen(trial)
        gain = seen.value[some] - found.value
        better = (gain > 0.0) & (found.front >= seen.front[some])
        to = some[better]
        for part, new in zip((*at, *seen), (*trial, *found), strict=True):
            part[to] = new[better]
        # where it brings little more, the bundle goes on
        running[to] = (gain > _LITTLE * found.value)[better]
        damping[some] = np.maximum(damping[some] * np.where(better, 0.1, 10.0), _LEAST)
        running &= damping < _STUCK
    order = np.argsort(seen.value, kind="stable")
    return at.some(order), seen.value[order] - before


class _Seen(NamedTuple):
    """What rays are from k places.

    Attributes
    ----------
    design
        (k, m, 2, 9) derivatives with respect to the photo and to a ray's point [1/sigma].
    e
        (k, m, 2) computed minus observed [sigmas].
    value
        (k,) v'Pv, with that of control.
    front
        (k,) rays whose points are in front of their photos.
    """

    design: Array
    e: Array
    value: Array
    front: Index

    def some(self, which: Index) -> _Seen:
        """Return what they are from some of the places."""
        design, e, value, front = self
        return _Seen(design[which], e[which], value[which], front[which])


@dataclass(frozen=True, slots=True, eq=False)
class _PhotoRays:
    """All rays of the points of one photo.

    Attributes
    ----------
    centres, rotations, c, xy, weight
        (m, ...) of their photos, where they are; what was observed, and what e is multiplied by.
    own
        (m,) which are the photo's.
    point, first
        (m,) numbers among its points, and (n,) where those of each begin.
    known, place
        (2, n, 3) weights of control and of the points' priors, and where these are.
    fixed
        (n, 3) coordinates free of error.
    """

    centres: Array
    rotations: Array
    c: Array
    xy: Array
    weight: Array
    own: Bools
    point: Index
    first: Index
    known: Array
    place: Array
    fixed: Bools

    @classmethod
    def of(cls, problem: Problem, state: BlockState, photo: int, names: Index) -> _PhotoRays:
        """Return those of a photo."""
        # a bundle's rays are in the order of their points
        rays = np.flatnonzero(np.isin(problem.point, names))
        photos, point = problem.photo[rays], np.searchsorted(names, problem.point[rays])
        weight = 1.0 / problem.sigma_xy[rays]
        if problem.rejected is not None:
            weight[problem.rejected[rays]] = 0.0
        known = np.nan_to_num(problem.ground_sigma[:, names] ** -2.0)
        return cls(
            state.centres[photos],
            state.rotations[photos],
            problem.c[photos],
            problem.ideal[rays],
            weight,
            photos == photo,
            point,
            np.flatnonzero(np.diff(point, prepend=-1)),
            known,
            np.where(known > 0.0, problem.ground[:, names] - state.origin, 0.0),
            problem.fixed[names],
        )

    def seen(self, at: Places) -> _Seen:
        """Return what they are from k places."""
        k, m = len(at.centres), len(self.own)
        mine = self.own[None, :, None]
        centres = np.where(mine, at.centres[:, None], self.centres)
        rotations = np.where(mine[..., None], at.rotations[:, None], self.rotations)
        seen = project_with_derivatives(
            centres.reshape(-1, 3),
            rotations.reshape(-1, 3, 3),
            np.tile(self.c, k),
            at.points[:, self.point].reshape(-1, 3),
            weight=np.tile(self.weight, (k, 1)),
        )
        e = np.nan_to_num(seen.xy.reshape(k, m, 2) - self.xy, nan=_FAR)
        e = np.clip(e, -_FAR, _FAR) * self.weight
        design = np.zeros((k, m, 2, 9))
        design[:, self.own, :, :6] = seen.photo.reshape(k, m, 2, 6)[:, self.own]
        design[..., 6:] = np.where(
            self.fixed[self.point][:, None], 0.0, seen.point.reshape(k, m, 2, 3)
        )
        off = self._off(at)
        value = np.einsum("kmi,kmi->k", e, e) + (self.known * off**2).sum(axis=(1, 2, 3))
        front = (seen.depth.reshape(k, m) > 0.0).sum(axis=1)
        return _Seen(np.nan_to_num(design, posinf=0.0, neginf=0.0), e, value, front)

    def _off(self, at: Places) -> Array:
        """(k, 2, n, 3) how far points are off what is known of them."""
        return np.where(self.known > 0.0, at.points[:, None] - self.place, 0.0)

    def moved(self, at: Places, seen: _Seen, damping: Array) -> Places:
        """Return places after a damped step: points are eliminated one by one."""
        with np.errstate(over="ignore", invalid="ignore"):
            return self._step(at, seen, damping)

    def _step(self, at: Places, seen: _Seen, damping: Array) -> Places:
        across = seen.design.transpose(0, 1, 3, 2)
        products = np.add.reduceat(np.matmul(across, seen.design), self.first, axis=1)
        sides = np.add.reduceat(np.matmul(across, seen.e[..., None]), self.first, axis=1)
        by_point, side = products[..., 6:, 6:], sides[..., 6:, :]
        side[..., 0] += np.where(self.fixed, 0.0, (self.known * self._off(at)).sum(axis=1))
        _held(by_point, self.known.sum(axis=0), damping[:, None])
        photo, mixed = products[..., :6, :6].sum(axis=1), products[..., :6, 6:]
        _held(photo, np.zeros(6), damping)
        both = np.concatenate((mixed.transpose(0, 1, 3, 2), side), axis=3)
        solved = np.linalg.solve(by_point, both)
        taken = np.matmul(mixed, solved).sum(axis=1)
        step = -np.linalg.solve(
            photo - taken[..., :6], sides[..., :6, :].sum(axis=1) - taken[..., 6:]
        )
        shift = -solved[..., 6] - np.einsum("knij,kj->kni", solved[..., :6], step[..., 0])
        # what nothing determines stays, and so no step makes it better
        step, shift = (np.where(np.isfinite(part), part, 0.0) for part in (step, shift))
        return Places(
            at.centres + step[:, :3, 0],
            np.matmul(turns(step[:, 3:, 0]), at.rotations),
            at.points + np.where(self.fixed, 0.0, shift),
        )


def _held(matrices: Array, known: Array, damping: Array) -> None:
    """Add what is known to diagonals of (..., p, p) matrices, and damp them."""
    diagonal = np.einsum("...ii->...i", matrices)
    diagonal += known
    diagonal *= 1.0 + damping[..., None]
    diagonal += _HELD * diagonal.max(axis=-1, keepdims=True) + _TINY
