"""Where a block stands while it is measured: kept from change to change."""

from __future__ import annotations

from dataclasses import replace

from anaplot.orientation.results import ModelSolution
from anaplot.photogrammetry.block import Block, Strip
from anaplot.photogrammetry.selection import measured_in_files
from anaplot.session.desk import Desk
from anaplot.session.modelstate import ModelState
from anaplot.session.recomputed import Recomputed
from anaplot.station.blockstatus import (
    BlockStatus,
    ModelStatus,
    StripStatus,
    first_open,
    standing,
    suspected_models,
    untied,
    waiting,
    with_table,
)
from anaplot.station.blockstep import following
from anaplot.station.blockview import BlockView
from anaplot.station.coverage import Coverage, coverage_of, is_held
from anaplot.station.modeltables import ModelTables

__all__ = ["LiveStatus"]

Photos = tuple[str, str]


class LiveStatus:
    """Says again and again where a block stands; only what has changed is looked at anew.

    Parameters
    ----------
    folder
        How the command line names the block.
    """

    def __init__(self, folder: str) -> None:
        self._folder = folder
        self._files: Block | None = None
        self._coverage = Coverage(0, 0, 0)
        self._there: frozenset[Photos] = frozenset()
        self._newest: tuple[ModelState, ModelSolution] | None = None
        self._models: tuple[ModelState, ...] = ()
        self._tables: ModelTables | None = None
        self._suspected: frozenset[str] = frozenset()
        self._recomputed: tuple[Recomputed, ...] = ()
        self._strips: tuple[StripStatus, ...] = ()

    def now(
        self,
        block: Block,
        desk: Desk,
        view: BlockView | None,
        tables: ModelTables,
    ) -> BlockStatus:
        """Return where the block stands.

        Parameters
        ----------
        block
            As declared, with the image points of its files and the control.
        desk
            The session as it stands.
        view
            What the block as one bundle says, or None.
        tables
            Those of accepted models, as far as they are known yet.
        """
        state, ahead, recomputed = desk.state, desk.outlook, desk.recomputed
        if self._files is not block:
            self._files = block
            self._coverage = coverage_of(block)
            self._there = measured_in_files(block)
            self._tables = None
        if state.current is not None and ahead.solution is not None:
            self._newest = state.current, ahead.solution
        suspected = suspected_models(view)
        if (
            self._tables is not tables
            or self._models is not state.models
            or self._suspected != suspected
            or self._recomputed is not recomputed
        ):
            # all but the model in work, which changes with every point
            self._tables, self._models, self._suspected = tables, state.models, suspected
            self._recomputed = recomputed
            accepted = {model.photos: model for model in state.models}
            anew = frozenset(one.name for one in recomputed)
            self._strips = tuple(
                self._strip(strip, accepted, tables, suspected, anew) for strip in block.strips
            )
        strips = self._strips
        if state.current is not None:
            work = with_table(
                state.current.photos, "in work", ahead.solution, state.current, ahead.alarm
            )
            strips = tuple(_with_work(strip, state.current.strip, work) for strip in strips)
            waits = waiting(state)
            if waits is not None:
                strips = tuple(_with_waiting(strip, waits) for strip in strips)
        # the next key begins what the session has not measured, unless all is measured elsewhere
        opened = ""
        if ahead.next_model is not None and first_open(strips):
            opened = "/".join(ahead.next_model[1:])
        measured, held = bool(block.image_points), is_held(block)
        apart = untied(strips, self._coverage, view)
        step = following(
            opened, measured, view, self._folder, state, ahead, held=held, untied=apart
        )
        return BlockStatus(strips, recomputed, view, self._coverage, step)

    def _strip(
        self,
        strip: Strip,
        accepted: dict[Photos, ModelState],
        tables: ModelTables,
        suspected: frozenset[str],
        anew: frozenset[str],
    ) -> StripStatus:
        return StripStatus(
            strip.id,
            tuple(
                self._model(photos, accepted.get(photos), tables, suspected, anew)
                for photos in strip.models()
            ),
        )

    def _model(
        self,
        photos: Photos,
        accepted: ModelState | None,
        tables: ModelTables,
        suspected: frozenset[str],
        anew: frozenset[str],
    ) -> ModelStatus:
        if accepted is None and photos not in self._there:
            return ModelStatus(*photos, "open")
        name = "/".join(photos)
        wrong = name in suspected
        table = tables.get(photos)
        if table is not None and table.measured is accepted:
            stands = standing(table.solution, suspected=wrong, recomputed=name in anew)
            return with_table(photos, stands, table.solution, accepted, table.why)
        if self._newest is not None and self._newest[0] is accepted:
            solution = self._newest[1]
            return with_table(photos, standing(solution, suspected=wrong), solution, accepted, "")
        # its table is being computed
        return with_table(photos, "look" if wrong else "accepted", None, accepted, "")


def _with_work(strip: StripStatus, name: str, work: ModelStatus) -> StripStatus:
    if strip.strip != name:
        return strip
    models = (work if m.name == work.name else m for m in strip.models)
    return StripStatus(strip.strip, tuple(models))


def _with_waiting(strip: StripStatus, photos: Photos) -> StripStatus:
    models = tuple(
        replace(m, state="in work") if (m.left, m.right) == photos and m.state == "open" else m
        for m in strip.models
    )
    return StripStatus(strip.strip, models)
