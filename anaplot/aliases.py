"""Type aliases that more than one module uses; what belongs to one module is written there.

Those of arrays are words that only a type checker resolves, and cost no NumPy; a union with one of
them is written as a word, too.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Literal, TypeAlias

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

__all__ = [
    "Array",
    "Axis",
    "Bools",
    "Complex",
    "Grouping",
    "Index",
    "PriorEstimator",
    "Progress",
    "RowKey",
    "SetName",
    "Side",
    "Strategy",
    "SwitchedBy",
    "TestKind",
]

Array: TypeAlias = "NDArray[np.float64]"
Complex: TypeAlias = "NDArray[np.complex128]"
Bools: TypeAlias = "NDArray[np.bool_]"
Index: TypeAlias = "NDArray[np.intp]"

Axis = Literal["x", "y"]
"""Axis of an image coordinate."""

Side = Literal["left", "right"]
"""Photo of a model."""

RowKey = tuple[str, str]
"""Point and axis of a model's row."""

TestKind = Literal["tau", "baarda"]
"""Pope's tau with the estimated sigma0, or Baarda's w with the a-priori one."""

Strategy = Literal["baarda", "tau", "rms", "modified", "huber", "danish", "l1", "search", "odds"]
"""Name of a strategy for gross errors."""

SwitchedBy = Literal[Strategy, "thin"]
"""What `adjust --apply` gives as its reason: the strategy, or that the point was thinned out."""

SetName = Literal["ebner", "gruen", "gruen50", "physical"]
"""Name of a set of additional parameters."""

Grouping = Literal["kinds", "axes", "strips", "operators"]
"""How image coordinates are grouped for variance components."""

PriorEstimator = Literal["known", "common", "separate"]
"""Which variance factors of prior knowledge are estimated."""

Progress = Callable[[str, float], None]
"""Told of a step and of how much of it is done (0 to 1); may raise to end the computation."""
