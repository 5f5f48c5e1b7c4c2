"""Which observations of a block can be tested, those that are free of error among them."""

from __future__ import annotations

import numpy as np

from anaplot.adjustment.significance import TESTABLE
from anaplot.adjustment.tested import Tested
from anaplot.aliases import Bools
from anaplot.bundle.solve.conditions import Conditions
from anaplot.bundle.solve.observations import ObservationName

__all__ = ["checked_rows"]


def checked_rows(
    tested: Tested[ObservationName],
    conditions: Conditions | None,
    first: int,
    least: float = TESTABLE,
) -> Bools:
    """Return (n,) which observations take part and can be tested.

    Parameters
    ----------
    tested
        All of them.
    conditions
        Between points; those that are free of error have redundancy numbers of zero, and are
        tested by their multipliers wherever others check them.
    first
        Number of the conditions' first row.
    least
        Redundancy number of what can be tested.
    """
    can_be: Bools = tested.r >= least
    if conditions is not None:
        can_be[first:] |= conditions.firm & np.isfinite(tested.w[first:])
    return can_be & tested.use
