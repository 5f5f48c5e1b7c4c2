"""Points that seem to have moved, since they are named otherwise in one of the epochs."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from anaplot.bundle.epochs.series import EpochDifferences
from anaplot.bundle.solve.problem import listed

__all__ = ["exchanged_names"]

_NEAR = 5.0  # standard deviations up to which a place is that of another point
_FAR = 20.0  # and which a movement there has at least: no chance leads to a point


def exchanged_names(pairs: Iterable[EpochDifferences], sigma: float | None) -> list[str]:
    """Say of which points the names are exchanged in an epoch.

    Parameters
    ----------
    pairs
        Pairs of epochs.
    sigma
        Of unit weight; None where there is none.

    Returns
    -------
    list
        A sentence for each pair in which points have come to where others were, but where a pair
        before has told of the same.
    """
    out: list[str] = []
    told: set[frozenset[str]] = set()
    for pair in pairs:
        found = _come_to_another(pair, sigma)
        names = {frozenset(each) for each in found}
        if names <= told:
            continue
        told |= names
        first, second = pair.numbers
        which = listed([f"{one} where {other} was" for one, other in found])
        out.append(
            f"in epoch {second} points lie where others were in epoch {first} ({which}): are they "
            "named otherwise in one of them?"
        )
    return out


def _come_to_another(pair: EpochDifferences, sigma: float | None) -> list[tuple[str, str]]:
    """Return points, each with the one that was in the first epoch where it is in the second."""
    if sigma is None:
        return []
    d = pair.d.reshape(-1, 3)
    s = sigma * np.sqrt(np.diag(pair.cofactors).clip(0.0)).reshape(-1, 3)
    far = np.flatnonzero((np.abs(d) > _FAR * s).any(axis=1) & (s > 0.0).all(axis=1))
    out = []
    for k in far:
        beside = np.abs(pair.places[k] + d[k] - pair.places) <= _NEAR * s[k]
        # one that has stayed is a point beside which this one has come to lie
        there = [j for j in far if j != k and bool(beside[j].all())]
        out += [(pair.points[k], pair.points[j]) for j in there]
    return out
