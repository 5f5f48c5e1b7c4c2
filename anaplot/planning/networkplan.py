"""Camera stations around an object before they are built up: reliability and accuracy.

The cube of Gruen 1978, Figure 2, is the example: 27 points, five ways of photographing them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import cos, pi, radians
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.errors import NotComputableError
from anaplot.photogrammetry.block import Camera, ControlPoint, Strip
from anaplot.planning.idealblock import ExposureStation, IdealBlock, photograph
from anaplot.planning.plannedreliability import (
    PlannedReliability,
    photo_reliability,
    point_reliability,
)

__all__ = [
    "CUBE_VERSIONS",
    "Network",
    "NetworkReliability",
    "cube",
    "looking_at",
    "network_reliability",
    "plan_network",
]


CUBE_VERSIONS: Mapping[str, tuple[str, ...]] = {
    "A": ("1", "2"),
    "B": ("3", "4"),
    "C": ("3", "0", "4"),
    "D": ("1", "2", "5", "6"),
    "E": ("3", "4", "7", "8"),
}
"""Photos of each version of the cube."""

_PHI = 20.483 * pi / 200.0
# projection centre, phi and omega in units of _PHI
_STATIONS: Mapping[str, tuple[tuple[float, float, float], int, int]] = {
    "0": ((0, 0, 5), 0, 0),
    "1": ((-1, 0, 5), 0, 0),
    "2": ((1, 0, 5), 0, 0),
    "3": ((-5, 0, 5), -1, 0),
    "4": ((5, 0, 5), 1, 0),
    "5": ((0, 0, 4), 0, 0),
    "6": ((0, 0, 6), 0, 0),
    "7": ((0, 0, 0), 0, 1),
    "8": ((0, 0, 10), 0, -1),
}
_CUBE_C = 100.0


@dataclass(frozen=True, slots=True, eq=False)
class Network:
    """Stations around an object.

    Attributes
    ----------
    name
        Of the network.
    cameras
        A camera's format bounds its field of view.
    stations
        By photo.
    points
        (3,) coordinates [m] by point.
    normals
        (3,) direction in which the surface faces, for points that are not seen from behind.
    incidence_deg
        Largest angle between the normal and the ray at which a point is still measured.
    control
        Points known beforehand.
    image_um
        A-priori sigma0 [um].
    """

    name: str
    cameras: tuple[Camera, ...]
    stations: Mapping[str, ExposureStation]
    points: Mapping[str, Array]
    control: tuple[ControlPoint, ...] = ()
    normals: Mapping[str, Array] = field(default_factory=dict)
    incidence_deg: float = 75.0
    image_um: float = 5.0


class NetworkReliability(NamedTuple):
    """Reliability and accuracy of a planned network, and what it leaves undetermined.

    Attributes
    ----------
    points, photos
        Everything adjusted, the weakest first.
    rays
        Photos in which each point is seen, by name.
    new_s
        Means of the expected standard deviations of the determined new points in X, Y, Z and of
        all three [m]; None when there are none.
    new_determined
        How many new points are determined.
    not_determined
        New points that are not.
    unused_photos
        Stations without usable rays.
    unused_control
        Control that no usable ray meets.
    """

    points: tuple[PlannedReliability, ...]
    photos: tuple[PlannedReliability, ...]
    rays: Mapping[str, int]
    new_s: tuple[float, float, float, float] | None
    new_determined: int
    not_determined: tuple[str, ...]
    unused_photos: tuple[str, ...]
    unused_control: tuple[str, ...]


def looking_at(
    centre: tuple[float, float, float], target: tuple[float, float, float], roll: float = 0.0
) -> Array:
    """Return the rotation of a camera that looks at a point, x' level; (3, 3).

    A camera that looks straight up or down has y' along +Y. `roll` [rad] turns it about its axis,
    counter-clockwise as seen from behind the camera.
    """
    back = np.subtract(centre, target)
    back = back / np.linalg.norm(back)
    up = np.array([0.0, 0.0, 1.0]) if abs(back[2]) < 1.0 - 1e-9 else np.array([0.0, 1.0, 0.0])
    right = np.cross(up, back)
    right = right / np.linalg.norm(right)
    turn = np.array([[cos(roll), -np.sin(roll), 0.0], [np.sin(roll), cos(roll), 0.0], [0, 0, 1.0]])
    rotation: Array = np.stack((right, np.cross(back, right), back), axis=1) @ turn
    return rotation


def plan_network(network: Network) -> IdealBlock:
    """Photograph the object from all stations.

    Raises
    ------
    NotComputableError
        No station sees any point.
    """
    limit = cos(radians(network.incidence_deg))

    def sees(photo: str, point: str, _: Array) -> bool:
        normal = network.normals.get(point)
        if normal is None:
            return True
        ray = network.stations[photo].centre - network.points[point]
        return float(_unit(normal) @ _unit(ray)) >= limit - 1e-12

    made = photograph(
        network.name,
        network.cameras,
        network.stations,
        network.points,
        control=network.control,
        # a block's photos stand in strips; here it means nothing more than their order
        strips=(Strip("1", tuple(network.stations)),) if len(network.stations) > 1 else (),
        sees=sees,
        image_um=network.image_um,
        stated=True,
    )
    if not made.block.image_points:
        raise NotComputableError(f"network {network.name}: no station sees any point")
    return made


def _unit(vector: Array) -> Array:
    """Return the direction of a vector that is not zero, however short; (3,)."""
    scaled = vector / np.abs(vector).max()
    unit: Array = scaled / np.linalg.norm(scaled)
    return unit


def cube(version: str, image_um: float = 5.0) -> Network:
    """Return a version of the cube of 1978: the corners are control free of error.

    Parameters
    ----------
    version
        "A" to "E".
    image_um
        A-priori sigma0 [um].
    """
    points: dict[str, Array] = {}
    for z in (0, 5, 10):
        for y in (10, 15, 20):
            for x in (-5, 0, 5):
                points[str(len(points) + 1)] = np.array([x, y, z], dtype=float)
    control = tuple(
        ControlPoint(name, (float(x), float(y), float(z)), (0.0, 0.0, 0.0))
        for name, (x, y, z) in points.items()
        if abs(x) == 5 and y != 15 and z != 5
    )
    stations = {
        photo: ExposureStation(
            np.array(_STATIONS[photo][0], dtype=float),
            _cube_rotation(_STATIONS[photo][1] * _PHI, _STATIONS[photo][2] * _PHI),
            "camera",
        )
        for photo in CUBE_VERSIONS[version]
    }
    name = f"cube {version}"
    return Network(name, (Camera("camera", _CUBE_C),), stations, points, control, image_um=image_um)


def _cube_rotation(phi: float, omega: float) -> Array:
    """Zero rotation looks along +Y with x' along X and y' along Z."""
    level = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    about_z = np.array([[cos(phi), -np.sin(phi), 0], [np.sin(phi), cos(phi), 0], [0, 0, 1.0]])
    about_x = np.array(
        [[1.0, 0, 0], [0, cos(omega), -np.sin(omega)], [0, np.sin(omega), cos(omega)]]
    )
    rotation: Array = about_z @ about_x @ level
    return rotation


def network_reliability(
    network: Network, made: IdealBlock, block: AdjustedBlock
) -> NetworkReliability:
    """Return what an adjusted network determines, and what it does not."""
    rays = dict.fromkeys(network.points, 0)
    for row in made.block.image_points:
        rays[row.point] += 1
    control = {row.point for row in network.control}
    adjusted, used = set(block.problem.points), set(block.problem.photos)
    points = point_reliability(block)
    s = [worth.s_xyz for worth in points if worth.name not in control]
    new_s = None
    if s:
        x, y, z = np.array(s, dtype=float).mean(axis=0).tolist()
        new_s = (x, y, z, (x + y + z) / 3.0)
    return NetworkReliability(
        points,
        photo_reliability(block),
        rays,
        new_s,
        len(s),
        tuple(p for p in network.points if p not in adjusted and p not in control),
        tuple(photo for photo in network.stations if photo not in used),
        tuple(row.point for row in network.control if row.point not in adjusted),
    )
