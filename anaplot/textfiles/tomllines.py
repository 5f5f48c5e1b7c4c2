"""Where in a TOML text a key stands: tomllib reads values, it does not keep their lines."""

from __future__ import annotations

import contextlib
import re
import tomllib

__all__ = ["KeyPath", "TomlLines"]

KeyPath = tuple[str | int, ...]
"""Keys from the root of the document; integers count the elements of arrays."""

_BLANK = re.compile(r"(?:[ \t\r\n]+|#[^\n]*)*")
_SPACE = re.compile(r"[ \t]*")
_BARE = re.compile(r"[A-Za-z0-9_-]+")
_STRING = re.compile(
    r'"""(?:[^\\]|\\.)*?"{3,5}|' + r"'''.*?'{3,5}|" + r'"(?:[^"\\\n]|\\.)*"|' + r"'[^'\n]*'",
    re.DOTALL,
)
_SCALAR = re.compile(r"[^,\]}\n#]+")


class TomlLines:
    """The lines of all tables, keys and array elements of a valid TOML text.

    Parameters
    ----------
    text
        The document, already accepted by tomllib.
    """

    def __init__(self, text: str) -> None:
        self._text = text.replace("\r\n", "\n")
        self._at = 0
        self._found: dict[KeyPath, int] = {}
        self._counts: dict[KeyPath, int] = {}
        # Only lines of messages depend on this: what was found until it is lost still serves.
        with contextlib.suppress(_LostError, RecursionError, tomllib.TOMLDecodeError):
            self._document()

    def line(self, path: KeyPath) -> int | None:
        """Return the line of a key, or of the nearest table around it; None when unknown."""
        for length in range(len(path), 0, -1):
            at = self._found.get(path[:length])
            if at is not None:
                return self._text.count("\n", 0, at) + 1
        return None

    def _document(self) -> None:
        table: KeyPath = ()
        while True:
            self._skip(_BLANK)
            start = self._at
            if start >= len(self._text):
                return
            if self._text.startswith("[", start):
                table = self._header()
                self._found.setdefault(table, start)
            else:
                self._pair(table)

    def _header(self) -> KeyPath:
        start = self._at
        is_array = self._text.startswith("[[", start)
        self._at += 2 if is_array else 1
        keys = self._keys()
        end = self._text.find("\n", self._at)
        self._at = len(self._text) if end < 0 else end
        for length in range(1, len(keys)):
            # [photo.101] is where the table photo begins, when it does not stand by itself
            self._found.setdefault(self._inside(keys[:length]), start)
        path = self._inside(keys[:-1])
        last: KeyPath = (*path, keys[-1])
        if is_array:
            self._counts[last] = self._counts.get(last, -1) + 1
            self._found.setdefault(last, start)
            return (*last, self._counts[last])
        return self._inside(keys)

    def _inside(self, keys: list[str]) -> KeyPath:
        """Return the path of keys, each array of tables standing for its last element."""
        path: KeyPath = ()
        for key in keys:
            path = (*path, key)
            if path in self._counts:
                path = (*path, self._counts[path])
        return path

    def _pair(self, table: KeyPath) -> None:
        start = self._at
        path: KeyPath = table
        for key in self._keys():
            path = (*path, key)
            self._found.setdefault(path, start)
        self._skip(_SPACE)
        self._expect("=")
        self._skip(_SPACE)
        self._value(path)

    def _keys(self) -> list[str]:
        keys: list[str] = []
        while True:
            self._skip(_SPACE)
            bare = _BARE.match(self._text, self._at)
            match = bare or _STRING.match(self._text, self._at)
            if match is None:
                raise _LostError
            raw = match.group()
            keys.append(raw if bare else tomllib.loads(f"key = {raw}")["key"])
            self._at = match.end()
            self._skip(_SPACE)
            if not self._text.startswith(".", self._at):
                return keys
            self._at += 1

    def _value(self, path: KeyPath) -> None:
        if self._text.startswith("[", self._at):
            self._at += 1
            index = 0
            while True:
                self._skip(_BLANK)
                if self._took("]"):
                    return
                self._found.setdefault((*path, index), self._at)
                self._value((*path, index))
                self._skip(_BLANK)
                self._took(",")
                index += 1
        elif self._text.startswith("{", self._at):
            self._at += 1
            while True:
                self._skip(_BLANK)
                if self._took("}"):
                    return
                self._pair(path)
                self._skip(_BLANK)
                self._took(",")
        else:
            match = _STRING.match(self._text, self._at) or _SCALAR.match(self._text, self._at)
            if match is None:
                raise _LostError
            self._at = match.end()

    def _skip(self, pattern: re.Pattern[str]) -> None:
        match = pattern.match(self._text, self._at)
        if match is not None:
            self._at = match.end()

    def _took(self, character: str) -> bool:
        if self._text.startswith(character, self._at):
            self._at += 1
            return True
        return False

    def _expect(self, character: str) -> None:
        if not self._took(character):
            raise _LostError


class _LostError(Exception):
    """The text is not what this scanner understands."""
