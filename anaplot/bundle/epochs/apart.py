"""Displacements between epochs that are adjusted each by itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from anaplot.aliases import Array
from anaplot.bundle.epochs.moves import Move
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.crosscofactors import coordinate_cofactors
from anaplot.bundle.solve.namedpoints import point_numbers, point_places
from anaplot.photogrammetry.similarity import fit_similarity, similarity_effects

__all__ = ["Agreement", "displacements_apart", "displacements_laid"]


@dataclass(frozen=True, slots=True, eq=False)
class Agreement:
    """How well the points that hold the datum agree between the epochs, as free networks see them.

    Attributes
    ----------
    points
        Names of the s points.
    square, dimension
        Quadratic form R for the a-priori sigma0 and its degrees of freedom, 3 s - 7 for every epoch
        after the first.
    d, information
        (3 s (k - 1),) differences [m] of the s points laid onto each other, each epoch of k minus
        the one before, for one point after the other, and the pseudo-inverse [1/m^2] of their
        cofactors; both from separate adjustments.
    vtpv, redundancy
        Sums of the free networks, in which the points need not agree.
    """

    points: tuple[str, ...]
    square: float
    dimension: int
    d: Array = field(repr=False)
    information: Array = field(repr=False)
    vtpv: float
    redundancy: int


def displacements_apart(
    alone: Sequence[AdjustedBlock], moves: Sequence[Move]
) -> tuple[Array, Array, Array]:
    """Return displacements between epochs in one datum.

    Parameters
    ----------
    alone
        The epochs.
    moves
        The m movements.

    Returns
    -------
    tuple
        (m, 3) places in the earlier epoch [m], (3 m,) displacements [m] and (3 m, 3 m) their
        cofactors [m^2].
    """
    origin = alone[0].state.origin
    names = [_names(moves, k) for k in range(len(alone))]
    at = [point_places(b, mine, origin) for b, mine in zip(alone, names, strict=True)]
    cofactors = [_cofactors(b, mine) for b, mine in zip(alone, names, strict=True)]
    d, q = _differences(moves, names, at, cofactors)
    return _places(moves, names, at) + origin, d, q


def displacements_laid(
    alone: Sequence[AdjustedBlock], moves: Sequence[Move], stable: Sequence[str]
) -> tuple[Array, Array, Array, Agreement]:
    """Return displacements between free networks that are laid onto the first by stable points.

    Coordinates and covariances are transformed (S-transformation).

    Parameters
    ----------
    alone, moves
        As `displacements_apart` has them.
    stable
        Names of the s points.

    Returns
    -------
    tuple
        As `displacements_apart`, and how well the stable points agree.
    """
    origin = alone[0].state.origin
    target = point_places(alone[0], stable, origin)
    middle = target.mean(axis=0)
    names, at, cofactors = [], [], []
    # one unit of length in all epochs: turns and scale in metres at the farthest point
    places: dict[str, Array] = {}
    turns = []
    for k, block in enumerate(alone):
        mine = [*_names(moves, k), *stable]
        here = point_places(block, mine, origin)
        turn = np.eye(3)
        if k > 0:
            fitted = fit_similarity(here[len(mine) - len(stable) :], target)
            here, turn = fitted.apply(here), fitted.scale * fitted.rotation
        for name, place in zip(mine, here, strict=True):
            places.setdefault(name, place)
        names.append(mine)
        at.append(here)
        turns.append(turn)
    far = float(np.abs(np.array(list(places.values())) - middle).max()) or 1.0
    for block, mine, turn in zip(alone, names, turns, strict=True):
        q = _cofactors(block, mine).reshape(len(mine), 3, len(mine), 3)
        q = np.einsum("ij,ajbk,lk->aibl", turn, q, turn).reshape(3 * len(mine), -1)
        null = similarity_effects(np.array([places[n] for n in mine]) - middle).reshape(-1, 7)
        null[:, 3:] /= far
        held = null.copy()
        held[: -3 * len(stable)] = 0.0
        change = np.eye(len(q)) - null @ np.linalg.solve(held.T @ null, held.T)
        cofactors.append(change @ q @ change.T)
    steady = [Move(name, k, k + 1) for name in stable for k in range(len(alone) - 1)]
    d, q = _differences((*moves, *steady), names, at, cofactors)
    q = 0.5 * (q + q.T)
    first = 3 * len(moves)
    values, vectors = np.linalg.eigh(q[first:, first:])
    rank = (3 * len(stable) - 7) * (len(alone) - 1)
    values, vectors = values[-rank:], vectors[:, -rank:]
    part = vectors.T @ d[first:]
    square = float(np.sum(part * part / values))
    information = (vectors / values) @ vectors.T
    agreement = Agreement(
        tuple(stable),
        square,
        rank,
        d[first:],
        information,
        sum(one.vtpv for one in alone),
        sum(one.redundancy for one in alone),
    )
    return _places(moves, names, at) + origin, d[:first], q[:first, :first], agreement


def _names(moves: Sequence[Move], epoch: int) -> list[str]:
    """Return the points that an epoch has a part of the movement of."""
    mine = (move.point for move in moves if epoch in (move.first, move.second))
    return list(dict.fromkeys(mine))


def _cofactors(block: AdjustedBlock, names: Sequence[str]) -> Array:
    return coordinate_cofactors(
        block, [(k, axis) for k in point_numbers(block, names) for axis in (0, 1, 2)]
    )


def _places(moves: Sequence[Move], names: Sequence[Sequence[str]], at: Sequence[Array]) -> Array:
    """Return (m, 3) where the movements begin."""
    rows = [{name: k for k, name in enumerate(mine)} for mine in names]
    return np.array([at[m.first][rows[m.first][m.point]] for m in moves]).reshape(-1, 3)


def _differences(
    moves: Sequence[Move],
    names: Sequence[Sequence[str]],
    at: Sequence[Array],
    cofactors: Sequence[Array],
) -> tuple[Array, Array]:
    """Return (3 m,) differences and (3 m, 3 m) their cofactors, of epochs that are independent."""
    m = len(moves)
    d = np.zeros((m, 3))
    q = np.zeros((m, 3, m, 3))
    for k, (mine, here, own) in enumerate(zip(names, at, cofactors, strict=True)):
        rows = {name: row for row, name in enumerate(mine)}
        whole = own.reshape(len(mine), 3, len(mine), 3)
        part = [(row, move) for row, move in enumerate(moves) if k in (move.first, move.second)]
        if not part:
            continue
        to = np.array([row for row, _ in part])
        of = np.array([rows[move.point] for _, move in part])
        sign = np.array([1.0 if move.second == k else -1.0 for _, move in part])
        d[to] += sign[:, None] * here[of]
        signed = np.einsum("a,aibj,b->aibj", sign, whole[of][:, :, of], sign)
        q[to[:, None, None, None], np.arange(3)[:, None, None], to[:, None], np.arange(3)] += signed
    return d.reshape(-1), q.reshape(3 * m, 3 * m)
