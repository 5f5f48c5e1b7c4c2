"""The carriages of a simulated device: where they stand, how they move, what is counted."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass

import numpy as np

from anaplot.plotter.readings import Position
from anaplot.plotter.schema import Profile

__all__ = ["Carriages"]

_AT_ONCE = 5.0  # mm that a hand moves between two read-outs


@dataclass(frozen=True, slots=True)
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


class Carriages:
    """The carriages of a device, with backlash and the encoders' resolution and noise.

    Parameters
    ----------
    profile
        The device.
    start
        Where they stand first, plate coordinates [mm]; the travel's ends hold.
    seed
        Of the encoders' noise.

    Notes
    -----
    Times [s] are the simulated ones; axis values [mm] come in the order of the profile.
    """

    def __init__(self, profile: Profile, start: Position, seed: int) -> None:
        self._profile = profile
        self._stage = profile.stage
        self._seed = seed
        self._sampled = 0
        self._motion: _Motion | None = None
        self._axes = self._clamped(self._stage.to_axes(self._stage.plates(start)))
        self._side = [0.0] * len(self._axes)
        self.origin = (0.0,) * len(self._axes)
        """Axis values at which the counters began."""

    def stand(self, now: float) -> Position:
        """Return where they truly stand, plate coordinates [mm]."""
        return self._position(self._axes_now(now))

    @property
    def counted_from(self) -> Position:
        """Where they stand when the counters are where they began, less that beginning [mm]."""
        at, zero = self._position(self.origin), self._position((0.0,) * len(self.origin))
        return Position(at.xl - zero.xl, at.yl - zero.yl, at.xr - zero.xr, at.yr - zero.yr)

    def put(self, position: Position) -> None:
        """Move at once to a position [mm]; the travel's ends hold."""
        self._put(self._stage.to_axes(self._stage.plates(position)))

    def begin(self, target: tuple[float, ...], now: float) -> float:
        """Begin to drive to axis values; returns how long that takes [s]."""
        distance = max(abs(b - a) for a, b in zip(self._axes, target, strict=True))
        seconds = distance / self._profile.simulate.speed
        self._motion = _Motion(self._axes, target, now, now + seconds)
        return seconds

    def by_hand(self, position: Position, now: float) -> float:
        """Move to a position [mm] as a hand does; returns how long that takes [s].

        At once, but for ways that would be taken for a jump where axes have a `fastest`.
        """
        target = self._clamped(self._stage.to_axes(self._stage.plates(position)))
        way = max(abs(b - a) for a, b in zip(self._axes, target, strict=True))
        if way <= _AT_ONCE or all(axis.fastest is None for axis in self._profile.axes.values()):
            self._put(target)
            return 0.0
        return self.begin(target, now)

    def arrive(self) -> None:
        """End a drive at its target."""
        if self._motion is not None:
            end, self._motion = self._motion.end, None
            self._put(end)

    def halt(self, now: float) -> None:
        """Stop a drive where it is."""
        if self._motion is not None:
            here, self._motion = self._motion.at(now), None
            self._put(here)

    def switch_on(self) -> None:
        """Begin to count anew where they stand, as incremental counters do."""
        if self._profile.incremental:
            self.origin = self._axes

    def counts(self, now: float) -> dict[str, float]:
        """Return what the encoders count: axis -> value in the device's units."""
        simulate = self._profile.simulate
        step = simulate.resolution_um / 1000.0
        values: dict[str, float] = {}
        axes = self._axes_now(now)
        for at, (name, axis) in enumerate(self._profile.axes.items()):
            value = axes[at] - self.origin[at] - self._side[at] * simulate.backlash_um / 2000.0
            if simulate.noise_um:
                self._sampled += 1
                key = repr((self._seed, "encoder", name, self._sampled)).encode()
                digest = hashlib.sha256(key).digest()
                jitter = np.random.default_rng(int.from_bytes(digest[:16], "big"))
                value += float(jitter.standard_normal()) * simulate.noise_um / 1000.0
            values[name] = round(value / step) * step * axis.direction / axis.scale
        return values

    def _position(self, axes: tuple[float, ...]) -> Position:
        return self._stage.position(self._stage.to_plate(axes))

    def _clamped(self, axes: tuple[float, ...]) -> tuple[float, ...]:
        return tuple(
            min(max(value, axis.low), axis.high)
            for value, axis in zip(axes, self._profile.axes.values(), strict=True)
        )

    def _axes_now(self, now: float) -> tuple[float, ...]:
        return self._motion.at(now) if self._motion is not None else self._axes

    def _put(self, axes: tuple[float, ...]) -> None:
        """Move at once; the side from which an axis was reached decides the backlash."""
        target = self._clamped(axes)
        for at, (old, new) in enumerate(zip(self._axes, target, strict=True)):
            if new != old:
                self._side[at] = math.copysign(1.0, new - old)
        self._axes = target
