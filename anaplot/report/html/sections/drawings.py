"""The figures of an adjusted block, with what they show."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.drawing.drawing import Drawing
from anaplot.report.figures.blockmap import block_map
from anaplot.report.figures.photobars import photo_redundancy
from anaplot.report.figures.pointmaps import (
    accuracy_maps,
    detectable_map,
    effect_map,
    redundancy_map,
)
from anaplot.report.figures.residuals import residual_pattern
from anaplot.report.figures.testvalues import (
    histogram_of_w,
    image_coordinates,
    quantiles_of_w,
)
from anaplot.report.html.parts import HtmlBlock, Section

__all__ = ["map_section", "maps_section", "residuals_section"]

_WHAT = "image coordinates"


def map_section(block: AdjustedBlock) -> Section:
    """Return the map of the block."""
    return Section("map", "Map of the block", (block_map(block),))


def residuals_section(block: AdjustedBlock) -> Section | None:
    """Return residuals over all photos, and their distribution."""
    of = image_coordinates(block)
    drawings: list[Drawing | None] = [
        histogram_of_w(block.tested, of, key="histogram-of-w", what=_WHAT),
        quantiles_of_w(block.tested, of, key="quantiles-of-w", what=_WHAT),
        *_patterns(block),
    ]
    blocks: list[HtmlBlock] = [one for one in drawings if one is not None]
    return Section("residuals", "Residuals", tuple(blocks)) if blocks else None


def _patterns(block: AdjustedBlock) -> Iterator[Drawing | None]:
    """Yield what the residuals of each camera's photos have in common."""
    problem = block.problem
    used = np.bincount(problem.cameras, minlength=len(problem.block.cameras))
    for k, camera in enumerate(problem.block.cameras):
        if used[k]:
            yield residual_pattern(block, camera.id, key=f"residual-pattern-{k + 1}")


def maps_section(block: AdjustedBlock) -> Section | None:
    """Return where the block is accurate, checked, and what stays undetected."""
    maps = (
        *accuracy_maps(block),
        redundancy_map(block),
        detectable_map(block),
        effect_map(block),
        photo_redundancy(block),
    )
    found = tuple(one for one in maps if one is not None)
    return Section("maps", "Accuracy and reliability over the ground", found) if found else None
