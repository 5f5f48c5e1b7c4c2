"""The scale that distances give to a network without datum.

In a free network a change of scale s costs nothing but the misclosures e of lengths, h s with h
what it does to them. One combination of the contrasts, h'e / |h|, is used up by the scale, and the
others, orthonormal to it, are observations like any: as with the parameters that the points of a
line share (see `anaplot.bundle.solve.conditions`). The first says what the scale is and how well it
is known, and meets nothing that could check it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array

from anaplot.adjustment.residualsystem import diagonal
from anaplot.aliases import Array, Index

__all__ = ["ScaleOfConditions", "parted"]


class ScaleOfConditions(NamedTuple):
    """What conditions say of the scale.

    Attributes
    ----------
    rows
        (n,) relative change of scale by an error of one standard deviation in each row.
    points
        (p, 3) relative change of scale that a change of the points means.
    variance
        Of the relative scale.
    """

    rows: Array
    points: Array
    variance: float

    @classmethod
    def of(
        cls, contrasts: csr_array, whitened: csr_array, effect: Array, direction: Array
    ) -> ScaleOfConditions:
        """Return it from the contrasts, their derivatives by points, and what `parted` has."""
        size = float(direction @ effect)
        return cls(
            contrasts @ (direction / size),
            (whitened.T @ (direction / size)).reshape(-1, 3),
            1.0 / size**2,
        )


def parted(effect: Array) -> tuple[csr_array, Index, Array]:
    """Return orthonormal combinations of q contrasts, those that a change of scale leaves alone.

    Parameters
    ----------
    effect
        (q,) what a relative change of scale does to the contrasts; not all zero.

    Returns
    -------
    (q, q - 1) and (q - 1,) and (q,) arrays
        The combinations; of each, the contrast that it replaces; and the direction of the effect.
    """
    q = len(effect)
    pivot = int(np.abs(effect).argmax())
    direction = effect / np.abs(effect[pivot])
    direction = direction / np.linalg.norm(direction)
    # Householder's reflection takes the direction to the pivot's axis, and what is left of the
    # others stays as sparse as it is
    away = direction.copy()
    away[pivot] += np.copysign(1.0, direction[pivot])
    column = csr_array(away[:, None])
    reflection = csr_array(diagonal(np.ones(q)) - (column @ column.T) * (2.0 / float(away @ away)))
    others = np.delete(np.arange(q), pivot)
    return csr_array(reflection[:, others]), others, direction
