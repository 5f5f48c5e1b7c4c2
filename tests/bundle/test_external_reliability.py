"""What undetected errors do to a block: against dense formulas and against a second adjustment."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bundleblocks import aerial
from denseblock import dense, dense_inverse, held_inverse

from anaplot.bundle.adjust import adjust_bundle
from anaplot.bundle.solve.additional import additional_parameters
from anaplot.bundle.solve.externalreliability import external_reliability
from anaplot.bundle.solve.parametercorrelations import parameter_correlations
from anaplot.bundle.solve.problem import make_problem


def adjusted(additional=None, datum="control", **options):
    scene = aerial(2, 4, per_base=1, noise_um=5.0, **options)
    problem = make_problem(
        scene.block,
        datum=datum,
        additional=None if additional is None else additional_parameters(*additional),
    )
    return adjust_bundle(problem, scene.start(problem, np.random.default_rng(2), 1.0, 0.001))


CASES = {
    "control": {"control_sigma": 0.05},
    "error-free control": {"control_sigma": 0.0},
    "priors": {"control_sigma": 0.05, "priors": True},
    "parameters by strip": {"control_sigma": 0.05, "additional": ("ebner:strip", 10.0)},
    "parameters by photo": {
        "control_sigma": 0.05,
        "priors": True,
        "additional": ("physical:photo", 5.0),
    },
    "free": {"datum": "free"},
    "minimal": {"datum": "minimal"},
    "free with parameters": {"datum": "free", "additional": ("ebner", None)},
}


@pytest.mark.parametrize("name", CASES)
def test_the_largest_effects_equal_the_dense_formula(name) -> None:
    block = adjusted(**CASES[name])
    problem = block.problem
    design, free = dense(block)
    if block.cofactors.change is None:
        q = dense_inverse(design, free)
    else:
        q = held_inverse(block, design)
    n, d, p, m = len(problem.photos), problem.per_photo, len(problem.points), len(problem.photo)
    gain = q @ design.T
    r = 1.0 - np.einsum("ij,ji->i", design, gain)
    moved = gain[n * d : n * d + 3 * p].reshape(p, 3, -1)
    found = external_reliability(block)
    order = np.argsort(problem.source)
    compared = 0

    def check(row, effect, at) -> None:
        nonlocal compared
        if effect is None:
            assert r[at] < 1e-8
            return
        assert row.effect == pytest.approx(
            block.test.delta0 * np.sqrt(max(1.0 - r[at], 0.0) / r[at]), rel=1e-4, abs=1e-3
        )
        if r[at] < 1e-4:
            return
        lengths = np.linalg.norm(moved[:, :, at], axis=1) * block.test.delta0 / np.sqrt(r[at])
        expected = (
            moved[problem.points.index(effect.point), :, at] * block.test.delta0 / np.sqrt(r[at])
        )
        np.testing.assert_allclose(effect.effect_m, expected, atol=1e-5 * lengths.max())
        assert np.linalg.norm(effect.effect_m) == pytest.approx(lengths.max(), rel=1e-5)
        compared += 1

    for ray, row, effects in zip(order.tolist(), block.ray_rows(), found.rays, strict=True):
        for axis in (0, 1):
            check(row.xy[axis], effects[axis], 2 * ray + axis)
    for row, effect in zip(block.control_rows(), found.control, strict=True):
        at = 2 * m + 3 * problem.points.index(row.point) + "XYZ".index(row.axis)
        check(row, effect, at)
    rows = np.argwhere(np.isfinite(block.cofactors.r_photo)).tolist()
    priors = block.prior_rows()
    for (photo, index), row, effect in zip(rows, priors, found.priors, strict=False):
        check(row, effect, 2 * m + 3 * p + 6 * photo + index)
    for k, effect in enumerate(found.priors[len(rows) :]):
        check(priors[len(rows) + k], effect, 2 * m + 3 * p + 6 * n + k)
    assert compared > m


class Again:
    """A block, and how its points move when one observation is another."""

    def __init__(self) -> None:
        self.scene = aerial(2, 4, per_base=1, noise_um=5.0, control_sigma=0.05)
        problem = make_problem(self.scene.block)
        self.block = adjust_bundle(problem, self.scene.start(problem))
        self.before = {row.point: np.array(row.xyz) for row in self.block.point_rows()}

    def _moved(self, changed) -> dict[str, np.ndarray]:
        problem = make_problem(changed)
        rows = adjust_bundle(problem, self.scene.start(problem)).point_rows()
        return {row.point: np.array(row.xyz) - self.before[row.point] for row in rows}

    def image_point(self, row, axis: int) -> dict[str, np.ndarray]:
        """A coordinate that is wrong by its smallest detectable error."""
        image = list(self.scene.block.image_points)
        name = "xy"[axis]
        value = getattr(image[row.row], name) + row.xy[axis].mdb * 1e-3
        image[row.row] = replace(image[row.row], **{name: value})
        return self._moved(replace(self.scene.block, image_points=tuple(image)))

    def control(self, row) -> dict[str, np.ndarray]:
        shift = [row.mdb * (axis == row.axis) for axis in "XYZ"]
        control = [
            replace(c, xyz=tuple(a + b for a, b in zip(c.xyz, shift, strict=True)))
            if c.point == row.point
            else c
            for c in self.scene.block.control
        ]
        return self._moved(replace(self.scene.block, control=tuple(control)))


@pytest.fixture(scope="module")
def again() -> Again:
    return Again()


def test_a_second_adjustment_moves_by_as_much(again: Again) -> None:
    found = external_reliability(again.block)
    fixed = {row.point for row in again.scene.block.control}
    of_control = 0
    rows = list(again.block.ray_rows())
    for k in range(0, len(rows), 5):
        row, effect = rows[k], found.rays[k][0]
        if effect is None or row.xy[0].r < 0.05:
            continue
        of_control += row.point in fixed
        moved = again.image_point(row, 0)
        length = {name: np.linalg.norm(each) for name, each in moved.items()}
        assert length[effect.point] == pytest.approx(max(length.values()), rel=0.02)
        np.testing.assert_allclose(
            effect.effect_m, moved[effect.point], atol=0.02 * length[effect.point]
        )
    assert of_control >= 2
    row, effect = again.block.control_rows()[2], found.control[2]
    assert row.axis == "Z"
    moved = again.control(row)
    np.testing.assert_allclose(effect.effect_m, moved[effect.point], atol=0.02 * row.mdb)


def test_a_second_adjustment_moves_the_point_itself_as_its_row_says(again: Again) -> None:
    """`ground` of rays and of control: sign, unit, and the point's own."""
    compared = 0
    for row in list(again.block.ray_rows())[2::7]:
        for axis in (0, 1):
            if row.xy[axis].r < 0.05:
                continue
            moved = again.image_point(row, axis)[row.point]
            size = np.linalg.norm(moved)
            np.testing.assert_allclose(row.xy[axis].ground, moved, atol=0.02 * size)
            compared += 1
    assert compared >= 8
    for row in again.block.control_rows()[:6]:
        moved = again.control(row)[row.point]
        assert np.linalg.norm(moved) > 1e-3
        np.testing.assert_allclose(row.ground, moved, atol=0.02 * row.mdb)


def test_an_error_at_fixed_control_moves_other_points() -> None:
    block = adjusted(**CASES["error-free control"])
    found = external_reliability(block)
    fixed = {block.problem.points[k] for k in np.nonzero(block.problem.fixed.all(axis=1))[0]}
    rays = [
        (row, effects)
        for row, effects in zip(block.ray_rows(), found.rays, strict=True)
        if row.point in fixed
    ]
    assert rays
    for row, effects in rays:
        for own, effect in zip(row.xy, effects, strict=True):
            assert own.ground == (0.0, 0.0, 0.0)
            assert effect.point not in fixed
            assert np.linalg.norm(effect.effect_m) > 1e-3


def test_large_blocks_have_standardized_effects_alone() -> None:
    block = adjusted(**CASES["priors"])
    found, whole = external_reliability(block, most=10), external_reliability(block)
    assert not any((*found.control, *found.priors))
    assert all((*whole.control, *whole.priors))
    assert all(row.effect for row in (*block.control_rows(), *block.prior_rows()))


@pytest.mark.parametrize("datum", ["control", "free", "minimal"])
@pytest.mark.parametrize(
    "additional", [("physical", 20.0), ("ebner:strip", None), ("ebner:photo", 5.0)]
)
@pytest.mark.filterwarnings("error")
def test_correlations_of_parameters_equal_the_dense_ones(datum, additional) -> None:
    block = adjusted(additional, datum, control_sigma=0.05)
    problem = block.problem
    design, free = dense(block)
    q = dense_inverse(design, free) if datum == "control" else held_inverse(block, design)
    n, d, p = len(problem.photos), problem.per_photo, len(problem.points)
    labels = problem.additional.set.names
    at = {
        f"{name} of {photo}": k * d + j
        for k, photo in enumerate(problem.photos)
        for j, name in enumerate(("X", "Y", "Z", "d1", "d2", "d3", *labels)[:d])
    }
    at |= {
        f"{label} of {group}": n * d + 3 * p + k * len(labels) + j
        for k, group in enumerate(problem.additional_groups)
        for j, label in enumerate(labels)
        if not problem.photo_invariant
    }
    size = np.sqrt(np.maximum(np.diag(q), 0.0))
    found = parameter_correlations(block, limit=1e-3)
    assert len(found) > 100
    for first, second, rho in found:
        i, j = at[first], at[second]
        assert abs(rho) <= 1.0
        assert rho == pytest.approx(q[i, j] / size[i] / size[j], abs=1e-5)
    assert parameter_correlations(block) == [each for each in found if abs(each[2]) > 0.9]
