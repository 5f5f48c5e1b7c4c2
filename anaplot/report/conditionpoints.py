"""Conditions between points that no file knows."""

from __future__ import annotations

from anaplot.errors import InputError
from anaplot.photogrammetry.block import Block
from anaplot.photogrammetry.imagepoints import columns_of
from anaplot.textfiles.wording import hint, quoted

__all__ = ["refuse_unknown_points"]


def refuse_unknown_points(block: Block) -> None:
    """Refuse a condition on a point that is neither measured nor in control.csv.

    An adjustment in a session does not: what is not measured yet may be measured later.

    Raises
    ------
    InputError
        With the file and line of the condition, and the nearest name that there is.
    """
    if not block.conditions:
        return
    known = {*columns_of(block.image_points).point.values, *(row.point for row in block.control)}
    for one in block.conditions:
        for name in one.points:
            if name not in known:
                # as the files' readers say it
                file, _, line = one.where.rpartition(":")
                place = f"{file} line {line}" if file else one.id
                raise InputError(f"{place}: unknown point {quoted(name)}{hint(name, known)}")
