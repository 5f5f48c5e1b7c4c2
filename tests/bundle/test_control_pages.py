"""A page for a control point says what the block would be without it: adjusted again, it is so."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bundleblocks import aerial

from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.hypotheses.checktests import check_tests
from anaplot.bundle.hypotheses.controlpages import ControlPage, control_pages
from anaplot.bundle.hypotheses.errorsets import ErrorSet, error_set_tests
from anaplot.bundle.hypotheses.verdict import HypothesisSettings
from anaplot.bundle.solve.crosscofactors import coordinate_cofactors
from anaplot.photogrammetry.block import Block
from anaplot.report.adjustcommand import adjust
from anaplot.report.astext import page_text
from anaplot.report.controlpages import control_pages_document


@pytest.fixture(scope="module")
def block() -> Block:
    # sigmas of control in metres at a flying height of 1000 m, and errors of that size
    found = aerial(noise_um=5.0).block
    rng = np.random.default_rng(11)
    control = tuple(
        replace(
            row,
            xyz=tuple((np.array(row.xyz) + rng.normal(0.0, 0.02, 3)).tolist()),
            sigma=(0.02, 0.02, 0.03),
            use="control",
        )
        for row in found.control
    )
    return replace(found, control=control)


def _pages(block: Block) -> dict[str, ControlPage]:
    return {page.point: page for page in control_pages(adjust_block(block))}


def _as(block: Block, point: str, use: str) -> Block:
    control = tuple(
        replace(row, use=use) if row.point == point else row  # type: ignore[arg-type]
        for row in block.control
    )
    return replace(block, control=control)


@pytest.mark.slow
def test_without_a_point_is_the_adjustment_without_it(block: Block) -> None:
    pages = _pages(block)
    before = {row.point: np.array(row.xyz) for row in adjust_block(block).point_rows()}
    assert len(pages) == len(block.control)
    for name, page in list(pages.items())[:3]:
        assert page.without is not None
        other = adjust_block(_as(block, name, "check"))
        (difference,) = [found for point, found in other.check_rows() if point == name]
        assert np.array(page.without.difference) == pytest.approx(np.array(difference), rel=1e-3)
        moved = {row.point: np.array(row.xyz) - before[row.point] for row in other.point_rows()}
        del moved[name]
        farthest = max(moved, key=lambda point: float(np.linalg.norm(moved[point])))
        assert page.without.farthest is not None
        assert page.without.farthest.point == farthest
        assert np.array(page.without.farthest.by) == pytest.approx(moved[farthest], rel=2e-2)
        up = np.array([by[2] for by in moved.values()])
        assert page.without.heights[1] == pytest.approx(np.sqrt((up**2).mean()), rel=2e-2)
        # the standard deviations of the difference, of both, as the check point has them
        then = {one.point: one for one in control_pages(other)}[name]
        sigma = adjust_block(block).sigma
        assert sigma is not None
        assert other.sigma is not None
        assert np.array(page.without.s) / sigma == pytest.approx(
            np.array(then.s) / other.sigma, rel=1e-2
        )


def test_parts_are_those_of_the_sets(block: Block) -> None:
    adjusted = adjust_block(block)
    page = control_pages(adjusted)[0]
    rows = [row for row in adjusted.control_rows() if row.key[1] == page.point]
    (found,) = error_set_tests(adjusted, [ErrorSet("plan", tuple(row.key for row in rows[:2]))])
    assert page.plan is not None
    assert page.height is not None
    assert page.plan.r == pytest.approx((rows[0].r + rows[1].r) / 2)
    assert page.height.r == pytest.approx(rows[2].r)
    assert page.plan.detectable == pytest.approx(
        np.hypot(*[one.worst for one in found.errors])  # type: ignore[arg-type]
    )
    # the worst direction is no better than either axis alone
    assert page.plan.detectable > max(row.mdb or 0.0 for row in rows[:2]) * 0.99
    assert page.plan.effect is not None


def test_the_worst_direction_in_plan_is_that_of_the_longest_error(block: Block) -> None:
    control = tuple(replace(row, sigma=(0.01, 0.04, 0.03)) for row in block.control)
    adjusted = adjust_block(replace(block, control=control))
    page = control_pages(adjusted)[0]
    rows = [row for row in adjusted.control_rows() if row.key[1] == page.point][:2]
    keys = tuple(row.key for row in rows)
    sets = [
        ErrorSet(f"{k}", keys, (float(np.cos(u)), float(np.sin(u))))
        for k, u in enumerate(np.linspace(0.0, np.pi, 721))
    ]
    (free,) = error_set_tests(adjusted, [ErrorSet("plan", keys)])
    longest = 0.0
    for found in error_set_tests(adjusted, sets):
        # along a direction by itself, at the noncentrality of both coordinates together
        root = np.sqrt(free.noncentrality / found.noncentrality)
        longest = max(longest, root * float(np.hypot(*[one.worst for one in found.errors])))
    assert page.plan is not None
    assert page.plan.detectable == pytest.approx(longest, rel=1e-4)
    assert page.plan.detectable > max(row.mdb or 0.0 for row in rows)
    # in standard deviations another direction is the worst
    assert longest > 1.05 * float(np.hypot(*[one.worst for one in free.errors]))


def test_a_wrong_point_is_looked_at_and_weak_ones_are_named(block: Block) -> None:
    first = block.control[0]
    x, y, z = first.xyz
    assert z is not None
    wrong = replace(first, xyz=(x, y, z + 1.0))
    pages = _pages(replace(block, control=(wrong, *block.control[1:])))
    assert pages[first.point].verdict == "look"
    without = pages[first.point].without
    assert without is not None
    assert without.difference[2] == pytest.approx(-1.0, abs=0.1)
    # three points hold seven of a datum's parameters with nine coordinates
    few = tuple(replace(row, sigma=(1e-4,) * 3) for row in block.control[:3])
    left = tuple(replace(row, use="off") for row in block.control[3:])
    held = _pages(replace(block, control=(*few, *left)))
    assert {page.verdict for page in held.values()} <= {"weak", "unchecked"}
    assert all(page.without is None or page.verdict == "weak" for page in held.values())
    bare = [page for page in held.values() if page.without is None]
    assert bare
    text = page_text(control_pages_document(bare).page)
    assert text.count("without it the block, or the point itself, is not determined") == len(bare)


def test_fixed_and_check_points_have_pages(block: Block) -> None:
    first, second, third, *others = block.control
    mixed = (
        replace(first, sigma=(0.0, 0.0, 0.0)), replace(second, use="check"),
        replace(third, xyz=(third.xyz[0], third.xyz[1], None)), *others,
    )  # fmt: skip
    pages = _pages(replace(block, control=mixed))
    assert pages[first.point].use == "fixed"
    assert pages[first.point].without is None
    check = pages[second.point]
    assert check.use == "check"
    assert check.height is not None
    assert check.height.detectable is not None
    assert check.height.r is None
    assert all(value is not None for value in check.difference)
    assert pages[third.point].height is None
    without = pages[third.point].without
    assert without is not None
    assert without.difference[2] is None


def _stated(block: Block, name: str, sigma: float, *, higher: float = 0.0) -> Block:
    control = tuple(
        replace(row, sigma=(sigma,) * 3, xyz=(*row.xyz[:2], (row.xyz[2] or 0.0) + higher))
        if row.point == name
        else row
        for row in block.control
    )
    return replace(block, control=control)


def test_control_free_of_error_is_checked_by_the_photographs(block: Block) -> None:
    """An error of any size stayed unseen, the page said, in what it tested elsewhere."""
    name = block.control[0].point
    page = _pages(_stated(block, name, 0.0))[name]
    assert page.use == "fixed"
    assert page.plan is not None
    assert page.height is not None
    assert page.plan.r is page.height.r is page.plan.effect is None
    # where ever smaller sigmas lead
    near = _pages(_stated(block, name, 1e-5))[name]
    assert near.plan is not None
    assert near.height is not None
    assert page.plan.detectable == pytest.approx(near.plan.detectable, rel=1e-3)
    assert page.height.detectable == pytest.approx(near.height.detectable, rel=1e-3)
    assert page.verdict == near.verdict == "weak"
    # an error of that size and more is found
    size = page.height.detectable
    assert size is not None
    assert _pages(_stated(block, name, 0.0, higher=2.0 * size))[name].verdict == "look"
    text = page_text(control_pages_document([page]).page)
    assert "control, free of error" in text
    assert "stays unseen" not in text
    # two points and a height, all of them free of error, are checked by nothing
    here, there = block.control[0], block.control[-1]
    beside = max(block.control, key=lambda row: _off_line(row.xyz, here.xyz, there.xyz))
    least = tuple(replace(row, sigma=(0.0,) * 3) for row in (here, there))
    third = replace(beside, sigma=(0.0,) * 3, xyz=(None, None, beside.xyz[2]))
    held = _pages(replace(block, control=(*least, third)))
    assert {one.verdict for one in held.values()} == {"unchecked"}
    assert held[beside.point].height is not None
    assert held[beside.point].height.detectable is None


def _off_line(xyz, one, other) -> float:  # type: ignore[no-untyped-def]
    """Return how far a place lies beside the line through two others, in plan."""
    (x, y), (dx, dy) = np.subtract(xyz[:2], one[:2]), np.subtract(other[:2], one[:2])
    return float(abs(x * dy - y * dx))


def test_a_check_point_in_plan_is_found_from_along_its_worst_direction(block: Block) -> None:
    name = block.control[1].point
    adjusted = adjust_block(_as(block, name, "check"))
    page = {one.point: one for one in control_pages(adjusted)}[name]
    test = adjusted.problem.test
    tests = check_tests(adjusted, HypothesisSettings(test.alpha, test.power))
    assert tests is not None
    of = {one.axis: one for one in tests.coordinates if one.point == name}
    assert page.plan is not None
    assert page.plan.detectable is not None
    # both covariances, along every degree; of the test that finds one.mdb of one.s
    at = adjusted.problem.points.index(name)
    q = coordinate_cofactors(adjusted, [(at, 0), (at, 1)]) + np.diag([0.02**2] * 2)
    angles = np.radians(np.arange(0.0, 180.0, 0.1))
    along = np.stack((np.cos(angles), np.sin(angles)))
    worst = np.sqrt(np.einsum("ik,ij,jk->k", along, q, along).max())
    assert page.plan.detectable == pytest.approx(worst * of["X"].mdb / of["X"].s, rel=1e-5)
    assert page.plan.detectable > max(of["X"].mdb, of["Y"].mdb) * (1.0 + 1e-6)


def test_without_what_is_no_observation_nothing_is_given_up(block: Block) -> None:
    first, *others = block.control
    mixed = replace(block, control=(replace(first, sigma=(0.0, 0.02, 0.03)), *others))
    pages = _pages(mixed)
    without = pages[first.point].without
    assert without is not None
    assert without.held == ("X",)
    assert without.difference[0] is None
    assert {page.without.held for page in pages.values() if page.without} == {("X",), ()}
    document = control_pages_document(list(pages.values()))
    assert page_text(document.page).count("without its Y, Z (X stays held) off by Y ") == 1
    assert document.answer[0]["without"]["held"] == ["X"]
    # it is the adjustment with X alone
    alone = replace(first, xyz=(first.xyz[0], None, None), sigma=(0.0, None, None))
    other = adjust_block(replace(mixed, control=(alone, *others)))
    (at,) = [np.array(row.xyz) for row in other.point_rows() if row.point == first.point]
    assert without.difference[1:] == pytest.approx((at - first.xyz)[1:], rel=1e-2)


def test_a_free_network_has_none(block: Block) -> None:
    assert control_pages(adjust_block(block, datum="free")) == ()


def test_the_library_and_the_page_say_the_same(block: Block) -> None:
    found = adjust(block, control_page=True)
    pages = found.result.control_pages
    assert pages is not None
    answer = found.to_dict()["control_pages"]
    assert [one["point"] for one in answer] == [page.point for page in pages]
    assert answer[0]["plan"]["mdb"] == pages[0].plan.detectable  # type: ignore[union-attr]
    text = str(found)
    assert "CONTROL AND CHECK POINTS" in text
    assert f"{pages[0].point}  control, {len(pages[0].rays)} images: " in text
    assert adjust(block).result.control_pages is None


@pytest.mark.slow
def test_what_was_rejected_is_named(block: Block) -> None:
    first, *others = block.control
    x, y, z = first.xyz
    assert x is not None
    assert y is not None
    assert z is not None
    wrong = replace(first, xyz=(x + 5.0, y + 4.0, z + 6.0))
    found = adjust(replace(block, control=(wrong, *others)), errors="odds", control_page=True)
    gone = {row.name[2] for row in found.result.rejected if row.name[0] == "control"}
    assert gone
    pages = found.result.control_pages
    assert pages is not None
    assert set(pages[0].rejected) == gone
    assert pages[0].verdict == "look"
    assert not any(page.rejected for page in pages[1:])
    assert "rejected" in str(found)
