"""Tested observations made of rows, where a test asks for rows that no adjustment gives."""

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np

from anaplot.adjustment.tested import AppliedTest, Dense, Observation, Odds, Tested
from anaplot.orientation.results import ModelSolution


def observation(point, axis, residual, r, expected, w, *, flagged=False, **also) -> Observation:
    """A row of a model."""
    values = {"mdb": None, "effect": None, "probability": 0.0, **also}
    return Observation(
        (point, axis), "um", True, residual, r, expected, w, flagged=flagged, **values
    )


def made_of(
    rows: Iterable[Observation],
    test: AppliedTest,
    redundancy: int,
    sigma0: float | None,
    none: float = 0.9,
    dense: Callable[[], Dense] | None = None,
) -> Tested:
    """The rows as they are."""
    rows = list(rows)

    def column(name):
        return np.array([getattr(row, name) for row in rows], dtype=np.float64)

    tested = Tested(
        keys=[row.key for row in rows],
        units=[row.unit for row in rows],
        test=test,
        redundancy=redundancy,
        sigma0=sigma0,
        residual=column("residual"),
        r=column("r"),
        deviation=column("expected"),
        expected=column("expected"),
        w=column("w"),
        mdb=column("mdb"),
        effect=column("effect"),
        flagged=np.array([row.flagged for row in rows]),
        use=np.array([row.use for row in rows]),
        evidence=400.0 * column("r"),
        dense=dense,
    )
    vars(tested)["odds"] = Odds(column("probability"), none)
    return tested


def with_rows(solution: ModelSolution, rows: Iterable[Observation], **changes) -> ModelSolution:
    """A model with other rows; `changes` of test, redundancy and sigma0."""
    own = solution.tested
    values = {"test": own.test, "redundancy": own.redundancy, "sigma0": own.sigma0, **changes}
    made = made_of(rows, **values, none=own.odds.none, dense=own.dense)
    return replace(solution, tested=made)
