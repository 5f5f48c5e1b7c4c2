"""Tables as the journal keeps them, and whether one computed later is the same."""

from __future__ import annotations

from collections.abc import Sequence
from math import isclose
from typing import Any, NamedTuple

from anaplot.adjustment.tested import Observation
from anaplot.orientation.results import ModelSolution, Row
from anaplot.photogrammetry.inner import InnerOrientation
from anaplot.session.innerstate import InnerState
from anaplot.station.payloads import RecordedInnerTable, RecordedTable, Value
from anaplot.textfiles.wording import plain

__all__ = ["inner_table_difference", "inner_table_payload", "table_difference", "table_payload"]

_RELATIVE = 1e-9  # tables agree to this, whatever machine recorded them
_ABSOLUTE_UM = 1e-6
_NOISE_UM = 1e-4  # of an expected residual that is 0: the root of rounding errors


class _Table(NamedTuple):
    name: str
    sigma0_um: float | None
    rows: Sequence[dict[str, Value]]


# Apart from the columns of the documents (report/modeldocument, report/innerdocument) on purpose:
# JSON may gain keys, while the order of a journal's values belongs to the version of its format.


def _model_row(row: Observation[Row]) -> dict[str, Value]:
    """Return the columns of a model's table in the order in which the journal has them."""
    return {
        "point": row.point,
        "axis": row.axis,
        "redn": row.r,
        "parx_um": row.residual,
        "expd_um": row.expected,
        "sigf": row.size,
        "flagged": row.flagged,
    }


def _inner_row(row: Observation[Row]) -> dict[str, Value]:
    """Return the columns of an inner orientation's table, likewise."""
    return {
        "fiducial": row.point,
        "axis": row.axis,
        "redn": row.r,
        "residual_um": row.residual,
        "expd_um": row.expected,
        "sigf": row.size,
        "flagged": row.flagged,
        "mdb_um": row.mdb,
        "probability": row.probability,
    }


def table_payload(solution: ModelSolution) -> dict[str, Any]:
    """Return a model's table for the journal."""
    return {
        "model": solution.name,
        "redundancy": solution.redundancy,
        "sigma0_um": solution.sigma0_um,
        "rows": [list(row.values()) for row in map(_model_row, solution.table)],
    }


def inner_table_payload(inner: InnerState, solution: InnerOrientation) -> dict[str, Any]:
    """Return an inner orientation's table for the journal."""
    return {
        "photo": inner.photo,
        "side": inner.side,
        "transformation": solution.kind,
        "redundancy": solution.redundancy,
        "sigma0_um": solution.sigma0_um,
        "rows": [list(row.values()) for row in map(_inner_row, solution.rows)],
    }


def table_difference(recorded: RecordedTable, solution: ModelSolution | None) -> str | None:
    """Compare a recorded table with the one computed now; None when they agree."""
    name = f"model {plain(recorded.model)}"
    if solution is None or solution.name != recorded.model:
        return f"{name}: there is a recorded table, but none is computed now"
    rows = list(map(_model_row, solution.table))
    return _difference(recorded, _Table(name, solution.sigma0_um, rows))


def inner_table_difference(
    recorded: RecordedInnerTable, inner: InnerState | None, solution: InnerOrientation | None
) -> str | None:
    """Compare a recorded inner orientation with the one computed now; None when they agree."""
    name = f"photo {recorded.photo} ({recorded.side})"
    if inner is None or solution is None or inner.name != name:
        return f"{plain(name)}: there is a recorded inner orientation, but none is computed now"
    if recorded.transformation != solution.kind:
        return f"{plain(name)}: {solution.kind} instead of {plain(recorded.transformation)}"
    rows = list(map(_inner_row, solution.rows))
    return _difference(recorded, _Table(plain(name), solution.sigma0_um, rows))


def _difference(recorded: RecordedTable | RecordedInnerTable, table: _Table) -> str | None:
    if not _same(recorded.sigma0_um, table.sigma0_um):
        return f"{table.name}: sigma0 {table.sigma0_um} instead of {recorded.sigma0_um}"
    if len(recorded.rows) != len(table.rows):
        return f"{table.name}: {len(table.rows)} rows instead of {len(recorded.rows)}"
    for values, row in zip(recorded.rows, table.rows, strict=True):
        if len(values) != len(row):
            return f"{table.name}: rows of {len(values)} values instead of {len(row)}"
        for (name, now), was in zip(row.items(), values, strict=True):
            if not _same(was, now, _NOISE_UM if name == "expd_um" else _ABSOLUTE_UM):
                which, axis, *_ = row.values()
                where = plain(f"{table.name}, row {which} {axis}")
                return f"{where}: {name} {now} instead of {plain(str(was))}"
    return None


def _same(was: Value, now: Value, absolute: float = _ABSOLUTE_UM) -> bool:
    if isinstance(was, bool) or isinstance(now, bool):
        return was is now
    if isinstance(was, float) and isinstance(now, float | int):
        return isclose(was, now, rel_tol=_RELATIVE, abs_tol=absolute)
    return was == now
