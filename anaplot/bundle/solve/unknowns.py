"""The unknowns of a bundle: their names, where they stand, and their values and units.

As one vector: those of the photos (n, d), of the points (p, 3) and the shared additional parameters
(g,), one after the other. What a person calls an unknown is a coordinate, an angle or a parameter,
a linear function of that vector near the solution. Offsets of stated positions and angles are
eliminated (`anaplot.bundle.solve.offsetequations`): they are the function -K^-1 C'x of the photos,
and beside it vary by themselves, with the cofactors K^-1.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array

from anaplot.aliases import Array
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.parameternames import (
    ParameterName,
    offset_names,
    parameter_names,
)
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.solve.unknownnames import UnknownName
from anaplot.errors import NotComputableError
from anaplot.photogrammetry.rotation import angle_derivatives, rotation_angles

__all__ = ["UnknownFunctions", "unknown_functions", "unknown_values"]

_UPRIGHT = 1e-12  # cosine of phi below which omega and kappa are one


class UnknownFunctions(NamedTuple):
    """Named unknowns as linear functions of the vector of all.

    Attributes
    ----------
    derivatives
        (k, n d + 3 p + g).
    beside
        (k, k) cofactors of what varies beside it; None: nothing does.
    """

    derivatives: csr_array
    beside: Array | None


def unknown_functions(block: AdjustedBlock, names: Sequence[UnknownName]) -> UnknownFunctions:
    """Return what k named unknowns are of the vector of all.

    Raises
    ------
    NotComputableError
        omega or kappa of a photo with phi at 90 degrees, where they are one.
    """
    problem, rotations = block.problem, block.state.rotations
    place, width = _places(problem), problem.per_photo
    after_photos = width * len(problem.photos)
    offsets = block.cofactors.normal.linear.offsets
    shared: list[tuple[int, int]] = []
    rows: list[int] = []
    columns: list[int] = []
    values: list[float] = []
    for row, name in enumerate(names):
        at = place[_key(name)]
        if isinstance(name, ParameterName) and name.kind == "offset":
            shared.append((row, at))
            continue
        if isinstance(name, ParameterName):
            # of a photo's own ones the place counts those before them
            if problem.photo_invariant:
                photo, index = divmod(at, width - 6)
                at = width * photo + 6 + index
            else:
                at += after_photos + 3 * len(problem.points)
            new = [(at, name.factor)]
        elif name.kind == "point":
            new = [(after_photos + 3 * at + name.axis, 1.0)]
        elif name.axis < 3:
            new = [(width * at + name.axis, 1.0)]
        else:
            if name.axis != 4 and np.hypot(*rotations[at, 0, :2]) < _UPRIGHT:
                raise NotComputableError(
                    f"photo {name.owner}: omega and kappa are one at phi = 90 degrees, and have no "
                    "covariance"
                )
            own = angle_derivatives(rotations[at])[name.axis - 3]
            new = [(width * at + 3 + k, float(value)) for k, value in enumerate(own)]
        rows += [row] * len(new)
        columns += [column for column, _ in new]
        values += [value for _, value in new]
    count = after_photos + 3 * len(problem.points) + problem.in_border
    shape = len(names), count
    derivatives = csr_array((values, (rows, columns)), shape=shape)
    if offsets is None or not shared:
        return UnknownFunctions(derivatives, None)
    mine, at_offset = (np.array(part, dtype=np.intp) for part in zip(*shared, strict=True))
    sides = offsets.sides(block.cofactors.normal.linear.photo_rows)
    own = -offsets.inverse[at_offset] @ sides.reshape(after_photos, -1).T
    every = mine.repeat(after_photos), np.tile(np.arange(after_photos), len(mine))
    beside = np.zeros((len(names), len(names)))
    beside[np.ix_(mine, mine)] = offsets.inverse[np.ix_(at_offset, at_offset)]
    return UnknownFunctions(
        csr_array(derivatives + csr_array((own.ravel(), every), shape=shape)), beside
    )


def unknown_values(block: AdjustedBlock, names: Sequence[UnknownName]) -> Array:
    """Return (k,) values [m, rad; of parameters their unit]."""
    state, place = block.state, _places(block.problem)
    equations = block.cofactors.normal.linear.offsets
    offsets = np.zeros(0) if equations is None else equations.value
    parameters = (state.own if block.problem.photo_invariant else state.shared).reshape(-1)
    out = np.empty(len(names))
    for k, name in enumerate(names):
        at = place[_key(name)]
        if isinstance(name, ParameterName):
            of_kind = parameters if name.kind == "parameter" else offsets
            out[k] = of_kind[at] * name.factor
        elif name.axis >= 3:
            out[k] = rotation_angles(state.rotations[at])[name.axis - 3]
        else:
            of = state.points if name.kind == "point" else state.centres
            out[k] = of[at, name.axis] + state.origin[name.axis]
    return out


def _places(problem: Problem) -> dict[tuple[str, str, str], int]:
    """Return the numbers of points, photos, parameters and offsets among their kind."""
    out = {("point", name, ""): k for k, name in enumerate(problem.points)}
    out |= {("photo", name, ""): k for k, name in enumerate(problem.photos)}
    for names in (parameter_names(problem), offset_names(problem)):
        out |= {_key(one): k for k, one in enumerate(names)}
    return out


def _key(name: UnknownName) -> tuple[str, str, str]:
    return name.kind, name.owner, name.unknown if isinstance(name, ParameterName) else ""
