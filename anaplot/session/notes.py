"""What explains events in the journal, and decides nothing."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

__all__ = ["Note", "NoteKind"]

NoteKind = Literal[
    "fault",
    "point-checked",
    "record-refused",
    "reference-pointed",
    "reference-refused",
    "referenced",
    "refused",
    "unreferenced",
]

Note = tuple[NoteKind, Mapping[str, Any]]
"""Its kind, and what it says."""
