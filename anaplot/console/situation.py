"""What a key meets: the station's snapshot, the row under the cursor, what is chosen to be seen."""

from __future__ import annotations

from dataclasses import dataclass

from anaplot.console.choices import Choices
from anaplot.console.inwork import in_work
from anaplot.console.now import NOTHING, Now
from anaplot.console.rows import ShownRow
from anaplot.console.stationlike import ControlsLike
from anaplot.session.othernames import OtherName
from anaplot.station.blockstatus import ModelStatus
from anaplot.station.snapshot import Snapshot

__all__ = ["Situation"]


@dataclass(frozen=True, slots=True)
class Situation:
    """Everything that decides what a key means now.

    Attributes
    ----------
    snapshot
        What the station says.
    selected
        The row under the cursor, or None.
    by_hand
        Whether the operator put the cursor there.
    rows
        Number of rows in the table.
    choices
        What is chosen to be seen.
    controls
        Those of a simulated instrument, or None.
    now
        What is to be done now, which Enter does.
    overview
        Whether the overview stands in place of table and map.
    aim
        The model of the overview to which Enter leads, or None.
    temporary
        Whether the block is deleted on leaving, unless it is asked to be kept.
    """

    snapshot: Snapshot
    selected: ShownRow | None
    by_hand: bool
    rows: int
    choices: Choices
    controls: ControlsLike | None
    now: Now = NOTHING
    overview: bool = False
    aim: ModelStatus | None = None
    temporary: bool = False

    @property
    def at_wheels(self) -> bool:
        """Whether the keys turn the handwheels: a simulated plotter's stereo view is shown."""
        return self.choices.stereo and self.controls is not None

    @property
    def hand(self) -> bool:
        """Whether a simulated hand sets the mark."""
        return self.controls is not None and self.controls.hand

    @property
    def chosen(self) -> str | None:
        """The measured point to which the operator moved the cursor, or None."""
        shown = self.selected if self.by_hand else None
        return shown.point if shown is not None and shown.state == "measured" else None

    @property
    def other_name(self) -> OtherName | None:
        """What the selected row's point is probably called instead, or None."""
        point = None if self.selected is None else self.selected.point
        return next((one for one in self.snapshot.other_names if one.point == point), None)

    @property
    def exchange(self) -> bool:
        """Whether it is probably taken for another one that the model has."""
        other = self.other_name
        views = self.snapshot.points
        return other is not None and any(v.point == other.name and v.times for v in views)

    @property
    def measured(self) -> bool:
        """Whether the selected row's point is measured; what is not is left out as a whole."""
        return self.selected is not None and any(
            view.point == self.selected.point and view.times > 0
            for view in in_work(self.snapshot).points
        )

    @property
    def row_off(self) -> bool:
        """Whether the selected row is switched off."""
        return self.selected is not None and self.selected.state == "off"

    @property
    def point_off(self) -> bool:
        """Whether the selected row's whole point is switched off."""
        return self.selected is not None and any(
            view.point == self.selected.point and view.status == "off"
            for view in in_work(self.snapshot).points
        )
