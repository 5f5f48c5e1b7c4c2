"""Size and power of the tests in an aerial block, and the strategies with several errors in it.

The block is that of Gruen 1980, Figure 2: 4 x 4 photos, nine points each (six at strip ends), inner
rays measured in two models, full control on the perimeter every second base, height in the middle.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.sparse import csr_array

from anaplot.adjustment.batch import batch_test
from anaplot.adjustment.residualsystem import DenseResiduals
from anaplot.adjustment.significance import (
    TESTABLE,
    noncentrality,
    tau_power,
)
from anaplot.aliases import Array, Bools
from anaplot.photogrammetry.rotation import rotation_matrix
from anaplot.planning.linearrows import image_design, residual_matrix
from anaplot.planning.montecarlo import QuantityKey, Scenario, Tally, sums
from anaplot.planning.plantederrors import Case, ErrorsScenario, case_of, hard_to_tell, run_by_run
from anaplot.planning.quantities import YES_OR_NO, Quantity, share
from anaplot.planning.rejections import SURE, rejected_rows

__all__ = [
    "BlockSizeScenario",
    "gruen_design",
    "gruen_matrix",
    "scenarios",
]


_PHOTOS = 4
_CONTROL = (0.0, 1.5, 3.0)
_HEIGHT = 150.0 / 92.0  # in bases
_ALPHAS = (0.001, 0.05)
_POWER = 0.80
_REDUNDANCY = 170
_TILT_DEG = 3.0
_SHAPE = 4  # of the generator: the one realisation of the tilts
_STRATEGIES = ("rms", "tau", "baarda", "huber", "danish", "l1", "search", "odds", "sure")


def gruen_design(tilt_deg: float = 0.0) -> Array:
    """Return (n, u) derivatives of the block's image coordinates; rows: rays, in them x and y.

    Parameters
    ----------
    tilt_deg
        Largest tilt of a photo about any axis, drawn once; the paper's photos have none.
    """
    steps = np.arange(_PHOTOS, dtype=float)
    points = [(x, y, 0.0) for y in np.arange(-1.0, _PHOTOS + 1) for x in steps]
    known = [[False] * 3 for _ in points]
    for x in _CONTROL:
        for y in _CONTROL:
            full = x in (0.0, _PHOTOS - 1.0) or y in (0.0, _PHOTOS - 1.0)
            if (x, y, 0.0) not in points:
                points.append((x, y, 0.0))
                known.append([False] * 3)
            known[points.index((x, y, 0.0))] = [full, full, True]
    rays = []
    for j in range(_PHOTOS):
        for i in range(_PHOTOS):
            for point, (x, y, _) in enumerate(points):
                if abs(x - i) < 1.01 and abs(y - j) < 1.01:
                    twice = x == i and 0 < i < _PHOTOS - 1
                    rays += [(j * _PHOTOS + i, point)] * (2 if twice else 1)
    centres = np.array([(i, j, _HEIGHT) for j in steps for i in steps])
    tilts = np.radians(
        np.random.default_rng(_SHAPE).uniform(-tilt_deg, tilt_deg, (len(centres), 3))
    )
    return image_design(
        centres,
        np.array([rotation_matrix(*angles) for angles in tilts.tolist()]),
        150.0,
        np.array(points, dtype=float),
        np.array(rays, dtype=np.intp),
        np.array(known),
    )


def gruen_matrix() -> Array:
    """Return (n, n) R of the block; see `gruen_design`."""
    return residual_matrix(gruen_design())


@dataclass(frozen=True, slots=True)
class BlockSizeScenario:
    """Rows flagged without error, and one error of the smallest detectable size; see `Scenario`."""

    name: str
    about: str
    references: Mapping[QuantityKey, float] = field(default_factory=dict)
    methods: tuple[str, ...] = ("baarda", "tau")
    runs: int = 5000
    chunk: int = 500
    alphas: tuple[float, ...] = _ALPHAS

    def prepare(self) -> _BlockSizeTrial:
        """Linearise the block."""
        return _BlockSizeTrial(self.alphas, gruen_matrix())


class _BlockSizeTrial:
    def __init__(self, alphas: tuple[float, ...], matrix: Array) -> None:
        self._alphas, self._matrix = alphas, matrix
        self._r = np.diag(matrix)
        self._testable = np.flatnonzero(self._r > 1e-6)

    def quantities(self, methods: tuple[str, ...]) -> dict[QuantityKey, Quantity]:
        """Say what is counted."""
        out: dict[QuantityKey, Quantity] = {}
        for alpha in self._alphas:
            for method in methods:
                out[_clean(alpha), method, "share of rows flagged"] = share(len(self._testable))
                out[_least(alpha), method, "row flagged"] = YES_OR_NO
                out[_least(alpha), method, "flagged and largest"] = YES_OR_NO
        return out

    def run(self, rng: np.random.Generator, runs: int, methods: tuple[str, ...]) -> Tally:
        """Test every row under no error, and the row in error under one."""
        tally: Tally = {}
        n, r = len(self._matrix), self._r
        redundancy = round(float(r.sum()))
        noise = rng.normal(size=(runs, n)) @ self._matrix
        rows = rng.choice(self._testable, runs)
        signs = rng.choice((-1.0, 1.0), runs)
        one = np.arange(runs)
        for alpha in self._alphas:
            least = noncentrality(alpha, _POWER) / np.sqrt(np.maximum(r, TESTABLE))
            wrong = noise + (signs * least[rows])[:, None] * self._matrix[rows]
            for method in methods:
                clean, critical = batch_test(method, noise, r, redundancy, alpha)
                hit, _ = batch_test(method, wrong, r, redundancy, alpha)
                assert critical is not None
                flagged = (clean[:, self._testable] > critical).mean(axis=1)
                largest = (np.argmax(hit, axis=1) == rows) & (hit[one, rows] > critical)
                tally[_clean(alpha), method, "share of rows flagged"] = sums(flagged)
                case = _least(alpha)
                tally[case, method, "row flagged"] = sums(hit[one, rows] > critical)
                tally[case, method, "flagged and largest"] = sums(largest)
        return tally

    def remarks(self) -> tuple[str, ...]:
        """Say what the block is."""
        return _facts(self._matrix)


def _clean(alpha: float) -> str:
    return f"no error, alpha {alpha:g}"


def _least(alpha: float) -> str:
    return f"smallest detectable error, alpha {alpha:g}"


def _facts(matrix: Array) -> tuple[str, ...]:
    n, r = len(matrix), np.diag(matrix)
    redundancy = round(float(r.sum()))
    return (
        f"n {n}, u {n - redundancy}, redundancy {redundancy}; "
        f"{int((r <= 1e-6).sum())} image coordinates cannot be tested",
    )


class _TiltedGeometry:
    """The block, tilted."""

    def __init__(self) -> None:
        design = gruen_design(_TILT_DEG)
        self._design, self._matrix = csr_array(design), residual_matrix(design)
        self.near = hard_to_tell(self._matrix)

    def planted(self, rng: np.random.Generator, runs: int, case: Case) -> tuple[Array, Bools]:
        errors = np.zeros((runs, len(self._matrix)))
        planted = np.zeros(errors.shape, dtype=bool)
        for one in range(runs):
            errors[one] = rng.normal(size=len(self._matrix))
            # in the order of a set: so the figures of a seed were made
            at = list(set(rng.choice(len(self._matrix), case.number, replace=False).tolist()))
            errors[one, at] += case.size * rng.choice((-1.0, 1.0), case.number)
            planted[one, at] = True
        return errors, planted

    def rejected(
        self, errors: Array, methods: tuple[str, ...], alpha: float
    ) -> Iterable[tuple[str, Bools]]:
        return run_by_run(
            errors, methods, lambda one: rejected_rows(self._system(one), methods, alpha)
        )

    def _system(self, errors: Array) -> DenseResiduals:
        matrix = self._matrix
        e, r = matrix @ errors, np.maximum(np.diag(matrix), 0.0)
        names = tuple((k // 2, "xy"[k % 2]) for k in range(len(e)))
        redundancy = round(float(r.sum()))
        return DenseResiduals(names, e, r, float(e @ e), redundancy, matrix, self._design)

    def remarks(self) -> tuple[str, ...]:
        """Say what the block is."""
        return (*_facts(self._matrix), SURE)


def scenarios() -> tuple[Scenario, ...]:
    """Return the scenarios of aerial blocks."""
    references: dict[QuantityKey, float] = {}
    for alpha in _ALPHAS:
        case = _least(alpha)
        for method in ("baarda", "tau"):
            references[_clean(alpha), method, "share of rows flagged"] = alpha
        references[case, "baarda", "row flagged"] = _POWER
        predicted = tau_power(noncentrality(alpha, _POWER), alpha, _REDUNDANCY)
        if predicted is not None:
            references[case, "tau", "row flagged"] = predicted
    return (
        BlockSizeScenario(
            "size-blocks",
            "An aerial block: how often the tests flag rows without error, and one error of the "
            "size found with power 0.80.",
            references,
        ),
        *(
            ErrorsScenario(
                f"block-errors-{size}",
                f"An aerial block, tilted by up to {_TILT_DEG:g} degrees, with 1, 5 and 10 gross "
                f"errors of {size} sigma: all strategies.",
                _TiltedGeometry,
                tuple(case_of(number, size) for number in (1, 5, 10)),
                _STRATEGIES,
                runs=50,
                chunk=5,
            )
            for size in (10, 20)
        ),
    )
