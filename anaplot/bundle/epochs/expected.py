"""A given movement as null hypothesis: H0: B x = w (Gruen 1978, eq. 55)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from anaplot.aliases import Array
from anaplot.bundle.epochs.common import Common
from anaplot.bundle.epochs.moves import Move, undone_movements
from anaplot.errors import InputError
from anaplot.photogrammetry.givenmovement import GivenMovement
from anaplot.textfiles.wording import hint

__all__ = ["expected_movements"]

_ROUNDING = 1e-9  # m, of a sum of movements


def expected_movements(
    moves: Sequence[Move], common: Common, rows: Sequence[GivenMovement], count: int
) -> Array:
    """Return (3 m,) the given movements w [m], zero of what is not given.

    A coordinate that is the same again as in an earlier epoch comes back, given or not.

    Parameters
    ----------
    moves
        The m movements.
    common
        Coordinates that are one in several epochs.
    rows
        What is given.
    count
        Of epochs.

    Raises
    ------
    InputError
        A movement of a point that is not compared, of epochs that do not follow each other, against
        what control holds, or one twice.
    """
    out = np.zeros((len(moves), 3))
    at = {move: k for k, move in enumerate(moves)}
    of: dict[str, list[Move]] = {}
    for move in moves:
        of.setdefault(move.point, []).append(move)
    said: dict[Move, GivenMovement] = {}
    for row in rows:
        mine = of.get(row.point)
        if mine is None:
            held = common.whole(row.point)
            why = ": it holds the datum" if held else hint(row.point, list(of))
            raise InputError(f"{row.where}: point {row.point} is not compared{why}")
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
                f"epochs follow each other as {steps}: give each of these"
            )
        if move in said:
            raise InputError(f"{row.where}: point {row.point} twice from {first} to {second}")
        said[move] = row
        out[at[move]] = row.d
    # in the order of time: what comes back undoes what may have come back itself
    for (k, axis), undone in undone_movements(moves, common).items():
        back = 0.0 - float(out[undone, axis].sum())
        stated = said.get(moves[k])
        slack = _ROUNDING if undone else 0.0
        if stated is not None and abs(stated.d[axis] - back) > slack:
            raise InputError(f"{stated.where}: {_held(moves, k, axis, undone, back)}")
        out[k, axis] = back
    return out.reshape(-1)


def _held(moves: Sequence[Move], k: int, axis: int, undone: Sequence[int], back: float) -> str:
    """Say how control holds a coordinate."""
    move = moves[k]
    what = f"control gives {'XYZ'[axis]} of point {move.point} in"
    if not undone:
        return f"{what} both epochs: it cannot move"
    first, last = moves[undone[0]].first + 1, move.second + 1
    return (
        f"{what} epochs {first} and {last}: with the movements before, from {move.first + 1} to "
        f"{last} it moves by {back:g} m"
    )
