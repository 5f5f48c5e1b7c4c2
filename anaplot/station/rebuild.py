"""A block rebuilt from its journal."""

from __future__ import annotations

from pathlib import Path

from anaplot.errors import InputError, NotComputableError
from anaplot.exchange.blockfolder import write_block_toml, write_image_points
from anaplot.orientation.results import ModelSolution
from anaplot.session.models import solve
from anaplot.session.state import SessionState
from anaplot.station.imagepoints import rows_of
from anaplot.station.replay import Replayed

__all__ = ["rebuild", "session_solutions"]


def rebuild(replayed: Replayed, folder: Path) -> None:
    """Write block.toml and image_points.csv of a replayed session into a new folder.

    Raises
    ------
    InputError
        The folder holds a block already, or cannot be written.
    """
    if (folder / "image_points.csv").exists():
        raise InputError(f"{folder}: there is an image_points.csv already")
    write_block_toml(folder, replayed.block)
    rows = rows_of(replayed.state.models)
    if rows:
        write_image_points(folder, rows)


def session_solutions(state: SessionState) -> tuple[tuple[str, ModelSolution], ...]:
    """Return (strip, solution) of the accepted models, and of the current one where it has one."""
    models = [*state.models, *([] if state.current is None else [state.current])]
    out = []
    for model in models:
        try:
            out.append((model.strip, solve(state, model)))
        except NotComputableError:
            continue
    return tuple(out)
