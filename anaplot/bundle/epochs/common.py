"""What epochs have in common: coordinates that control gives in several, or stable points."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.namedpoints import point_places
from anaplot.bundle.solve.problem import listed
from anaplot.errors import InputError, NotComputableError
from anaplot.photogrammetry.block import Block, ControlPoint

__all__ = [
    "Common",
    "Epochs",
    "check_control",
    "check_stable",
    "common_control",
    "is_weighted",
    "nearly_in_line",
    "ordinal",
    "stable_points",
]

Epochs = frozenset[int]
"""Some epochs, numbered from 0."""

_AXES = "XYZ"
_APART = 5.0  # standard deviations by which control of one datum never differs
_FLAT = 1e-3  # of the extent: points closer to one line than this do not hold a rotation


@dataclass(frozen=True, slots=True)
class Common:
    """Coordinates that are the same in several epochs.

    Attributes
    ----------
    axes
        By the name of a point: the epochs in which its X, Y and Z are one; empty of an axis that
        each epoch has for itself.
    """

    axes: Mapping[str, tuple[Epochs, Epochs, Epochs]]

    def whole(self, point: str) -> Epochs:
        """Return the epochs in which all three coordinates of a point are one; at least two."""
        x, y, z = self.axes.get(point, (frozenset[int](),) * 3)
        epochs = x & y & z
        return epochs if len(epochs) > 1 else frozenset()

    def points(self, among: Collection[int] | None = None) -> tuple[str, ...]:
        """Return the points that are one in all coordinates in two epochs at least."""
        return tuple(name for name in self.axes if _several(self.whole(name), among))

    def partly(self, among: Collection[int] | None = None) -> dict[str, tuple[int, ...]]:
        """Return the common axes of the other points, by name."""
        out: dict[str, tuple[int, ...]] = {}
        for name, epochs in self.axes.items():
            mine = tuple(k for k in range(3) if _several(epochs[k], among))
            if mine and not _several(self.whole(name), among):
                out[name] = mine
        return out

    def lettered(self, among: Collection[int] | None = None) -> tuple[tuple[str, str], ...]:
        """Return `partly` with the axes as letters: ("p1", "XY")."""
        several = self.partly(among).items()
        return tuple((name, "".join(_AXES[k] for k in axes)) for name, axes in several)

    def same(self, point: str, axis: int, first: int, second: int) -> bool:
        """Whether a coordinate is one in two epochs."""
        epochs = self.axes.get(point)
        return epochs is not None and first in epochs[axis] and second in epochs[axis]


def _several(epochs: Epochs, among: Collection[int] | None) -> bool:
    return len(epochs if among is None else epochs & set(among)) > 1


def ordinal(number: int) -> str:
    """Return "first" for 1, and so on."""
    words = ("first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth", "ninth")
    if number <= len(words):
        return words[number - 1]
    last = {1: "st", 2: "nd", 3: "rd"}.get(number % 10, "th")
    return f"{number}{'th' if number % 100 in (11, 12, 13) else last}"


def common_control(blocks: Sequence[Block]) -> Common:
    """Return the coordinates that control gives in several epochs."""
    given: dict[str, list[set[int]]] = {}
    for k, block in enumerate(blocks):
        for row in block.control:
            if row.use != "control":
                continue
            axes = given.setdefault(row.point, [set(), set(), set()])
            for axis, value in enumerate(row.xyz):
                if value is not None:
                    axes[axis].add(k)
    found: dict[str, tuple[Epochs, Epochs, Epochs]] = {}
    for name, each in given.items():
        x, y, z = (frozenset(epochs if len(epochs) > 1 else ()) for epochs in each)
        if x or y or z:
            found[name] = (x, y, z)
    return Common(found)


def stable_points(names: Sequence[str], count: int) -> Common:
    """Return points that are the same in all of `count` epochs."""
    every = frozenset(range(count))
    return Common(dict.fromkeys(names, (every, every, every)))


def _sigmas(block: Block, row: ControlPoint) -> tuple[float | None, ...]:
    """Return the standard deviations [m] of a point's coordinates, None for what is not given."""
    return tuple(
        None if value is None else sigma
        for value, sigma in zip(row.xyz, block.sigma_of(row), strict=True)
    )


def _control_pairs(first: Block, second: Block) -> list[tuple[ControlPoint, ControlPoint]]:
    there = {row.point: row for row in second.control if row.use == "control"}
    return [
        (row, there[row.point])
        for row in first.control
        if row.use == "control" and row.point in there
    ]


def _pairs(blocks: Sequence[Block]) -> list[tuple[int, int]]:
    return [(j, k) for k in range(len(blocks)) for j in range(k)]


def check_control(blocks: Sequence[Block], separate: bool) -> None:
    """Refuse control that is not of one datum; joint control must be the same.

    Raises
    ------
    InputError
        Control that differs between two epochs.
    """
    for j, k in _pairs(blocks):
        first, second = blocks[j], blocks[k]
        for one, two in _control_pairs(first, second):
            sigmas = zip(_sigmas(first, one), _sigmas(second, two), strict=True)
            for axis, (a, b, (s, t)) in enumerate(zip(one.xyz, two.xyz, sigmas, strict=True)):
                name = f"control point {one.point}"
                if not separate and (a != b or s != t):
                    raise InputError(
                        f"{name}: {_AXES[axis]} is {_stated(a, s)} in the {ordinal(j + 1)} epoch "
                        f"and {_stated(b, t)} in the {ordinal(k + 1)}: a joint adjustment needs "
                        "the same (--separate does not)"
                    )
                if a is None or b is None or s is None or t is None:
                    continue
                if abs(a - b) > _APART * float(np.hypot(s, t)):
                    which = "the epochs" if len(blocks) == 2 else f"epochs {j + 1} and {k + 1}"
                    raise InputError(
                        f"{name}: {_AXES[axis]} differs by {b - a:g} m between {which}, more than "
                        f"its sigmas {s:g} and {t:g} m allow: the epochs are not in one datum "
                        "(points that have not moved can hold it: --stable)"
                    )


def is_weighted(blocks: Sequence[Block]) -> bool:
    """Whether a coordinate that control gives in two epochs has a standard deviation."""
    return any(
        s is not None and t is not None and max(s, t) > 0.0
        for j, k in _pairs(blocks)
        for one, two in _control_pairs(blocks[j], blocks[k])
        for s, t in zip(_sigmas(blocks[j], one), _sigmas(blocks[k], two), strict=True)
    )


def _stated(value: float | None, sigma: float | None) -> str:
    return "not known" if value is None else f"{value:.10g} (sigma {sigma:g})"


def nearly_in_line(block: AdjustedBlock, points: Sequence[str]) -> bool:
    """Whether points of a block lie on one line, as far as a rotation about it is concerned."""
    at = point_places(block, points, block.state.origin)
    spread = np.linalg.svd(at - at.mean(axis=0), compute_uv=False)
    return not spread[1] > _FLAT * spread[0]


def check_stable(alone: Sequence[AdjustedBlock], stable: Sequence[str]) -> None:
    """Refuse points that do not hold a datum.

    Raises
    ------
    InputError
        An epoch does not have one of them, or they are fewer than three.
    NotComputableError
        They lie on one line.
    """
    names = list(dict.fromkeys(stable))
    for number, block in enumerate(alone, start=1):
        missing = [name for name in names if name not in set(block.problem.points)]
        why = {part.name: part.reason for part in block.problem.left_out if part.kind == "point"}
        missing = [f"{name} (it {why[name]})" if name in why else name for name in missing]
        if missing:
            raise InputError(f"stable points that epoch {number} does not have: {listed(missing)}")
    if len(names) < 3:
        raise InputError(f"{len(names)} stable points do not hold a datum: at least 3")
    if nearly_in_line(alone[0], names):
        raise NotComputableError(
            f"the stable points {listed(names)} lie on one line: the rotation about it is open"
        )
