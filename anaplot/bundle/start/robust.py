"""A robust solution, in which gross errors have little weight, and the errors seen from it."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array, Bools, Progress
from anaplot.bundle.solve.datum import anchor
from anaplot.bundle.solve.gaussnewton import damped_step
from anaplot.bundle.solve.imaging import BlockState, RobustPlace
from anaplot.bundle.solve.linearised import (
    beside_misclosures,
    counted_misclosures,
    linearise,
    move,
    objective,
)
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.solve.structure import Structure
from anaplot.bundle.start.placedagain import placed_again
from anaplot.bundle.start.resection import resect
from anaplot.bundle.start.subblock import SubBlock, intersect_rays, rays_of_photos, unit_rays

__all__ = [
    "FAR",
    "OFF",
    "OF_A_PHOTO",
    "ClearestSolution",
    "FarOff",
    "RobustState",
    "Waiting",
    "clearest_solution",
    "far_off",
    "reoriented",
    "robust_state",
    "with_fixed",
]


FAR = 10.0
"""Times what measurements are off in the median: so far off is a suspect."""

OFF = 20.0
"""Sigmas by which a ray or control is off."""

OF_A_PHOTO = 0.25
"""Share of a photo's rays that may be off where it is oriented rightly."""

_DAMPING = 1e-3  # of the first step
_FIRM = 1e-6  # of it where many rays hold every photo
_ROBUST = 1e-4  # of n: squared change of the whitened residuals where robust steps end
_STEPS = 12
_RESECTED = 30  # photos that are resected at most when a culprit is looked for
_FEW = 200  # rays of which one may be off in any case
_SCATTERED = 0.05  # of the redundancy: coordinates that may be off, scattered over the photos
_TRUE = 1e-3  # of c: right orientations miss by less, in the median
_WRONG = 0.45  # share of its rays off that a photo of a wrong solution has, at least
_AGREE = 0.1  # of the redundancy: coordinates that may be off where all others agree


class FarOff(NamedTuple):
    """What is far off from a robust solution.

    Attributes
    ----------
    state
        The solution; coordinates free of error have their values.
    rays, control, priors, expected
        (m,) which rays, (points,) which points' control, (photos, 2) which prior positions and
        rotations, (points,) which points' priors.
    reach
        What a ray may be off [mm].
    """

    state: BlockState
    rays: Bools
    control: Bools
    priors: Bools
    expected: Bools
    reach: float


def far_off(problem: Problem, structure: Structure, start: RobustPlace) -> FarOff:
    """Return what a robust adjustment leaves far off, by the measure of `robust_suspects`.

    Parameters
    ----------
    problem, structure, start
        As `robust_suspects` has them.
    """
    clearest = clearest_solution(problem, structure, start)
    misfits, held = clearest.misfits, clearest.held
    control = np.zeros(len(problem.points), dtype=bool)
    if held.any():
        far = misfits.control > FAR * misfits.control_scale(held, clearest.least)
        control = held.any(axis=1) & far
    reach = FAR * misfits.ray_scale(problem)
    rays = misfits.image > reach
    limit = FAR * misfits.prior_scale()
    priors, expected = misfits.priors > limit, misfits.expected > limit
    return FarOff(with_fixed(problem, clearest.state), rays, control, priors, expected, reach)


class _Misfits(NamedTuple):
    """(m,) of rays [mm], (points,) of control [m].

    And in sigmas (photos, 2) of prior orientations and (points,) of priors of points.
    """

    image: Array
    control: Array
    priors: Array
    expected: Array

    def ray_scale(self, problem: Problem) -> float:
        """Return what a ray is off in the median, not less than its sigma [mm]."""
        return max(float(np.median(self.image)), float(np.median(problem.sigma)))

    def control_scale(self, held: Bools, least: Array) -> float:
        """Return what control is off in the median, not less than its smallest sigma [m]."""
        middle = float(np.median(self.control[held.any(axis=1)]))
        return max(middle, float(least[held].min()))

    def prior_scale(self) -> float:
        """Return what priors are off in the median, not less than their sigma."""
        off = np.concatenate((self.priors.ravel(), self.expected))
        off = off[off > 0.0]
        return max(float(np.median(off)), 1.0) if len(off) else 1.0


class ClearestSolution(NamedTuple):
    """A robust solution; held and least as `_robust` returns them."""

    state: BlockState
    held: Bools
    least: Array
    misfits: _Misfits


def clearest_solution(
    problem: Problem, structure: Structure, start: RobustPlace
) -> ClearestSolution:
    """Return the robust solution that leaves fewest rays off, with and without new orientations."""
    if start.settled:
        state, (held, least) = start.state, _control(problem, start.state)
    else:
        state, held, least, _ = _robust(problem, structure, start.state)
    misfits = _misfits(problem, held, state)
    off = _off(problem, misfits.image)
    if off > max(1, len(misfits.image) // 200):
        again, *_ = _robust(problem, structure, reoriented(problem, start.state))
        others = _misfits(problem, held, again)
        if _off(problem, others.image) <= off:
            state, misfits = again, others
    placed = placed_again(problem, state, OFF * problem.sigma)
    if placed is not None:
        again, *_ = _robust(problem, structure, placed)
        others = _misfits(problem, held, again)
        if _off(problem, others.image) < _off(problem, misfits.image):
            state, misfits = again, others
    return ClearestSolution(state, held, least, misfits)


class RobustState(NamedTuple):
    """A solution in which gross errors have little weight.

    Attributes
    ----------
    state
        The state; coordinates free of error have their values.
    misfit
        Median misfit of the rays [mm].
    rays_off, control_off
        How many rays and control points are off by more than 20 times what is expected.
    most_off
        The largest share of a photo's rays that are off.
    settled
        Whether more such steps would hardly move anything.
    beside
        Whether most rays of most control points are off: control has drawn its points along, and
        the block lies elsewhere.
    """

    state: BlockState
    misfit: float
    rays_off: int
    control_off: int
    most_off: float
    settled: bool = False
    beside: bool = False

    @property
    def place(self) -> RobustPlace:
        """Where it is, for other steps."""
        return RobustPlace(self.state, self.settled)

    @property
    def grounded(self) -> bool:
        """Whether no control is off, and the block lies on it."""
        return self.control_off == 0 and not self.beside

    def explains(self, problem: Problem) -> bool:
        """Whether all but a few of the rays fit: what is off is wrong, not the orientations.

        Few is one of two hundred. Where other rays tell against them there may be more, scattered
        over the photos: of a photo that is oriented wrongly most rays are off.
        """
        if self.rays_off <= max(1, len(problem.photo) // _FEW):
            return True
        return self.most_off <= OF_A_PHOTO and self._told_by_others(problem, _SCATTERED)

    def orients(self, problem: Problem) -> bool:
        """Whether the photos are oriented rightly, however many rays are wrong.

        Of no photo many rays are off then (.08 to .21 in our tests), and the others fit well. Few
        that fit well do not do: wrong photos may, by the rest of their rays.
        """
        return self.most_off <= OF_A_PHOTO and self.misfit <= _TRUE * float(np.median(problem.c))

    def misleads(self, problem: Problem) -> bool:
        """Whether some photos are oriented wrongly, and the others do not fit either."""
        return self.most_off > _WRONG and self.misfit > _TRUE * float(np.median(problem.c))

    def agrees(self, problem: Problem) -> bool:
        """Whether nearly all rays fit, wherever the others are."""
        return self._told_by_others(problem, _AGREE)

    def _told_by_others(self, problem: Problem, share: float) -> bool:
        """Whether coordinates that are off are at most a share of the redundancy."""
        return 2 * self.rays_off <= share * problem.redundancy

    def better_than(self, other: RobustState, problem: Problem) -> bool:
        """Whether fewer rays are off, and then fewer control points.

        Of two that orient the photos a few rays more or less say nothing: either ray of a point of
        two may be the one that is off. The one that lies on its control counts then.
        """
        if self.beside != other.beside and self.orients(problem) and other.orients(problem):
            return other.beside
        return self.off < other.off

    @property
    def off(self) -> tuple[int, int]:
        """How many rays and how many control points are off."""
        return self.rays_off, self.control_off


class Waiting(NamedTuple):
    """Approximate values that wait for the other ways.

    Attributes
    ----------
    start
        The values.
    solution
        Their robust solution, where it is known.
    """

    start: BlockState
    solution: RobustState | None

    @property
    def rays_off(self) -> float:
        """How many rays are off; infinite where that is not known."""
        return float("inf") if self.solution is None else self.solution.rays_off


def robust_state(
    problem: Problem,
    structure: Structure,
    start: BlockState,
    *,
    of_some: bool = False,
    firm: bool = False,
    enough: float = _ROBUST,
    progress: Progress | None = None,
) -> RobustState:
    """Return the state after some steps of a robust adjustment.

    The sigma of every ray, control point and prior grows with its residual (Cauchy's weight
    function), so that gross errors lose their pull. The steps are damped; control free of error is
    weighted here, for it may be what is wrong.

    Parameters
    ----------
    problem, structure, start
        The bundle, and where the steps begin.
    of_some
        Whether the start is already such a state of some of the points, with the others placed by
        it: the first step with all of them that makes it better settles it.
    firm
        Whether every photo has so many rays that its steps need hardly any damping, as `of_some`
        has: what control says would wait for that to fade.
    enough
        Of n: squared change of the whitened residuals in a step that is the last one.
    progress
        Called with what is being done and the fraction of it.
    """
    damping = _FIRM if firm or of_some else _DAMPING
    state, held, least, settled = _robust(
        problem, structure, start, progress, damping, enough, one=of_some
    )
    image, control, *_ = _misfits(problem, held, state)
    off = control > OFF * np.nan_to_num(np.nanmax(np.where(held, least, 0.0), axis=1))
    rays_off = image > OFF * problem.sigma
    contradict = np.bincount(problem.point[rays_off], minlength=len(off))
    rays = np.bincount(problem.point, minlength=len(off))
    contradicted = contradict > np.maximum(rays // 2, 1)
    known = held.any(axis=1)
    return RobustState(
        with_fixed(problem, state),
        float(np.median(image)),
        int(rays_off.sum()),
        int((off & known).sum()),
        float(np.max(np.bincount(problem.photo, rays_off) / np.bincount(problem.photo))),
        # control free of error lay elsewhere in these steps: they would go on from where it is
        settled and not problem.fixed.any(),
        2 * int((contradicted & known).sum()) > int(known.sum()),
    )


def with_fixed(problem: Problem, state: BlockState) -> BlockState:
    """Return the state with the values of coordinates free of error."""
    points = np.where(problem.fixed, problem.known - state.origin, state.points)
    return replace(state, points=points)


def _off(problem: Problem, image: Array) -> int:
    """Count the rays that are off by more than 20 times their sigma."""
    return int((image > OFF * problem.sigma).sum())


def _robust(
    problem: Problem,
    structure: Structure,
    start: BlockState,
    progress: Progress | None = None,
    damping: float = _DAMPING,
    enough: float = _ROBUST,
    *,
    one: bool = False,
) -> tuple[BlockState, Bools, Array, bool]:
    """Robust steps; also which coordinates are control, its smallest sigmas [m], and if it settled.

    It has where the last step hardly moved anything, or with the first that was taken where `one`
    is enough.
    """
    held, least = _control(problem, start)
    soft = replace(
        problem,
        conditions=None,
        fixed=np.zeros_like(problem.fixed),
        known_sigma=np.where(held, least, np.nan),
    )
    state = start
    tie = anchor(problem, state) if problem.defect else None
    weights = None if tie is None else tie.weights
    for done in range(_STEPS):
        if progress is not None:
            progress("robust solution", done / _STEPS)
        misfits = _misfits(problem, held, state)
        scale = misfits.ray_scale(problem)
        soft = replace(soft, sigma=scale * np.sqrt(1.0 + (misfits.image / scale) ** 2))
        if held.any():
            scale = misfits.control_scale(held, least)
            grown = least * np.sqrt(1.0 + (misfits.control / scale) ** 2)[:, None]
            soft = replace(soft, known_sigma=np.where(held, grown, np.nan))
        if misfits.priors.any() or misfits.expected.any():
            scale = misfits.prior_scale()
            grown = np.sqrt(1.0 + (misfits.priors / scale) ** 2)
            of_points = np.sqrt(1.0 + (misfits.expected / scale) ** 2)
            soft = replace(
                soft,
                position_sigma=problem.position_sigma * grown[:, :1],
                rotation_sigma=problem.rotation_sigma * grown[:, 1:],
                expected_sigma=problem.expected_sigma * of_points[:, None],
            )
        linear = linearise(soft, state)
        step = None  # its memory, before there is another
        step = damped_step(soft, structure, linear, damping, weights, None)
        if step is None:
            damping *= 10.0
            continue
        trial = move(state, *step.dx)
        if objective(soft, trial)[0] <= linear.vtpv:
            state, damping = trial, damping * 0.3
            if one or step.change < enough * problem.observations:
                return state, held, least, True
        else:
            damping *= 10.0
    return state, held, least, False


def _control(problem: Problem, state: BlockState) -> tuple[Bools, Array]:
    """(points, 3) which coordinates are control, and its smallest sigmas [m]."""
    held = problem.fixed | np.isfinite(problem.known_sigma)
    depth = counted_misclosures(problem, state)[1]
    ground = float(np.median(np.abs(depth) / problem.c[problem.photo] * problem.sigma))
    least = np.where(problem.fixed, ground, np.nan_to_num(problem.known_sigma, nan=ground))
    return held, least


def reoriented(problem: Problem, start: BlockState) -> BlockState:
    """Points from their rays alone, and photos that fit them badly resected to the others' points.

    Independent of control and of gross errors in the approximate orientations.
    """
    rays, by_photo = unit_rays(problem), rays_of_photos(problem)
    subblock = SubBlock(start.centres.copy(), start.rotations.copy(), start.points.copy())
    subblock.place(problem, rays, again=True)
    for _ in range(3):
        size = np.nan_to_num(subblock.residuals(problem), nan=np.inf, posinf=np.inf)
        worst = np.array([np.max(size[mine]) for mine in by_photo])
        limit = 10.0 * max(float(np.median(size)), float(np.median(problem.sigma)))
        for photo in np.argsort(-worst, kind="stable")[:_RESECTED].tolist():
            if not worst[photo] > limit:
                break
            mine = by_photo[photo]
            # points as the other photos alone place them
            others = SubBlock(subblock.centres.copy(), subblock.rotations, subblock.points.copy())
            others.centres[photo] = np.nan
            its = np.zeros(len(problem.points), dtype=bool)
            its[problem.point[mine]] = True
            seen = intersect_rays(problem, others, rays, its)[problem.point[mine]]
            good = np.isfinite(seen[:, 0])
            c = float(problem.c[photo])
            found = resect(problem.ideal[mine[good]], c, seen[good])
            if found is None:
                continue
            before = float(np.sum(np.minimum(size[mine[good]], 0.02 * c)))
            if float(np.sum(np.minimum(found.residual, 0.02 * c))) < before:
                subblock.centres[photo], subblock.rotations[photo] = found.centre, found.rotation
        subblock.place(problem, rays, again=True)
    return replace(
        start, centres=subblock.centres, rotations=subblock.rotations, points=subblock.points
    )


def _misfits(problem: Problem, held: Bools, state: BlockState) -> _Misfits:
    e = counted_misclosures(problem, state)[0] * problem.sigma_xy
    image = np.nan_to_num(np.hypot(*e.T), nan=1e6, posinf=1e6)
    off = np.where(held, state.points - (problem.known - state.origin), 0.0)
    of_photos, of_points = beside_misclosures(problem, state)
    priors = np.abs(of_photos).reshape(-1, 2, 3).max(axis=2)
    expected = np.abs(of_points[1]).max(axis=1)
    return _Misfits(image, np.linalg.norm(off, axis=1), priors, expected)
