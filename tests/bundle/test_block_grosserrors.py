"""Gross errors of blocks: found, left out alone, adjusted anew, and able to come back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import test_sxb
from bundleblocks import aerial

from anaplot.adjustment import cleaning
from anaplot.adjustment.elimination import Elimination
from anaplot.adjustment.findings import SearchSettings
from anaplot.adjustment.stepwise import rule_of
from anaplot.adjustment.strategies import STRATEGIES
from anaplot.adjustment.watch import Watch
from anaplot.bundle.adjust import adjust_block, adjust_bundle
from anaplot.bundle.errors import blockrows, grosserrors
from anaplot.bundle.errors.blockrows import BlockRows
from anaplot.bundle.errors.grosserrors import block_gross_errors
from anaplot.bundle.errors.leftout import without
from anaplot.bundle.errors.snooping import model_values
from anaplot.bundle.solve.problem import make_problem
from anaplot.bundle.solve.reliability import cofactor_column
from anaplot.bundle.solve.residuals import block_residuals
from anaplot.bundle.solve.structure import make_structure
from anaplot.errors import InputError
from anaplot.photogrammetry.block import ControlPoint

pytestmark = pytest.mark.slow

ALPHA = SearchSettings(alpha=0.001)


def plant(scene, places, times=18.0):
    """Add errors of `times` sigma (5 um) to the coordinates (row, axis) of a scene's block."""
    rows = list(scene.block.image_points)
    for k, axis in places:
        rows[k] = replace(rows[k], **{axis: getattr(rows[k], axis) + times * 5e-3})
    return scene.with_rows(rows)


def names(scene, places):
    rows = scene.block.image_points
    return {("image", rows[k].photo, rows[k].point, rows[k].model, axis) for k, axis in places}


def adjusted(scene, **options):
    problem = make_problem(scene.block, **options)
    return adjust_bundle(problem, scene.start(problem))


def small(**options):
    return aerial(2, 5, per_base=2, control_sigma=0.05, noise_um=5.0, **options)


# rays of points of six photos
PLACES = ((27, "y"), (57, "x"), (152, "y"))


def test_a_block_of_fifty_photos_loses_its_planted_errors() -> None:
    scene = aerial(5, 10, per_base=2, control_sigma=0.05, noise_um=5.0)
    clean = adjusted(scene)
    # errors that can be seen at all: 18 sigma stand well above the critical value
    good = np.argwhere(clean.cofactors.r > 0.4)
    rng = np.random.default_rng(8)
    chosen = good[rng.choice(len(good), 20, replace=False)]
    places = [(int(clean.problem.source[k]), "xy"[axis]) for k, axis in chosen.tolist()]
    block = adjusted(plant(scene, places))
    found = block_gross_errors(block, "search", ALPHA)
    planted = names(scene, places)
    got = {row.name: row for row in found.rejected}
    # a point of two rays: their residuals are nearly one, and the search says so
    partners = {found.system.names[kept] for _, kept, _ in found.findings.hard_to_tell}
    assert planted - set(got) <= partners
    assert len(planted - set(got)) <= 1
    assert len(got) <= len(planted) + 2  # 2318 coordinates tested at 0.001
    for name in planted & set(got):
        row = got[name]
        assert row.unit == "um"
        assert row.error == pytest.approx(90.0, abs=4.0 * row.sigma)
        assert row.w == pytest.approx(row.error / row.sigma)
        assert row.r_back == pytest.approx((5.0 / row.sigma) ** 2, rel=1e-6)
    # honest numbers: an observation less for each, nothing else
    assert found.block.redundancy == block.redundancy - len(got)
    assert found.block.problem.observations == block.problem.observations - len(got)
    assert found.block.problem.unknowns == block.problem.unknowns
    assert found.block.sigma0 < 1.1 < block.sigma0
    assert found.block.cofactors.r.sum() + np.nansum(
        found.block.cofactors.r_ground
    ) == pytest.approx(found.block.redundancy, abs=1e-6)
    assert found.refused == ()
    # what a linear adjustment predicts is what the new adjustment says, in the last pass exactly
    assert found.findings.at_end.vtpv == pytest.approx(found.block.vtpv, rel=1e-7)
    # and from the minimum with all errors in, to second order of 90 um in 150 mm
    assert found.passes[0].rows == found.findings.rows
    assert found.passes[0].at_end.vtpv == pytest.approx(found.block.vtpv, rel=0.02)


def test_what_is_said_of_a_set_that_does_not_settle_is_true_where_the_block_lies(
    monkeypatch,
) -> None:
    """Here every second pass may only reject another coordinate."""
    real, calls = cleaning.find_gross_errors, 0
    scene = small()
    first, second = names(scene, PLACES[:1]), names(scene, PLACES[1:2])

    def turning(system, *args, suspects, **more):
        nonlocal calls
        calls += 1
        allowed = first if calls % 2 else second
        return real(system, *args, suspects=np.array([n in allowed for n in system.names]), **more)

    monkeypatch.setattr(cleaning, "find_gross_errors", turning)
    found = block_gross_errors(adjusted(plant(scene, PLACES[:2], 60.0)), "baarda", ALPHA)
    assert any("did not settle" in remark for remark in found.remarks)
    (gone,) = found.rejected
    block = found.block
    there = block_residuals(found.system.problem, block.state, block.cofactors.normal.structure)
    assert found.system.e == pytest.approx(there.e, abs=1e-6)
    own = real(there, "baarda", ALPHA)
    assert found.findings.odds.rows == pytest.approx(own.odds.rows, abs=1e-9)
    row = found.findings.rows[0]
    assert gone.w**2 == pytest.approx(there.e[row] ** 2 / there.r[row], rel=1e-6)
    # exactly what the adjustment without it says, at its own minimum
    assert found.findings.at_end.vtpv == pytest.approx(block.vtpv, rel=1e-7)


def test_danish_weights_settle_where_one_of_forty_rays_is_a_mismatch() -> None:
    """Weights that began with ones in every pass came to another end each time, 30 times."""
    scene = aerial(3, 5, per_base=2, control_sigma=0.05, noise_um=5.0)
    rng, rows = np.random.default_rng(0), list(scene.block.image_points)
    places = []
    for k in rng.choice(len(rows), 8, replace=False).tolist():
        dx, dy = rng.uniform(-8.0, 8.0, 2)
        rows[k] = replace(rows[k], x=rows[k].x + dx, y=rows[k].y + dy)
        places += [(k, "x"), (k, "y")]
    # also where the last digits are others: a ten millionth of the accuracy
    for rows_of in (rows, [replace(row, x=row.x + 1e-10 * rng.normal()) for row in rows]):
        found = block_gross_errors(scene.with_rows(rows_of).block, "danish", ALPHA)
        assert found.end.settled
        assert not any("did not settle" in remark for remark in found.remarks)
        # but for what cannot be told apart at a point with two wrong rays
        assert len({row.name for row in found.rejected} - names(scene, places)) <= 2
        assert found.block.sigma0 < 1.2


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_every_strategy_on_a_small_block(strategy) -> None:
    scene = small()
    block = adjusted(plant(scene, PLACES, 15.0))
    found = block_gross_errors(block, strategy, ALPHA)
    got = {row.name for row in found.rejected}
    assert names(scene, PLACES) <= got
    assert found.findings.strategy == strategy
    assert (found.findings.at_end.weights is not None) == (strategy in ("huber", "danish"))
    assert all((row.weight is not None) == (strategy in ("huber", "danish"))
               for row in found.rejected)  # fmt: skip
    assert (found.findings.model_values is not None) == (strategy == "modified")
    assert found.passes[-1].rows == found.findings.rows
    kept = set(found.came_back)
    assert not kept & got


def test_the_rank_one_prediction_is_the_new_adjustment_to_second_order() -> None:
    scene = small()
    clean = adjusted(scene)
    ray, axis = int(np.argmax(clean.cofactors.r[:, 0])), 0
    structure = clean.cofactors.normal.structure
    misses = []
    for times in (100.0, 200.0):
        xy = clean.problem.xy.copy()
        xy[ray, axis] += times * clean.problem.sigma[ray]
        problem = replace(clean.problem, xy=xy)
        torn = adjust_bundle(problem, clean.state)
        system = block_residuals(problem, torn.state, structure)
        row = 2 * ray + axis
        column = system.columns(np.array([row]))[:, 0]
        z = system.e[row] / system.r[row]
        predicted = system.e - column * z
        left = adjust_bundle(without(system.rows, frozenset([row])), torn.state)
        real = -left.v.ravel()
        assert real[row] == 0.0
        miss = np.abs(np.delete(predicted[: system.rows.image] - real, row)).max()
        effect = np.abs(np.delete(column * z, row)).max()
        assert miss < 1e-3 * effect
        misses.append(miss)
    # twice the error, four times the miss
    assert misses[1] / misses[0] == pytest.approx(4.0, rel=0.2)


def test_a_coordinate_goes_alone_and_stays_visible() -> None:
    scene = small()
    found = block_gross_errors(adjusted(plant(scene, PLACES)), "baarda", ALPHA)
    block = found.block
    [row] = [r for r in block.ray_rows() if r.row == 27]
    assert [one.use for one in row.xy] == [True, False]
    assert row.xy[1].r == 0.0
    assert row.xy[1].w is None
    assert row.xy[1].mdb is None
    assert row.xy[0].r > 0.0
    assert row.xy[0].w is not None
    [error] = [r.error for r in found.rejected if r.name in names(scene, PLACES[:1])]
    # adjusted minus observed
    assert row.xy[1].residual == pytest.approx(-error, rel=1e-6)
    assert not any(block.flagged[block.rejected])
    assert not {(p, q, a) for p, q, a in block.spurs()} & {
        (n[1], n[2], n[4]) for n in names(scene, PLACES)
    }
    k = int(np.flatnonzero(block.problem.source == 27)[0])
    cofactors = block.cofactors
    assert cofactor_column(cofactors.normal, cofactors.factor, k, 1)[k, 1] == 0.0
    rays, q = block.cofactors.point_rays(int(block.problem.point[k]))
    at = 2 * int(np.flatnonzero(rays == k)[0]) + 1
    assert not q[at].any()


def test_a_rejected_one_is_looked_at_anew_and_comes_back() -> None:
    scene = small()
    clean = adjusted(scene)
    quiet = block_gross_errors(clean, "baarda", SearchSettings(alpha=1e-5))
    assert quiet.block is clean
    assert quiet.rejected == ()
    assert len(quiet.passes) == 1
    rejected = np.zeros(clean.v.shape, dtype=bool)
    rejected[40, 0] = True
    start = adjust_bundle(replace(clean.problem, rejected=rejected), clean.state)
    assert start.redundancy == clean.redundancy - 1
    found = block_gross_errors(start, "baarda", SearchSettings(alpha=1e-5))
    assert found.rejected == ()
    assert found.block.redundancy == clean.redundancy
    assert found.block.vtpv == pytest.approx(clean.vtpv, rel=1e-9)


def test_a_wrong_control_coordinate_becomes_unknown() -> None:
    scene = small()
    control = list(scene.block.control)
    wrong = control[1]
    x, y, z = wrong.xyz
    control[1] = ControlPoint(wrong.point, (x, y, z + 2.0), wrong.sigma)
    scene.block = replace(scene.block, control=tuple(control))
    block = adjusted(scene)
    found = block_gross_errors(block, "search", ALPHA)
    row = found.rejected[0]
    assert row.name == ("control", wrong.point, "Z")
    assert row.unit == "m"
    assert row.error == pytest.approx(2.0, abs=4.0 * row.sigma)
    assert found.block.redundancy == block.redundancy - len(found.rejected)
    assert found.block.problem.unknowns == block.problem.unknowns
    left = [(r.point, r.axis) for r in found.block.control_rows()]
    assert (wrong.point, "Z") not in left
    assert (wrong.point, "X") in left


def test_a_wrong_prior_is_rejected_alone() -> None:
    scene = aerial(2, 4, per_base=2, control_sigma=0.05, noise_um=5.0, priors=True)
    photos = list(scene.block.photos)
    omega, phi, kappa = photos[2].rotation
    photos[2] = replace(photos[2], rotation=(omega, phi + 0.03, kappa))
    x, y, z = photos[5].position
    photos[5] = replace(photos[5], position=(x + 4.0, y, z))
    scene.block = replace(scene.block, photos=tuple(photos))
    block = adjusted(scene)
    found = block_gross_errors(block, "search", ALPHA)
    got = {row.name: row for row in found.rejected}
    turned, shifted = got[("prior", photos[2].id, "phi")], got[("prior", photos[5].id, "X")]
    assert (turned.unit, shifted.unit) == ("rad", "m")
    assert turned.error == pytest.approx(0.03, abs=4.0 * turned.sigma)
    assert shifted.error == pytest.approx(4.0, abs=4.0 * shifted.sigma)
    assert found.block.redundancy == block.redundancy - len(got)
    left = {(row.point, row.axis) for row in found.block.prior_rows()}
    assert (photos[2].id, "phi") not in left
    assert {(photos[2].id, "omega"), (photos[2].id, "kappa"), (photos[5].id, "Y")} <= left


def test_priors_of_additional_parameters_are_never_rejected() -> None:
    from anaplot.bundle.solve.additional import additional_parameters

    scene = small(distort=lambda x, y: (2e-6 * x * y, 0.0))
    block = adjusted(scene, additional=additional_parameters("ebner", 0.05))
    found = block_gross_errors(block, "baarda", ALPHA)
    system = found.system
    assert len(system.rows.additional)
    assert all(row < system.rows.starts[2] for row in found.findings.rows)
    with pytest.raises(ValueError, match="cannot be rejected"):
        without(system.rows, frozenset([system.rows.starts[2]]))


def test_errors_so_large_that_the_minimum_is_torn() -> None:
    scene = small(test=None)
    places = (*PLACES, (182, "x"), (80, "y"), (110, "y"))
    block = adjust_block(plant(scene, places, 4000.0).block)  # 20 mm
    assert block.sigma0 > 100.0
    found = block_gross_errors(block, "search", ALPHA)
    assert names(scene, places) <= {row.name for row in found.rejected}
    assert found.block.sigma0 < 1.2


def test_what_the_block_cannot_do_without_is_refused_by_name(monkeypatch) -> None:
    from anaplot.errors import NotComputableError

    scene = small()
    block = adjusted(plant(scene, PLACES, 40.0))
    real = blockrows.find_minimum
    at = next(k for k in np.argsort(block.problem.source).tolist()
              if block.problem.source[k] == 27)  # fmt: skip

    def minimum(problem, *rest, **options):
        if problem.rejected is not None and problem.rejected[at, 1]:
            raise NotComputableError("block synthetic: not determined: photo 101")
        return real(problem, *rest, **options)

    monkeypatch.setattr(blockrows, "find_minimum", minimum)
    found = block_gross_errors(block, "baarda", replace(ALPHA, most=60))
    refused = {row.name: row.reason for row in found.refused}
    assert names(scene, PLACES[:1]) <= set(refused)
    assert set(refused.values()) == {"block synthetic: not determined: photo 101"}
    assert not names(scene, PLACES[:1]) & {row.name for row in found.rejected}


def test_control_that_alone_holds_the_datum_is_untestable_not_rejected() -> None:
    scene = aerial(1, 4, per_base=1, control_sigma=0.05, noise_um=5.0)
    control = [c for c in scene.block.control if c.point in ("p1", "p4", "p12")]
    kept = [replace(control[0]), replace(control[1]),
            replace(control[2], xyz=(None, None, control[2].xyz[2]))]  # fmt: skip
    scene.block = replace(scene.block, control=tuple(kept))
    found = block_gross_errors(adjusted(plant(scene, [(6, "y")], 60.0)), "search", ALPHA)
    blind = {found.system.names[k] for k in found.findings.untestable}
    assert {("control", "p1", "X"), ("control", "p4", "Y"), ("control", "p12", "Z")} <= blind
    assert all(row.name[0] == "image" for row in found.rejected)


@pytest.mark.parametrize("datum", ["free", "minimal"])
def test_without_a_datum_of_control(datum) -> None:
    scene = small()
    block = adjusted(plant(scene, PLACES), datum=datum)
    found = block_gross_errors(block, "search", ALPHA)
    assert names(scene, PLACES) <= {row.name for row in found.rejected}
    assert found.block.redundancy == block.redundancy - len(found.rejected)


def test_model_values_stand_for_image_coordinates_only() -> None:
    block = adjusted(small())
    system = block_residuals(block.problem, block.state, block.cofactors.normal.structure)
    models = model_values(system)
    assert np.isfinite(models[: system.rows.image]).all()
    assert np.isnan(models[system.rows.image :]).all()
    assert ((models[: system.rows.image] >= 0.0) & (models[: system.rows.image] <= 1.0)).all()


def test_blocks_too_large_for_columns_are_refused(monkeypatch) -> None:

    monkeypatch.setattr(grosserrors, "MOST_ROWS_OF_COLUMNS", 100)
    with pytest.raises(InputError, match=r"odds of [0-9]+ observations: at most 100"):
        block_gross_errors(small().block, "odds", ALPHA)


def test_wrong_requests() -> None:
    block = adjusted(small())
    with pytest.raises(ValueError, match="no strategy 'guess'"):
        block_gross_errors(block, "guess")
    large = adjusted(aerial(6, 12, per_base=2, control_sigma=0.05, noise_um=5.0))
    with pytest.raises(
        InputError, match=r"odds over pairs, asked for beside baarda, of .* at most 3000"
    ):
        block_gross_errors(large, "baarda", replace(ALPHA, pairs=True))


@pytest.mark.skipif(test_sxb.FOLDER is None, reason="the data of sxb is not here")
def test_sxb_with_planted_errors() -> None:
    block = test_sxb.sxb(())
    clean = block_gross_errors(block, "search", ALPHA)
    kept = {row.name for row in clean.rejected}
    adjustment = adjust_block(block)
    rng = np.random.default_rng(3)
    good = np.argwhere(adjustment.cofactors.r > 0.4)
    chosen = good[rng.choice(len(good), 8, replace=False)]
    rows = list(block.image_points)
    planted = {}
    for k, axis in chosen.tolist():
        source = int(adjustment.problem.source[k])
        row, label = rows[source], "xy"[axis]
        size = 20.0 * float(adjustment.problem.sigma[k])
        rows[source] = replace(row, **{label: getattr(row, label) + size})
        planted["image", row.photo, row.point, row.model, label] = size * 1e3
    found = block_gross_errors(replace(block, image_points=tuple(rows)), "search", ALPHA)
    got = {row.name: row for row in found.rejected}
    assert set(planted) - set(got) <= kept
    assert len(set(planted) & set(got)) >= 7
    for name in set(planted) & set(got):
        assert got[name].error == pytest.approx(planted[name], abs=5.0 * got[name].sigma)
    assert len(set(got) - set(planted) - kept) <= 3


def test_coordinates_that_are_off_are_no_observations_of_the_rms() -> None:
    scene = aerial(3, 5, relief=30.0, control_sigma=0.05, noise_um=5.0, seed=3, per_base=2)
    rows = [
        replace(row, use="x") if k % 4 == 0 else row
        for k, row in enumerate(scene.block.image_points)
    ]
    adjusted = adjust_block(replace(scene.block, image_points=tuple(rows)))
    problem = adjusted.problem
    structure = make_structure(problem, adjusted.state.centres)
    system = block_residuals(problem, adjusted.state, structure)
    state, rows_of = Elimination(system), BlockRows(problem, structure, Watch(), control_only=False)
    told = rule_of("rms", 0.001, rows_of.apriori.rows, rows_of.apriori.idle)(state)
    count = sum(len(row.use) for row in rows if row.point in problem.points)
    assert count < system.rows.image
    rms = np.sqrt(adjusted.vtpv / count)
    some = np.isfinite(told.size) & (state.e != 0.0)
    assert some.sum() > 300
    np.testing.assert_allclose(told.size[some], np.abs(state.e[some]) / rms, rtol=1e-9)
