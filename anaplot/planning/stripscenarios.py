"""Scenarios on bridged strips, with noise in the image coordinates: no step is linearised.

Every model is measured on its own, as in a stereo instrument, and tied to the one before. The x
rows of its ties then carry the noise of two models; whether the tests know it is the question.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from anaplot.adjustment.tested import AppliedTest
from anaplot.aliases import Array, TestKind
from anaplot.orientation.model import orient
from anaplot.orientation.results import ModelSolution
from anaplot.orientation.strip import stereopair
from anaplot.photogrammetry.block import Precision, TestSettings, TieVariance
from anaplot.planning.montecarlo import QuantityKey, Scenario, Tally, sums
from anaplot.planning.quantities import YES_OR_NO, Quantity, share
from anaplot.planning.scenarioalpha import PAPER_ALPHA
from anaplot.planning.synthetic import SyntheticStrip, synthetic_strip

__all__ = ["SizeInStrips", "scenarios"]


POWER = 0.80
_IMAGE_UM = 5.0
_PHOTOS, _SEED = 5, 1983
_POINTS_OF_15 = ("7'", "9'")  # outer points of the middle column, which the 13 points leave out
_METHODS = ("baarda", "tau")
_TIE_VARIANCES: tuple[TieVariance, ...] = ("propagated", "paper", "exact")
_RIGHT: tuple[TieVariance, ...] = ("propagated", "exact")  # variances as they are
_AXES = ("y", "x")


@dataclass(frozen=True, slots=True)
class SizeInStrips:
    """Size of the tests in strips without error, and power against one smallest detectable error.

    The models are those of the pattern 13/5.
    """

    name: str = "size-strips"
    about: str = "size and power of the tests in bridged strips, noise in the image coordinates"
    methods: tuple[str, ...] = _METHODS
    runs: int = 2_000
    chunk: int = 50
    alpha: float = PAPER_ALPHA

    @property
    def references(self) -> Mapping[QuantityKey, float]:
        """What tests promise whose variances are right; "paper" has those of another model."""
        sizes: dict[QuantityKey, float] = {
            (tie_variance, method, f"{axis} rows flagged"): self.alpha
            for tie_variance in _RIGHT
            for method in _METHODS
            for axis in _AXES
        }
        return sizes | {(one, "baarda", "power (y)"): POWER for one in _RIGHT}

    def prepare(self) -> _StripTrial:
        """Make the strip."""
        strip = synthetic_strip(_PHOTOS, seed=_SEED, image_um=_IMAGE_UM)
        return _StripTrial(strip, self.alpha)


@dataclass(frozen=True, slots=True, eq=False)
class _Measured:
    """True image coordinates of a model's points."""

    photos: tuple[str, str]
    points: tuple[str, ...]
    left: Array
    right: Array


class _StripTrial:
    """A strip of models, measured and bridged again and again."""

    def __init__(self, strip: SyntheticStrip, alpha: float) -> None:
        self._alpha = alpha
        declared = strip.block.strips[0]
        self._camera = strip.block.camera_of(declared.photos[0])
        self._base = declared.base
        self._models = []
        for left, right in declared.models():
            first, second = strip.truth[left], strip.truth[right]
            points = tuple(p for p in first if p in second and not p.endswith(_POINTS_OF_15))
            self._models.append(
                _Measured(
                    (left, right),
                    points,
                    np.array([first[p] for p in points]),
                    np.array([second[p] for p in points]),
                )
            )

    def quantities(self, methods: tuple[str, ...]) -> dict[QuantityKey, Quantity]:
        solutions = self._bridged(None, "propagated")
        out: dict[QuantityKey, Quantity] = {}
        for tie_variance in _TIE_VARIANCES:
            for method in methods:
                for axis in _AXES:
                    rows = sum(row.axis == axis for s in solutions for row in s.table)
                    out[tie_variance, method, f"{axis} rows flagged"] = share(rows)
            out |= {(tie_variance, method, "power (y)"): YES_OR_NO for method in methods}
        return out

    def remarks(self) -> tuple[str, ...]:
        return (
            f"{len(self._models)} models of 13 points, 5 of them ties; the x rows of the first "
            "model do not exist",
            "paper: the ties' model coordinates count as free of error, so that an x row has six "
            "times the variance it is tested with; propagated: they do not",
            "propagated still flags slightly more than alpha: v'Pv per redundancy is 1.04 to 1.06 "
            "in tied models, for their ties share the errors of the orientation before, which the "
            "variance of a single row leaves out; in the first model it is 1.01, from tilts of "
            "some degrees (0.99 without them)",
            "exact: the same orientation, with the covariance of all rows in the tests",
        )

    def run(self, rng: np.random.Generator, runs: int, methods: tuple[str, ...]) -> Tally:
        tally: Tally = {}
        for tie_variance in _TIE_VARIANCES:
            limits = self._detectable(tie_variance)
            found: dict[tuple[str, str], list[float]] = {}
            for _ in range(runs):
                self._one(rng, tie_variance, methods, limits, found)
            for (method, quantity), values in found.items():
                tally[tie_variance, method, quantity] = sums(values)
        return tally

    def _detectable(self, tie_variance: TieVariance) -> Array:
        """Return the smallest detectable errors of the last model's y rows [mm]."""
        rows = self._bridged(None, tie_variance)[-1].table
        return np.array([row.mdb or np.inf for row in rows if row.axis == "y"]) / 1000.0

    def _one(
        self,
        rng: np.random.Generator,
        tie_variance: TieVariance,
        methods: tuple[str, ...],
        limits: Array,
        found: dict[tuple[str, str], list[float]],
    ) -> None:
        solutions = self._bridged(rng, tie_variance)
        for method in methods:
            for axis in _AXES:
                flags = [f for s in solutions for f in _flags(s, method, axis, self._alpha)]
                found.setdefault((method, f"{axis} rows flagged"), []).append(float(np.mean(flags)))
        # the last model once more, with the smallest detectable error of a row
        model = self._models[-1]
        wrong = int(rng.choice(np.flatnonzero(np.isfinite(limits))))
        shift = np.zeros_like(model.right)
        shift[wrong, 1] = limits[wrong] * rng.choice((-1.0, 1.0))
        spoiled = self._oriented(model, rng, tie_variance, solutions[-2], shift)
        for method in methods:
            flags = _flags(spoiled, method, "y", self._alpha)
            found.setdefault((method, "power (y)"), []).append(float(flags[wrong]))

    def _bridged(
        self, rng: np.random.Generator | None, tie_variance: TieVariance
    ) -> list[ModelSolution]:
        solutions: list[ModelSolution] = []
        for model in self._models:
            before = solutions[-1] if solutions else None
            solutions.append(self._oriented(model, rng, tie_variance, before))
        return solutions

    def _oriented(
        self,
        model: _Measured,
        rng: np.random.Generator | None,
        tie_variance: TieVariance,
        before: ModelSolution | None,
        shift: Array | float = 0.0,
    ) -> ModelSolution:
        left, right = model.left, model.right + shift
        if rng is not None:
            left = left + rng.normal(scale=_IMAGE_UM / 1000.0, size=left.shape)
            right = right + rng.normal(scale=_IMAGE_UM / 1000.0, size=right.shape)
        pair = stereopair(
            model.photos,
            {p: (x, y) for p, (x, y) in zip(model.points, left.tolist(), strict=True)},
            {p: (x, y) for p, (x, y) in zip(model.points, right.tolist(), strict=True)},
            (self._camera, self._camera),
            preceding=before,
            base=self._base,
        )
        test = TestSettings("baarda", self._alpha, POWER)
        return orient(pair, Precision(_IMAGE_UM, tie_variance), test)


def _flags(solution: ModelSolution, method: str, axis: str, alpha: float) -> list[bool]:
    """Return which rows of an axis a test flags; `w` of the solution has the a-priori sigma."""
    kind: TestKind = "tau" if method == "tau" else "baarda"
    test = AppliedTest.of(TestSettings(kind, alpha, POWER), solution.redundancy)
    factor = test.factor(solution.tested.sigma0)
    limit = test.critical * factor if test.critical is not None and factor else None
    return [
        limit is not None and row.size is not None and row.size > limit
        for row in solution.table
        if row.axis == axis
    ]


def scenarios() -> tuple[Scenario, ...]:
    """Return the scenarios on strips."""
    return (SizeInStrips(),)
