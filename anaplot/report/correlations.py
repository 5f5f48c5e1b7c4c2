"""Pairs of measurements of one point that the block can hardly tell apart."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from anaplot.adjustment.significance import TESTABLE
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.textfiles.wording import plain

__all__ = ["RayPair", "correlated_rays", "correlations_json", "correlations_printout"]

Json = dict[str, Any]
Coordinate = tuple[str, str | None, str]

_ROUNDING = 1e-9  # a limit of 1 finds what is correlated completely


class RayPair(NamedTuple):
    """Two image coordinates of a point and the correlation of their residuals.

    Attributes
    ----------
    point
        Name.
    first, second
        (photo, model, axis).
    correlation
        rho = q_ij / sqrt(q_ii q_jj) of the residuals.
    """

    point: str
    first: Coordinate
    second: Coordinate
    correlation: float


def correlated_rays(block: AdjustedBlock, limit: float) -> tuple[RayPair, ...]:
    """Return the pairs of a point's image coordinates correlated at or above a limit.

    Points in the order of the file; coordinates that nothing checks are correlated with nothing.

    Parameters
    ----------
    block
        The adjusted block.
    limit
        Smallest abs(correlation), above 0 and at most 1.
    """
    problem = block.problem
    first = np.full(len(problem.points), len(problem.block.image_points))
    np.minimum.at(first, problem.point, problem.source)
    pairs = []
    for point in np.argsort(first).tolist():
        rays, q = block.cofactors.point_rays(point)
        diagonal = np.diag(q)
        size = np.sqrt(np.where(diagonal > TESTABLE, diagonal, np.inf))
        rho = q / size[:, None] / size
        rows = [problem.block.image_points[problem.source[ray]] for ray in rays.tolist()]
        names = [(row.photo, row.model, axis) for row in rows for axis in "xy"]
        for i, j in np.argwhere(np.triu(np.abs(rho) >= limit - _ROUNDING, 1)).tolist():
            value = float(np.clip(rho[i, j], -1.0, 1.0))
            pairs.append(RayPair(problem.points[point], names[i], names[j], value))
    return tuple(pairs)


def correlations_printout(pairs: tuple[RayPair, ...], limit: float) -> str:
    """Return the pairs as text."""
    if not pairs:
        return (
            f"CORRELATED RESIDUALS\n  no two of a point's rays are correlated at {limit:g} or more"
        )
    lines = [f"CORRELATED RESIDUALS of a point's rays, {limit:g} or more"]
    lines += [
        f"  point {plain(pair.point)}: {_named(pair.first)} with {_named(pair.second)}: "
        f"{pair.correlation:+.3f}"
        for pair in pairs
    ]
    return "\n".join(lines)


def _named(coordinate: Coordinate) -> str:
    photo, model, axis = coordinate
    where = "" if model is None else f" in {plain(model)}"
    return f"photo {plain(photo)}{where} {axis}"


def correlations_json(pairs: tuple[RayPair, ...]) -> list[Json]:
    """Return the pairs for programs."""
    names = ("photo", "model", "axis")
    return [
        {
            "point": pair.point,
            "first": dict(zip(names, pair.first, strict=True)),
            "second": dict(zip(names, pair.second, strict=True)),
            "correlation": pair.correlation,
        }
        for pair in pairs
    ]
