"""The tables of a block's accepted models, from the first to the last of every strip."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import NamedTuple

from anaplot.errors import NotComputableError
from anaplot.orientation.results import ModelSolution
from anaplot.orientation.strip import bridge_strip
from anaplot.photogrammetry.block import Block, ImagePoint, Strip
from anaplot.photogrammetry.selection import measured_in_files, rows_by_photo
from anaplot.session.models import solve_after
from anaplot.session.modelstate import ModelState
from anaplot.session.state import SessionState

__all__ = ["ModelTable", "ModelTables", "TableKeeper"]

Photos = tuple[str, str]


class ModelTable(NamedTuple):
    """What is known of an accepted model.

    Attributes
    ----------
    measured
        As it was measured; None where its rows come from elsewhere.
    preceding
        The solution that its ties come from; None for a first model.
    solution
        Its solution, or None.
    why
        Why there is none, or "".
    """

    measured: ModelState | None
    preceding: ModelSolution | None
    solution: ModelSolution | None
    why: str = ""


ModelTables = Mapping[Photos, ModelTable]


class TableKeeper:
    """Keeps the tables as a session goes on: what has not changed is not computed again."""

    def __init__(self) -> None:
        self._block: Block | None = None
        self._known: ModelTables = {}

    def update(
        self, block: Block, state: SessionState, look_up: Callable[[], None] = lambda: None
    ) -> ModelTables:
        """Return the tables of all accepted models of a session, and of those from elsewhere.

        Parameters
        ----------
        block
            As declared, with the image points of its files.
        state
            The session's state.
        look_up
            Called before each model; what it raises ends the computation, and what was known
            stays.

        Returns
        -------
        ModelTables
            By (left, right); the same object as before when nothing has changed.
        """
        accepted = {model.photos: model for model in state.models}
        elsewhere = measured_in_files(block) - accepted.keys()
        rows = cache(lambda: rows_by_photo(block.image_points))
        out: dict[Photos, ModelTable] = {}
        for strip in block.strips:
            before: ModelState | None = None
            preceding: ModelSolution | None = None
            for photos in strip.models():
                model = accepted.get(photos)
                if model is not None:
                    look_up()
                    out[photos] = self._of_session(block, model, before, preceding)
                    preceding = out[photos].solution
                before = model
            if not elsewhere.isdisjoint(strip.models()):
                look_up()
                out |= self._of_files(block, strip, elsewhere, rows)
        self._block = block
        if out.keys() != self._known.keys() or any(out[k] is not self._known[k] for k in out):
            self._known = out
        return self._known

    def _of_session(
        self,
        block: Block,
        model: ModelState,
        before: ModelState | None,
        preceding: ModelSolution | None,
    ) -> ModelTable:
        old = self._known.get(model.photos)
        if before is None:
            preceding = None
        if old is not None and old.measured is model and old.preceding is preceding:
            return old
        if before is not None and preceding is None:
            return ModelTable(model, None, None, f"model {before.name} before it has no table")
        return _table(block, model, before, preceding)

    def _of_files(
        self,
        block: Block,
        strip: Strip,
        elsewhere: frozenset[Photos],
        rows: Callable[[], Mapping[str, Sequence[ImagePoint]]],
    ) -> dict[Photos, ModelTable]:
        wanted = [photos for photos in strip.models() if photos in elsewhere]
        old = {photos: self._known[photos] for photos in wanted if photos in self._known}
        if block is self._block and len(old) == len(wanted):
            return old
        bridged = bridge_strip(block, strip, rows=rows())
        solved = {(model.left, model.right): model for model in bridged.models}
        why = bridged.error or ""
        return {
            photos: ModelTable(None, None, solved.get(photos), "" if photos in solved else why)
            for photos in wanted
        }


def _table(
    block: Block, model: ModelState, before: ModelState | None, preceding: ModelSolution | None
) -> ModelTable:
    try:
        solution = solve_after(block, model, before, preceding)
    except NotComputableError as error:
        return ModelTable(model, preceding, None, str(error))
    return ModelTable(model, preceding, solution)
