"""A block as BlocksExchange 3.2."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import isfinite
from typing import Final

import numpy as np

from anaplot.aliases import Array
from anaplot.errors import InputError
from anaplot.exchange.formats.blocksexchangemodel import HALF
from anaplot.exchange.formats.door import Exporting, Note
from anaplot.exchange.formats.gathered import not_held, rays_that_count
from anaplot.exchange.formats.resulttables import frame_of
from anaplot.exchange.formats.xmlstream import xml_text
from anaplot.photogrammetry.block import Camera, ControlPoint
from anaplot.photogrammetry.groundsystem import GroundSystem
from anaplot.photogrammetry.measuredimage import measured_places
from anaplot.photogrammetry.rotation import rotation_matrix
from anaplot.textfiles.wording import quoted

__all__ = ["written"]

_HELD: Final = ("check", "control sigmas", "lens")
_Rays = dict[str, list[tuple[int, float, float]]]


def written(exporting: Exporting) -> tuple[Iterator[bytes], tuple[Note, ...]]:
    """Return the file in pieces, and what it does not hold.

    Raises
    ------
    InputError
        A camera has no pixels, or a control point X or Y alone: the latter only while written.
    """
    block = exporting.block
    for camera in block.cameras:
        if camera.pixels is None:
            raise InputError(f"camera {quoted(camera.id)} states no pixels")
    kept, notes = rays_that_count(block)
    notes += not_held(block, holds=_HELD)
    off = sum(row.use == "off" for row in block.control)
    uneven = sum(row.sigma[0] != row.sigma[1] for row in block.control)
    for count, text in (
        (off, "control points with use = off: left out"),
        (uneven, "control points with different sX and sY: the larger stands for both"),
    ):
        if count:
            notes.append(Note("not held", count, text))
    if block.ground is not None:
        text = "ground coordinates are written as east, north, up of the block's local frame"
        if block.ground.frame == "offset":
            text = "ground coordinates are written in the system's own values"
        notes.append(Note("changed", None, text))
    number = {photo.id: k for k, photo in enumerate(block.photos)}
    places = measured_places(block, kept, pixels=True) - HALF
    rays: _Rays = {}
    for row, (x, y) in zip(kept, places.tolist(), strict=True):
        rays.setdefault(row.point, []).append((number[row.photo], x, y))
    return _pieces(exporting, rays), tuple(notes)


def _pieces(exporting: Exporting, rays: _Rays) -> Iterator[bytes]:
    block = exporting.block
    origin = np.zeros(3)
    yield b'<?xml version="1.0" encoding="utf-8"?>\n<BlocksExchange version="3.2">\n'
    if block.ground is not None:
        definition, origin = _system(exporting, block.ground)
        yield _lines(
            1,
            "<SpatialReferenceSystems><SRS>",
            f"<Id>0</Id><Name>{definition}</Name><Definition>{definition}</Definition>",
            "</SRS></SpatialReferenceSystems>",
        )
    yield _lines(1, "<Block>", f"<Name>{xml_text(block.name)}</Name>")
    if block.ground is not None:
        yield _lines(1, "<SRSId>0</SRSId>")
    yield _lines(1, "<Photogroups>")
    for camera in block.cameras:
        yield from _group(exporting, camera, origin)
    yield _lines(1, "</Photogroups>", "<ControlPoints>")
    control = [row for row in block.control if row.use != "off"]
    for row in control:
        yield _control(row, rays.get(row.point, []), origin)
    yield _lines(1, "</ControlPoints>", "<TiePoints>")
    known = {row.point for row in control}
    adjusted: Mapping[str, tuple[float, float, float]] = {}
    if exporting.adjusted is not None:
        adjusted = {row.point: row.xyz for row in exporting.adjusted.points}
    for point, mine in rays.items():
        if point not in known:
            yield _tie(point, mine, adjusted.get(point), origin)
    yield _lines(1, "</TiePoints>", "</Block>") + b"</BlocksExchange>\n"


def _system(exporting: Exporting, ground: GroundSystem) -> tuple[str, Array]:
    """Return a definition, and what is added to the block's coordinates for it.

    ENU is of WGS84, whatever the datum in which the origin stands.
    """
    if ground.frame == "offset":
        return xml_text(ground.crs), np.array(ground.origin)
    theirs = frame_of(exporting, ground).theirs
    degrees = theirs.shifted(np.array([ground.origin]), to_wgs84=True)
    ((longitude, latitude, height),) = degrees.tolist()
    return f"ENU:{latitude!r},{longitude!r}", np.array((0.0, 0.0, height))


def _group(exporting: Exporting, camera: Camera, origin: Array) -> Iterator[bytes]:
    block = exporting.block
    width, height = camera.pixels or (0, 0)
    cx, cy = camera.principal_px or (width / 2.0, height / 2.0)
    _, _, _, k1, k2, k3, p1, p2, b1, b2 = camera.lens_parameters
    focal = camera.c / camera.pixel_mm
    lines = [
        "<Photogroup>",
        f"<Name>{xml_text(camera.id)}</Name>",
        f"<ImageDimensions><Width>{width}</Width><Height>{height}</Height></ImageDimensions>",
        "<CameraModelType>Perspective</CameraModelType>",
        f"<FocalLengthPixels>{focal * (1.0 + b1)!r}</FocalLengthPixels>",
    ]
    if camera.pixel_um is not None:
        lines.append(f"<PixelSize>{camera.pixel_mm!r}</PixelSize>")
    lines += [
        "<CameraOrientation>XRightYDown</CameraOrientation>",
        f"<PrincipalPoint><x>{cx - HALF!r}</x><y>{cy - HALF!r}</y></PrincipalPoint>",
        f"<Distortion><K1>{k1!r}</K1><K2>{k2!r}</K2><K3>{k3!r}</K3>"
        f"<P1>{p2!r}</P1><P2>{p1!r}</P2></Distortion>",
        f"<AspectRatio>{1.0 / (1.0 + b1)!r}</AspectRatio>",
        f"<Skew>{-b2 * focal!r}</Skew>",
    ]
    yield _lines(2, *lines)
    done = {} if exporting.adjusted is None else {p.photo: p for p in exporting.adjusted.photos}
    for k, photo in enumerate(block.photos):
        if photo.camera != camera.id:
            continue
        place, angles = photo.position, photo.rotation
        if photo.id in done:
            place, angles = done[photo.id].position, done[photo.id].rotation
        pose = ""
        if angles is not None:
            matrix = np.diag((1.0, -1.0, -1.0)) @ rotation_matrix(*angles).T
            cells = "".join(
                f"<M_{i}{j}>{float(matrix[i, j])!r}</M_{i}{j}>" for i in range(3) for j in range(3)
            )
            pose += f"<Rotation>{cells}</Rotation>"
        if place is not None:
            pose += f"<Center>{_xyz(np.array(place) + origin)}</Center>"
        yield _lines(
            3,
            f"<Photo><Id>{k}</Id><ImagePath>{xml_text(photo.id)}</ImagePath>"
            + (f"<Pose>{pose}</Pose>" if pose else "")
            + "</Photo>",
        )
    yield _lines(2, "</Photogroup>")


def _control(row: ControlPoint, mine: list[tuple[int, float, float]], origin: Array) -> bytes:
    x, y, z = row.xyz
    plan = x is not None and y is not None
    if not plan and (x is not None or y is not None):
        raise InputError(f"control point {quoted(row.point)}: X or Y alone has no place")
    kind = "Full" if plan and z is not None else "Horizontal" if plan else "Vertical"
    at = [
        f"<{key}>{float(value + shift)!r}</{key}>"
        for key, value, shift in zip("xyz", row.xyz, origin.tolist(), strict=True)
        if value is not None
    ]
    sx, sy, sz = row.sigma
    known = [s for s in (sx, sy) if s is not None]
    lines = [
        "<ControlPoint>",
        f"<Name>{xml_text(row.point)}</Name><Category>{kind}</Category>",
        f"<Position>{''.join(at)}</Position>",
    ]
    if row.use == "check":
        lines.append("<CheckPoint>true</CheckPoint>")
    if known:
        lines.append(f"<HorizontalAccuracy>{max(known)!r}</HorizontalAccuracy>")
    if sz is not None:
        lines.append(f"<VerticalAccuracy>{sz!r}</VerticalAccuracy>")
    return _lines(2, *lines, *_measurements(mine), "</ControlPoint>")


def _tie(
    point: str,
    mine: list[tuple[int, float, float]],
    xyz: tuple[float, float, float] | None,
    origin: Array,
) -> bytes:
    lines = ["<TiePoint>", f"<Name>{xml_text(point)}</Name>"]
    if xyz is not None and all(map(isfinite, xyz)):
        lines.append(f"<Position>{_xyz(np.array(xyz) + origin)}</Position>")
    return _lines(2, *lines, *_measurements(mine), "</TiePoint>")


def _measurements(mine: list[tuple[int, float, float]]) -> list[str]:
    return [
        f"<Measurement><PhotoId>{photo}</PhotoId><x>{x!r}</x><y>{y!r}</y></Measurement>"
        for photo, x, y in mine
    ]


def _xyz(place: Array) -> str:
    x, y, z = place.tolist()
    return f"<x>{x!r}</x><y>{y!r}</y><z>{z!r}</z>"


def _lines(depth: int, *lines: str) -> bytes:
    return "".join(f"{'  ' * depth}{line}\n" for line in lines).encode()
