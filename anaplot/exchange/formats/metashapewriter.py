"""A Metashape camera file again, byte for byte, but for measurements that are left out."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Final
from xml.parsers import expat

from anaplot.errors import InputError
from anaplot.textfiles.inputfile import read_bytes
from anaplot.textfiles.wording import place

__all__ = ["without_locations"]

_MAX_BYTES: Final = 500_000_000


def without_locations(path: Path, leave: Collection[tuple[str, str]]) -> tuple[bytes, int]:
    """Return a file's bytes without some of its locations, and how many these were.

    Parameters
    ----------
    path
        A file that `xmlstream` has read, so that it has no document type.
    leave
        Ids of marker and camera.

    Raises
    ------
    InputError
        It cannot be read.
    """
    data = read_bytes(path, _MAX_BYTES)
    spans = _Spans(leave)
    try:
        spans.parser.Parse(data, True)
    except expat.ExpatError as error:
        raise InputError(f"{place(path, error.lineno)}: not XML any more") from None
    pieces, at = [], 0
    for start, end in spans.found:
        before = data[at:start]
        # the blanks of its line go with it
        if data[end : end + 1] in (b"\n", b"\r"):
            before = before.rstrip(b" \t")
            end += 2 if data[end : end + 2] == b"\r\n" else 1
        pieces.append(before)
        at = end
    return b"".join((*pieces, data[at:])), len(spans.found)


class _Spans:
    """Where locations begin and end."""

    def __init__(self, leave: Collection[tuple[str, str]]) -> None:
        self.found: list[tuple[int, int]] = []
        self._leave = leave
        self._marker: str | None = None
        self._start: int | None = None  # of a location that is left out
        self._ended = False
        parser = self.parser = expat.ParserCreate()
        parser.StartElementHandler = self._open
        parser.EndElementHandler = self._close
        parser.DefaultHandler = self._other  # everything else, so that an end is known at once

    def _settle(self) -> None:
        """Note that a location that has ended reaches to where the next thing begins."""
        if self._ended and self._start is not None:
            self.found.append((self._start, self.parser.CurrentByteIndex))
            self._start, self._ended = None, False

    def _open(self, tag: str, attributes: dict[str, str]) -> None:
        self._settle()
        if tag == "marker":
            self._marker = attributes.get("marker_id")
        elif tag == "location" and self._marker is not None:
            key = self._marker, attributes.get("camera_id", "")
            if key in self._leave:
                self._start = self.parser.CurrentByteIndex

    def _close(self, tag: str) -> None:
        self._settle()
        if tag == "location" and self._start is not None:
            self._ended = True
        elif tag == "marker":
            self._marker = None

    def _other(self, _: str) -> None:
        self._settle()
