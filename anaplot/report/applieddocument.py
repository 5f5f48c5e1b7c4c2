"""What `anaplot inner --apply` says: what was put into a block, photo by photo, and how well."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from math import hypot

from anaplot.photogrammetry.inneradvice import inner_advice
from anaplot.photogrammetry.radialshift import RadialShift
from anaplot.report.columns import counted
from anaplot.report.document import (
    BLANK,
    Block,
    Document,
    Line,
    name,
    named,
    number,
    say,
    table,
    whole,
)
from anaplot.report.innerapply import CarriedPhoto, Measured
from anaplot.report.innerdocument import InnerGroup, camera_remarks, inner_documents, side_remarks

__all__ = ["applied_document"]

_PHOTOS = (
    name("photo", "PHOTO", 6),
    name("transformation", "FOUND", 6),
    whole("fiducials", "FIDUCIALS", 10),
    number("sigma0_um", "SIGMA0", 2, 8, unit="um"),
    whole("points", "POINTS", 7),
    number("inner_um", "INNER", 2, 8, unit="um"),
    whole("replaced", "REPLACED", 9),
    name("", "verdict", head="", look=bool),
)
_MOST = 6


def applied_document(
    measured: Measured,
    groups: Sequence[InnerGroup],
    photos: Sequence[CarriedPhoto],
    without: Sequence[str],
) -> Document:
    """Return the document of an `inner --apply`.

    INNER is the largest standard deviation of an image coordinate of the photo that comes from
    the measured fiducials, for their a-priori sigma.

    Parameters
    ----------
    measured
        The block before.
    groups
        The inner orientations.
    photos
        What was put in.
    without
        Photos with fiducials and no points.
    """
    inner = inner_documents(groups)
    rows = table(
        "applied",
        _PHOTOS,
        [
            (one.photo, one.inner.kind, len(one.inner.rows) // 2, one.inner.sigma0_um,
             len(one.rows), one.carried_um, len(one.replaced),
             "< flagged" if one.inner.flagged or one.inner.refused else "")
            for one in photos
        ],
        units=">",
    )  # fmt: skip
    count = sum(len(one.rows) for one in photos)
    replaced = [row for one in photos for row in one.replaced]
    off = sum(row.use != "xy" for row in replaced)
    applied = {
        "points": count,
        "replaced": len(replaced),
        "replaced_off": off,
        "without_points": list(without),
        "refinement": None if measured.block.air is None else asdict(measured.block.air),
        "photos": rows,
    }
    page: list[Block] = [rows, BLANK, *_said(measured, photos, count, len(replaced), off)]
    if without:
        page.append(say("  fiducials, but no points: {}", named(without, _MOST)))
    page += _taken_off(measured, groups)
    page += _advice(groups)
    page += side_remarks(groups)
    for camera in {group.camera.id: group.camera for group in groups}.values():
        page += camera_remarks(camera)
    return Document({**inner.answer, "applied": applied}, tuple(page), (*inner.tables, rows))


def _said(
    measured: Measured, photos: Sequence[CarriedPhoto], count: int, replaced: int, off: int
) -> list[Line]:
    said = [
        say(
            "  {} of {} in {}",
            counted(count, "image point"),
            counted(len(photos), "photo"),
            str(measured.folder / "image_points.csv"),
        )
    ]
    if replaced:
        gone = say("  {} replaced", counted(replaced, "row is", "rows are"))
        if off:
            gone += say(", {} of them had coordinates switched off: they count again", off)
        said.append(gone.of("remark"))
    if any(one.carried_um is not None for one in photos):
        said.append(
            say(
                "  INNER is common to a photo's points (shift, scale, turn and shear of the whole "
                "image) and no part of their sigma"
            )
            .of("remark")
            .folded(4)
        )
    return said


def _taken_off(measured: Measured, groups: Sequence[InnerGroup]) -> list[Line]:
    """Return what of air and earth is taken off, at the corner of each camera's format."""
    air = measured.block.air
    said = []
    for camera in {group.camera.id: group.camera for group in groups}.values():
        radius = camera.c if camera.format is None else 0.5 * hypot(*camera.format)
        for what, part in () if air is None else air.parts():
            um = 1e3 * RadialShift.of(part, camera.c).at(radius)
            said.append(
                say(
                    "  {} is taken off: {:.1f} um {}wards at {:.1f} mm from the principal point "
                    "of camera {}",
                    *(what, abs(um), "out" if um > 0.0 else "in", radius, camera.id),
                )
            )
    return said


def _advice(groups: Sequence[InnerGroup]) -> list[Line]:
    """Return each sentence on inner orientations once, with the photos that it is said of."""
    photos: dict[str, list[str]] = {}
    for group in groups:
        for photo, inner in group.photos:
            if not isinstance(inner, str):
                for sentence in inner_advice(inner, group.unit):
                    photos.setdefault(sentence, []).append(photo)
    return [
        say("  {}: {}", named(of, _MOST), sentence).folded(4) for sentence, of in photos.items()
    ]
