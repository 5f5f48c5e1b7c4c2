"""Which files belong to a block, so that nothing else is written over them."""

from __future__ import annotations

from pathlib import Path

from anaplot.errors import InputError
from anaplot.exchange.blockfolder import MORE_FILES, block_files, read_declared
from anaplot.exchange.formats.door import SOURCE
from anaplot.exchange.patternfile import is_pattern_file
from anaplot.exchange.recordline import SESSIONS

__all__ = ["block_of_file"]


def block_of_file(target: Path) -> Path | None:
    """Return the folder of the block to which a file belongs; None where it belongs to none.

    Parameters
    ----------
    target
        The file, whether it exists or not: an absolute path without links.

    Notes
    -----
    Its tables and what its block.toml names; all of its sessions, and of what it was imported from.
    """
    for folder in target.parents:
        if (folder / "block.toml").is_file():
            inside = target.relative_to(folder)
            if inside.parts[0] in (SESSIONS, SOURCE) or target in _own(folder):
                return folder
    return None


def _own(folder: Path) -> set[Path]:
    own = {*MORE_FILES, *(path.name for path in block_files(folder))}
    try:
        block = read_declared(folder)
    except InputError:
        # a block that cannot be read keeps all that may be meant
        return {*folder.glob("*.toml"), *map(folder.joinpath, own)}
    own |= {camera.file for camera in block.cameras if camera.file is not None}
    pattern = block.measuring.pattern
    if pattern is not None and is_pattern_file(pattern):
        own.add(pattern)
    return set(map(folder.joinpath, own))
