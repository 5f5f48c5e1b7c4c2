"""Numbering accidents in a document: one id in two places, two ids in one place."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

from anaplot.report.document import Answer, Document, Line, say
from anaplot.session.blockaccidents import MOST_MEASUREMENTS, BlockAccidents
from anaplot.session.photoaccidents import PhotoAccident

__all__ = [
    "accidents_answer",
    "photos_answer",
    "unchecked_line",
    "with_accidents",
    "with_photo_accidents",
]


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


def photos_answer(accidents: Iterable[PhotoAccident]) -> Answer:
    """Return what programs read of wrong photographs, under a key that is there where any is."""
    rows = [
        {"kind": one.kind, "photos": one.photos, "strips": one.strips, "text": one.text}
        for one in accidents
    ]
    return {"photo_accidents": rows} if rows else {}


def with_photo_accidents(
    document: Document, accidents: Iterable[PhotoAccident], cures: Mapping[str, str] | None = None
) -> Document:
    """Return a document that ends with what is wrong with photographs, where anything is.

    Parameters
    ----------
    document
        Of a block.
    accidents
        Of its photographs.
    cures
        What putting one right would give, by its text.
    """
    accidents = tuple(accidents)
    lines = []
    for one in accidents:
        cure = (cures or {}).get(one.text, "")
        lines.append(say("{}{}", one.text, f": {cure}" if cure else "").of("look"))
    answer = document.answer | photos_answer(accidents)
    return replace(document, answer=answer, page=(*document.page, *lines))


def with_accidents(
    document: Document, accidents: BlockAccidents, cures: Mapping[str, str] | None = None
) -> Document:
    """Return a document that ends with the accidents of its block, where there are any.

    `cures`: what putting wrong photographs right would give, by the accident's text.
    """
    lines = [
        say("model {}: {}", one.model, one.accident.text).of("look") for one in accidents.found
    ]
    answer = document.answer | {"accidents": accidents_answer(accidents)}
    page = (*document.page, *lines, *unchecked_line(accidents))
    document = replace(document, answer=answer, page=page)
    return with_photo_accidents(document, accidents.photos, cures)


def unchecked_line(accidents: BlockAccidents) -> list[Line]:
    """Return the line that says which strips were not looked at, where there are any."""
    if not accidents.unchecked:
        return []
    words = "numbering is not compared in strips of more than {} measurements: {}"
    return [say(words, MOST_MEASUREMENTS, ", ".join(accidents.unchecked)).of("remark")]
