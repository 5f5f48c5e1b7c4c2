"""The block page, and the one line that the block is worth beside the model's advice."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical, VerticalScroll
from textual.content import Content
from textual.geometry import Region
from textual.widgets import Static

from anaplot.console.blockmapview import BlockMapView
from anaplot.console.describe import Entry
from anaplot.console.dialogs import LINE, Page, clickable
from anaplot.console.panels import entry_lines, said_line
from anaplot.console.text import cell, fit, fit_end, number, wrap
from anaplot.station.blockview import (
    BlockView,
    FlaggedObservation,
    SuspectedPoint,
    SuspectedRay,
    percent,
    unless_wrong,
)
from anaplot.station.snapshot import Snapshot
from anaplot.textfiles.wording import plain

__all__ = ["TITLE", "BlockPage", "block_page"]

TITLE = "The block as one bundle"

_HERE = "▶ "
_LABEL = 14
_MOST = 100  # points on the page; whoever has more begins with the first
_POINT, _PHOTO, _MODEL = 15, 12, 17


class BlockPage(Page):
    """What the block says; Enter on a suspected point returns to the model that holds it.

    Its map takes the place of the text, or stands beside it where the terminal has room.

    Parameters
    ----------
    snapshot
        What the station says.
    back
        Called with left, right, point and photo when the operator returns to a model.
    report
        Called when the report is to be written, and the key for that as people write it.
    """

    HORIZONTAL_BREAKPOINTS = [(0, "-narrow"), (130, "-broad")]  # noqa: RUF012

    DEFAULT_CSS = """
    BlockPage {
        #sight { height: auto; }
        .page--foot { dock: bottom; height: auto; display: none; }
        BlockMapView { display: none; width: 1fr; height: 1fr; }
        &.-map.-solved, &.-broad.-solved {
            & > Vertical { width: 98%; height: 94%; }
            #sight { height: 1fr; }
            BlockMapView { display: block; }
        }
        &.-broad.-solved VerticalScroll { width: 74; margin-right: 2; }
        &.-map.-solved VerticalScroll { display: none; }
    }
    """

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("m", "map", "The map in place of the text"),
        Binding("W", "report", "Write the report", id="report"),
        Binding("enter", "enter", "Return to the point's model"),
        Binding("up,k", "select(-1)", "The point before"),
        Binding("down,j", "select(1)", "The next point"),
    ]

    def __init__(
        self,
        snapshot: Snapshot,
        back: Callable[[str, str, str, str], None],
        report: tuple[Callable[[], None], str],
    ) -> None:
        self._snapshot, self._back = snapshot, back
        self._report, self._report_key = report
        self._chosen = ""
        super().__init__(TITLE, self._drawn())

    def compose(self) -> ComposeResult:
        """Lay title, text and map out."""
        with Vertical():
            keys = (
                clickable("(escape closes)", "close"),
                clickable("(m the map)", "map"),
                clickable(f"({self._report_key} the report)", "report"),
            )
            yield Static(Content("   ").join([Content(TITLE), *keys]), classes="page--title")
            yield Static(Content(""), classes="page--foot")
            with Horizontal(id="sight"):
                with VerticalScroll(can_focus=False):
                    yield Static(Content("\n").join(self._lines), classes="page--text")
                yield BlockMapView()

    def on_mount(self) -> None:
        """Show what has come since it was laid out."""
        super().on_mount()
        self._show_map()

    def renew(self, snapshot: Snapshot) -> None:
        """Show what the block says now."""
        self._snapshot = snapshot
        self.show(self._drawn())
        self._show_map()

    def _show_map(self) -> None:
        view, points = self._snapshot.block_view, self._points
        block = None if view is None else view.block_map
        self.set_class(block is not None, "-solved")
        for shown in self.query(BlockMapView):
            shown.show(block, points[self._at].point if points else None)

    def action_report(self) -> None:
        """Have the report written."""
        self._report()

    def tell(self, severity: str, text: str) -> None:
        """Say at the foot what becomes of the report."""
        for foot in self.query(".page--foot").results(Static):
            width = max(self.query_one(Vertical).content_size.width, 1)
            foot.display = True
            foot.update(said_line(severity, text, width))

    def action_map(self) -> None:
        """Show the map in place of the text, or the text again."""
        self.toggle_class("-map")

    @property
    def _points(self) -> tuple[SuspectedPoint, ...]:
        view = self._snapshot.block_view
        return () if view is None or not view.solved else view.suspects[:_MOST]

    @property
    def _at(self) -> int:
        """Where the chosen point stands; the first one, until one is chosen, or when it is gone."""
        names = (point.point for point in self._points)
        return next((k for k, name in enumerate(names) if name == self._chosen), 0)

    def _target(self) -> tuple[str, str, str, str] | None:
        """Return what Enter returns to, or None."""
        if not self._points:
            return None
        point = self._points[self._at]
        ray = point.accused
        for left, right in self._snapshot.accepted:
            if ray.model == f"{left}/{right}":
                return left, right, point.point, ray.photo
        return None

    def _drawn(self) -> list[Content]:
        lines = block_page(self._snapshot.block_view, LINE, self._at if self._points else None)
        there = self._target()
        if there is not None:
            words = f"Enter returns to model {there[0]}/{there[1]}, for point {there[2]}"
            lines += [Content(""), *(Content(s) for s in wrap(plain(words), LINE))]
        return lines

    def action_select(self, step: int) -> None:
        """Select another suspected point; without one, scroll."""
        if len(self._points) < 2:
            self.action_scroll(step)
            return
        place = min(max(self._at + step, 0), len(self._points) - 1)
        self._chosen = self._points[place].point
        lines = self._drawn()
        self.show(lines)
        self._show_map()
        marked = next(i for i, line in enumerate(lines) if line.plain.startswith(_HERE))
        self.query_one(VerticalScroll).scroll_to_region(Region(0, marked, LINE, 3), animate=False)

    def action_enter(self) -> None:
        """Return to the selected point's model, or close the page."""
        there = self._target()
        self.dismiss(None)
        if there is not None:
            self._back(*there)


def block_page(view: BlockView | None, width: int, at: int | None = None) -> list[Content]:
    """Return the page: figures, suspected points, and what only now shows up.

    Parameters
    ----------
    view
        What the block says; None before there is anything to adjust.
    width
        Cells of a line.
    at
        Which of the suspected points is selected, or None.
    """
    if view is None:
        return [
            Content(line)
            for line in wrap(
                "Nothing is in the block yet: it begins with the first model whose pattern is "
                "complete and no y row of which is flagged.",
                width,
            )
        ]
    lines = entry_lines(_figures(view), width, _LABEL)
    if view.solved:
        lines += [Content(""), *_suspects(view, width, at)]
    return lines


def _figures(view: BlockView) -> list[Entry]:
    models = "1 model" if view.models == 1 else f"{view.models} models"
    newest = f"{models} of this session, the newest {view.after}"
    if not view.after:
        newest = "no model of this session yet, rows from elsewhere"
    entries = [("in it", newest + (", still to be accepted" if view.provisional else ""))]
    if view.busy:
        entries.append(("", "what was measured since is being adjusted"))
    if not view.solved:
        if view.remark:
            entries.append(("no solution", view.remark))
        return entries
    entries.append(("size", f"{view.photos} photos, {view.points} points, {view.rays} rays"))
    if view.sigma0 is None or view.sigma0_um is None:
        entries.append(("sigma0", "none: no redundancy, nothing is checked"))
    else:
        entries.append(
            ("sigma0", f"{view.sigma0:.2f} ({view.sigma0_um:.2f} µm), redundancy {view.redundancy}")
        )
    critical = "none" if view.critical is None else f"{view.critical:.2f}"
    entries.append(("test", f"{view.test}, critical value {critical}"))
    if view.ri_x is not None and view.ri_y is not None:
        entries.append(("mean RED-N", f"x {view.ri_x:.2f}, y {view.ri_y:.2f}"))
    free = "free: control does not suffice yet" if view.datum == "free" else "control and priors"
    entries.append(("datum", free))
    if view.aside:
        entries.append(("not joined yet", "photos " + ", ".join(view.aside)))
    newly = [point.point for point in view.suspects if point.newly]
    if newly:
        entries.append(("only now", f"{', '.join(newly)}: earlier, and not flagged before"))
    return entries


def _suspects(view: BlockView, width: int, at: int | None) -> list[Content]:
    if not view.suspects:
        return [Content("No point is flagged.")]
    head = (
        f"{'POINT':<{_POINT}}{'PHOTO':<{_PHOTO}}{'MODEL':<{_MODEL}}{'AXIS':<5}{'W':>8}{'RED-N':>7}"
    )
    lines = [Content.styled(fit(head, width), "bold $foreground-muted")]
    for k, point in enumerate(view.suspects[:_MOST]):
        lines += _point(point, view.unless(point), width, here=k == at)
    if len(view.suspects) > _MOST:
        lines.append(Content(f"and {len(view.suspects) - _MOST} more points"))
    advice = "One error may flag its neighbours: remeasure the first point, then look again."
    if len(view.suspects) > 1:
        lines += [
            Content(""),
            *(Content.styled(s, "$foreground-muted") for s in wrap(advice, width)),
        ]
    return lines


def _point(
    point: SuspectedPoint, unless: FlaggedObservation | None, width: int, *, here: bool
) -> list[Content]:
    lines = []
    for k, row in enumerate(point.flagged):
        cells = (
            (_HERE if here and k == 0 else "")
            + fit_end(point.point if k == 0 else "", _POINT - 1 - len(_HERE) * (here and k == 0))
            + " "
            + fit_end(row.photo, _PHOTO - 1)
            + " "
            + fit_end(row.model or "elsewhere", _MODEL - 1)
            + " "
            + fit(row.axis, 5)
            + number(row.w, 8, 2)
            + cell(row.r, 7, 3)
        )
        lines.append(Content.styled(fit(cells, width), "bold $text-error" if k == 0 else ""))
    verdict = "wrong: " + ", ".join(_chance(ray) for ray in point.rays[:3]) + unless_wrong(unless)
    if point.newly:
        verdict = f"only now ({point.since}), {verdict}"
    lines += [Content(f"  {line}") for line in wrap(verdict, width - 2)]
    return lines


def _chance(ray: SuspectedRay) -> str:
    where = f" ({plain(ray.model)})" if ray.model is not None else ""
    return f"photo {plain(ray.photo)}{where} {percent(ray.probability)}"
