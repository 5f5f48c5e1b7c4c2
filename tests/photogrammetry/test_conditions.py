"""Coplanarity and collinearity: values by definition, derivatives numerically."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from anaplot.photogrammetry.conditions import coefficients, misclosure_coefficients, products
from anaplot.photogrammetry.rotation import rotation_matrix, turn


def scene(seed, n=7):
    rng = np.random.default_rng(seed)
    state = (
        float(rng.uniform(40, 120) * rng.choice([-1, 1])),
        float(rng.uniform(-0.4, 0.4)),
        float(rng.uniform(-0.4, 0.4)),
        rotation_matrix(*rng.uniform(-0.6, 0.6, 3).tolist()),
    )
    x1 = np.vstack((rng.uniform(-100, 100, (2, n)), rng.uniform(-170, -130, n)))
    p2 = np.vstack((rng.uniform(-100, 100, (2, n)), np.full(n, -152.4)))
    tie = np.vstack((rng.uniform(-100, 100, (2, n)), rng.uniform(-170, -130, n)))
    return state, x1, p2, tie


def f_p(state, x1, p2):
    _, beta_y, beta_z, R = state
    beta = np.array([1.0, beta_y, beta_z])
    return np.einsum("in,in->n", np.cross(beta, x1.T).T, R @ p2)


def f_l(state, tie, p2):
    bx, _, beta_z, R = state
    x2 = R @ p2
    return (tie[0] - bx) * x2[2] - (tie[2] - bx * beta_z) * x2[0]


def rows_of(state, x1, p2, tie):
    factors = coefficients(*state)
    flat = np.vstack((tie[0], tie[2], np.ones(tie.shape[1])))
    return factors[:, :9] @ products(x1, p2), factors[:, 9:] @ products(flat, p2)


def moved(state, k, h):
    bx, beta_y, beta_z, R = state
    if k == 0:
        return bx * np.exp(h), beta_y, beta_z, R
    if k == 1:
        return bx, beta_y + h, beta_z, R
    if k == 2:
        return bx, beta_y, beta_z + h, R
    d = [0.0, 0.0, 0.0]
    d[k - 3] = h
    return bx, beta_y, beta_z, turn(*d) @ R


@given(st.integers(0, 10**6))
def test_misclosures_are_the_conditions_of_the_paper(seed):
    state, x1, p2, tie = scene(seed)
    plane, line = rows_of(state, x1, p2, tie)
    assert plane[6] == pytest.approx(f_p(state, x1, p2), abs=1e-8)
    assert line[6] == pytest.approx(f_l(state, tie, p2), abs=1e-8)


@given(st.integers(0, 10**6), st.floats(0.1, 3.0))
def test_the_matrix_between_two_vectors_gives_both_misclosures(seed, weight):
    state, x1, p2, tie = scene(seed)
    between = misclosure_coefficients(*state, weight)
    flat = np.vstack((tie[0], tie[2], np.ones(tie.shape[1])))
    plane = np.einsum("in,ij,jn->n", x1, between[:3], p2)
    line = np.einsum("in,ij,jn->n", flat, between[3:], p2)
    assert plane == pytest.approx(f_p(state, x1, p2), abs=1e-8)
    assert line == pytest.approx(weight * f_l(state, tie, p2), abs=1e-7)


@given(st.integers(0, 10**6), st.integers(0, 5))
def test_analytic_against_numerical_derivatives(seed, k):
    state, x1, p2, tie = scene(seed)
    plane, line = rows_of(state, x1, p2, tie)
    h = 1e-5
    up, down = moved(state, k, h), moved(state, k, -h)
    numerical = (f_p(up, x1, p2) - f_p(down, x1, p2)) / (2 * h)
    assert plane[k] == pytest.approx(numerical, abs=1e-3)  # of values near 2e4
    numerical = (f_l(up, tie, p2) - f_l(down, tie, p2)) / (2 * h)
    assert line[k] == pytest.approx(numerical, abs=1e-3)


def test_coplanarity_knows_nothing_of_the_size_of_the_base():
    state, x1, p2, tie = scene(1)
    assert not rows_of(state, x1, p2, tie)[0][0].any()


def test_products_are_the_outer_products_of_each_column():
    _, x1, p2, _ = scene(2)
    got = products(x1, p2)
    for k in range(x1.shape[1]):
        assert got[:, k] == pytest.approx(np.outer(x1[:, k], p2[:, k]).ravel())
