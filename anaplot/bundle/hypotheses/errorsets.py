"""Tests of sets of observations: composite alternatives (Gruen 1978, eq. 14, 17 and 18).

A set of k observations may hold errors z, in units of their standard deviations: H_A: l = l0 + C z
with the columns of C a unit vector each, or, where the relation of the errors is known, one column
c_p with z a number (eq. 14). With R = Q_vv P whitened, R_SS = C'RC and e = Rl,

    residuals change by -R C z (eq. 17),   lambda = z' R_SS z (eq. 18),   T = e_S' R_SS^+ e_S,

T being chi-square of rank(R_SS) degrees of freedom if there is no error, and of that noncentrality
if there is. Of all errors of one size that along the eigenvector of the smallest eigenvalue of R_SS
is the hardest to detect; along eigenvectors of eigenvalue zero none is, at any size.

Rows of conditions free of error have next to no standard deviation, and next to nothing on the
diagonal of R. Errors in them are measured by the standard deviation of what a condition would be
without itself: the root of the largest diagonal element of its rows times smaller.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from anaplot.adjustment.hypothesis import f_noncentrality, f_power
from anaplot.adjustment.significance import TESTABLE, noncentrality
from anaplot.aliases import Array, Index
from anaplot.bundle.hypotheses.verdict import VarianceFactor, Verdict
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.observations import ObservationName
from anaplot.bundle.solve.residuals import BlockResiduals, residuals_of
from anaplot.errors import InputError

__all__ = [
    "MOST_IN_A_SET",
    "ErrorInSet",
    "ErrorSet",
    "ErrorSetTest",
    "SetStatistic",
    "error_set_tests",
    "set_statistic",
]


MOST_IN_A_SET = 2000
"""Observations of a set: each needs one more solution of the normal equations."""


class ErrorSet(NamedTuple):
    """Observations that may be wrong together.

    Attributes
    ----------
    name
        What it is called.
    observations
        Which they are.
    shares
        How their errors are related, in the units of the observations: c_p of eq. 14 up to a
        factor; None where they are free.
    by_length
        Whether the worst direction is that of the longest detectable error in the unit that they
        share, rather than in their standard deviations; only where they are free.
    """

    name: str
    observations: tuple[ObservationName, ...]
    shares: tuple[float, ...] | None = None
    by_length: bool = False


class ErrorInSet(NamedTuple):
    """What is said of one observation of a set.

    Attributes
    ----------
    name, unit
        The observation, and the unit of its errors.
    estimated
        The error that fits the residuals best; of directions that nothing checks it has no part.
    worst
        Its part in the smallest detectable error along the worst direction; None without one.
    """

    name: ObservationName
    unit: str
    estimated: float
    worst: float | None


class SetStatistic(NamedTuple):
    """The residuals of a set along the eigenvectors of R_SS.

    Attributes
    ----------
    values
        (b,) eigenvalues of the directions that are checked, the smallest first; errors of
        conditions free of error in their own measure.
    axes
        (k, b) these directions, in standard deviations of the observations.
    parts
        (b,) misclosures left along them.
    undetectable
        Directions of eigenvalue zero.
    """

    values: Array
    axes: Array
    parts: Array
    undetectable: int

    @property
    def square(self) -> float:
        """T, for the a-priori sigma0."""
        return float((self.parts**2 / self.values).sum())

    @property
    def worst(self) -> Array:
        """(b,) along the axes, the error of noncentrality 1 that is largest."""
        # eigenvalues ascend: the first that is checked at all
        out = np.zeros(len(self.values))
        out[0] = 1.0 / np.sqrt(self.values[0])
        return out

    @property
    def estimated(self) -> Array:
        """(k,) the errors that fit best, in standard deviations of the observations."""
        out: Array = self.axes @ (self.parts / self.values)
        return out


@dataclass(frozen=True, slots=True, eq=False)
class ErrorSetTest:
    """A tested set.

    Attributes
    ----------
    name
        What it is called.
    errors
        Of its observations.
    dimension
        Degrees of freedom b: the rank of R_SS.
    undetectable
        Directions of errors that change no residual.
    square
        T, for the a-priori sigma0.
    verdict
        Of "nothing of the set is wrong"; None where nothing checks it, or only the set itself does
        and sigma0 is estimated without it.
    noncentrality
        lambda0 at which the deciding test has the power asked for; None without a test.
    power
        Power of the deciding test against an error of the size that a test of a single observation
        with the a-priori sigma0 would find with the power asked for: what it costs to suspect b
        things at once.
    worst_sigmas
        Length of the smallest detectable error along the worst of the directions that are checked,
        in standard deviations of the observations; of conditions free of error in those of the
        difference that they would have if they did not count.
    moved, moved_m
        The point that this error moves farthest, and by how much in X, Y, Z [m], in the datum of
        control; None otherwise.
    """

    name: str
    errors: tuple[ErrorInSet, ...] = field(repr=False)
    dimension: int
    undetectable: int
    square: float
    verdict: Verdict | None
    noncentrality: float | None
    power: float | None
    worst_sigmas: float | None
    moved: str | None = None
    moved_m: tuple[float, float, float] | None = None

    @property
    def rejected(self) -> bool:
        """Whether something of the set is wrong."""
        return self.verdict is not None and bool(self.verdict.rejected)


def error_set_tests(block: AdjustedBlock, sets: Sequence[ErrorSet]) -> tuple[ErrorSetTest, ...]:
    """Test sets of observations of an adjusted block, each by itself.

    With significance and power of the block's test, and the sigma0 that it takes: the a-priori one
    (chi-square), or that which the observations outside of the set estimate (F).

    Parameters
    ----------
    block
        The adjusted block.
    sets
        The sets; observations that are rejected or off take no part in them.

    Raises
    ------
    InputError
        An observation that there is not, a set without any that counts, or one of more than
        `MOST_IN_A_SET`.
    """
    if not sets:
        return ()
    system = residuals_of(block)
    place = {name: row for row, name in enumerate(system.names)}
    use = block.tested.use
    out = []
    for one in sets:
        where = f"set {one.name}"
        for name in one.observations:
            if name not in place:
                raise InputError(f"{where}: no observation {' '.join(str(n) for n in name if n)}")
        kept = [k for k, name in enumerate(one.observations) if use[place[name]]]
        if not kept:
            raise InputError(f"{where}: none of its observations counts")
        if len(kept) > MOST_IN_A_SET:
            raise InputError(f"{where}: {len(kept)} observations, at most {MOST_IN_A_SET}")
        rows = np.array([place[one.observations[k]] for k in kept], dtype=np.intp)
        shares = None if one.shares is None else np.array([one.shares[k] for k in kept])
        # columns of R are kept as long as the set needs them
        out.append(_tested(block, residuals_of(block), one, rows, shares))
    return tuple(out)


def set_statistic(system: BlockResiduals, rows: Index, shares: Array | None = None) -> SetStatistic:
    """Return the statistic of a set of rows.

    Parameters
    ----------
    system
        The adjusted block.
    rows
        (k,) rows of the set.
    shares
        (k,) how their errors are related, in the units of the rows; None where they are free.
    """
    measure = _measures(system)[rows]
    directions = np.diag(measure)
    if shares is not None:
        along = shares / system.sigma[rows]
        directions = (along / np.linalg.norm(along / measure))[:, None]
    r = directions.T @ system.columns(rows)[rows] @ directions
    values, vectors = np.linalg.eigh(0.5 * (r + r.T))
    seen = values >= TESTABLE
    return SetStatistic(
        values[seen],
        directions @ vectors[:, seen],
        vectors[:, seen].T @ (directions.T @ system.e[rows]),
        int((~seen).sum()),
    )


def _longest(found: SetStatistic, sigma: Array) -> Array:
    """(b,) along the axes, the error of noncentrality 1 that is longest in its unit."""
    # e = axes z with z' diag(values) z = 1: the longest sigma e is a singular vector
    of_unit = sigma[:, None] * found.axes / np.sqrt(found.values)
    _, _, right = np.linalg.svd(of_unit, full_matrices=False)
    out: Array = right[0] / np.sqrt(found.values)
    return out


def _measures(system: BlockResiduals) -> Array:
    """(n,) in what errors of rows are measured, in their standard deviations."""
    out = np.ones(len(system.e))
    conditions, r = system.problem.conditions, system.cofactors.r_conditions
    if conditions is not None:
        largest = np.zeros(len(conditions.conditions))
        np.maximum.at(largest, conditions.of_row, r)
        scaled = conditions.firm & (largest[conditions.of_row] > 0.0)
        out[system.rows.starts[3] :][scaled] = largest[conditions.of_row][scaled] ** -0.5
    return out


def _tested(
    block: AdjustedBlock, system: BlockResiduals, one: ErrorSet, rows: Index, shares: Array | None
) -> ErrorSetTest:
    name = one.name
    test, sigma = block.problem.test, system.sigma[rows]
    if shares is not None and not 0.0 < np.linalg.norm(shares / sigma) < np.inf:
        raise InputError(f"set {name}: its shares are all zero")
    found = set_statistic(system, rows, shares)
    b, square = len(found.values), found.square
    variance = VarianceFactor.of(block).without(square, b)
    verdict = variance.test(square, b, test.alpha) if b else None
    if verdict is not None and verdict.decisive is None:
        verdict = None
    lambda0 = power = length = None
    worst: list[float | None] = [None] * len(rows)
    moved: tuple[str | None, tuple[float, float, float] | None] = (None, None)
    if verdict is not None:
        degrees = variance.degrees
        lambda0 = f_noncentrality(test.alpha, test.power, b, degrees)
        single = noncentrality(test.alpha, test.power) ** 2
        power = f_power(single, test.alpha, b, degrees)
        along = np.sqrt(lambda0) * (_longest(found, sigma) if one.by_length else found.worst)
        length = float(np.linalg.norm(along))
        error = found.axes @ along
        error *= np.sign(error[np.argmax(np.abs(error))])
        worst = (error * sigma).tolist()
        moved = _moved(block, system, rows, error)
    errors = tuple(
        ErrorInSet(system.names[row], system.units[row], z, w)
        for row, z, w in zip(rows.tolist(), (found.estimated * sigma).tolist(), worst, strict=True)
    )
    return ErrorSetTest(
        name, errors, b, found.undetectable, square, verdict, lambda0, power, length, *moved
    )


def _moved(
    block: AdjustedBlock, system: BlockResiduals, rows: Index, error: Array
) -> tuple[str | None, tuple[float, float, float] | None]:
    """Return the point that an error in some rows moves farthest, and its move [m]."""
    problem = block.problem
    if problem.datum != "control":
        return None, None
    moves = system.moves(rows) @ error
    at = int(np.argmax(np.einsum("pi,pi->p", moves, moves)))
    x, y, z = moves[at].tolist()
    return problem.points[at], (x, y, z)
