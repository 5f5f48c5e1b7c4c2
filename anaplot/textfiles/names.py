"""What may be the name of a block, camera, strip, photo or point."""

from __future__ import annotations

__all__ = ["MAX_NAME", "name_fault"]

MAX_NAME = 255


def name_fault(name: str) -> str | None:
    """Return why a name cannot be used, or None for a good one; a slash is part of a name."""
    if not name or name.isspace():
        return "is empty"
    if len(name) > MAX_NAME:
        return f"is longer than {MAX_NAME} characters"
    if not name.isprintable():
        return "holds a character that cannot be printed"
    if name != name.strip():
        return "begins or ends with a blank"
    return None
