"""A TOML file read strictly: every complaint names file, line, table and key."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from anaplot.errors import InputError
from anaplot.textfiles.names import name_fault
from anaplot.textfiles.tomllines import KeyPath, TomlLines
from anaplot.textfiles.tomlvalues import TomlError, toml_values
from anaplot.textfiles.wording import describe_type, hint, place, plain, quoted

__all__ = ["TomlFile", "TomlTable"]


class TomlFile:
    """A parsed TOML document that knows its name and lines.

    Parameters
    ----------
    path
        File name, for messages only.
    text
        Its content.

    Raises
    ------
    InputError
        The text is not TOML.
    """

    def __init__(self, path: Path, text: str) -> None:
        self.path = path
        self._text = text
        try:
            values = toml_values(text)
        except TomlError as error:
            raise self._not_toml(error) from None
        self.root = TomlTable(self, (), "", values)

    def fail(self, path: KeyPath, message: str) -> InputError:
        """Return the error about the key at a path."""
        return InputError(f"{place(self.path, self.line(path))}: {message}")

    def line(self, path: KeyPath) -> int | None:
        """Return the line of the key at a path, or of what surrounds it."""
        # Scanned again for each message, of which there is one in a run.
        return TomlLines(self._text).line(path)

    def _not_toml(self, error: TomlError) -> InputError:
        at = f" (column {error.column})" if error.column else ""
        at = " (at the end of the file)" if error.at_end else at
        return InputError(
            f"{place(self.path, error.line)}: not valid TOML: {plain(str(error), 120)}{at}"
        )


class TomlTable:
    """One table of a file and the checks on its keys; every method raises InputError.

    Parameters
    ----------
    file
        The file it belongs to.
    path
        Where it stands.
    title
        How a person writes it ("[[camera]]"), empty for the top of the file.
    values
        Its content.
    """

    def __init__(self, file: TomlFile, path: KeyPath, title: str, values: dict[str, Any]) -> None:
        self._file = file
        self._path = path
        self._title = title
        self._values = values

    def __contains__(self, key: str) -> bool:
        return key in self._values

    def fail(self, key: str | None, message: str, index: int | None = None) -> InputError:
        """Return the error about one key, one element of its list, or the whole table."""
        path = self._path if key is None else (*self._path, key)
        return self._file.fail(path if index is None else (*path, index), message)

    def line(self, key: str | None = None) -> int | None:
        """Return the line of one key, or of the table."""
        return self._file.line(self._path if key is None else (*self._path, key))

    def key_names(self) -> tuple[str, ...]:
        """Return the keys, in file order."""
        return tuple(self._values)

    def version(self, newest: int) -> None:
        """Refuse a file whose `format` is not the one that is read.

        To be called first of all: the keys of a newer format are not unknown keys but unread news.
        """
        number = self.integer("format")
        if number > newest:
            raise self.fail(
                "format", f"written by a newer version of anaplot: this one reads format {newest}"
            )
        if number != newest:
            raise self.fail("format", f"format must be {newest}")

    def only(self, *known: str) -> None:
        """Refuse keys that are not known."""
        for key in self._values:
            if key not in known:
                within = f" in {self._title}" if self._title else ""
                raise self.fail(key, f"unknown key {quoted(key)}{within}{hint(key, known)}")

    def raw(self, key: str) -> Any:
        """Return the value of a key that must be there."""
        if key not in self._values:
            where = self._title or "the file"
            raise self.fail(None, f"{where} has no key '{key}'")
        return self._values[key]

    def integer(self, key: str) -> int:
        """Return a whole number."""
        value = self.raw(key)
        if isinstance(value, bool) or not isinstance(value, int):
            raise self._wrong(key, "a whole number", value)
        return value

    def number(self, key: str, default: float | None = None) -> float:
        """Return a finite number, or the default when there is one and the key is left out."""
        if default is not None and key not in self._values:
            return default
        return self._finite(key, self.raw(key))

    def positive(self, key: str, default: float | None = None) -> float:
        """Return a finite number greater than zero."""
        value = self.number(key, default)
        if value <= 0.0:
            raise self.fail(key, f"{key} = {value:g} must be greater than 0")
        return value

    def between(self, key: str, low: float, high: float, default: float | None = None) -> float:
        """Return a number from `low` to `high`, both included."""
        value = self.number(key, default)
        if not low <= value <= high:
            raise self.fail(key, f"{key} = {value:g} must lie between {low:g} and {high:g}")
        return value

    def fraction(self, key: str, default: float) -> float:
        """Return a number between 0 and 1, both excluded."""
        value = self.number(key, default)
        if not 0.0 < value < 1.0:
            raise self.fail(key, f"{key} = {value:g} must lie between 0 and 1")
        return value

    def numbers(self, key: str, count: int) -> tuple[float, ...]:
        """Return a list of finite numbers of given length."""
        value = self.raw(key)
        if not isinstance(value, list):
            raise self._wrong(key, f"a list of {count} numbers", value)
        if len(value) != count:
            raise self.fail(key, f"{key} must hold {count} numbers, not {len(value)}")
        return tuple(self._finite(key, item) for item in value)

    def choice(self, key: str, choices: tuple[str, ...], default: str | None = None) -> str:
        """Return one of several words."""
        if default is not None and key not in self._values:
            return default
        value = self.raw(key)
        one_of = " or ".join(f'"{choice}"' for choice in choices)
        if not isinstance(value, str):
            raise self._wrong(key, one_of, value)
        if value not in choices:
            nearest = hint(value, choices, listing=False)
            raise self.fail(key, f"{key} = {quoted(value)} must be {one_of}{nearest}")
        return value

    def text(self, key: str) -> str:
        """Return a text."""
        value = self.raw(key)
        if not isinstance(value, str):
            raise self._wrong(key, "text", value)
        return value

    def name(self, key: str, *, photo: bool = False) -> str:
        """Return a name (see `names`)."""
        return self._name(key, self.raw(key), photo)

    def names(self, key: str, *, photo: bool = False) -> tuple[str, ...]:
        """Return a list of names."""
        value = self.raw(key)
        if not isinstance(value, list):
            raise self._wrong(key, "a list of names", value)
        return tuple(self._name(key, item, photo) for item in value)

    def name_at(self, key: str, value: object, index: int) -> str:
        """Return a value found in element `index` of a list as a name."""
        return self._name(key, value, photo=False, index=index)

    def number_at(self, key: str, value: object, index: int) -> float:
        """Return a value found in element `index` of a list as a finite number."""
        return self._finite(key, value, index)

    def table(self, key: str, title: str) -> TomlTable:
        """Return a table within this one, empty when it is left out."""
        value = self._values.get(key, {})
        if not isinstance(value, dict):
            raise self._wrong(key, "a table", value)
        return TomlTable(self._file, (*self._path, key), title, value)

    def tables(self, key: str) -> Iterator[TomlTable]:
        """Yield the tables of an array [[key]]."""
        value = self._values.get(key, [])
        if isinstance(value, dict):
            raise self.fail(key, f"[{key}] must be written [[{key}]]")
        if not isinstance(value, list):
            raise self._wrong(key, f"tables [[{key}]]", value)
        for index, item in enumerate(value):
            if not isinstance(item, dict):
                raise self._file.fail((key, index), f"'{key}' must be written as tables [[{key}]]")
            yield TomlTable(self._file, (*self._path, key, index), f"[[{key}]]", item)

    def _name(self, key: str, value: object, photo: bool, index: int | None = None) -> str:
        if isinstance(value, int | float) and not isinstance(value, bool):
            raise self.fail(key, f"{key}: a name stands in quotes, also one of digits", index)
        if not isinstance(value, str):
            raise self._wrong(key, "a name", value, index)
        fault = name_fault(value, photo=photo)
        if fault is not None:
            raise self.fail(key, f"{key}: the name {quoted(value)} {fault}", index)
        return value

    def _finite(self, key: str, value: object, index: int | None = None) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self._wrong(key, "a number", value, index)
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            raise self.fail(key, f"{key} must be a finite number", index)
        return number

    def _wrong(self, key: str, wanted: str, value: object, index: int | None = None) -> InputError:
        return self.fail(key, f"{key} must be {wanted}, not {describe_type(value)}", index)
