"""What the operator is told beyond the table."""

import json
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

from anaplot.adjustment.advice import odds_in_words, remeasure
from anaplot.adjustment.partners import rounded
from anaplot.adjustment.reliability import HARD_TO_TELL
from anaplot.adjustment.significance import noncentrality, tau_power
from anaplot.orientation.diagnosis import diagnose
from anaplot.orientation.model import orient
from anaplot.report.asjson import json_text
from anaplot.report.modeldocument import model_document


def models(precision=PAPER, test=TAU):
    return bridge_flight(fly(8, 3, tilt=3.0, kappa=10.0, noise=0.004), precision, test)


@pytest.mark.parametrize("precision", [PAPER, PROPAGATED])
def test_smallest_detectable_errors_take_the_a_priori_sigma_whatever_the_test(precision):
    for test in (TAU, BAARDA):
        for model in models(precision, test):
            for row in model.table:
                q = 2.0 if row.axis == "y" else model.q_l[-1]
                expected = noncentrality(0.001, 0.80) * 5.0 * (q / row.r) ** 0.5
                assert row.mdb == pytest.approx(expected)
                effect = noncentrality(0.001, 0.80) * ((1 - row.r) / row.r) ** 0.5
                assert row.effect == pytest.approx(effect)


def test_the_real_power_of_tau_is_shown():
    model = models()[1]
    expected = tau_power(noncentrality(0.001, 0.8), 0.001, model.redundancy)
    assert model.tested.power == pytest.approx(expected)
    assert 0.0 < expected < 0.8
    assert models(test=replace(BAARDA, power=0.9))[1].tested.power == 0.9


def test_correlated_rows_are_partners():
    model = models()[0]
    d = diagnose(model)
    deviation = np.sqrt(np.diag(model.q_vv))
    rho = model.q_vv / np.outer(deviation, deviation)
    keys = [row.key for row in model.table]
    n = len(keys)
    expected = {
        (keys[i], keys[j]) for i in range(n) for j in range(i) if abs(rho[i, j]) >= HARD_TO_TELL
    }
    assert {(p.second, p.first) for p in d.partners} == expected
    six = orient(ideal_pair("6/3"), PAPER, BAARDA)
    assert all(abs(p.correlation) >= HARD_TO_TELL for p in diagnose(six).partners)
    assert diagnose(six).partners


@pytest.mark.parametrize("point", ["1", "6"])  # before and after its partners
def test_what_is_hard_to_tell_from_the_accused_is_said(point):
    model = orient(spoiled(ideal_pair("6/3"), point, "y", 0.3), PAPER, BAARDA)
    d = diagnose(model)
    accused = d.suspects[0]
    others = [(({p.first, p.second} - {accused}), p.correlation) for p in d.partners]
    others = [(next(iter(keys)), rho) for keys, rho in others if len(keys) == 1]
    assert 0 < len(others) < len(d.partners)
    assert [said for said in d.advice if "hard to tell" in said] == [
        f"{' '.join(accused)} and {' '.join(other)} are hard to tell apart (correlation {rho:.2f})"
        for other, rho in others
    ]


def test_nothing_flagged():
    first, model = models()[:2]
    d = diagnose(model)
    assert not model.flagged
    free = len(model.points) - len(model.ties)
    assert d.advice == (
        f"nothing is flagged; x of {free} points is checked by the next model only",
    )
    assert f"; x of {len(first.points)} points is " in diagnose(first).advice[-1]
    assert d.suspects == ()
    assert sum(row.probability for row in model.table) + model.tested.odds.none == pytest.approx(
        1.0
    )


@pytest.mark.parametrize("test", [TAU, BAARDA])
def test_a_wrong_y_is_named_with_its_odds_over_the_next_point(test):
    f = fly(8, 3, tilt=3.0, kappa=10.0, noise=0.004)
    first = bridge_flight(f)[0]
    model = orient(spoiled(pair_of(f, 1, first), "2c", "y", 0.08), PAPER, test)
    d = diagnose(model)
    assert d.suspects[0] == ("2c", "y")
    assert d.advice[0].startswith("remeasure 2c (y): ")
    assert " to 1 over " in d.advice[0]
    odds = model.tested.point_odds()
    assert max(odds, key=odds.__getitem__) == "2c"
    rival = d.advice[0].split(" over ")[1].split(",")[0]
    assert odds[rival] == max(p for name, p in odds.items() if name != "2c")
    assert sum(odds.values()) + model.tested.odds.none == pytest.approx(1.0)


@pytest.mark.parametrize("kind", ["propagated", "exact"])
def test_the_chances_are_those_of_the_advice(kind):
    f = fly(8, 3, tilt=3.0, kappa=10.0, noise=0.004)
    precision = replace(PROPAGATED, tie_variance=kind)
    first = bridge_flight(f, precision, BAARDA)[0]
    model = orient(spoiled(pair_of(f, 1, first), "2c", "y", 0.04), precision, BAARDA)
    d = diagnose(model)
    assert sum(d.chances) + d.none == pytest.approx(1.0)
    keys = [row.key for row in model.table]
    assert keys[int(np.argmax(d.chances))] == d.suspects[0] == ("2c", "y")
    in_table = (*(row.probability for row in model.table), model.tested.odds.none)
    same = np.allclose((*d.chances, d.none), in_table, rtol=1e-9, atol=1e-12)
    assert same == (kind == "propagated")


@pytest.mark.parametrize("kind", ["propagated", "exact"])
def test_odds_for_programs_are_those_of_which_the_advice_speaks(kind):
    """Of correlated ties no single row says what its error would do to all of them."""
    f = fly(7, 3, tilt=3.0, kappa=10.0, noise=0.004)
    precision = replace(PROPAGATED, tie_variance=kind)
    first = bridge_flight(f, precision, BAARDA)[0]
    pair = pair_of(f, 1, first)
    told = []
    for point in pair.points[:4]:
        model = orient(spoiled(pair, point, "y", 0.05), precision, BAARDA)
        d = diagnose(model)
        answer = model_document(model, strip="s", number=2, count=2).answer
        odds = json.loads(json_text(answer))["odds"]
        assert odds["none"] == d.none
        rows = odds["rows"]
        assert tuple(row["probability"] for row in rows) == d.chances
        best = max(rows, key=lambda row: row["probability"])
        assert (best["point"], best["axis"]) == d.suspects[0]
        in_table = [row.probability for row in model.table]
        told.append(np.abs(np.subtract(d.chances, in_table)).max())
    assert (max(told) < 1e-9) == (kind == "propagated")


def test_a_wrong_x_at_a_tie_has_two_suspects():
    f = fly(8, 3, tilt=3.0, kappa=10.0, noise=0.002)
    first = bridge_flight(f)[0]
    model = orient(spoiled(pair_of(f, 1, first), "1c", "x", 0.3), PAPER, BAARDA)
    d = diagnose(model)
    assert d.suspects[0] == ("1c", "x")
    assert d.advice[0].startswith("remeasure 1c (x)")
    assert "this pointing" in d.advice[1]
    assert "preceding model" in d.advice[1]


def test_odds_of_a_point_are_the_sum_over_its_rows():
    tested = models()[1].tested
    odds = tested.point_odds()
    tie = next(row.point for row in tested if row.axis == "x")
    assert odds[tie] == pytest.approx(sum(row.probability for row in tested if row.point == tie))
    assert len([row for row in tested if row.point == tie]) == 2


def test_suspects_are_the_flagged_rows_the_most_probable_first():
    model = orient(spoiled(ideal_pair("13/5"), "4", "y", 0.3), PAPER, BAARDA)
    d = diagnose(model)
    chance = {(row.point, row.axis): row.probability for row in model.table}
    assert {row.key for row in model.flagged} == set(d.suspects)
    assert [chance[key] for key in d.suspects] == sorted(
        (chance[key] for key in d.suspects), reverse=True
    )
    assert d.suspects[0] == ("4", "y")


def test_suspects_of_uncorrelated_rows_go_by_the_odds_of_their_points_whatever_their_size():
    otherwise = 0
    for name in ("6/3", "9/3", "13/5"):
        pair = ideal_pair(name)
        for point in pair.points:
            model = orient(spoiled(pair, point, "y", 0.3), PAPER, BAARDA)
            d, odds = diagnose(model), model.tested.point_odds()
            # to nine digits: rounding decides nothing
            chances = [rounded(odds[key[0]]) for key in d.suspects]
            assert chances == sorted(chances, reverse=True)
            size = {row.key: row.size for row in model.table}
            sizes = [size[key] for key in d.suspects]
            otherwise += sizes != sorted(sizes, reverse=True)
    assert otherwise > 0


def test_the_odds_in_words_are_those_of_the_table_however_large_the_error():
    model = orient(spoiled(ideal_pair("6/3"), "6", "y", 2.0), PAPER, BAARDA)
    assert max(row.size or 0.0 for row in model.table) > 20.0  # beyond the width of the prior
    d = diagnose(model)
    point, axis = d.suspects[0]
    rival = d.advice[0].split(" over ")[1].split(",")[0]
    words = odds_in_words(model.tested.point_odds(), point, rival)
    assert d.advice[0] == remeasure(point, axis, words)


@pytest.mark.parametrize("number", [0, 1])
def test_a_point_that_pulls_the_orientation_far_away_is_named(number):
    f = fly(0, 3, noise=0.005, kappa=5.0)
    first = orient(pair_of(f, 0), PAPER, BAARDA)
    pair = pair_of(f, 1, first) if number else pair_of(f, 0)
    clean, point = orient(pair, PAPER, BAARDA), pair.points[0]
    near, away = (orient(spoiled(pair, point, "y", size), PAPER, BAARDA) for size in (3.0, 40.0))
    assert (clean.outliers, near.outliers, away.outliers) == ((), (), (point,))
    moved = [np.linalg.norm(np.subtract(m.base, clean.base)[1:] / m.base[0]) for m in (near, away)]
    assert moved[0] < 0.05 < 0.15 < moved[1]
    assert diagnose(away).advice[0].startswith(f"remeasure {point} (")
    assert diagnose(away).advice[0].endswith(": without it all other points agree")


def test_errors_that_hide_behind_an_estimated_sigma_are_not_called_good():
    pair = ideal_pair("13/5")
    for point, axis, size in (("4", "y", 3.0), ("6", "y", -2.0), ("2", "x", 3.0), ("8", "y", 2.5)):
        pair = spoiled(pair, point, axis, size)
    model = orient(pair, PAPER, TAU)
    assert not model.flagged
    assert "times its a-priori value" in model.unexplained
    found = diagnose(model)
    # each of them, the largest in its own sigmas first
    assert found.suspects == (("2", "x"), ("4", "y"), ("8", "y"), ("6", "y"))
    assert found.advice[0] == (
        "remeasure 2 (x): without 2 x, 4 y, 8 y and 6 y all other rows agree"
    )
    assert orient(ideal_pair("13/5"), PAPER, TAU).unexplained == ""


@pytest.mark.parametrize("test", [TAU, BAARDA])
@pytest.mark.parametrize("count", [2, pytest.param(3, marks=pytest.mark.slow)])
def test_of_several_large_errors_one_is_to_be_measured_again(test, count):
    """Odds of a single error name a good row that they bend, or sigma0 hides them all."""
    rng = np.random.default_rng(7)
    single = 0
    for _ in range(25):
        pair = ideal_pair("13/5", 92.0, 100.0, 152.0)
        pair = replace(pair, xr=pair.xr + rng.normal(0.0, 0.005, pair.xr.shape))
        wrong = [pair.points[k] for k in rng.choice(len(pair.points), count, replace=False)]
        for point in wrong:
            pair = spoiled(pair, point, "y", rng.choice([-1.0, 1.0]) * rng.uniform(0.2, 2.0))
        model = orient(pair, PAPER, test)
        found = diagnose(model)
        assert found.suspects[0][0] in wrong
        assert set(wrong) <= {point for point, _ in found.suspects[:count]}
        best = int(np.argmax(model.tested.odds.rows))
        single += bool(model.flagged) and model.tested.keys[best][0] in wrong
    if test is TAU:
        assert single < 20  # the odds of a single error say so less often


@pytest.mark.parametrize("factor", [4.0, 6.0, 10.0])
def test_noise_larger_than_stated_accuses_no_row(factor):
    rng = np.random.default_rng(11)
    asked = 0
    for _ in range(25):
        pair = ideal_pair("13", 92.0, 100.0, 152.0)
        noise = factor * 0.005 * rng.standard_normal(pair.xr.shape)
        model = orient(replace(pair, xr=pair.xr + noise), PAPER, TAU)
        if model.unexplained:
            asked += 1
            found = diagnose(model)
            assert found.suspects == ()
            assert found.advice[-1].endswith("and the test does not tell which")
    assert asked > 5


def test_with_one_redundancy_rounding_does_not_say_what_is_advised():
    f = fly(12, noise=0.005, relief=0.1, tilt=10.0, kappa=60.0)
    x, y = f.images[2]["1a"]
    f.images[2]["1a"] = (x, y + 0.06)
    exact = replace(PROPAGATED, tie_variance="exact")
    points = ["1a", "1c", "2a", "2b", "2c"]
    said = set()
    for seed in range(4):
        rng = np.random.default_rng(seed)
        images = [
            {p: tuple(np.multiply(xy, 1.0 + 1e-15 * rng.integers(-2, 3, 2) * (seed > 0)).tolist())
             for p, xy in image.items()}
            for image in f.images
        ]  # fmt: skip
        measured = replace(f, images=images)
        first = orient(pair_of(measured, 0), exact, BAARDA)
        model = orient(pair_of(measured, 1, first, points=points), exact, BAARDA)
        assert model.redundancy == 1
        said.add(diagnose(model).advice)
    assert len(said) == 1
