"""What comes next in a model whose photos need no inner orientation now."""

from __future__ import annotations

from typing import NamedTuple

from anaplot.aliases import Side
from anaplot.session.events import PlannedPoint
from anaplot.session.modelstate import ModelState

__all__ = ["Again", "Expectation", "next_step", "remeasured_side"]


class Expectation(NamedTuple):
    """What is expected: the point to measure, the sentence, and which photo to lay in first."""

    point: str | None
    expected: str
    lay: Side | None = None


class Again(NamedTuple):
    """A point that is to be measured again; in which photo of a mono model, where that is known."""

    point: str
    side: Side | None = None


def next_step(
    model: ModelState, suspects: tuple[str, ...], *, solved: bool, again: Again | None = None
) -> Expectation:
    """Say what comes next in a model.

    Parameters
    ----------
    model
        The model.
    suspects
        Points to measure again, the one to begin with first.
    solved
        Whether the model is determined.
    again
        What the operator returned to the model for, or None: it comes before other suspects.
    """
    if again is not None:
        suspects = (again.point, *(point for point in suspects if point != again.point))
    side = None if again is None else again.side
    step = _single(model, suspects, side) if model.mono else _pair(model, suspects)
    if step is not None:
        return step
    if solved:
        return Expectation(None, "accept the model")
    return Expectation(None, "add or re-measure points: the model is not determined")


def _pair(model: ModelState, suspects: tuple[str, ...]) -> Expectation | None:
    """Return what to measure in both photos; None when all is done."""
    pending = model.pending
    if not pending:
        if not suspects:
            return None
        return Expectation(suspects[0], f"remeasure {suspects[0]}, or switch it off, or accept")
    again = f"remeasure {suspects[0]}, or " if suspects else ""
    to_go = f"{len(pending)} of {len(model.plan)} points to go"
    return Expectation(pending[0].point, f"{again}measure {_named(pending[0])}: {to_go}")


def _single(model: ModelState, suspects: tuple[str, ...], there: Side | None) -> Expectation | None:
    """Return what to measure in a mono comparator; None when all is done.

    `there`: in which photo the first suspect is wrong, where that is known.

    All points of the photo in the comparator, then those of the other; then what is flagged.
    """
    order: tuple[Side, Side] = ("right", "left") if model.laid == "right" else ("left", "right")
    for side in order:
        pending = model.pending_in(side)
        if not pending:
            continue
        if side == model.laid:
            to_go = f"{len(pending)} of {len(model.plan)} points to go"
            words = f"measure {_named(pending[0])} in photo {model.photo(side)}: {to_go}"
            return Expectation(pending[0].point, words)
        words = f"lay photo {model.photo(side)} into the comparator: {len(pending)} points to go"
        return Expectation(None, words, side)
    if not suspects:
        return None
    again = suspects[0]
    side = there or remeasured_side(model, again)
    photo = model.photo(side)
    other = f"switch {again} off, or accept"
    if side == model.laid:
        return Expectation(again, f"remeasure {again} in photo {photo}, or {other}")
    return Expectation(
        again, f"lay photo {photo} in again to remeasure {again} there, or {other}", side
    )


def _named(point: PlannedPoint) -> str:
    return point.point + (" (tie)" if point.role == "tie" else "")


def remeasured_side(model: ModelState, point: str) -> Side:
    """Return in which photo a point is to be measured again.

    A parallax does not tell the photo. So the one in which it was measured less often; of two
    alike the one in the comparator, for which nothing has to be changed.
    """
    times = {s.side: s.times for s in model.seen if s.point == point}
    left, right = times.get("left", 0), times.get("right", 0)
    if left == right:
        return model.laid or "left"
    return "left" if left < right else "right"
