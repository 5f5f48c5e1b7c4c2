"""What a salvage of a session brought over and what not, for people and for programs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from anaplot.station.salvage import Salvaged
from anaplot.textfiles.wording import place

__all__ = ["salvage_json", "salvage_text"]


def salvage_text(salvaged: Salvaged, folder: Path) -> str:
    """Return the lines that a person reads."""
    state = salvaged.state
    have = [_count(len(state.models), "accepted model")]
    if state.current is not None:
        measured = _count(len(state.current.measured), "point")
        have.append(f"{measured} in model {state.current.name}, which is in work")
    lines = [
        f"{_count(salvaged.records, 'record')} brought over to {place(folder)}: {', '.join(have)}"
    ]
    lines += [f"missing: {gap}" for gap in salvaged.gaps]
    lines += [f"left out: {sentence}" for sentence in salvaged.left_out]
    lines += [f"assumed: {sentence}" for sentence in salvaged.assumed]
    if len(lines) == 1:
        lines.append("nothing is missing")
    return "\n".join(lines)


def salvage_json(salvaged: Salvaged) -> dict[str, Any]:
    """Return the same for programs."""
    current = salvaged.state.current
    return {
        "records": salvaged.records,
        "models": [model.name for model in salvaged.state.models],
        "in_work": None if current is None else current.name,
        "missing": [
            {
                "file": gap.file,
                "first_line": gap.first_line,
                "last_line": gap.last_line,
                "first_seq": gap.first_seq,
                "last_seq": gap.last_seq,
                "why": gap.why,
            }
            for gap in salvaged.gaps
        ],
        "left_out": list(salvaged.left_out),
        "assumed": list(salvaged.assumed),
    }


def _count(number: int, what: str) -> str:
    return f"{number} {what}" if number == 1 else f"{number} {what}s"
