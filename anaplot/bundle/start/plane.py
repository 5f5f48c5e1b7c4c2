"""A part of a block whose object is flat: what all its photos say of one plane.

Two photos of a plane fit each other in two ways, and through a long lens, where rays are nearly
parallel, in many more. What all of them say together is clear: a homography leads from the plane's
image in one photo to that in another, and squares in the plane are squares in every photo that is
turned back. The tilt of the plane against one photo, two unknowns, is sought where they are.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array, Index, Progress
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.start.seeds import rays_of_common_points, spread
from anaplot.bundle.start.subblock import SubBlock, median_miss
from anaplot.bundle.start.viewgraph import ViewGraph, view_graph

__all__ = ["grown_from_plane"]

_FEWEST = 8  # common points of two photos, of which a homography takes four
_PHOTOS = 8  # that tell of the plane beside the first, at most
_SIGMAS, _RELIEF = 5.0, 2e-3  # by which points of a plane miss, and share of the image's size
_TILTS, _AZIMUTHS = np.radians(np.arange(3.0, 79.0, 6.0)), 24
_REFINED = 12  # tilts that are refined
_STEPS = 10
_SAME = 0.03  # by which tilts differ that are the same [rad]
_TRIED = 3  # of them
_BASE = 0.02  # between two photos, as a share of the distance of the plane
_ROUNDS = 4  # of weights of a homography
_SAMPLES = 60  # of four points each, where so many points are wrong that weights do not do
_AHEAD = 0.02  # cosine at least at which a photo looks at the plane
_TILTED = 0.15  # of a plane against photos, in the median [rad]
_CLEARLY = 3.0  # times worse a plane's other tilts fit


class _Flat(NamedTuple):
    """Photos beside a first one, and (v, 3, 3) from its rays to theirs: q ~ H p.

    And those of its rays that lie on the plane, as one of the others shows.
    """

    photos: list[int]
    homographies: Array
    rays: Index


class _Homography(NamedTuple):
    """H with q ~ H p, rays in front of both photos.

    And what it misses in the median, the size of q and (n,) what the points miss, as shares of c.
    """

    matrix: Array
    off: float
    size: float
    misses: Array

    def fits(self, sigma: float) -> bool:
        """Whether points of such a sigma, a share of c, lie on a plane."""
        return self.off <= self.reach(sigma)

    def reach(self, sigma: float) -> float:
        """Return by how much points of a plane may miss."""
        return _SIGMAS * sigma + _RELIEF * self.size


def grown_from_plane(
    problem: Problem,
    rays: Array,
    by_photo: list[Index],
    progress: Progress | None = None,
    *,
    graph: ViewGraph | None = None,
) -> SubBlock | None:
    """Return what grows from photos of a plane.

    Parameters
    ----------
    problem
        The bundle.
    rays
        (m, 3) rays of unit length in image axes.
    by_photo
        The rays of each photo.
    progress
        Called with what is being done and the fraction of it.
    graph
        The view graph, where it is known.

    Returns
    -------
    SubBlock or None
        None where fewer than three photos show that the object is flat, and where they look
        straight at it: these are level photos.
    """
    graph = view_graph(problem) if graph is None else graph
    every = np.ones(len(problem.photos), dtype=bool)
    strongest = graph.strongest(_FEWEST, every)
    if not len(strongest):
        return None
    first = int(strongest[0, 0])
    flat = _flat_neighbours(problem, rays, by_photo, graph, first)
    if len(flat.photos) < 2:
        return None
    parts = []
    for normal in _normals(flat.homographies, rays[flat.rays]):
        part = _seen_from(problem, first, flat, normal)
        part.place(problem, rays)
        against = part.rotations[[first, *flat.photos], :, 2] @ -normal
        parts.append((median_miss(part.residuals(problem)), float(np.median(against)), part))
    parts.sort(key=lambda one: one[0])
    if not parts or parts[0][1] > np.cos(_TILTED):
        return None
    best: SubBlock | None = None
    least = float("inf")
    for error, _, part in parts[:_TRIED]:
        if best is not None and error > _CLEARLY * parts[0][0]:
            break
        spread(problem, part, rays, by_photo, ~every, progress)
        grown = median_miss(part.residuals(problem))
        if grown < least:
            best, least = part, grown
    return best


def _flat_neighbours(
    problem: Problem, rays: Array, by_photo: list[Index], graph: ViewGraph, first: int
) -> _Flat:
    """Return the photos with most points in common with one that show them on a plane.

    None where the first of them taken from elsewhere does not.
    """
    ends = graph.pairs == first
    mine = np.flatnonzero(ends.any(axis=1) & (graph.common >= _FEWEST))
    mine = mine[np.argsort(-graph.common[mine], kind="stable")][:_PHOTOS]
    photos: list[int] = []
    found: list[Array] = []
    shown: list[Index] = []
    for k in mine.tolist():
        other = int(graph.pairs[k].sum()) - first
        one, two = rays_of_common_points(problem, by_photo, np.array([first, other]))
        sigma = float(np.median(problem.sigma[two]) / problem.c[other])
        homography = _homography(rays[one], rays[two], sigma)
        if not homography.fits(sigma):
            if not photos:
                break
            continue
        stretch = np.linalg.svd(homography.matrix, compute_uv=False)
        if stretch[0] < (1.0 + _BASE) * stretch[2]:
            # taken from the same place it shows the same of any object
            continue
        photos.append(other)
        found.append(homography.matrix)
        shown.append(one[homography.misses <= _SIGMAS * homography.reach(sigma)])
    on_plane = np.unique(np.concatenate(shown)) if shown else by_photo[first][:0]
    return _Flat(photos, np.array(found).reshape(-1, 3, 3), on_plane)


def _homography(p: Array, q: Array, sigma: float) -> _Homography:
    """Return what leads from (n, 3) rays p to q, of which a minority may be wrong."""
    found = _weighted_homography(p, q)
    if found.fits(sigma):
        return found
    # mismatches far beyond the object have more leverage than weights take from them
    misses = _sampled_misses(p, q)
    agree = misses <= max(_SIGMAS * float(np.median(misses)), 1e-12)
    if agree.all():
        return found
    less = _weighted_homography(p[agree], q[agree])
    misses = np.full(len(p), np.inf)
    misses[agree] = less.misses
    again = less._replace(misses=misses, off=float(np.median(misses)))
    return again if again.off < found.off else found


def _sampled_misses(p: Array, q: Array) -> Array:
    """(n,) misses as shares of c: least median over homographies of four points each."""
    _, a = _normalised(p)
    to_q, b = _normalised(q)
    four = np.argsort(np.random.default_rng(0).random((_SAMPLES, len(p))), axis=1)[:, :4]
    rows = _conditions(a[four], b[four])
    h = np.linalg.eigh(np.matmul(rows.transpose(0, 2, 1), rows))[1][:, :, 0].reshape(-1, 3, 3)
    seen = np.matmul(a, h.transpose(0, 2, 1))
    with np.errstate(divide="ignore", invalid="ignore"):
        off = np.linalg.norm(seen[:, :, :2] / seen[:, :, 2:] - b[:, :2], axis=2)
    off = np.nan_to_num(off, nan=np.inf)
    best = off[int(np.argmin(np.median(off, axis=1)))]
    return np.asarray(best / float(to_q[0, 0]))


def _conditions(a: Array, b: Array) -> Array:
    """(..., 2 n, 9) conditions of q ~ H p, linear in H, of (..., n, 3) points."""
    zero = np.zeros_like(a)
    return np.concatenate(
        (
            np.concatenate((a, zero, -b[..., :1] * a), axis=-1),
            np.concatenate((zero, a, -b[..., 1:2] * a), axis=-1),
        ),
        axis=-2,
    )


def _weighted_homography(p: Array, q: Array) -> _Homography:
    """Return a homography from all points; those that miss by far lose their weight (Cauchy)."""
    to_p, a = _normalised(p)
    to_q, b = _normalised(q)
    weight, depth = np.ones(len(p)), np.ones(len(p))
    conditions = _conditions(a, b)
    for _ in range(_ROUNDS):
        rows = np.tile(np.sqrt(weight) / depth, 2)[:, None] * conditions
        h = np.linalg.eigh(rows.T @ rows)[1][:, 0].reshape(3, 3)
        seen = a @ h.T
        depth = seen[:, 2]
        off = np.linalg.norm(seen[:, :2] / depth[:, None] - b[:, :2], axis=1)
        middle = float(np.median(off))
        weight = 1.0 / (1.0 + (off / max(2.0 * middle, 1e-12)) ** 2)
    out = np.linalg.inv(to_q) @ h @ to_p
    out *= np.sign(np.median(np.einsum("ni,ni->n", q, p @ out.T)))
    scale = float(to_q[0, 0])
    matrix = out / np.cbrt(abs(np.linalg.det(out)))
    return _Homography(matrix, middle / scale, np.sqrt(2.0) / scale, off / scale)


def _normalised(rays: Array) -> tuple[Array, Array]:
    """Return (3, 3) from rays to image coordinates about their middle, and these (n, 3)."""
    xy = rays[:, :2] / -rays[:, 2:]
    middle = xy.mean(axis=0)
    scale = np.sqrt(2.0) / max(float(np.sqrt(((xy - middle) ** 2).sum(axis=1).mean())), 1e-12)
    to = np.array(
        [[scale, 0.0, scale * middle[0]], [0.0, scale, scale * middle[1]], [0.0, 0.0, -1.0]]
    )
    seen = rays @ to.T
    return to, seen / seen[:, 2:]


def _normals(homographies: Array, rays: Array) -> list[Array]:
    """Return what may be the plane's normal in axes of the first photo, (3,) unit vectors.

    Towards the plane: n . X = 1 holds for its points. Those that fit best first.
    """
    tilt, around = np.meshgrid(_TILTS, 2.0 * np.pi * np.arange(_AZIMUTHS) / _AZIMUTHS)
    x, y = (np.sin(tilt) * np.cos(around)).ravel(), (np.sin(tilt) * np.sin(around)).ravel()
    normals = np.column_stack((x, y, -np.cos(tilt).ravel()))
    normals = normals[(rays @ normals.T > _AHEAD).all(axis=0)]
    if not len(normals):
        return []
    cost = _cost(_bent(homographies, normals))
    normals = normals[np.argsort(cost, kind="stable")[:_REFINED]]
    damping = np.full(len(normals), 1e-3)
    for _ in range(_STEPS):
        u, v = _along(normals)
        e = _bent(homographies, normals)
        slopes = np.stack(
            [(_bent(homographies, _unit(normals + 1e-5 * side)) - e) / 1e-5 for side in (u, v)],
            axis=2,
        )
        scale = 2.0 * np.median(np.abs(e), axis=1)[:, None] + 1e-9
        half = (slopes / (1.0 + (e / scale) ** 2)[:, :, None]).transpose(0, 2, 1)
        matrix = np.matmul(half, slopes)
        held = (damping * (np.trace(matrix, axis1=1, axis2=2) + 1e-12))[:, None, None] * np.eye(2)
        step = -np.linalg.solve(matrix + held, np.matmul(half, e[:, :, None]))[:, :, 0]
        step /= np.maximum(np.linalg.norm(step, axis=1) / 0.2, 1.0)[:, None]
        trial = _unit(normals + step[:, :1] * u + step[:, 1:] * v)
        better = _cost(_bent(homographies, trial), scale) <= _cost(e, scale)
        normals = np.where(better[:, None], trial, normals)
        damping = np.clip(damping * np.where(better, 0.2, 10.0), 1e-9, 1e6)
    order = np.argsort(_cost(_bent(homographies, normals)), kind="stable")
    found: list[Array] = []
    for k in order.tolist():
        ahead = float((rays @ normals[k]).min()) > 0.0
        if ahead and all(float(normals[k] @ other) < np.cos(_SAME) for other in found):
            found.append(normals[k])
    return found


def _bent(homographies: Array, normals: Array) -> Array:
    """(k, 2 v) by how much squares in planes of (k, 3) normals are none any more in v photos."""
    u, v = _along(normals)
    one, other = (np.einsum("vij,kj->kvi", homographies, side) for side in (u, v))
    a, b, d = ((x * y).sum(axis=2) for x, y in ((one, one), (one, other), (other, other)))
    return np.concatenate(((a - d) / (a + d), 2.0 * b / (a + d)), axis=1)


def _cost(e: Array, scale: Array | float = 0.05) -> Array:
    """(k,) how badly (k, n) misclosures fit."""
    return np.asarray(np.log1p((e / scale) ** 2).sum(axis=1))


def _along(normals: Array) -> tuple[Array, Array]:
    """(k, 3) unit vectors in the planes of (k, 3) normals, at right angles to each other."""
    x, _, z = normals.T
    u = _unit(np.column_stack((-z, np.zeros(len(z)), x)))
    return u, np.cross(normals, u)


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1)[:, None])


def _seen_from(problem: Problem, first: int, flat: _Flat, normal: Array) -> SubBlock:
    """Return the photos as a plane of such a normal in the first one's axes has them."""
    part = SubBlock.empty(problem)
    part.centres[first], part.rotations[first] = 0.0, np.eye(3)
    u, v = (side[0] for side in _along(normal[None]))
    for photo, homography in zip(flat.photos, flat.homographies, strict=True):
        one, other = homography @ u, homography @ v
        scale = np.sqrt((one @ one + other @ other) / 2.0)
        # H = R + t n' is R for what lies in the plane
        turned = np.column_stack((one, other, np.cross(one, other) / scale)) / scale
        left, _, right = np.linalg.svd(turned @ np.stack((u, v, normal)))
        rotation = left @ right
        shift = homography @ normal / scale - rotation @ normal
        part.centres[photo], part.rotations[photo] = -rotation.T @ shift, rotation.T
    return part
