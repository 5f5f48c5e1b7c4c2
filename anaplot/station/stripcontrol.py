"""A session's strips on the control that was measured so far."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from anaplot.errors import NotComputableError
from anaplot.orientation.results import ModelSolution
from anaplot.orientation.stripfit import Degree, StripFit, fit_models, measured_control
from anaplot.photogrammetry.block import Block
from anaplot.session.models import solved_or_none
from anaplot.session.modelstate import ModelState
from anaplot.session.state import SessionState

__all__ = ["StripOnControl", "strips_on_control"]


@dataclass(frozen=True, slots=True, eq=False)
class StripOnControl:
    """A strip as far as it was measured, fitted to its control.

    Attributes
    ----------
    strip
        Name.
    models
        How many of its models are determined.
    control
        Control and check points measured in them.
    fit
        The fit, or why there is none.
    """

    strip: str
    models: int
    control: tuple[str, ...]
    fit: StripFit | str


def strips_on_control(
    block: Block, state: SessionState, degree: Degree, without: Collection[str]
) -> tuple[StripOnControl, ...]:
    """Fit every strip: its accepted models, the one in work, and one that waits meanwhile.

    Parameters
    ----------
    block
        With the control.
    state
        The session's state.
    degree
        1: similarity; 2 and 3: with polynomials.
    without
        Control points that are compared and do not take part.
    """
    out = []
    for strip in block.strips:
        solved = _solved(state, strip.id)
        control, fit = _fitted(block, strip.id, solved, degree, without)
        out.append(StripOnControl(strip.id, len(solved), control, fit))
    return tuple(out)


def _fitted(
    block: Block,
    strip: str,
    solved: list[ModelSolution],
    degree: Degree,
    without: Collection[str],
) -> tuple[tuple[str, ...], StripFit | str]:
    if not solved:
        return (), f"strip {strip}: no model is determined yet"
    points = {point.point for model in solved for point in model.points}
    control = tuple(c.point for c in measured_control(block, points))
    try:
        return control, fit_models(block, strip, solved, degree=degree, without=without)
    except NotComputableError as error:
        return control, str(error)


def _solved(state: SessionState, strip: str) -> list[ModelSolution]:
    """Return the models of a strip that are determined, in the order of its photos."""
    models: tuple[ModelState, ...] = state.models
    if state.current is not None:
        models = state.models_with(state.current)
    if state.returned is not None and state.returned.parked is not None:
        models = (*models, state.returned.parked)
    solved = (solved_or_none(state, model) for model in models if model.strip == strip)
    return [solution for solution in solved if solution is not None]
