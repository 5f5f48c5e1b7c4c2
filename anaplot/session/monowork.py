"""What comes next in a model that is measured in a mono comparator."""

from __future__ import annotations

from typing import NamedTuple

from anaplot.aliases import Side
from anaplot.session.modelstate import ModelState

__all__ = ["MonoStep", "mono_step", "remeasured_side"]


class MonoStep(NamedTuple):
    """What is expected: the point to measure, the sentence, and which photo to lay in first."""

    point: str | None
    expected: str
    lay: Side | None


def mono_step(model: ModelState, suspects: tuple[str, ...], *, solved: bool) -> MonoStep:
    """Say what comes next in a mono model whose photo needs no inner orientation now.

    All points of the photo in the comparator, then those of the other; then what is flagged.

    Parameters
    ----------
    model
        The model.
    suspects
        Points to measure again, the one to begin with first.
    solved
        Whether the model is determined.
    """
    order: tuple[Side, Side] = ("right", "left") if model.laid == "right" else ("left", "right")
    for side in order:
        pending = model.pending_in(side)
        if not pending:
            continue
        if side == model.laid:
            point = pending[0]
            tie = " (tie)" if point.role == "tie" else ""
            to_go = f"{len(pending)} of {len(model.plan)} points to go"
            words = f"measure {point.point}{tie} in photo {model.photo(side)}: {to_go}"
            return MonoStep(point.point, words, None)
        words = f"lay photo {model.photo(side)} into the comparator: {len(pending)} points to go"
        return MonoStep(None, words, side)
    if suspects:
        point_again = suspects[0]
        side = remeasured_side(model, point_again)
        photo = model.photo(side)
        other = f"switch {point_again} off, or accept"
        if side == model.laid:
            words = f"remeasure {point_again} in photo {photo}, or {other}"
            return MonoStep(point_again, words, None)
        words = f"lay photo {photo} in again to remeasure {point_again} there, or {other}"
        return MonoStep(point_again, words, side)
    if solved:
        return MonoStep(None, "accept the model", None)
    return MonoStep(None, "add or re-measure points: the model is not determined", None)


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
