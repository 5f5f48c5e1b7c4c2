"""Whether anything has moved: several families of tests at one level."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

from anaplot.bundle.hypotheses.verdict import Verdict

__all__ = ["Overall", "overall"]


class Overall(NamedTuple):
    """Whether anything has moved: all families of tests together, at one level.

    Attributes
    ----------
    families
        Names of the families that could be tested.
    significance
        Smallest probability of a family, times their number (Bonferroni): if nothing has moved it
        is below alpha with a probability of alpha at most, however the families hang together.
    alpha
        Of all families together.
    """

    families: tuple[str, ...]
    significance: float
    alpha: float

    @property
    def rejected(self) -> bool:
        """Whether something has moved."""
        return self.significance < self.alpha


def overall(families: Mapping[str, Iterable[Verdict | None]], alpha: float) -> Overall | None:
    """Return all families at one level; None where nothing can be tested."""
    smallest: dict[str, float] = {}
    for name, verdicts in families.items():
        tests = [v.decisive for v in verdicts if v is not None and v.decisive is not None]
        if tests:
            smallest[name] = len(tests) * min(test.significance for test in tests)
    if not smallest:
        return None
    significance = min(1.0, len(smallest) * min(smallest.values()))
    return Overall(tuple(smallest), significance, alpha)
