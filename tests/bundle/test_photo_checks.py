"""What checks a photo, and what it shares with others, against counting over the rays."""

from dataclasses import replace

import numpy as np
import pytest
from bundleblocks import aerial

from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.solve.photochecks import MOST_NEIGHBOURS, photo_checks, photo_overlaps
from anaplot.planning.blockplan import BlockPlan, plan_block


def test_a_vertical_flight_has_the_overlaps_that_it_was_planned_with():
    plan = BlockPlan(2, 4, 0.6, 0.3, 3)
    block = plan_block(plan).evaluated()
    found = {(one.photo, one.other): one for one in photo_overlaps(block)}
    photos = block.problem.photos
    centres = {name: row.position for name, row in zip(photos, block.photo_rows(), strict=True)}
    along = across = 0
    for (photo, other), one in found.items():
        dx, dy = np.abs(np.subtract(centres[other], centres[photo])[:2])
        # over flat ground a shift by s leaves 1 - s / side of each side
        side = plan.format / 1e3 * plan.scale
        assert one.overlap == pytest.approx(max(1 - dx / side, 0) * max(1 - dy / side, 0))
        along += dy < 1.0 and one.overlap == pytest.approx(0.6)
        across += dx < 1.0 and one.overlap == pytest.approx(0.3)
    assert (along, across) == (12, 8)
    assert {photo for photo, _ in found} == set(photos)


def test_checks_and_shares_are_those_of_the_rays_that_count():
    scene = aerial(2, 5, per_base=2, tilt=0.1, noise_um=3.0)
    rows = list(scene.block.image_points)
    rows[3] = replace(rows[3], use="x")
    rows[7] = replace(rows[7], use="off")
    block = adjust_block(replace(scene.block, image_points=tuple(rows)))
    counted = [[(ray, one) for one in ray.xy if one.use] for ray in block.ray_rows()]
    counted = [pairs for pairs in counted if pairs]
    seen = {}
    for photo, found in zip(block.problem.photos, photo_checks(block), strict=True):
        mine = [pairs for pairs in counted if pairs[0][0].photo == photo]
        r = [one.r for pairs in mine for _, one in pairs]
        seen[photo] = {pairs[0][0].point for pairs in mine}
        assert found.rays == len(mine)
        assert (found.redundancy, found.mean_r) == pytest.approx((sum(r), np.mean(r)))
        for axis, rms in (("x", found.rms_x_um), ("y", found.rms_y_um)):
            v = [one.residual for pairs in mine for _, one in pairs if one.axis == axis]
            assert rms == pytest.approx(np.sqrt(np.mean(np.square(v))))
        assert found.flagged == sum(one.flagged for pairs in mine for _, one in pairs)
        assert found.least_r == pytest.approx(max(min(r), 0.0), abs=1e-12)
    told = photo_overlaps(block)
    for photo, mine in seen.items():
        of = [one for one in told if one.photo == photo]
        common = {other: len(mine & points) for other, points in seen.items() if other != photo}
        expected = sorted((-n, seen_at) for seen_at, n in enumerate(common.values()) if n)
        assert [-one.points for one in of] == [n for n, _ in expected[:MOST_NEIGHBOURS]]
        for one in of:
            assert one.points == common[one.other]
            assert one.share == pytest.approx(one.points / len(mine))
            assert one.overlap is None or 0.0 <= one.overlap <= 1.0
