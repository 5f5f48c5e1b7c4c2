"""What robust weights of one pass after another begin with.

The Danish weights stand still in more than one place, and where several errors are large the last
digits of a linearisation decide in which they come to an end from ones. Where two passes differ,
the next one begins with weights that have one end only, and those after it where the pass before
left the rows: what comes again then has come to stay.
"""

from __future__ import annotations

from enum import Enum
from typing import TypeVar

__all__ = ["WeightsBegin"]

K = TypeVar("K")

_FROM_ONES = 2  # passes that the Danish weights begin with ones, then one with Huber's


class WeightsBegin(Enum):
    """What the weights of a pass begin with."""

    ONES = "ones"
    HUBER = "Huber's weights"
    AS_LEFT = "no weight for what the pass before rejected"

    @classmethod
    def of_pass(cls, strategy: str, before: int) -> WeightsBegin:
        """Return what the weights of a strategy begin with after some passes."""
        if strategy != "danish" or before < _FROM_ONES:
            return cls.ONES
        return cls.HUBER if before == _FROM_ONES else cls.AS_LEFT

    def without_weight(self, rejected: frozenset[K]) -> frozenset[K] | None:
        """Return what has no weight at first of the pass before's, see `find_gross_errors`."""
        if self is WeightsBegin.ONES:
            return None
        return rejected if self is WeightsBegin.AS_LEFT else frozenset()
