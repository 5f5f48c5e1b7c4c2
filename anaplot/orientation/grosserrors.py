"""Gross errors of models and strips: a strategy's rejected rows out, oriented again, and so on."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np

from anaplot.adjustment.cleaned import Cleaned
from anaplot.adjustment.cleaning import Attempts, Cleaning, SolvedWithout
from anaplot.adjustment.findings import Findings, SearchSettings
from anaplot.adjustment.scale import AprioriSigma, ScaleError, check_scale
from anaplot.adjustment.strategies import find_gross_errors, sigma_of
from anaplot.adjustment.tested import sigma0_known
from anaplot.adjustment.watch import Watch
from anaplot.aliases import Array, Bools, RowKey
from anaplot.errors import NotComputableError
from anaplot.orientation.model import WrongPointsError, orient
from anaplot.orientation.modelvalues import ideal_roots
from anaplot.orientation.pair import Stereopair
from anaplot.orientation.residuals import ModelResiduals, residual_system, residuals_at
from anaplot.orientation.results import ModelSolution
from anaplot.orientation.strip import BridgedStrip, bridge_strip
from anaplot.photogrammetry.block import Block, Precision, Strip, TestSettings
from anaplot.photogrammetry.pointchange import PointChange, point_change

__all__ = [
    "CleanedModel",
    "CleanedStrip",
    "model_gross_errors",
    "strategy_findings",
    "strip_gross_errors",
]


_TORN = 4.0  # sigma0 from which a cleaned orientation is a second place to begin


@dataclass(frozen=True, eq=False)
class CleanedModel(Cleaned[ModelSolution, RowKey, ModelResiduals]):
    """A model without the rows that a strategy rejects.

    Attributes
    ----------
    begun
        What the search began with: oriented with all rows that allow an orientation.
    """

    begun: SolvedWithout[ModelSolution, RowKey] = field(repr=False)

    @property
    def solution(self) -> ModelSolution:
        """Oriented without the rejected rows."""
        return self.end.solved.solution

    @property
    def begun_without(self) -> tuple[RowKey, ...]:
        """Rows that are left out to find an orientation at all, or one that shows wrong ones."""
        return self.begun.also

    @property
    def held(self) -> frozenset[RowKey]:
        """Rows of these that were not looked at: the strategy cannot cope with them."""
        return self.end.held

    @property
    def first(self) -> ModelSolution | None:
        """Oriented with all rows; None where there is no such orientation, or a torn one."""
        return None if self.begun_without else self.begun.solution

    @property
    def point_change(self) -> PointChange | None:
        """What it did to the model's points [mm]; None without an orientation with all rows.

        Standard deviations, under "exact", are those as seen from the right photo.
        """
        if self.first is None:
            return None
        before = {point.point: point[1:] for point in self.first.points}
        now = [point for point in self.solution.points if point.point in before]
        names = [point.point for point in now]
        sigmas = [_deviations(one, names) for one in (self.first, self.solution)]
        return point_change(
            names,
            np.array([before[name] for name in names]).reshape(-1, 3),
            np.array([point[1:] for point in now]).reshape(-1, 3),
            None if sigmas[0] is None or sigmas[1] is None else (sigmas[0], sigmas[1]),
        )

    @property
    def came_back(self) -> tuple[RowKey, ...]:
        """Rows that were left out at the beginning, in some pass or step, and are in at the end."""
        out = {*self.out, *(refused.name for refused in self.refused)}
        rows = dict.fromkeys((*self.begun_without, *self.taken_back))
        return tuple(key for key in rows if key not in out)


@dataclass(frozen=True, slots=True, eq=False)
class CleanedStrip:
    """A strip bridged without the rows that a strategy rejects.

    Attributes
    ----------
    bridged
        The strip as far as it could be bridged.
    models
        What was rejected in each of its models.
    """

    bridged: BridgedStrip
    models: tuple[CleanedModel, ...]


def strategy_findings(solution: ModelSolution, strategy: str) -> Findings:
    """Run a strategy on a model as it is oriented.

    With the significance of the model's test. "modified" takes its model values from the ideal
    model with the same points. A remark says so where the a-priori sigma cannot be right.

    Raises
    ------
    ValueError
        No such strategy.
    """
    system = residual_system(solution)
    settings = SearchSettings(alpha=solution.test.alpha)
    found = find_gross_errors(
        system,
        strategy,
        settings,
        models=ideal_roots(solution) if strategy == "modified" else None,
    )
    if sigma0_known(sigma_of(strategy)):
        name = f"model {solution.left}/{solution.right}"
        try:
            for judged in (None, found):
                check_scale(
                    system, judged, settings.alpha, AprioriSigma.image_um(name, solution.apriori_um)
                )
        except ScaleError as error:
            found = replace(found, remarks=(*found.remarks, error.doubt))
    return found


def _deviations(solution: ModelSolution, names: Sequence[str]) -> Array | None:
    """(n, 3) standard deviations of points [mm] with the a-priori sigma0; None but for "exact"."""
    if solution.exact is None:
        return None
    known = solution.exact.ties
    at = {name: k for k, name in enumerate(known.points)}
    variances = np.diag(known.covariance).reshape(-1, 3)[[at[name] for name in names]]
    return np.asarray(np.sqrt(np.maximum(variances, 0.0)) * solution.apriori_um * 1e-3)


class _ModelRows:
    """A model as it is cleaned; see `Relinearised`."""

    def __init__(self, pair: Stereopair, precision: Precision, test: TestSettings) -> None:
        self._pair, self._precision, self._test = pair, precision, test
        self.apriori = AprioriSigma.image_um(f"model {pair.name}", precision.image_um)

    def residuals(self, at: ModelSolution, number: int) -> ModelResiduals:
        """Return all rows, linearised at an orientation."""
        return residuals_at(self._pair, self._precision, at)

    def without(
        self, out: frozenset[RowKey], near: ModelSolution | None
    ) -> SolvedWithout[ModelSolution, RowKey]:
        """Orient without some rows, and without those of points that allow no orientation."""
        gone = sorted(out)
        also: list[RowKey] = []
        while True:
            off = self._pair.off.union(gone, also)
            try:
                solution = orient(replace(self._pair, off=off), self._precision, self._test)
            except WrongPointsError as error:
                new = _rows_of(self._pair, error.suspects[:1], [*gone, *also])
                if not new:
                    raise
            else:
                new = _rows_of(self._pair, solution.outliers[:1], [*gone, *also])
                if not new:
                    return SolvedWithout(solution, residual_system(solution).vtpv, tuple(also))
            also += new

    def suspects(self, system: ModelResiduals) -> Bools:
        """Return which rows may be rejected: all."""
        return np.ones(len(system.names), dtype=bool)

    def model_values(self, system: ModelResiduals, at: ModelSolution) -> Array:
        """Return model values of the ideal model with the same points."""
        return ideal_roots(at, system.names)

    def apart(self, system: ModelResiduals, at: ModelSolution) -> None:
        """Return None: a model is cleaned as one."""

    def price(self, out: frozenset[RowKey], at: ModelSolution, each: float) -> float:
        """Return that of every row that is out."""
        return each * len(out)

    def astray(self, error: NotComputableError) -> bool:
        """Whether the iteration has lost its way: one that has none tries the next set."""
        return False


def model_gross_errors(
    pair: Stereopair,
    precision: Precision,
    test: TestSettings,
    strategy: str,
    settings: SearchSettings | None = None,
    *,
    as_given: bool = False,
    watch: Watch | None = None,
) -> CleanedModel:
    """Orient a model, reject, orient again, and look at all rows again until the set repeats.

    Parameters
    ----------
    pair, precision, test
        As `orient` has them; rows that are off stay off and are not reported.
    strategy, settings
        As `find_gross_errors` has them; None: the significance of the test.
    as_given
        Search also where the residuals say that the a-priori sigma cannot be right.
    watch
        Told how far it is; where it asks for the end, the best so far is kept.

    Raises
    ------
    ScaleError
        The a-priori sigma cannot be right, and the strategy tests by it.
    NotComputableError
        The model cannot be oriented even so.
    ValueError
        No such strategy.

    Notes
    -----
    Where the orientation with all rows is torn (sigma0 above 4 a-priori sigmas), the one that the
    search ends with is a second place to begin. Where rows had to be left out to begin with, it is
    also tried what the strategy finds among the others alone: not every strategy can cope with
    errors so large. The best end counts: least v'Pv plus c^2 for every row that is out. Sets that
    come again without end are decided likewise.
    """
    used = SearchSettings(alpha=test.alpha, power=test.power) if settings is None else settings
    subject = _ModelRows(pair, precision, test)
    cleaning = Cleaning(subject, strategy, used, Watch() if watch is None else watch, as_given)
    attempts = Attempts(cleaning)
    begun = subject.without(frozenset(), None)
    attempts.begin(begun.solution, begun)
    sigma0 = begun.solution.sigma0_um
    torn = sigma0 is not None and sigma0 > _TORN * precision.image_um
    if strategy != "search" and torn and not attempts.ended:
        with suppress(NotComputableError):
            clean = replace(cleaning, strategy="search").run(begun.solution, begun)
            attempts.begin(clean.solved.solution, None)
    if begun.also:
        attempts.begin(begun.solution, begun._replace(also=()), frozenset(begun.also))
    end = attempts.best()
    return CleanedModel(end, (*sorted(end.out), *end.solved.also), begun)


def strip_gross_errors(
    block: Block,
    strip: Strip,
    strategy: str,
    settings: SearchSettings | None = None,
    *,
    as_given: bool = False,
    watch: Watch | None = None,
) -> CleanedStrip:
    """Bridge a strip; every model loses its rejected rows before the next one is tied to it.

    Parameters as `model_gross_errors` has them.

    Raises
    ------
    ValueError
        No such strategy.
    """
    cleaned: list[CleanedModel] = []

    def form(pair: Stereopair) -> ModelSolution:
        model = model_gross_errors(
            pair,
            block.precision,
            block.test,
            strategy,
            settings,
            as_given=as_given,
            watch=watch,
        )
        cleaned.append(model)
        return model.solution

    return CleanedStrip(bridge_strip(block, strip, form=form), tuple(cleaned))


def _rows_of(pair: Stereopair, points: tuple[str, ...], out: list[RowKey]) -> list[RowKey]:
    rows = [(point, "y") for point in points]
    rows += [(point, "x") for point in points if pair.ties is not None and point in pair.ties]
    return [row for row in rows if row not in out and row not in pair.off]
