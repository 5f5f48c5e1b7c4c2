"""The minimum of v'Pv by damped Gauss-Newton steps, or why there is none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from anaplot.bundle.cluster import Cluster, intersect_rays
from anaplot.bundle.datum import Anchor, anchor, relocate
from anaplot.bundle.factor import Factor, NotPositiveError
from anaplot.bundle.normal import (
    Linearised,
    NormalEquations,
    PointError,
    State,
    Structure,
    linearise,
    move,
    objective,
)
from anaplot.bundle.problem import Problem, listed
from anaplot.bundle.resection import resect
from anaplot.errors import NotComputableError

__all__ = [
    "Convergence",
    "Found",
    "NoConvergenceError",
    "RobustState",
    "Suspect",
    "find_minimum",
    "no_minimum",
    "robust_state",
    "robust_suspects",
]

Array = NDArray[np.float64]
Progress = Callable[[str, float], None]

MAX_ITERATIONS = 60
_CONVERGED = 1e-13  # of n: squared change of the whitened residuals in the last step
_ROBUST = 1e-4  # of n: the same where robust steps end
_BEHIND = 1e2  # damping from which a step may put a point behind its photo
_RESECTED = 30  # photos that are resected at most when a culprit is looked for
_RUNAWAY = 1e12  # damping at which no step downhill is left


class NoConvergenceError(NotComputableError):
    """The iteration found no minimum."""


class Convergence(NamedTuple):
    """How the minimum was found.

    Attributes
    ----------
    iterations
        Accepted steps.
    damped
        Steps that had to be damped or taken back.
    first, last
        v'Pv at the approximate values and at the end.
    """

    iterations: int
    damped: int
    first: float
    last: float


class Found(NamedTuple):
    """A minimum and the equations there."""

    state: State
    normal: NormalEquations
    factor: Factor
    anchor: Anchor | None
    convergence: Convergence


def find_minimum(
    problem: Problem,
    start: State,
    structure: Structure,
    *,
    progress: Progress | None = None,
    limit: int = MAX_ITERATIONS,
    explain: bool = True,
) -> Found:
    """Minimise v'Pv by damped Gauss-Newton steps (Levenberg and Marquardt).

    A step is full until one would increase v'Pv or put more points behind their photos; the
    damping then grows until the step goes downhill, and fades as steps succeed.

    Parameters
    ----------
    problem, start, structure
        The bundle, approximate values, and the structure of its normal equations.
    progress
        Called with what is being done and the fraction of it.
    limit
        Steps after which the search ends.
    explain
        Whether the error says which measurements are to blame, which takes as long as some steps.

    Raises
    ------
    NoConvergenceError
        There is no minimum to be found from here.
    NotComputableError
        The observations leave something open at the minimum.
    """
    state = start
    value, depth = objective(problem, state)
    if not value < float("inf"):
        raise NoConvergenceError(
            f"block {problem.block.name}: the approximate values put a point into a photo's centre"
        )
    first, behind = value, int((depth <= 0.0).sum())
    tie = anchor(problem, state) if problem.defect else None
    weights = None if tie is None else tie.weights
    damping, accepted, damped = 0.0, 0, 0
    tolerance = _CONVERGED * max(problem.observations, 1)
    while accepted < limit:
        linear = linearise(problem, state)
        while True:
            if progress is not None:
                progress(f"iteration {accepted + 1}", 0.0)
            step = _step(problem, structure, linear, damping, weights, progress)
            if step is not None:
                dx, change = step
                trial = move(problem, state, *dx)
                new_value, depth = objective(problem, trial)
                new_behind = int((depth <= 0.0).sum())
                done = change <= tolerance
                # at the minimum rounding alone moves the sum, all of it when there is no error
                settled = done and new_value <= 1.5 * value + 1e-12
                downhill = new_value <= value
                if settled or (downhill and (new_behind <= behind or damping > _BEHIND)):
                    break
            damped += 1
            damping = max(10.0 * damping, 1e-4)
            if damping > _RUNAWAY:
                if not explain:
                    raise NoConvergenceError(f"block {problem.block.name}: no solution found")
                raise _no_minimum(problem, structure, start, state, tie)
        state, value, behind = trial, new_value, new_behind
        accepted += 1
        if done and damping == 0.0:
            if problem.defect:
                state = relocate(problem, start, state)
            return _closed(problem, structure, state, tie, accepted, damped, first)
        # a step that hardly moves is only believed without damping
        damping = 0.0 if damping < 1e-3 or done else damping * 0.1
    if not explain:
        raise NoConvergenceError(f"block {problem.block.name}: no solution found")
    raise _no_minimum(problem, structure, start, state, tie)


def _step(
    problem: Problem,
    structure: Structure,
    linear: Linearised,
    damping: float,
    weights: Array | None,
    progress: Progress | None,
) -> tuple[tuple[Array, Array, Array], float] | None:
    """Return corrections and the squared change of the residuals."""
    try:
        normal = NormalEquations(problem, structure, linear, damping, weights)
        factor = normal.factor(None if progress is None else (lambda f: progress("factor", f)))
    except (NotPositiveError, PointError):
        return None
    photos, points, shared = normal.gradient()
    dx = normal.solve(factor, photos[:, :, None], points[:, :, None], shared[:, None])
    d_photos, d_points, d_shared = dx[0][:, :, 0], dx[1][:, :, 0], dx[2][:, 0]
    change = float(np.vdot(photos, d_photos) + np.vdot(points, d_points) + shared @ d_shared)
    if not change < float("inf"):
        return None
    return (d_photos, d_points, d_shared), max(change, 0.0)


def _closed(
    problem: Problem,
    structure: Structure,
    state: State,
    tie: Anchor | None,
    accepted: int,
    damped: int,
    first: float,
) -> Found:
    """Equations at the minimum, without damping."""
    if tie is not None:
        tie = anchor(problem, state)
    linear = linearise(problem, state)
    try:
        normal = NormalEquations(
            problem, structure, linear, 0.0, None if tie is None else tie.weights
        )
        factor = normal.factor()
    except (PointError, NotPositiveError) as error:
        raise undetermined(problem, structure, linear, tie, error) from error
    return Found(
        state, normal, factor, tie, Convergence(accepted, damped, first, normal.linear.vtpv)
    )


def undetermined(
    problem: Problem,
    structure: Structure,
    linear: Linearised,
    tie: Anchor | None,
    error: PointError | NotPositiveError,
) -> NotComputableError:
    """Return the error that names the photos or points that the observations leave open."""
    name = problem.block.name
    if isinstance(error, PointError):
        open_points = [problem.points[k] for k in error.points.tolist()]
        return NotComputableError(
            f"block {name}: not determined: points {listed(open_points)}: their rays do not meet "
            "at an angle"
        )
    weights = None if tie is None else tie.weights
    try:
        normal = NormalEquations(problem, structure, linear, 1e-7, weights)
        factor = normal.factor()
    except (PointError, NotPositiveError):
        photo = "" if error.photo is None else f": photo {problem.photos[error.photo]}"
        return NotComputableError(f"block {name}: not determined{photo}")
    # inverse iteration: what the observations resist least, in units of what they determine alone
    n, d, p = len(problem.photos), problem.per_photo, len(problem.points)
    rng = np.random.default_rng(1)
    size = np.sqrt(
        np.maximum(np.einsum("nii->ni", normal.blocks[structure.pattern.diagonal]), 1e-300)
    )
    photos: Array = rng.normal(size=(n, d)) * size
    points, shared = np.zeros((p, 3)), np.zeros(problem.in_border)
    for _ in range(4):
        x = normal.solve(factor, photos[:, :, None], points[:, :, None], shared[:, None])[0]
        moved = x[:, :, 0] * size
        moved /= np.abs(moved).max()
        photos = moved * size
    share = np.abs(moved).max(axis=1)
    names = [problem.photos[k] for k in np.nonzero(share > 0.2)[0].tolist()]
    what = "photos" if len(names) > 1 else "photo"
    if problem.additional is not None and len(names) > n // 2:
        return NotComputableError(
            f"block {name}: not determined: the additional parameters "
            f"({problem.additional.set.name}, {problem.additional.scope}-invariant) together with "
            "the orientations; use fewer or weight them"
        )
    return NotComputableError(
        f"block {name}: not determined: {what} {listed(names)}: their common points and control "
        "leave a movement open"
    )


def _no_minimum(
    problem: Problem, structure: Structure, start: State, state: State, tie: Anchor | None
) -> NotComputableError:
    """Name what is not determined, else the observations farthest from a robust solution."""
    linear = linearise(problem, state)
    open_part: NotComputableError | None = None
    try:
        weights = None if tie is None else tie.weights
        NormalEquations(problem, structure, linear, 0.0, weights).factor()
    except (PointError, NotPositiveError) as error:
        open_part = undetermined(problem, structure, linear, tie, error)
    worst = robust_suspects(problem, structure, start)
    if not worst and open_part is not None:
        return open_part
    advice = ""
    if worst:
        others = "".join(f"; then {suspect.what}" for suspect in worst[1:3])
        advice = f": {worst[0].what} disagrees by {worst[0].size} with all others{others}"
    return NoConvergenceError(f"block {problem.block.name}: no solution found{advice}")


def no_minimum(problem: Problem, structure: Structure, start: State) -> NotComputableError:
    """Return the error that says what is wrong where `find_minimum` finds nothing."""
    tie = anchor(problem, start) if problem.defect else None
    return _no_minimum(problem, structure, start, start, tie)


class Suspect(NamedTuple):
    """A measurement far from a robust solution.

    Attributes
    ----------
    what
        "point P in photo F" or "control point P".
    size
        How far it is off, with its unit.
    times
        The same, in units of what the measurements of its kind are off in the median.
    """

    what: str
    size: str
    times: float


def robust_suspects(
    problem: Problem, structure: Structure, start: State, steps: int = 12
) -> list[Suspect]:
    """Return the measurements that a robust adjustment leaves far off, the worst first.

    As `robust_state`; where that leaves many rays off, photos that fit badly are resected to the
    points of the others first.
    """
    state, held, least = _robust(problem, structure, start, steps)
    image, control = _misfits(problem, held, state)
    off = _off(problem, image)
    if off > max(1, len(image) // 200):
        again, _, _ = _robust(problem, structure, _reoriented(problem, start), steps)
        others = _misfits(problem, held, again)
        if _off(problem, others[0]) <= off:
            state, (image, control) = again, others
    found = []
    scale = max(float(np.median(image)), float(np.median(problem.sigma)))
    rays = np.bincount(problem.point, minlength=len(problem.points))
    bad = np.bincount(problem.point[image > 10.0 * scale], minlength=len(problem.points))
    named: set[str] = set()
    for k in np.argsort(-image, kind="stable")[:20].tolist():
        p = int(problem.point[k])
        photo, point = problem.photos[problem.photo[k]], problem.points[p]
        what = f"point {point} in photo {photo}"
        if held[p].any() and rays[p] == 1:
            # a single ray and control contradict each other: nothing tells which is wrong
            what = f"control point {point} or {what}"
        elif held[p].any() and bad[p] > rays[p] // 2:
            what = f"control point {point}"
        if what in named:
            continue
        named.add(what)
        found.append(Suspect(what, f"{image[k]:.3g} mm", image[k] / scale))
    if held.any():
        scale = max(float(np.median(control[held.any(axis=1)])), float(least[held].min()))
        for k in np.argsort(-control, kind="stable")[:10].tolist():
            what = f"control point {problem.points[k]}"
            if what in named:
                continue
            found.append(Suspect(what, f"{control[k]:.3g} m", control[k] / scale))
    found = [suspect for suspect in found if suspect.times > 10.0]
    found.sort(key=lambda suspect: -suspect.times)
    return found


class RobustState(NamedTuple):
    """Where gross errors have lost their pull.

    Attributes
    ----------
    state
        The state; coordinates free of error have their values.
    misfit
        Median misfit of the rays [mm].
    rays_off, control_off
        How many rays and control points are off by more than 20 times what is expected.
    """

    state: State
    misfit: float
    rays_off: int
    control_off: int

    def explains(self, rays: int) -> bool:
        """Whether all but a few of the rays fit: what is off is wrong, not the orientations."""
        return self.rays_off <= max(1, rays // 200)

    @property
    def off(self) -> tuple[int, int]:
        """How many rays and how many control points are off."""
        return self.rays_off, self.control_off


def robust_state(
    problem: Problem, structure: Structure, start: State, steps: int = 12
) -> RobustState:
    """Return the state after some steps of a robust adjustment.

    The sigma of every ray and control point grows with its residual (Cauchy's weight function), so
    that gross errors lose their pull. The steps are damped; control free of error is weighted
    here, for it may be what is wrong.
    """
    state, held, least = _robust(problem, structure, start, steps)
    image, control = _misfits(problem, held, state)
    off = control > 20.0 * np.nan_to_num(np.nanmax(np.where(held, least, 0.0), axis=1))
    points = np.where(problem.fixed, problem.known - state.origin, state.points)
    return RobustState(
        replace(state, points=points),
        float(np.median(image)),
        _off(problem, image),
        int((off & held.any(axis=1)).sum()),
    )


def _off(problem: Problem, image: Array) -> int:
    """Count the rays that are off by more than 20 times their sigma."""
    return int((image > 20.0 * problem.sigma).sum())


def _robust(
    problem: Problem, structure: Structure, start: State, steps: int
) -> tuple[State, NDArray[np.bool_], Array]:
    """Robust steps; also which coordinates are control, and its smallest sigmas [m]."""
    held = problem.fixed | np.isfinite(problem.known_sigma)
    seen = linearise(problem, start)
    ground = float(np.median(np.abs(seen.depth) / problem.c[problem.photo] * problem.sigma))
    least = np.where(problem.fixed, ground, np.nan_to_num(problem.known_sigma, nan=ground))
    soft = replace(
        problem,
        fixed=np.zeros_like(problem.fixed),
        known_sigma=np.where(held, least, np.nan),
    )
    state = start
    tie = anchor(problem, state) if problem.defect else None
    weights = None if tie is None else tie.weights
    damping = 1e-3
    for _ in range(steps):
        image, control = _misfits(problem, held, state)
        scale = max(float(np.median(image)), float(np.median(problem.sigma)))
        soft = replace(soft, sigma=scale * np.sqrt(1.0 + (image / scale) ** 2))
        if held.any():
            scale = max(float(np.median(control[held.any(axis=1)])), float(least[held].min()))
            grown = least * np.sqrt(1.0 + (control / scale) ** 2)[:, None]
            soft = replace(soft, known_sigma=np.where(held, grown, np.nan))
        linear = linearise(soft, state)
        step = _step(soft, structure, linear, damping, weights, None)
        if step is None:
            damping *= 10.0
            continue
        trial = move(soft, state, *step[0])
        if objective(soft, trial)[0] <= linear.vtpv:
            state, damping = trial, damping * 0.3
            if step[1] < _ROBUST * problem.observations:
                break
        else:
            damping *= 10.0
    return state, held, least


def _reoriented(problem: Problem, start: State, rounds: int = 3) -> State:
    """Points from their rays alone, and photos that fit them badly resected to the others' points.

    Whatever control says, and however a gross error has bent the approximate orientations.
    """
    rays = np.column_stack((problem.xy, -problem.c[problem.photo]))
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    cluster = Cluster(start.centres.copy(), start.rotations.copy(), start.points.copy())
    cluster.place(problem, rays, again=True)
    order = np.argsort(problem.photo, kind="stable")
    ends = np.searchsorted(problem.photo[order], np.arange(len(problem.photos) + 1))
    for _ in range(rounds):
        size = np.nan_to_num(cluster.residuals(problem), nan=np.inf)
        worst = np.array(
            [np.max(size[order[ends[k] : ends[k + 1]]]) for k in range(len(problem.photos))]
        )
        limit = 10.0 * max(float(np.median(size)), float(np.median(problem.sigma)))
        for photo in np.argsort(-worst, kind="stable")[:_RESECTED].tolist():
            if not worst[photo] > limit:
                break
            mine = order[ends[photo] : ends[photo + 1]]
            # points as the other photos alone place them
            others = Cluster(cluster.centres.copy(), cluster.rotations, cluster.points.copy())
            others.centres[photo] = np.nan
            seen = intersect_rays(problem, others, rays)[problem.point[mine]]
            good = np.isfinite(seen[:, 0])
            c = float(problem.c[photo])
            found = resect(problem.xy[mine[good]], c, seen[good])
            if found is None:
                continue
            before = float(np.sum(np.minimum(size[mine[good]], 0.02 * c)))
            if float(np.sum(np.minimum(found.residual, 0.02 * c))) < before:
                cluster.centres[photo], cluster.rotations[photo] = found.centre, found.rotation
        cluster.place(problem, rays, again=True)
    return replace(
        start, centres=cluster.centres, rotations=cluster.rotations, points=cluster.points
    )


def _misfits(problem: Problem, held: NDArray[np.bool_], state: State) -> tuple[Array, Array]:
    """(m,) misfit of the rays [mm] and (points,) of control [m]."""
    e = linearise(problem, state).e * problem.sigma_xy
    image = np.nan_to_num(np.linalg.norm(e, axis=1), nan=1e6, posinf=1e6)
    off = np.where(held, state.points + state.origin - problem.known, 0.0)
    return image, np.linalg.norm(off, axis=1)
