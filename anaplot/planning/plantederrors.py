"""Gross errors planted in a linear geometry, and counts of what every method makes of them.

Errors and noise are counted in a-priori sigmas of their row; every run leaves e = R l.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

import numpy as np

from anaplot.adjustment.reliability import HARD_TO_TELL, residual_correlations
from anaplot.aliases import Array, Bools, Index
from anaplot.planning.montecarlo import QuantityKey, Tally, sums
from anaplot.planning.quantities import COUNT, YES_OR_NO, Quantity, out_of
from anaplot.planning.scenarioalpha import PAPER_ALPHA

__all__ = [
    "FATES",
    "PARTNERS",
    "SAME",
    "Case",
    "ErrorsScenario",
    "PlantedTrial",
    "case_of",
    "hard_to_tell",
    "plant",
    "run_by_run",
]

FATES = ("right", "wrong", "missed")
PARTNERS, SAME = "wrong beside a partner", "exactly the errors"


class Case(NamedTuple):
    """What it is called, and how many errors of which size [a-priori sigmas] a run has."""

    name: str
    number: int
    size: float


def case_of(number: int, size: float) -> Case:
    """Return a case with the name that says what it is."""
    return Case(f"{number} of {size:g} sigma", number, size)


class Geometry(Protocol):
    """A linearised geometry of n rows; near: (n, n) which of them are hard to tell apart."""

    @property
    def near(self) -> Bools: ...

    def planted(self, rng: np.random.Generator, runs: int, case: Case) -> tuple[Array, Bools]:
        """Return (runs, n) errors of the observations, and which of them are gross."""

    def rejected(
        self, errors: Array, methods: tuple[str, ...], alpha: float
    ) -> Iterable[tuple[str, Bools]]:
        """Return every method and (runs, n) which rows it rejects."""

    def remarks(self) -> tuple[str, ...]:
        """Say what the geometry is."""


@dataclass(frozen=True, slots=True)
class ErrorsScenario:
    """Gross errors in image coordinates anywhere in a block, of either sign; every method.

    Attributes
    ----------
    name, about, methods, runs, chunk, references
        See `Scenario`.
    geometry
        Linearises the block.
    cases
        What is planted.
    counted
        What is counted of every method.
    alpha
        Significance of a single row.
    """

    name: str
    about: str
    geometry: Callable[[], Geometry]
    cases: tuple[Case, ...]
    methods: tuple[str, ...]
    runs: int
    chunk: int
    counted: tuple[str, ...] = FATES
    references: Mapping[QuantityKey, float] = field(default_factory=dict)
    alpha: float = PAPER_ALPHA

    def prepare(self) -> PlantedTrial:
        """Linearise the block."""
        return PlantedTrial(self.geometry(), self.cases, self.counted, self.alpha)


@dataclass(frozen=True, slots=True, eq=False)
class PlantedTrial:
    """See `Trial`."""

    geometry: Geometry
    cases: tuple[Case, ...]
    counted: tuple[str, ...]
    alpha: float

    def remarks(self) -> tuple[str, ...]:
        """Say what the geometry is."""
        return self.geometry.remarks()

    def quantities(self, methods: tuple[str, ...]) -> dict[QuantityKey, Quantity]:
        """Say what is counted."""
        out: dict[QuantityKey, Quantity] = {}
        for name, number, _ in self.cases:
            some = out_of(number)
            kinds = {"right": some, "missed": some, SAME: YES_OR_NO}
            for method in methods:
                out |= {(name, method, what): kinds.get(what, COUNT) for what in self.counted}
        return out

    def run(self, rng: np.random.Generator, runs: int, methods: tuple[str, ...]) -> Tally:
        """Plant the errors, reject, count."""
        tally: Tally = {}
        for case in self.cases:
            errors, planted = self.geometry.planted(rng, runs, case)
            for method, found in self.geometry.rejected(errors, methods, self.alpha):
                wrong, missed = found & ~planted, planted & ~found
                rows = {"right": found & planted, "wrong": wrong, "missed": missed}
                if PARTNERS in self.counted:
                    rows[PARTNERS] = wrong & (missed @ self.geometry.near)
                counts = {what: of.sum(axis=1) for what, of in rows.items()}
                counts[SAME] = (found == planted).all(axis=1)
                for what in self.counted:
                    tally[case.name, method, what] = sums(counts[what])
        return tally


def hard_to_tell(matrix: Array) -> Bools:
    """Return (n, n) which rows R = Q_vv P makes hard to tell apart."""
    rho = np.abs(np.nan_to_num(residual_correlations(matrix, np.diag(matrix))))
    np.fill_diagonal(rho, 0.0)
    near: Bools = rho >= HARD_TO_TELL
    return near


def plant(rng: np.random.Generator, errors: Array, places: Index, case: Case, unit: Array) -> Bools:
    """Add gross errors to (runs, n) errors, in some of the rows `places`; return which hold one.

    `unit`: (n,) the a-priori sigmas of the rows, in the units of the errors.
    """
    planted = np.zeros(errors.shape, dtype=bool)
    for one in range(len(errors)):
        at = rng.choice(places, case.number, replace=False)
        planted[one, at] = True
        errors[one, at] += case.size * unit[at] * rng.choice((-1.0, 1.0), case.number)
    return planted


def run_by_run(
    errors: Array, methods: tuple[str, ...], reject: Callable[[Array], Mapping[str, Iterable[int]]]
) -> Iterable[tuple[str, Bools]]:
    """Return every method and (runs, n) the rows that `reject` names for it and one run."""
    found = {method: np.zeros(errors.shape, dtype=bool) for method in methods}
    for one, each in enumerate(errors):
        for method, rows in reject(each).items():
            found[method][one, list(rows)] = True
    return found.items()
