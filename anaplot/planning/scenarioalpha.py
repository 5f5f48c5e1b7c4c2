"""The significance of single rows in a scenario: that of the papers, or another one."""

from __future__ import annotations

from dataclasses import fields, is_dataclass, replace
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from anaplot.planning.montecarlo import Scenario

__all__ = ["PAPER_ALPHA", "alpha_of", "with_alpha"]

PAPER_ALPHA = 0.001
"""Significance of a single row in the papers."""


def with_alpha(scenario: Scenario, alpha: float) -> Scenario | None:
    """Return a scenario with all its tests at another significance; None where it has its own.

    What is known of its figures holds for the papers' significance, unless the scenario itself
    computes it.
    """
    of: Any = scenario
    names = {each.name for each in fields(of)} if is_dataclass(of) else set()
    changes: dict[str, Any] = {}
    if "alphas" in names:
        changes["alphas"] = (alpha,)
    elif "alpha" in names:
        changes["alpha"] = alpha
    else:
        return None
    if "references" in names and alpha != PAPER_ALPHA:
        changes["references"] = {}
    changed: Scenario = replace(of, **changes)
    return changed


def alpha_of(scenario: Scenario) -> float | None:
    """Return the one significance of single rows of a scenario; None where it has several."""
    alphas: tuple[float, ...] = getattr(scenario, "alphas", ())
    if len(alphas) == 1:
        return float(alphas[0])
    alpha = getattr(scenario, "alpha", None)
    return None if alpha is None else float(alpha)
