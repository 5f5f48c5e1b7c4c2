"""What circles of objects leave behind is looked for when nobody waits.

Python looks for it whenever enough objects have come: among new ones seven times in a record, 4 ms
together; and with all modules loaded a complete search takes 50 to 100 ms, and fell into every
twentieth record. Here both wait for the moment after the table of a record is shown, in which
nobody can have pointed at the next point yet, or until nothing has happened for a while.
"""

from __future__ import annotations

import contextlib
import gc
import sys
from collections.abc import Iterator

__all__ = ["at_ease", "tidy"]

_SWITCH = 0.001  # s after which a thread that computes lets others on: screen and station wait
_NEW = 20_000  # objects, as of four records, that are searched without waiting
_SHORT = 10  # such searches, after which those that they left are searched with them
_LONGER = 1000  # of these, after which a complete one does not wait any more
_ENOUGH = 5  # of them, for a complete one to be worth its time


@contextlib.contextmanager
def at_ease() -> Iterator[None]:
    """Let nothing stop the screen for longer than it must, as long as it lasts."""
    interval, limits = sys.getswitchinterval(), gc.get_threshold()
    sys.setswitchinterval(_SWITCH)
    # what is loaded by now stays
    gc.freeze()
    gc.set_threshold(_NEW, _SHORT, _LONGER)
    try:
        yield
    finally:
        sys.setswitchinterval(interval)
        gc.set_threshold(*limits)
        gc.unfreeze()


def tidy() -> None:
    """Search for what is left behind: among all objects if enough may have come together."""
    if gc.get_count()[2] >= _ENOUGH:
        gc.collect()
    else:
        gc.collect(1)
