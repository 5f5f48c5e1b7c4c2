"""The demonstration as text: each model before and after, and what became of the mistakes."""

from __future__ import annotations

from collections.abc import Iterable

from anaplot.orientation.diagnosis import diagnose
from anaplot.photogrammetry.platetransformation import TITLES
from anaplot.report import astext
from anaplot.report.innerdocument import fiducial_table
from anaplot.report.modeldocument import model_rows
from anaplot.simulation.automatic import Handled, InnerRecord, ModelRecord
from anaplot.simulation.demo import Outcome
from anaplot.simulation.mistakes import Planted
from anaplot.textfiles.wording import plain

__all__ = ["model_story", "outcome_text"]


def model_story(record: ModelRecord) -> str:
    """Return a model's tables before and after, and what was done in between."""
    lines = [f"MODEL {plain(record.left)}/{plain(record.right)}"]
    for inner in record.inners:
        lines += _inner_story(inner, [h for h in record.handled if h.photo == inner.photo])
    points = [h for h in record.handled if not h.photo]
    if record.before is not None:
        lines += [f"  pattern complete, {_sigma(record.before.sigma0_um)}"]
        lines += astext.table_lines(
            model_rows(record.before.table, diagnose(record.before).suspects)
        )
    lines += _actions(points)
    if points and record.after is not None:
        lines += [f"  accepted, {_sigma(record.after.sigma0_um)}"]
        lines += astext.table_lines(model_rows(record.after.table, diagnose(record.after).suspects))
    elif record.after is not None:
        lines.append("  nothing flagged: accepted")
    return "\n".join(lines)


def _inner_story(record: InnerRecord, handled: list[Handled]) -> list[str]:
    """Return what happened in an inner orientation; its tables when something was wrong in it."""
    lines = []
    title = f"  photo {plain(record.photo)} ({record.side})"
    if handled and record.before is not None:
        lines.append(f"{title}: fiducials measured, {_sigma(record.before.sigma0_um)}")
        lines += astext.table_lines(fiducial_table(record.before))
        lines += _actions(handled)
    if record.after is None:
        return lines
    lines.append(f"{title}: {TITLES[record.after.kind]} accepted, {_sigma(record.after.sigma0_um)}")
    if handled:
        lines += astext.table_lines(fiducial_table(record.after))
    return lines


def _actions(handled: Iterable[Handled]) -> list[str]:
    rows = [(plain(h.point) + ("" if h.axis is None else f" ({h.axis})"), h) for h in handled]
    return [f"  {'fiducial ' if h.photo else ''}{row} {h.action}" for row, h in rows]


def _sigma(sigma0_um: float | None) -> str:
    return "sigma0 none" if sigma0_um is None else f"sigma0 {sigma0_um:.2f} um"


def _entries(title: str, entries: Iterable[Planted]) -> list[str]:
    lines = [
        f"    {p.model}  {plain(p.point):<8} {p.axis}  {p.size_um:9.1f} um  {_kind(p)}"
        + ("" if p.detectable or p.kind == "none" else _elsewhere(p))
        for p in entries
    ]
    return [f"  {title}: {len(lines) or 'none'}", *lines]


def _kind(planted: Planted) -> str:
    if planted.kind == "wrong fiducial":
        return f"{planted.kind} of photo {plain(planted.photo)}"
    return planted.kind


def _elsewhere(planted: Planted) -> str:
    if planted.shows_in is None:
        return "  (no model can show it)"
    return f"  (not detectable here, shows in {planted.shows_in})"


def outcome_text(seed: int, outcome: Outcome) -> str:
    """Return what was planted and what became of it."""
    lines = [f"MISTAKES PLANTED WITH SEED {seed}"]
    lines += _entries("planted", outcome.planted)
    lines += _entries("found", outcome.found)
    lines += _entries("repaired by measuring again", outcome.repaired)
    lines += _entries("missed although detectable", outcome.missed)
    lines += _entries("flagged without a mistake", outcome.false_flags)
    return "\n".join(lines)
