"""A widget of whole lines, of which only what changes is laid out and painted."""

from __future__ import annotations

from textual.content import Content
from textual.geometry import Size
from textual.strip import Strip
from textual.visual import Visual
from textual.widget import Widget

from anaplot.console.repainting import repaint

__all__ = ["LinesWidget"]

_PAINTED = 500  # lines whose cells are kept


class LinesWidget(Widget):
    """A widget of whole lines, made anew for every size; no text is ever taken for markup."""

    _shown: list[Content] | None = None
    _shown_in = Size()
    _painted: dict[tuple[object, ...], Strip] | None = None

    def show_lines(self) -> None:
        """Paint the lines that are others now; of a panel that is hidden none are made."""
        if not self.display:
            self._shown = None
            return
        before = None if self._shown is None else _compared(self._shown)
        if self._shown_in != self.size:
            before = None
        repaint(self, before, _compared(self._fitted()))

    def _fitted(self) -> list[Content]:
        width, height = self._shown_in = self.size
        self._shown = self.lines(width, height)[:height]
        return self._shown

    def lines(self, width: int, height: int) -> list[Content]:
        """Return at most `height` lines of at most `width` cells."""
        raise NotImplementedError

    def render(self) -> Content:
        """Return the lines as one text."""
        return Content("\n").join(self._fitted())

    def render_line(self, y: int) -> Strip:
        """Return one line; those that are painted already are not made again."""
        shown, size = self._shown, self.size
        if shown is None or self._shown_in != size:
            shown = self._fitted()
        width, style = size.width, self.visual_style
        if y >= len(shown):
            return Strip.blank(width, style.rich_style)
        if self.text_selection is not None:
            return Visual.to_strips(self, shown[y], width, 1, style)[0]
        # a new message moves all that are older by a line: the text of none of them is laid anew
        if self._painted is None or len(self._painted) > _PAINTED:
            self._painted = {}
        key = (width, *_compared_line(shown[y]))
        strip = self._painted.get(key)
        if strip is None:
            strip = self._painted[key] = Visual.to_strips(self, shown[y], width, 1, style)[0]
        return strip

    def notify_style_update(self) -> None:
        """Paint again in the new colours."""
        self._painted = None
        super().notify_style_update()


def _compared(lines: list[Content]) -> list[tuple[object, ...]]:
    """Return what lines differ by: contents are equal when their text is."""
    return [_compared_line(line) for line in lines]


def _compared_line(line: Content) -> tuple[object, ...]:
    return (line.plain, *line.spans)
