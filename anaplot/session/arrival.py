"""When a drive has come to its end: what replies and read-outs say of it.

A reply carries nothing that tells its drive, and that of a drive given up may come while the next
one is under way. Where the plates are decides: where the reply says that they are, or, of a reply
that does not say it, where they are read at a standstill after it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from anaplot.photogrammetry.readings import Position

__all__ = ["NO_REPLIES", "Replies", "is_at"]

_ARRIVED_MM = 0.02  # a read-out this near to the target ends a drive as its reply would
_SAME_DRIVE_MM = 1.0  # a reply farther away than this is not of the drive
_ROUNDING_MM = 1e-9
_MOST = 8  # drives of which a reply may still come


@dataclass(frozen=True, slots=True)
class Replies:
    """Which replies to drives may still come, and what came without saying where the plates are.

    Attributes
    ----------
    unanswered
        Where drives went whose reply has not come [mm], the latest last.
    bare
        Whether a reply has come since the latest began that does not say where the plates are.
    read
        The latest read-out after it [mm], or None.
    """

    unanswered: tuple[Position, ...] = ()
    bare: bool = False
    read: Position | None = None

    def driven(self, target: Position) -> Replies:
        """Return what may come when the plates are sent to a target [mm] now."""
        others = tuple(one for one in self.unanswered if one != target)
        return Replies((*others, target)[-_MOST:])

    def answered(self, position: Position) -> tuple[Replies, Position | None]:
        """Take a reply that says where the plates are.

        Returns
        -------
        Replies
            What may come after it: replies come in the order of their drives.
        Position or None
            Where its drive went: the nearest target, of two the later; None: not known.
        """
        near = [
            (gap, -at)
            for at, target in enumerate(self.unanswered)
            if (gap := _gap(position, target)) <= _SAME_DRIVE_MM
        ]
        if not near:
            return self, None
        at = -min(near)[1]
        return replace(self, unanswered=self.unanswered[at + 1 :]), self.unanswered[at]

    def stands(self, position: Position, target: Position, still: float) -> bool:
        """Whether a read-out, after a bare reply, says that the plates stand at the target.

        Parameters
        ----------
        position
            The read-out [mm].
        target
            Of the drive under way [mm].
        still
            By how much read-outs at a standstill may differ [mm].
        """
        return (
            self.read is not None
            and _gap(position, self.read) <= still + _ROUNDING_MM
            and _gap(position, target) <= _SAME_DRIVE_MM
        )


NO_REPLIES = Replies()
"""Before the first drive."""


def is_at(position: Position, target: Position) -> bool:
    """Whether a read-out [mm] ends a drive to a target [mm] by itself."""
    return _gap(position, target) <= _ARRIVED_MM


def _gap(here: Position, there: Position) -> float:
    """Return how far two positions are from each other, on the axis where it is most [mm]."""
    return max(
        abs(here.xl - there.xl),
        abs(here.yl - there.yl),
        abs(here.xr - there.xr),
        abs(here.yr - there.yr),
    )
