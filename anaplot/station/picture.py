"""The snapshot of a session's state, whoever drives it: a station or a replay."""

from __future__ import annotations

from anaplot.photogrammetry.block import Block
from anaplot.planning.fiducialplan import expected_fiducials
from anaplot.session.innerstate import InnerState
from anaplot.session.innerwork import InnerOutlook, inner_outlook
from anaplot.session.state import ModelState, SessionState
from anaplot.session.workflow import Outlook
from anaplot.station.snapshot import (
    FiducialView,
    InnerView,
    LinkView,
    PointStatus,
    PointView,
    Snapshot,
)

__all__ = ["picture"]


def picture(
    block: Block,
    state: SessionState,
    view: Outlook,
    serial: int,
    target: str | None,
    link: LinkView,
) -> Snapshot:
    """Return everything a screen needs, consistent in itself.

    Parameters
    ----------
    block
        As declared.
    state, view
        The session's state and what follows from it.
    serial
        Number of the snapshot.
    target
        The point at which the plates are, or to which they drive.
    link
        The link as a person sees it.
    """
    model = state.current
    strip = model.strip if model is not None else ""
    number = count = 0
    if model is not None:
        models = next(s for s in block.strips if s.id == strip).models()
        number, count = models.index(model.photos) + 1, len(models)
    return Snapshot(
        serial=serial,
        block=block.name,
        strip=strip,
        left=model.left if model is not None else "",
        right=model.right if model is not None else "",
        model_number=number,
        model_count=count,
        accepted=tuple(m.photos for m in state.models),
        points=() if model is None else _points(model, view),
        target=target,
        next_point=view.next_point,
        solution=view.solution,
        diagnosis=view.diagnosis,
        problem=view.problem,
        expected=view.expected,
        may_accept=view.may_accept,
        may_undo=state.may_undo,
        suspended=state.suspended,
        finished=view.finished,
        link=link,
        tie_variance=block.precision.tie_variance,
        test=f"{block.test.kind} {block.test.alpha:g}",
        inners=() if model is None else tuple(_inner(block, i, view) for i in model.inner),
        mono=model is not None and model.mono,
        laid=model.photo(model.laid) if model is not None and model.laid is not None else "",
        next_photo=None
        if model is None or view.next_photo is None
        else model.photo(view.next_photo),
    )


def _inner(block: Block, inner: InnerState, view: Outlook) -> InnerView:
    current = view.inner is not None and view.inner.state is inner
    found: InnerOutlook = view.inner if current and view.inner else inner_outlook(block, inner)
    solution = found.solution
    flagged = set() if solution is None else {row.fiducial for row in solution.flagged}
    calibration = block.camera_of(inner.photo).calibration
    places = {} if calibration is None else expected_fiducials(calibration)
    fiducials = []
    for name in inner.fiducials:
        m = inner.measurement(name)
        status: PointStatus = "pending"
        if m is not None:
            status = "flagged" if name in flagged else "measured"
            if inner.is_off(name):
                status = "off"
        off = tuple(axis for axis in ("x", "y") if (name, axis) in inner.off)
        times = 0 if m is None else m.times
        fiducials.append(FiducialView(name, places.get(name), status, times, off))
    return InnerView(
        photo=inner.photo,
        side=inner.side,
        fiducials=tuple(fiducials),
        solution=solution,
        suspects=found.suspects,
        advice=found.advice,
        accepted=inner.accepted is not None,
    )


def _points(model: ModelState, view: Outlook) -> tuple[PointView, ...]:
    flagged = set() if view.solution is None else {row.point for row in view.solution.flagged}
    measured = {m.point: m for m in model.measured}
    out = []
    for planned in model.plan:
        name = planned.point
        m = measured.get(name)
        status: PointStatus = "pending"
        if m is not None:
            status = "flagged" if name in flagged else "measured"
            if model.is_off(name):
                status = "off"
        off = tuple(axis for axis in model.axes(name) if (name, axis) in model.off)
        x, y = (planned.xl, planned.yl) if m is None else (m.xl, m.yl)
        times = 0 if m is None else m.times
        seen = tuple(s.side for s in model.seen if s.point == name)
        out.append(PointView(name, planned.role, x, y, status, times, off, seen))
    return tuple(out)
