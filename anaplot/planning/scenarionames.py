"""What the scenarios are called: a name is completed without the mathematics behind it."""

from __future__ import annotations

from anaplot.orientation.patterns import PATTERNS

__all__ = ["scenario_names", "scenario_of_pattern"]

_OTHERS = (
    *("size-models", "size-strips", "size-blocks", "block-errors-10", "block-errors-20"),
    *("strategies-tilted", "gruen-1978-methods", "bayes-G0A", "bayes-G0B"),
    *(f"bayes-G{group}{letter}" for group in (1, 2, 3, 4) for letter in "ABC"),
    "bayes-tables",
)


def scenario_of_pattern(pattern: str) -> str:
    """Return the name of the scenario of one error in models of a pattern."""
    return f"kratky-1983-{pattern.replace('/', '-')}"


def scenario_names() -> tuple[str, ...]:
    """Return the names of all scenarios, in the order of `planning.scenarios.scenarios`."""
    return (*map(scenario_of_pattern, PATTERNS), *_OTHERS)
