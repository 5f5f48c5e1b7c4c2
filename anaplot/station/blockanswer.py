"""The live block's answer as the view that a screen shows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from anaplot.bundle.blockmap import block_map
from anaplot.bundle.errors.bychance import may_be_chance
from anaplot.bundle.errors.suspects import ImageCoordinate, likeliest_suspects
from anaplot.bundle.hypotheses.offsetadvice import offset_advice
from anaplot.bundle.live import LiveAnswer
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.photogrammetry.selection import measured_in_files
from anaplot.planning.stabilizing import as_recorded, stabilizing_sets, weak_ones
from anaplot.station.blockview import (
    BlockView,
    FlaggedCoordinate,
    FlaggedObservation,
    SuspectedPoint,
    SuspectedRay,
)

__all__ = ["view_of"]


def view_of(
    answer: LiveAnswer,
    empty: BlockView,
    since: Mapping[str, str] | None,
    *,
    most_weak: int = 0,
    helped: bool = True,
) -> BlockView:
    """Return what an adjusted block says.

    Parameters
    ----------
    answer
        The live block's answer.
    empty
        A view that says which models are in the block, and nothing else.
    since
        Points flagged in the answer before, each with the newest model of the block when it was
        first flagged; None when there was no answer before: then nothing counts as new.
    most_weak
        For how many weak photos at most the points are found that would help them; without any
        the offsets that the block should have are not looked for either.
    helped
        Whether those points are found at all.
    """
    adjusted = answer.adjusted
    problem, test = adjusted.problem, adjusted.problem.test
    indicators = adjusted.indicators()
    um = problem.block.precision.image_um
    weak = _weak(adjusted) if most_weak else ()
    helps = weak[:most_weak] if helped else ()
    sets = stabilizing_sets(adjusted, helps, as_recorded(adjusted)) if helps else ()
    return replace(
        empty,
        sigma0=adjusted.sigma0,
        sigma0_um=None if adjusted.sigma0 is None else adjusted.sigma0 * um,
        redundancy=adjusted.redundancy,
        photos=len(problem.photos),
        points=len(problem.points),
        rays=len(problem.photo),
        datum=answer.datum,
        test=f"{test.kind} {test.alpha:g}",
        critical=adjusted.critical,
        ri_x=indicators.ri_x,
        ri_y=indicators.ri_y,
        suspects=_suspects(answer, empty, since),
        aside=answer.aside,
        weak=weak,
        stabilizing=sets,
        others=tuple(
            FlaggedObservation(kind, what, w)
            for w, what, kind in adjusted.flagged_observations()
            if kind != "image"
        ),
        offsets=tuple(offset_advice(adjusted)) if most_weak else (),
        block_map=block_map(adjusted),
        by_chance=may_be_chance(adjusted),
    )


def _weak(adjusted: AdjustedBlock) -> tuple[str, ...]:
    """Return weak photos, but for those that are weak because a model is not measured yet."""
    weak = weak_ones(adjusted)
    if not weak:
        return ()
    block = adjusted.problem.block
    done = measured_in_files(block)
    waiting = {
        photo
        for strip in block.strips
        for model in strip.models()
        if model not in done
        for photo in model
    }
    return tuple(photo for photo in weak if photo not in waiting)


def _suspects(
    answer: LiveAnswer, empty: BlockView, since: Mapping[str, str] | None
) -> tuple[SuspectedPoint, ...]:
    adjusted = answer.adjusted
    problem, w, r = adjusted.problem, adjusted.w, adjusted.cofactors.r
    flagged: dict[str, list[FlaggedCoordinate]] = {}
    at = np.argwhere(adjusted.flagged)
    order = np.argsort(-np.abs(w[at[:, 0], at[:, 1]]), kind="stable")
    for ray, axis in at[order].tolist():
        row = problem.block.image_points[problem.source[ray]]
        flagged.setdefault(row.point, []).append(
            FlaggedCoordinate(
                row.photo, row.model, "xy"[axis], float(w[ray, axis]), float(r[ray, axis])
            )
        )
    first_of_all = {(one.point, one.where) for one in likeliest_suspects(adjusted)}
    for point, coordinates in flagged.items():
        # what stands for those that are hard to tell apart comes first
        coordinates.sort(
            key=lambda c: (point, ImageCoordinate(c.photo, c.model, c.axis)) not in first_of_all
        )
    suspects = []
    for point, coordinates in flagged.items():
        rays = tuple(
            SuspectedRay(ray.photo, ray.model, ray.probability)
            for ray in answer.suspect_rays[point]
        )
        first = empty.after if since is None else since.get(point, empty.after)
        earlier = any(ray.model != empty.after for ray in rays)
        newly = since is not None and first == empty.after and earlier
        suspects.append(
            SuspectedPoint(point, tuple(coordinates), rays, first, newly, answer.explained[point])
        )
    return tuple(suspects)
