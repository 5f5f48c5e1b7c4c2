"""Synthetic strips: what a flight would have shown."""

from __future__ import annotations

import numpy as np
import pytest

from anaplot.orientation.patterns import pattern
from anaplot.photogrammetry.block import Camera
from anaplot.photogrammetry.rotation import rotation_matrix
from anaplot.planning.modelplan import plan_positions
from anaplot.planning.synthetic import SyntheticStrip, synthetic_strip, synthetic_truth

SEEDS = range(60)


@pytest.mark.parametrize("seed", SEEDS)
def test_every_model_of_every_seed_has_the_whole_pattern(seed: int) -> None:
    made = synthetic_strip(5, seed=seed)
    before: dict[str, tuple[float, float]] = {}
    for left, right in made.block.strips[0].models():
        plan = plan_positions(
            made.block,
            (left, right),
            pattern("13"),
            nominal_base=92.0,
            preceding=before,
            candidates=made.truth,
        )
        names = [p.point for p in plan]
        assert len(set(names)) == len(names) == 13
        assert sum(name in before for name in names) == (5 if before else 0)
        # ties first, and each point where it truly is
        assert {name in before for name in names[:5]} == {bool(before)}
        for p in plan:
            assert (p.xl, p.yl) == made.truth[left][p.point]
            assert (p.xr, p.yr) == made.truth[right][p.point]
        before = {name: made.truth[right][name] for name in names}


@pytest.mark.parametrize("seed", SEEDS)
def test_points_lie_inside_the_format(seed: int) -> None:
    made = synthetic_strip(4, seed=seed)
    for photo, points in made.truth.items():
        reach_x, reach_y = made.block.camera_of(photo).reach()
        xy = np.array(list(points.values()))
        assert (np.abs(xy) <= [reach_x - 2.0, reach_y - 2.0]).all()
        assert len(points) >= 13


@pytest.mark.parametrize("seed", range(5))
def test_common_points_are_coplanar_with_the_base(seed: int) -> None:
    made = synthetic_strip(4, seed=seed)
    c = made.block.cameras[0].c
    for k, (left, right) in enumerate(made.block.strips[0].models()):
        base = made.centres[k + 1] - made.centres[k]
        for point in made.truth[left].keys() & made.truth[right].keys():
            ray_l = made.rotations[k] @ [*made.truth[left][point], -c]
            ray_r = made.rotations[k + 1] @ [*made.truth[right][point], -c]
            volume = np.cross(base, ray_l) @ ray_r
            assert abs(volume) < 1e-9 * np.linalg.norm(base) * c * c


def same(one: SyntheticStrip, other: SyntheticStrip) -> bool:
    return one.truth == other.truth and np.array_equal(one.centres, other.centres)


def test_the_seed_decides_everything() -> None:
    assert same(synthetic_strip(4, seed=3), synthetic_strip(4, seed=3))
    assert not same(synthetic_strip(4, seed=3), synthetic_strip(4, seed=4))


def test_rotations_are_bounded_and_proper() -> None:
    limits = np.radians([2.4, 2.4, 4.0])
    for seed in range(20):
        made = synthetic_strip(5, seed=seed)
        for r in made.rotations:
            assert np.allclose(r @ r.T, np.eye(3))
            assert np.linalg.det(r) > 0
        edge = rotation_matrix(*limits.tolist())
        assert (np.trace(made.rotations, axis1=1, axis2=2) >= np.trace(edge) - 1e-3).all()


def test_the_block_is_what_a_person_would_declare() -> None:
    made = synthetic_strip(3, seed=1, image_um=4.0)
    assert made.block.precision.tie_variance == "exact"
    assert made.block.precision.image_um == 4.0
    assert made.block.strips[0].photos == ("101", "102", "103")
    assert made.block.image_points == ()


@pytest.mark.parametrize("photos", [1, 0, -3])
def test_a_strip_has_two_photos(photos: int) -> None:
    with pytest.raises(ValueError, match="at least two photos"):
        synthetic_strip(photos, seed=1)


def test_a_camera_without_format_is_believed_too() -> None:
    truth, centres, rotations = synthetic_truth(("a", "b"), Camera("x", 100.0), seed=1, base=60.0)
    assert len(truth["a"].keys() & truth["b"].keys()) >= 13
    assert (centres.shape, rotations.shape) == ((2, 3), (2, 3, 3))
