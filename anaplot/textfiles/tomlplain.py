"""The plain tables at the end of a TOML text: photos and strips as programs write them.

Thousands of such tables cost tomllib, which goes letter by letter, more time than all rows of
image points cost their reader. What is plain says the same in JSON, but for its punctuation.
"""

from __future__ import annotations

import json
import re
from typing import Any, NamedTuple

__all__ = ["PlainTables", "plain_tables"]

_KEY = r"[A-Za-z0-9_-]++"
# the same in JSON, and nothing in it that is mistaken for a key or the end of a table
_TEXT = r'"[^"\\=}\x00-\x1f\x7f]*+"'
_NUMBER = r"-?(?:0|[1-9][0-9]*+)(?:\.[0-9]++)?(?:[eE][+-]?[0-9]++)?"
_ONE = rf"(?:{_TEXT}|{_NUMBER})"
_LIST = rf"\[{_ONE}(?:, {_ONE})*+\]"
_INLINE = rf"\{{ {_KEY} = {_ONE}(?:, {_KEY} = {_ONE})*+ \}}"
_LINES = rf"(?:{_KEY} = (?:{_ONE}|{_LIST}|{_INLINE})\n)++"
# these names alone: of names that a text chooses each would be a pass of its own
_HEADER = re.compile(r"\[\[(photo|strip)\]\]\n")
# not looked for at every letter of a long text
_NAMED = re.compile(rf"(?<![A-Za-z0-9_-])({_KEY}) = ")


class PlainTables(NamedTuple):
    """What stands at the end of a text.

    Attributes
    ----------
    before
        The text before it.
    name
        Of the array of tables.
    tables
        Its tables.
    """

    before: str
    name: str
    tables: list[dict[str, Any]]


def plain_tables(text: str) -> PlainTables | None:
    """Return the photos or strips with which a text ends, where all of them are plain; else None.

    What is before is left to be parsed: where that is TOML by itself, and has nothing of the name,
    both together are what the whole text says.
    """
    header = _HEADER.match(text, text.rfind("\n[[") + 1)
    if header is None:
        return None
    first = text.find(f"\n{header.group()}") + 1
    name, end = header.group(1), text[first:]
    if re.fullmatch(rf"(?:\[\[{name}\]\]\n{_LINES}\n?)++", end) is None:
        return None
    # a text in quotes has no end of line
    said = end.replace("\n\n", "\n").replace(header.group(), "},{").replace("\n", ",")
    said = _NAMED.sub(r'"\1": ', said).replace(",}", "}").removeprefix("},").removesuffix(",")
    try:
        tables = json.loads(f"[{said}}}]", object_pairs_hook=_once)
    except ValueError:  # a key twice, or a number of more digits than Python takes
        return None
    return PlainTables(text[:first], name, tables)


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    table = dict(pairs)
    if len(table) < len(pairs):
        raise ValueError("a key twice")
    return table
