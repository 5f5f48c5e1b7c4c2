"""Tables of an adjusted block for other programs, with the person's coordinates beside ours."""

from __future__ import annotations

import numpy as np

from anaplot.errors import InputError
from anaplot.exchange.formats.crs import GroundFrame
from anaplot.exchange.formats.door import Exporting, Note, ResultColumn, ResultTable
from anaplot.photogrammetry.groundsystem import GroundSystem
from anaplot.textfiles.wording import place

__all__ = ["frame_of", "result_tables"]

_AXES = ("X", "Y", "Z")


def result_tables(exporting: Exporting) -> tuple[tuple[ResultTable, ...], tuple[Note, ...]]:
    """Return the tables of an adjusted block, and what is to be said of their coordinates.

    In a block whose ground has a coordinate system, photos and points have `crs_x`, `crs_y` and
    `crs_z` too: east (longitude), north (latitude) and height there.

    Raises
    ------
    InputError
        The system is unknown, or pyproj is missing.
    """
    if exporting.adjusted is None:
        raise InputError("nothing was adjusted")
    tables = exporting.adjusted.tables()
    system = exporting.block.ground
    if system is None:
        note = Note("assumed", None, "X, Y, Z are the block's own: it has no coordinate system")
        return tables, (note,)
    frame = frame_of(exporting, system)
    text = f"crs_x, crs_y, crs_z are those of {system.crs}; X, Y, Z the block's own"
    return tuple(_with_crs(table, frame) for table in tables), (Note("changed", None, text),)


def frame_of(exporting: Exporting, system: GroundSystem) -> GroundFrame:
    """Return the frame that the block's file states; raises InputError that names the file."""
    try:
        return GroundFrame.of(system)
    except InputError as error:
        file = place(exporting.folder / "block.toml")
        raise InputError(f"{file}: [ground]: {error}") from None


def _with_crs(table: ResultTable, frame: GroundFrame) -> ResultTable:
    by_name = {column.name: column for column in table.columns}
    if table.name not in ("photos", "points") or not table.columns[0].values:
        return table
    xyz = np.array([by_name[axis].values for axis in _AXES], dtype=float).T
    theirs = frame.out_of_block(xyz).T.tolist()
    flat, up = frame.theirs.units()
    more = tuple(
        ResultColumn(f"crs_{axis.lower()}", unit, tuple(values))
        for axis, unit, values in zip(_AXES, (flat, flat, up), theirs, strict=True)
    )
    return table._replace(columns=(*table.columns, *more))
