"""Which additional parameters a block needs: sets tried, tested and thinned out (Gruen 1978, D1).

A set is added to the block as a whole. What the geometry does not determine is left out beforehand
("protect against over-parametrization"). Then H0: dz = dz' = 0 is tested

1. for all parameters together (eq. 35); a set that is not significant is rejected as a whole;
2. for every group of parameters that hang together by correlations; one that is not significant is
   rejected;
3. for the others one by one "after orthogonalization": each with those that are rejected already
   held at zero and all others free, the one that is worst separated from the others first. The
   order depends on the geometry alone, so that with sigma0 known the tests are independent of each
   other as long as nothing is kept;
4. for all that are rejected, together. Are they significant in sum, those come back that cannot be
   left out together.

All these tests take the residuals of the whole set, which none of the hypotheses has a part in.
What a rejection does to the ground follows from the cofactors. Of several significant sets
Schwarz's criterion chooses: the least v'Pv + k ln n for k parameters and n observations (sigma0
known), or n ln(v'Pv / n) + k ln n (estimated); the paper has no rule for that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import log
from typing import Literal, NamedTuple

import numpy as np

from anaplot.adjustment.hypothesis import bonferroni_alpha, f_power, removable, sidak_alpha
from anaplot.aliases import Array, Index, Progress
from anaplot.bundle.adjust import calibrated
from anaplot.bundle.hypotheses.parametertests import ParameterTests, parameter_tests
from anaplot.bundle.hypotheses.verdict import USUAL, HypothesisSettings, VarianceFactor, Verdict
from anaplot.bundle.solve.additional import AdditionalParameters
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.imaging import with_additional
from anaplot.bundle.solve.problem import make_problem
from anaplot.bundle.solve.residuals import block_residuals
from anaplot.bundle.solve.structure import make_structure
from anaplot.errors import NotComputableError
from anaplot.photogrammetry.pointchange import PointChange, point_change

__all__ = ["ChosenParameters", "ParameterStep", "TriedSet", "choose_parameters"]

Stage = Literal["all", "group", "single", "rejected", "kept"]
Outcome = Literal["significant", "rejected", "kept", "back"]

_WEAK_UM = 1e3  # effect of the weights under which it is seen what the geometry determines, sigmas
_DETERMINED = 0.1  # of that: standard deviation from which a parameter counts as not determined


class ParameterStep(NamedTuple):
    """A step of the strategy.

    Attributes
    ----------
    stage
        "all", "group", "single", "rejected" (all that are, together), or "kept".
    parameters
        The parameters in question.
    verdict
        Their test; None where there is none.
    noncentrality, power
        lambda (without the factor 1/2) of an alternative in which each of them is as large as the
        block's a-priori image sigma, and the power against it.
    outcome
        "significant", "rejected", "kept" or, of rejected ones, "back".
    change
        What the step does to the points and their standard deviations (a-priori sigma0): of "all"
        and "kept" against the block without parameters, else of holding these at zero.
    """

    stage: Stage
    parameters: tuple[str, ...]
    verdict: Verdict | None
    noncentrality: float
    power: float
    outcome: Outcome
    change: PointChange | None


@dataclass(frozen=True, slots=True, eq=False)
class TriedSet:
    """A set of additional parameters that was tried.

    Attributes
    ----------
    name, parameters
        The set, and those of its parameters that were tested.
    not_determined
        Those that the geometry does not determine.
    failure
        Why it cannot be adjusted; None where it can.
    steps
        What was tested, in this order.
    kept
        What is left of it.
    block
        The block with what is left; None where nothing is.
    criterion
        Schwarz's criterion with what is left, less that without parameters: negative is better.
    """

    name: str
    parameters: tuple[str, ...]
    not_determined: tuple[str, ...] = ()
    failure: str | None = None
    steps: tuple[ParameterStep, ...] = ()
    kept: tuple[str, ...] = ()
    block: AdjustedBlock | None = field(default=None, repr=False)
    criterion: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class ChosenParameters:
    """The additional parameters that a block needs.

    Attributes
    ----------
    scope, alpha
        Of the parameters, and the significance of the whole choice.
    set_alpha
        Significance of each set's tests: the family of sets keeps alpha (Bonferroni).
    without
        The block without additional parameters.
    sets
        What was tried.
    chosen
        The set that is taken; None: the block needs none.
    """

    scope: str
    alpha: float
    set_alpha: float
    without: AdjustedBlock = field(repr=False)
    sets: tuple[TriedSet, ...] = field(repr=False)
    chosen: TriedSet | None

    @property
    def block(self) -> AdjustedBlock:
        """The block with what is chosen."""
        if self.chosen is None or self.chosen.block is None:
            return self.without
        return self.chosen.block


def choose_parameters(
    without: AdjustedBlock,
    sets: Sequence[AdditionalParameters],
    settings: HypothesisSettings = USUAL,
    *,
    progress: Progress | None = None,
) -> ChosenParameters:
    """Try sets of additional parameters on a block, and keep what is proved.

    Parameters
    ----------
    without
        The block adjusted without additional parameters.
    sets
        What is tried, all of one scope: block, strip or camera.
    settings
        Significance and power.
    progress
        Called with what is being done and the fraction of it.

    Raises
    ------
    ValueError
        No set, sets of several scopes, or one for every photo.
    """
    scopes = {one.scope for one in sets}
    if len(scopes) != 1 or "photo" in scopes:
        raise ValueError("sets of one scope, block, strip or camera")
    alpha = bonferroni_alpha(settings.alpha, len(sets))
    mine = replace(settings, alpha=alpha)
    tried = []
    for number, one in enumerate(sets):
        if progress is not None:
            progress("additional parameters", number / len(sets))
        tried.append(_tried(without, one, mine))
    better = [one for one in tried if one.kept]
    return ChosenParameters(
        scope=sets[0].scope,
        alpha=settings.alpha,
        set_alpha=alpha,
        without=without,
        sets=tuple(tried),
        chosen=min(better, key=lambda one: one.criterion) if better else None,
    )


def _tried(
    without: AdjustedBlock, additional: AdditionalParameters, settings: HypothesisSettings
) -> TriedSet:
    name, every = additional.set.name, additional.set.names
    away: tuple[str, ...] = ()
    try:
        away = _not_determined(without, additional)
        if len(away) == len(every):
            return TriedSet(name, (), away)
        whole = _with(without, additional, set(every) - set(away))
    except NotComputableError as error:
        return TriedSet(name, every, away, str(error))
    tests = parameter_tests(whole, settings)
    assert tests is not None
    if tests.everything is None:
        return TriedSet(name, every, away, "its parameters repeat each other")
    thinning = _Thinning(whole, settings)
    steps, kept = _steps(without, whole, tests, thinning)
    if not kept:
        return TriedSet(name, thinning.names, away, None, tuple(steps))
    try:
        block = _with(without, additional, kept)
    except NotComputableError as error:
        return TriedSet(name, thinning.names, away, str(error), tuple(steps))
    test = _Thinning(block, settings).test(kept, len(kept) * thinning.groups, settings.alpha)
    steps.append(ParameterStep("kept", kept, *test, "kept", _ground(without, block)))
    criterion = _schwarz(block) - _schwarz(without)
    return TriedSet(name, thinning.names, away, None, tuple(steps), kept, block, criterion)


def _with(
    without: AdjustedBlock,
    additional: AdditionalParameters,
    names: set[str] | tuple[str, ...],
) -> AdjustedBlock:
    """Return the block with some parameters of a set."""
    chosen = replace(additional, set=additional.set.only(names))
    old = without.problem
    problem = make_problem(
        old.block, datum=old.datum, additional=chosen, undetermined=old.undetermined
    )
    return calibrated(problem, without.state, robust=without.robust)


def _not_determined(without: AdjustedBlock, additional: AdditionalParameters) -> tuple[str, ...]:
    """Return the parameters that photographs and control do not determine.

    Under weak weights, where the block is without them: the worst is held, then the next, until the
    standard deviations of all others' largest effects are below a hundred a-priori sigmas.
    """
    old = without.problem
    weak = replace(additional, sigma_um=_WEAK_UM * old.block.precision.image_um)
    problem = make_problem(
        old.block, datum=old.datum, additional=weak, undetermined=old.undetermined
    )
    state = with_additional(problem, without.state)
    there = block_residuals(problem, state, make_structure(problem, state.centres))
    names, sigma = additional.set.names, problem.additional_sigma.ravel()
    q = there.cofactors.shared / sigma[:, None] / sigma
    away: list[str] = []
    while len(away) < len(names):
        size = np.sqrt(np.maximum(np.diag(q), 0.0)).reshape(-1, len(names)).max(axis=0)
        worst = int(np.argmax(size))
        if size[worst] <= _DETERMINED:
            break
        away.append(names[worst])
        at = np.arange(worst, len(sigma), len(names))
        gain = np.linalg.solve(q[np.ix_(at, at)], q[at])
        q = q - q[:, at] @ gain
        q[at] = 0.0
        q[:, at] = 0.0
    return tuple(name for name in names if name in away)


def _steps(
    without: AdjustedBlock, whole: AdjustedBlock, tests: ParameterTests, thinning: _Thinning
) -> tuple[list[ParameterStep], tuple[str, ...]]:
    """Return the tests of a set, and the names that are kept."""
    settings, names = thinning.settings, thinning.names
    every = len(names) * thinning.groups
    outcome: Outcome = (
        "significant" if tests.everything and tests.everything.rejected else "rejected"
    )
    _, noncentrality, power = thinning.test(names, every, settings.alpha)
    steps = [
        ParameterStep("all", names, tests.everything, noncentrality, power, outcome,
                      _ground(without, whole))
    ]  # fmt: skip
    if outcome == "rejected":
        return steps, ()
    for entry in tests.sets:
        members = tuple(dict.fromkeys(label[1] for label in entry.members))
        if entry.verdict.decisive is None or not set(members) <= set(thinning.free):
            continue
        test = thinning.test(members, len(members) * thinning.groups, entry.verdict.decisive.alpha)
        if test[0].rejected:
            change = thinning.effect(members)
            steps.append(ParameterStep("group", members, *test, "significant", change))
        else:
            steps.append(ParameterStep("group", members, *test, "rejected", thinning.hold(members)))
    alone = sidak_alpha(settings.alpha, max(len(thinning.free), 1))
    undecided = list(thinning.free)
    while undecided:
        worst = thinning.worst_separated(undecided)
        undecided.remove(worst)
        test = thinning.test((worst,), thinning.groups, alone)
        change = thinning.effect((worst,))
        if test[0].rejected:
            steps.append(ParameterStep("single", (worst,), *test, "kept", change))
        else:
            thinning.hold((worst,))
            steps.append(ParameterStep("single", (worst,), *test, "rejected", change))
    gone = tuple(name for name in names if name not in thinning.free)
    back: tuple[str, ...] = ()
    if gone:
        fresh = _Thinning(whole, settings)
        test = fresh.test(gone, len(gone) * fresh.groups, settings.alpha)
        if test[0].rejected:
            back = fresh.needed(gone)
        change = fresh.hold(gone)
        steps.append(
            ParameterStep("rejected", gone, *test, "significant" if back else "rejected", change)
        )
        if back:
            fresh = _Thinning(whole, settings)
            test = fresh.test(back, len(back) * fresh.groups, settings.alpha)
            steps.append(ParameterStep("single", back, *test, "back", fresh.effect(back)))
    return steps, tuple(name for name in names if name in thinning.free or name in back)


class _Thinning:
    """A set of which some parameters are held at zero, one after the other.

    Parameters
    ----------
    block
        The block with the whole set.
    settings
        Significance and power.
    """

    def __init__(self, block: AdjustedBlock, settings: HypothesisSettings) -> None:
        problem, cofactors = block.problem, block.cofactors
        assert problem.additional is not None
        self.settings = settings
        self.names = problem.additional.set.names
        self.groups = len(problem.additional_groups)
        self.free = list(self.names)
        self._variance = VarianceFactor.of(block)
        self._points = problem.points
        self._image_mm = problem.block.precision.image_um * 1e-3
        self._z = block.state.shared - problem.additional_given.ravel()
        self._q = cofactors.shared
        count = len(self._z)
        photos, points, shared = cofactors.normal.solve(
            cofactors.factor,
            np.zeros((len(problem.photos), problem.per_photo, count)),
            np.zeros((len(problem.points), 3, count)),
            np.eye(count),
        )
        del shared  # the cofactors of the parameters, which are known
        if cofactors.change is not None:
            points = cofactors.change.of_points(photos, points)
        self._beside = points
        self._spread = np.einsum("nii->ni", cofactors.points).copy()

    def _at(self, names: Sequence[str]) -> Index:
        columns = [self.names.index(name) for name in names]
        start = len(self.names) * np.arange(self.groups)
        return np.sort((start[:, None] + columns).ravel())

    def worst_separated(self, names: Sequence[str]) -> str:
        """Return the parameter that the other free ones explain best; the geometry says."""
        free = self._at(self.free)
        inverse = np.linalg.inv(self._q[np.ix_(free, free)])
        inflation = np.zeros(len(self._z))
        inflation[free] = np.diag(self._q)[free] * np.diag(inverse)
        return max(names, key=lambda name: (float(inflation[self._at([name])].sum()), name))

    def test(
        self, names: Sequence[str], dimension: int, alpha: float
    ) -> tuple[Verdict, float, float]:
        """Test that parameters are zero, the other free ones free; noncentrality and power."""
        at = self._at(names)
        q = self._q[np.ix_(at, at)]
        square = float(self._z[at] @ np.linalg.solve(q, self._z[at]))
        sizes = np.full(len(at), self._image_mm)
        noncentrality = float(sizes @ np.linalg.solve(q, sizes))
        power = f_power(noncentrality, alpha, dimension, self._variance.degrees)
        return self._variance.test(max(square, 0.0), dimension, alpha), noncentrality, power

    def needed(self, names: Sequence[str]) -> tuple[str, ...]:
        """Return which of parameters cannot be left out together."""
        at, sigma = self._at(names), self._variance.used
        if sigma is None:
            return tuple(names)
        steps = removable(
            self._z[at],
            self._q[np.ix_(at, at)],
            alpha=self.settings.alpha,
            sigma=sigma,
            redundancy=self._variance.degrees,
        )
        gone = {step.member for step in steps}
        left = {int(k) % len(self.names) for n, k in enumerate(at.tolist()) if n not in gone}
        return tuple(name for name in names if self.names.index(name) in left)

    def _inverse(self, at: Index) -> Array:
        return np.asarray(np.linalg.inv(self._q[np.ix_(at, at)]), dtype=np.float64)

    def _effect(self, at: Index, inverse: Array) -> tuple[PointChange | None, Array]:
        """Return what holding parameters does to the points, and the variances they keep (p, 3)."""
        beside = self._beside[:, :, at]
        moved = -beside @ (inverse @ self._z[at])
        taken = np.einsum("pai,ij,paj->pa", beside, inverse, beside)
        spread = np.maximum(self._spread - taken, 0.0)
        sigmas = np.sqrt(self._spread), np.sqrt(spread)
        return point_change(self._points, np.zeros_like(moved), moved, sigmas), spread

    def effect(self, names: Sequence[str]) -> PointChange | None:
        """Return what holding parameters at zero does to the points."""
        at = self._at(names)
        return self._effect(at, self._inverse(at))[0]

    def hold(self, names: Sequence[str]) -> PointChange | None:
        """Hold parameters at zero; return what that does to the points."""
        at = self._at(names)
        inverse = self._inverse(at)
        change, self._spread = self._effect(at, inverse)
        self._z = self._z - self._q[:, at] @ (inverse @ self._z[at])
        self._beside = self._beside - self._beside[:, :, at] @ (inverse @ self._q[at])
        self._q = self._q - self._q[:, at] @ inverse @ self._q[at]
        self.free = [name for name in self.free if name not in names]
        return change


def _ground(before: AdjustedBlock, after: AdjustedBlock) -> PointChange | None:
    """Return what parameters do to the points, and to their standard deviations."""
    old = {name: k for k, name in enumerate(before.problem.points)}
    at = [old[name] for name in after.problem.points]
    places = before.state.points[at] + (before.state.origin - after.state.origin)
    sigmas = tuple(one.cofactors.point_deviations for one in (before, after))
    return point_change(
        after.problem.points, places, after.state.points, (sigmas[0][at], sigmas[1])
    )


def _schwarz(block: AdjustedBlock) -> float:
    """Return Schwarz's criterion, up to what all sets share."""
    n, factor = block.problem.observations, VarianceFactor.of(block)
    price = block.problem.in_border * log(n)
    if factor.by_known:
        return block.vtpv + price
    return n * log(max(block.vtpv, 1e-300) / n) + price
