"""A block with fewer tie points: nothing below the limit, nothing more that could go."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bundleblocks import aerial
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse.csgraph import connected_components

from anaplot.adjustment.watch import Watch
from anaplot.aliases import Bools
from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.errors.grosserrors import block_gross_errors
from anaplot.bundle.solve.additional import AdditionalParameters, ebner
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.gaussnewton import equations_at
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.problem import Problem, make_problem
from anaplot.bundle.solve.reliability import compute_cofactors
from anaplot.bundle.solve.structure import make_structure
from anaplot.bundle.thinning.accuracy import deviations
from anaplot.bundle.thinning.imageparts import image_parts
from anaplot.bundle.thinning.keeping import keeping
from anaplot.bundle.thinning.losses import Losses
from anaplot.bundle.thinning.thinned import Thinned, block_without, bundle_without, thinned_at
from anaplot.bundle.thinning.thinning import Thinning, thin_block
from anaplot.errors import NotComputableError
from anaplot.photogrammetry.block import Block
from anaplot.photogrammetry.objectconditions import ObjectCondition


def dense(seed: int = 1, strips: int = 2, length: int = 4, per_base: int = 3) -> Block:
    return aerial(
        strips, length, per_base=per_base, seed=seed, noise_um=5.0, tilt=0.05, control_sigma=0.05
    ).block


def whole(block: AdjustedBlock) -> Thinned:
    problem = block.problem
    rays, points = np.arange(len(problem.photo)), np.arange(len(problem.points))
    return Thinned(block.cofactors, block.state, rays, points, block.cofactors.r)


def means_of(block: AdjustedBlock) -> dict[tuple[str, int], float]:
    """Mean redundancy number of every photo and region, by hand from the rows."""
    problem, parts = block.problem, image_parts(block.problem)
    found: dict[tuple[str, int], list[float]] = {}
    for ray, photo in enumerate(problem.photo.tolist()):
        cell = int(parts.cell[parts.region[ray]])
        for axis in range(2):
            if not block.rejected[ray, axis]:
                for key in (-1, cell):
                    of = found.setdefault((problem.photos[photo], key), [])
                    of.append(float(block.cofactors.r[ray, axis]))
    return {key: float(np.mean(r)) for key, r in found.items()}


def check(thinning: Thinning) -> None:
    """Check what is true of every thinned block."""
    before, after, least = thinning.before, thinning.block, thinning.least
    first, then = means_of(before), means_of(after)
    assert set(first) == set(then)  # no photo and no region loses its last ray
    gone = set(thinning.gone)
    for key, mean in first.items():
        if mean >= least:
            assert then[key] >= least - 1e-8
        else:
            photo, cell = key
            parts, problem = thinning.parts, before.problem
            of = [
                problem.points[problem.point[k]]
                for k, p in enumerate(problem.photo.tolist())
                if problem.photos[p] == photo and cell in (-1, parts.cell[parts.region[k]])
            ]
            assert not gone & set(of)
    assert after.problem.photos == before.problem.photos
    assert np.bincount(after.problem.point).min() >= 2
    assert not gone & {row.point for row in before.problem.block.control}
    sees = np.zeros((len(after.problem.photos), len(after.problem.points)))
    sees[after.problem.photo, after.problem.point] = 1.0
    assert connected_components(sees @ sees.T >= 3)[0] == 1
    for part, key in enumerate(zip(thinning.parts.owner, thinning.parts.cell, strict=True)):
        name = before.problem.photos[key[0]], int(key[1])
        assert thinning.means_before[part] == pytest.approx(first[name], abs=1e-9)
        assert thinning.means[part] == pytest.approx(then[name], abs=1e-7)


def points_that_tie(block: AdjustedBlock) -> list[tuple[int, set[int]]]:
    """Sets of points that hold a block together, and how many of each have to stay."""
    problem = block.problem
    seen: dict[str, set[int]] = {}
    for photo, point in zip(problem.photo.tolist(), problem.point.tolist(), strict=True):
        seen.setdefault(problem.photos[photo], set()).add(point)
    out = [(6, points) for points in seen.values()]
    strips = problem.block.strips
    for strip in strips:
        for size, need in ((2, 6), (3, 2)):
            for k in range(len(strip.photos) - size + 1):
                run = strip.photos[k : k + size]
                out.append((need, set.intersection(*(seen[photo] for photo in run))))
        for other in strips:
            if other is not strip:
                every = set().union(*(seen[photo] for photo in other.photos))
                out += [(2, seen[photo] & every) for photo in strip.photos]
    return out


def test_what_holds_the_block_together_is_kept() -> None:
    before = adjust_block(dense(5, 3, 4))
    rules = keeping(before.problem, image_parts(before.problem))
    needs: dict[frozenset[int], int] = {}
    for row, need in enumerate(rules.need.tolist()):
        points = frozenset(rules.sets[[row]].indices.tolist())
        needs[points] = max(needs.get(points, 0), need)
    for need, tie in points_that_tie(before):
        assert len(tie) == 0 or needs[frozenset(tie)] >= min(need, len(tie))
    thinning = thin_block(before, 0.05)
    assert thinning.gone
    kept = set(np.flatnonzero(thinning.kept).tolist())
    for need, tie in points_that_tie(before):
        assert len(tie & kept) >= min(need, len(tie))


def more_could_go(thinning: Thinning) -> list[str]:
    """Return the points without which all parts are above R, and that no rule keeps."""
    problem, alive = thinning.before.problem, thinning.kept
    kept = keeping(problem, thinning.parts).whole(thinning.weak)
    tight = (kept.sets @ alive) <= kept.need
    counted = (~thinning.before.rejected).sum(axis=1)
    found = []
    for k in np.flatnonzero(alive & ~kept.firm & (kept.sets.T @ tight == 0)).tolist():
        less = alive.copy()
        less[k] = False
        r = thinned_at(problem, thinning.before.state, less).r
        means = thinning.parts.means(r, np.where(less[problem.point], counted, 0))
        if (means[~thinning.weak] >= thinning.least + 1e-6).all():
            found.append(problem.points[k])
    return found


@pytest.mark.slow
@pytest.mark.parametrize(("least", "strips"), [(0.15, 2), (0.3, 2), (0.45, 3)])
def test_nothing_is_below_the_limit_and_not_one_more_can_go(least: float, strips: int) -> None:
    thinning = thin_block(adjust_block(dense(1, strips)), least)
    check(thinning)
    assert thinning.complete
    assert len(thinning.gone) > 5
    assert more_could_go(thinning) == []
    # a second time nothing more goes
    again = thin_block(thinning.block, least)
    assert again.gone == ()
    assert again.block is thinning.block


@pytest.mark.slow
def test_what_is_lost_far_away_is_foreseen() -> None:
    # regions far from a point have next to nothing to spare: it goes or stays without being tried
    block = aerial(3, 4, per_base=3, seed=1, noise_um=5.0, tilt=0.05, control_sigma=0.05).block
    thinning = thin_block(adjust_block(block), 0.25)
    check(thinning)
    assert thinning.complete
    assert thinning.rounds < 30
    assert more_could_go(thinning) == []


@pytest.mark.slow
@pytest.mark.parametrize("shows", ["no solution", "a photo below the limit"])
def test_a_point_that_only_the_adjustment_refuses_stays(
    shows: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = adjust_block(dense())
    first = thin_block(before, 0.3)
    names, strong = first.gone, np.nanargmax(first.means_before[: first.parts.photos])
    point, tried = before.problem.points.index(names[0]), []

    def refusing(whole: Problem, state: BlockState, alive: Bools) -> Thinned:
        found = thinned_at(whole, state, alive)
        if alive[point]:
            return found
        tried.append(int((~alive).sum()))
        if shows == "no solution":
            raise NotComputableError("not without it")
        return replace(found, r=np.where(whole.photo[:, None] == strong, 0.3, 1.0) * found.r)

    monkeypatch.setattr("anaplot.bundle.thinning.thinning.thinned_at", refusing)
    thinning = thin_block(before, 0.3)
    assert thinning.complete
    assert names[0] not in thinning.gone
    assert len(thinning.gone) > len(names) // 2
    assert tried
    assert len(tried) < 30


def test_further_rays_have_their_whole_loss() -> None:
    bundle = adjust_block(dense(1, 2, 6))
    problem, losses = bundle.problem, Losses(whole(bundle))
    known_points = {row.point for row in problem.block.control}
    size = np.bincount(problem.point)
    k = next(
        k for k, name in enumerate(problem.points) if size[k] == 2 and name not in known_points
    )
    every = np.delete(np.arange(len(problem.points)), k)
    near, all_rays = next(losses.near(np.array([k]))), next(losses.near(np.array([k]), {k: every}))
    assert len(near.rays) < len(all_rays.rays) == len(problem.photo) - 2
    known = dict(zip(all_rays.rays.tolist(), all_rays.lost.tolist(), strict=True))
    assert [known[ray] for ray in near.rays.tolist()] == pytest.approx(near.lost.tolist())
    alive = np.ones(len(problem.points), dtype=bool)
    alive[k] = False
    r = thinned_at(problem, bundle.state, alive).r
    lost = (bundle.cofactors.r - r).sum(axis=1)[all_rays.rays]
    assert all_rays.lost == pytest.approx(lost, abs=1e-4)
    assert lost[np.isin(all_rays.rays, near.rays, invert=True)].max() > 1e-5


def test_a_higher_limit_keeps_more_rays() -> None:
    before = adjust_block(dense())
    rays = [len(thin_block(before, least).block.problem.photo) for least in (0.15, 0.45, 0.6)]
    assert rays == sorted(rays)
    assert rays[0] < 0.6 * len(before.problem.photo) < rays[2]


@pytest.mark.slow
@given(st.integers(0, 10_000), st.floats(0.05, 0.9), st.sampled_from(["control", "free"]))
@settings(max_examples=8, deadline=None)
def test_what_is_true_of_every_thinned_block(seed: int, least: float, datum: str) -> None:
    block = dense(seed, 2, 3)
    check(thin_block(adjust_block(block, datum=datum), least))  # type: ignore[arg-type]


def test_the_solution_is_that_of_the_block_with_the_points_switched_off() -> None:
    before = adjust_block(dense())
    thinning = thin_block(before, 0.3)
    anew = adjust_block(block_without(before.problem.block, set(thinning.gone)))
    assert anew.problem.points == thinning.block.problem.points
    assert anew.vtpv == pytest.approx(thinning.block.vtpv, rel=1e-9)
    np.testing.assert_allclose(anew.cofactors.r, thinning.block.cofactors.r, atol=1e-9)
    np.testing.assert_allclose(anew.state.points, thinning.block.state.points, atol=1e-7)


def test_rejected_coordinates_stay_rejected() -> None:
    block = dense()
    clean = adjust_block(block)
    planted = clean.problem.source[np.argsort(-clean.cofactors.r[:, 0])[:30:10]].tolist()
    rows = list(block.image_points)
    for k in planted:
        rows[k] = replace(rows[k], x=rows[k].x + 0.2)
    before = block_gross_errors(replace(block, image_points=tuple(rows)), "baarda").block
    wrong = {int(k) for k in before.problem.source[before.problem.newly_rejected.any(axis=1)]}
    assert set(planted) <= wrong
    thinning = thin_block(before, 0.3)
    check(thinning)
    after = thinning.block.problem
    kept = {int(k) for k in after.source[after.newly_rejected.any(axis=1)]}
    assert kept == wrong & set(after.source.tolist())
    assert thinning.block.sigma0 is not None
    assert thinning.block.sigma0 < 1.5


@pytest.mark.parametrize("kind", ["plain", "free", "parameters", "conditions", "rejected"])
def test_losses_are_those_of_the_bundle_without_the_point(kind: str) -> None:
    block = dense(2)
    additional = None
    if kind == "parameters":
        additional = AdditionalParameters(ebner, sigma_um=20.0)
    if kind == "conditions":
        names = list(dict.fromkeys(row.point for row in block.image_points))
        ends = names[10], names[13]
        conditions = (ObjectCondition("distance", ends, 600.0, 50.0),)
        block = replace(block, conditions=conditions)
    before = adjust_block(
        block, datum="free" if kind == "free" else "control", additional=additional
    )
    if kind == "rejected":
        problem = before.problem
        rejected = np.zeros((len(problem.photo), 2), dtype=bool)
        rejected[::17, 0] = True
        problem = replace(problem, rejected=rejected)
        structure = make_structure(problem, before.state.centres)
        normal, factor, _ = equations_at(problem, structure, before.state)
        before = replace(before, problem=problem, cofactors=compute_cofactors(normal, factor))
    problem = before.problem
    kept = keeping(problem, image_parts(problem))
    free = np.flatnonzero(~kept.firm)[::7]
    losses = Losses(whole(before))
    at_least = {loss.point: loss for loss in losses.at_least(free)}
    near = {loss.point: loss for loss in losses.near(free)}
    assert set(near) == set(at_least) == set(free.tolist())
    for k in free.tolist():
        thinner = bundle_without(problem, block_without(problem.block, {problem.points[k]}))
        place = {name: j for j, name in enumerate(problem.points)}
        points = before.state.points[[place[name] for name in thinner.points]]
        state = replace(before.state, points=points)
        structure = make_structure(thinner, state.centres)
        normal, factor, _ = equations_at(thinner, structure, state)
        r = compute_cofactors(normal, factor).r.sum(axis=1)
        then = dict(zip(thinner.source.tolist(), r.tolist(), strict=True))
        was = before.cofactors.r.sum(axis=1)
        for found in (near[k], at_least[k]):
            lost = [was[ray] - then[int(problem.source[ray])] for ray in found.rays.tolist()]
            np.testing.assert_allclose(found.lost, lost, atol=1e-7)
        assert set(at_least[k].rays.tolist()) <= set(near[k].rays.tolist())
        # together with what is lost far away: what the point tells of orientations
        mine = problem.point == k
        counted = int((~before.rejected[mine]).sum())
        total = counted - 3.0 - float(before.cofactors.r[mine].sum())
        assert 0.6 * total - 1e-9 <= near[k].lost.sum() <= total + 1e-7


@pytest.mark.parametrize("datum", ["control", "free", "minimal"])
def test_standard_deviations_before_and_after_are_in_one_datum(datum: str) -> None:
    before = adjust_block(dense(3), datum=datum)  # type: ignore[arg-type]
    thinning = thin_block(before, 0.3)
    assert thinning.gone
    found = deviations(thinning)
    for pair in found:
        # fewer observations know nothing better, in one datum
        assert (pair[1] >= pair[0] - 1e-12).all()
        assert pair[1].mean() > 1.01 * pair[0].mean()


@pytest.mark.slow
def test_named_points_and_points_of_conditions_stay() -> None:
    block = dense()
    before = adjust_block(block)
    first = thin_block(before, 0.3)
    one, two, three = first.gone[:3]
    tied = replace(block, conditions=(ObjectCondition("distance", (one, two), 100.0, 1e4),))
    thinning = thin_block(adjust_block(tied), 0.3, keep=[three])
    assert not {one, two, three} & set(thinning.gone)
    assert thinning.gone


def test_what_asks_for_the_end_has_what_was_reached() -> None:
    before = adjust_block(dense())
    watch = Watch()
    watch.stop()
    thinning = thin_block(before, 0.3, watch=watch)
    assert not thinning.complete
    assert thinning.block is before


def test_every_camera_without_a_format_reaches_as_far_as_its_own_photos_measure() -> None:
    block = dense()
    one, other = replace(block.cameras[0], id="one"), replace(block.cameras[0], id="other")
    wide, idle = replace(one, id="wide", format=(300.0, 200.0)), replace(one, id="idle")
    used = [one, other, wide]
    photos = [replace(p, camera=used[k % 3].id) for k, p in enumerate(block.photos)]
    mixed = replace(block, cameras=(idle, *used), photos=tuple(photos))
    problem = make_problem(mixed)
    parts = image_parts(problem)
    reach = {"wide": (150.0, 100.0)}
    for camera in used[:2]:
        mine = {p.id for p in photos if p.camera == camera.id}
        rows = [row for row in mixed.image_points if row.photo in mine]
        reach[camera.id] = max(abs(row.x) for row in rows), max(abs(row.y) for row in rows)
    of = {p.id: reach[p.camera] for p in photos}
    for ray, (x, y) in enumerate(problem.ideal.tolist()):
        a, b = of[problem.photos[problem.photo[ray]]]
        column, row = min(int(1.5 * (x / a + 1.0)), 2), min(int(1.5 * (y / b + 1.0)), 2)
        assert parts.cell[parts.region[ray]] == 3 * (2 - row) + column


def test_without_a_format_rays_that_are_off_move_no_region() -> None:
    before = adjust_block(dense())
    thinning = thin_block(before, 0.3)
    parts, later = thinning.parts, image_parts(thinning.block.problem)
    cell = dict(zip(before.problem.source.tolist(), parts.cell[parts.region], strict=True))
    then = dict(zip(thinning.block.problem.source.tolist(), later.cell[later.region], strict=True))
    assert then == {row: cell[row] for row in then}


def test_a_search_that_is_ended_looks_no_further(monkeypatch: pytest.MonkeyPatch) -> None:
    watch, near, asked = Watch(), Losses.near, []

    def until_the_third(self, points, seen=None):
        for loss in near(self, points) if seen is None else near(self, points, seen):
            asked.append(loss.point)
            if len(asked) == 3:
                watch.stop()
            yield loss

    monkeypatch.setattr(Losses, "near", until_the_third)
    thinning = thin_block(adjust_block(dense()), 0.3, watch=watch)
    assert len(asked) <= 4
    assert not thinning.complete
    assert not thinning.kept.all()
    assert np.nanmin(thinning.means[~thinning.weak]) >= 0.3 - 1e-9
