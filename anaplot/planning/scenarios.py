"""All named scenarios, to be run by anyone: `anaplot plan simulate --list`."""

from __future__ import annotations

from anaplot.planning import (
    bayesscenarios,
    bayestables,
    blockscenarios,
    modelscenarios,
    networkscenarios,
    stripscenarios,
    tiltedscenarios,
)
from anaplot.planning.montecarlo import Scenario

__all__ = ["scenarios"]

_ROOMS = (
    modelscenarios,
    stripscenarios,
    blockscenarios,
    tiltedscenarios,
    networkscenarios,
    bayesscenarios,
    bayestables,
)


def scenarios() -> dict[str, Scenario]:
    """Return every named scenario by its name."""
    return {scenario.name: scenario for room in _ROOMS for scenario in room.scenarios()}
