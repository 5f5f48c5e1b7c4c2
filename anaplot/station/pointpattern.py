"""The point pattern by which the points of new models are planned: a name, or a file."""

from __future__ import annotations

from pathlib import Path

from anaplot.exchange.patternfile import is_pattern_file, read_pattern
from anaplot.orientation.ownpattern import OwnPattern, PointPattern
from anaplot.orientation.patterns import pattern
from anaplot.photogrammetry.block import Block, PatternPoint
from anaplot.textfiles.inputfile import real_path

__all__ = ["pattern_of_block", "pattern_points", "point_pattern_of"]


def point_pattern_of(name: str, folder: Path, block: Block) -> PointPattern:
    """Return a point pattern that can be measured in a block.

    Parameters
    ----------
    name
        One that has a name, or a file.
    folder, block
        The block folder, and what it declares.

    Raises
    ------
    InputError
        There is no such pattern, its file is wrong, or it cannot be measured in this block.
    """
    if not is_pattern_file(name):
        return pattern(name)
    path = Path(name)
    return _own_pattern(path, _recorded_name(path, folder), block)


def pattern_of_block(folder: Path, block: Block, usual: str) -> PointPattern:
    """Return the pattern that block.toml states, a file standing beside it, or else the usual one.

    A file is recorded by the name that block.toml has for it.

    Raises
    ------
    InputError
        As `point_pattern_of`.
    """
    name = block.measuring.pattern or usual
    return _own_pattern(folder / name, name, block) if is_pattern_file(name) else pattern(name)


def _own_pattern(path: Path, name: str, block: Block) -> OwnPattern:
    """Return the pattern of a file, under a name."""
    from anaplot.planning.patternfit import pattern_fault  # computes a model

    file = read_pattern(path)
    own = OwnPattern(name, file.places, file.ties)
    fault = pattern_fault(own, block)
    if fault is not None:
        raise file.fault(*fault)
    return own


def pattern_points(pattern: PointPattern) -> tuple[PatternPoint, ...] | None:
    """Return the points of a pattern of one's own as its file has them; None of a named one."""
    if not isinstance(pattern, OwnPattern):
        return None
    return tuple(PatternPoint(*point, point[0] in pattern.ties) for point in pattern.points)


def _recorded_name(path: Path, folder: Path) -> str:
    """Return a file's path within the block folder, as block.toml names it, or its whole path."""
    whole, inside = real_path(path), real_path(folder)
    return whole.relative_to(inside).as_posix() if whole.is_relative_to(inside) else str(whole)
