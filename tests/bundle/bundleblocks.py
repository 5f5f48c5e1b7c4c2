"""Synthetic blocks for the tests of this room, with their truth."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from anaplot.bundle.errors.grosserrors import BlockFindings
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.problem import Problem
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
from anaplot.photogrammetry.rotation import rotation_angles, rotation_matrix
from anaplot.planning.networkplan import cube as planned_cube


@dataclass
class Scene:
    """A block and what it was made from."""

    block: Block
    centres: dict[str, np.ndarray]
    rotations: dict[str, np.ndarray]
    points: dict[str, np.ndarray]

    def start(self, problem: Problem, rng=None, shift=0.0, turn=0.0) -> BlockState:
        """Return true values, disturbed by `shift` [m] and `turn` [rad]."""
        centres = np.array([self.centres[p] for p in problem.photos])
        rotations = np.array([self.rotations[p] for p in problem.photos])
        points = np.array([self.points[p] for p in problem.points])
        if rng is not None:
            centres = centres + rng.normal(size=centres.shape) * shift
            points = points + np.where(problem.fixed, 0.0, rng.normal(size=points.shape) * shift)
            rotations = np.array(
                [r @ rotation_matrix(*(rng.normal(size=3) * turn)) for r in rotations]
            )
        origin = points.mean(axis=0)
        return BlockState(
            centres - origin,
            rotations,
            points - origin,
            np.zeros((len(centres), problem.per_photo - 6)),
            np.zeros(problem.in_border),
            origin,
        )

    def with_rows(self, rows) -> Scene:
        return replace(self, block=replace(self.block, image_points=tuple(rows)))


def make_scene(
    photos,
    points,
    *,
    c=150.0,
    control=(),
    strips=(),
    sees=None,
    noise_um=0.0,
    sigma_um=5.0,
    test=None,
    seed=0,
    models=None,
    distort=None,
) -> Scene:
    """Photograph points: photos {id: (centre, rotation)}, points {id: xyz}.

    `sees(photo, point, xy)` says which rays exist; `models(photo, point)` the models in which a
    ray is measured, one row for each; `distort(x, y)` adds an image error [mm].
    """
    rng = np.random.default_rng(seed)
    rows = []
    names = list(points)
    at = np.array([points[n] for n in names])
    for photo, (centre, rotation) in photos.items():
        n = len(names)
        seen = project(
            np.broadcast_to(centre, (n, 3)),
            np.broadcast_to(rotation, (n, 3, 3)),
            np.full(n, c),
            at,
        )
        for name, xy, depth in zip(names, seen.xy, seen.depth, strict=True):
            if depth <= 0 or (sees is not None and not sees(photo, name, xy)):
                continue
            for model in models(photo, name) if models else (None,):
                off = rng.normal(size=2) * noise_um * 1e-3
                extra = distort(*xy) if distort else (0.0, 0.0)
                rows.append(
                    ImagePoint(
                        photo,
                        name,
                        xy[0] + off[0] + extra[0],
                        xy[1] + off[1] + extra[1],
                        None,
                        model,
                    )
                )
    block = Block(
        name="synthetic",
        precision=Precision(image_um=sigma_um, tie_variance="propagated"),
        test=test or TestSettings(),
        cameras=(Camera("cam", c),),
        photos=tuple(Photo(p, "cam") for p in photos),
        strips=tuple(strips),
        image_points=tuple(rows),
        control=tuple(control),
    )
    return Scene(
        block,
        {p: np.asarray(v[0], float) for p, v in photos.items()},
        {p: np.asarray(v[1], float) for p, v in photos.items()},
        {p: np.asarray(v, float) for p, v in points.items()},
    )


def known_in(one: ControlPoint, axes: str) -> ControlPoint:
    """Return a control point of which nothing is known along the other axes."""
    return replace(
        one,
        xyz=tuple(v if a in axes else None for a, v in zip("XYZ", one.xyz, strict=True)),
        sigma=tuple(s if a in axes else None for a, s in zip("XYZ", one.sigma, strict=True)),
    )


def off_by(scene: Scene, cleaned: BlockFindings) -> float:
    """Return by how much the worst projection centre is off [m]."""
    state = cleaned.block.state
    true = np.array([scene.centres[name] for name in cleaned.block.problem.photos])
    return float(np.linalg.norm(state.centres + state.origin - true, axis=1).max())


# --- Gruen 1978, Figure 2 -------------------------------------------------------------------


def cube(version: str, **options) -> Scene:
    """Gruen's cube: 27 points, the corners are control free of error."""
    made = planned_cube(version)
    photos = {photo: (s.centre, s.rotation) for photo, s in made.stations.items()}
    return make_scene(photos, made.points, c=100.0, control=made.control, **options)


# --- aerial blocks --------------------------------------------------------------------------


def aerial(
    strips=2,
    length=4,
    *,
    per_base=1,
    base=600.0,
    height=1000.0,
    c=150.0,
    relief=30.0,
    tilt=0.02,
    control_sigma=0.0,
    seed=0,
    priors=False,
    forward=True,
    turned=False,
    **options,
) -> Scene:
    """A 60/60 block: photos at (i, j) base lengths, a point grid of 1 / per_base bases."""
    rng = np.random.default_rng(seed + 1000)
    photos, declared, points = {}, [], {}
    for j in range(strips):
        names = [f"{j + 1}{i + 1:02d}" for i in range(length)]
        back = turned and j % 2 == 1
        for i in range(length):
            at = np.array([i * base, j * base, height])
            kappa = np.pi if back else 0.0
            photos[names[i]] = (
                at,
                rotation_matrix(0, 0, kappa) @ rotation_matrix(*rng.normal(size=3) * tilt),
            )
        declared.append(Strip(f"s{j + 1}", tuple(reversed(names) if back else names)))
    number = 0
    lines_x = np.arange(0, (length - 1) * per_base + 1) / per_base
    lines_y = np.arange(-per_base, strips * per_base + 1) / per_base
    for y in lines_y:
        for x in lines_x:
            number += 1
            points[f"p{number}"] = np.array([x * base, y * base, rng.uniform(-1, 1) * relief])
    corners = {
        (x, y)
        for x in (lines_x[0], lines_x[len(lines_x) // 2], lines_x[-1])
        for y in (lines_y[0], lines_y[-1])
    }
    control = [
        ControlPoint(n, tuple(p.tolist()), (control_sigma,) * 3)
        for n, p in points.items()
        if any(abs(p[0] - x * base) < 1 and abs(p[1] - y * base) < 1 for x, y in corners)
    ]
    reach = 1.02 * base * c / height + 0.06 * c

    def sees(photo, point, xy):
        centre = photos[photo][0]
        off = points[point] - centre
        return max(abs(off[0]), abs(off[1])) <= 1.001 * base and np.abs(xy).max() < 2 * reach

    options.setdefault("sees", sees)
    scene = make_scene(photos, points, c=c, control=control, strips=declared, seed=seed, **options)
    if priors:
        block = scene.block
        found = tuple(
            replace(
                p,
                position=tuple((scene.centres[p.id] + rng.normal(size=3) * 0.1).tolist()),
                position_sigma=(0.1,) * 3,
                rotation=rotation_angles(scene.rotations[p.id]),
                rotation_sigma=(1e-3,) * 3,
            )
            for p in block.photos
        )
        scene.block = replace(block, photos=found)
    return scene
