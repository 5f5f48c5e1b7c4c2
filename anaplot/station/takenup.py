"""A session that goes on: what its journal and its file say, before anything is written."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from anaplot.exchange.blockfolder import image_points_digest
from anaplot.exchange.journal import Journal, Recovered
from anaplot.exchange.journalkinds import is_event
from anaplot.photogrammetry.readings import Position
from anaplot.session.events import DecisionsTakenOver
from anaplot.session.referencing import in_words
from anaplot.session.state import start
from anaplot.station.changedplates import told_changed_plates
from anaplot.station.edited import check_unedited, written_once
from anaplot.station.lastshift import last_shift
from anaplot.station.pointsfile import BlockRead, PointsFile
from anaplot.station.rejectedelsewhere import elsewhere, told_decisions
from anaplot.station.restored import Past, PastReading, choice_for

__all__ = ["TakenUp"]


class TakenUp:
    """Where a block's session stands; of one without a journal, at its beginning.

    Parameters
    ----------
    folder
        The block folder.
    read
        As read from it.

    Attributes
    ----------
    block
        The block.
    past
        What happened in the sessions before, and the state to which it led; what was decided
        elsewhere since then with it.
    decided
        That part of it: what the journal does not say yet.
    points
        The file image_points.csv, and what of it is the session's own.
    shift
        By how much the counters of the instrument are moved [mm], as they were when its last
        session ended; None: they count as they are.
    plates
        That plates become image coordinates otherwise than before, in one line, or "".
    """

    def __init__(self, folder: Path, read: BlockRead) -> None:
        self._folder = folder
        self._read = read
        self.block = read.block
        self.past = Past(0, 0, start(read.block), frozenset())
        self.decided: tuple[DecisionsTakenOver, ...] = ()
        self.points = PointsFile(folder, read, ())
        self.shift: Position | None = None
        self.plates = ""
        self._profile: str | None = None

    @property
    def remarks(self) -> tuple[str, ...]:
        """What is told of it when it goes on, each in one line, or ""."""
        return told_decisions(self.decided), self.plates, self._moved

    @property
    def _moved(self) -> str:
        """That the counters are moved as before, in one line, or ""."""
        by = self.shift
        if by is None:
            return ""
        alike = (by.xl, by.yl) == (by.xr, by.yr)  # as those of one carriage are
        return f"the counters are moved as before: {in_words(by, mono=alike)}"

    def open(self, header: Mapping[str, Any]) -> tuple[Journal, Recovered]:
        """Open the journal, and take up what it says.

        Raises
        ------
        InputError
            As `Journal.open`; or the journal does not fit the block, or somebody else changed a row
            of the session's.
        """
        reading = PastReading(self._folder, self.block)
        # the device of a simulation begins anew, too
        self._profile = None if header.get("simulated") else header.get("profile")
        return Journal.open(
            self._folder,
            header,
            keep=is_event,
            accept=lambda _: self._take(reading),
            choose=choice_for(self.block),
            begin=reading.begin,
        )

    def _take(self, reading: PastReading) -> dict[str, Any]:
        """Take up the session where its journal ends; returns what its header says of that.

        Raises
        ------
        InputError
            The journal does not fit the block, or somebody else changed a row of the session's;
            what a strategy for gross errors rejected there is taken over.
        """
        self._read_again()
        past = reading.past()
        new, said = elsewhere(self._folder, self.block, past.state, past.taken)
        once = written_once(self._folder, self.block, past.state)
        self.points = PointsFile(self._folder, self._read, past.of_session, once)
        check_unedited(self._folder, self.block, said, self.points.of_session)
        self.decided = new
        self.past = replace(
            past,
            count=past.count + len(new),
            state=said if new else past.state,
        )
        if not reading.declared_alike:  # else a long journal is searched for nothing
            self.plates = told_changed_plates(self._folder, self.block, past.state)
        if self._profile is not None:
            self.shift = last_shift(self._folder, self._profile)
        by = self.shift
        return {} if by is None else {"shift": [by.xl, by.yl, by.xr, by.yr]}

    def _read_again(self) -> None:
        """Read image_points.csv again where it was written before the lock was had."""
        if image_points_digest(self._folder) == self._read.digest:
            return
        now = BlockRead.of(self._folder)
        self.block = replace(self.block, image_points=now.block.image_points)
        self._read = replace(now, block=self.block)
