"""Pointing again at something measured, for the precision of pointing alone.

Between two pointings the mark is moved away, so that the second one owes nothing to the first. What
comes of it changes neither measurement nor model.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from math import cos, hypot, isfinite, pi, sin
from typing import Protocol

from anaplot.aliases import Side
from anaplot.errors import InputError
from anaplot.photogrammetry.block import Block
from anaplot.photogrammetry.readings import Position
from anaplot.session.events import (
    Event,
    FiducialMeasured,
    MonoMeasured,
    Place,
    PointMeasured,
    PointRepeated,
)
from anaplot.session.modelstate import ModelState
from anaplot.session.nextstep import Agenda, Step
from anaplot.session.pointcheck import check_place
from anaplot.session.refusal import EventRefusedError

__all__ = [
    "AWAY_MM",
    "Repeating",
    "begin_repeating",
    "check_repetition",
    "measured_at",
    "repetition",
]

AWAY_MM = 0.05
"""How far the plates are moved away before something is pointed at again."""
_SEEN_AWAY_MM = 0.5 * AWAY_MM  # a hand need not be exact


class _Mode(Protocol):
    """What a mode of measuring says of something measured; see `anaplot.session.modes`."""

    @property
    def model(self) -> ModelState: ...
    @property
    def unit(self) -> str: ...
    @property
    def side(self) -> Side | None: ...
    def stands(self, name: str, middle: Position) -> Position | None: ...


@dataclass(frozen=True, slots=True)
class Repeating:
    """How far pointing again at something has come.

    Attributes
    ----------
    name, unit
        Of the point or fiducial, and which of the two it is.
    times, done
        How often it is to be pointed at again, and how often it was.
    last
        Where the carriages stood at the pointing before [mm].
    side
        The carriage in which a fiducial lies; None: both count.
    moved
        Whether the mark was away from it since.
    """

    name: str
    unit: str
    times: int
    last: Position
    side: Side | None = None
    done: int = 0
    moved: bool = False

    def agenda(self, *, moves: bool) -> Agenda:
        """Return what is to be done; `moves`: the plates move by themselves."""
        words = f"set the mark on {self.unit} {self.name} anew"
        if not (moves or self.moved):
            words = f"move the mark away from {self.unit} {self.name}, set it anew"
        return Agenda((Step("measure", words, self.name),), f"{self.done + 1} of {self.times}")

    def after(self, position: Position) -> Repeating:
        """Return how far it has come when the mark was set once more."""
        return replace(self, done=self.done + 1, last=position)

    def is_away(self, position: Position) -> bool:
        """Whether the mark is away from where it was set before, in every photo pointed at."""
        left = hypot(position.xl - self.last.xl, position.yl - self.last.yl) >= _SEEN_AWAY_MM
        right = hypot(position.xr - self.last.xr, position.yr - self.last.yr) >= _SEEN_AWAY_MM
        return left if self.side == "left" else right if self.side == "right" else left and right

    def away(self, mode: _Mode, middle: Position) -> Position:
        """Return where the plates go: 50 um from it, each in a direction of its own.

        The directions are as good as drawn by lot, and the same ones whenever all of it happens
        once more.
        """
        at = mode.stands(self.name, middle)
        if at is None:
            raise InputError(f"{self.unit} {self.name} is not measured yet")
        seed = hashlib.sha256(repr((mode.model.photos, self.name, self.done, self.last)).encode())
        turns = [int.from_bytes(seed.digest()[k : k + 4], "big") / 2.0**32 for k in (0, 4)]
        (dxl, dyl), (dxr, dyr) = (
            (AWAY_MM * cos(2.0 * pi * turn), AWAY_MM * sin(2.0 * pi * turn)) for turn in turns
        )
        if mode.model.mono:
            dxr, dyr = dxl, dyl  # one plate
        elif self.side == "left":
            dxr = dyr = 0.0
        elif self.side == "right":
            dxl = dyl = 0.0
        return Position(at.xl + dxl, at.yl + dyl, at.xr + dxr, at.yr + dyr)


def begin_repeating(mode: _Mode, name: str, times: int, middle: Position) -> Repeating:
    """Return pointing again before the first time.

    Raises
    ------
    InputError
        It is not measured.
    """
    at = mode.stands(name, middle)
    if at is None:
        raise InputError(f"{mode.unit} {name} is not measured yet: there is nothing to repeat")
    return Repeating(name, mode.unit, times, at, mode.side)


def repetition(model: ModelState, measured: Event, *, moved: bool) -> PointRepeated:
    """Return the event of a pointing that would have been a measurement, but only repeats one."""
    sides: tuple[Side, Side] = ("left", "right")
    match measured:
        case PointMeasured():
            xy = ((measured.xl, measured.yl), (measured.xr, measured.yr))
            places = tuple(
                Place(model.photo(side), side, *at) for side, at in zip(sides, xy, strict=True)
            )
            name, switch = measured.point, measured.switch
        case MonoMeasured():
            photo = model.photo(measured.side)
            places = (Place(photo, measured.side, measured.x, measured.y),)
            name, switch = measured.point, measured.switch
        case FiducialMeasured():
            places = (Place(measured.photo, measured.side, measured.x, measured.y),)
            name, switch = measured.fiducial, measured.switch
        case _:
            raise TypeError(f"{measured.kind} is no measurement")
    fiducial = isinstance(measured, FiducialMeasured)
    return PointRepeated(model.left, model.right, name, fiducial, places, moved, switch)


def measured_at(model: ModelState, event: PointRepeated) -> tuple[tuple[float, float], ...] | None:
    """Return the coordinates [mm] that a pointing repeats, photo by photo; None without any."""
    found: list[tuple[float, float]] = []
    for place in event.places:
        where = model.fiducial_place if event.fiducial else model.place_of
        at = where(place.side, event.name)
        if at is None:
            return None
        found.append(at)
    return tuple(found)


def check_repetition(block: Block, model: ModelState, event: PointRepeated) -> None:
    """Check that something measured can be pointed at again now.

    Raises
    ------
    EventRefusedError
        Another model is in the instrument, the photos are not those that are pointed at together,
        it is not measured, or lies outside the photo.
    """
    what = f"{'fiducial' if event.fiducial else 'point'} {event.name}"
    if (event.left, event.right) != model.photos:
        raise EventRefusedError(
            f"{what} of {event.left}/{event.right}: {model.name} is in the instrument"
        )
    inner = model.open_inner
    if event.fiducial != (inner is not None):
        raise EventRefusedError(
            f"{what}: {'points are' if inner is None else 'the inner orientation is'} measured now"
        )
    sides = tuple(place.side for place in event.places)
    together: tuple[Side, ...] = model.carriages if inner is None else (inner.side,)
    if sides != together:
        raise EventRefusedError(f"{what}: not in the photos that are pointed at now")
    for place in event.places:
        if place.photo != model.photo(place.side):
            raise EventRefusedError(f"photo {place.photo} does not lie on the {place.side}")
        if not (isfinite(place.x) and isfinite(place.y)):
            raise EventRefusedError(f"{what}: ({place.x:g}, {place.y:g}) is no place")
        if not event.fiducial:
            check_place(block, place.photo, event.name, place.x, place.y)
    if measured_at(model, event) is None:
        raise EventRefusedError(f"{what} is not measured: there is nothing to repeat")
