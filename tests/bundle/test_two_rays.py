"""At a point of two rays a parallax in y checks all four coordinates: y is named, heights stay."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bundleblocks import make_scene

from anaplot.adjustment.findings import SearchSettings
from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.errors.grosserrors import block_gross_errors
from anaplot.bundle.errors.suspects import likeliest_suspects
from anaplot.photogrammetry.block import Block, ControlPoint
from anaplot.photogrammetry.rotation import rotation_matrix

pytestmark = pytest.mark.slow

WRONG = "13"


def tilted_pair(seed: int, error_um: float) -> tuple[Block, np.ndarray]:
    """Two photos 1:10000, tilted by some degrees; 25 points, five of them control of 5 cm."""
    rng = np.random.default_rng(seed)
    points = {
        str(5 * i + j + 1): np.array(
            [-100.0 + 280.0 * i, -900.0 + 450.0 * j, float(rng.uniform(0.0, 120.0))]
        )
        for i in range(5)
        for j in range(5)
    }
    photos = {
        name: (
            np.array([x, 0.0, 1500.0]) + rng.normal(size=3) * 15.0,
            rotation_matrix(*(rng.normal(size=3) * 0.04)),
        )
        for name, x in (("101", 0.0), ("102", 920.0))
    }
    known = {
        name: points[name] + rng.normal(size=3) * 0.05 for name in ("1", "5", "11", "21", "25")
    }
    control = tuple(ControlPoint(name, tuple(p), (0.05,) * 3) for name, p in known.items())
    scene = make_scene(photos, points, control=control, noise_um=5.0, seed=seed)
    rows = [
        replace(row, y=row.y + error_um * 1e-3) if (row.photo, row.point) == ("102", WRONG) else row
        for row in scene.block.image_points
    ]
    return replace(scene.block, image_points=tuple(rows)), points[WRONG]


@pytest.mark.parametrize("strategy", ["baarda", "tau", "search", "odds", "modified", "huber"])
def test_the_parallax_is_named_and_the_height_stays(strategy: str) -> None:
    named = 0
    for seed in range(8):
        block, true = tilted_pair(seed, 90.0)
        found = block_gross_errors(block, strategy, SearchSettings(alpha=0.001))
        rejected = [row.name for row in found.rejected if row.name[2] == WRONG]
        assert {name[4] for name in rejected} <= {"y"}
        named += len(rejected) == 1
        adjusted = next(row for row in found.block.point_rows() if row.point == WRONG)
        # 5 um are .05 m in position; a base of .6 of the height makes .12 m of them in height
        assert abs(adjusted.xyz[2] - true[2]) < 6 * 0.12
    assert named >= 7  # w of 18 sigma times the root of .4


def test_the_advice_names_the_row_of_the_largest_redundancy_number() -> None:
    for seed in range(8):
        block, _ = tilted_pair(seed, 90.0)
        found = likeliest_suspects(adjust_block(block))
        assert [one.point for one in found].count(WRONG) == 1
        assert (found[0].point, found[0].where.axis) == (WRONG, "y")
        assert found[0].r > 0.1
        alike = {(other.photo, other.axis) for other in found[0].partners}
        assert len(alike) == 3  # the other coordinates of both rays
