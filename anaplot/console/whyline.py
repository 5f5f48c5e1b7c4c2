"""What is asked after a measurement was changed."""

from __future__ import annotations

from collections.abc import Mapping

from anaplot.console.keybar import show_key
from anaplot.session.reasons import REASONS
from anaplot.station.snapshot import Snapshot

__all__ = ["why_line"]


def why_line(snapshot: Snapshot, keys: Mapping[str, tuple[str, ...]]) -> tuple[str, str]:
    """Return the question why, with the keys that answer it, and those alone; "" for no question.

    It stands there until it is answered, or something else has happened.
    """
    change = snapshot.last_change
    asked = change is not None and change.latest and change.reason is None
    if not asked or snapshot.link.state == "replay":
        return "", ""
    known = [show_key(keys[f"why_{reason}"][0]) for reason in REASONS]
    answers = (f"{key} {reason}" for key, reason in zip(known, REASONS, strict=True))
    return f"why? {' '.join(answers)}", f"why? {' '.join(known)}"
