"""Approximate values of photos and points from nothing."""
