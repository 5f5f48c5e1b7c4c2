"""Whether image_points.csv still says of a session's models what its journal does."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Set
from pathlib import Path

from anaplot.errors import InputError
from anaplot.exchange.blockfolder import IMAGE_POINTS_CSV
from anaplot.photogrammetry.block import Block, ImagePoint
from anaplot.photogrammetry.measuredimage import computed_place
from anaplot.session.events import DecisionsTakenOver
from anaplot.session.modelstate import ModelState
from anaplot.session.state import SessionState, apply, start
from anaplot.station.editedrows import EditedRow, told
from anaplot.station.imagepoints import (
    Key,
    measured_here,
    rows_of,
)
from anaplot.station.rejectedelsewhere import agreeing
from anaplot.textfiles.csvlines import cell_value, cells_of

__all__ = [
    "check_unedited",
    "decided_rows",
    "edited_rows",
    "written_once",
]

Name = tuple[str, str, str | None]


def decided_rows(
    block: Block, state: SessionState, taken: Iterable[DecisionsTakenOver]
) -> Iterator[EditedRow]:
    """Yield the rows in which what a strategy has switched differs from the journal."""
    rows = {(row.left, row.right, row.point) for event in taken for row in event.rows}
    models = {f"{left}/{right}" for left, right, _ in rows}
    points = {
        (photo, point, model)
        for left, right, point in rows
        for photo in (left, right)
        for model in (f"{left}/{right}", None)
    }
    own = {_name(row): row for row in rows_of(m for m in state.models if m.name in models)}
    for row in block.image_points:
        mine = own.get(_name(row))
        if mine is not None and _name(row) in points and mine.use != row.use:
            yield EditedRow(row, mine, taken_over=True)


def edited_rows(
    folder: Path, block: Block, state: SessionState, of_session: Collection[str]
) -> tuple[EditedRow, ...]:
    """Return the rows of the session's that somebody else changed.

    The file may lag behind the journal (a full disk, a power cut): what the session has ever
    written is no change. Nor are reasons, rows of models that it never accepted, and what it has
    taken over of a strategy's.

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
        The journal cannot be read.
    """
    own = {_name(row): row for row in rows_of(state.models)}
    uses = _has_use(folder / IMAGE_POINTS_CSV)
    measured = measured_here(state.models)
    agreed = agreeing(block.image_points, state.models)

    def differs(row: ImagePoint) -> bool:
        mine = own.get(_name(row))
        if mine is not None and (mine.x, mine.y) == computed_place(row):
            return uses and mine.use != row.use and _name(row) not in agreed
        if row.model is None or row.model not in of_session:
            return False  # from elsewhere
        return mine is not None or (row.photo, row.point, *computed_place(row)) not in measured

    other = [row for row in block.image_points if differs(row)]
    if not other:
        return ()
    written, ever = _written(folder, block, {row.photo for row in other})

    def known(row: ImagePoint) -> bool:
        place = computed_place(row)
        if (row.photo, row.point, *place) not in ever:
            return False
        return not uses or (*_name(row), *place, row.use) in written

    return tuple(EditedRow(row, own.get(_name(row))) for row in other if not known(row))


def check_unedited(
    folder: Path, block: Block, state: SessionState, of_session: Collection[str]
) -> None:
    """Refuse a file of which a row of the session's was changed by somebody else.

    Parameters
    ----------
    folder, block, state, of_session
        As `edited_rows` has them.

    Raises
    ------
    InputError
        The first row that differs: photo and point, both versions, and what to do.
    """
    for row in edited_rows(folder, block, state, of_session):
        raise InputError(told(folder, row))


def written_once(folder: Path, block: Block, state: SessionState) -> frozenset[Key]:
    """Return the measurements whose rows in the file are the session's, though they name no model.

    The file may lag behind the journal: a row that belonged to two models of a mono comparator as
    they were before is no measurement from elsewhere.

    Parameters
    ----------
    folder, block, state
        As `edited_rows` has them.

    Raises
    ------
    InputError
        The journal cannot be read.
    """
    photos = {photo for model in state.models if model.mono for photo in model.photos}
    shared = {
        (row.photo, row.point, *computed_place(row))
        for row in block.image_points
        if row.model is None and row.photo in photos
    }
    now = shared & measured_here(state.models) if shared else shared
    others = shared - now
    if not others:
        return frozenset(now)
    _, ever = _written(folder, block, {photo for photo, *_ in others})
    return frozenset(now | (others & ever))


def _name(row: ImagePoint) -> Name:
    return row.photo, row.point, row.model


def _has_use(path: Path) -> bool:
    """Whether the file has the column use: older versions wrote none, nor is it always needed."""
    try:
        with path.open(encoding="utf-8-sig") as file:
            return "use" in map(cell_value, cells_of(file.readline().rstrip("\n")))
    except FileNotFoundError:
        return False


def _written(folder: Path, block: Block, photos: Set[str]) -> tuple[set[object], set[object]]:
    """Return every row of photos, and every measurement, that the session has ever had to write.

    The rows of a photo follow from the models that have it: nothing else is looked at.
    """
    state = start(block)
    known: tuple[ModelState, ...] = ()
    written: set[object] = set()
    ever: set[object] = set()
    from anaplot.station.sessionlog import read_history  # loads the room of instruments

    for _, _, event in read_history(folder)[1]:
        before, state = state, apply(state, event)
        if state.models is before.models:
            continue
        models = tuple(m for m in state.models if not photos.isdisjoint(m.photos))
        if models != known:
            known = models
            rows = (row for row in rows_of(models) if row.photo in photos)
            written.update((*_name(r), r.x, r.y, r.use) for r in rows)
            ever.update(measured_here(models))
    return written, ever
