"""Names of an adjusted block's observations, and units of what is said of them."""

from __future__ import annotations

from anaplot.bundle.solve.observations import ObservationName
from anaplot.report.document import Answer, Line, say

__all__ = ["SHOWN_UNITS", "in_words", "name_json"]

SHOWN_UNITS = {
    "um": (1.0, "um"),
    "m": (1e3, "mm"),
    "rad": (1e6, "urad"),
    "mm": (1e3, "um"),
    "m/s": (1e3, "mm/s"),
    "m/photo": (1e3, "mm/photo"),
}
"""What people read of an observation's unit: times how much, and in which unit."""


def in_words(name: ObservationName) -> Line:
    """Return an observation in words."""
    kind, first, *rest = name
    if kind == "image":
        point, model, axis = rest
        inside = "" if model is None else say(" in {}", model)
        return say("photo {}{}  point {}  {}", first, inside, point, axis)
    if kind == "condition":
        return say("{}  {} of {}", first, rest[1], rest[0])
    words = {"control": "control point {}  {}", "point prior": "prior of point {}  {}"}
    return say(words.get(str(kind), "prior of {}  {}"), first, rest[0])


def name_json(name: ObservationName) -> Answer:
    """Return an observation for programs: its kind, and what it belongs to."""
    keys = {
        "image": ("photo", "point", "model", "axis"),
        "control": ("point", "axis"),
        "point prior": ("point", "axis"),
        "prior": ("owner", "unknown"),
        "condition": ("id", "what", "axis"),
    }[str(name[0])]
    return {"kind": name[0], **dict(zip(keys, name[1:], strict=True))}
