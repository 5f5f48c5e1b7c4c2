"""Which patterns of points are not suitable for on-line triangulation (1983)."""

from __future__ import annotations

from collections.abc import Iterable

from anaplot.adjustment.partners import rounded
from anaplot.adjustment.tested import Transfer
from anaplot.orientation.diagnosis import diagnose
from anaplot.orientation.idealmodel import ideal_model
from anaplot.orientation.ownpattern import PointPattern
from anaplot.orientation.patterns import USUAL_C, USUAL_D
from anaplot.orientation.results import Row
from anaplot.textfiles.wording import plain

__all__ = ["pattern_verdict", "unsuitable", "worst_transfer"]


def worst_transfer(transfers: Iterable[Transfer[Row]]) -> Transfer[Row] | None:
    """Return the critical transfer that misleads most, the first of equal ones; None without any.

    In a symmetric pattern many are equal: rounding must not say which one is named.
    """
    critical = (one for one in transfers if one.critical)
    return max(critical, key=lambda one: rounded(one.share), default=None)


def unsuitable(transfers: Iterable[Transfer[Row]]) -> str:
    """Say why a pattern is none for on-line triangulation, or return "".

    Those with a critical transfer of errors "are not suitable for on-line triangulation because of
    their critical error transfer, which prevents an efficient quality control" (Kratky and
    El-Hakim 1983, of six and nine points).
    """
    worst = worst_transfer(transfers)
    if worst is None:
        return ""
    return (
        "not suitable for on-line triangulation: an error in {} ({}) shows {:.1f} times as large "
        "in {} ({})".format(*worst.source, worst.share, *worst.target)
    )


def pattern_verdict(pattern: PointPattern) -> str:
    """Say of a pattern whether it is suitable; "" when it is."""
    base = pattern.usual_base
    model = ideal_model(pattern.positions(base, USUAL_D), pattern.ties, base, USUAL_C)
    verdict = unsuitable(diagnose(model).transfers)
    return f"pattern {plain(pattern.name, 100)} is {verdict}" if verdict else ""
