"""What modified data snooping decided by model values, in words and for programs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from anaplot.adjustment.findings import ModelValues
from anaplot.report.document import Line, say

__all__ = ["model_values_json", "model_values_line"]


def model_values_line(values: ModelValues) -> Line:
    """Return one sentence about them."""
    otherwise = len(values.wrongly_accepted) + len(values.wrongly_rejected)
    return say(
        "model values decided {} times, exact ones {} times; in the first step the exact test "
        "decides {} otherwise",
        values.decided,
        values.computed,
        otherwise,
    )


def model_values_json(values: ModelValues, name: Callable[[int], dict[str, Any]]) -> dict[str, Any]:
    """Return them for programs.

    Parameters
    ----------
    values
        From the findings.
    name
        Makes the identity of a row from its index.
    """
    return {
        "computed": values.computed,
        "decided": values.decided,
        "wrongly_accepted": [name(row) for row in values.wrongly_accepted],
        "wrongly_rejected": [name(row) for row in values.wrongly_rejected],
        "beyond_tolerance": values.beyond_tolerance,
    }
