"""Is the control in agreement with the photographs, weighted or free of error (Gruen 1978, D2).

The hypothesis "these given coordinates are right" is tested against "they are off by d". Giving
them up means one more unknown per coordinate; with C the change of the whitened misclosures e for
d, R the projector on the residuals (e = R e at the minimum), the linear model gives

    g = C'e,    M = C'R C = C'C - (J'C)'N^-1 (J'C),    d = -M^-1 g,    R = g'M^-1 g,

without another adjustment. M^-1 is the covariance of d for sigma0 = 1: that of the given
coordinates and that of the photogrammetric ones without them, together. A weighted coordinate has
-1/sigma in its own row; one free of error has the derivatives of its rays, and those D of the
conditions between points that name it. With G and M_c of the conditions (see
`anaplot.bundle.solve.conditionupdate`) and C of the other rows, they add D'M_c^-1 D - X - X' to M,
X = (J'C)'G M_c^-1 D: finite for conditions free of error, too. The residuals of the test's own
variance factor are those that remain when the coordinates are given up.

A free or minimal datum uses no control. There the given coordinates are tested against the network
up to a similarity, or to shift and rotation where distances give it its scale: with C the
covariances of both together and G what a change of datum does to the coordinates,
M = C^-1 - C^-1 G (G'C^-1 G)^-1 G'C^-1 and g = -M (adjusted - given).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import sqrt
from typing import Literal, NamedTuple

import numpy as np
from scipy.sparse import csr_array

from anaplot.adjustment.hypothesis import bonferroni_alpha
from anaplot.adjustment.significance import TESTABLE
from anaplot.aliases import Array, Bools, Index
from anaplot.bundle.hypotheses.givenparts import PartTest, parts_of
from anaplot.bundle.hypotheses.verdict import USUAL, HypothesisSettings, VarianceFactor, Verdict
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.crosscofactors import coordinate_cofactors
from anaplot.bundle.solve.imaging import imaged_with_derivatives
from anaplot.bundle.solve.innerproducts import inner_products
from anaplot.bundle.solve.problem import Problem
from anaplot.photogrammetry.similarity import (
    Similarity,
    fit_to_partial,
    similarity_effects,
    without_scale,
)

__all__ = [
    "ControlCoordinateTest",
    "ControlGroupTest",
    "ControlPointTest",
    "ControlTests",
    "control_tests",
]


_MOST = 1500  # control coordinates that are tested together
_WEAK = 1e-6  # eigenvalue, over the largest, below which linearisation does not reach
_NULL = 1e-11  # the same of what holds the datum only
_ROUNDING = 30.0  # times as far above zero as another lies below it may rounding leave one of these


class ControlGroupTest(NamedTuple):
    """Control coordinates given up together.

    Attributes
    ----------
    what
        "all", "plan" or "heights"; "weighted" or "free of error" where both kinds occur.
    coordinates
        Their number.
    conditions
        How many independent conditions they put beyond holding the datum.
    verdict
        None when they only hold the datum.
    """

    what: str
    coordinates: int
    conditions: int
    verdict: Verdict | None


class ControlPointTest(NamedTuple):
    """The coordinates of one control point given up together.

    Attributes
    ----------
    point
        Its name.
    coordinates, conditions
        As in `ControlGroupTest`.
    verdict
        The family of points keeps the significance; None when nothing checks the point.
    """

    point: str
    coordinates: int
    conditions: int
    verdict: Verdict | None


class ControlCoordinateTest(NamedTuple):
    """One control coordinate given up.

    Attributes
    ----------
    point, axis
        Which one.
    fixed
        Whether it is free of error.
    difference
        Photogrammetric coordinate without it, minus the given one [m]; None where nothing checks
        it.
    s
        Standard deviation of the difference [m] for the a-priori sigma0, of both.
    verdict
        The family of coordinates keeps the significance.
    mdb
        Smallest error of the given coordinate [m] that is found with the settings' power; None
        where no test can be made.
    """

    point: str
    axis: str
    fixed: bool
    difference: float | None
    s: float | None
    verdict: Verdict | None
    mdb: float | None


@dataclass(frozen=True, slots=True)
class ControlTests:
    """The hypotheses about control.

    Attributes
    ----------
    against
        "photographs": control that holds the datum; "network": control and check points against a
        network with a datum of its own.
    scaled
        Whether that network has its scale from distances, which are tested against the given
        coordinates, too.
    groups
        All control, plan and heights; empty when it is too much to be tested together.
    points, coordinates
        Every point and every coordinate.
    remarks
        Sentences for a person.
    parts
        Plan and height of every point.
    """

    against: Literal["photographs", "network"]
    scaled: bool
    groups: tuple[ControlGroupTest, ...]
    points: tuple[ControlPointTest, ...]
    coordinates: tuple[ControlCoordinateTest, ...]
    remarks: tuple[str, ...]
    parts: tuple[PartTest, ...] = ()


class _Control(NamedTuple):
    """Control coordinates: where they are, g, M and the diagonal of C'C.

    `apart`: the residuals of the adjustment have no part in g; `scaled`: distances give the scale.
    """

    at: list[tuple[int, int]]
    fixed: Bools
    score: Array
    information: Array
    size: Array
    apart: bool = False
    scaled: bool = False


def control_tests(
    block: AdjustedBlock, settings: HypothesisSettings = USUAL
) -> ControlTests | None:
    """Test the given coordinates of control points; None when there are none.

    With datum "control" those that hold it, otherwise all of control and check points, as far as
    they say more than a change of datum. Single tests are Bonferroni's, for each leaves a variance
    factor of its own.
    """
    problem = block.problem
    if problem.datum != "control":
        return _network_tests(block, settings)
    names = {name: k for k, name in enumerate(problem.points)}
    # an earlier adjustment may hold other coordinates free of error, of check points, too
    places = [
        (names[name], axis)
        for name, row in problem.control_rows.items()
        if name in names and row.use == "control"
        for axis, value in enumerate(row.xyz)
        if value is not None
    ]
    if not places:
        return None
    together = len(places) <= _MOST
    remarks = []
    if not together:
        remarks.append(
            f"{len(places)} control coordinates are tested one by one, not all together "
            f"(that is done up to {_MOST})"
        )
    control = _control(block, places, together=together)
    if control.fixed.all():
        remarks.append(
            "the control is free of error: its differences are what the photographs would "
            "make of a coordinate that is given up"
        )
    return _tests(block, control, settings, remarks, groups=together)


def _network_tests(block: AdjustedBlock, settings: HypothesisSettings) -> ControlTests | None:
    problem = block.problem
    names = {name: k for k, name in enumerate(problem.points)}
    wanted = [
        (names[name], axis, value, problem.block.sigma_of(row)[axis])
        for name, row in problem.control_rows.items()
        if name in names
        for axis, value in enumerate(row.xyz)
        if value is not None
    ]
    if not wanted:
        return None
    if len(wanted) > _MOST:
        remark = f"{len(wanted)} given coordinates are not tested (that is done up to {_MOST})"
        return ControlTests("network", False, (), (), (), (remark,))
    places = [(point, axis) for point, axis, _, _ in wanted]
    given = np.array([value for _, _, value, _ in wanted])
    spread = np.array([sigma for *_, sigma in wanted])
    index = np.array(places)
    used, row = np.unique(index[:, 0], return_inverse=True)
    pick = 3 * row + index[:, 1]
    target = np.full((len(used), 3), np.nan)
    target[row, index[:, 1]] = given
    # laid onto the given coordinates first: what is left is small, and linear in the similarity
    origin = block.state.origin
    source = block.state.points[used]
    start = Similarity(1.0, np.eye(3), np.zeros(3))
    change = block.cofactors.change
    scaled = change is not None and change.gives_scale
    laid = fit_to_partial(source, target - origin, start, some=scaled) or start
    if scaled:
        laid = without_scale(laid, source)
    at = laid.apply(source)
    difference = at.reshape(-1)[pick] - (target - origin).reshape(-1)[pick]
    turn = np.kron(np.eye(len(used)), laid.scale * laid.rotation)
    own = coordinate_cofactors(block, [(int(k), axis) for k in used for axis in range(3)])
    covariance = (turn @ own @ turn.T)[np.ix_(pick, pick)] + np.diag(spread**2)
    null = similarity_effects(at).reshape(-1, 7)[pick, : 6 if scaled else 7]
    root = np.linalg.cholesky(covariance)
    whitened = np.linalg.solve(root, null / np.linalg.norm(null, axis=0).clip(min=1e-300))
    left, singular, _ = np.linalg.svd(whitened, full_matrices=False)
    left = left[:, singular > 1e-9 * singular[0]]
    inverse = np.linalg.inv(root)
    reduced = inverse - left @ (left.T @ inverse)
    information = reduced.T @ reduced
    control = _Control(
        places,
        spread == 0.0,
        -(information @ difference),
        information,
        np.einsum("ij,ij->j", inverse, inverse),
        apart=True,
        scaled=scaled,
    )
    return _tests(block, control, settings, [])


def _tests(
    block: AdjustedBlock,
    control: _Control,
    settings: HypothesisSettings,
    remarks: list[str],
    *,
    groups: bool = True,
) -> ControlTests:
    variance = VarianceFactor.of(block)
    coordinates = _coordinates(block, control, variance, settings)
    unchecked = [f"{c.axis} of {c.point}" for c in coordinates if c.verdict is None]
    if unchecked:
        some = ", ".join(unchecked[:12]) + (" ..." if len(unchecked) > 12 else "")
        remarks.append(
            f"{_are(len(unchecked), 'control coordinate')} checked by nothing, an error there "
            f"stays unseen: {some}"
        )
    tested: tuple[ControlGroupTest, ...] = ()
    if groups:
        together = _given_up(control, list(range(len(control.at))))
        if together.weak:
            remarks.append(
                f"{_are(together.weak, 'condition')} not tested together with the others: without "
                "control the photographs hardly tell"
            )
        tested = _groups(control, together, variance, settings)
    return ControlTests(
        "network" if control.apart else "photographs",
        control.scaled,
        tested,
        _points(block, control, variance, settings),
        coordinates,
        tuple(remarks),
        _parts(block, control, variance, settings),
    )


def _control(block: AdjustedBlock, places: list[tuple[int, int]], *, together: bool) -> _Control:
    """Return score and information of control coordinates; blocks of points only, if not all."""
    problem = block.problem
    linear = block.cofactors.normal.linear
    fixed = np.array([bool(problem.fixed[point, axis]) for point, axis in places])
    rays_of = _rays_of(problem, [point for point, _ in places])
    b = _derivatives(block) if fixed.any() else linear.b
    score = np.empty(len(places))
    own = np.zeros((len(places), len(places)))
    by_point: dict[int, list[int]] = {}
    for k, (point, axis) in enumerate(places):
        by_point.setdefault(point, []).append(k)
        if fixed[k]:
            rays = rays_of[point]
            score[k] = float(np.vdot(b[rays, :, axis], linear.e[rays]))
        else:
            sigma = float(problem.known_sigma[point, axis])
            score[k] = -float(linear.point_e[0, point, axis]) / sigma
            own[k, k] = sigma**-2.0
    for point, members in by_point.items():
        held = [k for k in members if fixed[k]]
        if not held:
            continue
        axes = [places[k][1] for k in held]
        column = b[rays_of[point]][:, :, axes].reshape(-1, len(axes))
        own[np.ix_(held, held)] = column.T @ column
    size = np.diag(own).copy()

    sides = _sides(block, places, fixed, b)
    information = own
    if together:
        information = own - _products(block, sides)
    else:
        for point, members in by_point.items():
            index = np.ix_(members, members)
            if fixed[members].any():
                taken = _products(block, csr_array(sides[:, members]))
            else:
                axes = [places[k][1] for k in members]
                weight = size[members]
                taken = block.cofactors.points[point][np.ix_(axes, axes)]
                taken = taken * weight[:, None] * weight
            information[index] -= taken
    tied = _tied(block, places, fixed, sides)
    if tied is not None:
        score += tied.score
        information += tied.information
        size += tied.size
    return _Control(places, fixed, score, information, size)


def _rays_of(problem: Problem, points: Iterable[int]) -> dict[int, Index]:
    """Return the rays of some points."""
    order = np.argsort(problem.point, kind="stable")
    ends = np.searchsorted(problem.point[order], np.arange(len(problem.points) + 1))
    return {k: order[ends[k] : ends[k + 1]] for k in points}


def _products(block: AdjustedBlock, sides: csr_array) -> Array:
    return inner_products(block.cofactors.normal, block.cofactors.factor, sides)


def _sides(
    block: AdjustedBlock, places: list[tuple[int, int]], fixed: Bools, b: Array
) -> csr_array:
    """Return (n d + 3 p + g, k) J'C of control coordinates, without conditions.

    Of one free of error what its rays say, with the derivatives `b` of `_derivatives`.
    """
    problem, normal = block.problem, block.cofactors.normal
    linear, d = normal.linear, problem.per_photo
    first = len(problem.photos) * d
    last = first + 3 * len(problem.points)
    point, axis = np.array(places, dtype=np.intp).reshape(-1, 2).T
    weighted = np.flatnonzero(~fixed)
    known = problem.known_sigma[point[weighted], axis[weighted]]
    found = [(first + 3 * point[weighted] + axis[weighted], weighted, -(known**-2.0))]
    rays_of = _rays_of(problem, point.tolist())
    for k in np.flatnonzero(fixed).tolist():
        rays = rays_of[point[k]]
        change = b[rays, :, axis[k]]
        parts = [
            (problem.photo[rays, None] * d + np.arange(d), linear.a),
            (first + 3 * problem.point[rays, None] + np.arange(3), linear.b),
        ]
        if problem.in_border:
            parts.append((last + normal.border_columns(problem.additional_group[rays]), linear.h))
        for rows, of in parts:
            values = np.einsum("rij,ri->rj", of[rays], change).ravel()
            found.append((rows.ravel(), np.full(len(values), k), values))
    rows, columns, values = (np.concatenate(part) for part in zip(*found, strict=True))
    return csr_array((values, (rows, columns)), shape=(last + problem.in_border, len(places)))


class _Tied(NamedTuple):
    """What conditions between points add to g, to M, and to the terms that M is made of."""

    score: Array
    information: Array
    size: Array


def _tied(
    block: AdjustedBlock,
    places: list[tuple[int, int]],
    fixed: Bools,
    sides: csr_array,
) -> _Tied | None:
    """Return the part of conditions that name control free of error; None without any.

    `sides` are J'C of the other rows.
    """
    conditions = block.problem.conditions
    normal, factor = block.cofactors.normal, block.cofactors.factor
    update = normal.update(factor)
    if conditions is None or update is None:
        return None
    # as if no coordinate were free of error
    equations = conditions.equations(block.state.points, np.zeros_like(block.problem.fixed))
    columns = [3 * point + axis for point, axis in places]
    d: Array = equations.whitened[:, columns].toarray() * fixed
    mine = np.flatnonzero(d.any(axis=0))
    if not len(mine):
        return None
    weighted = update.inner @ d
    own = d.T @ weighted
    gained = [(part @ weighted[:, mine]).reshape(-1, len(mine)) for part in update.gain]
    beside = np.zeros_like(own)
    beside[:, mine] = sides.T @ np.concatenate(gained)
    left = equations.contrasts.T @ normal.conditions_left(factor)
    return _Tied(d.T @ left, own - beside - beside.T, np.diag(own).copy())


def _derivatives(block: AdjustedBlock) -> Array:
    """Return (m, 2, 3) whitened derivatives by the points, also by coordinates free of error."""
    problem = block.problem
    b = block.cofactors.normal.linear.b.copy()
    mine = np.nonzero(np.any(problem.fixed, axis=1)[problem.point])[0]
    seen = imaged_with_derivatives(problem, block.state, mine)
    b[mine] = seen.point / problem.sigma_xy[mine][:, :, None]
    if problem.rejected is not None:
        b[problem.rejected] = 0.0
    return b


class _GivenUp(NamedTuple):
    """R, its conditions, and those left out because the photographs hardly determine them."""

    square: float
    conditions: int
    weak: int


def _given_up(control: _Control, members: list[int]) -> _GivenUp:
    """Give coordinates up together."""
    free = [k for k in members if control.information[k, k] > TESTABLE * control.size[k]]
    if not free:
        return _GivenUp(0.0, 0, 0)
    scale = np.sqrt(control.information[free, free])
    if len(free) == 1:  # two thirds of all that is asked for
        return _GivenUp(float((control.score[free[0]] / scale[0]) ** 2), 1, 0)
    rho = control.information[np.ix_(free, free)] / scale[:, None] / scale
    values, vectors = np.linalg.eigh(0.5 * (rho + rho.T))
    good = values > _WEAK * float(values[-1])
    null = max(_NULL * float(values[-1]), -_ROUNDING * float(values[0]))
    weak = ~good & (values > null)
    part = (control.score[free] / scale) @ vectors[:, good]
    return _GivenUp(float((part * part / values[good]).sum()), int(good.sum()), int(weak.sum()))


def _are(count: int, what: str) -> str:
    return f"1 {what} is" if count == 1 else f"{count} {what}s are"


def _verdict(
    control: _Control, given_up: _GivenUp, variance: VarianceFactor, alpha: float
) -> Verdict | None:
    """Judge coordinates that are given up together; None where they are under no condition."""
    square, conditions, _ = given_up
    if conditions == 0:
        return None
    own = variance if control.apart else variance.without(square, conditions)
    return own.test(square, conditions, alpha)


def _groups(
    control: _Control, together: _GivenUp, variance: VarianceFactor, settings: HypothesisSettings
) -> tuple[ControlGroupTest, ...]:
    """Test all coordinates, given up by `together`, and those of a kind."""
    every = list(range(len(control.at)))
    plan = [k for k in every if control.at[k][1] < 2]
    heights = [k for k in every if control.at[k][1] == 2]
    fixed = [k for k in every if control.fixed[k]]
    weighted = [k for k in every if not control.fixed[k]]
    sets = []
    if plan and heights:
        sets += [("plan", plan), ("heights", heights)]
    if fixed and weighted:
        sets += [("weighted", weighted), ("free of error", fixed)]
    found = [("all", len(every), together)]
    found += [(what, len(members), _given_up(control, members)) for what, members in sets]
    return tuple(
        ControlGroupTest(
            what,
            count,
            given_up.conditions,
            _verdict(control, given_up, variance, settings.alpha),
        )
        for what, count, given_up in found
    )


def _points(
    block: AdjustedBlock, control: _Control, variance: VarianceFactor, settings: HypothesisSettings
) -> tuple[ControlPointTest, ...]:
    by_point: dict[int, list[int]] = {}
    for k, (point, _) in enumerate(control.at):
        by_point.setdefault(point, []).append(k)
    alpha = bonferroni_alpha(settings.alpha, len(by_point))
    out = []
    for point, members in by_point.items():
        given_up = _given_up(control, members)
        verdict = _verdict(control, given_up, variance, alpha)
        name = block.problem.points[point]
        out.append(ControlPointTest(name, len(members), given_up.conditions, verdict))
    return tuple(out)


def _parts(
    block: AdjustedBlock, control: _Control, variance: VarianceFactor, settings: HypothesisSettings
) -> tuple[PartTest, ...]:
    parts = parts_of((block.problem.points[point], "XYZ"[axis]) for point, axis in control.at)
    alpha = bonferroni_alpha(settings.alpha, len(parts))
    out = []
    for (name, part), members in parts.items():
        given_up = _given_up(control, members)
        difference = s = largest = None
        if given_up.conditions == len(members):
            inverse = np.linalg.inv(control.information[np.ix_(members, members)])
            d = -inverse @ control.score[members]
            difference = float(d[0]) if part == "height" else float(np.linalg.norm(d))
            s = sqrt(float(np.trace(inverse)))
            largest = sqrt(float(np.linalg.eigvalsh(inverse)[-1]))
        verdict = _verdict(control, given_up, variance, alpha)
        out.append(PartTest(name, part, len(members), difference, s, verdict, largest))
    return tuple(out)


def _coordinates(
    block: AdjustedBlock, control: _Control, variance: VarianceFactor, settings: HypothesisSettings
) -> tuple[ControlCoordinateTest, ...]:
    alpha = bonferroni_alpha(settings.alpha, len(control.at))
    # the tested coordinate takes its own condition from the variance factor
    own = variance if control.apart else variance.without(0.0, 1)
    possible = own.by_known or own.redundancy > 0
    noncentrality = own.detectable(alpha, settings.power)
    out = []
    for k, (point, axis) in enumerate(control.at):
        verdict = _verdict(control, _given_up(control, [k]), variance, alpha)
        information = float(control.information[k, k])
        out.append(
            ControlCoordinateTest(
                block.problem.points[point],
                "XYZ"[axis],
                bool(control.fixed[k]),
                None if verdict is None else -float(control.score[k]) / information,
                None if verdict is None else sqrt(1.0 / information),
                verdict,
                sqrt(noncentrality / information) if possible and verdict is not None else None,
            )
        )
    return tuple(out)
