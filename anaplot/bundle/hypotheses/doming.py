"""What a lens that is not quite known does to heights: it bends them like a dome.

Heights of a block of near-vertical photos and the radial terms of a lens hang together: what the
photos leave open of one they leave open of the other. The bend is the size of the parabola of
revolution in the errors of heights, middle against edge, beside a tilted plane; it is a linear
function of the adjusted heights, and so are its standard deviation, the calibration's part of it,
and the combination of parameters that bends most.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import ceil, sqrt
from typing import Literal, NamedTuple

import numpy as np

from anaplot.adjustment.hypothesis import critical_f
from anaplot.aliases import Array, Index
from anaplot.bundle.errors.leftout import with_rows_of
from anaplot.bundle.solve.additional import AdditionalParameters, physical
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.crosscofactors import coordinate_cofactors
from anaplot.bundle.solve.factor import Factor, NotPositiveError
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.linearised import linearise
from anaplot.bundle.solve.normal import NormalEquations, PointError
from anaplot.bundle.solve.parameternames import parameter_names
from anaplot.bundle.solve.problem import Problem, make_problem
from anaplot.bundle.solve.structure import make_structure

__all__ = [
    "LEAST_HEIGHTS",
    "Bend",
    "Doming",
    "Explained",
    "FreedLens",
    "HeightDifferences",
    "LensSpread",
    "bend_weights",
    "doming",
    "equations_of",
    "lens_spread",
]

_RADIAL = ("c", "k1", "k2", "k3")
_FREED = ("k1", "k2")  # of a lens that is held
_LOOKS_DOWN = 0.7  # cosine: photos that look along heights
LEAST_HEIGHTS = 6  # points, or height differences, of which a bend says something
_FLAT = 1e-3  # singular values of plane and parabola beyond which they are one
_SURE = 3.0  # standard deviations of a bend that are expected
_ALPHA = 0.05
_NEARLY = 0.1  # of what photographs demand: what is left then counts for nothing
_ALIKE = 1.5  # root mean squares of few differences that are the same for all that is known
_MOST = 200  # heights of control or check points that are looked at together; of more a share


class Bend(NamedTuple):
    """A bend of heights [m], middle above edge, and its standard deviation."""

    size: float
    s: float


class Explained(NamedTuple):
    """What of height differences the calibration explains.

    Attributes
    ----------
    left
        Root mean square of what is left of them [m].
    camera, name, change, s
        The parameter of a lens that is held whose change explains them best, what it is, and its
        standard deviation by the differences alone; None where the lens is free: then it is what
        its uncertainty leaves open.
    contradiction, demand, critical
        How much the photographs have against this change, and against what the camera states:
        squares divided by their degrees of freedom, and what they may be; None where the lens is
        free.
    """

    left: float
    camera: str | None = None
    name: str | None = None
    change: float | None = None
    s: float | None = None
    contradiction: float | None = None
    demand: float | None = None
    critical: float | None = None

    @property
    def photographs(self) -> Literal["say the same", "do not contradict", "contradict"] | None:
        """What the photographs say to the change; None where the lens is free."""
        if self.contradiction is None or self.demand is None or self.critical is None:
            return None
        # of a large change the equations, linear here, know most
        if self.demand > self.critical and self.contradiction < _NEARLY * self.demand:
            return "say the same"
        return "do not contradict" if self.contradiction <= self.critical else "contradict"


@dataclass(frozen=True, slots=True)
class HeightDifferences:
    """Adjusted minus given heights of control or of check points.

    Attributes
    ----------
    use
        "control" or "check".
    count
        Their number.
    rms
        Root mean square of the differences [m].
    given
        The same of the standard deviations of what is given.
    calibration
        The same of what one standard deviation of the calibration does to them.
    expected
        The same of the standard deviations of the differences.
    bend
        Their bend; None for fewer than six, or where they lie so that there is none.
    explained
        What of them the calibration explains; None where they are bent no more than is expected
        and the lens is held, and for control that a free lens has been fitted to.
    """

    use: str
    count: int
    rms: float
    given: float
    calibration: float
    expected: float
    bend: Bend | None
    explained: Explained | None

    @property
    def bent(self) -> bool:
        """Whether they are bent more than is expected."""
        return self.bend is not None and abs(self.bend.size) > _SURE * self.bend.s


class FreedLens(NamedTuple):
    """A parameter of a lens that is held, as one more step of the adjustment would free it.

    Attributes
    ----------
    camera, name
        Which one.
    change, s
        What it would change by, and the standard deviation of that.
    """

    camera: str
    name: str
    change: float
    s: float


class LensSpread(NamedTuple):
    """What the uncertainty of lens parameters does to heights.

    Attributes
    ----------
    free
        (k,) numbers of the parameters that are unknown.
    q
        (k, k) their cofactors [mm^2].
    points
        (p, 3, k) cofactors of the points with them.
    bend
        Cofactor of the bend of all points.
    of_lens
        The calibration's part of that.
    """

    free: Index
    q: Array
    points: Array
    bend: float
    of_lens: float


@dataclass(frozen=True, slots=True, eq=False)
class Doming:
    """The verdict on heights.

    Attributes
    ----------
    names
        (camera or group, parameter) of the lens parameters that are free, or were freed for this.
    held
        Whether the lens is held in the adjustment, and was freed for this alone.
    radius
        Of the points about their middle [m].
    bend, calibration
        Standard deviation of the bend of all points [m], and the calibration's part of it.
    worst
        How many standard deviations of each of `names` make that part; their sum of squares is not
        1 where they are correlated.
    freed
        What freeing would change, where the lens is held.
    bent_by
        The bend of all points that freeing changes [m]; None where the lens is free.
    differences
        Of control and check points.
    control_s
        Median standard deviation of control heights [m]; None where all are free of error.
    problem, state
        Bundle with these parameters, and where it was linearised.
    spread
        What their uncertainty does to heights there.
    """

    names: tuple[tuple[str, str], ...]
    held: bool
    radius: float
    bend: float
    calibration: float
    worst: tuple[float, ...]
    freed: tuple[FreedLens, ...]
    bent_by: float | None
    differences: tuple[HeightDifferences, ...]
    control_s: float | None
    problem: Problem = field(repr=False)
    state: BlockState = field(repr=False)
    spread: LensSpread = field(repr=False)


def doming(block: AdjustedBlock) -> Doming | None:
    """Return what the calibration does to heights; None where nothing of that is asked.

    It is where a lens has free radial parameters, or cameras state a lens and control checks it,
    photos look down or up, and heights are known.
    """
    problem, sigma = block.problem, block.sigma
    if problem.datum != "control" or sigma is None or len(problem.points) < LEAST_HEIGHTS:
        return None
    down = np.abs(block.state.rotations[:, 2, 2])
    heights = _heights(problem)
    if float(np.median(down)) < _LOOKS_DOWN or not heights:
        return None
    lens = problem.additional is not None and problem.additional.set.lens
    free = lens and any(row.name in _RADIAL for row in block.parameter_rows())
    held = not free and problem.additional is None and problem.stated_lens is not None
    if problem.photo_invariant or not (free or held):
        return None
    if free:
        equations = block.cofactors.normal, block.cofactors.factor
        return _verdict(block, problem, block.state, equations, sigma, held=False)
    freed = AdditionalParameters(physical.only(_FREED), "camera")
    trial = make_problem(
        problem.block, datum=problem.datum, additional=freed, undetermined=problem.undetermined
    )
    if trial.photos != problem.photos or trial.points != problem.points:
        return None
    state = block.state
    there = BlockState(
        state.centres, state.rotations, state.points, state.own,
        np.zeros(trial.in_border), state.origin,
    )  # fmt: skip
    trial = _as_adjusted(trial, problem)
    try:
        equations = equations_of(trial, there)
    except (NotPositiveError, PointError):
        return None
    return _verdict(block, trial, there, equations, sigma, held=True)


def _as_adjusted(trial: Problem, adjusted: Problem) -> Problem:
    """Return a bundle without what the adjustment rejected, and with its weights."""
    return replace(
        with_rows_of(trial, adjusted),
        sigma=adjusted.sigma,
        axis_factor=adjusted.axis_factor,
        estimated=adjusted.estimated,
        conditions=adjusted.conditions,
    )


def _verdict(
    block: AdjustedBlock,
    problem: Problem,
    state: BlockState,
    equations: tuple[NormalEquations, Factor],
    sigma: float,
    *,
    held: bool,
) -> Doming | None:
    radius, weights = bend_weights(state.points)
    if weights is None:
        return None
    normal, factor = equations
    try:
        spread = lens_spread(problem, normal, factor, weights)
    except np.linalg.LinAlgError:
        return None  # the lens is left open altogether; what is open is told elsewhere
    along = weights @ spread.points[:, 2, :]
    size = np.sqrt(np.diag(spread.q) * max(spread.of_lens, np.finfo(float).tiny))
    names = parameter_names(problem)
    freed: list[FreedLens] = []
    changed = moved = None
    if held:
        _, moved, shared = normal.step(factor)
        changed = shared[spread.free]
        for j, k in enumerate(spread.free.tolist()):
            unit, s = names[k].factor, sigma * sqrt(float(spread.q[j, j]))
            change = float(shared[k]) * unit
            freed.append(FreedLens(names[k].owner, names[k].unknown, change, s * unit))
    given = [s for use, _, _, s in _heights(problem) if use == "control" and s > 0.0]
    return Doming(
        tuple((names[k].owner, names[k].unknown) for k in spread.free.tolist()),
        held,
        radius,
        sigma * sqrt(spread.bend),
        sigma * sqrt(spread.of_lens),
        tuple((along / size).tolist()),
        tuple(freed),
        None if moved is None else float(weights @ moved[:, 2]),
        tuple(_differences(block, problem, spread, changed, sigma)),
        float(np.median(given)) if given else None,
        problem,
        state,
        spread,
    )


def equations_of(problem: Problem, state: BlockState) -> tuple[NormalEquations, Factor]:
    """Return the normal equations of a bundle with its datum, and their factor.

    Raises
    ------
    NotPositiveError, PointError
        Something is left open.
    """
    structure = make_structure(problem, state.centres)
    normal = NormalEquations(problem, structure, linearise(problem, state))
    return normal, normal.factor()


def lens_spread(
    problem: Problem, normal: NormalEquations, factor: Factor, weights: Array
) -> LensSpread:
    """Return what the uncertainty of shared parameters does to the heights of points.

    Parameters
    ----------
    problem
        A bundle in the datum of control.
    normal, factor
        Its normal equations.
    weights
        (p,) of the points' heights in their bend.
    """
    g, still = problem.in_border, problem.additional_still
    free = np.arange(g) if still is None else np.flatnonzero(~still.ravel())
    n, p, count = len(problem.photos), len(problem.points), len(free) + 1
    photos, points = np.zeros((n, problem.per_photo, count)), np.zeros((p, 3, count))
    shared = np.zeros((g, count))
    shared[free, np.arange(len(free))] = 1.0
    points[:, 2, -1] = np.where(problem.fixed[:, 2], 0.0, weights)
    found = normal.solve(factor, photos, points, shared)
    q, of_points = found[2][free][:, :-1], found[1][:, :, :-1]
    bend = float(points[:, 2, -1] @ found[1][:, 2, -1])
    along = weights @ of_points[:, 2, :]
    return LensSpread(free, q, of_points, bend, float(along @ np.linalg.solve(q, along)))


def bend_weights(places: Array) -> tuple[float, Array | None]:
    """Return the radius of (n, 3) places about their middle [m], and (n,) weights of their bend.

    The bend is what they make of heights: the size of the parabola of revolution, middle above
    edge, that fits them together with a plane. None where the places tell no parabola from a
    plane.
    """
    at = places[:, :2] - places[:, :2].mean(axis=0)
    square = np.einsum("ni,ni->n", at, at)
    radius = sqrt(float(square.max()))
    if len(places) < LEAST_HEIGHTS or not radius > 0.0:
        return radius, None
    design = np.column_stack((np.ones(len(at)), at / radius, -square / radius**2))
    size = np.linalg.svd(design, compute_uv=False)
    if size[-1] < _FLAT * size[0]:
        return radius, None
    return radius, np.asarray(np.linalg.pinv(design)[-1])


def _heights(problem: Problem) -> list[tuple[str, int, float, float]]:
    """Return use, point, given height [m] and its standard deviation, of control and checks."""
    at = {name: k for k, name in enumerate(problem.points)}
    return [
        (row.use, at[name], row.xyz[2], problem.given_sigma(row)[2])
        for name, row in problem.control_rows.items()
        if name in at and row.xyz[2] is not None and row.use in ("control", "check")
    ]


def _differences(
    block: AdjustedBlock, problem: Problem, spread: LensSpread, changed: Array | None, sigma: float
) -> Sequence[HeightDifferences]:
    state, known = block.state, _heights(problem)
    out = []
    for use in ("control", "check"):
        # control free of error has no difference, and what was rejected is none
        rows = [
            row[1:]
            for row in known
            if row[0] == use and (use == "check" or np.isfinite(problem.known_sigma[row[1], 2]))
        ]
        rows = rows[:: ceil(len(rows) / _MOST) or 1]
        if not rows:
            continue
        at = np.array([point for point, _, _ in rows])
        d = state.points[at, 2] - (np.array([z for _, z, _ in rows]) - state.origin[2])
        given = np.array([s for _, _, s in rows])
        by_lens = spread.points[at, 2, :] @ np.linalg.inv(spread.q)
        of_lens = by_lens @ spread.points[at, 2, :].T
        q = coordinate_cofactors(block, [(int(k), 2) for k in at])
        # residuals of what takes part, or differences of what does not
        q = np.diag(given**2) + (q if use == "check" else -q)
        _, weights = bend_weights(state.points[at])
        bend = None
        if weights is not None:
            bend = Bend(float(weights @ d), sigma * sqrt(max(float(weights @ q @ weights), 0.0)))
        effect = sigma * sqrt(float(np.diag(of_lens).mean()))
        expected = sigma * sqrt(max(float(np.diag(q).mean()), 0.0))
        found = HeightDifferences(
            use, len(rows), _rms(d), _rms(given), effect, expected, bend, None
        )
        if changed is not None:
            if found.bent:
                explained = _by_one(problem, spread, by_lens, changed, d, q, sigma, expected)
                found = replace(found, explained=explained)
        elif use == "check":
            left = d - of_lens @ np.linalg.pinv(q, hermitian=True) @ d
            found = replace(found, explained=Explained(_rms(left)))
        out.append(found)
    return out


def _by_one(
    problem: Problem,
    spread: LensSpread,
    by_lens: Array,
    changed: Array,
    d: Array,
    q: Array,
    sigma: float,
    expected: float,
) -> Explained | None:
    """Return the one parameter of held lenses whose change explains height differences best.

    What leaves about as little as is expected of them, or as the one that leaves least, explains
    them; of several that do, it is the one that the photographs have least against.

    Parameters
    ----------
    problem, spread
        The bundle with these parameters free.
    by_lens
        (n, k) what a change of each does to the heights while the others stay [m/mm].
    changed
        (k,) what freeing all of them changes.
    d, q
        (n,) differences [m], and their cofactors.
    sigma
        The factor of standard deviations.
    expected
        Root mean square of the standard deviations of the differences [m].
    """
    squares = np.einsum("nk,nk->k", by_lens, by_lens)
    if not (squares > 0.0).any():
        return None
    best = np.divide(-(d @ by_lens), squares, out=np.zeros_like(squares), where=squares > 0.0)
    left = np.array([_rms(d + by_lens[:, k] * size) for k, size in enumerate(best)])
    # beside nothing (the last row), what the photographs have against each change by itself
    off = np.vstack((np.diag(best), np.zeros(len(best)))) - changed
    against = np.einsum("ik,ki->i", off, np.linalg.solve(spread.q, off.T))
    *contradictions, demand = (against / sigma**2 / len(best)).tolist()
    k = min(
        np.flatnonzero(left <= _ALIKE * max(expected, float(left.min()))).tolist(),
        key=contradictions.__getitem__,
    )
    contradiction = contradictions[k]
    parameter = parameter_names(problem)[int(spread.free[k])]
    unit = parameter.factor
    s = sigma * sqrt(max(float(by_lens[:, k] @ q @ by_lens[:, k]), 0.0)) / float(squares[k])
    limit = critical_f(_ALPHA, len(best))
    return Explained(
        float(left[k]),
        parameter.owner,
        parameter.unknown,
        float(best[k]) * unit,
        s * unit,
        contradiction,
        demand,
        limit,
    )


def _rms(values: Array) -> float:
    return sqrt(float(np.mean(np.square(values))))
