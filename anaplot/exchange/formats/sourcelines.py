"""Lines of other programs' text files: bounded in size, and complaints name their place."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from anaplot.errors import InputError
from anaplot.textfiles.inputfile import not_utf8, open_input
from anaplot.textfiles.names import name_fault
from anaplot.textfiles.wording import place, quoted

__all__ = ["MAX_SOURCE_BYTES", "SourceLine", "source_lines", "value_of"]

MAX_SOURCE_BYTES = 2_000_000_000
_FARTHEST = 1e9  # of a ground coordinate, in metres or feet: no place on earth has more
_MAX_LINE = 50_000_000  # bytes; a COLMAP image of 10^6 features has all of them in one


class SourceLine(NamedTuple):
    """A line of a file, and where it stands."""

    path: Path
    number: int
    text: str

    def fail(self, message: str) -> InputError:
        """Return the error about this line."""
        return InputError(f"{place(self.path, self.number)}: {message}")

    def number_of(self, text: str, what: str) -> float:
        """Return a finite number; raises InputError for anything else."""
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value) or "_" in text or not text.isascii():
            raise self.fail(f"{what} must be a finite number, not {quoted(text)}")
        return value

    def numbers_of(self, texts: list[str], what: str) -> list[float]:
        """Return finite numbers; raises InputError for anything else."""
        return [self.number_of(text, what) for text in texts]

    def ground_of(self, texts: list[str], what: str) -> list[float]:
        """Return ground coordinates; raises InputError for what is none, or no place on earth."""
        values = self.numbers_of(texts, what)
        return [self.on_earth(value, text, what) for value, text in zip(values, texts, strict=True)]

    def on_earth(self, value: float, text: str, what: str) -> float:
        """Return a ground coordinate; raises InputError for one that is no place on earth."""
        if abs(value) > _FARTHEST:
            raise self.fail(f"{what} of {quoted(text)} is no place on earth")
        return value

    def whole_of(self, text: str, what: str, low: int = 0, high: int = 2**63) -> int:
        """Return a whole number from `low` to `high`; raises InputError for anything else."""
        if len(text) > 20 or not text.isascii() or not text.removeprefix("-").isdigit():
            raise self.fail(f"{what} must be a whole number, not {quoted(text)}")
        value = int(text)
        if not low <= value <= high:
            raise self.fail(f"{what} must lie between {low} and {high}, not {value}")
        return value

    def name_of(self, text: str, what: str) -> str:
        """Return the name of a photo or point; raises InputError for one that cannot be used."""
        fault = name_fault(text)
        if fault is not None:
            raise self.fail(f"the {what} name {quoted(text)} {fault}")
        return text


def value_of(text: str) -> float | None:
    """Return the number that a text is, not a finite one either; None for other texts."""
    try:
        return float(text)
    except ValueError:
        return None


def source_lines(
    path: Path,
    max_bytes: int = MAX_SOURCE_BYTES,
    *,
    encoding: str = "utf-8-sig",
    ends: bool = False,
) -> Iterator[SourceLine]:
    """Yield the lines of a text file, without their ends unless asked for, one at a time.

    Raises
    ------
    InputError
        The file cannot be read or is too large, a line is too long or not of the encoding.
    """
    with open_input(path, max_bytes) as file:
        number = 0
        while raw := file.readline(_MAX_LINE + 1):
            number += 1
            if len(raw) > _MAX_LINE:
                raise InputError(f"{place(path, number)}: longer than {_MAX_LINE} bytes")
            try:
                text = raw.decode(encoding)
            except UnicodeDecodeError:
                raise not_utf8(path, number) from None
            yield SourceLine(path, number, text if ends else text.rstrip("\r\n"))
