"""The unknowns of a bundle: their names, where they stand, and their values and units.

As one vector: those of the photos (n, d), of the points (p, 3) and the shared additional parameters
(g,), one after the other. What a person calls an unknown is a coordinate, an angle or a parameter,
a linear function of that vector near the solution.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Literal, TypeAlias

import numpy as np
from scipy.sparse import csr_array

from anaplot.aliases import Array
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.observations import ORIENTATION
from anaplot.bundle.solve.parameternames import ParameterName, parameter_names
from anaplot.bundle.solve.problem import Problem
from anaplot.errors import InputError, NotComputableError
from anaplot.photogrammetry.posterior import CoordinateName
from anaplot.photogrammetry.rotation import angle_derivatives, rotation_angles
from anaplot.textfiles.wording import hint, quoted

__all__ = [
    "UnknownName",
    "unknown_functions",
    "unknown_values",
    "unknowns_meant",
    "unknowns_of",
]

_UPRIGHT = 1e-12  # cosine of phi below which omega and kappa are one


UnknownName: TypeAlias = CoordinateName | ParameterName
"""Coordinates and angles, and additional parameters: `kind`, `owner`, `unknown`, `unit`, `text`."""


def unknown_functions(block: AdjustedBlock, names: Sequence[UnknownName]) -> csr_array:
    """Return (k, n d + 3 p + g) derivatives of k named unknowns by the vector of all.

    Raises
    ------
    NotComputableError
        omega or kappa of a photo with phi at 90 degrees, where they are one.
    """
    problem, rotations = block.problem, block.state.rotations
    place, width = _places(problem), problem.per_photo
    after_photos = width * len(problem.photos)
    rows: list[int] = []
    columns: list[int] = []
    values: list[float] = []
    for row, name in enumerate(names):
        at = place[name.kind, name.owner, name.unknown if name.kind == "parameter" else ""]
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
    return csr_array((values, (rows, columns)), shape=(len(names), count))


def unknown_values(block: AdjustedBlock, names: Sequence[UnknownName]) -> Array:
    """Return (k,) values [m, rad; of parameters their unit]."""
    state, place = block.state, _places(block.problem)
    parameters = (state.own if block.problem.photo_invariant else state.shared).reshape(-1)
    out = np.empty(len(names))
    for k, name in enumerate(names):
        at = place[name.kind, name.owner, name.unknown if name.kind == "parameter" else ""]
        if isinstance(name, ParameterName):
            out[k] = parameters[at] * name.factor
        elif name.axis >= 3:
            out[k] = rotation_angles(state.rotations[at])[name.axis - 3]
        else:
            of = state.points if name.kind == "point" else state.centres
            out[k] = of[at, name.axis] + state.origin[name.axis]
    return out


def _places(problem: Problem) -> dict[tuple[str, str, str], int]:
    """Return the numbers of points, photos and parameters among their kind."""
    out = {("point", name, ""): k for k, name in enumerate(problem.points)}
    out |= {("photo", name, ""): k for k, name in enumerate(problem.photos)}
    for k, one in enumerate(parameter_names(problem)):
        out["parameter", one.owner, one.unknown] = k
    return out


def unknowns_meant(problem: Problem, wanted: Iterable[str], option: str) -> tuple[UnknownName, ...]:
    """Return the unknowns that are meant, each once, in the order in which they are asked for.

    Parameters
    ----------
    problem
        The bundle.
    wanted
        "points", "photos" and "parameters" for all of them; "points:A,B", "photos:101",
        "parameters:c,k1" for some; "point:NAME", "photo:NAME" and "parameter:NAME" for one, whose
        name may hold commas and colons; a name of a point or photo alone. One unknown of an owner
        stands behind a colon: "point:7:Z", "parameter:GROUP:k1".
    option
        What messages call it.

    Raises
    ------
    InputError
        A name that the block does not have or that takes no part, or two of a point and a photo.
    """
    known = _Known(problem, option)
    chosen: dict[UnknownName, None] = {}
    for one in wanted:
        chosen.update(dict.fromkeys(known.meant(one)))
    return tuple(chosen)


def unknowns_of(problem: Problem) -> tuple[UnknownName, ...]:
    """Return all unknowns of a bundle that have names: of points, photos, parameters."""
    points = (one for name in problem.points for one in _coordinates("point", name))
    photos = (one for name in problem.photos for one in _coordinates("photo", name))
    return (*points, *photos, *(one for one in parameter_names(problem) if not one.held))


class _Known:
    """The unknowns of a bundle by what they are called."""

    def __init__(self, problem: Problem, option: str) -> None:
        self._problem, self._option = problem, option
        self._owners: dict[str, dict[str, tuple[UnknownName, ...]]] = {
            "point": {name: _coordinates("point", name) for name in problem.points},
            "photo": {name: _coordinates("photo", name) for name in problem.photos},
        }
        parameters: dict[str, tuple[UnknownName, ...]] = {}
        groups: dict[str, tuple[UnknownName, ...]] = {}
        for one in parameter_names(problem):
            if one.held:
                continue
            parameters[one.unknown] = (*parameters.get(one.unknown, ()), one)
            groups[one.owner] = (*groups.get(one.owner, ()), one)
        # a parameter of all groups, or all parameters of a group
        self._owners["parameter"] = groups | parameters
        self._groups = groups

    def meant(self, text: str) -> list[UnknownName]:
        """Return what is meant by one word."""
        word, colon, rest = text.partition(":")
        kind = word.removesuffix("s")
        if kind in self._owners and word != kind:
            if not colon:
                return self._all(kind)
            return [
                found
                for name in rest.split(",")
                if name.strip()
                for found in self._one(kind, name.strip())
            ]
        if kind in self._owners and colon:
            found = self._found(kind, rest)
            if found:
                return found
        bare = [kind for kind in ("point", "photo") if text in self._owners[kind]]
        if len(bare) > 1:
            raise InputError(
                f"{self._option}: {quoted(text)} is a point and a photo: point:{text} or "
                f"photo:{text}"
            )
        if bare:
            return [*self._owners[bare[0]][text]]
        if kind in self._owners and colon:
            return self._one(kind, rest)
        words = ["points", "photos"]
        raise InputError(
            f"{self._option}: no point and no photo {quoted(text)} in the adjusted block"
            f"{hint(text, [*words, *self._owners['point'], *self._owners['photo']])}"
        )

    def _all(self, kind: str) -> list[UnknownName]:
        owners = self._groups if kind == "parameter" else self._owners[kind]
        found = [name for names in owners.values() for name in names]
        if not found:
            raise InputError(f"{self._option}: the block is adjusted without additional parameters")
        return found

    def _one(self, kind: str, name: str) -> list[UnknownName]:
        found = self._found(kind, name)
        if found:
            return found
        if kind == "parameter" and not self._groups:
            raise InputError(
                f"{self._option}: no parameter {quoted(name)}: the block is adjusted without "
                "additional parameters"
            )
        if kind == "parameter" and any(
            one.held and name in (one.unknown, f"{one.owner}:{one.unknown}")
            for one in parameter_names(self._problem)
        ):
            raise InputError(f"{self._option}: parameter {quoted(name)} is held: it does not vary")
        kinds = ("photo",) if kind == "photo" else ("point", "control")
        for out in self._problem.left_out:
            if kind != "parameter" and out.kind in kinds and out.name == name:
                raise InputError(
                    f"{self._option}: {kind} {quoted(name)} takes no part in the adjustment: it "
                    f"{out.reason}"
                )
        owner, _, unknown = name.rpartition(":")
        if owner in self._owners[kind]:
            known = [one.unknown for one in self._owners[kind][owner]]
            raise InputError(
                f"{self._option}: {kind} {quoted(owner)} has no {quoted(unknown)}"
                f"{hint(unknown, known)}"
            )
        raise InputError(
            f"{self._option}: no {kind} {quoted(name)} in the adjusted block"
            f"{hint(name, self._owners[kind])}"
        )

    def _found(self, kind: str, name: str) -> list[UnknownName]:
        owners = self._owners[kind]
        if name in owners:
            return [*owners[name]]
        owner, _, unknown = name.rpartition(":")
        among = self._groups if kind == "parameter" else owners
        return [one for one in among.get(owner, ()) if one.unknown == unknown]


def _coordinates(kind: Literal["point", "photo"], owner: str) -> tuple[UnknownName, ...]:
    unknowns = "XYZ" if kind == "point" else ORIENTATION
    return tuple(CoordinateName(kind, owner, unknown) for unknown in unknowns)
