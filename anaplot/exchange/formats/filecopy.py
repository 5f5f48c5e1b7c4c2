"""Files that are copied as they are."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from anaplot.exchange.formats.sourcelines import MAX_SOURCE_BYTES
from anaplot.textfiles.inputfile import open_input

__all__ = ["pieces"]

_PIECE = 1 << 20  # bytes


def pieces(path: Path) -> Iterator[bytes]:
    """Yield a file's bytes, piece by piece; raises InputError for one that cannot be read."""
    with open_input(path, MAX_SOURCE_BYTES) as file:
        while piece := file.read(_PIECE):
            yield piece
