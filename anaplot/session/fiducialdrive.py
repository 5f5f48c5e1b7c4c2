"""Where the plates are driven for a fiducial."""

from __future__ import annotations

import numpy as np

from anaplot.aliases import Side
from anaplot.errors import NotComputableError
from anaplot.photogrammetry.platetransformation import Placement, PlateTransformation
from anaplot.photogrammetry.readings import Position
from anaplot.planning.fiducialplan import expected_fiducials, predicted_fiducial
from anaplot.session.innerstate import InnerState
from anaplot.session.state import SessionState

__all__ = ["fiducial_target"]


def fiducial_target(
    state: SessionState, inner: InnerState, fiducial: str, middle: Position
) -> Position:
    """Return where the plates are driven for a fiducial; another plate waits at its centre.

    Parameters
    ----------
    state
        The session's state.
    inner
        The inner orientation in work.
    fiducial
        The fiducial.
    middle
        The middle of the travel: where a photo's centre is as long as nothing else is known. Once
        a photo was oriented in a carriage, the next one there is looked for where it lay.
    """
    calibration = state.block.camera_of(inner.photo).calibration
    assert calibration is not None
    expected = expected_fiducials(calibration)
    placed = _nominal(state, inner.side, middle)
    names = [*expected, ""]
    places = placed.to_plate(np.array([*expected.values(), (0.0, 0.0)]))
    nominal = {name: (x, y) for name, (x, y) in zip(names, places.tolist(), strict=True)}
    nominal.setdefault(fiducial, nominal[""])
    measured = {m.fiducial: (m.x, m.y) for m in inner.used}
    x, y = predicted_fiducial(expected, nominal, measured, fiducial)
    if state.current is not None and state.current.mono:
        return Position(x, y, x, y)
    other: Side = "right" if inner.side == "left" else "left"
    ((waiting_x, waiting_y),) = _nominal(state, other, middle).to_plate(np.zeros((1, 2))).tolist()
    if inner.side == "left":
        return Position(x, y, waiting_x, waiting_y)
    return Position(waiting_x, waiting_y, x, y)


def _nominal(state: SessionState, side: Side, middle: Position) -> PlateTransformation:
    """Return how a photo is thought to lie in a carriage before anything is measured in it."""
    for model in reversed(state.models):
        inner = model.inner_of(side)
        if inner is not None and inner.accepted is not None:
            try:
                return inner.accepted.placement().transformation()
            except (NotComputableError, ValueError):
                continue  # so odd that nothing follows from it for the next photo
    left = side == "left"
    x, y = (middle.xl, middle.yl) if left else (middle.xr, middle.yr)
    return Placement(x, y).transformation()
