"""Large coordinates: a block in UTM or geocentric coordinates is the block at the origin."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from bundleblocks import Scene, cube
from epochblocks import compare_epochs

from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.hypotheses.checktests import check_tests
from anaplot.bundle.hypotheses.controltests import control_tests
from anaplot.bundle.hypotheses.verdict import HypothesisSettings
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.problem import Datum
from anaplot.photogrammetry.block import Block, ControlPoint

pytestmark = pytest.mark.slow

PLACES = {
    "utm": np.array([500_000.0, 5_400_000.0, 300.0]),
    "geocentric": np.array([4_177_000.0, 855_000.0, 4_728_000.0]),
}
ROUNDING = 4e-9  # m: of a coordinate of some 10^6 m, stated and adjusted


def close_range(shift: np.ndarray | float, *, stated: bool = False, seed: int = 3) -> Block:
    """A cube of some decimetres, control and checks of 0.05 mm; positions of 0.1 mm on demand."""
    scene = shrunk(cube("E", noise_um=1.0, sigma_um=1.0, seed=seed))
    rng = np.random.default_rng(1)
    control = tuple(
        ControlPoint(
            name,
            tuple((at + rng.normal(size=3) * 5e-5 + shift).tolist()),
            (5e-5,) * 3,
            "check" if k % 3 == 1 else "control",
        )
        for k, (name, at) in enumerate(list(scene.points.items())[::2])
    )
    block = replace(scene.block, control=control)
    if stated:
        photos = tuple(
            replace(
                photo,
                position=tuple((scene.centres[photo.id] + shift).tolist()),
                position_sigma=(1e-4,) * 3,
            )
            for photo in block.photos
        )
        block = replace(block, photos=photos)
    return block


def shrunk(scene: Scene) -> Scene:
    """The same rays in an object of a tenth the size of a metre."""
    extent = float(np.ptp(np.array(list(scene.points.values())), axis=0).max())
    factor = 0.3 / extent
    return replace(
        scene,
        centres={name: at * factor for name, at in scene.centres.items()},
        points={name: at * factor for name, at in scene.points.items()},
    )


@cache
def at_the_origin(datum: Datum, stated: bool) -> AdjustedBlock:
    return adjust_block(close_range(0.0, stated=stated), datum=datum)


def places(found: AdjustedBlock) -> np.ndarray:
    return np.array([row.xyz for row in found.point_rows()])


@pytest.mark.parametrize(
    ("datum", "stated"),
    [("control", False), ("control", True), ("free", False), ("minimal", False)],
)
@pytest.mark.parametrize("where", PLACES)
def test_the_same_block_far_away(where: str, datum: Datum, stated: bool) -> None:
    shift = PLACES[where]
    here = at_the_origin(datum, stated)
    there = adjust_block(close_range(shift, stated=stated), datum=datum)
    # control itself is rounded to 1e-9 m there: 2e-5 of its sigma
    assert there.vtpv == pytest.approx(here.vtpv, rel=1e-4)
    np.testing.assert_allclose(places(there) - shift, places(here), atol=ROUNDING)
    np.testing.assert_allclose(there.v, here.v, atol=1e-3)
    for one, two in zip(here.check_rows(), there.check_rows(), strict=True):
        assert one[0] == two[0]
        np.testing.assert_allclose(one[1], two[1], atol=ROUNDING)
    assert there.convergence.iterations <= here.convergence.iterations + 1


@pytest.mark.parametrize("datum", ["control", "free"])
def test_tests_of_given_coordinates_far_away(datum: Datum) -> None:
    settings = HypothesisSettings()
    here = at_the_origin(datum, False)
    there = adjust_block(close_range(PLACES["geocentric"]), datum=datum)
    for test in (control_tests, check_tests):
        one, two = test(here, settings), test(there, settings)
        if one is None or two is None:
            assert (one, two, datum) == (None, None, "free")
            continue
        differences = [[row.difference for row in found.coordinates] for found in (one, two)]
        np.testing.assert_allclose(*np.array(differences, dtype=float), atol=ROUNDING)


@pytest.mark.parametrize("options", [{}, {"separate": True}, {"separate": True, "stable": "138"}])
def test_displacements_far_away(options) -> None:
    found = [
        compare_epochs(close_range(shift), close_range(shift, seed=4), **options)
        for shift in (0.0, PLACES["geocentric"])
    ]
    np.testing.assert_allclose(found[1].d, found[0].d, atol=ROUNDING)
