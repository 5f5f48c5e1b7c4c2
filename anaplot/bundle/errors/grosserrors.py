"""Gross errors of a block: a strategy on the linearised block, adjusted anew, until it stands.

Every pass sees all observations, linearised where the block lies without those that the pass
before rejected: a rejected one can come back, and its estimated error is what it is off from all
the others. A single coordinate is rejected alone; the other coordinate of its ray stays.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import NamedTuple, cast

import numpy as np

from anaplot.adjustment.cleaned import Cleaned
from anaplot.adjustment.cleaning import (
    Attempts,
    Cleaning,
    CleaningEnd,
    SolvedWithout,
    best_of,
)
from anaplot.adjustment.findings import SearchSettings
from anaplot.adjustment.pairodds import MOST_ROWS_OF_PAIRS
from anaplot.adjustment.scale import ScaleError
from anaplot.adjustment.significance import critical_normal
from anaplot.adjustment.strategies import STRATEGIES
from anaplot.adjustment.watch import Watch
from anaplot.bundle.adjust import evaluate, points_settled
from anaplot.bundle.errors.before import BlockBefore
from anaplot.bundle.errors.blockplace import BlockPlace
from anaplot.bundle.errors.blockrows import BlockRows
from anaplot.bundle.errors.blockscale import check_common_scale, check_scale_at
from anaplot.bundle.errors.controlagreed import (
    AgreedPlace,
    agreed_places,
    contradicted,
    control_out,
    what_is_wrong,
)
from anaplot.bundle.errors.exchangedcontrol import ExchangedControl, exchanged_control
from anaplot.bundle.errors.laterresiduals import AllRows
from anaplot.bundle.errors.leftout import missing
from anaplot.bundle.errors.misfits import (
    PartialAdjustment,
    WithoutFirst,
    adjust_without_misfits,
    minimum_without_misfits,
    mismatched,
    points_gone,
)
from anaplot.bundle.errors.misnamed import MisnamedRay, misnamed_rays
from anaplot.bundle.errors.photosofrejected import (
    HardlyChecked,
    PhotoLoss,
    hardly_checked_photos,
    losses_of_photos,
)
from anaplot.bundle.errors.wholecontrol import whole_control
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.gaussnewton import Minimum
from anaplot.bundle.solve.imaging import RobustPlace
from anaplot.bundle.solve.knownvalues import as_likely_wrong, known_values
from anaplot.bundle.solve.observations import ObservationName
from anaplot.bundle.solve.problem import SEVEN, Problem, make_problem
from anaplot.bundle.solve.remade import among_points, without_points
from anaplot.bundle.solve.selection import FAR_APART
from anaplot.bundle.solve.structure import make_structure
from anaplot.bundle.solve.uncheckedvalues import unchecked_values
from anaplot.bundle.start.controlremark import WithoutControl
from anaplot.bundle.start.robust import robust_state
from anaplot.errors import InputError
from anaplot.photogrammetry.block import Block
from anaplot.photogrammetry.imagepoints import columns_of
from anaplot.photogrammetry.pointchange import PointChange, point_change

__all__ = [
    "MOST_ROWS_OF_COLUMNS",
    "BlockFindings",
    "block_gross_errors",
]


MOST_ROWS_OF_COLUMNS = 100_000
"""Observations of a block up to which sets of errors are weighed: every set looks at all of them
against each row that it holds."""

_MOST_PHOTOS = 5  # that remarks name
_HARDLY = 5e-4  # redundancy number below which control that is left checks nothing
_TORN = 4.0  # sigma0 from which a robust state is a second place to linearise at
_NEAR = 0.1  # of n: change in the last step to it; what that leaves, the first pass adjusts


@dataclass(frozen=True, eq=False)
class BlockFindings(Cleaned[BlockPlace, ObservationName, AllRows]):
    """A block without its gross errors, and how they were found.

    Attributes
    ----------
    block
        Adjusted without the rejected observations.
    begun
        Adjusted with all of them but those held; where that has no solution, with all that fit.
        The search has looked at the others as well.
    settings
        Significance and limits.
    held
        Observations that were rejected before and that it did not look at.
    misnamed
        Rays with rejected coordinates that only bear the name of another point.
    far
        Image coordinates of rays that miss their points by so much that they were taken for other
        points' (`mismatched`).
    against
        Coordinates of control that stay out because control that agrees tells against them
        (`agreed_places`).
    exchanged
        Control points that are interchanged, of those with coordinates out.
    of_control
        What is wrong with control as a whole, where a search among gross errors has ended beside
        that; else None.
    """

    block: AdjustedBlock
    begun: Begun
    settings: SearchSettings
    held: frozenset[ObservationName] = frozenset()
    misnamed: tuple[MisnamedRay, ...] = ()
    far: frozenset[ObservationName] = frozenset()
    against: frozenset[ObservationName] = frozenset()
    exchanged: tuple[ExchangedControl, ...] = ()
    of_control: str | None = None

    @property
    def kept_out(self) -> frozenset[ObservationName]:
        """Not looked at: `far`, `against`, or without a solution, whatever else was out."""
        return self.end.held - self.held

    @property
    def first(self) -> BlockBefore | None:
        """Adjusted with all observations but those held; None where that has no solution."""
        return None if self.begun.reason else self.begun.block

    @property
    def points(self) -> tuple[str, ...]:
        """Points left out with all rays: far apart, and too little to tell what is wrong."""
        apart = self.block.problem.undetermined or {}
        return tuple(name for name, why in apart.items() if why == FAR_APART)

    @cached_property
    def rays_of_points(self) -> tuple[str, ...]:
        """The photo of every ray that is out with its point."""
        if not self.points:
            return ()
        rows, out = columns_of(self.block.problem.block.image_points), set(self.points)
        gone = np.array([name in out for name in rows.point.values])[rows.point.index]
        gone &= np.array([use != "off" for use in rows.use.values])[rows.use.index]
        return tuple(rows.photo.values[k] for k in rows.photo.index[gone].tolist())

    @property
    def point_change(self) -> PointChange | None:
        """What it did to the points [m]; None where there is no solution with all observations."""
        if self.first is None:
            return None
        place = {name: k for k, name in enumerate(self.block.problem.points)}
        names = [name for name in self.first.problem.points if name in place]
        old = [k for k, name in enumerate(self.first.problem.points) if name in place]
        new = [place[name] for name in names]
        before, after = self.first.state, self.block.state
        return point_change(
            names,
            before.points[old],
            after.points[new] + (after.origin - before.origin),
            (self.first.deviations[old], self.block.cofactors.point_deviations[new]),
        )

    @property
    def untestable(self) -> tuple[ObservationName, ...]:
        """What nothing checks, with all observations in."""
        off = self.block.problem.off
        looked_at = (
            row
            for row in self.findings.untestable
            if (off is None or row >= off.size or not off.flat[row]) and row not in self._firm
        )
        names = map(self.names.__getitem__, looked_at)
        return tuple(name for name in names if name not in self.end.held)

    @property
    def _firm(self) -> frozenset[int]:
        """Rows of conditions free of error."""
        conditions, count = self.block.problem.conditions, len(self.names)
        if conditions is None:
            return frozenset()
        return frozenset((count - len(conditions.firm) + np.flatnonzero(conditions.firm)).tolist())

    @cached_property
    def photo_losses(self) -> list[PhotoLoss]:
        """Photos that lose more of their rays than chance explains, the worst first."""
        return losses_of_photos(self.block.problem, self.out, self.rays_of_points)

    @cached_property
    def hardly_checked(self) -> list[HardlyChecked]:
        """Photos that have lost rays, and of whose others less than one checks the place."""
        block = self.block
        return hardly_checked_photos(block.problem, block.state, self.out, self.rays_of_points)

    @cached_property
    def unchecked_control(self) -> tuple[str, ...]:
        """Control points of which any may be wrong instead of what is out: too little checks them.

        As many coordinates are left as hold the block, or one more, and another point out as a
        whole may explain the same; or next to nothing checks what is left of plan, or of height.
        None where no control is out.
        """
        out = [name for name in self.out if name[0] == "control"]
        problem = self.block.problem
        if not out or problem.fixed.any():
            return ()
        hardly = known_values(problem) <= SEVEN + 1
        points = set(as_likely_wrong(problem.every) if hardly else ())
        points.update(str(name[1]) for name in (out if points else ()))
        left = self.block.control_rows()
        unchecked = {row.key for row in unchecked_values(self.block, _HARDLY)}
        for axes in ("XY", "Z"):
            gone, here = (
                [name for name in names if str(name[2]) in axes]
                for names in (out, [row.key for row in left])
            )
            if gone and unchecked.issuperset(here):
                points.update(str(name[1]) for name in (*gone, *here))
        return tuple(row.point for row in problem.block.control if row.point in points)

    @cached_property
    def control_instead(self) -> dict[str, tuple[str, ...]]:
        """For control points with coordinates out, others of which one explains as much.

        Out in place of it, a coordinate whose residual has the correlation rho with its leaves
        (1 - rho^2) w^2 more of v'Pv.
        """
        limit = critical_normal(self.settings.alpha) ** 2
        square = {
            one.name: (one.error / one.sigma) ** 2
            for one in self.rejected
            if one.name[0] == "control" and one.error is not None and one.sigma
        }
        found: dict[str, dict[str, None]] = {}
        for out, kept, rho in self.hard_to_tell:
            other = out in square and kept[0] == "control" and kept[1] != out[1]
            if other and square[out] * (1.0 - rho * rho) < limit:
                found.setdefault(str(out[1]), {})[str(kept[1])] = None
        return {point: tuple(others) for point, others in found.items()}

    @property
    def remarks(self) -> tuple[str, ...]:
        """Sentences: what limited the search, and photos or control that is wrong as a whole."""
        said = list(super().remarks)
        said += [pair.sentence for pair in self.exchanged]
        if not (
            self.of_control is None or self.exchanged or self.of_control in self.block.warnings
        ):
            said.append(self.of_control)
        if self.unchecked_control:
            said.append(
                "without what is rejected next to nothing checks control: any of "
                f"{', '.join(self.unchecked_control)} may be what is wrong"
            )
        said += [
            f"instead of control point {point} it may be {' or '.join(others)} that is wrong: "
            "that explains as much"
            for point, others in self.control_instead.items()
            if not {point, *others}.issuperset(self.unchecked_control or (None,))
        ]
        for photos, are_more in (
            (self.photo_losses, "lose as many"),
            (self.hardly_checked, "are checked as little"),
        ):
            said += [one.sentence for one in photos[:_MOST_PHOTOS]]
            if len(photos) > _MOST_PHOTOS:
                said.append(f"{len(photos) - _MOST_PHOTOS} more photos {are_more}")
        return tuple(said)

    @property
    def came_back(self) -> tuple[ObservationName, ...]:
        """What some pass or step rejected and is in at the end."""
        return self.taken_back


class Begun(NamedTuple):
    """What a search for gross errors began with; see `PartialAdjustment`."""

    block: BlockBefore
    left_out: tuple[ObservationName, ...]
    reason: str
    points: tuple[str, ...]


def block_gross_errors(
    block: Block | Problem | AdjustedBlock,
    strategy: str,
    settings: SearchSettings | None = None,
    *,
    control_only: bool = False,
    as_given: bool = False,
    watch: Watch | None = None,
) -> BlockFindings:
    """Search a block for gross errors, adjust it without them, and search again until it stands.

    Parameters
    ----------
    block
        The block, or the bundle made of it (also with another datum or additional parameters), or
        its adjustment; image coordinates rejected there are looked at anew.
    strategy
        One of `STRATEGIES`.
    settings
        Significance, limits; None: alpha and power of the block's test.
    control_only
        Suspect control and priors alone; image coordinates rejected in the block stay rejected.
    as_given
        Search also where the residuals say that the a-priori sigma cannot be right.
    watch
        Told what is being done and how much of it; where it asks for the end, the best set of
        observations that was found so far is left out.

    Raises
    ------
    InputError
        Odds over pairs, or odds, of too many observations.
    ScaleError
        The a-priori sigma cannot be right, and the strategy tests by it.
    NotComputableError
        The block cannot be adjusted, with all observations or at all.
    ValueError
        No such strategy.

    Notes
    -----
    Control free of error is not observed and thus never suspected; priors on additional
    parameters take part but are not rejected. Where the adjustment with all observations is torn
    (sigma0 above 4), a robust state is a second place to begin, and the better end counts: less
    v'Pv plus c^2 for every rejected row, two interchanged control points counted as one. Sets that
    come again without end are decided likewise.
    """
    if strategy not in STRATEGIES:
        raise ValueError(f"no strategy {strategy!r}; there are {', '.join(STRATEGIES)}")
    start = None
    if isinstance(block, AdjustedBlock):
        problem = block.problem
    else:
        problem = make_problem(block) if isinstance(block, Block) else block
        problem, start = points_settled(problem, progress=watch)
    test = problem.test
    used = SearchSettings(alpha=test.alpha, power=test.power) if settings is None else settings
    n = problem.every.observations
    for asked, what, most in (
        (used.pairs, f"odds over pairs, asked for beside {strategy},", MOST_ROWS_OF_PAIRS),
        (strategy == "odds", strategy, MOST_ROWS_OF_COLUMNS),
    ):
        if asked and n > most:
            raise InputError(
                f"block {problem.block.name}: {what} of {n} observations: at most {most}"
            )
    way = WithoutFirst(_NEAR, watch)
    # else the second place is not that of this way
    ahead = way if problem.bare is problem and not problem.newly_rejected.any() else None
    if isinstance(block, AdjustedBlock):
        least = PartialAdjustment(block, (), "")
    else:
        least = adjust_without_misfits(problem, start=start, ahead=ahead, progress=watch)
    if least.points:
        problem = without_points(problem, least.points, FAR_APART)
    second = _second_place(problem.every, least.block, way)
    first = BlockBefore.of(least.block, keep=second is None or least.block is block)
    begun = Begun(first, *least[1:])
    del least  # as large as the block
    if second is not None and second.points:
        problem = without_points(problem, second.points, FAR_APART)
    every = problem.every
    held = frozenset[ObservationName]()
    if control_only:
        held = frozenset(missing(every, problem))
    watch = Watch() if watch is None else watch
    # the first adjustment is the minimum without what is held, unless it lacks something else
    same = every.points == first.problem.points
    whole = same and not begun.left_out and not missing(every, problem)
    complete = same and not begun.left_out and (control_only or not problem.newly_rejected.any())
    subject = BlockRows(
        every,
        first.structure if same else make_structure(every, first.state.centres),
        watch,
        control_only=control_only,
        first=first.kept if whole else None,
    )
    cleaning = Cleaning(subject, strategy, used, watch, as_given)
    best_end = partial(
        _best_end, subject=subject, first=first, second=second, held=held, complete=complete
    )
    told = first.of_control
    if second is not None or begun.left_out:
        told = what_is_wrong(every, first.state, None) or told
    try:
        if cleaning.by_apriori and not control_only and told is None:
            check_common_scale(subject, first, used.alpha)
        end, far, against, places = best_end(cleaning)
    except ScaleError as error:
        start = first.state if first.robust is None else first.robust.state
        without = WithoutControl(first.problem, start)
        if without.remark is not None:
            raise ScaleError(f"{error.doubt}; but {without.remark.text}") from error
        if not without.agree:
            raise
        end, far, against, places = best_end(replace(cleaning, as_given=True))
    found = end.solved.solution.found
    if found is None:
        cleaned = first.whole()
    else:
        # at scale they are known from the last pass
        known = vars(end.solved.solution).get("cofactors")
        cleaned = evaluate(subject.problem_without(end.out), found, cofactors=known)
    went = [cast("ObservationName", one.name) for one in end.findings.rejected]
    others = sorted(end.out.difference(held, went), key=subject.rows.row_of)
    rejected = (*others, *went)
    misnamed = misnamed_rays(cleaned, rejected, watch)
    exchanged = exchanged_control(every, end.solved.solution.state, end.out - held)
    if exchanged:
        remark = WithoutControl(every, end.solved.solution.state).remark
        # of what was tried, what explains less
        likely = end.score + critical_normal(used.alpha) ** 2
        less = [place.points for place in places if place.score >= likely]
        less += [frozenset(pair.points) for pair in exchanged]
        also = () if remark is None else remark.exchanged
        instead = tuple(pair for pair in also if frozenset(pair) not in less)
        exchanged = tuple(pair._replace(otherwise=instead) for pair in exchanged)
    # what is left in may fit its mirror image, and does not tell it any more
    if told is None and not exchanged:
        told = what_is_wrong(every, end.solved.solution.state, end.out - held)
    return BlockFindings(
        end,
        rejected,
        cleaned,
        begun,
        used,
        held,
        misnamed,
        far & end.held,
        against & end.held,
        exchanged,
        told,
    )


_Names = frozenset[ObservationName]


class _Second(NamedTuple):
    """Another place to begin at: what is adjusted there, and points that cannot be linearised."""

    problem: Problem
    place: BlockPlace
    points: tuple[str, ...]


def _second_place(problem: Problem, first: AdjustedBlock, way: WithoutFirst) -> _Second | None:
    """Return a robust place where the first adjustment is torn; None where there is none.

    `way`: by which that was reached, if it was.
    """
    known, way.found = way.found, None
    if first.sigma0 is None or first.sigma0 <= _TORN:
        return None
    if known is not None and first.robust is not None and first.robust.state is known[0].state:
        return _second(problem, known[1:])
    structure = first.cofactors.normal.structure
    start = RobustPlace(first.state) if first.robust is None else first.robust
    if first.problem.newly_rejected.any():
        # the robust steps have not seen what was rejected before
        start = start._replace(settled=False)
    try:
        least = minimum_without_misfits(problem, structure, start, enough=_NEAR)
        if least is None:
            there = robust_state(problem, structure, start.state).state
            return _Second(first.problem, BlockPlace(there), ())
    except np.linalg.LinAlgError:
        return None
    return _second(problem, least)


def _second(problem: Problem, least: tuple[Problem, Minimum]) -> _Second:
    return _Second(least[0], BlockPlace.of(least[1]), points_gone(problem, least[0]))


def _best_end(
    cleaning: Cleaning[BlockPlace, ObservationName, AllRows],
    subject: BlockRows,
    first: BlockBefore,
    second: _Second | None,
    held: _Names,
    *,
    complete: bool,
) -> tuple[CleaningEnd[BlockPlace, ObservationName, AllRows], _Names, _Names, list[AgreedPlace]]:
    """Search from the first adjustment, and from a robust one where there is a second place.

    Where so much control is out that the rest may be wrong, also from control that agrees. Where no
    set that is found can be left out, what fits nowhere stays out for good. `held` is what stays
    out; `complete`: the first adjustment lacks nothing else. Returned with the end: the
    `mismatched` coordinates, those of control that others told against, and the places on control
    that agrees.
    """
    problem, alpha = subject.problem, cleaning.settings.alpha
    attempts = Attempts(cleaning)
    reduced, state = first.problem, first.state
    if problem.points != reduced.points:
        state = among_points(reduced, problem, state)
    here = BlockPlace(state)
    place = here
    if second is not None:
        reduced, place = second.problem, second.place
        state = place.state
    kept_out = frozenset(missing(problem, reduced)) - held
    far, against, agreed = _Names(), _Names(), False
    places: list[AgreedPlace] = []
    with suppress(np.linalg.LinAlgError):
        if second is not None and cleaning.by_apriori:
            check_scale_at(subject, state, first, alpha)
        # what was taken for another point's would only hide what is wrong with the others
        far = mismatched(problem, reduced, state)
        if contradicted(problem, kept_out):
            # what is wrong is known nearly: all of it in would only lead away
            places = agreed_places(problem, state, reduced.rejected, alpha, cleaning.watch)
            agreed, against = _begin_on_agreed(attempts, problem, places, far, held)
        if far and not agreed:
            attempts.begin(place, None, held | far)
        if second is not None and not attempts.ends:
            attempts.begin(place, None, held)
    # a torn minimum is only gone on from where nothing better has come to an end
    torn = _TORN**2 * max(problem.redundancy, 1)
    if not any(end.settled and end.score <= torn for end in attempts.ends):
        attempts.begin(here, SolvedWithout(here, first.vtpv) if complete else None, held)
    best = best_of(attempts.ends) if attempts.ends else None
    if best is not None and not agreed and contradicted(problem, best.out - held):
        rays = frozenset(name for name in best.out if name[0] == "image")
        state, rejected = best.solved.solution.state, subject.problem_without(rays).rejected
        places = agreed_places(problem, state, rejected, alpha, cleaning.watch)
        against |= _begin_on_agreed(attempts, problem, places, far, held)[1]
    # so many misfits, and residuals that contradict the a-priori sigma: it is wrong, not they
    many = 2 * len(kept_out) > cleaning.settings.room(problem.redundancy)
    if not attempts.ends and kept_out and not (attempts.doubted and many):
        attempts.begin(place, None, held | kept_out)
    return attempts.best(), far, against, places


def _begin_on_agreed(
    attempts: Attempts[BlockPlace, ObservationName, AllRows],
    problem: Problem,
    places: list[AgreedPlace],
    far: _Names,
    held: _Names,
) -> tuple[bool, _Names]:
    """Search also from control that agrees, until so little of it is out that nothing is doubted.

    Parameters
    ----------
    attempts, problem
        The search, and the bundle with all observations.
    places
        On control that agrees, the likeliest first.
    far
        The `mismatched` coordinates.
    held
        What stays out.

    Returns
    -------
    bool
        Whether a search has settled with no more control out than its place began without.
    frozenset
        Coordinates of control that stayed out in one of these searches.
    """
    watch = attempts.cleaning.watch
    # a ray of wrong control may be far off for it
    control = whole_control(problem)
    held = held.union(name for name in far if name[2] not in control)
    against, agreed = _Names(), False
    for place, out, score in places:
        # where a search has found nothing against the control of its place, less likely ones wait
        if agreed and score > best_of(attempts.ends).score:
            break
        before = len(attempts.ends)
        attempts.begin(place, None, held | out)
        against |= out
        ended = attempts.ends[before:]
        if watch.stopped or any(not contradicted(problem, end.out - held) for end in ended):
            break
        agreed |= any(end.settled and not control_out(problem, end.out - end.held) for end in ended)
    return agreed, against
