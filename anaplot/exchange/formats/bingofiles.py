"""Files of BINGO: image coordinates, geoin and itera.

    image file   photo camera; point x y [mm, from the middle of the image]; -99 or a blank line
    geoin        CAPA camera . c x0 y0;  CONT id E N H;  CHCK id E N H;  ECCA camera e n h
    itera        ORIA photo X Y Z a b c flag [gon];  CORD id X Y Z

Lines that begin with * or C and a blank are comments. a, b, c are the angles of one of ORDERS: the
factors of the rotation from image to ground, the primary one first, which phi is as a rule.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import suppress
from math import asin, atan2, hypot, pi
from pathlib import Path
from typing import NamedTuple

from anaplot.aliases import Array
from anaplot.errors import InputError
from anaplot.exchange.formats.door import Note
from anaplot.exchange.formats.gathered import MAX_TABLE_BYTES, ground_number, head_of, number
from anaplot.exchange.formats.sourcelines import SourceLine, source_lines, value_of
from anaplot.photogrammetry.rotation import rotation_angles, rotation_matrix
from anaplot.textfiles.wording import place, plain, quoted

__all__ = [
    "GON",
    "ORDERS",
    "XYZ",
    "Geoin",
    "Itera",
    "PhotoRows",
    "angles_in",
    "known_cameras",
    "looks_like_images",
    "read_geoin",
    "read_images",
    "read_itera",
    "turned_by",
]

GON = pi / 200.0
ORDERS = ("phi-omega-kappa", "kappa-omega-phi", "omega-phi-kappa")
"""The factors of the rotation from image to ground, usually R2(phi) R1(omega) R3(kappa); a, b, c
are phi, omega, kappa, but of the last, our own, omega, phi, kappa."""

_LOOK = 4000  # bytes that are looked at
_SMALL = 10.0  # a camera's number is smaller, a camera constant is not
XYZ = tuple[float, float, float]


class PhotoRows(NamedTuple):
    """A photo, its camera, and its points with their image coordinates [mm]."""

    line: SourceLine
    photo: str
    camera: str
    points: list[tuple[SourceLine, str, float, float]]


class Geoin(NamedTuple):
    """c, x0, y0 [mm] of cameras, control and check points [m]."""

    cameras: dict[str, tuple[float, float, float]]
    control: list[tuple[str, XYZ]]
    check: list[tuple[str, XYZ]]


class Itera(NamedTuple):
    """Positions [m] and angles a, b, c [rad] of photos, and object points [m]."""

    positions: dict[str, XYZ]
    angles: dict[str, XYZ]
    points: dict[str, XYZ]


def turned_by(order: str, a: float, b: float, c: float) -> Array:
    """Return the (3, 3) rotation from image to ground of angles [rad] in one of `ORDERS`."""
    if order == ORDERS[2]:
        return rotation_matrix(a, b, c)
    if order == ORDERS[1]:
        last: Array = rotation_matrix(0.0, 0.0, c) @ rotation_matrix(b, a, 0.0)
        return last
    first: Array = rotation_matrix(0.0, a, 0.0) @ rotation_matrix(b, 0.0, c)
    return first


def angles_in(order: str, rotation: Array) -> tuple[float, float, float]:
    """Return the angles [rad] of `turned_by`; phi or omega is 0 where it is not determined."""
    if order == ORDERS[2]:
        return rotation_angles(rotation)
    if order == ORDERS[1]:  # the transpose has the same angles with the other sign
        phi, omega, kappa = angles_in(ORDERS[0], rotation.T)
        return -phi, -omega, -kappa
    (r00, r01, r02), (r10, r11, r12), (_, _, r22) = rotation.tolist()
    flat = hypot(r10, r11)
    omega = atan2(-r12, flat) if abs(r12) < 1.0 else asin(max(-1.0, min(1.0, -r12)))
    if flat < 1e-12:
        return 0.0, omega, atan2(-r01, r00)
    return atan2(r02, r22), omega, atan2(r10, r11)


def looks_like_images(path: Path, cameras: Collection[str] = ()) -> bool:
    """Return whether a file begins as an image file does.

    Parameters
    ----------
    path
        The file.
    cameras
        Names of cameras that a geoin knows: what begins with one of them is no camera constant.
    """
    head = head_of(path, _LOOK)
    lines = head.splitlines()
    if len(head) > _LOOK // 2 and len(lines) > 1:
        lines.pop()  # it may be cut
    inside = ended = False
    for line in lines:
        fields = line.split()
        if _ends(fields):
            ended |= inside
            inside = False
        elif _is_comment(line):
            continue
        elif inside:
            return len(fields) >= 3 and None not in map(value_of, fields[1:3])
        elif len(fields) != 2 or not (fields[1] in cameras or _of_camera(*fields)):
            return False
        else:
            inside = True
    return ended


def _of_camera(photo: str, camera: str) -> bool:
    """Whether these are rather a photo and its camera than a camera constant, or fields of CSV."""
    value = value_of(camera)
    number = value is None or (value.is_integer() and 0.0 < value < _SMALL)
    return number and "," not in photo


def _ends(fields: list[str]) -> bool:
    return not fields or fields[0] in ("-99", "-99.")


def known_cameras(path: Path) -> set[str]:
    """Return the names of cameras that a geoin has, as far as it can be read."""
    found = set()
    with suppress(InputError):  # who reads it says what is wrong
        for _, fields in _records(path):
            if fields[0].upper() == "CAPA" and len(fields) > 1:
                found.add(fields[1])
    return found


def read_images(path: Path, notes: list[Note]) -> list[PhotoRows]:
    """Read an image file; raises InputError."""
    photos: list[PhotoRows] = []
    seen: dict[str, int] = {}
    inside, more = False, 0
    for line in source_lines(path, MAX_TABLE_BYTES):
        fields = line.text.split()
        if _ends(fields):
            inside = False
        elif _is_comment(line.text):
            continue
        elif not inside:
            if len(fields) != 2:
                what = f"{len(fields)} fields, where a photo and its camera are expected"
                raise line.fail(f"{what}: after -99 or a blank line there is the next photo")
            name, camera = line.name_of(fields[0], "photo"), line.name_of(fields[1], "camera")
            if seen.setdefault(name, line.number) != line.number:
                raise line.fail(f"photo {quoted(name)} twice (first in line {seen[name]})")
            photos.append(PhotoRows(line, name, camera, []))
            inside = True
        else:
            if len(fields) < 3:
                last = quoted(photos[-1].photo)
                raise line.fail(f"a point has a name, x and y: is the -99 of photo {last} missing?")
            x, y = (number(line, text, "x and y") for text in fields[1:3])
            photos[-1].points.append((line, line.name_of(fields[0], "point"), x, y))
            more += len(fields) > 3
    if not photos:
        raise InputError(f"{place(path)}: no photo")
    if inside:
        text = f"photo {photos[-1].photo} ends with the file, without -99"
        notes.append(Note("assumed", None, text))
    if more:
        notes.append(Note("dropped", more, "rows with further columns: these"))
    notes.append(Note("assumed", None, "image coordinates are in mm, y up"))
    return photos


def read_geoin(path: Path, notes: list[Note]) -> Geoin:
    """Read a geoin; what is neither camera nor control is told; raises InputError."""
    cameras: dict[str, tuple[float, float, float]] = {}
    points: dict[str, list[tuple[str, XYZ]]] = {"CONT": [], "CHCK": []}
    seen: set[str] = set()
    others: dict[str, int] = {}
    more = 0
    for line, fields in _records(path):
        word = fields[0].upper()
        if word == "CAPA":
            if len(fields) < 6:
                raise line.fail(f"{len(fields)} fields, where CAPA camera . c x0 y0 are expected")
            name = line.name_of(fields[1], "camera")
            c, x0, y0 = (number(line, text, "c, x0 and y0") for text in fields[3:6])
            if name in cameras:
                raise line.fail(f"CAPA of camera {quoted(name)} twice")
            if not c > 0.0:
                raise line.fail(f"the camera constant must be greater than 0, not {c:g}")
            cameras[name] = c, x0, y0
            more += len(fields) > 6
        elif word in points:
            if len(fields) < 5:
                raise line.fail(f"{len(fields)} fields, where {word} id E N H are expected")
            name = line.name_of(fields[1], "point")
            if name in seen:
                raise line.fail(f"point {quoted(name)} twice")
            seen.add(name)
            points[word].append((name, _xyz(line, fields[2:5])))
            more += len(fields) > 5
        else:
            others[word] = others.get(word, 0) + 1
    _tell(others, more, path, notes)
    return Geoin(cameras, points["CONT"], points["CHCK"])


def read_itera(path: Path, notes: list[Note]) -> Itera:
    """Read an itera; raises InputError."""
    found = Itera({}, {}, {})
    others: dict[str, int] = {}
    for line, fields in _records(path):
        word = fields[0].upper()
        if word not in ("ORIA", "CORD"):
            others[word] = others.get(word, 0) + 1
            continue
        what = "ORIA photo X Y Z a b c" if word == "ORIA" else "CORD id X Y Z"
        if len(fields) < (8 if word == "ORIA" else 5):
            raise line.fail(f"{len(fields)} fields, where {what} are expected")
        kind = "photo" if word == "ORIA" else "point"
        name = line.name_of(fields[1], kind)
        places = found.positions if word == "ORIA" else found.points
        if name in places:
            raise line.fail(f"{kind} {quoted(name)} twice")
        places[name] = _xyz(line, fields[2:5])
        if word == "ORIA":
            a, b, c = (number(line, text, "an angle") * GON for text in fields[5:8])
            found.angles[name] = a, b, c
    if found.points:
        text = "object points of the itera: they are computed from the rays"
        notes.append(Note("dropped", len(found.points), text))
    _tell(others, 0, path, notes)
    return found


def _xyz(line: SourceLine, texts: list[str]) -> XYZ:
    x, y, z = (ground_number(line, text, "a coordinate") for text in texts)
    return x, y, z


def _records(path: Path) -> Iterator[tuple[SourceLine, list[str]]]:
    for line in source_lines(path, MAX_TABLE_BYTES):
        if line.text.strip() and not _is_comment(line.text):
            yield line, line.text.split()


def _tell(others: dict[str, int], more: int, path: Path, notes: list[Note]) -> None:
    if others:
        words = tuple(f"{plain(word, 20)} {count}" for word, count in sorted(others.items())[:4])
        text = f"records of {plain(path.name, 60)} of other kinds"
        notes.append(Note("dropped", sum(others.values()), text, words))
    if more:
        notes.append(Note("dropped", more, f"records of {plain(path.name, 60)}: further columns"))


def _is_comment(text: str) -> bool:
    text = text.lstrip()
    return text.startswith(("*", "C ", "C\t")) or text.rstrip() == "C"
