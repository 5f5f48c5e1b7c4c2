"""A block of two strips, measured at a desk with nothing but numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
from deskscene import DRIVEN, Bench
from syntheticblocks import SyntheticBlock, synthetic_block

from anaplot.photogrammetry.block import TestSettings
from anaplot.photogrammetry.readings import InPosition, Position, Record
from anaplot.session.commands import Accept, Drive, NextModel
from anaplot.session.desk import Desk
from anaplot.session.events import PlannedPoint
from anaplot.session.modelstate import Measured, ModelState
from anaplot.session.state import SessionState, start
from anaplot.session.transfer import Offer

__all__ = ["BlockBench", "flown", "marked", "second_strip_begun"]

SIGMA0 = 0.005  # mm


@cache
def flown(seed: int) -> SyntheticBlock:
    """A block of two strips of four photos."""
    return synthetic_block(2, 4, seed=seed, test=TestSettings(kind="baarda"))


def marked(made: SyntheticBlock, *, transferred: int | None = None):
    """Return the marks on the photos, to .1 mm.

    Parameters
    ----------
    made
        The block.
    transferred
        How many points of the first strip are marked on the photos of the second; None: all, and
        the control. Otherwise no control is marked at all there.
    """
    shown = {p for p in made.ground if p.startswith("10")}
    if transferred is not None:
        common = [p for p in made.truth["202"] if p in shown and p in made.truth["201"]]
        shown -= set(common[:: max(len(common) // transferred, 1)][:transferred])
        shown |= {c.point for c in made.block.control}
    else:
        shown = set()
    return {
        photo: {
            p: (round(x, 1), round(y, 1))
            for p, (x, y) in points.items()
            if not (photo.startswith("2") and p in shown)
        }
        for photo, points in made.truth.items()
    }


def second_strip_begun(made: SyntheticBlock) -> SessionState:
    """The first strip accepted, and the second one's first model in work, all without error.

    That model has no control yet.
    """
    first, second = made.block.strips
    control = {c.point for c in made.block.control}
    return replace(
        start(made.block),
        models=tuple(_exact(made, first.id, *photos) for photos in first.models()),
        current=_exact(made, second.id, *second.models()[0], without=control),
    )


def _exact(made: SyntheticBlock, strip: str, left: str, right: str, without=()) -> ModelState:
    seen = {
        name: (*made.truth[left][name], *made.truth[right][name])
        for name in made.truth[left]
        if name in made.truth[right] and name not in without
    }
    plan = tuple(PlannedPoint(name, "new", *at) for name, at in seen.items())
    measured = tuple(Measured(name, *at, 1) for name, at in seen.items())
    return ModelState(strip, left, right, plan, measured)


@dataclass
class BlockBench(Bench):
    """A desk whose marks are set on true points, with noise and with mistakes.

    Attributes
    ----------
    made
        The block.
    wrong
        (left photo, point) -> another point that is measured in its place.
    off
        (left photo, point) -> how far both marks are set beside it [mm], whenever it is measured.
    predicted
        For every point that was driven to by prediction: the offer and the prediction's error.
    """

    made: SyntheticBlock | None = None
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(1))
    wrong: Mapping[tuple[str, str], str] = field(default_factory=dict)
    off: Mapping[tuple[str, str], tuple[float, float]] = field(default_factory=dict)
    predicted: list[tuple[Offer, np.ndarray]] = field(default_factory=list)

    @classmethod
    def over(cls, made: SyntheticBlock, candidates, seed: int = 1, **mistakes) -> BlockBench:
        """A bench before anything has happened."""
        desk = Desk.at(start(made.block), DRIVEN, candidates=candidates, control=made.block.control)
        rng = np.random.default_rng([seed, 3])
        return cls(desk, made=made, rng=rng, **mistakes)

    @property
    def offers(self) -> tuple[Offer, ...]:
        """What is offered."""
        return self.desk.transfer.offers

    def true(self, point: str) -> np.ndarray:
        """Where a point truly lies in both photos."""
        model = self.desk.state.current
        return np.array([*self.made.truth[model.left][point], *self.made.truth[model.right][point]])

    def point_at(self, name: str) -> None:
        """Drive to a point, and record what is taken for it."""
        offer = self.desk.transfer.offer(name)
        left = self.desk.state.current.left
        if self.desk.target != name:
            self.give(Drive(name))
        if offer is not None and offer.sigma is not None:
            at = self.stands
            found = np.array([at.xl, at.yl, at.xr, at.yr])
            self.predicted.append((offer, found - self.true(name)))
        self.hear(InPosition(self.stands))
        at = self.true(self.wrong.get((left, name), name))
        dx, dy = self.off.get((left, name), (0.0, 0.0))
        at = at + np.array((dx, dy, dx, dy)) + self.rng.normal(0.0, SIGMA0, 4)
        decision = self.hear(Record(Position(*at.tolist()), "pedal"))
        assert decision.events, decision.requests

    def model(self) -> None:
        """Measure all of the next model that is due, and leave it open."""
        self.give(NextModel())
        while pending := self.desk.mode.pending:
            self.point_at(pending[0])
        while self.offers:
            self.point_at(self.offers[0].planned.point)

    def block(self, models: int) -> BlockBench:
        """Measure and accept models."""
        for _ in range(models):
            self.model()
            self.give(Accept())
        return self
