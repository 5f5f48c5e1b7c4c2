"""A strip measured without a session: its rows stand in the file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from anaplot.exchange.blockfolder import write_image_points, write_new_block
from anaplot.photogrammetry.block import ImagePoint, TestSettings
from anaplot.planning.synthetic import SyntheticStrip, synthetic_strip


def write_measured(
    folder: Path,
    *,
    models: int,
    measured: int,
    seed: int = 3,
    keep_models: bool = True,
    change: Callable[[ImagePoint], ImagePoint] = lambda row: row,
) -> SyntheticStrip:
    """Write a block of one strip whose first models are measured with 3 um of noise."""
    made = synthetic_strip(models + 1, seed=seed, test=TestSettings(kind="baarda", alpha=1e-5))
    rng = np.random.default_rng(seed)
    rows: list[ImagePoint] = []
    (strip,) = made.block.strips
    for left, right in strip.models()[:measured]:
        shared = sorted(made.truth[left].keys() & made.truth[right].keys())
        for photo in (left, right):
            for point in shared:
                x, y = np.array(made.truth[photo][point]) + rng.normal(0.0, 0.003, 2)
                model = f"{left}/{right}" if keep_models else None
                row = ImagePoint(photo, point, round(x, 4), round(y, 4), model=model)
                if keep_models or not any((r.photo, r.point) == (photo, point) for r in rows):
                    rows.append(row)
    write_new_block(folder, replace(made.block, image_points=()))
    write_image_points(folder, [change(row) for row in rows])
    return made
