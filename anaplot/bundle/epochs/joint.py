"""Epochs in one bundle: laid out, adjusted, and the displacements in it (Gruen 1978, D3)."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.sparse import csr_array

from anaplot.aliases import Array, Progress
from anaplot.bundle.adjust import adjust_bundle
from anaplot.bundle.epochs.common import Common, Epochs
from anaplot.bundle.epochs.moves import Move
from anaplot.bundle.solve.additional import AdditionalParameters, Scope
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.crosscofactors import function_cofactors
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.laidparameters import groups_of_photos
from anaplot.bundle.solve.namedpoints import point_numbers, point_places
from anaplot.bundle.solve.problem import Datum, Problem, make_problem
from anaplot.errors import InputError
from anaplot.photogrammetry.block import (
    Block,
    Camera,
    ControlPoint,
    ImagePoint,
    Photo,
    Precision,
    Strip,
)
from anaplot.photogrammetry.similarity import Similarity, fit_similarity
from anaplot.textfiles.wording import hint, quoted

__all__ = ["adjust_jointly", "joint_block", "joint_displacements", "progress_of"]


def _mark(epochs: Iterable[int], count: int) -> str:
    """Return what the names of some epochs end in: every name does, so that no two can meet."""
    numbers = sorted(epochs)
    if len(numbers) == count > 1:
        return " [both]" if count == 2 else " [all]"
    return f" [{','.join(str(k + 1) for k in numbers)}]"


def _point_mark(name: str, epoch: int, common: Common, count: int) -> str:
    whole = common.whole(name)
    return _mark(whole if epoch in whole else (epoch,), count)


def joint_block(
    blocks: Sequence[Block],
    common: Common,
    *,
    control: bool = True,
    shares: Mapping[str, int] | None = None,
    used: Sequence[Collection[int]] | None = None,
    epoch_strips: bool = False,
    same_cameras: bool = True,
) -> Block:
    """Return all epochs as one block, names marked by " [1]", " [2]" and, of two, " [both]".

    Parameters
    ----------
    blocks
        The epochs.
    common
        Its points that are one in all coordinates are one point.
    control
        Whether the other epochs' control is taken besides the first's.
    shares
        Control points that are a point in each of some epochs, and in how many: each with that
        share of the weight, so that once they are held equal (`joint_displacements`), their
        observations are the one that was made.
    used
        Rows of image points that take part; None: all.
    epoch_strips
        Make each epoch one strip.
    same_cameras
        Let cameras that are declared alike be one.

    Raises
    ------
    InputError
        Positions or angles have unknowns in common.
    """
    count = len(blocks)
    shifted = next((block.name for block in blocks if block.offsets is not None), None)
    if shifted is not None:
        raise InputError(
            f"block {shifted}: [gnss] and [imu] are of one epoch, not of several in one "
            "adjustment: --separate"
        )
    parts = shares or {}
    cameras: dict[str, Camera] = {}
    photos: list[Photo] = []
    strips: list[Strip] = []
    rows: list[ImagePoint] = []
    controls: dict[str, ControlPoint] = {}
    for k, block in enumerate(blocks):
        mark = _mark((k,), count)
        named = {
            c.id: c.id + _mark(_alike(blocks, c) if same_cameras else (k,), count)
            for c in block.cameras
        }
        for camera in block.cameras:
            cameras.setdefault(named[camera.id], replace(camera, id=named[camera.id]))
        photos += [replace(p, id=p.id + mark, camera=named[p.camera]) for p in block.photos]
        if epoch_strips:
            strips.append(Strip(f"epoch{mark}", tuple(p.id + mark for p in block.photos)))
        else:
            strips += [
                replace(s, id=s.id + mark, photos=tuple(p + mark for p in s.photos))
                for s in block.strips
            ]
        chosen = range(len(block.image_points)) if used is None else sorted(used[k])
        measured = tuple(block.image_points)
        for at in chosen:
            row = measured[at]
            sigma = block.precision.image_um if row.sigma_um is None else row.sigma_um
            point = row.point + _point_mark(row.point, k, common, count)
            rows.append(replace(row, photo=row.photo + mark, point=point, sigma_um=sigma))
        if k > 0 and not control:
            continue
        for given in block.control:
            if given.use == "off":
                continue
            name = given.point + _point_mark(given.point, k, common, count)
            wide = parts.get(given.point, 1) ** 0.5
            x, y, z = (
                None if value is None else wide * sigma
                for value, sigma in zip(given.xyz, block.sigma_of(given), strict=True)
            )
            controls.setdefault(name, replace(given, point=name, sigma=(x, y, z)))
    first = blocks[0]
    *others, last = (block.name for block in blocks)
    return Block(
        name=f"{', '.join(others)} and {last}",
        precision=Precision(first.precision.image_um, first.precision.tie_variance),
        test=first.test,
        cameras=tuple(cameras.values()),
        photos=tuple(photos),
        strips=tuple(strips),
        image_points=tuple(rows),
        control=tuple(controls.values()),
    )


def _of_all(
    additional: AdditionalParameters, alone: Sequence[AdjustedBlock], block: Block, scope: Scope
) -> AdditionalParameters:
    """Return parameters with the priors of a group for what it is called in the joint block."""
    called: dict[str, dict[str, None]] = {}
    for k, one in enumerate(alone):
        photos, mark = one.problem.photos, _mark((k,), len(alone))
        own = groups_of_photos(one.problem.block, additional.scope, photos)
        joint = groups_of_photos(block, scope, [photo + mark for photo in photos])
        for name, there in zip(own, joint, strict=True):
            called.setdefault(name, {})[there] = None
    priors = []
    for prior in additional.priors:
        if prior.group is not None and prior.group not in called:
            raise InputError(
                f"the prior of {quoted(prior.parameter)}: no {additional.scope} "
                f"{quoted(prior.group)} in any epoch{hint(prior.group, called)}"
            )
        groups = [None] if prior.group is None else called[prior.group]
        priors += [prior._replace(group=group) for group in groups]
    return replace(additional, priors=tuple(priors))


def _alike(blocks: Sequence[Block], camera: Camera) -> Epochs:
    """Return the epochs in which a camera is declared so."""
    return frozenset(k for k, block in enumerate(blocks) if camera in block.cameras)


def adjust_jointly(
    alone: Sequence[AdjustedBlock],
    common: Common,
    shares: Mapping[str, int],
    datum: Datum,
    additional: AdditionalParameters | None,
    *,
    same: bool,
    progress: Progress | None = None,
) -> AdjustedBlock:
    """Adjust epochs in one bundle, from the approximate values of their own adjustments.

    Parameters
    ----------
    alone
        The epochs, each adjusted by itself.
    common
        Its points have one set of coordinates; in a free datum the epochs are laid onto the first
        by them.
    shares
        As `joint_block` has it.
    datum
        "control" or "free".
    additional
        Additional parameters.
    same
        Whether all epochs have the same ones.
    progress
        Called with what is being done and the fraction of it.

    Raises
    ------
    InputError
        A camera of common parameters is declared differently.
    NotComputableError
        All together are not determined.
    """
    blocks = [one.problem.block for one in alone]
    per_epoch = additional is not None and not same and additional.scope == "block"
    own_cameras = additional is not None and not same and additional.scope == "camera"
    if same:
        _check_cameras(blocks)
    block = joint_block(
        blocks,
        common,
        control=datum == "control",
        shares=shares,
        used=[set(one.problem.source.tolist()) for one in alone],
        epoch_strips=per_epoch,
        same_cameras=not own_cameras,
    )
    if additional is not None:
        scope: Scope = "strip" if per_epoch else additional.scope
        additional = replace(_of_all(additional, alone, block, scope), scope=scope)
    problem = make_problem(block, datum=datum, additional=additional)
    fitted: list[Similarity | None] = [None] * len(alone)
    if datum == "free":
        origin, held = alone[0].state.origin, common.points()
        target = point_places(alone[0], held, origin)
        fitted[1:] = [fit_similarity(point_places(b, held, origin), target) for b in alone[1:]]
    start = _start(problem, alone, fitted, common)
    part = "both epochs" if len(alone) == 2 else "all epochs"
    return adjust_bundle(problem, start, progress=progress_of(part, progress))


def _check_cameras(blocks: Sequence[Block]) -> None:
    declared: dict[str, Camera] = {}
    for block in blocks:
        for camera in block.cameras:
            if declared.setdefault(camera.id, camera) != camera:
                which = "two epochs" if len(blocks) == 2 else "epochs"
                raise InputError(
                    f"camera {camera.id} is declared differently in the {which}: common "
                    "parameters need the same camera"
                )


def progress_of(part: str, progress: Progress | None) -> Progress | None:
    """Return what tells the steps of a part as such."""
    if progress is None:
        return None
    return lambda what, share: progress(f"{part}: {what}", share)


def _start(
    problem: Problem,
    alone: Sequence[AdjustedBlock],
    fitted: Sequence[Similarity | None],
    common: Common,
) -> BlockState:
    """Approximate values from the epochs' own adjustments; the first epoch that has one counts."""
    origin, count = alone[0].state.origin, len(alone)
    centres: dict[str, Array] = {}
    rotations: dict[str, Array] = {}
    points: dict[str, Array] = {}
    for k, (block, onto) in reversed(list(enumerate(zip(alone, fitted, strict=True)))):
        state, names = block.state, block.problem
        shift = state.origin - origin
        at_photos, at_points = state.centres + shift, state.points + shift
        turned = state.rotations
        if onto is not None:
            at_photos, at_points = onto.apply(at_photos), onto.apply(at_points)
            turned = onto.rotation @ turned
        mark = _mark((k,), count)
        centres.update((n + mark, v) for n, v in zip(names.photos, at_photos, strict=True))
        rotations.update((n + mark, v) for n, v in zip(names.photos, turned, strict=True))
        for n, v in zip(names.points, at_points, strict=True):
            points[n + _point_mark(n, k, common, count)] = v
    at = np.array([points[n] for n in problem.points])
    fixed = problem.fixed
    at[fixed] = (problem.known - origin)[fixed]
    return BlockState(
        centres=np.array([centres[n] for n in problem.photos]),
        rotations=np.array([rotations[n] for n in problem.photos]),
        points=at,
        own=np.zeros((len(problem.photos), problem.per_photo - 6)),
        shared=np.zeros(problem.in_border),
        origin=origin,
    )


def joint_displacements(
    block: AdjustedBlock,
    moves: Sequence[Move],
    common: Common,
    count: int,
    equal: Sequence[tuple[Move, int]] = (),
) -> tuple[Array, Array, Array, float]:
    """Return displacements in a joint adjustment.

    A difference of two points does not depend on what
    holds the joint datum, up to its own size over the extent of the block.

    Parameters
    ----------
    block
        The adjusted `joint_block` of `count` epochs.
    moves
        The m movements.
    common, count
        With which it was laid out.
    equal
        (movement, axis) of what is the same coordinate in both epochs, see `shares` of
        `joint_block`; held equal from here on, by conditions between the adjusted unknowns.

    Returns
    -------
    tuple
        (m, 3) places in the earlier epoch [m], (3 m,) displacements [m], (3 m, 3 m) their cofactors
        [m^2], and what the conditions add to v'Pv.
    """
    problem = block.problem
    every = list(dict.fromkeys((*moves, *(move for move, _ in equal))))
    before, after = (
        point_numbers(block, [n + _point_mark(n, k, common, count) for n, k in ends])
        for ends in (
            [(move.point, move.first) for move in every],
            [(move.point, move.second) for move in every],
        )
    )
    position = {move: k for k, move in enumerate(every)}
    same = [3 * position[move] + axis for move, axis in equal]
    # what is free of error is equal already
    same = [k for k in same if not problem.fixed[before[k // 3], k % 3]]
    change = _differences(problem, before, after)
    m = 3 * len(moves)
    places = block.state.points[before[: len(moves)]] + block.state.origin
    d = (block.state.points[after] - block.state.points[before]).reshape(-1)
    q = function_cofactors(block, change)
    if not same:
        return places, d[:m], q[:m, :m], 0.0
    off = np.linalg.solve(q[np.ix_(same, same)], d[same])
    cost = float(d[same] @ off)
    photos, points, shared = (
        np.zeros((len(problem.photos), problem.per_photo, 1)),
        np.zeros((len(problem.points), 3, 1)),
        np.zeros((problem.in_border, 1)),
    )
    side = off @ change[same]
    points[:, :, 0] = side[photos.size : photos.size + points.size].reshape(-1, 3)
    _, moved, _ = block.cofactors.normal.solve(block.cofactors.factor, photos, points, shared)
    moved = np.where(problem.fixed, 0.0, moved[:, :, 0])
    places = places - moved[before[: len(moves)]]
    d = d - q[:, same] @ off
    q = q - q[:, same] @ np.linalg.solve(q[np.ix_(same, same)], q[same])
    d[same], q[same], q[:, same] = 0.0, 0.0, 0.0
    q = 0.5 * (q + q.T)
    return places, d[:m], q[:m, :m], cost


def _differences(problem: Problem, before: Sequence[int], after: Sequence[int]) -> csr_array:
    """Return (3 k, unknowns) coordinates of the points `after` minus those `before`."""
    first = len(problem.photos) * problem.per_photo
    count = 3 * len(before)
    minus, plus = ((3 * np.array(of)[:, None] + np.arange(3)).ravel() for of in (before, after))
    free = ~problem.fixed.ravel()
    return csr_array(
        (
            np.concatenate((-1.0 * free[minus], 1.0 * free[plus])),
            (np.tile(np.arange(count), 2), first + np.concatenate((minus, plus))),
        ),
        shape=(count, first + free.size + problem.in_border),
    )
