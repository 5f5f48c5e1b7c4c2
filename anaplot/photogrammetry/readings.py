"""What an instrument says, once its bytes are understood: plain values, whoever decoded them."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = [
    "AWAY",
    "KEY",
    "UNREFERENCED",
    "Fault",
    "InPosition",
    "Position",
    "Reading",
    "Record",
    "Refused",
]

UNREFERENCED = "the counters have lost their reference"
"""Why every reading of counters without reference is refused."""

AWAY = ("lost", "reconnecting")
"""States of an instrument's line over which nothing comes and goes."""

KEY = "key"
"""The switch of a record that the operator's key asked for."""


@dataclass(frozen=True, slots=True)
class Position:
    """Where the carriages stand: plate coordinates [mm] of the left and the right photo."""

    xl: float
    yl: float
    xr: float
    yr: float


@dataclass(frozen=True, slots=True)
class Record:
    """A footswitch was pressed at a position; `number` is the device's own count, if it has one."""

    position: Position
    switch: str
    number: int | None = None


@dataclass(frozen=True, slots=True)
class InPosition:
    """A drive has ended at its target."""

    position: Position | None = None


@dataclass(frozen=True, slots=True)
class Fault:
    """The device reports a fault; text is made safe for display."""

    code: str
    text: str


@dataclass(frozen=True, slots=True)
class Refused:
    """Bytes that are no valid reading, and why; `raw` is kept for the journal."""

    raw: bytes
    reason: str


Reading = Position | Record | InPosition | Fault | Refused
