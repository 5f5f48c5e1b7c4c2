"""What a station shows: immutable pictures of itself, made after every change."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from anaplot.orientation.results import Diagnosis, ModelSolution
from anaplot.photogrammetry.inner import InnerOrientation
from anaplot.session.events import Axis, Role, Side
from anaplot.station.blockview import BlockView

__all__ = [
    "FiducialView",
    "InnerView",
    "LinkView",
    "PointStatus",
    "PointView",
    "ReadOut",
    "Snapshot",
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
class ReadOut:
    """The live read-out: image coordinates [mm], parallaxes px = x' - x'', py = y' - y'' [mm].

    `plate_left` and `plate_right` say that the coordinates of that photo are plate coordinates,
    for its inner orientation is still to be accepted; parallaxes mean nothing then. `mono`: both
    are those of the one photo in a mono comparator.
    """

    xl: float
    yl: float
    xr: float
    yr: float
    plate_left: bool = False
    plate_right: bool = False
    mono: bool = False

    @property
    def px(self) -> float:
        """x-parallax [mm]."""
        return self.xl - self.xr

    @property
    def py(self) -> float:
        """y-parallax [mm]."""
        return self.yl - self.yr


@dataclass(frozen=True, slots=True)
class PointView:
    """One point of the current model: planned or measured position in the left photo [mm].

    `times` counts how often it was recorded; `off_axes` names the rows switched off. `seen`: in
    which photos of a model in a mono comparator it was measured.
    """

    point: str
    role: Role
    x: float
    y: float
    status: PointStatus
    times: int
    off_axes: tuple[str, ...] = ()
    seen: tuple[Side, ...] = ()


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
        Points of the current model in plan order.
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
    mono: bool = False
    laid: str = ""
    next_photo: str | None = None
    unreferenced: bool = False
    reference_point: str | None = None

    @property
    def inner(self) -> InnerView | None:
        """The inner orientation in work, or None when points are measured.

        In a mono comparator that of the photo in it.
        """
        there = (i for i in self.inners if not self.mono or i.photo == self.laid)
        return next((inner for inner in there if not inner.accepted), None)
