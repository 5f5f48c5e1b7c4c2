"""Inner orientations with their residuals: those of journals, and those of fiducial files."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from anaplot.exchange.fiducialfile import read_fiducials
from anaplot.report.document import Answer, Document, Line, name, number, say, table, whole
from anaplot.report.html.parts import Captioned, HtmlBlock, Section
from anaplot.report.html.times import time_column, utc
from anaplot.report.innercommand import orient_photos
from anaplot.report.innerdocument import photo_document
from anaplot.station.sessionlog import read_inner

__all__ = ["OrientedPlate", "inner_section", "plates_in"]

_MOST = 60  # photos that a page has one by one, flagged ones first
_OPEN = 2  # that are not folded

_OVERVIEW = (
    name("photo", "PHOTO", 5),
    name("model", "IN MODEL", 8, none=""),
    time_column("ACCEPTED"),
    name("who", "BY", 2, none=""),
    name("transformation", "TRANSFORMATION", 14),
    number("sigma0_um", "sigma0 [um]", 2, 12, unit="um"),
    whole("redundancy", "redundancy", 11),
    number("largest", "largest SIGF", 2, 13),
    name("at", "AT", 2),
    whole("flagged", "flagged", 8),
    name("", "look", head="", look=bool),
)


class OrientedPlate(NamedTuple):
    """A photo on a plate, and its inner orientation.

    Attributes
    ----------
    photo
        Its name.
    found
        The document of its inner orientation, as `inner` has it; or why there is none.
    model, time, who
        In which model it lay, when it was accepted and by whom; None of a file.
    file
        Where its fiducials stand; None of a journal.
    """

    photo: str
    found: Document | str
    model: str | None = None
    time: str | None = None
    who: str | None = None
    file: str | None = None

    @property
    def answer(self) -> Answer:
        """What programs read: that of `inner`, and where it is from."""
        told = (
            {"photo": self.photo, "error": self.found}
            if isinstance(self.found, str)
            else self.found.answer
        )
        return {**told, "model": self.model, "time": self.time, "who": self.who, "file": self.file}


def plates_in(session: Path | None, files: Iterable[Path] = ()) -> tuple[OrientedPlate, ...]:
    """Return the inner orientations of a session, and those of fiducial files.

    Parameters
    ----------
    session
        A block folder with a journal; None: there is none.
    files
        As `inner` takes them.

    Raises
    ------
    InputError
        A journal or a file cannot be read, or is wrong.
    """
    plates = []
    for accepted, inner in () if session is None else read_inner(session):
        photo = accepted.inner.photo
        document = photo_document(photo, inner)
        plates.append(
            OrientedPlate(photo, document, accepted.model, accepted.time, accepted.who or None)
        )
    for path in files:
        file = read_fiducials(path)
        for photo, found in orient_photos(file):
            document_or_why = (
                found if isinstance(found, str) else photo_document(photo, found, file.unit)
            )
            plates.append(OrientedPlate(photo, document_or_why, file=str(path)))
    return tuple(plates)


def inner_section(plates: Sequence[OrientedPlate]) -> Section | None:
    """Return the section of inner orientations; None where there are none."""
    if not plates:
        return None
    oriented = [(one, one.found) for one in plates if isinstance(one.found, Document)]
    blocks: list[HtmlBlock] = [
        say("Photo {} has no inner orientation: {}", one.photo, one.found).of("look")
        for one in plates
        if isinstance(one.found, str)
    ]
    rows = [_summary(one, found.answer) for one, found in oriented]
    if rows:
        overview = table("inner", _OVERVIEW, rows)
        blocks.append(Captioned(overview, say("Inner orientations of the photos")))
    first = sorted(range(len(oriented)), key=lambda k: (not rows[k][-1], k))[:_MOST]
    if len(first) < len(oriented):
        shown = "{} of {} are shown one by one, those with something to look at first"
        blocks.append(say(shown, len(first), len(oriented)).of("remark"))
    for k in sorted(first):
        plate, found = oriented[k]
        blocks.append(_plate(k + 1, plate, found, folded=len(oriented) > _OPEN))
    return Section("inner", "Inner orientations", tuple(blocks), on_paper="columns")


def _summary(plate: OrientedPlate, answer: Answer) -> tuple[Any, ...]:
    rows = answer["table"].records()
    tested = [row for row in rows if row["sigf"] is not None]
    largest = max(tested, key=lambda row: row["sigf"], default=None)
    flagged = sum(bool(row["flagged"]) for row in rows)
    return (
        plate.photo,
        plate.model,
        plate.time,
        plate.who,
        answer["transformation"],
        answer["sigma0_um"],
        answer["redundancy"],
        None if largest is None else largest["sigf"],
        None if largest is None else f"{largest['fiducial']} {largest['axis']}",
        flagged,
        "look" if flagged or answer["refused"] else "",
    )


def _plate(number_: int, plate: OrientedPlate, found: Document, *, folded: bool) -> Section:
    title = say("Photo {}", plate.photo)
    if plate.model is not None:
        title += say(", in model {}", plate.model)
    if plate.time is not None:
        title += say(", {} UTC", utc(plate.time))
    if plate.file is not None:
        title += say(", from {}", plate.file)
    caption = say("Fiducials of photo {}", plate.photo)
    blocks: list[HtmlBlock] = []
    for block in found.page[1:]:
        if block is found.tables[0]:
            blocks.append(Captioned(found.tables[0], caption))
        elif isinstance(block, Line):
            blocks.append(block)
    return Section(f"inner-{number_}", title, tuple(blocks), folded)
