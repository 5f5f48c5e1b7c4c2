"""Stated positions and angles with what they have in common: lever arm, shift, drift, boresight."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np
import pytest
from epochblocks import compare_epochs
from gnssblocks import Dense, flown

from anaplot.bundle.adjust import adjust_block, adjust_problem
from anaplot.bundle.errors.grosserrors import block_gross_errors
from anaplot.bundle.hypotheses import offsetadvice
from anaplot.bundle.hypotheses.offsetadvice import offset_advice
from anaplot.bundle.hypotheses.offsettests import offset_rows, offset_tests
from anaplot.bundle.solve.additional import additional_parameters
from anaplot.bundle.solve.datum import priors_hold
from anaplot.bundle.solve.externalreliability import external_reliability
from anaplot.bundle.solve.problem import make_problem
from anaplot.bundle.solve.residuals import block_residuals, residuals_of
from anaplot.errors import InputError, NotComputableError
from anaplot.photogrammetry.objectconditions import ObjectCondition
from anaplot.photogrammetry.prioroffsets import PriorOffsets
from anaplot.photogrammetry.rotation import rotation_angles, rotation_matrix
from anaplot.report.adjustcommand import adjust
from anaplot.report.astext import page_text
from anaplot.report.offsets import offsets_document

EVERY = PriorOffsets("strip", "strip", "block")
WEIGHTED = PriorOffsets(
    "strip", "strip", "camera", (1.0, 2.0, 0.5), (0.02, 0.01, 0.03), (0.01, 0.02, 0.03)
)
CASES = {
    "all free": EVERY,
    "all weighted": WEIGHTED,
    "shift of the block": PriorOffsets(shift="block"),
    "drift alone": PriorOffsets(drift="block", drift_sigma=(0.1, 0.1, 0.1)),
    "boresight alone": PriorOffsets(boresight="camera"),
    "mixed": PriorOffsets("strip", "block", "block", shift_sigma=(0.3, 0.3, 0.3)),
    "lever arm alone": PriorOffsets(),
}


class Both(NamedTuple):
    """Our adjustment, and one without any of our code: residuals, design, cofactors."""

    ours: object
    e: np.ndarray
    jacobian: np.ndarray
    q: np.ndarray
    order: np.ndarray  # our rows in the order of the other's

    @property
    def whole(self):
        """R = Q_vv P."""
        return np.eye(len(self.e)) - self.jacobian @ self.q @ self.jacobian.T


@cache
def both(name) -> Both:
    block = flown(CASES[name], seed=3, timed=name != "mixed").scene.block
    ours = adjust_block(block)
    problem, state, rows = ours.problem, ours.state, offset_rows(ours)
    names = problem.photos, problem.points, [(row.kind, row.group, row.axis) for row in rows]
    dense = Dense(block, names, state.origin)
    angles = [row.angles for row in ours.photo_rows()]
    values = [row.value for row in rows]
    x = np.concatenate((state.centres.ravel(), np.ravel(angles), state.points.ravel(), values))
    found, e, jacobian = dense.solve(x)
    size = np.linalg.norm(jacobian, axis=0)
    assert np.abs((found - x) * size).max() < 1e-5  # sigmas of an observation
    q = np.linalg.inv((jacobian / size).T @ (jacobian / size)) / size[:, None] / size
    # rays as in the file, control and photos in our order, offsets last
    rays = 2 * len(problem.photo)
    in_file = (2 * np.argsort(problem.source)[:, None] + np.arange(2)).ravel()
    return Both(ours, e, jacobian, q, np.concatenate((in_file, np.arange(rays, len(ours.tested)))))


@pytest.mark.parametrize("name", CASES)
def test_everything_is_as_in_a_dense_adjustment_without_any_of_our_code(name):
    found = both(name)
    ours, e, order = found.ours, found.e, found.order
    redundancy = len(e) - found.jacobian.shape[1]
    assert ours.redundancy == redundancy
    assert ours.vtpv == pytest.approx(float(e @ e), rel=1e-10)
    assert len(order) == len(e) == ours.problem.observations
    tested = ours.tested
    v = tested.residual[order] / ours.observations.sigma[order]
    np.testing.assert_allclose(v, e, atol=2e-7)
    np.testing.assert_allclose(tested.r[order], np.diag(found.whole), atol=1e-8)
    assert tested.r.sum() == pytest.approx(redundancy, abs=1e-8)
    rows = ours.photo_rows()
    s = np.concatenate(
        (
            np.ravel([row.s_position for row in rows]),
            np.ravel([row.s_angles for row in rows]),
            ours.sigma * np.sqrt(np.einsum("nii->ni", ours.cofactors.points)).ravel(),
            [row.s for row in offset_rows(ours)],
        )
    )
    np.testing.assert_allclose(s, ours.sigma * np.sqrt(np.diag(found.q)), rtol=1e-7)


@pytest.mark.parametrize("name", ["all free", "all weighted", "mixed"])
def test_the_search_for_errors_sees_the_same_matrix(name):
    found = both(name)
    ours, order = found.ours, found.order
    system = block_residuals(ours.problem, ours.state, ours.cofactors.normal.structure)
    whole = found.whole
    np.testing.assert_allclose(system.columns(order)[order], whole, atol=1e-7)
    np.testing.assert_allclose(system.r[order], np.diag(whole), atol=1e-8)
    np.testing.assert_allclose(system.e[order], -found.e, atol=1e-5)
    assert system.vtpv == pytest.approx(ours.vtpv, rel=1e-8)
    np.testing.assert_allclose(residuals_of(ours).e[order], -found.e, atol=2e-7)
    # its design has the unknowns of the offsets, and the same column space
    design = system.design().toarray()[order]
    assert design.shape == found.jacobian.shape
    np.testing.assert_allclose(whole @ design, 0.0, atol=1e-6 * np.abs(design).max())


@pytest.mark.parametrize("name", ["all free", "all weighted"])
def test_undetected_errors_do_what_the_dense_formula_says(name):
    found = both(name)
    ours = found.ours
    n, p = len(ours.problem.photos), len(ours.problem.points)
    gain = (found.q @ found.jacobian.T)[6 * n : 6 * n + 3 * p].reshape(p, 3, -1)
    r = np.diag(found.whole)
    external = external_reliability(ours)
    rays = 2 * len(ours.problem.photo)
    effects = [one for pair in external.rays for one in pair]
    effects += [*external.control, *external.priors]
    # control stands in the order of the file there, priors of photos and offsets in that of rows
    where = {name: k for k, name in enumerate(ours.problem.points)}
    known = sorted(where[row.point] for row in ours.problem.block.control)
    at = [*range(rays)]
    for row in ours.control_rows():
        at.append(rays + 3 * known.index(where[row.point]) + "XYZ".index(row.axis))
    at += range(rays + 3 * len(known), len(r))
    assert len(at) == len(effects) == len(r)
    compared = 0
    for row, effect in zip(at, effects, strict=True):
        if r[row] < 1e-3:
            continue
        moved = gain[:, :, row] * ours.test.delta0 / np.sqrt(r[row])
        length = np.linalg.norm(moved, axis=1).max()
        np.testing.assert_allclose(effect.effect_m, moved[where[effect.point]], atol=1e-5 * length)
        assert np.linalg.norm(effect.effect_m) == pytest.approx(length, rel=1e-5)
        compared += 1
    assert compared > 0.9 * len(r)


@pytest.mark.slow
def test_beside_parameters_and_conditions_redundancy_numbers_are_those_of_the_whole_design():
    block = flown(WEIGHTED, seed=4).scene.block
    at = {row.point: np.array(row.xyz) for row in block.control}
    length = float(np.linalg.norm(at["p1"] - at["p3"]))
    conditions = (ObjectCondition("distance", ("p1", "p3"), length + 0.02, 0.03, "control"),)
    block = replace(block, conditions=conditions)
    more = additional_parameters("ebner:strip", 10.0)
    for parameters in (more, additional_parameters("physical:photo", 5.0)):
        adjusted = adjust_block(block, additional=parameters)
        system = residuals_of(adjusted)
        whole = system.design().toarray()
        size = np.linalg.norm(whole, axis=0)
        u, s, _ = np.linalg.svd(whole[:, size > 0.0] / size[size > 0.0], full_matrices=False)
        u = u[:, s > 1e-11 * s[0]]
        dense = np.eye(len(whole)) - u @ u.T
        np.testing.assert_allclose(adjusted.tested.r, np.diag(dense), atol=2e-7)
        assert adjusted.tested.r.sum() == pytest.approx(adjusted.redundancy, abs=1e-6)
        some = np.arange(0, len(dense), 3)
        np.testing.assert_allclose(system.columns(some), dense[:, some], atol=2e-7)
        names = [row.key for row in adjusted.prior_rows()]
        assert ("prior", "s1", "drift Y") in names
        assert len(set(names)) == len(names)


def test_large_coordinates_cost_no_digits():
    near, away = (
        adjust_block(flown(EVERY, seed=5, far=far).scene.block)
        for far in ((0.0, 0.0, 0.0), (432_100.0, 5_234_000.0, 320.0))
    )
    assert away.vtpv == pytest.approx(near.vtpv, rel=1e-6)
    np.testing.assert_allclose(away.tested.r, near.tested.r, atol=1e-7)
    for a, b in zip(offset_rows(near), offset_rows(away), strict=True):
        assert b.value == pytest.approx(a.value, abs=1e-6 * a.s)
        assert b.s == pytest.approx(a.s, rel=1e-6)


def test_positions_that_are_far_off_by_the_same_change_the_shift_alone():
    block = flown(EVERY, seed=6).scene.block
    off = np.array([47.0, -120.0, 48.0])
    moved = tuple(
        replace(photo, position=tuple((np.array(photo.position) + off).tolist()))
        for photo in block.photos
    )
    before, after = adjust_block(block), adjust_block(replace(block, photos=moved))
    assert after.vtpv == pytest.approx(before.vtpv, rel=1e-8)
    for a, b in zip(offset_rows(before), offset_rows(after), strict=True):
        by = off["XYZ".index(a.axis)] if a.kind == "shift" else 0.0
        assert b.value - a.value == pytest.approx(by, abs=1e-5)


def test_without_noise_everything_is_found():
    made = flown(EVERY, seed=7, noise=0.0, length=5)
    adjusted = adjust_block(made.scene.block)
    assert adjusted.vtpv < 1e-12
    rows = {(row.kind, row.group, row.axis): row.value for row in offset_rows(adjusted)}
    assert rows.keys() == made.offsets.keys()
    for key, value in made.offsets.items():
        assert rows[key] == pytest.approx(value, abs=1e-8), key
    for row in adjusted.photo_rows():
        np.testing.assert_allclose(row.position, made.scene.centres[row.photo], atol=1e-6)
    # the arm the other way round is not the same
    camera = replace(made.scene.block.cameras[0], lever_arm=(-0.35, 0.6, 1.8))
    wrong = adjust_block(replace(made.scene.block, cameras=(camera,)))
    assert wrong.vtpv > 1.0


# --- what is not determined -----------------------------------------------------------------


def without_control(block, left=0):
    return replace(
        block,
        control=tuple(
            row if k < left else replace(row, use="check") for k, row in enumerate(block.control)
        ),
    )


@pytest.mark.parametrize(
    ("offsets", "words"),
    [
        (EVERY, "the shift in X, the shift in Y, the shift in Z; there is no control, and what "
         "photos state is only known but for the unknown shift, drift, boresight"),
        (PriorOffsets("block"), "but for the unknown shift"),
        (PriorOffsets("strip", "strip", shift_sigma=None), "but for the unknown shift, drift"),
    ],
)  # fmt: skip
def test_free_shifts_leave_the_datum_to_control(offsets, words):
    block = flown(offsets, seed=3).scene.block
    with pytest.raises(NotComputableError, match=words):
        adjust_block(without_control(block))
    problem = make_problem(without_control(block))
    assert not priors_hold(problem)
    # one control point holds what a shift leaves open: the angles do the rest
    adjusted = adjust_block(without_control(block, 1))
    assert adjusted.tested.r.sum() == pytest.approx(adjusted.redundancy, abs=1e-6)


def test_a_shift_with_a_standard_deviation_or_a_drift_alone_leaves_the_datum_to_the_positions():
    wide = replace(WEIGHTED, shift_sigma=(300.0, 300.0, 300.0))
    for offsets in (WEIGHTED, wide, PriorOffsets(drift="strip"), PriorOffsets()):
        block = replace(without_control(flown(offsets, seed=3).scene.block), offsets=offsets)
        adjusted = adjust_block(block)
        # 300 m against 0.05 m: seven digits of sixteen
        assert adjusted.tested.r.sum() == pytest.approx(adjusted.redundancy, abs=1e-5)
        assert priors_hold(make_problem(block)) == (offsets is not wide)


def test_positions_of_one_time_leave_a_drift_open():
    block = flown(PriorOffsets(), seed=3).scene.block
    still = replace(
        block,
        offsets=PriorOffsets(drift="block"),
        photos=tuple(replace(photo, time=1.0) for photo in block.photos),
    )
    with pytest.raises(
        NotComputableError, match=r"all of one time .photo '101', .*: give drift_sigma, or"
    ):
        adjust_block(still)
    known = replace(still, offsets=PriorOffsets(drift="block", drift_sigma=(1.0, 1.0, 1.0)))
    adjusted = adjust_block(known)
    rows = offset_rows(adjusted)
    assert [row.value for row in rows] == pytest.approx([0.0] * 3, abs=1e-12)
    assert [row.s for row in rows] == pytest.approx([adjusted.sigma] * 3)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda b: replace(b, photos=tuple(replace(p, position_sigma=None) for p in b.photos)),
         "no photo has a position_sigma: there is nothing that a shift could belong to"),
        (lambda b: replace(b, photos=tuple(replace(p, rotation_sigma=None) for p in b.photos)),
         "no photo has a rotation_sigma: there is nothing that a boresight could belong to"),
        (lambda b: replace(b, photos=(replace(b.photos[0], time=None), *b.photos[1:])),
         "photo 101 has no time, others of strip 's1' have one"),
        (lambda b: replace(b, offsets=replace(EVERY, shift_sigma=(1.0, 0.0, 1.0))),
         "the shift: its standard deviation 0 must be positive"),
        (lambda b: replace(b, strips=(replace(b.strips[0], photos=(*b.strips[0].photos,
                                                                  b.strips[1].photos[0])),
                                      b.strips[1])),
         "photo '204' is in strips 's1' and 's2': to which of them its shift belongs"),
        (lambda b: replace(b, strips=(replace(b.strips[0], id="(no strip)"),)),
         r"a strip is called '\(no strip\)', as are photos in none \('201'\): rename"),
    ],
)  # fmt: skip
def test_what_cannot_be_laid_out_is_said(change, words):
    with pytest.raises(InputError, match=words):
        adjust_block(change(flown(EVERY, seed=3).scene.block))


def with_sigma_of_first(block, sigma):
    first = replace(block.photos[0], position_sigma=(sigma, sigma, sigma))
    return replace(block, photos=(first, *block.photos[1:]))


def test_a_position_that_is_all_but_free_of_error_costs_the_offsets_no_digits():
    block = flown(EVERY, seed=3).scene.block
    near, exact = (adjust_block(with_sigma_of_first(block, sigma)) for sigma in (1e-3, 1e-5))
    for a, b in zip(offset_rows(near), offset_rows(exact), strict=True):
        assert b.value == pytest.approx(a.value, abs=1e-3 * a.s)
        # (1e-3 / 0.05)^2 is what their variances differ by
        assert b.s == pytest.approx(a.s, rel=1e-3)
    assert all(one.verdict is not None for one in offset_tests(exact).groups)


def test_positions_too_far_apart_in_weight_are_said_to_be_so():
    block = with_sigma_of_first(flown(EVERY, seed=3).scene.block, 1e-6)
    words = "shift of strip 's1': the standard deviation 1e-06 of photo '101' beside 0.05 of others"
    with pytest.raises(NotComputableError, match=words):
        adjust_block(block)
    # one that counts for nothing is no such thing
    away = adjust_block(with_sigma_of_first(block, 1e9))
    assert away.tested.r.sum() == pytest.approx(away.redundancy, abs=1e-6)


def test_what_offsets_cannot_be_laid_out_for_is_adjusted_without_them():
    block = replace(flown(PriorOffsets("strip"), seed=3).scene.block, offsets=None)
    first, second = block.strips
    both_strips = replace(first, photos=(*first.photos, second.photos[0]))
    for odd in (
        replace(block, strips=(both_strips, second)),
        with_sigma_of_first(block, 1e-6),
    ):
        assert [one.kind for one in offset_advice(adjust_block(odd))] in ([], ["boresight"])


def test_what_another_datum_leaves_out_is_told():
    block = flown(EVERY, seed=3).scene.block
    count = len(block.photos)
    words = f"not observed in this datum: {count} stated positions and {count} stated rotations"
    found = [adjust(block, datum=datum) for datum in ("free", "control")]
    free, held = (" ".join(page_text(one.document.page).split()) for one in found)
    assert words in free
    assert "not observed" not in held
    told = [[text for text in one.to_dict()["remarks"] if "not observed" in text] for one in found]
    assert len(told[0]) == 1
    assert told[0][0].startswith(words)
    assert told[1] == []


def test_angles_that_are_one_are_not_tested_together():
    adjusted = adjust_block(flown(WEIGHTED, seed=3).scene.block)
    own = adjusted.cofactors.offsets.own.copy()
    at = [k for k, row in enumerate(offset_rows(adjusted)) if row.kind == "boresight"]
    own[np.ix_(at, at)] = 1.0
    cofactors = adjusted.cofactors.offsets._replace(own=own)
    same = replace(adjusted, cofactors=replace(adjusted.cofactors, offsets=cofactors))
    found = {one.kind: one.verdict for one in offset_tests(same).groups}
    assert found["boresight"] is None
    assert found["shift"] is not None
    page = offsets_document(offset_tests(same))
    assert next(g for g in page.answer["groups"] if g["kind"] == "boresight")["verdict"] is None
    assert any("not testable" in str(line) for line in page.page)


def test_strips_without_positions_have_no_shift():
    block = flown(EVERY, seed=3).scene.block
    first = set(block.strips[0].photos)
    bare = replace(
        block,
        photos=tuple(
            photo if photo.id in first else replace(photo, position_sigma=None)
            for photo in block.photos
        ),
    )
    adjusted = adjust_block(bare)
    assert {row.group for row in offset_rows(adjusted)} == {"s1", "block"}
    assert adjusted.tested.r.sum() == pytest.approx(adjusted.redundancy, abs=1e-6)
    # a shift of which every position has gone is no unknown any more
    problem = make_problem(block)
    mine = np.array([name in first for name in problem.photos])
    gone = replace(problem, position_sigma=np.where(mine[:, None], problem.position_sigma, np.nan))
    same = adjust_problem(gone)
    assert same.redundancy == adjusted.redundancy
    assert same.vtpv == pytest.approx(adjusted.vtpv, rel=1e-8)
    assert [row.group for row in offset_rows(same)] == [r.group for r in offset_rows(adjusted)]
    np.testing.assert_allclose(same.tested.r, adjusted.tested.r, atol=1e-8)


def test_a_free_datum_observes_nothing_that_is_stated_and_has_no_offsets():
    block = flown(EVERY, seed=3).scene.block
    free = adjust_block(block, datum="free")
    assert offset_rows(free) == []
    assert offset_tests(free) is None


def test_epochs_in_one_adjustment_refuse_offsets():
    block = flown(EVERY, seed=3).scene.block
    with pytest.raises(InputError, match="--separate"):
        compare_epochs(block, block)


# --- errors and tests -----------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("strategy", ["baarda", "odds", "huber"])
def test_a_wrong_position_is_rejected_and_nothing_else(strategy):
    block = flown(EVERY, seed=3).scene.block
    x, y, z = next(photo.position for photo in block.photos if photo.id == "103")
    wrong = tuple(
        replace(photo, position=(x + 2.0, y, z)) if photo.id == "103" else photo
        for photo in block.photos
    )
    found = block_gross_errors(replace(block, photos=wrong), strategy)
    assert [row.name for row in found.rejected] == [("prior", "103", "X")]
    left = found.block
    assert left.redundancy == adjust_block(block).redundancy - 1
    assert left.tested.r.sum() == pytest.approx(left.redundancy, abs=1e-6)
    assert found.rejected[0].error == pytest.approx(2.0, abs=0.5)


def test_offsets_are_tested_with_the_sigma_of_the_block():
    adjusted = both("all free").ours
    found = offset_tests(adjusted)
    assert [one.row for one in found.single] == offset_rows(adjusted)
    for one in found.single:
        assert one.verdict.estimated.statistic == pytest.approx((one.row.value / one.row.s) ** 2)
        assert one.mdb > 3.0 * one.row.s
    shift = next(one for one in found.groups if (one.kind, one.group) == ("shift", "s1"))
    assert shift.verdict.rejected
    assert shift.verdict.decisive.dimension == 3
    # three together: the correlations count
    names = [(n.kind, n.group) for n in adjusted.problem.offsets.names]
    its = [k for k, name in enumerate(names) if name == ("shift", "s1")]
    q = adjusted.cofactors.offsets.own[np.ix_(its, its)]
    y = np.array([one.row.value for one in found.single])[its]
    square = float(y @ np.linalg.solve(q, y)) / 3.0 / adjusted.sigma0**2
    assert shift.verdict.estimated.statistic == pytest.approx(square)


def small(block):
    """The block with a shift of one strip of 0.2 m more, and a boresight of 0.6 mrad."""
    first = set(block.strips[0].photos)
    photos = []
    for photo in block.photos:
        shift = np.array([0.2, -0.1, 0.2]) * (photo.id in first)
        turned = rotation_matrix(*photo.rotation) @ rotation_matrix(6e-4, -6e-4, 8e-4)
        position = np.array(photo.position) + shift
        angles = rotation_angles(turned)
        photos.append(replace(photo, position=tuple(position.tolist()), rotation=angles))
    return replace(block, photos=tuple(photos))


def test_what_positions_and_angles_ask_for_is_advised():
    block = small(flown(PriorOffsets(), seed=8).scene.block)
    bare = adjust_block(block)
    advised = {one.kind: one for one in offset_advice(bare)}
    assert {kind: one.scope for kind, one in advised.items()} == {
        "shift": "strip", "boresight": "block",
    }  # fmt: skip
    assert [one.unknowns for one in advised.values()] == [6, 3]
    both_there = PriorOffsets("strip", boresight="block")
    least = adjust_block(replace(block, offsets=both_there)).vtpv
    for kind, other in (("shift", "boresight"), ("boresight", "shift")):
        without = replace(both_there, **{kind: None})
        alone = adjust_block(replace(block, offsets=without))
        assert getattr(alone.problem.block.offsets, other) is not None
        # to first order: what is there has moved the photos
        assert advised[kind].falls == pytest.approx(alone.vtpv - least, rel=0.02)
        assert advised[kind].vtpv == bare.vtpv
    assert offset_advice(alone) == []  # some are declared
    # without control the shift of all is the datum: angles alone can tell
    there = [one.kind for one in offset_advice(adjust_block(without_control(block)))]
    assert there == ["boresight"]
    assert offset_advice(adjust_block(block, datum="free")) == []


@pytest.mark.slow
def test_what_a_search_takes_apart_is_asked_whole():
    # it rejects heights of control, or of positions, one by one, and nothing is left to tell
    block = flown(PriorOffsets(), seed=8, angles=False).scene.block
    up = tuple(
        replace(photo, position=(*photo.position[:2], photo.position[2] + 30.0))
        for photo in block.photos
    )
    found = block_gross_errors(replace(block, photos=up), "search")
    rejected = [one.name for one in found.rejected]
    assert len({name[0] for name in rejected if name[-1] == "Z"} & {"control", "prior"}) == 1
    assert offset_advice(found.block) == []
    (advised,) = offset_advice(found.block, rejected)
    assert advised.kind == "shift"


def test_nothing_is_adjusted_again_where_nothing_is_stated(monkeypatch):
    block = flown(PriorOffsets(), seed=8, angles=False).scene.block
    bare = tuple(replace(photo, position=None, position_sigma=None) for photo in block.photos)
    found = adjust_block(replace(block, photos=bare))
    rejected = [("control", row.point, "Z") for row in block.control[:3]]

    def again(*_):
        raise AssertionError

    monkeypatch.setattr(offsetadvice, "adjust_onward", again)
    assert offset_advice(found, rejected) == []


def test_where_one_observation_explains_more_no_offset_is_advised():
    block = flown(PriorOffsets(), seed=8, angles=False).scene.block
    first, *others = block.control
    wrong = replace(first, xyz=(*first.xyz[:2], first.xyz[2] + 50.0))
    found = adjust_block(replace(block, control=(wrong, *others)))
    assert found.flagged_observations()[0][1:] == (f"Z of control point {first.point}", "control")
    assert offset_advice(found) == []


@pytest.mark.slow
def test_good_positions_and_angles_ask_for_nothing():
    # alpha .001 of two tests a block: more than two of 60 have a probability of .0003
    found = sum(
        len(offset_advice(adjust_block(flown(PriorOffsets(), seed=seed).scene.block)))
        for seed in range(30)
    )
    assert found <= 2
