"""The regular blocks of Gruen 1980, Figures 1 and 2; the unit of length is the base."""

from __future__ import annotations

import numpy as np
from bundleblocks import Scene, make_scene

from anaplot.photogrammetry.block import ControlPoint

C, BASE_MM = 150.0, 92.0

CONTROL = {
    7: {2: (0, 2, 4, 6), 3: (0, 3, 6), 6: (0, 6)},
    4: {1: (0, 1, 2, 3), 2: (0, 1.5, 3), 3: (0, 3)},
}


def regular(n: int, side: int, distance: int, *, twin: bool = False, noise_um: float = 0.0,
            seed: int = 0) -> Scene:  # fmt: skip
    """n x n photos, side x side points each (3 or 5), control at a bridging distance.

    A twin stands beside every full control point, 0.05 away along x.
    """
    height = C / BASE_MM
    step = 1.0 if side == 3 else 0.5
    xs = np.arange(0, n - 1 + step / 2, step)
    ys = np.arange(-1, n + step / 2, step)
    points = {f"{x:g}_{y:g}": (float(x), float(y), 0.0) for y in ys for x in xs}
    lattice = CONTROL[n][distance]
    at = [(x, y) for x in lattice for y in lattice]
    if len(lattice) == 2:
        at.append(((n - 1) / 2,) * 2)
    control = []
    for x, y in at:
        full = x in (0, n - 1) or y in (0, n - 1)
        name = f"{x:g}_{y:g}"
        points[name] = (float(x), float(y), 0.0)
        xyz = points[name] if full else (None, None, 0.0)
        control.append(ControlPoint(name, xyz, (0.0, 0.0, 0.0)))
        if twin and full:
            # towards the middle of the block, so that the same photos see it
            off = 0.05 if x < (n - 1) / 2 else -0.05
            name = f"t{name}"
            points[name] = (x + off, float(y), 0.0)
            control.append(ControlPoint(name, points[name], (0.0, 0.0, 0.0)))
    photos = {f"{i}-{j}": (np.array([i, j, height]), np.eye(3)) for j in range(n) for i in range(n)}

    def column(point: str) -> float:
        return points[point.removeprefix("t")][0]

    def sees(photo: str, point: str, xy) -> bool:
        i, j = (int(k) for k in photo.split("-"))
        x, y, _ = points[point.removeprefix("t")]
        return abs(x - i) < 1.01 and abs(y - j) < 1.01

    def models(photo: str, point: str):
        i, j = (int(k) for k in photo.split("-"))
        if 0 < i < n - 1 and column(point) == i:
            return (f"{i - 1}-{j}/{i}-{j}", f"{i}-{j}/{i + 1}-{j}")
        return (None,)

    return make_scene(photos, points, c=C, control=control, sees=sees, models=models,
                      noise_um=noise_um, seed=seed)  # fmt: skip


def classes(problem) -> dict[str, list[tuple[int, int]]]:
    """(ray, axis) of each class of Table 2."""
    inner = np.array(
        [problem.block.image_points[k].model is not None for k in problem.source.tolist()]
    )
    control = np.isfinite(problem.known).any(axis=1)
    # twin rays count as one
    pairs = np.unique(np.stack((problem.point, problem.photo), axis=1), axis=0)
    rays = np.bincount(pairs[:, 0], minlength=len(problem.points))
    out: dict[str, list[tuple[int, int]]] = {}
    for ray, point in enumerate(problem.point.tolist()):
        count = rays[point]
        kind = "I" if inner[ray] else "O"
        if control[point]:
            names = (f"CR{kind}4/9",) * 2
        elif count >= 4:
            names = (f"R{kind}4/9",) * 2
        elif count == 3:
            names = ("RI3",) * 2 if inner[ray] else ("RO3(x)", "RO3(y)")
        else:
            names = ("R2(x)", "R2(y)")
        for axis in (0, 1):
            out.setdefault(names[axis], []).append((ray, axis))
    return out
