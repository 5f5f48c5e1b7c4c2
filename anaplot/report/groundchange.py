"""What a cleaning did to the points, as text and for programs."""

from __future__ import annotations

from typing import Any

from anaplot.photogrammetry.pointchange import PointChange
from anaplot.textfiles.wording import plain

__all__ = ["change_json", "change_lines"]


def change_lines(change: PointChange | None, where: str, unit: str) -> list[str]:
    """Return the sentence that says how far points have moved; none where nothing is known.

    Parameters
    ----------
    change
        The change.
    where
        "on the ground", "in the model".
    unit
        Of the coordinates.
    """
    if change is None:
        return []
    x, y, z = change.rms
    text = (
        f"{where}: {plain(change.point)} moves most, {change.axis} by {change.change:.4f} "
        f"{unit} (rms of all points X {x:.4f}  Y {y:.4f}  Z {z:.4f})"
    )
    sigma = change.sigma
    if sigma is not None:
        text += (
            f"; the standard deviation of {sigma.axis} of {plain(sigma.point)} becomes "
            f"{sigma.after:.4f} {unit}, it was {sigma.before:.4f}"
        )
    return [text]


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
