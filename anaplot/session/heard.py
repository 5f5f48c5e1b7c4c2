"""What a desk hears besides readings, and what is seen of the instrument at that moment."""

from __future__ import annotations

from dataclasses import dataclass

from anaplot.photogrammetry.readings import Position, Reading

__all__ = [
    "Abilities",
    "DriveBegun",
    "DriveFailed",
    "Heard",
    "KeyFailed",
    "LinkChanged",
    "MarkSet",
    "ReferenceLost",
    "Seen",
]

_ORIGIN = Position(0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Abilities:
    """What an instrument can do.

    Attributes
    ----------
    mono
        Whether it holds one photo at a time.
    drives
        Whether it drives its plates, and says when they have arrived.
    moves
        Whether the plates go to a point without the person at the instrument.
    middle
        The middle of the travel, plate coordinates [mm].
    still
        By how much read-outs of plates that stand may differ [mm].
    reads
        Whether positions are read without a press.
    """

    mono: bool = False
    drives: bool = True
    moves: bool = True
    middle: Position = _ORIGIN
    still: float = 0.003
    reads: bool = True


@dataclass(frozen=True, slots=True)
class Seen:
    """What is seen of the instrument at the moment of a command.

    Attributes
    ----------
    time
        Seconds that never go back.
    own_operator
        Who sets the mark by himself after a drive; "" where the person at the instrument does.
    line
        The state of the link.
    position
        The live read-out, plate coordinates [mm]; None while there is none.
    counters
        Where counters without reference say that the carriages stand [mm], or None.
    shift
        By how much the counters are moved [mm].
    read
        Whether the counters have been read since the desk asked for that.
    """

    time: float = 0.0
    own_operator: str = ""
    line: str = "none"
    position: Position | None = None
    counters: Position | None = None
    shift: Position = _ORIGIN
    read: bool = False


@dataclass(frozen=True, slots=True)
class MarkSet:
    """The instrument's own operator has set the mark, or can set none, after the drive-th drive.

    `remark` is what the person at the instrument is warned of, or "".
    """

    drive: int
    remark: str = ""


@dataclass(frozen=True, slots=True)
class DriveBegun:
    """The drive last asked for begins now; `before` drives had begun before it."""

    before: int


@dataclass(frozen=True, slots=True)
class DriveFailed:
    """A drive could not be commanded; `errand` is the desk's when it was asked for."""

    errand: int


@dataclass(frozen=True, slots=True)
class KeyFailed:
    """A record asked for by key cannot come; `errand` is the desk's when it was asked for."""

    errand: int


@dataclass(frozen=True, slots=True)
class LinkChanged:
    """The new state of the link, and why."""

    state: str
    detail: str = ""


@dataclass(frozen=True, slots=True)
class ReferenceLost:
    """The counters have lost their reference."""


Heard = Reading | MarkSet | DriveBegun | DriveFailed | KeyFailed | LinkChanged | ReferenceLost
