"""Parts of a block from its strips: bridged models, joined over common points."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array, Progress
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.start.subblock import SubBlock
from anaplot.errors import NotComputableError
from anaplot.orientation.model import WrongPointsError, orient
from anaplot.orientation.results import ModelSolution
from anaplot.orientation.strip import stereopair
from anaplot.photogrammetry.block import Block, Camera, ImagePoint, Strip
from anaplot.photogrammetry.rotation import rotation_matrix
from anaplot.photogrammetry.selection import model_name, points_of, rows_by_photo, rows_off

__all__ = ["BRIDGING", "bridged_parts"]

BRIDGING = "bridging strips"
"""What this says of its progress."""

_TELLS_WHICH = 2  # redundancy that tells a wrong point: with 1, all test alike


def bridged_parts(
    problem: Problem, rays: Array, progress: Progress | None = None
) -> list[SubBlock]:
    """Bridge the strips and join them over common points.

    Parameters
    ----------
    problem
        The bundle.
    rays
        (m, 3) its rays, of unit length in image axes.
    progress
        Called with what is being done and the fraction of it.

    Returns
    -------
    list[Cluster]
        Parts that could not be joined, each in the system of one of its strips; the largest first.
    """
    parts: list[SubBlock] = []
    block = problem.block
    unused = set(problem.unused_rays.tolist())
    rows = rows_by_photo(row for k, row in enumerate(block.image_points) if k not in unused)
    index = _Names.of(problem)
    for count, strip in enumerate(block.strips):
        if progress is not None:
            progress(BRIDGING, count / len(block.strips))
        parts += _bridged(problem, strip, rows, index)
    parts.sort(key=lambda part: -int(part.oriented.sum()))
    joined: list[SubBlock] = []
    placed = [part.placed for part in parts]
    while parts:
        main = parts.pop(0)
        placed.pop(0)
        main.place(problem, rays)
        again = True
        while again:
            again = False
            own = main.placed
            shared = [int(np.count_nonzero(own & other)) for other in placed]
            for k in np.argsort(shared)[::-1].tolist():
                if shared[k] >= 3 and main.join(parts[k]):
                    parts.pop(k)
                    placed.pop(k)
                    main.place(problem, rays)
                    again = True
                    break
        joined.append(main)
    return joined


class _Names(NamedTuple):
    """Numbers of photos and points by their names, and the cameras of the photos."""

    photos: dict[str, int]
    points: dict[str, int]
    camera_of: dict[str, Camera]

    @classmethod
    def of(cls, problem: Problem) -> _Names:
        cameras = {camera.id: camera for camera in problem.block.cameras}
        return cls(
            {name: k for k, name in enumerate(problem.photos)},
            {name: k for k, name in enumerate(problem.points)},
            {photo.id: cameras[photo.camera] for photo in problem.block.photos},
        )


def _bridged(
    problem: Problem, strip: Strip, rows: dict[str, list[ImagePoint]], index: _Names
) -> list[SubBlock]:
    """Clusters of one strip: a new one begins wherever the chain of models breaks."""
    block = problem.block
    at_photo, at_point, camera_of = index
    found: list[SubBlock] = []
    current: SubBlock | None = None
    preceding: ModelSolution | None = None
    for left, right in strip.models():
        model = None
        if left in at_photo and right in at_photo:
            model = _model(block, strip, (left, right), rows, camera_of, preceding)
            if model is None and preceding is not None:
                current, preceding = None, None
                model = _model(block, strip, (left, right), rows, camera_of, None)
        if model is None:
            current, preceding = None, None
            continue
        if current is None:
            current = SubBlock.empty(problem)
            found.append(current)
            k = at_photo[left]
            current.centres[k], current.rotations[k] = np.array(model.centre), np.eye(3)
        k = at_photo[right]
        current.centres[k] = np.array(model.centre) + np.array(model.base)
        current.rotations[k] = rotation_matrix(*model.rotation)
        seen = [(at_point[p.point], p.X, p.Y, p.Z) for p in model.points if p.point in at_point]
        at = np.array([k for k, *_ in seen], dtype=np.intp)
        new = np.isnan(current.points[at, 0])
        current.points[at[new]] = np.array([xyz for _, *xyz in seen]).reshape(-1, 3)[new]
        preceding = model
    return found


def _model(
    block: Block,
    strip: Strip,
    photos: tuple[str, str],
    rows: dict[str, list[ImagePoint]],
    camera_of: dict[str, Camera],
    preceding: ModelSolution | None,
) -> ModelSolution | None:
    """Orient one model without the points that contradict the others most."""
    name = model_name(*photos)
    measured = [points_of(rows.get(photo, ()), photo, name) for photo in photos]
    left, right = ({n: (p.x, p.y) for n, p in points.items()} for points in measured)
    off = rows_off(*measured)
    precision = block.precision
    if precision.tie_variance == "exact":
        # the same orientation, without statistics that nobody looks at
        precision = replace(precision, tie_variance="propagated")
    allowed = 2 + len(left) // 10
    while True:
        pair = stereopair(
            photos,
            left,
            right,
            (camera_of[photos[0]], camera_of[photos[1]]),
            preceding=preceding,
            base=strip.base,
            off=off,
        )
        try:
            model = orient(pair, precision, block.test)
        except WrongPointsError as error:
            if allowed <= 0:
                return None
            wrong = list(error.suspects)
        except NotComputableError:
            return None
        else:
            rough = (model.sigma0_um or 0.0) > 20.0 * block.precision.image_um
            if not rough or allowed <= 0:
                return model
            worst = max(model.table, key=lambda row: row.size or 0.0)
            if not worst.flagged:
                return model
            if model.redundancy < _TELLS_WHICH:
                # rounding alone would choose; without a model the photo follows by resection
                return None
            wrong = [worst.point]
        for point in wrong:
            left.pop(point, None)
        allowed -= len(wrong)
