"""What comes next in a model whose photos need no inner orientation now."""

from __future__ import annotations

from typing import Literal, NamedTuple

from anaplot.aliases import Side
from anaplot.session.events import PlannedPoint
from anaplot.session.modelstate import ModelState

__all__ = [
    "NO_AGENDA",
    "Again",
    "Agenda",
    "Expectation",
    "Step",
    "StepKind",
    "next_step",
    "remeasured_side",
]

StepKind = Literal[
    "lay", "measure", "remeasure", "rename", "add", "switch off", "accept", "resume", "return"
]


class Step(NamedTuple):
    """Something that the operator may do now.

    Attributes
    ----------
    kind
        What is to be done.
    words
        The same for people, without any key.
    point
        The point or fiducial that is meant; None where none is.
    """

    kind: StepKind
    words: str
    point: str | None = None


class Agenda(NamedTuple):
    """What may be done now, the most urgent first, and a remark on it.

    Who has keys says with which of them; `sentence` is for those who have none.
    """

    steps: tuple[Step, ...] = ()
    remark: str = ""

    @property
    def sentence(self) -> str:
        """The steps and the remark as one sentence."""
        words = ", or ".join(step.words for step in self.steps)
        return ": ".join(part for part in (words, self.remark) if part)


NO_AGENDA = Agenda()
"""Nothing is to be done."""


class Expectation(NamedTuple):
    """What is expected: the point to measure, what may be done, which photo to lay in first."""

    point: str | None
    agenda: Agenda
    lay: Side | None = None


class Again(NamedTuple):
    """A point that is to be measured again; in which photo of a mono model, where that is known."""

    point: str
    side: Side | None = None


def next_step(
    model: ModelState,
    suspects: tuple[str, ...],
    *,
    solved: bool,
    again: Again | None = None,
    interchanged: tuple[str, ...] = (),
    unexplained: str = "",
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
    interchanged
        Two points whose records are exchanged, or ().
    unexplained
        Why the model is not to be accepted as it is although nothing is flagged, or "".
    """
    if again is not None:
        suspects = (again.point, *(point for point in suspects if point != again.point))
    side = None if again is None else again.side
    step = _single(model, suspects, side) if model.mono else _pair(model, suspects)
    if step is not None:
        return _naming(step, interchanged)
    add = Step("add", "add or re-measure points")
    if solved:
        accept = Step("accept", "accept the model")
        return Expectation(None, Agenda((add, accept) if unexplained else (accept,), unexplained))
    return Expectation(None, Agenda((add,), "the model is not determined"))


def _naming(step: Expectation, interchanged: tuple[str, ...]) -> Expectation:
    """Say that two points are interchanged where one is measured again, or exchange them."""
    first, *others = step.agenda.steps
    if first.point not in interchanged:
        return step
    named = first._replace(words=f"{' and '.join(interchanged)} interchanged? {first.words}")
    exchange = Step("rename", "exchange them", first.point)
    return step._replace(agenda=step.agenda._replace(steps=(named, exchange, *others)))


def _pair(model: ModelState, suspects: tuple[str, ...]) -> Expectation | None:
    """Return what to measure in both photos; None when all is done."""
    pending = model.pending
    again = tuple(Step("remeasure", f"remeasure {point}", point) for point in suspects[:1])
    if pending:
        first = pending[0]
        steps = (*again, Step("measure", f"measure {_named(first)}", first.point))
        to_go = f"{len(pending)} of {len(pending) + len(model.measured)} points to go"
        return Expectation(first.point, Agenda(steps, to_go))
    if not again:
        return None
    off = Step("switch off", "switch it off", suspects[0])
    return Expectation(suspects[0], Agenda((*again, off, Step("accept", "accept"))))


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
        photo, first = model.photo(side), pending[0]
        if side == model.laid:
            words = f"measure {_named(first)} in photo {photo}"
            seen = sum(s.side == side for s in model.seen)
            to_go = f"{len(pending)} of {len(pending) + seen} points to go"
            return Expectation(first.point, Agenda((Step("measure", words, first.point),), to_go))
        lay = Step("lay", f"lay photo {photo} into the comparator")
        return Expectation(None, Agenda((lay,), f"{len(pending)} points to go"), side)
    if not suspects:
        return None
    again = suspects[0]
    side = there or remeasured_side(model, again)
    photo = model.photo(side)
    others = (Step("switch off", f"switch {again} off", again), Step("accept", "accept"))
    if side == model.laid:
        step = Step("remeasure", f"remeasure {again} in photo {photo}", again)
        return Expectation(again, Agenda((step, *others)))
    lay = Step("lay", f"lay photo {photo} in again to remeasure {again} there", again)
    return Expectation(again, Agenda((lay, *others)), side)


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
