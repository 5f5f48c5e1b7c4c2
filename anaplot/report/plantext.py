"""A planned point pattern drawn with characters, as in 1983's Figures 2, 4 and 7."""

from __future__ import annotations

from anaplot.orientation.results import ModelSolution, Transfer
from anaplot.planning.patternplan import Advice, PlannedPattern
from anaplot.report.printable import printable

__all__ = ["advice_lines", "drawing", "transfer_lines"]

_WIDTH = 17


def drawing(plan: PlannedPattern, solution: ModelSolution) -> list[str]:
    """Return the points in their places, each with its redundancy numbers."""
    redn = {row.key: row.redn for row in solution.table}
    columns = sorted({round(x, 3) for _, x, _ in plan.points})
    levels = sorted({round(y, 3) for _, _, y in plan.points}, reverse=True)
    lines = []
    for y in levels:
        cells: list[list[str]] = []
        for x in columns:
            here = [p for p in plan.points if (round(p[1], 3), round(p[2], 3)) == (x, y)]
            cells.append([])
            for label, _, _ in here:
                cells[-1].append(f"o {printable(label)}"[: _WIDTH - 1])
                text = f"  y {redn[label, 'y']:.3f}"
                if (label, "x") in redn:
                    text += f" x {redn[label, 'x']:.3f}"
                cells[-1].append(text)
        for k in range(max(map(len, cells))):
            lines.append(
                "".join((c[k] if k < len(c) else "").ljust(_WIDTH) for c in cells).rstrip()
            )
        lines.append("")
    return lines[:-1]


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
    return [
        f"{what} helps the weakest redundancy number most: {best.before:.3f} -> {best.after:.3f}"
    ]
