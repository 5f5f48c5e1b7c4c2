"""A geometry of one's own to simulate in: a pattern, a block's folder, a network."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array
from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.errors.snooping import model_values
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.observations import ObservationName
from anaplot.bundle.solve.residuals import block_residuals
from anaplot.errors import InputError
from anaplot.exchange.blockfolder import read_block
from anaplot.exchange.networkfile import read_network
from anaplot.exchange.patternfile import is_pattern_file, read_pattern
from anaplot.orientation.modelvalues import ideal_roots
from anaplot.orientation.patterns import USUAL_BASE, USUAL_C, USUAL_D, pattern
from anaplot.orientation.residuals import residual_system
from anaplot.photogrammetry.block import TieVariance
from anaplot.planning.networkplan import CUBE_VERSIONS, cube, plan_network
from anaplot.planning.ownerrors import Correlated, OwnErrors
from anaplot.planning.patternplan import (
    PlannedPattern,
    from_pattern,
    solve,
)
from anaplot.report.ownplaces import RowName, rows_in
from anaplot.report.plannetwork import network_from_file
from anaplot.station.coverage import is_held
from anaplot.textfiles.inputfile import real_path
from anaplot.textfiles.tomltable import read_toml
from anaplot.textfiles.wording import hint, quoted

__all__ = ["MOST_ROWS", "ModelOptions", "own_scenario"]


MOST_ROWS = 4_000
"""Rows of the largest block: R is held dense in every process."""

# Runs of a chunk, and rows of them all: a large block's chunks are done, and kept, as often.
_CHUNK, _CHUNK_ROWS = 50, 5_000

_MOST_BYTES = 20_000_000


class ModelOptions(NamedTuple):
    """What a pattern does not say of its model; None: not asked for.

    Attributes
    ----------
    base, d, c
        Base at photo scale, half the model in y, and camera constant [mm].
    tie_variance
        Of the ties; "exact" by default.
    """

    base: float | None = None
    d: float | None = None
    c: float | None = None
    tie_variance: TieVariance | None = None

    def given(self) -> str | None:
        """Return the first option that was asked for."""
        return next(
            (f"--{k.replace('_', '-')}" for k, v in self._asdict().items() if v is not None), None
        )


class _Geometry(NamedTuple):
    """A geometry, linearised.

    Attributes
    ----------
    name, about
        What it is called, whatever way its file was named; and what it is.
    names, matrix
        Of the rows, and R between them.
    models
        (n,) model values of sqrt(q_vv).
    settings
        What was assumed of it.
    correlated
        How its rows are correlated, or None.
    """

    name: str
    about: str
    names: tuple[RowName, ...]
    matrix: Array
    models: Array
    settings: dict[str, float | str]
    correlated: Correlated | None = None


def own_scenario(
    source: str,
    *,
    numbers: tuple[int, ...],
    sizes: tuple[float, ...],
    places: Sequence[str],
    alpha: float,
    known: Collection[str],
    model: ModelOptions,
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
    model
        Of a pattern only.

    Raises
    ------
    InputError
        No such geometry or place, options that it does not have, or the block is too large.
    NotComputableError
        It does not determine its unknowns.
    """
    found = _geometry(source, known, model)
    scenario = OwnErrors(
        found.name,
        f"errors planted in {found.about}",
        found.matrix,
        found.names,
        found.models,
        numbers,
        sizes,
        rows_in(found.names, places),
        alpha,
        chunk=max(1, min(_CHUNK, _CHUNK_ROWS // len(found.names))),
        settings=found.settings,
        correlated=found.correlated,
    )
    scenario.prepare()
    return scenario


def _geometry(source: str, known: Collection[str], model: ModelOptions) -> _Geometry:
    path = Path(source)
    suffix = path.suffix.lower()
    cubic, _, version = source.partition(":")
    if path.is_dir() or cubic == "cube" or (suffix == ".toml" and _is_network(path)):
        if model.given() is not None:
            raise InputError(f"{model.given()} goes with a pattern")
        if path.is_dir():
            return _of_block(path)
        return _of_network(path) if suffix == ".toml" else _of_cube(version)
    if is_pattern_file(path):
        if model.d is not None:
            raise InputError("--d goes with a named pattern; a file says where its points lie")
        own = read_pattern(path)
        plan = PlannedPattern(own.places, own.ties, model.base or USUAL_BASE, model.c or USUAL_C)
        return _of_model(path.name, f"the pattern {path.name}", plan, model)
    try:
        named = pattern(source)
    except InputError:
        raise InputError(
            f"{quoted(source)} is no scenario{hint(source, known)}, pattern, block or network; "
            "--list names the scenarios"
        ) from None
    plan = from_pattern(named, model.base or USUAL_BASE, model.d or USUAL_D, model.c or USUAL_C)
    about = f"a model of pattern {named.name}"
    return _of_model(named.name, about, plan, model, d=model.d or USUAL_D)


def _is_network(path: Path) -> bool:
    """Tell a network from a pattern: only a network has stations."""
    return "station" in read_toml(path, _MOST_BYTES)


def _of_cube(version: str) -> _Geometry:
    case = version or "A"
    if case not in CUBE_VERSIONS:
        raise InputError(f"no cube {quoted(version)}: A to E")
    block = plan_network(cube(case)).evaluated()
    return _of_adjusted(f"cube:{case}", f"the cube of 1978, {case}", block)


def _of_network(path: Path) -> _Geometry:
    network = network_from_file(read_network(path))
    block = plan_network(network).evaluated("control" if network.control else "free")
    return _of_adjusted(path.name, f"network {network.name}", block)


def _of_block(path: Path) -> _Geometry:
    # conditions between points take no part in what is simulated
    block = replace(read_block(path), conditions=())
    adjusted = adjust_block(block, datum="control" if is_held(block) else "free")
    return _of_adjusted(real_path(path).name, f"block {block.name}", adjusted)


def _of_model(
    name: str, about: str, plan: PlannedPattern, model: ModelOptions, **more: float
) -> _Geometry:
    tie_variance = model.tie_variance or "exact"
    solution = solve(plan, tie_variance)
    system = residual_system(solution)
    correlated = None
    if solution.exact is not None:
        unit = solution.exact.units
        scaled = solution.exact.misclosures / unit[:, None] / unit
        factor = np.asarray(np.linalg.cholesky(scaled))
        correlated = Correlated(factor, np.sqrt(solution.q_l) / unit, solution.redundancy)
    names = tuple(RowName(None, row.point, row.axis) for row in solution.table)
    lengths = {"base": plan.base, **more, "c": plan.c}
    said = ", ".join(f"{what} {value:g} mm" for what, value in lengths.items())
    return _Geometry(
        name,
        f"{about}, {said}, tie variance {tie_variance}",
        names,
        system.matrix,
        ideal_roots(solution),
        {f"{what}_mm": value for what, value in lengths.items()} | {"tie_variance": tie_variance},
        correlated,
    )


def _of_adjusted(name: str, about: str, block: AdjustedBlock) -> _Geometry:
    count = 2 * len(block.problem.photo)
    if count > MOST_ROWS:
        raise InputError(f"{about}: {count} image coordinates, at most {MOST_ROWS} are simulated")
    system = block_residuals(block.problem, block.state, block.cofactors.normal.structure)
    datum = block.problem.datum
    return _Geometry(
        name,
        about if datum == "control" else f"{about}: no control and no priors, {datum} datum",
        tuple(_row_name(row) for row in system.names),
        system.columns(np.arange(len(system.e))),
        model_values(system),
        {"datum": datum},
    )


def _row_name(name: ObservationName) -> RowName:
    """Return what an observation belongs to: its kind comes first, its axis or unknown last."""
    kind, first, *_ = name
    if kind == "image":
        return RowName(str(first), str(name[2]), str(name[-1]))
    if kind == "control":
        return RowName(None, str(first), str(name[-1]))
    if kind == "point prior":
        return RowName(None, str(first), f"prior-{name[-1]}")
    return RowName(str(first), None, str(name[-1]))
