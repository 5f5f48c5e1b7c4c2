"""Approximate values from nothing but image coordinates and control.

Strips that can be bridged come first; strips join over common points, photos in no strip are
resected to the points that exist by then. Where nothing can be bridged (close range, convergent or
rotated photos) control alone orients the photos, or else a pair oriented relative to each other
from any attitude is the seed. What has grown is laid onto all control at once.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from anaplot.aliases import Array, Bools, Index, Progress
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.problem import Problem, listed
from anaplot.bundle.solve.structure import make_structure
from anaplot.bundle.start.absolute import give_nominal_place, to_ground, to_some_ground
from anaplot.bundle.start.bridging import BRIDGING, Chain, bridged_chains, joined_chains
from anaplot.bundle.start.plane import grown_from_plane
from anaplot.bundle.start.robust import robust_state
from anaplot.bundle.start.seeds import PAIRS, PHOTOS, grown_from_seed
from anaplot.bundle.start.subblock import (
    SubBlock,
    intersect_rays,
    median_miss,
    rays_of_photos,
    unit_rays,
)
from anaplot.bundle.start.vertical import LEVEL, PLAINLY_LEVEL, vertical_subblock
from anaplot.bundle.start.viewgraph import view_graph
from anaplot.errors import NotComputableError

__all__ = [
    "SEARCHES",
    "LostPointsError",
    "Way",
    "approximate_ways",
    "completed_state",
    "doubtful",
    "extended_state",
    "grown_whole",
    "laid_onto_control",
    "restricted",
    "state_of",
]

SEARCHES = BRIDGING, PAIRS, PHOTOS
"""What the search for approximate values says of its progress."""


@dataclass(frozen=True, slots=True)
class Way:
    """A way to approximate values.

    Attributes
    ----------
    find
        Returns them; None where the way does not apply.
    tries
        Steps within which the minimum is reached from them, if they are right.
    """

    find: Callable[[Progress | None], BlockState | None]
    tries: int = 40


_LEVEL_TRIES = 10  # level photos lead there in seven steps, or go round corners in forty
_BELIEVED = 0.05  # share of c by which approximate orientations may miss, in the median
_STATED = 0.15  # the same, where all are stated and a few steps tell whether it leads anywhere
_DOUBTFUL = 0.02  # the same, from which a start often leads nowhere


def approximate_ways(problem: Problem) -> list[Way]:
    """Return the ways to approximate values, in the order in which to try them.

    What the block states; bridged strips; the photos as oblique ones of a plane, then as vertical
    ones; bridged strips together with pairs in any attitude; such pairs alone. A way returns None
    where it does not apply, and raises NotComputableError where it does not get through. Level
    photos whose rays miss by more than a fiftieth of c in the median, or that are not plainly
    level, come last of all; where few rays check them so do those that miss by less, unless robust
    steps from there orient them.
    """
    put_off: list[Callable[[Progress | None], SubBlock | None]] = []
    chains: list[Chain] = []  # of the strips, once they are bridged
    hang_together: list[BlockState] = []  # strips that need no pairs
    rays, by_photo = unit_rays(problem), rays_of_photos(problem)
    graph = cache(lambda: view_graph(problem))

    def seeded(among: Bools, progress: Progress | None) -> SubBlock | None:
        return grown_from_seed(problem, rays, by_photo, among, graph=graph(), progress=progress)

    def joined(free: list[SubBlock], progress: Progress | None) -> BlockState:
        return _joined(problem, rays, by_photo, free, progress, seeded)

    def stated(progress: Progress | None) -> BlockState | None:
        given = _given(problem, rays, _STATED)
        if given is None or not given[0].oriented.all():
            return None
        return state_of(problem, _completed(problem, given[0], rays, given[1]))

    def parts(progress: Progress | None) -> list[SubBlock]:
        if problem.block.strips and not chains:
            chains.extend(bridged_chains(problem, progress))
        return joined_chains(problem, rays, chains)

    def bridged(progress: Progress | None) -> BlockState | None:
        free = parts(progress)
        if not free:
            return None
        hang_together.append(_joined(problem, rays, by_photo, free, progress, seeded, others=False))
        return hang_together[0]

    def tilted(progress: Progress | None) -> BlockState | None:
        part = grown_from_plane(problem, rays, by_photo, progress, graph=graph())
        if part is None:
            return None
        return joined([part], progress)

    def level(progress: Progress | None) -> BlockState | None:
        subblock = vertical_subblock(problem, progress, reach=PLAINLY_LEVEL, graph=graph())
        if subblock is None:
            put_off.append(
                lambda then: vertical_subblock(problem, then, reach=LEVEL, graph=graph())
            )
            return None
        missed = _misses(problem, subblock)
        if not missed > _far(problem):
            return state_of(problem, subblock)
        oriented = None
        if missed <= _DOUBTFUL:
            # level over relief, or not level: robust steps tell, and cost less than pairs
            oriented = _oriented_from(problem, subblock, progress)
        if oriented is None:
            put_off.append(lambda _: subblock)
        return oriented

    def mixed(progress: Progress | None) -> BlockState | None:
        if hang_together:
            # the same has been tried
            return None
        free = parts(progress)
        if not free:
            return None
        return joined(free, progress)

    def paired(progress: Progress | None) -> BlockState | None:
        return joined([], progress)

    def hopeless(progress: Progress | None) -> BlockState | None:
        subblock = put_off.pop()(progress) if put_off else None
        return None if subblock is None else state_of(problem, subblock)

    return [
        Way(stated),
        Way(bridged),
        Way(tilted),
        Way(level, _LEVEL_TRIES),
        Way(mixed),
        Way(paired),
        Way(hopeless),
    ]


def doubtful(problem: Problem, start: BlockState) -> bool:
    """Whether the rays of a start miss by so much that few steps tell whether it leads anywhere."""
    subblock = SubBlock(start.centres, start.rotations, start.points)
    return _misses(problem, subblock) > _far(problem)


def _far(problem: Problem) -> float:
    """Return beyond which share of c rays miss by so much that a start often leads nowhere.

    Unknowns take up a share of any misfit: points of two rays fit photos that are anything but
    level, as only one of their four coordinates says so.
    """
    shown = np.sqrt(max(problem.redundancy, 1) / problem.observations)
    return _DOUBTFUL * float(shown)


def _oriented_from(
    problem: Problem, subblock: SubBlock, progress: Progress | None
) -> BlockState | None:
    """Return the robust solution that a complete subblock leads to; None where it orients not all.

    Mismatches, which bend least squares from any start, do not count.
    """
    start = state_of(problem, subblock)
    try:
        structure = make_structure(problem, start.centres)
        found = robust_state(problem, structure, start, progress=progress)
    except (NotComputableError, np.linalg.LinAlgError):
        return None
    return found.state if found.orients(problem) else None


def _misses(problem: Problem, subblock: SubBlock) -> float:
    """Return by which share of c rays miss their points, in the median; infinite without rays."""
    return median_miss(subblock.residuals(problem) / problem.c[problem.photo])


def _joined(
    problem: Problem,
    rays: Array,
    by_photo: list[Index],
    free: list[SubBlock],
    progress: Progress | None,
    seeded: Callable[[Bools, Progress | None], SubBlock | None],
    *,
    others: bool = True,
) -> BlockState:
    """Join parts over common points and control, and add what is not in them.

    With `others`, pairs in any attitude orient what does not hang together with that: `seeded`
    returns what grows from one of some photos.
    """
    given = _given(problem, rays)
    ground = SubBlock.empty(problem) if given is None else given[0]
    for subblock in free:
        if ground.oriented.any() and ground.join(subblock):
            continue
        if to_ground(problem, subblock):
            _merge(ground, subblock)
    if not ground.oriented.any():
        ground = _from_control(problem, by_photo)
        if not ground.oriented.any():
            part = free[0] if free else seeded(~ground.oriented, progress)
            if part is not None:
                ground = part
                if not to_ground(problem, ground):
                    give_nominal_place(problem, ground)
    _grow(problem, ground, rays, by_photo, free, progress)
    missing = np.nonzero(~ground.oriented)[0]
    if len(missing) and others:
        ground = _other_parts(problem, ground, rays, by_photo, progress, seeded)
        missing = np.nonzero(~ground.oriented)[0]
    if len(missing):
        raise _not_oriented(problem, ground, missing)
    return state_of(problem, _completed(problem, ground, rays))


def extended_state(problem: Problem, last: Problem, state: BlockState) -> BlockState | None:
    """Return the state of a smaller or earlier block, grown by what is new.

    Parameters
    ----------
    problem
        The bundle as it is now.
    last, state
        A bundle before and its solution, in the same system.

    Returns
    -------
    State or None
        None when something new cannot be placed from what is there.
    """
    rays, by_photo = unit_rays(problem), rays_of_photos(problem)
    subblock = _taken_over(problem, last, state)
    if not subblock.oriented.any():
        return None
    _grow(problem, subblock, rays, by_photo, [], None)
    if not subblock.oriented.all():
        return None
    kept = subblock.points.copy()
    known = np.isfinite(kept[:, 0])
    subblock = _completed(problem, subblock, rays)
    # adjusted coordinates are better than intersected ones
    subblock.points[known] = kept[known]
    found = state_of(problem, subblock)
    if len(state.shared) == problem.in_border:
        found = replace(found, shared=state.shared)
    return found


def laid_onto_control(
    problem: Problem, free: Problem, state: BlockState, *, some: bool = False
) -> BlockState | None:
    """Return a solution without datum laid onto control and stated positions.

    Parameters
    ----------
    problem
        The bundle with its datum.
    free, state
        A bundle of the same block without, which may lack some points and photos, and its solution.
    some
        Lay it on also where that does not determine all of a datum.

    Returns
    -------
    State or None
        None when control does not suffice, or what is lacking cannot be added.
    """
    subblock = _taken_over(problem, free, state)
    if not to_ground(problem, subblock):
        if not some:
            return None
        to_some_ground(problem, subblock)
    return grown_whole(problem, subblock)


def grown_whole(
    problem: Problem,
    subblock: SubBlock,
    others: Sequence[SubBlock] = (),
    otherwise: BlockState | None = None,
) -> BlockState | None:
    """Return a part of a block, grown by other parts and by photos.

    Photos that cannot be added are as `otherwise` has them; None where there is no such state, or
    none could be added.
    """
    rays, by_photo = unit_rays(problem), rays_of_photos(problem)
    before = int(subblock.oriented.sum())
    _grow(problem, subblock, rays, by_photo, others, None)
    missing = ~subblock.oriented
    if missing.any():
        if otherwise is None or len(missing) - missing.sum() == before:
            return None
        subblock.centres[missing] = otherwise.centres[missing] + otherwise.origin
        subblock.rotations[missing] = otherwise.rotations[missing]
    return state_of(problem, _completed(problem, subblock, rays))


def completed_state(problem: Problem, state: BlockState, kept: Bools) -> BlockState:
    """Return a state with all points placed by its photos, but for those that are kept.

    Parameters
    ----------
    problem, state
        The bundle, and where its photos are.
    kept
        (points,) those that stay where they are.
    """
    subblock = SubBlock(state.centres.copy(), state.rotations, state.points.copy())
    for part in (subblock.centres, subblock.points):
        part += state.origin
    subblock = _completed(problem, subblock, unit_rays(problem))
    points = np.where(kept[:, None] | problem.fixed, state.points, subblock.points - state.origin)
    return replace(state, points=points)


def restricted(smaller: Problem, problem: Problem, state: BlockState) -> BlockState:
    """Return the state of a bundle for another one with some of its photos and points."""
    subblock = _taken_over(smaller, problem, state)
    return state_of(smaller, subblock)


def _taken_over(problem: Problem, last: Problem, state: BlockState) -> SubBlock:
    """Return what another bundle has of this one's photos and points."""
    subblock = SubBlock.empty(problem)
    photos = {name: k for k, name in enumerate(last.photos)}
    points = {name: k for k, name in enumerate(last.points)}
    for k, name in enumerate(problem.photos):
        old = photos.get(name)
        if old is not None:
            subblock.centres[k] = state.centres[old] + state.origin
            subblock.rotations[k] = state.rotations[old]
    for k, name in enumerate(problem.points):
        old = points.get(name)
        if old is not None:
            subblock.points[k] = state.points[old] + state.origin
    return subblock


class LostPointsError(NotComputableError):
    """No approximate coordinates are found for points.

    Parameters
    ----------
    text
        What is said of it.
    subblock
        The photos, and the other points.

    Attributes
    ----------
    subblock
        As above.
    """

    def __init__(self, text: str, subblock: SubBlock) -> None:
        super().__init__(text)
        self.subblock = subblock


def state_of(problem: Problem, subblock: SubBlock) -> BlockState:
    """Return a complete subblock as the state of a bundle.

    Raises
    ------
    LostPointsError
        It is not complete.
    """
    points = np.where(problem.fixed, problem.known, subblock.points)
    lost = np.nonzero(~np.isfinite(points).all(axis=1))[0]
    if len(lost) or not bool(np.isfinite(subblock.centres).all()):
        raise LostPointsError(
            f"block {problem.block.name}: no approximate coordinates found for the points "
            f"{listed([problem.points[k] for k in lost.tolist()])}",
            subblock,
        )
    origin = np.round(points.mean(axis=0))
    return BlockState(
        centres=subblock.centres - origin,
        rotations=subblock.rotations,
        points=points - origin,
        own=np.zeros((len(problem.photos), problem.per_photo - 6)),
        shared=np.zeros(problem.in_border),
        origin=origin,
    )


def _given(
    problem: Problem, rays: Array, reach: float = _BELIEVED
) -> tuple[SubBlock, Array] | None:
    """Photos whose orientation the block states, when their rays meet within a share of c.

    And (points, 3) where they meet.
    """
    stated = np.isfinite(problem.position[:, 0]) & np.isfinite(problem.rotation[:, 0])
    if not stated.any():
        return None
    subblock = SubBlock.empty(problem)
    subblock.centres[stated] = problem.stated_centres[stated]
    subblock.rotations[stated] = problem.stated_rotations[stated]
    met = intersect_rays(problem, subblock, rays)
    known = np.isfinite(problem.near).all(axis=1, keepdims=True)
    subblock.points = np.where(known, problem.near, met)
    return None if _misses(problem, subblock) > reach else (subblock, met)


def _from_control(problem: Problem, by_photo: list[Index]) -> SubBlock:
    """Photos that see at least four full control points."""
    subblock = SubBlock.empty(problem)
    known = np.isfinite(problem.near).all(axis=1)
    subblock.points[known] = problem.near[known]
    subblock.add_photos(problem, by_photo)
    return subblock


def _grow(
    problem: Problem,
    ground: SubBlock,
    rays: Array,
    by_photo: list[Index],
    others: Sequence[SubBlock],
    progress: Progress | None,
) -> None:
    """Add photos, points and parts to the ground sub-block until nothing more can be added."""
    known = np.isfinite(problem.near).all(axis=1) & ~ground.placed
    if problem.datum == "control" and _in_ground(problem, ground):
        ground.points[known] = problem.near[known]
    waiting = [c for c in others if c is not ground and (c.oriented & ~ground.oriented).any()]
    while True:
        if progress is not None:
            progress(PHOTOS, float(ground.oriented.mean()))
        ground.place(problem, rays)
        joined = [c for c in waiting if ground.join(c)]
        waiting = [c for c in waiting if c not in joined]
        if joined:
            continue
        # of a strip that shares a line of points, a photo by itself would be worse oriented
        oriented = [c.oriented for c in waiting]
        apart = np.any(oriented, axis=0) if oriented else None
        if any(ground.add_photos(problem, by_photo, fewest, but=apart) for fewest in (5, 4)):
            continue
        hinged = next((c for c in waiting if ground.join(c, hinged=True)), None)
        if hinged is not None:
            waiting = [c for c in waiting if c is not hinged]
            continue
        if apart is None:
            break
        if not any(ground.add_photos(problem, by_photo, fewest) for fewest in (5, 4)):
            break


def _in_ground(problem: Problem, subblock: SubBlock) -> bool:
    """Whether the sub-block's points lie near the control they should coincide with."""
    both = np.isfinite(problem.near).all(axis=1) & subblock.placed
    if both.sum() < 3:
        return False
    off = np.linalg.norm(subblock.points[both] - problem.near[both], axis=1)
    return bool(np.median(off) < 0.2 * np.ptp(problem.near[both], axis=0).max())


def _other_parts(
    problem: Problem,
    ground: SubBlock,
    rays: Array,
    by_photo: list[Index],
    progress: Progress | None,
    seeded: Callable[[Bools, Progress | None], SubBlock | None],
) -> SubBlock:
    """Orient photos that do not hang together with the ground sub-block by themselves."""
    for _ in range(len(problem.photos)):
        missing = ~ground.oriented
        if not missing.any():
            break
        control = _from_control(problem, by_photo)
        new = control.oriented & missing
        if new.any():
            ground.centres[new] = control.centres[new]
            ground.rotations[new] = control.rotations[new]
            _grow(problem, ground, rays, by_photo, [], progress)
            continue
        # grown over all photos: what both have in common joins them
        part = seeded(missing, progress)
        if part is None:
            break
        if not ground.join(part):
            if not to_ground(problem, part):
                give_nominal_place(problem, part)
            _merge(ground, part)
        _grow(problem, ground, rays, by_photo, [], progress)
        if (~ground.oriented).sum() == missing.sum():
            break
    return ground


def _merge(ground: SubBlock, part: SubBlock) -> None:
    """Take up a part that is in the same system already."""
    photos, points = part.oriented & ~ground.oriented, part.placed & ~ground.placed
    ground.centres[photos] = part.centres[photos]
    ground.rotations[photos] = part.rotations[photos]
    ground.points[points] = part.points[points]


def _completed(
    problem: Problem, subblock: SubBlock, rays: Array, met: Array | None = None
) -> SubBlock:
    """Give every point coordinates: intersected, known, or on its ray.

    `met`: (points, 3) where the rays meet, if that is known already.
    """
    found = intersect_rays(problem, subblock, rays) if met is None else met
    good = np.isfinite(found[:, 0])
    subblock.points[good] = found[good]
    known = np.isfinite(problem.near)
    missing = ~subblock.placed
    behind = _behind(problem, subblock)
    lost = np.nonzero(missing | behind)[0].tolist()
    typical = _typical_depth(problem, subblock) if lost else 1.0
    for k in lost:
        ray = int(np.nonzero(problem.point == k)[0][0])
        photo = problem.photo[ray]
        direction = subblock.rotations[photo] @ rays[ray]
        along = typical
        if known[k, 2] and abs(direction[2]) > 1e-6:
            reach = (problem.near[k, 2] - subblock.centres[photo, 2]) / direction[2]
            along = reach if reach > 0.0 else along
        subblock.points[k] = subblock.centres[photo] + along * direction
    if problem.datum == "control":
        near = known & ~np.isnan(subblock.points)
        full = known.all(axis=1)
        # control with few rays is better known than intersected
        few = np.bincount(problem.point, minlength=len(problem.points)) < 2
        take = (full & few)[:, None] & near
        subblock.points = np.where(take, problem.near, subblock.points)
    return subblock


def _typical_depth(problem: Problem, subblock: SubBlock) -> float:
    """Return how far photos are from their points, in the median [m]."""
    away = subblock.points[problem.point] - subblock.centres[problem.photo]
    depths = np.linalg.norm(away, axis=1)
    return float(np.nanmedian(depths)) if np.isfinite(depths).any() else 1.0


def _behind(problem: Problem, subblock: SubBlock) -> Bools:
    """Points that lie behind most of their photos."""
    axes = np.ascontiguousarray(subblock.rotations[:, :, 2])
    away = subblock.points.take(problem.point, axis=0)
    away -= subblock.centres.take(problem.photo, axis=0)
    depth = -np.einsum("ni,ni->n", axes.take(problem.photo, axis=0), away)
    count = np.bincount(problem.point, minlength=len(problem.points))
    with np.errstate(invalid="ignore"):
        wrong = np.bincount(problem.point, depth <= 0.0, minlength=len(problem.points))
    return wrong > 0.5 * count


def _not_oriented(problem: Problem, ground: SubBlock, missing: Index) -> NotComputableError:
    placed = ground.placed
    counts = np.bincount(problem.photo[placed[problem.point]], minlength=len(problem.photos))
    names = [f"{problem.photos[k]} ({int(counts[k])} points known)" for k in missing.tolist()]
    return NotComputableError(
        f"block {problem.block.name}: no approximate orientation found for photo"
        f"{'s' * (len(names) > 1)} {listed(names)}: they share too few points with the others, or "
        "their measurements contradict each other"
    )
