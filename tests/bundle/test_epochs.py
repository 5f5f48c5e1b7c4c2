"""Two epochs: dense formulas, planted displacements, the null rate, refusals, the command."""

from __future__ import annotations

import csv
import json
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from epochblocks import compare_epochs, epoch, heights_only, layout, rescaled, stable_names, written
from wild import text_of, wild, words

from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.epochs.common import common_control
from anaplot.bundle.epochs.displacementtests import epoch_tests
from anaplot.bundle.epochs.joint import adjust_jointly, joint_block
from anaplot.bundle.epochs.variances import doubtful_epochs
from anaplot.bundle.solve.additional import additional_parameters
from anaplot.bundle.solve.crosscofactors import coordinate_cofactors
from anaplot.bundle.solve.gaussnewton import NoConvergenceError
from anaplot.bundle.solve.parameterpriors import ParameterPrior
from anaplot.cli import main
from anaplot.errors import InputError, NotComputableError
from anaplot.photogrammetry.block import ImagePoint, TestSettings
from anaplot.photogrammetry.similarity import fit_similarity
from anaplot.report.comparecommand import compare
from anaplot.report.epochdocument import compare_document

pytestmark = pytest.mark.slow

BAARDA = TestSettings(kind="baarda")


def inverse(block):
    """Dense inverse of the normal equations (no additional parameters), and its columns."""
    problem, linear = block.problem, block.cofactors.normal.linear
    n = 6 * len(problem.photos)
    u = n + 3 * len(problem.points)
    rows = np.zeros((2 * len(problem.photo), u))
    for ray in range(len(problem.photo)):
        f, p = int(problem.photo[ray]), int(problem.point[ray])
        rows[2 * ray : 2 * ray + 2, 6 * f : 6 * f + 6] = linear.a[ray]
        rows[2 * ray : 2 * ray + 2, n + 3 * p : n + 3 * p + 3] = linear.b[ray]
    normal = rows.T @ rows
    for p, axis in np.argwhere(np.isfinite(problem.known_sigma)):
        normal[n + 3 * p + axis, n + 3 * p + axis] += problem.known_sigma[p, axis] ** -2
    return normal, {name: n + 3 * k for k, name in enumerate(problem.points)}


def test_joint_covariances_are_those_of_the_whole_inverse() -> None:
    first, second = epoch(1), epoch(2)
    found = compare_epochs(first, second)
    joint = adjust_block(joint_block((first, second), common_control((first, second))))
    normal, column = inverse(joint)
    q = np.linalg.inv(normal)
    b = np.zeros((3 * len(found.points), len(q)))
    for k, name in enumerate(found.points):
        for axis in range(3):
            b[3 * k + axis, column[name + " [1]"] + axis] = -1.0
            b[3 * k + axis, column[name + " [2]"] + axis] = 1.0
    np.testing.assert_allclose(found.cofactors, b @ q @ b.T, rtol=2e-5, atol=1e-9)
    rows = {r.point: np.array(r[1]) for r in joint.point_rows()}
    for k, name in enumerate(found.points):
        d = rows[name + " [2]"] - rows[name + " [1]"]
        np.testing.assert_allclose(found.d[3 * k : 3 * k + 3], d, atol=1e-7)
    assert found.vtpv == pytest.approx(joint.vtpv, rel=1e-8)
    assert found.redundancy == joint.redundancy
    tested = epoch_tests(found)
    r = found.d @ np.linalg.solve(b @ q @ b.T, found.d)
    assert tested.everything.estimated.square == pytest.approx(r, rel=1e-4)
    assert tested.everything.estimated.dimension == len(found.d)


def test_separate_covariances_add_up() -> None:
    first, second = epoch(1), epoch(2)
    found = compare_epochs(first, second, separate=True)
    total = 0.0
    for block in (first, second):
        normal, column = inverse(adjust_block(block))
        at = [column[name] + axis for name in found.points for axis in range(3)]
        total = total + np.linalg.inv(normal)[np.ix_(at, at)]
    mine = [k for k, p in enumerate(found.points) if p not in found.common]
    assert len(mine) == len(found.points)
    np.testing.assert_allclose(found.cofactors, total, rtol=2e-5, atol=1e-9)
    joint = compare_epochs(first, second)
    # common control takes its own error out of the differences
    assert np.trace(joint.cofactors) < np.trace(found.cofactors)


def test_a_coordinate_given_once_is_one_observation_of_one_unknown() -> None:
    first, second = (heights_only(epoch(k), "p13", sigma=0.03) for k in (1, 2))
    found = compare_epochs(first, second)
    assert found.partly == (("p13", "Z"),)
    assert "p13" not in found.common
    assert found.given.sum() == 1
    # dense: the columns of both heights made one; half the weight twice is the weight
    joint = adjust_block(
        joint_block((first, second), common_control((first, second)), shares={"p13": 2})
    )
    normal, column = inverse(joint)
    one, two = column["p13 [1]"] + 2, column["p13 [2]"] + 2
    at = dict(zip(joint.problem.points, joint.state.points, strict=True))
    together = np.delete(np.eye(len(normal)), two, axis=1)
    together[two, one] = 1.0
    q = together @ np.linalg.inv(together.T @ normal @ together) @ together.T
    shift = np.zeros(len(normal))
    shift[two] = at["p13 [1]"][2] - at["p13 [2]"][2]
    # from the minimum, where the gradient vanishes, to the smallest v'Pv with equal heights
    x = shift - q @ normal @ shift
    b = np.zeros((3 * len(found.points), len(normal)))
    d = np.zeros(len(b))
    for k, name in enumerate(found.points):
        d[3 * k : 3 * k + 3] = at[name + " [2]"] - at[name + " [1]"]
        for axis in range(3):
            b[3 * k + axis, column[name + " [1]"] + axis] = -1.0
            b[3 * k + axis, column[name + " [2]"] + axis] = 1.0
    np.testing.assert_allclose(found.cofactors, b @ q @ b.T, rtol=2e-5, atol=1e-9)
    np.testing.assert_allclose(found.d, d + b @ x, atol=1e-7)
    assert found.vtpv == pytest.approx(joint.vtpv + x @ normal @ x, rel=1e-7)
    assert abs(x @ normal @ x) > 1e-3
    places = np.array([at[n + " [1]"] + x[column[n + " [1]"] :][:3] for n in found.points])
    np.testing.assert_allclose(found.places, places + joint.state.origin, atol=1e-6)
    # and the redundancy counts it once
    photos, points = 2 * len(first.photos), len(found.points)
    rays = len(first.image_points) + len(second.image_points)
    whole = len(found.common)
    unknowns = 6 * photos + 3 * whole + 6 * points - 1
    assert found.redundancy == 2 * rays + 3 * whole + 1 - unknowns


def test_a_tiny_sigma_is_next_to_free_of_error() -> None:
    made = []
    for sigma in (1e-6, 0.0):
        first, second = (heights_only(epoch(k), "p13", sigma=sigma) for k in (1, 2))
        made.append(compare_epochs(first, second))
    near, fixed = made
    assert near.redundancy == fixed.redundancy
    assert near.vtpv == pytest.approx(fixed.vtpv, rel=1e-5)
    np.testing.assert_allclose(near.d, fixed.d, atol=1e-6)
    np.testing.assert_allclose(near.cofactors, fixed.cofactors, rtol=1e-4, atol=1e-8)
    assert near.points == fixed.points


@pytest.mark.parametrize("sigma", [0.0, 0.02])
@pytest.mark.parametrize("separate", [False, True])
def test_a_point_of_given_height_is_seen_to_move_in_plan(sigma, separate) -> None:
    first = heights_only(epoch(11), "p13", sigma=sigma)
    second = heights_only(epoch(12, moved={"p13": (0.4, 0.0, 0.0)}), "p13", sigma=sigma)
    tested = epoch_tests(compare_epochs(first, second, separate=separate))
    [moved] = [p for p in tested.points if p.point == "p13"]
    assert moved.verdict.rejected
    assert moved.verdict.known.dimension == 2
    assert [c.given for c in moved.coordinates] == [False, False, True]
    assert moved.coordinates[0].verdict.rejected
    assert moved.coordinates[2].verdict is None
    assert moved.length == pytest.approx(np.hypot(*(c.d for c in moved.coordinates[:2])))
    assert tested.everything.known.dimension == 3 * len(tested.points) - 1
    assert tested.located[0].point == "p13"
    assert "p13" not in tested.differences.common


def test_a_coordinate_given_in_one_epoch_is_compared() -> None:
    first, second = epoch(11), heights_only(epoch(12), "p1")
    found = compare_epochs(first, second, separate=True)
    assert found.partly == (("p1", "Z"),)
    assert found.given[found.points.index("p1")].tolist() == [False, False, True]
    # measured in one epoch alone, it is that epoch's control with all its weight
    rows = tuple(r for r in epoch(2).image_points if r.point != "p13")
    first, second = heights_only(epoch(1), "p13"), heights_only(epoch(2), "p13")
    alone = compare_epochs(first, replace(second, image_points=rows))
    bare = compare_epochs(first, replace(epoch(2), image_points=rows))
    assert "p13" in alone.only_first
    assert alone.vtpv == pytest.approx(bare.vtpv)
    assert alone.redundancy == bare.redundancy


def test_stable_points_by_s_transformation() -> None:
    first, second = epoch(1, control=False), epoch(2, control=False)
    stable = [n for n in stable_names() if n in layout().points]
    found = compare_epochs(first, second, separate=True, stable=stable, points=("p8", "p9"))
    # the same from the two free networks
    one, two = (adjust_block(b, datum="free") for b in (first, second))

    def at(block, names):
        rows = dict(zip(block.problem.points, block.state.points + block.state.origin, strict=True))
        return np.array([rows[n] for n in names])

    fitted = fit_similarity(at(two, stable), at(one, stable))
    d = fitted.apply(at(two, ("p8", "p9"))) - at(one, ("p8", "p9"))
    np.testing.assert_allclose(found.d, d.ravel(), atol=1e-8)
    assert found.agreement.dimension == 3 * len(stable) - 7
    # dense: S (Q1 + Q2) S' with S = I - G (G'EG)^-1 G'E, E the stable points
    names = list(dict.fromkeys((*stable, "p8", "p9")))
    total = sum(
        coordinate_cofactors(
            block, [(block.problem.points.index(n), axis) for n in names for axis in range(3)]
        )
        for block in (one, two)
    )
    place = at(one, names) - at(one, stable).mean(axis=0)
    g = np.zeros((len(total), 7))
    for k, (x, y, z) in enumerate(place):
        g[3 * k : 3 * k + 3, :3] = np.eye(3)
        g[3 * k : 3 * k + 3, 3:6] = [[0, z, -y], [-z, 0, x], [y, -x, 0]]
        g[3 * k : 3 * k + 3, 6] = x, y, z
    held = np.repeat([name in stable for name in names], 3)
    s = np.eye(len(total)) - g @ np.linalg.solve(g[held].T @ g[held], (g * held[:, None]).T)
    dense = (s @ total @ s.T)[-6:, -6:]
    # up to the different scales of the two free networks
    np.testing.assert_allclose(found.cofactors, dense, rtol=5e-3, atol=1e-4 * dense.max())
    joint = compare_epochs(first, second, stable=stable, points=("p8", "p9"))
    assert joint.agreement.dimension == found.agreement.dimension
    # R of the stable points: by covariances here, by the growth of v'Pv there
    assert joint.agreement.square == pytest.approx(found.agreement.square, rel=2e-2)
    assert joint.redundancy == found.redundancy + found.agreement.dimension
    # the rigorous weighting is never worse
    assert np.trace(joint.cofactors) <= 1.02 * np.trace(found.cofactors)


@pytest.mark.parametrize("options", [{}, {"separate": True}, {"stable": stable_names()}])
def test_a_planted_displacement_is_found_and_named(options) -> None:
    first, second = epoch(11), epoch(12, moved={"p13": (0.0, 0.25, 0.4)})
    tested = epoch_tests(compare_epochs(first, second, **options))
    assert tested.everything.rejected
    assert tested.located[0].point == "p13"
    by = {p.point: p for p in tested.points}
    assert by["p13"].verdict.rejected
    assert by["p13"].length == pytest.approx(np.hypot(0.25, 0.4), abs=5 * by["p13"].s_length)
    for c, true in zip(by["p13"].coordinates, (0.0, 0.25, 0.4), strict=True):
        assert abs(c.d - true) < c.half_scheffe
        assert c.half_scheffe > c.half_bonferroni > c.s


@pytest.mark.parametrize(
    "options", [{}, {"stable": stable_names()}, {"separate": True, "stable": stable_names()}]
)
def test_null_rate_is_alpha(options) -> None:
    runs, alpha = 40, 0.2
    rejected, single = Counter(), Counter()
    square = 0.0
    for k in range(runs):
        found = compare_epochs(
            epoch(100 + 2 * k), epoch(101 + 2 * k), points=("p8", "p13"), **options
        )
        # the adjustments are the same, whichever sigma0 the tests take
        for by_known in (True, False):
            tested = epoch_tests(replace(found, by_known=by_known), alpha=alpha)
            rejected[by_known] += bool(tested.everything.rejected)
            single[by_known] += any(p.verdict.rejected for p in tested.points)
        square += tested.everything.known.square
    # R of fresh noise is chi-square of 6 with the covariance claimed: within 3.3 deviations
    assert abs(square - 6 * runs) < 3.3 * np.sqrt(2 * 6 * runs)
    # the count is binomial, Bonferroni keeps at most alpha: within 3.3 deviations
    room = 3.3 * np.sqrt(runs * alpha * (1.0 - alpha))
    for by_known in (True, False):
        assert abs(rejected[by_known] - alpha * runs) < room
        assert single[by_known] < alpha * runs + room


@pytest.mark.parametrize("stable", [False, True])
@pytest.mark.parametrize("test", [None, BAARDA])
def test_all_families_together_keep_one_level(stable, test) -> None:
    runs, alpha = 800, 0.05
    names = stable_names() if stable else ()
    found = compare_epochs(
        epoch(11, test=test), epoch(12, test=test), stable=names, points=("p7", "p8", "p9")
    )
    rng = np.random.default_rng(1978)
    root = np.linalg.cholesky(found.cofactors)
    moved = apart = 0
    for _ in range(runs):
        # without movement: displacements and what is left of v'Pv know nothing of each other
        held = found.agreement
        agree = float(rng.chisquare(held.dimension))
        left = float(rng.chisquare(held.redundancy))
        # what stable points need not agree in is the joint adjustment's; control adds its own
        own = found.redundancy - held.redundancy - stable * held.dimension
        more = float(rng.chisquare(own)) if own else 0.0
        fresh = replace(
            found,
            d=root @ rng.normal(size=len(root)),
            vtpv=left + stable * agree + more,
            agreement=replace(held, square=agree, vtpv=left),
        )
        tested = epoch_tests(fresh, alpha=alpha)
        assert tested.overall is not None
        families = tested.overall.families
        held_by = "stable points" if stable else "common control"
        assert families == ("all points", held_by, "points", "coordinates")
        moved += tested.any_moved
        verdicts = [tested.everything, tested.agreement, *(p.verdict for p in tested.points)]
        verdicts += [c.verdict for p in tested.points for c in p.coordinates]
        apart += any(v is not None and v.rejected for v in verdicts)
    # Bonferroni: alpha at most, and at least what one family has of it; 3.3 deviations
    assert moved <= alpha * runs + 3.3 * np.sqrt(runs * alpha * (1.0 - alpha))
    share = alpha / len(families)
    assert moved >= share * runs - 3.3 * np.sqrt(runs * share * (1.0 - share))
    # one family after the other at alpha is no level for all of them
    assert apart > alpha * runs + 3.3 * np.sqrt(runs * alpha * (1.0 - alpha))


@pytest.mark.parametrize("alpha", [0.01, 0.05])
def test_an_epoch_is_doubted_at_the_level_asked_for(alpha) -> None:
    found = compare_epochs(epoch(11), epoch(12), points=("p8",))
    rng = np.random.default_rng(7)
    (_, f), (_, g) = found.alone
    runs, doubted = 800, 0
    for _ in range(runs):
        alone = ((float(rng.chisquare(f)), f), (float(rng.chisquare(g)), g))
        tested = epoch_tests(replace(found, alone=alone), alpha=alpha)
        doubted += sum("its global test is rejected" in remark for remark in tested.remarks)
    # binomial: within 3.3 deviations
    assert abs(doubted - 2 * runs * alpha) < 3.3 * np.sqrt(2 * runs * alpha * (1.0 - alpha))


def test_stable_points_that_have_moved_are_named_and_refute_the_datum() -> None:
    first, second = epoch(11), epoch(12, moved={"p16": (0.0, 0.5, 0.0)})
    for separate in (False, True):
        found = compare_epochs(
            first, second, stable=stable_names(), points=("p8",), separate=separate
        )
        tested = epoch_tests(found)
        assert tested.agreement.rejected
        assert tested.any_moved
        assert tested.located_stable[0].point == "p16"
        assert any("(p16" in remark and "refuted" in remark for remark in tested.remarks)
    three = epoch_tests(compare_epochs(first, second, stable=("p1", "p5", "p16"), separate=True))
    assert three.agreement.rejected
    assert three.located_stable == ()
    assert any("does not show" in remark for remark in three.remarks)
    right = epoch_tests(compare_epochs(first, epoch(12), stable=stable_names()))
    assert right.located_stable == ()
    assert right.remarks == right.differences.remarks


@pytest.mark.parametrize("k", [0.05, 100.0])
def test_stable_points_that_have_moved_are_the_same_in_every_unit_of_an_estimated_sigma0(k) -> None:
    first, second = epoch(11), epoch(12, moved={"p16": (0.0, 0.5, 0.0)})
    blocks = [rescaled(block, k) for block in (first, second)]
    tested = epoch_tests(compare_epochs(*blocks, stable=stable_names(), points=("p8",)))
    assert tested.agreement.decisive is tested.agreement.estimated
    assert [step.point for step in tested.located_stable] == ["p16"]


def test_epochs_with_gross_errors_are_named() -> None:
    first, second = (epoch(k, test=BAARDA) for k in (11, 12))
    clean = compare_epochs(first, second)
    assert clean.flagged == (0, 0)
    assert not any(r.startswith("epoch") for r in clean.remarks)
    rows = list(second.image_points)
    rows[7] = replace(rows[7], x=rows[7].x + 1.0)
    found = compare_epochs(first, replace(second, image_points=tuple(rows)))
    assert found.flagged[0] == 0
    assert found.flagged[1] > 0
    wrong = f"x of point {rows[7].point} in photo {rows[7].photo}"
    assert any(r.startswith("epoch 2: ") and wrong in r and "--errors" in r for r in found.remarks)
    doubts = epoch_tests(found).remarks
    assert any(r.startswith("epoch 2: its global test is rejected: ") for r in doubts)
    extra = compare_epochs(
        first,
        replace(second, image_points=tuple(rows)),
        additional=additional_parameters("ebner", 1.0),
        points=("p8",),
    )
    assert sum("by itself, without additional" in r for r in epoch_tests(extra).remarks) == 2


def test_joint_warnings_are_told_whatever_names_they_hold() -> None:
    first, second = epoch(11), epoch(12)
    rows = [*second.image_points, ImagePoint(second.photos[0].id, "lonely", 10.0, 10.0)]
    rows[7] = replace(rows[7], x=rows[7].x + 20.0)
    wrong = rows[7].point
    first, second = (
        replace(
            block,
            image_points=tuple(
                replace(row, point="left out") if row.point == wrong else row for row in mine
            ),
        )
        for block, mine in ((first, first.image_points), (second, rows))
    )
    told = [r for r in compare_epochs(first, second).remarks if r.startswith("jointly: ")]
    assert any("gross errors" in r and "point left out [2]" in r for r in told)
    # the epochs by themselves say what they lack
    assert not any("lonely" in r for r in told)


def test_what_is_flagged_is_to_be_remeasured_or_removed() -> None:
    first, second = (epoch(k, test=BAARDA) for k in (11, 12))
    rows = list(second.image_points)
    rows[7] = replace(rows[7], x=rows[7].x + 0.03)
    one = compare_epochs(first, replace(second, image_points=tuple(rows)))
    assert one.flagged == (0, 1)
    [remark] = [r for r in one.remarks if "flagged" in r]
    wrong = f"x of point {rows[7].point} in photo {rows[7].photo} (w "
    assert wrong in remark
    assert remark.endswith("): remeasure it, or remove it from image_points.csv")
    # which leads on
    gone = compare_epochs(first, replace(second, image_points=tuple(rows[:7] + rows[8:])))
    assert gone.flagged == (0, 0)
    control = list(second.control)
    x, y, z = control[0].xyz
    control[0] = replace(control[0], xyz=(x, y + 0.3, z))
    found = adjust_block(replace(second, control=tuple(control))).flagged_observations()[0]
    assert found[1:] == (f"Y of control point {control[0].point}", "control")
    tight = additional_parameters("ebner", 1e-3)
    bent = epoch(12, test=BAARDA, distort=lambda x, y: (1e-5 * x * y, 0.0))
    kinds = {kind for *_, kind in adjust_block(bent, additional=tight).flagged_observations()}
    assert "parameter" in kinds
    assert "prior" not in kinds


def test_the_same_measurements_are_not_two_epochs() -> None:
    first, second = epoch(11), epoch(12)
    copied = replace(first, name="copy", image_points=first.image_points[::-1])
    same = "both epochs have the same image measurements: they are not two epochs"
    assert same in compare_epochs(first, copied).remarks
    assert same in compare_epochs(first, copied, separate=True).remarks
    assert same not in compare_epochs(first, second).remarks


def test_the_unit_of_a_free_network_is_told_where_it_is_not_controls() -> None:
    def stripped(block, axes):
        rows = [
            replace(
                row,
                xyz=tuple(v if k in axes[n % 2] else None for k, v in enumerate(row.xyz)),
                sigma=tuple(v if k in axes[n % 2] else None for k, v in enumerate(row.sigma)),
            )
            for n, row in enumerate(block.control)
        ]
        return replace(block, control=tuple(rows))

    first, second = epoch(1), epoch(2)
    options = {"stable": stable_names(), "points": ("p8",)}
    # plan and height by turns lay it onto control all the same
    by_turns = ((0, 1), (2,))
    apart = compare_epochs(stripped(first, by_turns), stripped(second, by_turns), **options)
    assert not any("units" in r for r in apart.remarks)
    heights = ((2,), (2,))
    flat = compare_epochs(stripped(first, heights), stripped(second, heights), **options)
    assert any(r.startswith("control does not hold the first epoch") for r in flat.remarks)
    bare = compare_epochs(replace(first, control=()), replace(second, control=()), **options)
    assert any(r.startswith("no control in the first epoch") for r in bare.remarks)


def test_variances_of_rounding_are_not_compared() -> None:
    found = compare_epochs(epoch(1, noise_um=0.0), epoch(2))
    assert epoch_tests(found).variance is None
    assert epoch_tests(compare_epochs(epoch(1), epoch(2))).variance is not None


def test_an_epoch_without_redundancy_is_not_doubted() -> None:
    [said] = doubtful_epochs([(0.0, 0), (1e-20, 0), (40.0, 4)], 0.001, without=False)
    assert said.startswith("epoch 3: its global test is rejected: sigma0^2 10.000 against 4.617")


def test_control_free_of_error_is_not_determined_anew() -> None:
    first, second = epoch(1), epoch(2)
    anew = "determined anew"
    assert any(anew in r for r in compare_epochs(first, second, separate=True).remarks)
    exact = [
        replace(b, control=tuple(replace(c, sigma=(0.0,) * 3) for c in b.control))
        for b in (first, second)
    ]
    assert not any(anew in r for r in compare_epochs(*exact, separate=True).remarks)


def test_smallest_displacements_are_those_of_the_blocks_power() -> None:
    first = epoch(1, test=TestSettings(kind="baarda", power=0.9))
    found = compare_epochs(first, epoch(2, test=BAARDA), points=("p8",))
    tested = epoch_tests(found)
    assert tested.power == 0.9
    least = epoch_tests(replace(found, power=0.80)).points[0].coordinates[0].mdb
    assert tested.points[0].coordinates[0].mdb > least


def test_common_parameters_and_those_of_each_epoch() -> None:
    def bend(x, y):
        return (0.01 * x * y / 90.0**2, 0.0)

    first, second = epoch(21, distort=bend), epoch(22, distort=bend)
    extra = additional_parameters("ebner")
    common = compare_epochs(first, second, additional=extra)
    own = compare_epochs(first, second, additional=extra, common_parameters=False)
    assert common.own_parameters is False
    assert own.own_parameters is True
    assert common.redundancy == own.redundancy + 12
    assert np.trace(common.cofactors) < np.trace(own.cofactors)
    with pytest.raises(InputError, match="cannot be common"):
        compare_epochs(
            first, second, additional=additional_parameters("ebner:photo"), common_parameters=True
        )


@pytest.mark.parametrize(
    ("scope", "common"), [("block", False), ("strip", None), ("camera", None), ("camera", False)]
)
@pytest.mark.parametrize("sigma", [2.0, 0.0, None])
def test_priors_of_groups_are_those_of_the_epochs_that_have_them(scope, common, sigma) -> None:
    first, second = epoch(21), epoch(22)
    groups = {
        "block": ["block"],
        "strip": [strip.id for strip in first.strips],
        "camera": [camera.id for camera in first.cameras],
    }[scope]

    def compared(*of):
        known = [ParameterPrior("b3", 3.0, sigma, group) for group in of]
        chosen = additional_parameters(f"ebner:b3,b5:{scope}", 20.0, known)
        return compare_epochs(first, second, additional=chosen, common_parameters=common)

    one, other = compared(*groups), compared(None)
    np.testing.assert_allclose(one.d, other.d, atol=1e-9)
    assert (one.redundancy, one.vtpv) == (other.redundancy, pytest.approx(other.vtpv))
    with pytest.raises(InputError, match=rf"no {scope} 'x' in any epoch \(known: {groups[0]}"):
        compared(*groups, "x")


def test_a_prior_of_one_strip_is_that_of_this_strip_in_each_epoch() -> None:
    blocks = [epoch(21), epoch(22)]
    chosen = additional_parameters(
        "ebner:b3,b5:strip", None, [ParameterPrior("b3", 3.0, 2.0, blocks[0].strips[1].id)]
    )
    alone = [adjust_block(block) for block in blocks]
    found = adjust_jointly(alone, common_control(blocks), {}, "control", chosen, same=False)
    names = [row.key[1] for row in found.prior_rows()]
    assert names == [f"{blocks[0].strips[1].id} [{k}]" for k in (1, 2)]


def test_points_of_one_epoch_and_control_in_one_epoch() -> None:
    first, second = epoch(1), epoch(2)
    second = replace(
        second,
        image_points=tuple(r for r in second.image_points if r.point != "p8"),
        control=second.control[1:],
    )
    found = compare_epochs(first, second)
    assert found.only_first == ("p8",)
    # control given up in one epoch is a point like others, and compared
    assert first.control[0].point in found.points
    assert first.control[0].point not in found.common


def test_refusals() -> None:
    first, second = epoch(1), epoch(2)
    row = second.control[0]
    shifted = replace(row, xyz=(row.xyz[0] + 0.03, *row.xyz[1:]))
    with pytest.raises(InputError, match=f"control point {row.point}: X .* needs the same"):
        compare_epochs(first, replace(second, control=(shifted, *second.control[1:])))
    near = replace(second, control=(shifted, *second.control[1:]))
    compare_epochs(first, near, separate=True, points=("p8",))
    far = replace(row, xyz=(row.xyz[0] + 100.0, *row.xyz[1:]))
    with pytest.raises(InputError, match="not in one datum"):
        compare_epochs(first, replace(second, control=(far, *second.control[1:])), separate=True)
    with pytest.raises(NotComputableError, match=r"^epoch 2: .*--stable"):
        compare_epochs(first, replace(second, control=()))
    with pytest.raises(InputError, match="at least 3"):
        compare_epochs(first, second, stable=("p1", "p2"))
    with pytest.raises(InputError, match="does not have: nowhere"):
        compare_epochs(first, second, stable=("p1", "p2", "nowhere"))
    with pytest.raises(InputError, match="point p999 is not in both"):
        compare_epochs(first, second, points=("p999",))
    other = replace(
        second,
        image_points=tuple(replace(r, point="q" + r.point) for r in second.image_points),
        control=tuple(replace(c, point="q" + c.point) for c in second.control),
    )
    with pytest.raises(InputError, match="no point in common"):
        compare_epochs(first, other)
    with pytest.raises(InputError, match="tested differently"):
        compare_epochs(first, replace(second, test=BAARDA))


def test_an_epoch_without_a_minimum_is_named(monkeypatch) -> None:
    def endless(block, **_):
        raise NoConvergenceError(f"block {block.name}: no solution found", None)

    monkeypatch.setattr("anaplot.bundle.epochs.alone.adjust_block", endless)
    with pytest.raises(NotComputableError, match=r"^epoch 1: block .*: no solution found"):
        compare_epochs(epoch(1), epoch(2))


def test_names_cannot_meet() -> None:
    first = epoch(1)
    odd = {"p8": "p9 [1]", "p9": "p9", "p10": "p9 [both]"}

    def renamed(block):
        rows = tuple(replace(r, point=odd.get(r.point, r.point)) for r in block.image_points)
        return replace(block, image_points=rows)

    plain = compare_epochs(first, epoch(2))
    found = compare_epochs(renamed(first), renamed(epoch(2)))
    assert len(found.points) == len(plain.points)
    np.testing.assert_allclose(found.d, plain.d, atol=1e-8)


# --- the command ----------------------------------------------------------------------------


def test_the_command(tmp_path, capsys) -> None:
    folders = written(tmp_path, epoch(11), epoch(12, moved={"p13": (0.0, 0.25, 0.4)}))
    table = tmp_path / "moves.csv"
    assert main(["compare", *folders, "--csv", str(table)]) == 0
    text = capsys.readouterr().out
    line = next(x for x in text.splitlines() if x.startswith("  p13 "))
    assert "MOVED BS" in line
    assert "no point has moved" in text
    assert "<< REJECTED" in text
    with table.open(encoding="utf-8", newline="") as file:
        rows = {row["point"]: row for row in csv.DictReader(file)}
    assert rows["p13"]["moved_bonferroni"] == "1"
    assert main(["compare", *folders, "--json", "--fail-on-flag"]) == 1
    found = json.loads(capsys.readouterr().out)
    assert found["adjustment"] == "joint"
    assert found["all"]["rejected"] is True
    assert found["located"][0]["point"] == "p13"
    by = {p["point"]: p for p in found["points"]}
    assert by["p13"]["coordinates"][2]["d"] == pytest.approx(float(rows["p13"]["dZ"]))
    assert set(by) == set(rows)
    assert found["flagged"] == [0, 0]
    assert found["located_stable"] == []
    assert main(["compare", *folders, "--separate", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["adjustment"] == "separate"


def test_what_is_switched_off_counts_in_neither_adjustment_and_is_listed(tmp_path, capsys) -> None:
    first, second = epoch(11), epoch(12)
    bad = next(row for row in second.image_points if row.point == "p13")
    wrong = replace(second, image_points=tuple(
        replace(row, x=row.x + 0.5, use="off") if row is bad else row
        for row in second.image_points
    ))  # fmt: skip
    without = replace(second, image_points=tuple(r for r in second.image_points if r is not bad))
    for options in ({}, {"separate": True}):
        found, clean = (compare(first, other, **options) for other in (wrong, without))
        np.testing.assert_allclose(
            found.result.differences.d, clean.result.differences.d, atol=1e-9
        )
        assert found.result.differences.redundancy == clean.result.differences.redundancy
        assert found.document.answer["off"] == [
            {"epoch": 2, "photo": bad.photo, "point": "p13", "model": None, "use": "off",
             "reason": None}
        ]  # fmt: skip
        assert f"switched off in epoch 2: p13 in photo {bad.photo} (xy)" in text_of(found.document)
        assert "off" not in clean.document.answer


def test_columns_of_the_command_never_touch() -> None:
    found = epoch_tests(compare_epochs(epoch(11), epoch(12)))
    usual, large = text_of(compare_document(found)), text_of(compare_document(wild(found)))
    assert words(usual) == words(large)
    assert any(line.startswith("  p13 ") for line in large.splitlines())


def test_given_coordinates_are_shown_as_such(tmp_path, capsys) -> None:
    folders = written(tmp_path, *(heights_only(epoch(k), "p13") for k in (11, 12)))
    assert main(["compare", *folders]) == 0
    text = capsys.readouterr().out
    assert "p13 in Z" in next(x for x in text.splitlines() if "common control" in x)
    line = next(x for x in text.splitlines() if x.startswith("  p13 "))
    assert line.split()[3] == "given"
    assert main(["compare", *folders, "--points", "p13"]) == 0
    assert "  the point, or all coordinates, together" in capsys.readouterr().out
    assert main(["compare", *folders, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["common_coordinates"] == [{"point": "p13", "axes": "Z"}]
    [point] = [p for p in found["points"] if p["point"] == "p13"]
    assert [c["given"] for c in point["coordinates"]] == [False, False, True]


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (["--alpha", "0"], 2),
        (["--alpha", "1e-13"], 2),
        (["--common-parameters"], 2),
        (["--stable", ","], 2),
        (["--additional-sigma-um", "3"], 2),
        (["--additional-reference-mm", "90"], 2),
        (["--stable", "p1,p2"], 2),
    ],
)
def test_refused_by_the_command(tmp_path, capsys, arguments, code) -> None:
    folders = written(tmp_path, epoch(11), epoch(12))
    assert main(["compare", *folders, *arguments]) == code
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.count("anaplot: ") == 1
