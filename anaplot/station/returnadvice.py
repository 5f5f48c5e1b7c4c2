"""When to return to an accepted model: what the block, or the next model, is sure of."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from anaplot.session.modelstate import ModelState
from anaplot.session.nextstep import Agenda, Step
from anaplot.station.blockview import SURE, BlockView, SuspectedPoint, SuspectedRay

if TYPE_CHECKING:
    from anaplot.session.desk import Desk

__all__ = ["ReturnAdvice", "may_help", "return_advice", "surely_wrong"]

_MOST = 2  # measurements of a point there after which measuring it again has not helped
_AGAIN = 2  # measurements of a point here that say the same


class ReturnAdvice(NamedTuple):
    """That a point is to be measured again in a model that is accepted already.

    Attributes
    ----------
    left, right
        Names of the model's photos.
    point, axis, photo
        What is wrong there; photo "" where it is not known in which.
    probability
        How sure the block is; None: the point was measured again in the next model, and it still
        does not fit.
    """

    left: str
    right: str
    point: str
    axis: str
    photo: str
    probability: float | None

    @property
    def agenda(self) -> Agenda:
        """What is to be done."""
        why = "measured again here, it does not fit"
        if self.probability is not None:
            why = f"{min(100.0 * self.probability, 99.9):.1f} %"
        what = f"remeasure {self.point} {self.axis}"
        step = Step("return", f"return to {self.left}/{self.right}: {what}")
        return Agenda((step,), why)


def return_advice(desk: Desk, view: BlockView | None) -> ReturnAdvice | None:
    """Return to which accepted model the operator should return, or None.

    Between models, and when all points of a model are measured: as soon as the block is sure that
    a coordinate of an accepted model is wrong, for it shows most of all; or when a tie that was
    measured again still does not fit the model before. What was measured there several times is
    not asked for again.
    """
    state, outlook = desk.state, desk.outlook
    busy = (
        state.suspended
        or desk.repeating is not None
        or state.returned is not None
        or outlook.inner is not None
    )
    pending = state.current is not None and state.current.pending
    if busy or desk.referencing is not None or desk.checks or pending:
        return None
    return _of_block(desk, view) or _of_tie(desk)


def surely_wrong(view: BlockView, models: Sequence[ModelState]) -> SuspectedPoint | None:
    """Return the point that shows most of all, if the block is sure which measurement is wrong.

    None as well where that was measured in one of `models` so often that it has not helped, and
    where control, a prior or a condition shows more.
    """
    if not view.suspects or view.suspects[0].certainty <= SURE:
        return None
    suspect = view.suspects[0]
    if view.unless(suspect) is not None:
        return None
    model = _model_of(models, suspect.point, suspect.accused)
    return suspect if model is None or may_help(model, suspect.point) else None


def _of_block(desk: Desk, view: BlockView | None) -> ReturnAdvice | None:
    if any(accident.certain for accident in desk.accidents):
        return None  # the block has that in it, and is not to be believed before it is mended
    suspect = None if view is None or view.busy else surely_wrong(view, desk.state.models)
    if suspect is None:
        return None
    ray = suspect.accused
    model = _model_of(desk.state.models, suspect.point, ray)
    if model is None:
        return None
    return ReturnAdvice(
        model.left,
        model.right,
        suspect.point,
        suspect.flagged[0].axis,
        ray.photo,
        suspect.certainty,
    )


def _model_of(models: Sequence[ModelState], point: str, ray: SuspectedRay) -> ModelState | None:
    """Return the accepted model in which a ray was measured, or None.

    What a mono comparator measured once for two models names none: the first one measured it.
    """
    for model in models:
        named = ray.model == model.name or (ray.model is None and model.mono)
        if named and ray.photo in model.photos and model.measurement(point) is not None:
            return model
    return None


def _of_tie(desk: Desk) -> ReturnAdvice | None:
    model, diagnosis = desk.state.current, desk.outlook.diagnosis
    if model is None or diagnosis is None or not diagnosis.suspects:
        return None
    point, axis = diagnosis.suspects[0]
    measured, before = model.measurement(point), desk.state.preceding(model.strip, model.left)
    # in a mono comparator the photos are measured one after the other
    again = _AGAIN + model.mono
    if axis != "x" or measured is None or measured.times < again:
        return None
    if before is None or not may_help(before, point):
        return None
    return ReturnAdvice(before.left, before.right, point, axis, "", None)


def may_help(model: ModelState, point: str) -> bool:
    """Return whether it may help to measure a point again: not where it was often enough."""
    measured = model.measurement(point)
    return measured is not None and measured.times <= _MOST and not model.is_off(point)
