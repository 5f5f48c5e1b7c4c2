"""What exists and what does not: no redundancy, redundancy 1, untestable rows, tie variances."""

from dataclasses import replace

import numpy as np
import pytest
from flightscene import (
    BAARDA,
    PAPER,
    PROPAGATED,
    TAU,
    bridge_flight,
    fly,
    pair_of,
)
from idealmodel import ideal_pair, spoiled

from anaplot.adjustment.significance import critical_normal, critical_tau
from anaplot.orientation.conditionequations import tie_cofactor
from anaplot.orientation.diagnosis import diagnose
from anaplot.orientation.model import orient
from anaplot.orientation.strip import pooled_sigma_um

FIVE = ["0a", "0d", "1a", "1d", "0mb"]
SIX = ["0a", "0c", "0d", "1a", "1c", "1d"]


def flight():
    return fly(8, 3, tilt=3.0, kappa=10.0, noise=0.004)


@pytest.mark.parametrize("test", [TAU, BAARDA])
def test_five_points_are_an_orientation_without_any_check(test):
    model = orient(pair_of(flight(), 0, points=FIVE), PAPER, test)
    assert model.redundancy == 0
    assert model.sigma0_um is None
    assert model.test.critical is None
    assert "an orientation without any check" in model.remarks[0]
    for row in model.table:
        assert row.r < 1e-9
        assert row.residual == pytest.approx(0.0, abs=1e-6)
        assert row.w is None
        assert not row.flagged
        if test is TAU:
            assert row.expected is None
        else:
            assert row.expected == pytest.approx(0.0, abs=1e-3)
    d = diagnose(model)
    assert all(row.mdb is None and row.effect is None for row in model.table)
    assert model.tested.odds.none == pytest.approx(0.9)
    assert model.tested.power is None
    assert d.advice == model.remarks
    assert d.suspects == d.partners == d.transfers == ()


def test_redundancy_one_under_tau():
    model = orient(pair_of(flight(), 0, points=SIX), PAPER, TAU)
    assert model.redundancy == 1
    assert model.test.critical is None
    assert [row.size for row in model.table] == pytest.approx([1.0] * 6)
    assert not model.flagged
    assert "nothing can be located" in model.remarks[0]
    assert model.tested.power is None
    assert model.tested.odds.none == pytest.approx(0.9)  # every factor is 1: nothing was learnt


def test_redundancy_one_under_baarda_flags_all_rows_or_none():
    pair = pair_of(flight(), 0, points=SIX)
    good = orient(pair, PAPER, BAARDA)
    assert good.test.critical == pytest.approx(critical_normal(0.001))
    ratios = [row.size for row in good.table]
    assert ratios == pytest.approx([ratios[0]] * 6)
    bad = orient(spoiled(pair, "0c", "y", 0.5), PAPER, BAARDA)
    assert len(bad.flagged) == 6
    assert len(diagnose(bad).partners) == 15


def test_critical_values_in_use():
    first, second = bridge_flight(flight(), PAPER, TAU)
    assert first.test == ("tau", 0.001, critical_tau(0.001, first.redundancy), 0.80)
    assert second.test.critical == critical_tau(0.001, second.redundancy)
    assert bridge_flight(flight(), PAPER, BAARDA)[1].test.critical == critical_normal(0.001)


def test_a_row_that_nothing_checks_has_no_significance():
    f = flight()
    first = bridge_flight(f)[0]
    # one tie: its x alone determines bx, nothing else knows the scale
    points = ["1a", "1ma", "1mb", "1mc", "2a", "2c", "2d", "2b"]
    model = orient(pair_of(f, 1, first, points=points), PAPER, BAARDA)
    row = model.table[-1]
    assert model.ties == ("1a",)
    assert row.key == ("1a", "x")
    assert row.r < 1e-9
    assert row.w is None
    assert not row.flagged
    d = diagnose(model)
    assert model.table[-1].mdb is None
    assert all(("1a", "x") not in (p.first, p.second) for p in d.partners)
    assert all(row.w is not None for row in model.table[:-1])


@pytest.mark.parametrize(("k", "q"), [(1.0, 6.0), (0.0, 2.0), (0.5, 3.5), (2.0, 14.0)])
def test_propagated_tie_variance(k, q):
    assert tie_cofactor(k, "propagated") == pytest.approx(q)
    assert tie_cofactor(k, "paper") == 1.0


def test_tie_variance_takes_the_ratio_of_the_converged_bases():
    f = flight()
    first, second = bridge_flight(f, PROPAGATED)
    k = second.base[0] / first.base[0]
    n = len(second.points)
    assert second.q_l[:n] == pytest.approx(np.full(n, 2.0))
    assert second.q_l[n:] == pytest.approx(np.full(len(second.ties), 1 + (1 + k) ** 2 + k**2))
    paper = bridge_flight(f, PAPER)[1]
    assert paper.q_l[n:] == pytest.approx(np.ones(len(paper.ties)))
    # an x row that varies more is expected to deviate more
    assert second.table[-1].r > paper.table[-1].r
    assert (second.tie_variance, paper.tie_variance) == ("propagated", "paper")


def test_switched_off_rows_are_no_part_of_the_model():
    f = flight()
    first, second = bridge_flight(f)
    off = frozenset({("1a", "x"), ("2c", "y")})
    model = orient(pair_of(f, 1, first, off=off), PAPER, TAU)
    keys = [row.key for row in model.table]
    assert not off & set(keys)
    assert len(keys) == len(second.table) - 2
    assert model.redundancy == second.redundancy - 2
    # no row of 2c is left: it was measured, and is no point of the model
    points = [p.point for p in second.points]
    assert list(model.measured) == points
    assert [p.point for p in model.points] == [name for name in points if name != "2c"]
    assert "1a" not in model.ties
    # switching off a wrong row gives what the others say
    x, y = f.images[2]["2c"]
    wrong = pair_of(f, 1, first, off=off, right=dict(f.images[2]) | {"2c": (x, y + 5.0)})
    again = orient(wrong, PAPER, TAU)
    assert again.base == pytest.approx(model.base, abs=1e-8)


def test_badly_spread_points_are_said_to_be():
    pair = ideal_pair("13")
    xl = pair.xl * [0.02, 1.0]
    narrow = orient(replace(pair, xl=xl, xr=xl - [60.0, 0.0]), PAPER, TAU)
    assert 200.0 < narrow.condition < 1e4
    assert narrow.remarks == (
        f"the points are badly spread (condition number {narrow.condition:.0f})",
    )
    wide = orient(pair, PAPER, TAU)
    assert wide.condition < 200.0
    assert not wide.remarks


def test_nine_well_spread_points_have_a_condition_number_near_17():
    assert orient(ideal_pair("9"), PAPER, TAU).condition == pytest.approx(15.0, abs=3.0)


def test_pooled_sigma():
    models = tuple(bridge_flight(flight()))
    total = sum(m.redundancy * m.sigma0_um**2 for m in models)
    expected = (total / sum(m.redundancy for m in models)) ** 0.5
    assert pooled_sigma_um(models) == pytest.approx(expected)
    unchecked = orient(pair_of(flight(), 0, points=FIVE), PAPER, TAU)
    assert pooled_sigma_um((unchecked,)) is None
    assert pooled_sigma_um(()) is None


def test_parax_has_the_sign_of_the_error():
    pair = ideal_pair("13/5")
    for point, axis in (("4", "y"), ("2", "x")):
        for sign in (1.0, -1.0):
            model = orient(spoiled(pair, point, axis, sign * 0.05), PAPER, TAU)
            row = next(row for row in model.table if row.key == (point, axis))
            assert row.residual * sign > 0.0
            assert row.residual == pytest.approx(sign * row.r * 50.0, rel=0.02)
