"""Names of scenarios stand by themselves, and are those that the scenarios have."""

from __future__ import annotations

from anaplot.planning.scenarionames import scenario_names
from anaplot.planning.scenarios import scenarios


def test_the_names_are_those_of_the_scenarios() -> None:
    assert scenario_names() == tuple(scenarios())
