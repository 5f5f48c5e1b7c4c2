"""What is said of errors that were put in for a trial."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

from anaplot.photogrammetry.block import Block
from anaplot.photogrammetry.planting import PlantedError, with_planted_errors
from anaplot.report.document import BLANK, Document, say

__all__ = ["plant", "planted_errors", "with_planting"]


def planted_errors(given: Sequence[str]) -> tuple[PlantedError, ...]:
    """Return errors from "WHERE:AXIS:UM", which the option's check has let pass."""
    parts = (one.rsplit(":", 2) for one in given)
    return tuple(PlantedError(where, "x" if axis == "x" else "y", float(um))
                 for where, axis, um in parts)  # fmt: skip


def plant(block: Block, given: Sequence[str] | None) -> tuple[Block, tuple[PlantedError, ...]]:
    """Return a block with errors put in, and these.

    Raises
    ------
    InputError
        There is no such image point.
    """
    errors = planted_errors(given or ())
    return (with_planted_errors(block, errors) if errors else block), errors


def with_planting(document: Document, planted: Iterable[PlantedError]) -> Document:
    """Return a document that says what was put in."""
    errors = list(planted)
    if not errors:
        return document
    answer = document.answer | {"planted": [one._asdict() for one in errors]}
    lines = [say("PLANTED {0.where} {0.axis} {0.um:+g} um", one) for one in errors]
    note = say("for a trial: the files stay as they are")
    return replace(document, answer=answer, page=(*lines, note, BLANK, *document.page))
