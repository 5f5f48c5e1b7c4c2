"""Files of the PAT-B family: .im, .con and .ori, and those of the -99 files in use.

A list ends with -99. Of an image file: photos with their camera constant, then points; where it
begins with four numbers, photos carry 0 and the last of a strip is negative.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array
from anaplot.errors import InputError
from anaplot.exchange.formats.gathered import MAX_TABLE_BYTES, fields_of, ground_number, number
from anaplot.exchange.formats.sourcelines import SourceLine, source_lines
from anaplot.photogrammetry.rotation import is_rotation, rotation_angles
from anaplot.textfiles.wording import place, quoted

__all__ = [
    "SENSES",
    "CameraLine",
    "Control",
    "ImageFile",
    "Orientation",
    "PhotoRows",
    "PointRow",
    "is_end",
    "read_camera_lines",
    "read_control",
    "read_images",
    "read_orientations",
    "unit_of_project",
]

SENSES = ("image-to-ground", "ground-to-image")
"""What the matrix of an .ori takes to what; the first is our R."""

_END = re.compile(r"-99(\.0*)?")
_PHOTO = 2
_ORTHONORMAL = 1e-6
_GROUPS = 100  # a group is a small whole number
_COLUMNS = (12, 26, 40)  # I12, 2F14.4


class PointRow(NamedTuple):
    """A point of a photo, as it is written."""

    line: SourceLine
    point: str
    x: str
    y: str
    group: str | None


class PhotoRows(NamedTuple):
    """A photo, its camera constant as it is written, its points, whether it ends a strip."""

    line: SourceLine
    photo: str
    c: str
    points: list[PointRow]
    last: bool


class ImageFile(NamedTuple):
    """An image file; `header` says that it begins with four numbers, as the -99 files in use do."""

    photos: list[PhotoRows]
    header: bool
    beside: int


class Control(NamedTuple):
    """Ground coordinates [m] of a point, None where none are known, and the groups it is in."""

    point: str
    xyz: tuple[float | None, float | None, float | None]
    groups: tuple[str, ...]


class Orientation(NamedTuple):
    """A photo's projection centre [m] and omega, phi, kappa [rad]."""

    photo: str
    position: tuple[float, float, float]
    rotation: tuple[float, float, float]


class CameraLine(NamedTuple):
    """Camera constant, principal point and format [mm] of a camera file."""

    c: float
    principal: tuple[float, float]
    format: tuple[float, float] | None


def is_end(field: str) -> bool:
    """Return whether a field is the -99 that ends a list."""
    return _END.fullmatch(field) is not None


def read_images(path: Path) -> ImageFile:
    """Read an image file.

    Raises
    ------
    InputError
        What is wrong, with file and line; a photo without its -99.
    """
    photos: list[PhotoRows] = []
    seen: dict[str, int] = {}
    header, beside, inside, first = False, 0, False, True
    for line, fields in _content(path):
        if first and len(fields) == 4:
            line.numbers_of(fields, "a number of the header")
            header, first = True, False
            continue
        first = False
        if is_end(fields[0]):
            inside = False
        elif not inside:
            photos.append(_photo(line, fields))
            name = photos[-1].photo
            if seen.setdefault(name, line.number) != line.number:
                raise line.fail(f"photo {quoted(name)} twice (first in line {seen[name]})")
            inside = True
        else:
            row, more = _point(line, fields, photos[-1].photo, fixed=header)
            photos[-1].points.append(row)
            beside += more
    if inside:
        raise InputError(f"{place(path)}: photo {quoted(photos[-1].photo)} has no -99 at its end")
    if not photos:
        raise InputError(f"{place(path)}: no photo")
    return ImageFile(photos, header, beside)


def read_control(path: Path, *, codes: bool = False) -> tuple[list[Control], str | None]:
    """Read a control file.

    Parameters
    ----------
    path
        The file.
    codes
        Whether the last column is the code of the -99 files in use.

    Returns
    -------
    list[Control]
        In file order.
    str or None
        What was assumed of a fourth column, or None.

    Raises
    ------
    InputError
        What is wrong, with file and line; a list without its -99.
    """
    lists: list[list[tuple[SourceLine, list[str]]]] = [[]]
    closed = False
    for line, fields in _content(path):
        closed = is_end(fields[0])
        if closed:
            lists.append([])
        else:
            lists[-1].append((line, fields))
    if not closed:
        raise InputError(f"{place(path)}: no -99 at the end of the last list")
    plan, heights = lists[0], lists[1]
    if any(lists[2:]):
        raise lists[2][0][0].fail("a third list: after plan and heights there is none")
    found: dict[str, tuple[list[float | None], list[str]]] = {}
    grouped = _fourth_is_group(plan)
    for line, fields in plan:
        _plan_row(line, fields, found, grouped=grouped, codes=codes)
    for line, fields in heights:
        _height_row(line, fields, found)
    four = any(len(fields) == 4 for _, fields in plan)
    told = None
    if four:
        told = "the fourth column is a group" if grouped else "the fourth column is Z"
    made = [Control(p, (c[0], c[1], c[2]), tuple(groups)) for p, (c, groups) in found.items()]
    return made, told


def read_orientations(path: Path, order: str | None) -> tuple[list[Orientation], str, bool]:
    """Read an .ori: three records a photo, (I16,16X,3F16.5), (5F16.12), (4F16.12).

    Parameters
    ----------
    path
        The file.
    order
        One of `SENSES`, or None: what the file's comment says, else the first.

    Returns
    -------
    list[Orientation]
        In file order.
    str
        The sense that they were read in.
    bool
        Whether somebody said it.

    Raises
    ------
    InputError
        What is wrong, with file and line; a matrix that is no rotation.
    """
    said, records = None, list[SourceLine]()
    for line in source_lines(path, MAX_TABLE_BYTES):
        if line.text.lstrip().startswith("#"):
            words = line.text.lower().replace("-", " ")
            said = next((s for s in SENSES if s.replace("-", " ") in words), said)
        elif line.text.strip():
            records.append(line)
    if order is not None and said is not None and order != said:
        raise InputError(f"--order {order}: {place(path)} says {said} itself")
    sense = order or said or SENSES[0]
    if len(records) % 3:
        raise records[-1].fail("a photo has three records: the file is cut")
    out: dict[str, Orientation] = {}
    for first, second, third in zip(records[::3], records[1::3], records[2::3], strict=True):
        name, *texts = _fixed(first)
        photo = first.name_of(name, "photo")
        if photo in out:
            raise first.fail(f"photo {quoted(photo)} twice")
        x, y, z = (ground_number(first, text, "a coordinate") for text in texts)
        elements = _numbers(second, 5) + _numbers(third, 4)
        matrix = np.array(elements).reshape(3, 3)
        if not is_rotation(matrix, _ORTHONORMAL):
            raise second.fail(f"the matrix of photo {quoted(photo)} is no rotation")
        u, _, vt = np.linalg.svd(matrix)
        turned: Array = u @ vt
        rotation = rotation_angles(turned if sense == SENSES[0] else turned.T)
        out[photo] = Orientation(photo, (x, y, z), rotation)
    return list(out.values()), sense, order is not None or said is not None


def read_camera_lines(path: Path) -> CameraLine:
    """Read a camera file of the -99 files in use; raises InputError.

    A header; camera constant and principal point; three zeros; four frame corners; -99.
    """
    rows = [(line, fields) for line, fields in _content(path)]
    if len(rows) < 2 or not is_end(rows[-1][1][0]):
        raise InputError(f"{place(path)}: no -99 at the end: no camera file")
    of = next(((a, b) for a, b in rows[1:] if len(b) == 3), None)
    if of is None:
        raise InputError(f"{place(path)}: no line with camera constant and principal point")
    line, fields = of
    c, x0, y0 = (number(line, text, "c, x0 and y0") for text in fields)
    if not c > 0.0:
        raise line.fail(f"the camera constant must be greater than 0, not {c:g}")
    after = rows[rows.index(of) + 2 : -1]
    corners = [[number(a, text, "a frame corner") for text in b[-2:]] for a, b in after]
    frame = None
    if len(corners) == 4:
        xs, ys = (
            max(abs(corner[k] - centre) for corner in corners) for k, centre in ((0, x0), (1, y0))
        )
        frame = (2.0 * xs, 2.0 * ys) if xs > 0.0 and ys > 0.0 else None
    return CameraLine(c, (x0, y0), frame)


def unit_of_project(path: Path) -> str | None:
    """Return the unit, um or mm, that a .pro names; None where it names none, or both."""
    text = " ".join(line.text.lower() for line in source_lines(path, 1_000_000))
    words = set(re.findall(r"[a-zµμ]+", text))
    um = bool(words & {"um", "µm", "μm", "micron", "microns", "micrometer", "micrometers"})
    mm = bool(words & {"mm", "millimeter", "millimeters"})
    return ("um" if um else "mm") if um != mm else None


def _content(path: Path) -> Iterator[tuple[SourceLine, list[str]]]:
    for line in source_lines(path, MAX_TABLE_BYTES):
        fields = fields_of(line)
        if fields:
            yield line, fields


def _photo(line: SourceLine, fields: list[str]) -> PhotoRows:
    if len(fields) > _PHOTO:
        raise line.fail(
            f"{len(fields)} fields, where a photo and its camera constant are expected: "
            f"after -99 there is the next photo"
        )
    name, last = fields[0], False
    if re.fullmatch(r"-\d+", name):
        name, last = name[1:], True
    c = fields[1] if len(fields) == _PHOTO else "0"
    number(line, c, "the camera constant")
    return PhotoRows(line, line.name_of(name, "photo"), c, [], last)


def _point(
    line: SourceLine, fields: list[str], photo: str, *, fixed: bool
) -> tuple[PointRow, bool]:
    text = line.text
    if len(fields) < 3 and fixed and len(text.rstrip()) > _COLUMNS[1]:
        a, b, c = _COLUMNS
        fields = [text[:a].strip(), text[a:b].strip(), text[b:c].strip()]
    if len(fields) < 3 or not all(fields):
        raise line.fail(
            f"a point has a name, x and y: is the -99 of photo {quoted(photo)} missing?"
        )
    point, x, y, *more = fields
    for what, value in (("x", x), ("y", y)):
        number(line, value, what)
    row = PointRow(line, line.name_of(point, "point"), x, y, more[0] if more else None)
    return row, len(more) > 1


def _is_group(text: str) -> bool:
    return text.isdecimal() and text.isascii() and len(text) <= 2 and int(text) < _GROUPS


def _fourth_is_group(plan: list[tuple[SourceLine, list[str]]]) -> bool:
    four = [fields[3] for _, fields in plan if len(fields) == 4]
    return bool(four) and all(map(_is_group, four))


def _plan_row(
    line: SourceLine,
    fields: list[str],
    found: dict[str, tuple[list[float | None], list[str]]],
    *,
    grouped: bool,
    codes: bool,
) -> None:
    count = len(fields)
    if not 3 <= count <= 5:
        raise line.fail(f"{count} fields, where point, X, Y, perhaps Z and a group are expected")
    point = line.name_of(fields[0], "point")
    if point in found:
        raise line.fail(f"point {quoted(point)} twice")
    x, y = (ground_number(line, text, "a coordinate") for text in fields[1:3])
    z = None
    if count == 5 or (count == 4 and not grouped):
        z = ground_number(line, fields[3], "Z")
    last = fields[-1] if count == 5 or (count == 4 and grouped) else None
    if codes and count == 5 and last != "3":
        raise line.fail(f"code {quoted(fields[4])}: only 3, full control, is known")
    found[point] = ([x, y, z], [last] if last is not None and not codes else [])


def _height_row(
    line: SourceLine, fields: list[str], found: dict[str, tuple[list[float | None], list[str]]]
) -> None:
    if not 2 <= len(fields) <= 3:
        raise line.fail(f"{len(fields)} fields, where point, Z and perhaps a group are expected")
    point = line.name_of(fields[0], "point")
    z = ground_number(line, fields[1], "Z")
    xyz, groups = found.setdefault(point, ([None, None, None], []))
    if xyz[2] is not None:
        raise line.fail(f"point {quoted(point)} has a height already")
    xyz[2] = z
    groups += fields[2:]


def _fixed(line: SourceLine) -> list[str]:
    """Return the fields of a record by its columns; by its blanks, where they differ."""
    text = line.text.rstrip()
    cut = [text[k : k + 16].strip() for k in range(0, 80, 16)]
    if not cut.pop(1) and all(cut) and not text[80:]:
        return cut
    fields = text.split()
    if len(fields) != 4:
        raise line.fail("no record (I16,16X,3F16.5): photo, X, Y, Z")
    return fields


def _numbers(line: SourceLine, count: int) -> list[float]:
    text = line.text.rstrip()
    cut = [text[16 * k : 16 * k + 16].strip() for k in range(count)]
    if len(text) > 16 * count or not all(cut):
        cut = text.split()
    if len(cut) != count:
        raise line.fail(f"no record ({count}F16.12)")
    return [number(line, field, "an element of the matrix") for field in cut]
