"""Approximate values of vertical photographs: a plane block of photos turned, scaled and shifted.

Over level ground a vertical photo is a similar image of it, x + iy -> alpha (x + iy) + tau in the
complex plane (Anblock). Turned images, any flight pattern and few points per photo do no harm:
two common points tie two photos, and control in plan ties what has no common points at all.
Relief and tilts of a few degrees are errors of a few millimetres that the bundle takes care of.
"""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree
from scipy.sparse.linalg import MatrixRankWarning, spsolve

from anaplot.aliases import Array, Complex, Index, Progress
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.start.subblock import SubBlock
from anaplot.bundle.start.viewgraph import ViewGraph, view_graph
from anaplot.photogrammetry.rotation import rotation_matrix

__all__ = ["LEVEL", "PLAINLY_LEVEL", "vertical_subblock"]


LEVEL, PLAINLY_LEVEL = 0.12, 0.04
"""Median misfits of two photos, as shares of c, above which they are not level, or not plainly: of
photos flown level in our tests it is up to .025."""

_NEIGHBOURS = 10  # pairs of each photo, those with most common points
_ROUNDS = 8
_DENSE = 200  # unknowns up to which equations are solved as a full matrix
_OF_EDGES, _OF_PLACES = 0.25, 0.15  # of the work: pairs of photos, and their first places
_HOLD = 1e-3  # weight that keeps the factor of a photo
_TRIALS = 60
_PAIRED = 48  # points that are paired with each other at most


class _Edge(NamedTuple):
    """w_i = ratio w_j + shift for two photos."""

    i: int
    j: int
    ratio: complex
    weight: float
    misfit: float


class _Rays(NamedTuple):
    """One complex image coordinate for each photo and point."""

    photo: Index
    point: Index
    w: Complex


def vertical_subblock(
    problem: Problem,
    progress: Progress | None = None,
    *,
    reach: float = LEVEL,
    graph: ViewGraph | None = None,
) -> SubBlock | None:
    """Orient all photos as vertical ones.

    With the datum "control", in the ground system as far as control in plan and stated positions
    determine that; else in a system with the mean scale of the photos.

    Parameters
    ----------
    problem
        The bundle.
    progress
        Called with what is being done and the fraction of it.
    reach
        Share of c by which points of two such photos may miss each other, in the median.
    graph
        The view graph, where it is known.

    Returns
    -------
    SubBlock or None
        None when the photos are not images of level ground seen from above.
    """

    def say(share: float) -> None:
        if progress is not None:
            progress("laying photos level", share)

    say(0.0)
    rays = _rays(problem)
    edges = _edges(problem, rays, view_graph(problem) if graph is None else graph, say)
    if not edges:
        return None
    if float(np.median([edge.misfit for edge in edges])) > reach * float(np.median(problem.c)):
        return None
    n = len(problem.photos)
    # photos of different cameras differ in scale by their c at equal heights: that is in alpha
    alpha, part = _synchronised(n, edges)
    plan, heights = _control_in_plan(problem)
    tau, z = _positions(rays, alpha, len(problem.points), say)
    if problem.datum == "control" and int(np.isfinite(plan).sum()) >= 2:
        alpha, tau, z = _onto_control(rays, alpha, tau, z, part, plan, say)
    return _subblock(problem, alpha, tau, z, heights)


def _rays(problem: Problem) -> _Rays:
    p = len(problem.points)
    key, inverse, count = np.unique(
        problem.photo * p + problem.point, return_inverse=True, return_counts=True
    )
    x, y = problem.ideal.T
    w = np.bincount(inverse, x) + 1j * np.bincount(inverse, y)
    return _Rays(key // p, key % p, w / count)


def _edges(
    problem: Problem, rays: _Rays, graph: ViewGraph, say: Callable[[float], None]
) -> list[_Edge]:
    """Similarities between the photos that have most points in common."""
    wanted = graph.strongest_of_each(_NEIGHBOURS).tolist()
    n = len(problem.photos)
    ends = np.searchsorted(rays.photo, np.arange(n + 1))
    found = []
    for done, (i, j) in enumerate(wanted):
        say(_OF_EDGES * done / len(wanted))
        a, b = slice(ends[i], ends[i + 1]), slice(ends[j], ends[j + 1])
        _, at_i, at_j = np.intersect1d(
            rays.point[a], rays.point[b], assume_unique=True, return_indices=True
        )
        edge = _edge(i, j, rays.w[a][at_i], rays.w[b][at_j], float(problem.c[j]))
        if edge is not None:
            found.append(edge)
    return found


def _edge(i: int, j: int, first: Complex, second: Complex, c: float) -> _Edge | None:
    """Least median of squares over pairs of points, then least squares over who agrees."""
    ratio, distance = _median_similarity(second, first)
    if ratio is None:
        return None
    n = len(first)
    limit = 2.5 * float(np.sort(distance)[min(n - 1, max(n // 2, 2))]) + 0.01 * c
    good = distance <= limit
    if good.sum() >= 2:
        s = second[good] - second[good].mean()
        t = first[good] - first[good].mean()
        spread = float((np.abs(s) ** 2).sum())
        if spread > 0.0:
            ratio = complex((t * s.conj()).sum() / spread)
            size = float(np.sqrt(np.mean(np.abs(t - ratio * s) ** 2)))
            if abs(ratio) <= 0.0:
                return None
            trust = 1.0 if good.sum() > 2 else 0.1
            return _Edge(i, j, ratio, trust * spread / c**2, size if good.sum() > 2 else 0.0)
    return None


def _median_similarity(source: Complex, target: Complex) -> tuple[complex | None, Array]:
    """Return the ratio of the plane similarity most points agree on, and all distances from it."""
    n = len(source)
    some = np.unique(np.linspace(0.0, n - 1.0, min(n, _PAIRED)).astype(np.intp))
    first, second = (some[at] for at in np.triu_indices(len(some), 1))
    if len(first) > _TRIALS:
        # the pairs farthest apart, which say most
        far = np.argsort(-np.abs(source[first] - source[second]), kind="stable")[: 2 * _TRIALS : 2]
        first, second = first[far], second[far]
    apart = source[second] - source[first]
    good = np.abs(apart) > 1e-9 * (1.0 + np.abs(source).max(initial=0.0))
    if not good.any():
        return None, np.empty(0)
    first, second, apart = first[good], second[good], apart[good]
    ratio = (target[second] - target[first]) / apart
    shift = 0.5 * (target[first] + target[second] - ratio * (source[first] + source[second]))
    distance = np.abs(ratio[:, None] * source + shift[:, None] - target)
    # two points always agree: at least one more must
    middle = np.partition(distance, min(n - 1, max(n // 2, 2)), axis=1)[
        :, min(n - 1, max(n // 2, 2))
    ]
    middle = np.where(np.abs(ratio) > 0.0, middle, np.inf)
    best = int(np.argmin(middle))
    if not middle[best] < np.inf:
        return None, np.empty(0)
    return complex(ratio[best]), distance[best]


def _synchronised(n: int, edges: list[_Edge]) -> tuple[Complex, Index]:
    """Factors alpha_j = alpha_i ratio_ij of all photos, and the part each belongs to.

    Along the strongest edges first, then the logarithms of all edges together, with Cauchy's
    weights against edges that are wrong.
    """
    i = np.array([edge.i for edge in edges])
    j = np.array([edge.j for edge in edges])
    ratio = np.log(np.array([edge.ratio for edge in edges], dtype=np.complex128))
    weight = np.array([edge.weight for edge in edges])
    weight = np.minimum(weight / np.median(weight), 4.0) + 1e-6
    cost = sparse.coo_matrix((1.0 / weight, (i, j)), shape=(n, n)).tocsr()
    tree = minimum_spanning_tree(cost)
    tree = (tree + tree.T).tocsr()
    part = connected_components(tree, directed=False)[1].astype(np.intp)
    known = {(int(a), int(b)): r for a, b, r in zip(i, j, ratio, strict=True)}
    log = np.zeros(n, dtype=np.complex128)
    for label in range(int(part.max()) + 1):
        root = int(np.nonzero(part == label)[0][0])
        order, before = breadth_first_order(tree, root, directed=False)
        for k in order[1:].tolist():
            b = int(before[k])
            log[k] = log[b] + (known[b, k] if (b, k) in known else -known[k, b])
    roots = [int(np.nonzero(part == label)[0][0]) for label in range(int(part.max()) + 1)]
    hold = np.zeros(n)
    hold[roots] = 1.0
    robust = np.ones(len(edges))
    for _ in range(_ROUNDS):
        off = ratio - (log[j] - log[i])
        off = off.real + 1j * np.angle(np.exp(1j * off.imag))
        scale = max(2.0 * float(np.median(np.abs(off))), 0.02)
        robust = weight / (1.0 + (np.abs(off) / scale) ** 2)
        log = log + _laplace(n, i, j, robust, off, hold)
    for label in range(int(part.max()) + 1):
        log[part == label] -= log[part == label].real.mean()
    return np.exp(log), part


def _laplace(
    n: int,
    i: Index,
    j: Index,
    weight: Array,
    off: Complex,
    hold: Array,
    *,
    photos: int | None = None,
) -> Complex:
    """Least squares of x_j - x_i = off; the unknowns after `photos` are of points."""
    matrix = sparse.coo_matrix(
        (
            np.concatenate((weight, weight, -weight, -weight, hold)),
            (
                np.concatenate((i, j, i, j, np.arange(n))),
                np.concatenate((i, j, j, i, np.arange(n))),
            ),
        ),
        shape=(n, n),
    ).tocsc()
    right = np.zeros(n, dtype=np.complex128)
    np.add.at(right, j, weight * off)
    np.add.at(right, i, -weight * off)
    return _solved(matrix, right, n if photos is None else photos)


def _solved(matrix: sparse.csc_matrix, right: Complex, photos: int) -> Complex:
    """Solve Hermitian equations whose unknowns after `photos` are of points.

    No point has an equation with another: they are eliminated one by one, and what is left is as
    small as the number of photos, however many rays there are. Where all of it is small, it is
    solved at once.
    """
    if len(right) <= _DENSE:
        with contextlib.suppress(np.linalg.LinAlgError):
            return np.asarray(np.linalg.solve(matrix.toarray(), right), dtype=np.complex128)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MatrixRankWarning)
        rows = matrix.tocsr()
        own, tie = rows[:photos, :photos], rows[:photos, photos:]
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = 1.0 / matrix.diagonal()[photos:]
        half = (tie @ sparse.diags(inverse)).tocsr()
        reduced = (own - half @ tie.conj().T).tocsc()
        first = spsolve(reduced, right[:photos] - half @ right[photos:], permc_spec="MMD_AT_PLUS_A")
        first = np.nan_to_num(np.asarray(first, dtype=np.complex128))
        last = inverse * (right[photos:] - tie.conj().T @ first)
    return np.concatenate((first, np.nan_to_num(last)))


def _positions(
    rays: _Rays, alpha: Complex, points: int, say: Callable[[float], None]
) -> tuple[Complex, Complex]:
    """Shifts of the photos and points in plan from all rays; alpha is given."""
    n = len(alpha)
    m = len(rays.w)
    away = alpha[rays.photo] * rays.w
    graph = sparse.coo_matrix(
        (np.ones(m), (rays.photo, n + rays.point)), shape=(n + points, n + points)
    )
    label = connected_components(graph, directed=False)[1]
    hold = np.zeros(n + points)
    hold[np.unique(label, return_index=True)[1]] = 1.0
    i, j = rays.photo, n + rays.point
    x = np.zeros(n + points, dtype=np.complex128)
    weight = np.ones(m)
    for done in range(_ROUNDS):
        say(_OF_EDGES + _OF_PLACES * done / _ROUNDS)
        off = away - (x[j] - x[i])
        x = x + _laplace(n + points, i, j, weight, off, hold, photos=n)
        size = np.abs(away - (x[j] - x[i]))
        scale = max(3.0 * float(np.median(size)), 1e-9)
        weight = 1.0 / (1.0 + (size / scale) ** 2)
    return x[:n], x[n:]


def _control_in_plan(problem: Problem) -> tuple[Complex, Array]:
    """(points + photos,) plan coordinates, NaN where unknown, and known ground heights."""
    at = np.concatenate((problem.near, problem.position))
    plan = at[:, 0] + 1j * at[:, 1]
    heights = problem.near[:, 2]
    return plan, heights[np.isfinite(heights)]


def _onto_control(
    rays: _Rays,
    alpha: Complex,
    tau: Complex,
    z: Complex,
    part: Index,
    plan: Complex,
    say: Callable[[float], None],
) -> tuple[Complex, Complex, Complex]:
    """Lay every part onto control in plan, then adjust all factors, shifts and points together."""
    n, p = len(alpha), len(z)
    alpha, tau, z = alpha.copy(), tau.copy(), z.copy()
    label = np.full(p, -1)
    label[rays.point] = part[rays.photo]
    is_known = np.isfinite(plan)
    middle = complex(np.mean(plan[is_known]))
    laid = np.zeros(int(part.max()) + 1, dtype=bool)
    factors = np.zeros(len(laid), dtype=np.complex128)
    ground = np.full(p, np.nan, dtype=np.complex128)
    for k in np.argsort(-np.bincount(part), kind="stable").tolist():
        mine = np.unique(rays.point[part[rays.photo] == k])
        photos = np.nonzero(part == k)[0]
        # each part in its own system: its points from its own photos alone
        own = rays.photo[part[rays.photo] == k]
        at = rays.point[part[rays.photo] == k]
        here = np.full(p, np.nan, dtype=np.complex128)
        sums = np.bincount(at, minlength=p)
        value = alpha[own] * rays.w[part[rays.photo] == k] + tau[own]
        with np.errstate(invalid="ignore", divide="ignore"):
            here = np.bincount(at, value.real, minlength=p) / sums + 1j * (
                np.bincount(at, value.imag, minlength=p) / sums
            )
        target = np.where(is_known[:p], plan[:p], ground)
        use = mine[np.isfinite(target[mine])]
        stations = photos[is_known[p + photos]]
        source = np.concatenate((here[use], tau[stations]))
        goal = np.concatenate((target[use], plan[p + stations]))
        if len(source) < 2:
            continue
        ratio, distance = _median_similarity(source, goal)
        if ratio is None:
            continue
        good = distance <= 2.5 * float(np.median(distance)) + 1e-12
        good |= distance <= np.sort(distance)[min(len(distance) - 1, 1)]
        s, t = source[good] - source[good].mean(), goal[good] - goal[good].mean()
        spread = float((np.abs(s) ** 2).sum())
        if spread <= 0.0:
            continue
        ratio = complex((t * s.conj()).sum() / spread)
        if abs(ratio) <= 0.0:
            continue
        shift = goal[good].mean() - ratio * source[good].mean()
        alpha[photos] *= ratio
        tau[photos] = ratio * tau[photos] + shift
        laid[k], factors[k] = True, ratio
        new = mine[~np.isfinite(ground[mine])]
        ground[new] = ratio * here[new] + shift
    if not laid.any():
        return alpha, tau, z
    typical = float(np.median(np.abs(factors[laid])))
    for k in np.nonzero(~laid)[0].tolist():
        photos = np.nonzero(part == k)[0]
        alpha[photos] *= typical
        tau[photos] = typical * (tau[photos] - tau[photos].mean()) + middle
    z = np.where(np.isfinite(ground), ground, middle)
    return _together(rays, alpha, tau, z, plan, middle, n, p, say)


def _together(
    rays: _Rays,
    alpha: Complex,
    tau: Complex,
    z: Complex,
    plan: Complex,
    middle: complex,
    n: int,
    p: int,
    say: Callable[[float], None],
) -> tuple[Complex, Complex, Complex]:
    """Least squares of w = (z - tau) / alpha over all rays and control, with Cauchy's weights.

    Misfits count in the image, where a photo cannot shrink away from what contradicts it. Weak
    observations hold every alpha near the value it has: they matter where nothing else does.
    """
    m = len(rays.w)
    photo, point = rays.photo, rays.point
    known = np.nonzero(np.isfinite(plan))[0]
    of_photo = known >= p
    typical = 1.0 / float(np.median(np.abs(alpha)))
    reach = float(np.sqrt(np.mean(np.abs(rays.w) ** 2)))
    turn, z = 1.0 / alpha, z - middle
    shift = -(tau - middle) * turn
    goal = plan[known] - middle
    count = m + len(known)
    rows = np.concatenate((np.tile(np.arange(m), 3), np.arange(m, count + n)))
    column = np.where(of_photo, n + known - p, 2 * n + known)
    columns = np.concatenate((photo, n + photo, 2 * n + point, column, np.arange(n)))
    for done in range(_ROUNDS):
        before = _OF_EDGES + _OF_PLACES
        say(before + (1.0 - before) * done / _ROUNDS)
        seen = turn[photo] * z[point] + shift[photo]
        stated = np.where(of_photo, known - p, 0)
        station = np.where(of_photo, goal * turn[stated] + shift[stated], 0.0)
        off = np.where(of_photo, -station, typical * (goal - z[np.where(of_photo, 0, known)]))
        misfit = np.concatenate((rays.w - seen, off))
        values = np.concatenate(
            (
                seen,
                np.ones(m),
                turn[photo],
                np.where(of_photo, 1.0, typical),
                np.full(n, reach),
            )
        )
        design = sparse.coo_matrix(
            (values, (rows, columns)), shape=(count + n, 2 * n + p), dtype=np.complex128
        ).tocsr()
        size = np.abs(misfit)
        scale = max(3.0 * float(np.median(size[:m])), 1e-9 * reach)
        weight = np.concatenate(
            (
                1.0 / (1.0 + (size[:m] / scale) ** 2),
                1.0 / (1.0 + (size[m:] / (3.0 * scale)) ** 2),
                np.full(n, _HOLD),
            )
        )
        half = sparse.diags(weight) @ design
        normal = (design.conj().T @ half).tocsc()
        # a unit of the image, so that nothing is without any hold
        hold = 1e-9 * sparse.diags(
            np.concatenate((np.full(n, reach**2), np.ones(n), np.full(p, typical**2)))
        )
        step = _solved((normal + hold).tocsc(), half[:count].conj().T @ misfit, 2 * n)
        if not np.isfinite(step).all() or float(np.abs(step[:n]).max(initial=0.0)) > 1.0:
            break
        growth = np.exp(step[:n])
        turn, shift = turn * growth, shift * growth + step[n : 2 * n]
        z = z + step[2 * n :]
    return 1.0 / turn, -shift / turn + middle, z + middle


def _subblock(
    problem: Problem, alpha: Complex, tau: Complex, z: Complex, heights: Array
) -> SubBlock:
    subblock = SubBlock.empty(problem)
    above = problem.c * np.abs(alpha)
    flown = problem.position[:, 2] - above
    if problem.datum == "control" and len(heights):
        ground = float(np.median(heights))
    elif problem.datum == "control" and np.isfinite(flown).any():
        ground = float(np.nanmedian(flown))
    else:
        ground = 0.0
    subblock.centres = np.column_stack((tau.real, tau.imag, ground + above))
    subblock.rotations = np.array([rotation_matrix(0.0, 0.0, k) for k in np.angle(alpha).tolist()])
    subblock.points = np.column_stack((z.real, z.imag, np.full(len(z), ground)))
    if problem.datum == "control":
        known = np.isfinite(problem.near[:, 2])
        subblock.points[known, 2] = problem.near[known, 2]
    return subblock
