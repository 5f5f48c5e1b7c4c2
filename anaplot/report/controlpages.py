"""`adjust --control-page`: a page for every ground control and check point."""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot
from typing import Any

from anaplot.bundle.hypotheses.controlpages import ControlPage, ControlPart, Movement, WithoutPoint
from anaplot.report.columns import counted
from anaplot.report.document import Answer, Block, Document, Line, named, say

__all__ = ["control_pages_document"]

_XYZ = ("X", "Y", "Z")
_WORDS = {
    "good": "good",
    "look": "something is flagged: look at it",
    "weak": "hardly checked: only a large error shows",
    "unchecked": "checked by nothing: an error of any size stays unseen",
}


def control_pages_document(pages: Sequence[ControlPage]) -> Document:
    """Return the part of a document about control and check points, each by itself."""
    lines: list[Block] = [say("CONTROL AND CHECK POINTS, one by one").of("heading")]
    if not pages:
        lines.append(say("  no control point takes part"))
    for page in pages:
        lines += _lines(page)
    lines += [
        say("  FOUND FROM: the smallest error found with the power of [test], along the worst"),
        say("  direction in plan; WITHOUT: what the photographs would make of the point, to first"),
        say("  order, and what would move"),
    ]
    return Document([_json(page) for page in pages], tuple(lines), ())


def _lines(page: ControlPage) -> list[Block]:
    kind = {
        "control": "control",
        "check": "check point",
        "fixed": "control, free of error",
        "rejected": "control, rejected",
    }
    head = say("  {}  {}, {}: {}", page.point, kind[page.use],
               counted(len(page.rays), "image"), _WORDS[page.verdict])  # fmt: skip
    lines: list[Block] = [head.of("look") if page.verdict == "look" else head]
    if page.rejected and page.use == "control":
        lines.append(say("    rejected: {}", named(page.rejected)).of("look"))
    for word, part in (("plan", page.plan), ("height", page.height)):
        if part is not None:
            lines.append(_part(word, part))
    if page.without is not None:
        lines += _without(page.without)
    elif page.use == "control":
        lines.append(say("    without it the block, or the point itself, is not determined"))
    if page.use == "check":
        lines.append(say("    off by {}", _with_sigmas(page.difference, page.s)))
    for ray in page.rays:
        size = 1.0 if ray.pixel_um is None else ray.pixel_um
        unit = "um" if ray.pixel_um is None else "px"
        x, y = (value / size for value in ray.v)
        line = say("    {}  {:+.2f} {:+.2f} {}", ray.photo, x, y, unit)
        lines.append((line + "  << CHECK").of("look") if ray.flagged else line)
    return lines


def _part(word: str, part: ControlPart) -> Line:
    line = say("    {}", word)
    if part.r is not None:
        line += say("  r {:.3f}", part.r)
    if part.detectable is None:
        return line + "  found at no size"
    line += say("  found from {:.3f|m}", part.detectable)
    if part.effect is not None:
        line += say(", undetected it moves {}", _movement(part.effect))
    return line


def _without(found: WithoutPoint) -> list[Line]:
    what = "it"
    if found.held:
        mine = [
            axis for axis, value in zip(_XYZ, found.difference, strict=True) if value is not None
        ]
        verb = "stays" if len(found.held) == 1 else "stay"
        what = f"its {', '.join(mine)} ({', '.join(found.held)} {verb} held)"
    lines = [say("    without {} off by {}", what, _with_sigmas(found.difference, found.s))]
    if found.farthest is not None:
        mean, rms = found.heights
        lines.append(
            say("      moves {}; heights of the others {:+.4f|m} in the mean, {:.4f|m} rms",
                _movement(found.farthest), mean, rms)
        )  # fmt: skip
    return lines


def _movement(move: Movement) -> Line:
    return say("{} by {:.3f|m}", move.point, hypot(*move.by))


def _with_sigmas(values: Sequence[float | None], sigmas: Sequence[float | None]) -> Line:
    line = say("")
    for axis, value, sigma in zip(_XYZ, values, sigmas, strict=True):
        if value is not None:
            line += say("{} {:+.3f} +- {:.3f}  ", axis, value, sigma)
    return line + "m"


def _json(page: ControlPage) -> Answer:
    return {
        "point": page.point,
        "use": page.use,
        "verdict": page.verdict,
        "rejected": list(page.rejected),
        "images": len(page.rays),
        "plan": _part_json(page.plan),
        "height": _part_json(page.height),
        "without": None if page.without is None else _without_json(page.without),
        "difference": list(page.difference),
        "s": list(page.s),
        "rays": [
            {
                "photo": ray.photo,
                "vx_um": ray.v[0],
                "vy_um": ray.v[1],
                "vx_px": None if ray.pixel_um is None else ray.v[0] / ray.pixel_um,
                "vy_px": None if ray.pixel_um is None else ray.v[1] / ray.pixel_um,
                "flagged": ray.flagged,
            }
            for ray in page.rays
        ],
    }


def _part_json(part: ControlPart | None) -> dict[str, Any] | None:
    if part is None:
        return None
    return {
        "r": part.r,
        "mdb": part.detectable,
        "largest_effect": None if part.effect is None else list(part.effect.by),
        "largest_effect_at": None if part.effect is None else part.effect.point,
    }


def _without_json(found: WithoutPoint) -> dict[str, Any]:
    return {
        "difference": list(found.difference),
        "s": list(found.s),
        "farthest": None if found.farthest is None else list(found.farthest.by),
        "farthest_at": None if found.farthest is None else found.farthest.point,
        "heights_mean": found.heights[0],
        "heights_rms": found.heights[1],
        "held": list(found.held),
    }
