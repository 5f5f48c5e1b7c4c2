"""An a-priori sigma of image coordinates in another unit is told, and gross errors are not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from startkinds import KINDS, measured, with_mismatches

from anaplot.adjustment.scale import ScaleError
from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.errors.grosserrors import block_gross_errors
from anaplot.photogrammetry.block import Block

DOUBT = "nearly all residuals in the images are"


def made(
    kind: str, seed: int, *, factor: float = 1.0, share: float = 0.0, noise: float = 1
) -> Block:
    """Return a block with so much noise, in units of 5 um, whose image_um is off by a factor."""
    rng = np.random.default_rng(seed)
    scene = measured(KINDS[kind](rng, 1), rng, noise)
    block = (with_mismatches(scene, rng, share) if share else scene).block
    return replace(block, precision=replace(block.precision, image_um=5.0 * factor))


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["strip", "block", "ring"])
@pytest.mark.parametrize("factor", [1e-3, 0.1, 1e3])
def test_another_unit_is_doubted_with_the_value_that_the_residuals_suggest(
    kind: str, factor: float
) -> None:
    block = made(kind, 0, factor=factor)
    (told,) = adjust_block(block).warnings
    assert told.startswith(DOUBT)
    assert f"image_um = {5.0 * factor:g} of [precision] in block.toml" in told
    assert ("lens" in told) == (factor < 1.0)
    # 99 degrees of freedom and more: beyond 4 standard deviations of 1 / sqrt(2 * 99)
    assert float(told.split("suggest ")[1].split(" um")[0]) == pytest.approx(5.0, rel=0.3)
    with pytest.raises(ScaleError, match=r"most residuals are .*is image_um = "):
        block_gross_errors(block, "baarda")


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.0, 0.01, 0.05, 0.1])
@pytest.mark.parametrize("kind", ["strip", "block", "ring"])
def test_neither_noise_nor_mismatches_are_taken_for_another_unit(kind: str, share: float) -> None:
    told = adjust_block(made(kind, 0, share=share)).warnings
    assert not any(DOUBT in line for line in told)
    assert any("there are gross errors" in line for line in told) == (share > 0.0)


@pytest.mark.parametrize("noise", [0.0, 1e-4])
def test_a_block_without_noise_suggests_nothing(noise: float) -> None:
    assert adjust_block(made("block", 0, noise=noise)).warnings == ()
