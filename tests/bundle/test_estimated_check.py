"""Check points are control that is held back: they err as control was seen to err, if it was."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bundleblocks import aerial

import anaplot
from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.hypotheses.checktests import check_tests
from anaplot.bundle.hypotheses.components import block_components
from anaplot.bundle.hypotheses.controlpages import control_pages
from anaplot.bundle.hypotheses.doming import doming
from anaplot.bundle.hypotheses.priorknowledge import prior_estimate
from anaplot.bundle.solve.estimatedfactors import EstimatedFactors
from anaplot.photogrammetry.block import Block, ControlPoint
from anaplot.photogrammetry.camera import BrownLens
from anaplot.report.astext import page_text
from anaplot.report.document import Line
from anaplot.report.html.sections.givenpoints import given_points_section

SIGMA = 0.05  # m, as stated
AS_STATED = "check points are taken to err as stated: no variance of control was estimated"


def given(seed: int, *, few: bool = False) -> Block:
    """Ten points of control, or three, and five check points, eight times as bad as they say."""
    scene = aerial(3, 5, relief=30.0, noise_um=5.0, seed=seed, tilt=0.03)
    rng = np.random.default_rng(seed)
    names = list(scene.points)[::2]
    use = {name: "control" if k % 3 else "check" for k, name in enumerate(names)}
    if few:
        use |= dict.fromkeys(names, "check") | dict.fromkeys(
            (names[0], names[4], names[-1]), "control"
        )
    rows = tuple(
        ControlPoint(
            name,
            tuple((scene.points[name] + rng.normal(0.0, 8.0 * SIGMA, 3)).tolist()),
            (SIGMA,) * 3,
            use[name],
        )
        for name in names
    )
    return replace(scene.block, control=rows)


@pytest.mark.parametrize("kind", ["tau", "baarda"])
def test_check_points_have_the_factor_of_control_and_its_degrees(kind: str) -> None:
    block = given(0)
    stated = adjust_block(replace(block, test=replace(block.test, kind=kind)))
    before = check_tests(stated)
    assert before.sigma_factor == 1.0
    assert all(one.s_given == pytest.approx(SIGMA) for one in before.coordinates)
    assert before.groups[0].verdict.rejected
    assert before.remarks == ()
    found = prior_estimate(stated, "separate")
    after = check_tests(found.block)
    assert 4.0 < after.sigma_factor == pytest.approx(np.sqrt(found.prior.factor), rel=1e-5)
    for one in after.coordinates:
        assert one.s_given == pytest.approx(after.sigma_factor * SIGMA)
        assert one.s == pytest.approx(np.hypot(one.s_block, one.s_given))
    # the estimate has hardly more degrees of freedom than control has redundancy
    test = after.groups[0].verdict.decisive
    assert 0.5 * found.prior.redundancy < test.redundancy < 2.0 * found.prior.redundancy
    assert test.sigma == pytest.approx(1.0, abs=1e-4)
    assert not test.rejected
    [remark] = after.remarks
    assert f"err {after.sigma_factor:.3g} times as much as stated, as control does" in remark
    # the same by the components of all kinds; there positions and angles would be others
    parted = check_tests(block_components(stated, "kinds").block)
    assert parted.sigma_factor == pytest.approx(after.sigma_factor, rel=1e-3)


@pytest.mark.slow
def test_control_of_which_nothing_is_estimated_leaves_check_points_as_stated() -> None:
    held = prior_estimate(adjust_block(given(1, few=True)), "separate")
    assert held.prior.interval is None
    free = given(0)
    rows = tuple(
        replace(row, sigma=(0.0,) * 3) if row.use == "control" else row for row in free.control
    )
    centres = {row.photo: row.position for row in adjust_block(free).photo_rows()}
    photos = tuple(
        replace(photo, position=tuple(centres[photo.id]), position_sigma=(1.0,) * 3)
        for photo in free.photos
    )
    fixed = prior_estimate(adjust_block(replace(free, control=rows, photos=photos)), "separate")
    for block in (held.block, fixed.block):
        found = check_tests(block)
        assert found.sigma_factor == 1.0
        assert all(one.s_given == pytest.approx(SIGMA) for one in found.coordinates)
        assert found.remarks == (AS_STATED,)
    # an estimate of nothing is held where that showed: it says nothing of others
    assert EstimatedFactors(control=0.01).check == 1.0


@pytest.mark.parametrize("estimator", ["known", "common"])
def test_where_variances_are_known_but_for_one_factor_nothing_is_said(estimator: str) -> None:
    stated = adjust_block(given(0))
    found = check_tests(prior_estimate(stated, estimator).block)
    assert found.sigma_factor == 1.0
    assert found.remarks == ()
    for one, other in zip(found.coordinates, check_tests(stated).coordinates, strict=True):
        assert one.s == pytest.approx(other.s, rel=1e-6)


@pytest.mark.slow
def test_as_many_are_rejected_as_by_chance() -> None:
    # alpha .05: more than 9 of 60 have a probability of .0007; as stated all 60 are
    found = [
        check_tests(prior_estimate(adjust_block(given(seed)), "separate").block)
        for seed in range(60)
    ]
    assert sum(bool(one.groups[0].verdict.rejected) for one in found) <= 9
    assert sum(any(row.verdict.rejected for row in one.coordinates) for one in found) <= 9


def test_pages_of_control_and_bent_heights_take_the_same() -> None:
    block = given(0)
    cameras = tuple(replace(one, lens=BrownLens(k1=1e-9)) for one in block.cameras)
    adjusted = prior_estimate(adjust_block(replace(block, cameras=cameras)), "separate").block
    tests = check_tests(adjusted)
    at = {(one.point, one.axis): one for one in tests.coordinates}
    pages = [page for page in control_pages(adjusted) if page.use == "check"]
    assert len(pages) == 5
    for page in pages:
        its = [adjusted.sigma * at[page.point, axis].s for axis in "XYZ"]
        assert list(page.s) == pytest.approx(its)
        # along the worst direction of the plan, as large as along its axes at least
        largest = max(at[page.point, axis].mdb for axis in "XY")
        assert largest <= page.plan.detectable < 2.0 * largest
    control, check = doming(adjusted).differences
    assert (control.use, check.use) == ("control", "check")
    assert check.given == pytest.approx(tests.sigma_factor * SIGMA)
    assert control.given == pytest.approx(tests.sigma_factor * SIGMA)


def test_all_that_is_written_says_which_is_taken() -> None:
    block = given(0)
    for prior, factor in ((None, 1.0), ("separate", 7.7)):
        result = anaplot.adjust(block, prior=prior)
        check = result.to_dict()["hypotheses"]["check"]
        assert check["sigma_factor"] == pytest.approx(factor, abs=0.05)
        words = f"check points are taken to err {factor} times as much as stated, as control does"
        assert (words in " ".join(result.text().split())) == (prior is not None)
        page = given_points_section(result.document.answer)
        told = f"Of check points s has {factor} times the standard deviation that is stated"
        lines = page_text([one for one in page.blocks if isinstance(one, Line)])
        assert (told in " ".join(lines.split())) == (prior is not None)
