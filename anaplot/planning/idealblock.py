"""A block that was never flown: stations and points, photographed without error."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from anaplot.aliases import Array
from anaplot.bundle.adjust import adjust_bundle
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.problem import Datum, Problem, make_problem
from anaplot.photogrammetry.block import (
    Block,
    Camera,
    ControlPoint,
    ImagePoint,
    Photo,
    Precision,
    Strip,
    TestSettings,
)
from anaplot.photogrammetry.collinearity import project
from anaplot.photogrammetry.rotation import rotation_angles

__all__ = ["ExposureStation", "IdealBlock", "photograph"]


@dataclass(frozen=True, slots=True, eq=False)
class ExposureStation:
    """Where a photo is taken: projection centre (3,) [m], rotation (3, 3), camera's name."""

    centre: Array
    rotation: Array
    camera: str


@dataclass(frozen=True, slots=True, eq=False)
class IdealBlock:
    """A block whose image coordinates are free of error, and the truth behind it.

    Attributes
    ----------
    block
        The block, ready to be adjusted or written.
    stations
        By photo.
    points
        (3,) true coordinates [m] by point, also of points that no photo sees.
    """

    block: Block
    stations: Mapping[str, ExposureStation] = field(repr=False)
    points: Mapping[str, Array] = field(repr=False)

    def start(self, problem: Problem) -> BlockState:
        """Return the truth as approximate values."""
        centres = np.array([self.stations[p].centre for p in problem.photos])
        points = np.array([self.points[p] for p in problem.points])
        origin = points.mean(axis=0)
        return BlockState(
            centres - origin,
            np.array([self.stations[p].rotation for p in problem.photos]),
            points - origin,
            np.zeros((len(centres), problem.per_photo - 6)),
            np.zeros(problem.in_border),
            origin,
        )

    def evaluated(self, datum: Datum = "control") -> AdjustedBlock:
        """Adjust at the truth: reliability and accuracy that are to be expected.

        Raises
        ------
        NotComputableError
            The observations do not determine everything; what is not is named.
        """
        problem = make_problem(self.block, datum=datum)
        return adjust_bundle(problem, self.start(problem))


def photograph(
    name: str,
    cameras: Iterable[Camera],
    stations: Mapping[str, ExposureStation],
    points: Mapping[str, Array],
    *,
    control: Iterable[ControlPoint] = (),
    strips: Iterable[Strip] = (),
    sees: Callable[[str, str, Array], bool] | None = None,
    models: Callable[[str, str], tuple[str | None, ...]] | None = None,
    image_um: float = 5.0,
    stated: bool = False,
) -> IdealBlock:
    """Photograph points.

    Parameters
    ----------
    name
        Of the block.
    cameras
        All cameras; a format bounds what lies in the photo.
    stations, points
        By name.
    control, strips
        As in a block.
    sees
        Whether a photo shows a point that lies in it at (2,) image coordinates [mm]; None:
        always.
    models
        Models in which a photo's point is measured, one row each; None: one row without model.
    image_um
        A-priori sigma0 [um].
    stated
        Whether the block states the planned orientations, as approximate values.
    """
    of = {camera.id: camera for camera in cameras}
    names = list(points)
    at = np.array([points[p] for p in names]).reshape(-1, 3)
    rows = []
    for photo, station in stations.items():
        camera = of[station.camera]
        n = len(names)
        seen = project(
            np.broadcast_to(station.centre, (n, 3)),
            np.broadcast_to(station.rotation, (n, 3, 3)),
            np.full(n, camera.c),
            at,
        )
        reach = np.array(camera.reach()) * (1.0 + 1e-12)
        inside = (seen.depth > 0.0) & (np.abs(seen.xy) <= reach).all(axis=1)
        for k in np.flatnonzero(inside).tolist():
            xy = seen.xy[k]
            if sees is not None and not sees(photo, names[k], xy):
                continue
            for model in models(photo, names[k]) if models else (None,):
                rows.append(ImagePoint(photo, names[k], float(xy[0]), float(xy[1]), None, model))
    block = Block(
        name=name,
        precision=Precision(image_um=image_um, tie_variance="exact"),
        test=TestSettings(kind="baarda"),
        cameras=tuple(of.values()),
        photos=tuple(_photo(p, station, stated) for p, station in stations.items()),
        strips=tuple(strips),
        image_points=tuple(rows),
        control=tuple(control),
    )
    return IdealBlock(block, dict(stations), dict(points))


def _photo(name: str, station: ExposureStation, stated: bool) -> Photo:
    if not stated:
        return Photo(name, station.camera)
    x, y, z = station.centre.tolist()
    return Photo(name, station.camera, (x, y, z), rotation_angles(station.rotation))
