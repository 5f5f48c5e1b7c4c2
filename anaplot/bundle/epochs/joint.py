"""Two epochs in one bundle: laid out, adjusted, and the displacements in it (Gruen 1978, D3)."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from anaplot.aliases import Array, Progress
from anaplot.bundle.adjust import adjust_bundle
from anaplot.bundle.solve.additional import AdditionalParameters
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.crosscofactors import Sides, empty_sides, side_products
from anaplot.bundle.solve.imaging import BlockState
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

__all__ = ["adjust_jointly", "joint_block", "joint_differences", "progress_of"]


_MARKS = (" [1]", " [2]")
_BOTH = " [both]"  # every name ends in one of the three, so that no two can meet
_HALF_WEIGHT = 2.0**0.5  # factor of a standard deviation


def joint_block(
    first: Block,
    second: Block,
    common: Collection[str] = (),
    *,
    control: bool = True,
    twice: Collection[str] = (),
    used: tuple[Collection[int], Collection[int]] | None = None,
    epoch_strips: bool = False,
    same_cameras: bool = True,
) -> Block:
    """Return both epochs as one block, names marked by " [1]", " [2]" and " [both]".

    Parameters
    ----------
    first, second
        The blocks.
    common
        Points that have one set of coordinates.
    control
        Whether the second epoch's control is taken besides the first's.
    twice
        Control points that are a point in each epoch, each with half the weight: once both are
        held equal (`joint_differences`), the two observations are the one that was made.
    used
        Rows of image points that take part; None: all.
    epoch_strips
        Make each epoch one strip.
    same_cameras
        Let cameras that are declared alike be one.
    """
    together, halved = set(common), set(twice)

    def named(name: str, k: int) -> str:
        return name + (_BOTH if name in together else _MARKS[k])

    blocks = (first, second)
    alike = {c.id for c in first.cameras} & {c.id for c in second.cameras}
    alike = {n for n in alike if same_cameras and _camera(first, n) == _camera(second, n)}
    cameras: dict[str, Camera] = {}
    photos: list[Photo] = []
    strips: list[Strip] = []
    rows: list[ImagePoint] = []
    controls: dict[str, ControlPoint] = {}
    for k, block in enumerate(blocks):
        mark = _MARKS[k]

        def camera_name(name: str, mark: str = mark) -> str:
            return name + (_BOTH if name in alike else mark)

        for camera in block.cameras:
            name = camera_name(camera.id)
            cameras.setdefault(name, replace(camera, id=name))
        photos += [replace(p, id=p.id + mark, camera=camera_name(p.camera)) for p in block.photos]
        if epoch_strips:
            strips.append(Strip(f"epoch{mark}", tuple(p.id + mark for p in block.photos)))
        else:
            strips += [
                replace(s, id=s.id + mark, photos=tuple(p + mark for p in s.photos))
                for s in block.strips
            ]
        chosen = range(len(block.image_points)) if used is None else sorted(used[k])
        for at in chosen:
            row = block.image_points[at]
            sigma = block.precision.image_um if row.sigma_um is None else row.sigma_um
            rows.append(
                replace(row, photo=row.photo + mark, point=named(row.point, k), sigma_um=sigma)
            )
        if k == 1 and not control:
            continue
        for point in block.control:
            if point.use == "off":
                continue
            name = named(point.point, k)
            wide = _HALF_WEIGHT if point.point in halved else 1.0
            x, y, z = (
                None if value is None else wide * sigma
                for value, sigma in zip(point.xyz, block.sigma_of(point), strict=True)
            )
            controls.setdefault(name, replace(point, point=name, sigma=(x, y, z)))
    return Block(
        name=f"{first.name} and {second.name}",
        precision=Precision(first.precision.image_um, first.precision.tie_variance),
        test=first.test,
        cameras=tuple(cameras.values()),
        photos=tuple(photos),
        strips=tuple(strips),
        image_points=tuple(rows),
        control=tuple(controls.values()),
    )


def _camera(block: Block, name: str) -> Camera:
    return next(c for c in block.cameras if c.id == name)


def adjust_jointly(
    one: AdjustedBlock,
    two: AdjustedBlock,
    held: Sequence[str],
    twice: Sequence[str],
    datum: Datum,
    additional: AdditionalParameters | None,
    *,
    common: bool,
    progress: Progress | None = None,
) -> AdjustedBlock:
    """Adjust two epochs in one bundle, from the approximate values of their own adjustments.

    Parameters
    ----------
    one, two
        The epochs, each adjusted by itself.
    held
        Points that have one set of coordinates; in a free datum the epochs are laid onto each
        other by them.
    twice
        As `joint_block` has it.
    datum
        "control" or "free".
    additional
        Additional parameters.
    common
        Whether both epochs have the same ones.
    progress
        Called with what is being done and the fraction of it.

    Raises
    ------
    InputError
        A camera of common parameters is declared differently.
    NotComputableError
        Both together are not determined.
    """
    first, second = one.problem.block, two.problem.block
    per_epoch = additional is not None and not common and additional.scope == "block"
    own_cameras = additional is not None and not common and additional.scope == "camera"
    if common:
        for camera in first.cameras:
            other = next((c for c in second.cameras if c.id == camera.id), None)
            if other is not None and other != camera:
                raise InputError(
                    f"camera {camera.id} is declared differently in the two epochs: common "
                    "parameters need the same camera"
                )
    block = joint_block(
        first,
        second,
        held,
        control=datum == "control",
        twice=twice,
        used=(set(one.problem.source.tolist()), set(two.problem.source.tolist())),
        epoch_strips=per_epoch,
        same_cameras=not own_cameras,
    )
    if per_epoch and additional is not None:
        additional = replace(additional, scope="strip")
    problem = make_problem(block, datum=datum, additional=additional)
    fitted = None
    if datum == "free":
        origin = one.state.origin
        fitted = fit_similarity(point_places(two, held, origin), point_places(one, held, origin))
    start = _start(problem, one, two, fitted)
    return adjust_bundle(problem, start, progress=progress_of("both epochs", progress))


def progress_of(part: str, progress: Progress | None) -> Progress | None:
    """Return what tells the steps of a part as such."""
    if progress is None:
        return None
    return lambda what, share: progress(f"{part}: {what}", share)


def _start(
    problem: Problem, one: AdjustedBlock, two: AdjustedBlock, fitted: Similarity | None
) -> BlockState:
    """Approximate values from the epochs' own adjustments."""
    origin = one.state.origin
    centres: dict[str, Array] = {}
    rotations: dict[str, Array] = {}
    points: dict[str, Array] = {}
    for k, block in reversed(list(enumerate((one, two)))):
        state, names = block.state, block.problem
        shift = state.origin - origin
        at_photos, at_points = state.centres + shift, state.points + shift
        turned = state.rotations
        if k == 1 and fitted is not None:
            at_photos, at_points = fitted.apply(at_photos), fitted.apply(at_points)
            turned = fitted.rotation @ turned
        centres.update((n + _MARKS[k], v) for n, v in zip(names.photos, at_photos, strict=True))
        rotations.update((n + _MARKS[k], v) for n, v in zip(names.photos, turned, strict=True))
        for n, v in zip(names.points, at_points, strict=True):
            points[n + _MARKS[k]] = v
            points[n + _BOTH] = v
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


def joint_differences(
    block: AdjustedBlock, names: Sequence[str], equal: Sequence[tuple[str, int]] = ()
) -> tuple[Array, Array, Array, float]:
    """Return displacements in a joint adjustment.

    One right-hand side for each difference. A difference of two points does not depend on what
    holds the joint datum, up to its own size over the extent of the block.

    Parameters
    ----------
    block
        The adjusted `joint_block`.
    names
        The m points.
    equal
        (point, axis) that are the same coordinate in both epochs, see `twice` of `joint_block`;
        held equal from here on, by conditions between the adjusted unknowns.

    Returns
    -------
    tuple
        (m, 3) places in the first epoch [m], (3 m,) displacements [m], (3 m, 3 m) their cofactors
        [m^2], and what the conditions add to v'Pv.
    """
    problem = block.problem
    every = [*names, *dict.fromkeys(name for name, _ in equal if name not in set(names))]
    before, after = (point_numbers(block, [n + mark for n in every]) for mark in _MARKS)
    position = {name: k for k, name in enumerate(every)}
    same = [3 * position[name] + axis for name, axis in equal]
    # what is free of error is equal already
    same = [k for k in same if not problem.fixed[before[k // 3], k % 3]]

    def sides(mine: Sequence[int]) -> Sides:
        photos, points, shared = empty_sides(block, len(mine))
        for column, k in enumerate(mine):
            point, axis = divmod(k, 3)
            for at, sign in ((before[point], -1.0), (after[point], 1.0)):
                points[at, axis, column] = 0.0 if problem.fixed[at, axis] else sign
        return photos, points, shared

    m = 3 * len(names)
    places = block.state.points[before[: len(names)]] + block.state.origin
    d = (block.state.points[after] - block.state.points[before]).reshape(-1)
    q = side_products(block, len(d), sides)
    if not same:
        return places, d[:m], q[:m, :m], 0.0
    off = np.linalg.solve(q[np.ix_(same, same)], d[same])
    cost = float(d[same] @ off)
    _, moved, _ = block.cofactors.normal.solve(block.cofactors.factor, *sides(same))
    moved = np.where(problem.fixed, 0.0, moved @ off)
    places = places - moved[before[: len(names)]]
    d = d - q[:, same] @ off
    q = q - q[:, same] @ np.linalg.solve(q[np.ix_(same, same)], q[same])
    d[same], q[same], q[:, same] = 0.0, 0.0, 0.0
    q = 0.5 * (q + q.T)
    return places, d[:m], q[:m, :m], cost
