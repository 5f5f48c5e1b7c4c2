"""What an adjusted block leaves to the next one: coordinates and their full covariance."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from anaplot.aliases import Array
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.crosscofactors import Sides, empty_sides, side_products
from anaplot.bundle.solve.observations import ORIENTATION
from anaplot.bundle.solve.problem import Problem
from anaplot.errors import InputError
from anaplot.photogrammetry.posterior import MOST_COORDINATES, CoordinateName, Posterior
from anaplot.photogrammetry.rotation import angle_derivatives, rotation_angles
from anaplot.textfiles.wording import hint, quoted

__all__ = ["coordinates_meant", "posterior_names", "posterior_of"]


def posterior_names(block: AdjustedBlock, wanted: Sequence[str]) -> tuple[CoordinateName, ...]:
    """Return the coordinates of an adjusted block that are meant, as `coordinates_meant` has it."""
    return coordinates_meant(block.problem, wanted)


def coordinates_meant(problem: Problem, wanted: Sequence[str]) -> tuple[CoordinateName, ...]:
    """Return the coordinates that are meant.

    Parameters
    ----------
    problem
        The bundle.
    wanted
        "points" and "photos" for all of them, or names of points, then of photos; "point:NAME" and
        "photo:NAME" where a name is both, or one of these words.

    Raises
    ------
    InputError
        A name that the block does not have, or two of a point and a photo; too many.
    """
    owners = {"point": problem.points, "photo": problem.photos}
    there = {kind: set(names) for kind, names in owners.items()}
    chosen: dict[tuple[str, str], None] = {}
    for one in wanted:
        kind, _, name = one.partition(":")
        if one in ("points", "photos"):
            chosen.update(((one[:-1], each), None) for each in owners[one[:-1]])
        elif kind in there and name in there[kind]:
            chosen[kind, name] = None
        else:
            kinds = [kind for kind, names in there.items() if one in names]
            if len(kinds) > 1:
                raise InputError(
                    f"--posterior-of: {quoted(one)} is a point and a photo: point:{one} or "
                    f"photo:{one}"
                )
            if not kinds:
                known = ["points", "photos", *problem.points, *problem.photos]
                raise InputError(
                    f"--posterior-of: no point and no photo {quoted(one)} in the adjusted block"
                    f"{hint(one, known)}"
                )
            chosen[kinds[0], one] = None
    names = tuple(
        CoordinateName("point", owner, unknown)
        if kind == "point"
        else CoordinateName("photo", owner, unknown)
        for kind, owner in chosen
        for unknown in ("XYZ" if kind == "point" else ORIENTATION)
    )
    if len(names) > MOST_COORDINATES:
        raise InputError(
            f"--posterior: {len(names)} coordinates with each other: at most {MOST_COORDINATES}; "
            "choose with --posterior-of"
        )
    return names


def posterior_of(block: AdjustedBlock, wanted: Sequence[str] = ("points",)) -> Posterior:
    """Return coordinates and their covariance, the state X1, C1 of the Bayesian paper's Figure 1.

    Parameters
    ----------
    block
        The adjusted block; its datum is that of control and priors.
    wanted
        As `coordinates_meant` has it.

    Returns
    -------
    Posterior
        Metres and radians, C for the a-priori sigma0; zeros where a coordinate is free of error.

    Raises
    ------
    InputError
        The datum is another one: coordinates of a free network are known in it alone.
    """
    problem = block.problem
    if problem.datum != "control":
        raise InputError(
            "--posterior goes with the datum of control: in another one C is that of the datum"
        )
    names = posterior_names(block, wanted)
    sides = _Unit(block, names)
    return Posterior(
        names,
        sides.values(),
        side_products(block, len(names), sides),
        f"the posterior of {problem.block.name}",
    )


class _Unit:
    """Right-hand sides that pick coordinates out of the unknowns."""

    def __init__(self, block: AdjustedBlock, names: Sequence[CoordinateName]) -> None:
        self._block, self._names = block, names
        problem = block.problem
        self._place = {
            "point": {name: k for k, name in enumerate(problem.points)},
            "photo": {name: k for k, name in enumerate(problem.photos)},
        }

    def __call__(self, mine: range) -> Sides:
        """Return the sides of some of the coordinates."""
        photos, points, shared = empty_sides(self._block, len(mine))
        fixed = self._block.problem.fixed
        for column, k in enumerate(mine):
            name = self._names[k]
            at = self._place[name.kind][name.owner]
            if name.kind == "point":
                points[at, name.axis, column] = 0.0 if fixed[at, name.axis] else 1.0
            elif name.axis < 3:
                photos[at, name.axis, column] = 1.0
            else:
                derivatives = angle_derivatives(self._block.state.rotations[at])
                photos[at, 3:6, column] = derivatives[name.axis - 3]
        return photos, points, shared

    def values(self) -> Array:
        """Return the coordinates [m, rad]."""
        state = self._block.state
        out = np.empty(len(self._names))
        for k, name in enumerate(self._names):
            at = self._place[name.kind][name.owner]
            if name.axis >= 3:
                out[k] = rotation_angles(state.rotations[at])[name.axis - 3]
            else:
                of = state.points if name.kind == "point" else state.centres
                out[k] = of[at, name.axis] + state.origin[name.axis]
        return out
