"""The experiments of the Bayesian paper, over many realisations: groups G0A to G4C."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from anaplot.adjustment.reliability import HARD_TO_TELL, residual_correlations
from anaplot.aliases import Array
from anaplot.planning.bayesblock import BayesBlock, bayes_block
from anaplot.planning.montecarlo import QuantityKey, Scenario, Tally, sums
from anaplot.planning.quantities import COUNT, Quantity, out_of
from anaplot.planning.rejections import SURE, rejected_rows
from anaplot.planning.scenarioalpha import PAPER_ALPHA

__all__ = ["BayesScenario", "noise_within_three", "scenarios"]


METHODS = ("rms", "tau", "baarda", "l1", "search", "odds", "sure")
_QUANTITIES = ("right", "wrong", "missed", "wrong beside a partner")

# group: errors' size [um], prior variance [m^2], and of A, B, C the paper's counts C, E, F
_GROUPS = {
    "G1": (30, 10.0, ((2, 0, 0), (3, 1, 3), (1, 0, 9))),
    "G2": (30, 100.0, ((2, 0, 0), (3, 0, 3), (1, 0, 9))),
    "G3": (90, 10.0, ((2, 0, 0), (5, 5, 1), (5, 0, 5))),
    "G4": (90, 100.0, ((2, 0, 0), (4, 3, 2), (5, 0, 5))),
}
_NUMBERS = {"A": 2, "B": 6, "C": 10}
_SIGMA_UM = 5


@dataclass(frozen=True, slots=True)
class BayesScenario:
    """One group: some errors of one size, anywhere in the block, of either sign.

    Attributes
    ----------
    name, about, methods, runs, chunk, references
        See `Scenario`. "rms" is the paper's rule with its n - u = 21, "odds" the most probable
        set and "sure" the rows that more probably than not hold an error.
    errors
        Number of gross errors.
    size
        Their size [sigma].
    prior_variance
        Of every unknown [m^2].
    alpha
        Significance of a single row.
    """

    name: str
    about: str
    errors: int
    size: float
    prior_variance: float
    references: Mapping[QuantityKey, float] = field(default_factory=dict)
    methods: tuple[str, ...] = METHODS
    runs: int = 100
    chunk: int = 10
    alpha: float = PAPER_ALPHA

    @property
    def case(self) -> str:
        """How the figures are headed."""
        return f"{self.errors} of {self.size:g} sigma" if self.errors else "no gross error"

    def prepare(self) -> _BayesTrial:
        """Linearise the block."""
        return _BayesTrial(self, bayes_block(self.prior_variance))


class _BayesTrial:
    def __init__(self, scenario: BayesScenario, block: BayesBlock) -> None:
        self._scenario, self._block = scenario, block
        rho = residual_correlations(block.matrix, np.diag(block.matrix))
        self._partners = np.abs(np.nan_to_num(rho)) >= HARD_TO_TELL

    def quantities(self, methods: tuple[str, ...]) -> dict[QuantityKey, Quantity]:
        """Say what is counted."""
        case, number = self._scenario.case, self._scenario.errors
        return {
            (case, method, what): out_of(number) if what in ("right", "missed") else COUNT
            for method in methods
            for what in _QUANTITIES
        }

    def run(self, rng: np.random.Generator, runs: int, methods: tuple[str, ...]) -> Tally:
        """Place the errors, search, count."""
        of = self._scenario
        n = len(self._block.rows)
        errors = noise_within_three(rng, runs, n)
        planted = np.zeros((runs, n), dtype=bool)
        for one in range(runs):
            rows = rng.choice(n, of.errors, replace=False)
            errors[one, rows] += of.size * rng.choice((-1.0, 1.0), of.errors)
            planted[one, rows] = True
        rejected = {method: np.zeros((runs, n), dtype=bool) for method in methods}
        for one in range(runs):
            for method, rows_of in self._found(errors[one], methods).items():
                rejected[method][one, list(rows_of)] = True
        tally: Tally = {}
        for method in methods:
            right = rejected[method] & planted
            wrong = rejected[method] & ~planted
            beside = wrong & ((planted & ~rejected[method]) @ self._partners)
            counts = (right, wrong, planted & ~right, beside)
            for quantity, rows_of_quantity in zip(_QUANTITIES, counts, strict=True):
                tally[of.case, method, quantity] = sums(rows_of_quantity.sum(axis=1))
        return tally

    def _found(self, errors: Array, methods: tuple[str, ...]) -> dict[str, tuple[int, ...]]:
        rest = [method for method in methods if method != "rms"]
        alpha = self._scenario.alpha
        found = rejected_rows(self._block.residuals(errors), rest, alpha)
        if "rms" in methods:
            n, u = self._block.design.shape
            found |= rejected_rows(self._block.residuals(errors, n - u), ["rms"], alpha)
        return found

    def remarks(self) -> tuple[str, ...]:
        """Say what limits every method."""
        facts = self._block.facts()
        return (
            f"n {facts.observations}, u {facts.unknowns}; rank {facts.rank} without priors, "
            f"{facts.firm_rank} of it firm",
            f"real redundancy {facts.redundancy:.1f} (n - u = "
            f"{facts.observations - facts.unknowns})",
            f"{facts.untestable} image coordinates cannot be tested, {facts.inseparable} have a "
            "partner whose residual correlates by more than 0.99",
            "wrong beside a partner: a row whose residual correlates above "
            f"{HARD_TO_TELL:g} with that of a planted error that was missed",
            SURE,
        )


def noise_within_three(rng: np.random.Generator, runs: int, n: int) -> Array:
    """Return (runs, n) standard normal numbers, those beyond 3 drawn again (as in the paper)."""
    noise = rng.normal(size=(runs, n))
    while (beyond := np.abs(noise) > 3.0).any():
        noise[beyond] = rng.normal(size=int(beyond.sum()))
    return noise


def scenarios() -> tuple[Scenario, ...]:
    """Return the fourteen groups."""
    out = [
        BayesScenario(
            f"bayes-G0{letter}",
            f"The Bayesian paper's block without gross errors, priors of {prior:g} m^2.",
            0,
            0.0,
            prior,
        )
        for letter, prior in (("A", 10.0), ("B", 100.0))
    ]
    for group, (size_um, prior, printed) in _GROUPS.items():
        for (letter, number), (right, wrong, missed) in zip(_NUMBERS.items(), printed, strict=True):
            out.append(
                BayesScenario(
                    f"bayes-{group}{letter}",
                    f"The Bayesian paper's block, {number} gross errors of {size_um} um, priors "
                    f"of {prior:g} m^2; its one experiment: {right} right, {wrong} wrong, "
                    f"{missed} missed.",
                    number,
                    size_um / _SIGMA_UM,
                    prior,
                    _INDEPENDENT if (group, letter) == ("G3", "C") else {},
                )
            )
    return tuple(out)


_INDEPENDENT: dict[QuantityKey, float] = {
    ("10 of 18 sigma", "rms", "right"): 0.8,
    ("10 of 18 sigma", "baarda", "right"): 4.0,
    ("10 of 18 sigma", "baarda", "wrong"): 3.8,
    ("10 of 18 sigma", "search", "right"): 4.6,
    ("10 of 18 sigma", "search", "wrong"): 3.0,
}
"""Found independently with priors of 10 m^2."""
