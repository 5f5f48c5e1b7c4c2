"""A camera file: what a calibration certificate says, to and from text.

    format = 1
    [camera]
    id = "rmk"
    c = 152.40                          # mm
    format = [230.0, 230.0]             # mm; left out: not known
    pixels = [6000, 4000]               # instead of format; also pixel_um and principal_px
    principal_point = [0.012, -0.004]   # mm in the fiducial system; left out: its origin
    symmetry_point = [0.015, -0.001]    # mm; about it is all distortion; left out: principal_point
    [fiducials]                         # mm
    1 = [-106.003, 106.001]
    2 = [106.000, 105.998]
    [distortion]
    table = [[20.0, 1.5], [40.0, 2.2]]  # radius [mm], dr [um]; see `distortion`
    [lens]                              # instead of [distortion]: from ideal to measured
    model = "brown"
    k1 = -0.05                          # also k2, k3, p1, p2, b1, b2, of coordinates divided by c

dr is subtracted from the measured radius to give the ideal one. A certificate that states nothing
but distances between fiducials has, instead of [fiducials],

    [distances]
    sigma_um = 2.0                      # their standard deviation, this when left out
    mm = [["1", "3", 226.002], ["4", "2", 226.010]]

of which the first runs along +x and the second along +y. A camera without fiducials may leave
out both.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from anaplot.errors import InputError
from anaplot.exchange.distortion import distortion_lines, read_distortion
from anaplot.photogrammetry.block import Camera
from anaplot.photogrammetry.camera import (
    BrownLens,
    CameraCalibration,
    Fiducial,
    FiducialDistance,
)
from anaplot.textfiles.inputfile import read_text
from anaplot.textfiles.kinds import (
    NAME,
    NUMBER,
    POSITIVE,
    SIGMA,
    TABLE,
    Fields,
    Items,
    Keys,
    Kind,
    ListOf,
    Made,
    MapOf,
    Number,
    Numbers,
    Whole,
    Word,
    WrongValueError,
)
from anaplot.textfiles.tomltable import TomlTable, parse_toml
from anaplot.textfiles.tomltext import toml_number, toml_numbers, toml_text
from anaplot.textfiles.wholefile import create_whole
from anaplot.textfiles.wording import place, plain, quoted

__all__ = [
    "CAMERA_FORMAT",
    "CONSTANT",
    "FRAME",
    "LENS",
    "MAX_CAMERA_BYTES",
    "MAX_PIXELS",
    "PIXELS",
    "camera_path",
    "check_distortion",
    "check_principal_px",
    "format_camera",
    "lens_lines",
    "parse_camera",
    "pixel_lines",
    "read_camera",
    "write_camera",
]

CAMERA_FORMAT = 1
MAX_PIXELS = 1_000_000
MAX_CAMERA_BYTES = 1_000_000

_MAX_FIDUCIALS = 400  # a reseau of 19 x 19 crosses and more than any frame


def read_camera(path: Path) -> CameraCalibration:
    """Read a camera file; nothing is written.

    Raises
    ------
    InputError
        The first thing that is wrong, with file, line and key.
    """
    return parse_camera(read_text(path, MAX_CAMERA_BYTES), path)


def parse_camera(text: str, path: Path) -> CameraCalibration:
    """Return the calibration that the text of a camera file states.

    Parameters
    ----------
    text
        Content of the file.
    path
        Its name, for messages.

    Raises
    ------
    InputError
        Anything but a complete camera of format 1, with file, line and key.
    """
    root = parse_toml(text, path)
    root.version(CAMERA_FORMAT)
    camera = root.take({"camera": Keys(_CAMERA, _CAMERA_MORE)}, _TABLES, also=("format",))["camera"]
    c = camera["c"]
    size = camera.get("format")
    stray = next((key for key in ("pixel_um", "principal_px") if key in camera), None)
    if stray is not None and "pixels" not in camera:
        raise root.fail(f"{stray} without pixels", "camera", stray)
    if size is not None and "pixels" in camera:
        raise root.fail("beside pixels, which state it: only one of them", "camera", "format")
    check_principal_px(root, camera, c, "camera")
    symmetry = camera.get("symmetry_point")
    for key in ("principal_point", "symmetry_point"):
        if any(abs(part) > c for part in camera.get(key, ())):
            raise root.fail("lies further off than c", "camera", key)
    if "fiducials" in root and "distances" in root:
        raise root.fail("[distances] beside [fiducials]: only one of them", "distances")
    fiducials = _fiducials(root.table("fiducials"), size or (4.0 * c, 4.0 * c))
    if "fiducials" in root and not fiducials:
        raise root.fail("is empty", "fiducials")
    distances = _distances(root.table("distances")) if "distances" in root else {}
    if "lens" in root and "distortion" in root:
        raise root.fail("[lens] beside [distortion]: only one of them", "lens")
    lens = root.get("lens", LENS) if "lens" in root else None
    if lens is not None and "symmetry_point" in camera:
        raise root.fail("beside [lens], which is about the principal point", *_SYMMETRY)
    distortion = read_distortion(root.table("distortion"), c)
    made = CameraCalibration(
        id=camera["id"],
        c=c,
        principal_point=camera.get("principal_point", (0.0, 0.0)),
        format=size,
        fiducials=fiducials,
        symmetry_point=symmetry,
        lens=lens,
        **{key: camera[key] for key in PIXELS if key in camera},
        **distances,
        **distortion,
    )
    check_distortion(root, made)
    return made


def check_distortion(table: TomlTable, calibration: CameraCalibration) -> None:
    """Refuse a lens or a distortion with which nothing can be measured, wherever it is stated.

    Parameters
    ----------
    table
        What holds the table `lens` or `distortion`.
    calibration
        What is stated.
    """
    if not calibration.distorts:
        return
    from anaplot.photogrammetry.refinement import Refinement

    try:
        Refinement.of(calibration)
    except InputError as error:
        key = "distortion" if calibration.lens is None else "lens"
        raise table.fail(str(error), key) from None


def check_principal_px(table: TomlTable, stated: Mapping[str, Any], c: float, *keys: str) -> None:
    """Refuse a principal point [px] that lies further off the middle of the image than c.

    Parameters
    ----------
    table, keys
        Where it stands.
    stated
        `PIXELS`, as far as they are stated.
    c
        Camera constant [mm].
    """
    if "principal_px" not in stated:
        return
    mm = 1e-3 * stated.get("pixel_um", 1.0)
    pairs = zip(stated["principal_px"], stated["pixels"], strict=True)
    if any(abs(at - size / 2.0) * mm > c for at, size in pairs):
        raise table.fail("lies further off the middle of the image than c", *keys, "principal_px")


def camera_path(folder: Path, name: str) -> Path:
    """Return the path of a camera file that a file in `folder` refers to.

    Parameters
    ----------
    folder
        Where the file stands that refers to it.
    name
        Relative to that folder and inside it, or absolute.

    Raises
    ------
    ValueError
        The name is none, or leads out of the folder; says so in one line.
    """
    if not name or name.isspace() or len(name) > 400 or not name.isprintable():
        raise ValueError(f"{quoted(name)} is not a file name")
    path = Path(name)
    if not path.is_absolute() and ".." in path.parts:
        raise ValueError(f"{quoted(name)} leads out of the folder: name it by its absolute path")
    return folder / path


def format_camera(calibration: CameraCalibration) -> str:
    """Return the text of a camera file; numbers are written so that they are read back exactly."""
    lines = [
        f"format = {CAMERA_FORMAT}",
        "",
        "[camera]",
        f"id = {toml_text(calibration.id)}",
        f"c = {toml_number(calibration.c)}",
    ]
    if calibration.format is not None:
        lines.append(f"format = {toml_numbers(*calibration.format)}")
    lines += pixel_lines(calibration)
    lines.append(f"principal_point = {toml_numbers(*calibration.principal_point)}")
    if calibration.symmetry_point is not None:
        lines.append(f"symmetry_point = {toml_numbers(*calibration.symmetry_point)}")
    if calibration.fiducials:
        lines += ["", "[fiducials]"]
        lines += [
            f"{toml_text(mark.id)} = {toml_numbers(mark.x, mark.y)}"
            for mark in calibration.fiducials
        ]
    if calibration.distances:
        lines += [
            "",
            "[distances]",
            f"sigma_um = {toml_number(calibration.distance_sigma_um)}",
            "mm = [",
        ]
        lines += [
            f"    [{toml_text(d.first)}, {toml_text(d.second)}, {toml_number(d.mm)}],"
            for d in calibration.distances
        ]
        lines.append("]")
    if calibration.lens is not None:
        lines += ["", "[lens]", *lens_lines(calibration.lens)]
        return "\n".join(lines) + "\n"
    lines += ["", *distortion_lines(calibration)]
    return "\n".join(lines) + "\n"


def pixel_lines(of: Camera | CameraCalibration) -> list[str]:
    """Return what is written of a camera's pixels; nothing where it has none."""
    if of.pixels is None:
        return []
    lines = [f"pixels = [{of.pixels[0]}, {of.pixels[1]}]"]
    if of.pixel_um is not None:
        lines.append(f"pixel_um = {toml_number(of.pixel_um)}")
    if of.principal_px is not None:
        lines.append(f"principal_px = {toml_numbers(*of.principal_px)}")
    return lines


def lens_lines(lens: BrownLens) -> list[str]:
    """Return the lines of a [lens] table: every coefficient that is not 0."""
    pairs = zip(_COEFFICIENTS, lens.coefficients, strict=True)
    stated = [f"{name} = {toml_number(value)}" for name, value in pairs if value]
    return ['model = "brown"', *stated]


def write_camera(path: Path, calibration: CameraCalibration, remark: str = "") -> None:
    """Write a new camera file.

    Parameters
    ----------
    path
        The file.
    calibration
        What it says.
    remark
        A line for people that it begins with, as a comment.

    Raises
    ------
    InputError
        The calibration could not be read again, there is such a file already, or it cannot be
        written.
    """
    text = f"# {plain(remark)}\n" * bool(remark) + format_camera(calibration)
    parse_camera(text, path)
    data = text.encode()
    if len(data) > MAX_CAMERA_BYTES:
        raise InputError(f"{place(path)}: larger than what is read ({MAX_CAMERA_BYTES / 1e6:g} MB)")
    create_whole(path, data)


def _fiducials(table: TomlTable, reach: tuple[float, float]) -> tuple[Fiducial, ...]:
    places: dict[tuple[float, ...], str] = {}
    for name in table:
        x, y = place = table.get(name, Numbers(2))
        # fiducials stand at the edge, some outside what the frame exposes
        if abs(x) > reach[0] or abs(y) > reach[1]:
            raise table.fail(f"fiducial {quoted(name)} lies far outside the format", name)
        if (twin := places.setdefault(place, name)) != name:
            raise table.fail(f"fiducial {quoted(name)} has the same place as {quoted(twin)}", name)
    if len(places) > _MAX_FIDUCIALS:
        raise table.fail(f"more than {_MAX_FIDUCIALS} fiducials")
    return tuple(Fiducial(name, x, y) for (x, y), name in places.items())


def _distances(table: TomlTable) -> dict[str, Any]:
    """Return the keyword arguments of a calibration that states distances."""
    found = table.take({"mm": ListOf(_DISTANCE, 'distances ["name", "name", mm]')}, _DISTANCES)
    distances: tuple[FiducialDistance, ...] = found["mm"]
    if len(distances) < 2:
        raise table.fail("two distances at least: one along x, one along y", "mm")
    if len(distances) > _MAX_FIDUCIALS:
        raise table.fail(f"more than {_MAX_FIDUCIALS} distances", "mm")
    pairs: set[frozenset[str]] = set()
    for index, distance in enumerate(distances):
        first, second = quoted(distance.first), quoted(distance.second)
        if distance.first == distance.second:
            raise table.fail(f"a distance from {first} to itself", "mm", index)
        pair = frozenset((distance.first, distance.second))
        if pair in pairs:
            raise table.fail(f"the distance between {first} and {second} twice", "mm", index)
        pairs.add(pair)
    return {"distances": distances, "distance_sigma_um": found.get("sigma_um", 2.0)}


_DISTANCE = Made(Items(NAME, NAME, POSITIVE), lambda items: FiducialDistance(*items))
FRAME = Numbers(2, POSITIVE)
"""A camera's format: width and height [mm]."""

_SYMMETRY = ("camera", "symmetry_point")
_COEFFICIENTS = ("k1", "k2", "k3", "p1", "p2", "b1", "b2")


def _lens(found: dict[str, Any]) -> BrownLens:
    return BrownLens(**{name: found[name] for name in _COEFFICIENTS if name in found})


LENS: Kind[BrownLens] = Made(
    Keys(
        {"model": Word("brown")},
        # b1 = -1 leaves nothing of x, and a smaller one turns it over
        {**dict.fromkeys(_COEFFICIENTS, NUMBER), "b1": Number(-1.0, inside=True)},
    ),
    _lens,
)
"""A lens's table: its model and coefficients, each 0 where it is left out."""

PIXELS: Fields = {
    "pixels": Made(Items(Whole(1, MAX_PIXELS), Whole(1, MAX_PIXELS)), lambda found: tuple(found)),
    "pixel_um": POSITIVE,
    "principal_px": Numbers(2),
}
"""What a camera says of its pixels."""


def _constant(c: float) -> float:
    if not 1e-6 <= c <= 1e9:
        raise WrongValueError(f"{c:g} mm is no camera constant (1e-06 to 1e+09)")
    return c


CONSTANT: Kind[float] = Made(POSITIVE, _constant)
"""A camera constant [mm]."""

_CAMERA: Fields = {"id": NAME, "c": CONSTANT}
_CAMERA_MORE: Fields = {
    "format": FRAME,
    **PIXELS,
    "principal_point": Numbers(2),
    "symmetry_point": Numbers(2),
}
_TABLES: Fields = {
    "fiducials": MapOf(NAME, Numbers(2)),
    "distances": TABLE,
    "distortion": TABLE,
    "lens": TABLE,
}
_DISTANCES: Fields = {"sigma_um": SIGMA}
