"""Tested observations: any adjustment's rows, and those of plate, model and block, by hand."""

from dataclasses import replace
from math import sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import integrate, stats

from anaplot.adjustment.leastsquares import adjust
from anaplot.adjustment.significance import critical_normal, critical_tau, tau_power
from anaplot.adjustment.tested import (
    AppliedTest,
    Dense,
    error_odds,
    examine,
    sigma0_known,
)
from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.solve.residuals import block_residuals
from anaplot.orientation.model import orient
from anaplot.orientation.strip import stereopair
from anaplot.photogrammetry.block import Precision, TestSettings
from anaplot.photogrammetry.camera import CameraCalibration, Fiducial
from anaplot.photogrammetry.inner import orient_inner
from anaplot.photogrammetry.rotation import rotation_matrix
from anaplot.planning.blockplan import BlockPlan, plan_block
from anaplot.planning.synthetic import synthetic_strip

APRIORI = 0.7
KINDS = ("tau", "baarda")
seeds = st.integers(0, 2**32 - 1)


def scene(seed=1, n=12, u=5):
    """A design, misclosures and cofactors."""
    rng = np.random.default_rng(seed)
    return rng.normal(size=(n, u)), rng.normal(size=n), rng.uniform(0.5, 2.0, n)


def examined(design, misclosure, q, kind="baarda", alpha=0.001, apriori=APRIORI, **also):
    """The adjustment, and its tested rows."""
    a = adjust(design, misclosure, q, unknowns=[f"g{k}" for k in range(design.shape[1])])
    return a, examine(
        [(str(k), "y") for k in range(len(q))],
        ["um"] * len(q),
        a.w,
        a.r,
        apriori * np.sqrt(q),
        vtpv=a.vtpv / apriori**2,
        redundancy=a.redundancy,
        test=AppliedTest(kind, alpha, None),
        dense=lambda: Dense(a.q_vv, a.influence),
        **also,
    )


@given(seeds, st.integers(6, 20), st.sampled_from(KINDS))
def test_redundancy_numbers_sum_to_the_redundancy(seed, n, kind) -> None:
    _, tested = examined(*scene(seed, n), kind)
    assert sum(row.r for row in tested) == pytest.approx(tested.redundancy, abs=1e-9)
    assert len(list(tested)) == len(tested) == n


@given(seeds, st.integers(0, 11), st.floats(-50.0, 50.0))
def test_a_planted_error_changes_its_residual_by_r_times_itself(seed, k, error) -> None:
    design, misclosure, q = scene(seed)
    _, before = examined(design, misclosure, q)
    spoilt = misclosure.copy()
    spoilt[k] += error
    _, after = examined(design, spoilt, q)
    change = after.residual - before.residual
    assert change[k] == pytest.approx(before.r[k] * error, abs=1e-9 * max(1.0, abs(error)))
    assert change == pytest.approx(before.influence[:, k] * error, abs=1e-9 * max(1.0, abs(error)))


@pytest.mark.parametrize("kind", KINDS)
def test_flags_are_what_exceeds_the_critical_value(kind) -> None:
    design, misclosure, q = scene()
    critical = critical_normal(0.05) if kind == "baarda" else critical_tau(0.05, 7)
    seen = set()
    for k in range(12):
        spoilt = misclosure.copy()
        spoilt[k] += 8.0
        a, tested = examined(design, spoilt, q, kind, alpha=0.05)
        sigma = APRIORI if sigma0_known(kind) else sqrt(a.vtpv / 7)
        w = a.w / (sigma * np.sqrt(np.diag(a.q_vv)))
        assert tested.test.critical == pytest.approx(critical)
        assert tested.w == pytest.approx(w)
        assert tested.expected == pytest.approx(sigma * np.sqrt(np.diag(a.q_vv)))
        assert tested.flagged.tolist() == (np.abs(w) > critical).tolist()
        worst = [int(row.key[0]) for row in tested.worst]
        assert worst == sorted(np.flatnonzero(tested.flagged), key=lambda i: -abs(w[i]))
        seen.update(tested.flagged.tolist())
    assert seen == {False, True}


def test_tau_never_exceeds_the_root_of_the_redundancy() -> None:
    for seed in range(20):
        assert np.abs(examined(*scene(seed), "tau")[1].w).max() <= sqrt(7) * (1.0 + 1e-12)


def test_rounding_is_never_flagged() -> None:
    design, misclosure, q = scene()
    _, tested = examined(design, 100.0 * misclosure, q)
    assert tested.flagged.any()
    largest = float(np.abs(tested.residual).max())
    assert not examined(design, 100.0 * misclosure, q, rounding=largest)[1].flagged.any()


def test_without_redundancy() -> None:
    for kind in KINDS:
        _, tested = examined(*scene(n=5), kind)
        assert tested.test.critical is tested.sigma0 is tested.power is None
        assert all(row.w is row.mdb is row.effect is None and not row.flagged for row in tested)
        assert all((row.expected is None) == (kind == "tau") for row in tested)
        assert tested.odds.none == pytest.approx(0.9)
        assert tested.odds.rows == pytest.approx(np.full(5, 0.02))


def test_residuals_of_nothing_are_not_divided_by_nothing() -> None:
    design, _, q = scene()
    _, tested = examined(design, np.zeros(12), q, "tau")
    assert tested.sigma0 == pytest.approx(0.0, abs=1e-12)
    exact = examine(
        tested.keys, tested.units, np.zeros(12), tested.r, APRIORI * np.sqrt(q),
        vtpv=0.0, redundancy=7, test=tested.test,
    )  # fmt: skip
    assert [row.expected for row in exact] == [0.0] * 12
    assert all(row.w is None and not row.flagged for row in exact)


def test_a_row_without_redundancy_is_not_testable() -> None:
    B = np.zeros((7, 2))
    B[0, 0] = 1.0  # the only row that knows g0
    B[1:, 1] = 1.0
    _, tested = examined(B, np.arange(7.0), np.ones(7), apriori=1.0)
    blind, *others = tested
    assert blind.w is blind.mdb is blind.effect is None
    assert not blind.flagged
    for row in others:
        assert row.mdb == pytest.approx(4.132 / np.sqrt(5 / 6), rel=1e-4)
        assert row.effect == pytest.approx(4.132 * np.sqrt(1 / 5), rel=1e-4)
    assert np.isnan(tested.correlations()[0]).all()
    assert tested.correlations()[1, 2] == pytest.approx(-1.0 / 5.0)
    assert all(blind.key != transfer.source for transfer in tested.transfers())
    assert blind.probability / tested.odds.none == pytest.approx(0.1 / 7 / 0.9)  # its prior


@pytest.mark.parametrize("kind", KINDS)
def test_the_smallest_detectable_error_moves_w_by_delta0_and_no_function_beyond_its_effect(
    kind,
) -> None:
    rng = np.random.default_rng(2)
    design, _, q = scene(2)
    a, tested = examined(design, np.zeros(12), q, kind)
    for row in tested:
        planted = np.zeros(12)
        planted[int(row.key[0])] = row.mdb
        moved, wrong = examined(design, planted, q)
        assert wrong.w[int(row.key[0])] == pytest.approx(4.132, abs=5e-4)
        for _ in range(20):
            h = rng.normal(size=5)
            bound = row.effect * APRIORI * np.sqrt(h @ a.q_xx @ h)
            assert abs(h @ moved.x) <= bound * (1.0 + 1e-9)
        # the bound is reached along Q_xx^-1 dx
        h = np.linalg.solve(a.q_xx, moved.x)
        bound = row.effect * APRIORI * np.sqrt(h @ a.q_xx @ h)
        assert abs(h @ moved.x) == pytest.approx(bound, rel=1e-8)


def test_the_power_of_tau_is_less_than_was_asked() -> None:
    tau, baarda = (AppliedTest(kind, 0.001, None) for kind in KINDS)
    assert baarda.real_power(6) == 0.80
    assert tau.real_power(6) == tau_power(tau.delta0, 0.001, 6) < 0.80
    assert baarda.real_power(0) is tau.real_power(1) is None


def test_partners_and_transfers_are_named_by_their_keys() -> None:
    # two rows that only check each other
    B = np.zeros((8, 3))
    B[:6, :2] = np.random.default_rng(4).normal(size=(6, 2))
    B[6:, 2] = 1.0
    _, tested = examined(B, np.zeros(8), np.ones(8))
    (partner,) = [p for p in tested.partners() if ("6", "y") in p]
    assert partner[:2] == (("6", "y"), ("7", "y"))
    assert partner.correlation == pytest.approx(-1.0)
    both = {(t.source[0], t.target[0]): t.value for t in tested.transfers()}
    assert both["6", "7"] == both["7", "6"] == pytest.approx(-0.5)


def test_without_matrices_the_questions_that_need_them_are_refused() -> None:
    _, tested = examined(*scene())
    bare = examine(
        tested.keys, tested.units, tested.residual, tested.r, np.ones(12),
        vtpv=1.0, redundancy=7, test=tested.test,
    )  # fmt: skip
    for ask in (bare.partners, bare.transfers, bare.correlations):
        with pytest.raises(ValueError, match="not kept"):
            ask()


def test_odds_of_a_point_are_the_sum_over_its_rows() -> None:
    design, misclosure, q = scene()
    a, _ = examined(design, misclosure, q)
    keys = [(str(k // 2), "xy"[k % 2]) for k in range(12)]
    tested = examine(
        keys, ["um"] * 12, a.w, a.r, APRIORI * np.sqrt(q),
        vtpv=a.vtpv / APRIORI**2, redundancy=7, test=AppliedTest("tau", 0.001, None),
    )  # fmt: skip
    odds = tested.point_odds()
    assert sum(odds.values()) + tested.odds.none == pytest.approx(1.0)
    for point, chance in odds.items():
        assert chance == pytest.approx(sum(r.probability for r in tested if r.point == point))


def same_as_dense(tested, design, misclosure, sigma, *, sign, atol, rel=1e-6) -> None:
    """Compare with the projection of the whitened design; residual = sign R misclosure."""
    n = len(design)
    left = np.linalg.qr(design[:, design.any(axis=0)] / sigma[:, None])[0]
    projection = np.eye(n) - left @ left.T
    white = projection @ (misclosure / sigma)
    f = n - left.shape[1]
    r = np.diag(projection)
    assert tested.redundancy == f
    assert tested.r == pytest.approx(r, abs=atol)
    assert tested.residual == pytest.approx(sign * white * sigma, abs=atol * sigma.max())
    sigma0 = float(np.linalg.norm(white)) / sqrt(f)
    assert tested.sigma0 == pytest.approx(sigma0, rel=rel)
    used = 1.0 if sigma0_known(tested.test.kind) else sigma0
    for k, row in enumerate(tested):
        assert row.expected == pytest.approx(used * sigma[k] * sqrt(max(r[k], 0.0)), abs=atol)
        if r[k] > 1e-3:
            assert row.w == pytest.approx(row.residual / row.expected)
            assert row.mdb == pytest.approx(tested.test.delta0 * sigma[k] / sqrt(r[k]), rel=1e-4)
            effect = tested.test.delta0 * sqrt((1.0 - r[k]) / r[k])
            assert row.effect == pytest.approx(effect, rel=1e-3, abs=1e-3)
            assert row.flagged == (abs(row.w) > tested.test.critical)


@pytest.mark.parametrize("kind", KINDS)
def test_an_inner_orientation_is_a_dense_affine_fit(kind) -> None:
    places = [(-106, 106), (106, 106), (106, -106), (-106, -106)]
    places += [(-113, 0), (0, 113), (113, 0), (0, -113)]
    marks = {str(k): (float(x), float(y)) for k, (x, y) in enumerate(places)}
    fiducials = tuple(Fiducial(name, x, y) for name, (x, y) in marks.items())
    camera = CameraCalibration("rmk", 152.4, fiducials=fiducials)
    rng = np.random.default_rng(6)
    measured = {
        name: (x + 3.0 + 0.005 * rng.normal(), y - 2.0 + 0.005 * rng.normal())
        for name, (x, y) in marks.items()
    }
    found = orient_inner(
        camera, measured, transformation="affine", test=TestSettings(kind, alpha=0.05)
    )
    place = np.array(list(marks.values()))
    design = np.kron(np.column_stack((np.ones(8), place / 100.0)), np.eye(2))
    away = (np.array(list(measured.values())) - place).ravel() * 1e3
    # linearised at the certificate, not at the adjusted plate: they differ by 1e-4
    same_as_dense(found.tested, design, away, np.full(16, 5.0), sign=-1.0, atol=2e-3, rel=1e-4)
    assert [row.key for row in found.tested] == [(n, a) for n in marks for a in "xy"]


@pytest.mark.parametrize("kind", KINDS)
def test_a_model_is_a_dense_adjustment_of_its_parallaxes(kind) -> None:
    strip = synthetic_strip(2, seed=3)
    first, second = strip.block.strips[0].photos
    rng = np.random.default_rng(5)
    names = sorted(set(strip.truth[first]) & set(strip.truth[second]))
    left, right = (
        {name: np.array(strip.truth[photo][name]) + 0.005 * rng.normal(size=2) for name in names}
        for photo in (first, second)
    )
    camera = strip.block.cameras[0]
    pair = stereopair((first, second), left, right, (camera, camera), preceding=None, base=92.0)
    precision = Precision(5.0, "paper")
    model = orient(pair, precision, TestSettings(kind, alpha=0.05))
    c = camera.c

    def parallaxes(change):
        by, bz, kappa, phi, omega = change
        base = np.array(model.base) + np.array((0.0, by, bz)) * model.base[0]
        turned = rotation_matrix(*(np.array(model.rotation) + np.array((omega, phi, kappa))))
        out = []
        for name in names:
            x1, x2 = np.array((*left[name], -c)), turned @ np.array((*right[name], -c))
            out.append(np.cross(base / base[0], x1) @ x2 / c)
        return np.array(out) * 1e3

    step = 1e-5
    design = np.column_stack(
        [(parallaxes(step * e) - parallaxes(-step * e)) / (2.0 * step) for e in np.eye(5)]
    )
    sigma = np.full(len(names), precision.image_um * sqrt(2.0))
    same_as_dense(
        model.tested, design, parallaxes(np.zeros(5)), sigma, sign=1.0, atol=2e-3, rel=1e-4
    )
    assert [row.key for row in model.tested] == [(name, "y") for name in names]


@pytest.mark.parametrize("kind", KINDS)
def test_a_block_is_a_dense_adjustment_of_its_whitened_design(kind) -> None:
    ideal = plan_block(BlockPlan(strips=2, photos=3))
    rng = np.random.default_rng(9)
    shaken = replace(
        ideal.block,
        test=TestSettings(kind, alpha=0.05),
        image_points=tuple(
            replace(row, x=row.x + 0.004 * rng.normal(), y=row.y + 0.004 * rng.normal())
            for row in ideal.block.image_points
        ),
    )
    block = adjust_block(shaken)
    tested = block.tested
    system = block_residuals(block.problem, block.state, block.cofactors.normal.structure)
    sigma = system.rows.sigma
    design = system.design().toarray() * sigma[:, None]
    same_as_dense(tested, design, system.e * sigma, sigma, sign=-1.0, atol=1e-4)
    assert tuple(tested.keys) == tuple(row.key for row in tested) == tuple(system.names)
    by_ray = {(row.photo, row.point, row.model): row.xy for row in block.ray_rows()}
    for row in tested:
        if row.key[0] == "image":
            assert row in by_ray[row.key[1:4]]


def brute_factor_known(w, g):
    """Integral of the likelihood of w over the error's prior, divided by that without error."""
    width = np.sqrt(g)
    value, _ = integrate.quad(
        lambda d: stats.norm.pdf(w, loc=d) * stats.norm.pdf(d, scale=width),
        -60.0,
        60.0,
        points=[0.0, w],
        limit=400,
        epsabs=0.0,
        epsrel=1e-10,
    )
    return value / stats.norm.pdf(w)


@pytest.mark.parametrize(("w", "r"), [(0.0, 0.1), (1.5, 0.02), (3.5, 0.08), (5.0, 0.1)])
def test_odds_with_known_sigma_against_integration_of_the_prior(w, r):
    odds = error_odds(400.0 * np.array([r, 0.0]), np.array([w, np.nan]), 3, "baarda")
    factor = brute_factor_known(w, 400.0 * r)
    assert odds.rows[0] / odds.none == pytest.approx(factor * 0.05 / 0.9, rel=1e-6)


@pytest.mark.parametrize(("w", "r", "f"), [(1.0, 0.05, 4), (2.2, 0.3, 8), (3.0, 0.6, 12)])
def test_odds_with_estimated_sigma_against_integration_of_the_prior(w, r, f):
    """Error of 20 sigma in units of the unknown sigma, sigma with the prior 1 / sigma."""
    g = 400.0 * r
    ss, along = float(f), w**2  # v'Pv and its part along the suspected row, sigma0_hat = 1

    def likelihood(with_error):
        def integrand(log_sigma):
            s2 = np.exp(2.0 * log_sigma)
            # given sigma the row's part has variance (1 + g) sigma^2 under an error
            rest = np.exp(-0.5 * (ss - along) / s2) * s2 ** (-0.5 * (f - 1))
            spread = s2 * (1.0 + g) if with_error else s2
            return rest * np.exp(-0.5 * along / spread) / np.sqrt(spread)

        return integrate.quad(integrand, -8.0, 8.0, limit=400, epsabs=0.0, epsrel=1e-10)[0]

    odds = error_odds(400.0 * np.array([r, 0.0]), np.array([w, np.nan]), f, "tau")
    factor = likelihood(True) / likelihood(False)
    assert odds.rows[0] / odds.none == pytest.approx(factor * 0.05 / 0.9, rel=1e-5)


@given(
    st.lists(st.tuples(st.floats(1e-8, 0.999), st.floats(0.0, 60.0)), min_size=1, max_size=30),
    st.integers(1, 40),
    st.sampled_from(["tau", "baarda"]),
)
def test_probabilities_sum_to_one(rows, f, kind):
    r, w = np.array(rows).T
    odds = error_odds(400.0 * r, np.minimum(w, np.sqrt(f)) if kind == "tau" else w, f, kind)
    assert odds.rows.sum() + odds.none == pytest.approx(1.0)
    assert (odds.rows >= 0.0).all()


def test_larger_residual_larger_probability():
    odds = error_odds(np.full(4, 200.0), np.array([0.5, 1.0, 4.0, 3.0]), 6, "baarda")
    assert np.argsort(odds.rows).tolist() == [0, 1, 3, 2]
    assert odds.rows[2] > odds.none


def test_table_2_of_the_paper_obeys_expd_and_w():
    """EXPD = sigma0_hat sqrt(2 r), SIGF = |PARX| / EXPD, from the printed r and parallaxes."""
    r = np.array([0.09, 0.77, 0.07, 0.32, 0.40, 0.23])
    parallax = np.array([6.6, -20.7, 6.6, -2.6, 11.8, -2.0])
    printed = np.array([1.38, 1.44, 1.51, 0.27, 1.14, 0.25])
    sigma = 20.7 / (1.44 * np.sqrt(2.0 * 0.77))
    rows = examine(
        [(str(k), "y") for k in range(6)],
        ["um"] * 6,
        parallax,
        r,
        sigma * np.sqrt(np.full(6, 2.0)),
        vtpv=float(parallax @ parallax / 2.0) / sigma**2,
        redundancy=3,  # 6 + 3 rows, 6 unknowns; the three x parallaxes are not printed
        test=AppliedTest("baarda", 0.001, None),
    )
    # r is printed with two digits: up to half a unit of its last one, 4 percent of sqrt(0.07)
    assert np.abs(rows.w) == pytest.approx(printed, rel=0.045, abs=0.006)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["tau", "baarda"])
def test_odds_are_right_as_often_as_they_say(kind) -> None:
    rng = np.random.default_rng(20)
    n, u, runs = 11, 6, 6000
    design = rng.normal(size=(n, u))
    q_l = np.where(np.arange(n) < 7, 2.0, 1.0)
    white = design / np.sqrt(q_l)[:, None]
    residual = np.eye(n) - white @ np.linalg.inv(white.T @ white) @ white.T
    r = np.diag(residual).copy()
    wrong = rng.integers(n, size=runs)
    wrong[rng.random(runs) < 0.9] = -1
    noise = 3.7 * rng.normal(size=(runs, n))
    noise[wrong >= 0, wrong[wrong >= 0]] += 3.7 * 20.0 * rng.normal(size=int((wrong >= 0).sum()))
    v = noise @ residual
    sigma = 3.7 if kind == "baarda" else np.sqrt((v * v).sum(axis=1, keepdims=True) / (n - u))
    ratio = np.abs(v) / (sigma * np.sqrt(r))
    claimed, truth, pairs, firsts = [], [], [], []
    for k in range(runs):
        odds = error_odds(400.0 * r, ratio[k], n - u, kind)
        claimed.append([*odds.rows.tolist(), odds.none])
        truth.append([*(wrong[k] == np.arange(n)).tolist(), wrong[k] < 0])
        second, first = np.argsort(odds.rows)[-2:].tolist()
        if wrong[k] in (first, second):
            pairs.append(odds.rows[first] / (odds.rows[first] + odds.rows[second]))
            firsts.append(wrong[k] == first)
    p, hit = np.array(claimed), np.array(truth)
    # what is chosen by the data alone is right as often as it says: 3.3 deviations
    best = np.arange(runs), np.argmax(p[:, :n], axis=1)
    for some in (p[:, n] < 0.5, p[best] > 0.5, p[best] < 0.3):
        mine = p[best][some]
        assert len(mine) > 100
        room = 3.3 * np.sqrt(np.sum(mine * (1.0 - mine)))
        assert abs(np.sum(hit[best][some] - mine)) < room
    none = p[:, n]
    assert abs(np.sum(hit[:, n] - none)) < 3.3 * np.sqrt(np.sum(none * (1.0 - none)))
    said, right = np.array(pairs), np.array(firsts)
    assert abs(np.sum(right - said)) < 3.3 * np.sqrt(np.sum(said * (1.0 - said)))
