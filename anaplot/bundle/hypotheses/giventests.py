"""Does what an earlier adjustment left agree with the new observations.

Of correlated observations x0 with P = C0^-1 and residuals v = x - x0 (adjusted minus given),

    M = P Q_vv P = P - P Q_x P,  w_i = (P v)_i / (sigma sqrt(M_ii)),  nabla_i = delta0 / sqrt(M_ii)

are Baarda's w and the smallest detectable error (1968), r_i = (Q_vv P)_ii. Coordinates given up
together are off by M^-1 P v, and cost (P v)' M^-1 P v. For all of them that is

    v' Q_vv^+ v = d' (C0 + C1)^-1 d,

d between what was given and what the new observations alone would give, C1 its covariance, wherever
they give anything: what only the prior holds, as a datum, cannot contradict it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array, hstack

from anaplot.adjustment.hypothesis import bonferroni_alpha
from anaplot.aliases import Array
from anaplot.bundle.hypotheses.verdict import USUAL, HypothesisSettings, VarianceFactor, Verdict
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.crosscofactors import function_cofactors
from anaplot.bundle.solve.givenprior import locate
from anaplot.bundle.solve.priorbending import prior_bending
from anaplot.bundle.solve.problem import Problem
from anaplot.photogrammetry.posterior import CoordinateName

__all__ = ["GivenCoordinateTest", "GivenOwnerTest", "GivenTests", "given_tests"]


_WEAK = 1e-6  # redundancy below which new observations hardly tell, and rounding might
_ROUNDING = 100.0  # of the fineness of what redundancies are the difference of: it may be that


class GivenCoordinateTest(NamedTuple):
    """One given coordinate.

    Attributes
    ----------
    name
        Which.
    v, s
        Adjusted minus given, and the given one's a-priori standard deviation [m, rad].
    r
        (Q_vv P)_ii: the sum over all coordinates is the prior's share of the redundancy.
    w
        Baarda's w, or divided by the estimated sigma0; None where nothing checks it.
    mdb
        Smallest detectable error [m, rad] for the a-priori sigma0; likewise.
    flagged
        Whether abs(w) exceeds the critical value.
    """

    name: CoordinateName
    v: float
    s: float
    r: float
    w: float | None
    mdb: float | None
    flagged: bool


class GivenOwnerTest(NamedTuple):
    """The given coordinates of a point or photo, given up together.

    Attributes
    ----------
    kind, name
        "point" or "photo", and which.
    unknowns
        The names of its given coordinates.
    difference
        What they would be without being given, minus what is given [m, rad]; None where nothing
        else determines them.
    conditions
        How many combinations of them the new observations check.
    verdict
        The family of all points and photos keeps the significance; None without conditions.
    """

    kind: str
    name: str
    unknowns: tuple[str, ...]
    difference: tuple[float | None, ...]
    conditions: int
    verdict: Verdict | None


@dataclass(frozen=True, slots=True)
class GivenTests:
    """The prior that an earlier adjustment left, tested.

    Attributes
    ----------
    source
        What messages call it.
    exact, unknown
        How many more coordinates are free of error, and are not of this block.
    coordinates, owners
        Every coordinate, every point and photo.
    conditions
        How many combinations of the coordinates the new observations check.
    verdict
        Of all together; None without conditions.
    doubled
        Points of which a coordinate is given and weighted control as well.
    bending
        As `prior_bending` has it.
    """

    source: str
    exact: int
    unknown: int
    coordinates: tuple[GivenCoordinateTest, ...]
    owners: tuple[GivenOwnerTest, ...]
    conditions: int
    verdict: Verdict | None
    doubled: tuple[str, ...] = ()
    bending: float = 0.0

    @property
    def contradicted(self) -> tuple[GivenOwnerTest, ...]:
        """The points and photos whose test is rejected, the least likely first."""
        bad = [one for one in self.owners if one.verdict is not None and one.verdict.rejected]
        return tuple(sorted(bad, key=lambda one: -_strength(one)))

    @property
    def flagged(self) -> bool:
        """Whether anything contradicts: all together, a point or photo, or a coordinate."""
        rejected = self.verdict is not None and self.verdict.rejected
        return (
            rejected or len(self.contradicted) > 0 or any(one.flagged for one in self.coordinates)
        )


def given_tests(block: AdjustedBlock, settings: HypothesisSettings = USUAL) -> GivenTests | None:
    """Test a prior that an earlier adjustment left; None without one.

    Parameters
    ----------
    block
        The adjusted block.
    settings
        Significance and power; of the single coordinates the block's own test decides.
    """
    prior = block.problem.given
    if prior is None:
        return _without_covariance(block.problem)
    equations = block.cofactors.normal.linear.given
    assert equations is not None  # of every block with a prior
    v = equations.misclosure

    none = csr_array((len(prior), block.problem.in_border))
    adjusted = function_cofactors(
        block, csr_array(hstack((equations.photos, equations.points, none)))
    )
    # in the measure that makes the prior's covariance one
    left = np.eye(len(prior)) - prior.root @ adjusted @ prior.root.T
    size = np.abs(prior.root)
    fineness = float(np.einsum("ij,ij->i", size @ np.abs(adjusted), size).max())
    weak = max(_WEAK, _ROUNDING * np.finfo(float).eps * fineness)
    information = prior.root.T @ left @ prior.root
    score = prior.weight @ v
    variance = VarianceFactor.of(block)
    whole = _given_up(left, prior.root @ v, weak)
    weight = np.diag(prior.weight)
    share = np.diag(information) / weight
    testable = share > weak
    deviation = np.sqrt(np.where(testable, np.diag(information), np.nan))
    sigma = block.sigma
    w = np.full(len(prior), np.nan) if not sigma else score / deviation / sigma
    mdb = block.test.delta0 / deviation
    r = 1.0 - np.einsum("ij,ji->i", adjusted, prior.weight)
    limit = np.inf if block.critical is None else block.critical
    coordinates = tuple(
        GivenCoordinateTest(
            name, float(v[k]), float(prior.sigma[k]), float(r[k]), _number(w[k]), _number(mdb[k]),
            bool(abs(w[k]) > limit),
        )
        for k, name in enumerate(prior.names)
    )  # fmt: skip
    return GivenTests(
        prior.source,
        prior.exact,
        prior.unknown,
        coordinates,
        _owners(_Scores(prior.names, information, weight, score, weak), variance, settings),
        whole.conditions,
        _verdict(variance, whole, settings.alpha),
        _doubled(block.problem),
        prior_bending(prior),
    )


def _without_covariance(problem: Problem) -> GivenTests | None:
    """Return what is said of a prior that is free of error as far as the block knows it."""
    given = problem.block.given
    if given is None or problem.datum != "control":
        return None
    known = len(locate(given, problem.points, problem.photos).row)
    return GivenTests(given.source, known, len(given.x) - known, (), (), 0, None)


def _doubled(problem: Problem) -> tuple[str, ...]:
    """Return the points of which a coordinate is given and weighted control as well."""
    prior = problem.given
    assert prior is not None
    at = np.zeros(problem.known_sigma.shape, dtype=bool)
    at[prior.owner[prior.of_point], prior.axis[prior.of_point]] = True
    both = (at & np.isfinite(problem.known_sigma)).any(axis=1)
    return tuple(problem.points[k] for k in np.flatnonzero(both).tolist())


class _GivenUp(NamedTuple):
    """What it would cost to give coordinates up, its conditions, and M^-1 P v where it is whole."""

    square: float
    conditions: int
    off: Array


class _Scores(NamedTuple):
    """Of (q,) coordinates M, the diagonal of P, P v, and the redundancy that tells nothing."""

    names: tuple[CoordinateName, ...]
    information: Array
    weight: Array
    score: Array
    weak: float


def _given_up(information: Array, score: Array, weak: float) -> _GivenUp:
    """Give coordinates up whose information is at most one in their measure."""
    values, vectors = np.linalg.eigh(0.5 * (information + information.T))
    good = values > weak
    along = vectors[:, good].T @ score
    off = vectors[:, good] @ (along / values[good])
    # a combination that nothing else determines is unknown when it is given up
    open_here = (vectors[:, ~good] ** 2).sum(axis=1) > weak
    return _GivenUp(
        float(along @ (along / values[good])), int(good.sum()), np.where(open_here, np.nan, off)
    )


def _owners(
    of: _Scores, variance: VarianceFactor, settings: HypothesisSettings
) -> tuple[GivenOwnerTest, ...]:
    members: dict[tuple[str, str], list[int]] = {}
    for k, name in enumerate(of.names):
        members.setdefault((name.kind, name.owner), []).append(k)
    found = []
    for rows in members.values():
        size = np.sqrt(of.weight[rows])
        own = _given_up(
            of.information[np.ix_(rows, rows)] / size[:, None] / size,
            of.score[rows] / size,
            of.weak,
        )
        found.append(own._replace(off=own.off / size))
    family = max(sum(one.conditions > 0 for one in found), 1)
    alpha = bonferroni_alpha(settings.alpha, family)
    return tuple(
        GivenOwnerTest(
            kind,
            owner,
            tuple(of.names[k].unknown for k in rows),
            tuple(_number(value) for value in own.off),
            own.conditions,
            _verdict(variance, own, alpha),
        )
        for ((kind, owner), rows), own in zip(members.items(), found, strict=True)
    )


def _verdict(variance: VarianceFactor, given_up: _GivenUp, alpha: float) -> Verdict | None:
    if not given_up.conditions:
        return None
    rest = variance.without(given_up.square, given_up.conditions)
    return rest.test(given_up.square, given_up.conditions, alpha)


def _strength(one: GivenOwnerTest) -> float:
    return 0.0 if one.verdict is None else one.verdict.known.statistic


def _number(value: float) -> float | None:
    return float(value) if abs(value) < np.inf else None
