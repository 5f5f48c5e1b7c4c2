"""Tables as the journal keeps them, and whether one computed later is the same."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isclose
from typing import Any, NamedTuple

from anaplot.orientation.results import ModelSolution, TableRow
from anaplot.photogrammetry.inner import InnerOrientation, InnerRow
from anaplot.session.innerstate import InnerState

__all__ = ["inner_table_difference", "inner_table_payload", "table_difference", "table_payload"]

_RELATIVE = 1e-9  # tables agree to this, whatever machine recorded them
_ABSOLUTE_UM = 1e-6


class _Table(NamedTuple):
    name: str
    sigma0_um: float | None
    rows: Sequence[TableRow | InnerRow]


def table_payload(solution: ModelSolution) -> dict[str, Any]:
    """Return a model's table for the journal."""
    return {
        "model": solution.name,
        "redundancy": solution.redundancy,
        "sigma0_um": solution.sigma0_um,
        "rows": [list(row) for row in solution.table],
    }


def inner_table_payload(inner: InnerState, solution: InnerOrientation) -> dict[str, Any]:
    """Return an inner orientation's table for the journal."""
    return {
        "photo": inner.photo,
        "side": inner.side,
        "transformation": solution.kind,
        "redundancy": solution.redundancy,
        "sigma0_um": solution.sigma0_um,
        "rows": [list(row) for row in solution.rows],
    }


def table_difference(payload: Mapping[str, Any], solution: ModelSolution | None) -> str | None:
    """Compare a recorded table with the one computed now; None when they agree."""
    name = f"model {payload.get('model')}"
    if solution is None or solution.name != payload.get("model"):
        return f"{name}: there is a recorded table, but none is computed now"
    return _difference(payload, _Table(name, solution.sigma0_um, solution.table))


def inner_table_difference(
    payload: Mapping[str, Any], inner: InnerState | None, solution: InnerOrientation | None
) -> str | None:
    """Compare a recorded inner orientation with the one computed now; None when they agree."""
    name = f"photo {payload.get('photo')} ({payload.get('side')})"
    if inner is None or solution is None or inner.name != name:
        return f"{name}: there is a recorded inner orientation, but none is computed now"
    if payload.get("transformation") != solution.kind:
        return f"{name}: {solution.kind} instead of {payload.get('transformation')}"
    return _difference(payload, _Table(name, solution.sigma0_um, solution.rows))


def _difference(payload: Mapping[str, Any], table: _Table) -> str | None:
    if not _same(payload.get("sigma0_um"), table.sigma0_um):
        return f"{table.name}: sigma0 {table.sigma0_um} instead of {payload.get('sigma0_um')}"
    rows = payload.get("rows", [])
    if len(rows) != len(table.rows):
        return f"{table.name}: {len(table.rows)} rows instead of {len(rows)}"
    for recorded, row in zip(rows, table.rows, strict=True):
        if len(recorded) != len(row):
            return f"{table.name}: rows of {len(recorded)} values instead of {len(row)}"
        for name, was, now in zip(row._fields, recorded, row, strict=True):
            if not _same(was, now):
                return f"{table.name}, row {row.key[0]} {row.axis}: {name} {now} instead of {was}"
    return None


def _same(was: object, now: object) -> bool:
    if isinstance(was, float | int) and isinstance(now, float | int) and not isinstance(now, bool):
        return isclose(was, now, rel_tol=_RELATIVE, abs_tol=_ABSOLUTE_UM)
    return was == now
