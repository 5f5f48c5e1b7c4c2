"""The simulated plotter: what any profile's device would say, with a hand at its wheels.

No ports, no threads and no clock: bytes in, simulated time in, bytes out. `server` puts it
behind a pseudo-terminal.
"""

from __future__ import annotations

import hashlib
import heapq
import itertools
import math
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from anaplot.aliases import Array, Side
from anaplot.errors import InputError
from anaplot.plotter.encoding import encode_value
from anaplot.plotter.faults import (
    FRAME_FAULTS,
    LASTING_FAULTS,
    check_fault,
    damaged,
    garbled,
    struck,
)
from anaplot.plotter.readings import Position
from anaplot.plotter.schema import Footswitch, Profile, RecordFormat
from anaplot.plotter.template import Value

__all__ = [
    "Hand",
    "HandSettled",
    "Offsets",
    "Photographs",
    "SimulatedPlotter",
    "fiducial_name",
    "monocular_name",
    "transfer_error",
]


Photographs = Mapping[str, Mapping[str, tuple[float, float]]]
_MAX_COMMAND = 256
SLOWER = 50.0
_TOLERANCE = 1e-9


@dataclass(frozen=True, slots=True)
class Offsets:
    """Where the hand sets the mark wrongly [mm]; `count` first pointings are affected."""

    dxl: float = 0.0
    dyl: float = 0.0
    dxr: float = 0.0
    dyr: float = 0.0
    count: int = 1


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


def transfer_error(
    left: str, right: str, point: str, dx: float, dy: float, count: int = 1
) -> dict[tuple[str, str, str], Offsets]:
    """Describe a tie that is taken for a detail beside it when it is pointed at again.

    Parameters
    ----------
    left, right
        The later model.
    point
        The tie.
    dx, dy
        Where the other detail lies [mm], alike in both photos: no parallax gives it away.
    count
        For how many pointings.

    Returns
    -------
    dict
        For `SimulatedPlotter`'s mistakes.
    """
    return {(left, right, point): Offsets(dx, dy, dx, dy, count)}


@dataclass(slots=True)
class _Motion:
    """Straight motion of all axes at once, axis values [mm], times [s]."""

    start: tuple[float, ...]
    end: tuple[float, ...]
    begin: float
    finish: float

    def at(self, now: float) -> tuple[float, ...]:
        if now >= self.finish:
            return self.end
        part = max(0.0, (now - self.begin) / (self.finish - self.begin))
        return tuple(a + (b - a) * part for a, b in zip(self.start, self.end, strict=True))


@dataclass(slots=True)
class _Outgoing:
    """Bytes waiting for their time on one link."""

    waiting: list[tuple[float, bytes]] = field(default_factory=list)
    free: float = 0.0
    frames: int = 0
    once: list[str] = field(default_factory=list)
    lasting: dict[str, float] = field(default_factory=dict)

    def lasts(self, name: str, now: float) -> bool:
        """Say whether a lasting fault is still on."""
        return self.lasting.get(name, -1.0) > now


class SimulatedPlotter:
    """A plotter that speaks a profile, with photographs in it.

    Parameters
    ----------
    profile
        The device.
    photographs
        Photo -> point -> true plate coordinates (x, y) [mm]. Fiducials are among them, see
        `fiducial_name`.
    in_right
        The same for the right carriage, where a photograph lies differently there.
    seed
        Of the pointing noise.
    noise_um
        Standard deviation of a pointing in each coordinate [um].
    hand
        What the operator's hand does.
    mistakes
        (left, right, point) -> offsets added the first times the point is pointed at; of a
        fiducial the offsets of its own carriage.
    drift
        Added to every pointing, growing with each one: n times the offsets at the n-th pointing
        in a model, counted over the model's points; fiducials are free of it.
    on_settled
        Called when the mark is set; from whatever thread lets time pass, without any lock held.
    start
        Where the carriages stand first.
    fault_rates
        Fault -> probability for one record, see `faults`.
    fault_seconds
        How long lasting faults last when they strike by rate [s].
    pointed
        How often points were pointed at before, as `pointed` returns it: a session that goes on
        tomorrow meets the same noise and mistakes as one that was never interrupted.

    Notes
    -----
    Pointing noise is drawn from a generator keyed by seed, photos, point and how often the
    point was pointed at in this model, so that results do not depend on timing or order.
    All methods may be called from any thread.
    """

    def __init__(
        self,
        profile: Profile,
        photographs: Photographs,
        *,
        seed: int = 0,
        noise_um: float = 5.0,
        hand: Hand | None = None,
        mistakes: Mapping[tuple[str, str, str], Offsets] | None = None,
        drift: Offsets | None = None,
        on_settled: Callable[[HandSettled], None] | None = None,
        start: Position | None = None,
        pointed: Mapping[tuple[str, str, str], int] | None = None,
        in_right: Photographs | None = None,
        fault_rates: Mapping[str, float] | None = None,
        fault_seconds: float = 2.0,
    ) -> None:
        self._profile = profile
        self._photographs = {photo: dict(points) for photo, points in photographs.items()}
        self._in_right = self._photographs
        if in_right is not None:
            self._in_right = {photo: dict(points) for photo, points in in_right.items()}
        self._attended: Side | None = None
        self._seed = seed
        self._noise = noise_um / 1000.0
        self._hand = hand if hand is not None else Hand()
        self._mistakes = dict(mistakes or {})
        self._drift = drift if drift is not None else Offsets()
        self._on_settled = on_settled
        self._on_wake: Callable[[], None] | None = None
        self._lock = threading.RLock()
        self._now = 0.0
        self._left = self._right = ""
        self._lies: tuple[Side, Side] = ("left", "left")
        self._pointed: dict[tuple[str, str, str], int] = dict(pointed or {})
        self._number = 0
        self._sampled = 0
        self._axes = self._clamped(
            profile.stage.to_axes(self._plate(start or Position(0.0, 0.0, 0.0, 0.0)))
        )
        self._motion: _Motion | None = None
        self._generation = 0
        self._drives = 0
        self._unnoticed = 0
        self._side = [0.0] * len(self._axes)
        self._origin = (0.0,) * len(self._axes)
        self._held: Footswitch | None = None
        self._rates: dict[str, float] = {}
        self.set_fault_rates(fault_rates or {})
        self._fault_seconds = fault_seconds
        self._cuts: list[tuple[str, float]] = []
        self._events: list[tuple[float, int, Callable[[], None]]] = []
        self._order = itertools.count()
        self._out = {name: _Outgoing() for name in profile.links}
        self._input = {name: bytearray() for name in profile.links}
        self._settled: list[HandSettled] = []
        if profile.drive is not None:
            self._command = profile.drive.command.matcher()
            self._stop_payload = profile.drive.stop.render({})
        if profile.simulate.stream is not None:
            self._at(profile.simulate.stream, self._stream)

    # -- from outside ----------------------------------------------------------------------

    @property
    def profile(self) -> Profile:
        """The device's profile."""
        return self._profile

    @property
    def now(self) -> float:
        """Simulated time [s]."""
        return self._now

    @property
    def hand(self) -> Hand:
        """What the hand does."""
        return self._hand

    def set_hand(self, hand: Hand) -> None:
        """Change what the hand does; one that is to follow does so from the next drive on."""
        with self._lock:
            self._hand = hand

    def set_on_settled(self, callback: Callable[[HandSettled], None] | None) -> None:
        """Set who is told when the mark is set."""
        with self._lock:
            self._on_settled = callback

    def set_on_wake(self, callback: Callable[[], None] | None) -> None:
        """Set who is told that something happens earlier than announced (the server)."""
        with self._lock:
            self._on_wake = callback

    def lay(
        self,
        left: str,
        right: str | None = None,
        side: Side = "left",
        placed: Side | None = None,
    ) -> None:
        """Lay photographs into the carriages.

        Parameters
        ----------
        left, right
            Photos of the model; with a mono comparator `right` may be left out.
        side
            Which of them lies in a mono comparator.
        placed
            In which of its two placements it lies there; by default that of its side.

        Raises
        ------
        InputError
            When there is no such photograph.
        """
        for photo, known in ((left, self._photographs), (right, self._in_right)):
            if photo is not None and photo not in known:
                raise InputError(f"the simulated plotter has no photograph {photo}")
        if right is None and not self._profile.mono:
            raise InputError("the simulated plotter holds two photographs")
        with self._lock:
            self._left = left
            self._right = right if right is not None else left
            self._lies = (side, placed if placed is not None else side)

    @property
    def _lying(self) -> Mapping[str, tuple[float, float]]:
        """The true points of the photograph in a mono comparator."""
        side, placed = self._lies
        known = self._photographs if placed == "left" else self._in_right
        return known.get(self._left if side == "left" else self._right, {})

    def attend(self, side: Side | None) -> None:
        """Say in which plate the hand points at fiducials from now on; None: points, in both."""
        with self._lock:
            self._attended = side

    def set_drift(self, drift: Offsets) -> None:
        """Have the hand creep by so much [mm] at every pointing of a model, from now on."""
        with self._lock:
            self._drift = drift

    def add_mistakes(self, mistakes: Mapping[tuple[str, str, str], Offsets]) -> None:
        """Plant more mistakes; one of the same model and point is replaced."""
        with self._lock:
            self._mistakes.update(mistakes)

    @property
    def laid(self) -> tuple[str, str]:
        """The photographs in the left and the right carriage; "" when empty."""
        return self._left, self._right

    def points_of(self, photo: str, side: Side = "left") -> dict[str, tuple[float, float]]:
        """Return the true plate coordinates (x, y) [mm] of a photograph's points in a carriage.

        Raises
        ------
        InputError
            When there is no such photograph.
        """
        photographs = self._photographs if side == "left" else self._in_right
        if photo not in photographs:
            raise InputError(f"the simulated plotter has no photograph {photo}")
        return dict(photographs[photo])

    @property
    def pointed(self) -> dict[tuple[str, str, str], int]:
        """(left, right, point) -> how often it was pointed at."""
        with self._lock:
            return dict(self._pointed)

    @property
    def drives(self) -> int:
        """How many drives were begun, by the device or by the hand."""
        return self._drives

    def remember(self, pointed: Mapping[tuple[str, str, str], int]) -> None:
        """Take over how often points were pointed at before, as in the constructor."""
        with self._lock:
            self._pointed.update(pointed)

    def positions(self) -> Position:
        """Return where the carriages truly stand, plate coordinates [mm]."""
        with self._lock:
            return self._position(self._axes_now())

    @property
    def counted_from(self) -> Position:
        """Where the carriages stand when the counters are where they began, less that beginning.

        Plate coordinates [mm]; zero until the device was switched off and on.
        """
        with self._lock:
            at = self._position(self._origin)
            zero = self._position((0.0,) * len(self._origin))
        return Position(at.xl - zero.xl, at.yl - zero.yl, at.xr - zero.xr, at.yr - zero.yr)

    def move(
        self, dxl: float = 0.0, dyl: float = 0.0, dxr: float = 0.0, dyr: float = 0.0
    ) -> Position:
        """Turn the handwheels; a drive under way is stopped.

        Parameters
        ----------
        dxl, dyl, dxr, dyr
            Displacements of the plates [mm]; the travel's ends hold.

        Returns
        -------
        Position
            Where the carriages stand then.
        """
        with self._lock:
            self._halt()
            here = self._position(self._axes)
            there = Position(here.xl + dxl, here.yl + dyl, here.xr + dxr, here.yr + dyr)
            self._set_axes(self._profile.stage.to_axes(self._plate(there)))
            result = self._position(self._axes)
        self._wake()
        return result

    def hand_to(self, position: Position, *, unnoticed: bool = False) -> None:
        """Have the hand move the plates near a place by itself, as an undriven plotter needs.

        Parameters
        ----------
        position
            Plate coordinates [mm]; the mark is then set on the nearest true point.
        unnoticed
            It is no measurement: the pedal is left alone and the pointing is not counted.
        """
        with self._lock:
            self._halt()
            self._set_axes(self._profile.stage.to_axes(self._plate(position)))
            self._drives += 1
            self._begin_settling(unnoticed=unnoticed)
        self._wake()

    def press(self, switch: str | None = None) -> bool:
        """Press a footswitch where the carriages stand now.

        Parameters
        ----------
        switch
            Its name; the hand's pedal by default.

        Returns
        -------
        bool
            Whether the device sends anything for it: a key or a modem line is the host's.

        Raises
        ------
        InputError
            When the profile has no such footswitch.
        """
        with self._lock:
            sent = self._press(switch if switch is not None else self._hand.pedal)
        self._wake()
        return sent

    def power_cycle(self) -> None:
        """Switch the device off and on: its counters and its count of presses begin at zero."""
        with self._lock:
            self._halt()
            if self._profile.incremental:
                self._origin = self._axes
            self._number = 0
            for outgoing in self._out.values():
                outgoing.waiting.clear()
                outgoing.free = self._now
            for buffer in self._input.values():
                buffer.clear()

    def inject(self, fault: str, link: str | None = None, seconds: float | None = None) -> None:
        """Have a fault strike once: the next record, or from now on for a while.

        Parameters
        ----------
        fault
            One of `faults.FAULTS`.
        link
            Where; None for every link.
        seconds
            How long a lasting fault lasts.

        Raises
        ------
        InputError
            When there is no such fault or link.
        """
        check_fault(fault)
        if link is not None and link not in self._out:
            raise InputError(f'{self._profile.id} has no link "{link[:40]}"')
        with self._lock:
            for name in self._out if link is None else (link,):
                if fault in FRAME_FAULTS:
                    self._out[name].once.append(fault)
                else:
                    self._begin_fault(
                        fault, name, self._fault_seconds if seconds is None else seconds
                    )
        self._wake()

    def set_fault_rates(self, rates: Mapping[str, float]) -> None:
        """Set the probabilities with which faults strike a record.

        Raises
        ------
        InputError
            When there is no such fault, or a rate is no probability.
        """
        for name, rate in rates.items():
            check_fault(name)
            if not 0.0 <= rate <= 1.0:
                raise InputError(f'the rate of "{name}" must lie between 0 and 1')
        with self._lock:
            self._rates = dict(rates)

    def take_cuts(self) -> list[tuple[str, float]]:
        """Return links to be broken now, with the simulated seconds until they are mended."""
        with self._lock:
            cuts, self._cuts = self._cuts, []
            return cuts

    def receive(self, data: bytes, link: str | None = None) -> None:
        """Take bytes from the host.

        Parameters
        ----------
        data
            What came.
        link
            Where; the profile's first link by default.
        """
        name = link if link is not None else self._profile.default_link
        with self._lock:
            if not self._out[name].lasts("freeze", self._now):
                self._take_commands(self._input[name], data, name)

    def step(self, dt: float, link: str | None = None) -> bytes:
        """Let simulated time pass.

        Parameters
        ----------
        dt
            How much [s].
        link
            Whose bytes are wanted; the profile's first link by default.

        Returns
        -------
        bytes
            What the device has sent on that link; other links keep theirs for their turn.
        """
        self.advance(dt)
        return self.take(link)

    def advance(self, dt: float) -> None:
        """Let simulated time pass; the bytes stay until they are taken."""
        with self._lock:
            until = self._now + max(0.0, dt)
            while self._events and self._events[0][0] <= until:
                when, _, action = heapq.heappop(self._events)
                self._now = max(self._now, when)
                action()
            self._now = until
            settled, self._settled = self._settled, []
            callback = self._on_settled
        if callback is not None:
            for event in settled:
                callback(event)

    def take(self, link: str | None = None) -> bytes:
        """Return the bytes whose time has come, once."""
        name = link if link is not None else self._profile.default_link
        with self._lock:
            outgoing = self._out[name]
            ready = bytearray()
            rest: list[tuple[float, bytes]] = []
            for when, data in outgoing.waiting:
                if when <= self._now and not rest:
                    ready += data
                else:
                    rest.append((when, data))
            outgoing.waiting = rest
            return bytes(ready)

    def next_event(self) -> float | None:
        """Return in how many simulated seconds something happens by itself, or None."""
        with self._lock:
            times = [self._events[0][0]] if self._events else []
            times += [item[0] for out in self._out.values() for item in out.waiting[:1]]
            return max(0.0, min(times) - self._now) if times else None

    # -- time ------------------------------------------------------------------------------

    def _at(self, delay: float, action: Callable[[], None]) -> None:
        heapq.heappush(self._events, (self._now + delay, next(self._order), action))

    def _wake(self) -> None:
        callback = self._on_wake
        if callback is not None:
            callback()

    # -- carriages -------------------------------------------------------------------------

    def _plate(self, position: Position) -> tuple[float, ...]:
        if self._profile.mono:
            return (position.xl, position.yl)
        return (position.xl, position.yl, position.xr, position.yr)

    def _position(self, axes: tuple[float, ...]) -> Position:
        plate = self._profile.stage.to_plate(axes)
        if self._profile.mono:
            return Position(plate[0], plate[1], plate[0], plate[1])
        return Position(*plate)

    def _clamped(self, axes: tuple[float, ...]) -> tuple[float, ...]:
        return tuple(
            min(max(value, axis.low), axis.high)
            for value, axis in zip(axes, self._profile.axes.values(), strict=True)
        )

    def _axes_now(self) -> tuple[float, ...]:
        return self._motion.at(self._now) if self._motion is not None else self._axes

    def _set_axes(self, axes: tuple[float, ...]) -> None:
        """Move at once; the side from which an axis was reached decides the backlash."""
        target = self._clamped(axes)
        for at, (old, new) in enumerate(zip(self._axes, target, strict=True)):
            if new != old:
                self._side[at] = math.copysign(1.0, new - old)
        self._axes = target

    def _halt(self) -> None:
        """Stop whatever moves and whatever the hand was about to do."""
        if self._motion is not None:
            here = self._motion.at(self._now)
            self._motion = None
            self._set_axes(here)
        self._generation += 1

    def _drive_to(self, target: tuple[float, ...]) -> None:
        drive = self._profile.drive
        if drive is None:
            return
        for name, value in zip(self._profile.axes, target, strict=True):
            low, high = drive.limits[name]
            if not low - _TOLERANCE <= value <= high + _TOLERANCE:
                self._fault("1", "target outside the travel")
                return
        self._halt()
        distance = max(abs(b - a) for a, b in zip(self._axes, target, strict=True))
        seconds = distance / self._profile.simulate.speed
        self._drives += 1
        self._motion = _Motion(self._axes, target, self._now, self._now + seconds)
        generation = self._generation
        self._at(seconds, lambda: self._arrive(generation))

    def _arrive(self, generation: int) -> None:
        if generation != self._generation or self._motion is None:
            return
        end = self._motion.end
        self._motion = None
        self._set_axes(end)
        if self._profile.drive is not None:
            self._say(self._profile.records[self._profile.drive.in_position])
        self._begin_settling()

    # -- the hand --------------------------------------------------------------------------

    def _begin_settling(self, *, unnoticed: bool = False) -> None:
        self._generation += 1
        if self._hand.follow and self._left:
            generation = self._generation
            self._at(self._hand.settle_time, lambda: self._settle(generation, unnoticed))

    def _settle(self, generation: int, unnoticed: bool) -> None:
        if generation != self._generation or not self._hand.follow:
            return
        point = self._nearest()
        if point is None:
            self._settled.append(HandSettled(None, self._position(self._axes), 0, self._drives))
            return
        if unnoticed:
            self._unnoticed += 1
            place = self._pointing(point, self._unnoticed, 0, "unnoticed")
            self._set_axes(self._profile.stage.to_axes(self._plate(place)))
            self._settled.append(HandSettled(point, self._position(self._axes), 0, self._drives))
            return
        counted = point
        if self._profile.mono and not _is_fiducial(point):
            counted = monocular_name(self._lies[0], point)
        key = (self._left, self._right, counted)
        times = self._pointed.get(key, 0) + 1
        self._pointed[key] = times
        in_model = sum(
            count
            for (left, right, name), count in self._pointed.items()
            if (left, right) == (self._left, self._right) and not _is_fiducial(name)
        )
        place = self._pointing(point, times, in_model)
        self._set_axes(self._profile.stage.to_axes(self._plate(place)))
        self._settled.append(HandSettled(point, self._position(self._axes), times, self._drives))
        if self._hand.auto_pedal:
            self._at(self._hand.pedal_time, lambda: self._press_if(generation))

    def _press_if(self, generation: int) -> None:
        if generation == self._generation:
            self._press(self._hand.pedal)

    def _nearest(self) -> str | None:
        """Return the true point common to both photographs nearest to the left mark.

        Where the hand attends to fiducials, the nearest one of that plate to its mark.
        """
        here = self._position(self._axes)
        if self._attended is not None:
            return self._nearest_fiducial(self._attended, here)
        mono = self._profile.mono
        points = self._lying if mono else self._photographs.get(self._left, {})
        other = points if mono else self._in_right.get(self._right, {})
        best: tuple[float, str] | None = None
        for point, (x, y) in points.items():
            if point not in other or _is_fiducial(point):
                continue
            distance = math.hypot(x - here.xl, y - here.yl)
            if distance <= self._hand.search_radius and (best is None or (distance, point) < best):
                best = (distance, point)
        return best[1] if best is not None else None

    def _nearest_fiducial(self, side: Side, here: Position) -> str | None:
        left = side == "left"
        points: Mapping[str, tuple[float, float]] = self._lying
        if not self._profile.mono:
            points = self._photographs[self._left] if left else self._in_right[self._right]
        x, y = (here.xl, here.yl) if left else (here.xr, here.yr)
        own = fiducial_name(self._lies[1] if self._profile.mono else side, "")
        near = [
            (math.hypot(at[0] - x, at[1] - y), point)
            for point, at in points.items()
            if point.startswith(own)
        ]
        distance, found = min(near, default=(math.inf, ""))
        return found if distance <= self._hand.fiducial_radius else None

    def _pointing(self, point: str, times: int, pointing: int, *kind: str) -> Position:
        """Return where the hand sets the mark: truth, noise, mistake and drift.

        A pointing of another kind than a measurement has noise of its own, and no mistake.
        """
        key = repr((self._seed, self._left, self._right, point, times, *kind)).encode()
        digest = hashlib.sha256(key).digest()
        generator = np.random.default_rng(int.from_bytes(digest[:16], "big"))
        noise = generator.standard_normal(4) * self._noise
        mistake = self._mistakes.get((self._left, self._right, point), Offsets(count=0))
        if times > mistake.count or kind:
            mistake = Offsets()
        if self._profile.mono:
            return self._in_one_photo(point, noise, mistake, pointing)
        if _is_fiducial(point):
            return self._on_fiducial(point, noise, mistake)
        xl, yl = self._photographs[self._left][point]
        xr, yr = self._in_right[self._right][point]
        drift = self._drift
        return Position(
            xl + float(noise[0]) + mistake.dxl + drift.dxl * pointing,
            yl + float(noise[1]) + mistake.dyl + drift.dyl * pointing,
            xr + float(noise[2]) + mistake.dxr + drift.dxr * pointing,
            yr + float(noise[3]) + mistake.dyr + drift.dyr * pointing,
        )

    def _in_one_photo(self, point: str, noise: Array, mistake: Offsets, pointing: int) -> Position:
        """Return where the mark stands in a mono comparator: as in that photo of a stereo one."""
        drift = Offsets() if _is_fiducial(point) else self._drift
        x, y = self._lying[point]
        if self._lies[0] == "left":
            x += float(noise[0]) + mistake.dxl + drift.dxl * pointing
            y += float(noise[1]) + mistake.dyl + drift.dyl * pointing
        else:
            x += float(noise[2]) + mistake.dxr + drift.dxr * pointing
            y += float(noise[3]) + mistake.dyr + drift.dyr * pointing
        return Position(x, y, x, y)

    def _on_fiducial(self, point: str, noise: Array, mistake: Offsets) -> Position:
        """Return where the marks stand when one is on a fiducial; the other stays."""
        here = self._position(self._axes)
        if point.startswith(fiducial_name("left", "")):
            x, y = self._photographs[self._left][point]
            x += float(noise[0]) + mistake.dxl
            return replace(here, xl=x, yl=y + float(noise[1]) + mistake.dyl)
        x, y = self._in_right[self._right][point]
        x += float(noise[2]) + mistake.dxr
        return replace(here, xr=x, yr=y + float(noise[3]) + mistake.dyr)

    def _press(self, name: str) -> bool:
        switch = self._profile.footswitches.get(name)
        if switch is None:
            known = ", ".join(self._profile.footswitches) or "none"
            raise InputError(f'{self._profile.id} has no footswitch "{name}" (known: {known})')
        if switch.source == "every":
            for record in self._carriers():
                for _ in range(record.confirm):
                    self._say(record)
            return True
        if switch.source != "record":
            return False
        record = self._profile.records[switch.record]
        if record.kind == "position":
            self._held = switch
            self._repeat(record, self._profile.simulate.hold)
        else:
            self._number = self._number % 999_999 + 1
            self._say(record, switch)
        return True

    def _repeat(self, record: RecordFormat, times: int) -> None:
        """Tell the held key again and again, then let it go."""
        simulate = self._profile.simulate
        if times == 0:
            self._held = None
            if simulate.tells_release:
                for _ in range(record.confirm):
                    self._say(record)
            return
        self._say(record, self._held)
        self._at(simulate.hold_period, lambda: self._repeat(record, times - 1))

    # -- what the device says --------------------------------------------------------------

    def _carriers(self) -> list[RecordFormat]:
        """Return the records that tell positions, each once."""
        return [
            record
            for record in self._profile.records.values()
            if record.kind == "position" and record.send is not None
        ]

    def _stream(self) -> None:
        period = self._profile.simulate.stream
        if period is None:
            return
        for record in self._carriers():
            self._say(record, self._held)
        self._at(period, self._stream)

    def _counts(self) -> dict[str, float]:
        """Return what the encoders count: axis -> value in the device's units."""
        simulate = self._profile.simulate
        step = simulate.resolution_um / 1000.0
        values: dict[str, float] = {}
        axes = self._axes_now()
        for at, (name, axis) in enumerate(self._profile.axes.items()):
            value = axes[at] - self._origin[at] - self._side[at] * simulate.backlash_um / 2000.0
            if simulate.noise_um:
                self._sampled += 1
                key = repr((self._seed, "encoder", name, self._sampled)).encode()
                digest = hashlib.sha256(key).digest()
                jitter = np.random.default_rng(int.from_bytes(digest[:16], "big"))
                value += float(jitter.standard_normal()) * simulate.noise_um / 1000.0
            values[name] = round(value / step) * step * axis.direction / axis.scale
        return values

    def _say(
        self,
        record: RecordFormat,
        switch: Footswitch | None = None,
        texts: Mapping[str, Value] | None = None,
    ) -> None:
        """Send a record on each of its links."""
        if record.send is None:
            return
        counts = self._counts()
        for link in record.links:
            values: dict[str, Value] = dict(record.constants or {})
            carried = 0
            for axis in self._profile.axes.values():
                if axis.link == link and record.name in axis.records:
                    values[axis.group] = encode_value(axis, counts[axis.name])
                    carried += 1
            if not carried and (record.kind == "position"):
                continue
            values["number"] = self._number
            if switch is not None and switch.group and switch.record == record.name:
                values[switch.group] = switch.value
            values.update(texts or {})
            self._send(link, record.send.render(values))

    def _fault(self, code: str, text: str) -> None:
        for record in self._profile.records.values():
            if record.kind == "fault":
                self._say(record, texts={"code": code, "text": text})
                return

    def _send(self, link: str, payload: bytes) -> None:
        """Put a record on the line."""
        checksum = self._profile.checksum
        if checksum is not None:
            payload += checksum.digits(payload)
        data = payload + self._profile.framing.terminator
        self._transmit(link, self._through_faults(link, data))

    def _begin_fault(self, fault: str, link: str, seconds: float) -> None:
        outgoing = self._out[link]
        outgoing.lasting[fault] = self._now + seconds
        if fault == "disconnect":
            outgoing.waiting.clear()
            outgoing.free = self._now
            self._cuts.append((link, seconds))

    def _through_faults(self, link: str, data: bytes) -> bytes:
        """Return what a record becomes on its way."""
        outgoing = self._out[link]
        outgoing.frames += 1
        line = self._profile.links[link]
        names, generator = struck(self._rates, self._seed, outgoing.frames)
        names += outgoing.once
        outgoing.once = []
        for name in names:
            if name in LASTING_FAULTS:
                self._begin_fault(name, link, self._fault_seconds)
            else:
                data = damaged(name, data, line, generator)
        if outgoing.lasts("freeze", self._now) or outgoing.lasts("disconnect", self._now):
            return b""
        if outgoing.lasts("wrong-baud", self._now):
            return garbled(data, line, generator)
        return data

    def _transmit(self, link: str, data: bytes) -> None:
        if not data:
            return
        simulate = self._profile.simulate
        outgoing = self._out[link]
        begin = max(self._now + simulate.latency, outgoing.free)
        slow = outgoing.lasts("slow", self._now)
        if not simulate.byte_timing and not slow:
            outgoing.free = begin
            outgoing.waiting.append((begin, data))
            return
        settings = self._profile.links[link]
        per_byte = settings.bits_per_byte / settings.baud * (SLOWER if slow else 1.0)
        for at in range(len(data)):
            outgoing.waiting.append((begin + (at + 1) * per_byte, data[at : at + 1]))
        outgoing.free = begin + len(data) * per_byte

    # -- what the device understands -------------------------------------------------------

    def _take_commands(self, buffer: bytearray, data: bytes, link: str) -> None:
        buffer += data
        poll, drive = self._profile.poll, self._profile.drive
        while buffer:
            if poll is not None and link in poll.links and buffer.startswith(poll.request):
                del buffer[: len(poll.request)]
                self._answer(link)
                continue
            if poll is not None and poll.request.startswith(bytes(buffer)):
                return
            if drive is None or link != drive.link:
                self._skip(buffer, poll.request if poll is not None else b"")
                continue
            end = buffer.find(drive.terminator)
            if end < 0:
                if len(buffer) > _MAX_COMMAND:
                    buffer.clear()
                    self._fault("4", "command not understood")
                return
            line = bytes(buffer[:end])
            del buffer[: end + len(drive.terminator)]
            self._obey(line)

    @staticmethod
    def _skip(buffer: bytearray, request: bytes) -> None:
        """Drop bytes up to the next possible request."""
        at = buffer.find(request[:1], 1) if request else -1
        del buffer[: at if at > 0 else len(buffer)]

    def _answer(self, link: str) -> None:
        for record in self._carriers():
            if link in record.links:
                self._say(replace(record, links=(link,)))
                return

    def _obey(self, line: bytes) -> None:
        checksum = self._profile.checksum
        payload = line.rstrip(b"\r")
        if checksum is not None and checksum.host:
            bare = payload[: -checksum.length]
            if payload != bare + checksum.digits(bare):
                self._fault("4", "command not understood")
                return
            payload = bare
        if payload == self._stop_payload:
            self._halt()
            return
        match = self._command.fullmatch(payload)
        if match is None:
            self._fault("4", "command not understood")
            return
        target = tuple(
            float(match.group(name)) * axis.scale * axis.direction + origin
            for (name, axis), origin in zip(self._profile.axes.items(), self._origin, strict=True)
        )
        self._drive_to(target)
