"""What the operator chose to see: order of the table, panes, stereo view and its field."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

from anaplot.console.rows import SORT_ORDERS, SortOrder
from anaplot.console.wheels import Wheels

__all__ = ["Choices", "Panes"]

Panes = Literal["both", "map", "table"]
_PANES: tuple[Panes, ...] = ("both", "map", "table")


@dataclass(frozen=True, slots=True)
class Choices:
    """How the screen shows what there is.

    Attributes
    ----------
    order
        How the table is sorted.
    panes
        Table and map, or one of them alone.
    stereo_on
        Whether the stereo view stands in place of the map where a map has room.
    all_transfers
        Whether the critical transfers of all rows are drawn, not the selected row's alone.
    wheels
        Field of the stereo view, and step of its handwheels.
    """

    order: SortOrder = "table"
    panes: Panes = "both"
    stereo_on: bool = False
    all_transfers: bool = False
    wheels: Wheels = field(default_factory=Wheels)

    @property
    def stereo(self) -> bool:
        """Whether the stereo view is shown."""
        return self.stereo_on and self.panes != "table"

    def after(self, action: str) -> Choices | None:
        """Return the choices after an action; None when it chooses nothing of the kind."""
        match action:
            case "sort":
                place = (SORT_ORDERS.index(self.order) + 1) % len(SORT_ORDERS)
                return replace(self, order=SORT_ORDERS[place])
            case "transfers":
                return replace(self, all_transfers=not self.all_transfers)
            case "layout":
                place = (_PANES.index(self.panes) + 1) % len(_PANES)
                return replace(self, panes=_PANES[place])
            case "stereo" if self.panes == "table":
                return replace(self, panes="both", stereo_on=True)
            case "stereo":
                return replace(self, stereo_on=not self.stereo_on)
            case "zoom_in":
                return replace(self, wheels=self.wheels.zoomed(1))
            case "zoom_out":
                return replace(self, wheels=self.wheels.zoomed(-1))
            case "coarse":
                return replace(self, wheels=self.wheels.toggled())
            case _:
                return None

    def said(self, action: str) -> str:
        """Return what is told of an action that led here, or ""."""
        if action == "sort":
            return f"sorted by {self.order}" if self.order != "table" else "table order"
        if action == "transfers":
            whose = "all rows" if self.all_transfers else "the selected row"
            return f"critical transfers of {whose}"
        return ""
