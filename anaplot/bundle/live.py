"""The live block: adjusted again after every model, photo and re-measurement.

The last solution is the start of the next; where only coordinates have changed, the structure and
even the last factor of the normal equations serve again, so that the solution follows by
back-substitutions before one full step gives the exact redundancy numbers. The object belongs to
one thread; a progress function that raises stops it, and the last answer stays.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from anaplot.aliases import Index, Progress
from anaplot.bundle.adjust import adjust_problem, evaluate
from anaplot.bundle.errors.wrongray import SuspectRay, explained, suspect_rays_of
from anaplot.bundle.onward import adjust_onward
from anaplot.bundle.solve.additional import AdditionalParameters
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.datum import components
from anaplot.bundle.solve.gaussnewton import find_minimum
from anaplot.bundle.solve.knownvalues import known_values
from anaplot.bundle.solve.linearised import linearise, move, objective
from anaplot.bundle.solve.problem import SEVEN, Datum, Problem, make_problem
from anaplot.bundle.solve.remade import remeasured
from anaplot.errors import NotComputableError
from anaplot.photogrammetry.block import Block

__all__ = ["LiveAnswer", "LiveBlock", "answer_of"]

_CHORD_STEPS = 4
_JOINING = 3  # common points that hold a strip to another


@dataclass(frozen=True, slots=True, eq=False)
class LiveAnswer:
    """The state of the whole block.

    Attributes
    ----------
    adjusted
        The adjusted block.
    datum
        "control", or "free" as long as control does not suffice.
    suspect_rays
        For every flagged point its rays, the most probably wrong one first.
    explained
        For every flagged point how probable it is that an error of one of them is what shows.
    aside
        Photos that do not hang together with the rest yet.
    """

    adjusted: AdjustedBlock
    datum: Datum
    suspect_rays: dict[str, tuple[SuspectRay, ...]]
    explained: dict[str, float]
    aside: tuple[str, ...]


class LiveBlock:
    """A block that is adjusted as it grows.

    Parameters
    ----------
    block
        The block as it is when measuring begins; its image points may be none.
    additional
        Additional parameters.
    """

    def __init__(self, block: Block, *, additional: AdditionalParameters | None = None) -> None:
        self._block = block
        self._additional = additional
        self._answer: LiveAnswer | None = None

    @property
    def block(self) -> Block:
        """The block as it is now."""
        return self._block

    @property
    def answer(self) -> LiveAnswer | None:
        """The last answer; None before the first."""
        return self._answer

    def update(self, block: Block, *, progress: Progress | None = None) -> LiveAnswer:
        """Adjust the block as it is now.

        Parameters
        ----------
        block
            All that is known and measured now.
        progress
            Called with what is being done and the fraction of it.

        Raises
        ------
        InputError, NotComputableError
            As `adjust_block`; the measurements are kept, the last answer stays.
        """
        # whatever bad data makes infinite on the way is looked at where it matters
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            return self._updated(block, progress)

    def _updated(self, block: Block, progress: Progress | None) -> LiveAnswer:
        before = self._block
        self._block = block
        fast = self._only_coordinates(before, block, progress)
        if fast is not None:
            return self._keep(fast, self._answer.aside if self._answer else ())
        error: NotComputableError | None = None
        hanging: Problem | None = None
        datums: tuple[Datum, ...] = ("control", "free")
        for datum in datums:
            problem = make_problem(block, datum=datum, additional=self._additional)
            if datum == "control" and _hangs(problem):
                hanging = problem
                continue
            for part, aside in self._parts(problem):
                try:
                    adjusted = self._adjusted(part, progress)
                except NotComputableError as caught:
                    error = error or caught
                    continue
                return self._keep(adjusted, aside)
        if hanging is not None:
            # what is missing first of all is the datum, and that is told in words
            return self._keep(self._adjusted(hanging, progress), ())
        assert error is not None
        raise error

    def _parts(self, problem: Problem) -> Iterator[tuple[Problem, tuple[str, ...]]]:
        """Yield what may be adjusted, the largest first, and the photos that are not in it."""
        if problem.datum != "free":
            yield problem, ()
            return
        connected, aside = self._part(problem, components(problem))
        yield connected, aside
        held, more = self._part(connected, _joined_strips(connected))
        if more:
            yield held, (*aside, *more)

    def _part(self, problem: Problem, labels: Index) -> tuple[Problem, tuple[str, ...]]:
        """Restrict to the part with most rays; names the photos of the others."""
        if labels.max(initial=0) == 0:
            return problem, ()
        largest = int(np.argmax(np.bincount(labels[problem.photo])))
        aside = tuple(
            name for name, label in zip(problem.photos, labels, strict=True) if label != largest
        )
        gone = set(aside)
        block = problem.block
        rows = tuple(r for r in block.image_points if r.photo not in gone)
        smaller = replace(block, image_points=rows)
        return make_problem(smaller, datum=problem.datum, additional=self._additional), aside

    def _adjusted(self, problem: Problem, progress: Progress | None) -> AdjustedBlock:
        """Adjust from the last answer where it has approximate values, else from nothing."""
        if self._answer is not None and self._answer.datum == problem.datum:
            return adjust_onward(problem, self._answer.adjusted, progress=progress)
        return adjust_problem(problem, progress=progress)

    def _only_coordinates(
        self, before: Block, block: Block, progress: Progress | None
    ) -> AdjustedBlock | None:
        """Adjust by what is there already, when only image coordinates have changed."""
        if self._answer is None or self._answer.aside:
            return None
        same = replace(block, image_points=()) == replace(before, image_points=())
        rows, old = block.image_points, before.image_points
        last = self._answer.adjusted
        if not same or last.problem.block is not before or len(rows) != len(old):
            return None
        changed = [k for k, (a, b) in enumerate(zip(rows, old, strict=True)) if a != b]
        for k in changed:
            if replace(rows[k], x=old[k].x, y=old[k].y) != old[k]:
                return None
        if self._additional is not None:
            return None  # their basis functions belong to the measured coordinates
        problem = last.problem
        ideal = problem.ideal.copy()
        at = {int(source): k for k, source in enumerate(problem.source)}
        for k in changed:
            if k not in at:
                return None  # measured otherwise, what took no part may take part, or differs more
            ideal[at[k]] = rows[k].x, rows[k].y
        problem = remeasured(problem, block, ideal)
        normal, factor = last.cofactors.normal, last.cofactors.factor
        state = last.state
        value = objective(problem, state)[0]
        for _ in range(_CHORD_STEPS):
            # the last factor as it is: right to first order, and only the way to the minimum
            trial = move(state, *normal.step(factor, linearise(problem, state)))
            trial_value = objective(problem, trial)[0]
            if not trial_value < value * (1.0 - 1e-12):
                break
            state, value = trial, trial_value
        try:
            found = find_minimum(problem, state, normal.structure, progress=progress)
        except NotComputableError:
            return None
        return evaluate(problem, found, progress=progress)

    def _keep(self, adjusted: AdjustedBlock, aside: tuple[str, ...]) -> LiveAnswer:
        self._answer = answer_of(adjusted, aside)
        return self._answer


def answer_of(adjusted: AdjustedBlock, aside: tuple[str, ...] = ()) -> LiveAnswer:
    """Return the state of a block that is adjusted."""
    points = dict.fromkeys(point for _, _, point, _ in adjusted.suspects())
    return LiveAnswer(
        adjusted=adjusted,
        datum=adjusted.problem.datum,
        suspect_rays=suspect_rays_of(adjusted, points),
        explained={point: explained(adjusted, point) for point in points},
        aside=aside,
    )


def _joined_strips(problem: Problem) -> Index:
    """Return the part that each photo belongs to, of strips that three common points join.

    About a line of two a strip may turn, and nothing of the block is determined then. Photos of no
    strip are with the others of none.
    """
    strip_of = {name: strip.id for strip in problem.block.strips for name in strip.photos}
    number: dict[str | None, int] = {}
    strips = [number.setdefault(strip_of.get(name), len(number)) for name in problem.photos]
    at = np.array(strips, dtype=np.intp)
    rays = np.ones(len(problem.photo)), (at[problem.photo], problem.point)
    sees = sparse.csr_array(rays, shape=(len(number), len(problem.points))) > 0.0
    common = (sees.astype(np.intp) @ sees.T.astype(np.intp)).toarray()
    part = connected_components(common >= _JOINING, directed=False)[1]
    return np.asarray(part[at], dtype=np.intp)


def _hangs(problem: Problem) -> bool:
    """Whether fewer coordinates and angles are known than a datum has parameters."""
    return known_values(problem) < SEVEN
