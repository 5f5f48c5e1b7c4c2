"""A session that goes on: what its journal and its file say, before anything is written."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from anaplot.exchange.journal import JournalRecord
from anaplot.photogrammetry.block import Block
from anaplot.session.events import Event
from anaplot.session.state import SessionState, start
from anaplot.station.edited import check_unedited
from anaplot.station.pointsfile import PointsFile
from anaplot.station.restored import restored

__all__ = ["TakenUp"]


class TakenUp:
    """Where a block's session stands; of one without a journal, at its beginning.

    Parameters
    ----------
    folder
        The block folder.
    block
        As read from it.

    Attributes
    ----------
    events
        What happened in the sessions before.
    state
        To which it led.
    points
        The file image_points.csv, and what of it is the session's own.
    """

    def __init__(self, folder: Path, block: Block) -> None:
        self._folder = folder
        self._block = block
        self.events: tuple[Event, ...] = ()
        self.state: SessionState = start(block)
        self.points = PointsFile(folder, block, ())

    def take(self, records: Iterable[JournalRecord]) -> None:
        """Take up the session where its journal ends.

        Raises
        ------
        InputError
            The journal does not fit the block, or somebody else changed a row of the session's.
        """
        self.events, self.state = restored(self._block, records)
        self.points = PointsFile(self._folder, self._block, self.events)
        check_unedited(self._folder, self._block, self.state, self.points.of_session)
