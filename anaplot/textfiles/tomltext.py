"""Values as TOML text; numbers are written so that they are read back exactly."""

from __future__ import annotations

from anaplot.errors import InputError
from anaplot.textfiles.wording import quoted

__all__ = ["toml_number", "toml_numbers", "toml_text"]


def toml_text(value: str) -> str:
    """Return a name in quotation marks; raises InputError for one that cannot be printed."""
    if not value.isprintable():
        raise InputError(f"the name {quoted(value)} holds a character that cannot be printed")
    escaped = value.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'


def toml_number(value: float) -> str:
    """Return a number with the fewest digits that are read back as the same."""
    return repr(float(value))


def toml_numbers(*values: float) -> str:
    """Return a list of numbers."""
    return f"[{', '.join(toml_number(value) for value in values)}]"
