"""Vertical photographs in any flight pattern: turned images, weak ties, parts joined by control."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bundleblocks import make_scene

from anaplot.bundle.adjust import adjust_block, adjust_bundle
from anaplot.bundle.solve.problem import make_problem
from anaplot.bundle.start.vertical import vertical_subblock
from anaplot.errors import NotComputableError
from anaplot.photogrammetry.block import ControlPoint, Strip
from anaplot.photogrammetry.rotation import rotation_matrix

pytestmark = pytest.mark.slow

HALF = 114.0
BASE, LINE, HEIGHT = 920.0, 1600.0, 1524.0


def flown(
    seed: int,
    *,
    strips: int = 3,
    per: int = 5,
    kappa: float | None = 0.0,
    tilt: float = 3.0,
    first_row: float = -800.0,
    declared: bool = True,
    sigma: float = 0.05,
):
    """Strips flown to and fro with few points; kappa None: every image is turned at random."""
    rng = np.random.default_rng(seed)
    photos, lines = {}, []
    for s in range(strips):
        row = []
        for k in range(per):
            name = f"{s + 1}{k + 1:02d}"
            centre = np.array([5000.0 + BASE * k, 8000.0 + LINE * s, HEIGHT + 300.0])
            turn = rng.uniform(-np.pi, np.pi) if kappa is None else kappa + np.pi * (s % 2)
            lean = rng.uniform(-1.0, 1.0, 2) * np.radians(tilt)
            photos[name] = (
                centre + rng.normal(size=3) * 20.0,
                rotation_matrix(lean[0], lean[1], turn + rng.normal() * 0.05),
            )
            row.append(name)
        lines.append(Strip(str(s + 1), tuple(row if s % 2 == 0 else row[::-1])))
    points, control = {}, []
    rows = 2 * strips + 1
    for gx in range(2 * per + 1):
        for gy in range(rows + 1):
            at = np.array([4540.0 + 460.0 * gx, 8000.0 + first_row + 800.0 * gy, 300.0])
            at += rng.normal(size=3) * [20.0, 20.0, 40.0]
            points[f"g{gx}_{gy}"] = at
            off = at + rng.normal(size=3) * sigma
            if (gx in (0, 2 * per) and gy % 2 == 0) or (gx % 4 == 0 and gy in (0, rows)):
                control.append(ControlPoint(f"g{gx}_{gy}", tuple(off.tolist()), (sigma,) * 3))
            elif gx % 3 == 0:
                xyz = (None, None, float(off[2]))
                control.append(ControlPoint(f"g{gx}_{gy}", xyz, (None, None, sigma)))
    return make_scene(
        photos,
        points,
        c=152.4,
        control=control,
        strips=lines if declared else (),
        sees=lambda photo, point, xy: bool(np.abs(xy).max() < HALF),
        noise_um=5.0,
        seed=seed,
    )


def adjusts_as_from_the_truth(scene, datum="control", block=None):
    block = block or scene.block
    problem = make_problem(block, datum=datum)
    truth = adjust_bundle(problem, scene.start(problem))
    found = adjust_block(block, datum=datum)
    assert found.vtpv == pytest.approx(truth.vtpv, rel=1e-6)
    assert found.sigma0 is not None
    assert found.sigma0 < 1.4
    return found


@pytest.mark.parametrize("kappa", [0.0, 1.0, 2.5, -1.57, None])
@pytest.mark.parametrize("declared", [True, False])
def test_turned_images(kappa, declared) -> None:
    adjusts_as_from_the_truth(flown(1, kappa=kappa, declared=declared))


@pytest.mark.parametrize("seed", range(4))
def test_tilts_of_five_degrees_and_a_free_datum(seed: int) -> None:
    scene = flown(seed, kappa=None, tilt=5.0, strips=2, per=4, declared=False)
    adjusts_as_from_the_truth(scene)
    adjusts_as_from_the_truth(scene, "free", replace(scene.block, control=()))


@pytest.mark.parametrize("kappa", [0.0, 2.5])
def test_strips_that_share_control_only(kappa: float) -> None:
    # rows of points that no two strips have in common but for a few on control
    scene = flown(2, kappa=kappa, first_row=-1200.0)
    held = {c.point for c in scene.block.control}
    rows = []
    for row in scene.block.image_points:
        own = row.point if row.point in held else f"{row.point}_{row.photo[0]}"
        scene.points[own] = scene.points[row.point]
        rows.append(replace(row, point=own))
    adjusts_as_from_the_truth(scene.with_rows(rows))


def test_a_part_without_enough_control_is_named() -> None:
    scene = flown(3)
    # strip 3 has points of its own alone, and of its control two heights
    rows = [
        replace(r, point=f"q{r.point}") if r.photo[0] == "3" else r
        for r in scene.block.image_points
    ]
    control = [c for c in scene.block.control if any(r.point == c.point for r in rows)]
    heights = [
        ControlPoint(f"qg{gx}_6", (None, None, float(scene.points[f"g{gx}_6"][2]))) for gx in (2, 6)
    ]
    block = replace(scene.block, image_points=tuple(rows), control=(*control, *heights))
    with pytest.raises(NotComputableError) as caught:
        adjust_block(block)
    text = str(caught.value)
    assert "2 disconnected parts" in text
    for photo in ("301", "302", "303", "304", "305"):
        assert photo in text
    assert "201" not in text


def test_control_measured_in_one_photo_is_enough() -> None:
    # the datum hangs on corner points that no second photo sees
    scene = flown(4, kappa=1.0, declared=False, sigma=0.0)
    corners = {f"g{gx}_{gy}" for gx in (0, 10) for gy in (0, 6)}
    seen: set[str] = set()
    rows = []
    for row in scene.block.image_points:
        if row.point in corners:
            if row.point in seen:
                continue
            seen.add(row.point)
        rows.append(row)
    control = tuple(c for c in scene.block.control if c.point in corners or c.xyz[0] is None)
    scene = scene.with_rows(rows)
    assert len(seen) >= 3
    adjusts_as_from_the_truth(scene, block=replace(scene.block, control=control))


def told(block) -> str:
    """What a person is told: the worst suspect and the remarks, or the reason of the refusal."""
    try:
        found = adjust_block(block)
    except NotComputableError as error:
        return str(error)
    _, photo, point, _ = found.suspects()[0]
    return f"point {point} in photo {photo}; {' '.join(found.remarks)}"


@pytest.mark.parametrize("size", [0.5, 5.0, 100.0])
def test_one_gross_error_is_named(size: float) -> None:
    rng = np.random.default_rng(int(size * 10))
    scene = flown(5, kappa=None, declared=False)
    rays: dict[str, int] = {}
    for row in scene.block.image_points:
        rays[row.point] = rays.get(row.point, 0) + 1
    for _ in range(4):
        k = int(rng.integers(len(scene.block.image_points)))
        while rays[scene.block.image_points[k].point] < 4:
            k = int(rng.integers(len(scene.block.image_points)))
        rows = list(scene.block.image_points)
        rows[k] = replace(rows[k], y=rows[k].y - np.copysign(size, rows[k].y))
        name = f"point {rows[k].point} in photo {rows[k].photo}"
        assert name in told(replace(scene.block, image_points=tuple(rows)))


def test_swapped_control_ids_are_named() -> None:
    scene = flown(6, kappa=2.0)
    control = list(scene.block.control)
    full = [k for k, c in enumerate(control) if c.xyz[0] is not None]
    i, j = full[0], full[-1]
    control[i], control[j] = (
        replace(control[i], xyz=control[j].xyz),
        replace(control[j], xyz=control[i].xyz),
    )
    text = told(replace(scene.block, control=tuple(control)))
    assert f"control point {control[i].point}" in text
    assert f"control point {control[j].point}" in text


def test_level_values_are_near_the_truth() -> None:
    scene = flown(7, kappa=None)
    problem = make_problem(scene.block)
    subblock = vertical_subblock(problem)
    assert subblock is not None
    for k, name in enumerate(problem.photos):
        assert np.linalg.norm(subblock.centres[k] - scene.centres[name]) < 0.15 * HEIGHT
        turn = subblock.rotations[k].T @ scene.rotations[name]
        assert np.degrees(np.arccos((np.trace(turn) - 1.0) / 2.0)) < 8.0
