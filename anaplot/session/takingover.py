"""The part of the fold that is about rows of accepted models which were switched elsewhere."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import groupby
from typing import NamedTuple

from anaplot.session.copied import copied
from anaplot.session.events import DecidedRow
from anaplot.session.modelstate import ModelState
from anaplot.session.reasons import RowReason
from anaplot.session.refusal import EventRefusedError
from anaplot.session.returning import AsAccepted, following, recomputed_since, replaced

__all__ = ["Decided", "decided"]


class Decided(NamedTuple):
    """What rows that were switched make of a session; all as in `SessionState`."""

    models: tuple[ModelState, ...]
    current: ModelState | None
    parked: ModelState | None
    recomputed: tuple[AsAccepted, ...]
    reasons: tuple[RowReason, ...]


def decided(now: Decided, rows: Iterable[DecidedRow]) -> Decided:
    """Switch rows of accepted models.

    A model to which the operator has returned follows where it says the same still.

    Parameters
    ----------
    now
        The session before.
    rows
        The rows, those of a model together.

    Raises
    ------
    EventRefusedError
        A model that is not accepted, or that has no such row.
    """
    before = now.models
    changed = []
    for photos, group in groupby(rows, lambda row: (row.left, row.right)):
        mine = tuple(group)
        old = next((m for m in now.models if m.photos == photos), None)
        if old is None:
            raise EventRefusedError(f"model {'/'.join(photos)} is not accepted")
        new = _switched(old, mine)
        models, current = replaced(now.models, now.current, new)
        _, parked = replaced(now.models, now.parked, new)
        if current is not None and current.photos == photos:
            same = [r for r in mine if current.measurement(r.point) == old.measurement(r.point)]
            current = _switched(current, same)
        now = Decided(models, current, parked, now.recomputed, _with_reasons(now.reasons, mine))
        changed.append(new)
    after = now.recomputed
    for new in changed:
        after = recomputed_since(after, following(now.models, new), before)
    return now._replace(recomputed=after)


def _switched(model: ModelState, rows: Iterable[DecidedRow]) -> ModelState:
    off = set(model.off)
    for row in rows:
        if model.measurement(row.point) is None or row.axis not in model.axes(row.point):
            raise EventRefusedError(
                f"model {model.name} has no row {row.axis} of point {row.point}"
            )
        (off.discard if row.on else off.add)((row.point, row.axis))
    return copied(model, off=frozenset(off))


def _with_reasons(
    reasons: tuple[RowReason, ...], rows: tuple[DecidedRow, ...]
) -> tuple[RowReason, ...]:
    given = {(f"{r.left}/{r.right}", r.point, r.axis): r.reason for r in rows if not r.on}
    others = (r for r in reasons if r[:3] not in given)
    return (*others, *(RowReason(*row, reason) for row, reason in given.items()))
