"""Positions and angles that err by more than they state are not off by the same for that."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from gnssblocks import flown

from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.hypotheses.offsetadvice import offset_advice
from anaplot.photogrammetry.block import Block
from anaplot.photogrammetry.prioroffsets import PriorOffsets

pytestmark = pytest.mark.slow

POSITION, ROTATION = 0.05 * np.array((1.0, 1.0, 1.5)), 2e-4 * np.array((1.0, 1.0, 2.0))


def erring(seed: int, *, position: float = 1.0, rotation: float = 1.0, off: float = 0.0) -> Block:
    """Two strips whose positions, or angles, err by times of what they state, and are off in X."""
    block = flown(PriorOffsets(), seed=seed, strips=2, length=5).scene.block
    rng = np.random.default_rng(seed)

    def more(times: float, sigma: np.ndarray) -> np.ndarray:
        return rng.normal(size=3) * sigma * np.sqrt(times**2 - 1.0)

    photos = tuple(
        replace(
            photo,
            position=tuple((photo.position + more(position, POSITION) + (off, 0.0, 0.0)).tolist()),
            rotation=tuple((photo.rotation + more(rotation, ROTATION)).tolist()),
        )
        for photo in block.photos
    )
    return replace(block, photos=photos)


@pytest.mark.parametrize("kind", ["position", "rotation"])
def test_what_errs_by_eight_times_is_not_advised_to_be_off(kind: str) -> None:
    # by chance .001 each: two of ten have a probability of 5e-5
    advised = [offset_advice(adjust_block(erring(seed, **{kind: 8.0}))) for seed in range(10)]
    assert sum(bool(one) for one in advised) <= 1


@pytest.mark.parametrize(("times", "off"), [(1.0, 0.3), (8.0, 3.0)])
def test_what_is_off_is_told_however_it_errs(times: float, off: float) -> None:
    for seed in range(3):
        (advised,) = offset_advice(adjust_block(erring(seed, position=times, off=off)))
        assert advised.kind == "shift"
