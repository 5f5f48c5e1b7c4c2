"""A block rebuilt from its journal."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from itertools import chain, count
from pathlib import Path

from anaplot.errors import InputError
from anaplot.exchange.blockfolder import write_image_points, write_new_block
from anaplot.orientation.results import ModelSolution
from anaplot.photogrammetry.block import Block
from anaplot.session.models import solved_or_none
from anaplot.session.state import SessionState
from anaplot.station.imagepoints import rows_of
from anaplot.station.replay import Replayed

__all__ = ["rebuild", "session_solutions"]


def rebuild(replayed: Replayed, folder: Path) -> None:
    """Write block.toml, camera files and image_points.csv of a replayed session into a new folder.

    So is the file of the block's point pattern, where a session was opened with it. Files that
    stood elsewhere come to stand beside block.toml.

    Raises
    ------
    InputError
        The folder holds a block already, or cannot be written.
    """
    if (folder / "image_points.csv").exists():
        raise InputError(f"{folder}: there is an image_points.csv already")
    write_new_block(folder, _self_contained(replayed.block))
    rows = rows_of(replayed.state.models, replayed.state.reasons)
    if rows:
        write_image_points(folder, rows, replayed.block)


def _self_contained(block: Block) -> Block:
    cameras = []
    taken = {c.file for c in block.cameras if c.file is not None and not Path(c.file).is_absolute()}
    for camera in block.cameras:
        if camera.file is not None and Path(camera.file).is_absolute():
            file = _free(Path(camera.file), taken)
            taken.add(file)
            camera = replace(camera, file=file)
        cameras.append(camera)
    measuring = block.measuring
    if measuring.points is not None and measuring.pattern is not None:
        pattern = Path(measuring.pattern)
        if pattern.is_absolute():
            measuring = replace(measuring, pattern=_free(pattern, taken))
    return replace(block, cameras=tuple(cameras), measuring=measuring)


def _free(path: Path, taken: Collection[str]) -> str:
    """Return a file's name, with a number behind it when another file has it."""
    names = chain((path.name,), (f"{path.stem}-{k}{path.suffix}" for k in count(2)))
    return next(name for name in names if name not in taken)


def session_solutions(state: SessionState) -> tuple[tuple[str, ModelSolution], ...]:
    """Return (strip, solution) of the accepted models, and of the current one where it has one."""
    models = state.models if state.current is None else state.models_with(state.current)
    solved = ((model.strip, solved_or_none(state, model)) for model in models)
    return tuple((strip, solution) for strip, solution in solved if solution is not None)
