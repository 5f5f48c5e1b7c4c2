"""What `anaplot plan` computes, one function a command: `anaplot.plan.pattern("13/5")`."""

from __future__ import annotations

from anaplot.report.networkcomparison import compared_networks as networks
from anaplot.report.patterncomparison import compared_patterns as patterns
from anaplot.report.planadditional import planned_additional as additional
from anaplot.report.planblock import planned_block as block
from anaplot.report.plannetwork import planned_network as network
from anaplot.report.planpattern import planned_pattern as pattern
from anaplot.report.planseries import block_series

__all__ = ["additional", "block", "block_series", "network", "networks", "pattern", "patterns"]
