"""Progress of a long computation, and the request to end it early."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext

from anaplot.aliases import Progress

__all__ = ["Watch"]


class Watch:
    """Told of the progress of a computation, and asked by it whether to stop.

    Parameters
    ----------
    progress
        Called with what is being done and the fraction of it (0 to 1); None: nobody looks.

    Attributes
    ----------
    stopped
        Whether the computation is to end with the best that it has.
    """

    def __init__(self, progress: Progress | None = None) -> None:
        self._progress = progress
        self.stopped = False

    def __call__(self, what: str, fraction: float) -> None:
        """Say what is being done and how much of it is done."""
        if self._progress is not None:
            self._progress(what, fraction)

    def searching(self) -> AbstractContextManager[Watch]:
        """Return what lasts as long as a search that may be ended early."""
        return nullcontext(self)

    def stop(self) -> None:
        """Ask for the end."""
        self.stopped = True
