"""The map of a block has what its rows have."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bundleblocks import aerial

from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.blockmap import block_map
from anaplot.bundle.solve.covariances import covariance_of
from anaplot.bundle.solve.placeaccuracy import place_accuracies
from anaplot.bundle.solve.unknownnames import unknowns_meant

SCENE = aerial(2, 4, noise_um=5.0, control_sigma=0.05, tilt=0.1, seed=2)


def adjusted_with(wrong=None, off=None):
    """Adjust the block with a gross error in p6, and a ray that does not count."""
    rows = [
        replace(row, x=row.x + 0.4) if (row.photo, row.point) == wrong else row
        for row in SCENE.block.image_points
    ]
    rows = [replace(row, use="off") if (row.photo, row.point) == off else row for row in rows]
    control = tuple(
        replace(row, use="check") if k == 0 else row for k, row in enumerate(SCENE.block.control)
    )
    return adjust_block(replace(SCENE.block, image_points=tuple(rows), control=control))


def test_the_map_has_what_the_rows_have() -> None:
    adjusted = adjusted_with()
    found = block_map(adjusted)
    rows = adjusted.point_rows()
    assert found.points == tuple(row.point for row in rows)
    np.testing.assert_allclose(found.places, [row.xyz[:2] for row in rows], rtol=1e-12)
    centres = [row.position[:2] for row in adjusted.photo_rows()]
    np.testing.assert_allclose(found.centres, centres, rtol=1e-12)
    names = [[found.photos[k] for k in strip] for strip in found.strips]
    assert names == [list(strip.photos) for strip in SCENE.block.strips]
    kinds = {row.point: row.use for row in adjusted.problem.block.control}
    assert found.kinds == tuple(kinds.get(point, "tie") for point in found.points)
    assert found.kinds.count("check") == 1
    assert found.kinds.count("control") > 1


def test_the_ellipses_are_those_of_the_covariance() -> None:
    adjusted = adjusted_with()
    found = block_map(adjusted)
    covariance = covariance_of(adjusted, unknowns_meant(adjusted.problem, ["points"], "x"))
    expected = {one.place.name: one.ellipse for one in place_accuracies(covariance)}
    assert len(expected) == len(found.points)
    for point, ellipse in zip(found.points, found.ellipses.tolist(), strict=True):
        assert ellipse == pytest.approx(expected[point], rel=1e-6)


def test_a_point_is_worth_its_coordinates_that_count() -> None:
    off = next((r.photo, r.point) for r in SCENE.block.image_points if r.point == "p6")
    adjusted = adjusted_with(off=off)
    found = block_map(adjusted)
    every: dict[str, list[float]] = {}
    for row in adjusted.ray_rows():
        every.setdefault(row.point, []).extend(one.r for one in row.xy)
    means = [np.mean(every[point]) for point in found.points]
    assert found.r == pytest.approx(means, abs=1e-12)


def test_what_is_flagged_in_a_row_is_flagged_in_the_map() -> None:
    assert not block_map(adjusted_with()).flagged.any()
    photo = next(row.photo for row in SCENE.block.image_points if row.point == "p6")
    adjusted = adjusted_with(wrong=(photo, "p6"))
    flagged = {point for _, _, point, _ in adjusted.suspects()}
    flagged |= {row.key[1] for row in adjusted.control_rows() if row.flagged}
    found = block_map(adjusted)
    assert {p for p, bad in zip(found.points, found.flagged, strict=True) if bad} == flagged
    assert "p6" in flagged
