"""What formats of tables share: what a person states of them, and what they cannot hold."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from anaplot.errors import InputError
from anaplot.exchange.camerafile import read_camera
from anaplot.exchange.formats.door import Exporting, ImportOptions, Note
from anaplot.exchange.formats.sourcelines import SourceLine
from anaplot.photogrammetry.block import (
    Block,
    Camera,
    ImagePoint,
    Precision,
    TestSettings,
    calibrated_camera,
    in_pixels,
)
from anaplot.textfiles.wording import hint, plain, quoted

__all__ = [
    "MAX_TABLE_BYTES",
    "Pose",
    "check_order",
    "check_with",
    "fields_of",
    "ground_number",
    "head_of",
    "image_sigma",
    "named",
    "not_held",
    "number",
    "poses_of",
    "rays_that_count",
    "stated_camera",
    "whole_name",
]

MAX_TABLE_BYTES = 50_000_000
"""Largest table of text that is read; in memory it is forty times as large."""


class Pose(NamedTuple):
    """A photo's name, projection centre [m] and omega, phi, kappa [rad]."""

    photo: str
    position: tuple[float, float, float]
    rotation: tuple[float, float, float]


def head_of(source: Path, size: int) -> str:
    """Return the first bytes of a file as text; "" where there is no file that can be read."""
    try:
        if not source.is_file():
            return ""
        with source.open("rb") as file:
            return file.read(size).decode("utf-8", "replace")
    except (OSError, ValueError):
        return ""


def named(folder: Path, suffix: str) -> list[Path]:
    """Return what of a folder bears a suffix, in small or capital letters; raises OSError."""
    return sorted(one for one in folder.iterdir() if one.suffix.lower() == suffix)


def fields_of(line: SourceLine, marks: str = "#") -> list[str]:
    """Return the fields of a line between blanks; none of a comment, which begins with a mark."""
    text = line.text.strip()
    return [] if text[:1] and text[0] in marks else text.split()


def number(line: SourceLine, text: str, what: str, unit: str = "mm") -> float:
    """Return a number as FORTRAN writes it too; of micrometres [mm], rounded once.

    Raises
    ------
    InputError
        It is none, or not finite.
    """
    plain_text = text.replace("D", "E").replace("d", "e")
    value = line.number_of(plain_text, what)
    if unit != "um":
        return value
    return value / 1000.0 if "e" in plain_text.lower() else float(f"{plain_text}e-3")


def ground_number(line: SourceLine, text: str, what: str, unit: str = "mm") -> float:
    """Return a ground coordinate as `number` does; raises InputError for no place on earth."""
    return line.on_earth(number(line, text, what, unit), text, what)


def check_with(files: Mapping[str, Path], known: Iterable[str]) -> None:
    """Refuse a further file that a format has no use for; raises InputError."""
    words = tuple(known)
    for word in files:
        if word not in words:
            raise InputError(f"--with {plain(word, 60)}: no such file here{hint(word, words)}")


def check_order(order: str | None, known: Iterable[str]) -> None:
    """Refuse an --order that a format does not know; raises InputError."""
    words = tuple(known)
    if order is not None and order not in words:
        raise InputError(f"--order {plain(order, 60)}{hint(order, words)}")


def stated_camera(options: ImportOptions) -> tuple[Camera | None, list[Note]]:
    """Return the camera that a person states by a file or by numbers, or None.

    Raises
    ------
    InputError
        Both, or pixels without a camera constant, or a pixel size without pixels.
    """
    given = {"--c": options.c, "--pixels": options.pixels, "--pixel-um": options.pixel_um}
    if options.camera is not None:
        beside = next((word for word, value in given.items() if value is not None), None)
        if beside is not None:
            raise InputError(f"{beside}: beside --camera, which states it")
        found = read_camera(options.camera)
        notes = []
        if found.corrects or any(found.principal_point):
            text = "coordinates are ideal ones: principal point and [distortion] of the camera file"
            notes = [Note("assumed", None, f"{text} are not taken off")]
        return replace(calibrated_camera(found), calibration=None), notes
    if options.pixels is None:
        if options.pixel_um is not None:
            raise InputError("--pixel-um: without --pixels")
        return (None if options.c is None else Camera("camera", options.c)), []
    if options.c is None:
        raise InputError("--pixels: without --c, the camera constant")
    c = options.c if options.pixel_um is not None else options.c / 1000.0
    return in_pixels(Camera("camera", c), options.pixels, options.pixel_um), []


def image_sigma(options: ImportOptions) -> tuple[float, list[Note]]:
    """Return the a-priori sigma of image coordinates [um] where the source states none."""
    if options.sigma_um is not None:
        return options.sigma_um, []
    usual = Precision().image_um
    return usual, [Note("assumed", None, f"sigma of image coordinates {usual:g} um (--sigma-um)")]


def rays_that_count(block: Block) -> tuple[list[ImagePoint], list[Note]]:
    """Return the rays that a format without switches can hold, and what it cannot hold of them."""
    kept: dict[tuple[str, str], ImagePoint] = {}
    off = half = again = 0
    for row in block.image_points:
        if row.use == "off":
            off += 1
        elif row.use != "xy":
            half += 1
        elif (row.photo, row.point) in kept:
            again += 1
        else:
            kept[row.photo, row.point] = row
    notes = []
    for count, text in (
        (off, "rays with use = off: left out"),
        (half, "rays of which one coordinate counts: left out"),
        (again, "rays of points measured again in another model: left out"),
    ):
        if count:
            notes.append(Note("not held", count, text))
    return list(kept.values()), notes


def poses_of(exporting: Exporting) -> list[Pose]:
    """Return the orientations of a block's photos: the adjusted ones, else those that are stated.

    Photos without one are left out.
    """
    if exporting.adjusted is not None:
        return [Pose(row.photo, row.position, row.rotation) for row in exporting.adjusted.photos]
    return [
        Pose(photo.id, photo.position, photo.rotation)
        for photo in exporting.block.photos
        if photo.position is not None and photo.rotation is not None
    ]


def not_held(block: Block, *, holds: Iterable[str] = ()) -> list[Note]:
    """Return what of a block has no place in a format, but for what it holds.

    Parameters
    ----------
    block
        The block.
    holds
        Of "strips", "check", "priors", "distances", "conditions", "image sigmas", "lens",
        "control sigmas", "photo sigmas", "image_um", "control_m".
    """
    kinds = [condition.kind for condition in block.conditions]
    photos = block.photos
    counts = {
        "strips": (len(block.strips), "strips"),
        "check": (sum(row.use == "check" for row in block.control), "check points"),
        "priors": (len(block.priors), "priors of points"),
        "distances": (kinds.count("distance"), "distances"),
        "conditions": (len(kinds) - kinds.count("distance"), "conditions between points"),
        "image sigmas": (
            sum(row.sigma_um is not None for row in block.image_points),
            "standard deviations of rays",
        ),
        "control sigmas": (
            sum(any(s is not None for s in row.sigma) for row in block.control),
            "standard deviations of control points",
        ),
        "photo sigmas": (
            sum(p.position_sigma is not None or p.rotation_sigma is not None for p in photos),
            "priors of photos",
        ),
        "lens": (sum(c.lens is not None for c in block.cameras), "lenses: coordinates are ideal"),
    }
    held = set(holds)
    notes = [
        Note("not held", count, text)
        for name, (count, text) in counts.items()
        if count and name not in held
    ]
    precision, test = block.precision, block.test
    if "image_um" not in held:
        notes.append(Note("not held", None, f"image_um = {precision.image_um:g} um"))
    if "control_m" not in held and any(
        sigma is None and value is not None
        for row in block.control
        for sigma, value in zip(row.sigma, row.xyz, strict=True)
    ):
        notes.append(Note("not held", None, f"control_m = {precision.control_m:g} m"))
    if test != TestSettings():
        settings = f"{test.kind}, alpha = {test.alpha:g}, power = {test.power:g}"
        notes.append(Note("not held", None, f"the settings of the test: {settings}"))
    return notes


def whole_name(what: str, name: str, most: int, kind: str) -> str:
    """Return a name that a format can hold.

    Raises
    ------
    InputError
        It is too long, or has blanks, or reads as something else: it is never cut.
    """
    fault = None
    if len(name) > most:
        fault = f"is longer than the {most} characters of {kind}"
    elif name.split() != [name]:
        fault = f"holds a blank, which {kind} cannot"
    elif not name.isascii():
        fault = f"holds a letter that {kind} cannot"
    elif name[0] in "-#*":
        fault = f"begins with {name[0]!r}, which means something else in {kind}"
    if fault is not None:
        raise InputError(f"{what} {quoted(name)} {fault}")
    return name
