"""Results as GeoJSON (RFC 7946): photo centres and points with ellipses, redundancy and verdict.

The standard ellipse of a point has the semi-axes a >= b, the roots of the eigenvalues of the
covariance in plan, and the azimuth of a, clockwise from north (of the frame's y axis).
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from anaplot.aliases import Array
from anaplot.errors import InputError
from anaplot.exchange.formats.crs import GroundFrame
from anaplot.exchange.formats.door import Exported, Exporting, Note, PhotoResult, PointResult
from anaplot.exchange.formats.resulttables import frame_of
from anaplot.textfiles.wholefile import create_whole

__all__ = ["Ellipse", "standard_ellipse", "write"]

_CORNERS = 36
_DEGREE_DIGITS, _METRE_DIGITS = 12, 6  # a tenth of a micrometre, a micrometre
_LOCAL = "local metres: no coordinate system is known, so this is no WGS84"


class Ellipse(NamedTuple):
    """A standard ellipse.

    Attributes
    ----------
    a, b
        Semi-axes [m], the larger first.
    azimuth
        Of a, clockwise from north [degrees], from 0 to 180.
    """

    a: float
    b: float
    azimuth: float


def standard_ellipse(covariance: Sequence[Sequence[float]]) -> Ellipse:
    """Return the standard ellipse of (3, 3) or (2, 2) covariances [m^2] of x, y."""
    values, vectors = np.linalg.eigh(np.array(covariance, dtype=float)[:2, :2])
    b, a = np.sqrt(np.maximum(values, 0.0)).tolist()
    x, y = vectors[:, 1].tolist()
    azimuth = math.degrees(math.atan2(x, y)) % 180.0
    return Ellipse(a, b, 0.0 if azimuth == 180.0 else azimuth)


def write(exporting: Exporting, target: Path) -> Exported:
    """Write a file.

    Raises
    ------
    InputError
        The coordinate system is unknown, or pyproj is missing; or it cannot be written.
    """
    found, larger = exporting.adjusted, exporting.options.ellipses
    if found is None:
        raise InputError("nothing was adjusted")
    system = exporting.block.ground
    frame = None if system is None else frame_of(exporting, system)
    verdicts = {one.point: one.verdict for one in found.control}
    features = _placed([(one.position, _photo(one)) for one in found.photos], frame)
    features += _placed(
        [(one.xyz, _point(one, verdicts.get(one.point))) for one in found.points], frame
    )
    notes = []
    if larger is not None:
        features += _drawn(found.points, larger, frame)
        text = f"ellipses are drawn {larger:g} times as large as they are"
        notes.append(Note("changed", None, text))
    if frame is None:
        text = "no coordinate system: coordinates are local metres, against RFC 7946"
        notes.append(Note("not held", None, text))
    answer = {
        "type": "FeatureCollection",
        "coordinates_are": _LOCAL if frame is None else _world(frame),
        "sigma0": found.sigma0,
        "features": features,
    }
    create_whole(target, (json.dumps(answer, allow_nan=False, ensure_ascii=False) + "\n").encode())
    return Exported((target,), tuple(notes))


def _world(frame: GroundFrame) -> str:
    """Say what the coordinates are: heights above the sea go through as they are."""
    sea = frame.theirs.sea
    height = f"height of {sea}, not ellipsoidal" if sea else "ellipsoidal height"
    return f"WGS84: longitude, latitude [degrees], {height} [m]"


def _placed(
    items: Sequence[tuple[tuple[float, float, float], dict[str, Any]]], frame: GroundFrame | None
) -> list[dict[str, Any]]:
    if not items:
        return []
    places = _coordinates(np.array([at for at, _ in items]), frame)
    return [
        _feature({"type": "Point", "coordinates": at}, properties)
        for at, (_, properties) in zip(places, items, strict=True)
    ]


def _feature(geometry: dict[str, Any], properties: dict[str, Any]) -> dict[str, Any]:
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def _coordinates(xyz: Array, frame: GroundFrame | None) -> list[list[float]]:
    if frame is None:
        return [[round(v, _METRE_DIGITS) for v in row] for row in xyz.tolist()]
    places = frame.degrees(xyz)
    places[:, 0] = (places[:, 0] + 180.0) % 360.0 - 180.0
    return [
        [round(x, _DEGREE_DIGITS), round(y, _DEGREE_DIGITS), round(z, _METRE_DIGITS)]
        for x, y, z in places.tolist()
    ]


def _xyz(at: tuple[float, float, float]) -> dict[str, float]:
    return dict(zip("XYZ", at, strict=True))


def _photo(one: PhotoResult) -> dict[str, Any]:
    angles = ("omega_deg", "phi_deg", "kappa_deg")
    return {
        "kind": "photo",
        "name": one.photo,
        **_xyz(one.position),
        **dict(zip(("sX", "sY", "sZ"), one.position_sigma, strict=True)),
        **dict(zip(angles, map(math.degrees, one.rotation), strict=True)),
        "rays": one.rays,
        "redundancy": one.redundancy,
        "flagged": one.flagged,
        "verdict": _verdict(one.flagged, one.redundancy),
    }


def _point(one: PointResult, verdict: str | None) -> dict[str, Any]:
    ellipse = standard_ellipse(one.covariance)
    return {
        "kind": "point",
        "name": one.point,
        "use": one.use,
        **_xyz(one.xyz),
        "ellipse_a_m": ellipse.a,
        "ellipse_b_m": ellipse.b,
        "ellipse_azimuth_deg": ellipse.azimuth,
        "sigma_height_m": math.sqrt(max(one.covariance[2][2], 0.0)),
        "rays": one.rays,
        "redundancy": one.redundancy,
        "flagged": one.flagged,
        "verdict": verdict or _verdict(one.flagged, one.redundancy),
    }


def _verdict(flagged: int, redundancy: float | None) -> str:
    if flagged:
        return "look"
    if redundancy is None or redundancy < 1e-9:
        return "unchecked"
    return "weak" if redundancy < 0.1 else "good"


def _drawn(
    points: Sequence[PointResult], larger: float, frame: GroundFrame | None
) -> list[dict[str, Any]]:
    """Return ellipses as polygons: counterclockwise, the first corner again at the end."""
    if not points:
        return []
    corners = np.concatenate([_corners(one, larger) for one in points])
    every = _coordinates(corners, frame)
    middles = _coordinates(np.array([one.xyz for one in points]), frame)
    out = []
    for k, (one, middle) in enumerate(zip(points, middles, strict=True)):
        ring = every[_CORNERS * k : _CORNERS * (k + 1)]
        parts = [ring] if frame is None else _either_side(ring, middle[0])
        polygons = [[[*part, part[0]]] for part in parts]
        geometry: dict[str, Any] = {"type": "Polygon", "coordinates": polygons[0]}
        if len(polygons) > 1:
            geometry = {"type": "MultiPolygon", "coordinates": polygons}
        properties = {"kind": "ellipse", "name": one.point, "drawn_larger": larger}
        out.append(_feature(geometry, properties))
    return out


def _corners(one: PointResult, larger: float) -> Array:
    """Return (_CORNERS, 3) corners of an ellipse, counterclockwise."""
    ellipse = standard_ellipse(one.covariance)
    turn = math.radians(90.0 - ellipse.azimuth)
    along = np.array([math.cos(turn), math.sin(turn)])
    across = np.array([-along[1], along[0]])
    t = 2.0 * np.pi * np.arange(_CORNERS) / _CORNERS
    flat = larger * (
        ellipse.a * np.cos(t)[:, None] * along + ellipse.b * np.sin(t)[:, None] * across
    )
    out: Array = np.array(one.xyz) + np.column_stack((flat, np.zeros(_CORNERS)))
    return out


def _either_side(ring: list[list[float]], middle: float) -> list[list[list[float]]]:
    """Return a convex ring about a longitude, cut at the 180th meridian (RFC 7946, 3.1.9)."""
    east = [[middle + (x - middle + 180.0) % 360.0 - 180.0, *rest] for x, *rest in ring]
    high, low = max(at[0] for at in east), min(at[0] for at in east)
    if high <= 180.0 and low >= -180.0:
        return [ring]
    edge = 180.0 if high > 180.0 else -180.0
    parts = []
    for side in (-1.0, 1.0):
        part = _beside(east, edge, side)
        shift = -math.copysign(360.0, edge) if side * edge > 0.0 else 0.0
        parts.append([[round(x + shift, _DEGREE_DIGITS), *rest] for x, *rest in part])
    return [part for part in parts if len(part) > 2]


def _beside(ring: list[list[float]], edge: float, side: float) -> list[list[float]]:
    """Return the part of a convex ring that is west (-1) or east (1) of a meridian."""
    out = []
    for at, following in zip(ring, [*ring[1:], ring[0]], strict=True):
        from_edge, then = side * (at[0] - edge), side * (following[0] - edge)
        if from_edge >= 0.0:
            out.append(at)
        if from_edge * then < 0.0:
            t = from_edge / (from_edge - then)
            crossing = [a + t * (b - a) for a, b in zip(at, following, strict=True)]
            out.append([edge, *crossing[1:]])
    return out
