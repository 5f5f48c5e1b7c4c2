"""Hypotheses on an adjusted block, and its variance components."""
