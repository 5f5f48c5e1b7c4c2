"""What the help screen says: the screen, its columns, the signs, the keys."""

from __future__ import annotations

from collections.abc import Mapping

from textual.content import Content

from anaplot.console.keybar import show_key
from anaplot.console.keys import ACTIONS
from anaplot.console.text import fit, wrap

__all__ = ["help_lines"]

_SCREEN = (
    (
        "",
        "The top lines name block, photos, model, link, the variance of ties, the test, and "
        "the model's sigma0 and redundancy r. Below them the read-out: image coordinates and "
        "parallaxes px = x' - x'', py = y' - y'' in mm, then what to do now.",
    ),
    ("SIMULATED", "No instrument is connected: the plotter is a simulated one."),
)
_COLUMNS = (
    (
        "RED-N",
        "Redundancy number: the share of an error of this row that shows in its own "
        "parallax. 0: nothing controls it; 1: everything does.",
    ),
    (
        "PARX µm",
        "Parallax left at the point, in micrometres in the image. y rows: parallax "
        "of the point; x rows: discrepancy of a tie against the preceding model.",
    ),
    (
        "EXPD µm",
        "Its expected standard deviation. Under the tau test it follows the "
        "estimated sigma0, under baarda the a-priori one.",
    ),
    (
        "SIGF",
        "PARX / EXPD without sign. Above the critical value the row is flagged: "
        "<< REMEASURE. A dash: not testable.",
    ),
    ("FINDS µm", "Smallest error of this row that the test finds with its stated power."),
    ("ODDS %", "Probability that this row holds the one gross error."),
)
_MAP = (
    ("○ ● ! x", "Open, measured, flagged, switched off. (●) is where the plates are or drive to."),
    ("lines", "Residuals: y rows upright, x rows level; the bar gives their scale in micrometres."),
    (
        "arrows",
        "Critical transfers: an error at the arrow's foot shows at least as large at "
        "its head. Look at both before you remeasure.",
    ),
)


def _section(title: str, pairs: tuple[tuple[str, str], ...], width: int) -> list[Content]:
    lines = [Content(""), Content.styled(title, "bold")]
    for name, sentence in pairs:
        for i, part in enumerate(wrap(sentence, width - 14)):
            head = fit(name if i == 0 else "", 14)
            lines.append(Content.assemble((head, "bold $text-accent"), part))
    return lines


def help_lines(keys: Mapping[str, tuple[str, ...]], width: int) -> list[Content]:
    """Return the help for the keys in force, wrapped to `width` cells."""
    named = tuple(
        (" ".join(show_key(key) for key in keys[action.id]), action.help) for action in ACTIONS
    )
    palette = (
        ("^p", "The command palette: all of these by name, and points to drive to."),
        ("^q ^c", "Leave, as q does; a second time without a question."),
    )
    return [
        *_section("The screen", _SCREEN, width)[1:],
        *_section("The table", _COLUMNS, width),
        *_section("The map", _MAP, width),
        *_section("Keys", named + palette, width),
    ]
