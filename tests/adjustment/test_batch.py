"""Stepwise rejection of all runs at once against adjusting each run again."""

import numpy as np
import pytest

from anaplot.adjustment.batch import BATCH_TESTS, batch_test, reject_stepwise, standardized
from anaplot.adjustment.significance import critical_normal, critical_tau
from anaplot.planning.rates import score_interval

N, U = 13, 5


def design():
    return np.random.default_rng(4).normal(size=(N, U))


def residual_matrix(a):
    return np.eye(len(a)) - a @ np.linalg.pinv(a)


def one_by_one(a, errors, test, alpha):
    """Adjust again without the rejected rows, as often as something is rejected."""
    keep, order = list(range(N)), []
    while len(keep) > U and len(order) < (N - U) // 2:
        r = residual_matrix(a[keep])
        e = r @ errors[keep]
        w = standardized(e, np.diag(r))
        critical = critical_normal(alpha)
        if test == "tau":
            critical = critical_tau(alpha, len(keep) - U)
            if critical is None:
                break
            w = w / np.sqrt(e @ e / (len(keep) - U))
        if w.max() <= critical:
            break
        order.append(keep.pop(int(np.argmax(w))))
    return order


@pytest.mark.parametrize("test", ["baarda", "tau"])
def test_every_run_is_as_if_adjusted_again(test):
    a, rng = design(), np.random.default_rng(7)
    errors = rng.normal(size=(150, N))
    for run in errors:
        run[rng.choice(N, 2, replace=False)] += rng.choice([-15.0, 15.0], 2)
    found = reject_stepwise(residual_matrix(a), errors, test, 0.01)
    assert found.sum() > 100
    for m, run in enumerate(errors):
        order = one_by_one(a, run, test, 0.01)
        assert sorted(np.flatnonzero(found[m])) == sorted(order)


def test_sizes_equal_alpha_under_no_error():
    matrix = residual_matrix(design())
    e = np.random.default_rng(11).normal(size=(20_000, N)) @ matrix
    r = np.diag(matrix)
    for test in BATCH_TESTS:
        statistic, critical = batch_test(test, e, r, N - U, 0.01)
        hits = statistic > critical
        # one row: its runs are independent; 0.9999 because two rates are looked at
        low, high = score_interval(float(hits[:, 0].mean()), len(hits), 0.9999)
        assert low <= 0.01 <= high


def test_no_runs_are_no_rejections():
    matrix = residual_matrix(design())
    assert reject_stepwise(matrix, np.empty((0, N)), "tau", 0.001).shape == (0, N)


def test_what_does_not_belong_together_is_refused():
    matrix = residual_matrix(design())
    with pytest.raises(ValueError, match="no batch test 'rms'"):
        reject_stepwise(matrix, np.zeros((2, N)), "rms", 0.001)
    with pytest.raises(ValueError, match="do not belong"):
        reject_stepwise(matrix, np.zeros((2, N + 1)), "tau", 0.001)


def test_wilson_interval_of_a_known_case():
    low, high = score_interval(0.0, 10, 0.95)
    assert low == 0.0
    assert high == pytest.approx(0.2775, abs=1e-4)
