"""image_points.csv of a session that goes on: rows from elsewhere stay, its own follow models."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Set
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

from anaplot.exchange.blockfolder import (
    PointsFound,
    image_points_digest,
    read_block,
    write_image_points,
)
from anaplot.photogrammetry.block import Block, ImagePoint
from anaplot.photogrammetry.measuredimage import computed_place
from anaplot.planning.modelplan import Candidates
from anaplot.session.events import Event
from anaplot.session.modelstate import ModelState
from anaplot.session.reasons import RowReason
from anaplot.session.state import SessionState
from anaplot.station.imagepoints import (
    Key,
    accepted_ever,
    measured_here,
    measured_once,
    merged_rows,
)

__all__ = ["BlockRead", "PointsFile"]


@dataclass(frozen=True, slots=True)
class BlockRead:
    """A block as read from its folder.

    Attributes
    ----------
    block
        What its files say.
    digest
        Of the image_points.csv of which it was read; None where there was none.
    """

    block: Block
    digest: str | None

    @classmethod
    def of(cls, folder: Path) -> Self:
        """Read the block in a folder; errors as `read_block` has them."""
        # first: what is written between the two is read anew when it counts
        digest = image_points_digest(folder) if folder.is_dir() else None
        return cls(read_block(folder), digest)


_Written = tuple[tuple[ModelState, ...], tuple[RowReason, ...]]


class PointsFile:
    """The file, and what of it is the session's own.

    Parameters
    ----------
    folder
        The block folder.
    read
        As read from it.
    of_session
        Names "left/right" of the models that were accepted in the sessions before.
    once
        Measurements of which the sessions before wrote rows that name no model.
    """

    def __init__(
        self,
        folder: Path,
        read: BlockRead,
        of_session: Iterable[str],
        once: Collection[Key] = (),
    ) -> None:
        self._folder = folder
        self.block = read.block
        self._digest = read.digest
        self.of_session = set(of_session)
        self.once = frozenset(once)
        self._written: _Written | None = None if self.of_session else ((), ())

    @property
    def own(self) -> tuple[Set[str], frozenset[Key]]:
        """What is the session's: models by name, and measurements of rows that name none."""
        return self.of_session, self.once

    def happened(self, events: Iterable[Event]) -> None:
        """Take notice of events: what was accepted once, undone or not, is the session's own."""
        self.of_session |= accepted_ever(events)

    def holds(self, state: SessionState) -> bool:
        """Whether it was last written for the accepted models of a state."""
        return self._written == _accepted(state)

    def write(self, state: SessionState) -> None:
        """Bring the file up to the accepted models, unless it is.

        Raises
        ------
        InputError
            It cannot be read or written.
        """
        if self.holds(state):
            return
        models, reasons = _accepted(state)
        found, digest = self.block.image_points, image_points_digest(self._folder)
        if digest != self._digest:
            # rows that came from elsewhere meanwhile stay
            found = read_block(self._folder).image_points
        self.once |= measured_once(models)
        rows = merged_rows(found, models, self.of_session, reasons, self.once)
        if _recorded(rows) != _recorded(found):
            there = PointsFound(found, digest)
            digest = write_image_points(self._folder, rows, self.block, there)
        self.block = replace(self.block, image_points=rows)
        self._digest = digest
        self._written = models, reasons

    def known_points(self, models: tuple[ModelState, ...]) -> Candidates | None:
        """Return image coordinates of points measured elsewhere before, or None without any."""
        known: dict[str, dict[str, tuple[float, float]]] = {}
        own = measured_here(models) | self.once
        for row in self.block.image_points:
            if (row.photo, row.point, *computed_place(row)) in own:
                continue
            if row.model is None or row.model not in self.of_session:
                known.setdefault(row.photo, {})[row.point] = (row.x, row.y)
        return known or None


def _recorded(rows: Iterable[ImagePoint]) -> list[ImagePoint]:
    """Return rows with the coordinates that a session knows them by."""
    return [row if row.measured is None else _as_known(row) for row in rows]


def _as_known(row: ImagePoint) -> ImagePoint:
    x, y = computed_place(row)
    return replace(row, x=x, y=y)


def _accepted(state: SessionState) -> _Written:
    """Return the accepted models, and the reasons that are theirs."""
    names = {model.name for model in state.models}
    return state.models, tuple(r for r in state.reasons if r.model in names)
