"""All strategies on the same random blocks of tilted photos: errors found, accuracy gained.

In blocks without tilts an x row of two rays checks nothing at all; with tilts it checks a little,
and whoever rejects it moves the ground. So the errors on the ground stand beside what was found.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from anaplot.adjustment.findings import SearchSettings
from anaplot.adjustment.residualsystem import ResidualSystem
from anaplot.adjustment.significance import critical_normal
from anaplot.adjustment.strategies import reject_beyond
from anaplot.aliases import Array
from anaplot.planning.montecarlo import QuantityKey, Scenario, Tally, sums
from anaplot.planning.quantities import COUNT, MEASURE, Quantity, out_of
from anaplot.planning.rejections import rejected_rows
from anaplot.planning.scenarioalpha import PAPER_ALPHA
from anaplot.planning.tiltedblock import TiltedBlock, tilted_block
from anaplot.planning.truncated import truncated_residuals

__all__ = ["NOTHING", "TiltedOutcome", "TiltedScenario", "TiltedTrial", "scenarios"]


NOTHING = "none"
"""The method that rejects nothing."""

_REFERENCE = "gnc"
_STRATEGIES = ("baarda", "tau", "rms", "huber", "danish", "l1", _REFERENCE, "search", "odds")


class TiltedOutcome(NamedTuple):
    """What a method did in one block; rms errors over all points on the ground [m]."""

    right: int
    wrong: int
    missed: int
    plan: float
    height: float


_QUANTITIES = ("right", "wrong", "missed", "rms XY [m]", "rms Z [m]")


@dataclass(frozen=True, slots=True)
class TiltedScenario:
    """Gross errors of some sizes and numbers in image coordinates, a new block in every run.

    Attributes
    ----------
    name, about, methods, runs, chunk, references
        See `Scenario`. "none" rejects nothing; "gnc" is truncated least squares.
    sizes
        Of the errors [sigma].
    numbers
        How many are planted; one case each with every size.
    alpha
        Significance of a single row.
    """

    name: str
    about: str
    sizes: tuple[float, ...] = (6.0, 10.0, 18.0)
    numbers: tuple[int, ...] = (1, 5, 10, 20)
    references: Mapping[QuantityKey, float] = field(default_factory=dict)
    methods: tuple[str, ...] = (NOTHING, *_STRATEGIES)
    runs: int = 200
    chunk: int = 5
    alpha: float = PAPER_ALPHA

    def prepare(self) -> TiltedTrial:
        """Get ready; the blocks are drawn in the runs."""
        return TiltedTrial(self)


class TiltedTrial:
    """See `Trial`."""

    def __init__(self, scenario: TiltedScenario) -> None:
        self._alpha = scenario.alpha
        self._cases = {
            f"{number} of {size:g} sigma": (number, size)
            for size in scenario.sizes
            for number in scenario.numbers
        }

    def remarks(self) -> tuple[str, ...]:
        """Say what the figures are."""
        return (
            "ten photos in two strips, some 45 points of which a third has two rays, some 300 rows "
            "and a redundancy of about 100; a new block in every run, the same for all methods",
            f"{NOTHING}: nothing is rejected; gnc: truncated least squares, then as l1; modified "
            "does what baarda does, for its model values would be the exact ones",
            "rms: over all points on the ground against the truth, mean of the runs",
        )

    def quantities(self, methods: tuple[str, ...]) -> dict[QuantityKey, Quantity]:
        """Say what is counted."""
        out: dict[QuantityKey, Quantity] = {}
        for case, (number, _) in self._cases.items():
            kinds = (out_of(number), COUNT, out_of(number), MEASURE, MEASURE)
            for method in methods:
                out.update(
                    ((case, method, what), kind)
                    for what, kind in zip(_QUANTITIES, kinds, strict=True)
                )
        return out

    def run(self, rng: np.random.Generator, runs: int, methods: tuple[str, ...]) -> Tally:
        """Draw blocks and errors, reject, count."""
        tally: Tally = {}
        for case in self._cases:
            outcomes = [self.one(rng, case, methods) for _ in range(runs)]
            for method in methods:
                values = np.array([outcome[method] for outcome in outcomes], dtype=float)
                for k, what in enumerate(_QUANTITIES):
                    tally[case, method, what] = sums(values[:, k])
        return tally

    def one(
        self, rng: np.random.Generator, case: str, methods: tuple[str, ...]
    ) -> dict[str, TiltedOutcome]:
        """Return what every method does in one block."""
        number, size = self._cases[case]
        block = tilted_block(rng)
        errors = rng.standard_normal(len(block.names))
        planted = rng.choice(block.image_rows, number, replace=False)
        errors[planted] += size * rng.choice((-1.0, 1.0), number)
        found = _rejected(block.residuals(errors), methods, self._alpha)
        return {m: _outcome(block, errors, planted.tolist(), found[m]) for m in methods}


def _rejected(
    system: ResidualSystem, methods: tuple[str, ...], alpha: float
) -> dict[str, tuple[int, ...]]:
    found = rejected_rows(system, [m for m in methods if m not in (NOTHING, _REFERENCE)], alpha)
    found[NOTHING] = ()
    if _REFERENCE in methods:
        size = np.abs(truncated_residuals(system, critical_normal(alpha)))
        found[_REFERENCE] = reject_beyond(system, size, SearchSettings(alpha=alpha))
    return found


def _outcome(
    block: TiltedBlock, errors: Array, planted: list[int], found: tuple[int, ...]
) -> TiltedOutcome:
    right = len(set(planted).intersection(found))
    off = np.square(block.point_errors(errors, found)).mean(axis=0)
    return TiltedOutcome(
        right,
        len(found) - right,
        len(planted) - right,
        float(np.sqrt(off[:2].sum())),
        float(np.sqrt(off[2])),
    )


def scenarios() -> tuple[Scenario, ...]:
    """Return the scenario of tilted blocks."""
    return (
        TiltedScenario(
            "strategies-tilted",
            "All strategies in blocks of tilted photos, 1 to 20 gross errors of 6, 10 and 18 "
            "sigma: what they find, and the error on the ground.",
        ),
    )
