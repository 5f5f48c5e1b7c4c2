"""gcp_list.txt of OpenDroneMap and OpenSfM: control points as they are seen in the images.

The first line is the coordinate system; then `x y z px py image [name] [more]`, what is more being
read over by both programs; a line that begins with # is a remark. z may be NaN. Without a name,
equal coordinates are one point. Degrees have the longitude first, and real files the latitude:
which one lies where the images were taken is looked at.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array
from anaplot.errors import InputError
from anaplot.exchange.formats.crs import CoordinateSystem, GroundFrame, crs_text, local_system
from anaplot.exchange.formats.door import Note
from anaplot.exchange.formats.sourcelines import SourceLine, source_lines
from anaplot.photogrammetry.groundsystem import GroundSystem
from anaplot.textfiles.wording import place, quoted

__all__ = [
    "GCP_LIST",
    "GcpList",
    "GcpRow",
    "PlacedControl",
    "elsewhere_note",
    "place_control",
    "read_gcp_list",
]

GCP_LIST = "gcp_list.txt"
_MAX_BYTES = 50_000_000
_EXAMPLES = 4
_HIGHEST = 1e5  # m, of control on the ground
_FAR = 50_000.0  # m, from the images' origin
_CLEAR = 3.0  # times nearer that the other order must bring the points to the images


class GcpRow(NamedTuple):
    """A line of the list.

    Attributes
    ----------
    line
        Where it stands.
    xyz
        As the file has them; z NaN where it is not known.
    pixel
        From the upper left corner of the image.
    image
        Its name.
    name
        The point's, or None.
    """

    line: SourceLine
    xyz: tuple[float, float, float]
    pixel: tuple[float, float]
    image: str
    name: str | None


class GcpList(NamedTuple):
    """A list.

    Attributes
    ----------
    system
        Its first line.
    rows
        Its measurements in file order.
    elsewhere
        Lines of images that are not known.
    """

    system: SourceLine
    rows: tuple[GcpRow, ...]
    elsewhere: tuple[SourceLine, ...]

    def points(self) -> dict[str, tuple[float, float, float]]:
        """Return coordinates by name, in file order; points without one are gcp1, gcp2, ...

        Raises
        ------
        InputError
            A name with two places.
        """
        out: dict[str, tuple[float, float, float]] = {}
        for row, name in zip(self.rows, self.names(), strict=True):
            known = out.setdefault(name, row.xyz)
            if _key(known) != _key(row.xyz):
                text = f"point {quoted(name)} has other coordinates before"
                more = not row.line.text.rstrip().endswith(name)
                raise row.line.fail(f"{text}; a name ends at a blank" if more else text)
        return out

    def names(self) -> list[str]:
        """Return the point of every row."""
        taken = {row.name for row in self.rows}
        made: dict[tuple[float, ...], str] = {}
        out, number = [], 0
        for row in self.rows:
            if row.name is None and _key(row.xyz) not in made:
                number += 1
                while f"gcp{number}" in taken:
                    number += 1
                made[_key(row.xyz)] = f"gcp{number}"
            out.append(made[_key(row.xyz)] if row.name is None else row.name)
        return out


def _key(xyz: tuple[float, float, float]) -> tuple[float, ...]:
    return tuple(-1e99 if math.isnan(value) else value for value in xyz)


def read_gcp_list(path: Path, images: Collection[str]) -> GcpList:
    """Read a list.

    Parameters
    ----------
    path
        The file.
    images
        Names of the photos that there are.

    Raises
    ------
    InputError
        The file cannot be read, or a line is wrong.
    """
    system: SourceLine | None = None
    rows, elsewhere = [], []
    for line in source_lines(path, _MAX_BYTES):
        text = line.text.strip()
        if not text or text.startswith("#"):
            continue
        if system is None:
            system = line._replace(text=text.partition("#")[0].strip())
            try:
                crs_text(system.text)
            except InputError as error:
                raise line.fail(str(error)) from None
            continue
        row = _row(line, images)
        if row is None:
            elsewhere.append(line)
        else:
            rows.append(row)
    if system is None:
        raise InputError(f"{place(path)}: no line says the coordinate system")
    return GcpList(system, tuple(rows), tuple(elsewhere))


def _row(line: SourceLine, images: Collection[str]) -> GcpRow | None:
    """Return a row, or None of an image that is not known."""
    words = line.text.split(maxsplit=5)
    if len(words) < 6:
        raise line.fail(f"{len(words)} fields: x y z px py image [name] expected")
    x, y = line.ground_of(words[:2], "a coordinate")
    z = math.nan if words[2].lower() == "nan" else line.ground_of(words[2:3], "a height")[0]
    px, py = line.numbers_of(words[3:5], "a pixel")
    rest = words[5].split()
    # names of images may have blanks
    for count in range(1, min(len(rest), 12) + 1):
        image = " ".join(rest[:count])
        if image in images:
            name = line.name_of(rest[count], "point") if len(rest) > count else None
            return GcpRow(line, (x, y, z), (px, py), image, name)
    return None


def elsewhere_note(found: GcpList, images: Collection[str]) -> Note:
    """Return what is told of lines of images that are not known, with a like name where one is."""
    names = [_image_of(line) for line in found.elsewhere]
    text = f"lines of {GCP_LIST} of images without a pose here"
    alike = {_bare(image): image for image in images} | {
        image.casefold(): image for image in images
    }
    keys = [key for name in names for key in (name.casefold(), _bare(name))]
    near = next((alike[key] for key in keys if key in alike), None)
    if near is not None:
        text += f"; there is {quoted(near)}, and names must be the same letter by letter"
    if not found.rows:
        text += "; no other line is left: there is no control"
    some = zip(found.elsewhere[:_EXAMPLES], names, strict=False)
    examples = tuple(f"line {line.number}: {name}" for line, name in some)
    return Note("dropped", len(found.elsewhere), text, examples)


def _image_of(line: SourceLine) -> str:
    """Return what is probably the name of an image: up to the first word with a point."""
    rest = line.text.split(maxsplit=5)[5].split()
    end = next((k for k, word in enumerate(rest) if "." in word), 0)
    return " ".join(rest[: end + 1])


def _bare(image: str) -> str:
    """Return a name without folders and ending, in small letters."""
    return (
        image.replace("\\", "/").rpartition("/")[2].rpartition(".")[0].casefold()
        or image.casefold()
    )


class PlacedControl(NamedTuple):
    """Control in the block's frame.

    Attributes
    ----------
    ground
        The frame.
    xyz
        By name [m]; NaN for a height that is not known.
    notes
        What was assumed.
    by_reference
        Whether the frame is that of the images' origin; else it lies amid the control.
    """

    ground: GroundSystem
    xyz: dict[str, tuple[float, float, float]]
    notes: tuple[Note, ...]
    by_reference: bool


def place_control(
    found: GcpList,
    reference: tuple[float, float, float] | None,
    centres: Sequence[tuple[float, float, float]],
    order: str | None,
) -> PlacedControl:
    """Return control in the local frame of the images' origin.

    Parameters
    ----------
    found
        The list, of at least one row.
    reference
        Longitude, latitude [degrees] and height [m] of the origin; None, or where most points lie
        beyond 50 km from it: that of the points.
    centres
        Positions of the images in that frame [m].
    order
        "lonlat" or "latlon" where a person says how degrees stand; None: looked at.

    Raises
    ------
    InputError
        No such coordinate system, no pyproj, a coordinate that is no place.
    """
    try:
        theirs = CoordinateSystem.of(found.system.text)
    except InputError as error:
        raise found.system.fail(str(error)) from None
    points = found.points()
    if theirs.kind != "geocentric":
        for row in found.rows:
            if abs(row.xyz[2]) * theirs.height_m > _HIGHEST:
                raise row.line.fail(f"a height of {row.xyz[2]:g} is no place on earth")
    xyz = np.array(list(points.values()), dtype=float)
    notes = []
    unknown = np.isnan(xyz[:, 2])
    known_heights = xyz[~unknown, 2]
    if len(known_heights):
        fill = float(known_heights.mean())
    else:
        fill = 0.0 if reference is None else reference[2] / theirs.height_m
    if unknown.any():
        text = f"points without a height: put into the frame at {fill:.10g}, their Z left out"
        names = tuple(name for name, out in zip(points, unknown, strict=True) if out)
        notes.append(Note("assumed", int(unknown.sum()), text, names))
    xyz[unknown, 2] = fill
    if theirs.kind == "geographic":
        xyz, said = _ordered(theirs, xyz, reference, centres, order)
        notes.append(said)
    elif order is not None:
        raise found.system.fail("--order is of degrees, and this is another system")
    try:
        ground, placed, away = _local(theirs, xyz, reference)
        by_reference = reference is not None and float(np.median(away)) <= _FAR
        if reference is None:
            notes.append(Note("assumed", None, "no reference_lla: the origin is amid the control"))
        elif not by_reference:
            text = f"the control lies {_km(float(np.median(away)))} from the images' origin"
            ground, placed, away = _local(theirs, xyz, None)
            notes.append(Note("changed", None, f"{text}: the origin is amid the control instead"))
    except InputError as error:
        raise found.system.fail(str(error)) from None
    if not theirs.stated_heights:
        text = "heights are taken as ellipsoidal ones [m]: where they are not, the geoid stays in Z"
        notes.append(Note("assumed", None, text))
    elif theirs.sea:
        text = f"heights of {theirs.sea} are kept as they are: the geoid stays in Z"
        notes.append(Note("assumed", None, text))
    if (away > _FAR).any():
        names = tuple(name for name, far in zip(points, away > _FAR, strict=True) if far)
        text = f"control points up to {_km(float(away.max()))} from the origin"
        notes.append(Note("assumed", len(names), text, names[:_EXAMPLES]))
    placed[unknown, 2] = math.nan
    rows = zip(points, placed.tolist(), strict=True)
    xyz_of = {name: (x, y, z) for name, (x, y, z) in rows}
    return PlacedControl(ground, xyz_of, tuple(notes), by_reference)


def _local(
    theirs: CoordinateSystem, xyz: Array, reference: tuple[float, float, float] | None
) -> tuple[GroundSystem, Array, Array]:
    """Return the frame at a place, or amid points, these in it, and their distances in plan [m]."""
    if reference is None:
        degrees = theirs.shifted(theirs.degrees(xyz), to_wgs84=True)
        lon, lat, height = degrees.mean(axis=0).tolist()
        reference = (lon, lat, height)
    ground = local_system(theirs.text, reference)
    placed = GroundFrame.of(ground).into_block(xyz)
    return ground, placed, np.linalg.norm(placed[:, :2], axis=1)


def _ordered(
    theirs: CoordinateSystem,
    xyz: Array,
    reference: tuple[float, float, float] | None,
    centres: Sequence[tuple[float, float, float]],
    order: str | None,
) -> tuple[Array, Note]:
    """Return coordinates with the longitude first, and what was done."""
    swapped = xyz[:, [1, 0, 2]]
    if order is not None:
        if order not in ("lonlat", "latlon"):
            raise InputError(f"--order {order}: lonlat or latlon")
        return (
            (xyz, Note("assumed", None, "longitude first, as asked for"))
            if order == "lonlat"
            else (swapped, Note("changed", None, "latitude first, as asked for: turned round"))
        )
    as_said = _distance(theirs, xyz, reference, centres)
    turned = _distance(theirs, swapped, reference, centres)
    if reference is None and math.isfinite(as_said):
        return xyz, Note("assumed", None, "longitude first, as documented: no image has a place")
    if turned * _CLEAR < as_said:
        text = f"latitude first, against the documentation: {_km(turned)} from the images instead"
        return swapped, Note("changed", None, f"{text} of {_km(as_said)}, so turned round")
    text = f"longitude first, as documented: {_km(as_said)} from the images"
    return xyz, Note("assumed", None, f"{text}; the other way {_km(turned)}")


def _distance(
    theirs: CoordinateSystem,
    xyz: Array,
    reference: tuple[float, float, float] | None,
    centres: Sequence[tuple[float, float, float]],
) -> float:
    """Return the median distance [m] of points from the middle of the images; inf: no place."""
    try:
        if reference is None:
            theirs.geocentric(xyz)
            return 0.0
        local = GroundFrame.of(local_system(theirs.text, reference)).into_block(xyz)
    except InputError:
        return math.inf
    middle = np.mean(np.array(centres)[:, :2], axis=0) if len(centres) else np.zeros(2)
    return float(np.median(np.linalg.norm(local[:, :2] - middle, axis=1)))


def _km(metres: float) -> str:
    return "no place on earth" if math.isinf(metres) else f"{metres / 1000.0:.1f} km"
