"""A planned network as a TOML file: cameras, stations around an object, points of the object."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from math import dist, hypot, radians
from pathlib import Path

from anaplot.exchange.blocktoml import ROTATION
from anaplot.photogrammetry.block import Camera
from anaplot.textfiles.kinds import (
    NAME,
    NUMBER,
    PHOTO,
    Fields,
    KnownName,
    Made,
    Number,
    Numbers,
    WrongValueError,
)
from anaplot.textfiles.tomltable import TomlTable, read_toml

__all__ = ["NETWORK_FORMAT", "NetworkFile", "ObjectPoint", "StationEntry", "read_network"]

NETWORK_FORMAT = 1
_MAX_BYTES = 4_000_000
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
    rotation: Triple | None = None
    look_at: Triple | None = None
    roll: float = 0.0


@dataclass(frozen=True, slots=True)
class ObjectPoint:
    """A point of the object [m].

    `normal`: direction in which its surface faces, or None; `control`: standard deviation of its
    coordinates as control [m], 0 free of error, None when it is no control.
    """

    id: str
    position: Triple
    normal: Triple | None = None
    control: float | None = None


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
    root = read_toml(path, _MAX_BYTES)
    root.version(NETWORK_FORMAT)
    stated = root.take({"name": NAME}, _SETTINGS, also=("format", "camera", "station", "point"))
    cameras = root.each("camera", lambda table: Camera(**table.take(_CAMERA, _FRAME)))
    known = {camera.id for camera in cameras}
    return NetworkFile(
        stated["name"],
        stated.get("image_um", 5.0),
        stated.get("incidence", 75.0),
        cameras,
        root.each("station", lambda table: _station(table, known), most=1_000),
        root.each("point", _point, most=20_000),
    )


def _station(table: TomlTable, cameras: Collection[str]) -> StationEntry:
    kinds: Fields = {"id": PHOTO, "camera": KnownName("camera", cameras), "position": _PLACE}
    station = StationEntry(**table.take(kinds, _STATION))
    if (station.rotation is None) == (station.look_at is None):
        raise table.fail("a station has either rotation or look_at")
    if station.look_at is None and "roll" in table:
        raise table.fail("roll goes with look_at; a rotation holds it already", "roll")
    if station.look_at is not None and dist(station.look_at, station.position) < _NEAREST:
        raise table.fail("look_at is the station itself", "look_at")
    return station


def _point(table: TomlTable) -> ObjectPoint:
    return ObjectPoint(**table.take({"id": NAME, "position": _PLACE}, _POINT))


def _direction(vector: Triple) -> Triple:
    if hypot(*vector) < _NEAREST:
        raise WrongValueError(
            f"no direction: its length is {hypot(*vector):g}, at least {_NEAREST:g}"
        )
    return vector


def _sigma(value: float) -> float:
    if value != 0.0 and not _FINEST <= value <= _BOUNDS[1]:
        raise WrongValueError(
            f"must be 0 or lie between {_FINEST:g} and {_BOUNDS[1]:g} m, not {value:g}"
        )
    return value


_PLACE = Numbers(3, Number(-1e7, 1e7))
_SETTINGS: Fields = {"image_um": Number(*_BOUNDS), "incidence": Number(0.001, 90.0)}
_CAMERA: Fields = {"id": NAME, "c": Number(*_BOUNDS)}
_FRAME: Fields = {"format": Numbers(2, Number(*_BOUNDS))}
_STATION: Fields = {"rotation": ROTATION, "look_at": _PLACE, "roll": Made(NUMBER, radians)}
_POINT: Fields = {"normal": Made(_PLACE, _direction), "control": Made(NUMBER, _sigma)}
