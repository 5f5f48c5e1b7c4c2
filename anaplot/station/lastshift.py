"""By how much the counters of an instrument were moved when its last session ended."""

from __future__ import annotations

from pathlib import Path

from anaplot.exchange.journalbackwards import latest_records
from anaplot.exchange.recordline import OPENING
from anaplot.photogrammetry.readings import Position
from anaplot.station.payloads import opened_by, shift_of

__all__ = ["last_shift"]


def last_shift(folder: Path, profile: str) -> Position | None:
    """Return the offset [mm] of an instrument's counters, or None: they count as they are.

    Counters go on counting while a block is closed. Whether one that is incremental was switched
    off meanwhile is for the desk to find out.

    Parameters
    ----------
    folder
        The block folder, whose journal is verified.
    profile
        The instrument's. Sessions with others say nothing of it, and leave it as it is.

    Raises
    ------
    InputError
        The journal cannot be read, or holds something else than an offset.
    """
    found: Position | None = None
    for record in latest_records(folder, (*OPENING, "referenced")):
        if record.kind == "referenced":
            found = found or shift_of(record)
            continue
        said = opened_by(record)
        if said.goes_on:
            continue
        if said.profile == profile:
            # a simulated device begins anew with every session; an older program's session too
            return None if said.simulated else found or said.shift
        found = None
    return None
