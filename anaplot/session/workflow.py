"""What may happen next in a session, and what the operator is expected to do."""

from __future__ import annotations

from dataclasses import dataclass

from anaplot.aliases import Side
from anaplot.errors import NotComputableError, TooFewError
from anaplot.orientation.model import WrongPointsError
from anaplot.orientation.results import Diagnosis, Interchange, ModelSolution
from anaplot.session.innerstate import InnerState
from anaplot.session.innerwork import InnerOutlook, inner_outlook
from anaplot.session.models import diagnosis_of, solve
from anaplot.session.modelstate import ModelState
from anaplot.session.nextstep import Again, Agenda, Step, next_step
from anaplot.session.state import SessionState

__all__ = ["Outlook", "next_model", "outlook"]


@dataclass(frozen=True, slots=True, eq=False)
class Outlook:
    """What stands and what comes next.

    Attributes
    ----------
    solution, diagnosis
        The current model, as far as it is determined.
    problem
        Why there is no solution, or "".
    next_point
        The point to measure next: pending, or to be re-measured; None when there is none. During
        an inner orientation, the fiducial.
    agenda
        What the operator may do, the most urgent first.
    may_accept
        Whether the current model can be accepted; during an inner orientation, whether that can.
    next_model
        (strip, left, right) of the model to choose next, or None.
    finished
        Whether every model of the block is accepted.
    inner
        The inner orientation that comes before the current model's points, or None.
    next_photo
        In a mono comparator, which photo of the model is to be laid in now, or None.
    interchange
        Two points of the current model whose records are exchanged, or None.
    leaves
        Whether accepting leaves a model to which the operator returned as it was.
    too_few
        Whether the problem is that too little is measured yet.
    """

    solution: ModelSolution | None
    diagnosis: Diagnosis | None
    problem: str
    next_point: str | None
    agenda: Agenda
    may_accept: bool
    next_model: tuple[str, str, str] | None
    finished: bool
    inner: InnerOutlook | None = None
    next_photo: Side | None = None
    leaves: bool = False
    interchange: Interchange | None = None
    too_few: bool = False

    @property
    def alarm(self) -> str:
        """The problem, where going on with the measurement does not solve it."""
        return "" if self.too_few and self.next_point is not None else self.problem

    @property
    def complete(self) -> bool:
        """Whether nothing is left to do in the model, or the inner orientation, but to accept."""
        if self.next_point is not None or self.next_photo is not None or not self.may_accept:
            return False
        measured = None if self.inner is not None or self.leaves else self.solution
        return measured is None or not measured.unexplained

    @property
    def expected(self) -> str:
        """What the operator is expected to do, one sentence."""
        return self.agenda.sentence


_SUSPENDED = Agenda((Step("resume", "work is suspended: resume"),))
_LEAVES = Agenda(
    (Step("remeasure", "remeasure, add or switch points"), Step("accept", "accept")),
    "it stays as it was",
)


def _finished(state: SessionState) -> Agenda:
    what = "strip" if len(state.block.strips) == 1 else "block"
    return Agenda((), f"every model is accepted: the {what} is finished")


def next_model(state: SessionState) -> tuple[str, str, str] | None:
    """Return (strip, left, right) of the first model not yet accepted, or None."""
    accepted = {model.photos for model in state.models}
    for strip in state.block.strips:
        for left, right in strip.models():
            if (left, right) not in accepted:
                return strip.id, left, right
    return None


def outlook(state: SessionState) -> Outlook:
    """Say what stands and what comes next."""
    following = next_model(state)
    if state.current is None:
        if following is None:
            agenda = _finished(state)
        else:
            lay = Step("lay", f"lay photos {following[1]} and {following[2]}")
            agenda = Agenda((lay,), "next model")
        if state.suspended:
            agenda = _SUSPENDED
        return Outlook(None, None, "", None, agenda, False, following, following is None)
    model = state.current
    if model.open_inner is not None:
        return _inner(state, model.open_inner, following)
    solution: ModelSolution | None = None
    diagnosis: Diagnosis | None = None
    problem, too_few = "", False
    suspects: tuple[str, ...] = ()
    interchange: Interchange | None = None
    if model.measured:
        try:
            solution = solve(state, model)
            diagnosis = diagnosis_of(solution)
            suspects = tuple(dict.fromkeys(point for point, _ in diagnosis.suspects))
            interchange = diagnosis.interchange
        except WrongPointsError as error:
            problem, suspects = str(error), error.suspects
            interchange = error.interchange
        except NotComputableError as error:
            problem, too_few = str(error), isinstance(error, TooFewError)
    step = next_step(
        model,
        suspects,
        solved=solution is not None,
        again=_again(state, model),
        interchanged=() if interchange is None else interchange.points,
        unexplained="" if solution is None or suspects else solution.unexplained,
    )
    agenda, leaves = step.agenda, state.returned is not None and state.unchanged
    if leaves and step.point is None and step.lay is None:
        agenda = _LEAVES
    return Outlook(
        solution=solution,
        diagnosis=diagnosis,
        problem=problem,
        next_point=step.point,
        agenda=_SUSPENDED if state.suspended else agenda,
        may_accept=(solution is not None or leaves) and not state.suspended,
        next_model=following,
        finished=False,
        next_photo=None if state.suspended else step.lay,
        leaves=leaves,
        interchange=interchange,
        too_few=too_few,
    )


def _again(state: SessionState, model: ModelState) -> Again | None:
    """Return what the operator returned to the model for, or None."""
    returned = state.returned
    if returned is None or returned.point is None:
        return None
    if returned.photo is None:
        return Again(returned.point)
    return Again(returned.point, "left" if returned.photo == model.left else "right")


def _inner(
    state: SessionState, inner: InnerState, following: tuple[str, str, str] | None
) -> Outlook:
    view = inner_outlook(state.block, inner)
    leaves = state.returned is not None and state.unchanged and not inner.measured
    return Outlook(
        solution=None,
        diagnosis=None,
        problem=view.problem,
        next_point=view.next_fiducial,
        agenda=_SUSPENDED if state.suspended else view.agenda,
        may_accept=(view.solution is not None or leaves) and not state.suspended,
        next_model=following,
        finished=False,
        inner=view,
        leaves=leaves,
        too_few=view.too_few,
    )
