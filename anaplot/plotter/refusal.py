"""How a record that is no valid reading is turned away inside the decoder."""

from __future__ import annotations

__all__ = ["RefusedError"]


class RefusedError(Exception):
    """A record is no valid reading; the message is the reason."""
