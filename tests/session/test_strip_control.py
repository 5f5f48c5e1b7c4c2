"""A session's strips on their control: the same figures as `anaplot fit`, at any time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sessionscene import Scene

from anaplot.orientation.stripfit import StripFit
from anaplot.photogrammetry.block import Block, ControlPoint
from anaplot.report.fitcommand import fit
from anaplot.session.events import ModelAccepted, RowSwitched
from anaplot.session.models import solve
from anaplot.session.state import SessionState, apply
from anaplot.station.imagepoints import rows_of
from anaplot.station.stripcontrol import strips_on_control


def finished() -> tuple[Scene, SessionState]:
    scene = Scene(4)
    state = scene.whole(scene.chosen(2))
    point = state.current.plan[5].point
    state = apply(state, RowSwitched(point, "y", False))
    return scene, apply(state, ModelAccepted(*state.current.photos))


def with_control(scene: Scene, state: SessionState, every: int = 3) -> Block:
    rng = np.random.default_rng(2)
    at = {p.point: p[1:] for m in state.models for p in solve(state, m).points}
    control = [
        ControlPoint(name, tuple((np.array(xyz) * 10.0 + rng.normal(0.0, 0.02, 3)).tolist()))
        for name, xyz in list(at.items())[::every]
    ]
    return replace(scene.block, control=tuple(control), image_points=rows_of(state.models))


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_page_and_command_say_the_same_to_the_last_digit(degree) -> None:
    scene, state = finished()
    block = with_control(scene, state)
    aside = (block.control[4].point,)
    [one] = strips_on_control(block, state, degree, aside)
    [(name, wanted)] = fit(block, degree=degree, without=aside).strips
    assert isinstance(one.fit, StripFit)
    assert (one.strip, one.models, len(one.control)) == (name, 3, len(block.control))
    assert one.fit.points == wanted.points
    assert (one.fit.rms, one.fit.polynomials) == (wanted.rms, wanted.polynomials)
    assert [p.point for p in one.fit.points if not p.used] == list(aside)
    # nothing of it touches what was measured
    assert block.image_points == rows_of(state.models)


def test_the_model_in_work_takes_part_as_soon_as_it_is_determined() -> None:
    scene, state = finished()
    block = with_control(scene, state, every=2)
    before = scene.chosen(2)
    [accepted] = strips_on_control(block, before, 1, ())
    half = before
    for event in list(scene.measurements(before))[:9]:
        half = apply(half, event)
    [more] = strips_on_control(block, half, 1, ())
    assert (accepted.models, more.models) == (2, 3)
    assert set(accepted.control) < set(more.control)


def test_too_little_control_is_said_and_what_there_is_is_named() -> None:
    scene, state = finished()
    block = with_control(scene, state)
    few = replace(block, control=block.control[:2])
    [one] = strips_on_control(few, state, 1, ())
    assert one.fit == "strip 1: 6 control coordinates are measured, degree 1 needs 7"
    assert one.control == tuple(c.point for c in few.control)
    [none] = strips_on_control(block, scene.start, 1, ())
    assert (none.models, none.control) == (0, ())
    assert none.fit == "strip 1: no model is determined yet"
