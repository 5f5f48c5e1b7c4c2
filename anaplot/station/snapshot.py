"""What a station shows: immutable pictures of itself, made after every change."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from anaplot.orientation.results import Diagnosis, ModelSolution
from anaplot.session.events import Role

__all__ = ["LinkView", "PointStatus", "PointView", "ReadOut", "Snapshot"]

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
    """

    state: str
    profile: str = ""
    port: str = ""
    simulated: bool = False
    detail: str = ""


@dataclass(frozen=True, slots=True)
class ReadOut:
    """The live read-out: image coordinates [mm], parallaxes px = x' - x'', py = y' - y'' [mm]."""

    xl: float
    yl: float
    xr: float
    yr: float

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

    `times` counts how often it was recorded; `off_axes` names the rows switched off.
    """

    point: str
    role: Role
    x: float
    y: float
    status: PointStatus
    times: int
    off_axes: tuple[str, ...] = ()


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
        The point the plates are at or driving to, or None.
    next_point
        The point the operator is expected to measure next, or None.
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
