"""The table as a widget: every row of the model, one of them selected."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

from rich.cells import cell_len
from rich.segment import Segment
from rich.style import Style
from textual import events
from textual.geometry import Offset, Region, Size
from textual.message import Message
from textual.scroll_view import ScrollView
from textual.strip import Strip

from anaplot.aliases import Axis
from anaplot.console.repainting import repaint
from anaplot.console.rows import ShownRow, SortOrder
from anaplot.console.text import cell, fit, fit_end
from anaplot.textfiles.wording import plain

__all__ = ["TableView"]

_VERDICT = 13
_MARKS = {"": " ", "lateral": "◆", "control": "▲"}
"""Beside a row of a point that is known from another strip, or on the ground."""


@dataclass(frozen=True, slots=True)
class _Column:
    title: str
    width: int
    cell: Callable[[ShownRow, int], str]
    sorted_by: SortOrder | None = None


def _redn(shown: ShownRow, width: int) -> str:
    return cell(shown.row.r, width, 3) if shown.row else " " * width


def _parx(shown: ShownRow, width: int) -> str:
    if shown.off_um is not None:
        return cell(shown.off_um, width, 1)
    return cell(shown.row.residual, width, 1) if shown.row else " " * width


def _expd(shown: ShownRow, width: int) -> str:
    return cell(shown.row.expected, width, 1) if shown.row else " " * width


def _sigf(shown: ShownRow, width: int) -> str:
    return cell(shown.row.size, width, 2) if shown.row else " " * width


def _mdb(shown: ShownRow, width: int) -> str:
    return cell(shown.row.mdb, width, 0) if shown.row else " " * width


def _chance(shown: ShownRow, width: int) -> str:
    return cell(100.0 * shown.row.probability, width, 1) if shown.row else " " * width


_NUMBERS = (
    _Column("RED-N", 6, _redn, "redundancy"),
    _Column("PARX µm", 8, _parx),
    _Column("EXPD µm", 8, _expd),
    _Column("SIGF", 6, _sigf, "significance"),
)
_FEWEST = (_NUMBERS[-1],)
_RESIDUAL = _Column("RESID µm", 9, _parx)  # of a fiducial
_MORE = (
    _Column("FINDS µm", 9, _mdb),
    _Column("ODDS %", 7, _chance),
)


class TableView(ScrollView):
    """RED-N, PARX, EXPD, SIGF and verdict of every row, with a cursor that follows its row.

    Where flagged rows are out of sight, the last line says how many and where.
    """

    COMPONENT_CLASSES: ClassVar[set[str]] = {
        "table--header",
        "table--row",
        "table--ok",
        "table--quiet",
        "table--flagged",
        "table--culprit",
        "table--next",
        "table--cursor",
    }

    DEFAULT_CSS = """
    TableView {
        scrollbar-size-vertical: 1;
        scrollbar-size-horizontal: 0;
        overflow-x: hidden;
        scrollbar-background: $background;
        scrollbar-color: $panel-lighten-2;
        .table--header { color: $text-muted; text-style: bold; }
        .table--row { color: $foreground; }
        .table--ok { color: $text-muted; }
        .table--quiet { color: $text-muted; }
        .table--flagged { color: $text-error; text-style: bold; }
        .table--culprit { color: $text-error; text-style: bold reverse; }
        .table--next { color: $text-accent; }
        .table--cursor { background: $panel-lighten-1; }
    }
    """

    class Selected(Message):
        """Another row was selected with the mouse."""

    class Driven(Message):
        """A row was double-clicked."""

    can_focus = False

    def __init__(self, *, id: str | None = None) -> None:  # noqa: A002 - Textual's name
        super().__init__(id=id)
        self._rows: tuple[ShownRow, ...] = ()
        self._order: SortOrder = "table"
        self._fiducials = False
        self._cursor = 0
        self._styles: dict[tuple[str, bool], Style] = {}
        self._strips: list[Strip] = []
        self._painted_at: tuple[Size, Offset, int] | None = None

    @property
    def selected(self) -> ShownRow | None:
        """The row under the cursor."""
        return self._rows[self._cursor] if self._rows else None

    @property
    def shown(self) -> tuple[ShownRow, ...]:
        """The rows in the order shown."""
        return self._rows

    def show(
        self,
        rows: tuple[ShownRow, ...],
        order: SortOrder,
        *,
        fiducials: bool = False,
        chosen: tuple[str, Axis] | None = None,
    ) -> None:
        """Show these rows, of points or of fiducials; the cursor goes to the chosen one if any."""
        here = self.selected.key if self.selected else None
        self._rows, self._order, self._fiducials = rows, order, fiducials
        keys = [shown.key for shown in rows]
        self._cursor = min(self._cursor, max(len(rows) - 1, 0))
        self._cursor = next((keys.index(k) for k in (chosen, here) if k in keys), self._cursor)
        self._measure()
        self._keep_cursor_in_sight()
        self._paint()

    def select(self, key: tuple[str, Axis]) -> bool:
        """Put the cursor on a row; returns whether there is such a row."""
        for i, shown in enumerate(self._rows):
            if shown.key == key:
                self._cursor = i
                self._keep_cursor_in_sight()
                self._paint()
                return True
        return False

    def step(self, action: str) -> int | None:
        """Return by how many rows an action moves the cursor; None when it moves it nowhere."""
        page, everything = max(self.size.height - 1, 1), len(self._rows)
        return {
            **dict.fromkeys(("row_up", "up"), -1),
            **dict.fromkeys(("row_down", "down"), 1),
            "page_up": -page,
            "page_down": page,
            "first": -everything,
            "last": everything,
        }.get(action)

    def move(self, step: int) -> None:
        """Move the cursor by rows; it stops at either end."""
        if self._rows:
            self._cursor = min(max(self._cursor + step, 0), len(self._rows) - 1)
            self._keep_cursor_in_sight()
            self._paint()

    def moved(self, step: int) -> str:
        """Move the cursor by rows; returns what is to be told, or ""."""
        before = self.selected
        self.move(step)
        shown = self.selected
        if shown is None:
            return "no row is selected"
        if shown == before:
            return f"this is the {'first' if step < 0 else 'last'} row"
        return "" if self.display else f"{shown.point} {shown.axis}"

    def select_next(self, ranked: tuple[tuple[str, str], ...]) -> str:
        """Select the row after the cursor's in a ranking; returns what is to be told, or ""."""
        before = self.selected
        here = None if before is None else before.key
        place = ranked.index(here) + 1 if here in ranked else 0
        wanted = ranked[place % len(ranked)] if ranked else None
        if not any(self.select(row.key) for row in self._rows if row.key == wanted):
            return "no flagged row"
        return "no other flagged row" if self.selected == before else ""

    def on_resize(self) -> None:
        """Keep the selected row in sight."""
        self._measure()
        self._keep_cursor_in_sight()

    def _measure(self) -> None:
        self.virtual_size = Size(0, len(self._rows) + 1 + self._noting)

    @property
    def _noting(self) -> bool:
        """Whether the last line is kept for what is out of sight."""
        hides = 2 < self.size.height <= len(self._rows)
        return hides and any(shown.flagged for shown in self._rows)

    def _note(self) -> str:
        """Return how many flagged rows are out of sight, or ""."""
        if not self._noting:
            return ""
        first = self.scroll_offset.y
        last = first + self.size.height - 2
        parts = [
            f"{arrow} {count} flagged {where}"
            for arrow, where, rows in (
                ("↑", "above", self._rows[:first]),
                ("↓", "below", self._rows[last:]),
            )
            if (count := sum(shown.flagged for shown in rows))
        ]
        return ", ".join(parts)

    @property
    def _width(self) -> int:
        """Cells beside the scrollbar."""
        return self.scrollable_content_region.width

    def _keep_cursor_in_sight(self) -> None:
        if self.size.height < 2:
            return  # not laid out yet: there is nothing to scroll in
        # The header covers the first line wherever the rows are scrolled to, the note the last.
        self.scroll_to_region(
            Region(0, self._cursor, 1, 2 + self._noting), animate=False, force=True, immediate=True
        )

    def on_click(self, event: events.Click) -> None:
        """Select the row under the mouse; a double click drives there."""
        place = event.y - 1 + self.scroll_offset.y
        noted = event.y == self.size.height - 1 and self._note() != ""
        if event.y < 1 or noted or not 0 <= place < len(self._rows):
            return
        self._cursor = place
        self._paint()
        self.post_message(self.Selected())
        if event.chain == 2:
            self.post_message(self.Driven())

    def _columns(self) -> tuple[tuple[_Column, ...], int]:
        """Return the columns that have room, and the width of the point's name."""
        longest = max(
            [len(self._name_title) - 2, 5, *(cell_len(plain(shown.point)) for shown in self._rows)]
        )
        room = self._width - 4 - _VERDICT
        columns: tuple[_Column, ...] = ()
        # beside the stereo view there is no room for more than what the verdict comes from
        numbers: tuple[_Column, ...] = _NUMBERS
        if self._fiducials:
            numbers = tuple(_RESIDUAL if c.cell is _parx else c for c in _NUMBERS)
        for choice, least in (((*numbers, *_MORE), 6), (numbers, 4), (_FEWEST, 4), ((), 0)):
            rest = room - sum(column.width for column in choice)
            if rest >= least:
                columns, room = choice, rest
                break
        return columns, max(min(room, longest + 1, 24), 4)

    def _paint(self) -> None:
        """Paint the lines that are others now."""
        before = self._strips if self._painted_at == self._place else None
        self._draw()
        repaint(self, before, self._strips)

    @property
    def _place(self) -> tuple[Size, Offset, int]:
        """Return what decides which rows the lines are, and how long they are."""
        return self.size, self.scroll_offset, self._width

    def _draw(self) -> None:
        columns, name = self._columns()
        width = self._width
        self._strips = [self._line(y, columns, name, width) for y in range(self.size.height)]
        self._painted_at = self._place

    def render_line(self, y: int) -> Strip:
        """Return the header or one row."""
        if self._painted_at != self._place:
            self._draw()
        return self._strips[y]

    def _line(self, y: int, columns: tuple[_Column, ...], name: int, width: int) -> Strip:
        if y == 0:
            return self._header(columns, name, width)
        if y == self.size.height - 1 and (note := self._note()):
            style = self._style("table--flagged")
            return Strip([Segment(f"  {note}", style)]).adjust_cell_length(
                width, self._style("table--row")
            )
        place = y - 1 + self.scroll_offset.y
        if place >= len(self._rows):
            return Strip.blank(width, self._style("table--row"))
        shown = self._rows[place]
        here = place == self._cursor
        start = f"{'▶' if here else ' '} {fit_end(shown.point, name - 1)} {shown.axis}"
        start += _MARKS[shown.mark]
        middle = "".join(column.cell(shown, column.width) for column in columns)
        if shown.flagged or (shown.taken_for and shown.row is not None):
            accused = shown.accused or shown.taken_for
            verdict = "table--culprit" if accused else "table--flagged"
            parts = [(start + middle, "table--flagged"), (f" {shown.verdict}", verdict)]
        elif shown.verdict == "next":
            parts = [(start + middle, "table--next"), (" next", "table--next")]
        elif shown.row is None:
            parts = [(start + middle, "table--quiet"), (f" {shown.verdict}", "table--quiet")]
        else:
            parts = [(start + middle, "table--row"), (f" {shown.verdict}", "table--ok")]
        if here:  # nothing fades on the cursor's background
            faint = ("table--quiet", "table--ok")
            parts = [(part, "table--row" if style in faint else style) for part, style in parts]
        segments = [Segment(part, self._style(style, here)) for part, style in parts]
        return Strip(segments).adjust_cell_length(width, self._style("table--row", here))

    @property
    def _name_title(self) -> str:
        return "FIDUCIAL" if self._fiducials else "POINT"

    def _style(self, name: str, here: bool = False) -> Style:
        """Return a component's style, on the cursor's background or not."""
        style = self._styles.get((name, here))
        if style is None:
            style = self.get_component_rich_style(name)
            if here:
                style += self.get_component_rich_style("table--cursor", partial=True)
            self._styles[name, here] = style
        return style

    def notify_style_update(self) -> None:
        """Take the new colours."""
        self._styles = {}
        self._painted_at = None
        super().notify_style_update()

    def _header(self, columns: tuple[_Column, ...], name: int, width: int) -> Strip:
        first = self._name_title
        shown = f"{first[: name + 1]}▴" if self._order == "point" else first
        titles = "  " + fit(shown, name + 2)
        for column in columns:
            title = column.title
            if column.sorted_by == self._order:
                title += "▾" if self._order == "significance" else "▴"
            titles += title.rjust(column.width)
        style = self._style("table--header")
        return Strip([Segment(titles, style)]).adjust_cell_length(width, style)
