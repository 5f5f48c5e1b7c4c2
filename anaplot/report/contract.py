"""Results as the JSON that other programs read (conventions, "What programs read")."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from anaplot.adjustment.tested import Observation
from anaplot.orientation.results import ModelSolution, Row
from anaplot.orientation.strip import BridgedStrip
from anaplot.report.innerdocument import photo_document
from anaplot.simulation.automatic import ModelRecord
from anaplot.simulation.demo import Outcome
from anaplot.simulation.mistakes import Planted

__all__ = ["bridge_json", "demo_json", "model_json", "table_json"]

Json = dict[str, Any]


def table_json(table: Iterable[Observation[Row]]) -> list[Json]:
    """Return the rows of a table; what does not exist is None."""
    return [
        {
            "point": row.point,
            "axis": row.axis,
            "redn": row.r,
            "parx_um": row.residual,
            "expd_um": row.expected,
            "sigf": row.size,
            "flagged": row.flagged,
        }
        for row in table
    ]


def model_json(model: ModelSolution) -> Json:
    """Return one model; angles in radians, base and points in mm, residuals in um."""
    omega, phi, kappa = model.rotation
    return {
        "left": model.left,
        "right": model.right,
        "base": list(model.base),
        "rotation": {"omega": omega, "phi": phi, "kappa": kappa},
        "sigma0_um": model.sigma0_um,
        "redundancy": model.redundancy,
        "iterations": model.iterations,
        "test": {
            "kind": model.test.kind,
            "alpha": model.test.alpha,
            "critical": model.test.critical,
        },
        "table": table_json(model.table),
        "points": [
            {"point": p.point, "X": _number(p.X), "Y": _number(p.Y), "Z": _number(p.Z)}
            for p in model.points
        ],
        "ties": list(model.ties),
        "condition": model.condition,
        "odds": _odds_json(model),
        "remarks": list(model.remarks),
    }


def _odds_json(model: ModelSolution) -> Json:
    """Return the probabilities of no gross error, and of one in each row."""
    return {
        "none": model.tested.odds.none,
        "rows": [
            {"point": row.point, "axis": row.axis, "probability": row.probability}
            for row in model.table
        ],
    }


def bridge_json(strips: Iterable[BridgedStrip]) -> Json:
    """Return all strips; a strip that ended early carries "error" beside its models."""
    out = []
    for strip in strips:
        item: Json = {"strip": strip.strip, "models": [model_json(m) for m in strip.models]}
        if strip.error is not None:
            item["error"] = strip.error
        out.append(item)
    return {"strips": out}


def demo_json(seed: int, outcome: Outcome) -> Json:
    """Return what became of the planted mistakes, and every table before and after."""

    def entry(planted: Planted) -> Json:
        return dict(planted._asdict())

    return {
        "seed": seed,
        "planted": [entry(p) for p in outcome.planted],
        "found": [entry(p) for p in outcome.found],
        "repaired": [entry(p) for p in outcome.repaired],
        "missed": [entry(p) for p in outcome.missed],
        "false_flags": [entry(p) for p in outcome.false_flags],
        "models": [
            {
                "left": record.left,
                "right": record.right,
                "before": [] if record.before is None else table_json(record.before.table),
                "after": [] if record.after is None else table_json(record.after.table),
                "handled": [
                    {"point": h.point, "axis": h.axis, "action": h.action}
                    for h in record.handled
                    if not h.photo
                ],
                **({"inner": _inners_json(record)} if record.inners else {}),
            }
            for record in outcome.models
        ],
    }


def _inners_json(record: ModelRecord) -> list[Json]:
    """Return the inner orientations of a model's photos, before and after re-measurements."""
    return [
        {
            "photo": inner.photo,
            "side": inner.side,
            "before": None
            if inner.before is None
            else photo_document(inner.photo, inner.before).to_dict(),
            "after": None
            if inner.after is None
            else photo_document(inner.photo, inner.after).to_dict(),
            "handled": [
                {"fiducial": h.point, "axis": h.axis, "action": h.action}
                for h in record.handled
                if h.photo == inner.photo
            ],
        }
        for inner in record.inners
    ]


def _number(value: float) -> float | None:
    return value if abs(value) < float("inf") else None
