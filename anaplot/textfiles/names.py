"""What may be the name of a block, camera, strip, photo or point."""

from __future__ import annotations

__all__ = ["MAX_NAME", "name_fault"]

MAX_NAME = 100


def name_fault(name: str, *, photo: bool = False) -> str | None:
    """Return why a name cannot be used, or None for a good one.

    Parameters
    ----------
    name
        The name.
    photo
        Photo names hold no slash, for a model is written "left/right".
    """
    if not name or name.isspace():
        return "is empty"
    if len(name) > MAX_NAME:
        return f"is longer than {MAX_NAME} characters"
    if not name.isprintable():
        return "holds a character that cannot be printed"
    if name != name.strip():
        return "begins or ends with a blank"
    if photo and "/" in name:
        return "holds a slash"
    return None
