"""Fourteen kinds of random blocks of which nothing but the measurements is known, with their truth.

Each maker takes a random generator and how many times the smallest block it shall be, and lays
photos and points out; what sees what, noise and control are the same for all.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace

import numpy as np
from bundleblocks import Scene

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
from anaplot.photogrammetry.camera import BrownLens
from anaplot.photogrammetry.collinearity import project
from anaplot.photogrammetry.measuredimage import ideal_rays, measured_rays
from anaplot.photogrammetry.rotation import rotation_matrix

NORMAL_C, METRIC_C = 50.0, 150.0


@dataclass
class Layout:
    """Where photos and points are, before anything is measured.

    Attributes
    ----------
    centres, rotations, points
        (n, 3), (n, 3, 3) and (p, 3).
    cameras, camera
        The cameras, and (n,) which of them a photo was taken with; None: all with the first.
    half
        Half the side of an image over c.
    normals
        (p, 3) away from the surface: a point is seen from this side alone; None: from everywhere.
    share
        Share of the rays that are measured.
    control
        Points of known coordinates, and their sigma [m].
    strips
        Photos of declared strips.
    """

    centres: np.ndarray
    rotations: np.ndarray
    points: np.ndarray
    cameras: tuple[Camera, ...] = (Camera("cam", NORMAL_C),)
    camera: np.ndarray | None = None
    half: float = 0.7
    normals: np.ndarray | None = None
    share: float = 1.0
    control: tuple[int, float] = (3, 0.001)
    strips: list[list[int]] = field(default_factory=list)


def strip(rng: np.random.Generator, size: int) -> Layout:
    """One strip of 60 %, in both directions, declared or not."""
    layout = _flight(rng, 1, 4 * size, across=1.0)
    return replace(layout, strips=layout.strips if rng.random() < 0.5 else [])


def block(rng: np.random.Generator, size: int) -> Layout:
    """Strips of 60 %, side lap 20 to 60 %, declared or not."""
    layout = _flight(rng, 2 + size, 3 + size, across=rng.uniform(1.0, 2.0))
    return replace(layout, strips=layout.strips if rng.random() < 0.5 else [])


def ring(rng: np.random.Generator, size: int) -> Layout:
    """Photos all around an object that all of them see whole, rolled anyhow."""
    count = int(rng.integers(4, 9)) * size
    around = 2.0 * np.pi * np.arange(count) / count
    return looking_in(
        rng, around, np.full(count, 0.35), 12.0, rng.uniform(-3.0, 3.0, (40 * size, 3))
    )


def cube(rng: np.random.Generator, size: int) -> Layout:
    """Photos from anywhere on a sphere around 27 points of a cube."""
    count = int(rng.integers(4, 7)) * size
    grid = np.stack(np.meshgrid(*[np.arange(-1.0, 2.0)] * 3), axis=-1).reshape(-1, 3)
    return replace(
        looking_in(
            rng,
            rng.uniform(0.0, 2.0 * np.pi, count),
            np.arcsin(rng.uniform(0.0, 0.95, count)),
            5.0,
            grid + rng.normal(0.0, 0.05, grid.shape),
        ),
        control=(8, 0.0),
    )


def facade(rng: np.random.Generator, size: int) -> Layout:
    """A wall with ledges, along which one walks; every third photo is turned by 90 degrees."""
    count = 4 * size
    x = np.arange(count) * 4.0
    points = rng.uniform((-6.0, 0.0, -0.8), (x[-1] + 6.0, 12.0, 0.8), (25 * count, 3))
    centres = np.column_stack((x, rng.uniform(1.0, 3.0, count), rng.uniform(11.0, 14.0, count)))
    aims = centres + np.column_stack(
        (rng.normal(0.0, 3.0, count), rng.uniform(3.0, 6.0, count), -centres[:, 2])
    )
    roll = np.where(np.arange(count) % 3 == 2, np.pi / 2.0, 0.0)
    return Layout(centres, _aimed(centres, aims, roll), points, control=(6, 0.005))


def oblique(rng: np.random.Generator, size: int) -> Layout:
    """From each place one photo down and four 45 degrees off it."""
    side = 1 + size
    x, y = (g.ravel() * 60.0 for g in np.meshgrid(np.arange(float(side)), np.arange(float(side))))
    places = np.column_stack((x, y, np.full(len(x), 100.0)))
    centres = np.repeat(places, 5, axis=0)
    toward = np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]]) * 100.0
    aims = centres + np.column_stack(
        (np.tile(toward, (len(places), 1)), np.full(len(centres), -100.0))
    )
    aims += rng.normal(0.0, 4.0, aims.shape)
    points = rng.uniform(
        (-130.0, -130.0, -8.0), (x.max() + 130.0, y.max() + 130.0, 8.0), (90 * side * side, 3)
    )
    return Layout(centres, _aimed(centres, aims, 0.0), points, control=(5, 0.02))


def drone(rng: np.random.Generator, size: int) -> Layout:
    """A grid of 80/60 % with cross strips above it, turned by quarters, tilted by 5 degrees."""
    along, across = 3 + 2 * size, 2 + size
    places = []
    for high, (n, m), (a, b) in ((80.0, (along, across), (22.0, 44.0)),
                                 (95.0, (across, along), (44.0, 22.0))):  # fmt: skip
        x, y = (g.ravel() for g in np.meshgrid(np.arange(n) * a, np.arange(m) * b))
        places.append(np.column_stack((x, y, np.full(len(x), high))))
    centres = np.concatenate(places) + rng.normal(0.0, 1.0, (2 * along * across, 3))
    kappa = rng.choice([0.0, np.pi / 2, np.pi, -np.pi / 2], len(centres))
    rotations = _turned(rng, kappa, 0.09)
    low, high = centres.min(axis=0), centres.max(axis=0)
    count = int(0.05 * (np.ptp(centres[:, 0]) + 60.0) * (np.ptp(centres[:, 1]) + 60.0))
    points = rng.uniform(
        (low[0] - 30.0, low[1] - 30.0, -4.0), (high[0] + 30.0, high[1] + 30.0, 4.0), (count, 3)
    )
    return Layout(centres, rotations, points, control=(5, 0.02), share=0.7)


def two_cameras(rng: np.random.Generator, size: int) -> Layout:
    """A ring with a wide and a long lens in turn."""
    layout = ring(rng, size)
    at = np.arange(len(layout.centres)) % 2
    return replace(
        layout, cameras=(Camera("wide", 28.0), Camera("long", 85.0)), camera=at, half=0.9
    )


def pixels(rng: np.random.Generator, size: int) -> Layout:
    """A ring in pixels, through a lens that bends them by a tenth."""
    camera = Camera("px", 3.2, pixels=(4000, 4000), lens=BrownLens(k1=-0.11, k2=0.04, p1=5e-4))
    return replace(ring(rng, size), cameras=(camera,), half=0.6)


def planar(rng: np.random.Generator, size: int) -> Layout:
    """Convergent photos of a plane, from one side of it."""
    count = 4 + 2 * size
    points = rng.uniform(-3.0, 3.0, (40 * size, 3)) * (1.0, 1.0, 0.0)
    return looking_in(
        rng, rng.uniform(0.0, 2.0 * np.pi, count), rng.uniform(0.6, 1.3, count), 11.0, points
    )


def long_lens(rng: np.random.Generator, size: int) -> Layout:
    """Oblique photos of a plane from so far that rays are nearly parallel."""
    count = 6 * size
    points = rng.uniform(-3.0, 3.0, (40 * size, 3)) * (1.0, 1.0, 0.003)
    around, up = rng.uniform(0.0, 1.2, count), rng.uniform(0.7, 1.4, count)
    layout = looking_in(rng, around, up, 70.0, points)
    return replace(layout, cameras=(Camera("long", 300.0),))


def three_photos(rng: np.random.Generator, size: int) -> Layout:
    """Three convergent photos of few points."""
    around = rng.uniform(0.0, 2.0 * np.pi) + np.arange(3) * rng.uniform(0.35, 0.8)
    points = rng.uniform(-3.0, 3.0, (14 * size, 3))
    return looking_in(rng, around, rng.uniform(0.1, 0.6, 3), 12.0, points)


def few_rays(rng: np.random.Generator, size: int) -> Layout:
    """A ring around a solid object: of a point's rays a third is measured, mostly two or three."""
    layout = outside(rng, 10 * size, 90 * size)
    return replace(layout, share=0.8)


def outside(rng: np.random.Generator, count: int, points: int) -> Layout:
    """Photos around a solid cylinder: points are seen from their side only."""
    around = 2.0 * np.pi * np.arange(count) / count
    at = rng.uniform(0.0, 2.0 * np.pi, points)
    normals = np.column_stack((np.cos(at), np.sin(at), np.zeros(points)))
    radius = rng.uniform(2.4, 3.2, points)
    places = normals * radius[:, None] + np.outer(rng.uniform(-2.5, 2.5, points), [0.0, 0.0, 1.0])
    layout = looking_in(rng, around, rng.uniform(0.0, 0.5, count), 12.0, places)
    return replace(layout, normals=normals)


def building(rng: np.random.Generator, count: int, points: int) -> Layout:
    """A walk around a building, near its walls; every fifth photo is turned by 90 degrees."""
    side, corner = 40.0, np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.0, 0.0]])
    outward = np.array([[0.0, -1.0], [1.0, 0.0], [0.0, 1.0], [-1.0, 0.0]])
    wall, along = np.divmod(4.0 * np.arange(count) / count, 1.0)
    at = _along(corner, wall.astype(int), along) * side
    path = side / 2.0 + 1.6 * (at - side / 2.0) + rng.normal(0.0, 0.7, at.shape)
    centres = np.column_stack((path, rng.uniform(1.0, 8.0, count)))
    aims = np.column_stack((at + rng.normal(0.0, 4.0, at.shape), rng.uniform(2.0, 8.0, count)))
    roll = np.where(np.arange(count) % 5 == 0, np.pi / 2.0, 0.0)
    which = rng.integers(0, 4, points)
    normals = np.column_stack((outward[which], np.zeros(points)))
    places = np.column_stack(
        (_along(corner, which, rng.random(points)) * side, rng.uniform(0.0, 12.0, points))
    )
    return Layout(
        centres,
        _aimed(centres, aims, roll),
        places + normals * rng.normal(0.0, 0.4, points)[:, None],
        cameras=(Camera("px", 4.0, pixels=(4000, 4000)),),
        half=0.5,
        normals=normals,
        share=0.5,
        control=(6, 0.01),
    )


def _along(corner: np.ndarray, wall: np.ndarray, share: np.ndarray) -> np.ndarray:
    """(n, 2) places along walls, from corner to corner."""
    return np.asarray(corner[wall] + (corner[wall + 1] - corner[wall]) * share[:, None])


def with_mismatches(
    scene: Scene, rng: np.random.Generator, share: float, far: float = 0.1
) -> Scene:
    """Some rays are of something else: they lie up to `far`, of c, away."""
    rows = scene.block.image_points
    most = far * scene.block.cameras[0].c
    off = rng.uniform(-most, most, (len(rows), 2)) * (rng.random(len(rows)) < share)[:, None]
    moved = (
        replace(row, x=row.x + dx, y=row.y + dy)
        for row, (dx, dy) in zip(rows, off.tolist(), strict=True)
    )
    return replace(scene, block=replace(scene.block, image_points=tuple(moved)))


def turntable(rng: np.random.Generator, size: int) -> Layout:
    """Photos every ten degrees around a small object: in so narrow a field two see no depth."""
    count = 36
    angle, height = rng.uniform(0.0, 2.0 * np.pi, 150 * size), rng.uniform(0.0, 0.2, 150 * size)
    normals = np.column_stack((np.cos(angle), np.sin(angle), np.zeros(len(angle))))
    points = 0.08 * normals + rng.normal(0.0, 0.004, normals.shape)
    points[:, 2] += height - 0.1
    layout = looking_in(
        rng, 2.0 * np.pi * np.arange(count) / count, np.full(count, 0.45), 1.1, points
    )
    aims = rng.normal(0.0, 0.005, layout.centres.shape)
    return replace(
        layout,
        rotations=_aimed(layout.centres, aims, 0.0),
        cameras=(Camera("metric", METRIC_C),),
        half=0.3,
        normals=normals,
        control=(5, 1e-5),
    )


KINDS: dict[str, Callable[[np.random.Generator, int], Layout]] = {
    "strip": strip,
    "block": block,
    "ring": ring,
    "cube": cube,
    "facade": facade,
    "oblique": oblique,
    "drone": drone,
    "two cameras": two_cameras,
    "pixels": pixels,
    "planar": planar,
    "flat, long lens": long_lens,
    "three photos": three_photos,
    "few rays": few_rays,
    "turntable": turntable,
}


def measured(layout: Layout, rng: np.random.Generator, noise: float = 1.0) -> Scene:
    """Measure every point in every photo that sees it, with half a pixel or 5 um of noise."""
    n, p = len(layout.centres), len(layout.points)
    which = np.zeros(n, dtype=int) if layout.camera is None else layout.camera
    photos, rays = [f"f{k + 1}" for k in range(n)], []
    for k in range(n):
        camera = layout.cameras[which[k]]
        centre, rotation = layout.centres[k], layout.rotations[k]
        seen = project(
            np.tile(centre, (p, 1)),
            np.tile(rotation, (p, 1, 1)),
            np.full(p, camera.c),
            layout.points,
        )
        good = (seen.depth > 0.0) & (np.abs(seen.xy).max(axis=1) < layout.half * camera.c)
        if layout.normals is not None:
            away = centre - layout.points
            away /= np.linalg.norm(away, axis=1)[:, None]
            good &= np.einsum("ij,ij->i", away, layout.normals) > 0.25
        good &= rng.random(p) < layout.share
        at = np.flatnonzero(good)
        xy = measured_rays(camera, seen.xy[at])
        xy = ideal_rays(camera, xy + rng.normal(0.0, noise * _sigma_mm(camera), xy.shape))
        rays += [(k, int(i), *place) for i, place in zip(at, xy.tolist(), strict=True)]
    count = np.bincount([ray[1] for ray in rays], minlength=p)
    rays = [ray for ray in rays if count[ray[1]] > 1]
    chosen, sigma = layout.control
    known = _spread(layout.points, np.flatnonzero(count > 2), chosen)
    made = Block(
        "synthetic",
        Precision(image_um=1e3 * _sigma_mm(layout.cameras[0]), tie_variance="propagated"),
        TestSettings(),
        layout.cameras,
        tuple(Photo(photos[k], layout.cameras[which[k]].id) for k in range(n)),
        tuple(
            Strip(f"s{k}", tuple(photos[i] for i in names)) for k, names in enumerate(layout.strips)
        ),
        tuple(ImagePoint(photos[k], f"p{i}", x, y) for k, i, x, y in rays),
        tuple(ControlPoint(f"p{i}", tuple(layout.points[i].tolist()), (sigma,) * 3) for i in known),
    )
    return Scene(
        made,
        dict(zip(photos, layout.centres, strict=True)),
        dict(zip(photos, layout.rotations, strict=True)),
        {f"p{i}": layout.points[i] for i in range(p)},
    )


def _sigma_mm(camera: Camera) -> float:
    return 0.5 * camera.pixel_mm if camera.pixels else 0.005


def _flight(rng: np.random.Generator, strips: int, length: int, across: float) -> Layout:
    """Vertical photos of 60 % along the strips; every second strip is flown back."""
    base, height = 600.0, 1000.0
    centres, kappa, names = [], [], []
    for j in range(strips):
        names.append([j * length + i for i in range(length)])
        for i in range(length):
            centres.append((i * base, j * across * base, height))
            kappa.append(np.pi * (j % 2))
        if j % 2:
            names[-1].reverse()
    at = np.array(centres) + rng.normal(0.0, 15.0, (strips * length, 3))
    low, high = at.min(axis=0) - base, at.max(axis=0) + base
    count = int(3e-5 * (high[0] - low[0]) * (high[1] - low[1]))
    points = rng.uniform((low[0], low[1], -40.0), (high[0], high[1], 40.0), (count, 3))
    return Layout(
        at,
        _turned(rng, np.array(kappa), 0.03),
        points,
        cameras=(Camera("cam", METRIC_C),),
        control=(5, 0.05),
        strips=names,
    )


def looking_in(
    rng: np.random.Generator,
    around: np.ndarray,
    up: np.ndarray,
    distance: float,
    points: np.ndarray,
) -> Layout:
    """Photos that look at the middle from everywhere, rolled anyhow."""
    centres = distance * np.column_stack(
        (np.cos(around) * np.cos(up), np.sin(around) * np.cos(up), np.sin(up))
    )
    aims = rng.normal(0.0, 0.3, centres.shape)
    return Layout(centres, _aimed(centres, aims, rng.uniform(-3.0, 3.0, len(centres))), points)


def _aimed(centres: np.ndarray, aims: np.ndarray, roll: np.ndarray | float) -> np.ndarray:
    """(n, 3, 3) rotations of photos that look at a place each."""
    z = centres - aims
    z /= np.linalg.norm(z, axis=1)[:, None]
    level = np.where(np.abs(z[:, 2:]) > 0.99, [[0.0, 1.0, 0.0]], [[0.0, 0.0, 1.0]])
    x = np.cross(level, z)
    x /= np.linalg.norm(x, axis=1)[:, None]
    turn = np.array([rotation_matrix(0.0, 0.0, k) for k in np.broadcast_to(roll, len(z)).tolist()])
    return np.matmul(np.stack((x, np.cross(z, x), z), axis=2), turn)


def looking_at(centres: np.ndarray, aims: np.ndarray) -> np.ndarray:
    """(n, 3, 3) rotations of upright photos that look at a place each."""
    return _aimed(centres, aims, 0.0)


def _turned(rng: np.random.Generator, kappa: np.ndarray, tilt: float) -> np.ndarray:
    """(n, 3, 3) rotations of photos that look down."""
    return np.array(
        [
            rotation_matrix(0.0, 0.0, k) @ rotation_matrix(*(rng.normal(size=3) * tilt))
            for k in kappa.tolist()
        ]
    )


def _spread(points: np.ndarray, among: np.ndarray, count: int) -> Iterable[int]:
    """Points far apart from each other, one after the other; all where there are no more."""
    chosen = [int(among[0])]
    while len(chosen) < min(count, len(among)):
        off = np.linalg.norm(points[among][:, None] - points[chosen][None], axis=2).min(axis=1)
        chosen.append(int(among[np.argmax(off)]))
    return chosen
