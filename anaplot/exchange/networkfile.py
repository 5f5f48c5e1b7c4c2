"""A planned network as a TOML file: cameras, stations around an object, points of the object."""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass
from math import dist, hypot, radians
from pathlib import Path

from anaplot.exchange.blocktoml import read_rotation
from anaplot.exchange.camerafile import frame_format
from anaplot.photogrammetry.block import Camera
from anaplot.textfiles.inputfile import read_text
from anaplot.textfiles.tomlfile import TomlFile, TomlTable
from anaplot.textfiles.wording import quoted

__all__ = ["NETWORK_FORMAT", "NetworkFile", "ObjectPoint", "StationEntry", "read_network"]

NETWORK_FORMAT = 1
_MAX_BYTES = 4_000_000
_MOST_STATIONS, _MOST_POINTS = 1_000, 20_000
# computed in double precision: wide enough for any camera and any object
_BOUNDS = (1e-3, 1e6)  # mm or um
_FINEST = 1e-9  # m, of control that is not free of error
_NEAREST = 1e-6  # m: what is closer has no direction

Triple = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class StationEntry:
    """A station: projection centre [m], and omega, phi, kappa [rad] or a point to look at [m].

    `roll` [rad] turns a camera that looks at a point about its axis.
    """

    id: str
    camera: str
    position: Triple
    rotation: Triple | None
    look_at: Triple | None
    roll: float = 0.0


@dataclass(frozen=True, slots=True)
class ObjectPoint:
    """A point of the object [m].

    `normal`: direction in which its surface faces, or None; `control`: standard deviation of its
    coordinates as control [m], 0 free of error, None when it is no control.
    """

    id: str
    position: Triple
    normal: Triple | None
    control: float | None


@dataclass(frozen=True, slots=True)
class NetworkFile:
    """Content of a network file."""

    name: str
    image_um: float
    incidence_deg: float
    cameras: tuple[Camera, ...]
    stations: tuple[StationEntry, ...]
    points: tuple[ObjectPoint, ...]


def read_network(path: Path) -> NetworkFile:
    """Read a network file.

    Raises
    ------
    InputError
        The first thing that is wrong, with file, line and key.
    """
    root = TomlFile(path, read_text(path, _MAX_BYTES)).root
    root.version(NETWORK_FORMAT)
    root.only("format", "name", "image_um", "incidence", "camera", "station", "point")
    cameras: dict[str, Camera] = {}
    for table in root.tables("camera"):
        table.only("id", "c", "format")
        camera = Camera(table.name("id"), table.between("c", *_BOUNDS), _format(table))
        _once("camera", camera.id, table, cameras)
        cameras[camera.id] = camera
    stations: dict[str, StationEntry] = {}
    for table in root.tables("station"):
        station = _station(table, cameras)
        _once("station", station.id, table, stations)
        stations[station.id] = station
        if len(stations) > _MOST_STATIONS:
            raise table.fail(None, f"more than {_MOST_STATIONS} stations")
    points: dict[str, ObjectPoint] = {}
    for table in root.tables("point"):
        point = _point(table)
        _once("point", point.id, table, points)
        points[point.id] = point
        if len(points) > _MOST_POINTS:
            raise table.fail(None, f"more than {_MOST_POINTS} points")
    for what, found in (("camera", cameras), ("station", stations), ("point", points)):
        if not found:
            raise root.fail(None, f"no {what}: a network needs at least one [[{what}]]")
    incidence = root.positive("incidence", 75.0)
    if incidence > 90.0:
        raise root.fail("incidence", f"incidence = {incidence:g} must be at most 90 degrees")
    return NetworkFile(
        root.name("name"),
        root.between("image_um", *_BOUNDS, 5.0),
        incidence,
        tuple(cameras.values()),
        tuple(stations.values()),
        tuple(points.values()),
    )


def _station(table: TomlTable, cameras: dict[str, Camera]) -> StationEntry:
    table.only("id", "camera", "position", "rotation", "look_at", "roll")
    name = table.name("id", photo=True)
    camera = table.name("camera")
    if camera not in cameras:
        raise table.fail("camera", f"camera {quoted(camera)} is not among the [[camera]]")
    position = _triple(table, "position")
    if ("rotation" in table) == ("look_at" in table):
        raise table.fail(None, "a station has either rotation or look_at")
    if "rotation" in table:
        if "roll" in table:
            raise table.fail("roll", "roll goes with look_at; a rotation holds it already")
        return StationEntry(name, camera, position, read_rotation(table, "rotation"), None)
    target = _triple(table, "look_at")
    if dist(target, position) < _NEAREST:
        raise table.fail("look_at", "look_at is the station itself")
    roll = radians(table.number("roll", 0.0))
    return StationEntry(name, camera, position, None, target, roll)


def _point(table: TomlTable) -> ObjectPoint:
    table.only("id", "position", "normal", "control")
    normal = _triple(table, "normal") if "normal" in table else None
    name = table.name("id")
    if normal is not None and hypot(*normal) < _NEAREST:
        raise table.fail(
            "normal",
            f"point {quoted(name)}: normal has no direction: its length is {hypot(*normal):g}, "
            f"at least {_NEAREST:g}",
        )
    control = table.number("control") if "control" in table else None
    if control is not None and control != 0.0 and not _FINEST <= control <= _BOUNDS[1]:
        raise table.fail(
            "control",
            f"point {quoted(name)}: control = {control:g} must be 0 or lie between {_FINEST:g} and "
            f"{_BOUNDS[1]:g} m",
        )
    return ObjectPoint(name, _triple(table, "position"), normal, control)


def _format(table: TomlTable) -> tuple[float, float] | None:
    size = frame_format(table)
    if size is not None and not _BOUNDS[0] <= min(size) <= max(size) <= _BOUNDS[1]:
        raise table.fail("format", f"format must lie between {_BOUNDS[0]:g} and {_BOUNDS[1]:g} mm")
    return size


def _triple(table: TomlTable, key: str) -> Triple:
    x, y, z = table.numbers(key, 3)
    for index, value in enumerate((x, y, z)):
        if abs(value) > 1e7:
            raise table.fail(key, f"{key}: {value:g} is out of all measure", index)
    return x, y, z


def _once(what: str, name: str, table: TomlTable, found: Container[str]) -> None:
    if name in found:
        raise table.fail("id", f"{what} {quoted(name)} twice")
