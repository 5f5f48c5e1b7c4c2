"""The live block and what a screen shows of it, in whatever thread or process has the time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Protocol

from anaplot.errors import AnaplotError
from anaplot.photogrammetry.block import Block
from anaplot.station.blockview import BlockView

if TYPE_CHECKING:
    from anaplot.bundle.live import LiveBlock

__all__ = ["ElsewhereError", "LiveViews", "OvertakenError", "Views", "fault"]


class OvertakenError(Exception):
    """What is being adjusted is no longer the newest, or nobody wants it any more."""


class ElsewhereError(Exception):
    """Something went wrong where the block is adjusted; in words that say what."""


def fault(error: Exception) -> str:
    """Return in words what went wrong where the program itself fails."""
    return f"{type(error).__name__}: {error}" if str(error) else type(error).__name__


class Views(Protocol):
    """Who adjusts a block again and again, as it grows."""

    def view(
        self, block: Block, empty: BlockView, most_weak: int, look_up: Callable[[], None]
    ) -> BlockView | None:
        """Return what the block says now, from where it stood; None where nothing is in it.

        Parameters
        ----------
        block
            The block as it is now.
        empty
            A view that says which models are in it, and nothing else.
        most_weak
            For how many weak photos points are found that would help them.
        look_up
            Called many times on the way; what it raises comes out of here, and the block stays as
            it was before.
        """

    def close(self) -> None:
        """End whatever was begun for it."""


class LiveViews:
    """Adjusts the block here, in the thread that asks."""

    def __init__(self) -> None:
        self._live: LiveBlock | None = None
        self._since: dict[str, str] = {}

    def view(
        self, block: Block, empty: BlockView, most_weak: int, look_up: Callable[[], None]
    ) -> BlockView | None:
        """See `Views`; the mathematics load with the first block."""
        if not block.image_points:
            self._forget()
            return None
        try:
            return self._adjusted(block, empty, most_weak, look_up)
        except OvertakenError:
            raise
        except AnaplotError as error:
            return replace(empty, remark=str(error))
        except Exception:
            # what the live block holds now is not to be built upon
            self._forget()
            raise

    def close(self) -> None:
        """Nothing was begun."""

    def _forget(self) -> None:
        self._live, self._since = None, {}

    def _adjusted(
        self, block: Block, empty: BlockView, most_weak: int, look_up: Callable[[], None]
    ) -> BlockView:
        from anaplot.bundle.live import LiveBlock
        from anaplot.station.blockanswer import view_of

        known = self._live is not None and self._live.answer is not None
        if self._live is None:
            self._live = LiveBlock(block)
        answer = self._live.update(block, progress=lambda _what, _share: look_up())
        view = view_of(answer, empty, self._since if known else None, most_weak=most_weak)
        self._since = {point.point: point.since for point in view.suspects}
        return view
