"""The overview as widgets: the list of models with a cursor, what holds of all, and the map."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from rich.segment import Segment
from rich.style import Style
from textual import events
from textual.app import ComposeResult
from textual.containers import Horizontal, Vertical
from textual.content import Content
from textual.geometry import Region, Size
from textual.message import Message
from textual.scroll_view import ScrollView
from textual.strip import Strip
from textual.widget import Widget

from anaplot.console.intent import PAGES
from anaplot.console.inwork import recorded
from anaplot.console.now import leading
from anaplot.console.overview import (
    HEADINGS,
    Entry,
    doing,
    entries_of,
    foot_lines,
    map_lines,
    model_text,
    strip_text,
)
from anaplot.console.text import fit
from anaplot.session.reasons import REASONS
from anaplot.station.blockstatus import BlockStatus, ModelStatus
from anaplot.station.snapshot import Snapshot

__all__ = ["ModelList", "OverviewView"]

_OF_TABLE = frozenset({"sort", "transfers", "layout", "stereo"})
_ELSEWHERE = frozenset(
    {"leave", "redraw", "automatic", "suspend", "stop", "hand", "report", *PAGES}
    | {f"why_{reason}" for reason in REASONS}
)
_MOST_LINES = 12
_STEPS = {"row_up": -1, "up": -1, "row_down": 1, "down": 1}


class ModelList(ScrollView):
    """Strips and models, a line each; the cursor is on a model."""

    COMPONENT_CLASSES: ClassVar[set[str]] = {
        "list--header",
        "list--strip",
        "list--quiet",
        "list--model",
        "list--look",
        "list--work",
        "list--cursor",
    }

    DEFAULT_CSS = """
    ModelList {
        scrollbar-size-vertical: 1;
        scrollbar-size-horizontal: 0;
        overflow-x: hidden;
        height: 1fr;
        scrollbar-background: $background;
        scrollbar-color: $panel-lighten-2;
        .list--header { color: $text-muted; text-style: bold; }
        .list--strip { color: $text-primary; text-style: bold; }
        .list--quiet { color: $text-muted; }
        .list--model { color: $foreground; }
        .list--look { color: $text-error; text-style: bold; }
        .list--work { color: $text-accent; text-style: bold; }
        .list--cursor { background: $panel-lighten-1; }
    }
    """

    class Selected(Message):
        """Another model was selected by hand."""

    class Entered(Message):
        """The selected model was clicked again."""

    can_focus = False

    def __init__(self, *, id: str | None = None) -> None:  # noqa: A002 - Textual's name
        super().__init__(id=id)
        self._entries: tuple[Entry, ...] = ()
        self._places: tuple[int, ...] = ()
        self._next = ""
        self._cursor = 0
        self._styles: dict[tuple[str, bool], Style] = {}

    @property
    def selected(self) -> ModelStatus | None:
        """The model under the cursor."""
        return self._entries[self._places[self._cursor]].model if self._places else None

    def show(self, status: BlockStatus) -> None:
        """Show this; the cursor stays on its model."""
        here = self.selected
        self._entries, self._next = entries_of(status), status.next.model
        self._places = tuple(i for i, entry in enumerate(self._entries) if entry.model is not None)
        if here is None or not self.select(here.name):
            self._cursor = min(self._cursor, max(len(self._places) - 1, 0))
        self.virtual_size = Size(0, len(self._entries) + 1)
        self._keep_in_sight()
        self.refresh()

    def select(self, name: str) -> bool:
        """Put the cursor on a model; returns whether there is such a one."""
        for cursor, place in enumerate(self._places):
            model = self._entries[place].model
            if model is not None and model.name == name:
                self._cursor = cursor
                self._keep_in_sight()
                self.refresh()
                return True
        return False

    def step(self, action: str) -> int | None:
        """Return by how many models an action moves the cursor; None when it moves it nowhere."""
        page, everything = max(self.size.height - 1, 1), len(self._places)
        pages = {"page_up": -page, "page_down": page, "first": -everything, "last": everything}
        return {**_STEPS, **pages}.get(action)

    def move(self, step: int) -> None:
        """Move the cursor by models; it stops at either end."""
        if self._places:
            self._cursor = min(max(self._cursor + step, 0), len(self._places) - 1)
            self._keep_in_sight()
            self.refresh()
            self.post_message(self.Selected())

    def on_resize(self) -> None:
        """Keep the selected model in sight."""
        self.virtual_size = Size(0, len(self._entries) + 1)
        self._keep_in_sight()

    def _keep_in_sight(self) -> None:
        if self.size.height < 2 or not self._places:
            return  # not laid out yet: there is nothing to scroll in
        place = self._places[self._cursor]
        # a strip's first model brings the strip's own line along
        top = place - 1 if self._entries[place - 1].model is None else place
        region = Region(0, top, 1, place - top + 2)
        self.scroll_to_region(region, animate=False, force=True, immediate=True)

    def on_click(self, event: events.Click) -> None:
        """Select the model under the mouse; a click on the selected one goes there."""
        place = event.y - 1 + self.scroll_offset.y
        if event.y < 1 or place not in self._places:
            return
        cursor = self._places.index(place)
        again, self._cursor = cursor == self._cursor, cursor
        self.refresh()
        self.post_message(self.Selected())
        if again:
            self.post_message(self.Entered())

    def render_line(self, y: int) -> Strip:
        """Return the heading, a strip or a model."""
        width = self.scrollable_content_region.width
        if y == 0:
            return self._line(fit(HEADINGS, width), "list--header")
        place = y - 1 + self.scroll_offset.y
        if place >= len(self._entries):
            return Strip.blank(width, self._style("list--model"))
        entry = self._entries[place]
        if entry.model is None:
            return self._line(strip_text(entry.strip, width), "list--strip")
        model, here = entry.model, place == self._places[self._cursor]
        following = model.name == self._next
        style = {"open": "list--quiet", "look": "list--look", "in work": "list--work"}.get(
            model.state, "list--model"
        )
        if model.state == "open" and (following or here):
            style = "list--work" if following else "list--model"
        return self._line(model_text(model, width, here=here, following=following), style, here)

    def _line(self, text: str, style: str, here: bool = False) -> Strip:
        width = self.scrollable_content_region.width
        return Strip([Segment(text, self._style(style, here))]).adjust_cell_length(width)

    def _style(self, name: str, here: bool = False) -> Style:
        """Return a component's style, on the cursor's background or not."""
        style = self._styles.get((name, here))
        if style is None:
            style = self.get_component_rich_style(name)
            if here:
                style += self.get_component_rich_style("list--cursor", partial=True)
            self._styles[name, here] = style
        return style

    def notify_style_update(self) -> None:
        """Take the new colours."""
        self._styles = {}
        super().notify_style_update()


class OverviewFoot(Widget):
    """Verdict, ties, weak spots and what is next."""

    DEFAULT_CSS = "OverviewFoot { height: auto; max-height: 6; background: $surface; }"

    def __init__(self) -> None:
        super().__init__()
        self._status: BlockStatus | None = None
        self._doing = ""

    def show(self, status: BlockStatus, doing: str) -> None:
        """Show this from now on."""
        if (status, doing) == (self._status, self._doing):
            return
        before = len(self._lines(self.size.width))
        self._status, self._doing = status, doing
        # a new layout is costly: only another number of lines needs one
        self.refresh(layout=len(self._lines(self.size.width)) != before)

    def _lines(self, width: int, height: int = _MOST_LINES) -> list[Content]:
        if self._status is None:
            return []
        return foot_lines(self._status, self._doing, width, height)

    def get_content_height(self, container: Size, viewport: Size, width: int) -> int:
        """Return how many lines there are; the style sets a limit."""
        return len(self._lines(width))

    def render(self) -> Content:
        """Return the lines as one text."""
        return Content("\n").join(self._lines(*self.size))


class OverviewMap(Widget):
    """The block as signs."""

    DEFAULT_CSS = "OverviewMap { width: 1fr; margin-left: 2; }"

    def __init__(self) -> None:
        super().__init__()
        self._status: BlockStatus | None = None
        self._selected: ModelStatus | None = None

    def show(self, status: BlockStatus, selected: ModelStatus | None) -> None:
        """Show this from now on."""
        self._status, self._selected = status, selected
        self.refresh()

    def render(self) -> Content:
        """Return the lines as one text."""
        if self._status is None:
            return Content("")
        return Content("\n").join(map_lines(self._status, self._selected, *self.size))


class OverviewView(Horizontal):
    """Where the block stands; beside it, where there is room, the block's map.

    It stands on the screen when a block is opened and between models, and gives way to the table
    when a model comes into work or something is measured; whoever calls it keeps it until he sends
    it away. The cursor is on the model that is to be worked on next, until it is moved by hand.

    Attributes
    ----------
    stands
        Whether it is to be seen.
    """

    DEFAULT_CSS = """
    OverviewView {
        Vertical { width: 1fr; }
        OverviewMap { display: none; }
    }
    """

    def __init__(self, *, id: str | None = None) -> None:  # noqa: A002 - Textual's name
        super().__init__(id=id)
        self.stands = False
        self._called = False
        self._moved = False
        self._before: Snapshot | None = None
        self._status: BlockStatus | None = None

    def compose(self) -> ComposeResult:
        """Lay list, foot and map out."""
        with Vertical():
            yield ModelList(id="models")
            yield OverviewFoot()
        yield OverviewMap()

    @property
    def selected(self) -> ModelStatus | None:
        """The model under the cursor."""
        return self.query_one(ModelList).selected

    @property
    def aim(self) -> ModelStatus | None:
        """Where Enter leads: the model selected by hand, or between models the next one."""
        model, shown = self.selected, self._before
        if not self.stands or model is None or shown is None or self._status is None:
            return None
        following = not shown.left and model.name == self._status.next.model
        return model if self._moved or following else None

    def show(self, snapshot: Snapshot, keys: Mapping[str, tuple[str, ...]]) -> None:
        """Show where the block stands now, and stand or give way; `keys`: those in force."""
        before, self._before = self._before, snapshot
        self._status = status = snapshot.status
        if status is None:
            self.stands = False
            return
        if before is None or _photos(before) != _photos(snapshot):
            self.stands, self._called = before is None or not snapshot.left, False
            self._moved = False
        elif snapshot.left and not self._called and recorded(before) != recorded(snapshot):
            self.stands = False
        if self.stands:
            self._draw(snapshot, status, keys)

    def _draw(
        self, snapshot: Snapshot, status: BlockStatus, keys: Mapping[str, tuple[str, ...]]
    ) -> None:
        models = self.query_one(ModelList)
        models.show(status)
        if not self._moved:
            models.select(status.next.model)
        lead = leading(snapshot) if snapshot.left else None
        self.query_one(OverviewFoot).show(status, doing(status.next, lead, keys))
        self._show_map()

    def toggle(self, keys: Mapping[str, tuple[str, ...]]) -> None:
        """Call it, or send it away; `keys`: those in force."""
        self.stands = self._called = not self.stands and self._status is not None
        self._moved = False
        if self.stands and self._before is not None and self._status is not None:
            self._draw(self._before, self._status, keys)

    def give_way(self, action: str) -> None:
        """Give way to the table when an action is one that is to be seen there."""
        if action in _OF_TABLE or (self._before is not None and self._before.left):
            self.stands = self.stands and action in _ELSEWHERE

    def press(self, action: str) -> bool:
        """Move the cursor as an action says; returns whether it moves it."""
        models = self.query_one(ModelList)
        step = models.step(action)
        if step is None:
            return False
        models.move(step)
        return True

    def on_model_list_selected(self) -> None:
        """Remember that the cursor was moved by hand."""
        self._moved = True
        self._show_map()

    def _show_map(self) -> None:
        if self._status is not None:
            self.query_one(OverviewMap).show(self._status, self.selected)


def _photos(snapshot: Snapshot) -> tuple[str, str]:
    return snapshot.left, snapshot.right
