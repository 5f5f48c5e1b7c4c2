"""Epochs of one synthetic object: same photos and points, other noise, and what has moved."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
from bundleblocks import aerial, make_scene

from anaplot.bundle.epochs.displacements import compare_series
from anaplot.bundle.epochs.series import EpochDifferences
from anaplot.exchange.blockfolder import write_new_block
from anaplot.photogrammetry.block import Block, ControlPoint


def compare_epochs(first: Block, second: Block, **options) -> EpochDifferences:
    """Two epochs, compared as `compare_series` does it."""
    return compare_series((first, second), **options).as_two()


@lru_cache(maxsize=1)
def layout():
    return aerial(2, 3, per_base=2, noise_um=0.0, control_sigma=0.02, seed=1)


def epoch(seed, *, moved=None, noise_um=5.0, test=None, control=True, distort=None):
    """The same photos and points with other noise; `moved` {name: displacement [m]}."""
    base = layout()
    points = {
        n: p + np.array((moved or {}).get(n, (0.0, 0.0, 0.0))) for n, p in base.points.items()
    }
    rows = {(r.photo, r.point) for r in base.block.image_points}
    photos = {p: (base.centres[p], base.rotations[p]) for p in base.centres}
    return make_scene(
        photos,
        points,
        control=base.block.control if control else (),
        strips=base.block.strips,
        sees=lambda photo, point, _: (photo, point) in rows,
        noise_um=noise_um,
        seed=seed,
        test=test,
        distort=distort,
    ).block


def heights_only(block, name, *, sigma=0.02, value=None):
    """Give up X and Y of a control point, or add a point of which only Z is given."""
    value = layout().points[name][2] if value is None else value
    row = ControlPoint(name, (None, None, float(value)), (None, None, sigma))
    return replace(block, control=(*(c for c in block.control if c.point != name), row))


def rescaled(block, k):
    """State every a-priori standard deviation k times as large."""
    control = (replace(c, sigma=tuple(s and k * s for s in c.sigma)) for c in block.control)
    precision = replace(block.precision, image_um=k * block.precision.image_um)
    return replace(block, precision=precision, control=tuple(control))


def stable_names():
    return ("p1", "p5", "p16", "p31", "p35")


def cell(value):
    return "" if value is None else repr(float(value))


def written(tmp_path, *blocks):
    folders = dict(zip(("spring", "autumn", "winter", "fourth"), blocks, strict=False))
    for name, block in folders.items():
        write_new_block(tmp_path / name, block)
        lines = ["point,X,Y,Z,sX,sY,sZ,use"]
        for c in block.control:
            assert isinstance(c, ControlPoint)
            lines.append(",".join([c.point, *map(cell, c.xyz), *map(cell, c.sigma), c.use]))
        (tmp_path / name / "control.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
        rows = ["photo,point,x,y"]
        rows += [f"{r.photo},{r.point},{float(r.x)!r},{float(r.y)!r}" for r in block.image_points]
        (tmp_path / name / "image_points.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    return [str(tmp_path / name) for name in folders]
