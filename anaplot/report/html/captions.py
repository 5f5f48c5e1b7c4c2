"""What the tables of a report show, in a few words, and what columns without a title are called."""

from __future__ import annotations

__all__ = ["caption_of", "words_of"]

_CAPTIONS = {
    "accuracy": "Standard deviations of positions and points",
    "accuracy_angles": "Standard deviations of angles",
    "calibration": "Calibrated cameras",
    "check": "Check points: adjusted minus given",
    "choice": "Steps in which parameters were chosen",
    "components": "Variance components",
    "conditions": "Conditions between points",
    "control": "Control coordinates as observations",
    "covariance": "Unknowns",
    "covariance_pairs": "Differences of points",
    "covariance_places": "Error ellipses",
    "doming": "What further photos would tell",
    "files": "Files that were read",
    "functions": "Functions of coordinates",
    "hypotheses_check": "Check coordinates, the least probable first",
    "hypotheses_control": "Control coordinates, the least probable first",
    "hypotheses_deformations": "Deformations at check points",
    "hypotheses_parameters": "Additional parameters, each by itself",
    "off": "What is switched off, with its reasons",
    "overlaps": "What photos share with their neighbours",
    "parameters": "Additional parameters",
    "photos": "Orientations of the photos and their standard deviations",
    "plan_and_height": "What the photographs make of given points, minus what is given",
    "point_priors": "Priors of points",
    "points": "Adjusted points and their standard deviations",
    "priors": "What was known before: positions, angles, parameters",
    "rays": "Image coordinates: residuals, redundancy numbers and tests",
    "rejected": "Rejected observations",
    "snooping_classes": "Classes of observations",
    "thinning": "Photos before and after thinning",
}

_WORDS = {
    "flagged": "flag",
    "height_rejected": "test of height",
    "off": "off",
    "plan_rejected": "test of plan",
    "sha256": "SHA-256",
}


def caption_of(key: str) -> str:
    """Return the caption of a table by its key."""
    return _CAPTIONS.get(key) or key.replace("_", " ").capitalize()


def words_of(key: str) -> str:
    """Return what a column without a title is called, by its key."""
    return _WORDS.get(key) or key.replace("_", " ")
