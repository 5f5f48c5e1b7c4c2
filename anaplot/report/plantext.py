"""A planned point pattern drawn with characters, as in 1983's Figures 2, 4 and 7."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from anaplot.orientation.results import ModelSolution, Transfer
from anaplot.planning.patternplan import Advice, PlannedPattern
from anaplot.report.printable import printable

__all__ = ["advice_lines", "drawing", "transfer_lines"]

_LINE = 80
_WIDEST, _NARROWEST = 20, 11
_SHAFT = 3  # lines between two levels with an arrow between them

Cell = tuple[int, int]  # column from the left, level from above


class _Arrow(NamedTuple):
    """What is drawn between two neighbouring cells, `first` above or left of the other."""

    forward: bool
    back: bool
    value: float


def drawing(
    plan: PlannedPattern, solution: ModelSolution, transfers: Iterable[Transfer] = ()
) -> list[str]:
    """Return the points in their places, each with its redundancy numbers, at most 80 wide.

    Transfers between neighbours in a column or a row are drawn as arrows, the largest of each
    pair of places with its value where there is room. Points at too many different x for a
    drawing are listed instead.
    """
    redn = {row.key: row.redn for row in solution.table}
    columns = sorted({round(x, 3) for _, x, _ in plan.points})
    levels = sorted({round(y, 3) for _, _, y in plan.points}, reverse=True)
    width = min(_WIDEST, (_LINE - 1) // len(columns))
    if width < _NARROWEST:
        return _listed(plan, redn)
    place = {
        label: (columns.index(round(x, 3)), levels.index(round(y, 3)))
        for label, x, y in plan.points
    }
    arrows = _arrows(place, transfers)
    lines: list[str] = []
    for level in range(len(levels)):
        cells = [
            _cell([p for p, at in place.items() if at == (column, level)], redn, width)
            for column in range(len(columns))
        ]
        for column, cell in enumerate(cells):
            arrow = arrows.get(((column, level), (column + 1, level)))
            if arrow is not None:
                cell[0] = _horizontal(cell[0], arrow, width)
        for k in range(max(map(len, cells))):
            lines.append(_row([cell[k] if k < len(cell) else "" for cell in cells], width))
        if level + 1 < len(levels):
            below = {
                column: arrows[(column, level), (column, level + 1)]
                for column in range(len(columns))
                if ((column, level), (column, level + 1)) in arrows
            }
            lines += _vertical(below, len(columns), width) if below else [""]
    return lines


def _cell(labels: list[str], redn: dict[tuple[str, str], float], width: int) -> list[str]:
    lines = []
    for label in labels:
        lines.append(f"o {printable(label)}"[: width - 1])
        lines += [f"  {a} {redn[label, a]:.3f}" for a in ("y", "x") if (label, a) in redn]
    return lines or [""]


def _row(cells: list[str], width: int) -> str:
    return "".join(cell.ljust(width) for cell in cells).rstrip()


def _arrows(
    place: dict[str, Cell], transfers: Iterable[Transfer]
) -> dict[tuple[Cell, Cell], _Arrow]:
    out: dict[tuple[Cell, Cell], _Arrow] = {}
    for transfer in transfers:
        source, target = place[transfer.source[0]], place[transfer.target[0]]
        if abs(source[0] - target[0]) + abs(source[1] - target[1]) != 1:
            continue
        forward = source < target
        key = (source, target) if forward else (target, source)
        had = out.get(key, _Arrow(False, False, 0.0))
        value = max(had.value, transfer.value, key=abs)
        out[key] = _Arrow(had.forward or forward, had.back or not forward, value)
    return out


def _horizontal(head: str, arrow: _Arrow, width: int) -> str:
    room = width - len(head) - 2
    if room < 4:
        return head
    tips = ("<" if arrow.back else "-", ">" if arrow.forward else "-")
    value = f" {arrow.value:+.3f} "
    shaft = value if len(value) + 4 <= room else ""
    return f"{head} {tips[0]}{shaft.center(room - 2, '-')}{tips[1]} "


def _vertical(below: dict[int, _Arrow], columns: int, width: int) -> list[str]:
    lines = []
    for k in range(_SHAFT):
        cells = [""] * columns
        for column, arrow in below.items():
            mark = "|"
            if k == 0 and arrow.back:
                mark = "^"
            elif k == _SHAFT - 1 and arrow.forward:
                mark = "v"
            cells[column] = f"{mark} {arrow.value:+.3f}" if k == 1 else mark
        lines.append(_row(cells, width))
    return lines


def _listed(plan: PlannedPattern, redn: dict[tuple[str, str], float]) -> list[str]:
    lines = ["POINT             x mm     y mm    r of y    r of x"]
    for label, x, y in plan.points:
        tie = f"{redn[label, 'x']:10.3f}" if (label, "x") in redn else ""
        lines.append(
            f"{printable(label)[:12]:<12}{x:>10.3f}{y:>9.3f}{redn[label, 'y']:>10.3f}{tie}"
        )
    return lines


def transfer_lines(transfers: tuple[Transfer, ...]) -> list[str]:
    """Return one arrow per critical transfer, with its value."""
    if not transfers:
        return ["no critical transfers"]
    lines = ["critical transfers (an error in the first shows at least as large in the second)"]
    for t in transfers:
        first, second = (f"{printable(point)} ({axis})" for point, axis in (t.source, t.target))
        lines.append(f"  {first} --> {second}  {t.value:+.3f}")
    return lines


def advice_lines(best: Advice) -> list[str]:
    """Return what one further point would do for the weakest redundancy number."""
    if best.after <= best.before + 5e-4:
        return [f"no further point tried raises the weakest redundancy number {best.before:.3f}"]
    what = (
        f"one more point at x {best.x:.1f}, y {best.y:.1f} mm"
        if best.doubles is None
        else f"a double of {printable(best.doubles)}"
    )
    what += " as a tie" if best.tie else ""
    effect = f"helps the weakest redundancy number most: {best.before:.3f} -> {best.after:.3f}"
    line = f"{what} {effect}"
    return [line] if len(line) <= _LINE else [what, f"  {effect}"]
