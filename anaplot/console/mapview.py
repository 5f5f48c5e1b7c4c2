"""The map as a widget."""

from __future__ import annotations

from typing import ClassVar

from textual.geometry import Size

from anaplot.console.braille import Canvas
from anaplot.console.canvaswidget import CanvasWidget, layer_classes
from anaplot.console.mapdrawing import Layer, draw_map, drawn_from
from anaplot.station.snapshot import Snapshot

__all__ = ["MapView"]

_CLASSES = layer_classes(Layer)


class MapView(CanvasWidget):
    """Points where they lie, residual vectors, and the critical transfers of the selected row."""

    LAYERS: ClassVar[dict[int, str]] = _CLASSES
    COMPONENT_CLASSES: ClassVar[set[str]] = set(_CLASSES.values())

    DEFAULT_CSS = """
    MapView {
        .map--paper { color: $foreground; }
        .map--legend { color: $text-muted; }
        .map--name { color: $text-muted; }
        .map--residual { color: $text-primary; }
        .map--transfer { color: $text-warning; text-style: bold; }
        .map--flagged-residual { color: $text-error; text-style: bold; }
        .map--off { color: $text-muted; }
        .map--pending { color: $text-muted; }
        .map--measured { color: $foreground; }
        .map--next { color: $text-accent; text-style: bold; }
        .map--target { color: $text-accent; text-style: bold; }
        .map--flagged { color: $text-error; text-style: bold; }
        .map--culprit { color: $text-error; text-style: bold reverse; }
        .map--selected { color: $foreground; text-style: bold underline; }
    }
    """

    def __init__(self, *, id: str | None = None) -> None:  # noqa: A002 - Textual's name
        super().__init__(id=id)
        self._snapshot: Snapshot | None = None
        self._selected: tuple[str, str] | None = None
        self._all_transfers = False
        self._drawn_from: tuple[object, ...] = ()

    def show(
        self, snapshot: Snapshot, selected: tuple[str, str] | None, *, all_transfers: bool
    ) -> None:
        """Draw this from now on."""
        drawn = drawn_from(snapshot, selected, all_transfers=all_transfers)
        if self.display and drawn == self._drawn_from:
            return
        self._drawn_from = drawn
        self._snapshot = snapshot
        self._selected = selected
        self._all_transfers = all_transfers
        self.draw()

    def canvas(self, size: Size) -> Canvas | None:
        """Return the map in this size."""
        if self._snapshot is None:
            return None
        return draw_map(
            self._snapshot,
            self._selected,
            size.width,
            size.height,
            all_transfers=self._all_transfers,
        )
