"""Strict reading of TOML: every key is known, every error names file, line, table and key."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Iterable, Mapping
from typing import Any, NoReturn

from anaplot.errors import InputError
from anaplot.textfiles.tomlvalues import TomlError, toml_values
from anaplot.textfiles.wording import plain

__all__ = [
    "TomlTable",
    "nearest",
    "parse_toml",
]


def parse_toml(raw: bytes, name: str) -> TomlTable:
    """Parse a TOML document.

    Parameters
    ----------
    raw
        Its bytes.
    name
        What errors call the file.

    Returns
    -------
    TomlTable
        The root table.

    Raises
    ------
    InputError
        When it is not UTF-8 or not TOML.
    """
    try:
        text = raw.decode("utf-8")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise InputError(f"{name}: line {line}: not UTF-8 text") from None
    try:
        data = toml_values(text)
    except TomlError as error:
        where = name if error.line is None else f"{name}: line {error.line}"
        raise InputError(f"{where}: {plain(str(error), 120)}") from None
    return TomlTable(data, _Source(name, text.splitlines()), ())


class _Source:
    """The file behind a table: for line numbers only."""

    def __init__(self, name: str, lines: list[str]) -> None:
        self.name = name
        self._lines = lines

    def line_of(self, path: tuple[str | int, ...], key: str | None) -> int | None:
        """Return the line (from 1) of a key in a table, or of the table's header."""
        names = [str(part) for part in path if isinstance(part, str)]
        index = next((part for part in path if isinstance(part, int)), 0)
        header = self._header(names, index)
        if header is None and names:
            # an inline table: the key that holds it
            parent = path[: _last_name(path)]
            return self.line_of(parent, names[-1])
        if key is None:
            return header
        return self._key(key, header or 0) or self._below([*names, key]) or header

    def _header(self, names: list[str], index: int) -> int | None:
        if not names:
            return None
        seen = 0
        for number, line in enumerate(self._lines, 1):
            match = re.match(r"\s*\[\[?([^\]]*)\]", line)
            if match is None:
                continue
            found = [part.strip().strip("\"'") for part in match.group(1).split(".")]
            if found == names:
                if seen == index:
                    return number
                seen += 1
        return None

    def _below(self, names: list[str]) -> int | None:
        """Return the line of the first header of a table or of one within it."""
        for number, line in enumerate(self._lines, 1):
            match = re.match(r"\s*\[\[?([^\]]*)\]", line)
            if match is not None:
                found = [part.strip().strip("\"'") for part in match.group(1).split(".")]
                if found[: len(names)] == names:
                    return number
        return None

    def _key(self, key: str, start: int) -> int | None:
        for number, line in enumerate(self._lines[start:], start + 1):
            if re.match(r"\s*\[", line) and "=" not in line:
                return None
            match = re.match(r"\s*([^=#\[]+?)\s*=", line)
            if match is None:
                continue
            first = match.group(1)
            if first.strip("\"'") == key or first.split(".")[0].strip().strip("\"'") == key:
                return number
        return None


def _last_name(path: tuple[str | int, ...]) -> int:
    return max(at for at, part in enumerate(path) if isinstance(part, str))


class TomlTable:
    """One table: keys are taken by type, and what was not taken is an error.

    Parameters
    ----------
    data
        What tomllib made of it.
    source
        The file.
    path
        Names (and indices of arrays) from the root.
    """

    def __init__(
        self, data: Mapping[str, Any], source: _Source, path: tuple[str | int, ...]
    ) -> None:
        self._data = data
        self._source = source
        self._path = path
        self._known: set[str] = set()

    @property
    def title(self) -> str:
        """The table as it is written in a file, e.g. ``[record.position]``."""
        names = [plain(str(part), 40) for part in self._path if isinstance(part, str)]
        index = next((part for part in self._path if isinstance(part, int)), None)
        if not names:
            return ""
        return f"[[{'.'.join(names)}]] {index + 1}" if index is not None else f"[{'.'.join(names)}]"

    def fail(self, reason: str, key: str | None = None) -> NoReturn:
        """Raise an error that names file, line, table and key.

        Raises
        ------
        InputError
            Always.
        """
        line = self._source.line_of(self._path, key)
        where = [self._source.name]
        if line is not None:
            where.append(f"line {line}")
        place = " ".join(part for part in (self.title, plain(key, 60) if key else "") if part)
        if place:
            where.append(place)
        raise InputError(f"{': '.join(where)}: {reason}")

    def keys(self) -> list[str]:
        """Return the keys in the file's order."""
        return list(self._data)

    def has(self, key: str) -> bool:
        """Say whether a key is given (and count it as known)."""
        self._known.add(key)
        return key in self._data

    def raw(self, key: str) -> Any:
        """Return a value as it is, or None."""
        self._known.add(key)
        return self._data.get(key)

    def string(self, key: str, default: str | None = None, *, limit: int = 200) -> str:
        """Return a string; without a default the key is required."""
        value = self._required(key, default)
        if not isinstance(value, str):
            self.fail("must be a string", key)
        if len(value) > limit:
            self.fail(f"longer than {limit} characters", key)
        return value

    def octets(self, key: str, default: str | None = None, *, limit: int = 200) -> bytes:
        """Return a string as bytes, one per character."""
        text = self.string(key, default, limit=limit)
        try:
            return text.encode("latin-1")
        except UnicodeEncodeError:
            self.fail("holds a character that is not a single byte", key)

    def choice(self, key: str, allowed: Iterable[str], default: str | None = None) -> str:
        """Return one of some words."""
        value = self.string(key, default)
        words = list(allowed)
        if value not in words:
            near = nearest(value, words)
            self.fail(f'"{plain(value, 40)}" is none of {", ".join(words)}{near}', key)
        return value

    def number(
        self,
        key: str,
        default: float | None = None,
        *,
        low: float = -math.inf,
        high: float = math.inf,
    ) -> float:
        """Return a finite number within bounds."""
        value = self._required(key, default)
        if isinstance(value, bool) or not isinstance(value, int | float):
            self.fail("must be a number", key)
        if isinstance(value, int) and abs(value) > 1e15:
            self.fail("is too large", key)
        if not math.isfinite(value) or not low <= value <= high:
            bounds = (
                f" between {low:g} and {high:g}" if math.isfinite(high) else f" from {low:g} on"
            )
            self.fail(f"must be a number{bounds if math.isfinite(low) else ''}", key)
        return float(value)

    def integer(self, key: str, default: int | None = None, *, low: int, high: int) -> int:
        """Return a whole number within bounds."""
        value = self._required(key, default)
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            self.fail(f"must be a whole number from {low} to {high}", key)
        return value

    def flag(self, key: str, default: bool) -> bool:
        """Return true or false."""
        value = self._required(key, default)
        if not isinstance(value, bool):
            self.fail("must be true or false", key)
        return value

    def numbers(self, key: str, counts: Iterable[int]) -> tuple[float, ...]:
        """Return a list of finite numbers with one of the given lengths."""
        value = self._required(key, None)
        lengths = list(counts)
        wanted = " or ".join(str(count) for count in lengths)
        if not isinstance(value, list) or len(value) not in lengths:
            self.fail(f"must be a list of {wanted} numbers", key)
        for item in value:
            if isinstance(item, bool) or not isinstance(item, int | float):
                self.fail("must be a list of numbers", key)
            if abs(item) > 1e15 or not math.isfinite(item):
                self.fail("must be a list of finite numbers", key)
        return tuple(float(item) for item in value)

    def strings(self, key: str, default: tuple[str, ...] | None = None) -> tuple[str, ...]:
        """Return a string or a list of strings."""
        self._known.add(key)
        if key not in self._data and default is not None:
            return default
        value = self._required(key, None)
        items = [value] if isinstance(value, str) else value
        if not isinstance(items, list) or not items or len(items) > 50:
            self.fail("must be a string or a list of strings", key)
        for item in items:
            if not isinstance(item, str) or not item or len(item) > 300:
                self.fail("must be a string or a list of strings", key)
        return tuple(items)

    def table(self, key: str) -> TomlTable | None:
        """Return a table within this one, or None."""
        self._known.add(key)
        if key not in self._data:
            return None
        value = self._data[key]
        if not isinstance(value, dict):
            self.fail("must be a table", key)
        return TomlTable(value, self._source, (*self._path, key))

    def tables(self, key: str) -> list[TomlTable]:
        """Return an array of tables."""
        self._known.add(key)
        value = self._data.get(key, [])
        if not isinstance(value, list) or not all(isinstance(item, dict) for item in value):
            self.fail("must be an array of tables", key)
        return [
            TomlTable(item, self._source, (*self._path, key, at)) for at, item in enumerate(value)
        ]

    def named_tables(self, key: str, *, limit: int = 16) -> dict[str, TomlTable]:
        """Return the tables ``[key.NAME]`` by name."""
        parent = self.table(key)
        if parent is None:
            return {}
        if len(parent.keys()) > limit:
            self.fail(f"more than {limit} tables", key)
        found: dict[str, TomlTable] = {}
        for name in parent.keys():  # noqa: SIM118 - a method of its own, not a dict
            if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_-]{0,30}", name):
                parent.fail("a name is a letter and up to 30 letters, digits, - or _", name)
            table = parent.table(name)
            if table is not None:
                found[name] = table
        return found

    def done(self) -> None:
        """Refuse every key that nobody asked for.

        Raises
        ------
        InputError
            Naming the first unknown key and the nearest known one.
        """
        for key in self._data:
            if key not in self._known:
                kind = "table" if isinstance(self._data[key], dict) else "key"
                self.fail(f"unknown {kind}{nearest(key, sorted(self._known))}", key)

    def _required(self, key: str, default: Any) -> Any:
        self._known.add(key)
        if key in self._data:
            return self._data[key]
        if default is None:
            self.fail(f'"{key}" is missing')
        return default


def nearest(word: str, known: list[str]) -> str:
    """Return " (did you mean X?)", or what is known when nothing is near.

    Parameters
    ----------
    word
        As written.
    known
        What would have been right.
    """
    near = difflib.get_close_matches(word[:60], known, 1, 0.6)
    if near:
        return f' (did you mean "{near[0]}"?)'
    return f" (known: {', '.join(known)})" if known and len(known) <= 20 else ""
