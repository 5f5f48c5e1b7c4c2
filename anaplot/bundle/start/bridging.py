"""Parts of a block from its strips: bridged models, joined over common points."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array, Bools, Index, Progress
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.solve.runs import runs
from anaplot.bundle.start.stripmodels import strip_models
from anaplot.bundle.start.subblock import SubBlock
from anaplot.errors import NotComputableError
from anaplot.orientation.model import LEAST_PARALLAX, WrongPointsError, orient
from anaplot.orientation.modelbatch import ModelBatch, OrientedModels, orient_at_once
from anaplot.orientation.results import ModelPoint, ModelSolution
from anaplot.orientation.strip import Predecessor, stereopair
from anaplot.photogrammetry.block import ImagePoint, Precision
from anaplot.photogrammetry.rotation import rotation_angles, rotation_matrix
from anaplot.photogrammetry.selection import model_name, points_of, rows_by_photo, rows_off

__all__ = ["BRIDGING", "Chain", "bridged_chains", "joined_chains"]

BRIDGING = "bridging strips"
"""What this says of its progress."""

_SEVERAL = 4  # models that are oriented at once: fewer are quicker one by one
_LONGER = 5.0  # times the base before: no photo of a strip is so far from the next one
_TELLS_WHICH = 2  # redundancy that tells a wrong point: with 1, all test alike


def bridged_chains(problem: Problem, progress: Progress | None = None) -> list[Chain]:
    """Form the models of the strips, one after another.

    Parameters
    ----------
    problem
        The bundle.
    progress
        Called with what is being done and the fraction of it.

    Returns
    -------
    list[Chain]
        Models that hang together; the most of them first.
    """
    chains = _Strips(problem).bridged(progress)
    chains.sort(key=lambda chain: -len(chain.photos))
    return chains


def joined_chains(problem: Problem, rays: Array, chains: Iterable[Chain]) -> list[SubBlock]:
    """Join bridged strips over common points.

    Parameters
    ----------
    problem
        The bundle.
    rays
        (m, 3) its rays, of unit length in image axes.
    chains
        As `bridged_chains` returns them.

    Returns
    -------
    list[SubBlock]
        Parts that could not be joined, each in the system of one of its strips; the largest first.
    """
    chains = list(chains)
    joined: list[SubBlock] = []
    while chains:
        main = chains.pop(0).sub_block(problem)
        main.place(problem, rays)
        again = True
        while again:
            again = False
            own = main.placed
            shared = [int(np.count_nonzero(own[chain.points])) for chain in chains]
            for k in np.argsort(shared)[::-1].tolist():
                if shared[k] >= 3 and main.join(chains[k].sub_block(problem)):
                    chains.pop(k)
                    main.place(problem, rays)
                    again = True
                    break
        joined.append(main)
    return joined


class Chain(NamedTuple):
    """Models of a strip that hang together.

    Attributes
    ----------
    photos, centres, rotations
        Its photos, and (n, 3), (n, 3, 3) in the system of the first.
    points, xyz
        Its points, and (p, 3) where they are in the first model that has them.
    """

    photos: Index
    centres: Array
    rotations: Array
    points: Index
    xyz: Array

    def sub_block(self, problem: Problem) -> SubBlock:
        """Return it as a part of the block."""
        out = SubBlock.empty(problem)
        out.centres[self.photos], out.rotations[self.photos] = self.centres, self.rotations
        out.points[self.points] = self.xyz
        return out


class _Preceding(NamedTuple):
    """What a model takes over from the one before."""

    centre: tuple[float, float, float]
    base: tuple[float, float, float]
    rotation: tuple[float, float, float]
    points: tuple[ModelPoint, ...]
    exact: None = None


def _goes_on(preceding: _Preceding, found: ModelSolution) -> bool:
    """Whether a model has a base like the one before it: wrong tie points may give it any."""
    before, base = (float(np.linalg.norm(one)) for one in (preceding.base, found.base))
    return before < _LONGER * base and base < _LONGER * before


class _Strips:
    """The strips of a block while their models are formed, of every strip the k-th at once."""

    def __init__(self, problem: Problem) -> None:
        self._problem, self._models = problem, strip_models(problem)
        precision = problem.block.precision
        if precision.tie_variance == "exact":
            # the same orientation, without statistics that nobody looks at
            precision = replace(precision, tie_variance="propagated")
        self._precision: Precision = precision
        cameras = {camera.id: camera for camera in problem.block.cameras}
        self._camera_of = {photo.id: cameras[photo.camera] for photo in problem.block.photos}
        count, points = len(self._models.photos), len(self._models.points)
        # of each model: whether it is formed, and as the first of a chain; where it lies
        self._formed, self._begins = (np.zeros(count, dtype=bool) for _ in range(2))
        self._centre, self._base = np.zeros((count, 3)), np.full((count, 3), np.nan)
        self._rotation = np.full((count, 3, 3), np.nan)
        # of each point of a model: whether the model has it, and where
        self._has, self._xyz = np.zeros(points, dtype=bool), np.full((points, 3), np.nan)

    def bridged(self, progress: Progress | None) -> list[Chain]:
        """Form all models; a new chain begins wherever the chain of models breaks."""
        strips = self._models.strips
        longest = max(map(len, strips), default=0)
        for step in range(longest):
            if progress is not None:
                progress(BRIDGING, step / longest)
            models = np.array([strip[step] for strip in strips if step < len(strip)])
            models = models[(self._models.photos[models] >= 0).all(axis=1)]
            carried = self._formed[models - 1] & (step > 0)
            sure = np.zeros(len(models), dtype=bool)
            if len(models) >= _SEVERAL:
                sure = self._form_at_once(models, carried)
            for model, goes_on in zip(models[~sure].tolist(), carried[~sure].tolist(), strict=True):
                self._form(model, goes_on)
        return [chain for strip in strips for chain in self._chains(strip)]

    def _chains(self, strip: range) -> list[Chain]:
        begins = [model for model in strip if self._begins[model]]
        return [self._chain(range(a, b)) for a, b in pairwise([*begins, strip.stop])]

    def _chain(self, models: range) -> Chain:
        """Return the models of a range that are formed, the first of which begins a chain."""
        laid, count = self._models, int(self._formed[models.start : models.stop].sum())
        these = slice(models.start, models.start + count)
        rows = np.arange(laid.ends[these.start], laid.ends[these.stop])
        rows = rows[self._has[rows] & ~np.isnan(self._xyz[rows, 0])]
        points, first = np.unique(laid.points[rows], return_index=True)
        return Chain(
            np.append(laid.photos[these.start, 0], laid.photos[these, 1]),
            np.vstack((self._centre[these.start], self._centre[these] + self._base[these])),
            np.concatenate((np.eye(3)[None], self._rotation[these])),
            points,
            self._xyz[rows[first]],
        )

    def _form_at_once(self, models: Index, carried: Bools) -> Bools:
        """Form models that carry on a chain or begin one; return those that are beyond doubt."""
        laid, count = self._models, np.diff(self._models.ends)[models]
        rows = runs(laid.ends[models], count)
        of = np.repeat(np.arange(len(models)), count)
        before = laid.before[rows]
        tied = carried[of] & (before >= 0) & self._has[before] & laid.counts[rows, 0]
        use = laid.counts[rows, 1] | tied
        rows, of, tied, before = rows[use], of[use], tied[use], before[use]
        tied &= np.isfinite(self._xyz[before, 2])
        count = np.bincount(of, minlength=len(models))
        self._centre[models] = np.where(
            carried[:, None], self._centre[models - 1] + self._base[models - 1], 0.0
        )
        sure = np.zeros(len(models), dtype=bool)
        # models of about as many points
        size = np.frexp(count)[1]
        for some in (np.flatnonzero(size == one) for one in np.unique(size[count > 0])):
            mine = np.isin(of, some)
            at = np.searchsorted(some, of[mine])
            slot = np.arange(len(at)) - (np.cumsum(count[some]) - count[some])[at]
            batch = self._batch(models[some], carried[some], rows[mine], tied[mine], (at, slot))
            found = orient_at_once(
                batch, self._precision.tie_variance, self._precision.image_um * 1e-3
            )
            sure[some] = found.sure
            self._note(models[some], found, rows[mine], (at, slot))
        self._begins[models[sure & ~carried]] = True
        return sure

    def _batch(
        self, models: Index, carried: Bools, rows: Index, tied: Bools, place: tuple[Index, Index]
    ) -> ModelBatch:
        """Lay out models whose points are in some rows, each in its place."""
        laid, problem = self._models, self._problem
        at, slot = place
        shape = len(models), int(slot.max()) + 1
        c = problem.c[laid.photos[models]]
        left, right = np.zeros((2, shape[0], 3, shape[1]))
        for rays, xy, side in ((left, laid.left, 0), (right, laid.right, 1)):
            rays[at, :2, slot] = xy[rows]
            rays[at, 2, slot] = -c[at, side]
        counts, ties = np.zeros((2, *shape), dtype=bool), np.zeros((shape[0], 3, shape[1]))
        counts[0][place], counts[1][place] = laid.counts[rows, 1], tied
        ties[at, :, slot] = np.where(
            tied[:, None], self._xyz[laid.before[rows]] - self._centre[models][at], 0.0
        )
        rotation = np.where(carried[:, None, None], self._rotation[models - 1], np.eye(3))
        return ModelBatch(
            left,
            right,
            counts[0],
            counts[1],
            ties,
            rotation,
            ~carried,
            np.where(carried, self._base[models - 1, 0], self._nominal(models, left, right)),
        )

    def _nominal(self, models: Index, left: Array, right: Array) -> Array:
        """(m,) magnitudes of bx of first models: stated, or the mean x-parallaxes."""
        stated = np.abs(self._models.base[models])
        mean = np.abs((left[:, 0] - right[:, 0]).sum(axis=1)) / (left[:, 2] != 0.0).sum(axis=1)
        mean[mean < LEAST_PARALLAX * -left[:, 2].min(axis=1)] = np.nan
        return np.where(np.isnan(stated), mean, stated)

    def _note(
        self, models: Index, found: OrientedModels, rows: Index, place: tuple[Index, Index]
    ) -> None:
        """Take down the models that are beyond doubt, whose points are in some rows."""
        sure = found.sure
        self._formed[models[sure]] = True
        self._base[models[sure]] = found.base[sure]
        self._rotation[models[sure]] = found.rotation[sure]
        good = sure[place[0]]
        at, slot = place[0][good], place[1][good]
        self._has[rows[good]] = True
        self._xyz[rows[good]] = found.points[at, :, slot] + self._centre[models][at]

    def _form(self, model: int, carried: bool) -> None:
        """Form one model, as the next of its chain or else the first of a new one."""
        ways = (self._preceding(model - 1), None) if carried else (None,)
        for preceding in ways:
            solution = self._oriented(model, preceding)
            if solution is not None and (preceding is None or _goes_on(preceding, solution)):
                break
        else:
            return
        self._formed[model], self._begins[model] = True, preceding is None
        self._centre[model], self._base[model] = solution.centre, solution.base
        self._rotation[model] = rotation_matrix(*solution.rotation)
        rows = self._models.of(model)
        names = [self._problem.points[k] for k in self._models.points[rows].tolist()]
        row = {name: rows.start + k for k, name in enumerate(names)}
        at = [row[point.point] for point in solution.points]
        self._has[at], self._xyz[at] = True, [point[1:] for point in solution.points]

    def _preceding(self, model: int) -> _Preceding:
        """Return what is taken over from a model."""
        rows = self._models.of(model)
        has = self._has[rows]
        points = self._models.points[rows][has].tolist()
        names = [self._problem.points[k] for k in points]
        return _Preceding(
            tuple(self._centre[model].tolist()),
            tuple(self._base[model].tolist()),
            rotation_angles(self._rotation[model]),
            tuple(map(ModelPoint, names, *self._xyz[rows][has].T.tolist())),
        )

    @cached_property
    def _rows(self) -> dict[str, list[ImagePoint]]:
        unused = set(self._problem.unused_rays.tolist())
        rows = enumerate(self._problem.block.image_points)
        return rows_by_photo(row for k, row in rows if k not in unused)

    def _oriented(self, model: int, preceding: Predecessor | None) -> ModelSolution | None:
        """Orient one model without the points that contradict the others most."""
        block, precision = self._problem.block, self._precision
        base = float(self._models.base[model])
        first, second = (self._problem.photos[k] for k in self._models.photos[model].tolist())
        photos = first, second
        name = model_name(*photos)
        measured = [points_of(self._rows.get(photo, ()), photo, name) for photo in photos]
        left, right = ({n: (p.x, p.y) for n, p in points.items()} for points in measured)
        off = rows_off(*measured)
        allowed = 2 + len(left) // 10
        while True:
            pair = stereopair(
                photos,
                left,
                right,
                (self._camera_of[first], self._camera_of[second]),
                preceding=preceding,
                base=None if np.isnan(base) else base,
                off=off,
            )
            try:
                found = orient(pair, precision, block.test)
            except WrongPointsError as error:
                if allowed <= 0:
                    return None
                wrong = list(error.suspects)
            except NotComputableError:
                return None
            else:
                rough = (found.sigma0_um or 0.0) > 20.0 * precision.image_um
                if not rough or allowed <= 0:
                    return found
                worst = max(found.table, key=lambda row: row.size or 0.0)
                if not worst.flagged:
                    return found
                if found.redundancy < _TELLS_WHICH:
                    # rounding alone would choose; without a model the photo follows by resection
                    return None
                wrong = [worst.point]
            for point in wrong:
                left.pop(point, None)
            allowed -= len(wrong)
