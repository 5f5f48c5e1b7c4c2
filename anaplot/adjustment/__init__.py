"""Least squares and its statistics, independent of photographs."""
