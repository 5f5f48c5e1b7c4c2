"""A strip against another one, or against the ground: the similarity by the points both have."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

from anaplot.errors import NotComputableError
from anaplot.orientation.stripgeometry import StripGeometry
from anaplot.orientation.striptie import Placed, StripTie, System, tie_systems
from anaplot.photogrammetry.block import Block, ControlPoint
from anaplot.planning.modelplan import Candidates
from anaplot.session import elsewhere
from anaplot.session.remembering import remembered

__all__ = [
    "GROUND",
    "NOTHING_KNOWN",
    "Known",
    "TieCheck",
    "TiedStrip",
    "check_tie",
    "control_placed",
    "tie_to",
]

GROUND = "control"
"""What the ground is called beside the names of strips."""

_OUTLIERS = 3  # common points that are left out at most before others are placed by the rest


@dataclass(frozen=True, slots=True, eq=False)
class Known:
    """What is known from elsewhere.

    Attributes
    ----------
    control
        Control and check points, those that are off left out.
    candidates
        Approximate image coordinates of marked points by photo, or None.
    """

    control: tuple[ControlPoint, ...] = ()
    candidates: Candidates | None = None

    @classmethod
    def of(cls, control: Iterable[ControlPoint], candidates: Candidates | None) -> Known:
        """Return it from a block's control and its candidates."""
        return cls(tuple(c for c in control if c.use != "off"), candidates)


NOTHING_KNOWN = Known()


@dataclass(frozen=True, slots=True, eq=False)
class TieCheck:
    """The strip in work against another one, or against the ground.

    Attributes
    ----------
    strip, other
        Names; the other is `GROUND` for the control.
    common
        Number of common points.
    tie
        The similarity by all of them; None while there is none.
    problem
        Why not.
    cleaned
        The one by those that agree; `tie` where all do.
    wrong
        Points that certainly do not agree with the others, the worst first.
    unit_m
        Metres for a unit of the discrepancies; None while the ground is not known.
    """

    strip: str
    other: str
    common: int
    tie: StripTie | None
    problem: str = ""
    cleaned: StripTie | None = None
    wrong: tuple[str, ...] = ()
    unit_m: float | None = None

    @property
    def named(self) -> str:
        """The other one in words."""
        return "the control" if self.other == GROUND else f"strip {self.other}"


class TiedStrip(NamedTuple):
    """A strip that is compared with others.

    Attributes
    ----------
    name
        Its name.
    whole
        The strip as far as it is oriented; None where it is not.
    near
        Those of its points that tie it; None where it is not oriented.
    """

    name: str
    whole: StripGeometry | None
    near: System | None


def check_tie(block: Block, known: Known, strip: TiedStrip, name: str, other: System) -> TieCheck:
    """Compare a strip with another system.

    Parameters
    ----------
    block, known
        Its precision and test, and what is known from elsewhere.
    strip
        The strip.
    name, other
        The other system: a strip's name, or `GROUND`.
    """
    this = strip.near
    if this is None:
        return TieCheck(strip.name, name, 0, None, "the strip is not oriented yet")
    common = [p for p in this.points if p in other.points]
    try:
        tie, cleaned, wrong = _cleaned(block, known, strip, this, other, ground=name == GROUND)
    except NotComputableError as error:
        return TieCheck(strip.name, name, len(common), None, str(error))
    unit = 1.0 / cleaned.similarity.scale if name == GROUND else None
    return TieCheck(strip.name, name, len(common), tie, "", cleaned, wrong, unit)


def tie_to(
    block: Block,
    known: Known,
    this: System,
    other: System,
    without: Iterable[str] = (),
    models: tuple[float, int] = (0.0, 0),
    *,
    ground: bool = False,
) -> StripTie:
    """Return the similarity of two systems; to the ground no check point helps to determine it.

    Raises
    ------
    NotComputableError
        Their common points do not determine it.
    """
    if ground:
        checks = (c.point for c in known.control if c.use == "check")
        without = (*without, *checks)
    sigma0 = block.precision.image_um * 1e-3
    return tie_systems(this, other, sigma0, block.test, without=set(without), models=models)


@remembered
def control_placed(block: Block, known: Known, other: System) -> Placed | None:
    """Return a strip with the control that its own fit to it places; None where it places none."""
    whole = elsewhere.ground(block, known.control)
    missing = whole.points.keys() - other.points.keys()
    if not missing:
        return None
    try:
        fit = tie_to(block, known, other, whole, ground=True)
    except NotComputableError:
        return None
    return Placed(dict(other.points) | fit.placed(missing), fit.count)


def _cleaned(
    block: Block, known: Known, strip: TiedStrip, this: System, other: System, *, ground: bool
) -> tuple[StripTie, StripTie, tuple[str, ...]]:
    """Return the similarity by all points, that by those which agree, and the others."""
    models = _sums(strip.whole, other)
    tie = now = tie_to(block, known, this, other, (), models, ground=ground)
    out = tie.gross
    while (wrong := now.surely_wrong) is not None and len(out) < _OUTLIERS:
        out = (*out, wrong)
        now = tie_to(block, known, this, other, out, models, ground=ground)
    if now.surely_wrong is not None:
        return tie, tie, tie.gross  # more are wrong than can be told
    return tie, now, out


def _sums(*systems: System | None) -> tuple[float, int]:
    """Return v'Pv and redundancy of the models of strips."""
    strips = [s for s in systems if isinstance(s, StripGeometry)]
    return sum(s.vtpv for s in strips), sum(s.redundancy for s in strips)
