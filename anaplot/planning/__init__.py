"""Synthetic strips: what an ideal flight would show."""
