"""Numbering accidents in a document: one id in two places, two ids in one place."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING

from anaplot.report.document import Answer, Document, Line, say
from anaplot.report.photocures import PhotoCures, cure_words
from anaplot.session.filedaccidents import MOST_MEASUREMENTS, BlockAccidents

if TYPE_CHECKING:
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


def photos_answer(accidents: Iterable[PhotoAccident], cures: PhotoCures | None = None) -> Answer:
    """Return what programs read of wrong photographs.

    A pair that may be exchanged has `exchanged`, what its strips give with it put right, where that
    was computed; `alternatives` are pairs of which the same may be true instead.
    """
    known = cures or {}

    def put_right(pair: tuple[str, str]) -> Answer:
        return {"exchanged": known[pair]._asdict()} if pair in known else {}

    return {
        "photo_accidents": [
            {
                "kind": one.kind,
                "photos": one.photos,
                "strips": one.strips,
                "text": one.text,
                "alternatives": [{"photos": two, **put_right(two)} for two in one.alternatives],
                **(put_right(one.pairs[0]) if one.pairs else {}),
            }
            for one in accidents
        ]
    }


def with_photo_accidents(
    document: Document, accidents: Iterable[PhotoAccident], cures: PhotoCures | None = None
) -> Document:
    """Return a document that ends with what is wrong with photographs, where anything is.

    Parameters
    ----------
    document
        Of a block.
    accidents
        Of its photographs.
    cures
        What putting them right would give.
    """
    accidents = tuple(accidents)
    lines = [say("{}", cure_words(one, cures or {})).of("look") for one in accidents]
    answer = document.answer | photos_answer(accidents, cures)
    return replace(document, answer=answer, page=(*document.page, *lines))


def with_accidents(
    document: Document, accidents: BlockAccidents, cures: PhotoCures | None = None
) -> Document:
    """Return a document that ends with the accidents of its block, where there are any.

    `cures`: what putting wrong photographs right would give.
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
