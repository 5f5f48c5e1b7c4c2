"""What unknowns of a bundle are called: by people in a few words, by programs one by one."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal, TypeAlias

from anaplot.bundle.solve.observations import ORIENTATION
from anaplot.bundle.solve.parameternames import (
    ParameterName,
    offset_names,
    parameter_names,
)
from anaplot.bundle.solve.problem import Problem
from anaplot.errors import InputError
from anaplot.photogrammetry.posterior import CoordinateName
from anaplot.textfiles.separated import separated
from anaplot.textfiles.wording import hint, quoted

__all__ = ["UnknownName", "unknowns_meant", "unknowns_of"]

UnknownName: TypeAlias = CoordinateName | ParameterName
"""Coordinates and angles, parameters and offsets: `kind`, `owner`, `unknown`, `unit`, `text`."""


def unknowns_meant(problem: Problem, wanted: Iterable[str], option: str) -> tuple[UnknownName, ...]:
    """Return the unknowns that are meant, each once, in the order in which they are asked for.

    Parameters
    ----------
    problem
        The bundle.
    wanted
        "points", "photos", "parameters" and "offsets" for all of them; "points:A,B", "photos:101",
        "parameters:c,k1" for some (`separated`: 'points:7,"12,a"'); "point:NAME", "photo:NAME" and
        "parameter:NAME" for one, whose name may hold commas and colons; a name of a point or photo
        alone. One unknown of an owner stands behind a colon: "point:7:Z", "parameter:GROUP:k1",
        "offset:STRIP:shift_X".
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
    """Return all unknowns of a bundle that have names."""
    points = (one for name in problem.points for one in _coordinates("point", name))
    photos = (one for name in problem.photos for one in _coordinates("photo", name))
    shared = (*parameter_names(problem), *offset_names(problem))
    return (*points, *photos, *(one for one in shared if not one.held))


_NONE = {
    "point": "the block has no points",
    "photo": "the block has no photos",
    "parameter": "the block is adjusted without additional parameters",
    "offset": "the block is adjusted without offsets of what photos state",
}
_HELD = {
    "parameter": "is held: it does not vary",
    "offset": "is no unknown: nothing is observed of it",
}


class _Known:
    """The unknowns of a bundle by what they are called."""

    def __init__(self, problem: Problem, option: str) -> None:
        self._problem, self._option = problem, option
        self._owners: dict[str, dict[str, tuple[UnknownName, ...]]] = {
            "point": {name: _coordinates("point", name) for name in problem.points},
            "photo": {name: _coordinates("photo", name) for name in problem.photos},
        }
        # of what groups of photos share: all of a group
        self._groups: dict[str, dict[str, tuple[UnknownName, ...]]] = {}
        self._shared = {"parameter": parameter_names(problem), "offset": offset_names(problem)}
        for kind, names in self._shared.items():
            groups = self._groups[kind] = {}
            of_all: dict[str, tuple[UnknownName, ...]] = {}
            for one in names:
                if not one.held:
                    of_all[one.unknown] = (*of_all.get(one.unknown, ()), one)
                    groups[one.owner] = (*groups.get(one.owner, ()), one)
            self._owners[kind] = groups | of_all

    def meant(self, text: str) -> list[UnknownName]:
        """Return what is meant by one word."""
        word, colon, rest = text.partition(":")
        kind = word.removesuffix("s")
        if kind in self._owners and word != kind:
            if not colon:
                return self._all(kind)
            try:
                parts = separated(rest)
            except InputError as error:
                raise InputError(f"{self._option}: {error}") from error
            return [found for name in parts if name for found in self._one(kind, name)]
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
        owners = self._groups.get(kind, self._owners[kind])
        found = [name for names in owners.values() for name in names]
        if not found:
            raise InputError(f"{self._option}: {_NONE[kind]}")
        return found

    def _one(self, kind: str, name: str) -> list[UnknownName]:
        found = self._found(kind, name)
        if found:
            return found
        if not self._owners[kind]:
            raise InputError(f"{self._option}: no {kind} {quoted(name)}: {_NONE[kind]}")
        if any(
            one.held and name in (one.unknown, f"{one.owner}:{one.unknown}")
            for one in self._shared.get(kind, ())
        ):
            raise InputError(f"{self._option}: {kind} {quoted(name)} {_HELD[kind]}")
        kinds = ("photo",) if kind == "photo" else ("point", "control")
        for out in self._problem.left_out:
            if kind not in self._groups and out.kind in kinds and out.name == name:
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
        among = self._groups.get(kind, owners)
        return [one for one in among.get(owner, ()) if one.unknown == unknown]


def _coordinates(kind: Literal["point", "photo"], owner: str) -> tuple[UnknownName, ...]:
    unknowns = "XYZ" if kind == "point" else ORIENTATION
    return tuple(CoordinateName(kind, owner, unknown) for unknown in unknowns)
