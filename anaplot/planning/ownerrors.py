"""Gross errors of any sizes, numbers and places in any geometry that is linearised once.

Errors and noise are counted in a-priori sigmas of their row; every run leaves e = R l.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array

from anaplot.adjustment.batch import BATCH_TESTS, reject_stepwise
from anaplot.adjustment.findings import SearchSettings
from anaplot.adjustment.leastabsolute import design_of
from anaplot.adjustment.modelvalues import MODEL_TOLERANCE
from anaplot.adjustment.reliability import HARD_TO_TELL, residual_correlations
from anaplot.adjustment.residualsystem import DenseResiduals
from anaplot.adjustment.significance import TESTABLE
from anaplot.adjustment.strategies import STRATEGIES, find_gross_errors
from anaplot.aliases import Array, Bools
from anaplot.errors import InputError
from anaplot.planning.montecarlo import QuantityKey, Tally, sums
from anaplot.planning.quantities import COUNT, YES_OR_NO, Quantity, out_of

__all__ = ["Correlated", "OwnErrors"]


_QUANTITIES = ("right", "wrong", "missed", "wrong beside a partner", "exactly the errors")


@dataclass(frozen=True, slots=True, eq=False)
class Correlated:
    """What rows have that are correlated, each in units of its sigma given the others.

    Attributes
    ----------
    factor
        (n, n) F of the covariance F F' of their noise.
    unit
        (n,) a-priori sigmas of the rows in these units.
    redundancy
        Rank of R.
    """

    factor: Array = field(repr=False)
    unit: Array = field(repr=False)
    redundancy: int


@dataclass(frozen=True, slots=True, eq=False)
class OwnErrors:
    """Errors planted in rows of a geometry; a `Scenario`.

    Attributes
    ----------
    name, about, methods, runs, chunk, references
        See `Scenario`.
    matrix
        (n, n) R of the whitened rows.
    names
        Identities of the n rows: of one measurement alike but for the last element.
    models
        (n,) model values of sqrt(q_vv) for the method "modified".
    numbers
        How many errors there are in a run, one case each; 0: none.
    sizes
        Their sizes [a-priori sigmas of the row], one case each.
    places
        (n,) rows in which errors are planted.
    alpha
        Significance of a single row.
    settings
        What was assumed of the geometry, for people and programs.
    correlated
        Of correlated rows; None: they are not.
    """

    name: str
    about: str
    matrix: Array = field(repr=False)
    names: tuple[Hashable, ...] = field(repr=False)
    models: Array = field(repr=False)
    numbers: tuple[int, ...]
    sizes: tuple[float, ...]
    places: Bools = field(repr=False)
    alpha: float = 0.001
    runs: int = 1_000
    chunk: int = 50
    methods: tuple[str, ...] = STRATEGIES
    references: Mapping[QuantityKey, float] = field(default_factory=dict)
    settings: Mapping[str, float | str] = field(default_factory=dict)
    correlated: Correlated | None = field(default=None, repr=False)

    def prepare(self) -> _OwnTrial:
        """Check that the errors have room.

        Raises
        ------
        InputError
            More errors than places for them.
        """
        room = int(self.places.sum())
        if max(self.numbers) > room:
            raise InputError(f"{max(self.numbers)} errors, but only {_rows(room)} to put them in")
        return _OwnTrial(self)

    def cases(self) -> tuple[tuple[int, float], ...]:
        """Return number and size of the errors of every case; no error comes first, and once."""
        numbers, sizes = dict.fromkeys(self.numbers), dict.fromkeys(self.sizes)
        planted = tuple((k, size) for k in numbers if k for size in sizes)
        return ((0, 0.0), *planted) if 0 in numbers else planted


def _rows(number: int) -> str:
    return "1 row" if number == 1 else f"{number} rows"


def _case(number: int, size: float) -> str:
    return f"{number} of {size:g} sigma" if number else "no error"


class _OwnTrial:
    def __init__(self, scenario: OwnErrors) -> None:
        self._of = scenario
        r = np.diag(scenario.matrix)
        rho = np.abs(np.nan_to_num(residual_correlations(scenario.matrix, r)))
        np.fill_diagonal(rho, 0.0)
        self._near = rho >= HARD_TO_TELL
        self._r = r
        known = scenario.correlated
        self._unit = np.ones(len(r)) if known is None else known.unit
        self._redundancy = max(round(float(r.sum())), 0) if known is None else known.redundancy

    @cached_property
    def _design(self) -> csr_array | None:
        return design_of(self._of.matrix)

    def remarks(self) -> tuple[str, ...]:
        n = len(self._r)
        return (
            f"{n} rows, redundancy {self._redundancy:.1f}, "
            f"{_rows(int(self._of.places.sum()))} in which errors are planted",
            f"{_rows(int((self._r < TESTABLE).sum()))} cannot be tested, "
            f"{int(self._near.any(axis=1).sum())} have a partner with residual correlation of "
            f"{HARD_TO_TELL:g} or more",
            "right, wrong and missed are numbers of rows in a run",
        )

    def quantities(self, methods: tuple[str, ...]) -> dict[QuantityKey, Quantity]:
        out: dict[QuantityKey, Quantity] = {}
        for number, size in self._of.cases():
            found = (out_of(number), COUNT, out_of(number), COUNT, YES_OR_NO)
            for method in methods:
                for what, quantity in zip(_QUANTITIES, found, strict=True):
                    out[_case(number, size), method, what] = quantity
        return out

    def run(self, rng: np.random.Generator, runs: int, methods: tuple[str, ...]) -> Tally:
        tally: Tally = {}
        n = len(self._r)
        rows = np.flatnonzero(self._of.places)
        for number, size in self._of.cases():
            errors = rng.standard_normal((runs, n))
            if self._of.correlated is not None:
                errors = errors @ self._of.correlated.factor.T
            planted = np.zeros((runs, n), dtype=bool)
            for one in range(runs):
                at = rng.choice(rows, number, replace=False)
                planted[one, at] = True
                errors[one, at] += size * self._unit[at] * rng.choice((-1.0, 1.0), number)
            case = _case(number, size)
            for method in methods:
                found = self._rejected(errors, method)
                for quantity, values in zip(
                    _QUANTITIES, self._counted(found, planted), strict=True
                ):
                    tally[case, method, quantity] = sums(values)
        return tally

    def _counted(self, found: Bools, planted: Bools) -> tuple[Array, ...]:
        wrong, missed = found & ~planted, planted & ~found
        near = wrong & ((missed @ self._near) > 0)
        counts = (found & planted, wrong, missed, near)
        same = (found == planted).all(axis=1)
        return (*(rows.sum(axis=1).astype(float) for rows in counts), same.astype(float))

    def _rejected(self, errors: Array, method: str) -> Bools:
        matrix, r = self._of.matrix, self._r
        if method in BATCH_TESTS:
            return reject_stepwise(
                matrix, errors, method, self._of.alpha, redundancy=self._redundancy
            ).rejected
        settings = SearchSettings(alpha=self._of.alpha)
        out = np.zeros(errors.shape, dtype=bool)
        left = errors @ matrix
        for one, e in enumerate(left):
            vtpv = max(float(e @ errors[one]), 0.0)
            system = DenseResiduals(
                self._of.names, e, r, vtpv, self._redundancy, matrix, self._design
            )
            found = find_gross_errors(
                system, method, settings, models=self._of.models, tolerance=MODEL_TOLERANCE
            )
            out[one, list(found.rows)] = True
        return out
