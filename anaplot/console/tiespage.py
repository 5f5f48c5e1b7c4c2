"""The page of ties: the strip in work against its neighbours and against the control."""

from __future__ import annotations

from typing import ClassVar

from textual.binding import Binding, BindingType
from textual.content import Content

from anaplot.console.dialogs import LINE, Page
from anaplot.console.text import cell, fit, fit_end, number, wrap
from anaplot.orientation.striptie import TiePoint
from anaplot.session.tiecheck import GROUND, TieCheck
from anaplot.station.snapshot import Snapshot
from anaplot.textfiles.wording import plain

__all__ = ["TiesPage", "ties_page"]

_POINT = 12
_MOST = 100  # points of a table; whoever has more begins with the last


class TiesPage(Page):
    """What ties the strip; it follows the work while it is read.

    Parameters
    ----------
    snapshot
        What is said of ties.
    """

    BINDINGS: ClassVar[list[BindingType]] = [Binding("T", "close", "Close")]

    def __init__(self, snapshot: Snapshot) -> None:
        super().__init__("Ties between strips, and to the control", ties_page(snapshot, LINE))

    def renew(self, snapshot: Snapshot) -> None:
        """Show what is said of ties now."""
        self.show(ties_page(snapshot, LINE))


def ties_page(snapshot: Snapshot, width: int) -> list[Content]:
    """Return the page.

    Parameters
    ----------
    snapshot
        What is said of ties.
    width
        Cells of a line.
    """
    lines: list[Content] = []
    for accident in snapshot.accidents:
        style = "bold $text-error" if accident.certain else "bold $text-warning"
        lines += [Content.styled(line, style) for line in wrap(plain(accident.text), width)]
    if snapshot.hint:
        lines += [Content(line) for line in wrap(plain(snapshot.hint), width)]
    offered = [view for view in snapshot.points if view.offered]
    if offered:
        names = ", ".join(
            plain(view.point)
            + ("" if view.sigma is None else f" (within {1e3 * view.sigma:.0f} µm)")
            for view in offered
        )
        lines += [Content(line) for line in wrap(f"due in this model: {names}", width)]
    for check in snapshot.ties:
        lines += [Content(""), *_check(check, width)] if lines else _check(check, width)
    if not lines:
        text = "Nothing ties this strip yet: no other strip is measured, and there is no control."
        lines = [Content(line) for line in wrap(text, width)]
    return lines


def _check(check: TieCheck, width: int) -> list[Content]:
    name = f"STRIP {check.strip} AND {'CONTROL' if check.other == GROUND else check.other}"
    points = "1 common point" if check.common == 1 else f"{check.common} common points"
    lines = [Content.styled(fit(f"{plain(name)}  {points}", width), "bold")]
    tie = check.tie
    if tie is None:
        return [*lines, *(Content(f"  {line}") for line in wrap(check.problem, width - 2))]
    sigma0 = "none" if tie.sigma0 is None else f"{tie.sigma0:.2f}"
    critical = "none" if tie.test.critical is None else f"{tie.test.critical:.2f}"
    said = [
        f"sigma0 {sigma0}, redundancy {tie.redundancy}, test {tie.test.kind} {tie.test.alpha:g}, "
        f"critical value {critical}"
    ]
    if tie.level:
        said.append("too few points, or nearly on one line: both are taken to be level")
    if not tie.checkable:
        said.append("not yet checkable: a wrong one can be told from four points on")
    lines += [Content(f"  {line}") for text in said for line in wrap(text, width - 2)]
    metres = "" if check.unit_m is None else "  OFF m"
    head = f"  {'POINT':<{_POINT}}{'dX mm':>9}{'dY mm':>9}{'dZ mm':>9}{metres}{'R':>6}{'W':>8}"
    lines.append(Content.styled(fit(head, width), "bold $foreground-muted"))
    shown = tie.points[-_MOST:]
    return lines + [_row(point, check, width) for point in shown]


def _row(point: TiePoint, check: TieCheck, width: int) -> Content:
    off = sum(d * d for d in point.difference) ** 0.5
    metres = "" if check.unit_m is None else number(off * check.unit_m, 7, 2)
    verdict = ""
    if point.point in check.wrong:
        verdict = " << WRONG"
    elif point.flagged:
        verdict = " < flagged"
    elif point.r is None:
        verdict = " check"
    text = (
        "  "
        + fit_end(plain(point.point), _POINT - 1)
        + " "
        + "".join(number(d, 9, 3) for d in point.difference)
        + metres
        + cell(point.mean_r, 6, 2)
        + cell(point.largest_w, 8, 2)
        + verdict
    )
    return Content.styled(fit(text, width), "bold $text-error" if verdict[:2] == " <" else "")
