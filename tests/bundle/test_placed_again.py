"""Photos of which hardly a ray is checked are placed by most of their rays, and named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from grossblocks import mismatched, planned, weak

from anaplot.adjustment.findings import SearchSettings
from anaplot.bundle.adjust import adjust_problem
from anaplot.bundle.errors.grosserrors import block_gross_errors
from anaplot.bundle.errors.photosofrejected import hardly_checked_photos
from anaplot.bundle.solve.posteriors import posterior_of
from anaplot.bundle.solve.problem import Problem, make_problem
from anaplot.bundle.start.placedagain import hardly_checked, placed_again
from anaplot.bundle.start.robust import OFF
from anaplot.photogrammetry.block import PointPrior
from anaplot.photogrammetry.objectconditions import ObjectCondition
from anaplot.photogrammetry.rotation import rotation_matrix


def of_photo(problem: Problem, name: str) -> dict[str, int]:
    mine = np.flatnonzero(problem.photo == problem.photos.index(name)).tolist()
    return {problem.points[problem.point[k]]: k for k in mine}


def test_a_photo_that_lies_elsewhere_comes_back_though_two_of_its_six_rays_are_wrong() -> None:
    problem, state = weak()
    photo, rays = problem.photos.index("201"), of_photo(problem, "201")
    assert len(rays) == 6
    block = problem.block
    rows = tuple(
        replace(row, x=row.x - 40.0, y=row.y + 30.0)
        if row.photo == "201" and row.point in ("03-02", "05-02")
        else row
        for row in block.image_points
    )
    problem = make_problem(replace(block, image_points=rows))
    reach = OFF * problem.sigma
    assert placed_again(problem, state, reach) is None
    centres, rotations = state.centres.copy(), state.rotations.copy()
    centres[photo] += (900.0, -300.0, -1400.0)
    rotations[photo] = rotation_matrix(1.0, 0.5, 2.0)
    again = placed_again(problem, replace(state, centres=centres, rotations=rotations), reach)
    assert again is not None
    # of a flying height of 1.5 km
    assert np.abs(again.centres - state.centres).max() < 5.0
    assert np.abs(again.rotations - state.rotations).max() < 0.01
    # all else is where it was
    others = np.arange(len(problem.photos)) != photo
    assert np.array_equal(again.centres[others], state.centres[others])


def test_less_than_a_ray_checks_a_photo_of_four_that_are_half_known() -> None:
    problem, state = weak()
    rays, photo = of_photo(problem, "101"), problem.photos.index("101")
    fits = np.ones(len(problem.photo), dtype=bool)
    assert not hardly_checked(problem, fits, state).any()
    # 02-01 is seen in one other photo and says one thing; each of the others says two
    fits[[rays["01-02"], rays["03-02"]]] = False
    assert problem.photos[int(np.flatnonzero(hardly_checked(problem, fits, state))[0])] == "101"
    assert int(hardly_checked(problem, fits, state).sum()) == 1
    fits[rays["03-02"]] = True
    assert not hardly_checked(problem, fits, state).any()
    fits[rays["03-02"]] = False
    stated = problem.position_sigma.copy()
    stated[photo] = 1.0
    assert not hardly_checked(replace(problem, position_sigma=stated), fits, state).any()


@pytest.mark.parametrize("known", ["prior", "weak prior", "distance", "point given", "photo given"])
def test_what_else_is_known_of_points_and_photos_checks_a_photo(known: str) -> None:
    problem, state = weak()
    place = tuple((state.points[problem.points.index("02-01")] + state.origin).tolist())
    block = problem.block
    if "prior" in known:
        sigma = 0.1 if known == "prior" else 500.0
        block = replace(block, priors=(PointPrior("02-01", place, (sigma,) * 3),))
    elif known == "distance":
        there = state.points[problem.points.index("03-03")] + state.origin
        long = float(np.linalg.norm(there - place))
        one = ObjectCondition("distance", ("02-01", "03-03"), long, 0.1)
        block = replace(block, conditions=(one,))
    else:
        name = "photo:101" if known == "photo given" else "point:02-01"
        block = replace(block, given=posterior_of(adjust_problem(problem), [name]))
    with_it = make_problem(block)
    assert with_it.points == problem.points
    rays = of_photo(with_it, "101")
    fits = np.ones(len(with_it.photo), dtype=bool)
    fits[[rays["01-02"], rays["03-02"]]] = False
    assert hardly_checked(problem, fits, state).any()
    assert hardly_checked(with_it, fits, state).any() == (known == "weak prior")


def test_a_photo_is_named_where_what_is_left_of_it_is_hardly_checked() -> None:
    problem, state = weak()
    rays = of_photo(problem, "101")
    rejected = np.zeros((len(problem.photo), 2), dtype=bool)
    out = [
        ("image", "101", point, "101/102", axis) for point in ("01-02", "03-02") for axis in "xy"
    ]
    rejected[[rays["01-02"], rays["03-02"]]] = True
    (one,) = hardly_checked_photos(replace(problem, rejected=rejected), state, out)
    assert one.sentence.startswith("less than one ray checks where photo 101 is: 2 of its 6 rays")
    # nothing was lost of it: few rays are no finding
    assert hardly_checked_photos(replace(problem, rejected=rejected), state, []) == []


@pytest.mark.slow
def test_a_corner_photo_of_a_block_with_far_rays_is_right_or_named() -> None:
    """Two of its six rays, and one beside it; three of its rays fit at another place as well."""
    clean = planned(2, strips=4, photos=15, sidelap=0.3)
    block, wrong = mismatched(clean, 27, 2)
    assert {("201", "03-02"), ("201", "05-02"), ("202", "05-01")} <= wrong
    found = block_gross_errors(block, "search", SearchSettings(alpha=0.001))
    true = adjust_problem(make_problem(clean)).state
    off = found.block.state.centres + found.block.state.origin - true.centres - true.origin
    # it was 1.7 km
    assert float(np.linalg.norm(off, axis=1).max()) < 5.0
    assert any(
        remark.startswith("less than one ray checks where photo 201") for remark in found.remarks
    )
