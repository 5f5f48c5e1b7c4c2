"""Three estimators with prior knowledge: the dense formulas of the paper, on blocks."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from bundleblocks import aerial
from denseblock import dense
from gnssblocks import flown

from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.hypotheses.components import block_components
from anaplot.bundle.hypotheses.offsetadvice import offset_advice
from anaplot.bundle.hypotheses.priorknowledge import prior_estimate
from anaplot.bundle.solve.additional import additional_parameters
from anaplot.bundle.solve.linearised import linearise
from anaplot.bundle.solve.remade import laid_out_again, with_given_back, without_points
from anaplot.errors import InputError
from anaplot.photogrammetry.prioroffsets import PriorOffsets

ESTIMATORS = ("known", "common", "separate")


def adjusted(*, strips=2, length=4, seed=0, prior_noise=1.0, kind="tau", **options):
    """Return an adjusted block whose priors err `prior_noise` times as much as they say."""
    additional = options.pop("additional", None)
    scene = aerial(strips, length, seed=seed, noise_um=5.0, priors=True, control_sigma=0.05)
    rng = np.random.default_rng(seed + 7)

    def near(values, sigma):
        return tuple((np.array(values) + rng.normal(size=3) * sigma * prior_noise).tolist())

    block = scene.block
    photos = tuple(
        replace(
            photo,
            position=near(scene.centres[photo.id], 0.1),
            rotation=near(photo.rotation, 1e-3),
        )
        for photo in block.photos
    )
    control = tuple(replace(row, xyz=near(row.xyz, 0.05)) for row in block.control)
    block = replace(block, photos=photos, control=control, test=replace(block.test, kind=kind))
    return adjust_block(block, additional=additional)


def dense_estimate(a, e, d, e_x, estimator):
    """Corrections, covariance and both factors: eq. 2 and 3 with the redundancies as divisors."""
    scale = np.linalg.norm(np.vstack((a, d)), axis=0)
    a, d = a / scale, d / scale
    factor = factor_x = 1.0
    for _ in range(200 if estimator == "separate" else 1):
        c = np.linalg.inv(a.T @ a / factor + d.T @ d / factor_x)
        x = -c @ (a.T @ e / factor + d.T @ e_x / factor_x)
        v, v_x = a @ x + e, d @ x + e_x
        r = len(a) - np.trace(c @ a.T @ a) / factor
        r_x = len(d) - np.trace(c @ d.T @ d) / factor_x
        if estimator == "separate":
            factor, factor_x = v @ v / r, v_x @ v_x / r_x
    if estimator == "common":
        factor = factor_x = (v @ v + v_x @ v_x) / (r + r_x)
        c = c * factor
    return x / scale, c / scale[:, None] / scale, factor, factor_x


@pytest.mark.parametrize("additional", [None, "ebner"])
@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_a_block_is_estimated_as_the_dense_formulas_say(estimator, additional):
    chosen = None if additional is None else additional_parameters(additional, 5.0)
    block = adjusted(seed=3, prior_noise=2.0, additional=chosen)
    found = prior_estimate(block, estimator)
    # the stated weights, at the state that was found
    linear = linearise(block.problem, found.block.state)
    stated = SimpleNamespace(
        problem=block.problem, cofactors=SimpleNamespace(normal=SimpleNamespace(linear=linear))
    )
    rows, free = dense(stated)
    own = np.broadcast_to(linear.own_e, (len(block.problem.photos), block.problem.per_photo - 6))
    e = np.concatenate(
        [
            part.ravel()
            for part in (linear.e, linear.point_e[0], linear.photo_e, own, linear.shared_e)
        ]
    )
    images = 2 * len(block.problem.photo)
    some = np.flatnonzero(np.abs(rows[images:]).sum(axis=1) > 0.0) + images
    x, c, factor, factor_x = dense_estimate(
        rows[:images, free], e[:images], rows[some][:, free], e[some], estimator
    )
    assert found.prior.observations == len(some)
    assert found.image.observations == images
    assert found.image.factor == pytest.approx(factor, rel=1e-4)
    assert found.prior.factor == pytest.approx(factor_x, rel=1e-4)
    s = np.sqrt(np.diag(c))
    assert (np.abs(x) < 1e-4 * s).all()
    photos, points = len(block.problem.photos), block.problem.points
    shown = [row.s_position for row in found.block.photo_rows()]
    np.testing.assert_allclose(shown, s[: 6 * photos].reshape(-1, 6)[:, :3], rtol=1e-4)
    of_points = s[6 * photos :][: 3 * len(points)].reshape(-1, 3)
    for row in found.block.point_rows():
        np.testing.assert_allclose(row.s_xyz, of_points[points.index(row.point)], rtol=1e-4)


def test_known_factors_are_the_apriori_sigma_and_a_common_one_the_estimated():
    for estimator, kind in (("known", "baarda"), ("common", "tau")):
        for own in ("baarda", "tau"):
            found = prior_estimate(adjusted(kind=own), estimator)
            same = adjusted(kind=kind)
            assert found.block.sigma == pytest.approx(same.sigma)
            np.testing.assert_allclose(found.block.w, same.w, rtol=1e-5, atol=1e-6)
            for mine, other in zip(found.block.photo_rows(), same.photo_rows(), strict=True):
                np.testing.assert_allclose(mine.s_position, other.s_position, rtol=1e-6)


@pytest.mark.slow
def test_separate_factors_are_those_that_made_the_errors():
    hits = []
    for seed in range(20):
        found = prior_estimate(adjusted(seed=seed, prior_noise=3.0), "separate")
        assert found.converged
        assert found.block.sigma0 == pytest.approx(1.0, abs=1e-5)
        for group, true in ((found.image, 1.0), (found.prior, 9.0)):
            assert group.interval is not None
            hits.append(group.interval[0] < true < group.interval[1])
    # 95 % intervals: fewer than 31 of 40 (binomial) would be a chance below 1e-4
    assert sum(hits) >= 31


def test_redundancies_and_numbers_add_up():
    block = adjusted()
    found = prior_estimate(block, "common")
    assert found.image.redundancy + found.prior.redundancy == pytest.approx(block.redundancy)
    assert found.image.observations + found.prior.observations == block.problem.observations


def test_a_block_of_which_nothing_is_known_is_refused():
    block = adjust_block(aerial(noise_um=5.0).block)  # control free of error
    with pytest.raises(InputError, match="nothing is known beforehand"):
        prior_estimate(block, "known")


@pytest.mark.slow
def test_a_block_of_a_hundred_photos():
    found = prior_estimate(adjusted(strips=5, length=20, prior_noise=2.0), "separate")
    assert found.converged
    # four standard deviations of a chi-square of the redundancy
    for group, true in ((found.image, 1.0), (found.prior, 4.0)):
        assert abs(group.factor / true - 1.0) < 4.0 * np.sqrt(2.0 / group.redundancy)


@pytest.mark.parametrize("image", [1.0, 8.0])
def test_offsets_are_advised_with_the_weights_that_were_estimated(image):
    # with the stated weights of images that were eight times as good nothing would be advised
    block = flown(PriorOffsets(), seed=1, angles=False).scene.block
    off = np.array([0.3, -0.3, 0.3])
    photos = tuple(
        replace(photo, position=tuple((np.array(photo.position) + off).tolist()))
        for photo in block.photos
    )
    precision = replace(block.precision, image_um=block.precision.image_um / image)
    stated = adjust_block(replace(block, photos=photos, offsets=None, precision=precision))
    found = prior_estimate(stated, "separate").block
    # as many as make it ask with all that is given: here nothing of that was left out
    rejected = [("control", row.point, "Z") for row in block.control[:4]]
    [advice] = offset_advice(found, rejected)
    [same] = offset_advice(found)
    assert advice.falls == pytest.approx(same.falls, rel=1e-5)
    assert advice.vtpv == pytest.approx(same.vtpv, rel=1e-5)


@pytest.mark.parametrize("grouping", ["axes", "strips", None])
def test_what_is_laid_out_anew_keeps_estimated_weights(grouping):
    stated = adjusted(prior_noise=3.0, additional=additional_parameters("ebner", 5.0))
    if grouping is None:
        problem = prior_estimate(stated, "separate").block.problem
        assert problem.estimated.additional > 1.5
    else:
        problem = block_components(stated, grouping).block.problem
        assert np.ptp(problem.sigma_xy) > 0.0
    assert problem.estimated.position > 1.5
    rays = {one: k for k, one in enumerate(problem.source.tolist())}
    place = {name: k for k, name in enumerate(problem.points)}
    gone = problem.points[:2]
    for anew in (
        laid_out_again(problem, problem.block),
        with_given_back(problem),
        without_points(problem, gone),
    ):
        its = [rays[k] for k in anew.source.tolist()]
        np.testing.assert_allclose(anew.sigma_xy, problem.sigma_xy[its], rtol=1e-12)
        mine = [place[name] for name in anew.points]
        np.testing.assert_allclose(anew.known_sigma, problem.known_sigma[mine], rtol=1e-12)
        for key in ("position_sigma", "rotation_sigma"):
            np.testing.assert_allclose(getattr(anew, key), getattr(problem, key), rtol=1e-12)
        # what a sigma as an effect in the image is hangs on which rays there are
        np.testing.assert_allclose(anew.additional_sigma, problem.additional_sigma, rtol=0.02)
        assert anew.estimated == problem.estimated
