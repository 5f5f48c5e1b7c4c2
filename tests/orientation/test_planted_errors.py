"""Table 1 of the paper: a gross error changes every residual by the predicted amount."""

import numpy as np
import pytest
from flightscene import (
    BAARDA,
    PAPER,
    PROPAGATED,
    bridge_flight,
    fly,
    pair_of,
)
from idealmodel import ideal_pair, spoiled

from anaplot.adjustment.leastsquares import adjust
from anaplot.orientation.conditionequations import ConditionEquations, ModelUnknowns
from anaplot.orientation.model import UNKNOWNS, orient
from anaplot.orientation.patterns import PATTERNS, pattern

SIZE = 0.100  # mm, as in the paper


def parallaxes(model):
    return np.array([row.residual for row in model.table])


@pytest.mark.parametrize("name", list(PATTERNS))
def test_planted_in_the_misclosure_it_is_exact(name):
    pair = ideal_pair(name)
    conditions = ConditionEquations(pair)
    first = not pattern(name).ties
    rows = conditions.evaluate(ModelUnknowns(60.0, 0.0, 0.0, np.eye(3)))
    q = conditions.cofactors(60.0)
    design = (rows[conditions.unknown_rows()] * np.sqrt(q)).T
    names = UNKNOWNS[1:] if first else UNKNOWNS
    for k in range(len(q)):
        misclosure = np.zeros(len(q))
        misclosure[k] = SIZE
        a = adjust(design, misclosure, q, unknowns=names)
        influence = a.q_vv / q
        assert a.w == pytest.approx(influence[:, k] * SIZE, abs=1e-15)
        assert a.w[k] == pytest.approx(a.r[k] * SIZE, abs=1e-15)


@pytest.mark.parametrize("name", list(PATTERNS))
def test_planted_in_the_image_it_is_predicted_to_second_order(name):
    pair = ideal_pair(name)
    clean = orient(pair, PAPER, BAARDA)
    influence = clean.q_vv / clean.q_l
    for k, row in enumerate(clean.table):
        wrong = orient(spoiled(pair, row.point, row.axis, SIZE), PAPER, BAARDA)
        change = parallaxes(wrong) - parallaxes(clean)
        # 100 um of 100 mm: second-order terms are of the order of 100 um / 1000
        assert change == pytest.approx(influence[:, k] * 1e3 * SIZE, abs=0.35)
        assert change[k] == pytest.approx(row.r * 1e3 * SIZE, abs=0.35)


@pytest.mark.parametrize("precision", [PAPER, PROPAGATED])
def test_the_remainder_is_of_second_order(precision):
    """A tenth of the error leaves a hundredth of the remainder, in a tilted model too."""
    flight = fly(4, tilt=3.0, kappa=10.0)
    first = bridge_flight(flight, precision, BAARDA)[0]
    pair = pair_of(flight, 1, first)
    clean = orient(pair, precision, BAARDA)
    # tilted images: a is not exactly the derivative, so the comparison is with a tiny error
    for k in range(0, len(clean.table), 3):
        row = clean.table[k]

        def effect(size, row=row):
            wrong = orient(spoiled(pair, row.point, row.axis, size), precision, BAARDA)
            return (parallaxes(wrong) - parallaxes(clean)) / size

        linear = effect(1e-4)
        large, small = effect(0.1) - linear, effect(0.01) - linear
        assert np.abs(small).max() <= 0.15 * np.abs(large).max() + 1e-3


def test_an_error_of_an_x_coordinate_shows_in_no_y_row_of_a_first_model():
    pair = ideal_pair("13")
    for point in pair.points:
        wrong = orient(spoiled(pair, point, "x", SIZE), PAPER, BAARDA)
        assert np.abs(parallaxes(wrong)).max() < 1e-9
