"""What every strategy rejects in one and the same system, for scenarios that compare them."""

from __future__ import annotations

from collections.abc import Iterable

from anaplot.adjustment.findings import SearchSettings
from anaplot.adjustment.residualsystem import ResidualSystem
from anaplot.adjustment.strategies import find_gross_errors, most_probable_rows
from anaplot.planning.scenarioalpha import PAPER_ALPHA

__all__ = ["SURE", "rejected_rows"]

SURE = "sure: the rows that by the odds more probably than not hold an error, each by itself"


def rejected_rows(
    system: ResidualSystem, methods: Iterable[str], alpha: float = PAPER_ALPHA
) -> dict[str, tuple[int, ...]]:
    """Return the rows that each method rejects at a significance of single rows.

    Parameters
    ----------
    system
        All rows.
    methods
        Names of strategies; "sure" are the rows that by the odds hold an error more probably than
        not.
    alpha
        Significance of a single row.

    Raises
    ------
    ValueError
        No such strategy.
    """
    wanted = tuple(methods)
    settings = SearchSettings(alpha=alpha)
    found = {
        method: find_gross_errors(system, method, settings).rows
        for method in wanted
        if method not in ("odds", "sure")
    }
    if "odds" in wanted or "sure" in wanted:
        odds, sure = most_probable_rows(system, settings, sure="sure" in wanted)
        found |= {m: rows for m, rows in (("odds", odds), ("sure", sure)) if m in wanted}
    return found
