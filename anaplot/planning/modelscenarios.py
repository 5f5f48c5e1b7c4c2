"""Scenarios on single models, with noise in the pseudo-observations (Kratky and El-Hakim 1983).

Every one of them is linear: the observations of a run leave e = R l, so that all runs of a chunk
are one matrix product. Errors are counted in a-priori sigmas of their row.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np

from anaplot.adjustment.batch import BATCH_TESTS, batch_test
from anaplot.adjustment.reliability import HARD_TO_TELL
from anaplot.adjustment.significance import (
    TESTABLE,
    noncentrality,
    tau_power,
)
from anaplot.aliases import Array, Bools
from anaplot.orientation.patterns import PATTERNS, pattern
from anaplot.planning.montecarlo import QuantityKey, Scenario, Tally, sums
from anaplot.planning.patternplan import from_pattern, solve
from anaplot.planning.plantederrors import hard_to_tell
from anaplot.planning.quantities import YES_OR_NO, Quantity, share
from anaplot.planning.scenarioalpha import PAPER_ALPHA
from anaplot.planning.scenarionames import scenario_of_pattern

__all__ = ["OneError", "SizeOfTests", "model_rows", "scenarios"]


POWER = 0.80
_B, _D, _C = 0.60 * 152.0, 0.66 * 152.0, 152.0  # NOTES: the proportions of the printed values
_SIZES = (6, 10, 20)
_FATES = ("detected", "right", "right or its partner", "wrong", "missed")
_SCATTER_MM, _MODELS, _LAID = 2.5, 40, 1983


@dataclass(frozen=True, slots=True, eq=False)
class _IdealRows:
    """R of an ideal model, and what turns whitened misclosures into parallaxes."""

    name: str
    matrix: Array = field(repr=False)
    root: Array = field(repr=False)
    redundancy: int

    @property
    def r(self) -> Array:
        return np.diag(self.matrix)

    @property
    def testable(self) -> Bools:
        return np.asarray(self.r >= TESTABLE)


def model_rows(name: str, scatter: Array | None = None) -> _IdealRows:
    """Return the rows of an ideal model with a named pattern, e.g. "13/5".

    Parameters
    ----------
    name
        The pattern.
    scatter
        (n, 2) how far the points lie from their ideal places [mm]; None: not at all.
    """
    plan = from_pattern(pattern(name), _B, _D, _C)
    if scatter is not None:
        moved = zip(plan.points, scatter.tolist(), strict=True)
        plan = replace(plan, points=tuple((p, x + dx, y + dy) for (p, x, y), (dx, dy) in moved))
    solution = solve(plan)
    root = np.sqrt(solution.q_l)
    return _IdealRows(name, solution.q_vv / root[:, None] / root, root, solution.redundancy)


@cache  # the same models, whoever asks
def _as_measured(name: str) -> tuple[_IdealRows, ...]:
    """Return models whose points lie where people set them: some millimetres off.

    At the ideal places two pairs of rows of 6/3 are exactly inseparable: rounding would decide.
    """
    rng = np.random.default_rng(_LAID)
    points = len(pattern(name).positions(_B, _D))
    return tuple(
        model_rows(name, rng.normal(scale=_SCATTER_MM, size=(points, 2))) for _ in range(_MODELS)
    )


def _tests(
    rows: _IdealRows, e: Array, methods: tuple[str, ...], alpha: float
) -> dict[str, tuple[Array, float]]:
    """Return (m, n) statistics and their critical value for every test asked that has one."""
    found: dict[str, tuple[Array, float]] = {}
    for name in BATCH_TESTS:
        if name in methods:
            statistic, critical = batch_test(name, e, rows.r, rows.redundancy, alpha)
            if critical is not None:
                found[name] = np.where(rows.testable, statistic, 0.0), critical
    return found


def _there(rows: _IdealRows, methods: tuple[str, ...], alpha: float) -> tuple[str, ...]:
    """Return the tests asked that there are."""
    return tuple(_tests(rows, np.zeros((1, len(rows.r))), methods, alpha))


@dataclass(frozen=True, slots=True)
class OneError:
    """One gross error in any row: found by the tests, and by the eye for the largest parallax."""

    name: str
    pattern: str
    references: Mapping[QuantityKey, float] = field(default_factory=dict, repr=False)
    methods: tuple[str, ...] = ("baarda", "tau", "largest parallax")
    runs: int = 10_000
    chunk: int = 2_000
    alpha: float = PAPER_ALPHA

    @property
    def about(self) -> str:
        """What it is."""
        one = pattern(self.pattern)
        tied = f"{len(one.ties)} ties" if one.ties else "no scale transfer"
        points = f"{len(one.labels)} points ({one.arrangement})"
        return f"one gross error in a model of {points}, {tied} (1983)"

    def prepare(self) -> _OneErrorTrial:
        """Orient the models."""
        return _OneErrorTrial(_as_measured(self.pattern), self.alpha)


@dataclass(frozen=True, slots=True, eq=False)
class _OneErrorTrial:
    models: tuple[_IdealRows, ...]
    alpha: float

    def quantities(self, methods: tuple[str, ...]) -> dict[QuantityKey, Quantity]:
        tests = _there(self.models[0], methods, self.alpha)
        found = [(name, what) for name in tests for what in _FATES]
        if "largest parallax" in methods:
            found.append(("largest parallax", "right"))
        return {(f"{size} sigma", *key): YES_OR_NO for size in _SIZES for key in found}

    def remarks(self) -> tuple[str, ...]:
        low = min(float(rows.r.min()) for rows in self.models)
        high = max(float(rows.r.max()) for rows in self.models)
        n = len(self.models[0].r)
        partners = np.mean([hard_to_tell(rows.matrix).any() for rows in self.models])
        return (
            f"{n} rows, redundancy {self.models[0].redundancy}, redundancy numbers {low:.3f} to "
            f"{high:.3f}; {_MODELS} models, their points {_SCATTER_MM} mm (1 sigma) from the "
            "ideal places",
            f"{100.0 * partners:.0f} % of the models hold rows with residual correlation of "
            f"{HARD_TO_TELL} or more; where they do, 'right' depends on how far the points are "
            "scattered (6/3, 20 sigma: 0.74 at the ideal places, where rounding decides between "
            "rows, 0.81 at 2.5 mm, 0.86 at 5 mm), 'right or its partner' does not",
        )

    def run(self, rng: np.random.Generator, runs: int, methods: tuple[str, ...]) -> Tally:
        tally: Tally = {}
        for size in _SIZES:
            model = np.sort(rng.integers(len(self.models), size=runs))
            parts: list[dict[tuple[str, str], Bools]] = []
            for k in np.unique(model).tolist():
                count = int((model == k).sum())
                parts.append(_with_one_error(self.models[k], rng, count, size, methods, self.alpha))
            for method, quantity in parts[0]:
                values = np.concatenate([part[method, quantity] for part in parts])
                tally[f"{size} sigma", method, quantity] = sums(values)
        return tally


def _with_one_error(
    rows: _IdealRows,
    rng: np.random.Generator,
    runs: int,
    size: float,
    methods: tuple[str, ...],
    alpha: float,
) -> dict[tuple[str, str], Bools]:
    """Return what became of (runs,) single errors, by method and quantity."""
    n, at, near = len(rows.r), np.arange(runs), hard_to_tell(rows.matrix)
    wrong = rng.integers(n, size=runs)
    errors = rng.standard_normal((runs, n))
    errors[at, wrong] += size * rng.choice((-1.0, 1.0), runs)
    e = errors @ rows.matrix
    out: dict[tuple[str, str], Bools] = {}
    for method, (statistic, critical) in _tests(rows, e, methods, alpha).items():
        largest = statistic.argmax(axis=1)
        found = statistic[at, largest] > critical
        right = found & (largest == wrong)
        fates = (found, right, right | (found & near[largest, wrong]), found & ~right, ~found)
        out |= {(method, what): fate for what, fate in zip(_FATES, fates, strict=True)}
    if "largest parallax" in methods:
        out["largest parallax", "right"] = np.abs(e * rows.root).argmax(axis=1) == wrong
    return out


@dataclass(frozen=True, slots=True)
class SizeOfTests:
    """No error: the size of every test is its alpha. One error: its power is as predicted.

    The error planted for the power is the smallest detectable one of its row.
    """

    name: str = "size-models"
    about: str = "size and power of the tests on single models, noise in the pseudo-observations"
    methods: tuple[str, ...] = ("baarda", "tau")
    runs: int = 20_000
    chunk: int = 5_000
    patterns: tuple[str, ...] = ("6/3", "9/3", "13", "13/5", "15/5")
    alpha: float = PAPER_ALPHA

    @property
    def references(self) -> Mapping[QuantityKey, float]:
        """The alpha of the tests, and the power computed for them."""
        known: dict[QuantityKey, float] = {}
        delta = noncentrality(self.alpha, POWER)
        for name in self.patterns:
            rows = model_rows(name)
            power = tau_power(delta, self.alpha, rows.redundancy)
            known[name, "baarda", "size"] = self.alpha
            known[name, "baarda", "power"] = POWER
            if power is not None:
                known[name, "tau", "size"] = self.alpha
                known[name, "tau", "power"] = power
        return known

    def prepare(self) -> _ModelSizeTrial:
        """Orient the ideal models."""
        return _ModelSizeTrial(tuple(model_rows(name) for name in self.patterns), self.alpha)


@dataclass(frozen=True, slots=True, eq=False)
class _ModelSizeTrial:
    models: tuple[_IdealRows, ...]
    alpha: float

    def quantities(self, methods: tuple[str, ...]) -> dict[QuantityKey, Quantity]:
        return {
            (rows.name, method, what): share(int(rows.testable.sum())) if k == 0 else YES_OR_NO
            for rows in self.models
            for k, what in enumerate(("size", "power"))
            for method in _there(rows, methods, self.alpha)
        }

    def remarks(self) -> tuple[str, ...]:
        return (
            f"size: share of testable rows flagged, alpha {self.alpha:g}; power: share of errors "
            f"flagged that have the size found with {100.0 * POWER:.0f} % by the test with known "
            "sigma",
        )

    def run(self, rng: np.random.Generator, runs: int, methods: tuple[str, ...]) -> Tally:
        tally: Tally = {}
        delta = noncentrality(self.alpha, POWER)
        for rows in self.models:
            n = len(rows.r)
            noise = rng.standard_normal((runs, n))
            e = noise @ rows.matrix
            for method, (statistic, critical) in _tests(rows, e, methods, self.alpha).items():
                flagged = (statistic > critical)[:, rows.testable].mean(axis=1)
                tally[rows.name, method, "size"] = sums(flagged)
            places = np.flatnonzero(rows.testable)
            wrong = rng.choice(places, runs)
            size = delta / np.sqrt(rows.r[wrong]) * rng.choice((-1.0, 1.0), runs)
            e = e + rows.matrix[wrong] * size[:, None]
            for method, (statistic, critical) in _tests(rows, e, methods, self.alpha).items():
                tally[rows.name, method, "power"] = sums(
                    statistic[np.arange(runs), wrong] > critical
                )
        return tally


_FOUND: dict[str, dict[QuantityKey, float]] = {
    "6/3": {
        ("20 sigma", "baarda", "right"): 0.81,
        ("20 sigma", "largest parallax", "right"): 0.40,
    },
    "9/3": {
        ("20 sigma", "baarda", "right"): 1.00,
        ("20 sigma", "largest parallax", "right"): 0.67,
    },
    "13/5": {("20 sigma", "baarda", "right"): 1.00},
}
"""Found independently with known sigma."""


def scenarios() -> tuple[Scenario, ...]:
    """Return the scenarios on single models."""
    one = [OneError(scenario_of_pattern(name), name, _FOUND.get(name, {})) for name in PATTERNS]
    return (*one, SizeOfTests())
