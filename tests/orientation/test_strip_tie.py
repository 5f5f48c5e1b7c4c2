"""Two strips by their common points: against a dense adjustment, and against chance."""

from math import sqrt

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.stats import chi2
from syntheticblocks import synthetic_block

from anaplot.errors import NotComputableError
from anaplot.orientation.model import orient
from anaplot.orientation.strip import stereopair
from anaplot.orientation.stripgeometry import Located, extended, widened
from anaplot.orientation.striptie import LEVEL_DEG, Placed, tie_systems
from anaplot.photogrammetry.block import TestSettings
from anaplot.photogrammetry.rotation import rotation_matrix

SIGMA0 = 0.005  # mm
BAARDA = TestSettings("baarda", 0.001)
SEEDS = range(12)
LATERAL = ("101-1", "101-7'", "102-1", "102-7'", "103-1'", "103-7", "104-1", "104-7")


def measured_strip(flown, s, rng):
    """Measure and bridge a strip: what lies under its photos, and the lateral ties."""
    before, solution = None, None
    for left, right in flown.block.strips[s].models():
        one, two = flown.truth[left], flown.truth[right]
        names = [p for p in one if p in two and (p in LATERAL or p[:3] in (left, right))]
        e = rng.normal(0.0, SIGMA0, (len(names), 4)).tolist()
        pair = stereopair(
            (left, right),
            {p: (one[p][0] + d[0], one[p][1] + d[1]) for p, d in zip(names, e, strict=True)},
            {p: (two[p][0] + d[2], two[p][1] + d[3]) for p, d in zip(names, e, strict=True)},
            (flown.block.cameras[0],) * 2,
            preceding=solution,
            base=92.0,
        )
        solution = orient(pair, flown.block.precision, BAARDA)
        before = extended(before, pair, solution)
    return before


@pytest.fixture(scope="module")
def flights():
    out = []
    for seed in SEEDS:
        flown = synthetic_block(seed=seed)
        rng = np.random.default_rng([seed, 9])
        out.append([measured_strip(flown, s, rng) for s in (0, 1)])
    return out


def shifted(system, **moves):
    """Return a system in which points are somewhere else."""
    points = dict(system.points)
    for name, by in moves.items():
        points[name] = Located(points[name].xyz + by, points[name].errors)
    return Placed(points, system.count)


def by_hand(this, other, names):
    """Adjust densely: parameters, v'Pv, Q_vv P, and P v over its deviation."""
    at = np.concatenate([this.points[p].xyz for p in names])
    source = np.array([other.points[p].xyz for p in names])

    def moved(x, points=source):
        return np.exp(x[6]) * points @ rotation_matrix(*x[3:6]).T + x[:3]

    def start():
        a, b = source[:, :2] @ [1, 1j], at.reshape(-1, 3)[:, :2] @ [1, 1j]
        f = np.vdot(a - a.mean(), b - b.mean()) / np.vdot(a - a.mean(), a - a.mean())
        shift = b.mean() - f * a.mean()
        z = (at.reshape(-1, 3)[:, 2] - abs(f) * source[:, 2]).mean()
        return np.array([shift.real, shift.imag, z, 0, 0, np.angle(f), np.log(abs(f))])

    x = start()
    for _ in range(3):  # the covariance follows the similarity
        turn = np.exp(x[6]) * rotation_matrix(*x[3:6])
        cov = np.zeros((len(at), len(at)))
        for system, factor in ((this, np.eye(3)), (other, turn)):
            e = np.concatenate(
                [factor @ widened(system.points[p].errors, system.count) for p in names]
            )
            cov += e @ e.T
        cov *= SIGMA0**2
        root = np.linalg.cholesky(cov)

        def white(x, root=root):
            return np.linalg.solve(root, moved(x).ravel() - at)

        x = least_squares(white, x, x_scale="jac", xtol=1e-14, ftol=1e-14, gtol=1e-14).x
    design = np.empty((len(at), 7))
    for k, step in enumerate([1e-3] * 3 + [1e-6] * 4):
        d = step * np.eye(7)[k]
        design[:, k] = (moved(x + d) - moved(x - d)).ravel() / (2 * step)
    p = np.linalg.inv(cov)
    q_vv = cov - design @ np.linalg.inv(design.T @ p @ design) @ design.T
    v = moved(x).ravel() - at
    w = (p @ v) / np.sqrt(np.diag(p @ q_vv @ p))
    return v, float(v @ p @ v), np.diag(q_vv @ p), w


def test_the_table_is_that_of_a_dense_adjustment_and_r_sums_to_the_redundancy(flights):
    other, this = flights[0]
    tie = tie_systems(this, other, SIGMA0, BAARDA)
    names = [p.point for p in tie.points]
    assert len(names) >= 6
    assert not tie.level
    v, vtpv, r, w = by_hand(this, other, names)
    assert tie.redundancy == 3 * len(names) - 7
    assert sum(sum(p.r) for p in tie.points) == pytest.approx(tie.redundancy)
    assert np.concatenate([p.difference for p in tie.points]) == pytest.approx(v, abs=1e-5)
    assert np.concatenate([p.r for p in tie.points]) == pytest.approx(r, abs=1e-5)
    assert np.concatenate([p.w for p in tie.points]) == pytest.approx(w, abs=2e-3)
    assert tie.sigma0 == pytest.approx(sqrt(vtpv / tie.redundancy), rel=1e-4)


def test_discrepancies_have_the_variance_that_is_expected_of_them(flights):
    ties = [tie_systems(this, other, SIGMA0, BAARDA) for other, this in flights]
    f = sum(tie.redundancy for tie in ties)
    vtpv = sum(tie.redundancy * tie.sigma0**2 for tie in ties)
    # two-sided, significance .001
    assert chi2.ppf(0.0005, f) < vtpv < chi2.ppf(0.9995, f)


def test_predictions_lie_within_their_standard_deviations(flights):
    total, count = 0.0, 0
    for other, this in flights:
        common = [p for p in this.points if p in other.points]
        held = common[1::3][:2]
        tie = tie_systems(this, other, SIGMA0, BAARDA, without=held)
        found = [_prediction_error(tie, this, p) for p in held]
        d, e = (np.concatenate(part) for part in zip(*found, strict=True))
        total += float(d @ np.linalg.solve(SIGMA0**2 * e @ e.T, d))
        count += len(d)
    assert chi2.ppf(0.0005, count) < total < chi2.ppf(0.9995, count)


def _prediction_error(tie, this, point):
    """Return a prediction's difference [mm], and its errors."""
    placed = tie.placed([point])[point]
    errors = placed.errors.copy()
    own = this.points[point].errors
    errors[:, : own.shape[1]] -= own
    return tie.improved(placed.xyz - this.points[point].xyz, errors)


def test_the_most_probable_errors_explain_every_discrepancy(flights):
    for other, this in flights[:3]:
        tie = tie_systems(this, other, SIGMA0, BAARDA)
        names = [p.point for p in tie.points]
        for name, xyz, by in zip(names, *tie.probably_placed(names), strict=True):
            own = this.points[name]
            off = (own.errors @ tie.probable[: own.errors.shape[1]])[:, None]
            np.testing.assert_allclose(xyz - by, own.xyz - off[:, 0], rtol=0.0, atol=1e-6)
            # the same as by all errors, each written out
            whole = tie.placed([name])[name]
            values, _ = tie.improved(whole.xyz, whole.errors)
            np.testing.assert_allclose(xyz, whole.xyz, rtol=1e-14)
            np.testing.assert_allclose(xyz - by, values, rtol=1e-12)


def test_every_common_point_makes_predictions_better(flights):
    other, this = flights[1]
    common = [p for p in this.points if p in other.points]
    point = common[2]
    used = [p for p in common if p != point]
    sizes = []
    for k in (2, 3, 4, len(used)):
        tie = tie_systems(this, other, SIGMA0, BAARDA, without=[point, *used[k:]])
        sizes.append(float((_prediction_error(tie, this, point)[1] ** 2).sum()))
    assert sizes == sorted(sizes, reverse=True)


def test_a_wrong_point_is_flagged_and_named(flights):
    for other, this in flights:
        common = [p for p in this.points if p in other.points]
        for point in common[::3]:
            spoilt = shifted(this, **{point: np.array([0.5, -0.4, 0.3])})
            tie = tie_systems(spoilt, other, SIGMA0, BAARDA)
            assert tie.checkable
            assert tie.suspects == (point,)


def test_two_points_need_level_strips_and_check_nothing(flights):
    other, this = flights[2]
    common = [p for p in this.points if p in other.points]
    ends = [common[0], common[-1]]
    tie = tie_systems(this, other, SIGMA0, BAARDA, without=set(common) - set(ends))
    assert tie.level
    assert tie.redundancy == 1
    assert not tie.checkable
    # the inclination is as uncertain as was said, and everything near the line is known
    turned = tie.placed()[common[0]].errors
    assert np.sqrt((turned**2).sum(axis=1))[:2].max() * SIGMA0 < 1.0
    assert LEVEL_DEG == 3.0
    with pytest.raises(NotComputableError, match="1 common points, 2 are needed"):
        tie_systems(this, other, SIGMA0, BAARDA, without=set(common) - {common[0]})


def test_points_that_are_far_off_take_no_part_and_are_named(flights):
    other, this = flights[0]
    common = [p for p in this.points if p in other.points]
    one, two = common[1], common[-2]
    # interchanged: each where the other one is
    gap = this.points[two].xyz - this.points[one].xyz
    tie = tie_systems(shifted(this, **{one: gap, two: -gap}), other, SIGMA0, BAARDA)
    assert set(tie.gross) == {one, two}
    assert tie.surely_wrong is None
    assert {p.point for p in tie.points if p.flagged} == {one, two}
    off = {p.point: np.array(p.difference) for p in tie.points if p.r is None}
    assert off[one] == pytest.approx(-gap, abs=0.1)
    assert off[two] == pytest.approx(gap, abs=0.1)


def test_all_that_are_off_take_no_part_while_more_than_half_agree():
    for seed in range(20):
        rng = np.random.default_rng(seed)
        names = [f"p{k}" for k in range(41)]
        source = {p: rng.uniform([0, 0, -160], [900, 200, -140]) for p in names}
        turn = rotation_matrix(0.0, 0.0, rng.uniform(-3.0, 3.0))
        wrong = set(rng.permutation(names)[:19].tolist())
        target = {p: 1.1 * turn @ at + rng.normal(0.0, SIGMA0, 3) for p, at in source.items()}
        for p in wrong:
            away = rng.uniform(100.0, 400.0)
            angle = rng.uniform(0.0, 2.0 * np.pi)
            target[p] += away * np.array([np.cos(angle), np.sin(angle), 0.0])
        free = np.zeros((3, 3 * len(names)))
        this, other = (
            Placed(
                {
                    p: Located(at, free + np.eye(3, free.shape[1], 3 * k))
                    for k, (p, at) in enumerate(points.items())
                },
                free.shape[1],
            )
            for points in (target, source)
        )
        tie = tie_systems(this, other, SIGMA0, BAARDA)
        assert set(tie.gross) == wrong
        np.testing.assert_allclose(tie.similarity.scale, 1.1, rtol=1e-4)
        np.testing.assert_allclose(tie.similarity.rotation, turn, atol=1e-4)
