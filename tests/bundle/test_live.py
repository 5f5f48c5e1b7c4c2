"""The live block: same answers as from nothing, after models, photos and re-measurements."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from bundleblocks import aerial
from growing import added, flagged, remeasured, removed

from anaplot.bundle import live as live_module
from anaplot.bundle.adjust import adjust_block, adjust_problem
from anaplot.bundle.live import LiveAnswer, LiveBlock
from anaplot.bundle.solve.additional import additional_parameters
from anaplot.bundle.solve.structure import Structure
from anaplot.errors import InputError, NotComputableError
from anaplot.photogrammetry.block import Block, Strip


def agree(first, second) -> None:
    assert first.redundancy == second.redundancy
    assert first.sigma0 == pytest.approx(second.sigma0, rel=1e-6)
    rows = {(r.photo, r.point, r.model): r for r in first.ray_rows()}
    for other in second.ray_rows():
        row = rows[other.photo, other.point, other.model]
        for mine, its in zip(row.xy, other.xy, strict=True):
            assert mine.residual == pytest.approx(its.residual, abs=1e-3)
            assert mine.r == pytest.approx(its.r, abs=1e-6)


def structure(answer: LiveAnswer) -> Structure:
    """That of the equations: the same one where only coordinates have changed."""
    return answer.adjusted.cofactors.normal.structure


@pytest.mark.slow
def test_a_block_grows_photo_by_photo() -> None:
    scene = aerial(2, 4, per_base=2, noise_um=5.0)
    whole = scene.block
    live = LiveBlock(replace(whole, image_points=(), control=()))
    with pytest.raises((InputError, NotComputableError)):
        live.update(live.block)
    order = [p.id for p in whole.photos]
    for count in range(2, len(order) + 1):
        rows = [r for r in whole.image_points if r.photo in order[:count]]
        answer = added(live, rows)
        assert answer.datum == "free"
        fresh = adjust_block(replace(whole, image_points=tuple(rows), control=()), datum="free")
        if not answer.aside:
            agree(answer.adjusted, fresh)
    answer = live.update(replace(live.block, control=whole.control))
    assert answer.datum == "control"
    agree(answer.adjusted, adjust_block(whole))


def test_a_wrong_ray_is_accused_remeasured_and_forgotten() -> None:
    scene = aerial(2, 4, per_base=2, noise_um=5.0, seed=6)
    rows = list(scene.block.image_points)
    at = next(k for k, r in enumerate(rows) if r.photo == "102" and abs(r.x) < 12 and abs(r.y) < 12)
    good = rows[at]
    rows[at] = replace(good, x=good.x + 0.2)
    live = LiveBlock(replace(scene.block, image_points=tuple(rows)))
    answer = live.update(live.block)
    assert (good.photo, good.point, "x") in flagged(answer)
    worst = answer.suspect_rays[good.point][0]
    assert worst.photo == "102"
    assert worst.probability > 0.9
    assert sum(ray.probability for ray in answer.suspect_rays[good.point]) == pytest.approx(1.0)
    before = structure(answer)
    answer = remeasured(live, good, good.x, good.y)
    assert structure(answer) is before
    assert (good.photo, good.point, "x") not in flagged(answer)
    assert good.point not in answer.suspect_rays
    agree(answer.adjusted, adjust_block(scene.block))
    # what was measured long ago and spoilt now shows up by name
    old = rows[0]
    answer = remeasured(live, old, old.x, old.y + 0.3)
    assert any(point == old.point for _, point, _ in flagged(answer))
    answer = removed(live, old)
    assert structure(answer) is not before
    assert all(point != old.point for _, point, _ in flagged(answer))


@pytest.mark.parametrize("named", [None, "ebner"])
def test_parts_that_do_not_hang_together_wait_aside(named: str | None) -> None:
    scene = aerial(2, 4, per_base=2, noise_um=5.0)
    rows = tuple(r for r in scene.block.image_points if r.photo in ("101", "102", "203", "204"))
    names = {r.point: {q.photo for q in rows if q.point == r.point} for r in rows}
    rows = tuple(
        r for r in rows if not (names[r.point] & {"101", "102"} and names[r.point] & {"203", "204"})
    )
    rows = tuple(r for r in rows if r.photo != "204" or r.point != rows[-1].point)
    additional = None if named is None else additional_parameters(named, 10.0)
    live = LiveBlock(replace(scene.block, image_points=rows, control=()), additional=additional)
    answer = live.update(live.block)
    assert answer.adjusted.state.shared.size == (12 if named == "ebner" else 0)
    assert set(answer.aside) in ({"101", "102"}, {"203", "204"})
    assert len(answer.adjusted.photo_rows()) == 2


def test_a_strip_that_may_turn_about_two_points_waits_aside() -> None:
    """Nothing was determined then, and the page of the block empty."""
    scene = aerial(2, 3, per_base=2, noise_um=5.0)
    strips = (Strip("1", ("101", "102", "103")), Strip("2", ("201", "202", "203")))
    of = {name: strip.id for strip in strips for name in strip.photos}
    both = [
        point
        for point in dict.fromkeys(row.point for row in scene.block.image_points)
        if {of[row.photo] for row in scene.block.image_points if row.point == point} == {"1", "2"}
    ]
    assert len(both) > 5

    def joined_by(points) -> Block:
        own = {p for p in both if p not in points}
        rows = tuple(
            replace(r, point=f"{r.point}-{of[r.photo]}") if r.point in own else r
            for r in scene.block.image_points
        )
        return replace(scene.block, strips=strips, image_points=rows, control=())

    two, three = joined_by((both[0], both[-1])), joined_by((both[0], both[2], both[-1]))
    with pytest.raises(NotComputableError, match="leave a movement open"):
        adjust_block(two, datum="free")
    live = LiveBlock(two)
    answer = live.update(two)
    assert set(answer.aside) in ({"101", "102", "103"}, {"201", "202", "203"})
    assert len(answer.adjusted.photo_rows()) == 3
    answer = live.update(three)
    assert answer.aside == ()
    agree(answer.adjusted, adjust_block(three, datum="free"))
    # what says where the other strip lies is not waited for
    held = live.update(replace(two, control=scene.block.control))
    assert (held.datum, held.aside) == ("control", ())


def test_errors_leave_the_last_answer() -> None:
    scene = aerial(1, 3, per_base=2, noise_um=5.0)
    live = LiveBlock(scene.block)
    answer = live.update(scene.block)

    class Stop(Exception):
        pass

    def stop(what: str, fraction: float) -> None:
        raise Stop

    row = scene.block.image_points[0]
    with pytest.raises(Stop):
        remeasured(live, row, row.x, row.y + 0.01, progress=stop)
    assert live.answer is answer
    again = remeasured(live, row, row.x, row.y)
    np.testing.assert_allclose(again.adjusted.v, answer.adjusted.v, atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("named", ["ebner", "physical"])
def test_additional_parameters_stay_with_a_growing_block(named: str) -> None:
    scene = aerial(2, 4, per_base=2, noise_um=5.0, control_sigma=0.05)
    additional = additional_parameters(named, 10.0)
    whole = scene.block
    first = tuple(r for r in whole.image_points if r.photo not in ("104", "204"))
    live = LiveBlock(replace(whole, image_points=first), additional=additional)

    def same(answer) -> None:
        fresh = adjust_block(live.block, additional=additional)
        agree(answer.adjusted, fresh)
        assert fresh.state.shared.size > 0
        np.testing.assert_allclose(
            answer.adjusted.state.shared, fresh.state.shared, atol=1e-6 * 10.0
        )

    same(live.update(live.block))
    answer = added(live, (r for r in whole.image_points if r not in set(first)))
    assert answer.datum == "control"
    same(answer)
    # where only a coordinate changes, what the parameters do there changes too
    row = whole.image_points[3]
    same(remeasured(live, row, row.x + 0.02, row.y))
    same(removed(live, row))
    # without control: in the free network they stay as well
    free = live.update(replace(live.block, control=()))
    assert free.datum == "free"
    agree(free.adjusted, adjust_block(live.block, datum="free", additional=additional))


def test_without_enough_control_no_datum_but_the_free_one_is_tried(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    scene = aerial(2, 4, per_base=2, noise_um=5.0)
    asked: list[str] = []

    def adjusted(problem, **kwargs):
        asked.append(problem.datum)
        return adjust_problem(problem, **kwargs)

    monkeypatch.setattr(live_module, "adjust_problem", adjusted)
    for control in ((), scene.block.control[:2]):
        block = replace(scene.block, control=control)
        answer = LiveBlock(block).update(block)
        assert answer.datum == "free"
        agree(answer.adjusted, adjust_block(block, datum="free"))
    assert asked == ["free", "free"]
    # where nothing can be adjusted it is the datum that is said to be missing
    rows = tuple(r for r in scene.block.image_points if r.photo == "101")
    alone = replace(scene.block, control=(), image_points=rows)
    with pytest.raises((InputError, NotComputableError)) as told:
        LiveBlock(alone).update(alone)
    with pytest.raises((InputError, NotComputableError)) as by_control:
        adjust_block(alone)
    assert str(told.value) == str(by_control.value)


def test_what_took_no_part_and_is_measured_again_is_looked_at_anew() -> None:
    scene = aerial(2, 3, relief=30.0, noise_um=5.0, seed=1, tilt=0.05)
    rows = list(scene.block.image_points)
    count = Counter(row.point for row in rows)
    at = next(k for k, row in enumerate(rows) if count[row.point] >= 4)
    rows[at] = replace(rows[at], use="off")
    live = LiveBlock(replace(scene.block, image_points=tuple(rows)))
    before = live.update(live.block).adjusted.off_rays()
    rows[at] = replace(rows[at], x=rows[at].x + 0.1)
    after = live.update(replace(live.block, image_points=tuple(rows))).adjusted.off_rays()
    assert after.keys() == before.keys() == {at}
    assert after[at][0] - before[at][0] == pytest.approx(-100.0, abs=1e-6)


def test_a_point_that_was_left_out_comes_in_when_its_rays_meet() -> None:
    scene = aerial(
        2, 3, relief=30.0, control_sigma=0.05, noise_um=5.0, seed=1, tilt=0.05, per_base=2
    )
    held = {row.point for row in scene.block.control}
    count = Counter(row.point for row in scene.block.image_points)
    point = next(name for name, n in count.items() if n >= 3 and name not in held)
    mine = [row for row in scene.block.image_points if row.point == point][:2]
    others = [row for row in scene.block.image_points if row.point != point]
    half = replace(mine[1], use="x")
    behind = replace(half, x=half.x + 150.0)
    first = replace(scene.block, image_points=(*others, mine[0], behind))
    live = LiveBlock(first)
    left_out = live.update(first).adjusted.problem.left_out
    assert [one.name for one in left_out] == [point]
    right = replace(first, image_points=(*others, mine[0], half))
    answer = live.update(right)
    assert point in answer.adjusted.problem.points
    agree(answer.adjusted, adjust_block(right))
