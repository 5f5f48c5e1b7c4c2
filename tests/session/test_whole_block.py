"""Two strips of five photos with cross ties and control, measured at a desk and adjusted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import chdtri
from transferscene import SIGMA0, BlockBench, marked

from anaplot import adjust
from anaplot.photogrammetry.block import TestSettings
from anaplot.planning.syntheticblock import SyntheticBlock, synthetic_block
from anaplot.station.imagepoints import rows_of

pytestmark = pytest.mark.slow

SEEDS = 50


@pytest.fixture(scope="module")
def made() -> SyntheticBlock:
    return synthetic_block(2, 5, seed=4, test=TestSettings(kind="baarda"))


@pytest.fixture(scope="module")
def measured(made: SyntheticBlock):
    """The rows of the block as an operator measures them, what is offered as well."""
    return rows_of(BlockBench.over(made, marked(made), 4).block(8).desk.state.models)


def test_ties_across_and_control_are_measured(made: SyntheticBlock, measured) -> None:
    strip_of = {photo: strip.id for strip in made.block.strips for photo in strip.photos}
    strips: dict[str, set[str]] = {}
    for row in measured:
        strips.setdefault(row.point, set()).add(strip_of[row.photo])
    assert set(strip_of) == {row.photo for row in measured}
    across = {point for point, of in strips.items() if len(of) == 2}
    assert len(across) >= 6
    assert {control.point for control in made.block.control} <= set(strips)


def test_ground_coordinates_lie_within_their_predicted_deviations(
    made: SyntheticBlock, measured
) -> None:
    control = {point.point for point in made.block.control}
    squares: dict[tuple[str, str], float] = {}
    sigma0 = 0.0
    for seed in range(SEEDS):
        rng = np.random.default_rng([seed, 8])
        rows = tuple(
            replace(row, x=x + rng.normal(0.0, SIGMA0), y=y + rng.normal(0.0, SIGMA0))
            for row in measured
            for x, y in [made.truth[row.photo][row.point]]
        )
        given = tuple(
            replace(point, xyz=tuple((made.ground[point.point] + rng.normal(0.0, s, 3)).tolist()))
            for point in made.block.control
            for s in [point.sigma[0] or made.block.precision.control_m]
        )
        found = adjust(replace(made.block, image_points=rows, control=given))
        points = found.to_columns("points")
        sigma0 += found.to_dict()["sigma0"] / SEEDS
        for k, name in enumerate(points["point"]):
            for axis, true in zip("XYZ", made.ground[name], strict=True):
                z = (points[axis][k] - true) / points[f"s{axis}"][k]
                squares[name, axis] = squares.get((name, axis), 0.0) + float(z) ** 2
    assert control <= {name for name, _ in squares}
    # chi-square of 50, the seeds being independent: one coordinate in 20 000 lies outside these,
    # and the block has about two hundred
    low, high = chdtri(SEEDS, [1.0 - 2.5e-5, 2.5e-5]).tolist()
    assert 100 < len(squares) < 400
    outside = {key: value for key, value in squares.items() if not low < value < high}
    assert outside == {}
    # the mean over all of them has at most the deviation of one of them
    assert abs(np.mean(list(squares.values())) - SEEDS) < 4.0 * np.sqrt(2.0 * SEEDS)
    # a redundancy of more than 100: its deviation is below .01
    assert abs(sigma0 - 1.0) < 0.04
