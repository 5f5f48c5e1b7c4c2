"""Memory that arrays leave behind is taken by the next ones, not given back to the system.

Every array of a large block is larger than what the C library keeps for the next one: it asks the
system for its pages, the system fills them with zeros, and takes them back a moment later. That was
a fifth of the processor time of a block of a million rays.

What it costs: all arrays lie in one piece of memory that only grows and shrinks at its end. What is
freed below something that stays serves later arrays, but goes back to the system only when the
process ends. So it is for commands that compute and end, not for what runs for days.
"""

from __future__ import annotations

import sys

__all__ = ["keep_freed_memory"]

_TRIM_THRESHOLD, _MMAP_MAX = -1, -4  # <malloc.h>
_KEPT = 1 << 30  # bytes free at the end of the memory, beyond which it goes back


def keep_freed_memory() -> bool:
    """Tell the C library to keep freed memory until the process ends; return whether it does.

    Where it is not that of GNU, or cannot be told, nothing is changed.
    """
    if sys.platform != "linux":
        return False
    try:
        import ctypes

        told = ctypes.CDLL(None).mallopt
    except (ImportError, OSError, AttributeError):
        return False
    return bool(told(_MMAP_MAX, 0)) and bool(told(_TRIM_THRESHOLD, _KEPT))
