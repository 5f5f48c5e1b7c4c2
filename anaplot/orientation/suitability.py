"""Which patterns of points are not suitable for on-line triangulation (1983)."""

from __future__ import annotations

from collections.abc import Iterable

from anaplot.adjustment.tested import Transfer
from anaplot.orientation.diagnosis import diagnose
from anaplot.orientation.patterns import USUAL_BASE, USUAL_C, USUAL_D, Pattern, ideal_model
from anaplot.orientation.results import Row

__all__ = ["pattern_verdict", "unsuitable"]


def unsuitable(transfers: Iterable[Transfer[Row]]) -> str:
    """Say why a pattern is none for on-line triangulation, or return "".

    Those with a critical transfer of errors "are not suitable for on-line triangulation because of
    their critical error transfer, which prevents an efficient quality control" (Kratky and
    El-Hakim 1983, of six and nine points).
    """
    critical = [one for one in transfers if one.critical]
    if not critical:
        return ""
    worst = max(critical, key=lambda one: one.share)
    return (
        "not suitable for on-line triangulation: an error in {} ({}) shows {:.1f} times as large "
        "in {} ({})".format(*worst.source, worst.share, *worst.target)
    )


def pattern_verdict(pattern: Pattern) -> str:
    """Say of a named pattern whether it is suitable; "" when it is."""
    at = pattern.positions(USUAL_BASE, USUAL_D)
    model = ideal_model(at, pattern.ties, USUAL_BASE, USUAL_C)
    verdict = unsuitable(diagnose(model).transfers)
    return f"pattern {pattern.name} is {verdict}" if verdict else ""
