"""What computing models anew has changed, since a model before them was accepted again."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf

from anaplot.adjustment.tested import Observation
from anaplot.errors import NotComputableError
from anaplot.orientation.results import ModelSolution, Row
from anaplot.session.models import solve
from anaplot.session.modelstate import ModelState
from anaplot.session.state import SessionState

__all__ = ["Recomputed", "recomputed_models"]

_ANY = 0.05  # um; below it a residual reads the same


@dataclass(frozen=True, slots=True)
class Recomputed:
    """An accepted model that is another than it was when it was accepted.

    Attributes
    ----------
    strip, left, right
        Names.
    sigma0_um
        Before and now [um]; None where there is none.
    newly_flagged, no_longer
        Rows (point, axis) that are flagged only now, and that are not flagged any more.
    row, change_um
        The row whose residual has changed most, and by how much [um]; None where no row is in
        both.
    why
        Why it cannot be computed now, or "".
    """

    strip: str
    left: str
    right: str
    sigma0_um: tuple[float | None, float | None]
    newly_flagged: tuple[Row, ...] = ()
    no_longer: tuple[Row, ...] = ()
    row: Row | None = None
    change_um: float | None = None
    why: str = ""

    @property
    def name(self) -> str:
        """'left/right'."""
        return f"{self.left}/{self.right}"

    def in_words(self) -> str:
        """Return what has changed, in a few words."""
        if self.why:
            return self.why
        before, after = ("none" if s is None else f"{s:.2f}" for s in self.sigma0_um)
        said = [f"sigma0 {after} um, was {before}"]
        for rows, what in (
            (self.newly_flagged, "flagged now"),
            (self.no_longer, "flagged no longer"),
        ):
            if rows:
                said.append(f"{what}: {', '.join(f'{point} {axis}' for point, axis in rows)}")
        if self.row is not None and self.change_um is not None:
            point, axis = self.row
            said.append(f"largest change {self.change_um:.1f} um at {point} {axis}")
        return "; ".join(said)


def recomputed_models(state: SessionState) -> tuple[Recomputed, ...]:
    """Return the accepted models whose tables are others than when they were accepted, in order."""
    known = {one.photos: one.models for one in state.recomputed}
    found = []
    for model in state.models:
        if model.photos in known:
            was = replace(state, models=known[model.photos])
            one = _compared(model, was, state)
            if one is not None:
                found.append(one)
    return tuple(found)


def _compared(model: ModelState, was: SessionState, now: SessionState) -> Recomputed | None:
    """Compare a model's tables; None when they say the same."""
    before, _ = _solved(was, was.accepted(*model.photos))
    after, why = _solved(now, model)
    names = (model.strip, model.left, model.right)
    sigma0 = (
        None if before is None else before.sigma0_um,
        None if after is None else after.sigma0_um,
    )
    if before is None or after is None:
        return None if before is after else Recomputed(*names, sigma0, why=why)
    old = {row.key: row for row in before.listed}
    new = {row.key: row for row in after.listed}
    changes = {key: abs(new[key].residual - old[key].residual) for key in new if key in old}
    worst = max(changes, key=lambda key: changes[key], default=None)
    largest = inf if old.keys() != new.keys() else 0.0
    if worst is not None:
        largest = max(largest, changes[worst])
    if largest <= _ANY and _flagged(before) == _flagged(after):
        return None
    return Recomputed(
        *names,
        sigma0,
        tuple(row.key for row in after.flagged if row.key not in _flagged(before)),
        tuple(row.key for row in before.flagged if row.key not in _flagged(after)),
        worst,
        None if worst is None else changes[worst],
    )


def _flagged(solution: ModelSolution) -> set[Row]:
    rows: tuple[Observation[Row], ...] = solution.flagged
    return {row.key for row in rows}


def _solved(state: SessionState, model: ModelState | None) -> tuple[ModelSolution | None, str]:
    if model is None:
        return None, ""
    try:
        return solve(state, model), ""
    except NotComputableError as error:
        return None, str(error)
