"""Photos of a flat object: what all of them say of its plane orients them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bundleblocks import Scene
from startkinds import KINDS, Layout, long_lens, looking_in, measured

from anaplot.adjustment.findings import SearchSettings
from anaplot.bundle.adjust import adjust_problem
from anaplot.bundle.errors.grosserrors import block_gross_errors
from anaplot.bundle.solve.gaussnewton import find_minimum
from anaplot.bundle.solve.problem import Problem, make_problem
from anaplot.bundle.solve.structure import make_structure
from anaplot.bundle.start.plane import grown_from_plane
from anaplot.bundle.start.subblock import SubBlock, rays_of_photos, unit_rays


def grown(problem: Problem) -> SubBlock | None:
    return grown_from_plane(problem, unit_rays(problem), rays_of_photos(problem))


def most_turned(scene: Scene, problem: Problem, part: SubBlock) -> float:
    """Largest angle between a photo's attitude beside the first one's, and the true one [rad]."""
    true = np.array([scene.rotations[name] for name in problem.photos])
    off = (true[0].T @ true).transpose(0, 2, 1) @ part.rotations[0].T @ part.rotations
    return float(np.arccos(np.clip((np.trace(off, axis1=1, axis2=2) - 1.0) / 2.0, -1.0, 1.0)).max())


@pytest.mark.parametrize("seed", range(8))
def test_a_plane_through_a_long_lens_is_not_taken_for_its_mirror_image(seed: int) -> None:
    rng = np.random.default_rng(seed)
    scene = measured(long_lens(rng, 1), rng)
    problem = make_problem(scene.block)
    part = grown(problem)
    assert part is not None
    # 0.2 to 0.5 rad tilted: a mirror image is off by twice as much
    assert most_turned(scene, problem, part) < 0.04
    start = scene.start(problem)
    true = find_minimum(problem, start, make_structure(problem, start.centres))
    assert adjust_problem(problem).vtpv == pytest.approx(true.convergence.last, rel=1e-9)


def anywhere(scene: Scene, share: float, seed: int) -> tuple[Scene, set[tuple[str, str]]]:
    """The scene with rays measured anywhere in their photos, and which they are."""
    rng = np.random.default_rng(seed)
    rows, half = list(scene.block.image_points), 0.7 * scene.block.cameras[0].c
    wrong = rng.choice(len(rows), round(share * len(rows)), replace=False).tolist()
    for k in wrong:
        x, y = rng.uniform(-half, half, 2).tolist()
        rows[k] = replace(rows[k], x=x, y=y)
    block = replace(scene.block, image_points=tuple(rows))
    return replace(scene, block=block), {(rows[k].photo, rows[k].point) for k in wrong}


@pytest.mark.parametrize("share", [0.02, 0.04])
@pytest.mark.parametrize("seed", range(4))
def test_rays_that_lie_anywhere_do_not_turn_the_plane(seed: int, share: float) -> None:
    """The object fills a tenth of the image: such rays have eight times the lever of its points."""
    rng = np.random.default_rng(seed)
    scene, _ = anywhere(measured(long_lens(rng, 1), rng), share, seed)
    problem = make_problem(scene.block)
    part = grown(problem)
    assert part is not None
    assert part.oriented.all()
    # a mirror image is off by .4 rad at least
    assert most_turned(scene, problem, part) < 0.15


@pytest.mark.slow
@pytest.mark.parametrize("seed", [321, 332])
def test_rays_anywhere_are_found_where_they_bend_what_holds_the_block(seed: int) -> None:
    """Three control points of a millimetre, and wrong rays at them, far from where they are."""
    rng = np.random.default_rng(seed)
    scene, wrong = anywhere(measured(long_lens(rng, 1), rng), 0.02, seed)
    found = block_gross_errors(scene.block, "search", SearchSettings(alpha=0.001))
    assert {name[1:3] for name in found.out if name[0] == "image"} >= wrong
    assert found.block.sigma0 is not None
    assert found.block.sigma0 < 1.2
    control = {name for name in found.out if name[0] != "image"}
    assert control == set()


def test_more_photos_than_tell_of_the_plane_and_two_wrong_rays() -> None:
    rng = np.random.default_rng(5)
    scene = measured(KINDS["planar"](rng, 4), rng)
    rows = list(scene.block.image_points)
    for k in (3, 200):
        rows[k] = replace(rows[k], x=rows[k].x + 4.0)
    problem = make_problem(replace(scene.block, image_points=tuple(rows)))
    part = grown(problem)
    assert part is not None
    assert part.oriented.all()
    assert len(problem.photos) == 12
    assert most_turned(scene, problem, part) < 0.01


def flat(heights: float, tilts: float, base: float = 1.0) -> Problem:
    """Five photos side by side, and 60 points of such heights."""
    rng = np.random.default_rng(3)
    around, up = np.linspace(0.0, 6.0, 5), np.full(5, np.pi / 2.0 - tilts)
    points = rng.uniform(-3.0, 3.0, (60, 3)) * (1.0, 1.0, heights)
    layout: Layout = looking_in(rng, around, up, 12.0, points)
    middle = layout.centres.mean(axis=0)
    centres = middle + base * (layout.centres - middle)
    return make_problem(measured(replace(layout, centres=centres, half=2.0), rng).block)


def test_only_tilted_photos_of_a_flat_object_from_several_places() -> None:
    assert grown(flat(0.0, 0.5)) is not None
    assert grown(flat(0.1, 0.5)) is None
    # level photos, and photos from one place, which are images of each other whatever they show
    assert grown(flat(0.0, 0.05)) is None
    assert grown(flat(1.0, 0.5, base=0.0)) is None
