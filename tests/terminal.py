"""A terminal that knows what the console's frames are made of."""

from __future__ import annotations

import re

from rich.cells import cell_len

_PARTS = re.compile(r"\x1b\[(\d+);(\d+)H|\x1b\[([\d;]*)m|\x1b\[[0-?]*[ -/]*[@-~]|([^\x00-\x1f]+)")
_CODES = re.compile(r"(?:38|48);(?:5;\d+|2;\d+;\d+;\d+)|\d+")
_GROUNDS = {"colour": re.compile(r"[39]\d"), "background": re.compile(r"(?:4|10)\d")}

Style = frozenset[tuple[str, str]]


class Terminal:
    """What it shows: by (line, column), counted from 1, text and style; "" behind a wide one."""

    def __init__(self) -> None:
        self.cells: dict[tuple[int, int], tuple[str, Style | None]] = {}
        self.line = self.column = 1
        self.style: Style = frozenset()

    def write(self, data: str) -> None:
        """Take text and whole control sequences."""
        for line, column, style, text in _PARTS.findall(data):
            if line:
                self.line, self.column = int(line), int(column)
            elif text:
                self._put(text)
            elif style:
                self._turn(style)

    @property
    def lines(self) -> list[str]:
        """The text, line by line."""
        last = max((line for line, _ in self.cells), default=0)
        return [self._line(line) for line in range(1, last + 1)]

    def _line(self, line: int) -> str:
        end = max((column for at, column in self.cells if at == line), default=0)
        return "".join(self.cells.get((line, k), (" ", None))[0] for k in range(1, end + 1))

    def _turn(self, style: str) -> None:
        for code in _CODES.findall(style):
            ground = next((name for name, of in _GROUNDS.items() if of.match(code)), None)
            if code == "0":
                self.style = frozenset()
            else:
                kept = (part for part in self.style if ground is None or part[0] != ground)
                self.style = frozenset((*kept, (ground or "attribute", code)))

    def _put(self, text: str) -> None:
        for character in text:
            wide = cell_len(character)
            for k in range(wide):
                self._clear(self.column + k)
            for k in range(wide):
                self.cells[self.line, self.column + k] = (character if k == 0 else "", self.style)
            self.column += wide

    def _clear(self, column: int) -> None:
        """Half of a wide character is none."""
        here, after = (self.cells.get((self.line, k), (" ", None))[0] for k in (column, column + 1))
        if not here:
            self.cells[self.line, column - 1] = (" ", None)
        if not after:
            self.cells[self.line, column + 1] = (" ", None)
