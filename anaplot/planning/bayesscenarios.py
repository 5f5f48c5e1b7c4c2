"""The experiments of the Bayesian paper, over many realisations: groups G0A to G4C."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import partial
from typing import NamedTuple

import numpy as np

from anaplot.adjustment.reliability import HARD_TO_TELL
from anaplot.aliases import Array, Bools
from anaplot.photogrammetry.block import Block
from anaplot.planning.bayesblock import bayes_block
from anaplot.planning.bayesfolder import bayes_folder
from anaplot.planning.montecarlo import QuantityKey, Scenario
from anaplot.planning.plantederrors import (
    FATES,
    PARTNERS,
    Case,
    ErrorsScenario,
    case_of,
    hard_to_tell,
    plant,
    run_by_run,
)
from anaplot.planning.rejections import SURE, rejected_rows

__all__ = ["BayesRun", "bayes_run", "noise_within_three", "scenarios"]


METHODS = ("rms", "tau", "baarda", "l1", "search", "odds", "sure")

# group: errors' size [um], prior variance [m^2], and of A, B, C the paper's counts C, E, F
_GROUPS = {
    "G1": (30, 10.0, ((2, 0, 0), (3, 1, 3), (1, 0, 9))),
    "G2": (30, 100.0, ((2, 0, 0), (3, 0, 3), (1, 0, 9))),
    "G3": (90, 10.0, ((2, 0, 0), (5, 5, 1), (5, 0, 5))),
    "G4": (90, 100.0, ((2, 0, 0), (4, 3, 2), (5, 0, 5))),
}
_NUMBERS = {"A": 2, "B": 6, "C": 10}
_SIGMA_UM = 5


class _BayesGeometry:
    def __init__(self, prior_variance: float) -> None:
        self.prior_variance = prior_variance
        self._block = bayes_block(prior_variance)
        self.near = hard_to_tell(self._block.matrix)

    @property
    def rows(self) -> tuple[tuple[str, str, str], ...]:
        """(photo, point, axis) of every row."""
        return self._block.rows

    def planted(self, rng: np.random.Generator, runs: int, case: Case) -> tuple[Array, Bools]:
        n = len(self._block.rows)
        errors = noise_within_three(rng, runs, n)
        return errors, plant(rng, errors, np.arange(n), case, np.ones(n))

    def rejected(
        self, errors: Array, methods: tuple[str, ...], alpha: float
    ) -> Iterable[tuple[str, Bools]]:
        n, u = self._block.design.shape
        rest = [method for method in methods if method != "rms"]
        of_paper = ["rms"] if "rms" in methods else []

        def reject(one: Array) -> dict[str, tuple[int, ...]]:
            # "rms" is the paper's rule with its n - u = 21
            return rejected_rows(self._block.residuals(one), rest, alpha) | rejected_rows(
                self._block.residuals(one, n - u), of_paper, alpha
            )

        return run_by_run(errors, methods, reject)

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


class BayesRun(NamedTuple):
    """One run of a group.

    Attributes
    ----------
    block
        As a folder may hold it.
    rows
        (photo, point, axis) of every image coordinate.
    planted
        The rows that hold a gross error.
    rejected
        By method, the rows that it rejects.
    """

    block: Block
    rows: tuple[tuple[str, str, str], ...]
    planted: tuple[int, ...]
    rejected: Mapping[str, tuple[int, ...]]


def bayes_run(scenario: Scenario, *, seed: int, methods: tuple[str, ...]) -> BayesRun | None:
    """Return the first run of a group of the Bayesian paper; None of any other scenario.

    The simulation's first run, where it has as many runs as a chunk or more.

    Parameters
    ----------
    scenario
        One of `scenarios`.
    seed
        Of the simulation.
    methods
        Whose rejections are wanted.
    """
    geometry = scenario.geometry() if isinstance(scenario, ErrorsScenario) else None
    if not isinstance(scenario, ErrorsScenario) or not isinstance(geometry, _BayesGeometry):
        return None
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(0,)))
    errors, planted = geometry.planted(rng, scenario.chunk, scenario.cases[0])
    found = dict(geometry.rejected(errors[:1], methods, scenario.alpha))
    return BayesRun(
        bayes_folder(scenario.name, geometry.prior_variance, errors[0]),
        geometry.rows,
        tuple(np.flatnonzero(planted[0]).tolist()),
        {method: tuple(np.flatnonzero(rows[0]).tolist()) for method, rows in found.items()},
    )


def noise_within_three(rng: np.random.Generator, runs: int, n: int) -> Array:
    """Return (runs, n) standard normal numbers, those beyond 3 drawn again (as in the paper)."""
    noise = rng.normal(size=(runs, n))
    while (beyond := np.abs(noise) > 3.0).any():
        noise[beyond] = rng.normal(size=int(beyond.sum()))
    return noise


def _group(
    name: str,
    about: str,
    prior: float,
    case: Case,
    references: Mapping[QuantityKey, float] | None = None,
) -> ErrorsScenario:
    return ErrorsScenario(
        f"bayes-{name}",
        f"The Bayesian paper's block{about}",
        partial(_BayesGeometry, prior),
        (case,),
        METHODS,
        runs=100,
        chunk=10,
        counted=(*FATES, PARTNERS),
        references=references or {},
    )


def scenarios() -> tuple[Scenario, ...]:
    """Return the fourteen groups."""
    none = Case("no gross error", 0, 0.0)
    out = [
        _group(f"G0{letter}", f" without gross errors, priors of {prior:g} m^2.", prior, none)
        for letter, prior in (("A", 10.0), ("B", 100.0))
    ]
    for group, (size_um, prior, printed) in _GROUPS.items():
        for (letter, number), (right, wrong, missed) in zip(_NUMBERS.items(), printed, strict=True):
            about = (
                f", {number} gross errors of {size_um} um, priors of {prior:g} m^2; its one "
                f"experiment: {right} right, {wrong} wrong, {missed} missed."
            )
            known = _INDEPENDENT if (group, letter) == ("G3", "C") else None
            case = case_of(number, size_um / _SIGMA_UM)
            out.append(_group(group + letter, about, prior, case, known))
    return tuple(out)


_INDEPENDENT: dict[QuantityKey, float] = {
    ("10 of 18 sigma", "rms", "right"): 0.8,
    ("10 of 18 sigma", "baarda", "right"): 4.0,
    ("10 of 18 sigma", "baarda", "wrong"): 3.8,
    ("10 of 18 sigma", "search", "right"): 4.6,
    ("10 of 18 sigma", "search", "wrong"): 3.0,
}
"""Found independently with priors of 10 m^2."""
