"""What a cleaning did to the points, as text and for programs."""

from __future__ import annotations

from typing import Any

from anaplot.photogrammetry.pointchange import PointChange
from anaplot.report.document import Line, say

__all__ = ["change_json", "change_lines"]


def change_lines(change: PointChange | None, where: str, unit: str, *, indent: int) -> list[Line]:
    """Return the sentence that says how far points have moved; none where nothing is known.

    Parameters
    ----------
    change
        The change.
    where
        "on the ground", "in the model".
    unit
        Of the coordinates.
    indent
        Blanks before it.
    """
    if change is None:
        return []
    x, y, z = change.rms
    line = say(
        "{}{}: {} moves most, {} by {:.4f} {} (rms of all points X {:.4f}  Y {:.4f}  Z {:.4f})",
        *(" " * indent, where, change.point, change.axis, change.change, unit, x, y, z),
    )
    sigma = change.sigma
    if sigma is not None:
        line += say(
            "; the standard deviation of {} of {} becomes {:.4f} {}, it was {:.4f}",
            *(sigma.axis, sigma.point, sigma.after, unit, sigma.before),
        )
    return [line]


def change_json(change: PointChange | None, unit: str) -> dict[str, Any] | None:
    """Return the change for programs; lengths have their unit in the key."""
    if change is None:
        return None
    x, y, z = change.rms
    sigma = change.sigma
    return {
        "point": change.point,
        "axis": change.axis,
        f"change_{unit}": change.change,
        f"rms_X_{unit}": x,
        f"rms_Y_{unit}": y,
        f"rms_Z_{unit}": z,
        "sigma_point": None if sigma is None else sigma.point,
        "sigma_axis": None if sigma is None else sigma.axis,
        f"sigma_before_{unit}": None if sigma is None else sigma.before,
        f"sigma_after_{unit}": None if sigma is None else sigma.after,
    }
