"""The iteration of one model's conditions, and its approximate values from nothing.

Everything is in image units: each row's misclosure F and derivatives are divided by the
coefficient a of its observation (a_p = -z', a_L = -dZ), so that a row's cofactor is simply 2
for y and q_x for x. Converged means B' P F = 0 with the coefficients and weights of the
converged unknowns (Kratky and El-Hakim 1983, eq. 1-4).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations, product
from math import atan2, cos, hypot, inf, log1p, sin, sqrt
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dposv

from anaplot.orientation.pair import Stereopair
from anaplot.photogrammetry.conditions import ROWS, collinearity_rows, coplanarity_rows, products
from anaplot.photogrammetry.intersection import intersect
from anaplot.photogrammetry.rotation import turn

__all__ = ["Q_Y", "Conditions", "State", "find_orientation", "tie_cofactor"]

Array = NDArray[np.float64]

Q_Y = 2.0
"""A-priori cofactor of a y row: q_yy = 2 q_xx, the experience of the NRC."""

CONVERGED = 1e-10
_ROOT_Y = sqrt(0.5)
_MAX_ITERATIONS = 60
_PAIRS_UP_TO = 16  # points of a model in which two wrong ones are looked for
_LARGEST_TURN = 0.4  # rad; longer corrections are shortened to this
_ACROSS_MARGIN = 4.0  # per row: a gross error alone must not make the images look turned
_TURNED = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def tie_cofactor(ratio: float, tie_variance: Literal["paper", "propagated"]) -> float:
    """Return the cofactor of an x row; `ratio` is new bx / old bx.

    "paper" takes the ties' model coordinates as free of error: 1. "propagated" adds what the
    image errors of the preceding model contribute: 1 + (1 + k)^2 + k^2, 6 for equal bases.
    """
    if tie_variance == "paper":
        return 1.0
    return 1.0 + (1.0 + ratio) ** 2 + ratio * ratio


class State(NamedTuple):
    """Unknowns of a model: bx [mm], by/bx, bz/bx, (3, 3) rotation of the right photo."""

    bx: float
    beta_y: float
    beta_z: float
    rotation: Array


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """A converged state with its weighted rows.

    Attributes
    ----------
    state
        The unknowns.
    rows
        (7, n + m) derivatives (d ln bx, beta_y, beta_z, three turns) and misclosures, image
        units [mm], each column divided by the root of its cofactor.
    iterations
        Number of corrections made.
    """

    state: State
    rows: Array
    iterations: int

    @property
    def sum_of_squares(self) -> float:
        """Weighted sum of squared misclosures [mm^2]."""
        closing = self.rows[6]
        return float(closing @ closing)


class Conditions:
    """The conditions of one model, ready to be evaluated at any state.

    Parameters
    ----------
    pair
        The measurements.
    tie_variance
        Cofactor of x rows: "paper" or "propagated".

    Attributes
    ----------
    y_index, x_index
        Rows in use, as positions in pair.points.
    x1, p2
        (3, n) left rays in the strip system and right rays in the image system.
    """

    def __init__(
        self, pair: Stereopair, tie_variance: Literal["paper", "propagated"] = "paper"
    ) -> None:
        n = len(pair.points)
        self.tie_variance = tie_variance
        self.preceding_bx = pair.preceding_bx
        self.x1 = pair.fixed.rotation @ _rays(pair.xl, pair.c_left)
        self.p2 = _rays(pair.xr, pair.c_right)
        off = pair.off
        self.y_index = [k for k in range(n) if (pair.points[k], "y") not in off]
        ties = pair.ties or {}
        self.x_index = [
            k for k in range(n) if pair.points[k] in ties and (pair.points[k], "x") not in off
        ]
        self.first = pair.ties is None
        self._y = y = np.array(self.y_index, dtype=np.intp)
        self._x = x = np.array(self.x_index, dtype=np.intp)
        self._x1y = self.x1[:, y] / -self.x1[2, y]
        self._p2_rows = np.concatenate((self.p2[:, y], self.p2[:, x]), axis=1)
        self.tie_points = (
            np.array([ties[pair.points[k]] for k in self.x_index]).reshape(-1, 3).T
            - pair.fixed.centre[:, None]
        )
        self._n, self._m = len(y), len(x)

    @property
    def row_count(self) -> int:
        """Number of rows in use."""
        return self._n + self._m

    def unknown_rows(self) -> slice:
        """Which of the six derivatives are unknowns: a first model holds bx."""
        return slice(1, 6) if self.first else slice(0, 6)

    def cofactors(self, bx: float) -> Array:
        """Return (n + m,) a-priori cofactors of the rows, y first."""
        out = np.full(self.row_count, Q_Y)
        if self._m:
            out[self._n :] = self._tie_cofactor(bx)
        return out

    def _tie_cofactor(self, bx: float) -> float:
        ratio = bx / self.preceding_bx if self.preceding_bx else 1.0
        return tie_cofactor(ratio, self.tie_variance)

    def evaluate(self, state: State, *, ties: bool = True) -> Array:
        """Return (7, n + m) weighted derivatives and misclosures in image units [mm]."""
        bx, beta_y, beta_z, rotation = state
        n, m = self._n, self._m if ties else 0
        x2 = rotation @ self._p2_rows
        rows = np.empty((ROWS, n + m))
        rows[:, :n] = coplanarity_rows(beta_y, beta_z, products(self._x1y, x2[:, :n]))
        rows[:, :n] *= _ROOT_Y
        if m:
            tie = self.tie_points
            d_x, d_z = tie[0] - bx, tie[2] - bx * beta_z
            reduced = np.array([d_x, d_z, np.ones(m)])
            reduced *= -1.0 / (d_z * sqrt(self._tie_cofactor(bx)))
            rows[:, n:] = collinearity_rows(bx, beta_z, products(reduced, x2[:, n:]))
            rows[0] *= bx
            rows[0, :n] = 0.0
        return rows

    def in_front(self, state: State) -> float:
        """Return the share of points that lie in front of both photos."""
        bx, beta_y, beta_z, rotation = state
        meet = intersect(
            np.zeros(3), np.array([bx, bx * beta_y, bx * beta_z]), self.x1, rotation @ self.p2
        )
        return float(np.mean((meet.left > 0.0) & (meet.right > 0.0)))

    def bx_of_ties(self, beta_z: float, rotation: Array) -> float | None:
        """Return the median bx that the ties ask for, one collinearity equation each."""
        if not self._m:
            return None
        x2 = rotation @ self.p2[:, self._x]
        tie = self.tie_points
        lever = x2[2] - beta_z * x2[0]
        usable = np.abs(lever) > 1e-9
        if not usable.any():
            return None
        return float(np.median(((tie[0] * x2[2] - tie[2] * x2[0]) / lever)[usable]))


def _rays(xy: Array, c: float) -> Array:
    out = np.empty((3, len(xy)))
    out[:2] = xy.T
    out[2] = -c
    return out


def iterate(
    conditions: Conditions,
    start: State,
    *,
    ties: bool = True,
) -> Solution | None:
    """Iterate from a start to convergence; None when it does not converge.

    Gauss-Newton corrections; one that would increase the sum of squares is damped (Levenberg and
    Marquardt) until it does not. Rank defects do not stop the iteration: they are judged
    at its end, by the adjustment.
    """
    with np.errstate(all="ignore"):
        return _iterate(conditions, start, ties)


def _iterate(conditions: Conditions, start: State, ties: bool) -> Solution | None:
    with_scale = ties and not conditions.first
    first = 0 if with_scale else 1
    state = start
    rows = conditions.evaluate(state, ties=with_scale)
    normal = rows @ rows.T
    damping = 0.0
    for count in range(1, _MAX_ITERATIONS + 1):
        square = float(normal[6, 6])
        if not square < inf:
            return None
        while True:
            matrix = normal[first:6, first:6]
            if damping:
                matrix = matrix.copy()
                diagonal = np.einsum("ii->i", matrix)
                diagonal += damping * diagonal + 1e-14 * float(diagonal.max())
            _, correction, info = dposv(matrix, normal[first:6, 6])
            if info == 0:
                step = (-correction).tolist()
                if not with_scale:
                    step = [0.0, *step]
                longest = max(map(abs, step))
                if longest < inf:
                    break
            damping = max(10.0 * damping, 1e-8)
            if damping > 1e8:
                return None
        shorten = min(1.0, _LARGEST_TURN / longest) if longest else 1.0
        trial = _moved(state, [shorten * s for s in step])
        trial_rows = conditions.evaluate(trial, ties=with_scale)
        trial_normal = trial_rows @ trial_rows.T
        # weights and coefficients move with the unknowns, hence the room of a few steps
        if float(trial_normal[6, 6]) <= square * (1.0 + 4.0 * longest) + 1e-24:
            state, rows, normal = trial, trial_rows, trial_normal
            damping = damping / 10.0 if damping > 1e-7 else 0.0
            if longest < CONVERGED:
                return Solution(state, rows, count)
        else:
            if longest < CONVERGED:
                return Solution(state, rows, count)
            damping = max(10.0 * damping, 1e-4)
            if damping > 1e8:
                return None
    return None


def _moved(state: State, step: list[float]) -> State:
    return State(
        state.bx * (1.0 + step[0]),
        state.beta_y + step[1],
        state.beta_z + step[2],
        turn(np.array(step[3:])) @ state.rotation,
    )


def _kappa_rotation(kappa: float, fixed: Array) -> Array:
    s, c = sin(kappa), cos(kappa)
    out: Array = fixed @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return out


def _similar_kappa(pair: Stereopair) -> float:
    """Relative kappa of the plane similarity between the two photos' points."""
    left = pair.xl[:, 0] + 1j * pair.xl[:, 1]
    right = pair.xr[:, 0] + 1j * pair.xr[:, 1]
    turned = complex(np.vdot(right - right.mean(), left - left.mean()))
    return atan2(turned.imag, turned.real)


def _tilt(pair: Stereopair, rotation: Array) -> float:
    """Angle [rad] between the axes of the two photos."""
    left, right = pair.fixed.rotation[:, 2], rotation[:, 2]
    return atan2(float(np.linalg.norm(np.cross(left, right))), float(left @ right))


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """The most plausible orientation.

    Attributes
    ----------
    solution
        In the frame of the strip, unless `across`.
    in_front
        Share of points in front of both photos.
    across
        Whether the base lies across x: the images are turned.
    """

    solution: Solution
    in_front: float
    across: bool

    @property
    def usable(self) -> bool:
        """Whether this can be an orientation of this strip at all."""
        return not self.across and abs(self.solution.state.beta_y) <= 1.0 and self.in_front > 0.5


Candidate = tuple[Found, Stereopair, Conditions]


def find_orientation(
    pair: Stereopair, conditions: Conditions, bx: float | None, apriori_mm: float
) -> tuple[Found | None, tuple[str, ...]]:
    """Find the orientation of a pair from nothing.

    A single start (vertical, kappa from a plane similarity) serves nearly always. When what it
    finds does not look like an aerial model, one point may be grossly wrong: the orientation that
    all others agree on then is the start. Failing that, rotations on a grid are tried, each with
    the base direction that suits it best, and the most plausible outcome is taken: small
    residuals, points in front, small tilts, a base along x.

    Parameters
    ----------
    pair, conditions
        The measurements and their conditions.
    bx
        Magnitude of a first model's bx [mm]; None for later models.
    apriori_mm
        A-priori sigma0 [mm].

    Returns
    -------
    Found or None
        None when nothing converges.
    tuple of str
        Points without which the others agree, when there is no usable orientation with them.
    """
    direct = _direct(pair, conditions, bx)
    if direct is not None and _fits(pair, conditions, direct, apriori_mm):
        return direct, ()
    suspects: tuple[str, ...] = ()
    without = _without(pair, conditions, bx, apriori_mm, 1)
    if without is not None:
        found = _finish(pair, conditions, bx, without[0].solution.state, direct=True)
        if found is not None and found.usable:
            return found, ()
        suspects = without[1]
    best = _best_of_grid(pair, conditions, bx, apriori_mm, direct)
    if best is not None and best.usable:
        return best, ()
    if not suspects and len(pair.points) <= _PAIRS_UP_TO:
        without = _without(pair, conditions, bx, apriori_mm, 2)
        suspects = () if without is None else without[1]
    return best, suspects


def _direct(pair: Stereopair, conditions: Conditions, bx: float | None) -> Found | None:
    start = _kappa_rotation(_similar_kappa(pair), pair.fixed.rotation)
    return _finish(pair, conditions, bx, State(bx or 1.0, 0.0, 0.0, start), direct=True)


def _fits(pair: Stereopair, conditions: Conditions, found: Found, apriori_mm: float) -> bool:
    """Whether a result is beyond doubt: it looks like an aerial model and its rows agree."""
    freedom = conditions.row_count - (5 if conditions.first else 6)
    state = found.solution.state
    return (
        freedom > 1
        and found.solution.sum_of_squares < freedom * (3.0 * apriori_mm) ** 2
        and found.in_front >= 0.75
        and _tilt(pair, state.rotation) < 0.45
        and max(abs(state.beta_y), abs(state.beta_z)) < 0.7
    )


def _without(
    pair: Stereopair, conditions: Conditions, bx: float | None, apriori_mm: float, count: int
) -> tuple[Found, tuple[str, ...]] | None:
    """Leave out `count` points at a time; return the best orientation that the others agree on."""
    best: tuple[Found, tuple[str, ...]] | None = None
    lowest = inf
    for left_out in combinations(pair.points, count):
        off = pair.off | {(point, axis) for point in left_out for axis in ("x", "y")}
        reduced = replace(pair, off=off)
        rest = Conditions(reduced, conditions.tie_variance)
        if rest.row_count < (5 if rest.first else 6) + 2 or not (rest.first or rest.x_index):
            continue
        found = _direct(reduced, rest, bx)
        if found is None or not _fits(reduced, rest, found, apriori_mm):
            continue
        merit = found.solution.sum_of_squares
        if merit < lowest:
            best, lowest = (found, left_out), merit
    return best


def _best_of_grid(
    pair: Stereopair,
    conditions: Conditions,
    bx: float | None,
    apriori_mm: float,
    direct: Found | None,
) -> Found | None:
    candidates: list[Candidate] = [] if direct is None else [(direct, pair, conditions)]
    across_pair = _turned(pair)
    across_conditions = Conditions(across_pair, conditions.tie_variance)
    for state, across in _starts(pair, conditions, bx):
        frame = (across_pair, across_conditions) if across else (pair, conditions)
        other = _finish(*frame, bx, state)
        if other is not None:
            candidates.append((replace(other, across=across), *frame))
    if not candidates:
        return None
    merits = [_implausibility(item, apriori_mm) for item in candidates]
    order = sorted(range(len(merits)), key=merits.__getitem__)
    along = [k for k in order if not candidates[k][0].across]
    if not along or merits[order[0]] + _ACROSS_MARGIN * conditions.row_count < merits[along[0]]:
        return candidates[order[0]][0]
    return candidates[along[0]][0]


def _implausibility(item: Candidate, apriori_mm: float) -> float:
    found, pair, conditions = item
    n = conditions.row_count
    misfit = n * log1p(found.solution.sum_of_squares / (n * apriori_mm**2))
    return misfit + _strangeness(pair, found, conditions)


def _strangeness(pair: Stereopair, found: Found, conditions: Conditions) -> float:
    """How little a result looks like aerial photography: tilts, base, relief, points behind.

    Flat terrain has two exact orientations; in the second one the terrain stands upright.
    """
    state = found.solution.state
    bx, beta_y, beta_z, rotation = state
    depth = intersect(
        np.zeros(3),
        np.array([bx, bx * beta_y, bx * beta_z]),
        conditions.x1,
        rotation @ conditions.p2,
    ).points[2]
    middle = float(np.median(depth))
    with np.errstate(all="ignore"):
        relief: float = float(np.median(np.abs(depth / middle - 1.0)))
    return float(
        (_tilt(pair, rotation) / 0.15) ** 2
        + (hypot(beta_y, beta_z) / 0.4) ** 2
        + (min(relief, 10.0) / 0.15) ** 2
        + 10.0 * len(depth) * (1.0 - found.in_front)
    )


def _finish(
    pair: Stereopair,
    conditions: Conditions,
    bx: float | None,
    start: State,
    *,
    direct: bool = False,
) -> Found | None:
    """Coplanarity first (where it suffices), then the sign and size of bx, then all conditions."""
    if conditions.first:
        assert bx is not None
        solution = iterate(conditions, start)
        if solution is None:
            return None
        share = conditions.in_front(solution.state)
        if share < 0.75:
            # a base of the wrong sign fits as well: the points tell which it is
            mirrored = solution.state._replace(bx=-solution.state.bx)
            other = conditions.in_front(mirrored)
            if other > share:
                return Found(Solution(mirrored, solution.rows, solution.iterations), other, False)
        return Found(solution, share, False)
    if not direct and len(conditions.y_index) >= 5:
        plane = iterate(conditions, start, ties=False)
        if plane is not None:
            start = plane.state
    size = conditions.bx_of_ties(start.beta_z, start.rotation)
    if size is None or size == 0.0:
        return None
    solution = iterate(conditions, start._replace(bx=size))
    if solution is None:
        return None
    return Found(solution, conditions.in_front(solution.state), False)


def _turned(pair: Stereopair) -> Stereopair:
    """Return the same pair in a system turned by -90 degrees about z: y becomes x."""
    fixed = replace(
        pair.fixed,
        centre=_TURNED @ pair.fixed.centre,
        rotation=_TURNED @ pair.fixed.rotation,
    )
    ties = pair.ties
    if ties is not None:
        ties = {name: (y, -x, z) for name, (x, y, z) in ties.items()}
    return replace(pair, fixed=fixed, ties=ties)


def _starts(pair: Stereopair, conditions: Conditions, bx: float | None) -> list[tuple[State, bool]]:
    """Return promising starts, the best first: (state, whether the base lies across x).

    For a given rotation the coplanarity condition is linear in the base direction: the smallest
    eigenvector of the moment matrix of x' x x'' is the base, its eigenvalue the merit.
    """
    kappa = _similar_kappa(pair)
    tilts = (-0.2, 0.0, 0.2)
    kappas = [kappa + d for d in (0.0, -0.35, 0.35)] + [0.0, 0.5, -0.5, 1.0, -1.0]
    grid = list(product(kappas, tilts, tilts))
    rotations = np.array(
        [_kappa_rotation(k, pair.fixed.rotation @ turn(np.array([o, p, 0.0]))) for k, o, p in grid]
    )
    size = bx or abs(conditions.preceding_bx or 1.0)
    vertical = [(State(size, 0.0, 0.0, _kappa_rotation(kappa, pair.fixed.rotation)), False)]
    y = conditions.y_index
    if len(y) < 3:
        return vertical + [(State(size, 0.0, 0.0, r), False) for r in rotations]
    x1 = conditions.x1[:, y] / -conditions.x1[2, y]
    x2 = rotations @ conditions.p2[:, y]
    normal = np.cross(x1[None].swapaxes(1, 2), x2.swapaxes(1, 2))
    values, vectors = np.linalg.eigh(normal.swapaxes(1, 2) @ normal)
    order = np.argsort(values[:, 0], kind="stable")[:16].tolist()
    starts: list[tuple[State, bool]] = list(vertical)
    for k in order:
        x, y_, z = vectors[k, :, 0].tolist()
        across = abs(y_) > abs(x)
        along, side = (y_, -x) if across else (x, y_)
        rotation = _TURNED @ rotations[k] if across else rotations[k]
        if abs(z) > 2.0 * abs(along):
            starts.append((State(size, 0.0, 0.0, rotations[k]), False))
        else:
            starts.append((State(size, side / along, z / along, rotation), across))
    return starts
