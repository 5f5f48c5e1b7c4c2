"""Gross errors of a block."""
