"""The block page, and the one line that the block is worth beside the model's advice."""

from __future__ import annotations

from textual.content import Content

from anaplot.console.describe import Entry
from anaplot.console.panels import entry_lines
from anaplot.console.text import cell, fit, fit_end, number, wrap
from anaplot.station.blockview import BlockView, SuspectedPoint, SuspectedRay, percent
from anaplot.textfiles.wording import plain

__all__ = ["TITLE", "block_page"]

TITLE = "The block as one bundle"

_LABEL = 14
_MOST = 100  # points on the page; whoever has more begins with the first
_POINT, _PHOTO, _MODEL = 15, 12, 17


def block_page(view: BlockView | None, width: int) -> list[Content]:
    """Return the page: figures, suspected points, and what only now shows up.

    Parameters
    ----------
    view
        What the block says; None before there is anything to adjust.
    width
        Cells of a line.
    """
    if view is None:
        return [
            Content(line)
            for line in wrap(
                "Nothing is in the block yet: it begins with the first model whose pattern is "
                "complete and no y row of which is flagged.",
                width,
            )
        ]
    lines = entry_lines(_figures(view), width, _LABEL)
    if view.solved:
        lines += [Content(""), *_suspects(view, width)]
    return lines


def _figures(view: BlockView) -> list[Entry]:
    models = "1 model" if view.models == 1 else f"{view.models} models"
    newest = f"{models} of this session, the newest {view.after}"
    if not view.after:
        newest = "no model of this session yet, rows from elsewhere"
    entries = [("in it", newest + (", still to be accepted" if view.provisional else ""))]
    if view.busy:
        entries.append(("", "what was measured since is being adjusted"))
    if not view.solved:
        if view.remark:
            entries.append(("no solution", view.remark))
        return entries
    entries.append(("size", f"{view.photos} photos, {view.points} points, {view.rays} rays"))
    if view.sigma0 is None or view.sigma0_um is None:
        entries.append(("sigma0", "none: no redundancy, nothing is checked"))
    else:
        entries.append(
            ("sigma0", f"{view.sigma0:.2f} ({view.sigma0_um:.2f} µm), redundancy {view.redundancy}")
        )
    critical = "none" if view.critical is None else f"{view.critical:.2f}"
    entries.append(("test", f"{view.test}, critical value {critical}"))
    if view.ri_x is not None and view.ri_y is not None:
        entries.append(("mean RED-N", f"x {view.ri_x:.2f}, y {view.ri_y:.2f}"))
    free = "free: control does not suffice yet" if view.datum == "free" else "control and priors"
    entries.append(("datum", free))
    if view.aside:
        entries.append(("not joined yet", "photos " + ", ".join(view.aside)))
    newly = [point.point for point in view.suspects if point.newly]
    if newly:
        entries.append(("only now", f"{', '.join(newly)}: earlier, and not flagged before"))
    return entries


def _suspects(view: BlockView, width: int) -> list[Content]:
    if not view.suspects:
        return [Content("No point is flagged.")]
    head = (
        f"{'POINT':<{_POINT}}{'PHOTO':<{_PHOTO}}{'MODEL':<{_MODEL}}{'AXIS':<5}{'W':>8}{'RED-N':>7}"
    )
    lines = [Content.styled(fit(head, width), "bold $foreground-muted")]
    for point in view.suspects[:_MOST]:
        lines += _point(point, width)
    if len(view.suspects) > _MOST:
        lines.append(Content(f"and {len(view.suspects) - _MOST} more points"))
    advice = "One error may flag its neighbours: remeasure the first point, then look again."
    if len(view.suspects) > 1:
        lines += [
            Content(""),
            *(Content.styled(s, "$foreground-muted") for s in wrap(advice, width)),
        ]
    return lines


def _point(point: SuspectedPoint, width: int) -> list[Content]:
    lines = []
    for k, row in enumerate(point.flagged):
        cells = (
            fit_end(point.point if k == 0 else "", _POINT - 1)
            + " "
            + fit_end(row.photo, _PHOTO - 1)
            + " "
            + fit_end(row.model or "elsewhere", _MODEL - 1)
            + " "
            + fit(row.axis, 5)
            + number(row.w, 8, 2)
            + cell(row.r, 7, 3)
        )
        lines.append(Content.styled(fit(cells, width), "bold $text-error" if k == 0 else ""))
    verdict = "wrong: " + ", ".join(_chance(ray) for ray in point.rays[:3])
    if point.newly:
        verdict = f"only now ({point.since}), {verdict}"
    lines += [Content(f"  {line}") for line in wrap(verdict, width - 2)]
    return lines


def _chance(ray: SuspectedRay) -> str:
    where = f" ({plain(ray.model)})" if ray.model is not None else ""
    return f"photo {plain(ray.photo)}{where} {percent(ray.probability)}"
