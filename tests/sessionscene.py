"""A small synthetic strip and the events with which an operator measures it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from anaplot.orientation.patterns import pattern
from anaplot.photogrammetry.block import Block, ImagePoint
from anaplot.planning.modelplan import plan_positions
from anaplot.planning.synthetic import SyntheticStrip, synthetic_strip
from anaplot.session.events import (
    Event,
    ModelAccepted,
    ModelChosen,
    PlannedPoint,
    PointMeasured,
)
from anaplot.session.modelstate import ModelState
from anaplot.session.state import SessionState, apply, fold, start

__all__ = ["Scene", "however_it_lies"]


def however_it_lies(state: SessionState) -> SessionState:
    """Return a state without how often photos were laid in, which no undo takes back."""

    def model(one: ModelState) -> ModelState:
        return replace(one, laying=0)

    current, returned = state.current, state.returned
    if returned is not None and returned.parked is not None:
        returned = replace(returned, parked=model(returned.parked))
    return replace(
        state,
        layings=0,
        models=tuple(model(one) for one in state.models),
        current=None if current is None else model(current),
        returned=returned,
    )


class Scene:
    """A strip, measured with noise of 3 um."""

    def __init__(self, photos: int = 4, seed: int = 5) -> None:
        self.made: SyntheticStrip = synthetic_strip(photos, seed=seed)
        self.block: Block = self.made.block
        self.start: SessionState = start(self.block)
        rng = np.random.default_rng(seed)
        self.noisy = {
            (model, photo, point): (x + rng.normal(0, 0.003), y + rng.normal(0, 0.003))
            for model in self.block.strips[0].models()
            for photo in model
            for point, (x, y) in self.made.truth[photo].items()
        }

    def choice(self, state: SessionState, model: int) -> ModelChosen:
        """The event that lays the photos of a model."""
        left, right = self.block.strips[0].models()[model]
        before = state.preceding("1", left)
        used = () if before is None else before.used
        places = plan_positions(
            self.block,
            (left, right),
            pattern("13"),
            nominal_base=92.0,
            preceding={m.point: (m.xr, m.yr) for m in used},
            candidates=self.made.truth,
        )
        known = {m.point for m in used}
        plan = tuple(
            PlannedPoint(p.point, "tie" if p.point in known else "new", *p[1:]) for p in places
        )
        return ModelChosen("1", left, right, plan)

    def measurement(
        self, state: SessionState, point: str, dyr: float = 0.0, dxr: float = 0.0
    ) -> PointMeasured:
        """The event that records a point of the current model."""
        model = state.current
        assert model is not None
        (xl, yl), (xr, yr) = (self.noisy[model.photos, photo, point] for photo in model.photos)
        return PointMeasured(
            model.left, model.right, point, xl, yl, xr + dxr, yr + dyr, switch="pedal"
        )

    def chosen(self, model: int = 0) -> SessionState:
        """The state with a model laid and the ones before it accepted."""
        state = self.start
        for k in range(model):
            state = self.whole(apply(state, self.choice(state, k)))
            left, right = self.block.strips[0].models()[k]
            state = apply(state, ModelAccepted(left, right))
        return apply(state, self.choice(state, model))

    def whole(self, state: SessionState) -> SessionState:
        """The state with every pending point measured."""
        return fold(state, list(self.measurements(state)))

    def measurements(self, state: SessionState) -> Iterator[Event]:
        """The events that record what is pending."""
        assert state.current is not None
        for planned in state.current.pending:
            yield self.measurement(state, planned.point)

    def rows(self, state: SessionState) -> tuple[ImagePoint, ...]:
        """The measurements of accepted models and the current one as rows of a file."""
        models = [*state.models, *([state.current] if state.current else [])]
        return tuple(
            ImagePoint(photo, m.point, *xy, model=model.name)
            for model in models
            for photo, side in ((model.left, 0), (model.right, 1))
            for m in model.used
            for xy in [((m.xl, m.yl), (m.xr, m.yr))[side]]
        )
