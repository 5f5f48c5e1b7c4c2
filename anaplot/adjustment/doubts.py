"""What conspicuous rows elsewhere leave in doubt of a place's w; see `adjustment.apart`.

Places may be as many as the points of a block, and each touches thousands of others: which of them
are larger is looked up where it is asked for.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import coo_array, csc_array, csr_array

from anaplot.aliases import Array, Bools, Index

__all__ = ["Doubts", "Touching"]

_MOST_TOGETHER = 3000  # places whose pairs are looked at together: some million pairs


@dataclass(frozen=True, eq=False)
class Touching:
    """What carries an error from one of k places to another.

    Attributes
    ----------
    seen
        (k, f) not zero where a place has a row in one of f photos: two that share one touch.
    far
        (k,) places that touch every other one.
    """

    seen: csr_array
    far: Bools

    @cached_property
    def pairs(self) -> tuple[Index, Index]:
        """Every two different places that touch, each pair both ways round."""
        shared = coo_array(self.seen @ self.seen.T)
        every = np.arange(len(self.far))
        far = np.flatnonzero(self.far)
        one = np.concatenate((shared.row, np.repeat(far, len(every)), np.tile(every, len(far))))
        other = np.concatenate((shared.col, np.tile(every, len(far)), np.repeat(far, len(every))))
        keys = np.unique(one.astype(np.intp) * len(every) + other.astype(np.intp))
        first, second = np.divmod(keys, max(len(every), 1))
        return first[first != second], second[first != second]


class Doubts:
    """What conspicuous rows elsewhere leave in doubt of the w of k places.

    Parameters
    ----------
    top
        (k,) largest w of every place that may still be rejected; 0: none.
    reach
        (k,) g of every place.
    touching
        Which of them touch.
    """

    def __init__(self, top: Array, reach: Array, touching: Touching) -> None:
        self._top, self._reach, self._far = top, reach, touching.far
        self._carried = reach * top
        self._touching = touching
        self._seen, self._of = touching.seen, csc_array(touching.seen)
        self._largest = float(np.max(top, initial=0.0))

    def of(self, k: int, size: float) -> float:
        """Return the doubt of a w in place k of this size, by those that are larger."""
        if size >= self._largest:
            return 0.0
        larger = self._top > size
        larger[k] = False
        if not self._far[k]:
            larger &= self._touched_by(k)
        return float(self._reach[k] * self._carried[larger].sum())

    def of_all(self, size: Array) -> Array:
        """Return (k,) what `of` does of a w of this size in every place; NaN: 0."""
        if len(size) > _MOST_TOGETHER:
            sizes = enumerate(size.tolist())
            return np.array([0.0 if w != w else self.of(k, w) for k, w in sizes])
        first, second = self._touching.pairs
        larger = self._top[second] > size[first]
        first, second = first[larger], second[larger]
        return np.asarray(self._reach * np.bincount(first, self._carried[second], len(size)))

    def _touched_by(self, k: int) -> Bools:
        """(k,) the places that touch one."""
        out: Bools = self._far.copy()
        photos = _of(self._seen, k)
        if len(photos):
            out[np.concatenate([_of(self._of, int(photo)) for photo in photos])] = True
        return out

    def blocks(self, critical: float, negligible: float) -> Bools:
        """Return (k,) where the doubt is surely such that the largest row does not go.

        It is at least what those that are larger leave in one photo.
        """
        photo = np.repeat(np.arange(self._of.shape[1]), np.diff(self._of.indptr))
        place = self._of.indices
        order = np.lexsort((-self._top[place], photo))
        photo, place = photo[order], place[order]
        carried = self._carried[place]
        before = np.cumsum(carried) - carried
        least = np.zeros(len(self._top))
        np.maximum.at(least, place, before - before[self._of.indptr[photo]])
        least *= self._reach
        # those of equal size are no larger; beyond that the sums only round
        least *= 1.0 - 1e-9
        return np.asarray((least > negligible) & (self._top - critical <= least))


def _of(matrix: csr_array | csc_array, at: int) -> Index:
    """Return the entries of a row of a csr_array, or of a column of a csc_array."""
    return np.asarray(matrix.indices[matrix.indptr[at] : matrix.indptr[at + 1]])
