"""Correlations of residuals, and critical transfers."""

import numpy as np
import pytest

from anaplot.adjustment.leastsquares import adjust
from anaplot.adjustment.reliability import error_transfers, is_critical, residual_correlations


def sample(seed=1, n=12, u=5):
    rng = np.random.default_rng(seed)
    return adjust(
        rng.normal(size=(n, u)),
        rng.normal(size=n),
        rng.uniform(0.5, 2.0, n),
        unknowns=[f"g{k}" for k in range(u)],
    )


def test_transfers_by_definition():
    for seed in range(10):
        a = sample(seed, 9, 5)
        influence = a.q_vv @ np.diag(1.0 / a.root**2)
        expected = [
            (i, j)
            for i in range(9)
            for j in range(9)
            if i != j and abs(influence[j, i]) >= influence[i, i] - 1e-9
        ]
        found = error_transfers(a.q_vv / a.root**2)
        critical = [(i, j) for i, j, value in found if is_critical(value, influence[i, i])]
        assert critical == expected
        assert [(i, j) for i, j, _ in found] == [
            (i, j)
            for i in range(9)
            for j in range(9)
            if i != j and abs(influence[j, i]) >= 0.6 * influence[i, i]
        ]
        for i, j, value in found:
            assert value == pytest.approx(influence[j, i])


def test_correlations_are_symmetric_with_unit_diagonal():
    a = sample()
    rho = residual_correlations(a.q_vv, a.r)
    assert np.diag(rho) == pytest.approx(np.ones(12))
    assert rho == pytest.approx(rho.T)
    assert np.abs(rho).max() <= 1.0


def test_correlations_of_copies_are_one_whatever_the_rounding():
    beyond = 0
    for seed in range(20):
        v = np.random.default_rng(seed).normal(size=9)
        q_vv = np.outer(v, v)
        root = np.sqrt(np.diag(q_vv))
        beyond += int((np.abs(q_vv / root[:, None] / root) > 1.0).sum())
        rho = residual_correlations(q_vv, np.full(9, 0.5))
        assert np.abs(rho).max() <= 1.0
        assert rho == pytest.approx(np.sign(q_vv), abs=1e-14)
    assert beyond > 0
