"""From the system of a part of the block to the ground: control, stated positions and angles."""

from __future__ import annotations

import numpy as np

from anaplot.aliases import Array
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.start.subblock import SubBlock, common_similarity
from anaplot.photogrammetry.collinearity import project, turns
from anaplot.photogrammetry.rotation import rotation_matrix
from anaplot.photogrammetry.similarity import Similarity, fit_to_partial

__all__ = ["give_nominal_place", "to_ground", "to_some_ground", "turn_onto"]

_CLOSE = 1e-4  # step after which a similarity is refined: the bundle goes on
_BETTER = 0.5  # share of what another similarity leaves off, at most: noise alone is no reason
_CHECKED = 4  # places that check their similarity
_IN_LINE = 0.15  # width over length of places up to which they are nearly in line
_TURNS = 120  # about a line of control
_RAYS_AT_ONCE = 20_000  # turned and projected together


def to_ground(problem: Problem, subblock: SubBlock) -> bool:
    """Lay a sub-block onto control and stated positions.

    A similarity that most full points agree on, refined with all single coordinates; False when
    they do not suffice, the sub-block then stays as it is.
    """
    source, target = _both_places(problem, subblock)
    if len(source) == 0:
        return False
    full = np.isfinite(target).all(axis=1)
    start: Similarity | None = None
    found = common_similarity(source[full], target[full]) if full.any() else None
    if found is not None:
        start = found[0]
    candidates = [start] if start is not None else _level_starts(problem, subblock, source, target)
    if start is None and int(full.sum()) >= 2:
        candidates += _line_starts(source[full], target[full])
    best, best_size = None, float("inf")
    for candidate in candidates:
        refined = fit_to_partial(source, target, candidate, close=_CLOSE)
        if refined is None:
            continue
        off = np.abs(refined.apply(source) - target)
        size = float(np.nanmedian(off))
        if start is not None and int(full.sum()) > 3:
            # a refinement that wanders off from the full points is not believed
            before = float(np.nanmedian(np.abs(start.apply(source) - target)))
            if size > 3.0 * before + 1e-9:
                continue
        # flat ground seen from below fits as well: the first, which stands upright, counts then
        if size < _BETTER * best_size:
            best, best_size = refined, size
    if best is None:
        best = start
    if best is None or start is not None:
        # single coordinates have not closed the rotation about a line of full points
        turned = _about_the_line(problem, subblock, source[full], target[full], best)
        best = best if turned is None else turned
    if best is None:
        return False
    subblock.transform(best)
    return True


def to_some_ground(problem: Problem, subblock: SubBlock) -> None:
    """Lay a sub-block onto what is known where that leaves some of a similarity open.

    What is open stays as it is.
    """
    source, target = _both_places(problem, subblock)
    if len(source) == 0:
        return
    lean = next(iter(_known_turns(problem, subblock)), np.eye(3))
    fitted = fit_to_partial(source, target, Similarity(1.0, lean, np.zeros(3)), some=True)
    if fitted is not None:
        subblock.transform(fitted)


def _both_places(problem: Problem, subblock: SubBlock) -> tuple[Array, Array]:
    """Return places in the sub-block, (n, 3), and what is known of them; NaN where nothing is.

    Stated positions count where control leaves a similarity open, or nothing checks it.
    """
    near = problem.near
    x, y, z = np.isfinite(near).T
    placed = subblock.placed & (x | y | z)
    stated = subblock.oriented & np.isfinite(problem.position[:, 0])
    full = placed & x & y & z
    if stated.any() and _tell_one(subblock.points[full], near[full]):
        stated = np.zeros_like(stated)
    source = np.concatenate((subblock.points[placed], subblock.centres[stated]))
    return source, np.concatenate((near[placed], problem.stated_centres[stated]))


def _tell_one(source: Array, target: Array) -> bool:
    """Whether places tell one similarity, and check it: four agree that are not nearly in line."""
    found = common_similarity(source, target) if len(source) >= _CHECKED else None
    if found is None or found[1].sum() < _CHECKED:
        return False
    there = target[found[1]]
    spread = np.linalg.svd(there - there.mean(axis=0), compute_uv=False)
    return bool(spread[1] > _IN_LINE * spread[0])


def _known_turns(problem: Problem, subblock: SubBlock) -> list[Array]:
    """Return rotations from the sub-block to the ground by photos whose angles are stated."""
    stated = subblock.oriented & np.isfinite(problem.rotation[:, 0])
    return [
        rotation_matrix(*problem.rotation[k].tolist()) @ subblock.rotations[k].T
        for k in np.nonzero(stated)[0].tolist()[:5]
    ]


def _about_the_line(
    problem: Problem, subblock: SubBlock, source: Array, target: Array, start: Similarity | None
) -> Similarity | None:
    """Turn a sub-block about a line of control until the other control points' rays fit.

    Two points, or points nearly on a line, leave the rotation about the line open; control points
    that are measured but could not be intersected close it. None when there is nothing to do.
    """
    if len(source) < 2:
        return None
    spread = np.linalg.svd(target - target.mean(axis=0), compute_uv=False)
    if len(source) > 2 and spread[1] > _IN_LINE * spread[0]:
        return None
    near = problem.near
    x, y, z = np.isfinite(near).T
    use = np.nonzero(subblock.oriented[problem.photo] & (x & y & z)[problem.point])[0]
    start = _along_the_line(source, target) if start is None else start
    if start is None:
        return None
    if len(use) < 3:
        return start
    axis = np.linalg.svd(target - target.mean(axis=0))[2][0]
    middle = target.mean(axis=0)
    photo, c = problem.photo[use], problem.c[problem.photo[use]]
    centres, rotations = subblock.centres[photo], subblock.rotations[photo]
    ideal, there = problem.ideal[use], near[problem.point[use]]
    turned = turns(np.linspace(0.0, 2.0 * np.pi, _TURNS, endpoint=False)[:, None] * axis)
    rotation, shift = turned @ start.rotation, middle + turned @ (start.shift - middle)
    best, best_size = start, float("inf")
    # so many turns at once as keep the arrays small
    at_once = max(1, _RAYS_AT_ONCE // len(use))
    for first in range(0, _TURNS, at_once):
        part = slice(first, first + at_once)
        count = len(rotation[part])
        moved = start.scale * centres @ rotation[part].transpose(0, 2, 1) + shift[part, None]
        looking = (rotation[part, None] @ rotations).reshape(-1, 3, 3)
        every = np.tile(c, count)
        seen = project(moved.reshape(-1, 3), looking, every, np.tile(there, (count, 1)))
        miss = np.linalg.norm(seen.xy - np.tile(ideal, (count, 1)), axis=1)
        fits = (seen.depth > 0.0) & np.isfinite(miss)
        miss = np.where(fits, np.minimum(miss, every), 4.0 * every)
        for k, size in enumerate(miss.reshape(count, -1).sum(axis=1).tolist(), first):
            if size < best_size - 1e-9:
                best, best_size = Similarity(start.scale, rotation[k], shift[k]), size
    return best


def _along_the_line(source: Array, target: Array) -> Similarity | None:
    """Return a similarity that lays the two points farthest apart onto each other."""
    first = int(np.argmin(target[:, 0] + target[:, 1]))
    last = int(np.argmax(np.linalg.norm(target - target[first], axis=1)))
    a, b = source[last] - source[first], target[last] - target[first]
    lengths = float(np.linalg.norm(a)), float(np.linalg.norm(b))
    if min(lengths) <= 0.0:
        return None
    rotation = turn_onto(a / lengths[0], b / lengths[1])
    scale = lengths[1] / lengths[0]
    return Similarity(scale, rotation, target[first] - scale * rotation @ source[first])


def _line_starts(source: Array, target: Array) -> list[Similarity]:
    """Similarities on two points, turned about their line; single coordinates choose among them."""
    start = _along_the_line(source, target)
    if start is None:
        return []
    middle = target.mean(axis=0)
    axis = np.linalg.svd(target - middle)[2][0]
    found = []
    for angle in np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False).tolist():
        rotation = turns(angle * axis[None])[0]
        shift = middle + rotation @ (start.shift - middle)
        found.append(Similarity(start.scale, rotation @ start.rotation, shift))
    return found


def turn_onto(a: Array, b: Array) -> Array:
    """Return the shortest rotation (3, 3) that takes the unit vector a (3,) to b (3,)."""
    axis = np.cross(a, b)
    size = float(np.linalg.norm(axis))
    angle = float(np.arctan2(size, float(a @ b)))
    if size < 1e-12:
        axis, size = np.cross(a, np.eye(3)[int(np.argmin(np.abs(a)))]), 1.0
        axis /= np.linalg.norm(axis)
    out: Array = turns((angle / size * axis)[None])[0]
    return out


def _level_starts(
    problem: Problem, subblock: SubBlock, source: Array, target: Array
) -> list[Similarity]:
    """Similarities of a sub-block that stands upright, or whose photos have known angles."""
    starts: list[Similarity] = []
    plan = np.isfinite(target[:, :2]).all(axis=1)
    rotations = _known_turns(problem, subblock)
    if plan.sum() >= 2:
        s, t = source[plan], target[plan]
        for lean in rotations or [np.eye(3)]:
            turned = s @ lean.T
            a = (turned[:, 0] + 1j * turned[:, 1]) - (turned[:, 0] + 1j * turned[:, 1]).mean()
            b = (t[:, 0] + 1j * t[:, 1]) - (t[:, 0] + 1j * t[:, 1]).mean()
            size = float((np.abs(a) ** 2).sum())
            if size <= 0.0:
                continue
            factor = complex((b * a.conj()).sum() / size)
            scale, kappa = abs(factor), float(np.angle(factor))
            if scale <= 0.0:
                continue
            rotation = rotation_matrix(0.0, 0.0, kappa) @ lean
            shift = np.zeros(3)
            moved = scale * source @ rotation.T
            shift[:2] = (t - moved[plan])[:, :2].mean(axis=0)
            heights = np.isfinite(target[:, 2])
            if heights.any():
                shift[2] = float((target[heights, 2] - moved[heights, 2]).mean())
            starts.append(Similarity(scale, rotation, shift))
    return starts


def give_nominal_place(problem: Problem, subblock: SubBlock) -> None:
    """Give a sub-block without control a size like that of its control or of its own system."""
    both = np.isfinite(problem.near).all(axis=1) & subblock.placed
    if both.sum() == 0:
        return
    target = problem.near[both]
    shift = target.mean(axis=0) - subblock.points[both].mean(axis=0)
    subblock.transform(Similarity(1.0, np.eye(3), shift))
