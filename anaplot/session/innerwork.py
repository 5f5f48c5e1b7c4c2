"""What an inner orientation says so far, and what is expected of the operator in it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import cast

from anaplot.aliases import Axis
from anaplot.errors import NotComputableError, TooFewError
from anaplot.photogrammetry.block import Block, TestSettings
from anaplot.photogrammetry.camera import CameraCalibration
from anaplot.photogrammetry.inner import InnerOrientation, orient_inner
from anaplot.photogrammetry.inneradvice import inner_advice
from anaplot.photogrammetry.platetransformation import TransformationName
from anaplot.session.events import InnerAccepted
from anaplot.session.innerstate import InnerState
from anaplot.session.nextstep import Agenda, Step

__all__ = ["InnerOutlook", "acceptance", "inner_outlook", "solve_inner"]

Suspect = tuple[str, Axis | None]


@dataclass(frozen=True, slots=True, eq=False)
class InnerOutlook:
    """What an inner orientation stands at, and what comes next in it.

    Attributes
    ----------
    state
        What was measured.
    solution
        The inner orientation, as far as it is determined.
    problem
        Why there is none, or "".
    suspects
        Rows (fiducial, axis) to measure again, the one to begin with first; axis None: the
        fiducial as a whole.
    advice
        Sentences for the operator, the most useful first.
    next_fiducial
        The fiducial to measure next: pending, or to be measured again; None when there is none.
    agenda
        What the operator may do, the most urgent first.
    too_few
        Whether the problem is that too few fiducials are measured yet.
    """

    state: InnerState
    solution: InnerOrientation | None
    problem: str
    suspects: tuple[Suspect, ...]
    advice: tuple[str, ...]
    next_fiducial: str | None
    agenda: Agenda
    too_few: bool


def solve_inner(block: Block, inner: InnerState) -> InnerOrientation:
    """Find the transformation plate -> image from the fiducials measured so far.

    Raises
    ------
    NotComputableError
        They do not determine it (yet); says why.
    """
    calibration = block.camera_of(inner.photo).calibration
    if calibration is None:
        raise NotComputableError(f"{inner.name}: its camera has no fiducials")
    # how often a fiducial was measured does not matter: undoing and redoing meet the same result
    measured = tuple((m.fiducial, m.x, m.y) for m in inner.used)
    return _solve(calibration, measured, inner.off, block.precision.image_um, block.test)


@lru_cache(maxsize=512)
def _solve(
    calibration: CameraCalibration,
    measured: tuple[tuple[str, float, float], ...],
    off: frozenset[tuple[str, Axis]],
    apriori_um: float,
    test: TestSettings,
) -> InnerOrientation:
    return orient_inner(
        calibration,
        {fiducial: (x, y) for fiducial, x, y in measured},
        apriori_um=apriori_um,
        test=test,
        off=off,
    )


def acceptance(inner: InnerState, solution: InnerOrientation) -> InnerAccepted:
    """Return the event that accepts a solution."""
    found = solution.transformation
    # measured fiducials never give the identity
    kind = cast(TransformationName, found.kind)
    return InnerAccepted(
        inner.photo, inner.side, kind, found.frame, found.numerator, found.denominator
    )


def inner_outlook(block: Block, inner: InnerState) -> InnerOutlook:
    """Say what an inner orientation stands at and what comes next in it."""
    solution: InnerOrientation | None = None
    problem, too_few = "", False
    if inner.used:
        try:
            solution = solve_inner(block, inner)
        except NotComputableError as error:
            problem, too_few = str(error), isinstance(error, TooFewError)
    suspects = () if solution is None else _suspects(inner, solution)
    pending = inner.pending
    again = suspects[0][0] if suspects else None
    steps: tuple[Step, ...] = ()
    remark = ""
    if again is not None:
        steps = (Step("remeasure", f"remeasure fiducial {again}", again),)
    if pending:
        next_fiducial: str | None = pending[0]
        words = f"measure fiducial {pending[0]} of {inner.name}"
        steps = (*steps, Step("measure", words, pending[0]))
        remark = f"{len(pending)} of {len(pending) + len(inner.measured)} to go"
    elif again is not None:
        next_fiducial = again
        off = Step("switch off", "switch it off", again)
        steps = (*steps, off, Step("accept", "accept the inner orientation"))
    elif solution is not None:
        next_fiducial = None
        steps = (Step("accept", f"accept the inner orientation of {inner.name}"),)
        if solution.refused:
            steps = (Step("remeasure", "sigma0 is too large: measure fiducials again"), *steps)
    else:
        next_fiducial = None
        steps = (Step("remeasure", f"re-measure fiducials of {inner.name}"),)
        remark = "its inner orientation is not determined"
    return InnerOutlook(
        state=inner,
        solution=solution,
        problem=problem,
        suspects=suspects,
        advice=() if solution is None else _advice(inner, solution),
        next_fiducial=next_fiducial,
        agenda=Agenda(steps, remark),
        too_few=too_few,
    )


def _suspects(inner: InnerState, solution: InnerOrientation) -> tuple[Suspect, ...]:
    if solution.exchanged is not None:
        return tuple((name, None) for name in solution.exchanged)
    flagged = solution.flagged
    if not flagged and (solution.locatable or not solution.refused):
        return ()
    if solution.locatable:
        keys = [row.key if inner.rows else (row.point, None) for row in flagged]
        return tuple(dict.fromkeys(keys))
    # which one is wrong cannot be known: each is measured again, in turn
    times = {m.fiducial: m.times for m in inner.measured}
    names = dict.fromkeys(row.point for row in solution.rows)
    return tuple((name, None) for name in sorted(names, key=times.__getitem__))


def _advice(inner: InnerState, solution: InnerOrientation) -> tuple[str, ...]:
    # what is still to be measured, the table says; what was switched off is known to the operator
    sentences = inner_advice(replace(solution, unmeasured=()))
    off = [f"{name} {axis}" for name in inner.fiducials for axis in ("x", "y")
           if (name, axis) in inner.off]  # fmt: skip
    return (*sentences, f"switched off: {', '.join(off)}") if off else sentences
