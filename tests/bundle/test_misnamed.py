"""Rays under a wrong name are told by the block from rays in error."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.errors.grosserrors import block_gross_errors
from anaplot.bundle.errors.misnamed import MisnamedRay, misnamed_rays
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
