"""A planned point pattern drawn with characters, as in 1983's Figures 2, 4 and 7."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import pairwise
from typing import NamedTuple

from anaplot.adjustment.tested import Transfer
from anaplot.aliases import Axis
from anaplot.orientation.results import ModelSolution, Row
from anaplot.planning.patternplan import PlannedPattern
from anaplot.report.columns import cell
from anaplot.textfiles.wording import plain

__all__ = ["drawing"]

_LINE = 80
_WIDEST, _NARROWEST = 20, 11
_GAP = 0.1  # of the extent: a wider gap begins a new column or level
_SPREAD = 0.25  # of the extent: no column or level is wider
_SHAFT = 3  # lines between two levels with an arrow between them

Cell = tuple[int, int]  # column from the left, level from above


class _Arrow(NamedTuple):
    """What is drawn between two neighbouring cells, `first` above or left of the other."""

    forward: bool
    back: bool
    value: float
    critical: bool

    @property
    def level(self) -> str:
        """Of what it is drawn where it goes along a level."""
        return "-" if self.critical else "."

    @property
    def upright(self) -> str:
        """Of what it is drawn where it goes up and down."""
        return "|" if self.critical else ":"


def drawing(
    plan: PlannedPattern, solution: ModelSolution, transfers: Iterable[Transfer[Row]] = ()
) -> list[str]:
    """Return the points in their places, each with its redundancy numbers, at most 80 wide.

    Points that nearly share x stand in one column, those that nearly share y on one level.
    Transfers between neighbours in a column or a row are drawn as arrows, critical ones in full
    and serious ones dotted, the largest of each pair of places with its value where there is
    room. Points at too many different x for a
    drawing are listed instead.
    """
    r = {row.key: row.r for row in solution.table}
    column_of = _ranks([x for _, x, _ in plan.points])
    level_of = _ranks([-y for _, _, y in plan.points])
    columns, levels = max(column_of) + 1, max(level_of) + 1
    width = min(_WIDEST, (_LINE - 1) // columns)
    if width < _NARROWEST:
        return _listed(plan, r)
    labels = [label for label, _, _ in plan.points]
    place = dict(zip(labels, zip(column_of, level_of, strict=True), strict=True))
    arrows = _arrows(place, transfers)
    upright = {ends: arrow for ends, arrow in arrows.items() if ends[0][0] == ends[1][0]}
    lines: list[str] = []
    for level in range(levels):
        cells = [
            _cell([p for p, at in place.items() if at == (column, level)], r, width)
            for column in range(columns)
        ]
        height = max(map(len, cells))
        for ((column, top), (_, bottom)), arrow in upright.items():
            if top < level < bottom:
                cells[column] = [arrow.upright] * height
        for k in range(height):
            line = _row([cell[k] if k < len(cell) else "" for cell in cells], width)
            lines.append(_level(line, level, arrows, width) if k == 0 else line)
        if level + 1 < levels:
            lines += _vertical(level, upright, columns, width)
    return lines


def _ranks(values: list[float]) -> list[int]:
    """Return which of the columns or levels each value lies in; a wide gap begins a new one."""
    ordered = sorted({round(value, 3) for value in values})
    extent = ordered[-1] - ordered[0]
    groups = [[ordered[0]]]
    for before, value in pairwise(ordered):
        if value - before > _GAP * extent:
            groups.append([])
        groups[-1].append(value)
    if any(group[-1] - group[0] > _SPREAD * extent for group in groups):
        # evenly spread: there are no columns to be seen
        groups = [[value] for value in ordered]
    rank = {value: k for k, group in enumerate(groups) for value in group}
    return [rank[round(value, 3)] for value in values]


_AXES: tuple[Axis, Axis] = ("y", "x")


def _cell(labels: list[str], r: Mapping[Row, float], width: int) -> list[str]:
    lines = []
    for label in labels:
        lines.append(f"o {plain(label)}"[: width - 1])
        lines += [f"  {a} {r[label, a]:.3f}" for a in _AXES if (label, a) in r]
    return lines or [""]


def _row(cells: list[str], width: int) -> str:
    return "".join(cell.ljust(width) for cell in cells).rstrip()


def _arrows(
    place: dict[str, Cell], transfers: Iterable[Transfer[Row]]
) -> dict[tuple[Cell, Cell], _Arrow]:
    neighbours = _neighbours(set(place.values()))
    out: dict[tuple[Cell, Cell], _Arrow] = {}
    for transfer in transfers:
        source, target = place[transfer.source[0]], place[transfer.target[0]]
        forward = source < target
        key = (source, target) if forward else (target, source)
        if key not in neighbours:
            continue
        had = out.get(key)
        if had is None:
            out[key] = _Arrow(forward, not forward, transfer.value, transfer.critical)
        elif had.critical == transfer.critical:
            value = max(had.value, transfer.value, key=abs)
            tips = had.forward or forward, had.back or not forward
            out[key] = _Arrow(*tips, value, had.critical)
        elif transfer.critical:
            out[key] = _Arrow(forward, not forward, transfer.value, critical=True)
    return out


def _neighbours(occupied: set[Cell]) -> set[tuple[Cell, Cell]]:
    """Return the pairs of cells that follow each other in a column or a row."""
    by_column = sorted(occupied)
    by_level = sorted(occupied, key=lambda cell: (cell[1], cell[0]))
    return {(a, b) for a, b in pairwise(by_column) if a[0] == b[0]} | {
        (a, b) for a, b in pairwise(by_level) if a[1] == b[1]
    }


def _level(line: str, level: int, arrows: dict[tuple[Cell, Cell], _Arrow], width: int) -> str:
    """Return the first line of a level with the arrows between its cells."""
    for (left, at), (right, other) in sorted(arrows):
        if not at == other == level:
            continue
        start, end = left * width, right * width
        line = line.ljust(end)
        head = line[start : start + width].rstrip()
        drawn = _horizontal(head, arrows[(left, at), (right, at)], width, end - start)
        # an upright shaft that is crossed stays to be seen
        for column in range(left + 1, right):
            k = (column - left) * width
            if line[start + k] == "|" and drawn[k : k + 1] == "-":
                drawn = f"{drawn[:k]}+{drawn[k + 1 :]}"
        line = line[:start] + drawn.ljust(end - start) + line[end:]
    return line.rstrip()


def _horizontal(head: str, arrow: _Arrow, width: int, reach: int) -> str:
    """Return a cell's head and the arrow that begins in it; the value stands in the first cell."""
    room = width - len(head) - 2
    if room < 4:
        return head
    line = arrow.level
    tips = ("<" if arrow.back else line, ">" if arrow.forward else line)
    value = f" {arrow.value:+.3f} "
    shaft = value if len(value) + 4 <= room else ""
    drawn = shaft.center(room - 2, line).ljust(room - 2 + reach - width, line)
    return f"{head} {tips[0]}{drawn}{tips[1]} "


def _vertical(
    level: int, upright: dict[tuple[Cell, Cell], _Arrow], columns: int, width: int
) -> list[str]:
    """Return what stands between a level and the next one."""
    through = {ends: arrow for ends, arrow in upright.items() if ends[0][1] <= level < ends[1][1]}
    if not through:
        return [""]
    lines = []
    for k in range(_SHAFT):
        cells = [""] * columns
        for ((column, top), (_, bottom)), arrow in through.items():
            mark = arrow.upright
            if (level, k) == (top, 0) and arrow.back:
                mark = "^"
            elif (level + 1, k) == (bottom, _SHAFT - 1) and arrow.forward:
                mark = "v"
            cells[column] = f"{mark} {arrow.value:+.3f}" if (level, k) == (top, 1) else mark
        lines.append(_row(cells, width))
    return lines


def _listed(plan: PlannedPattern, r: Mapping[Row, float]) -> list[str]:
    lines = ["POINT             x mm     y mm    r of y    r of x"]
    for label, x, y in plan.points:
        tie = cell(r[label, "x"], 3, 10) if (label, "x") in r else ""
        lines.append(
            f"{plain(label)[:12]:<12}{cell(x, 3, 10)}{cell(y, 3, 9)}"
            f"{cell(r[label, 'y'], 3, 10)}{tie}"
        )
    return lines
