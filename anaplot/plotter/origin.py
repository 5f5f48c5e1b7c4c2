"""The origin of a device's counters: known or lost, and by how much they are moved."""

from __future__ import annotations

import math

from anaplot.errors import InputError
from anaplot.plotter.readings import UNREFERENCED, Position
from anaplot.plotter.refusal import RefusedError
from anaplot.plotter.schema import Stage

__all__ = ["Origin"]


class Origin:
    """Where the counters of a device count from.

    Parameters
    ----------
    stage
        The map between axes and plates.
    """

    def __init__(self, stage: Stage) -> None:
        self._stage = stage
        self._shift: tuple[float, ...] = (0.0,) * len(stage.offset)
        self._counted: tuple[float, ...] | None = None
        self.known = True
        """Whether it is known."""
        self.heard = 0
        """How many complete positions were heard, whether it was known or not."""

    def lose(self) -> None:
        """Take it that the origin is lost."""
        self.known = False

    def move(self, shift: Position) -> None:
        """Take it that the counters are to be moved by so much [mm], wherever they stand."""
        self._shift = self._stage.plates(shift)

    def forget(self) -> None:
        """Forget where the carriages stood."""
        self._counted = None

    @property
    def counted(self) -> Position | None:
        """Where the carriages stand as the device counts [mm]; None before anything was heard."""
        return None if self._counted is None else self._stage.position(self._counted)

    @property
    def shift(self) -> Position:
        """By how much the counters are moved [mm]."""
        return self._stage.position(self._shift)

    def place(self, axes: tuple[float, ...]) -> Position:
        """Return where the carriages stand, from the values [mm] of all axes.

        Raises
        ------
        RefusedError
            The origin is lost.
        """
        self._counted = self._stage.to_plate(axes)
        self.heard += 1
        if not self.known:
            raise RefusedError(UNREFERENCED)
        return self._stage.position(
            tuple(
                counted + shift for counted, shift in zip(self._counted, self._shift, strict=True)
            )
        )

    def to_axes(self, position: Position) -> tuple[float, ...]:
        """Return the axis values [mm] at which the carriages stand at a position.

        Raises
        ------
        InputError
            The origin is lost, or the position is not a number.
        """
        if not self.known:
            raise InputError(UNREFERENCED)
        plates = self._stage.plates(position)
        if not all(map(math.isfinite, plates)):
            raise InputError("the target of a drive is not a number")
        return self._stage.to_axes(
            tuple(value - shift for value, shift in zip(plates, self._shift, strict=True))
        )

    def refer(self, known: Position) -> Position:
        """Take it that the carriages stand at a position now; returns the new shift [mm].

        Raises
        ------
        InputError
            No position was heard since the line was opened.
        """
        if self._counted is None:
            raise InputError("no position was heard yet: there is nothing to refer to")
        self._shift = tuple(
            wanted - counted
            for wanted, counted in zip(self._stage.plates(known), self._counted, strict=True)
        )
        self.known = True
        return self.shift
