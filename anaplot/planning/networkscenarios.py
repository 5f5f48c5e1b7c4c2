"""The comparison of 1978: data snooping against thresholds on the residual, over many noises.

Five arrangements of cameras around a cube, four cases of gross errors of -30 um each (Gruen 1978,
Figure 2 and Table 1): 18 runs with 23 gross errors, without the two in spur observations.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from anaplot.adjustment.batch import reject_stepwise
from anaplot.adjustment.consistency import global_from_single
from anaplot.adjustment.reliability import HARD_TO_TELL, residual_correlations
from anaplot.adjustment.significance import TESTABLE, noncentrality
from anaplot.aliases import Array, Bools
from anaplot.planning.linearrows import image_design, residual_matrix
from anaplot.planning.montecarlo import QuantityKey, Scenario, Tally, sums
from anaplot.planning.networkplan import CUBE_VERSIONS, cube
from anaplot.planning.quantities import COUNT, YES_OR_NO, Quantity, out_of
from anaplot.planning.scenarioalpha import PAPER_ALPHA

__all__ = ["GruenScenario", "scenarios"]


_CASES = {"a": ((0, 0),), "b": ((0, 0), (0, 1)), "c": ((1, 0),), "d": ((1, 1),)}
"""(point, axis) of the first image; point 0 is control, point 1 is not."""

_SPURS = ("Ac", "Bc")
_SIGMA_UM = 5.0
_ERROR = -30.0 / _SIGMA_UM
_POWER = 0.80
_ALL = "23 errors in 18 runs"
_METHODS = ("snooping", "3 sigma0", "3 sigma0_hat", "global test")


@dataclass(frozen=True, slots=True)
class GruenScenario:
    """All runs of the comparison under one noise are one run here; see `Scenario`."""

    name: str
    about: str
    references: Mapping[QuantityKey, float] = field(default_factory=dict)
    methods: tuple[str, ...] = _METHODS
    runs: int = 500
    chunk: int = 50
    alpha: float = PAPER_ALPHA

    def prepare(self) -> _GruenTrial:
        """Linearise the five arrangements."""
        return _GruenTrial(self.alpha)


class _GruenTrial:
    def __init__(self, alpha: float) -> None:
        self._alpha = alpha
        self._matrices = {name: _matrix(name) for name in CUBE_VERSIONS}
        self._equal = {name: _equal(matrix) for name, matrix in self._matrices.items()}

    def quantities(self, methods: tuple[str, ...]) -> dict[QuantityKey, Quantity]:
        """Return what is counted, figures of all runs together first."""
        counting = [method for method in methods if method != "global test"]
        every: dict[QuantityKey, Quantity] = {}
        planted = 0
        for name in self._matrices:
            if "global test" in methods:
                every[f"{name}, no gross error", "global test", "rejected"] = YES_OR_NO
            for case, rows in _CASES.items():
                label = name + case
                planted += len(rows) if label not in _SPURS else 0
                if "global test" in methods:
                    every[label, "global test", "rejected"] = YES_OR_NO
                for method in counting:
                    every[label, method, "right"] = out_of(len(rows))
                    every[label, method, "wrong"] = COUNT
        return {
            (_ALL, method, what): out_of(planted) if what == "right" else COUNT
            for method in counting
            for what in ("right", "wrong")
        } | every

    def run(self, rng: np.random.Generator, runs: int, methods: tuple[str, ...]) -> Tally:
        """Make one noise for each arrangement, plant the errors of each case, count."""
        tally: Tally = {}
        totals = {method: np.zeros((2, runs)) for method in methods if method != "global test"}
        for name, matrix in self._matrices.items():
            noise = rng.normal(size=(runs, len(matrix)))
            if "global test" in methods:
                tally[f"{name}, no gross error", "global test", "rejected"] = sums(
                    _global(matrix, noise, self._alpha)
                )
            for case, rows in _CASES.items():
                planted = np.zeros(len(matrix), dtype=bool)
                planted[[2 * point + axis for point, axis in rows]] = True
                errors = noise + _ERROR * planted
                label = name + case
                if "global test" in methods:
                    tally[label, "global test", "rejected"] = sums(
                        _global(matrix, errors, self._alpha)
                    )
                for method, total in totals.items():
                    found = _found(matrix, errors, method, self._alpha)
                    if method == "snooping":
                        found = _by_lot(found, self._equal[name], rng)
                    right = (found & planted).sum(axis=1)
                    wrong = (found & ~planted).sum(axis=1)
                    tally[label, method, "right"] = sums(right)
                    tally[label, method, "wrong"] = sums(wrong)
                    if label not in _SPURS:
                        total += right, wrong
        for method, (right, wrong) in totals.items():
            tally[_ALL, method, "right"] = sums(right)
            tally[_ALL, method, "wrong"] = sums(wrong)
        # figures of all runs together come first
        return dict(sorted(tally.items(), key=lambda item: item[0][0] != _ALL))

    def remarks(self) -> tuple[str, ...]:
        """Say which failures must happen, and the significance of the global test."""
        out = []
        for name, matrix in self._matrices.items():
            r = np.diag(matrix)
            redundancy = round(float(r.sum()))
            test = global_from_single(self._alpha, _POWER, redundancy)
            out.append(
                f"{name}: r {redundancy}, global test alpha {test.alpha:.3f}, "
                f"c(theta) {test.critical:.3f}"
            )
        for name, matrix in self._matrices.items():
            r = np.diag(matrix)
            rho = residual_correlations(matrix, r)
            for case, rows in _CASES.items():
                for point, axis in rows:
                    row = 2 * point + axis
                    what = f"{name}{case}: {'xy'[axis]}' of point {point + 1}"
                    if r[row] < TESTABLE:
                        out.append(f"{what} is a spur observation: no test can find its error")
                        continue
                    if r[row] < 0.05:
                        least = _SIGMA_UM * noncentrality(self._alpha, _POWER) / r[row] ** 0.5
                        out.append(
                            f"{what} is nearly a spur observation: below {least:.0f} um its error "
                            "is not found"
                        )
                    others = np.abs(np.nan_to_num(rho[row]))
                    others[row] = 0.0
                    # of several as bad the one that shows its own errors best
                    worst = int(np.argmax(np.where(others > others.max() - 1e-3, r, -1.0)))
                    if others[worst] > HARD_TO_TELL:
                        photo, at = divmod(worst, len(matrix) // len(CUBE_VERSIONS[name]))
                        place = f"{'xy'[at % 2]}' of point {at // 2 + 1}"
                        kind = "cannot be located" if others[worst] > 0.999 else "is hard to locate"
                        out.append(
                            f"{what} {kind}: its residual correlates by "
                            f"{rho[row, worst]:+.4f} with {place} in image "
                            f"{CUBE_VERSIONS[name][photo]}"
                        )
        out.append("of rows whose residuals correlate perfectly snooping takes one by lot")
        return tuple(out)


def _found(matrix: Array, errors: Array, method: str, alpha: float) -> Bools:
    """Return (runs, n) the rows a method rejects."""
    if method == "snooping":
        return reject_stepwise(matrix, errors, "baarda", alpha)
    v = errors @ matrix
    limit = np.full(len(v), 3.0)
    if method == "3 sigma0_hat":
        limit *= np.sqrt(np.einsum("mn,mn->m", v, v) / np.trace(matrix))
    found: Bools = np.abs(v) > limit[:, None]
    return found


def _equal(matrix: Array) -> Bools:
    """Return (n, n) which rows always have the same abs(w)."""
    rho = residual_correlations(matrix, np.diag(matrix))
    equal: Bools = np.abs(np.nan_to_num(rho)) > 1.0 - 1e-7
    return equal


def _by_lot(found: Bools, equal: Bools, rng: np.random.Generator) -> Bools:
    """Exchange every row rejected for any row that could have been rejected instead of it.

    To reject the one or the other leaves the same adjustment, and rounding must not choose.
    """
    out = np.zeros_like(found)
    for run, row in np.argwhere(found & (equal.sum(axis=1) > 1)).tolist():
        out[run, rng.choice(np.flatnonzero(equal[row]))] = True
    out[:, equal.sum(axis=1) <= 1] = found[:, equal.sum(axis=1) <= 1]
    return out


def _global(matrix: Array, errors: Array, alpha: float) -> Bools:
    redundancy = round(float(np.trace(matrix)))
    v = errors @ matrix
    theta = np.einsum("mn,mn->m", v, v) / redundancy
    rejected: Bools = theta > global_from_single(alpha, _POWER, redundancy).critical
    return rejected


def _matrix(name: str) -> Array:
    """Return R of an arrangement; rows: images, in them points, in them x' and y'."""
    network = cube(name)
    control = {known.point for known in network.control}
    stations = [network.stations[photo] for photo in CUBE_VERSIONS[name]]
    m = len(network.points)
    design = image_design(
        np.array([station.centre for station in stations]),
        np.array([station.rotation for station in stations]),
        network.cameras[0].c,
        np.array(list(network.points.values())),
        np.array([(f, p) for f in range(len(stations)) for p in range(m)], dtype=np.intp),
        np.array([[point in control] * 3 for point in network.points]),
    )
    return residual_matrix(design)


def scenarios() -> tuple[Scenario, ...]:
    """Return the comparison of 1978."""
    references: dict[QuantityKey, float] = {
        (_ALL, "snooping", "right"): 18.0,
        (_ALL, "snooping", "wrong"): 3.0,
        (_ALL, "3 sigma0", "right"): 14.0,
        (_ALL, "3 sigma0_hat", "right"): 9.0,
    }
    alphas = {"A": 0.213, "B": 0.213, "C": 0.369, "D": 0.450, "E": 0.450}
    references |= {
        (f"{name}, no gross error", "global test", "rejected"): alpha
        for name, alpha in alphas.items()
    }
    return (
        GruenScenario(
            "gruen-1978-methods",
            "Data snooping, abs(v) > 3 sigma0 and abs(v) > 3 sigma0_hat in the cube of 1978; its "
            "one noise: 19, 15 and 10 right, 2, 12 and 5 wrong.",
            references,
        ),
    )
