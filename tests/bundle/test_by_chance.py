"""Whether what is flagged may be chance: of good blocks one in twenty is called wrong, not more."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bundleblocks import make_scene
from scipy.stats import binom

from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.errors import bychance
from anaplot.bundle.errors.bychance import may_be_chance, own_tests
from anaplot.photogrammetry.block import ControlPoint, TestSettings
from anaplot.photogrammetry.rotation import rotation_matrix

POINTS = 24


def model(seed, *, photos=2, test=None):
    """Photos 600 m apart, all points in all of them, and control in four of these."""
    rng = np.random.default_rng(seed)
    first = 300.0 * (photos - 2)
    low, high = (first, -600.0, -40.0), (first + 600.0, 600.0, 40.0)
    points = {f"p{k}": rng.uniform(low, high) for k in range(POINTS)}
    corners = [(x, y, 0.0) for x in (first, first + 600.0) for y in (-600.0, 600.0)]
    points |= {f"c{k}": np.array(corner) for k, corner in enumerate(corners)}
    taken = {
        f"f{k}": (np.array((600.0 * k, 0.0, 1000.0)), rotation_matrix(*rng.normal(size=3) * 0.02))
        for k in range(photos)
    }
    control = [
        ControlPoint(name, tuple((at + rng.normal(size=3) * 0.05).tolist()), (0.05,) * 3)
        for name, at in points.items()
        if name.startswith("c")
    ]
    scene = make_scene(taken, points, control=control, noise_um=5.0, seed=seed, test=test)
    return adjust_block(scene.block)


def test_rays_of_two_photos_are_one_test_and_those_of_three_are_not():
    two, three = model(1), model(1, photos=3)
    tested = two.tested.r[: two.observations.image] >= bychance.SPUR
    known = np.array([name.startswith("c") for name in two.problem.points])
    of_control = np.repeat(known[two.problem.point], 2)
    # control is known, if not free of error: its rays are checked by its coordinates, too
    others = int(np.count_nonzero(tested & of_control)) + 3 * 4
    assert np.count_nonzero(tested & ~of_control) > 2 * POINTS
    assert POINTS + 4 + 3 * 4 <= own_tests(two).tests <= POINTS + others
    assert own_tests(three).tests == bychance.tested_count(three)


@pytest.mark.slow
def test_good_blocks_of_two_ray_points_are_seldom_called_wrong():
    """A parallax of chance flags all four coordinates of its point: it was called four errors."""
    test = TestSettings(kind="baarda", alpha=0.01)
    runs, wrong, flagged = 150, 0, 0
    for seed in range(runs):
        block = model(seed, test=test)
        flagged += own_tests(block).flagged > 0
        wrong += bool(block.tested.flagged.any()) and not may_be_chance(block)
    # each of 24 points in a hundred, and the control: about every fourth block has one flagged
    assert binom.cdf(flagged, runs, 0.25) > 1e-3
    assert wrong <= binom.isf(1e-3, runs, 0.05)  # significance 0.001


def with_error(block, point, **by):
    rows = list(block.problem.block.image_points)
    at = next(k for k, row in enumerate(rows) if row.point == point)
    rows[at] = replace(rows[at], **{axis: getattr(rows[at], axis) + mm for axis, mm in by.items()})
    return adjust_block(replace(block.problem.block, image_points=tuple(rows)))


def test_a_gross_error_is_no_chance():
    found = with_error(model(3), "p7", y=0.06)
    assert found.tested.flagged.any()
    assert not may_be_chance(found)


def test_what_is_flagged_together_counts_once():
    """Three x of a point in three photos of a row were three errors, by chance as well."""
    found = with_error(model(1, photos=3), "p7", x=0.1)
    assert np.count_nonzero(found.tested.flagged) == 3
    assert own_tests(found).flagged == 1


def test_control_counts_once_with_its_rays():
    found = with_error(model(1), "c0", x=0.3)
    keys = [found.tested.keys[k] for k in np.flatnonzero(found.tested.flagged)]
    points = {key[2] if key[0] == "image" else key[1] for key in keys}
    assert {key[0] for key in keys} == {"image", "control"}
    assert own_tests(found).flagged == len(points) < len(keys) - 2
