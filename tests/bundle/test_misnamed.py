"""Rays under a wrong name are told by the block from rays in error."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bundleblocks import aerial

from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.errors import misnamed
from anaplot.bundle.errors.grosserrors import block_gross_errors
from anaplot.bundle.errors.misnamed import MisnamedRay, misnamed_rays
from anaplot.bundle.solve.problem import make_problem
from anaplot.photogrammetry.block import Block
from anaplot.planning.blockplan import BlockPlan, plan_block


def measured(seed: int) -> Block:
    """Two 60/60 strips of four photos, every ray measured once, noise of 5 um."""
    block = plan_block(BlockPlan(2, 4, 0.60, 0.60, stereo=False)).block
    noise = np.random.default_rng(seed).normal(size=(len(block.image_points), 2)) * 0.005
    return replace(
        block,
        image_points=tuple(
            replace(row, x=row.x + dx, y=row.y + dy)
            for row, (dx, dy) in zip(block.image_points, noise.tolist(), strict=True)
        ),
    )


def renamed(block: Block, photo: str, names: dict[str, str]) -> Block:
    rows = tuple(
        replace(row, point=names.get(row.point, row.point)) if row.photo == photo else row
        for row in block.image_points
    )
    return replace(block, image_points=rows)


def named(block: Block) -> tuple[tuple[MisnamedRay, ...], float]:
    found = block_gross_errors(block, "search")
    return found.misnamed, float(adjust_block(measured(1)).sigma0 or 0.0)


@pytest.mark.slow
def test_two_names_exchanged_in_a_photo_are_named() -> None:
    rays, clean = named(renamed(measured(1), "203", {"03-03": "02-03", "02-03": "03-03"}))
    [ray] = rays
    assert {ray.point, ray.meant} == {"03-03", "02-03"}
    assert (ray.photo, ray.model, ray.interchanged) == ("203", None, True)
    assert ray.sigma0 == pytest.approx(clean)
    assert ray.taken_back >= 2


@pytest.mark.slow
def test_a_ray_under_the_name_of_a_point_that_its_photo_lacks_is_named() -> None:
    rays, clean = named(renamed(measured(1), "103", {"01-03": "04-03"}))
    [ray] = rays
    assert (ray.photo, ray.point, ray.meant, ray.interchanged) == ("103", "04-03", "01-03", False)
    assert ray.sigma0 == pytest.approx(clean)


@pytest.mark.slow
def test_an_exchange_and_a_wrong_name_are_told_together() -> None:
    wrong = renamed(measured(1), "203", {"03-03": "02-03", "02-03": "03-03"})
    rays, clean = named(renamed(wrong, "103", {"01-03": "04-03"}))
    assert {(ray.photo, ray.interchanged) for ray in rays} == {("203", True), ("103", False)}
    assert all(ray.sigma0 < 2.0 * clean for ray in rays if ray.sigma0 is not None)


@pytest.mark.slow
@pytest.mark.parametrize("size_mm", [0.06, 0.6, 40.0])
def test_an_error_of_measurement_is_no_wrong_name(size_mm: float) -> None:
    block = measured(2)
    rows = list(block.image_points)
    at = next(k for k, row in enumerate(rows) if (row.photo, row.point) == ("203", "02-03"))
    rows[at] = replace(rows[at], y=rows[at].y + size_mm)
    rays, _ = named(replace(block, image_points=tuple(rows)))
    assert rays == ()


def test_nothing_rejected_names_nothing() -> None:
    assert misnamed_rays(adjust_block(measured(3)), ()) == ()


@pytest.mark.slow
def test_rejected_control_hides_no_wrong_name() -> None:
    block = renamed(measured(1), "203", {"03-03": "02-03", "02-03": "03-03"})
    weighted = tuple(replace(row, sigma=(0.05, 0.05, 0.05)) for row in block.control)
    at = next(k for k, row in enumerate(weighted) if row.xyz[0] is not None)
    x, y, z = weighted[at].xyz
    wrong = replace(weighted[at], xyz=(x, y, None if z is None else z + 10.0))
    control = (*weighted[:at], wrong, *weighted[at + 1 :])
    found = block_gross_errors(replace(block, control=control), "search")
    assert ("control", wrong.point, "Z") in {row.name for row in found.rejected}
    [ray] = found.misnamed
    assert (ray.photo, ray.interchanged) == ("203", True)


def mistaken(seed: int, most_mm: float) -> Block:
    """Fifteen photos; in five of them a ray was measured near another one, which is there too."""
    block = aerial(3, 5, per_base=2, control_sigma=0.05, noise_um=5.0).block
    rng, rows = np.random.default_rng(seed), list(block.image_points)
    for photo in rng.choice([photo.id for photo in block.photos], 5, replace=False):
        mine = [k for k, row in enumerate(rows) if row.photo == photo]
        ray, other = rng.choice(mine, 2, replace=False).tolist()
        dx, dy = rng.uniform(-most_mm, most_mm, 2).tolist()
        rows[ray] = replace(rows[ray], x=rows[other].x + dx, y=rows[other].y + dy)
    return replace(block, image_points=tuple(rows))


def tried_names(block: Block, monkeypatch: pytest.MonkeyPatch):
    """All names that rejected rays may have borne, those that other rays contradict as well."""
    found = block_gross_errors(block, "search")
    rays = misnamed._rejected_rays(found.block, [row.name for row in found.rejected])
    monkeypatch.setattr(misnamed, "_ENOUGH", 99)
    return found.block, rays, list(misnamed._candidates(found.block, list(rays)))


@pytest.mark.slow
def test_what_is_plainly_wrong_is_not_put_right_by_an_adjustment(monkeypatch) -> None:
    block, rays, tried = tried_names(mistaken(1, 0.03), monkeypatch)
    plain = [one for one in tried if misnamed._plainly_wrong(block, rays, one)]
    assert len(plain) >= 4
    assert all(misnamed._put_right(block, rays, one) is None for one in plain)


@pytest.mark.slow
@pytest.mark.parametrize("sigmas", [0.0, 2.0, 5.0])
def test_an_exchange_does_what_is_foreseen_of_it(sigmas: float, monkeypatch) -> None:
    block = renamed(measured(1), "203", {"03-03": "02-03", "02-03": "03-03"})
    rows = list(block.image_points)
    at = next(k for k, row in enumerate(rows) if (row.photo, row.point) == ("203", "02-03"))
    rows[at] = replace(rows[at], y=rows[at].y + sigmas * 0.005)
    block, rays, [right] = tried_names(replace(block, image_points=tuple(rows)), monkeypatch)
    ended = []
    real = misnamed.adjust_onward
    monkeypatch.setattr(misnamed, "adjust_onward", lambda *of: ended.append(real(*of)) or ended[-1])
    put_right = misnamed._put_right(block, rays, right)
    [after], seen = ended, misnamed._foreseen(block, right)
    growth = after.vtpv - block.vtpv
    assert seen.growth == pytest.approx(growth, rel=0.01, abs=0.01)
    mine = [np.flatnonzero(after.problem.source == row)[0] for row in right.rows]
    size = np.abs(after.v[mine]) / np.sqrt(after.cofactors.r[mine])
    assert np.abs(seen.w) == pytest.approx(size.ravel(), rel=0.02, abs=0.01)
    if misnamed._plainly_wrong(block, rays, right):
        assert put_right is None


def test_points_around_a_photo_are_those_of_photos_that_share_points_with_it(monkeypatch) -> None:
    monkeypatch.setattr(misnamed, "_FEW", 0)
    problem = make_problem(plan_block(BlockPlan(1, 8, 0.60, 0.60, stereo=False)).block)
    rays = list(zip(problem.photo.tolist(), problem.point.tolist(), strict=True))
    placed, fewer = misnamed._Placed(problem), 0
    for photo in range(len(problem.photos)):
        mine = {point for of, point in rays if of == photo}
        beside = {of for of, point in rays if point in mine}
        around = {point for of, point in rays if of in beside} - mine
        assert placed.points_around(photo).tolist() == sorted(around)
        fewer += len(around | mine) < len(problem.points)
    assert fewer
