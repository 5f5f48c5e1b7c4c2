"""What is asked after a measurement was changed."""

from __future__ import annotations

from collections.abc import Mapping

from anaplot.console.keybar import show_key
from anaplot.session.reasons import REASONS
from anaplot.station.snapshot import Snapshot

__all__ = ["why_line"]


def why_line(snapshot: Snapshot, keys: Mapping[str, tuple[str, ...]]) -> str:
    """Return the question why, with the keys that answer it; "" when there is nothing to ask.

    It stands there until it is answered, or something else has happened.
    """
    change = snapshot.last_change
    asked = change is not None and change.latest and change.reason is None
    if not asked or snapshot.link.state == "replay":
        return ""
    answers = (f"{show_key(keys[f'why_{reason}'][0])} {reason}" for reason in REASONS)
    return f"why? {' '.join(answers)}"
