"""A drawing of braille cells as a widget: every layer has its colour by a class of its name."""

from __future__ import annotations

from collections.abc import Iterable
from enum import IntEnum
from typing import ClassVar

from rich.segment import Segment
from rich.style import Style
from textual.geometry import Size
from textual.strip import Strip

from anaplot.console.braille import Canvas
from anaplot.console.repainting import DrawnWidget

__all__ = ["CanvasWidget", "layer_classes"]


def layer_classes(layers: Iterable[IntEnum]) -> dict[int, str]:
    """Return the component class of every layer: `map--name` of NAME."""
    return {int(layer): f"map--{layer.name.lower().replace('_', '-')}" for layer in layers}


class CanvasWidget(DrawnWidget):
    """A widget that shows a canvas."""

    LAYERS: ClassVar[dict[int, str]] = {}

    def __init__(self, *, id: str | None = None) -> None:  # noqa: A002 - Textual's name
        super().__init__(id=id)
        self._styles: dict[int, Style] = {}

    def notify_style_update(self) -> None:
        """Draw again in the new colours."""
        self._styles = {}
        super().notify_style_update()

    def canvas(self, size: Size) -> Canvas | None:
        """Return the drawing in this size; None while there is none."""
        raise NotImplementedError

    def drawn(self, size: Size) -> list[Strip]:
        """Return the lines in this size."""
        canvas = self.canvas(size)
        if canvas is None:
            return []
        if not self._styles:
            self._styles = {
                layer: self.get_component_rich_style(name) for layer, name in self.LAYERS.items()
            }
        return [
            Strip([Segment(text, self._styles[layer]) for text, layer in row], size.width)
            for row in canvas.runs()
        ]
