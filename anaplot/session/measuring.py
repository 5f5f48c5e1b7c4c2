"""What a record of the plotter is, in a session's state."""

from __future__ import annotations

from anaplot.errors import InputError
from anaplot.photogrammetry.readings import Record
from anaplot.session.events import Event, FiducialMeasured, MonoMeasured, PointMeasured
from anaplot.session.modelstate import ModelState
from anaplot.session.plates import image_of, plates_of
from anaplot.session.state import SessionState

__all__ = ["check_instrument", "measurement_of"]


def check_instrument(model: ModelState, *, mono: bool) -> None:
    """Check that a model can be measured in this kind of instrument as it is now.

    Raises
    ------
    InputError
        The model was begun in an instrument of the other kind, or no photo lies in the comparator.
    """
    if model.mono and not mono:
        raise InputError(f"model {model.name} was begun in a mono comparator: connect one, or undo")
    if mono and not model.mono:
        raise InputError(
            f"model {model.name} was begun in an instrument that holds both photos: connect one, "
            "or undo"
        )
    if model.mono and model.laid is None:
        raise InputError("no photo lies in the comparator: lay one in first")


def measurement_of(state: SessionState, model: ModelState, point: str, record: Record) -> Event:
    """Return the event that a record is: a fiducial on its plate, or a point in the images."""
    at, inner = record.position, model.open_inner
    if inner is not None:
        x, y = (at.xl, at.yl) if inner.side == "left" else (at.xr, at.yr)
        return FiducialMeasured(inner.photo, inner.side, point, x, y, record.switch)
    read = image_of(at, plates_of(state))
    if model.mono and model.laid is not None:
        return MonoMeasured(
            model.left, model.right, model.laid, point, read.xl, read.yl, record.switch
        )
    return PointMeasured(
        model.left, model.right, point, read.xl, read.yl, read.xr, read.yr, record.switch
    )
