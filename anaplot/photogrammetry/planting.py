"""Errors put into measurements, to see what the statistics make of them (1983, Tables 1 and 2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from anaplot.aliases import Axis
from anaplot.errors import InputError
from anaplot.photogrammetry.block import Block, Camera, ImagePoint
from anaplot.photogrammetry.measuredimage import has_lens, ideal_rays, measured_rays
from anaplot.textfiles.wording import hint, quoted

__all__ = ["PlantedError", "with_planted_errors"]


class PlantedError(NamedTuple):
    """An error in an image coordinate.

    Attributes
    ----------
    where
        "PHOTO:POINT" as it was typed; names may hold colons themselves.
    axis
        "x" or "y".
    um
        Its size [um].
    """

    where: str
    axis: Axis
    um: float


def with_planted_errors(block: Block, planted: Sequence[PlantedError]) -> Block:
    """Return a block with errors in its image coordinates; its files stay as they are.

    A ray that is measured in two models has the error in both.

    Raises
    ------
    InputError
        There is no such image point; names the nearest.
    """
    rows = list(block.image_points)
    by_name: dict[str, list[int]] = {}
    for k, row in enumerate(rows):
        by_name.setdefault(f"{row.photo}:{row.point}", []).append(k)
    for one in planted:
        if one.where not in by_name:
            known = hint(one.where, list(by_name)[:_SEARCHED])
            raise InputError(f"--plant: no image point {quoted(one.where)} (PHOTO:POINT){known}")
        for k in by_name[one.where]:
            rows[k] = _moved(block.camera_of(rows[k].photo), rows[k], one)
    return replace(block, image_points=tuple(rows))


def _moved(camera: Camera, row: ImagePoint, one: PlantedError) -> ImagePoint:
    """Return an image point with an error in what was measured, before any lens is taken off."""
    if not has_lens(camera):
        return replace(row, **{one.axis: getattr(row, one.axis) + 1e-3 * one.um})
    measured = measured_rays(camera, [(row.x, row.y)])
    measured[0, "xy".index(one.axis)] += 1e-3 * one.um
    x, y = ideal_rays(camera, measured)[0].tolist()
    return replace(row, x=x, y=y)


_SEARCHED = 20_000  # names among which the nearest is looked for
