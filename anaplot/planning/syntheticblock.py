"""Strips side by side over one terrain with control that nobody has flown: what they show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import radians

import numpy as np

from anaplot.aliases import Array
from anaplot.orientation.ownpattern import PointPattern
from anaplot.orientation.patterns import pattern
from anaplot.photogrammetry.block import Camera
from anaplot.photogrammetry.collinearity import project
from anaplot.photogrammetry.rotation import rotation_matrix
from anaplot.planning.modelplan import standard_d
from anaplot.planning.synthetic import (
    BETWEEN,
    RELIEF,
    TILTS_DEG,
    UNDER,
    Truth,
    further_places,
)
from anaplot.planning.syntheticcamera import usual_format

__all__ = ["flown", "synthetic_plates"]

_SIDE = 0.7  # of a photo's height between strips: 30 % side lap
_SCALE = 10.0  # m on the ground for a mm at photo scale: 1 : 10 000
_ORIGIN = (4000.0, 7000.0, 300.0)  # m
_MARGIN = 2.0  # mm at the edge of a photo where nothing is marked


def synthetic_plates(
    strips: Sequence[tuple[str, ...]],
    camera: Camera,
    *,
    seed: int,
    base: float,
    wanted: PointPattern | None = None,
) -> Truth:
    """Return true image coordinates [mm] of photos in parallel strips over one terrain.

    Parameters
    ----------
    strips
        Names of the photos in flight order; every second strip is flown back. Where strips are not
        of one length they begin side by side.
    camera
        The camera of all.
    seed
        Of the generator of orientations, relief and positions.
    base
        Base at photo scale [mm].
    wanted
        A point pattern that finds its points there, too.
    """
    rng = np.random.default_rng([seed, 4])
    truth, _, control = flown(strips, camera, abs(base), rng, wanted)
    # nobody has a list of this control
    return {
        photo: {point: xy for point, xy in seen.items() if point not in control}
        for photo, seen in truth.items()
    }


def flown(
    strips: Sequence[tuple[str, ...]],
    camera: Camera,
    base: float,
    rng: np.random.Generator,
    wanted: PointPattern | None = None,
) -> tuple[dict[str, dict[str, tuple[float, float]]], dict[str, Array], tuple[str, ...]]:
    """Return true image coordinates [mm], the ground [m], and which of it is control.

    Every photo has the points of the 15-point pattern under it and towards the next one; those of
    the side overlap lie in photos of two strips. Control stands at both ends and in the middle of
    every edge and of every side overlap. Else as for `synthetic_plates`.
    """
    places, control = _places(strips, camera, base, rng, wanted)
    waves = rng.normal(size=(4, 3)) * [1.0, 1.0, radians(180.0)]
    ground = {
        name: np.array(_ORIGIN) + _SCALE * np.array([*xy, _height(xy, camera, base, waves)])
        for name, xy in places.items()
    }
    side, longest = _side(camera), max(map(len, strips))
    truth: dict[str, dict[str, tuple[float, float]]] = {}
    for s, photos in enumerate(strips):
        back = s % 2 == 1
        for k, photo in enumerate(photos):
            x = base * (longest - 1 - k if back else k)
            centre = np.array([x, side * s, camera.c]) + rng.normal(0.0, 0.015 * base, 3)
            angles = np.clip(rng.normal(size=3), -2.0, 2.0) * np.radians(TILTS_DEG)
            angles[2] += radians(180.0) if back else 0.0
            at = np.array(_ORIGIN) + _SCALE * centre
            truth[photo] = _photographed(camera, at, rotation_matrix(*angles.tolist()), ground)
    return truth, ground, control


def _side(camera: Camera) -> float:
    """Return the distance of two strips [mm at photo scale]."""
    return _SIDE * usual_format(camera)[1]


def _places(
    strips: Sequence[tuple[str, ...]],
    camera: Camera,
    base: float,
    rng: np.random.Generator,
    wanted: PointPattern | None,
) -> tuple[dict[str, Array], tuple[str, ...]]:
    """Return where points lie in plan [mm at photo scale], and which are control."""
    d = standard_d(camera)
    side, longest = _side(camera), max(map(len, strips))
    positions = pattern("15").positions(base, d, twin=(4.0, 4.0))
    out: dict[str, Array] = {}

    def in_block(s: int, along: float, y: float) -> Array:
        x, across = (base * (longest - 1) - along, -y) if s % 2 == 1 else (along, y)
        return np.array([x, across + side * s])

    for s, photos in enumerate(strips):
        for k, photo in enumerate(photos):
            for label in UNDER + (BETWEEN if k + 1 < len(photos) else ()):
                x, y = positions[label]
                place = in_block(s, x + base * k, y)
                out[f"{photo}-{label}"] = place + rng.uniform(-1.5, 1.5, 2)
    rows = [
        -0.9 * d,
        *(side * (s + 0.5) for s in range(len(strips) - 1)),
        side * (len(strips) - 1) + 0.9 * d,
    ]
    ends = (0.05, 0.5, 0.95)
    control: list[str] = []
    for y in rows:
        for part in ends:
            control.append(f"C{len(control) + 1}")
            place = np.array([part * base * (longest - 1), y])
            out[control[-1]] = place + rng.uniform(-6.0, 6.0, 2)
    for s, photos in enumerate(strips):
        if wanted is not None:
            for name, (along, y) in further_places(wanted, photos, base, d).items():
                out[name] = in_block(s, along, y)
    return out, tuple(control)


def _height(xy: Array, camera: Camera, base: float, waves: Array) -> float:
    """Smooth terrain [mm at photo scale]: a few waves."""
    phase = waves[:, 0] * xy[0] / base + waves[:, 1] * xy[1] / base + waves[:, 2]
    return RELIEF * camera.c * float(np.sin(phase).mean())


def _photographed(
    camera: Camera, centre: Array, rotation: Array, ground: Mapping[str, Array]
) -> dict[str, tuple[float, float]]:
    n = len(ground)
    seen = project(
        np.broadcast_to(centre, (n, 3)),
        np.broadcast_to(rotation, (n, 3, 3)),
        np.full(n, camera.c),
        np.array(list(ground.values())),
    )
    reach = np.array(camera.reach()) - _MARGIN
    inside = np.flatnonzero((np.abs(seen.xy) <= reach).all(axis=1)).tolist()
    names = list(ground)
    return {names[k]: (float(seen.xy[k, 0]), float(seen.xy[k, 1])) for k in inside}
