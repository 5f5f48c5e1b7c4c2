"""What circles of objects leave behind is looked for when nobody waits.

Python looks for it whenever enough objects have come: with all modules loaded a complete search
takes 50 to 100 ms, and fell into every twentieth record. Here only the short searches among new
objects come by themselves; the complete one waits for the moment after the table of a record is
shown, in which nobody can have pointed at the next point yet, or until nothing has happened for a
while.
"""

from __future__ import annotations

import contextlib
import gc
import sys
from collections.abc import Iterator

__all__ = ["at_ease", "tidy"]

_SWITCH = 0.001  # s after which a thread that computes lets others on: screen and station wait
_OFTEN = (700, 10)  # new objects and short searches: little at a time, Python's own
_BY_ITSELF = 1000  # longer searches after which a complete one does not wait any more
_ENOUGH = 5  # of them, for a complete one to be worth its time


@contextlib.contextmanager
def at_ease() -> Iterator[None]:
    """Let nothing stop the screen for longer than it must, as long as it lasts."""
    interval, limits = sys.getswitchinterval(), gc.get_threshold()
    sys.setswitchinterval(_SWITCH)
    # what is loaded by now stays
    gc.freeze()
    gc.set_threshold(*_OFTEN, _BY_ITSELF)
    try:
        yield
    finally:
        sys.setswitchinterval(interval)
        gc.set_threshold(*limits)
        gc.unfreeze()


def tidy() -> None:
    """Search all objects for what is left behind, if enough may have come together."""
    if gc.get_count()[2] >= _ENOUGH:
        gc.collect()
