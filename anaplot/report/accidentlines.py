"""Numbering accidents in a document: one id in two places, two ids in one place."""

from __future__ import annotations

from dataclasses import replace

from anaplot.report.document import Answer, Document, Line, say
from anaplot.session.blockaccidents import MOST_MEASUREMENTS, BlockAccidents

__all__ = ["accidents_answer", "unchecked_line", "with_accidents"]


def accidents_answer(accidents: BlockAccidents) -> list[Answer]:
    """Return what programs read: where a point is, what is wrong, and whether it is certain.

    `against` is what has it elsewhere: a strip, "control", or null for its own strip.
    """
    return [
        {
            "strip": one.strip,
            "model": one.model,
            "point": one.accident.point,
            "text": one.accident.text,
            "certain": one.accident.certain,
            "against": one.accident.against or None,
        }
        for one in accidents.found
    ]


def with_accidents(document: Document, accidents: BlockAccidents) -> Document:
    """Return a document that ends with the accidents of its block, where there are any."""
    lines = [
        say("model {}: {}", one.model, one.accident.text).of("look") for one in accidents.found
    ]
    answer = document.answer | {"accidents": accidents_answer(accidents)}
    page = (*document.page, *lines, *unchecked_line(accidents))
    return replace(document, answer=answer, page=page)


def unchecked_line(accidents: BlockAccidents) -> list[Line]:
    """Return the line that says which strips were not looked at, where there are any."""
    if not accidents.unchecked:
        return []
    words = "numbering is not compared in strips of more than {} measurements: {}"
    return [say(words, MOST_MEASUREMENTS, ", ".join(accidents.unchecked)).of("remark")]
