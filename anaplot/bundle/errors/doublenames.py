"""One point under two names, and two points under one name, in an adjusted block.

What lies at the same place within the accuracy of its coordinates, and was never seen apart in
one photo, may be one point. A point whose rays meet in two places, some here and some there, may be
two. Either is tried: with the names put right the block is adjusted anew. That two names are one
point is a hypothesis of three conditions, and v'Pv grows by chi-square with 3 degrees of freedom if
it is true; that a point is two frees three unknowns, and v'Pv falls by as much if it is not.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations, islice, product
from typing import NamedTuple

import numpy as np

from anaplot.adjustment.watch import Watch
from anaplot.aliases import Array, Bools, Index
from anaplot.bundle.onward import adjust_onward
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.remade import laid_out_again
from anaplot.errors import InputError, NotComputableError
from anaplot.photogrammetry.block import ImagePoint

__all__ = ["DoubleName", "double_names"]

_ALPHA = 0.001  # of the tests of three conditions
_SIGMAS = 4.0  # two rays as near as that are one
_SPARSE = 0.25  # of the usual distance to the second neighbour: points less certain say nothing
_FEWEST = 3  # points that have two neighbours each
_WIDER = 36.0  # times the square up to which points may be one: how many are neighbours by chance
_BY_CHANCE = 0.025  # of as many as near in a good block, with a common photo or without
_MOST = 4  # of either kind that are tried
_MOST_DOUBTED = 30  # points whose rays are parted, the largest residuals first
_MOST_RAYS = 16  # of a point whose rays are parted
_MOST_CUBES = 1e12  # from the middle: rounding is no part of one
_CUBE_NUMBER = np.array([1, 2_654_435_761, 805_459_861_000_003])
_ROUNDING = 3.0 * float(np.finfo(float).eps)  # of rays that all but coincide
_ALIKE = 1e-9
_ALONE = 9.0  # times the misfit of two points: what one ray left out explains is one gross error


class DoubleName(NamedTuple):
    """Names that do not tell points apart, or rays that one name does not hold together.

    Attributes
    ----------
    points
        Two names of one point; or the one name of two.
    rays
        Of a name that is two points: photos of the rays that meet elsewhere; else ().
    statistic, critical
        Change of v'Pv by putting the names right, against chi-square with 3 degrees of freedom: by
        how much it grows with one name for two, and falls with two for one; None where the block
        has no solution with one.
    sigma0
        Of the block with the names put right.
    """

    points: tuple[str, ...]
    rays: tuple[str, ...]
    statistic: float | None
    critical: float
    sigma0: float | None

    @property
    def text(self) -> str:
        """One sentence."""
        if not self.rays:
            first, second = self.points
            return (
                f"{first} and {second} are one point under two names? With one name v'Pv grows by "
                f"{self.statistic:.1f} (below {self.critical:.1f}: nothing tells them apart)"
            )
        where = f"photo{'s' if len(self.rays) > 1 else ''} {', '.join(self.rays)}"
        said = f"{self.points[0]} is two points under one name? Its rays of {where} meet elsewhere"
        if self.statistic is None:
            return f"{said}; with two names there is a solution"
        fall = f"v'Pv falls by {self.statistic:.1f} (critical {self.critical:.1f})"
        return f"{said}; with two names {fall}"


def double_names(block: AdjustedBlock, watch: Watch | None = None) -> tuple[DoubleName, ...]:
    """Return the points under two names, and those that are two under one.

    Parameters
    ----------
    block
        The block; rays that it was adjusted without are taken for those of another point first.
    watch
        Told of every name that is tried; where it asks for the end, no more are.
    """
    from scipy.special import chdtri

    watch = Watch() if watch is None else watch
    critical = float(chdtri(3.0, _ALPHA))
    found: list[DoubleName] = []
    done: set[str] = set()
    for names in islice(_near(block, critical), _MOST):
        if watch.stopped:
            break
        if done.isdisjoint(names):
            watch("double names", 0.0)
            one = _merged(block, *names, critical)
            if one is not None:
                found.append(one)
                done.update(names)
    for point, rays in islice(_parted(block), _MOST):
        if watch.stopped:
            break
        watch("double names", 0.5)
        two = _split(block, point, rays, critical)
        if two is not None:
            found.append(two)
    return tuple(found)


def _near(block: AdjustedBlock, critical: float) -> Iterator[tuple[str, str]]:
    """Yield the names of what lies at one place and is never seen apart, the nearest first.

    Where points are dense some lie as near by chance: how many tell those a little farther apart.
    """
    problem = block.problem
    at, q = block.state.points, block.cofactors.points
    sound = np.flatnonzero(np.isfinite(at).all(axis=1) & np.isfinite(q).all(axis=(1, 2)))
    if len(sound) < _FEWEST:
        return
    q = q * max(block.sigma0 or 1.0, 1.0) ** 2
    reach = np.sqrt(critical * np.linalg.eigvalsh(q[sound])[:, -1])
    if not _may_meet(at[sound], reach):
        return
    from scipy.spatial import cKDTree  # half as long to load as NumPy, and seldom needed

    tree = cKDTree(at[sound])
    # the second one: points may stand in twos
    certain = reach < _SPARSE * float(np.median(tree.query(at[sound], k=[3])[0]))
    sound, reach = sound[certain], reach[certain]
    if len(sound) < 2:
        return
    tree, most = cKDTree(at[sound]), 2.0**0.5 * float(reach.max())
    floor = 1e-6 * np.median(np.trace(q[sound], axis1=1, axis2=2)) * np.eye(3)

    def pairs(wider: float) -> tuple[Index, Array]:
        """Return (n, 2) points, and what parts them: squares up to so many times the critical."""
        i, j = tree.query_pairs(wider**0.5 * most, output_type="ndarray").T
        off = at[sound[i]] - at[sound[j]]
        # beyond that no square is as small
        some = np.einsum("ni,ni->n", off, off) <= 1.01 * wider * (reach[i] ** 2 + reach[j] ** 2)
        first, second, off = sound[i[some]], sound[j[some]], off[some, :, None]
        square = np.einsum("nij,nij->n", off, np.linalg.solve(q[first] + q[second] + floor, off))
        meant = square <= wider * critical
        return np.column_stack((first, second))[meant], square[meant]

    near, squares = pairs(1.0)
    gaps = [
        (square, problem.points[i], problem.points[j], i, j)
        for (i, j), square in zip(near.tolist(), squares.tolist(), strict=True)
        if not _seen_apart(block, _rays_of(block, i), _rays_of(block, j))
    ]
    if not gaps:
        return
    gaps.sort()
    around, beyond = pairs(_WIDER)
    around = around[beyond > critical]
    together = _common_photo(block, np.array([gap[3:] for gap in gaps]))
    # on a surface as many pairs have squares up to s by chance as have some from s to 2 s
    every, parted = (
        count / (_WIDER - 1.0) / critical
        for count in (len(around), int(np.count_nonzero(~_common_photo(block, around))))
    )
    for alike, density in ((False, parted), (True, every)):
        mine = [gap for gap, both in zip(gaps, together.tolist(), strict=True) if both is alike]
        expected = density * np.array([gap[0] for gap in mine])
        told = np.flatnonzero(_as_many(np.arange(1, len(mine) + 1), expected) <= _BY_CHANCE)
        for _, first, second, *_ in mine[: int(told[-1]) + 1 if len(told) else 0]:
            yield first, second


def _as_many(counts: Index, expected: Array) -> Array:
    """Return the probabilities of counts as large, of Poisson variables with these means."""
    from scipy.special import pdtrc

    return np.asarray(pdtrc(counts - 1, expected))


def _common_photo(block: AdjustedBlock, pairs: Index) -> Bools:
    """Return which of (n, 2) points are in one photo."""
    from scipy.sparse import csr_array

    problem = block.problem
    shape = len(problem.points), len(problem.photos)
    seen = csr_array((np.ones(len(problem.point)), (problem.point, problem.photo)), shape=shape)
    both: Array = np.asarray(seen[pairs[:, 0]].multiply(seen[pairs[:, 1]]).sum(axis=1))
    return both.ravel() > 0.0


def _may_meet(at: Array, reach: Array) -> bool:
    """Whether any two of (n, 3) points that are certain enough may lie within their (n,) reach.

    Two points no farther apart than an edge lie in one cube of twice that edge, in one of eight
    grids that are half a cube off each other. Which points are certain hangs on the distance to
    the second neighbour; along an axis the farther one of those on either side is no nearer.
    """
    order = np.argsort(at[:, 0], kind="stable")
    steps = np.linalg.norm(np.diff(at[order], axis=0), axis=1)
    farther = np.maximum(np.append(steps, np.inf), np.append(np.inf, steps))
    certain = reach < _SPARSE * (1.0 + _ALIKE) * float(np.median(farther))
    places = at[certain] - at.mean(axis=0)
    if len(places) < 2:
        return False
    edge = 1.01 * 2.0**0.5 * float(reach[certain].max())  # and what rounding takes
    if not edge * _MOST_CUBES > float(np.abs(places).max()):
        return True
    for shift in product((0.0, edge), repeat=3):
        cubes = np.floor((places + shift) / (2.0 * edge)).astype(np.int64)
        # the same cube has the same number; that another one has it, too, does no harm
        if len(np.unique(cubes @ _CUBE_NUMBER)) < len(places):
            return True
    return False


def _rays_of(block: AdjustedBlock, point: int) -> list[int]:
    """Return the rays of a point: a problem has them side by side."""
    first, last = np.searchsorted(block.problem.point, (point, point + 1)).tolist()
    return list(range(first, last))


def _seen_apart(block: AdjustedBlock, first: list[int], second: list[int]) -> bool:
    """Whether two names were measured in one photo, in different places."""
    problem = block.problem
    near = _SIGMAS * 2.0**0.5
    for i in first:
        for j in second:
            if problem.photo[i] == problem.photo[j]:
                off = np.abs(problem.xy[i] - problem.xy[j]) / problem.sigma_xy[i]
                if np.any(off > near):
                    return True
    return False


def _merged(block: AdjustedBlock, first: str, second: str, critical: float) -> DoubleName | None:
    """Return two names that may be one point, by the adjustment with one of them."""
    rows = _without_rejected(block)
    given = {c.point for c in block.problem.block.control}
    given |= {prior.point for prior in block.problem.block.priors}
    given |= {name for one in block.problem.block.conditions for name in one.points}
    carried = block.problem.block.given
    if carried is not None:
        given |= {one.owner for one in carried.names if one.kind == "point"}
    if {first, second} <= given:
        return None
    kept, gone = (second, first) if second in given else (first, second)
    held = {(r.photo, r.model) for r in rows if r.point == kept}
    named = [
        replace(r, point=kept) if r.point == gone else r
        for r in rows
        if r.point != gone or (r.photo, r.model) not in held
    ]
    right = _adjusted(block, named)
    if right is None:
        return None
    grown = right.vtpv - block.vtpv
    if grown > critical:
        return None
    return DoubleName((first, second), (), max(grown, 0.0), critical, right.sigma0)


def _parted(block: AdjustedBlock) -> Iterator[tuple[str, frozenset[int]]]:
    """Yield points whose rays meet in two places, with those of the smaller part."""
    problem = block.problem
    rejected = np.zeros(len(problem.point), dtype=np.bool_)
    if problem.rejected is not None:
        rejected |= problem.rejected.any(axis=1)
    doubted = np.flatnonzero(rejected | np.asarray(block.flagged).any(axis=1))
    size: dict[int, float] = {}
    for ray in doubted.tolist():
        point = int(problem.point[ray])
        large = np.inf if rejected[ray] else float(np.nanmax(np.abs(block.v[ray])))
        size[point] = max(size.get(point, 0.0), large)
    for point in sorted(size, key=lambda k: -size[k])[:_MOST_DOUBTED]:
        mine = _rays_of(block, point)
        if 4 <= len(mine) <= _MOST_RAYS and (parts := _parts(block, mine)):
            yield problem.points[point], parts


def _parts(block: AdjustedBlock, rays: list[int]) -> frozenset[int] | None:
    """Return the smaller of two parts of a point's rays that meet by themselves, or None."""
    problem, state = block.problem, block.state
    photo = problem.photo[rays]
    xy, c = problem.ideal[rays], problem.c[photo]
    direction = np.einsum(
        "nij,nj->ni", state.rotations[photo], np.column_stack([xy, -np.broadcast_to(c, len(rays))])
    )
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    across = np.eye(3) - direction[:, :, None] * direction[:, None, :]
    centres = state.centres[photo]
    right = np.einsum("nij,nj->ni", across, centres)

    def met(parts: Array) -> tuple[Array, Array]:
        """Return where the rays of (..., n) parts meet, and how far every ray misses [rad^2]."""
        normal = np.tensordot(parts, across, axes=1)
        # by its axes: rays from one photo leave one of them nearly open, and err along it only
        values, axes = np.linalg.eigh(normal)
        along = np.einsum("...ij,...i->...j", axes, parts @ right)
        sound = values > _ROUNDING * values[..., -1:]
        along = np.divide(along, values, out=np.zeros_like(along), where=sound)
        at = axes @ along[..., None]
        away = at[..., None, :, 0] - centres
        by = np.einsum("nij,...nj->...ni", across, away)
        with np.errstate(invalid="ignore", divide="ignore"):
            off = (by**2).sum(axis=-1) / (away**2).sum(axis=-1)
        return at, np.nan_to_num(off, nan=np.inf)

    def misfit(parts: Array) -> Array:
        return np.asarray(np.where(parts > 0.0, met(parts)[1], 0.0).sum(axis=-1))

    # the rays nearest to where two of them meet, two and more, and the others
    pairs = np.array(
        [np.eye(len(rays))[[i, j]].sum(0) for i, j in combinations(range(len(rays)), 2)]
    )
    rank = np.argsort(np.argsort(met(pairs)[1], axis=1), axis=1)
    counts = np.arange(2, len(rays) - 1)
    parts = (rank[:, None] < counts[:, None]).astype(float).reshape(-1, len(rays))
    both = misfit(parts) + misfit(1.0 - parts)
    best = float(both.min())
    noise = len(rays) * float(np.median(problem.sigma_xy) / np.median(c)) ** 2
    alone = float(misfit(1.0 - np.eye(len(rays))).min())
    if alone < _ALONE * max(best, noise):
        return None
    # of those that differ by rounding the first
    part = parts[int(np.flatnonzero(both <= best * (1.0 + _ALIKE))[0])] > 0.0
    smaller = part if part.sum() < len(rays) / 2 else ~part
    return frozenset(rays[k] for k in np.flatnonzero(smaller).tolist())


def _split(
    block: AdjustedBlock, point: str, rays: frozenset[int], critical: float
) -> DoubleName | None:
    """Return a name that is two points, by the adjustment with two names."""
    problem = block.problem
    names = set(problem.points)
    other = f"{point}'"
    while other in names:
        other += "'"
    mine = {int(problem.source[ray]) for ray in rays}
    whole = list(problem.block.image_points)
    rows = _without_rejected(block)
    # of this point nothing is left out: two names explain all of its rays, or none
    rows = [whole[k] if r.point == point else r for k, r in enumerate(rows)]
    before = block.vtpv
    if problem.rejected is not None:
        with_all = _adjusted(block, rows)
        before = np.inf if with_all is None else with_all.vtpv
    right = _adjusted(
        block, [replace(r, point=other) if k in mine else r for k, r in enumerate(rows)]
    )
    if right is None:
        return None
    parted = np.isin([right.problem.points[k] for k in right.problem.point], (point, other))
    fallen = before - right.vtpv
    if right.flagged[parted].any() or not fallen > critical:
        return None
    photos = tuple(dict.fromkeys(whole[k].photo for k in sorted(mine)))
    statistic = float(fallen) if np.isfinite(fallen) else None
    return DoubleName((point,), photos, statistic, critical, right.sigma0)


def _without_rejected(block: AdjustedBlock) -> list[ImagePoint]:
    """Return the image points with what the block was adjusted without as off."""
    problem = block.problem
    rows = list(problem.block.image_points)
    if problem.rejected is not None:
        for ray in np.flatnonzero(problem.rejected.any(axis=1)).tolist():
            axes = {axis for axis, out in zip("xy", problem.rejected[ray], strict=True) if out}
            k = int(problem.source[ray])
            rows[k] = replace(rows[k], use=rows[k].use_without(axes))
    return rows


def _adjusted(block: AdjustedBlock, rows: list[ImagePoint]) -> AdjustedBlock | None:
    problem = block.problem
    changed = replace(problem.block, image_points=tuple(rows))
    try:
        return adjust_onward(laid_out_again(problem, changed), block)
    except (NotComputableError, InputError):
        return None
