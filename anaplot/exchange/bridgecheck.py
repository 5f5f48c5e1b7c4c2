"""What a block must hold before its models can be formed one after another."""

from __future__ import annotations

from anaplot.errors import InputError
from anaplot.photogrammetry.block import Block
from anaplot.photogrammetry.selection import model_name, points_of, rows_by_photo
from anaplot.textfiles.wording import quoted

__all__ = ["check_for_bridge"]


def check_for_bridge(block: Block) -> None:
    """Refuse a block whose strips cannot be begun, but for strips that are not measured yet.

    Photos without image points of a block that is begun, and a later model without common points,
    are left to the computation, which prints the models before them.

    Raises
    ------
    InputError
        No strip, a photo in no strip, a strip whose first model has no common points, or no strip
        whose first photos have image points.
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
    begun = [strip for strip in block.strips if rows.keys() >= set(strip.photos[:2])]
    if not begun:
        first = block.strips[0]
        name = next(name for name in first.photos[:2] if name not in rows)
        what = "has no image points" if rows else "has no image points: there are none"
        raise InputError(
            f"image_points.csv: photo {quoted(name)} of strip {quoted(first.id)} {what}"
        )
    for strip in begun:
        left, right = strip.photos[:2]
        model = model_name(left, right)
        common = points_of(rows[left], left, model).keys() & points_of(rows[right], right, model)
        if not common:
            raise InputError(
                f"image_points.csv: photos {quoted(left)} and {quoted(right)} of strip "
                f"{quoted(strip.id)} have no common points"
            )
