"""Photos of few rays at the wrong one of the places that three of them make."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from bundleblocks import aerial
from conditionblocks import flat_scene
from gnssblocks import flown

from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.solve.gaussnewton import find_minimum
from anaplot.bundle.start import otherplaces
from anaplot.bundle.start.otherplaces import at_other_places
from anaplot.photogrammetry.block import (
    Block,
    Camera,
    ControlPoint,
    Photo,
    Precision,
    TestSettings,
)
from anaplot.photogrammetry.imagepoint import ImagePoint
from anaplot.photogrammetry.prioroffsets import PriorOffsets
from anaplot.photogrammetry.rotation import rotation_matrix

NADIR, ASLANT = Camera("nadir", 50.0, (54.0, 40.0)), Camera("aslant", 80.0, (54.0, 40.0))


def oblique(seed: int, grid: int) -> tuple[Block, dict[str, np.ndarray]]:
    """Return nine photos that look down and twenty that look aslant, and where they are.

    Those at the edge see five to eight points, most of them with one other ray.
    """
    rng = np.random.default_rng(seed)
    photos = {}
    for i, j in np.ndindex(3, 3):
        at = np.array([150.0 * i, 200.0 * j, 500.0]) + rng.normal(0, 4, 3)
        tilted = rotation_matrix(*np.radians(rng.normal(0, 3, 3)))
        photos[f"n{i}{j}"] = NADIR, at, tilted @ rotation_matrix(0, 0, np.pi * (i % 2))
        for k, azimuth in enumerate((0, np.pi / 2, np.pi, -np.pi / 2) if (i + j) % 2 == 0 else ()):
            turned = rotation_matrix(0, 0, rng.uniform(-0.1, 0.1) - np.pi / 2)
            turned = rotation_matrix(0, 0, azimuth) @ rotation_matrix(0, -np.pi / 4, 0) @ turned
            photos[f"a{i}{j}{k}"] = ASLANT, at + rng.normal(0, 0.3, 3), turned
    steps = np.linspace(0, 1, grid)
    points = {
        f"g{i}-{j}": np.array([1120 * steps[i] - 420, 1260 * steps[j] - 420, rng.uniform(0, 40)])
        for i in range(grid)
        for j in range(grid)
    }
    rays = []
    for photo, (camera, centre, rotation) in photos.items():
        for point, place in points.items():
            seen = (place - centre) @ rotation
            xy = -camera.c * seen[:2] / seen[2]
            if seen[2] < 0 and abs(xy[0]) < 26.9 and abs(xy[1]) < 19.9:
                rays.append((photo, point, *(xy + rng.normal(0, 0.004, 2)).tolist()))
    for column, least in ((1, 2), (0, 5), (1, 2)):
        count = Counter(ray[column] for ray in rays)
        rays = [ray for ray in rays if count[ray[column]] >= least]
    below = sorted({ray[1] for ray in rays if ray[0].startswith("n")})
    places = (0, 0), (300, 0), (0, 400), (300, 400), (150, 200)
    near = [min(below, key=lambda p: np.hypot(*(points[p][:2] - at))) for at in np.array(places)]
    control = tuple(
        ControlPoint(point, tuple((points[point] + rng.normal(0, 0.02, 3)).tolist()), (0.02,) * 3)
        for point in dict.fromkeys(near)
    )
    used = dict.fromkeys(ray[0] for ray in rays)
    block = Block(
        "oblique",
        Precision(image_um=4.0),
        TestSettings("baarda"),
        (NADIR, ASLANT),
        tuple(Photo(photo, photos[photo][0].id) for photo in used),
        (),
        tuple(ImagePoint(*ray) for ray in rays),
        control,
    )
    return block, {photo: centre for photo, (_, centre, _) in photos.items()}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "grid", "sigma0"),
    [
        (25, 10, 4.1),
        (189, 10, 5.25),
        (20, 11, 1.41),
        (22, 11, 74.3),
        (24, 11, 5.73),
        (20, 13, 3.94),
        (177, 13, 11.6),
    ],
)
def test_no_photo_stays_at_a_wrong_place(seed: int, grid: int, sigma0: float) -> None:
    # with `sigma0`, one photo or more hundreds of metres off, and good rays of others rejected
    block, centres = oblique(seed, grid)
    adjusted = adjust_block(block)
    assert adjusted.sigma0 < 1.2 < sigma0
    at = adjusted.state.centres + adjusted.state.origin
    off = {
        photo: np.linalg.norm(at[k] - centres[photo])
        for k, photo in enumerate(adjusted.problem.photos)
    }
    assert max(off.values()) < 30.0, off


@pytest.mark.slow
def test_a_minimum_that_fits_and_one_with_gross_errors_stay() -> None:
    block, _ = oblique(1, 11)
    adjusted = adjust_block(block)
    found = find_minimum(adjusted.problem, adjusted.state, adjusted.cofactors.normal.structure)
    assert at_other_places(adjusted.problem, found, None) is found
    rows = list(block.image_points)
    few = min(Counter(row.photo for row in rows).items(), key=lambda item: item[1])[0]
    k = next(k for k, row in enumerate(rows) if row.photo == few)
    rows[k] = replace(rows[k], x=rows[k].x + 0.5)
    spoilt = adjust_block(replace(block, image_points=tuple(rows)))
    moved = spoilt.state.centres - adjusted.state.centres
    assert np.linalg.norm(moved, axis=1).max() < 40.0


@pytest.mark.slow
def test_where_places_lead_back_the_block_is_not_adjusted(monkeypatch: pytest.MonkeyPatch) -> None:
    """A gross error remains wherever the photos stand, and explains by itself what is off."""
    tried = []

    def counted(*arguments, **options):
        tried.append(1)
        return find_minimum(*arguments, **options)

    monkeypatch.setattr(otherplaces, "find_minimum", counted)
    block = flat_scene().block
    every = list(block.image_points)
    for point in ("p6", "p7", "p10"):
        at = next(k for k, row in enumerate(every) if (row.photo, row.point) == ("102", point))
        rows = list(block.image_points)
        rows[at] = every[at] = replace(rows[at], y=rows[at].y + 0.5)
        adjust_block(replace(block, image_points=tuple(rows)))
        assert not tried
    adjust_block(replace(block, image_points=tuple(every)))
    # thirty that lead to nothing at most, and no more for those that lead back
    assert 0 < len(tried) <= 31


@pytest.mark.slow
def test_where_what_is_given_is_wrong_places_that_lead_back_are_not_tried(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Stated positions in feet: nearly all rays are far off, and from no place of a photo fewer."""
    tried = []

    def counted(*arguments, **options):
        tried.append(1)
        return find_minimum(*arguments, **options)

    monkeypatch.setattr(otherplaces, "find_minimum", counted)
    block = flown(PriorOffsets(), seed=8, angles=False).scene.block
    photos = [
        replace(one, position=(one.position[0] / 0.3048, *one.position[1:])) for one in block.photos
    ]
    said = " ".join(adjust_block(replace(block, photos=tuple(photos))).warnings)
    assert "the photos agree with control" in said
    assert len(tried) <= 3


@pytest.mark.slow
def test_control_free_of_error_stays_where_it_is() -> None:
    """Half of the control free of error, a ray 20 sigmas off, at most ten rays a photo."""
    for seed in (*range(8), 25):
        rng = np.random.default_rng(seed)
        block = aerial(
            2, 3, relief=30.0, control_sigma=0.0, noise_um=5.0, seed=seed, tilt=0.05
        ).block
        control = [
            replace(row, xyz=tuple(v + rng.normal() * 0.05 for v in row.xyz), sigma=(0.05,) * 3)
            if k % 2
            else row
            for k, row in enumerate(block.control)
        ]
        rows = list(block.image_points)
        wrong = int(rng.integers(len(rows)))
        rows[wrong] = replace(rows[wrong], x=rows[wrong].x + 0.1)
        adjusted = adjust_block(replace(block, control=tuple(control), image_points=tuple(rows)))
        problem = adjusted.problem
        assert problem.fixed.any()
        moved = np.abs(adjusted.state.points + adjusted.state.origin - problem.known)
        assert moved[problem.fixed].max() < 1e-9, seed
