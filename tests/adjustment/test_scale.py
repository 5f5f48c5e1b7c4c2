"""Whether an a-priori sigma can be right is judged by most of the residuals."""

from __future__ import annotations

import numpy as np
import pytest

from anaplot.adjustment.residualsystem import DenseResiduals
from anaplot.adjustment.scale import AprioriSigma, ScaleError, check_scale, robust_scale
from anaplot.adjustment.strategies import find_gross_errors

UM = AprioriSigma("block demo", "image_um", 5.0, "um")
N, U = 60, 12


def system_of(errors: np.ndarray, seed: int = 0) -> DenseResiduals:
    q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(N, U)))
    matrix = np.eye(N) - q @ q.T
    e = matrix @ errors
    return DenseResiduals(tuple(range(N)), e, np.diag(matrix), float(e @ e), N - U, matrix)


def test_the_scale_is_sigma0_of_normal_residuals_also_without_the_largest() -> None:
    w = np.abs(np.random.default_rng(1).normal(size=20_000)) * 7.0
    assert robust_scale(w, np.ones(len(w))) == pytest.approx(7.0, rel=0.03)
    cut = np.sort(w)[:12_000]
    assert robust_scale(cut, np.ones(len(cut)), 0.4) == pytest.approx(7.0, rel=0.03)
    # rows that hardly show their errors say nothing
    assert robust_scale(np.append(w, np.full(20_000, 1e6)), np.repeat([1.0, 0.005], 20_000)) == (
        pytest.approx(7.0, rel=0.03)
    )
    assert robust_scale(np.array([np.nan]), np.ones(1)) is None


@pytest.mark.slow
@pytest.mark.parametrize("strategy", ["baarda", "search", "danish"])
def test_a_sigma_that_is_far_too_small_is_doubted_and_gross_errors_are_not(strategy: str) -> None:
    rng = np.random.default_rng(2)
    for seed in range(10):
        noise = rng.normal(size=N)
        wrong = system_of(36.0 * noise, seed)
        found = find_gross_errors(wrong, strategy)
        with pytest.raises(ScaleError, match=r"block demo: most residuals are .* image_um = 5"):
            check_scale(wrong, found, 0.001, UM)
        noise[rng.choice(N, 4, replace=False)] += 1000.0
        spoilt = system_of(noise, seed)
        check_scale(spoilt, find_gross_errors(spoilt, strategy), 0.001, UM)
        check_scale(spoilt, None, 0.001, UM)


def test_what_fits_is_named_and_with_it_nothing_is_flagged() -> None:
    errors = 36.0 * np.random.default_rng(3).normal(size=N)
    wrong = system_of(errors)
    with pytest.raises(ScaleError) as caught:
        check_scale(wrong, find_gross_errors(wrong, "baarda"), 0.001, UM)
    value = float(str(caught.value).split("With ")[1].split(" um")[0])
    assert find_gross_errors(system_of(errors * UM.value / value), "baarda").rows == ()
    assert find_gross_errors(system_of(errors * UM.value / (0.8 * value)), "baarda").rows != ()


def test_a_sigma_that_is_far_too_large_is_doubted_before_anything_is_rejected() -> None:
    with pytest.raises(ScaleError, match=r"are 0\.0\d+ times"):
        check_scale(system_of(0.03 * np.random.default_rng(4).normal(size=N)), None, 0.001, UM)
    check_scale(system_of(np.zeros(N)), None, 0.001, UM)
