"""What modified data snooping decided by model values: text and JSON."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from anaplot.adjustment.findings import ModelValues

__all__ = ["model_values_json", "model_values_line"]


def model_values_line(values: ModelValues) -> str:
    """Return one sentence about them."""
    otherwise = len(values.wrongly_accepted) + len(values.wrongly_rejected)
    return (
        f"model values decided {values.decided} times, exact ones {values.computed} times; in the "
        f"first step the exact test decides {otherwise} otherwise"
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
