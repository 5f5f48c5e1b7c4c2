"""Results as the JSON that other programs read (conventions, "What programs read")."""

from __future__ import annotations

from typing import Any

from anaplot.report.innerdocument import photo_document
from anaplot.report.modeldocument import model_rows
from anaplot.simulation.automatic import ModelRecord
from anaplot.simulation.demo import Outcome
from anaplot.simulation.mistakes import Planted

__all__ = ["demo_json"]

Json = dict[str, Any]


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
                "before": []
                if record.before is None
                else model_rows(record.before.table).records(),
                "after": [] if record.after is None else model_rows(record.after.table).records(),
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
