"""Image points of any program: a table with a column for each of photo, point, x and y."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from math import hypot, sqrt
from pathlib import Path
from sys import intern
from typing import Final, TypeAlias, TypeVar, cast

from anaplot.errors import InputError
from anaplot.exchange.camerafile import format_camera
from anaplot.exchange.controlcsv import format_control
from anaplot.exchange.formats.door import Exported, Exporting, Imported, ImportOptions, Note
from anaplot.exchange.formats.gathered import not_held
from anaplot.exchange.formats.groundlist import read_ground
from anaplot.exchange.formats.measuredrays import MeasuredRay, image_points_of, own_sigmas
from anaplot.exchange.formats.namedcolumns import ColumnTable, open_columns, plain_title
from anaplot.exchange.formats.sourcelines import SourceLine, source_lines
from anaplot.exchange.formats.statedcameras import needed_camera, stated_cameras
from anaplot.exchange.measuredrows import REASON
from anaplot.photogrammetry.block import (
    Block,
    Camera,
    Photo,
    Precision,
    TestSettings,
    Use,
)
from anaplot.photogrammetry.camera import CameraCalibration
from anaplot.photogrammetry.measuredimage import measured_places
from anaplot.textfiles.csvtable import csv_text
from anaplot.textfiles.kinds import SIGMA, WrongValueError
from anaplot.textfiles.names import name_fault
from anaplot.textfiles.wholefile import create_folder
from anaplot.textfiles.wording import plain, quoted

__all__ = ["read", "recognises", "write"]

_COLUMNS: Final[dict[str, tuple[str, ...]]] = {
    "photo": (
        *("photo", "image", "img", "imagename", "photoname", "filename", "file", "photoid"),
        *("imageid", "photono", "imageno", "photonumber", "bild", "foto", "picture", "frame"),
    ),
    "point": (
        *("point", "pointid", "pointname", "pointno", "pointnumber", "pt", "ptid", "ptno"),
        *("objectpointid", "target", "marker", "gcp", "track", "label", "punkt", "name", "id"),
    ),
    "x": ("xpx", "x", "u", "xpixel", "pixelx", "px", "ximage", "imagex", "col", "column", "xmm"),
    "y": ("ypx", "y", "v", "ypixel", "pixely", "py", "yimage", "imagey", "row", "line", "ymm"),
    "sigma": ("sigmapx", "sigma", "s", "sxy", "sigmaxy", "std", "sd", "accuracy"),
    "sx": ("sx", "sigmax", "xsigma", "stdx", "sdx"),
    "sy": ("sy", "sigmay", "ysigma", "stdy", "sdy"),
    "sigma_um": ("sigmaum",),
    "use": ("use",),
    "reason": ("reason",),
    "camera": ("camera", "cam", "cameraid", "cameraname", "kamera"),
}
_BARE: Final = {
    4: ("point", "photo", "x", "y"),
    5: ("point", "photo", "x", "y", "sigma"),
    6: ("point", "photo", "x", "y", "sx", "sy"),
}
_OF_PHOTO: Final = {"photo": _COLUMNS["photo"], "camera": _COLUMNS["camera"]}
_FILES: Final = ("control", "check", "cameras")
_USES: Final = ("xy", "x", "y", "off")
_ORDERS: Final = ("corner", "pixel-centre", "middle", "up", "down")
_SHOWN: Final = 2  # rows

S = TypeVar("S")
T = TypeVar("T")
_Called: TypeAlias = tuple[SourceLine, str, str]  # a photo and its camera


def recognises(source: Path) -> bool:
    """Return whether a table says that it has x_px and y_px of points in photos."""
    if not source.is_file() or source.name == "image_points.csv":
        return False
    try:
        line = next(source_lines(source, max_bytes=10**12), None)
    except InputError:
        return False
    titles = {plain_title(word) for word in ("" if line is None else line.text[:5000]).split(",")}
    return {"xpx", "ypx"} <= titles and not titles.isdisjoint(_COLUMNS["photo"])


@dataclass(frozen=True)
class _Axes:
    """How a file's coordinates are counted.

    Attributes
    ----------
    pixels
        Whether what becomes of them is pixels.
    scale
        mm in a unit of the file, or 1 for pixels.
    origin, up
        As --order says.
    """

    pixels: bool
    scale: float
    origin: str
    up: bool

    def place(self, camera: Camera, x: float, y: float) -> tuple[float, float]:
        """Return pixels, or mm about the principal point with y up."""
        if not self.pixels:
            return x * self.scale, (y if self.up else -y) * self.scale
        assert camera.pixels is not None
        width, height = camera.pixels
        if self.origin == "middle":
            return width / 2 + x, height / 2 + (-y if self.up else y)
        if self.origin == "pixel-centre":
            x, y = x + 0.5, y + 0.5
        return x, height - y if self.up else y


def read(source: Path, options: ImportOptions) -> Imported:
    """Read a table of image points.

    Parameters
    ----------
    source
        Text with a header of any usual names, or without one (point photo x y).
    options
        `columns` by our names (photo, point, x, y, sigma, sx, sy, use, camera); `unit` px (taken
        when nothing is said), mm or um; `order`: words with commas between, of corner (taken when
        nothing is said), pixel-centre or middle, and down or up; mm and um count from the
        principal point, up. The camera as `camera`, or `c`, `pixels`, `pixel_um`. `files`:
        control, check, cameras (photo and camera), camera:NAME (a camera file).

    Raises
    ------
    InputError
        As the options and the files are wrong.
    """
    for key in options.files:
        if key not in _FILES and not key.startswith("camera:"):
            raise InputError(
                f"--with {plain(key, 60)}: neither of {', '.join(_FILES)}, camera:NAME"
            )
    photos, given = _photos(_opened(source, options))
    table = _opened(source, options)
    axes, notes = _axes(table, options)
    if not photos:
        raise InputError(f"{plain(str(source), 400)}: no row")
    called = _cameras_of(given, options.files.get("cameras"), photos)
    cameras, of_photo, said = _cameras(options, called, photos, pixels=axes.pixels)
    rays, shown, more = _rays(table, axes, of_photo)
    image_um, own, precision = _precision(options, of_photo, table, pixels=axes.pixels)
    points, lost = image_points_of(rays, of_photo, pixels=axes.pixels, sigma_um=own)
    notes = (*table.notes(), *notes)
    ground, told = read_ground(options.files)
    swapped = _swapped(table, photos, rays)
    known = {point.photo for point in points}
    block = Block(
        source.stem if name_fault(source.stem) is None else "block",
        Precision(image_um, "exact"),
        TestSettings("tau"),
        tuple(cameras.values()),
        tuple(Photo(name, of_photo[name].id) for name in photos if name in known),
        (),
        points,
        ground.control,
        priors=ground.priors,
        in_pixels=axes.pixels,
    )
    if not points:
        raise InputError(f"{plain(str(source), 400)}: no ray lies in its image")
    return Imported(
        block,
        (*notes, *said, *precision, *shown, *swapped, *more, *lost, *told),
        (f"Image points of {source.name}.",),
        {source.name: source},
    )


def _axes(table: ColumnTable, options: ImportOptions) -> tuple[_Axes, tuple[Note, ...]]:
    """Return how coordinates are counted, and what was assumed of it."""
    notes = []
    unit = options.unit
    if unit is None:
        title = plain_title(table.titles["x"]) if table.headed else ""
        unit = "mm" if title.endswith("mm") else "um" if title.endswith("um") else "px"
        if not title.endswith(unit):
            notes.append(Note("assumed", None, f"image coordinates are in {unit}"))
    words = [] if options.order is None else options.order.split(",")
    for word in words:
        if word not in _ORDERS:
            raise InputError(f"--order {quoted(word)}: neither of {', '.join(_ORDERS)}")
    origins = [word for word in words if word in _ORDERS[:3]]
    turns = [word for word in words if word in _ORDERS[3:]]
    if len(origins) > 1 or len(turns) > 1:
        raise InputError(
            f"--order {quoted(options.order or '')}: only one origin and one direction"
        )
    pixels = unit == "px"
    if origins and not pixels:
        raise InputError(f"--order {origins[0]}: {unit} count from the principal point")
    origin = origins[0] if origins else "corner" if pixels else "principal point"
    up = turns == ["up"] if turns else not pixels
    if not (origins and turns):
        where = {
            "corner": "the corner of the corner pixel",
            "pixel-centre": "the centre of the corner pixel",
            "middle": "the middle of the image",
        }.get(origin, "the principal point")
        text = f"y points {'up' if up else 'down'}, from {where} (--order says otherwise)"
        notes.append(Note("assumed", None, text))
    return _Axes(pixels, 0.001 if unit == "um" else 1.0, origin, up), tuple(notes)


def _opened(source: Path, options: ImportOptions) -> ColumnTable:
    return open_columns(source, _COLUMNS, ("photo", "point", "x", "y"), _BARE, options.columns)


def _rows(table: ColumnTable) -> Iterator[tuple[SourceLine, dict[str, str]]]:
    for line, fields in table.rows:
        yield line, dict(zip(table.titles, fields, strict=True))


def _photos(table: ColumnTable) -> tuple[dict[str, None], list[_Called]]:
    """Return the photos of a table, and what it calls their cameras; rows are not kept."""
    photos: dict[str, None] = {}
    given: dict[tuple[str, str], _Called] = {}
    for line, row in _rows(table):
        photos[row["photo"]] = None
        key = row["photo"], row.get("camera", "")
        if key[1] and key not in given:
            given[key] = line, *key
    return photos, list(given.values())


def _cameras_of(
    given: list[_Called], path: Path | None, photos: Mapping[str, None]
) -> dict[str, str]:
    """Return what photos call their cameras; nothing where no file says it."""
    found: dict[str, str] = {}
    if path is not None:
        bare = {2: ("photo", "camera")}
        table = open_columns(path, _OF_PHOTO, ("photo", "camera"), bare, None)
        given = [(line, photo, camera) for line, (photo, camera) in table.rows]
    for line, photo, camera in given:
        if found.setdefault(photo, line.name_of(camera, "camera")) != camera:
            raise line.fail(f"photo {quoted(photo)} has camera {quoted(found[photo])} already")
    missing = next((photo for photo in photos if photo not in found), None)
    if found and missing is not None:
        raise InputError(f"photo {quoted(missing)}: no row says which camera it has")
    return {photo: found[photo] for photo in photos if photo in found}


def _cameras(
    options: ImportOptions, called: Mapping[str, str], photos: Mapping[str, None], *, pixels: bool
) -> tuple[dict[str, Camera], dict[str, Camera], list[Note]]:
    if called:
        names = dict.fromkeys(called.values())
        cameras, notes = stated_cameras(options, names, pixels=pixels)
        return cameras, {photo: cameras[called[photo]] for photo in photos}, notes
    stray = next((key for key in options.files if key.startswith("camera:")), None)
    if stray is not None:
        raise InputError(f"--with {plain(stray, 60)}: no column camera says whose it is")
    camera, notes = needed_camera(options, pixels=pixels)
    return {camera.id: camera}, dict.fromkeys(photos, camera), notes


def _rays(
    table: ColumnTable, axes: _Axes, of_photo: Mapping[str, Camera]
) -> tuple[list[MeasuredRay], tuple[Note, ...], tuple[Note, ...]]:
    """Return rays, how the first rows were read, and what was changed."""
    rays: list[MeasuredRay] = []
    lines: list[SourceLine] = []
    uneven = 0
    for line, row in _rows(table):
        photo = intern(line.name_of(row["photo"], "photo"))
        point = intern(line.name_of(row["point"], "point"))
        if photo not in of_photo:
            raise line.fail("the file has changed while it was read")
        if len(lines) < _SHOWN:
            lines.append(line)
        use = row.get("use") or "xy"
        if use not in _USES:
            raise line.fail(f"use must be one of {', '.join(_USES)}, not {quoted(use)}")
        x = table.number(line, row["x"], "x")
        y = table.number(line, row["y"], "y")
        x, y = axes.place(of_photo[photo], x, y)
        um = 1000.0 * (of_photo[photo].pixel_mm if axes.pixels else axes.scale)
        sigma, differs = _sigma(table, line, row, um)
        uneven += differs
        if sigma is not None:
            _check(line, "sigma_um", SIGMA.of, sigma)
        reason = _check(line, "reason", REASON.of_text, row.get("reason", ""))
        rays.append(MeasuredRay(photo, point, x, y, sigma, cast("Use", use), reason))
    shown = _shown(lines, rays, axes)
    if not uneven:
        return rays, shown, ()
    text = "rays with different sigmas in x and y: both count with their quadratic mean"
    return rays, shown, (Note("changed", uneven, text),)


def _check(line: SourceLine, what: str, kind: Callable[[S], T], value: S) -> T:
    """Return a value that a block can hold; raises InputError for another one."""
    try:
        return kind(value)
    except WrongValueError as error:
        raise line.fail(f"{what} {error}") from None


def _sigma(
    table: ColumnTable, line: SourceLine, row: Mapping[str, str], um: float
) -> tuple[float | None, bool]:
    """Return a ray's standard deviation [um], and whether x and y have different ones."""
    values = {
        name: table.number(line, row[name], name)
        for name in ("sigma", "sx", "sy", "sigma_um")
        if row.get(name)
    }
    for name, value in values.items():
        _check(line, name, SIGMA.of, value)
    if "sigma_um" in values:
        return values["sigma_um"], False
    sx, sy = (values.get(name, values.get("sigma")) for name in ("sx", "sy"))
    if sx is None or sy is None:
        one = sx if sy is None else sy
        return None if one is None else one * um, False
    mean = sx if sx == sy else hypot(sx, sy) / sqrt(2.0)
    return mean * um, sx != sy


def _precision(
    options: ImportOptions, of_photo: Mapping[str, Camera], table: ColumnTable, *, pixels: bool
) -> tuple[float, dict[str, float], tuple[Note, ...]]:
    """Return the a-priori sigma of image coordinates [um], that of photos with another one, notes.

    In pixels the first photo's are meant by that of the block.
    """
    if options.sigma_um is not None:
        if options.sigma_px is not None:
            raise InputError("--sigma-um beside --sigma-px: only one of them")
        return options.sigma_um, {}, ()
    assumed: tuple[Note, ...] = ()
    if options.sigma_px is None:
        stated = table.stated.union(table.titles)
        if stated.isdisjoint(("sigma", "sx", "sy", "sigma_um")):
            one = "one pixel" if pixels else f"{Precision().image_um:g} um"
            assumed = (Note("assumed", None, f"an image coordinate has a sigma of {one}"),)
        if not pixels:
            return Precision().image_um, {}, assumed
    elif not pixels and any(camera.pixel_um is None for camera in of_photo.values()):
        raise InputError("--sigma-px: of image coordinates in mm it needs the size of a pixel")
    sigma_px = 1.0 if options.sigma_px is None else options.sigma_px
    image_um = sigma_px * (next(iter(of_photo.values())).pixel_um or 1.0)
    return image_um, own_sigmas(of_photo, sigma_px, image_um), assumed


def _shown(lines: list[SourceLine], rays: list[MeasuredRay], axes: _Axes) -> tuple[Note, ...]:
    """Return how the first rows were read."""
    unit = "px from the upper left corner, down" if axes.pixels else "mm, up"
    return tuple(
        Note(
            "assumed",
            None,
            f"line {line.number} is photo {quoted(ray.photo)}, point {quoted(ray.point)}, "
            f"x {ray.x:.10g}, y {ray.y:.10g} ({unit})",
        )
        for line, ray in zip(lines, rays, strict=False)
    )


def _swapped(
    table: ColumnTable, photos: Mapping[str, None], rays: list[MeasuredRay]
) -> tuple[Note, ...]:
    """Say when photos and points may have been taken for each other."""
    points = len({ray.point for ray in rays})
    if {"photo", "point"} <= table.stated or len(photos) <= points:
        return ()
    text = (
        f"{len(photos)} photos and {points} points: if they are exchanged, say --column photo=..."
    )
    return (Note("assumed", None, text),)


def write(exporting: Exporting, target: Path) -> Exported:
    """Write a folder: image_points.csv with a header, control.csv, and a file for every camera.

    Raises
    ------
    InputError
        A camera has no pixels where they are asked for, or a file cannot be written.
    """
    block = exporting.block
    unit = exporting.options.unit or ("px" if block.in_pixels else "mm")
    cameras = {camera.id: camera for camera in block.cameras}
    if unit == "px":
        for camera in block.cameras:
            if camera.pixels is None:
                raise InputError(f"camera {quoted(camera.id)} states no pixels: --unit mm")
    places = measured_places(block, block.image_points, pixels=unit == "px")
    if unit == "um":
        places = places * 1000.0
    of_photo = {photo.id: photo.camera for photo in block.photos}
    head = ("photo", "point", f"x_{unit}", f"y_{unit}", "sigma_um", "use", "reason", "camera")
    # a pixel is what a ray without a sigma is read with: of different cameras no weights were held
    alike = unit != "px" or len({camera.pixel_um for camera in block.cameras}) == 1
    usual = None if alike else block.precision.image_um
    text = csv_text(
        head,
        (
            (r.photo, r.point, x, y, r.sigma_um or usual, r.use, r.reason, of_photo[r.photo])
            for r, (x, y) in zip(block.image_points, places.tolist(), strict=True)
        ),
    )
    files = {"points.csv": text}
    if block.control or block.priors:
        files["control.csv"] = format_control(block.control, block.priors)
    for number, camera in enumerate(cameras.values(), 1):
        stated = CameraCalibration(
            camera.id,
            camera.c,
            format=camera.format if camera.pixels is None else None,
            lens=camera.lens,
            pixels=camera.pixels,
            pixel_um=camera.pixel_um,
            principal_px=camera.principal_px,
        )
        files[f"camera-{number}.toml"] = format_camera(stated)
    models = sum(row.model is not None for row in block.image_points)
    oriented = sum(photo.position is not None for photo in block.photos)
    notes = not_held(block, holds=("check", "priors", "image sigmas", "lens", "control sigmas"))
    for count, what in ((models, "rays belong to a model"), (oriented, "orientations of photos")):
        if count:
            notes.append(Note("not held", count, what))
    made = ((name, content.encode()) for name, content in files.items())
    return Exported(create_folder(target, made), tuple(notes))
