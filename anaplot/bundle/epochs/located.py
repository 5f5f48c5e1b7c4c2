"""What explains a refuted hypothesis: one thing after the other may move until the rest agrees."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg.blas import dgemm

from anaplot.adjustment.hypothesis import FTest, f_test
from anaplot.aliases import Array, Index

__all__ = ["Freed", "Located", "free_one_by_one"]

_BETTER = 1e-9  # of R, that what is put back has to be better by: less is rounding


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
    refuted: FTest,
    *,
    rank: int | None = None,
    least: int = 0,
) -> list[Freed]:
    """Let owners of differences move until the rest is accepted, by as many conditions as it has.

    Whoever is named too early is put back: where a part moves as a whole, what adjoins it seems
    to move first, as long as more is held that has moved. After each step owners become fixed
    again as long as what is left agrees better than any as large before it, so that this ends.

    R of the rest with the moved ones free is that of the rest by itself: what is free takes no part
    in it.

    Parameters
    ----------
    owners, d
        (n,) what each difference belongs to (a point, or a movement of one), and the differences.
    information
        (n, n) the inverse of their cofactors, or their pseudo-inverse.
    refuted
        The test of all of them, with whose significance and sigma the rest is tested.
    rank
        Of `information`; None: n.
    least
        Differences that stay.

    Returns
    -------
    list
        Those that move, the one that explains most first.
    """
    rank = len(d) if rank is None else rank
    search = _Search(owners, information, information @ d, float(d @ information @ d))
    every, found = frozenset(owners), set[int]()
    best = {0: search.total}
    while search.held > least and not _accepted(
        refuted, search.total, rank - (len(d) - search.held)
    ):
        latest = search.best(every - found)
        search.turn(latest)
        found.add(latest)
        best[len(found)] = min(search.total, best.get(len(found), search.total))
        while len(found) > 1:
            back = search.best(found)
            fewer, before = len(found) - 1, best[len(found) - 1]
            if back == latest or not search.after(back) < before * (1.0 - _BETTER):
                break
            search.turn(back)
            found.remove(back)
            best[fewer] = search.total
    # what the others' rows say is in the right-hand side: those of the ones found are enough
    mine = [row for row, owner in enumerate(owners) if owner in found]
    again = _Search(
        [owners[row] for row in mine],
        information[np.ix_(mine, mine)],
        information[mine] @ d,
        float(d @ information @ d),
    )
    out = []
    while found:
        before = again.total
        owner = again.best(found)
        again.turn(owner)
        found.remove(owner)
        out.append(Freed(owner, before - again.total, again.total))
    return out


def _accepted(refuted: FTest, rest: float, conditions: int) -> bool:
    """Whether what is left agrees."""
    if conditions < 1:
        return True
    left = f_test(
        rest, conditions, alpha=refuted.alpha, sigma=refuted.sigma, redundancy=refuted.redundancy
    )
    return not left.rejected


class _Search:
    """R of what is held at zero, while owners become free and are held again.

    The information of differences with its right-hand side and R below it, swept by the rows of
    whoever is free: their block is minus their cofactors then, their column what they move by.
    """

    def __init__(
        self, owners: Sequence[int], information: Array, side: Array, total: float
    ) -> None:
        n = len(owners)
        self._swept = np.empty((n + 1, n + 1), order="F")
        self._swept[:n, :n] = information
        self._swept[n, :n] = self._swept[:n, n] = side
        self._swept[n, n] = total
        rows: dict[int, list[int]] = {}
        for row, owner in enumerate(owners):
            rows.setdefault(owner, []).append(row)
        self._rows: dict[int, Index] = {owner: np.array(mine) for owner, mine in rows.items()}
        self._free: set[int] = set()
        self.held = n

    @property
    def total(self) -> float:
        """R of those that are held."""
        return max(float(self._swept[-1, -1]), 0.0)

    def best(self, among: Collection[int]) -> int:
        """Return who leaves the smallest R when it turns; of several the first."""
        alike: dict[int, list[int]] = {}
        for owner in sorted(among):
            alike.setdefault(len(self._rows[owner]), []).append(owner)
        left: dict[int, float] = {}
        for owners in alike.values():
            rows = np.array([self._rows[owner] for owner in owners])
            core = _inverse(self._swept[rows[:, :, None], rows[:, None, :]])
            side = self._swept[rows, -1]
            left.update(zip(owners, -np.einsum("ki,kij,kj->k", side, core, side), strict=True))
        return min(sorted(among), key=lambda each: left[each])

    def after(self, owner: int) -> float:
        """Return what R will be once an owner has turned."""
        mine = self._rows[owner]
        side = self._swept[mine, -1]
        return float(self._swept[-1, -1] - side @ _inverse(self._swept[np.ix_(mine, mine)]) @ side)

    def turn(self, owner: int) -> None:
        """Let an owner move that was held, or hold it again."""
        mine = self._rows[owner]
        rows = self._swept[mine]
        core = _inverse(rows[:, mine])
        side = core @ rows
        self._swept = dgemm(-1.0, rows, side, trans_a=1, beta=1.0, c=self._swept, overwrite_c=1)
        back = owner in self._free
        self._swept[mine] = -side if back else side
        self._swept[:, mine] = self._swept[mine].T
        self._swept[np.ix_(mine, mine)] = -core
        self._free ^= {owner}
        self.held += len(mine) if back else -len(mine)


def _inverse(core: Array) -> Array:
    # a direction in which the others leave a stable point open is none in which it can be seen
    return np.asarray(np.linalg.pinv(core, rcond=1e-9, hermitian=True))
