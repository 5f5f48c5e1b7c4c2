"""A camera file: what a calibration certificate says, to and from text.

    format = 1
    [camera]
    id = "rmk"
    c = 152.40                          # mm
    format = [230.0, 230.0]             # mm; left out: not known
    principal_point = [0.012, -0.004]   # mm in the fiducial system; left out: its origin
    [fiducials]                         # mm
    1 = [-106.003, 106.001]
    2 = [106.000, 105.998]
    [distortion]
    radial = [0.0, 1.2e-8, 0.0, 0.0]    # K0 K1 K2 K3: dr = K0 r + K1 r^3 + K2 r^5 + K3 r^7 [mm]
    table = [[20.0, 1.5], [40.0, 2.2]]  # instead: radius [mm], dr [um]
    decentring = [0.0, 0.0]             # P1 P2 [1/mm]

dr is subtracted from the measured radius to give the ideal one. A certificate that states nothing
but distances between fiducials has, instead of [fiducials],

    [distances]
    sigma_um = 2.0                      # their standard deviation, this when left out
    mm = [["1", "3", 226.002], ["4", "2", 226.010]]

of which the first runs along +x and the second along +y. A camera without fiducials may leave
out both.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from anaplot.errors import InputError
from anaplot.photogrammetry.camera import (
    CameraCalibration,
    Fiducial,
    FiducialDistance,
    RadialPolynomial,
    RadialTable,
)
from anaplot.photogrammetry.refinement import Refinement
from anaplot.textfiles.inputfile import read_text
from anaplot.textfiles.names import name_fault
from anaplot.textfiles.tomlfile import TomlFile, TomlTable
from anaplot.textfiles.tomltext import toml_number, toml_numbers, toml_text
from anaplot.textfiles.wholefile import create_whole
from anaplot.textfiles.wording import describe_type, place, quoted

__all__ = [
    "CAMERA_FORMAT",
    "MAX_CAMERA_BYTES",
    "camera_path",
    "format_camera",
    "frame_format",
    "parse_camera",
    "read_camera",
    "write_camera",
]

CAMERA_FORMAT = 1
MAX_CAMERA_BYTES = 1_000_000

_MAX_FIDUCIALS = 400  # a reseau of 19 x 19 crosses and more than any frame
_MAX_TABLE = 1000


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
    root = TomlFile(path, text).root
    root.version(CAMERA_FORMAT)
    root.only("format", "camera", "fiducials", "distances", "distortion")
    root.raw("camera")
    camera = root.table("camera", "[camera]")
    camera.only("id", "c", "format", "principal_point")
    name, c = camera.name("id"), camera.positive("c")
    size = frame_format(camera)
    x0, y0 = camera.numbers("principal_point", 2) if "principal_point" in camera else (0.0, 0.0)
    if abs(x0) > c or abs(y0) > c:
        raise camera.fail("principal_point", "principal_point lies further off than c")
    if "fiducials" in root and "distances" in root:
        raise root.fail("distances", "[distances] beside [fiducials]: only one of them")
    distances = root.table("distances", "[distances]")
    distances.only("sigma_um", "mm")
    distortion = root.table("distortion", "[distortion]")
    distortion.only("radial", "table", "decentring")
    p1, p2 = distortion.numbers("decentring", 2) if "decentring" in distortion else (0.0, 0.0)
    made = CameraCalibration(
        id=name,
        c=c,
        principal_point=(x0, y0),
        format=size,
        fiducials=_fiducials(root, size or (4.0 * c, 4.0 * c)),
        distances=_distances(distances) if "distances" in root else (),
        distance_sigma_um=distances.positive("sigma_um", 2.0),
        radial=_radial(distortion),
        decentring=(p1, p2),
    )
    try:
        Refinement.of(made)
    except InputError as error:
        raise root.fail("distortion", str(error)) from None
    return made


def frame_format(table: TomlTable) -> tuple[float, float] | None:
    """Return a camera's format [mm], None when the key is left out."""
    if "format" not in table:
        return None
    width, height = table.numbers("format", 2)
    if width <= 0.0 or height <= 0.0:
        raise table.fail("format", "format must hold two numbers greater than 0")
    return width, height


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
    x0, y0 = calibration.principal_point
    lines = [
        f"format = {CAMERA_FORMAT}",
        "",
        "[camera]",
        f"id = {toml_text(calibration.id)}",
        f"c = {toml_number(calibration.c)}",
    ]
    if calibration.format is not None:
        lines.append(f"format = {toml_numbers(*calibration.format)}")
    lines.append(f"principal_point = {toml_numbers(x0, y0)}")
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
    lines += ["", "[distortion]", f"decentring = {toml_numbers(*calibration.decentring)}"]
    if isinstance(calibration.radial, RadialPolynomial):
        lines.append(f"radial = {toml_numbers(*calibration.radial.k)}")
    if isinstance(calibration.radial, RadialTable):
        pairs = zip(calibration.radial.radius, calibration.radial.dr_um, strict=True)
        lines.append("table = [")
        lines += [f"    {toml_numbers(radius, dr)}," for radius, dr in pairs]
        lines.append("]")
    return "\n".join(lines) + "\n"


def write_camera(path: Path, calibration: CameraCalibration) -> None:
    """Write a new camera file.

    Raises
    ------
    InputError
        The calibration could not be read again, there is such a file already, or it cannot be
        written.
    """
    text = format_camera(calibration)
    parse_camera(text, path)
    data = text.encode()
    if len(data) > MAX_CAMERA_BYTES:
        raise InputError(f"{place(path)}: larger than what is read ({MAX_CAMERA_BYTES / 1e6:g} MB)")
    create_whole(path, data)


def _fiducials(root: TomlTable, reach: tuple[float, float]) -> tuple[Fiducial, ...]:
    table = root.table("fiducials", "[fiducials]")
    if "fiducials" in root and not table.key_names():
        raise root.fail("fiducials", "[fiducials] is empty")
    if len(table.key_names()) > _MAX_FIDUCIALS:
        raise root.fail("fiducials", f"more than {_MAX_FIDUCIALS} fiducials")
    marks: list[Fiducial] = []
    for name in table.key_names():
        fault = name_fault(name)
        if fault is not None:
            raise table.fail(name, f"fiducial: the name {quoted(name)} {fault}")
        x, y = table.numbers(name, 2)
        # fiducials stand at the edge, some outside what the frame exposes
        if abs(x) > reach[0] or abs(y) > reach[1]:
            raise table.fail(name, f"fiducial {quoted(name)} lies far outside the format")
        twin = next((mark for mark in marks if (mark.x, mark.y) == (x, y)), None)
        if twin is not None:
            raise table.fail(
                name, f"fiducial {quoted(name)} has the same place as {quoted(twin.id)}"
            )
        marks.append(Fiducial(name, x, y))
    return tuple(marks)


def _distances(table: TomlTable) -> tuple[FiducialDistance, ...]:
    shape = 'mm must hold distances ["name", "name", mm]'
    rows = table.raw("mm")
    if not isinstance(rows, list) or not all(isinstance(row, list) for row in rows):
        raise table.fail("mm", f"{shape}, not {_wrong_type(rows)}")
    if len(rows) < 2:
        raise table.fail("mm", "two distances at least: one along x, one along y")
    if len(rows) > _MAX_FIDUCIALS:
        raise table.fail("mm", f"more than {_MAX_FIDUCIALS} distances")
    found: list[FiducialDistance] = []
    for index, row in enumerate(rows):
        if len(row) != 3:
            raise table.fail("mm", f"{shape}, this one has {len(row)} items", index)
        first = table.name_at("mm", row[0], index)
        second = table.name_at("mm", row[1], index)
        mm = table.number_at("mm", row[2], index)
        if mm <= 0.0:
            raise table.fail("mm", f"the distance {mm:g} must be greater than 0", index)
        if first == second:
            raise table.fail("mm", f"a distance from {quoted(first)} to itself", index)
        if any({first, second} == {d.first, d.second} for d in found):
            raise table.fail(
                "mm", f"the distance between {quoted(first)} and {quoted(second)} twice", index
            )
        found.append(FiducialDistance(first, second, mm))
    return tuple(found)


def _wrong_type(rows: Any) -> str:
    if not isinstance(rows, list):
        return describe_type(rows)
    return describe_type(next(row for row in rows if not isinstance(row, list)))


def _radial(table: TomlTable) -> RadialPolynomial | RadialTable | None:
    if "radial" in table and "table" in table:
        raise table.fail("table", "table beside radial: only one of them")
    if "radial" in table:
        k0, k1, k2, k3 = table.numbers("radial", 4)
        return RadialPolynomial((k0, k1, k2, k3))
    if "table" not in table:
        return None
    rows = table.raw("table")
    if not isinstance(rows, list) or not all(isinstance(row, list) for row in rows):
        raise table.fail("table", f"table must hold pairs [mm, um], not {_wrong_type(rows)}")
    if not rows:
        raise table.fail("table", "table is empty")
    if len(rows) > _MAX_TABLE:
        raise table.fail("table", f"more than {_MAX_TABLE} radii")
    radius: list[float] = []
    dr: list[float] = []
    for index, row in enumerate(rows):
        if len(row) != 2:
            raise table.fail("table", f"a pair [mm, um], this one has {len(row)} items", index)
        r, um = (table.number_at("table", item, index) for item in row)
        if r < 0.0 or (radius and r <= radius[-1]):
            raise table.fail("table", f"radius {r:g}: radii must grow from 0 on", index)
        if r == 0.0 and um != 0.0:
            raise table.fail("table", "the distortion at radius 0 must be 0", index)
        radius.append(r)
        dr.append(um)
    return RadialTable(tuple(radius), tuple(dr))
