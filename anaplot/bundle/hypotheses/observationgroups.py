"""Groups of a block's observations whose variances are estimated, see `estimate_components`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from anaplot.adjustment.variancecomponents import GroupSums, VarianceComponents
from anaplot.aliases import Array, Index, Progress
from anaplot.bundle.adjust import evaluate
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.estimatedfactors import EstimatedFactors
from anaplot.bundle.solve.gaussnewton import Minimum, equations_at, find_minimum
from anaplot.bundle.solve.linearised import Linearised
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.solve.reliability import Cofactors, compute_cofactors
from anaplot.bundle.solve.remade import with_variances

__all__ = ["GroupedBlock", "ObservationGroups"]


class ObservationGroups(NamedTuple):
    """Which group every observation belongs to.

    Attributes
    ----------
    names
        Names of the k groups.
    image
        (m, 2) group of every image coordinate.
    control, expected, position, rotation, additional
        Group of weighted control, of priors of points, on positions, on rotations and on
        additional parameters; None where there are none. Several of them may be of one group.
    """

    names: tuple[str, ...]
    image: Index
    control: int | None
    expected: int | None
    position: int | None
    rotation: int | None
    additional: int | None

    def weighted(self, problem: Problem, factors: Array) -> Problem:
        """Return the problem with the variances of the groups multiplied by (k,) factors."""
        scale = np.sqrt(factors)
        control, expected, position, rotation, additional = (
            1.0 if group is None else float(scale[group]) for group in self[2:]
        )
        others = EstimatedFactors(control, expected, position, rotation, additional)
        return with_variances(problem, scale[self.image], others)

    def told(self, problem: Problem, variances: VarianceComponents) -> Problem:
        """Return the weighted problem that knows how well control's variance is estimated."""
        if problem.estimated is None or self.control is None:
            return problem
        degrees = variances.components[self.control].degrees
        return replace(problem, estimated=problem.estimated._replace(control_degrees=degrees))

    def squares(self, linear: Linearised) -> Array:
        """Return (k,) sums v'Pv."""
        photos = linear.photo_e**2
        return self._summed(
            linear.e**2,
            (linear.point_e[0] ** 2,),
            (linear.point_e[1] ** 2,),
            (photos[:, :3],),
            (photos[:, 3:],),
            (linear.own_e**2, linear.shared_e**2),
        )

    def redundancies(self, cofactors: Cofactors) -> Array:
        """Return (k,) sums of redundancy numbers."""
        r_photo = cofactors.r_photo
        return self._summed(
            cofactors.r,
            (cofactors.r_ground[0],),
            (cofactors.r_ground[1],),
            (r_photo[:, :3],),
            (r_photo[:, 3:],),
            (cofactors.r_own, cofactors.r_shared),
        )

    def counts(self, problem: Problem) -> list[int]:
        """Return how many observations each group has."""
        used = np.ones(self.image.shape)
        if problem.rejected is not None:
            used[problem.rejected] = 0.0
        return [
            round(count)
            for count in self._summed(
                used,
                (np.isfinite(problem.known_sigma) * 1.0,),
                (np.isfinite(problem.expected_sigma) * 1.0,),
                (np.isfinite(problem.position_sigma) * 1.0,),
                (np.isfinite(problem.rotation_sigma) * 1.0,),
                (np.isfinite(problem.additional_sigma) * 1.0,),
            ).tolist()
        ]

    def _summed(self, image: Array, *rest: tuple[Array, ...]) -> Array:
        out = np.bincount(self.image.ravel(), weights=image.ravel(), minlength=len(self.names))
        for group, parts in zip(self[2:], rest, strict=True):
            if group is not None:
                out[group] += sum(float(np.nansum(part)) for part in parts)
        return np.asarray(out, dtype=float)


class GroupedBlock:
    """An adjusted block whose groups get other variances, again and again.

    Parameters
    ----------
    block
        Adjusted with the a-priori variances.
    groups
        Of its observations.
    progress
        Called with what is being done and the fraction of it.
    """

    def __init__(
        self, block: AdjustedBlock, groups: ObservationGroups, progress: Progress | None
    ) -> None:
        self.problem, self.groups, self._progress = block.problem, groups, progress
        self._structure = block.cofactors.normal.structure
        self._state = block.state
        self._last: tuple[Problem, Minimum] | None = None
        self._runs = 0

    def readjust(self, factors: Array) -> GroupSums:
        """Adjust with (k,) variance factors, from the last solution."""
        weighted = self.groups.weighted(self.problem, factors)
        found = find_minimum(weighted, self._state, self._structure)
        self._last, self._state = (weighted, found), found.state
        self._runs += 1
        self._tell(f"variance components, adjustment {self._runs}", 1.0 - 0.7**self._runs)
        # redundancy numbers are the same in every datum
        cofactors = compute_cofactors(found.normal, found.factor, None)
        return GroupSums(
            self.groups.squares(found.normal.linear), self.groups.redundancies(cofactors)
        )

    def redundancies(self, factors: Array) -> Array:
        """Return what next to the solution changes by the weights, not by the residuals."""
        weighted = self.groups.weighted(self.problem, factors)
        normal, factor, _ = equations_at(weighted, self._structure, self._state)
        self._tell("variance components, standard deviations", 0.0)
        return self.groups.redundancies(compute_cofactors(normal, factor, None))

    def last(self, change: Callable[[Problem], Problem]) -> AdjustedBlock:
        """Return the last adjustment with everything that is computed of one.

        Parameters
        ----------
        change
            Applied to its problem: nothing that moves the minimum.
        """
        assert self._last is not None  # every estimate adjusts at least once
        problem, found = self._last
        return evaluate(change(problem), found, progress=self._progress)

    def _tell(self, what: str, share: float) -> None:
        if self._progress is not None:
            self._progress(what, share)
