"""TOML text to its values, for everything that is read: in time and memory that the size bounds.

tomllib needs memory that grows with the square of the number of parts of a dotted key: 20 kB of
`a.a.a...=1` take 500 MB. Such keys are refused before it sees them.
"""

from __future__ import annotations

import re
import tomllib
from typing import Any

from anaplot.textfiles.tomlplain import PlainTables, plain_tables

__all__ = ["MOST_DOTS", "TomlError", "toml_values"]

MOST_DOTS = 32
"""Dots in one key, or in the header of one table."""

_POSITION = re.compile(r"^(.*) \(at (?:line (\d+), column (\d+)|end of document)\)$", re.DOTALL)

# What a text is made of, as far as dots go. A possessive repeat gives nothing back, so that every
# character is looked at once.
_TOKEN = re.compile(
    r"""
      (?P<comment> \#[^\n]* )
    | (?P<text> \"{3}(?:[^"\\]|\\.|"(?!""))*+\"{3,5}
              | '{3}(?:[^']|'(?!''))*+'{3,5}
              | "(?!"")(?:[^"\\\n]|\\[^\n])*+"
              | '(?!'')[^'\n]*+' )
    | (?P<open> ["'] )
    | (?P<bare> [A-Za-z0-9_-]++ )
    | (?P<dot> \. )
    | (?P<blank> [ \t]++ )
    | (?P<other> . )
    """,
    re.DOTALL | re.VERBOSE,
)


class TomlError(ValueError):
    """A text is not TOML that is read.

    Attributes
    ----------
    line, column
        Where, from 1; None where it is not known.
    at_end
        It is the end of the text that is wrong.
    """

    def __init__(
        self, message: str, line: int | None = None, column: int | None = None, at_end: bool = False
    ) -> None:
        super().__init__(message)
        self.line = line
        self.column = column
        self.at_end = at_end


def toml_values(text: str) -> dict[str, Any]:
    """Parse a TOML document.

    Raises
    ------
    TomlError
        It is not TOML, or nested more deeply than anything that is read.
    """
    _refuse_many_dots(text)
    return _of_plain_tables(text) or _parsed(text)


def _of_plain_tables(text: str) -> dict[str, Any] | None:
    """Return what a text says that ends with plain tables; None: it does not, or is not TOML."""
    ends: list[PlainTables] = []
    before = text
    while (found := plain_tables(before)) is not None:
        ends.append(found)
        before = found.before
    if not ends:
        return None
    try:
        values = _parsed(before)
    except TomlError:
        return None
    for one in reversed(ends):
        if one.name in values:
            return None
        values[one.name] = one.tables
    return values


def _parsed(text: str) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        message = str(error)
        match = _POSITION.match(message)
        if match is None:
            raise TomlError(message) from None
        what, line, column = match.groups()
        if line is None:
            raise TomlError(what, text.count("\n") + 1, at_end=True) from None
        raise TomlError(what, int(line), int(column)) from None
    except RecursionError:
        raise TomlError("nested too deeply") from None
    except ValueError as error:
        # What Python does not take: a number of more than some 4000 digits.
        raise TomlError(str(error)) from None


def _refuse_many_dots(text: str) -> None:
    """Raise TomlError for a key or a header of too many parts.

    Keys are what dots join; a number has one dot only. Up to the first place where the text is not
    TOML this sees the same strings and comments as tomllib does, and tomllib reads no further.
    """
    if all(line.count(".") <= MOST_DOTS for line in text.split("\n")):
        return  # a key stands in one line
    dots = 0
    for token in _TOKEN.finditer(text):
        kind = token.lastgroup
        if kind == "dot":
            dots += 1
            if dots > MOST_DOTS:
                line = text.count("\n", 0, token.start()) + 1
                raise TomlError(f"a key of more than {MOST_DOTS} dots", line)
        elif kind == "open":
            return  # a string without an end: tomllib stops here
        elif kind in ("comment", "other"):
            dots = 0
