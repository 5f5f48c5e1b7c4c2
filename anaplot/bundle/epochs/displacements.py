"""Two epochs of an object: adjusted jointly or apart, and how far every point has moved.

Gruen 1978, section D3, eq. (54): the control (or points that are declared stable) and the
additional parameters may be common to both periods, every other point has coordinates of its own
in each. Of control that is given in some coordinates only those are common.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from anaplot.adjustment.tested import sigma0_known
from anaplot.aliases import Array, Bools, Progress
from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.epochs.joint import adjust_jointly, joint_differences, progress_of
from anaplot.bundle.solve.additional import AdditionalParameters
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.crosscofactors import coordinate_cofactors
from anaplot.bundle.solve.datum import on_control
from anaplot.bundle.solve.namedpoints import point_numbers, point_places
from anaplot.bundle.solve.problem import Datum, listed
from anaplot.errors import AnaplotError, InputError, NotComputableError
from anaplot.photogrammetry.block import Block, ControlPoint
from anaplot.photogrammetry.similarity import fit_similarity, similarity_effects

__all__ = ["MOST_POINTS", "Agreement", "EpochDifferences", "compare_epochs"]


MOST_POINTS = 1000
"""Points that are compared at once: their covariance matrix is dense."""

_AXES = "XYZ"
_APART = 5.0  # standard deviations by which control of one datum never differs
_FLAT = 1e-3  # of the extent: stable points closer to one line than this do not hold a rotation


@dataclass(frozen=True, slots=True, eq=False)
class Agreement:
    """How well points that are taken as stable agree between the epochs.

    Attributes
    ----------
    square, dimension
        Quadratic form R for the a-priori sigma0 and its degrees of freedom, 3 s - 7.
    d, information
        (3 s,) differences [m] of the s points laid onto each other, second minus first epoch, and
        the pseudo-inverse [1/m^2] of their cofactors; both from separate adjustments.
    """

    square: float
    dimension: int
    d: Array = field(repr=False)
    information: Array = field(repr=False)


@dataclass(frozen=True, slots=True, eq=False)
class EpochDifferences:
    """Displacements between two epochs.

    Attributes
    ----------
    epochs
        Names of the two blocks.
    joint
        Whether both were adjusted in one.
    datum
        "control", or "stable": the points named in `common` hold it.
    common
        Points that have the same coordinates in both epochs.
    partly
        (name, axes) of control that has only some common coordinates; the others are compared.
    own_parameters
        Whether each epoch had additional parameters of its own; None without any.
    points
        Names of the compared points.
    places
        (m, 3) their coordinates in the first epoch [m].
    given
        (m, 3) whether control gives the coordinate in both epochs: its difference is no movement.
    d
        (3 m,) second minus first epoch [m]: X, Y, Z of one point after the other.
    cofactors
        (3 m, 3 m) its covariance matrix [m^2] for the a-priori sigma0.
    flagged
        Observations that each epoch by itself flags.
    vtpv, redundancy
        Of the joint adjustment, or the sums of both.
    alone
        (vtpv, redundancy) of each epoch by itself; of the joint way without additional parameters.
    by_known
        Whether tests go by the a-priori sigma0 (test "baarda").
    power
        That of the first epoch's [test].
    agreement
        Of the points that hold the datum when they are declared stable, or None.
    only_first, only_second
        Names of points of one epoch alone.
    remarks
        Sentences for a person.
    """

    epochs: tuple[str, str]
    joint: bool
    datum: str
    common: tuple[str, ...]
    partly: tuple[tuple[str, str], ...]
    own_parameters: bool | None
    points: tuple[str, ...]
    places: Array = field(repr=False)
    given: Bools = field(repr=False)
    d: Array = field(repr=False)
    cofactors: Array = field(repr=False)
    flagged: tuple[int, int]
    vtpv: float
    redundancy: int
    alone: tuple[tuple[float, int], tuple[float, int]]
    by_known: bool
    power: float
    agreement: Agreement | None
    only_first: tuple[str, ...] = field(repr=False)
    only_second: tuple[str, ...] = field(repr=False)
    remarks: tuple[str, ...]


def compare_epochs(
    first: Block,
    second: Block,
    *,
    separate: bool = False,
    additional: AdditionalParameters | None = None,
    common_parameters: bool | None = None,
    stable: Sequence[str] = (),
    points: Sequence[str] = (),
    progress: Progress | None = None,
) -> EpochDifferences:
    """Adjust two epochs and compute the displacements with their covariance matrix.

    Parameters
    ----------
    first, second
        The blocks.
    separate
        Two adjustments, whose points are uncorrelated, in place of a joint one.
    additional
        Additional parameters.
    common_parameters
        Whether both epochs have the same ones; None: where their scope allows (block, camera) and
        the adjustment is a joint one.
    stable
        Points that hold the datum in place of control; at least three.
    points
        Names of the points to compare; empty: all common ones.
    progress
        Called with what is being done and the fraction of it.

    Raises
    ------
    InputError
        The epochs cannot be compared as asked: no common points, control that differs, names that
        are not there.
    NotComputableError
        An epoch, or both together, are not determined.

    Notes
    -----
    With stable points and separate adjustments both epochs are free networks; the second is laid
    onto the first by a similarity over the stable points, and the covariance matrix goes the same
    way (S-transformation).

    A control point of which only some coordinates are given in both epochs is a point in each:
    what is given is common (jointly, a weighted coordinate is one observation of one unknown), what
    is not is tested. Separate adjustments observe the given coordinate once in each.
    """
    # conditions between points and priors of points are no part of it
    first, second = (replace(one, conditions=(), priors=()) for one in (first, second))
    if first.test.kind != second.test.kind:
        raise InputError(
            f"the epochs are tested differently ({first.test.kind}, {second.test.kind}): [test] "
            "kind must be the same"
        )
    common = _shares(additional, separate, common_parameters)
    datum: Datum = "free" if stable else "control"
    remarks: list[str] = []
    if not stable:
        _check_control(first, second, separate)
    before = additional if separate else None
    alone = tuple(
        _alone(block, number, datum, before, progress)
        for number, block in enumerate((first, second), start=1)
    )
    one, two = alone
    partly: dict[str, tuple[int, ...]] = {}
    if stable:
        _check_stable(one, two, stable)
        held: tuple[str, ...] = tuple(dict.fromkeys(stable))
    else:
        held, partly = _common_control(first, second)
        if not held and not partly:
            remarks.append(
                "no control point is common to both epochs: that their control is of one system "
                "is not checked"
            )
    chosen, only = _chosen(one, two, held, points)
    if separate:
        found = _separately(one, two, chosen, held, datum)
        if not stable and _weighted(first, second):
            remarks.append(
                "control counts as determined anew in each epoch; if it is the same survey, the "
                "joint adjustment is the rigorous one"
            )
    else:
        found, warnings = _together(
            one, two, chosen, held, partly, datum, additional, common=common, progress=progress
        )
        # what the block lacks, the epochs by themselves say
        remarks += [f"jointly: {warning}" for warning in warnings]
    if _measured(first) == _measured(second):
        remarks.append("both epochs have the same image measurements: they are not two epochs")
    without = additional is not None and before is None
    for number, adjusted in enumerate(alone, start=1):
        remarks += [f"epoch {number}: {remark}" for remark in adjusted.remarks]
        remarks += [f"epoch {number}: {doubt}" for doubt in _doubts(adjusted, without)]
    if stable and not on_control(one.problem, one.state):
        some = bool(np.isfinite(one.problem.known).any())
        why = "control does not hold" if some else "no control in"
        remarks.append(f"{why} the first epoch: lengths are in the units of its free network")
    return EpochDifferences(
        epochs=(first.name, second.name),
        joint=not separate,
        datum="stable" if stable else "control",
        common=held,
        partly=tuple((n, "".join(_AXES[k] for k in axes)) for n, axes in partly.items()),
        own_parameters=None if additional is None else not common,
        points=chosen,
        places=found.places,
        given=np.array([[axis in partly.get(n, ()) for axis in range(3)] for n in chosen]),
        d=found.d,
        cofactors=found.cofactors,
        flagged=(len(one.flagged_observations()), len(two.flagged_observations())),
        vtpv=found.vtpv,
        redundancy=found.redundancy,
        alone=((one.vtpv, one.redundancy), (two.vtpv, two.redundancy)),
        by_known=sigma0_known(first.test.kind),
        power=first.test.power,
        agreement=found.agreement,
        only_first=only[0],
        only_second=only[1],
        remarks=tuple(dict.fromkeys(remarks)),
    )


class _Compared(NamedTuple):
    """Displacements of one way of adjusting; as in `EpochDifferences`."""

    places: Array
    d: Array
    cofactors: Array
    vtpv: float
    redundancy: int
    agreement: Agreement | None


def _separately(
    one: AdjustedBlock,
    two: AdjustedBlock,
    chosen: Sequence[str],
    held: Sequence[str],
    datum: Datum,
) -> _Compared:
    """Compare points of two adjustments, free networks laid onto each other by those held."""
    agreement: Agreement | None = None
    if datum == "free":
        places, d, q, agreement = _laid(one, two, chosen, held)
    else:
        places, d, q = _apart(one, two, chosen)
    return _Compared(places, d, q, one.vtpv + two.vtpv, one.redundancy + two.redundancy, agreement)


def _together(
    one: AdjustedBlock,
    two: AdjustedBlock,
    chosen: Sequence[str],
    held: Sequence[str],
    partly: Mapping[str, Sequence[int]],
    datum: Datum,
    additional: AdditionalParameters | None,
    *,
    common: bool,
    progress: Progress | None,
) -> tuple[_Compared, tuple[str, ...]]:
    """Compare points in a joint adjustment; also what it warns of."""
    seen = set(one.problem.points) & set(two.problem.points)
    twice = [name for name in partly if name in seen]
    block = adjust_jointly(
        one, two, held, twice, datum, additional, common=common, progress=progress
    )
    equal = [(name, axis) for name in twice for axis in partly[name]]
    places, d, q, cost = joint_differences(block, chosen, equal)
    vtpv, redundancy = block.vtpv + cost, block.redundancy
    agreement = None
    if datum == "free" and additional is None:
        # what both epochs by themselves need not agree in (Gruen 1978, eq. 32)
        agreement = replace(
            _laid(one, two, (), held)[3],
            square=max(vtpv - one.vtpv - two.vtpv, 0.0),
            dimension=redundancy - one.redundancy - two.redundancy,
        )
    return _Compared(places, d, q, vtpv, redundancy, agreement), block.warnings


_REMEDY = {
    "image": "remeasure it, or remove it from image_points.csv",
    "control": "check it, or remove it from control.csv",
    "prior": "check it, or remove it from block.toml",
    "parameter": "the sigma of the additional parameters is too small for it",
}


def _measured(block: Block) -> list[tuple[str, float, float]]:
    return sorted((row.point, row.x, row.y) for row in block.image_points)


def _doubts(block: AdjustedBlock, without: bool) -> list[str]:
    """Return the remarks on an epoch by itself."""
    by_itself = " (by itself, without additional parameters)" if without else ""
    out = []
    flagged = block.flagged_observations()
    if flagged:
        size, what, kind = flagged[0]
        chance = f"(by chance about {block.flagged_by_chance:.1f})"
        which = f"1 observation flagged {chance}, {what}" if len(flagged) == 1 else (
            f"{len(flagged)} observations flagged {chance}, the largest {what}"
        )  # fmt: skip
        more = "" if len(flagged) == 1 else "; adjust --errors names what else is wrong"
        out.append(f"{which} (w {size:.1f}){by_itself}: {_REMEDY[kind]}{more}")
    return out


def _shares(additional: AdditionalParameters | None, separate: bool, asked: bool | None) -> bool:
    """Whether additional parameters are common to both epochs."""
    possible = not separate and additional is not None and additional.scope in ("block", "camera")
    if asked and additional is None:
        raise InputError("common parameters: no additional parameters are asked for")
    if asked and separate:
        raise InputError("separate adjustments have no common parameters")
    if asked and not possible and additional is not None:
        raise InputError(
            f"additional parameters of every {additional.scope} cannot be common to both epochs: "
            "block or camera can"
        )
    return possible if asked is None else asked


def _alone(
    block: Block,
    number: int,
    datum: Datum,
    additional: AdditionalParameters | None,
    progress: Progress | None,
) -> AdjustedBlock:
    try:
        return adjust_block(
            block,
            datum=datum,
            additional=additional,
            progress=progress_of(f"epoch {number}", progress),
        )
    except AnaplotError as error:
        hint = ""
        bare = not any(row.use == "control" for row in block.control)
        if isinstance(error, NotComputableError) and datum == "control" and bare:
            hint = " (points that have not moved can hold the datum: --stable)"
        # a search without end carries more than its message
        kind = NotComputableError if isinstance(error, NotComputableError) else type(error)
        raise kind(f"epoch {number}: {error}{hint}") from error


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


def _check_control(first: Block, second: Block, separate: bool) -> None:
    """Refuse control that is not of one datum; joint control must be the same."""
    for one, two in _control_pairs(first, second):
        sigmas = zip(_sigmas(first, one), _sigmas(second, two), strict=True)
        for axis, (a, b, (s, t)) in enumerate(zip(one.xyz, two.xyz, sigmas, strict=True)):
            name = f"control point {one.point}"
            if not separate and (a != b or s != t):
                raise InputError(
                    f"{name}: {_AXES[axis]} is {_stated(a, s)} in the first epoch and "
                    f"{_stated(b, t)} in the second: a joint adjustment needs the same "
                    "(--separate does not)"
                )
            if a is None or b is None or s is None or t is None:
                continue
            if abs(a - b) > _APART * float(np.hypot(s, t)):
                raise InputError(
                    f"{name}: {_AXES[axis]} differs by {b - a:g} m between the epochs, more than "
                    f"its sigmas {s:g} and {t:g} m allow: the epochs are not in one datum "
                    "(points that have not moved can hold it: --stable)"
                )


def _weighted(first: Block, second: Block) -> bool:
    """Whether a coordinate that control gives in both epochs has a standard deviation."""
    return any(
        s is not None and t is not None and max(s, t) > 0.0
        for one, two in _control_pairs(first, second)
        for s, t in zip(_sigmas(first, one), _sigmas(second, two), strict=True)
    )


def _stated(value: float | None, sigma: float | None) -> str:
    return "not known" if value is None else f"{value:.10g} (sigma {sigma:g})"


def _common_control(
    first: Block, second: Block
) -> tuple[tuple[str, ...], dict[str, tuple[int, ...]]]:
    """Names of control that is common in all coordinates, and common axes of that in some."""
    whole: list[str] = []
    partly: dict[str, tuple[int, ...]] = {}
    for one, two in _control_pairs(first, second):
        axes = tuple(k for k in range(3) if one.xyz[k] is not None and two.xyz[k] is not None)
        if len(axes) == 3:
            whole.append(one.point)
        elif axes:
            partly[one.point] = axes
    return tuple(whole), partly


def _check_stable(one: AdjustedBlock, two: AdjustedBlock, stable: Sequence[str]) -> None:
    names = list(dict.fromkeys(stable))
    for number, block in enumerate((one, two), start=1):
        missing = [name for name in names if name not in set(block.problem.points)]
        if missing:
            raise InputError(f"stable points that epoch {number} does not have: {listed(missing)}")
    if len(names) < 3:
        raise InputError(f"{len(names)} stable points do not hold a datum: at least 3")
    at = point_places(one, names, one.state.origin)
    spread = np.linalg.svd(at - at.mean(axis=0), compute_uv=False)
    if not spread[1] > _FLAT * spread[0]:
        raise NotComputableError(
            f"the stable points {listed(names)} lie on one line: the rotation about it is open"
        )


def _chosen(
    one: AdjustedBlock, two: AdjustedBlock, held: Collection[str], asked: Sequence[str]
) -> tuple[tuple[str, ...], tuple[tuple[str, ...], tuple[str, ...]]]:
    """Names to compare, and those of one epoch only, in the order of the files."""
    names = [[row.point for row in block.problem.block.image_points] for block in (one, two)]
    there = [set(block.problem.points) for block in (one, two)]
    order = [list(dict.fromkeys(n for n in mine if n in have))
             for mine, have in zip(names, there, strict=True)]  # fmt: skip
    only = (
        tuple(n for n in order[0] if n not in there[1]),
        tuple(n for n in order[1] if n not in there[0]),
    )
    both = [n for n in order[0] if n in there[1]]
    if not both:
        raise InputError("the two epochs have no point in common")
    taken = set(held)
    free = [n for n in both if n not in taken]
    if asked:
        for name in dict.fromkeys(asked):
            if name in taken:
                raise InputError(f"point {name} holds the datum: it cannot be compared")
            if name not in both:
                raise InputError(f"point {name} is not in both epochs")
        free = [n for n in free if n in set(asked)]
    if not free:
        raise InputError(
            "nothing to compare: every point that is common to both epochs holds the datum "
            f"({listed(both)})"
        )
    if len(free) > MOST_POINTS:
        raise InputError(
            f"{len(free)} common points; {MOST_POINTS} can be compared at once: choose (--points)"
        )
    return tuple(free), only


def _cofactors(block: AdjustedBlock, names: Sequence[str]) -> Array:
    return coordinate_cofactors(
        block, [(k, axis) for k in point_numbers(block, names) for axis in (0, 1, 2)]
    )


def _apart(
    one: AdjustedBlock, two: AdjustedBlock, names: Sequence[str]
) -> tuple[Array, Array, Array]:
    origin = one.state.origin
    d = point_places(two, names, origin) - point_places(one, names, origin)
    return point_places(one, names), d.reshape(-1), _cofactors(one, names) + _cofactors(two, names)


def _laid(
    one: AdjustedBlock, two: AdjustedBlock, names: Sequence[str], stable: Sequence[str]
) -> tuple[Array, Array, Array, Agreement]:
    """Displacements after an S-transformation onto the stable points."""
    every = [*names, *stable]
    m, s = len(names), len(stable)
    origin = one.state.origin
    at, other = point_places(one, every, origin), point_places(two, every, origin)
    fitted = fit_similarity(other[m:], at[m:])
    d = (fitted.apply(other) - at).reshape(-1)
    turn = fitted.scale * fitted.rotation
    q = _cofactors(two, every).reshape(m + s, 3, m + s, 3)
    q = np.einsum("ij,ajbk,lk->aibl", turn, q, turn).reshape(3 * (m + s), -1)
    q = q + _cofactors(one, every)
    arm = at - at[m:].mean(axis=0)
    null = similarity_effects(arm).reshape(-1, 7)
    # turns and scale in metres at the farthest point, like the shifts
    null[:, 3:] /= float(np.abs(arm).max()) or 1.0
    held = null.copy()
    held[: 3 * m] = 0.0
    change = np.eye(len(d)) - null @ np.linalg.solve(held.T @ null, held.T)
    q = change @ q @ change.T
    q = 0.5 * (q + q.T)
    first = 3 * m
    values, vectors = np.linalg.eigh(q[first:, first:])
    rank = 3 * s - 7
    values, vectors = values[-rank:], vectors[:, -rank:]
    part = vectors.T @ d[first:]
    square = float(np.sum(part * part / values))
    information = (vectors / values) @ vectors.T
    agreement = Agreement(square, rank, d[first:], information)
    return at[:m] + origin, d[:first], q[:first, :first], agreement
