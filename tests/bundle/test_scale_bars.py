"""Scale bars in a convergent network: standard deviations and tests are true, by chi-square."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from bundleblocks import make_scene
from scipy.special import chdtri

from anaplot.bundle.adjust import adjust_bundle
from anaplot.bundle.hypotheses.conditiontests import condition_tests
from anaplot.bundle.hypotheses.verdict import HypothesisSettings
from anaplot.bundle.solve.comparedconditions import checked_conditions, compared_conditions
from anaplot.bundle.solve.networkscale import scale_deviation
from anaplot.bundle.solve.problem import make_problem
from anaplot.photogrammetry.block import TestSettings
from anaplot.photogrammetry.objectconditions import ObjectCondition
from anaplot.photogrammetry.similarity import fit_similarity

BARS = {"t1 t2": "control", "t5 t9": "control", "t3 t8": "control",
        "t0 t7": "check", "t4 t10": "check", "t0 t11": "check"}  # fmt: skip
SIGMA = 5e-5
NETWORKS = 150
SHARE = 1e-4  # of good programs that this test would fail


@cache
def network():
    """Six photos around an object of 3 m, about 1 um in the image: without noise."""
    rng = np.random.default_rng(4)
    points = {f"t{k}": rng.uniform(-1.5, 1.5, 3) * [1.0, 1.0, 0.5] for k in range(12)}
    photos = {}
    for k in range(6):
        a = np.pi * k / 3.0
        centre = np.array([4.0 * np.cos(a), 4.0 * np.sin(a), 2.5 + 0.6 * (k % 2)])
        z = centre / np.linalg.norm(centre)
        x = np.cross([np.cos(0.7 * k), np.sin(0.7 * k), 0.13], z)
        x /= np.linalg.norm(x)
        photos[f"P{k + 1}"] = (centre, np.column_stack((x, np.cross(z, x), z)))
    test = TestSettings(kind="baarda")
    return make_scene(photos, points, c=28.0, sigma_um=1.0, test=test)


def measured(seed, off=None):
    """The network with its bars, all with errors; `off` adds to a bar [m]."""
    scene, rng = network(), np.random.default_rng(seed)
    rows = [
        replace(row, x=row.x + 1e-3 * rng.normal(), y=row.y + 1e-3 * rng.normal())
        for row in scene.block.image_points
    ]
    bars = []
    for names, use in BARS.items():
        one, other = names.split()
        length = float(np.linalg.norm(scene.points[one] - scene.points[other]))
        length += SIGMA * rng.normal() + (off or {}).get(names, 0.0)
        bars.append(ObjectCondition("distance", (one, other), length, SIGMA, use))
    return replace(scene.block, image_points=tuple(rows), conditions=tuple(bars))


def adjusted_block(block, datum="free"):
    problem = make_problem(block, datum=datum)
    return adjust_bundle(problem, network().start(problem))


@pytest.mark.slow
def test_standard_deviations_of_a_network_with_scale_bars_are_true():
    truth = network().points
    sums: dict[str, float] = {}
    vtpv = together = redundancy = 0.0
    rejected = flagged = 0
    for seed in range(NETWORKS):
        adjusted = adjusted_block(measured(seed))
        assert adjusted.tested.r.sum() == pytest.approx(adjusted.redundancy, abs=1e-6)
        vtpv, redundancy = vtpv + adjusted.vtpv, redundancy + adjusted.redundancy
        for row in adjusted.condition_rows():
            sums[row.key[2]] = sums.get(row.key[2], 0.0) + row.w**2
            flagged += row.flagged
        for row in compared_conditions(adjusted):
            sums[row.row[1]] = sums.get(row.row[1], 0.0) + row.w**2
        found = condition_tests(adjusted, HypothesisSettings(alpha=0.05))
        together += found.everything.known.square
        rejected += found.everything.rejected
        at = adjusted.state.points
        true = np.array([truth[name] for name in adjusted.problem.points])
        scale = fit_similarity(true, at).scale
        sums["scale"] = sums.get("scale", 0.0) + ((scale - 1.0) / scale_deviation(adjusted)) ** 2
    each = SHARE / (len(sums) + 4) / 2.0
    assert len(sums) == len(BARS) + 1

    def true_by_chi_square(square: float, degrees: float) -> bool:
        return bool(chdtri(degrees, 1.0 - each) < square < chdtri(degrees, each))

    assert true_by_chi_square(vtpv, redundancy)
    assert true_by_chi_square(together, 3 * NETWORKS)
    for name, square in sums.items():
        assert true_by_chi_square(square, NETWORKS), name
    # of good bars alpha are rejected: .05 of all checks together, .001 of single bars
    assert 0 < rejected < NETWORKS * 0.05 + 4.0 * np.sqrt(NETWORKS * 0.05 * 0.95)
    assert flagged <= 4  # .45 in the mean, Poisson


def test_a_wrong_check_distance_is_told_and_changes_nothing():
    good = adjusted_block(measured(1))
    wrong = adjusted_block(measured(1, {"t4 t10": 0.002}))
    assert wrong.vtpv == good.vtpv
    before, after = condition_tests(good), condition_tests(wrong)
    assert not before.everything.rejected
    assert after.everything.rejected
    told = {one.what: one for one in after.single if one.verdict.rejected}
    assert list(told) == ["t4 t10"]
    one = next(row for row in before.single if row.what == "t4 t10")
    assert told["t4 t10"].difference == pytest.approx(one.difference - 0.002, abs=1e-9)
    assert told["t4 t10"].s_given == SIGMA < told["t4 t10"].s < told["t4 t10"].mdb < 0.002
    assert after.distances == 3
    assert after.rms > 3.0 * after.expected


@pytest.mark.slow
def test_what_is_tested_is_what_the_table_says():
    adjusted = adjusted_block(measured(2))
    found, rows = checked_conditions(adjusted), compared_conditions(adjusted)
    assert list(found.rows) == [row.row for row in rows]
    np.testing.assert_allclose(found.differences, [row.difference for row in rows])
    np.testing.assert_allclose(np.sqrt(np.diag(found.cofactors)), [row.s for row in rows])
    # check distances with a common point are correlated: those of a network with that bar as well
    rho = found.cofactors[0, 2] / np.sqrt(found.cofactors[0, 0] * found.cofactors[2, 2])
    assert abs(rho) > 0.02
    # what the third check is, once the first is taken for true
    first = replace(measured(2).conditions[3], use="control")
    block = measured(2)
    conditions = (*block.conditions[:3], first, *block.conditions[4:])
    taken = adjusted_block(replace(block, conditions=conditions))
    (_, again) = compared_conditions(taken)
    left = found.cofactors[2, 2] - found.cofactors[0, 2] ** 2 / found.cofactors[0, 0]
    assert again.s**2 == pytest.approx(left, rel=1e-4)
    # off is no check, and without scale there is none
    off = tuple(replace(one, use="off") for one in block.conditions[3:])
    bare = replace(block, conditions=(*block.conditions[:3], *off))
    assert condition_tests(adjusted_block(bare)) is None
    assert condition_tests(adjusted_block(block, datum="minimal")) is None
    repeated = replace(block, conditions=(*block.conditions, block.conditions[3]))
    twice = condition_tests(adjusted_block(repeated))
    assert twice.everything is not None  # each has its own measuring error


def test_the_scale_is_as_good_as_bars_and_images_are():
    adjusted = adjusted_block(measured(3))
    s = scale_deviation(adjusted)
    lengths = [one.value for one in adjusted.problem.conditions.conditions]
    bars_alone = SIGMA / np.sqrt(sum(length**2 for length in lengths))
    assert bars_alone < s < 3.0 * max(row.mdb for row in adjusted.condition_rows())
    # with images free of error, nothing but the bars is left
    sharp = replace(measured(3), precision=replace(measured(3).precision, image_um=1e-4))
    assert scale_deviation(adjusted_block(sharp)) == pytest.approx(bars_alone, rel=1e-4)
    assert scale_deviation(adjusted_block(measured(3), datum="minimal")) is None


def test_only_distances_are_in_the_rms_of_distances():
    plane = ObjectCondition("plane", ("t1", "t2", "t3", "t4", "t5"), None, 0.01, "check")
    block = measured(3)
    alone = condition_tests(adjusted_block(block))
    beside = condition_tests(adjusted_block(replace(block, conditions=(*block.conditions, plane))))
    assert len(beside.single) == len(alone.single) + 5
    assert beside.distances == alone.distances == 3
    assert (beside.rms, beside.expected) == (alone.rms, alone.expected)
