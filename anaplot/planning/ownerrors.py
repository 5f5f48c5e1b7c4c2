"""Gross errors of any sizes, numbers and places in any geometry that is linearised once."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array

from anaplot.adjustment.batch import BATCH_TESTS, reject_stepwise
from anaplot.adjustment.findings import SearchSettings
from anaplot.adjustment.leastabsolute import design_of
from anaplot.adjustment.reliability import HARD_TO_TELL
from anaplot.adjustment.residualsystem import DenseResiduals
from anaplot.adjustment.significance import TESTABLE
from anaplot.adjustment.strategies import STRATEGIES, find_gross_errors
from anaplot.aliases import Array, Bools
from anaplot.errors import InputError
from anaplot.planning.montecarlo import QuantityKey
from anaplot.planning.plantederrors import (
    FATES,
    PARTNERS,
    SAME,
    Case,
    PlantedTrial,
    case_of,
    hard_to_tell,
    plant,
)

__all__ = ["Correlated", "OwnErrors"]


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

    def prepare(self) -> PlantedTrial:
        """Check that the errors have room.

        Raises
        ------
        InputError
            More errors than places for them.
        """
        room = int(self.places.sum())
        if max(self.numbers) > room:
            raise InputError(f"{max(self.numbers)} errors, but only {_rows(room)} to put them in")
        counted = (*FATES, PARTNERS, SAME)
        return PlantedTrial(_OwnGeometry(self), self.cases(), counted, self.alpha)

    def cases(self) -> tuple[Case, ...]:
        """Return what is planted; no error comes first, and once."""
        numbers, sizes = dict.fromkeys(self.numbers), dict.fromkeys(self.sizes)
        planted = tuple(case_of(k, size) for k in numbers if k for size in sizes)
        return (Case("no error", 0, 0.0), *planted) if 0 in numbers else planted


def _rows(number: int) -> str:
    return "1 row" if number == 1 else f"{number} rows"


class _OwnGeometry:
    def __init__(self, scenario: OwnErrors) -> None:
        self._of, self._r = scenario, np.diag(scenario.matrix)
        self.near = hard_to_tell(scenario.matrix)
        known = scenario.correlated
        self._unit = np.ones(len(self._r)) if known is None else known.unit
        redundancy = max(round(float(self._r.sum())), 0)
        self._redundancy = redundancy if known is None else known.redundancy

    @cached_property
    def _design(self) -> csr_array | None:
        return design_of(self._of.matrix)

    def remarks(self) -> tuple[str, ...]:
        n = len(self._r)
        return (
            f"{n} rows, redundancy {self._redundancy:.1f}, "
            f"{_rows(int(self._of.places.sum()))} in which errors are planted",
            f"{_rows(int((self._r < TESTABLE).sum()))} cannot be tested, "
            f"{int(self.near.any(axis=1).sum())} have a partner with residual correlation of "
            f"{HARD_TO_TELL:g} or more",
            "right, wrong and missed are numbers of rows in a run",
        )

    def planted(self, rng: np.random.Generator, runs: int, case: Case) -> tuple[Array, Bools]:
        errors = rng.standard_normal((runs, len(self._r)))
        if self._of.correlated is not None:
            errors = errors @ self._of.correlated.factor.T
        return errors, plant(rng, errors, np.flatnonzero(self._of.places), case, self._unit)

    def rejected(
        self, errors: Array, methods: tuple[str, ...], alpha: float
    ) -> Iterable[tuple[str, Bools]]:
        return ((method, self._rejected(errors, method, alpha)) for method in methods)

    def _rejected(self, errors: Array, method: str, alpha: float) -> Bools:
        matrix, r = self._of.matrix, self._r
        if method in BATCH_TESTS:
            return reject_stepwise(matrix, errors, method, alpha, redundancy=self._redundancy)
        settings = SearchSettings(alpha=alpha)
        out = np.zeros(errors.shape, dtype=bool)
        left = errors @ matrix
        for one, e in enumerate(left):
            vtpv = max(float(e @ errors[one]), 0.0)
            system = DenseResiduals(
                self._of.names, e, r, vtpv, self._redundancy, matrix, self._design
            )
            found = find_gross_errors(system, method, settings, models=self._of.models)
            out[one, list(found.rows)] = True
        return out
