"""As few rays as keep the mean redundancy number of every photo and every region above a limit.

Whole points go, those first that tell least of the orientations for each of their rays
(`losses`). In rounds: many go at a time by what their photos are likely to lose, then the
redundancy numbers are computed anew, and where too much went some come back. At the end points go
by what every part would lose exactly, until not one more can.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from anaplot.adjustment.watch import Watch
from anaplot.aliases import Array, Bools, Index
from anaplot.bundle.adjust import adjust_problem
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.thinning.imageparts import ImageParts, image_parts
from anaplot.bundle.thinning.keeping import Keeping, keeping
from anaplot.bundle.thinning.losses import Loss, Losses
from anaplot.bundle.thinning.thinned import (
    Thinned,
    block_without,
    bundle_without,
    thinned_at,
)
from anaplot.errors import NotComputableError
from anaplot.photogrammetry.block import Block

__all__ = ["Thinning", "thin_block"]

_ROUNDING = 1e-9  # of a mean redundancy number
_EQUAL = 7  # decimals in which points tell the same: their order in the file decides
_SHARE = 0.25  # of a photo's rays that go in one round, at most
_FEW = 0.01  # of the points: rounds with fewer are left to the exact end
_SAME = 1e-6  # of v'Pv: minima that are the same
_ATTEMPTS = 3  # at leaving points out of which some take too much; from the second whole photos'

_Less = tuple[Index, Array]  # parts, and how much less each is above R


@dataclass(frozen=True, eq=False)
class Thinning:
    """A thinned block and what it was.

    Attributes
    ----------
    least
        R: the limit.
    before, block
        Adjusted with all its points, and without those that went.
    parts
        The photos and regions of `before`.
    kept
        (p,) which of its points are left.
    weak
        (parts,) which were below R before: they keep all their points.
    means, means_before
        (parts,) mean redundancy numbers; NaN where no coordinate counts.
    rounds
        How often they were computed anew.
    complete
        Whether the search came to its end: not one more point can go.
    """

    least: float
    before: AdjustedBlock
    block: AdjustedBlock
    parts: ImageParts = field(repr=False)
    kept: Bools = field(repr=False)
    weak: Bools = field(repr=False)
    means: Array = field(repr=False)
    means_before: Array = field(repr=False)
    rounds: int
    complete: bool

    @cached_property
    def gone(self) -> tuple[str, ...]:
        """Names of the points that went, in the order of the bundle."""
        points = self.before.problem.points
        return tuple(points[k] for k in np.flatnonzero(~self.kept).tolist())


def thin_block(
    before: AdjustedBlock,
    least: float,
    *,
    keep: Collection[str] = (),
    off: Callable[[Block, Collection[str]], Block] = block_without,
    watch: Watch | None = None,
) -> Thinning:
    """Return a block with as few rays as keep every part of every photo controlled.

    Parameters
    ----------
    before
        The adjusted block; what is rejected in it stays so.
    least
        R: the mean redundancy number of the image coordinates of every photo, and of every one of
        its 3 x 3 regions that has rays, stays at least this; above 0, below 1.
    keep
        Points that stay, beside those of control, conditions and priors.
    off
        Switches points off in the block; with a reason, if it has one.
    watch
        Told of the rounds; where it asks for the end, what is reached is the result.

    Returns
    -------
    Thinning
        Parts that were below R before keep all their points. The block is adjusted anew from its
        measurements alone.

    Raises
    ------
    NotComputableError
        The thinner block has no solution from nothing, or another one.
    """
    watch = Watch() if watch is None else watch
    search = _Search(before, least, keep, watch)
    # what it has found is put together however long that takes
    with watch.searching():
        complete = search.run()
    kept = search.alive
    problem = before.problem
    gone = {problem.points[k] for k in np.flatnonzero(~kept).tolist()}
    block = before
    if gone:
        thinner = bundle_without(problem, off(problem.block, gone))
        block = adjust_problem(thinner, progress=watch)
        known = search.now.cofactors.normal.linear.vtpv
        if block.vtpv > (1.0 + _SAME) * known + _SAME:
            raise NotComputableError(
                f"block {problem.block.name}: without {len(gone)} points the adjustment from the "
                "measurements alone ends elsewhere: thin it less, or state approximate positions"
            )
    return Thinning(
        least, before, block, search.parts, kept, search.weak,
        search.means, search.means_before, search.rounds, complete,
    )  # fmt: skip


class _Search:
    """Points of a bundle, one set of them after the other left out."""

    def __init__(
        self, before: AdjustedBlock, least: float, keep: Collection[str], watch: Watch
    ) -> None:
        self.problem, self.least, self.watch = before.problem, least, watch
        problem = self.problem
        self.parts = image_parts(problem)
        self.counted = (~before.rejected).sum(axis=1)
        self.first = np.searchsorted(problem.point, np.arange(len(problem.points) + 1))
        self.alive = np.ones(len(problem.points), dtype=bool)
        self.now_state = before.state
        rays = np.arange(len(problem.photo))
        self.now = Thinned(
            before.cofactors, before.state, rays, np.arange(len(problem.points)),
            before.cofactors.r,
        )  # fmt: skip
        self._known: tuple[Thinned, Losses, dict[int, _Less]] | None = None
        self.rounds = 0
        self._out: dict[int, tuple[int, float]] = {}  # the part that keeps a point, its loss
        self._refused: dict[int, tuple[int, float]] = {}  # the same, of adjustments without it
        self._broke: tuple[int, float] | None = None  # the part that fell most below R, its slack
        self.means_before = self.means
        with np.errstate(invalid="ignore"):
            self.weak: Bools = self.means_before < least - _ROUNDING
        self.keeping: Keeping = keeping(problem, self.parts, keep).whole(self.weak)
        by_point = self.keeping.sets.T.tocsr()
        self._sets_of = np.split(by_point.indices, by_point.indptr[1:-1])

    @property
    def means(self) -> Array:
        """(parts,) mean redundancy numbers of what is left."""
        return self.parts.means(self.now.r, self._counted)

    @property
    def _counted(self) -> Index:
        left: Index = np.where(self.alive[self.problem.point], self.counted, 0)
        return left

    @property
    def slack(self) -> Array:
        """(parts,) by how much the sum of redundancy numbers is above R for each coordinate."""
        out: Array = self.parts.sums @ self._spare(np.arange(len(self.counted)))
        return out

    def _spare(self, rays: Index) -> Array:
        """Return what rays have of redundancy beyond R for each of their coordinates."""
        out: Array = self.now.r[rays].sum(axis=1) - self.least * self._counted[rays]
        return out

    def run(self) -> bool:
        """Leave points out until not one more can go; return whether it came so far."""
        untried = ~self.keeping.firm
        while not self.watch.stopped:
            batch = self._likely(untried)
            if len(batch) <= _FEW * len(self.alive):
                break
            untried[batch] = False
            if len(self._without(batch)) == 0:
                break
        anew = True
        while True:
            batch = self._certain()
            if self.watch.stopped:
                break
            if len(batch) == 0:
                if anew:
                    return True
                self._out, anew = {}, True
                continue
            anew = False
            while len(self._without(batch)) == 0 and not self.watch.stopped:
                if len(batch) == 1:
                    self._refuse(int(batch[0]))
                    break
                batch = batch[: len(batch) // 2]
        return False

    def _refuse(self, point: int) -> None:
        """Keep a point that linearised could go, and adjusted could not, with what it showed."""
        self._refused[point] = 0, np.inf
        if self._broke is not None:
            part, then = self._broke
            rounding = _ROUNDING * float((self.parts.sums @ self._counted)[part])
            self._refused[point] = part, float(self.slack[part]) - then + rounding

    def _without(self, batch: Index) -> Index:
        """Leave points out; those come back that took too much. Return which are out."""
        for number in range(_ATTEMPTS):
            if number and self.watch.stopped:
                break
            self._broke = None
            alive = self.alive.copy()
            alive[batch] = False
            self.rounds += 1
            self.watch(f"thinning, round {self.rounds}", 1.0 - float(alive.mean()))
            try:
                now = thinned_at(self.problem, self.now_state, alive)
            except NotComputableError:
                break
            last = self.now, self.alive
            self.now, self.alive = now, alive
            slack = self.slack
            broken = self._broken(slack)
            if not broken.any():
                self._move(now)
                return batch
            self.now, self.alive = last
            worst = int(np.argmin(np.where(broken, slack, np.inf)))
            self._broke = worst, float(slack[worst])
            left = batch if number else self._unseen(batch, broken)
            if len(left) == len(batch):
                broken[self.parts.owner[broken]] = True
                left = self._unseen(batch, broken)
            if len(left) in (0, len(batch)):  # all see what broke, or none: it came from far away
                break
            batch = left
        return batch[:0]

    def _unseen(self, points: Index, parts: Bools) -> Index:
        """Return those of the points that have no ray in some parts."""
        return points[~self._seeing(parts)[points]]

    def _seeing(self, parts: Bools) -> Bools:
        """Return (p,) which points have a ray in some parts."""
        return self._any_ray(parts[self.problem.photo] | parts[self.parts.region])

    def _move(self, now: Thinned) -> None:
        """Take the state of the whole bundle along to what is adjusted."""
        points = self.now_state.points.copy()
        points[now.points] = now.state.points
        self.now_state = replace(now.state, points=points)

    def _broken(self, slack: Array) -> Bools:
        """Return which parts are below R that were not."""
        counted = self.parts.sums @ self._counted
        out: Bools = ~self.weak & (slack < -_ROUNDING * counted)
        return out

    def _any_ray(self, rays: Bools) -> Bools:
        """Return (p,) which points have one of (m,) rays."""
        out: Bools = np.bincount(self.problem.point, rays, len(self.alive)) > 0
        return out

    def _order(self, points: Index) -> tuple[Index, Array]:
        """Return points, those first that tell least for each ray, and what each tells."""
        size, tells = np.bincount(self.problem.point, minlength=len(self.alive)), self._tells
        order = np.lexsort((self._in_file[points], np.round(tells / size, _EQUAL)[points]))
        return points[order], tells

    @property
    def _tells(self) -> Array:
        """(p,) what each point tells of the orientations: what all other rays would lose."""
        known = np.bincount(self.problem.point, self.counted, len(self.alive))
        own = np.bincount(self.problem.point, self.now.r.sum(axis=1), len(self.alive))
        out: Array = np.maximum(known - 3.0 - own, 0.0)
        return out

    @cached_property
    def _in_file(self) -> Index:
        """(p,) first row of each point."""
        first = np.full(len(self.alive), len(self.problem.block.image_points))
        np.minimum.at(first, self.problem.point, self.problem.source)
        return first

    def _free(self, points: Bools, left: Array) -> Index:
        """Return those of the points that no rule keeps, one at a time."""
        tight = left <= self.keeping.need
        return np.flatnonzero(points & (self.keeping.sets.T @ tight == 0))

    def _likely(self, points: Bools) -> Index:
        """Return points that can go together by what their photos are likely to lose.

        What a point tells is lost by its photos in equal shares, and by all rays of a photo alike.
        """
        parts, problem = self.parts, self.problem
        slack = self.slack
        rays = parts.sums @ self.alive[problem.point]
        may_go = np.ceil(_SHARE * rays[: parts.photos])
        left = self.keeping.sets @ self.alive
        order, tells = self._order(self._free(points & self.alive, left))
        spare = self._spare(np.arange(len(problem.photo)))
        gone = []
        for k in order.tolist():
            mine = slice(self.first[k], self.first[k + 1])
            photos, sets = problem.photo[mine], self._sets_of[k]
            if (left[sets] <= self.keeping.need[sets]).any() or (may_go[photos] < 1.0).any():
                continue
            near = np.concatenate([parts.of_photo[photo] for photo in photos.tolist()])
            near, place = np.unique(near, return_inverse=True)
            lost = np.zeros(len(near))
            of_photo = np.repeat(photos, [len(parts.of_photo[p]) for p in photos.tolist()])
            share = tells[k] / len(photos) / np.maximum(rays[of_photo] - 1.0, 1.0)
            np.add.at(lost, place, share * rays[near[place]])
            for own in (photos, parts.region[mine]):
                np.add.at(lost, np.searchsorted(near, own), spare[mine])
            if ((slack[near] < lost) & ~self.weak[near]).any():
                continue
            slack[near] -= lost
            left[sets] -= 1.0
            for own in (photos, parts.region[mine]):
                np.subtract.at(rays, own, 1.0)
            np.subtract.at(may_go, photos, 1.0)
            gone.append(k)
        return np.array(gone, dtype=np.intp)

    def _certain(self) -> Index:
        """Return points that can go together by what parts of photos would lose.

        What goes may give others room: a ray with less than R leaves its part with more to spare.
        """
        slack, left = self.slack, self.keeping.sets @ self.alive
        spare = self._spare(np.arange(len(self.problem.photo)))
        limit = -_ROUNDING * (self.parts.sums @ self._counted)
        may_go = ~self.keeping.firm & self.alive
        if self._known is None or self._known[0] is not self.now:
            self._known = self.now, Losses(self.now), {}
        _, losses, known = self._known
        gone: list[int] = []
        while not self.watch.stopped:
            # what other rays lose comes on top: without it most are out already
            direct = np.zeros(len(spare), dtype=bool)
            for own in (self.problem.photo, self.parts.region):
                direct |= ~self.weak[own] & (slack[own] - spare < limit[own])
            free = self._free(may_go & ~self._any_ray(direct), left)
            # what a part would lose is known, and it has not gained since
            free = free[[not self._still_out(k, slack, limit) for k in free.tolist()]]
            new = free[[k not in known for k in free.tolist()]]
            for bounds in (losses.at_least, losses.near):
                fitting = self._fitting(bounds(new), slack, spare, limit)
                new = np.array(sorted(fitting), dtype=np.intp)
            far = self._far_away(fitting, slack - limit, spare)
            if far:
                for k in far:
                    del fitting[k]
                doubtful = np.array(sorted(far), dtype=np.intp)
                fitting |= self._fitting(losses.near(doubtful, far), slack, spare, limit)
            known |= fitting
            fits = free[[k in known for k in free.tolist()]]
            more = self._together(self._order(fits)[0], slack, left, known, limit)
            if not more:
                break
            gone += more
            may_go[more] = False
        return np.array(gone, dtype=np.intp)

    def _fitting(
        self, losses: Iterator[Loss], slack: Array, spare: Array, limit: Array
    ) -> dict[int, _Less]:
        """Return the points whose losses leave every part above R; of the others note the part."""
        fitting: dict[int, _Less] = {}
        for loss in losses:
            if self.watch.stopped:
                break  # nobody asks for the others any more
            parts, less = self._less(loss, spare)
            out = ~self.weak[parts] & (slack[parts] - less < limit[parts])
            if out.any():
                worst = int(np.argmin(np.where(out, slack[parts] - less, np.inf)))
                self._out[loss.point] = int(parts[worst]), float(less[worst])
            else:
                fitting[loss.point] = parts, less
        return fitting

    def _far_away(self, fitting: dict[int, _Less], room: Array, spare: Array) -> dict[int, Index]:
        """Return of points those in parts that have less room than what may yet be lost in them.

        All rays together lose what a point tells: what is not in its own photos is lost far away.
        """
        tells = self._tells
        out: dict[int, Index] = {}
        for k, (parts, less) in fitting.items():
            mine = slice(self.first[k], self.first[k + 1])
            rest = tells[k] + spare[mine].sum() - less[parts < self.parts.photos].sum()
            after = room.copy()
            after[parts] -= less
            for photo in self.problem.photo[mine].tolist():
                after[self.parts.of_photo[photo]] = np.inf
            far = np.flatnonzero((after < rest) & ~self.weak)
            if len(far):
                seen = np.unique(self.keeping.sets[far].indices).astype(np.intp)
                out[k] = seen[self.alive[seen]]
        return out

    def _still_out(self, point: int, slack: Array, limit: Array) -> bool:
        known = [kept[point] for kept in (self._out, self._refused) if point in kept]
        return any(slack[part] - less < limit[part] for part, less in known)

    def _less(self, loss: Loss, spare: Array) -> _Less:
        """Return parts, and how much less they are above R without a point."""
        mine = np.arange(self.first[loss.point], self.first[loss.point + 1])
        rays = np.concatenate((mine, loss.rays))
        each = np.concatenate((spare[mine], loss.lost))
        both = np.concatenate((self.problem.photo[rays], self.parts.region[rays]))
        parts, place = np.unique(both, return_inverse=True)
        less = np.bincount(place, np.concatenate((each, each)))
        return np.asarray(parts), np.asarray(less, dtype=float)

    def _together(
        self, order: Index, slack: Array, left: Array, known: dict[int, _Less],
        limit: Array,
    ) -> list[int]:  # fmt: skip
        """Return points that may go together: what each takes is taken from the others' room."""
        gone: list[int] = []
        for k in order.tolist():
            sets, (parts, less) = self._sets_of[k], known[k]
            if (left[sets] <= self.keeping.need[sets]).any():
                continue
            if ((slack[parts] - less < limit[parts]) & ~self.weak[parts]).any():
                continue
            slack[parts] -= less
            left[sets] -= 1.0
            gone.append(k)
        return gone
