"""S' N^-1 S by the elimination alone, against solutions of all sides and a dense inverse."""

from __future__ import annotations

import numpy as np
import pytest
from bundleblocks import aerial
from conditionblocks import every_kind, flat_scene, with_conditions
from denseblock import dense, dense_inverse
from givenblocks import campaigns, one_after_the_other
from gnssblocks import flown
from scipy.sparse import csr_array

from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.solve.additional import additional_parameters
from anaplot.bundle.solve.innerproducts import inner_products
from anaplot.bundle.solve.normal import NormalEquations
from anaplot.photogrammetry.prioroffsets import PriorOffsets

SIDES = 40  # of each block


def of(additional=None, **scene):
    made = aerial(**{"strips": 2, "length": 4, "noise_um": 5.0, "control_sigma": 0.05, **scene})
    chosen = None if additional is None else additional_parameters(additional, 5.0)
    return adjust_block(made.block, additional=chosen)


PLAIN = {
    "tilted": lambda: of(tilt=0.2),
    "control free of error": lambda: of(control_sigma=0.0),
    "priors": lambda: of(priors=True, control_sigma=0.1),
    "parameters of all photos": lambda: of("ebner"),
    "parameters of strips": lambda: of("ebner:strip"),
    "parameters of photos": lambda: of("physical:photo", priors=True),
    "many fronts": lambda: of("ebner", strips=5, length=18),
}
TIED = {
    "conditions": lambda: with_conditions(flat_scene(), every_kind(flat_scene(), (0, 1, 4))),
    "a given prior": lambda: one_after_the_other(campaigns(5.0, 0.05), ("points",)),
    "offsets": lambda: adjust_block(flown(PriorOffsets("strip", "strip", "block")).scene.block),
}


def random_sides(block, seed):
    """Sides that name few unknowns, one that names all, one that names none."""
    problem = block.problem
    size = len(problem.photos) * problem.per_photo + 3 * len(problem.points) + problem.in_border
    rng = np.random.default_rng(seed)
    few = np.where(rng.random((size, SIDES)) < 0.02, rng.normal(size=(size, SIDES)), 0.0)
    few[:, 3], few[:, 5] = rng.normal(size=size), 0.0
    return few


def products_of(block, factor, sides):
    return inner_products(block.cofactors.normal, factor, csr_array(sides))


def by_solutions(block, factor, sides):
    problem = block.problem
    n, p = len(problem.photos), len(problem.points)
    first = n * problem.per_photo
    photos, points, shared = np.split(sides, (first, first + 3 * p))
    found = block.cofactors.normal.solve(
        factor, photos.reshape(n, -1, SIDES), points.reshape(p, 3, SIDES), shared
    )
    return sides.T @ np.concatenate([part.reshape(-1, SIDES) for part in found])


@pytest.mark.parametrize("name", [*PLAIN, *TIED])
def test_they_are_those_of_solutions(name) -> None:
    block = {**PLAIN, **TIED}[name]()
    sides = random_sides(block, 1)
    wanted = by_solutions(block, block.cofactors.factor, sides)
    found = products_of(block, block.cofactors.factor, sides)
    size = np.sqrt(np.diag(wanted))
    np.testing.assert_array_less(np.abs(found - wanted), 1e-9 * size[:, None] * size + 1e-300)
    # and of a factor that the selected inverse has not divided
    normal = block.cofactors.normal
    fresh = normal.factor()
    bare = NormalEquations(normal.problem, normal.structure, normal.linear)
    undivided = inner_products(bare, fresh, csr_array(sides))
    np.testing.assert_array_less(np.abs(undivided - found), 1e-9 * size[:, None] * size + 1e-300)


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=pytest.mark.slow if name == "many fronts" else ()) for name in PLAIN],
)
def test_they_are_those_of_a_dense_inverse(name) -> None:
    block = PLAIN[name]()
    sides = random_sides(block, 2)
    wanted = sides.T @ dense_inverse(*dense(block)) @ sides
    found = products_of(block, block.cofactors.factor, sides)
    size = np.sqrt(np.diag(wanted))
    np.testing.assert_array_less(np.abs(found - wanted), 1e-7 * size[:, None] * size + 1e-300)


def test_fronts_that_no_side_reaches_are_passed_over() -> None:
    block = PLAIN["many fronts"]()
    assert len(block.cofactors.factor.pattern.plans) > 4
    none = np.zeros_like(random_sides(block, 1))
    np.testing.assert_array_equal(products_of(block, block.cofactors.factor, none), 0.0)
    only = none.copy()
    only[7, 0] = 1.0
    found = products_of(block, block.cofactors.factor, only)
    assert found[0, 0] == pytest.approx(block.cofactors.photos[1, 1, 1], rel=1e-9)
    assert np.count_nonzero(found) == 1
