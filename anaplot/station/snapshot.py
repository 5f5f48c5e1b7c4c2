"""What a station shows: immutable pictures of itself, made after every change."""

from __future__ import annotations

from dataclasses import astuple, dataclass
from typing import Literal

from anaplot.aliases import Axis, Side
from anaplot.orientation.results import Diagnosis, ModelSolution
from anaplot.photogrammetry.block import Block
from anaplot.photogrammetry.inner import InnerOrientation
from anaplot.planning.fiducialplan import expected_fiducials
from anaplot.session.accidents import Accident
from anaplot.session.desk import Desk
from anaplot.session.events import Role
from anaplot.session.innerstate import InnerState
from anaplot.session.innerwork import InnerOutlook, inner_outlook
from anaplot.session.modelstate import ModelState
from anaplot.session.nextstep import NO_AGENDA, Agenda
from anaplot.session.othernames import OtherName
from anaplot.session.reasons import LastChange
from anaplot.session.recomputed import Recomputed
from anaplot.session.tiecheck import TieCheck
from anaplot.session.transfer import Mark, Transfer
from anaplot.session.workflow import Outlook
from anaplot.station.blockstatus import BlockStatus
from anaplot.station.blockview import BlockView
from anaplot.station.returnadvice import ReturnAdvice, return_advice

__all__ = [
    "FiducialView",
    "InnerView",
    "LinkView",
    "PointStatus",
    "PointView",
    "Snapshot",
    "snapshot_of",
]

PointStatus = Literal["pending", "measured", "flagged", "off"]


@dataclass(frozen=True, slots=True)
class LinkView:
    """The link as a person sees it.

    Attributes
    ----------
    state
        closed, opening, live, silent, lost or reconnecting; "none" when no plotter was asked for.
    profile, port
        Names; empty without a plotter.
    simulated
        Whether the plotter is a simulated one.
    detail
        The last fault or reason, one line, already made safe for display.
    parity_unchecked
        Whether the profile has a parity that the line does not check.
    """

    state: str
    profile: str = ""
    port: str = ""
    simulated: bool = False
    detail: str = ""
    parity_unchecked: bool = False


@dataclass(frozen=True, slots=True)
class PointView:
    """One point of the current model: planned or measured position in the left photo [mm].

    `times` counts how often it was recorded; `off_axes` names the rows switched off. `seen`: in
    which photos of a model in a mono comparator it was measured. `mark`: whether it is known from
    another strip or on the ground. `offered`: the model is complete without it; then `sigma` is
    the standard deviation of its expected place [mm], None where it is marked.
    """

    point: str
    role: Role
    x: float
    y: float
    status: PointStatus
    times: int
    off_axes: tuple[str, ...] = ()
    seen: tuple[Side, ...] = ()
    mark: Mark = ""
    offered: bool = False
    sigma: float | None = None


@dataclass(frozen=True, slots=True)
class FiducialView:
    """One fiducial of a photo: its place in the fiducial system [mm], None where it is not known.

    `times` counts how often it was recorded; `off_axes` names the rows switched off.
    """

    fiducial: str
    place: tuple[float, float] | None
    status: PointStatus
    times: int
    off_axes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class InnerView:
    """The inner orientation of a photo of the current model.

    Attributes
    ----------
    photo, side
        The photo, and the carriage in which it lies.
    fiducials
        In the order of the certificate.
    solution
        The inner orientation as far as measured, its table in `solution.rows`; None while it is
        not determined.
    suspects
        Rows (fiducial, axis) to measure again, the one to begin with first; axis None: the whole
        fiducial.
    advice
        Sentences for the operator, the most useful first.
    accepted
        Whether it is accepted.
    """

    photo: str
    side: Side
    fiducials: tuple[FiducialView, ...]
    solution: InnerOrientation | None
    suspects: tuple[tuple[str, Axis | None], ...]
    advice: tuple[str, ...]
    accepted: bool


@dataclass(frozen=True, slots=True)
class Snapshot:
    """Everything a screen needs, consistent in itself.

    Attributes
    ----------
    serial
        Increases with every snapshot.
    block, strip, left, right
        Names; strip, left and right are empty before a model is chosen.
    model_number, model_count
        Which model of the strip this is (from 1) and how many the strip has.
    accepted
        (left, right) of the models accepted so far.
    points
        Points of the current model in plan order, then those that are offered beyond it.
    target
        The point, or during an inner orientation the fiducial, that the plates are at or driving
        to, or None.
    next_point
        The point or fiducial the operator is expected to measure next, or None.
    solution, diagnosis
        The model as far as measured, or None while it is not determined.
    problem
        Why there is no solution, or "".
    expected
        What the operator is expected to do now.
    may_accept, may_undo, suspended, finished
        What may happen next.
    link
        The link's state.
    tie_variance, test
        Names of the choices in force, e.g. "propagated", "baarda 0.001".
    inners
        Inner orientations of the current model's photos, left first; none where the cameras have
        no fiducials.
    block_view
        What the block as one bundle says; None before there is anything to adjust.
    status
        Where the block stands, model by model; None where nobody keeps it.
    mono
        Whether the current model is measured in a mono comparator, one photo after the other.
    laid
        The photo in the mono comparator; "" when nobody knows, or there is none.
    next_photo
        The photo to lay into the mono comparator next, or None.
    unreferenced
        The counters have lost their reference; `expected` says what to do.
    reference_point
        The point or fiducial on which the mark is to be set then, or None.
    reopened
        Whether the current model is accepted already, and the operator returned to it.
    wanted
        The point that is to be measured again in it, or None.
    returning
        The accepted model to return to now, and why; `expected` says it, too. None: there is none.
    checks
        Points still to be recorded again, to check how photos lie that were laid in anew.
    recomputed
        Accepted models that are others than when they were accepted, and what has changed.
    last_change
        The latest change of a measurement, of which a reason may be given, or None.
    agenda
        What may be done now, the most urgent first: `expected` in parts.
    drives
        Whether the instrument drives its plates.
    repeating
        How often the target was pointed at again, and how often it is to be; None when it is
        measured.
    ties
        The strip in work against every other one and against the control.
    accidents
        What is wrong with the numbers of points, and with ties.
    other_names
        What points of the current model are probably called instead.
    hint
        What is to be done before points of other strips can be offered, or "".
    """

    serial: int
    block: str
    strip: str
    left: str
    right: str
    model_number: int
    model_count: int
    accepted: tuple[tuple[str, str], ...]
    points: tuple[PointView, ...]
    target: str | None
    next_point: str | None
    solution: ModelSolution | None
    diagnosis: Diagnosis | None
    problem: str
    expected: str
    may_accept: bool
    may_undo: bool
    suspended: bool
    finished: bool
    link: LinkView
    tie_variance: str
    test: str
    inners: tuple[InnerView, ...] = ()
    block_view: BlockView | None = None
    status: BlockStatus | None = None
    mono: bool = False
    laid: str = ""
    next_photo: str | None = None
    unreferenced: bool = False
    reference_point: str | None = None
    reopened: bool = False
    wanted: str | None = None
    returning: ReturnAdvice | None = None
    checks: tuple[str, ...] = ()
    recomputed: tuple[Recomputed, ...] = ()
    last_change: LastChange | None = None
    agenda: Agenda = NO_AGENDA
    drives: bool = True
    repeating: tuple[int, int] | None = None
    ties: tuple[TieCheck, ...] = ()
    accidents: tuple[Accident, ...] = ()
    other_names: tuple[OtherName, ...] = ()
    hint: str = ""

    @property
    def inner(self) -> InnerView | None:
        """The inner orientation in work, or None when points are measured.

        In a mono comparator that of the photo in it.
        """
        there = (i for i in self.inners if not self.mono or i.photo == self.laid)
        return next((inner for inner in there if not inner.accepted), None)


def snapshot_of(
    desk: Desk,
    serial: int,
    link: LinkView,
    status: BlockStatus | None = None,
) -> Snapshot:
    """Return everything a screen needs, consistent in itself.

    Parameters
    ----------
    desk
        As it stands.
    serial
        Number of the snapshot.
    link
        The link as a person sees it.
    status
        Where the block stands and what it says as one bundle, or None.
    """
    state, view = desk.state, desk.outlook
    block, model = state.block, state.current
    strip = model.strip if model is not None else ""
    returning = return_advice(desk, None if status is None else status.block)
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
        points=() if model is None else _points(model, view, desk.transfer),
        target=desk.target,
        next_point=desk.next_name,
        solution=view.solution,
        diagnosis=view.diagnosis,
        problem=view.problem,
        expected=desk.expected if returning is None else returning.agenda.sentence,
        may_accept=view.may_accept,
        may_undo=state.may_undo,
        suspended=state.suspended,
        finished=view.finished,
        link=link,
        tie_variance=block.precision.tie_variance,
        test=f"{block.test.kind} {block.test.alpha:g}",
        inners=() if model is None else tuple(_inner(block, i, view) for i in model.inner),
        block_view=None if status is None else status.block,
        status=status,
        mono=model is not None and model.mono,
        laid=model.photo(model.laid) if model is not None and model.laid is not None else "",
        next_photo=None
        if model is None or view.next_photo is None
        else model.photo(view.next_photo),
        unreferenced=desk.referencing is not None,
        reference_point=None if desk.reference is None else desk.reference.name,
        reopened=state.returned is not None,
        wanted=None if state.returned is None else state.returned.point,
        returning=returning,
        checks=desk.checks,
        recomputed=desk.recomputed,
        last_change=state.last_change,
        agenda=desk.agenda if returning is None else returning.agenda,
        drives=desk.abilities is not None and desk.abilities.drives,
        repeating=None if desk.repeating is None else (desk.repeating.done, desk.repeating.times),
        ties=desk.transfer.checks,
        accidents=desk.accidents,
        other_names=desk.other_names,
        hint=desk.transfer.hint,
    )


def _inner(block: Block, inner: InnerState, view: Outlook) -> InnerView:
    current = view.inner is not None and view.inner.state is inner
    found: InnerOutlook = view.inner if current and view.inner else inner_outlook(block, inner)
    solution = found.solution
    flagged = set() if solution is None else {row.point for row in solution.flagged}
    calibration = block.camera_of(inner.photo).calibration
    places = {} if calibration is None else expected_fiducials(calibration)
    fiducials = []
    for name in inner.fiducials:
        m = inner.measurement(name)
        status = _status(m is not None, name in flagged, inner.is_off(name))
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


def _points(model: ModelState, view: Outlook, known: Transfer) -> tuple[PointView, ...]:
    flagged = set() if view.solution is None else {row.point for row in view.solution.flagged}
    measured = {m.point: m for m in model.measured}
    out = []
    for planned in model.plan:
        name = planned.point
        m = measured.get(name)
        status = _status(m is not None, name in flagged, model.is_off(name))
        off = tuple(axis for axis in model.axes(name) if (name, axis) in model.off)
        x, y = (planned.xl, planned.yl) if m is None else (m.xl, m.yl)
        times = 0 if m is None else m.times
        seen = tuple(s.side for s in model.seen if s.point == name)
        mark = known.marks.get(name, "")
        out.append(PointView(name, planned.role, x, y, status, times, off, seen, mark))
    for offer in known.offers:
        name, role, x, y, *_ = astuple(offer.planned)
        out.append(
            PointView(
                name, role, x, y, "pending", 0, mark=offer.mark, offered=True, sigma=offer.sigma
            )
        )
    return tuple(out)


def _status(measured: bool, flagged: bool, off: bool) -> PointStatus:
    if off:
        return "off"
    if not measured:
        return "pending"
    return "flagged" if flagged else "measured"
