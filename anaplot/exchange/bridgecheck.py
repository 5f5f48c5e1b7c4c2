"""What a block must hold before its models can be formed one after another."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from anaplot.errors import InputError
from anaplot.photogrammetry.block import Block, ImagePoint, Strip
from anaplot.photogrammetry.selection import model_name, points_of, rows_by_photo
from anaplot.textfiles.wording import quoted

__all__ = ["check_for_bridge"]


def check_for_bridge(block: Block) -> None:
    """Refuse a block of which no strip can be begun.

    What is not measured yet of a block that is begun, and a later model without common points, is
    left to the computation, which prints the models before it.

    Raises
    ------
    InputError
        No strip, a photo in no strip, or no strip whose first model has common points: the first
        reason.
    """
    if not block.strips:
        raise InputError(
            "block.toml: no strip: at least one [[strip]] is needed to form models"
            " (adjust needs none)"
        )
    in_strips = {photo for strip in block.strips for photo in strip.photos}
    for photo in block.photos:
        if photo.id not in in_strips:
            raise InputError(f"block.toml: photo {quoted(photo.id)} is in no strip")
    rows = rows_by_photo(block.image_points)
    reasons = [_not_begun(strip, rows) for strip in block.strips]
    if all(reasons):
        raise InputError(f"image_points.csv: {reasons[0]}")


def _not_begun(strip: Strip, rows: Mapping[str, Sequence[ImagePoint]]) -> str:
    """Return why the first model of a strip cannot be formed; "" where it may be."""
    left, right = strip.photos[0], strip.photos[1]
    for name in (left, right):
        if name not in rows:
            what = "has no image points" if rows else "has no image points: there are none"
            return f"photo {quoted(name)} of strip {quoted(strip.id)} {what}"
    model = model_name(left, right)
    if points_of(rows[left], left, model).keys() & points_of(rows[right], right, model):
        return ""
    return (
        f"photos {quoted(left)} and {quoted(right)} of strip {quoted(strip.id)} have no common "
        "points"
    )
