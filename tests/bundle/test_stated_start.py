"""What is given is used and checked, and blocks with many mismatches are searched through once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bundleblocks import Scene, aerial
from startkinds import drone, measured, outside, ring, with_mismatches

from anaplot.bundle.adjust import adjust_block, adjust_problem
from anaplot.bundle.solve.additional import additional_parameters
from anaplot.bundle.solve.gaussnewton import find_minimum
from anaplot.bundle.solve.problem import Problem, make_problem
from anaplot.bundle.solve.structure import make_structure
from anaplot.bundle.start import approximate, bestminimum
from anaplot.bundle.start.robust import RobustState, robust_state
from anaplot.photogrammetry.block import Block, Camera
from anaplot.photogrammetry.camera import BrownLens
from anaplot.photogrammetry.measuredimage import measured_rays
from anaplot.photogrammetry.rotation import rotation_angles, rotation_matrix

BENT = Camera("px", 3.2, pixels=(4000, 4000), lens=BrownLens(k1=-0.11, k2=0.04, p1=5e-4))


def stated(scene: Scene, shift: float, turn: float) -> Block:
    """State where all photos are, with errors."""
    rng = np.random.default_rng(4)
    photos = []
    for photo in scene.block.photos:
        rotation = scene.rotations[photo.id] @ rotation_matrix(*(rng.normal(size=3) * turn))
        position = scene.centres[photo.id] + rng.normal(size=3) * shift
        angles = rotation_angles(rotation)
        photos.append(replace(photo, position=tuple(position.tolist()), rotation=angles))
    return replace(scene.block, photos=tuple(photos))


def raw(block: Block) -> Block:
    """Image coordinates as the lens bends them, and nothing said of it."""
    xy = measured_rays(BENT, np.array([(p.x, p.y) for p in block.image_points]))
    return replace(
        block,
        cameras=(replace(BENT, lens=None),),
        image_points=tuple(
            replace(p, x=x, y=y) for p, (x, y) in zip(block.image_points, xy.tolist(), strict=True)
        ),
    )


def bent_drone() -> Scene:
    rng = np.random.default_rng(3)
    return measured(replace(drone(rng, 1), cameras=(BENT,), half=0.6, share=0.15), rng)


def no_search(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object) -> None:
        raise AssertionError("approximate values were searched for")

    for name in ("vertical_subblock", "grown_from_seed", "bridged_chains", "_from_control"):
        monkeypatch.setattr(approximate, name, refused)


@pytest.mark.slow
@pytest.mark.parametrize(
    "block", [stated(bent_drone(), 0.5, 0.01), raw(stated(bent_drone(), 0.5, 0.01))]
)
def test_stated_orientations_with_small_errors_are_used_also_through_an_unknown_lens(
    monkeypatch: pytest.MonkeyPatch, block: Block
) -> None:
    no_search(monkeypatch)
    found = adjust_problem(make_problem(block))
    # a lens that nobody stated is in the residuals, not in the orientations
    assert found.vtpv / found.redundancy > 20.0 or block.cameras[0].lens is not None
    assert not any("stated" in said for said in found.warnings)


@pytest.mark.slow
def test_a_lens_is_calibrated_from_stated_orientations(monkeypatch: pytest.MonkeyPatch) -> None:
    no_search(monkeypatch)
    block = raw(stated(bent_drone(), 0.5, 0.01))
    found = adjust_problem(make_problem(block, additional=additional_parameters("physical")))
    assert found.vtpv / found.redundancy == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("turn", [0.04, 0.08])
def test_stated_orientations_of_some_degrees_are_refined_not_thrown_away(
    monkeypatch: pytest.MonkeyPatch, turn: float
) -> None:
    rng = np.random.default_rng(1)
    scene = measured(outside(rng, 12, 100), rng)
    no_search(monkeypatch)
    problem = make_problem(stated(scene, 10.0 * turn, turn))
    start = scene.start(problem)
    true = find_minimum(problem, start, make_structure(problem, start.centres))
    assert adjust_problem(problem).vtpv == pytest.approx(true.convergence.last, rel=1e-9)


@pytest.mark.parametrize("datum", ["control", "free"])
def test_stated_orientations_that_are_grossly_wrong_are_told_and_searched_for(datum: str) -> None:
    rng = np.random.default_rng(1)
    scene = measured(ring(rng, 1), rng)
    block = stated(scene, 0.05, 0.01)
    one, other = block.photos[:2]
    swapped = (
        replace(one, rotation=other.rotation),
        replace(other, rotation=one.rotation),
        *block.photos[2:],
    )
    problem = make_problem(replace(block, photos=swapped), datum=datum)
    found = adjust_problem(problem)
    start = scene.start(problem)
    true = find_minimum(problem, start, make_structure(problem, start.centres))
    assert found.vtpv == pytest.approx(true.convergence.last, rel=1e-9)
    said = [line for line in found.warnings if "stated" in line]
    assert len(said) == 1
    assert said[0].startswith("stated orientations are grossly wrong: photo f1 by ")
    assert "photo f2 by " in said[0]
    assert "photo f3" not in said[0]
    assert "degrees" in said[0]


def test_a_grossly_wrong_stated_position_is_told_in_metres() -> None:
    rng = np.random.default_rng(1)
    scene = measured(ring(rng, 1), rng)
    block = stated(scene, 0.05, 0.01)
    photo = block.photos[2]
    x, y, z = photo.position
    photos = (*block.photos[:2], replace(photo, position=(x + 900.0, y, z)), *block.photos[3:])
    found = adjust_problem(make_problem(replace(block, photos=photos)))
    assert found.warnings[0] == "stated orientations are grossly wrong: photo f3 by 900 m"


def mismatched(share: float) -> Problem:
    """Photos around an object, of whose rays a share is somewhere else in the image."""
    rng = np.random.default_rng(2)
    scene = measured(replace(outside(rng, 14, 260), share=0.6), rng)
    return make_problem(with_mismatches(scene, rng, share).block)


@pytest.mark.slow
def test_scattered_mismatches_are_seen_from_the_first_good_start(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    problem = mismatched(0.012)
    solutions: list[RobustState] = []

    def keeping(*given: object, **more: object) -> RobustState:
        solutions.append(robust_state(*given, **more))
        return solutions[-1]

    monkeypatch.setattr(bestminimum, "robust_state", keeping)
    bestminimum.best_minimum(problem, None, problem)
    assert len(solutions) == 1
    solution = solutions[0]
    assert solution.rays_off > len(problem.photo) // 200
    assert solution.explains(problem)
    assert solution.agrees(problem)
    # the same many in one photo tell that it is oriented wrongly
    assert not solution._replace(most_off=0.6).explains(problem)
    assert not solution._replace(rays_off=len(problem.photo) // 10).explains(problem)
    assert not solution._replace(rays_off=len(problem.photo) // 10).agrees(problem)


def test_the_search_tells_from_its_beginning_how_far_it_is() -> None:
    said: list[tuple[str, float]] = []
    rng = np.random.default_rng(2)
    scene = measured(replace(outside(rng, 14, 260), share=0.6), rng)
    bestminimum.best_minimum(
        make_problem(scene.block), lambda *what: said.append(what), mismatched(0.0)
    )
    assert said[0] == ("laying photos level", 0.0)
    # level photos do not fit here, and are left before the last round
    for what, least, steps in (("laying photos level", 0.3, 20), ("resecting photos", 0.8, 10)):
        shares = [share for name, share in said if name == what]
        assert len(shares) > steps
        assert shares == sorted(shares)
        assert least < max(shares) <= 1.0


@pytest.mark.parametrize("datum", ["control", "free", "minimal"])
def test_of_one_straight_strip_nobody_is_accused_of_the_turn_about_it(datum: str) -> None:
    scene = aerial(1, 5, per_base=2, noise_um=5.0, control_sigma=0.05, seed=2)
    block = stated(scene, 10.0, 0.01)
    assert not [one for one in adjust_block(block, datum=datum).warnings if "stated" in one]
    # and one that is wrong is told
    photos = list(block.photos)
    photos[3] = replace(photos[3], rotation=(1.5, 0.0, 0.0))
    told = adjust_block(replace(block, photos=tuple(photos)), datum=datum).warnings
    assert [
        one
        for one in told
        if one.startswith("stated orientations are grossly wrong: photo 104 by ")
    ]
    assert not [one for one in told if "photo 101" in one]


def with_positions(scene: Scene, places: np.ndarray) -> Block:
    """State where photos are, and nothing of how they look."""
    photos = (
        replace(photo, position=tuple(place))
        for photo, place in zip(scene.block.photos, places.tolist(), strict=True)
    )
    return replace(scene.block, photos=tuple(photos))


@pytest.mark.parametrize("control", [3, 12])
@pytest.mark.parametrize("how", ["zero", "same", "exchanged", "elsewhere"])
def test_wrong_positions_of_all_photos_are_told_and_done_without(how: str, control: int) -> None:
    """Of a drone without a fix, with X and Y exchanged, or of another system."""
    scene = aerial(3, 4, per_base=2, relief=30.0, noise_um=5.0, tilt=0.05, seed=2)
    few = scene.block.control[:: max(1, len(scene.block.control) // control)]
    scene = replace(scene, block=replace(scene.block, control=few))
    at = np.array([scene.centres[photo.id] for photo in scene.block.photos])
    wrong = {
        "zero": np.zeros_like(at),
        "same": np.repeat(at[:1] + np.array((5.0, -3.0, 2.0)), len(at), axis=0),
        "exchanged": at[:, [1, 0, 2]] + np.array((40.0, 700.0, 0.0)),
        "elsewhere": at + np.array((1e5, -2e5, 50.0)),
    }[how]
    adjusted = adjust_block(with_positions(scene, wrong))
    assert adjusted.sigma0 < 1.3
    found = adjusted.state.centres + adjusted.state.origin
    assert np.linalg.norm(found - at, axis=1).max() < 2.0
    assert any("stated orientations are grossly wrong" in remark for remark in adjusted.remarks)
