"""Standard deviations of a model against numerical derivatives and against what is printed."""

from dataclasses import replace

import numpy as np
import pytest
from flightscene import BAARDA, EXACT, PAPER, PROPAGATED, TAU, fly, pair_of
from idealmodel import ideal

from anaplot.orientation.accuracy import model_accuracy
from anaplot.orientation.model import orient
from anaplot.orientation.patterns import pattern
from anaplot.photogrammetry.rotation import rotation_angles, rotation_matrix

STEP = 0.01  # mm
ORDER = ("bx", "by", "bz", "omega", "phi", "kappa")


def shifted(pair, k, j, step):
    """The pair with one image coordinate moved: xl, yl, xr, yr of point k."""
    xl, xr = pair.xl.copy(), pair.xr.copy()
    (xl if j < 2 else xr)[k, j % 2] += step
    return replace(pair, xl=xl, xr=xr)


def moved(pair, precision):
    """Orientation and points of a model by each of its image coordinates, ties held."""

    def all_of(one):
        model = orient(one, precision, BAARDA)
        return np.array([*model.base, *model.rotation, *np.ravel([p[1:] for p in model.points])])

    return np.array([
        (all_of(shifted(pair, k, j, STEP)) - all_of(shifted(pair, k, j, -STEP))) / (2.0 * STEP)
        for k in range(len(pair.points))
        for j in range(4)
    ]).T  # fmt: skip


def spread_of_points(change):
    points = change[6:].reshape(-1, 3, change.shape[1])
    return 5e-3 * np.sqrt(np.einsum("kai,kai->ka", points, points))


def test_a_first_model_by_numerical_derivatives():
    pair = pair_of(fly(4, photos=2, tilt=5.0, kappa=15.0), 0, base=70.0)
    found = model_accuracy(orient(pair, EXACT, BAARDA))
    change = moved(pair, EXACT)
    assert found.points == pytest.approx(spread_of_points(change), rel=1e-5)
    elements = change[1:6]
    spread = np.linalg.norm(elements, axis=1)
    assert found.elements == ORDER[1:]
    assert found.of("bx") is None
    assert found.of("kappa") == pytest.approx(5e-3 * spread[-1], rel=1e-5)
    assert found.deviations == pytest.approx(5e-3 * spread, rel=1e-5)
    rho = elements @ elements.T / np.outer(spread, spread)
    assert found.correlations == pytest.approx(rho, abs=1e-5)
    one, other, strongest = found.strongest
    assert one != other
    assert abs(strongest) == pytest.approx(np.abs(rho - np.eye(5)).max(), abs=1e-5)


def test_points_of_a_later_model_whose_ties_are_free_of_error_by_numerical_derivatives():
    flight = fly(4, photos=3, tilt=5.0, kappa=15.0)
    pair = pair_of(flight, 1, orient(pair_of(flight, 0, base=70.0), PAPER, BAARDA))
    found = model_accuracy(orient(pair, PAPER, BAARDA))
    assert found.elements == ORDER
    change = moved(pair, PAPER)
    assert found.points == pytest.approx(spread_of_points(change), rel=1e-5)


@pytest.mark.slow
def test_a_later_model_whose_ties_err_by_numerical_derivatives_of_the_whole_strip():
    flight = fly(4, photos=3, tilt=5.0, kappa=15.0)

    def both(images):
        one = replace(flight, images=images)
        first = orient(pair_of(one, 0, base=70.0), EXACT, BAARDA)
        # a ray of the middle photo serves both models
        return first, orient(pair_of(one, 1, first, once=frozenset(images[1])), EXACT, BAARDA)

    first, second = both(flight.images)
    held = rotation_matrix(*first.rotation)

    def elements(photo, point, move):
        """Elements of the second model with its left photo where it was."""
        images = [dict(seen) for seen in flight.images]
        images[photo][point] = tuple(np.add(images[photo][point], move).tolist())
        before, after = both(images)
        back = held @ rotation_matrix(*before.rotation).T
        return np.array(
            [*(back @ after.base), *rotation_angles(back @ rotation_matrix(*after.rotation))]
        )

    change = np.array([
        (elements(photo, point, move) - elements(photo, point, np.negative(move))) / (2.0 * STEP)
        for photo, seen in enumerate(flight.images)
        for point in seen
        for move in STEP * np.eye(2)
    ]).T  # fmt: skip
    covariance = change @ change.T
    spread = np.sqrt(np.diag(covariance))
    found = model_accuracy(second)
    assert found.elements == ORDER
    assert found.deviations == pytest.approx(5e-3 * spread, rel=1e-5)
    assert found.correlations == pytest.approx(covariance / np.outer(spread, spread), abs=1e-5)


def test_elements_of_a_later_model_follow_from_the_unknowns_by_numerical_derivatives():
    flight = fly(4, photos=3, tilt=5.0, kappa=15.0)
    model = orient(
        pair_of(flight, 1, orient(pair_of(flight, 0, base=70.0), PAPER, BAARDA)), PAPER, BAARDA
    )
    bx, by, bz = model.base
    assert model.unknowns == ("bx", "beta_y", "beta_z", "kappa", "phi", "omega")
    assert min(abs(by), abs(bz)) > 0.01 * abs(bx), "else nothing of the scale is in them"

    def elements(unknowns):
        scale, beta_y, beta_z, kappa, phi, omega = unknowns
        return np.array([scale, scale * beta_y, scale * beta_z, omega, phi, kappa])

    at, step = np.array([bx, by / bx, bz / bx, 0.0, 0.0, 0.0]), 1e-4 * np.eye(6)
    change = np.array([elements(at + h) - elements(at - h) for h in step]).T / 2e-4
    covariance = change @ model.q_gg @ change.T
    spread = np.sqrt(np.diag(covariance))
    found = model_accuracy(model)
    assert found.deviations == pytest.approx(5e-3 * spread)
    assert found.correlations == pytest.approx(covariance / np.outer(spread, spread))


def test_points_at_infinity_are_no_part_of_the_mean():
    found = model_accuracy(ideal(pattern("13"), 90.0, 100.0, 152.0))
    rms = np.sqrt(np.mean(found.points**2, axis=0))
    assert found.rms == pytest.approx(rms)
    far = np.vstack((found.points, [np.inf, 0.01, np.nan]))
    assert replace(found, points=far).rms == pytest.approx(rms)


def test_the_estimated_sigma_counts_under_tau():
    flight = fly(4, photos=2, tilt=3.0, noise=0.01)
    pair = pair_of(flight, 0, base=70.0)
    known, estimated = (model_accuracy(orient(pair, PROPAGATED, test)) for test in (BAARDA, TAU))
    assert known.sigma_um == 5.0
    ratio = estimated.sigma_um / 5.0
    assert estimated.deviations == pytest.approx(ratio * known.deviations)
    assert estimated.points == pytest.approx(ratio * known.points)


def test_without_redundancy_there_are_no_deviations_under_tau():
    flight = fly(4, photos=2, tilt=3.0)
    names = ("0a", "0b", "0c", "1a", "1c")
    found = model_accuracy(orient(pair_of(flight, 0, points=names, base=70.0), PROPAGATED, TAU))
    assert found.sigma_um is None
    assert found.of("by") is None
    assert np.isnan(found.points).all()


def test_trace_of_thirteen_points():
    assert model_accuracy(ideal(pattern("13"), 90.0, 100.0, 152.0)).trace == pytest.approx(
        14.35, abs=5e-3
    )
