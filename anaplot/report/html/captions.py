"""What the tables of a report show, in a few words: a caption each."""

from __future__ import annotations

__all__ = ["caption_of"]

_CAPTIONS = {
    "photos": "Orientations of the photos and their standard deviations",
    "points": "Adjusted points and their standard deviations",
    "rays": "Image coordinates: residuals, redundancy numbers and tests",
    "control": "Control coordinates as observations",
    "check": "Check points: adjusted minus given",
    "priors": "What was known before: positions, angles, parameters",
    "point_priors": "Priors of points",
    "conditions": "Conditions between points",
    "parameters": "Additional parameters",
}


def caption_of(key: str) -> str:
    """Return the caption of a table by its key."""
    return _CAPTIONS.get(key) or key.replace("_", " ").capitalize()
