"""What the block as one bundle says, as a screen shows it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from anaplot.bundle.blockmap import BlockMap
    from anaplot.bundle.hypotheses.offsetadvice import OffsetAdvice
    from anaplot.planning.stabilizing import StabilizingSet

__all__ = [
    "SURE",
    "BlockView",
    "FlaggedCoordinate",
    "FlaggedObservation",
    "SuspectedPoint",
    "SuspectedRay",
    "percent",
    "unless_wrong",
]

SURE = 0.99
"""From this probability on a suspected measurement is to be looked at."""


def percent(probability: float) -> str:
    """Return a probability as people read it; certainty is never claimed."""
    if probability >= 0.995:
        return "over 99 %"
    return "under 1 %" if probability < 0.01 else f"{100.0 * probability:.0f} %"


class FlaggedCoordinate(NamedTuple):
    """An image coordinate that the block's test rejects.

    Attributes
    ----------
    photo, model
        The photo, and "left/right" of the model in which it was measured; None: from elsewhere.
    axis
        "x" or "y".
    w, r
        Standardized residual and redundancy number.
    """

    photo: str
    model: str | None
    axis: str
    w: float
    r: float


class FlaggedObservation(NamedTuple):
    """Control, a prior, a condition or a parameter that the block's test rejects.

    Attributes
    ----------
    kind
        "control", "point prior", "prior", "condition" or "parameter".
    what
        In words: "Z of control point 4".
    w
        Absolute standardized residual.
    """

    kind: str
    what: str
    w: float


class SuspectedRay(NamedTuple):
    """A measurement of a suspected point, and how probable it is that it is the wrong one.

    Attributes
    ----------
    photo, model
        As in `FlaggedCoordinate`.
    probability
        That this measurement holds the error, given that one of the point's does.
    """

    photo: str
    model: str | None
    probability: float


def unless_wrong(other: FlaggedObservation | None) -> str:
    """Return what is added where something may be wrong in a ray's place."""
    return "" if other is None else f", unless {other.what} is wrong"


@dataclass(frozen=True, slots=True)
class SuspectedPoint:
    """A point with flagged image coordinates.

    Attributes
    ----------
    point
        Name.
    flagged
        Its flagged coordinates, the largest abs(w) first; never empty.
    rays
        All its measurements, the most probably wrong one first; never empty.
    since
        The newest model of the block when it was first flagged; "" when only rows from elsewhere
        were in the block.
    newly
        Whether it was measured in an earlier model and only the newest one brings it to light.
    explained
        How probable it is that an error of the accused measurement is what shows, rather than
        chance; 0 where the others do not agree without it either.
    """

    point: str
    flagged: tuple[FlaggedCoordinate, ...]
    rays: tuple[SuspectedRay, ...]
    since: str
    newly: bool
    explained: float = 1.0

    @property
    def accused(self) -> SuspectedRay:
        """The measurement that is most probably the wrong one."""
        return self.rays[0]

    @property
    def size(self) -> float:
        """abs(w) of the flagged coordinate that shows most."""
        return abs(self.flagged[0].w)

    @property
    def certainty(self) -> float:
        """The probability that the accused measurement is wrong, and the only one of the point."""
        return self.accused.probability * self.explained


@dataclass(frozen=True, slots=True)
class BlockView:
    """The strip or block as one bundle, as far as it was last adjusted.

    Attributes
    ----------
    after
        "left/right" of the newest model in it; "" when it holds rows from elsewhere only.
    models
        Number of the session's models in it.
    provisional
        Whether the newest model is still in the instrument, not yet accepted.
    busy
        Whether an adjustment with what was measured since is under way.
    sigma0, sigma0_um
        Factor sqrt(v'Pv / redundancy) and the same times the a-priori sigma0 [um]; None without
        redundancy or without a solution.
    redundancy, photos, points, rays
        Counts; 0 without a solution.
    datum
        "control", "free" as long as control does not suffice, "" without a solution.
    test
        The test in force, e.g. "baarda 0.001".
    critical
        Critical value of a single test; None where there is none.
    ri_x, ri_y
        Mean redundancy numbers of all x and all y; None without a solution.
    suspects
        Points with flagged coordinates, the largest abs(w) first.
    aside
        Photos that do not hang together with the rest yet.
    remark
        Why there is no solution, or "".
    weak
        Photos with few redundant observations beside the others, the weakest first; without those
        of which a model is still to be measured.
    stabilizing
        Points that would help the weakest of them most.
    others
        What is flagged beside image coordinates, the largest w first.
    offsets
        Which offsets of its positions and angles measured in flight the block should have.
    block_map
        Where photos and points lie, and how well they are checked; None without a solution.
    by_chance
        Whether so much is flagged, and as far out, in one of twenty blocks where nothing is wrong.
    """

    after: str
    models: int
    provisional: bool
    busy: bool = False
    sigma0: float | None = None
    sigma0_um: float | None = None
    redundancy: int = 0
    photos: int = 0
    points: int = 0
    rays: int = 0
    datum: str = ""
    test: str = ""
    critical: float | None = None
    ri_x: float | None = None
    ri_y: float | None = None
    suspects: tuple[SuspectedPoint, ...] = ()
    aside: tuple[str, ...] = ()
    remark: str = ""
    weak: tuple[str, ...] = ()
    stabilizing: tuple[StabilizingSet, ...] = ()
    others: tuple[FlaggedObservation, ...] = ()
    offsets: tuple[OffsetAdvice, ...] = ()
    block_map: BlockMap | None = field(default=None, repr=False, compare=False)
    by_chance: bool = False

    @property
    def solved(self) -> bool:
        """Whether there is a solution."""
        return bool(self.datum)

    @property
    def clean(self) -> bool:
        """Whether all of it is solved on its control, and no more is flagged than by chance."""
        flagged = bool(self.suspects or self.others) and not self.by_chance
        return self.solved and self.datum != "free" and not (flagged or self.aside or self.remark)

    def unless(self, point: SuspectedPoint) -> FlaggedObservation | None:
        """Return what is flagged more than a point's rays, and may be why they are; or None.

        Wrong control bends the rays about it: of none of them is the block sure then.
        """
        first = self.others[0] if self.others else None
        return first if first is not None and first.w > point.size else None

    def of_earlier_models(self, current: str) -> tuple[SuspectedPoint, ...]:
        """Return the suspects whose accused measurement does not belong to the model `current`."""
        return tuple(point for point in self.suspects if point.accused.model != current)
