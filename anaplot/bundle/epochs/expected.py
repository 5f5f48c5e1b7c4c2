"""A given movement as null hypothesis: H0: B x = w (Gruen 1978, eq. 55)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from anaplot.aliases import Array, Bools
from anaplot.bundle.epochs.moves import Move
from anaplot.errors import InputError
from anaplot.photogrammetry.givenmovement import GivenMovement
from anaplot.textfiles.wording import hint

__all__ = ["expected_movements"]


def expected_movements(
    moves: Sequence[Move], given: Bools, rows: Sequence[GivenMovement], count: int
) -> Array:
    """Return (3 m,) the given movements w [m], zero of what is not given.

    Parameters
    ----------
    moves
        The m movements.
    given
        (m, 3) whether control gives a coordinate in both epochs: that one cannot move.
    rows
        What is given.
    count
        Of epochs.

    Raises
    ------
    InputError
        A movement of a point that is not compared, of epochs that do not follow each other, of a
        coordinate that control holds, or one twice.
    """
    out = np.zeros((len(moves), 3))
    at = {move: k for k, move in enumerate(moves)}
    of: dict[str, list[Move]] = {}
    for move in moves:
        of.setdefault(move.point, []).append(move)
    said: set[Move] = set()
    for row in rows:
        mine = of.get(row.point)
        if mine is None:
            raise InputError(
                f"{row.where}: point {row.point} is not compared{hint(row.point, list(of))}"
            )
        first, second = row.first, row.second
        if first is None or second is None:
            if count > 2:
                raise InputError(f"{row.where}: from and to are needed: there are {count} epochs")
            first, second = 1, 2
        move = Move(row.point, first - 1, second - 1)
        if move not in at:
            steps = ", ".join(f"{m.first + 1} to {m.second + 1}" for m in mine)
            raise InputError(
                f"{row.where}: point {row.point} has no movement from {first} to {second}: its "
                f"epochs follow each other as {steps}"
            )
        if move in said:
            raise InputError(f"{row.where}: point {row.point} twice from {first} to {second}")
        said.add(move)
        for axis in np.flatnonzero(given[at[move]]).tolist():
            if row.d[axis] != 0.0:
                raise InputError(
                    f"{row.where}: control gives {'XYZ'[axis]} of point {row.point} in both "
                    "epochs: it cannot move"
                )
        out[at[move]] = row.d
    return out.reshape(-1)
