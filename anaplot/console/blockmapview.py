"""The map of the block as a widget."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from textual.geometry import Size

from anaplot.console.blockmapdrawing import BlockLayer, draw_block_map
from anaplot.console.braille import Canvas
from anaplot.console.canvaswidget import CanvasWidget, layer_classes

if TYPE_CHECKING:
    from anaplot.bundle.blockmap import BlockMap

__all__ = ["BlockMapView"]

_CLASSES = layer_classes(BlockLayer)


class BlockMapView(CanvasWidget):
    """Photos, strips, points by redundancy and error ellipses."""

    LAYERS: ClassVar[dict[int, str]] = _CLASSES
    COMPONENT_CLASSES: ClassVar[set[str]] = set(_CLASSES.values())

    DEFAULT_CSS = """
    BlockMapView {
        .map--paper { color: $foreground; }
        .map--legend { color: $text-muted; }
        .map--strip { color: $text-muted; }
        .map--ellipse { color: $text-primary; }
        .map--photo { color: $text-muted; text-style: bold; }
        .map--name { color: $text-muted; }
        .map--well { color: $text-success; }
        .map--fair { color: $foreground; }
        .map--weak { color: $text-warning; }
        .map--unchecked { color: $text-warning; text-style: bold; }
        .map--known { color: $text-accent; text-style: bold; }
        .map--flagged { color: $text-error; text-style: bold; }
        .map--selected { color: $foreground; text-style: bold reverse; }
    }
    """

    def __init__(self) -> None:
        super().__init__()
        self._map: BlockMap | None = None
        self._selected: str | None = None

    def show(self, block: BlockMap | None, selected: str | None) -> None:
        """Draw this from now on."""
        if self._map is block and self._selected == selected:
            return
        self._map, self._selected = block, selected
        self.draw()

    def canvas(self, size: Size) -> Canvas | None:
        """Return the map in this size."""
        if self._map is None:
            return None
        return draw_block_map(self._map, size.width, size.height, selected=self._selected)
