"""Whether image_points.csv still says of a session's models what its journal does."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from anaplot.errors import InputError
from anaplot.exchange.blockfolder import IMAGE_POINTS_CSV
from anaplot.photogrammetry.block import Block, ImagePoint
from anaplot.session.state import SessionState, apply, start
from anaplot.station.imagepoints import measured_here, rows_of
from anaplot.station.sessionlog import read_history
from anaplot.textfiles.wording import place, quoted

__all__ = ["check_unedited"]

Name = tuple[str, str, str | None]
_BACK = "adjust --apply-undo takes back what --apply switched off"


def check_unedited(
    folder: Path, block: Block, state: SessionState, of_session: Collection[str]
) -> None:
    """Refuse a file of which a row of the session's was changed by somebody else.

    The file may lag behind the journal (a full disk, a power cut): what the session has ever
    written is no change. Nor are reasons, and rows of models that it never accepted.

    Parameters
    ----------
    folder
        The block folder.
    block
        As read from it.
    state
        To which the journal led.
    of_session
        Names "left/right" of every model that the session has ever accepted.

    Raises
    ------
    InputError
        The first row that differs: photo and point, both versions, and what to do.
    """
    own = {_name(row): row for row in rows_of(state.models)}
    uses = _has_use(folder / IMAGE_POINTS_CSV)
    measured = measured_here(state.models)

    def differs(row: ImagePoint) -> bool:
        mine = own.get(_name(row))
        if mine is not None and (mine.x, mine.y) == (row.x, row.y):
            return uses and mine.use != row.use
        if row.model is None or row.model not in of_session:
            return False  # from elsewhere
        return mine is not None or (row.photo, row.point, row.x, row.y) not in measured

    other = [row for row in block.image_points if differs(row)]
    if not other:
        return
    written, ever = _written(folder, block)
    for row in other:
        known = (row.photo, row.point, row.x, row.y) in ever
        if known and (not uses or (*_name(row), row.x, row.y, row.use) in written):
            continue
        raise InputError(f"{place(folder / IMAGE_POINTS_CSV)}: {_told(row, own.get(_name(row)))}")


def _name(row: ImagePoint) -> Name:
    return row.photo, row.point, row.model


def _has_use(path: Path) -> bool:
    """Whether the file has the column use: older versions wrote none, nor is it always needed."""
    try:
        with path.open(encoding="utf-8-sig") as file:
            return "use" in [name.strip() for name in file.readline().split(",")]
    except FileNotFoundError:
        return False


def _written(folder: Path, block: Block) -> tuple[set[object], set[object]]:
    """Return every row, and every measurement, that the session has ever had to write."""
    state = start(block)
    written: set[object] = set()
    ever: set[object] = set()
    for _, _, event in read_history(folder)[1]:
        before, state = state, apply(state, event)
        if state.models != before.models:
            written.update((*_name(r), r.x, r.y, r.use) for r in rows_of(state.models))
            ever.update(measured_here(state.models))
    return written, ever


def _told(row: ImagePoint, mine: ImagePoint | None) -> str:
    where = f"photo {quoted(row.photo)}, point {quoted(row.point)}"
    if row.model is not None:
        where += f" of model {quoted(row.model)}"
    if mine is None:
        return (
            f"{where} is not in the session's journal: take the row out, or leave its model blank"
        )
    if (mine.x, mine.y) != (row.x, row.y):
        return (
            f"{where} was changed outside the session: x, y are {row.x}, {row.y} there and "
            f"{mine.x}, {mine.y} in the journal: put them back, then measure again in the console"
        )
    return (
        f"{where} was changed outside the session: use is {row.use} there and {mine.use} in the "
        f"journal: put it back ({_BACK}), then switch the row in the console"
    )
