"""What is compared: the movements of points from one epoch to the next that they are in."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from math import comb
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Bools
from anaplot.bundle.epochs.common import Common
from anaplot.bundle.solve.problem import listed
from anaplot.errors import InputError

__all__ = [
    "MOST_MOVES",
    "MOST_PAIRED",
    "Move",
    "bound_coordinates",
    "chosen_points",
    "given_coordinates",
    "moves_of",
    "undone_movements",
]

MOST_MOVES = 1000
"""Movements that are computed at once: their covariance matrix is dense."""

MOST_PAIRED = 20_000
"""Displacements of points between any two epochs: each has tests of its own, some 30 kB."""


class Move(NamedTuple):
    """A point's movement from one epoch to a later one, numbered from 0."""

    point: str
    first: int
    second: int


def chosen_points(
    names: Sequence[Sequence[str]],
    common: Common,
    asked: Sequence[str],
    left_out: Sequence[Mapping[str, str]] = (),
) -> tuple[str, ...]:
    """Return the points to compare, in the order of the files.

    Parameters
    ----------
    names
        Points of each epoch, in the order of its file.
    common
        Points that are one in all epochs that they are in hold the datum.
    asked
        Only these; empty: all.
    left_out
        Of each epoch the points that it does not determine, and why.

    Raises
    ------
    InputError
        There is nothing to compare, a point asked for cannot be, or there are too many.
    """
    two = len(names) == 2
    there = [set(each) for each in names]
    order = dict.fromkeys(name for each in names for name in each)
    several = [n for n in order if sum(n in each for each in there) > 1]
    if not several:
        raise InputError(
            f"the {'two ' if two else ''}epochs have no point in common{_lacking(left_out)}"
        )
    together = set(several)
    for k, each in enumerate(there, start=1):
        if not each & together:
            raise InputError(f"epoch {k} has no point in common with the others")
    moving = moves_of(several, names, common)
    free = list(dict.fromkeys(move.point for move in moving))
    moved = set(free)
    if asked:
        for name in dict.fromkeys(asked):
            if name in moved:
                continue
            if name in together or common.whole(name):
                raise InputError(f"point {name} holds the datum: it cannot be compared")
            raise InputError(
                f"point {name} is not in {'both' if two else 'two'} epochs"
                f"{_lacking(left_out, name)}"
            )
        free = [n for n in free if n in set(asked)]
        moving = tuple(move for move in moving if move.point in set(asked))
    if not free:
        raise InputError(
            f"nothing to compare: every point that is common to {'both ' if two else ''}epochs "
            f"holds the datum ({listed(several)}){_lacking(left_out)}"
        )
    if len(moving) > MOST_MOVES:
        what = f"{len(free)} common points" if two else f"{len(moving)} movements of common points"
        raise InputError(f"{what}; {MOST_MOVES} can be compared at once: choose (--points)")
    paired = sum(comb(sum(name in each for each in there), 2) for name in free)
    if paired > MOST_PAIRED:
        raise InputError(
            f"{paired} displacements of points between two of {len(names)} epochs; {MOST_PAIRED} "
            "can be compared at once: choose (--points), or compare fewer epochs"
        )
    return tuple(free)


def _lacking(left_out: Sequence[Mapping[str, str]], name: str | None = None) -> str:
    """Say that an epoch has measured a point, or any, and does not determine it."""
    for epoch, reasons in enumerate(left_out, start=1):
        one = next(iter(reasons), None) if name is None else name
        if one is not None and one in reasons:
            which = "it" if name is not None else f"point {one}"
            more = "" if name is not None or len(reasons) == 1 else f" ({len(reasons)} such points)"
            return f": in epoch {epoch} {which} {reasons[one]}{more}"
    return ""


def moves_of(
    points: Iterable[str], names: Sequence[Sequence[str]], common: Common
) -> tuple[Move, ...]:
    """Return the movements of points through the epochs that they are in, one after the other.

    None of a point that is one in all of them.
    """
    there = [set(each) for each in names]
    out: list[Move] = []
    for name in points:
        mine = [k for k, each in enumerate(there) if name in each]
        whole = common.whole(name)
        if not whole.issuperset(mine):
            out += [Move(name, j, k) for j, k in itertools.pairwise(mine)]
    return tuple(out)


def given_coordinates(moves: Sequence[Move], common: Common) -> Bools:
    """Return (m, 3) whether a coordinate is one in both epochs: its difference is no movement."""
    return np.array(
        [[common.same(m.point, axis, m.first, m.second) for axis in range(3)] for m in moves],
        dtype=bool,
    ).reshape(len(moves), 3)


def undone_movements(moves: Sequence[Move], common: Common) -> dict[tuple[int, int], list[int]]:
    """Return what a difference undoes where it follows from those before it.

    A coordinate that is one in epochs 1 and 3 and another in epoch 2 comes back from there.

    Returns
    -------
    dict
        By movement and axis, the movements before it whose sum the difference is the negative of;
        empty of a coordinate that is the same in both epochs.
    """
    before: dict[str, list[int]] = {}
    out: dict[tuple[int, int], list[int]] = {}
    for row, move in enumerate(moves):
        mine = before.setdefault(move.point, [])
        epochs = [*(moves[k].first for k in mine), move.first]
        for axis in range(3):
            latest = None
            for n, epoch in enumerate(epochs):
                if common.same(move.point, axis, epoch, move.second):
                    latest = n
            if latest is not None:
                out[row, axis] = mine[latest:]
        mine.append(row)
    return out


def bound_coordinates(moves: Sequence[Move], common: Common) -> Bools:
    """Return (m, 3) whether a difference follows from those before it."""
    out = np.zeros((len(moves), 3), dtype=bool)
    for row, axis in undone_movements(moves, common):
        out[row, axis] = True
    return out
