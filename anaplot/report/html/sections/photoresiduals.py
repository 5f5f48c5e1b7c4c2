"""Residual vectors photo by photo, the worst photos first."""

from __future__ import annotations

from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.photochecks import photo_checks
from anaplot.report.document import say
from anaplot.report.figures.residuals import photo_residuals
from anaplot.report.html.parts import HtmlBlock, Section

__all__ = ["MOST_PHOTOS", "photo_residuals_section"]

MOST_PHOTOS = 24
"""Photos whose residuals a page draws."""

_OPEN = 3  # photos that are not folded


def photo_residuals_section(block: AdjustedBlock) -> Section | None:
    """Return the section of the residual vectors of photos; None where no ray counts."""
    checks = photo_checks(block)
    there = [k for k, one in enumerate(checks) if one.rays]
    if not there:
        return None

    def worst(k: int) -> tuple[int, float]:
        one = checks[k]
        return -one.flagged, -((one.rms_x_um or 0.0) ** 2 + (one.rms_y_um or 0.0) ** 2)

    chosen = sorted(there, key=worst)[:MOST_PHOTOS]
    blocks: list[HtmlBlock] = []
    if len(chosen) < len(there):
        blocks.append(
            say(
                "{} of {} photos are drawn: those with the most flagged coordinates, then those "
                "with the largest residuals; the table of the photos has all",
                len(chosen),
                len(there),
            ).of("remark")
        )
    for count, k in enumerate(chosen):
        name = block.problem.photos[k]
        drawn = photo_residuals(block, name)
        if drawn is None:
            continue
        if count < _OPEN:
            blocks.append(drawn)
        else:
            title = say("Photo {}", name)
            if checks[k].flagged:
                title += say(": {} flagged", checks[k].flagged)
            blocks.append(Section(f"residuals-of-{k + 1}", title, (drawn,), True, "untitled"))
    return Section("photo-residuals", "Residuals photo by photo", tuple(blocks))
