"""Of a widget only those lines are painted again that have changed."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import zip_longest

from textual.geometry import Region, Size
from textual.strip import Strip
from textual.widget import Widget

__all__ = ["DrawnWidget", "repaint"]


def repaint(widget: Widget, old: Sequence[object] | None, new: Sequence[object]) -> None:
    """Ask for the lines of a widget to be painted that differ.

    Parameters
    ----------
    widget
        The widget.
    old
        Its lines as they are painted, or are to be; None: nothing is known of them.
    new
        Its lines from now on.
    """
    if old is None:
        widget.refresh()
        return
    width = widget.size.width
    pairs = enumerate(zip_longest(old, new))
    regions = [Region(0, y, width, 1) for y, (one, other) in pairs if one != other]
    if regions:
        widget.refresh(*regions)


class DrawnWidget(Widget):
    """A widget that is drawn as a whole, and painted line by line where it has changed."""

    _strips: list[Strip]
    _drawn_in: Size | None = None

    def drawn(self, size: Size) -> list[Strip]:
        """Return the lines."""
        raise NotImplementedError

    def draw(self) -> None:
        """Draw again, and paint the lines that are others now."""
        if not self.display:
            self._drawn_in = None
            return
        before = self._strips if self._drawn_in == self.size else None
        repaint(self, before, self._draw())

    def _draw(self) -> list[Strip]:
        self._drawn_in = self.size
        self._strips = self.drawn(self.size)
        return self._strips

    def notify_style_update(self) -> None:
        """Draw again in the new colours."""
        self._drawn_in = None
        super().notify_style_update()

    def render_line(self, y: int) -> Strip:
        """Return one line."""
        strips = self._strips if self._drawn_in == self.size else self._draw()
        if y < len(strips):
            return strips[y]
        return Strip.blank(self.size.width, self.rich_style)
