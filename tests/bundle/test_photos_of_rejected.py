"""Photos that lose more of their rays than chance explains."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from grossblocks import planned
from scipy.special import bdtr

from anaplot.adjustment.findings import SearchSettings
from anaplot.bundle.errors.grosserrors import block_gross_errors
from anaplot.bundle.errors.photosofrejected import beyond_chance, losses_of_photos
from anaplot.bundle.solve.problem import make_problem


@pytest.mark.parametrize("rate", [0.0005, 0.01, 0.05])
def test_chance_names_a_photo_as_seldom_as_it_may(rate: float) -> None:
    rng = np.random.default_rng(1)
    rays = np.full(100, 25)
    named = sum(len(beyond_chance(rng.binomial(rays, rate), rays)) > 0 for _ in range(1000))
    # 1 in 1000 blocks: five and more are met by chance once in 250 times
    assert named < 5
    assert 1.0 - bdtr(4, 1000, 0.001) < 0.004


def test_who_loses_more_is_named_the_worst_first() -> None:
    rays = np.array([25, 25, 25, 10, *[25] * 40])
    lost = np.array([0, 12, 2, 8, *[1] * 4, *[0] * 36])
    assert beyond_chance(lost, rays).tolist() == [3, 1]
    # as many in every photo are the rate of the block
    assert beyond_chance(np.full(44, 8), rays[:44]).tolist() == []
    assert beyond_chance(np.array([3]), np.array([3])).tolist() == []


def test_two_rays_of_one_photo_are_an_interchange() -> None:
    problem = make_problem(planned(1, strips=3))
    rows = [row for row in problem.block.image_points if row.photo == "204"]

    def lost(count: int) -> list[str]:
        gone = [("image", r.photo, r.point, r.model, axis) for r in rows[:count] for axis in "xy"]
        return [one.photo for one in losses_of_photos(problem, [*gone, ("control", "01-01", "X")])]

    assert lost(2) == []
    assert lost(5) == ["204"]


def test_rays_that_are_out_with_their_points_are_lost_as_well() -> None:
    problem = make_problem(planned(3, strips=3, sidelap=0.6))
    mine = int((problem.photo == problem.photos.index("204")).sum())
    assert losses_of_photos(problem, [], ["204", "204", "elsewhere"]) == []
    (loss,) = losses_of_photos(problem, [], ["204"] * 6)
    assert (loss.photo, loss.lost, loss.rays) == ("204", 6, mine + 6)
    assert (loss.others_lost, loss.others) == (0, len(problem.photo) - mine)


@pytest.mark.slow
def test_a_photo_of_which_a_part_is_shifted_is_named() -> None:
    block = planned(3, strips=3, sidelap=0.6)
    mine = [k for k, row in enumerate(block.image_points) if row.photo == "204"]
    rows = list(block.image_points)
    for k in mine[: len(mine) // 3]:
        rows[k] = replace(rows[k], x=rows[k].x + 0.3, y=rows[k].y - 0.3)
    found = block_gross_errors(
        replace(block, image_points=tuple(rows)), "baarda", SearchSettings(alpha=0.001)
    )
    assert [one.photo for one in found.photo_losses] == ["204"]
    assert any(remark.startswith("photo 204 loses") for remark in found.remarks)
    clean = block_gross_errors(block, "baarda", SearchSettings(alpha=0.001))
    assert clean.photo_losses == []
