"""The overview: where the block stands, as lines of text, and what is under its cursor."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from textual.content import Content

from anaplot.console.keybar import show_key
from anaplot.console.text import cell, fit, fit_end, wrap
from anaplot.station.blockstatus import BlockStatus, ModelStanding, ModelStatus, StripStatus
from anaplot.station.blockstep import NextStep
from anaplot.station.blockview import BlockView

__all__ = [
    "HEADINGS",
    "SIGNS",
    "Entry",
    "doing",
    "entries_of",
    "foot_lines",
    "map_lines",
    "model_text",
    "strip_text",
    "verdict",
]

SIGNS: dict[ModelStanding, str] = {
    "open": "○",
    "in work": "◆",
    "accepted": "●",
    "recomputed": "~",
    "look": "!",
}
_NAMES = 21
HEADINGS = (
    f"    {'MODEL':<{_NAMES}}{'STATE':<11}{'SIGMA0 µm':>9}"
    f"{'REDUND':>8}{'FLAGGED':>9}{'OFF':>5}{'TIES':>6}"
)


@dataclass(frozen=True, slots=True)
class Entry:
    """A line of the overview: a strip, or one of its models."""

    strip: StripStatus
    model: ModelStatus | None = None


def entries_of(status: BlockStatus) -> tuple[Entry, ...]:
    """Return all lines, every strip before its models."""
    return tuple(
        entry
        for strip in status.strips
        for entry in (Entry(strip), *(Entry(strip, model) for model in strip.models))
    )


def strip_text(strip: StripStatus, width: int) -> str:
    """Return the line of a strip."""
    count = len(strip.models)
    words = f"{strip.done} of {count} model{'' if count == 1 else 's'} accepted"
    pooled = strip.pooled_um
    if pooled is not None:
        words += f", pooled sigma0 {pooled:.2f} µm"
    return fit(
        f" STRIP {fit(strip.strip, min(len(strip.strip) * 2, 20)).rstrip()}   {words}", width
    )


def model_text(model: ModelStatus, width: int, *, here: bool, following: bool) -> str:
    """Return the line of a model.

    `here`: the cursor is on it. `following`: it is the one to be measured next.
    """
    half = (_NAMES - 4) // 2
    names = f"{fit_end(model.left, half).rstrip()} | {fit_end(model.right, half).rstrip()}"
    start = f"{'▶' if here else ' '} {SIGNS[model.state]} {fit(names, _NAMES)}"
    state = "next" if following and model.state == "open" else model.state
    if model.state == "open":
        return fit(f"{start}{state}", width)
    figures = (
        cell(model.sigma0_um, 9, 2)
        + f"{'–' if model.redundancy is None else model.redundancy:>8}"
        + f"{model.flagged:>9}{model.off:>5}{model.ties:>6}"
    )
    return fit(f"{start}{state:<11}{figures}", width)


def doing(step: NextStep, lead: str | None, keys: Mapping[str, tuple[str, ...]]) -> str:
    """Return the key of what is next, or the command where it is none of the console's.

    Parameters
    ----------
    step
        What is next.
    lead
        The action with which the model in work goes on, see `now.leading`; None without one.
    keys
        Those in force, by action.
    """
    if step.do == "adjust":
        return step.command
    if step.do in ("return", "tie"):
        return show_key(keys["drive"][0])
    if step.do == "report":
        return show_key(keys["report"][0])
    action = "accept" if step.do == "accept" else lead or "next_model"
    return show_key(keys[action][0])


def verdict(view: BlockView | None) -> str:
    """Return what the block as one bundle is worth, in one line."""
    if view is None:
        return "nothing is in it yet"
    if not view.solved:
        return view.remark or "being adjusted for the first time"
    flagged = sum(len(point.flagged) for point in view.suspects)
    sigma0 = "none" if view.sigma0_um is None else f"{view.sigma0_um:.2f} µm"
    words = f"{view.photos} photos, {view.points} points, sigma0 {sigma0}, "
    words += f"{flagged} flagged" if flagged else "nothing flagged"
    if view.datum == "free":
        words += ", free of control"
    return words + (", being adjusted anew" if view.busy else "")


def foot_lines(status: BlockStatus, doing: str, width: int, height: int) -> list[Content]:
    """Return what holds of the block as a whole, at most so many lines.

    Parameters
    ----------
    status
        Where it stands.
    doing
        The key, or the command, of what is next.
    width, height
        Cells of a line, and lines.
    """
    lines = [_labelled("block", verdict(status.block), width)]
    seen, facts = status.coverage, []
    if len(status.strips) > 1:
        facts.append(f"lateral ties {seen.lateral_ties}")
    if seen.control:
        facts.append(f"control {seen.control_seen} of {seen.control} measured")
    if facts:
        lines.append(_labelled("joined", ",   ".join(facts), width))
    following = wrap(f"{status.next.words}: {doing}", max(width - 9, 1))[:2]
    last = [
        _labelled("next" if i == 0 else "", words, width, "bold")
        for i, words in enumerate(following)
    ]
    room = max(height - len(lines) - len(last), 0)
    spots = [line for spot in status.weak_spots for line in wrap(f"! {spot.words}", width - 9)]
    if len(spots) > room:
        # one line each, with an ellipsis
        spots = [f"! {spot.words}" for spot in status.weak_spots]
    if len(spots) > room:
        kept = max(room - 1, 0)
        spots = [*spots[:kept], f"! and {len(spots) - kept} more to look at"][:room]
    lines += [
        _labelled("look" if i == 0 else "", words, width, "bold $text-error")
        for i, words in enumerate(spots)
    ]
    weak = status.weak_photos[: max(height - len(lines) - len(last), 0)]
    lines += [_labelled("" if i else "weak", words, width) for i, words in enumerate(weak)]
    return [*lines, *last][:height]


def _labelled(label: str, words: str, width: int, style: str = "") -> Content:
    return Content.assemble((f" {label:<8}", "$foreground-muted"), (fit(words, width - 9), style))


def map_lines(
    status: BlockStatus, selected: ModelStatus | None, width: int, height: int
) -> list[Content]:
    """Return the block as a map: a sign for every model, a line or more for every strip."""
    legend = ", ".join(f"{sign} {state}" for state, sign in SIGNS.items())
    lines = [Content.styled(fit(" BLOCK", width), "bold $foreground-muted"), Content("")]
    name = min(max((len(strip.strip) for strip in status.strips), default=1), 12) + 2
    first = min(max((len(model.left) for model in status.models), default=1), 12)
    room = max(width - name - first - 3, 1)
    for strip in status.strips:
        for start in range(0, max(len(strip.models), 1), room):
            part = strip.models[start : start + room]
            title = fit_end(strip.strip, name - 2) if start == 0 else " " * (name - 2)
            photo = fit_end(part[0].left, first) if part else ""
            lines.append(
                Content.assemble(
                    (f" {title} {photo:>{first}} ", "$foreground-muted"),
                    *((SIGNS[model.state], _style(model, selected)) for model in part),
                )
            )
    legends = [
        Content(""),
        *(Content.styled(f" {x}", "$foreground-muted") for x in wrap(legend, width - 2)),
    ]
    room = max(height - len(legends), 0)
    if len(lines) > room:
        lines = [*lines[: max(room - 1, 0)], Content(f" and {len(lines) - room + 1} lines more")]
    return [*lines, *legends][:height]


def _style(model: ModelStatus, selected: ModelStatus | None) -> str:
    style = {"look": "bold $text-error", "in work": "bold $text-accent", "open": "$text-muted"}.get(
        model.state, ""
    )
    here = selected is not None and model.name == selected.name
    return f"{style} reverse".strip() if here else style
