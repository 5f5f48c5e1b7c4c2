"""Pairs of measurements of one point that the block can hardly tell apart."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from anaplot.adjustment.significance import TESTABLE
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.report.astext import MOST_ROWS
from anaplot.report.document import (
    Block,
    Document,
    Line,
    Listed,
    name,
    number,
    say,
    table,
)

__all__ = ["RayPair", "correlated_rays", "correlations_document"]

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


_COLUMNS = (
    name("point", "POINT", 5),
    *(
        name(f"{which}_{part}", f"{which.upper()} {part.upper()}", none="")
        for which in ("first", "second")
        for part in ("photo", "model", "axis")
    ),
    number("correlation", "correlation", 3, 13),
)


def correlations_document(
    pairs: tuple[RayPair, ...],
    limit: float,
    *,
    most: int = MOST_ROWS,
    more: str = "    and {} more",
) -> Document:
    """Return the document of correlated residuals.

    Parameters
    ----------
    pairs, limit
        From `correlated_rays`.
    most, more
        How many a person reads, and what is said of the others.
    """
    names = ("photo", "model", "axis")
    answer = [
        {
            "point": pair.point,
            "first": dict(zip(names, pair.first, strict=True)),
            "second": dict(zip(names, pair.second, strict=True)),
            "correlation": pair.correlation,
        }
        for pair in pairs
    ]
    page: tuple[Block, ...] = (
        say("CORRELATED RESIDUALS").of("heading"),
        say("  no two of a point's rays are correlated at {:g} or more", limit),
    )
    if pairs:
        lines = (
            say("  point {}: {} with {}: {:+.3f}", pair.point, _named(pair.first),
                _named(pair.second), pair.correlation)
            for pair in pairs
        )  # fmt: skip
        head = say("CORRELATED RESIDUALS of a point's rays, {:g} or more", limit).of("heading")
        page = (head, Listed(tuple(lines), most, more))
    rows = ((pair.point, *pair.first, *pair.second, pair.correlation) for pair in pairs)
    return Document(answer, page, (table("correlations", _COLUMNS, rows),))


def _named(coordinate: Coordinate) -> Line:
    photo, model, axis = coordinate
    return say("photo {}{} {}", photo, "" if model is None else say(" in {}", model), axis)
