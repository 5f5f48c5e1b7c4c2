"""What is said of a report that was written."""

from __future__ import annotations

from anaplot.report.columns import counted
from anaplot.report.document import Answer, Line, say
from anaplot.report.html.write import Written

__all__ = ["written_answer", "written_lines"]


def written_answer(written: Written) -> Answer:
    """Return what programs read of a report that was written."""
    return {
        "page": str(written.page),
        "bytes": written.size,
        "cut": [str(path) for path in written.cut],
        "figures": [str(path) for path in written.figures],
    }


def written_lines(written: Written) -> tuple[Line, ...]:
    """Return what is said of a report that was written."""
    small = written.size < 1e6
    size = say("{:.0f} kB", written.size / 1e3) if small else say("{:.1f} MB", written.size / 1e6)
    lines = [say("{}: written, {}", str(written.page), size)]
    if written.cut:
        lines.append(
            say(
                "  {} cut to what needs a look; whole in {}",
                counted(len(written.cut), "table is", "tables are"),
                str(written.cut[0].parent),
            )
        )
    if written.figures:
        lines.append(
            say(
                "  {} in {}",
                counted(len(written.figures), "figure"),
                str(written.figures[0].parent),
            )
        )
    return tuple(lines)
