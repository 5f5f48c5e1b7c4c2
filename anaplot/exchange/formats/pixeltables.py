"""Tables of DBAT and PhotoModeler: image points in pixels, control, names of images.

Pixels of these programs have 1, 1 in the middle of the upper left pixel: the principal point of a
camera of 8858 pixels is at 4429.5 = (8858 + 1) / 2. Ours have 0, 0 in its upper left corner.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from anaplot.errors import InputError
from anaplot.exchange.formats.door import ImportOptions, Note
from anaplot.exchange.formats.gathered import MAX_TABLE_BYTES, check_order
from anaplot.exchange.formats.measuredrays import MeasuredRay, image_points_of
from anaplot.exchange.formats.sourcelines import SourceLine, source_lines
from anaplot.photogrammetry.block import (
    Block,
    Camera,
    ControlPoint,
    ControlUse,
    Photo,
    Precision,
    TestSettings,
)
from anaplot.textfiles.wording import place, quoted

__all__ = [
    "CONTROL_COLUMNS",
    "IMAGE_COLUMNS",
    "NAME_COLUMNS",
    "ORIGINS",
    "PixelRow",
    "comma_rows",
    "pixel_block",
    "read_control_table",
    "read_image_names",
    "read_image_table",
    "shift_of",
]

ORIGINS = {"centre-1": 0.5, "centre-0": -0.5, "corner": 0.0}
"""By word, what is taken off a pixel so that 0, 0 is the upper left corner."""

IMAGE_COLUMNS = ("id", "im", "x", "y", "sxy")
CONTROL_COLUMNS = ("id", "label", "x", "y", "z", "sx", "sy", "sz")
NAME_COLUMNS = ("id", "path")


class PixelRow(NamedTuple):
    """An image point: its place in the file, photo, point, pixels, sigma [px] or None."""

    line: SourceLine
    photo: str
    point: str
    x: float
    y: float
    sigma_px: float | None


def comma_rows(path: Path) -> Iterator[tuple[SourceLine, list[str]]]:
    """Yield the fields of every row of a table; lines that begin with # are comments."""
    for line in source_lines(path, MAX_TABLE_BYTES):
        text = line.text.strip()
        if text and not text.startswith("#"):
            yield line, [field.strip() for field in text.split(",")]


def read_image_table(
    path: Path, columns: Sequence[str] = IMAGE_COLUMNS, sigma_px: float | None = None
) -> list[PixelRow]:
    """Read a table of image points.

    Parameters
    ----------
    path
        The file.
    columns
        What its columns are: id, im, x, y, and perhaps sxy; those at the end may be missing.
    sigma_px
        Standard deviation where the table has none [px].

    Raises
    ------
    InputError
        What is wrong, with file and line.
    """
    rows = []
    for line, fields in comma_rows(path):
        found = _named(line, fields, columns, ("id", "im", "x", "y"))
        sigma = sigma_px
        if "sxy" in found:
            sigma = line.number_of(found["sxy"], "sxy")
            if not sigma > 0.0:
                raise line.fail(f"sxy must be greater than 0, not {sigma:g}")
        x, y = line.numbers_of([found["x"], found["y"]], "x and y")
        photo, point = line.name_of(found["im"], "image"), line.name_of(found["id"], "point")
        rows.append(PixelRow(line, photo, point, x, y, sigma))
    if not rows:
        raise InputError(f"{place(path)}: no image point")
    return rows


def read_image_names(path: Path) -> dict[str, str]:
    """Return the file names of images by their numbers; whole paths where names are not unique."""
    paths: dict[str, str] = {}
    for line, fields in comma_rows(path):
        found = _named(line, fields, NAME_COLUMNS, NAME_COLUMNS)
        number, name = line.name_of(found["id"], "image"), line.name_of(found["path"], "image")
        if paths.setdefault(number, name) != name:
            raise line.fail(f"image {quoted(number)} twice")
    short = {number: name.replace("\\", "/").rsplit("/", 1)[-1] for number, name in paths.items()}
    if len(set(short.values())) == len(short) and all(short.values()):
        return short
    if len(set(paths.values())) < len(paths):
        raise InputError(f"{place(path)}: two images of one name")
    return paths


def read_control_table(
    path: Path, use: ControlUse = "control", columns: Sequence[str] = CONTROL_COLUMNS
) -> tuple[list[ControlPoint], int]:
    """Return the points of a control table, and how many have a label.

    Raises
    ------
    InputError
        What is wrong, with file and line.
    """
    points: dict[str, ControlPoint] = {}
    labels = 0
    for line, fields in comma_rows(path):
        found = _named(line, fields, columns, ("id", "x", "y", "z"))
        point = line.name_of(found["id"], "point")
        if point in points:
            raise line.fail(f"point {quoted(point)} twice")
        x, y, z = line.ground_of([found[key] for key in "xyz"], "a coordinate")
        sigmas = [
            line.number_of(found[key], key) if key in found else None for key in ("sx", "sy", "sz")
        ]
        if any(sigma is not None and sigma < 0.0 for sigma in sigmas):
            raise line.fail("a standard deviation below 0")
        labels += bool(found.get("label"))
        points[point] = ControlPoint(point, (x, y, z), (sigmas[0], sigmas[1], sigmas[2]), use)
    return list(points.values()), labels


def _named(
    line: SourceLine, fields: list[str], columns: Sequence[str], needed: Sequence[str]
) -> dict[str, str]:
    if len(fields) > len(columns):
        raise line.fail(f"{len(fields)} fields, where {', '.join(columns)} are expected")
    found = dict(zip(columns, fields, strict=False))
    missing = next((name for name in needed if not found.get(name)), None)
    if missing is not None:
        raise line.fail(f"no {missing}: {', '.join(columns)} are expected")
    return {name: field for name, field in found.items() if field}


def shift_of(options: ImportOptions, notes: list[Note]) -> float:
    """Return what is taken off pixels; raises InputError for an unknown --order."""
    order = options.order
    if order is None:
        text = "1, 1 is the middle of the upper left pixel: half a pixel is taken off (--order)"
        notes.append(Note("assumed", None, text))
        return ORIGINS["centre-1"]
    check_order(order, ORIGINS)
    return ORIGINS[order]


def pixel_block(
    name: str,
    camera: Camera,
    rows: Sequence[PixelRow],
    names: dict[str, str],
    control: Sequence[ControlPoint],
    options: ImportOptions,
    shift: float,
    notes: list[Note],
) -> Block:
    """Return the block of a table of image points; adds to the notes.

    Parameters
    ----------
    name
        Of the block.
    camera
        Which all images were taken with.
    rows
        Image points.
    names
        Of images, by their numbers; one that is missing has its number as name.
    control
        Control and check points.
    options
        What was stated.
    shift
        What is taken off pixels.
    notes
        What was done; it grows.
    """
    if camera.pixels is None:
        raise InputError("the camera states no pixels: --pixels WIDTHxHEIGHT")
    um = 1000.0 * camera.pixel_mm
    sigma_px = options.sigma_px
    if sigma_px is None:
        sigma_px = 1.0
        if any(row.sigma_px is None for row in rows):
            notes.append(Note("assumed", None, "sigma of image coordinates one pixel (--sigma-px)"))
    nameless = [
        number for number in dict.fromkeys(row.photo for row in rows) if number not in names
    ]
    if nameless and names:
        text = "images have no name: their numbers serve"
        notes.append(Note("assumed", len(nameless), text, tuple(nameless[:4])))
    rays = [
        MeasuredRay(
            names.get(row.photo, row.photo),
            row.point,
            row.x - shift,
            row.y - shift,
            None if row.sigma_px is None else row.sigma_px * um,
        )
        for row in rows
    ]
    camera_of = dict.fromkeys((ray.photo for ray in rays), camera)
    points, told = image_points_of(rays, camera_of, pixels=True)
    notes += told
    idle = [name for name in names.values() if name not in camera_of]
    if idle:
        notes.append(Note("dropped", len(idle), "images without a point", tuple(idle[:4])))
    return Block(
        name,
        Precision(sigma_px * um, "exact"),
        TestSettings(),
        (camera,),
        tuple(Photo(photo, camera.id) for photo in camera_of),
        (),
        points,
        tuple(control),
        in_pixels=True,
    )
