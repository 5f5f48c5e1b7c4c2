"""What a search for gross errors found, and how it came to it."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass, field, replace
from typing import Generic, Literal, NamedTuple, TypeVar

from anaplot.adjustment.reliability import HARD_TO_TELL
from anaplot.adjustment.tested import Odds
from anaplot.aliases import Array, Index

__all__ = [
    "FinalStatistics",
    "Findings",
    "HardToTell",
    "ModelValues",
    "PairOdds",
    "Rejection",
    "SearchSettings",
    "SearchStep",
]


K = TypeVar("K", bound=Hashable)

Action = Literal["add", "drop", "swap", "reject", "reweight"]


@dataclass(frozen=True, slots=True)
class SearchSettings:
    """Settings common to all strategies.

    Attributes
    ----------
    alpha
        Two-sided significance of one row.
    power
        Power of the smallest detectable errors that belong to the search.
    partner
        Residual correlation from which two rows are hard to tell apart.
    most
        Largest number of rows rejected; None: half of the redundancy, see `room`.
    pairs
        Whether the odds over pairs of gross errors are computed.

    Raises
    ------
    ValueError
        A value outside its range.
    """

    alpha: float = 0.001
    power: float = 0.80
    partner: float = HARD_TO_TELL
    most: int | None = None
    pairs: bool = False

    def __post_init__(self) -> None:
        if not 0.0 < self.alpha < 0.5:
            raise ValueError(f"alpha {self.alpha} must lie between 0 and 0.5")
        if not self.alpha < self.power < 1.0:
            raise ValueError(f"power {self.power} must lie between alpha {self.alpha} and 1")
        if not 0.0 < self.partner <= 1.0:
            raise ValueError(f"correlation {self.partner} must lie between 0 and 1")
        if self.most is not None and self.most < 0:
            raise ValueError(f"the largest number of rejected rows is {self.most}, less than none")

    def room(self, redundancy: int) -> int:
        """Return how many rows a strategy may reject at a redundancy.

        Half of it: as many errors as that have other explanations as good, and a test that takes
        its scale from what is left ends with next to nothing. One where there are two to spare.
        """
        half = min(max(redundancy // 2, 1), max(redundancy - 1, 0))
        return half if self.most is None else min(half, self.most)


class SearchStep(NamedTuple):
    """One action of a strategy.

    Attributes
    ----------
    action
        "reject" and "add" take rows out, "drop" brings them back, "swap" exchanges the second row
        for the first, "reweight" is one re-weighting of all rows named.
    rows
        Row indices; of a swap (taken out, brought back).
    statistic, critical
        What decided: abs(standardized residual) for single rows, the change of the objective for
        the search (against 0), the largest change of a weight for a re-weighting (against the
        change at which it ends). None without such a value.
    before, after
        v'Pv in a-priori sigmas before and after; for steps of the search the objective.
    """

    action: Action
    rows: tuple[int, ...]
    statistic: float | None
    critical: float | None
    before: float
    after: float


class Rejection(NamedTuple, Generic[K]):
    """A row that is rejected at the end, or left out for another reason.

    Attributes
    ----------
    row, name
        Index (None: no row of the system in which the search ended) and identity.
    order
        Place among the actions that took it out finally, from 1; rows taken out together share it.
        0: the strategy did not reject it, but no good solution is found with it.
    statistic, critical
        As in the step that took it out; None without one.
    error, sigma
        Estimated gross error of the row and its a-priori standard deviation, all others that are
        out left out as well; None when the remaining rows cannot tell.
    r
        Its redundancy number when it was rejected (before it was taken out); zero without a row. Of
        what was cleaned apart that in its place, what is out elsewhere being out.
    weight
        Factor of its weight at the end of a re-weighting; None without one.
    partners
        Rows that are kept and were hard to tell apart from it when it went.
    unit, apriori
        Of error and sigma ("" for a-priori sigmas of the row), and the a-priori standard deviation
        of the row in it.
    """

    row: int | None
    name: K
    order: int
    statistic: float | None
    critical: float | None
    error: float | None
    sigma: float | None
    r: float
    weight: float | None = None
    partners: tuple[K, ...] = ()
    unit: str = ""
    apriori: float = 1.0

    @property
    def w(self) -> float | None:
        """Standardized residual that it has when it alone comes back, a-priori sigma."""
        return None if self.error is None or self.sigma is None else self.error / self.sigma

    @property
    def r_back(self) -> float | None:
        """Redundancy number that it has when it alone comes back."""
        return None if self.sigma is None else (self.apriori / self.sigma) ** 2

    @property
    def residual(self) -> float | None:
        """What it then shows of its error."""
        share = self.r_back
        return None if self.error is None or share is None else share * self.error

    def measured(self, sigma: float, unit: str) -> Rejection[K]:
        """Return it in the unit of the row, given the row's a-priori standard deviation in it."""
        error = None if self.error is None else self.error * sigma
        deviation = None if self.sigma is None else self.sigma * sigma
        return self._replace(error=error, sigma=deviation, unit=unit, apriori=sigma)


class HardToTell(NamedTuple):
    """A rejected row, one that is kept, and the correlation of their residuals when it went."""

    rejected: int
    kept: int
    correlation: float


@dataclass(frozen=True, slots=True, eq=False)
class FinalStatistics:
    """The adjustment without the rejected rows, seen from every row.

    Attributes
    ----------
    w
        (n,) standardized residuals with the a-priori sigma; of a rejected row that of its error
        estimate; NaN where a row cannot be tested.
    r
        (n,) redundancy numbers; of a rejected row the one it has when it alone comes back.
    sigma0
        Estimated sigma of unit weight, in a-priori sigmas; None without redundancy.
    redundancy
        Number of remaining observations minus number of unknowns.
    vtpv
        v'Pv of what remains.
    weights
        (n,) factors of the a-priori weights; None but for the robust strategies.
    """

    w: Array
    r: Array
    sigma0: float | None
    redundancy: int
    vtpv: float
    weights: Array | None = None


@dataclass(frozen=True, slots=True, eq=False)
class PairOdds:
    """Posterior probabilities of no, one or two gross errors.

    Attributes
    ----------
    none
        Of none.
    single
        (n,) that row i alone holds one.
    rows, others, probability
        (k,) the most probable pairs, the most probable first.
    pairs
        That any two rows hold one each.
    marginal
        (n,) that row i holds one at all.
    """

    none: float
    single: Array
    rows: Index
    others: Index
    probability: Array
    pairs: float
    marginal: Array


class ModelValues(NamedTuple):
    """What a strategy by model values decided without exact values, and what differs.

    Attributes
    ----------
    computed
        Rows whose exact redundancy number it needed, counted once for every pass.
    decided
        Decisions by the model value alone, counted likewise.
    wrongly_accepted, wrongly_rejected
        Rows of the first pass that the exact test decides otherwise.
    beyond_tolerance
        Rows whose exact sqrt(q_vv) differs from the model value by more than the tolerance.
    """

    computed: int
    decided: int
    wrongly_accepted: tuple[int, ...]
    wrongly_rejected: tuple[int, ...]
    beyond_tolerance: int


@dataclass(frozen=True, slots=True, eq=False)
class Findings:
    """The outcome of a strategy.

    Attributes
    ----------
    strategy
        Its name.
    steps
        Every action in its order.
    rejected
        The rows rejected at the end, in the order in which they went.
    hard_to_tell
        Rejected rows and kept ones with highly correlated residuals.
    untestable
        Rows whose redundancy number is too small to test anything, with all rows in.
    at_end
        The adjustment that remains.
    odds
        Odds over single gross errors, all rows in.
    pair_odds
        Odds over pairs; None unless asked.
    model_values
        Only of "modified".
    remarks
        Sentences: what limited the strategy.
    weigh
        What makes the remarks of "odds" anew when sets are weighed as well; None: they are.
    held
        How rows stand at the end that are out for good, of what was cleaned apart.
    """

    strategy: str
    steps: tuple[SearchStep, ...]
    rejected: tuple[Rejection[Hashable], ...]
    hard_to_tell: tuple[HardToTell, ...]
    untestable: tuple[int, ...]
    at_end: FinalStatistics
    odds: Odds
    pair_odds: PairOdds | None = None
    model_values: ModelValues | None = None
    remarks: tuple[str, ...] = ()
    weigh: Callable[[], tuple[str, ...]] | None = field(default=None, repr=False)
    held: tuple[Rejection[Hashable], ...] = field(default=(), repr=False)

    @property
    def weighed(self) -> Findings:
        """The same with all remarks."""
        if self.weigh is None:
            return self
        return replace(self, remarks=self.weigh(), weigh=None)

    @property
    def rows(self) -> tuple[int, ...]:
        """Indices of the rejected rows."""
        return tuple(one.row for one in self.rejected if one.row is not None)

    @property
    def taken_out(self) -> tuple[int, ...]:
        """Rows that some step took out, also those that came back, in the order in which it did."""
        out: dict[int, None] = {}
        for step in self.steps:
            if step.action in ("add", "reject"):
                out.update(dict.fromkeys(step.rows))
            elif step.action == "swap":
                out[step.rows[0]] = None
        return tuple(out)
