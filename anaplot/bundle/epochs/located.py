"""What explains a refuted hypothesis: one thing after the other may move until the rest agrees."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array

__all__ = ["Freed", "Located", "free_one_by_one"]


class Located(NamedTuple):
    """A step of naming moved points.

    Attributes
    ----------
    point
        The point whose displacement explains most of what is left.
    square
        What R falls by when this point may move besides those named before: R of its displacement
        against what those not yet named, held at zero, let expect.
    rest
        R of all other points once this one may move.
    """

    point: str
    square: float
    rest: float


class Freed(NamedTuple):
    """A step of the search.

    Attributes
    ----------
    owner
        Number of what may move from here on.
    square, rest
        As `Located` has them.
    """

    owner: int
    square: float
    rest: float


def free_one_by_one(
    owners: Sequence[int],
    d: Array,
    information: Array,
    total: float,
    limit: float,
    *,
    least: int = 0,
) -> list[Freed]:
    """Let one owner of differences after the other move until R of the rest is within the limit.

    R of the rest with the moved ones free is that of the rest by itself: what is free takes no part
    in it.

    Parameters
    ----------
    owners, d
        (n,) what each difference belongs to (a point, or a movement of one), and the differences.
    information
        (n, n) the inverse of their cofactors, or their pseudo-inverse.
    total, limit
        R of all of them, and what it may be.
    least
        Differences that stay.
    """
    rest = list(range(len(d)))
    out: list[Freed] = []
    while len(rest) > least and total > limit:
        gradient = information @ d[rest]
        at: dict[int, list[int]] = {}
        for position, row in enumerate(rest):
            at.setdefault(owners[row], []).append(position)
        drops = {
            owner: float(gradient[mine] @ _inverse(information[np.ix_(mine, mine)])
                         @ gradient[mine])
            for owner, mine in at.items()
        }  # fmt: skip
        owner = max(drops, key=lambda each: drops[each])
        mine = at[owner]
        gone = set(mine)
        stay = [k for k in range(len(rest)) if k not in gone]
        # the information of the rest alone is the Schur complement
        side = information[np.ix_(stay, mine)]
        core = _inverse(information[np.ix_(mine, mine)])
        information = information[np.ix_(stay, stay)] - side @ core @ side.T
        rest = [rest[k] for k in stay]
        total = max(total - drops[owner], 0.0)
        out.append(Freed(owner, drops[owner], total))
    return out


def _inverse(core: Array) -> Array:
    # a direction in which the others leave a stable point open is none in which it can be seen
    return np.asarray(np.linalg.pinv(core, rcond=1e-9, hermitian=True))
