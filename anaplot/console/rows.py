"""The table as shown: the solution's rows, and those that are still pending or switched off."""

from __future__ import annotations

import re
from dataclasses import dataclass
from math import isfinite
from typing import Literal

from anaplot.adjustment.tested import Observation
from anaplot.aliases import Axis
from anaplot.console.inwork import in_work
from anaplot.orientation.results import Row
from anaplot.session.transfer import Mark
from anaplot.station.snapshot import PointView, Snapshot
from anaplot.textfiles.wording import plain

__all__ = ["SORT_ORDERS", "RowState", "ShownRow", "SortOrder", "shown_rows", "sort_rows"]

RowState = Literal["pending", "measured", "off"]
SortOrder = Literal["table", "significance", "redundancy", "point"]
SORT_ORDERS: tuple[SortOrder, ...] = ("table", "significance", "redundancy", "point")

_NOT_TESTABLE = 1e-9


@dataclass(frozen=True, slots=True)
class ShownRow:
    """One row of the table on the screen.

    Attributes
    ----------
    point, axis
        The row's identity.
    state
        pending (not measured), measured or off.
    expected
        Whether its point is the one to be measured next.
    row
        What the model says of it, or None while it says nothing.
    accused
        Whether it is the flagged row most probably wrong.
    half
        The only photo in which its point was measured so far, in a mono comparator, or "".
    off_um
        The parallax [um] that it would have, where it is off; None where there is none.
    mark
        Whether its point is known from another strip, or on the ground.
    offered
        Whether the model is complete without it.
    taken_for
        What its point is probably called instead, or "".
    """

    point: str
    axis: Axis
    state: RowState
    expected: bool
    row: Observation[Row] | None = None
    accused: bool = False
    half: str = ""
    off_um: float | None = None
    mark: Mark = ""
    offered: bool = False
    taken_for: str = ""

    @property
    def key(self) -> tuple[str, Axis]:
        """(point, axis)."""
        return self.point, self.axis

    @property
    def flagged(self) -> bool:
        """Whether its test rejects it."""
        return self.row is not None and self.row.flagged

    @property
    def verdict(self) -> str:
        """What the operator reads at the end of the row."""
        if self.state == "off":
            return "off"
        if self.state == "pending" and self.half and not self.expected:
            return f"{self.half} only"
        if self.state == "pending":
            quiet = "offered" if self.offered else "pending"
            return "next" if self.expected else quiet
        if self.taken_for:
            return f"<< is {plain(self.taken_for)}?"
        if self.row is None:
            return "measured"
        if self.accused and self.row.w is not None:
            return "<< REMEASURE"
        if self.row.flagged:
            return "< flagged"
        if self.row.r < _NOT_TESTABLE:
            return "not testable"
        return "ok" if self.row.w is not None else "no check"


def _row(
    view: PointView,
    axis: Axis,
    expected: bool,
    table: dict[Row, Observation[Row]],
    accused: tuple[str, str | None] | None,
    off: dict[Row, float],
    taken_for: dict[str, str],
) -> ShownRow:
    key = (view.point, axis)
    if axis in view.off_axes or view.status == "off":
        return ShownRow(view.point, axis, "off", expected, off_um=off.get(key), mark=view.mark)
    # A point whose other row alone is off counts as measured: its plates were read.
    state: RowState = "pending" if view.status == "pending" else "measured"
    return ShownRow(
        view.point,
        axis,
        state,
        expected,
        table.get(key),
        key == accused,
        view.seen[0] if len(view.seen) == 1 else "",
        mark=view.mark,
        offered=view.offered,
        taken_for=taken_for.get(view.point, ""),
    )


def shown_rows(snapshot: Snapshot) -> tuple[ShownRow, ...]:
    """Return all rows of the current model: y of every point, then x of every tie, in plan order.

    During an inner orientation x and y of every fiducial. The order does not depend on what is
    measured already, so rows keep their places.
    """
    work = in_work(snapshot)
    table = {row.key: row for row in work.table}
    accused = work.suspects[0] if work.suspects else None
    off = {row.key: row.residual for row in work.off if isfinite(row.residual)}
    views = {view.point: view for view in work.points}
    other = {} if snapshot.inner is not None else {o.point: o.name for o in snapshot.other_names}
    return tuple(
        _row(views[point], axis, point == snapshot.next_point, table, accused, off, other)
        for point, axis in work.keys
    )


def _natural(name: str) -> tuple[tuple[int, int, str], ...]:
    """Names in the order people count: 9 before 10."""
    return tuple(
        (0, int(part), "") if part.isascii() and part.isdigit() else (1, 0, part)
        for part in re.findall(r"[0-9]{1,18}|[^0-9]+", name)
    )


def _by_significance(shown: ShownRow) -> float:
    size = shown.row.size if shown.row is not None else None
    return 1.0 if size is None else -size


def sort_rows(rows: tuple[ShownRow, ...], order: SortOrder) -> tuple[ShownRow, ...]:
    """Return the rows sorted; equal ones keep the table's order, rows without a value come last.

    `significance`: the largest first. `redundancy`: the worst controlled first. `point`: by name.
    """
    if order == "significance":
        return tuple(sorted(rows, key=_by_significance))
    if order == "redundancy":
        return tuple(sorted(rows, key=lambda shown: shown.row.r if shown.row else 2.0))
    if order == "point":
        return tuple(sorted(rows, key=lambda shown: _natural(shown.point)))
    return rows
