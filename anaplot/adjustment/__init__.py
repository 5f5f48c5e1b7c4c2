"""Least squares and its statistics; knows nothing of photographs."""
