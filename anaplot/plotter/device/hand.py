"""The hand at a simulated device: what lies there, and how it sets the mark on it."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array, Side
from anaplot.errors import InputError
from anaplot.plotter.readings import Position

__all__ = [
    "Hand",
    "HandSettled",
    "Observer",
    "Offsets",
    "Photographs",
    "Pointing",
    "fiducial_name",
    "monocular_name",
    "transfer_error",
]

Photographs = Mapping[str, Mapping[str, tuple[float, float]]]
"""Photo -> point -> true plate coordinates (x, y) [mm], fiducials among them."""

Key = tuple[str, str, str]
"""(left, right, point)."""


@dataclass(frozen=True, slots=True)
class Offsets:
    """Where the hand sets the mark wrongly [mm]; `count` first pointings are affected."""

    dxl: float = 0.0
    dyl: float = 0.0
    dxr: float = 0.0
    dyr: float = 0.0
    count: int = 1

    @property
    def array(self) -> Array:
        """(4,) dxl, dyl, dxr, dyr."""
        return np.array([self.dxl, self.dyl, self.dxr, self.dyr])


@dataclass(frozen=True, slots=True)
class Hand:
    """The simulated operator's hand.

    Attributes
    ----------
    follow
        After a drive the hand sets the mark on the nearest true point.
    auto_pedal
        It presses the pedal when the mark is set.
    pedal
        Name of the footswitch.
    search_radius
        Farthest true point that it looks for [mm], judged in the left plate.
    fiducial_radius
        Farthest fiducial that it looks for [mm], judged in the plate where it points.
    settle_time, pedal_time
        Simulated seconds to set the mark, and until the pedal is pressed.
    """

    follow: bool = True
    auto_pedal: bool = False
    pedal: str = "pedal"
    search_radius: float = 5.0
    fiducial_radius: float = 25.0
    settle_time: float = 0.8
    pedal_time: float = 0.2


@dataclass(frozen=True, slots=True)
class HandSettled:
    """The hand has set the mark on a point, or found none (None): ready to record.

    Attributes
    ----------
    point
        Name of the true point.
    position
        Where the carriages stand, plate coordinates [mm].
    times
        How often the point was pointed at in this model, this time included.
    drive
        After which drive it was, counted from 1; see `SimulatedPlotter.drives`.
    """

    point: str | None
    position: Position
    times: int
    drive: int = 0


def fiducial_name(side: Side, fiducial: str) -> str:
    """Return the name that a fiducial has among the true points of a photograph in a carriage.

    No point has it: a point's name does not begin with a blank.
    """
    return f" {side} {fiducial}"


def monocular_name(side: Side, point: str) -> str:
    """Return the name under which pointings at a point in one photo of a model are counted.

    In a mono comparator every photo is pointed at by itself. No point has this name.
    """
    return f"\t{side}\t{point}"


def _is_fiducial(point: str) -> bool:
    return point.startswith(" ")


def transfer_error(left: str, right: str, point: str, dx: float, dy: float) -> dict[Key, Offsets]:
    """Describe a tie that is taken for a detail beside it when it is pointed at again.

    Parameters
    ----------
    left, right
        The later model.
    point
        The tie.
    dx, dy
        Where the other detail lies [mm], alike in both photos: no parallax gives it away.

    Returns
    -------
    dict
        For `SimulatedPlotter`'s mistakes.
    """
    return {(left, right, point): Offsets(dx, dy, dx, dy, 1)}


class Pointing(NamedTuple):
    """A point found, where the mark is set on it, and the how-manieth time (0: not counted)."""

    point: str
    place: Position
    times: int


class Observer:
    """Who sets the mark: looks for points in the photographs laid, and misses them a little.

    Parameters
    ----------
    mono
        Whether one photograph lies in the device at a time.
    in_left, in_right
        What the photographs hold in the left and in the right carriage.
    seed, noise_um, mistakes, drift, pointed
        See `SimulatedPlotter`.
    """

    def __init__(
        self,
        *,
        mono: bool,
        in_left: Photographs,
        in_right: Photographs | None,
        seed: int,
        noise_um: float,
        mistakes: Mapping[Key, Offsets],
        drift: Offsets,
        pointed: Mapping[Key, int],
    ) -> None:
        self._mono = mono
        self._in_left = {photo: dict(points) for photo, points in in_left.items()}
        self._in_right = self._in_left
        if in_right is not None:
            self._in_right = {photo: dict(points) for photo, points in in_right.items()}
        self._seed = seed
        self._noise = noise_um / 1000.0
        self.mistakes = dict(mistakes)
        self.drift = drift
        self.pointed: dict[Key, int] = dict(pointed)
        self.attended: Side | None = None
        """In which plate fiducials are pointed at; None: points, in both."""
        self.laid = ("", "")
        """The photographs in the left and the right carriage; "" when empty."""
        self._lies: tuple[Side, Side] = ("left", "left")
        self._unnoticed = 0

    def lay(self, left: str, right: str | None, side: Side, placed: Side | None) -> None:
        """Lay photographs into the carriages; see `SimulatedPlotter.lay`."""
        for photo, known in ((left, self._in_left), (right, self._in_right)):
            if photo is not None and photo not in known:
                raise InputError(f"the simulated plotter has no photograph {photo}")
        if right is None and not self._mono:
            raise InputError("the simulated plotter holds two photographs")
        self.laid = (left, right if right is not None else left)
        self._lies = (side, placed if placed is not None else side)

    def points_of(self, photo: str, side: Side) -> dict[str, tuple[float, float]]:
        """Return what a photograph holds in a carriage; see `SimulatedPlotter.points_of`."""
        photographs = self._in_left if side == "left" else self._in_right
        if photo not in photographs:
            raise InputError(f"the simulated plotter has no photograph {photo}")
        return dict(photographs[photo])

    def point(self, here: Position, hand: Hand, *, unnoticed: bool = False) -> Pointing | None:
        """Set the mark on the true point nearest to where the carriages stand.

        Parameters
        ----------
        here
            Where they stand, plate coordinates [mm].
        hand
            How far it looks.
        unnoticed
            It is no measurement: it is not counted, and has noise of its own and no mistake.

        Returns
        -------
        Pointing or None
            None when there is no point within reach.
        """
        point = self._nearest(here, hand)
        if point is None:
            return None
        if unnoticed:
            self._unnoticed += 1
            return Pointing(point, self._place(here, point, self._unnoticed, 0, "unnoticed"), 0)
        counted = point
        if self._mono and not _is_fiducial(point):
            counted = monocular_name(self._lies[0], point)
        key = (*self.laid, counted)
        times = self.pointed[key] = self.pointed.get(key, 0) + 1
        in_model = sum(
            count
            for (left, right, name), count in self.pointed.items()
            if (left, right) == self.laid and not _is_fiducial(name)
        )
        return Pointing(point, self._place(here, point, times, in_model), times)

    @property
    def _lying(self) -> Mapping[str, tuple[float, float]]:
        """The true points of the photograph in a mono comparator."""
        side, placed = self._lies
        known = self._in_left if placed == "left" else self._in_right
        return known.get(self.laid[0] if side == "left" else self.laid[1], {})

    def _nearest(self, here: Position, hand: Hand) -> str | None:
        """Return the true point common to both photographs nearest to the left mark.

        Where fiducials are attended to, the nearest one of that plate to its mark.
        """
        left = self._lying if self._mono else self._in_left.get(self.laid[0], {})
        right = left if self._mono else self._in_right.get(self.laid[1], {})
        side, mark, radius = self.attended, (here.xl, here.yl), hand.search_radius
        if side is None:
            looked_for = {
                point: place
                for point, place in left.items()
                if point in right and not _is_fiducial(point)
            }
        else:
            own = fiducial_name(self._lies[1] if self._mono else side, "")
            points = left if side == "left" else right
            looked_for = {point: at for point, at in points.items() if point.startswith(own)}
            mark = mark if side == "left" else (here.xr, here.yr)
            radius = hand.fiducial_radius
        near = [(math.dist(place, mark), point) for point, place in looked_for.items()]
        distance, found = min(near, default=(math.inf, ""))
        return found if distance <= radius else None

    def _place(self, here: Position, point: str, times: int, pointing: int, *kind: str) -> Position:
        """Return where the mark is set: truth, noise, mistake and drift.

        A pointing of another kind than a measurement has noise of its own, and no mistake. On a
        fiducial the other mark stays; in a mono comparator it stands as in that photo of a stereo
        one.
        """
        key = repr((self._seed, *self.laid, point, times, *kind)).encode()
        digest = hashlib.sha256(key).digest()
        generator = np.random.default_rng(int.from_bytes(digest[:16], "big"))
        noise = generator.standard_normal(4) * self._noise
        mistake = self.mistakes.get((*self.laid, point), Offsets(count=0))
        if times > mistake.count or kind:
            mistake = Offsets()
        drift = Offsets() if _is_fiducial(point) else self.drift
        missed = noise + mistake.array + drift.array * pointing
        if self._mono:
            x, y = self._lying[point] + missed.reshape(2, 2)[int(self._lies[0] == "right")]
            return Position(float(x), float(y), float(x), float(y))
        place = np.array([here.xl, here.yl, here.xr, here.yr])
        if not point.startswith(fiducial_name("right", "")):
            place[:2] = self._in_left[self.laid[0]][point] + missed[:2]
        if not point.startswith(fiducial_name("left", "")):
            place[2:] = self._in_right[self.laid[1]][point] + missed[2:]
        return Position(*place.tolist())
