"""Calibration against the truth: strong distortion, and standard deviations that are true."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from calibrationblocks import STRONG, TRUTH, convergent, make_block, stated

from anaplot.adjustment.hypothesis import critical_f
from anaplot.bundle.adjust import adjust_block, adjust_bundle
from anaplot.bundle.solve.additional import additional_parameters
from anaplot.bundle.solve.imaging import with_additional
from anaplot.bundle.solve.problem import make_problem
from anaplot.photogrammetry.lens import LENS_PARAMETERS, through_lens
from anaplot.report.calibration import calibration_of

pytestmark = pytest.mark.slow

ALPHA = 1e-3


def quadratic(block, truth: np.ndarray) -> float:
    """Squared distance of all parameters from the truth, by their covariance (sigma0 = 1)."""
    off = block.state.shared - truth / block.problem.lens_units.ravel()
    return float(off @ np.linalg.solve(block.cofactors.shared, off))


def test_strong_distortion_is_found_where_polynomials_leave_more() -> None:
    reach = np.array([[14.0, 10.0]]) / 20.0
    assert np.linalg.norm(through_lens(reach, np.array(STRONG)).xy - 20.0 * reach) > 0.3
    block = convergent(16)
    chosen = calibration_of(block, ["c,x0,y0,k1,k2,k3,p1,p2,b1,b2"], [])
    found = adjust_block(block, datum="free", additional=chosen)
    # the global test, both ways
    assert found.sigma0**2 < critical_f(ALPHA / 2.0, found.redundancy)
    assert found.sigma0**2 > 2.0 - critical_f(ALPHA / 2.0, found.redundancy)
    truth = np.array(STRONG) - (20.0, *(0.0,) * 9)
    assert quadratic(found, truth) < 10.0 * critical_f(ALPHA, 10)
    for row, wanted in zip(found.parameter_rows(), truth, strict=True):
        assert abs(row.coefficient - wanted) < 4.0 * row.s_coefficient, row.name
    # 44 terms of the measured coordinates, from the right orientations
    gruen = make_problem(block, datum="free", additional=additional_parameters("gruen"))
    polynomials = adjust_bundle(gruen, with_additional(gruen, found.state))
    assert polynomials.sigma0**2 > 1.2 * critical_f(ALPHA, polynomials.redundancy)


def test_a_stated_lens_leaves_nothing_to_free_parameters() -> None:
    """Calibrated twice: what is found is stated, and then nothing is left to be found."""
    block = convergent(8)
    everything = ["c,x0,y0,k1,k2,k3,p1,p2,b1,b2"]
    first = adjust_block(block, datum="free", additional=calibration_of(block, everything, []))
    values = ",".join(
        f"{row.name}={row.coefficient + (20.0 if row.name == 'c' else 0.0)!r}"
        for row in first.parameter_rows()
    )
    held = [f"{name}=0" for name in LENS_PARAMETERS]
    kept = adjust_block(block, datum="free", additional=calibration_of(block, [values], held))
    assert kept.vtpv == pytest.approx(first.vtpv, rel=1e-9)
    assert kept.redundancy == first.redundancy + 10
    np.testing.assert_allclose(kept.v, first.v, atol=1e-6)


def test_deviations_of_three_calibrated_cameras_are_true() -> None:
    """Sums of squares over runs follow chi-square: of parameters, of points, of v'Pv."""
    runs, scene = 12, make_block(noise=0.0)
    names = ["drone:c,x0,y0,k1,k2,p1,p2", "phone/7:c,y0,k1,k2,p2,b1,b2", "metric:c"]
    chosen = calibration_of(scene, names, [])
    start = adjust_block(scene, additional=chosen)
    problem = start.problem
    assert start.sigma0 < 1e-4
    truth = np.array(
        [
            np.array(TRUTH[camera])[list(chosen.set.columns)]
            - np.array(stated(camera).lens_parameters)[list(chosen.set.columns)]
            for camera in problem.additional_groups
        ]
    ).ravel()
    free = np.flatnonzero(~problem.additional_still.ravel())
    assert len(free) == 15
    rng = np.random.default_rng(8)
    control = np.isfinite(problem.known_sigma)
    of_lens = of_points = of_v = 0.0
    watched = np.flatnonzero(~control.any(axis=1))[:3]
    for _ in range(runs):
        noisy = replace(
            problem,
            xy=problem.xy + rng.normal(size=problem.xy.shape) * problem.sigma_xy,
            known=problem.known
            + np.where(control, rng.normal(size=control.shape) * problem.known_sigma, 0.0),
        )
        block = adjust_bundle(noisy, start.state)
        off = (block.state.shared - truth / problem.lens_units.ravel())[free]
        q = block.cofactors.shared[np.ix_(free, free)]
        of_lens += float(off @ np.linalg.solve(q, off))
        for point in watched:
            gone = block.state.points[point] - start.state.points[point]
            of_points += float(gone @ np.linalg.solve(block.cofactors.points[point], gone))
        of_v += block.vtpv
    degrees = runs * len(free)
    for square, count in ((of_lens, degrees), (of_v, runs * start.redundancy)):
        upper = critical_f(ALPHA / 2.0, count)
        assert square / count < upper
        assert square / count > 2.0 - upper
    # three points of one run are not independent; their mean is 9
    assert of_points / runs / 9.0 == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / (3.0 * runs)))
    assert make_problem(scene, additional=chosen).additional_unknowns == 15
