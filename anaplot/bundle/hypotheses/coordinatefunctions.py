"""Functions of adjusted coordinates: value, standard deviation, external reliability.

A function f of the points has, with its gradient g, the variance g' Q g; an error of the smallest
detectable size nabla_i in observation i changes it by g' Q a_i delta0 / sqrt(r_i), a_i being the
whitened row of the observation (Baarda 1968; Gruen 1978, section C).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from anaplot.aliases import Array
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.observations import ObservationName
from anaplot.bundle.solve.residuals import residuals_of
from anaplot.errors import InputError, NotComputableError
from anaplot.textfiles.wording import hint, quoted

__all__ = ["CoordinateFunction", "FunctionKind", "FunctionValue", "evaluate_functions"]

FunctionKind = Literal["distance", "height", "centre"]


class CoordinateFunction(NamedTuple):
    """A function of points.

    Attributes
    ----------
    kind
        "distance" between two points, "height" of the second above the first, "centre": the mean
        of all.
    points
        Their names.
    """

    kind: FunctionKind
    points: tuple[str, ...]

    @property
    def name(self) -> str:
        """What it is called."""
        return f"{self.kind} {' '.join(self.points)}"


class FunctionValue(NamedTuple):
    """A function of adjusted coordinates.

    Attributes
    ----------
    function
        What it is.
    axis
        "X", "Y" or "Z" of a centre, else "".
    value, s
        Value and standard deviation [m]; s None without a sigma0.
    effect
        What the smallest detectable error of one observation changes it by at most [m]; None where
        nothing can be detected.
    observation
        Which observation that is.
    """

    function: CoordinateFunction
    axis: str
    value: float
    s: float | None
    effect: float | None
    observation: ObservationName | None


def evaluate_functions(
    block: AdjustedBlock, functions: Sequence[CoordinateFunction]
) -> tuple[FunctionValue, ...]:
    """Evaluate functions of the coordinates of an adjusted block.

    Parameters
    ----------
    block
        The adjusted block, in the datum of control; distances also in a free one whose scale
        distances give.
    functions
        The functions.

    Raises
    ------
    InputError
        A point that is not adjusted, or another datum: there the function means nothing.
    NotComputableError
        A distance between points that coincide.
    """
    if not functions:
        return ()
    problem, change = block.problem, block.cofactors.change
    scaled = change is not None and change.gives_scale
    if change is not None and not (scaled and all(one.kind == "distance" for one in functions)):
        but = ", but for distances" if scaled else ""
        raise InputError(
            f"functions of coordinates need the datum of control, not {problem.datum}{but}"
        )
    place = {name: k for k, name in enumerate(problem.points)}
    wanted = []
    for function in functions:
        for name in function.points:
            if name not in place:
                known = hint(name, place)
                raise InputError(f"{function.name}: no adjusted point {quoted(name)}{known}")
        at = block.state.points[[place[name] for name in function.points]] + block.state.origin
        wanted += [(function, *one) for one in _gradients(function, at)]
    sides = np.zeros((len(problem.points), 3, len(wanted)))
    for column, (function, _, _, gradient) in enumerate(wanted):
        for name, own in zip(function.points, gradient, strict=True):
            sides[place[name], :, column] += np.where(problem.fixed[place[name]], 0.0, own)
    system = residuals_of(block)
    variance = np.zeros(len(wanted))
    if change is not None:
        sides, by_held = change.of_functions(sides)
        variance += by_held**2 @ change.variance
    moved, changes = system.solved(sides)
    variance += np.einsum("pik,pik->k", sides, moved)
    if change is not None:
        changes[system.rows.starts[3] :] += np.outer(change.by_conditions, by_held[:, 6])
    # of an error of the detectable size, from that of one sigma
    size = np.abs(changes * (block.tested.mdb / system.sigma)[:, None])
    out = []
    for column, (function, axis, value, _) in enumerate(wanted):
        s = None if block.sigma is None else block.sigma * float(np.sqrt(max(variance[column], 0)))
        most = None
        if np.isfinite(size[:, column]).any():
            most = int(np.nanargmax(size[:, column]))
        out.append(
            FunctionValue(
                function,
                axis,
                value,
                s,
                None if most is None else float(size[most, column]),
                None if most is None else system.names[most],
            )
        )
    return tuple(out)


def _gradients(function: CoordinateFunction, at: Array) -> list[tuple[str, float, Array]]:
    """Return axis, value and (n, 3) gradient of each of a function's values."""
    if function.kind == "centre":
        out = []
        for axis in range(3):
            gradient = np.zeros((len(at), 3))
            gradient[:, axis] = 1.0 / len(at)
            out.append(("XYZ"[axis], float(at[:, axis].mean()), gradient))
        return out
    step = at[1] - at[0]
    if function.kind == "height":
        up = np.array((0.0, 0.0, 1.0))
        return [("", float(step[2]), np.array((-up, up)))]
    length = float(np.linalg.norm(step))
    if not length > 0.0:
        raise NotComputableError(f"{function.name}: its points coincide")
    return [("", length, np.array((-step, step)) / length)]
