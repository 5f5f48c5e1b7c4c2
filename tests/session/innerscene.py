"""A strip whose camera has fiducials, its photos laid shifted, turned and shrunk."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from sessionscene import Scene

from anaplot.aliases import Side
from anaplot.photogrammetry.block import TestSettings
from anaplot.photogrammetry.platetransformation import PlateTransformation, random_placement
from anaplot.planning.syntheticcamera import with_calibration
from anaplot.session.events import FiducialMeasured
from anaplot.session.innerwork import acceptance, solve_inner
from anaplot.session.state import SessionState, apply, start

__all__ = ["InnerScene"]

SIDES: tuple[Side, Side] = ("left", "right")


class InnerScene(Scene):
    """As `Scene`; every model begins with the inner orientation of its photos."""

    def __init__(self, photos: int = 4, seed: int = 5) -> None:
        super().__init__(photos, seed)
        self.camera = with_calibration(self.block.cameras[0])
        assert self.camera.calibration is not None
        self.calibration = self.camera.calibration
        # the noise of 3 um is never taken for an error
        test = TestSettings(kind="baarda", alpha=1e-6)
        self.block = replace(self.block, cameras=(self.camera,), test=test)
        self.start = start(self.block)
        self.placements: dict[tuple[str, Side], PlateTransformation] = {
            (photo, side): random_placement(100 * k + j)
            for k, photo in enumerate(self.block.strips[0].photos)
            for j, side in enumerate(SIDES)
        }
        rng = np.random.default_rng([seed, 9])
        self.noise = {
            (*key, mark.id): rng.normal(0.0, 0.003, 2)
            for key in self.placements
            for mark in self.calibration.fiducials
        }

    def fiducial(
        self, state: SessionState, name: str, dx: float = 0.0, dy: float = 0.0
    ) -> FiducialMeasured:
        """The event that records a fiducial of the inner orientation in work."""
        assert state.current is not None
        inner = state.current.open_inner
        assert inner is not None
        mark = next(m for m in self.calibration.fiducials if m.id == name)
        place = self.placements[inner.photo, inner.side].to_plate(np.array([[mark.x, mark.y]]))[0]
        x, y = (place + self.noise[inner.photo, inner.side, name]).tolist()
        return FiducialMeasured(inner.photo, inner.side, name, x + dx, y + dy, "pedal")

    def fiducials(self, state: SessionState) -> SessionState:
        """The state with every pending fiducial of one photo measured."""
        assert state.current is not None
        inner = state.current.open_inner
        assert inner is not None
        for name in inner.pending:
            state = apply(state, self.fiducial(state, name))
        return state

    def accepted(self, state: SessionState) -> SessionState:
        """The state with the inner orientation in work accepted."""
        assert state.current is not None
        inner = state.current.open_inner
        assert inner is not None
        return apply(state, acceptance(inner, solve_inner(state.block, inner)))

    def oriented(self, state: SessionState) -> SessionState:
        """The state with both inner orientations done."""
        while state.current is not None and state.current.open_inner is not None:
            state = self.accepted(self.fiducials(state))
        return state

    def whole(self, state: SessionState) -> SessionState:
        """The state with every pending fiducial and point measured."""
        return super().whole(self.oriented(state))
