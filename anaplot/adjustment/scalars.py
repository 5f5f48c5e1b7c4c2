"""Numbers as arrays without dimension.

An operation on an array converts a float anew, which is half of its time where rows are few.
"""

from __future__ import annotations

import numpy as np

__all__ = ["HALF", "NONE", "ONE", "ZERO"]

ZERO, HALF, ONE, NONE = map(np.array, (0.0, 0.5, 1.0, np.nan))
