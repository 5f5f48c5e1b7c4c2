"""How the session says no."""

from __future__ import annotations

from anaplot.errors import InputError

__all__ = ["EventRefusedError"]


class EventRefusedError(InputError):
    """An event that cannot happen in the present state; the state is unchanged."""
