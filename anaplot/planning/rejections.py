"""What every strategy rejects in one and the same system, for scenarios that compare them."""

from __future__ import annotations

from collections.abc import Iterable

from anaplot.adjustment.findings import SearchSettings
from anaplot.adjustment.residualsystem import ResidualSystem
from anaplot.adjustment.setodds import set_odds
from anaplot.adjustment.strategies import find_gross_errors
from anaplot.planning.levels import LEVEL

__all__ = ["SURE", "rejected_rows"]

SURE = "sure: the rows that by the odds more probably than not hold an error, each by itself"


def rejected_rows(
    system: ResidualSystem, methods: Iterable[str], alpha: float = LEVEL
) -> dict[str, tuple[int, ...]]:
    """Return the rows that each method rejects at a significance of single rows.

    Parameters
    ----------
    system
        All rows.
    methods
        Names of strategies; "odds" is the most probable set, and "sure" the rows that more
        probably than not hold an error, of one chain that begins with what the search finds.

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
        start = found["search"] if "search" in found else find_gross_errors(system, "search").rows
        odds = set_odds(system, start=start)
        weighed = {"odds": odds.best, "sure": odds.sure}
        found |= {method: rows for method, rows in weighed.items() if method in wanted}
    return found
