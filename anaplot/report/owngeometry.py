"""A geometry of one's own to simulate in: a pattern, a block's folder, a network."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.adjusted import AdjustedBlock
from anaplot.bundle.residuals import ObservationName, block_residuals
from anaplot.errors import InputError
from anaplot.exchange.blockfolder import read_block
from anaplot.exchange.networkfile import read_network
from anaplot.exchange.patternfile import read_pattern
from anaplot.exchange.wording import hint, quoted
from anaplot.orientation.patterns import pattern
from anaplot.planning.networkplan import CUBE_VERSIONS, cube, plan_network
from anaplot.planning.ownerrors import OwnErrors
from anaplot.planning.patternplan import PlannedPattern, from_pattern, solve
from anaplot.report.ownplaces import RowName, rows_in
from anaplot.report.plannetwork import network_from_file

__all__ = ["MOST_ROWS", "own_scenario"]

Array = NDArray[np.float64]
Rows = tuple[str, tuple[RowName, ...], Array]

MOST_ROWS = 4_000
"""Rows of the largest block: R is held dense in every process."""

# Runs of a chunk, and rows of them all: a large block's chunks are done, and kept, as often.
_CHUNK, _CHUNK_ROWS = 50, 5_000

_BASE, _D, _C = 90.0, 100.0, 152.0


def own_scenario(
    source: str,
    *,
    numbers: tuple[int, ...],
    sizes: tuple[float, ...],
    places: Sequence[str],
    alpha: float,
    known: Collection[str],
) -> OwnErrors:
    """Return the scenario of errors planted in a geometry.

    Parameters
    ----------
    source
        "13/5" or a file of points; a block's folder; "cube:A" or a network's file.
    numbers, sizes, alpha
        As `OwnErrors` has them.
    places
        Photos, points and axes to which the errors are kept, see `rows_in`.
    known
        Names of scenarios, for a hint.

    Raises
    ------
    InputError
        No such geometry or place, or the block is too large.
    NotComputableError
        It does not determine its unknowns.
    """
    about, names, matrix = _rows(source, known)
    scenario = OwnErrors(
        source,
        f"errors planted in {about}",
        matrix,
        numbers,
        sizes,
        rows_in(names, places),
        alpha,
        chunk=max(1, min(_CHUNK, _CHUNK_ROWS // len(names))),
    )
    scenario.prepare()
    return scenario


def _rows(source: str, known: Collection[str]) -> Rows:
    path = Path(source)
    if source.startswith("cube:"):
        version = source.removeprefix("cube:")
        if version not in CUBE_VERSIONS:
            raise InputError(f"no cube {quoted(version)}: A to E")
        return _block_rows(plan_network(cube(version)).evaluated(), f"the cube of 1978, {version}")
    if path.is_dir():
        block = adjust_block(read_block(path))
        return _block_rows(block, f"block {block.problem.block.name}")
    suffix = path.suffix.lower()
    if suffix == ".csv" or (suffix == ".toml" and _is_pattern(path)):
        points, ties = read_pattern(path)
        return _model_rows(PlannedPattern(points, ties, _BASE, _C), f"the pattern {path.name}")
    if suffix == ".toml":
        network = network_from_file(read_network(path))
        made = plan_network(network).evaluated("control" if network.control else "free")
        return _block_rows(made, f"network {network.name}")
    try:
        named = pattern(source)
    except InputError:
        raise InputError(
            f"{quoted(source)} is no scenario{hint(source, known)}, pattern, block or network; "
            "--list names the scenarios"
        ) from None
    return _model_rows(from_pattern(named, _BASE, _D, _C), f"a model of pattern {source}")


def _is_pattern(path: Path) -> bool:
    """Tell a pattern from a network: only its points have labels."""
    try:
        with path.open(encoding="utf-8", errors="replace") as file:
            return not any(line.strip().startswith("[[station]]") for line in file)
    except OSError:
        return False


def _model_rows(plan: PlannedPattern, about: str) -> Rows:
    solution = solve(plan, "propagated")
    root = np.sqrt(solution.q_l)
    names = tuple(RowName(None, row.point, row.axis) for row in solution.table)
    return about, names, solution.q_vv / root[:, None] / root


def _block_rows(block: AdjustedBlock, about: str) -> Rows:
    normal = block.cofactors.normal
    count = 2 * len(block.problem.photo)
    if count > MOST_ROWS:
        raise InputError(f"{about}: {count} image coordinates, at most {MOST_ROWS} are simulated")
    system = block_residuals(block.problem, block.state, normal.structure)
    n = len(system.e)
    names = tuple(_row_name(name) for name in system.names)
    return about, names, system.columns(np.arange(n))


def _row_name(name: ObservationName) -> RowName:
    """Return what an observation belongs to: its kind comes first, its axis or unknown last."""
    kind, first, *_ = name
    if kind == "image":
        return RowName(str(first), str(name[2]), str(name[-1]))
    if kind == "control":
        return RowName(None, str(first), str(name[-1]))
    return RowName(str(first), None, str(name[-1]))
