"""The iteration of one model's conditions, and its approximate values from nothing.

Converged means B' P F = 0 with the coefficients and weights of the converged unknowns (Kratky and
El-Hakim 1983, eq. 1-4).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations, product
from math import acos, atan2, cos, hypot, inf, log1p, sin
from typing import NamedTuple

import numpy as np

from anaplot.adjustment import lapack
from anaplot.aliases import Array, Bools
from anaplot.errors import NotComputableError
from anaplot.orientation.conditionequations import ConditionEquations, ModelUnknowns
from anaplot.orientation.pair import Stereopair
from anaplot.orientation.turnedalone import turned_alone
from anaplot.photogrammetry.block import TieVariance
from anaplot.photogrammetry.rotation import turn

__all__ = [
    "CONVERGED",
    "FEW_ITERATIONS",
    "IN_FRONT",
    "LARGEST_TURN",
    "ConvergedOrientation",
    "FoundOrientation",
    "agreement",
    "find_orientation",
    "iterate",
    "looks_right",
    "vertical_start",
]


IN_FRONT = 0.75
"""Share of points that must lie in front of both photos; the others may be grossly wrong."""

CONVERGED = 1e-10
"""Largest correction of an unknown at convergence."""

FEW_ITERATIONS = 12
"""What is right converges in fewer."""

LARGEST_TURN = 0.4
"""Correction [rad, and of the base] to which longer ones are shortened."""

_MAX_ITERATIONS = 60
_PAIRS_UP_TO = 16  # points of a model in which two wrong ones are looked for
_FEW_PARALLAXES = 200.0  # sigmas: below, photos may be of one place, and are looked at
_NO_BASE = 0.1  # of the preceding base: below, photos do not make a model
_ROUGH = 3.0  # sigmas: up to there the rows agree
_STEEP = 0.45  # rad between the axes of the photos of an aerial model, at most
_SLOPE = 0.7  # of the base, at most
_FAR = 0.15  # rad, and of the base: beyond, a gross error is no longer a linear matter
_LARGEST_DAMPING = 1e8
_SAME_MERIT = 1e-6  # starts that lead to the same orientation differ by less
_ACROSS_MARGIN = 4.0  # per row: a gross error alone must not make the images look turned
_TURNED = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


class ConvergedOrientation(NamedTuple):
    """A converged state with its weighted rows.

    Attributes
    ----------
    state
        The unknowns.
    rows
        (7, n + m) derivatives (d ln bx, beta_y, beta_z, three turns) and misclosures, image
        units [mm], each column divided by the root of its cofactor: those before the last
        correction, which is too short to change them and is made again by their adjustment.
    coefficients
        (7, 18) of the conditions, with which the rows were made.
    sum_of_squares
        Of the weighted misclosures [mm^2].
    iterations
        Number of corrections made.
    """

    state: ModelUnknowns
    rows: Array
    coefficients: Array
    sum_of_squares: float
    iterations: int


def iterate(
    conditions: ConditionEquations,
    start: ModelUnknowns,
    *,
    ties: bool = True,
    most: int = _MAX_ITERATIONS,
) -> ConvergedOrientation | None:
    """Iterate from a start to convergence; None when it does not converge.

    Gauss-Newton corrections; one that would increase the sum of squares is damped (Levenberg and
    Marquardt) until it does not. Rank defects do not stop the iteration: they are judged
    at its end, by the adjustment. The caller silences divisions by zero.
    """
    with_scale = ties and not conditions.first
    used = slice(0 if with_scale else 1, 6)
    state = start
    rows, factors = conditions.linearise(state, ties=with_scale)
    normal = rows.dot(rows.T)
    square, damping = normal.item(6, 6), 0.0
    for count in range(1, most + 1):
        if not square < inf:
            return None
        solved = _solved(normal[used, used], normal[used, 6], damping)
        if solved is None:
            return None
        excess, damping = solved
        longest = max(max(excess), -min(excess))
        if longest > LARGEST_TURN:
            excess = [s * LARGEST_TURN / longest for s in excess]
        if not with_scale:
            excess = [0.0, *excess]
        trial = _corrected(state, *excess)
        if longest < CONVERGED and not damping:
            return ConvergedOrientation(trial, rows, factors, square, count)
        trial_rows, trial_factors = conditions.linearise(trial, ties=with_scale)
        trial_normal = trial_rows.dot(trial_rows.T)
        trial_square = trial_normal.item(6, 6)
        # weights and coefficients move with the unknowns, hence the room of a few steps
        better = trial_square <= square * (1.0 + 4.0 * longest) + 1e-24
        if better:
            state, rows, factors = trial, trial_rows, trial_factors
            normal, square = trial_normal, trial_square
        if longest < CONVERGED:
            damping = 0.0  # a damped correction is short without being the last
        elif better:
            damping = damping / 10.0 if damping > 1e-7 else 0.0
        else:
            damping = max(10.0 * damping, 1e-4)
            if damping > _LARGEST_DAMPING:
                return None
    return None


def _solved(matrix: Array, right: Array, damping: float) -> tuple[list[float], float] | None:
    """Return what damped normal equations find too much, and the damping that it took."""
    while True:
        damped = matrix
        if damping:
            diagonal = matrix.diagonal()
            damped = matrix + np.diag(damping * diagonal + 1e-14 * diagonal.max())
        _, solution, info = lapack.dposv(damped, right)
        if info == 0:
            excess: list[float] = solution.tolist()
            if abs(sum(excess)) < inf:
                return excess, damping
        damping = max(10.0 * damping, 1e-8)
        if damping > _LARGEST_DAMPING:
            return None


def _corrected(
    state: ModelUnknowns, bx: float, beta_y: float, beta_z: float, x: float, y: float, z: float
) -> ModelUnknowns:
    """Return unknowns less what was found too much: d ln bx, beta_y, beta_z and three turns."""
    old_bx, old_y, old_z, rotation = state
    turned = turn(-x, -y, -z).dot(rotation)
    return ModelUnknowns(old_bx * (1.0 - bx), old_y - beta_y, old_z - beta_z, turned)


def _kappa_rotation(kappa: float, fixed: Array) -> Array:
    s, c = sin(kappa), cos(kappa)
    turned = np.array((c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0)).reshape(3, 3)
    out: Array = fixed.dot(turned)
    return out


def _similar_kappa(conditions: ConditionEquations) -> float:
    """Relative kappa of the plane similarity between the two photos' points."""
    # z of every ray is -c: products with it are the sums
    moments = conditions.p2.dot(conditions.p1.T).tolist()
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = moments
    return atan2(xy - yx - (xz * zy - yz * zx) / zz, xx + yy - (xz * zx + yz * zy) / zz)


def _tilt(pair: Stereopair, rotation: Array) -> float:
    """Angle [rad] between the axes of the two photos."""
    return acos(max(-1.0, min(1.0, float(pair.fixed.rotation[:, 2].dot(rotation[:, 2])))))


class FoundOrientation(NamedTuple):
    """The most plausible orientation.

    Attributes
    ----------
    solution
        In the frame of the strip, unless `across`.
    front
        Which points lie in front of both photos.
    parallax
        The x-parallax [mm] of points as far as they are in the root mean square.
    across
        Whether the base lies across x: the images are turned.
    """

    solution: ConvergedOrientation
    front: list[bool]
    parallax: float
    across: bool = False

    @classmethod
    def of(cls, conditions: ConditionEquations, solution: ConvergedOrientation) -> FoundOrientation:
        """Return what was found, with where the points that it gives lie."""
        front, far = conditions.front(solution.state)
        return cls(solution, front, abs(solution.state.bx) / far if far else inf)

    @property
    def in_front(self) -> float:
        """Share of them."""
        return self.front.count(True) / len(self.front)

    @property
    def along(self) -> bool:
        """Whether the base runs along x rather than across it."""
        return not self.across and abs(self.solution.state.beta_y) <= 1.0

    @property
    def usable(self) -> bool:
        """Whether this can be an orientation of this strip at all."""
        return self.along and self.in_front >= IN_FRONT


Candidate = tuple[FoundOrientation, Stereopair, ConditionEquations]


def find_orientation(
    pair: Stereopair, conditions: ConditionEquations, bx: float | None, apriori_mm: float
) -> tuple[FoundOrientation | None, tuple[str, ...]]:
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
        Points without which the others agree, when there is no usable orientation with them or
        one that they pull far away.

    Raises
    ------
    NotComputableError
        The photos of a later model are interchanged (in a first model that only turns the base),
        or there is no base between two photos.
    """
    direct = _direct(pair, conditions, bx)
    fits = direct is not None and _fits(pair, conditions, direct, apriori_mm)
    if not fits or (direct is not None and direct.parallax < _FEW_PARALLAXES * apriori_mm):
        turned = turned_alone(conditions.p1, conditions.p2, apriori_mm)
        if turned is not None:
            raise NotComputableError(
                f"model {pair.name}: there is no base between the photos: a rotation alone leads "
                f"from one to the other, within {turned:.1f} sigmas; is one photo laid in twice?"
            )
    if direct is not None and fits:
        return direct, ()
    # of one tie the sign of its depth would be all that says so
    if len(conditions.x_index) > 1 and _interchanged(pair, conditions, apriori_mm):
        raise NotComputableError(
            f"model {pair.name}: the photos are interchanged, the left one's points fit the right "
            "one's place"
        )
    without = _without(pair, conditions, bx, apriori_mm, 1)
    if without is not None:
        found = _finish(conditions, without[0].solution.state, direct=True)
        if found is not None and found.usable and not _far(found, without[0]):
            return found, ()
        return found, without[1]
    best = _best_of_grid(pair, conditions, bx, apriori_mm, direct)
    if best is not None and best.usable:
        return best, ()
    if len(pair.points) <= _PAIRS_UP_TO:
        without = _without(pair, conditions, bx, apriori_mm, 2)
        if without is not None:
            return best, without[1]
    return best, ()


def agreement(pair: Stereopair, tie_variance: TieVariance, apriori_mm: float) -> float | None:
    """Return F'PF [mm^2] where all rows of a pair agree, found from a single start; else None.

    Parameters
    ----------
    pair
        The measurements.
    tie_variance
        How the ties are weighted.
    apriori_mm
        A-priori sigma0 [mm].
    """
    conditions = ConditionEquations(pair, tie_variance)
    if not (conditions.first or conditions.x_index):
        return None
    found = _direct(pair, conditions, pair.base, FEW_ITERATIONS)
    if found is None or not _fits(pair, conditions, found, apriori_mm, least=1):
        return None
    return found.solution.sum_of_squares


def vertical_start(
    pair: Stereopair, conditions: ConditionEquations, bx: float | None
) -> ModelUnknowns:
    """Return the first approximation: tilts of the left photo, kappa from a plane similarity."""
    size = bx or abs(conditions.preceding_bx or 1.0)
    kappa = _similar_kappa(conditions)
    return ModelUnknowns(size, 0.0, 0.0, _kappa_rotation(kappa, pair.fixed.rotation))


def _direct(
    pair: Stereopair,
    conditions: ConditionEquations,
    bx: float | None,
    most: int = _MAX_ITERATIONS,
) -> FoundOrientation | None:
    return _finish(conditions, vertical_start(pair, conditions, bx), direct=True, most=most)


def _interchanged(pair: Stereopair, conditions: ConditionEquations, apriori_mm: float) -> bool:
    """Whether the model would fit the ties with left and right exchanged."""
    other = replace(pair, xl=pair.xr, xr=pair.xl, c_left=pair.c_right, c_right=pair.c_left)
    exchanged = ConditionEquations(other, conditions.tie_variance)
    found = _direct(other, exchanged, None)
    return found is not None and _fits(other, exchanged, found, apriori_mm)


def _far(found: FoundOrientation, agreed: FoundOrientation) -> bool:
    """Whether wrong points displace an orientation so far that its table misleads."""
    state, other = found.solution.state, agreed.solution.state
    turned = 0.5 * (float(np.einsum("ij,ij", state.rotation, other.rotation)) - 1.0)
    return (
        turned < cos(_FAR)
        or hypot(state.beta_y - other.beta_y, state.beta_z - other.beta_z) > _FAR
        or state.bx * other.bx < 0.0
    )


def _fits(
    pair: Stereopair,
    conditions: ConditionEquations,
    found: FoundOrientation,
    apriori_mm: float,
    least: int = 2,
) -> bool:
    """Whether a result is beyond doubt: it looks like an aerial model and its rows agree.

    `least`: the redundancy that says so.
    """
    freedom = conditions.row_count - (5 if conditions.first else 6)
    state = found.solution.state
    before = 0.0 if conditions.first else abs(conditions.preceding_bx or 0.0)
    return freedom >= least and bool(
        looks_right(
            square=found.solution.sum_of_squares / (freedom * apriori_mm**2),
            growth=abs(state.bx) / before if before else inf,
            in_front=found.in_front,
            tilt=_tilt(pair, state.rotation),
            slope=max(abs(state.beta_y), abs(state.beta_z)),
        )
    )


def looks_right(
    *,
    square: float | Array,
    growth: float | Array,
    in_front: float | Array,
    tilt: float | Array,
    slope: float | Array,
) -> bool | Bools:
    """Return whether what was found looks like an aerial model whose rows agree.

    Parameters
    ----------
    square
        Weighted sum of squared misclosures, over redundancy and the a-priori variance.
    growth
        abs(bx), over that of the preceding model; infinite where there is none.
    in_front
        Share of points in front of both photos.
    tilt
        Angle [rad] between the axes of the photos.
    slope
        The larger of abs(beta_y) and abs(beta_z).
    """
    return (
        (square < _ROUGH**2)
        # ties alone may put both photos into one place, from where everything agrees
        & (growth >= _NO_BASE)
        & (in_front >= IN_FRONT)
        & (tilt < _STEEP)
        & (slope < _SLOPE)
    )


def _without(
    pair: Stereopair,
    conditions: ConditionEquations,
    bx: float | None,
    apriori_mm: float,
    count: int,
) -> tuple[FoundOrientation, tuple[str, ...]] | None:
    """Leave out `count` points at a time; return the best orientation that the others agree on."""
    best: tuple[FoundOrientation, tuple[str, ...]] | None = None
    lowest = inf
    for left_out in combinations(pair.points, count):
        off = pair.off | {(point, axis) for point in left_out for axis in ("x", "y")}
        reduced = replace(pair, off=off)
        rest = ConditionEquations(reduced, conditions.tie_variance)
        if rest.row_count < (5 if rest.first else 6) + 2 or not (rest.first or rest.x_index):
            continue
        found = _direct(reduced, rest, bx, FEW_ITERATIONS)
        if found is None or not _fits(reduced, rest, found, apriori_mm):
            continue
        merit = found.solution.sum_of_squares
        if merit < lowest:
            best, lowest = (found, left_out), merit
    return best


def _best_of_grid(
    pair: Stereopair,
    conditions: ConditionEquations,
    bx: float | None,
    apriori_mm: float,
    direct: FoundOrientation | None,
) -> FoundOrientation | None:
    candidates: list[Candidate] = [] if direct is None else [(direct, pair, conditions)]
    across_pair = _turned(pair)
    across_conditions = ConditionEquations(across_pair, conditions.tie_variance)
    for state, across in _starts(pair, conditions, bx):
        frame = (across_pair, across_conditions) if across else (pair, conditions)
        other = _finish(frame[1], state)
        if other is not None:
            candidates.append((other._replace(across=across), *frame))
    if not candidates:
        return None
    merits = [_implausibility(item, apriori_mm) for item in candidates]
    best = _first_of_best(merits, range(len(merits)))
    along = [k for k, item in enumerate(candidates) if not item[0].across]
    if along:
        straight = _first_of_best(merits, along)
        if not merits[best] + _ACROSS_MARGIN * conditions.row_count < merits[straight]:
            best = straight
    return candidates[best][0]


def _first_of_best(merits: list[float], among: Sequence[int]) -> int:
    """Return the first of those that differ from the lowest by no more than the iteration does."""
    lowest = min(merits[k] for k in among)
    return next(k for k in among if not merits[k] > lowest + _SAME_MERIT)


def _implausibility(item: Candidate, apriori_mm: float) -> float:
    found, pair, conditions = item
    n = conditions.row_count
    misfit = n * log1p(found.solution.sum_of_squares / (n * apriori_mm**2))
    with np.errstate(all="ignore"):
        return misfit + _strangeness(pair, found, conditions.meet(found.solution.state).points[2])


def _strangeness(pair: Stereopair, found: FoundOrientation, depth: Array) -> float:
    """How little a result looks like aerial photography: tilts, base, relief, points behind.

    Flat terrain has two exact orientations; in the second one the terrain stands upright.
    """
    state = found.solution.state
    middle = float(np.median(depth))
    relief = float(np.median(np.abs(depth / middle - 1.0)))
    return float(
        (_tilt(pair, state.rotation) / 0.15) ** 2
        + (hypot(state.beta_y, state.beta_z) / 0.4) ** 2
        + (min(relief, 10.0) / 0.15) ** 2
        + 10.0 * len(depth) * (1.0 - found.in_front)
    )


def _finish(
    conditions: ConditionEquations,
    start: ModelUnknowns,
    *,
    direct: bool = False,
    most: int = _MAX_ITERATIONS,
) -> FoundOrientation | None:
    """Coplanarity first (where it suffices), then the sign and size of bx, then all conditions."""
    with np.errstate(all="ignore"):
        return _finished(conditions, start, direct, most)


def _finished(
    conditions: ConditionEquations, start: ModelUnknowns, direct: bool, most: int
) -> FoundOrientation | None:
    if conditions.first:
        solution = iterate(conditions, start, most=most)
        if solution is None:
            return None
        found = FoundOrientation.of(conditions, solution)
        share = found.in_front
        if share < IN_FRONT:
            # a base of the wrong sign fits as well: the points tell which it is
            mirrored = solution.state._replace(bx=-solution.state.bx)
            other = FoundOrientation.of(conditions, solution._replace(state=mirrored))
            if other.in_front > share:
                return other
        return found
    if not direct and len(conditions.y_index) >= 5:
        plane = iterate(conditions, start, ties=False)
        if plane is not None:
            start = plane.state
    size = conditions.bx_of_ties(start.beta_z, start.rotation)
    if size is None or size == 0.0:
        return None
    solution = iterate(conditions, ModelUnknowns(size, *start[1:]), most=most)
    if solution is None:
        return None
    return FoundOrientation.of(conditions, solution)


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


def _starts(
    pair: Stereopair, conditions: ConditionEquations, bx: float | None
) -> list[tuple[ModelUnknowns, bool]]:
    """Return promising starts, the best first: (state, whether the base lies across x).

    For a given rotation the coplanarity condition is linear in the base direction: the smallest
    eigenvector of the moment matrix of x' x x'' is the base, its eigenvalue the merit.
    """
    vertical = vertical_start(pair, conditions, bx)
    kappa = _similar_kappa(conditions)
    tilts = (-0.2, 0.0, 0.2)
    kappas = [kappa + d for d in (0.0, -0.35, 0.35)] + [0.0, 0.5, -0.5, 1.0, -1.0]
    grid = list(product(kappas, tilts, tilts))
    rotations = np.array(
        [_kappa_rotation(k, pair.fixed.rotation @ turn(o, p, 0.0)) for k, o, p in grid]
    )
    size = vertical.bx
    y = conditions.y_index
    if len(y) < 3:
        return [(vertical, False), *((ModelUnknowns(size, 0.0, 0.0, r), False) for r in rotations)]
    x1 = conditions.x1[:, y] / -conditions.x1[2, y]
    x2 = rotations @ conditions.p2[:, y]
    normal = np.cross(x1[None].swapaxes(1, 2), x2.swapaxes(1, 2))
    values, vectors = np.linalg.eigh(normal.swapaxes(1, 2) @ normal)
    order = np.argsort(values[:, 0], kind="stable")[:16].tolist()
    starts = [(vertical, False)]
    for k in order:
        x, y_, z = vectors[k, :, 0].tolist()
        across = abs(y_) > abs(x)
        along, side = (y_, -x) if across else (x, y_)
        rotation = _TURNED @ rotations[k] if across else rotations[k]
        if abs(z) > 2.0 * abs(along):
            starts.append((ModelUnknowns(size, 0.0, 0.0, rotations[k]), False))
        else:
            starts.append((ModelUnknowns(size, side / along, z / along, rotation), across))
    return starts
