"""Inner orientations as a document: the table, how the plate lies, what to do."""

from __future__ import annotations

from collections.abc import Sequence
from math import degrees
from typing import NamedTuple

from anaplot.adjustment.tested import Observation
from anaplot.photogrammetry.camera import CameraCalibration, RadialTable
from anaplot.photogrammetry.inner import InnerOrientation
from anaplot.photogrammetry.inneradvice import inner_advice
from anaplot.photogrammetry.innerresults import Fiducial
from anaplot.photogrammetry.platetransformation import TITLES
from anaplot.photogrammetry.plateunits import MILLIMETRE, PlateUnit
from anaplot.report.document import (
    BLANK,
    Answer,
    Block,
    Document,
    Line,
    Table,
    for_programs,
    name,
    named,
    number,
    say,
    stacked,
    table,
)
from anaplot.report.testedlines import sigma0_line, test_line

__all__ = [
    "InnerGroup",
    "camera_remarks",
    "fiducial_table",
    "inner_documents",
    "photo_document",
    "side_remarks",
]

_FIDUCIALS = (
    name("fiducial", "FIDUCIAL", 8),
    name("axis", head="  "),
    number("redn", "RED-N", 3, 8),
    number("residual_um", "RESID", 1, 8, unit="um"),
    number("expd_um", "EXPD", 1, 8, unit="um"),
    number("sigf", "SIGF", 2, 8),
    *for_programs("flagged"),
    number("mdb_um", "MDB", 1, 8, unit="um"),
    *for_programs("probability"),
    name("", "verdict", head="", look=bool),
)
_DISTANCES = for_programs("first", "second", "mm", "difference_um")
_PHOTO = for_programs("photo")
_TWO_SCALES = ("scales", "affine", "bilinear", "projective")
_SHEARED = ("affine", "bilinear", "projective")


class InnerGroup(NamedTuple):
    """Photographs of one camera that are measured in one unit.

    Attributes
    ----------
    camera
        The camera.
    photos
        Name and inner orientation of each photograph, or why there is none.
    unit
        Of plate coordinates.
    """

    camera: CameraCalibration
    photos: Sequence[tuple[str, InnerOrientation | str]]
    unit: PlateUnit = MILLIMETRE


def inner_documents(groups: Sequence[InnerGroup]) -> Document:
    """Return one document of photographs of some cameras; no name comes twice."""
    parts = {
        one: photo_document(one, found, group.unit)
        for group in groups
        for one, found in group.photos
        if not isinstance(found, str)
    }
    answers = [
        {"photo": one, "error": found} if isinstance(found, str) else parts[one].answer
        for group in groups
        for one, found in group.photos
    ]
    cameras = {group.camera.id: group.camera for group in groups}
    page = [block for part in parts.values() for block in (*part.page, BLANK)]
    tables = [
        stacked(key, _PHOTO, columns, (((one,), part.tables[k]) for one, part in parts.items()))
        for k, (key, columns) in enumerate((("fiducials", _FIDUCIALS), ("distances", _DISTANCES)))
    ]
    answer = {"camera": next(iter(cameras)) if len(cameras) == 1 else None, "photos": answers}
    page += side_remarks(groups)
    page += [line for camera in cameras.values() for line in camera_remarks(camera)]
    return Document(answer, tuple(page), tuple(tables))


def photo_document(photo: str, inner: InnerOrientation, unit: PlateUnit = MILLIMETRE) -> Document:
    """Return the document of one photograph: residuals in um in the image, plate in its unit.

    Programs read angles in radians, people in degrees. In "plate_to_image" (xi, eta) = frame
    (1, x, y); image x and y = numerator (1, xi, eta, xi eta) over 1 + denominator (xi, eta).
    """
    place, made = inner.placement, inner.transformation
    shrunk_x, shrunk_y = _shrinkage(inner, unit) or (None, None)
    fiducials = fiducial_table(inner)
    distances = table("distances", _DISTANCES, inner.distances)
    answer: Answer = {
        "photo": photo,
        "camera": inner.camera,
        "transformation": inner.kind,
        "sigma0_um": inner.sigma0_um,
        "apriori_um": inner.apriori_um,
        "redundancy": inner.redundancy,
        "iterations": inner.iterations,
        "test": {
            "kind": inner.test.kind,
            "alpha": inner.test.alpha,
            "critical": inner.test.critical,
            "power": inner.tested.power,
            "sigma0_limit_um": inner.overall,
        },
        "refused": inner.refused,
        "locatable": inner.locatable,
        "table": fiducials,
        "odds": {"none": inner.tested.odds.none},
        "partners": [partner._asdict() for partner in inner.partners],
        "distances": distances,
        "placement": {
            "x": place.x,
            "y": place.y,
            "rotation": place.rotation,
            "shear": place.shear,
            "scale_x": place.scale_x,
            "scale_y": place.scale_y,
            "mirrored": place.mirrored,
            "shrinkage_x_ppm": shrunk_x,
            "shrinkage_y_ppm": shrunk_y,
            "unit": unit.name,
        },
        "plate_to_image": {
            "frame": made.frame,
            "numerator": made.numerator,
            "denominator": made.denominator,
        },
        "unmeasured": list(inner.unmeasured),
        "advice": list(inner_advice(inner, unit)),
    }
    page: list[Block] = [*_summary(photo, inner, unit), BLANK, fiducials, BLANK]
    if inner.distances:
        page += [
            say("  DISTANCES [mm], transformed minus calibrated [um]"),
            *(say("  {} - {}  {:.3f}{:8.1c}", *row) for row in inner.distances),
            BLANK,
        ]
    page += [say("  {}", sentence) for sentence in answer["advice"]]
    return Document(answer, tuple(page), (fiducials, distances))


def fiducial_table(inner: InnerOrientation) -> Table:
    """Return the table of a photograph's fiducials.

    RED-N redundancy number, RESID residual (adjusted minus measured), EXPD its expected standard
    deviation, SIGF their ratio, MDB smallest detectable error; all but RED-N and SIGF in um.
    """
    suspect = inner.flagged[0].key if inner.flagged and inner.locatable else None
    rows = (
        (row.point, row.axis, row.r, row.residual, row.expected, row.size, row.flagged, row.mdb,
         row.probability, _verdict(row, suspect))
        for row in inner.rows
    )  # fmt: skip
    return table("fiducials", _FIDUCIALS, rows, units=">")


def _verdict(row: Observation[Fiducial], suspect: Fiducial | None) -> str:
    if row.flagged:
        return "<< REMEASURE" if row.key == suspect else "< flagged"
    return "not testable" if row.mdb is None else ""


def _summary(photo: str, inner: InnerOrientation, unit: PlateUnit) -> list[Line]:
    place, tested = inner.placement, test_line(inner)
    if inner.overall is not None:
        tested += say(", sigma0 at most {:.2f} um", inner.overall)
    if inner.tested.power is not None:
        tested += say(", power {:.2f} at MDB", inner.tested.power)
    turned = say("  rotation  {:.5f} deg", degrees(place.rotation))
    if inner.kind in _SHEARED:
        turned += say(", shear {:.5f} deg", degrees(place.shear))
    if place.mirrored:
        # who counts pixels counts y downwards; a film is laid in the wrong way round
        turned += (
            ", seen from behind"
            if unit == MILLIMETRE
            else (", mirrored: y runs down, or seen from behind")
        )
    shrunk = _shrinkage(inner, unit)
    if shrunk is None:
        scaled = say("  scale     x {0.scale_x:.6f}  y {0.scale_y:.6f} {1}/mm: ", place, unit.name)
        sides = 1e3 / place.scale_x, 1e3 / place.scale_y
        scaled += say("one {} is {:.4f} x {:.4f} um", unit.name, *sides)
    else:
        scaled = say(
            "  scale     x {:.6f}  y {:.6f}, film shrinkage ",
            *(scale / (unit.per_mm or 1.0) for scale in (place.scale_x, place.scale_y)),
        )
        if inner.kind in _TWO_SCALES:
            scaled += say("x {:.0f}  y {:.0f} ppm", *shrunk)
        else:
            scaled += say("{:.0f} ppm", shrunk[0])
    return [
        say("PHOTO {}  camera {}", photo, inner.camera).of("heading"),
        say("  found     {}", TITLES[inner.kind]),
        sigma0_line(inner),
        tested,
        say("  origin    x {0.x:.4f}  y {0.y:.4f} {1} on the plate", place, unit.name),
        turned,
        scaled,
    ]


def _shrinkage(inner: InnerOrientation, unit: PlateUnit) -> tuple[float, float] | None:
    """Return film shrinkage along x and y [ppm]; None where a unit's length is not known."""
    if unit.per_mm is None:
        return None
    place = inner.placement
    per_mm = unit.per_mm
    return (1.0 - place.scale_x / per_mm) * 1e6, (1.0 - place.scale_y / per_mm) * 1e6


def side_remarks(groups: Sequence[InnerGroup]) -> list[Line]:
    """Return a sentence on photographs of one file that are seen from different sides."""
    said = []
    for group in groups:
        sides: dict[bool, list[str]] = {True: [], False: []}
        for photo, inner in group.photos:
            if not isinstance(inner, str):
                sides[inner.placement.mirrored].append(photo)
        if sides[True] and sides[False]:
            mirrored, upright = (named(sides[side], 6) for side in (True, False))
            said.append(
                say(
                    "mirrored: {}; not mirrored: {}: were fiducials measured in another order?",
                    *(mirrored, upright),
                ).of("remark")
            )
    return said


def camera_remarks(camera: CameraCalibration) -> list[Line]:
    """Return sentences on what a camera's calibration leaves open."""
    if not isinstance(camera.radial, RadialTable):
        return []
    said = []
    spread = camera.radial.spread()
    if spread is not None:
        said.append(
            say(
                "camera {}: the distortion is the mean of its half-diagonals, which differ from "
                "it by up to {:.1f} um (at radius {:g} mm)",
                *(camera.id, *spread),
            ).of("remark")
        )
    end = camera.radial.radius[-1]
    corner = None if camera.format is None else 0.5 * sum(side**2 for side in camera.format) ** 0.5
    if corner is None or end < corner:
        said.append(
            say(
                "camera {}: the distortion is calibrated up to radius {:g} mm; beyond it, its "
                "last value is held",
                *(camera.id, end),
            ).of("remark")
        )
    return said
