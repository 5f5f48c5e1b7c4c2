"""tie_variance = "exact" on error-free strips: the tests have the sizes that they state.

Seeded simulations of tilted strips with unequal bases and relief, pointed anew in every model or
once for all. Every bound is four standard deviations of what is counted; rows of one model share
`f` degrees of freedom, and count no more than that.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from flightscene import BAARDA, EXACT, fly

from anaplot.adjustment.significance import critical_normal, critical_tau
from anaplot.orientation.model import orient
from anaplot.orientation.strip import stereopair

ALPHA = 0.01
SIGMA = 0.005
PATTERNS = {"6/3": ("acd", ()), "9/3": ("acd", ("ma", "mb", "mc")),
            "13/5": ("abcde", ("ma", "mb", "mc"))}  # fmt: skip


@dataclass(frozen=True)
class Found:
    """Standardized residuals of models: rows' axes, by the a-priori and by the estimated sigma."""

    axis: np.ndarray
    known: np.ndarray
    estimated: np.ndarray
    freedom: int  # of each model
    sigma2: np.ndarray  # (sigma0_hat / sigma0)^2 of each model


@cache
def simulated(name, *, strips=24, models=5, once=False, seed=1983, skipped=1):
    """Bridge strips; models from number `skipped` on are looked at."""
    rng = np.random.default_rng(seed)
    columns, middle = PATTERNS[name]
    axis, known, estimated, sigma2 = [], [], [], []
    freedom = 0
    for k in range(strips):
        flight = fly(seed + k, photos=models + 1, tilt=3.0, kappa=8.0, relief=0.05)
        noisy = [
            {p: xy + SIGMA * rng.standard_normal(2) for p, xy in seen.items()}
            for seen in flight.images
        ]
        before = None
        for m in range(models):
            points = [f"{i}{p}" for i in (m, m + 1) for p in columns]
            points += [f"{m}{p}" for p in middle]
            if not once:
                noisy[m], noisy[m + 1] = (
                    {p: xy + SIGMA * rng.standard_normal(2) for p, xy in flight.images[i].items()}
                    for i in (m, m + 1)
                )
            pair = stereopair(
                (str(m), str(m + 1)),
                {p: tuple(noisy[m][p]) for p in points},
                {p: tuple(noisy[m + 1][p]) for p in points},
                (flight.cameras[m], flight.cameras[m + 1]),
                preceding=before,
                base=70.0,
                once=frozenset(points) if once else frozenset(),
            )
            before = orient(pair, EXACT, BAARDA)
            if m < skipped:
                continue
            freedom = before.redundancy
            ratio = before.sigma0_um / before.apriori_um
            sigma2.append(ratio**2)
            for row in before.table:
                axis.append(row.axis)
                known.append(row.size)
                estimated.append(row.size / ratio)
    return Found(np.array(axis), np.array(known), np.array(estimated), freedom, np.array(sigma2))


CASES = [("6/3", False), ("6/3", True), ("9/3", False), ("13/5", False), ("13/5", True)]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "once"), CASES)
def test_the_estimated_sigma_is_the_stated_one(name, once):
    found = simulated(name, once=once)
    count = len(found.sigma2)
    assert found.sigma2.mean() == pytest.approx(1.0, abs=4.0 * (2.0 / found.freedom / count) ** 0.5)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "once"), CASES)
@pytest.mark.parametrize("axis", ["y", "x"])
def test_residuals_of_both_axes_are_as_large_as_expected(name, once, axis):
    found = simulated(name, once=once)
    size = found.known[found.axis == axis]
    independent = len(found.sigma2) * min(found.freedom, len(size) / len(found.sigma2))
    bound = 4.0 * (2.0 / independent) ** 0.5
    assert np.mean(size**2) == pytest.approx(1.0, abs=bound)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "once"), CASES)
@pytest.mark.parametrize("kind", ["baarda", "tau"])
def test_as_many_rows_are_flagged_as_alpha_says(name, once, kind):
    found = simulated(name, once=once)
    if kind == "baarda":
        flagged = found.known > critical_normal(ALPHA)
    else:
        flagged = found.estimated > critical_tau(ALPHA, found.freedom)
    rows = len(flagged)
    independent = len(found.sigma2) * found.freedom
    assert flagged.mean() == pytest.approx(ALPHA, abs=4.0 * (ALPHA / min(independent, rows)) ** 0.5)
