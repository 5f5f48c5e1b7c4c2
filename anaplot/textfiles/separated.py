"""Names in one word, with commas between: `7,"12,a"`."""

from __future__ import annotations

from anaplot.errors import InputError
from anaplot.textfiles.wording import plain

__all__ = ["separated"]


def separated(text: str) -> tuple[str, ...]:
    """Return parts with commas between; one in double quotes may hold some, as in a CSV file.

    Raises
    ------
    InputError
        A quote is not closed, or something stands behind it.
    """
    parts = tuple(part.strip() for part in text.split(","))
    if not any(part.startswith('"') for part in parts):
        return parts
    import csv

    try:
        return tuple(
            part.strip() for part in next(csv.reader([text], skipinitialspace=True, strict=True))
        )
    except csv.Error as error:
        raise InputError(f"{plain(text)}: no parts with commas between: {error}") from error
