"""What an adjusted block is worth in few rows: accuracies and correlations, and where they are."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import pi
from typing import Any

import numpy as np

from anaplot.aliases import Array
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.parametercorrelations import ORIENTATION_PAIRS
from anaplot.report.adjusttables import is_fine
from anaplot.report.document import Column, Table, name, number, table

__all__ = ["summary_tables"]

_XYZ = ("X", "Y", "Z")
_ANGLES = ("omega", "phi", "kappa")
_POINT_PAIRS = (("X", "Y"), ("X", "Z"), ("Y", "Z"))


def summary_tables(
    block: AdjustedBlock, photos: Table, points: Table, correlations: Table
) -> Mapping[str, Table]:
    """Return the tables by their names.

    Parameters
    ----------
    block
        The adjusted block.
    photos, points, correlations
        Its tables of these names; the last one of the photos' orientations.

    Returns
    -------
    mapping of str to Table
        "accuracy" [m] and "accuracy_angles" [rad]: least, middle and largest standard deviation of
        each kind of unknown, the middle one of an even number the lower; "photos_correlated" and
        "points_correlated": of each photo and point the two unknowns that are correlated most,
        the largest first.
    """
    decimals = 6 if is_fine(block) else 4
    lengths = [
        *_spread("position", "photo", photos, [f"s{axis}" for axis in _XYZ]),
        *_spread("point", "point", points, [f"s{axis}" for axis in _XYZ]),
    ]
    angles = _spread("angle", "photo", photos, [f"s{angle}" for angle in _ANGLES])
    return {
        "accuracy": table("accuracy", _accuracy("m", decimals, 1.0), lengths),
        "accuracy_angles": table("accuracy_angles", _accuracy("rad", 5, 180.0 / pi), angles),
        "photos_correlated": table(
            "photos_correlated",
            _correlated("photo", "PHOTO"),
            _largest(block.problem.photos, _columns(correlations), ORIENTATION_PAIRS),
        ),
        "points_correlated": table(
            "points_correlated",
            _correlated("point", "POINT"),
            _largest(block.problem.points, _point_pairs(block), _POINT_PAIRS),
        ),
    }


def _columns(correlations: Table) -> Array:
    columns = [values for column, values in correlations.for_programs() if column.key != "photo"]
    return np.column_stack([np.asarray(values, dtype=float) for values in columns])


def _accuracy(unit: str, decimals: int, scale: float) -> tuple[Column, ...]:
    return (
        name("of", "STANDARD DEVIATION OF", 10),
        name("unknown"),
        *(
            number(key, key, decimals, 12, unit=unit, scale=scale)
            for key in ("least", "middle", "largest")
        ),
        name("at", "LARGEST AT"),
    )


def _correlated(key: str, title: str) -> tuple[Column, ...]:
    return (
        name(key, title, 5),
        name("first", "MOST CORRELATED", 5),
        name("second", "WITH", 5),
        number("correlation", "rho", 3, 8),
    )


def _spread(what: str, owner: str, of: Table, keys: list[str]) -> list[tuple[Any, ...]]:
    """Return a row for each column of standard deviations that has any."""
    columns = {column.key: values for column, values in of.for_programs()}
    names = columns[owner]
    rows = []
    for key in keys:
        values = np.asarray(columns[key], dtype=float)
        known = np.nonzero(np.isfinite(values))[0]
        if not len(known):
            continue
        order = known[np.argsort(values[known], kind="stable")]
        low, middle, high = order[0], order[(len(order) - 1) // 2], order[-1]
        least, half, most = (float(values[k]) for k in (low, middle, high))
        rows.append((what, key[1:], least, half, most, names[high]))
    return rows


def _point_pairs(block: AdjustedBlock) -> Array:
    """Return (points, 3) the correlations XY, XZ, YZ of each point; NaN of what is held."""
    q = block.cofactors.points
    deviations = np.sqrt(np.einsum("nii->ni", q).clip(min=0.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        rho = q / deviations[:, :, None] / deviations[:, None, :]
    return np.asarray(rho[:, (0, 0, 1), (1, 2, 2)].clip(-1.0, 1.0))


def _largest(
    owners: Sequence[str], rho: Array, pairs: Sequence[tuple[str, str]]
) -> Iterator[tuple[str, str, str, float]]:
    """Yield of each owner the pair correlated most, the largest first; not of what is held."""
    known = np.nonzero(np.isfinite(rho).any(axis=1))[0]
    best = np.nanargmax(np.abs(rho[known]), axis=1)
    sizes = rho[known, best]
    for k in np.argsort(-np.abs(sizes), kind="stable").tolist():
        yield owners[known[k]], *pairs[best[k]], float(sizes[k])
