"""Approximate values from nothing: aerial blocks, close range, any attitude."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bundleblocks import aerial, cube, make_scene
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from syntheticblocks import synthetic_block

from anaplot.aliases import Index
from anaplot.bundle.adjust import adjust_block, adjust_problem
from anaplot.bundle.solve.problem import make_problem
from anaplot.bundle.start import subblock
from anaplot.bundle.start.bridging import bridged_chains, joined_chains
from anaplot.bundle.start.relative import (
    _Pair,
    _Refined,
    orientations,
    spread_rotations,
)
from anaplot.bundle.start.resection import resect, three_point_resection
from anaplot.bundle.start.subblock import SubBlock, unit_rays
from anaplot.photogrammetry.block import ControlPoint, ImagePoint, Strip
from anaplot.photogrammetry.collinearity import project
from anaplot.photogrammetry.rotation import rotation_angles, rotation_matrix
from anaplot.photogrammetry.similarity import (
    Similarity,
    fit_similarity,
    fit_to_partial,
    robust_similarity,
)


def converges_to_the_truth(scene, block=None, sigma=1.5, **options):
    adjusted = adjust_block(block or scene.block, **options)
    assert adjusted.sigma0 is not None
    assert adjusted.sigma0 < sigma
    total = adjusted.cofactors.r.sum() + np.nansum(adjusted.cofactors.r_ground)
    total += np.nansum(adjusted.cofactors.r_photo)
    assert total == pytest.approx(adjusted.redundancy, abs=1e-6)
    return adjusted


@pytest.mark.parametrize(
    "options",
    [
        {"strips": 2, "length": 4},
        {"strips": 3, "length": 5, "per_base": 2, "turned": True},
        {"strips": 2, "length": 25, "per_base": 2},
        {"strips": 3, "length": 4, "per_base": 2, "control_sigma": 0.05},
        {"strips": 2, "length": 4, "per_base": 2, "tilt": 0.08},
    ],
)
def test_aerial_blocks(options) -> None:
    scene = aerial(noise_um=5.0, **options)
    adjusted = converges_to_the_truth(scene)
    for row in adjusted.photo_rows():
        assert np.linalg.norm(np.array(row.position) - scene.centres[row.photo]) < 2.0


def test_photos_in_no_strip() -> None:
    scene = aerial(2, 4, per_base=2, noise_um=5.0)
    converges_to_the_truth(scene, replace(scene.block, strips=()))
    strips = (Strip("s1", scene.block.strips[0].photos),)
    converges_to_the_truth(scene, replace(scene.block, strips=strips))


def test_height_and_plan_control() -> None:
    scene = aerial(2, 5, per_base=2, noise_um=5.0)
    control = list(scene.block.control)
    x, y, _ = control[1].xyz
    control[1] = replace(control[1], xyz=(x, y, None))
    for k in (2, 3, 4):
        control[k] = replace(control[k], xyz=(None, None, control[k].xyz[2]))
    converges_to_the_truth(scene, replace(scene.block, control=tuple(control)))


def test_priors_alone_are_a_datum() -> None:
    scene = aerial(2, 4, per_base=2, noise_um=5.0, priors=True)
    adjusted = converges_to_the_truth(scene, replace(scene.block, control=()))
    assert len(adjusted.prior_rows()) == 6 * 8
    # positions alone, with angles nowhere stated
    photos = tuple(replace(p, rotation=None, rotation_sigma=None) for p in scene.block.photos)
    adjusted = converges_to_the_truth(scene, replace(scene.block, control=(), photos=photos))
    assert len(adjusted.prior_rows()) == 3 * 8


@pytest.mark.slow
@pytest.mark.parametrize("version", "ABCDE")
def test_close_range_from_control_and_from_nothing(version) -> None:
    scene = cube(version, noise_um=5.0)
    converges_to_the_truth(scene)
    strips = (Strip("1", tuple(p.id for p in scene.block.photos)),)
    converges_to_the_truth(scene, replace(scene.block, strips=strips))
    free = adjust_block(replace(scene.block, control=()), datum="free")
    assert free.sigma0 is not None
    assert free.sigma0 < 1.5


def ring(photos: int, *, flat: bool = False, points: int = 40, seed: int = 3):
    """Convergent photos all around an object, rolled at random; three control points."""
    rng = np.random.default_rng(seed)
    flatten = np.array([1.0, 1.0, 0.02 if flat else 1.0])
    at = {f"p{k}": rng.uniform(-3.0, 3.0, 3) * flatten for k in range(points)}
    stations = {}
    for k in range(photos):
        around = 0.5 * k if flat else 2.0 * np.pi * k / photos
        up = 1.0 if flat else 0.35
        place = 12.0 * np.array(
            [np.cos(around) * np.cos(up), np.sin(around) * np.cos(up), np.sin(up)]
        )
        z = place / np.linalg.norm(place)
        x = np.cross([0.0, 0.0, 1.0], z)
        x /= np.linalg.norm(x)
        rotation = np.column_stack((x, np.cross(z, x), z))
        stations[str(k)] = (place, rotation @ rotation_matrix(0, 0, rng.uniform(-3, 3)))
    control = [ControlPoint(f"p{k}", tuple(at[f"p{k}"].tolist()), (0.001,) * 3) for k in range(3)]
    return make_scene(stations, at, c=50.0, control=control, noise_um=5.0, seed=seed)


@pytest.mark.slow
@pytest.mark.parametrize(
    "options",
    [{"photos": 8}, {"photos": 4}, {"photos": 6, "flat": True}, {"photos": 3, "points": 12}],
)
def test_convergent_and_rotated_photos(options) -> None:
    scene = ring(**options)
    adjusted = converges_to_the_truth(scene)
    for row in adjusted.photo_rows():
        assert np.linalg.norm(np.array(row.position) - scene.centres[row.photo]) < 0.1


def test_good_orientations_are_used_and_wild_ones_are_not_believed() -> None:
    scene = aerial(2, 4, per_base=2, noise_um=5.0)
    stated = tuple(
        replace(
            p,
            position=tuple(scene.centres[p.id].tolist()),
            rotation=rotation_angles(scene.rotations[p.id]),
        )
        for p in scene.block.photos
    )
    good = converges_to_the_truth(scene, replace(scene.block, photos=stated))
    assert not good.prior_rows()
    wild = tuple(replace(p, rotation=(2.0, 1.0, 0.5)) for p in stated)
    again = converges_to_the_truth(scene, replace(scene.block, photos=wild))
    np.testing.assert_allclose(again.v, good.v, atol=1e-5)


@pytest.mark.parametrize("seed", range(40))
def test_three_points_and_resection(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rotation = Rotation.from_quat(rng.normal(size=4)).as_matrix()
    centre = rng.normal(size=3) * 50.0
    xy = rng.uniform(-70.0, 70.0, (12, 2))
    rays = np.column_stack((xy, np.full(12, -100.0)))
    points = centre + (rng.uniform(5.0, 9.0, 12)[:, None] * rays) @ rotation.T
    unit = rays / np.linalg.norm(rays, axis=1)[:, None]
    index = rng.choice(12, (8, 3), replace=True)
    index = index[[len(set(row)) == 3 for row in index.tolist()]]
    centres, rotations, case = three_point_resection(unit[index], points[index])
    # double roots of the quartic are found to half the digits only
    hits = (np.linalg.norm(centres - centre, axis=1) < 1.0) & (
        np.abs(rotations - rotation).max(axis=(1, 2)) < 0.01
    )
    assert len(set(case[hits].tolist())) >= 0.7 * len(index)
    xy[:3] += 40.0
    found = resect(xy, 100.0, points)
    assert found is not None
    np.testing.assert_allclose(found.centre, centre, atol=1e-2)
    np.testing.assert_allclose(found.rotation, rotation, atol=1e-4)
    assert (found.residual[:3] > 20.0).all()


@pytest.mark.parametrize("seed", range(10))
def test_relative_orientation_in_any_attitude(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1.0, 1.0, (15, 3))
    rays = []
    frames = []
    for _ in range(2):
        direction = rng.normal(size=3)
        direction /= np.linalg.norm(direction)
        if frames and abs(direction @ frames[0][1]) > 0.9:
            direction = np.cross(direction + 0.3, frames[0][1])
            direction /= np.linalg.norm(direction)
        centre = 5.0 * direction
        x = np.cross(rng.normal(size=3), direction)
        x /= np.linalg.norm(x)
        rotation = np.column_stack((x, np.cross(direction, x), direction))
        seen = project(
            np.tile(centre, (15, 1)), np.tile(rotation, (15, 1, 1)), np.full(15, 50.0), points
        )
        rays.append(np.column_stack((seen.xy, np.full(15, -50.0))))
        frames.append((centre, direction, rotation))
    found = list(orientations(*rays, 0.0))
    assert found
    wanted = frames[0][2].T @ frames[1][2]
    base = frames[0][2].T @ (frames[1][0] - frames[0][0])
    base /= np.linalg.norm(base)
    best = min(found[:3], key=lambda o: float(np.abs(o.rotation - wanted).max()))
    np.testing.assert_allclose(best.rotation, wanted, atol=1e-5)
    np.testing.assert_allclose(best.base, base, atol=1e-5)


def test_coplanarity_changes_with_turn_and_base_as_its_derivatives_say() -> None:
    rng = np.random.default_rng(1)
    pair = _Pair(rng.normal(size=(9, 3)), rng.normal(size=(9, 3)))
    rotations, bases = Rotation.random(4, rng).as_matrix(), rng.normal(size=(4, 3))
    e, weight = rng.normal(size=(4, 9)), rng.uniform(0.5, 2.0, (4, 9))
    h = 1e-6
    columns = []
    for side in np.eye(6) * h:
        turn, there = Rotation.from_rotvec(side[:3]).as_matrix(), bases + side[3:]
        back = Rotation.from_rotvec(-side[:3]).as_matrix(), bases - side[3:]
        ahead = pair.misclosures(turn @ rotations, there)
        columns.append((ahead - pair.misclosures(back[0] @ rotations, back[1])) / (2.0 * h))
    design = np.stack(columns, axis=2)
    normal, right = pair.equations(rotations, bases, e, weight)
    np.testing.assert_allclose(
        normal, np.einsum("kn,kni,knj->kij", weight, design, design), atol=1e-6
    )
    np.testing.assert_allclose(
        right[:, :, 0], -np.einsum("kn,kni,kn->ki", weight, design, e), atol=1e-6
    )
    turned = np.einsum("kij,nj->kni", rotations, pair.second)
    plain = np.einsum("ki,kni->kn", bases, np.cross(pair.first, turned))
    np.testing.assert_allclose(pair.misclosures(rotations, bases), plain, atol=1e-12)
    along = np.einsum("ki,kni->kn", bases, turned)
    np.testing.assert_allclose(pair.along_base(rotations, bases), along, atol=1e-12)
    cosines = np.einsum("ni,kni->kn", pair.first, turned)
    np.testing.assert_allclose(pair.cosines(rotations), cosines, atol=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_what_explains_the_rays_comes_before_the_rest_is_sought(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(seed)
    points = rng.uniform((-1.0, -1.0, -6.0), (1.0, 1.0, -4.0), (15, 3))
    turn = Rotation.from_rotvec(rng.normal(size=3)).as_matrix()
    rays = [points, (points - (1.5, 0.5, -0.5)) @ turn]
    sharp = 1e-4
    noisy = [p / np.linalg.norm(p, axis=1)[:, None] + rng.normal(0.0, sharp, p.shape) for p in rays]
    steps: list[int] = []
    step = _Refined.step

    def count(self: _Refined, noise: float) -> Index:
        steps.append(1)
        return step(self, noise)

    monkeypatch.setattr(_Refined, "step", count)
    every = orientations(*noisy, sharp)
    soon = next(every)
    early = len(steps)
    assert soon.error < sharp
    np.testing.assert_allclose(soon.rotation, turn, atol=0.01)
    rest = list(every)
    assert early < len(steps) / 2
    assert all(np.abs(one.rotation - turn).max() > 0.01 for one in rest if one.in_front == 1.0)
    best = list(orientations(*noisy, 0.0))
    assert [one.error for one in best] == sorted(one.error for one in best)
    np.testing.assert_allclose(soon.rotation, best[0].rotation, atol=1e-3)
    # the same orientations, whatever is known of the noise
    assert len(best) == 1 + len(rest)


@given(st.integers(0, 10_000))
@settings(max_examples=30)
def test_similarity(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rotation = Rotation.from_quat(rng.normal(size=4)).as_matrix()
    scale, shift = rng.uniform(0.1, 50.0), rng.normal(size=3) * 100.0
    source = rng.normal(size=(9, 3))
    target = scale * source @ rotation.T + shift
    got = fit_similarity(source, target)
    assert got.scale == pytest.approx(scale)
    np.testing.assert_allclose(got.rotation, rotation, atol=1e-9)


@pytest.mark.parametrize("seed", range(30))
def test_similarity_beside_wrong_points(seed: int) -> None:
    """Three of nine points are anywhere; then all but two are known in height only."""
    rng = np.random.default_rng(seed)
    rotation = Rotation.from_quat(rng.normal(size=4)).as_matrix()
    scale, shift = rng.uniform(0.1, 50.0), rng.normal(size=3) * 100.0
    source = rng.normal(size=(9, 3))
    target = scale * source @ rotation.T + shift
    spoilt = target.copy()
    spoilt[:3] += rng.normal(size=(3, 3)) * 50.0 * scale
    found = robust_similarity(source, spoilt)
    assert found is not None
    np.testing.assert_allclose(found[0].apply(source), target, atol=1e-6 * scale)
    partial = target.copy()
    partial[2:, :2] = np.nan
    start = found[0]._replace(shift=shift + 0.05 * scale)
    refined = fit_to_partial(source, partial, start)
    assert refined is not None
    np.testing.assert_allclose(refined.apply(source), target, atol=1e-5 * scale)
    nearly = fit_to_partial(source, partial, start, close=1e-3)
    assert nearly is not None
    np.testing.assert_allclose(nearly.apply(source), target, atol=0.01 * scale)


@pytest.mark.parametrize("count", [60, 900])
def test_similarity_beside_many_wrong_points(count: int) -> None:
    """Two of five points are anywhere: the motion on which most agree is that of the others."""
    rng = np.random.default_rng(count)
    rotation = Rotation.from_quat(rng.normal(size=4)).as_matrix()
    source = rng.normal(size=(count, 3)) * (900.0, 400.0, 30.0) + (4e5, 5e6, 200.0)
    target = 0.7 * source @ rotation.T + rng.normal(size=3)
    noisy = target + rng.normal(0.0, 0.01, (count, 3))
    wrong = rng.permutation(count) < 0.4 * count
    noisy[wrong] += rng.normal(size=(int(wrong.sum()), 3)) * 200.0
    found = robust_similarity(source, noisy)
    assert found is not None
    similarity, inliers = found
    assert not (inliers & wrong).any()
    # of six times the median of the others hardly any is left out
    assert inliers.sum() > 0.95 * (~wrong).sum()
    np.testing.assert_allclose(similarity.apply(source), target, atol=0.05)


def test_points_on_a_line_give_no_similarity() -> None:
    line = np.outer(np.arange(5.0), [1.0, 2.0, 3.0])
    assert robust_similarity(line, line) is None
    assert robust_similarity(line[:2], line[:2]) is None
    assert fit_to_partial(line, line, fit_similarity(line + np.eye(5)[:, :3], line)) is None


@pytest.mark.parametrize("noise", [0.0, 1e-6, 1e-4])
@pytest.mark.parametrize("seed", range(10))
def test_strips_that_share_a_line_of_points_look_the_same_way(seed: int, noise: float) -> None:
    rng = np.random.default_rng(seed)
    x = np.arange(7) * 0.6
    line = np.column_stack((x, 0 * x, 0 * x))
    sides = [np.column_stack((x, 0 * x + y, 0 * x)) for y in (-1.0, 1.0)]

    def strip(k: int) -> SubBlock:
        points = np.full((21, 3), np.nan)
        points[:7], points[7 * k + 7 : 7 * k + 14] = line, sides[k]
        points += rng.normal(size=points.shape) * noise
        centres, rotations = np.full((14, 3), np.nan), np.full((14, 3, 3), np.nan)
        centres[7 * k : 7 * k + 7] = sides[k] / 2.0 + [0.0, 0.0, 1.0]
        rotations[7 * k : 7 * k + 7] = np.eye(3)
        return SubBlock(centres, rotations, points)

    first, second = strip(0), strip(1)
    second.transform(
        Similarity(
            rng.uniform(0.5, 2.0),
            Rotation.from_quat(np.random.default_rng(seed).normal(size=4)).as_matrix(),
            x[:3],
        )
    )
    assert not first.join(second)
    assert first.join(second, hinged=True)
    np.testing.assert_allclose(first.points[14:], sides[1], atol=2e-3)
    np.testing.assert_allclose(first.rotations[7:], np.tile(np.eye(3), (7, 1, 1)), atol=2e-3)


def thinned(scene, share: float, seed: int):
    """Leave a share of the rays out, at random."""
    rng = np.random.default_rng(seed)
    return scene.with_rows([r for r in scene.block.image_points if rng.random() > share])


@pytest.mark.slow
def test_difficult_blocks() -> None:
    # nearly flat object, control nearly on a line
    converges_to_the_truth(ring(6, flat=True, points=30, seed=1))
    # a third of the control can only be intersected once the datum is known
    converges_to_the_truth(thinned(ring(3, points=25, seed=3), 0.3, 3))
    scene = thinned(aerial(3, 4, per_base=2, noise_um=5.0, seed=10, tilt=0.1), 0.2, 10)
    converges_to_the_truth(scene, replace(scene.block, strips=()))


@pytest.mark.slow
def test_images_turned_at_random_in_declared_strips() -> None:
    scene = aerial(3, 4, per_base=2, noise_um=5.0, seed=2, tilt=0.03)
    rng = np.random.default_rng(2)
    kappa = {p.id: rng.uniform(-np.pi, np.pi) for p in scene.block.photos}
    rows = []
    for r in scene.block.image_points:
        s, c = np.sin(kappa[r.photo]), np.cos(kappa[r.photo])
        rows.append(replace(r, x=c * r.x - s * r.y, y=s * r.x + c * r.y))
    converges_to_the_truth(scene, replace(scene.block, image_points=tuple(rows)))


def test_rotations_are_spread_over_all_of_them() -> None:
    spread = spread_rotations(600)
    np.testing.assert_allclose(spread @ spread.transpose(0, 2, 1), [np.eye(3)] * 600, atol=1e-14)
    assert (np.linalg.det(spread) > 0.0).all()
    anywhere = Rotation.from_quat(np.random.default_rng(0).normal(size=(4000, 4))).as_matrix()
    trace = np.einsum("aij,bij->ab", spread, anywhere).max(axis=0)
    nearest = np.degrees(np.arccos((trace - 1.0) / 2.0))
    # 600 random ones leave gaps of 35 degrees
    assert nearest.max() < 28.0


@pytest.mark.slow
def test_a_long_strip_is_hung_on_its_neighbour_as_a_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    flown = synthetic_block(2, 24, seed=1)
    rng = np.random.default_rng(1)
    rows = tuple(
        ImagePoint(photo, point, *(np.array(xy) + rng.normal(0.0, 0.005, 2)).tolist())
        for photo, seen in flown.truth.items()
        for point, xy in seen.items()
    )
    block = replace(flown.block, image_points=rows, control=())

    def one_by_one(*_: object) -> None:
        raise AssertionError("a photo of the strip was oriented by itself")

    problem = make_problem(block, datum="free")
    assert len(joined_chains(problem, unit_rays(problem), bridged_chains(problem))) == 2
    monkeypatch.setattr(subblock, "resect", one_by_one)
    assert 0.9 < adjust_problem(problem).sigma0 < 1.1
