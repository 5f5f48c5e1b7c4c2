"""Files of BINGO: image coordinates, geoin and itera.

    image file   photo camera; point x y [mm, from the middle of the image]; -99 or a blank line
    geoin        CAPA camera . c x0 y0;  CONT id E N H;  CHCK id E N H;  ECCA camera e n h
    itera        ORIA photo X Y Z a b c flag [gon];  CORD id X Y Z

Lines that begin with * or C and a blank are comments. a, b, c are the rotation of BLUH: phi, omega,
kappa of R = R3(kappa) R1(omega) R2(phi), image to ground.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import asin, atan2, hypot, pi
from pathlib import Path
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array
from anaplot.errors import InputError
from anaplot.exchange.formats.door import Note
from anaplot.exchange.formats.gathered import MAX_TABLE_BYTES, head_of, number
from anaplot.exchange.formats.sourcelines import SourceLine, source_lines
from anaplot.photogrammetry.rotation import rotation_angles, rotation_matrix
from anaplot.textfiles.wording import place, plain, quoted

__all__ = [
    "GON",
    "ORDERS",
    "Geoin",
    "PhotoRows",
    "bluh_angles",
    "bluh_rotation",
    "looks_like_images",
    "read_geoin",
    "read_images",
    "read_itera",
]

GON = pi / 200.0
ORDERS = ("phi-omega-kappa", "omega-phi-kappa")
"""What a, b, c are; the second is our own R1(omega) R2(phi) R3(kappa)."""

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


def bluh_rotation(phi: float, omega: float, kappa: float) -> Array:
    """Return the (3, 3) rotation R3(kappa) R1(omega) R2(phi), image to ground."""
    turned: Array = rotation_matrix(0.0, 0.0, kappa) @ rotation_matrix(omega, phi, 0.0)
    return turned


def bluh_angles(rotation: Array) -> tuple[float, float, float]:
    """Return phi, omega, kappa [rad] of `bluh_rotation`; phi is 0 at omega = +-90 degrees."""
    (r00, r01, _), (r10, r11, _), (r20, r21, r22) = rotation.tolist()
    flat = hypot(r20, r22)
    omega = atan2(r21, flat) if abs(r21) < 1.0 else asin(max(-1.0, min(1.0, r21)))
    if flat < 1e-12:
        return 0.0, omega, atan2(r10, r00)
    return atan2(-r20, r22), omega, atan2(-r01, r11)


def looks_like_images(path: Path) -> bool:
    """Return whether a file begins as an image file does."""
    head = head_of(path, _LOOK).splitlines()[:20]
    rows = [line.split() for line in head if line.strip() and not _is_comment(line)][:2]
    if len(rows) < 2 or len(rows[0]) != 2 or len(rows[1]) < 3:
        return False
    camera = _value(rows[0][1])
    if camera is not None and not (camera == int(camera) and 0.0 < camera < _SMALL):
        return False
    return "," not in rows[0][0] and None not in map(_value, rows[1][1:3])


def read_images(path: Path, notes: list[Note]) -> list[PhotoRows]:
    """Read an image file; raises InputError."""
    photos: list[PhotoRows] = []
    seen: dict[str, int] = {}
    inside, more = False, 0
    for line in source_lines(path, MAX_TABLE_BYTES):
        fields = line.text.split()
        if not fields or fields[0] in ("-99", "-99."):
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


def read_itera(path: Path, order: str | None, notes: list[Note]) -> dict[str, tuple[XYZ, XYZ]]:
    """Return positions [m] and omega, phi, kappa [rad] of an itera; raises InputError."""
    out: dict[str, tuple[XYZ, XYZ]] = {}
    others: dict[str, int] = {}
    for line, fields in _records(path):
        if fields[0].upper() != "ORIA":
            others[fields[0].upper()] = others.get(fields[0].upper(), 0) + 1
            continue
        if len(fields) < 8:
            raise line.fail(f"{len(fields)} fields, where ORIA photo X Y Z a b c are expected")
        name = line.name_of(fields[1], "photo")
        if name in out:
            raise line.fail(f"photo {quoted(name)} twice")
        a, b, c = (number(line, text, "an angle") * GON for text in fields[5:8])
        turned = rotation_matrix(a, b, c) if order == ORDERS[1] else bluh_rotation(a, b, c)
        out[name] = _xyz(line, fields[2:5]), rotation_angles(np.asarray(turned))
    if out and order is None:
        text = "rotations of BLUH, phi, omega, kappa in gon (--order omega-phi-kappa for ours)"
        notes.append(Note("assumed", len(out), text))
    _tell(others, 0, path, notes)
    return out


def _xyz(line: SourceLine, texts: list[str]) -> XYZ:
    x, y, z = (number(line, text, "a coordinate") for text in texts)
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


def _value(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None
