"""The view graph, and the part of a block that grows from one of its edges."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np
import pytest
from startkinds import KINDS, Layout, looking_in, measured, outside

from anaplot.bundle.solve.gaussnewton import find_minimum
from anaplot.bundle.solve.problem import Problem, make_problem
from anaplot.bundle.solve.structure import make_structure
from anaplot.bundle.start import seeds
from anaplot.bundle.start.approximate import approximate_ways, doubtful
from anaplot.bundle.start.relative import orientations
from anaplot.bundle.start.seeds import grown_from_seed, rays_of_common_points, spread
from anaplot.bundle.start.subblock import SubBlock, rays_of_photos, unit_rays
from anaplot.bundle.start.viewgraph import view_graph


def few_rays() -> Problem:
    rng = np.random.default_rng(4)
    return make_problem(measured(KINDS["few rays"](rng, 1), rng).block)


def test_edges_are_what_photos_have_in_common() -> None:
    problem = few_rays()
    seen = [set(problem.point[mine].tolist()) for mine in rays_of_photos(problem)]
    found = {(i, j): len(seen[i] & seen[j]) for i, j in combinations(range(len(seen)), 2)}
    wanted = {pair: count for pair, count in found.items() if count >= 2}
    assert 0 < len(wanted) < len(found)
    graph = view_graph(problem)
    assert list(map(tuple, graph.pairs.tolist())) == sorted(wanted)
    assert graph.common.tolist() == [wanted[pair] for pair in sorted(wanted)]


def test_a_point_twice_in_a_photo_is_one_common_point() -> None:
    problem = few_rays()
    graph = view_graph(problem)
    twice = replace(
        problem,
        photo=np.append(problem.photo, problem.photo[:20]),
        point=np.append(problem.point, problem.point[:20]),
    )
    np.testing.assert_array_equal(view_graph(twice).common, graph.common)


def test_the_strongest_edges_of_all_and_of_each_photo() -> None:
    graph = view_graph(few_rays())
    common = dict(zip(map(tuple, graph.pairs.tolist()), graph.common.tolist(), strict=True))
    among = np.arange(10) != 3
    strongest = [tuple(pair) for pair in graph.strongest(6, among).tolist()]
    assert set(strongest) == {p for p, count in common.items() if count >= 6 and 3 not in p}
    assert [common[p] for p in strongest] == sorted((common[p] for p in strongest), reverse=True)
    wanted = set()
    for photo in range(10):
        mine = [pair for pair in common if photo in pair]
        wanted |= set(sorted(mine, key=lambda p: (-common[p], sum(p)))[:2])
    assert list(map(tuple, graph.strongest_of_each(2).tolist())) == sorted(wanted)
    near = graph.with_neighbours(~among)
    assert set(np.flatnonzero(near).tolist()) == {3} | {k for p in common if 3 in p for k in p}


def doubled(seed: int) -> Layout:
    """A ring of which each photo was taken twice, from nearly the same place."""
    rng = np.random.default_rng(seed)
    around = np.repeat(2.0 * np.pi * np.arange(6) / 6, 2) + np.tile([0.0, 1e-3], 6)
    points = rng.uniform(-3.0, 3.0, (40, 3))
    return looking_in(rng, around, np.full(12, 0.35), 12.0, points)


@pytest.mark.parametrize("seed", range(3))
def test_a_seed_shows_its_points_at_an_angle(seed: int) -> None:
    layout = doubled(seed)
    scene = measured(layout, np.random.default_rng(seed))
    problem = make_problem(scene.block)
    told: list[str] = []
    part = grown_from_seed(
        problem,
        unit_rays(problem),
        rays_of_photos(problem),
        progress=lambda what, _: told.append(what),
    )
    assert part is not None
    assert told.count("orienting pairs") == 1
    assert part.oriented.all()
    # as far apart as they are, but for the scale
    at = np.array([scene.centres[name] for name in problem.photos])
    true, found = (np.linalg.norm(c[:, None] - c[None], axis=2) for c in (at, part.centres))
    np.testing.assert_allclose(found / found.max(), true / true.max(), atol=0.01)


def test_a_part_grows_from_photos_without_a_place_over_their_neighbours() -> None:
    problem = few_rays()
    among = np.isin(np.arange(10), [4, 5])
    part = grown_from_seed(problem, unit_rays(problem), rays_of_photos(problem), among)
    assert part is not None
    assert part.oriented[among].all()
    assert not part.oriented[~view_graph(problem).with_neighbours(among)].any()


@pytest.mark.slow
def test_what_is_left_grows_from_a_seed_that_reaches_most_of_it() -> None:
    # one that fits, and reaches few of them, was taken
    rng = np.random.default_rng(466904)
    problem = make_problem(measured(replace(outside(rng, 16, 200), share=0.4), rng).block)
    state = approximate_ways(problem)[5].find(None)
    assert state is not None
    found = find_minimum(problem, state, make_structure(problem, state.centres))
    assert found.convergence.last == pytest.approx(247.29, abs=0.01)


def test_no_part_grows_where_another_has_grown(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(264)
    problem = make_problem(measured(KINDS["few rays"](rng, 1), rng).block)
    reached, n = np.zeros(10, dtype=bool), len(problem.photos)
    grown: list[int] = []

    def grow(problem: Problem, part: SubBlock, *rest: Any) -> None:
        assert not reached[part.oriented].all()
        spread(problem, part, *rest)
        grown.append(int(part.oriented.sum()))
        if 2 * grown[-1] > n:
            reached[part.oriented] = True

    monkeypatch.setattr(seeds, "spread", grow)
    part = grown_from_seed(problem, unit_rays(problem), rays_of_photos(problem))
    assert part is not None
    assert part.oriented.sum() == max(grown) < n


def test_a_seed_has_no_orientation_in_which_its_rays_miss_far_more_than_in_another() -> None:
    rng = np.random.default_rng(264)
    problem = make_problem(measured(KINDS["few rays"](rng, 1), rng).block)
    rays, by_photo = unit_rays(problem), rays_of_photos(problem)
    pairs = view_graph(problem).strongest(6, np.ones(len(problem.photos), dtype=bool))[:4]
    nowhere, left_out = np.zeros(len(problem.photos), dtype=bool), 0
    for pair, possible in seeds._seeds(problem, rays, by_photo, pairs, nowhere):
        found = [one.error for one in possible]
        one, other = rays_of_common_points(problem, by_photo, pair)
        every = [each.error for each in orientations(rays[one], rays[other], 0.0)]
        assert max(found) <= 10.0 * max(found[0], problem.sigma[0] / problem.c[0])
        left_out += len(every[:3]) - len(found)
    assert left_out > 0


def test_a_photo_that_hangs_on_one_other_is_a_seed_with_that() -> None:
    # of the last photo all points but three are seen by the first alone: no resection
    rng = np.random.default_rng(5)
    around = np.linspace(0.0, 1.2, 6)
    layout = looking_in(rng, around, np.full(6, 0.35), 12.0, rng.uniform(-3.0, 3.0, (60, 3)))
    block = measured(layout, rng).block
    names = make_problem(block).photos
    first, last = names[0], names[-1]
    points = sorted({one.point for one in block.image_points})
    ours, common = set(points[:22]), points[:3]
    kept = [
        one
        for one in block.image_points
        if (one.point in ours and one.photo in (first, last))
        or (one.photo != last and (one.point not in ours or one.point in common))
    ]
    problem = make_problem(replace(block, image_points=kept))
    alone = np.array(problem.photos) == last
    part = grown_from_seed(problem, unit_rays(problem), rays_of_photos(problem), alone)
    assert part is not None
    assert part.oriented[[problem.photos.index(first), problem.photos.index(last)]].all()
    state = approximate_ways(problem)[5].find(None)
    assert state is not None
    assert not doubtful(problem, state)
