"""The block adjusted in the background, while measuring goes on.

One thread of its own owns the live block, or asks the process that does (`blockprocess`). Whoever
tells it a new state does not wait: the newest state takes the place of those not yet begun, and an
adjustment that newer measurements have overtaken is given up. The mathematics load there, when
there is something to adjust.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Collection, Set
from dataclasses import dataclass, replace
from functools import partial

from anaplot.photogrammetry.block import Block
from anaplot.session.state import ModelState, SessionState
from anaplot.session.workflow import Outlook
from anaplot.station.blockview import BlockView
from anaplot.station.blockviews import (
    ElsewhereError,
    LiveViews,
    OvertakenError,
    Views,
    fault,
)
from anaplot.station.imagepoints import Key, merged_rows
from anaplot.station.modeltables import ModelTables, TableKeeper

__all__ = ["BlockWatch"]

_MOST_WEAK = 3  # photos for which points are found that would help: the overview has few lines
_FIRST_SCREEN = 1.0  # s after opening before anything is loaded: the first screen comes first


@dataclass(frozen=True, slots=True, eq=False)
class _Work:
    """Everything that goes into one adjustment."""

    block: Block
    state: SessionState
    models: tuple[ModelState, ...]
    of_session: frozenset[str]
    once: frozenset[Key]
    current: str | None

    @property
    def provisional(self) -> bool:
        return self.current is not None

    @property
    def after(self) -> str:
        return self.current or (self.models[-1].name if self.models else "")

    def same_as(self, other: _Work | None) -> bool:
        """Whether an adjustment would come out the same."""
        return (
            other is not None
            and self.models == other.models
            and self.current == other.current
            and self.of_session == other.of_session
            and self.once == other.once
            and (self.block is other.block or self.block == other.block)
        )


class BlockWatch:
    """Keeps the block adjusted as a session goes on.

    Parameters
    ----------
    ready
        Called in the watch's own thread whenever there is a new view.
    rest
        Seconds after opening before anything is adjusted.
    """

    def __init__(self, ready: Callable[[], None], *, rest: float = _FIRST_SCREEN) -> None:
        self._ready = ready
        self._views: Views = LiveViews()
        self._begins = time.monotonic() + rest
        self._due = 0.0  # when the newest state may be computed
        self._changed = threading.Condition()
        self._told: _Work | None = None
        self._done: _Work | None = None
        self._view: BlockView | None = None
        self._keeper = TableKeeper()
        self._tables: ModelTables = {}
        self._closed = False
        self._thread: threading.Thread | None = None

    def apart(self) -> None:
        """Have the block adjusted by a process of its own from now on, where there is work."""
        from anaplot.station.blockprocess import BlockProcess

        with self._changed:
            self._views = BlockProcess()

    @property
    def view(self) -> BlockView | None:
        """What the block says; None before there is anything to adjust."""
        with self._changed:
            busy = self._told is not self._done
            if self._view is not None:
                return replace(self._view, busy=True) if busy else self._view
            if not busy or self._told is None:
                return None
            return BlockView(
                self._told.after, len(self._told.models), self._told.provisional, busy=True
            )

    @property
    def tables(self) -> ModelTables:
        """The tables of the accepted models, as far as they are computed."""
        with self._changed:
            return self._tables

    def tell(
        self,
        block: Block,
        state: SessionState,
        outlook: Outlook,
        of_session: Set[str],
        once: Collection[Key] = (),
        *,
        pause: float = 0.0,
    ) -> None:
        """Take notice of a new state; returns at once.

        Parameters
        ----------
        block
            As declared, with the image points found in the folder and the control.
        state, outlook
            The session's state and what follows from it. Accepted models take part; the current
            one, in the place of its accepted version where it has one, as soon as its pattern is
            complete and no y row of it is flagged: flagged x rows of ties stay, for the block
            alone says which of the two models is wrong.
        of_session
            Names of the models that the session has ever accepted.
        once
            Measurements of which it has ever written rows that name no model.
        pause
            Seconds before anything is computed: two threads at once share one interpreter, and
            whoever looks waits for the table of the model, not for the block.
        """
        current = _complete(state, outlook)
        work = _Work(
            block,
            state,
            state.models if current is None else state.models_with(current),
            frozenset(of_session if current is None else of_session | {current.name}),
            frozenset(once),
            None if current is None else current.name,
        )
        with self._changed:
            if self._closed or work.same_as(self._told):
                return
            if self._told is None and not work.models and not block.image_points:
                return
            self._told = work
            self._due = time.monotonic() + pause
            self._changed.notify_all()
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name="block", daemon=True)
                self._thread.start()

    def close(self) -> None:
        """End; an adjustment under way is given up. A second call does nothing."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join()

    # -- the thread ----------------------------------------------------------------------------

    def _run(self) -> None:
        with self._changed:
            rest = self._begins - time.monotonic()
            self._changed.wait_for(lambda: self._closed, max(rest, 0.0))
        try:
            self._keep_adjusted()
        finally:
            self._views.close()

    def _keep_adjusted(self) -> None:
        while (work := self._next()) is not None:
            try:
                self._tabled(work)
                view = self._adjusted(work)
            except OvertakenError:
                continue
            except Exception as error:  # noqa: BLE001 - measuring goes on; the operator is told
                view = _given_up(work, error)
            with self._changed:
                self._view, self._done = view, work
                if self._closed:
                    return
            self._ready()

    def _next(self) -> _Work | None:
        """Wait for something to adjust; None at the end."""
        with self._changed:
            self._changed.wait_for(lambda: self._closed or self._told is not self._done)
            while not self._closed and (rest := self._due - time.monotonic()) > 0.0:
                self._changed.wait(rest)
            return None if self._closed else self._told

    def _tabled(self, work: _Work) -> None:
        """Bring the tables of the accepted models up to date."""
        tables = self._keeper.update(work.block, work.state, partial(self._look_up, work))
        if tables is not self._tables:
            with self._changed:
                self._tables = tables
            self._ready()

    def _adjusted(self, work: _Work) -> BlockView | None:
        rows = merged_rows(work.block.image_points, work.models, work.of_session, once=work.once)
        block = replace(work.block, image_points=rows)
        # with a model in work the overview has given way to its table
        most = 0 if work.provisional else _MOST_WEAK
        return self._views.view(block, _nothing_of(work), most, partial(self._look_up, work))

    def _look_up(self, work: _Work) -> None:
        """Give up when overtaken; called many times on the way."""
        with self._changed:
            if self._closed or self._told is not work:
                raise OvertakenError


def _nothing_of(work: _Work) -> BlockView:
    """Return the view of a block of which nothing is known."""
    return BlockView(work.after, len(work.models), work.provisional)


def _given_up(work: _Work, error: Exception) -> BlockView:
    """Return what is shown when the program itself fails."""
    reason = str(error) if isinstance(error, ElsewhereError) else fault(error)
    return replace(_nothing_of(work), remark=f"the block could not be adjusted: {reason}")


def _complete(state: SessionState, outlook: Outlook) -> ModelState | None:
    """Return the current model if it is fit for the block, else None."""
    model, solution = state.current, outlook.solution
    if model is None or solution is None or model.pending:
        return None
    return None if any(row.axis == "y" for row in solution.flagged) else model
