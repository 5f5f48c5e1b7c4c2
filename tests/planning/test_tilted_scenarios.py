"""Random blocks of tilted photos: their linearisation, and what the strategies do to the ground."""

from __future__ import annotations

import numpy as np
import pytest

from anaplot.adjustment.residualsystem import DenseResiduals
from anaplot.adjustment.significance import critical_normal
from anaplot.planning.montecarlo import figures, simulate
from anaplot.planning.tiltedblock import tilted_block
from anaplot.planning.tiltedscenarios import NOTHING, TiltedScenario, scenarios
from anaplot.planning.truncated import truncated_residuals

pytestmark = pytest.mark.slow


def test_the_block_is_its_own_adjustment() -> None:
    block = tilted_block(np.random.default_rng(1))
    design, n = block.design.toarray(), len(block.names)
    np.testing.assert_allclose(block.matrix @ block.matrix, block.matrix, atol=1e-9)
    np.testing.assert_allclose(block.matrix @ design, 0.0, atol=1e-6 * np.abs(design).max())
    r = np.diag(block.matrix)
    assert r.sum() == pytest.approx(n - design.shape[1])
    # tilts let an x coordinate of two rays check a little, which flat geometries hide
    assert 10 <= ((r > 1e-6) & (r < 0.01)).sum() <= 60
    # an error of the ground, seen by all rows, is all of what is found there
    moved = np.random.default_rng(2).normal(size=design.shape[1])
    points = len(block.inverse) // 3
    np.testing.assert_allclose(
        block.point_errors(design @ moved, ()), moved[-3 * points :].reshape(-1, 3), atol=1e-6
    )


def test_a_row_left_out_has_no_say_on_the_ground() -> None:
    rng = np.random.default_rng(3)
    block = tilted_block(rng)
    errors = rng.normal(size=len(block.names))
    row = int(np.argmax(np.diag(block.matrix)[: block.image_rows]))
    rest = np.delete(np.arange(len(block.names)), row)
    design = block.design.toarray()[rest]
    length = np.linalg.norm(design, axis=0)
    expected = np.linalg.lstsq(design / length, errors[rest], rcond=None)[0] / length
    np.testing.assert_allclose(
        block.point_errors(errors, (row,)).ravel(), expected[-len(block.inverse) :], atol=1e-7
    )


def test_strategies_find_errors_and_spare_the_ground() -> None:
    scenario = TiltedScenario("small", "", sizes=(18.0,), numbers=(10,))
    tally = simulate(scenario, runs=12, seed=5)
    case = "10 of 18 sigma"
    found = figures(tally, scenario.prepare().quantities(scenario.methods), {})
    mean = {(f.method, f.quantity): f.mean for f in found}
    assert set(mean) == {key[1:] for key in tally}
    for method in scenario.methods:
        assert mean[method, "right"] + mean[method, "missed"] == pytest.approx(10.0)
        assert tally[case, method, "rms Z [m]"].runs == 12
    assert mean[NOTHING, "right"] == mean[NOTHING, "wrong"] == 0.0
    assert mean[NOTHING, "rms Z [m]"] > 0.2
    for method in ("l1", "gnc", "search", "odds"):
        assert mean[method, "right"] > 6.0
        assert mean[method, "wrong"] < 3.0
        # an x coordinate of two rays that is rejected costs tens of metres
        assert mean[method, "rms Z [m]"] < 1.3 * mean[NOTHING, "rms Z [m]"]


def test_the_named_scenario() -> None:
    (scenario,) = scenarios()
    assert scenario.name == "strategies-tilted"
    cases = {case for case, _, _ in scenario.prepare().quantities(("odds",))}
    assert len(cases) == 12


def test_truncated_least_squares_leaves_out_what_is_far_off() -> None:
    rng = np.random.default_rng(6)
    design = rng.normal(size=(60, 15))
    q = np.linalg.qr(design)[0]
    matrix = np.eye(60) - q @ q.T
    errors = rng.normal(size=60) * 0.5
    errors[[3, 30, 44]] += 25.0
    e = matrix @ errors
    system = DenseResiduals(tuple(range(60)), e, np.diag(matrix), float(e @ e), 45, matrix)
    v = truncated_residuals(system, critical_normal(0.001))
    assert set(np.flatnonzero(np.abs(v) > 3.29).tolist()) == {3, 30, 44}
    rest = np.delete(np.arange(60), [3, 30, 44])
    kept = np.linalg.lstsq(design[rest], errors[rest], rcond=None)[0]
    np.testing.assert_allclose(v[rest], (errors - design @ kept)[rest], atol=1e-6)
    small = DenseResiduals(tuple(range(60)), 0.1 * e, system.r, 0.01 * system.vtpv, 45, matrix)
    np.testing.assert_array_equal(truncated_residuals(small, 10.0), small.e)


def test_a_point_does_not_lose_what_holds_its_height() -> None:
    """A point lost x of one ray and then, for 3.3 sigmas in y, all of another: 17 m in Z."""
    trial = TiltedScenario("t", "", sizes=(6.0,), numbers=(20,)).prepare()
    rng = np.random.default_rng(0)
    for _ in range(20):
        last = trial.one(rng, "20 of 6 sigma", (NOTHING, "baarda"))
        assert last["baarda"].height < 4.0 * last[NOTHING].height
