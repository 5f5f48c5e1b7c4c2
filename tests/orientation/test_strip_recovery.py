"""Noise-free strips are recovered from nothing; redundancy and order of points."""

import numpy as np
import pytest
from flightscene import (
    BAARDA,
    PAPER,
    PROPAGATED,
    TAU,
    bridge_flight,
    fly,
    pair_of,
)
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from idealmodel import ideal_pair, spoiled

from anaplot.orientation.conditionequations import ConditionEquations
from anaplot.orientation.model import UNKNOWNS, orient
from anaplot.orientation.solver import find_orientation
from anaplot.photogrammetry.rotation import rotation_matrix

seeds = st.integers(0, 10**9)


def misses(flight, models):
    """Largest deviation from the truth in units of the base; the first bx defines the scale."""
    scale = models[0].base[0] / flight.centres[1, 0]
    assert scale > 0.0  # the sign comes from the data
    b = abs(flight.centres[1, 0])
    worst = 0.0
    for k, model in enumerate(models):
        base = flight.centres[k + 1] - flight.centres[k]
        worst = max(worst, np.abs(np.array(model.base) / scale - base).max() / b)
        turned = rotation_matrix(*model.rotation) - flight.rotations[k + 1]
        worst = max(worst, np.abs(turned).max())
        assert model.centre == pytest.approx(tuple(scale * flight.centres[k]), abs=1e-7 * b)
        for p in model.points:
            miss = np.array(p[1:]) / scale - flight.ground[p.point]
            worst = max(worst, np.abs(miss).max() / b)
    return worst


@pytest.mark.parametrize("relief", [0.0, 0.02, 0.1, 0.25])
@pytest.mark.parametrize("seed", range(16))
def test_any_strip_is_recovered_from_nothing(seed, relief):
    nominal, same_camera = seed % 2 == 0, seed % 4 < 2
    flight = fly(seed, 4, relief=relief, same_camera=same_camera)
    base = abs(float(flight.centres[1, 0])) if nominal else None
    models = bridge_flight(flight, base=base)
    assert misses(flight, models) < 1e-8
    if nominal:
        assert models[0].base[0] == pytest.approx(flight.centres[1, 0], rel=1e-14)
    for model in models:
        assert model.sigma0_um < 1e-6
        assert not model.flagged


def test_without_a_nominal_base_bx_is_the_mean_x_parallax():
    flight = fly(3)
    pair = pair_of(flight, 0)
    bx = orient(pair, PAPER, TAU).base[0]
    assert abs(bx) == pytest.approx(abs(np.mean(pair.xl[:, 0] - pair.xr[:, 0])))
    assert np.sign(bx) == np.sign(flight.centres[1, 0])


@pytest.mark.parametrize("length", [15.0, 8.0])
def test_short_bases(length):
    for seed in range(8):
        flight = fly(seed, 3, tilt=3.0, kappa=20.0, length=length)
        assert misses(flight, bridge_flight(flight)) < 1e-6


@pytest.mark.slow
@given(seeds, st.sampled_from([PAPER, PROPAGATED]), st.sampled_from([TAU, BAARDA]))
def test_redundancy_numbers_sum_to_the_redundancy(seed, precision, test):
    flight = fly(seed, 3, noise=0.004)
    for k, model in enumerate(bridge_flight(flight, precision, test)):
        n = len(model.table)
        assert model.redundancy == n - (5 if k == 0 else 6)
        assert sum(row.r for row in model.table) == pytest.approx(model.redundancy, abs=1e-10)
        projector = model.q_vv / model.q_l
        assert projector @ projector == pytest.approx(projector, abs=1e-10)
        keys = [row.key for row in model.table]
        points = [p.point for p in model.points]
        assert keys == [(p, "y") for p in points] + [(p, "x") for p in points if p in model.ties]
        sigma = model.sigma0_um if test.kind == "tau" else 5.0
        for row, q in zip(model.table, np.diag(model.q_vv), strict=True):
            assert row.expected == pytest.approx(sigma * q**0.5)
            assert row.size == pytest.approx(abs(row.residual) / row.expected)
            assert row.flagged == (row.size > model.test.critical)


@given(seeds, st.randoms(use_true_random=False))
def test_the_order_of_points_does_not_matter(seed, random):
    flight = fly(seed, 3, noise=0.004)
    first, second = bridge_flight(flight)
    points = [p.point for p in second.points]
    random.shuffle(points)
    again = orient(pair_of(flight, 1, first, points=points), PAPER, TAU)
    assert again.base == pytest.approx(second.base, abs=1e-7)
    assert again.rotation == pytest.approx(second.rotation, abs=1e-9)
    table = {row.key: row for row in second.table}
    for row in again.table:
        assert row.r == pytest.approx(table[row.key].r, abs=1e-8)
        assert row.residual == pytest.approx(table[row.key].residual, abs=1e-5)
    assert [row.point for row in again.table[: len(points)]] == points


@pytest.mark.slow
@given(seeds, st.sampled_from([PAPER, PROPAGATED]))
def test_the_fixed_point_has_the_weights_of_the_converged_unknowns(seed, precision):
    """B'PF = 0 with B, P and F all taken at the result."""
    flight = fly(seed, 3, noise=0.01)
    first = bridge_flight(flight, precision)[0]
    for pair in (pair_of(flight, 0), pair_of(flight, 1, first)):
        conditions = ConditionEquations(pair, precision.tie_variance)
        bx = abs(float(np.mean(pair.xl[:, 0] - pair.xr[:, 0]))) if conditions.first else None
        found, suspects = find_orientation(pair, conditions, bx, 0.005)
        assume(suspects == ())  # else a point was held out of the equations
        rows = conditions.evaluate(found.solution.state)
        used = rows[conditions.unknown_rows()]
        lengths = np.linalg.norm(used, axis=1)
        assert np.abs(used @ rows[6] / lengths).max() < 1e-9
        # the same by the definitions of the paper, object units and pseudo-weights
        bx, beta_y, beta_z, R = found.solution.state
        x1, x2 = conditions.x1, R @ conditions.p2
        f_p = np.einsum("in,in->n", np.cross([1.0, beta_y, beta_z], x1.T).T, x2)
        assert rows[6, : len(f_p)] == pytest.approx(f_p / -x1[2] / 2.0**0.5, abs=1e-12)
        if conditions.x_index:
            tie = conditions.tie_points
            d_x, d_z = tie[0] - bx, tie[2] - bx * beta_z
            z = x2[:, conditions.x_index]
            k = bx / pair.preceding_bx
            q = 1.0 if precision is PAPER else 1.0 + (1.0 + k) ** 2 + k**2
            expected = (d_x * z[2] - d_z * z[0]) / -d_z / q**0.5
            assert rows[6, len(f_p) :] == pytest.approx(expected, abs=1e-12)


@pytest.mark.slow
@given(seeds, st.sampled_from(["1a", "1c", "2d"]), st.floats(0.1, 8.0))
def test_converged_means_that_the_next_undamped_correction_is_nothing(seed, point, size):
    flight = fly(seed, 3, noise=0.005)
    first = bridge_flight(flight)[0]
    for k, pair in enumerate((pair_of(flight, 0), pair_of(flight, 1, first))):
        pair = spoiled(pair, point if k else "0c", "y", size)
        conditions = ConditionEquations(pair)
        bx = abs(float(np.mean(pair.xl[:, 0] - pair.xr[:, 0]))) if conditions.first else None
        found, _ = find_orientation(pair, conditions, bx, 0.005)
        if found is None or not found.usable:
            continue
        rows = conditions.evaluate(found.solution.state)
        used = rows[conditions.unknown_rows()]
        correction = np.linalg.solve(used @ used.T, used @ rows[6])
        assert np.abs(correction).max() < 1e-10


@pytest.mark.parametrize("seed", range(6))
def test_the_last_correction_is_made_and_leaves_the_rows_as_they_are(seed):
    flight = fly(seed, 3, noise=0.005)
    pair = pair_of(flight, 1, bridge_flight(flight, PROPAGATED)[0])
    conditions = ConditionEquations(pair, "propagated")
    found, _ = find_orientation(pair, conditions, None, 0.005)
    rows = conditions.evaluate(found.solution.state)
    size = np.abs(rows).max(axis=1)
    assert (np.abs(found.solution.rows - rows).max(axis=1)[:6] < 1e-9 * size[:6]).all()
    correction = np.linalg.solve(rows[:6] @ rows[:6].T, rows[:6] @ rows[6])
    # of one below 1e-10 noise leaves some 1e-4
    assert np.abs(correction).max() < 1e-12


@pytest.mark.slow
@settings(max_examples=30)
@given(seeds)
def test_cofactors_of_the_unknowns_against_numerical_derivatives(seed):
    """Q_gg = (B'PB)^-1 with B from differences of the misclosures in omega, phi, kappa."""
    flight = fly(seed, 3, noise=0.004)
    first = bridge_flight(flight)[0]
    pair = pair_of(flight, 1, first)
    model = orient(pair, PAPER, TAU)
    assert model.unknowns == UNKNOWNS
    conditions = ConditionEquations(pair)
    bx, by, bz = model.base
    omega, phi, kappa = model.rotation
    g = np.array([bx, by / bx, bz / bx, kappa, phi, omega])
    x1, tie, index = conditions.x1, conditions.tie_points, conditions.x_index
    a_p, a_l = -x1[2], -(tie[2] - bz)

    def misclosures(g):
        x2 = rotation_matrix(g[5], g[4], g[3]) @ conditions.p2
        f_p = np.einsum("in,in->n", np.cross([1.0, g[1], g[2]], x1.T).T, x2)
        f_l = (tie[0] - g[0]) * x2[2, index] - (tie[2] - g[0] * g[2]) * x2[0, index]
        return np.concatenate((f_p / a_p, f_l / a_l))  # coefficients of the converged state

    B = np.empty((len(model.table), 6))
    for k, h in enumerate((1e-3, 1e-6, 1e-6, 1e-6, 1e-6, 1e-6)):
        step = np.zeros(6)
        step[k] = h
        B[:, k] = (misclosures(g + step) - misclosures(g - step)) / (2 * h)
    P = np.diag(1.0 / model.q_l)
    q_gg = np.linalg.inv(B.T @ P @ B)
    assert model.q_gg == pytest.approx(q_gg, rel=1e-4, abs=1e-6 * np.abs(q_gg).max())
    q_vv = np.diag(model.q_l) - B @ q_gg @ B.T
    assert model.q_vv == pytest.approx(q_vv, abs=1e-6)


def test_large_errors_in_one_point_still_lead_to_the_least_squares_solution():
    flight = fly(11, 2, tilt=3.0, kappa=10.0, noise=0.003)
    pair = pair_of(flight, 0)
    for size in (0.05, 1.0, 20.0):
        model = orient(spoiled(pair, "0ma", "y", size), PAPER, TAU)
        assert max(model.table, key=lambda row: row.size).key == ("0ma", "y")
        assert model.flagged


def test_a_relative_kappa_of_sixty_degrees_between_ideal_photos():
    pair = ideal_pair("13")
    model = orient(pair, PAPER, TAU)
    assert model.base == pytest.approx((60.0, 0.0, 0.0), abs=1e-9)
    assert model.rotation == pytest.approx((0.0, 0.0, 0.0), abs=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("relief", [0.0, 0.1])
@pytest.mark.parametrize(
    "pattern",
    [("0a", "0c", "0d", "1a", "1c", "1d"), ("0a", "0d", "1a", "1d", "0mb")],
    ids=["six", "five"],
)
def test_a_handful_of_points_is_enough_for_the_right_one_of_several_solutions(pattern, relief):
    for seed in range(10):
        flight = fly(seed, 3, relief=relief)
        models = []
        for k in range(2):
            points = [f"{int(name[0]) + k}{name[1:]}" for name in pattern]
            preceding = models[-1] if models else None
            models.append(orient(pair_of(flight, k, preceding, points=points), PAPER, TAU))
        assert misses(flight, models) < 1e-6


def test_with_one_redundancy_it_is_not_rounding_that_says_which_start_wins():
    for seed in range(12):
        flight = fly(seed, 2, tilt=3.0, kappa=15.0, noise=0.005)
        points = ["0a", "0c", "0d", "1a", "1c", "1d"]
        found = [orient(pair_of(flight, 0, points=p), PAPER, TAU) for p in (points, points[::-1])]
        assert [model.redundancy for model in found] == [1, 1]
        assert found[0].iterations == found[1].iterations
