"""Points known from elsewhere that are due in a model, and whether what was measured agrees.

Known from elsewhere are points of other strips and of the ground. Where they lie in the model's
photos follows from the similarity between the strips, or between strip and ground, by the points
that both have: from two such points on, better with every further one. Where all points are marked
beforehand, their marks say it from the first, and stated exterior orientations do so roughly.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Set
from dataclasses import dataclass, field, replace
from math import radians
from typing import Literal, NamedTuple

import numpy as np

from anaplot.errors import NotComputableError
from anaplot.orientation.stripgeometry import Located, Pose, StripGeometry, widened
from anaplot.orientation.striptie import Placed, StripTie, System
from anaplot.photogrammetry.block import Block
from anaplot.planning.modelplan import EDGE
from anaplot.session.elsewhere import NOTHING_ELSEWHERE, Elsewhere, consecutive, elsewhere, ground
from anaplot.session.events import PlannedPoint, Role
from anaplot.session.models import geometry_of
from anaplot.session.modelstate import ModelState
from anaplot.session.remembering import remembered
from anaplot.session.sight import Carried, Close, Place, Poses, Sight, in_view
from anaplot.session.state import SessionState
from anaplot.session.statedorientation import seen_by_stated, stated_control
from anaplot.session.tiecheck import (
    GROUND,
    NOTHING_KNOWN,
    Known,
    TieCheck,
    TiedStrip,
    check_tie,
    control_placed,
    tie_to,
)

__all__ = [
    "RECENT",
    "Mark",
    "Offer",
    "Transfer",
    "transfer",
    "transfer_of_strip",
]

Mark = Literal["", "lateral", "control"]
"""What a point is beside its role in the model: known in another strip, or on the ground."""
RECENT = 12
"""Models of the strip in work whose points tie it."""

_LATERAL = 3  # lateral ties that every model adds
_UNCERTAIN = 8.0  # mm: who drives there has to search a circle of this standard deviation at most
_STRAYED = 24.0  # chi-square of 3 degrees of freedom that chance exceeds once in 40 000
# what is not known of a right photo before it is measured: base and inclination
_BASE, _TILT = 0.05, radians(2.0)


class Offer(NamedTuple):
    """A point known from elsewhere that is due in the model.

    Attributes
    ----------
    planned
        The point, and where it is expected.
    mark
        What it is.
    source
        From where it is known: a strip's name, or `GROUND`.
    sigma
        Standard deviation of its expected place where it is largest [mm]; None where it is marked.
    """

    planned: PlannedPoint
    mark: Mark
    source: str
    sigma: float | None

    @property
    def words(self) -> str:
        """What it is, in words."""
        if self.mark == "lateral":
            return f"lateral tie with strip {self.source}"
        return "control point"


@dataclass(frozen=True, slots=True, eq=False)
class Transfer:
    """What follows for the model in work from what is known from elsewhere.

    Attributes
    ----------
    offers
        Points due in it, beyond its plan.
    checks
        Its strip against the other strips and against the control.
    marks
        What points known from elsewhere are.
    places
        Where they are expected in both photos [mm] by what is known of the others, with the
        standard deviation where it is largest; marked ones not among them. By
        `transfer_of_strip` the strips place none that is measured in the model: it is no longer in
        work, and a place by its own measurements would say nothing of them.
    strayed
        Points of the model that an earlier model of the strip, not the one before, has elsewhere:
        name, how far away [mm], and that model.
    hint
        What the operator is told while nothing can be offered, or "".
    """

    offers: tuple[Offer, ...] = ()
    checks: tuple[TieCheck, ...] = ()
    marks: Mapping[str, Mark] = field(default_factory=dict)
    places: Mapping[str, tuple[Place, float]] = field(default_factory=dict)
    strayed: tuple[tuple[str, float, str], ...] = ()
    hint: str = ""

    def offer(self, point: str) -> Offer | None:
        """Return the offer of a point, or None."""
        return next((o for o in self.offers if o.planned.point == point), None)


def transfer(state: SessionState, known: Known) -> Transfer:
    """Return what follows for the model in work; remembered."""
    return _transfer(state.block, state.models, state.current, known)


@remembered
def _transfer(
    block: Block, models: tuple[ModelState, ...], current: ModelState | None, known: Known
) -> Transfer:
    strip = _strip_in_work(models, current)
    own = tuple(m for m in models if m.strip == strip)
    again = {} if current is None else _again(own, current)
    others = any(m.strip != strip for m in models)
    if not strip or not (others or known.control or again):
        return Transfer()
    theirs = elsewhere(block, models, strip)
    return _InWork(block, theirs, own, current, known, strip, again).transfer()


def transfer_of_strip(
    block: Block,
    models: tuple[ModelState, ...],
    own: tuple[ModelState, ...],
    known: Known,
    last: int,
    reach: float,
) -> tuple[Transfer, ...]:
    """Return what a strip says of its last models, by the similarities that its last one has.

    What is offered is left out. The checks are those of the last model.

    Parameters
    ----------
    block
        Its cameras, precision and test.
    models
        The models of other strips.
    own
        Those of the strip, one at least.
    known
        What else is known.
    last
        How many of its models are asked for.
    reach
        How far in any image coordinate from a point of its model [mm] another one is told; how
        certain those are that lie farther away is not computed.

    Returns
    -------
    tuple of Transfer
        One for each, in order.
    """
    strip = own[-1].strip
    theirs = elsewhere(block, models, strip)
    work = _InWork(block, theirs, own[:-1], own[-1], known, strip, {})
    checks, marks = work.checks(), work.marks()
    out = []
    for k in range(max(len(own) - last, 0), len(own)):
        before, model = own[:k], own[k]
        again = _again(before, model)
        strayed: tuple[tuple[str, float, str], ...] = ()
        if again:
            alone = _InWork(block, NOTHING_ELSEWHERE, before, model, NOTHING_KNOWN, strip, again)
            strayed = alone.strayed(model)
        of_last = checks if model is own[-1] else ()
        out.append(Transfer((), of_last, marks, work.places(checks, model, reach), strayed))
    return tuple(out)


def _strip_in_work(models: tuple[ModelState, ...], current: ModelState | None) -> str:
    if current is not None:
        return current.strip
    return models[-1].strip if models else ""


class _InWork:
    """A model in work with all that is known about its strip and the others."""

    def __init__(
        self,
        block: Block,
        theirs: Elsewhere,
        own: tuple[ModelState, ...],
        current: ModelState | None,
        known: Known,
        strip: str,
        again: Mapping[str, str],
    ) -> None:
        self._block, self._current, self._known = block, current, known
        self._strip = strip
        self._sigma0 = block.precision.image_um * 1e-3
        self._ways: dict[str, StripTie | None] = {}
        self._all: dict[tuple[int, int], tuple[StripTie, System, Carried]] = {}
        self._own, self._again = own, again
        self._control = {c.point for c in known.control}
        self._others, self._measured, self._stated = theirs
        chain = consecutive(block, strip, own if current is None else (*own, current))
        self._this = geometry_of(block, chain)
        self._tied = TiedStrip(strip, self._this, _recent(self._this, chain))
        self._ground = ground(block, known.control)

    def transfer(self) -> Transfer:
        """Return everything."""
        checks, marks = self.checks(), self.marks()
        model = self._current
        if model is None or model.open_inner is not None:
            return Transfer(checks=checks, marks=marks)
        expected = self._expected(checks, model)
        offers = self._offers(model, expected)
        return Transfer(
            offers,
            checks,
            marks,
            _uncertain(expected),
            self.strayed(model),
            self._hint(checks, offers, model),
        )

    def checks(self) -> tuple[TieCheck, ...]:
        """Return the strip against the others and against the ground."""
        near = frozenset(() if self._tied.near is None else self._tied.near.points)
        others: list[tuple[str, System]] = [
            # far away in the block nothing is common, wherever its points lie
            (name, self._others[name] if self._others.may_have(name, near) else Placed({}, 0))
            for name in self._others
        ]
        if self._ground.points:
            others.append((GROUND, self._ground))
        checks = tuple(
            check_tie(self._block, self._known, self._tied, name, other) for name, other in others
        )
        unit = next((c.unit_m for c in checks if c.other == GROUND), None)
        return tuple(c if c.other == GROUND else replace(c, unit_m=unit) for c in checks)

    def marks(self) -> dict[str, Mark]:
        """Return what the points known from elsewhere are."""
        return {name: self._mark(name) for name in self._measured.keys() | self._control}

    def places(
        self, checks: tuple[TieCheck, ...], model: ModelState, reach: float
    ) -> Mapping[str, tuple[Place, float]]:
        """Return where those not measured in a model are expected, near some that are."""
        here = frozenset(m.point for m in model.measured)
        close = Close.of(((m.xl, m.yl, m.xr, m.yr) for m in model.used), reach)
        expected = _uncertain(self._expected(checks, model, here, close))
        return {name: one for name, one in expected.items() if close.to(one[0])}

    def _mark(self, point: str) -> Mark:
        if point in self._control:
            return "control"
        return "lateral" if point in self._measured else ""

    # -- where points lie ------------------------------------------------------------------------

    def _expected(
        self,
        checks: tuple[TieCheck, ...],
        model: ModelState,
        without: frozenset[str] = frozenset(),
        close: Close | None = None,
    ) -> dict[str, tuple[Place, float | None, str]]:
        """Return places of points known from elsewhere, standard deviations, and sources."""
        out: dict[str, tuple[Place, float | None, str]] = {}
        known = {**self._stated, **stated_control(self._block, self._known.control, GROUND)}
        stated = list(seen_by_stated(self._block, model, known))
        poses = self._poses(model)
        if poses is not None:
            sights = list(self._sights(checks, poses, without))
            if close is not None:
                told = {name for name, at, *_ in stated if close.to(at)}
                told.update(name for sight in sights for name in sight.near(close))
                sights = [sight.among(told) for sight in sights]
            for sight in sights:
                for name, at, sigma in sight.seen():
                    before = out.get(name)
                    if before is None or sigma < (before[1] or 0.0):
                        out[name] = (at, sigma, sight.source)
        # what was measured says it better, unless it says next to nothing
        for name, at, sigma, source in stated:
            if name not in out or (out[name][1] or 0.0) > _UNCERTAIN:
                out[name] = (at, sigma, source)
        marked = self._known.candidates or {}
        in_left, in_right = (marked.get(photo, {}) for photo in model.photos)
        for name in in_left.keys() & in_right.keys():
            if self._mark(name):
                source = self._measured.get(name, GROUND)
                out[name] = ((*in_left[name], *in_right[name]), None, source)
        return out

    def _sights(
        self, checks: tuple[TieCheck, ...], poses: Poses, without: frozenset[str]
    ) -> Iterator[Sight]:
        """Yield what every similarity shows in two photos of points that are known elsewhere."""
        for check in checks:
            yield from self._directly(check, poses, without)
        if not any(c.other == GROUND and c.cleaned for c in checks):
            # as long as the strip itself has no fit, that of its neighbour shows the control
            for check in checks:
                yield from self._by_way_of(check, poses, without)

    def _directly(self, check: TieCheck, poses: Poses, without: frozenset[str]) -> Iterator[Sight]:
        """Yield the points of another system that it places."""
        tie, this = check.cleaned, self._this
        if tie is None or this is None:
            return
        theirs = self._ground if check.other == GROUND else self._others[check.other]
        names = [p for p in in_view(self._carried(tie, theirs), poses) if p not in without]
        own: dict[str, Located] = {}
        if check.other == GROUND:
            found = this.points.items()
            own = {p: at for p, at in found if p in self._control and p not in without}
        yield Sight(check.other, tie, names, own, poses, self._sigma0)

    def _by_way_of(self, check: TieCheck, poses: Poses, without: frozenset[str]) -> Iterator[Sight]:
        """Yield control that only another strip's fit to it places, as this strip has it."""
        if check.cleaned is None or check.tie is None:
            return
        other = self._others[check.other]
        joint = control_placed(self._block, self._known, other)
        if joint is None:
            return
        missing = joint.points.keys() - other.points.keys()
        # the same similarity, but for the errors of what it places
        seen = in_view(self._carried(check.tie, joint), poses)
        names = [p for p in seen if p in missing and p not in without]
        tie = self._way(check.other, joint, missing) if names else None
        if tie is not None:
            yield Sight(GROUND, tie, names, {}, poses, self._sigma0)

    def _carried(self, tie: StripTie, other: System) -> Carried:
        """Return another system's points as a similarity has them, the same for every model."""
        key = id(tie), id(other)  # both last as long as this, or are kept here
        if key not in self._all:
            self._all[key] = (tie, other, Carried.of(tie, other))
        return self._all[key][2]

    def _way(self, name: str, joint: System, missing: Set[str]) -> StripTie | None:
        """Return the similarity to a strip with the control that it places."""
        near = self._tied.near
        if name not in self._ways and near is not None:
            try:
                self._ways[name] = tie_to(self._block, self._known, near, joint, missing)
            except NotComputableError:
                self._ways[name] = None
        return self._ways.get(name)

    def _poses(self, model: ModelState) -> Poses | None:
        """Return both photos: the right one as a regular flight has it while it is not known."""
        this = self._this
        if this is None or model.left not in this.photos:
            return None
        left = this.photos[model.left]
        if model.right in this.photos:
            return Poses(left, this.photos[model.right])
        before = next((m.left for m in self._own if m.right == model.left), None)
        if before is None:
            return None
        step = left.centre - this.photos[before].centre
        size = float(np.linalg.norm(step))
        free = np.diag([_BASE * size] * 3 + [_TILT] * 3) / self._sigma0
        c = self._block.camera_of(model.right).c
        return Poses(left, Pose(c, left.centre + step, left.rotation, left.errors), free)

    def strayed(self, model: ModelState) -> tuple[tuple[str, float, str], ...]:
        """Return the points that lie elsewhere than an earlier model of the strip has them."""
        again = self._again
        if not again or self._this is None or model.right not in self._this.photos:
            return ()
        chain = consecutive(self._block, self._strip, self._own)
        before = geometry_of(self._block, chain)
        out = []
        for name, of in again.items():
            then = None if before is None else before.points.get(name)
            now = self._this.points.get(name)
            if then is None or now is None:
                continue
            off = now.xyz - then.xyz
            count = max(then.errors.shape[1], now.errors.shape[1])
            errors = widened(now.errors, count) - widened(then.errors, count)
            cov = self._sigma0**2 * errors @ errors.T  # 0: not computed anew, the place is kept
            if cov.any() and float(off @ np.linalg.solve(cov, off)) > _STRAYED:
                out.append((name, float(np.linalg.norm(off)), of))
        return tuple(out)

    # -- what is offered -------------------------------------------------------------------------

    def _offers(
        self,
        model: ModelState,
        expected: Mapping[str, tuple[Place, float | None, str]],
    ) -> tuple[Offer, ...]:
        """Return the points due: all control, and lateral ties that are spread along the strip."""
        planned = {p.point: p for p in model.plan}
        in_strip = {m.point for one in self._own for m in one.used}
        before = {m.point for one in self._own if one.right == model.left for m in one.used}
        known = [p for name, p in planned.items() if self._mark(name) == "lateral"]
        there = [p.xl for p in known]
        wanted = _LATERAL - sum(p.role != "tie" for p in known)
        control: list[Offer] = []
        free: dict[str, Offer] = {}
        for name, (at, sigma, source) in expected.items():
            mark = self._mark(name)
            if name in planned or not mark or not self._inside(model, at):
                continue
            if sigma is not None and sigma > _UNCERTAIN:
                continue
            if mark == "control":
                role: Role = "tie" if name in before else "control"
                control.append(Offer(PlannedPoint(name, role, *at), mark, source, sigma))
            elif name not in in_strip:
                free[name] = Offer(PlannedPoint(name, "lateral", *at), mark, source, sigma)
        lateral: list[Offer] = []
        while free and len(lateral) < wanted:
            # the one farthest from those there are; the first of all the one farthest left
            best = max(free, key=lambda n: _apart(free[n].planned.xl, there))
            lateral.append(free.pop(best))
            there.append(lateral[-1].planned.xl)
        return tuple(sorted((*lateral, *control), key=lambda o: o.sigma or 0.0))

    def _inside(self, model: ModelState, at: Place) -> bool:
        for photo, x, y in ((model.left, *at[:2]), (model.right, *at[2:])):
            camera = self._block.camera_of(photo)
            reach_x, reach_y = camera.reach()
            if camera.format is None:
                # what is believed of a coordinate is no edge
                reach_x = reach_y = camera.c
            if abs(x) > reach_x - EDGE or abs(y) > reach_y - EDGE:
                return False
        return True

    def _hint(
        self, checks: tuple[TieCheck, ...], offers: tuple[Offer, ...], model: ModelState
    ) -> str:
        """Return how a similarity comes about where there is none."""
        if offers or model.pending or self._this is None:
            return ""
        for check in checks:
            if check.cleaned is None and check.other != GROUND and check.common < 2:
                return (
                    f"{check.common} of 2 points known to tie this strip to {check.named}: add one "
                    "of its points under its own name with +, then others are driven to"
                )
        return ""


def _uncertain(
    expected: Mapping[str, tuple[Place, float | None, str]],
) -> dict[str, tuple[Place, float]]:
    """Return expected places with their standard deviations; marked ones not among them."""
    return {name: (at, sigma) for name, (at, sigma, _) in expected.items() if sigma is not None}


def _apart(x: float, there: list[float]) -> float:
    return min((abs(x - other) for other in there), default=-x)


def _again(own: tuple[ModelState, ...], model: ModelState) -> dict[str, str]:
    """Return points measured in a strip before, not in a neighbouring model, and in which."""
    here = {m.point for m in model.used}
    near = {m.point for one in own if set(one.photos) & set(model.photos) for m in one.used}
    return {
        m.point: one.name
        for one in own
        for m in one.used
        if m.point in here and m.point not in near
    }


def _recent(geometry: StripGeometry | None, chain: tuple[ModelState, ...]) -> System | None:
    """Return the strip's points of its last models: far behind, nothing is tied any more."""
    if geometry is None:
        return None
    names = {m.point for model in chain[-RECENT:] for m in model.used}
    points = {p: at for p, at in geometry.points.items() if p in names}
    return Placed(points, geometry.count)
