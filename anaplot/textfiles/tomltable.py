"""A TOML file read strictly: every complaint names file, line, table and key."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Any, Literal, Protocol, TypeVar

from anaplot.errors import InputError
from anaplot.textfiles.inputfile import read_text
from anaplot.textfiles.kinds import Fields, Keys, Kind, WrongValueError
from anaplot.textfiles.tomllines import KeyPath, TomlLines
from anaplot.textfiles.tomlvalues import TomlError, toml_values
from anaplot.textfiles.wording import describe_type, place, plain, quoted

__all__ = ["TomlTable", "parse_toml", "read_toml"]

T = TypeVar("T")
D = TypeVar("D")


class _Named(Protocol):
    @property
    def id(self) -> str: ...


N = TypeVar("N", bound=_Named)


def read_toml(path: Path, max_bytes: int) -> TomlTable:
    """Read a TOML file of bounded size; returns its root table and raises InputError."""
    return parse_toml(read_text(path, max_bytes), path)


def parse_toml(text: str, path: Path) -> TomlTable:
    """Return the root table of a TOML text.

    Parameters
    ----------
    text
        The document.
    path
        Its file, for messages only.

    Raises
    ------
    InputError
        The text is not TOML.
    """
    try:
        return TomlTable(text, path, (), toml_values(text))
    except TomlError as error:
        at = f" (column {error.column})" if error.column else ""
        at = " (at the end of the file)" if error.at_end else at
        raise InputError(
            f"{place(path, error.line)}: not valid TOML: {plain(str(error), 120)}{at}"
        ) from None


class TomlTable:
    """One table of a file; every method that reads raises InputError.

    Parameters
    ----------
    text, file
        The document and its name.
    path
        Keys and indices that lead to the table.
    values
        Its content.
    """

    def __init__(self, text: str, file: Path, path: KeyPath, values: dict[str, Any]) -> None:
        self._text = text
        self._file = file
        self._path = path
        self._values = values

    def __contains__(self, key: str) -> bool:
        return key in self._values

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def fail(self, message: str, *at: str | int) -> InputError:
        """Return the error about the table, or about what stands at some keys and indices in it."""
        value: Any = self._values
        for part in at:
            inside = part in value if isinstance(value, dict) else isinstance(value, list)
            value = value[part] if inside else None
        title = _title((*self._path, *at), isinstance(value, dict))
        return InputError(
            ": ".join(part for part in (place(self._file, self.line(*at)), title, message) if part)
        )

    def line(self, *at: str | int) -> int | None:
        """Return the line of the table or of what stands in it, else of what is around it."""
        # Scanned again for each message, of which there is one in a run.
        return TomlLines(self._text).line((*self._path, *at))

    def version(self, newest: int, key: str = "format") -> None:
        """Refuse a file whose format is not the one that is read.

        To be called first of all: the keys of a newer format are not unknown keys but unread news.
        """
        number = self._required(key)
        if isinstance(number, bool) or not isinstance(number, int):
            raise self.fail(f"must be a whole number, not {describe_type(number)}", key)
        if number > newest:
            raise self.fail(
                f"written by a newer version of anaplot: this one reads {key} {newest}", key
            )
        if number != newest:
            raise self.fail(f"must be {newest}", key)

    def take(
        self,
        required: Fields,
        optional: Fields | None = None,
        also: Collection[str] = (),
    ) -> dict[str, Any]:
        """Return the values of declared keys as far as they are there; see `Keys`."""
        return self.taken(Keys(required, optional, also))

    def taken(self, keys: Keys) -> dict[str, Any]:
        """Return the values of declared keys, as `take`: one declaration serves many tables."""
        return self._read(keys, self._values)

    def get(self, key: str, kind: Kind[T]) -> T:
        """Return the value of a key that must be there."""
        return self._read(kind, self._required(key), key)

    def optional(self, key: str, kind: Kind[T], default: D) -> T | D:
        """Return the value of a key, or the default where it is left out."""
        return self.get(key, kind) if key in self._values else default

    def table(self, key: str) -> TomlTable:
        """Return a table within this one, empty when it is left out."""
        value = self._values.get(key, {})
        if not isinstance(value, dict):
            raise self.fail(f"must be a table [{key}], not {describe_type(value)}", key)
        return TomlTable(self._text, self._file, (*self._path, key), value)

    def tables(self, key: str) -> Iterator[TomlTable]:
        """Yield the tables of an array [[key]]."""
        value = self._values.get(key, [])
        if not isinstance(value, list) or not all(isinstance(item, dict) for item in value):
            raise self.fail(f"must be written [[{key}]]", key)
        for index, item in enumerate(value):
            yield TomlTable(self._text, self._file, (*self._path, key, index), item)

    def each(
        self,
        what: str,
        read: Callable[[TomlTable], N],
        most: int | None = None,
        least: Literal[0, 1] = 1,
    ) -> tuple[N, ...]:
        """Return what stands in the tables [[what]]: between `least` and `most`, none twice."""
        found: dict[str, N] = {}
        tables: dict[str, TomlTable] = {}
        for table in self.tables(what):
            one = read(table)
            if one.id in found:
                first = tables[one.id].line("id")
                raise table.fail(f"{what} {quoted(one.id)} twice (first in line {first})", "id")
            found[one.id], tables[one.id] = one, table
            if most is not None and len(found) > most:
                raise table.fail(f"more than {most} {what}s")
        if len(found) < least:
            raise self.fail(f"no {what}: at least one [[{what}]] is needed")
        return tuple(found.values())

    def named_tables(self, key: str, names: Kind[str]) -> Iterator[tuple[str, TomlTable]]:
        """Yield the tables [key.NAME] with their names, which are of a kind."""
        parent = self.table(key)
        for name in parent:
            parent._read(names, name, name)
            yield name, parent.table(name)

    def _required(self, key: str) -> Any:
        if key not in self._values:
            raise self.fail(f"no key {quoted(key)}")
        return self._values[key]

    def _read(self, kind: Kind[T], value: Any, *at: str) -> T:
        try:
            return kind.of(value)
        except WrongValueError as error:
            raise self.fail(str(error), *at, *error.at) from None


def _title(path: KeyPath, is_table: bool) -> str:
    """Return a path as a person finds it in the file: `[[camera]] format`, `[axis.x]`, `name`."""
    names = [plain(part, 40) if isinstance(part, str) else part for part in path]
    last = max((at for at, part in enumerate(names) if isinstance(part, str)), default=-1)
    index = next(
        (at for at, part in enumerate(names) if isinstance(part, int) and (at < last or is_table)),
        None,
    )
    if index is not None:
        header, keys = f"[[{_dotted(names[:index])}]]", names[index:]
    elif is_table and names:
        header, keys = f"[{_dotted(names)}]", []
    else:
        header, keys = f"[{_dotted(names[:last])}]" if last > 0 else "", names[max(last, 0) :]
    return " ".join(part for part in (header, _dotted(keys)) if part)


def _dotted(parts: list[str | int]) -> str:
    return ".".join(part for part in parts if isinstance(part, str))
