"""Which parameter of a held lens is said to have bent heights."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bundleblocks import aerial

import anaplot
from anaplot.bundle.hypotheses.doming import doming
from anaplot.photogrammetry.block import Camera, ControlPoint
from anaplot.photogrammetry.camera import BrownLens
from anaplot.photogrammetry.measuredimage import ideal_rays, measured_rays


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1])
def test_the_lens_is_named_by_heights_and_photographs_together(seed: int) -> None:
    """Few heights fit k2 as well as k1, which is wrong; the photographs know which it is."""
    true = Camera("cam", 150.0, lens=BrownLens(k1=0.010))
    stated = Camera("cam", 150.0, lens=BrownLens(k1=0.008))
    block = aerial(
        4, 6, per_base=2, noise_um=3.0, relief=20.0, control_sigma=0.05, seed=seed,
        distort=lambda x, y: measured_rays(true, [(x, y)])[0] - (x, y),
    ).block  # fmt: skip
    ideal = ideal_rays(stated, [(row.x, row.y) for row in block.image_points])
    rows = tuple(
        replace(row, x=x, y=y)
        for row, (x, y) in zip(block.image_points, ideal.tolist(), strict=True)
    )
    precision = replace(block.precision, image_um=3.0)
    block = replace(block, cameras=(stated,), image_points=rows, precision=precision)
    [control] = doming(anaplot.adjust(block).result.block).differences
    why = control.explained
    assert (why.name, why.photographs) == ("k1", "say the same")
    assert why.change == pytest.approx(0.002, abs=4.0 * why.s)
    # three heights of check points are too few for that, and it is said
    check = tuple(
        replace(row, use="check") if k % 2 else row for k, row in enumerate(block.control)
    )
    few = anaplot.adjust(replace(block, control=check)).text()
    assert "3 check heights: rms " in few
    assert few.count("; a bend is told by 6 heights at least") == 2


@pytest.mark.slow
def test_differences_of_control_have_the_weights_of_the_adjustment() -> None:
    """Control six times as wrong as stated, whose weights are estimated: no bend by that alone."""
    scene = aerial(3, 5, relief=30.0, noise_um=5.0, seed=1, tilt=0.03)
    rng = np.random.default_rng(1)
    control = tuple(
        ControlPoint(
            name, tuple((scene.points[name] + rng.normal(0, 0.3, 3)).tolist()), (0.05,) * 3
        )
        for name in list(scene.points)[::2]
    )
    cameras = tuple(replace(one, lens=BrownLens(k1=1e-9)) for one in scene.block.cameras)
    block = replace(scene.block, control=control, cameras=cameras)
    adjusted = anaplot.adjust(block, prior="separate").result.block
    problem, q = adjusted.problem, adjusted.cofactors.points[:, 2, 2]
    known = np.isfinite(problem.known_sigma[:, 2])
    [found] = doming(adjusted).differences
    left = np.mean(problem.known_sigma[known, 2] ** 2 - q[known])
    assert found.expected == pytest.approx(adjusted.sigma * np.sqrt(left))
    assert found.expected > 0.1 > found.bend.s / 10.0 > 0.001
    assert not found.bent
